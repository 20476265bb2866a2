//! Purposes of file choosers, and chosen files.

use std::path::{Path, PathBuf};

use calib_editor::images::has_ending;

/// Purpose of the chosen files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Site to open.
    OpenSite,
    /// File for the site.
    SaveSite,
    /// File for the site without its images.
    SavePlain,
    /// Images of new cameras.
    AddImages,
    /// Floor plan.
    LoadPlan,
    /// Replacement for the image of the current camera.
    ReplaceStill,
    /// Newer images of cameras.
    NewerStill,
    /// Saved version to compare with.
    Compare,
    /// Lenses or cameras of another program.
    Import,
    /// Folder for exported files.
    Export,
    /// File for a screenshot.
    SavePicture,
    /// File for the report.
    SaveReport,
}

/// Chosen file.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// Name without folders.
    pub name: String,
    /// Path; `None` in the browser.
    pub path: Option<PathBuf>,
    /// Content; only in the browser.
    pub bytes: Option<Vec<u8>>,
}

impl Chosen {
    /// Creates a chosen file from a path.
    pub(crate) fn of_path(path: PathBuf) -> Self {
        let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        Self { name, path: Some(path), bytes: None }
    }

    /// Whether the file is a site, by its ending.
    pub(crate) fn is_site(&self) -> bool {
        has_ending(Path::new(&self.name), "json")
    }
}

/// Endings of images.
pub(crate) const IMAGES: &[&str] = &["png", "jpg", "jpeg"];
/// Endings of plans.
pub(crate) const PLANS: &[&str] = &["png", "jpg", "jpeg", "svg"];
/// Endings of sites.
pub(crate) const SITE: &[&str] = &["json"];
