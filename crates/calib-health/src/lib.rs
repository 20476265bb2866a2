//! Whether calibrations still hold, by the people that cameras see, and by edges that a later still shows elsewhere: no
//! image is looked at here.
//!
//! Law: no clock and no document; times are those of what was seen. The files in the order of the data:
//!
//! - `sighting` a person as a camera shows them; `movement` what can become of a camera; `stature` how tall they
//!   stand before it, with derivatives by the movement;
//! - `sigmas` probabilities; `normal_equations` evidence that adds up; `heights` that of heights; `tracks` the rows of one person as one
//!   observation; `moments` what cameras saw at the same times; `windows` all of it by time, in bounded memory;
//! - `pairs` one person seen by two cameras; `series` evidence over time, and how far it may be believed; `change`
//!   since when a camera moved; `watch` the front door: [`Watch`];
//! - `views`, `walk` one walker before all cameras, who are held against what they claim: [`Walk`]; `zones` the same by parts
//!   of the floor;
//! - `turn` where a camera that turned and zoomed shows its old pixels; `edge_offset`, `turn_equations`, `turn_fit` the turn that edges say together.

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
pub use watch::{CameraHealth, Change, HeightThen, Memory, Verdict, Watch};
pub use zones::{Zone, Zones};
