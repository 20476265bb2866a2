//! Files that need a decision: conflicts, typed paths, images outside the site's folder, images being read.

use std::collections::BTreeSet;
use std::path::PathBuf;

use calib_editor::NewImage;
use calib_site::Plan;

use crate::choice::Purpose;
use crate::platform::Task;

/// Reason for not writing a file without asking.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Why {
    /// The file changed since it was read; the differences as sentences.
    Changed(Vec<String>),
    /// The file is read-only.
    ReadOnly,
}

/// File that is not written without asking.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Conflict {
    /// Path of the file.
    pub path: PathBuf,
    /// Reason.
    pub why: Why,
}

/// Decision of the operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    /// Opens the file as it is now; the work on the open site is kept as an autosave.
    Reload,
    /// Saves to another file.
    SaveAs,
    /// Overwrites the file.
    Overwrite,
    /// Writes nothing.
    Leave,
}

/// Path that is being typed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PathField {
    /// Purpose of the file.
    pub purpose: Purpose,
    /// Typed text.
    pub text: String,
}

/// Images that the site names outside its folder.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Outside {
    /// Files that wait for a decision, as canonical paths.
    pub asked: BTreeSet<PathBuf>,
    /// Files that are not read.
    pub(crate) left: BTreeSet<PathBuf>,
    /// Image names of the site at the last check.
    pub(crate) names: Vec<String>,
}

/// Image file that was read, for a camera or for the plan.
#[derive(Debug)]
pub(crate) struct ReadPicture {
    pub(crate) still: NewImage,
    /// PNG of a drawing that was rasterised.
    pub(crate) drawn: Option<Vec<u8>>,
    /// Time at which the image was taken (RFC 3339), from its name or its EXIF data.
    pub(crate) taken: Option<String>,
}

/// Result of reading an image file.
pub(crate) type Read = Result<ReadPicture, String>;

/// Plan image that is being read.
#[derive(Debug)]
pub(crate) struct Planning {
    pub(crate) picture: Task<Read>,
    /// Plan entry from its world file.
    pub(crate) told: Option<Plan>,
}
