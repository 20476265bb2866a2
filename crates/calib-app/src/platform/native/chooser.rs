//! The system's file chooser.

use std::pin::Pin;

use calib_editor::world_endings;

use crate::choice::{Chosen, IMAGES, PLANS, Purpose, SITE};
use crate::platform::Answer;

/// Asks for files, or for where to put them.
pub(super) fn ask(purpose: Purpose) -> Answer {
    let dialog = rfd::AsyncFileDialog::new();
    let one = |file: rfd::FileHandle| Chosen {
        name: file.file_name(),
        path: Some(file.path().to_path_buf()),
        bytes: None,
    };
    let site = |title: &str| dialog.clone().set_title(title).add_filter("Site", SITE);
    let images = |title: &str| dialog.clone().set_title(title).add_filter("Images", IMAGES);
    let answer: Pin<Box<dyn Future<Output = Vec<rfd::FileHandle>>>> = match purpose {
        Purpose::AddImages | Purpose::NewerStill => {
            let what = if purpose == Purpose::AddImages { "Add images" } else { "Choose newer stills" };
            let files = images(what).pick_files();
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
        Purpose::SaveReport => {
            let page = dialog.set_title("Save the report").add_filter("Page", &["html"]);
            let file = page.set_file_name("report.html").save_file();
            Box::pin(async { file.await.into_iter().collect() })
        }
        Purpose::Export => {
            let folder = dialog.set_title("Export into a folder").pick_folder();
            Box::pin(async { folder.await.into_iter().collect() })
        }
    };
    Box::pin(async move { answer.await.into_iter().map(one).collect() })
}
