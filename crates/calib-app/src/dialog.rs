//! The system's file chooser, asked without holding up the frame.

use std::future::Future;
use std::path::PathBuf;
use std::pin::Pin;
use std::task::{Context, Poll, Waker};
use std::time::Duration;

use web_time::Instant;

use crate::plan::world_endings;

/// What the chosen files are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// A site to open.
    OpenSite,
    /// Where to save the site.
    SaveSite,
    /// Where to save the site without its images.
    SavePlain,
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

/// Nobody closes a chooser faster.
const UNSEEN: Duration = Duration::from_millis(400);

/// A chooser that is open.
pub struct Dialog {
    /// What for.
    pub purpose: Purpose,
    opened: Option<Instant>,
    answer: Pin<Box<dyn Future<Output = Vec<Chosen>>>>,
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
        Self { purpose, opened: Some(Instant::now()), answer: Box::pin(ask(purpose)) }
    }

    /// A chooser that was answered before it was opened: for tests and scripts.
    #[must_use]
    pub fn answered(purpose: Purpose, chosen: Vec<Chosen>) -> Self {
        Self { purpose, opened: None, answer: Box::pin(std::future::ready(chosen)) }
    }

    /// Whether it has been open for so short a time that nobody can have seen it.
    #[must_use]
    pub fn is_just_opened(&self) -> bool {
        self.opened.is_some_and(|opened| opened.elapsed() < UNSEEN)
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

const IMAGES: &[&str] = &["png", "jpg", "jpeg"];
const PLANS: &[&str] = &["png", "jpg", "jpeg", "svg"];
const SITE: &[&str] = &["json"];

#[cfg(not(target_arch = "wasm32"))]
fn ask(purpose: Purpose) -> impl Future<Output = Vec<Chosen>> {
    let dialog = rfd::AsyncFileDialog::new();
    let one = |file: rfd::FileHandle| Chosen {
        name: file.file_name(),
        path: Some(file.path().to_path_buf()),
        bytes: None,
    };
    let site = |title: &str| dialog.clone().set_title(title).add_filter("Site", SITE);
    let images = |title: &str| dialog.clone().set_title(title).add_filter("Images", IMAGES);
    let answer: Pin<Box<dyn Future<Output = Vec<rfd::FileHandle>>>> = match purpose {
        Purpose::AddImages => {
            let files = images("Add images").pick_files();
            Box::pin(async { files.await.unwrap_or_default() })
        }
        Purpose::SaveSite | Purpose::SavePlain => {
            let file = site("Save site").set_file_name("site.json").save_file();
            Box::pin(async { file.await.into_iter().collect() })
        }
        Purpose::OpenSite | Purpose::Compare => {
            let file = site("Open site").pick_file();
            Box::pin(async { file.await.into_iter().collect() })
        }
        Purpose::ReplaceStill => {
            let file = images("Choose an image").pick_file();
            Box::pin(async { file.await.into_iter().collect() })
        }
        Purpose::LoadPlan => {
            let endings = [PLANS, world_endings()].concat();
            let files = dialog.set_title("Choose a floor plan").add_filter("Plans", &endings).pick_files();
            Box::pin(async { files.await.unwrap_or_default() })
        }
        Purpose::Import => {
            let files = dialog.set_title("Import lenses or cameras").pick_files();
            Box::pin(async { files.await.unwrap_or_default() })
        }
        Purpose::SavePicture => {
            let picture = dialog.set_title("Save a picture").add_filter("Picture", &["png"]);
            let file = picture.set_file_name("view.png").save_file();
            Box::pin(async { file.await.into_iter().collect() })
        }
        Purpose::Export => {
            let folder = dialog.set_title("Export into a folder").pick_folder();
            Box::pin(async { folder.await.into_iter().collect() })
        }
    };
    async move { answer.await.into_iter().map(one).collect() }
}

/// A file that is saved is a download: there is nothing to ask.
#[cfg(target_arch = "wasm32")]
async fn ask(purpose: Purpose) -> Vec<Chosen> {
    match purpose {
        Purpose::SaveSite | Purpose::SavePlain => {
            vec![Chosen { name: "site.json".into(), path: Some("site.json".into()), bytes: None }]
        }
        // A site comes together with its images.
        Purpose::OpenSite => crate::web::pick(&[SITE, IMAGES].concat(), true).await,
        Purpose::Compare => crate::web::pick(SITE, false).await,
        Purpose::AddImages => crate::web::pick(IMAGES, true).await,
        Purpose::ReplaceStill => crate::web::pick(IMAGES, false).await,
        // A plan may come with its world file.
        Purpose::LoadPlan => crate::web::pick(&[PLANS, world_endings()].concat(), true).await,
        Purpose::Import => crate::web::pick(&[], true).await,
        Purpose::SavePicture => {
            vec![Chosen { name: "view.png".into(), path: Some("view.png".into()), bytes: None }]
        }
        // The browser has a folder of its own for what is downloaded.
        Purpose::Export => vec![Chosen { name: String::new(), path: Some(PathBuf::new()), bytes: None }],
    }
}
