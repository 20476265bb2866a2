//! Prior knowledge of the parameters of one camera, as normal distributions.

/// A normal prior on one parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Its mean, in the unit of the parameter: radians, pixels, metres.
    pub value: f64,
    /// Standard deviation, in the same unit.
    pub sigma: f64,
}

/// Priors on roll, pitch, focal and height.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Priors {
    /// In radians.
    pub roll: Option<Prior>,
    /// In radians.
    pub pitch: Option<Prior>,
    /// In pixels.
    pub focal: Option<Prior>,
    /// In metres.
    pub height: Option<Prior>,
    /// The weak prior, on the log of the focal in pixels: it enters where the constraints tell little of the focal.
    pub weak_log_focal: Option<Prior>,
}
