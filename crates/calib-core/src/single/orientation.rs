//! The orientation of a camera, with its focal: what vanishing points tell of it.

/// The orientation and focal that stage 1 estimates, by either method.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Orientation {
    /// In radians.
    pub roll: f64,
    /// In radians, positive down.
    pub pitch: f64,
    /// In pixels.
    pub focal: f64,
}
