//! The browser's file chooser.

use std::path::PathBuf;

use calib_editor::world_endings;

use super::pick;
use crate::choice::{Chosen, IMAGES, PLANS, Purpose, SITE};

/// A file that is saved is a download: there is nothing to ask.
pub(super) async fn ask(purpose: Purpose) -> Vec<Chosen> {
    match purpose {
        Purpose::SaveSite | Purpose::SavePlain => {
            vec![Chosen { name: "site.json".into(), path: Some("site.json".into()), bytes: None }]
        }
        // A site comes together with its images.
        Purpose::OpenSite => pick(&[SITE, IMAGES].concat(), true).await,
        Purpose::Compare => pick(SITE, false).await,
        Purpose::AddImages | Purpose::NewerStill => pick(IMAGES, true).await,
        Purpose::ReplaceStill => pick(IMAGES, false).await,
        // A plan may come with its world file.
        Purpose::LoadPlan => pick(&[PLANS, world_endings()].concat(), true).await,
        Purpose::Import => pick(&[], true).await,
        Purpose::SavePicture => {
            vec![Chosen { name: "view.png".into(), path: Some("view.png".into()), bytes: None }]
        }
        Purpose::SaveReport => {
            vec![Chosen { name: "report.html".into(), path: Some("report.html".into()), bytes: None }]
        }
        // The browser has a folder of its own for what is downloaded.
        Purpose::Export => vec![Chosen { name: String::new(), path: Some(PathBuf::new()), bytes: None }],
    }
}
