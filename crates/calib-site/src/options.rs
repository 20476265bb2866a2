//! Options of a calibration.

use crate::solution::Method;

/// Options of a calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Method for stage 1 (orientation and focal length of each camera).
    pub method: Method,
    /// Whether to refine all cameras jointly.
    pub refine: bool,
    /// Whether to use the weak prior on the focal length if the lines do not determine it.
    pub prior: bool,
    /// Ids of the cameras whose results are reported; all cameras if `None`. The other cameras still take part in the
    /// joint refinement.
    pub cameras: Option<Vec<String>>,
}

impl Default for Options {
    fn default() -> Self {
        Self { method: Method::MaximumLikelihood, refine: true, prior: true, cameras: None }
    }
}
