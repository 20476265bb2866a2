//! What is known of a camera for certain.

/// Parameters that are not estimated: fixed at the value where there is one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FixedParameters {
    /// In radians.
    pub roll: Option<f64>,
    /// In radians.
    pub pitch: Option<f64>,
    /// In pixels.
    pub focal: Option<f64>,
    /// In metres; the paper's method takes it as it is.
    pub height: Option<f64>,
}
