//! Kannala-Brandt model, the fisheye model of OpenCV: J. Kannala, S. Brandt, "A generic camera model and
//! calibration method for conventional, wide-angle, and fish-eye lenses", 2006, equation 6, without its
//! asymmetric part.
//!
//! A ray at the angle theta from the optical axis, in radians, has the image radius
//! `P = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)`, divided by the focal length.

use crate::camera::distortion::profile::Profile;
use crate::camera::distortion::{Coefficient, Distortion, DistortionModel, ModelRow};
use crate::camera::numerics::OddPolynomial;

/// Table entry of the Kannala-Brandt model in [`MODELS`](super::MODELS).
pub(super) const ROW: ModelRow = ModelRow {
    model: DistortionModel::KannalaBrandt,
    name: "kannala-brandt",
    coefficients: &[Coefficient::K1, Coefficient::K2, Coefficient::K3, Coefficient::K4],
    focal_powers: None,
    in_order: true,
    is_wide: true,
    is_fitted: true,
    default_count: 2,
    zero: Distortion::KannalaBrandt { k: [0.0; 4] },
};

/// Kannala-Brandt model with the coefficients k1 to k4.
#[derive(Clone, Copy, Debug)]
pub(super) struct KannalaBrandt {
    pub(super) k: [f64; 4],
}

/// Power of theta that each of the coefficients k1 to k4 multiplies.
const THETA_POWERS: [i32; 4] = [3, 5, 7, 9];

impl KannalaBrandt {
    /// Returns the image radius as a polynomial of theta.
    fn polynomial(&self) -> OddPolynomial {
        OddPolynomial(self.k)
    }
}

impl Profile for KannalaBrandt {
    const COEFFICIENTS: usize = THETA_POWERS.len();

    fn radius(&self, theta: f64) -> f64 {
        self.polynomial().value(theta)
    }

    fn slope(&self, theta: f64) -> f64 {
        self.polynomial().derivative(theta)
    }

    fn curvature(&self, theta: f64) -> f64 {
        self.polynomial().curvature(theta)
    }

    fn by_coefficients(&self, theta: f64) -> [[f64; 2]; Distortion::MAX_FITTED] {
        let mut by = [[0.0; 2]; Distortion::MAX_FITTED];
        for (by, power) in by.iter_mut().zip(THETA_POWERS) {
            *by = [theta.powi(power), f64::from(power) * theta.powi(power - 1)];
        }
        by
    }

    fn inverse(&self, radius: f64) -> Option<f64> {
        self.polynomial().inverse(radius)
    }

    fn max_angle(&self) -> f64 {
        self.polynomial().first_maximum()
    }
}
