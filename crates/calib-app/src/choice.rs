//! Purposes of file choosers, and chosen files.

use std::path::PathBuf;

use crate::drawing::DRAWINGS;

/// Purpose of the chosen files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Files of any kind to open: a site with its images, images, a plan, files of another program.
    Open,
    /// File to which the site is saved.
    SaveSite,
    /// File to which the site is saved without its images.
    SavePlain,
    /// Images of new cameras.
    AddImages,
    /// Image of the floor plan, with its world file.
    LoadPlan,
    /// Replacement for the image of the current camera.
    ReplaceStill,
    /// Newer images of calibrated cameras, for a comparison.
    NewerStill,
    /// Saved version of the site, to compare the open site with.
    Compare,
    /// Files of another program with lenses or cameras.
    Import,
    /// Folder into which files are exported.
    Export,
    /// File to which a screenshot is saved.
    SavePicture,
    /// File to which the report is saved.
    SaveReport,
}

impl Purpose {
    /// Returns the file name ending of a saved file; `None` for files to read, and for folders.
    pub(crate) const fn saved_ending(self) -> Option<&'static str> {
        match self {
            Self::SaveSite | Self::SavePlain => Some("json"),
            Self::SavePicture => Some("png"),
            Self::SaveReport => Some("html"),
            _ => None,
        }
    }
}

/// File that the operator chose or dropped.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// Name of the file without folders.
    pub name: String,
    /// Path of the file; `None` in the browser.
    pub path: Option<PathBuf>,
    /// Content of the file, in the browser only.
    pub bytes: Option<Vec<u8>>,
}

impl Chosen {
    /// Creates a chosen file from a path.
    pub(crate) fn of_path(path: PathBuf) -> Self {
        let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        Self { name, path: Some(path), bytes: None }
    }
}

/// Returns the file name endings of images.
pub(crate) fn images() -> Vec<&'static str> {
    calib_input::image_endings().collect()
}

/// Returns the file name endings of images and videos.
pub(crate) fn images_and_videos() -> Vec<&'static str> {
    calib_input::image_endings().chain(calib_input::VIDEO_ENDINGS).collect()
}

/// Returns the file name endings of floor plans.
pub(crate) fn plans() -> Vec<&'static str> {
    calib_input::image_endings().chain(DRAWINGS).collect()
}

/// File name endings of site files.
pub(crate) const SITE: &[&str] = &["json"];
