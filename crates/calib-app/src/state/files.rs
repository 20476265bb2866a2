//! What keeps the site from being written to a file without asking.
//!
//! A path that is typed where the system has no file chooser.
//!
//! Images that the site names outside its folder.
//!
//! Pictures that are being read.

use std::collections::BTreeSet;
use std::path::PathBuf;

use calib_editor::NewStill;
use calib_site::Plan;

use crate::choice::Purpose;
use crate::platform::Task;

/// Why a file is not written without asking.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Why {
    /// It is not what was read: somebody wrote it meanwhile. What differs, in words.
    Changed(Vec<String>),
    /// It may not be written to.
    ReadOnly,
}

/// A file that is not written without asking.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Conflict {
    /// Which.
    pub path: PathBuf,
    /// Why.
    pub why: Why,
}

/// What the operator decides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    /// Opens what the file holds now; the work on the open site is kept aside.
    Reload,
    /// Writes another file.
    SaveAs,
    /// Writes this one all the same.
    Overwrite,
    /// Nothing is written.
    Leave,
}

/// A path that is being typed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PathField {
    /// What for.
    pub purpose: Purpose,
    /// What was typed.
    pub text: String,
}

/// What became of the images that the site names outside its folder.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Outside {
    /// Files that wait for a decision, without links in their paths.
    pub asked: BTreeSet<PathBuf>,
    /// Files that are left out.
    pub(crate) left: BTreeSet<PathBuf>,
    /// The names that the site had for its images when they were looked at.
    pub(crate) names: Vec<String>,
}

/// A picture that was read, to become a still or the plan.
#[derive(Debug)]
pub(crate) struct ReadPicture {
    pub(crate) still: NewStill,
    /// A drawing as the picture that stands for it.
    pub(crate) drawn: Option<Vec<u8>>,
    /// When it was taken (RFC 3339), if its name says it, or the clock of its camera.
    pub(crate) taken: Option<String>,
}

/// What reading gives.
pub(crate) type Read = Result<ReadPicture, String>;

/// A plan whose picture is being read.
#[derive(Debug)]
pub(crate) struct Planning {
    pub(crate) picture: Task<Read>,
    /// What its world file says.
    pub(crate) told: Option<Plan>,
}
