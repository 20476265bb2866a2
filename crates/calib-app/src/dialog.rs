//! The system's file chooser, asked without holding up the frame.

use std::future::Future;
use std::path::PathBuf;
use std::pin::Pin;
use std::task::{Context, Poll, Waker};

/// What the chosen files are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// A site to open.
    OpenSite,
    /// Where to save the site.
    SaveSite,
    /// Stills of new cameras.
    AddImages,
    /// The floor plan.
    LoadPlan,
    /// Another still of the camera in hand.
    ReplaceStill,
    /// A saved version to compare with.
    Compare,
    /// Lenses or cameras of another program.
    Import,
    /// The folder for what other programs take.
    Export,
    /// Where to save a picture of a view.
    SavePicture,
}

/// A file that was chosen.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// Its name without folders.
    pub name: String,
    /// Where it is; not in the browser.
    pub path: Option<PathBuf>,
    /// What is in it; only in the browser.
    pub bytes: Option<Vec<u8>>,
}

/// A chooser that is open.
pub struct Dialog {
    /// What for.
    pub purpose: Purpose,
    answer: Answer,
}

impl std::fmt::Debug for Dialog {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Dialog").field("purpose", &self.purpose).finish_non_exhaustive()
    }
}

impl Dialog {
    /// Opens a chooser.
    #[must_use]
    pub fn open(purpose: Purpose) -> Self {
        let dialog = rfd::AsyncFileDialog::new();
        let images: &[&str] = &["png", "jpg", "jpeg"];
        let site: &[&str] = &["json"];
        let answer: Answer = match purpose {
            Purpose::AddImages => {
                let files = dialog.set_title("Add images").add_filter("Images", images).pick_files();
                Box::pin(async move { chosen(files.await.unwrap_or_default()).await })
            }
            Purpose::SaveSite => {
                let file = dialog
                    .set_title("Save site")
                    .add_filter("Site", site)
                    .set_file_name("site.json")
                    .save_file();
                Box::pin(async move { saved(file.await).await })
            }
            Purpose::OpenSite | Purpose::Compare => {
                let file = dialog.set_title("Open site").add_filter("Site", site).pick_file();
                Box::pin(async move { chosen(file.await.into_iter().collect()).await })
            }
            Purpose::ReplaceStill => {
                let file = dialog.set_title("Choose an image").add_filter("Images", images).pick_file();
                Box::pin(async move { chosen(file.await.into_iter().collect()).await })
            }
            Purpose::LoadPlan => {
                let plans = &["png", "jpg", "jpeg", "svg"];
                let file = dialog.set_title("Choose a floor plan").add_filter("Plans", plans).pick_file();
                Box::pin(async move { chosen(file.await.into_iter().collect()).await })
            }
            Purpose::Import => {
                let files = dialog.set_title("Import lenses or cameras").pick_files();
                Box::pin(async move { chosen(files.await.unwrap_or_default()).await })
            }
            Purpose::SavePicture => {
                let picture = dialog.set_title("Save a picture").add_filter("Picture", &["png"]);
                let file = picture.set_file_name("view.png").save_file();
                Box::pin(async move { saved(file.await).await })
            }
            Purpose::Export => folder(dialog),
        };
        Self { purpose, answer }
    }

    /// A chooser that was answered before it was opened: for tests and scripts.
    #[must_use]
    pub fn answered(purpose: Purpose, chosen: Vec<Chosen>) -> Self {
        Self { purpose, answer: Box::pin(std::future::ready(chosen)) }
    }

    /// What was chosen, once the operator is done; nothing if the chooser was closed.
    pub fn poll(&mut self) -> Option<Vec<Chosen>> {
        let mut context = Context::from_waker(Waker::noop());
        match self.answer.as_mut().poll(&mut context) {
            Poll::Ready(chosen) => Some(chosen),
            Poll::Pending => None,
        }
    }
}

type Answer = Pin<Box<dyn Future<Output = Vec<Chosen>>>>;

#[cfg(not(target_arch = "wasm32"))]
fn folder(dialog: rfd::AsyncFileDialog) -> Answer {
    let folder = dialog.set_title("Export into a folder").pick_folder();
    Box::pin(async move { chosen(folder.await.into_iter().collect()).await })
}

/// The browser has a folder of its own for what is downloaded.
#[cfg(target_arch = "wasm32")]
fn folder(_: rfd::AsyncFileDialog) -> Answer {
    Box::pin(std::future::ready(vec![Chosen {
        name: String::new(),
        path: Some(PathBuf::new()),
        bytes: None,
    }]))
}

#[cfg(not(target_arch = "wasm32"))]
async fn chosen(files: Vec<rfd::FileHandle>) -> Vec<Chosen> {
    let one = |file: rfd::FileHandle| Chosen {
        name: file.file_name(),
        path: Some(file.path().to_path_buf()),
        bytes: None,
    };
    files.into_iter().map(one).collect()
}

#[cfg(target_arch = "wasm32")]
async fn chosen(files: Vec<rfd::FileHandle>) -> Vec<Chosen> {
    let mut list = Vec::new();
    for file in files {
        list.push(Chosen { name: file.file_name(), path: None, bytes: Some(file.read().await) });
    }
    list
}

async fn saved(file: Option<rfd::FileHandle>) -> Vec<Chosen> {
    #[cfg(not(target_arch = "wasm32"))]
    {
        chosen(file.into_iter().collect()).await
    }
    #[cfg(target_arch = "wasm32")]
    {
        // Nothing is read from where one writes to.
        file.into_iter().map(|file| Chosen { name: file.file_name(), path: None, bytes: None }).collect()
    }
}
