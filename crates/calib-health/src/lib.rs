//! Drift of calibrated cameras from detections of people, and the acceptance test by a walker.
//!
//! Rule: no clock, no document and no images. All times are the times of the detections. The files, in the
//! order of the data:
//!
//! - `normal_equations`: normal equations that accumulate evidence, and the change of their unknowns.
//! - `stature`: the detection of a person ([`Sighting`]), the height of a person from the calibration with
//!   its derivatives, and the evidence of heights.
//! - `tracks`: the rows of one person, combined into one observation.
//! - `moments`: the moments at which several cameras saw people, a bounded sample.
//! - `windows`: all evidence by time, in bounded memory.
//! - `pairs`: the evidence of people seen by two cameras, and evidence over time.
//! - `watch`: the detection of changes and the entry point for drift, [`Watch`].
//! - `views`: the views of one walker from several cameras at the same moment.
//! - `walk`: the entry point for the acceptance test, [`Walk`], which compares cameras with each other and
//!   with their claimed uncertainty.
//! - `zones`: the result of a walk by squares of the floor.

mod normal_equations;
mod stature;
mod tracks;
mod moments;
mod windows;
mod pairs;
mod watch;
mod views;
mod walk;
mod zones;
#[cfg(test)]
mod tests;

pub use stature::Sighting;
pub use walk::{Disagreement, Walk, WalkMoment, WalkResult};
pub use watch::{CameraHealth, Change, DriftStatus, Memory, Watch, WindowHeight};
pub use zones::{Zone, Zones};
