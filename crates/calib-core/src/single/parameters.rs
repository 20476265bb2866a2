//! Prior knowledge of the parameters of one camera, as normal distributions.
//!
//! The orientation of a camera, with its focal: what vanishing points tell of it.
//!
//! What is known of a camera for certain.
//!
//! What is known of a plane that drawings, links or fields of view lie on.
//!
//! Which coefficients of a lens are fitted.

use crate::camera::{Distortion, DistortionModel, Plane};

/// A plane of the scene, with how well its height and its slope are known.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanePrior {
    /// By which annotations refer to it.
    pub id: String,
    /// Where it is thought to be.
    pub plane: Plane,
    /// The horizontal direction of its fall, of unit length.
    pub along: [f64; 2],
    /// Standard deviations of its height in metres, and of its slope along and across that direction in rise
    /// per metre; 0 of what is held.
    pub sigma: [f64; 3],
}

/// How far from the anchor of a plane a camera that sees it may stand, in metres.
const REACH: f64 = 10.0;

impl PlanePrior {
    /// A plane that is known exactly.
    #[must_use]
    pub fn held(id: impl Into<String>, plane: Plane) -> Self {
        Self { id: id.into(), plane, along: [1.0, 0.0], sigma: [0.0; 3] }
    }

    /// Whether nothing of it is estimated.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.sigma == [0.0; 3]
    }

    /// Covariance of height and slope, in square metres and squares of rise per metre.
    #[must_use]
    pub fn covariance(&self) -> [[f64; 3]; 3] {
        let rows = self.directions();
        let entry = |i: usize, j: usize| -> f64 {
            (0..3).map(|k| self.sigma[k] * self.sigma[k] * rows[k][i] * rows[k][j]).sum()
        };
        std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)))
    }

    /// Height, slope along and slope across, as rows over height and slope.
    pub(crate) fn directions(&self) -> [[f64; 3]; 3] {
        let [x, y] = self.along;
        [[1.0, 0.0, 0.0], [0.0, x, y], [0.0, -y, x]]
    }

    /// Root mean square of the slope in a direction of which nothing is known, as that of a camera without
    /// place: in rise per metre.
    pub(crate) fn slope_in_any_direction(&self) -> f64 {
        let [x, y] = self.plane.slope;
        let [_, along, across] = self.sigma;
        (0.5 * (x * x + y * y + along * along + across * across)).sqrt()
    }

    /// Standard deviation of the height of the plane under a camera without place, in metres.
    pub(crate) fn height_sigma_under_camera(&self) -> f64 {
        self.sigma[0].hypot(self.slope_in_any_direction() * REACH)
    }
}

/// Which coefficients are fitted, of which model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fitted {
    /// The model.
    pub model: DistortionModel,
    /// Which of its coefficients, in the order of [`Distortion::coefficients`].
    pub which: [bool; Distortion::MOST],
}

impl Fitted {
    /// The first coefficients of a model.
    #[must_use]
    pub fn first(model: DistortionModel, count: usize) -> Self {
        Self { model, which: std::array::from_fn(|k| k < count) }
    }

    pub(super) fn len(&self) -> usize {
        self.which.iter().filter(|&&is| is).count()
    }

    /// Indices of what is fitted among the coefficients of the model.
    pub(crate) fn indices(&self) -> Vec<usize> {
        (0..Distortion::MOST).filter(|&k| self.which[k]).collect()
    }

    /// Whether the coefficients refer to a focal that must be known beforehand.
    pub fn has_own_focal(&self) -> bool {
        self.model.row().powers.is_none()
    }

    /// Whether the lens shows rays from beside and behind the camera, too.
    pub(crate) fn is_wide(&self) -> bool {
        self.model.row().is_wide
    }

    /// The distortion with these values of what is fitted.
    pub(super) fn distortion(&self, values: &[f64]) -> Distortion {
        let mut full = [0.0; Distortion::MOST];
        for (&value, k) in values.iter().zip(self.indices()) {
            full[k] = value;
        }
        self.model.row().zero.with_coefficients(full)
    }
}

/// The orientation and focal that stage 1 estimates, by either method.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Orientation {
    /// In radians.
    pub roll: f64,
    /// In radians, positive down.
    pub pitch: f64,
    /// In pixels.
    pub focal: f64,
}

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
