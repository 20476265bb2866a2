//! Files that need a decision: conflicts, typed paths, images outside the site's folder, images being read.

use std::collections::BTreeSet;
use std::path::PathBuf;

use calib_editor::NewImage;
use calib_plan::{DrawingFacts, ImagePosition};
use calib_site::Plan;

use crate::choice::Purpose;
use crate::platform::Task;

/// Reason for not writing a file without asking the operator.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Why {
    /// Change of the file since it was read; contains the differences as sentences.
    Changed(Vec<String>),
    /// Write protection of the file.
    ReadOnly,
}

/// Conflict on saving: a file that is not written without asking the operator.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Conflict {
    /// Path of the file to write.
    pub path: PathBuf,
    /// Reason for asking.
    pub why: Why,
}

/// Decision of the operator about a conflict on saving.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    /// Discards the conflict and opens the current version of the file. The unsaved work remains as an autosave.
    Reload,
    /// Saves to another file.
    SaveAs,
    /// Overwrites the file.
    Overwrite,
    /// Does not write the file.
    Leave,
}

/// Field in which the operator types a path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PathField {
    /// Purpose of the file.
    pub purpose: Purpose,
    /// Typed text.
    pub text: String,
}

/// Images that the site names outside its folder, and the decisions about them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Outside {
    /// Images outside the folder of the site that the operator must still allow or refuse to read, as canonical
    /// paths.
    pub asked: BTreeSet<PathBuf>,
    /// Files that the operator decided not to read, as canonical paths.
    pub(crate) left: BTreeSet<PathBuf>,
    /// Image names of the site at the last check.
    pub(crate) names: Vec<String>,
}

/// Image file that was read, for a camera or for the plan.
#[derive(Debug)]
pub(crate) struct ReadPicture {
    pub(crate) still: NewImage,
    /// PNG of an SVG drawing that was rasterised, or of an image that only the browser can decode; otherwise `None`.
    pub(crate) drawn: Option<Vec<u8>>,
    /// Properties of a drawing; `None` for other images.
    pub(crate) drawing: Option<DrawingFacts>,
    /// Position of a georeferenced image on the map.
    pub(crate) position: Option<ImagePosition>,
    /// Time at which the image was taken (RFC 3339), from its name or its EXIF data.
    pub(crate) taken: Option<String>,
}

/// Result of reading an image file.
pub(crate) type Read = Result<ReadPicture, String>;

/// Plan image that is being read.
#[derive(Debug)]
pub(crate) struct Planning {
    pub(crate) picture: Task<Read>,
    /// Plan entry from the world file of the image, if it has one.
    pub(crate) world_file: Option<Plan>,
}
