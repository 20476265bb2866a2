//! What is asked of a calibration.

use crate::solution::Method;

/// How to calibrate.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// By which method stage 1 is solved.
    pub method: Method,
    /// Improve all cameras together.
    pub refine: bool,
    /// Let a weak prior about the focal enter where the lines do not tell it.
    pub prior: bool,
    /// Ids of the cameras to solve; all of them if absent.
    pub cameras: Option<Vec<String>>,
}

impl Default for Options {
    fn default() -> Self {
        Self { method: Method::MaximumLikelihood, refine: true, prior: true, cameras: None }
    }
}
