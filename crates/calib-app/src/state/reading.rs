//! Pictures that are being read.

use calib_editor::NewStill;
use calib_site::Plan;

use crate::platform::Task;

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
