//! What files are asked for, and those that were chosen.

use std::path::{Path, PathBuf};

use calib_editor::images::has_ending;

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
    /// Newer stills of cameras.
    NewerStill,
    /// A saved version to compare with.
    Compare,
    /// Lenses or cameras of another program.
    Import,
    /// The folder for what other programs take.
    Export,
    /// Where to save a picture of a view.
    SavePicture,
    /// Where to save the report.
    SaveReport,
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

impl Chosen {
    /// A file on a disk.
    pub(crate) fn of_path(path: PathBuf) -> Self {
        let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        Self { name, path: Some(path), bytes: None }
    }

    /// Whether it is a site, by its name.
    pub(crate) fn is_site(&self) -> bool {
        has_ending(Path::new(&self.name), "json")
    }
}

/// Endings of stills.
pub(crate) const IMAGES: &[&str] = &["png", "jpg", "jpeg"];
/// Endings of plans.
pub(crate) const PLANS: &[&str] = &["png", "jpg", "jpeg", "svg"];
/// Endings of sites.
pub(crate) const SITE: &[&str] = &["json"];
