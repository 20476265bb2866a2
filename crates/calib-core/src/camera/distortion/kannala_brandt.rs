//! The fisheye of OpenCV: J. Kannala, S. Brandt, "A generic camera model and calibration method for
//! conventional, wide-angle, and fish-eye lenses", 2006, equation 6, without its asymmetric part.
//!
//! A ray at the angle theta from the axis is shown at the radius
//! `P = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)`, and by a pinhole at `tan theta`.
//! The direction of the radius stays, so that every derivative is that of a radius; with
//! `d tan theta = (1 + tan^2 theta) d theta`, and at a radius that stays `d theta = -theta^p / P' d k` for
//! the coefficient of `theta^p`. Rays, unit vectors `(sin theta n, cos theta)` with the direction n of the radius,
//! are regular across theta = 90 degrees and beyond, where a pinhole has no image.

use crate::camera::distortion::model::{
    ByCoefficient, ByCoefficients, Matrix2, Model, RayByCoefficient, RayMatrix, radial,
};
use crate::camera::distortion::{Coefficient, Distortion, DistortionModel, ModelRow};
use crate::camera::elementary::{angle_from_axis, atan, hypot, sin_cos, tan};
use crate::camera::polynomial::OddPolynomial;

pub(super) const ROW: ModelRow = ModelRow {
    model: DistortionModel::KannalaBrandt,
    name: "kannala-brandt",
    coefficients: &[Coefficient::K1, Coefficient::K2, Coefficient::K3, Coefficient::K4],
    powers: None,
    in_order: true,
    is_wide: true,
    usual: 2,
    zero: Distortion::KannalaBrandt { k: [0.0; 4] },
};

/// The Kannala-Brandt model: k1 to k4.
#[derive(Clone, Copy, Debug)]
pub(super) struct KannalaBrandt {
    pub(super) k: [f64; 4],
}

/// Radii nearer to the axis than this have no direction.
const AXIS: f64 = 1e-9;

/// Largest angle from the axis, in radians: no lens that is built looks farther round than 288 degrees.
const WIDEST: f64 = 0.8 * std::f64::consts::PI;

/// Powers of theta, one a coefficient.
const POWERS: [i32; 4] = [3, 5, 7, 9];

impl KannalaBrandt {
    fn polynomial(&self) -> OddPolynomial {
        OddPolynomial(self.k)
    }

    /// The angle from the axis that is shown at a radius.
    fn angle(&self, radius: f64) -> Option<f64> {
        self.polynomial().inverse(radius).filter(|&theta| theta <= WIDEST)
    }
}

impl Model for KannalaBrandt {
    fn max_radius(&self) -> f64 {
        let theta = self.polynomial().first_turn();
        if theta < std::f64::consts::FRAC_PI_2 { tan(theta) } else { f64::INFINITY }
    }

    fn distort(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let radius = hypot(x, y);
        let theta = atan(radius);
        if theta > self.polynomial().first_turn() {
            return None;
        }
        let scale = if radius < AXIS { 1.0 } else { self.polynomial().value(theta) / radius };
        Some([scale * x, scale * y])
    }

    fn undistort(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let radius = hypot(x, y);
        let theta = self.polynomial().inverse(radius)?;
        if theta >= std::f64::consts::FRAC_PI_2 {
            return None;
        }
        let scale = if radius < AXIS { 1.0 } else { tan(theta) / radius };
        Some([scale * x, scale * y])
    }

    /// Also one from beside or behind the camera, which no pinhole sees.
    fn reaches(&self, [x, y]: [f64; 2]) -> bool {
        self.angle(hypot(x, y)).is_some()
    }

    fn ray(&self, [x, y]: [f64; 2]) -> Option<[f64; 3]> {
        let radius = hypot(x, y);
        let (sin, cos) = sin_cos(self.angle(radius)?);
        let scale = if radius < AXIS { 1.0 } else { sin / radius };
        Some([scale * x, scale * y, cos])
    }

    fn shown(&self, [x, y, w]: [f64; 3]) -> Option<[f64; 2]> {
        let across = hypot(x, y);
        let theta = angle_from_axis(across, w);
        let polynomial = self.polynomial();
        if theta > WIDEST || theta > polynomial.first_turn() {
            return None;
        }
        let scale = if across < AXIS * w { w.recip() } else { polynomial.value(theta) / across };
        Some([scale * x, scale * y])
    }

    fn ray_jacobian(&self, bent: [f64; 2], [x, y, w]: [f64; 3]) -> RayMatrix {
        let (radius, sin) = (hypot(bent[0], bent[1]), hypot(x, y));
        if radius < AXIS {
            return [[1.0, 0.0], [0.0, 1.0], [0.0; 2]];
        }
        let turn = self.polynomial().derivative(angle_from_axis(sin, w)).recip();
        let [u, v] = radial(bent, sin / radius, w * turn);
        [u, v, bent.map(|c| -sin * turn * c / radius)]
    }

    fn ray_by_coefficients(
        &self,
        bent: [f64; 2],
        [x, y, w]: [f64; 3],
    ) -> [RayByCoefficient; Distortion::MOST] {
        let (radius, sin) = (hypot(bent[0], bent[1]), hypot(x, y));
        let mut by = [RayByCoefficient::default(); Distortion::MOST];
        if radius < AXIS {
            return by;
        }
        let theta = angle_from_axis(sin, w);
        let (derivative, second) = (self.polynomial().derivative(theta), self.polynomial().curvature(theta));
        let turn = derivative.recip();
        for (by, power) in by.iter_mut().zip(POWERS) {
            let d_theta = -theta.powi(power) * turn;
            // Of 1 / P'.
            let d_turn = -(second * d_theta + f64::from(power) * theta.powi(power - 1)) * turn * turn;
            let [u, v] = radial(bent, w * d_theta / radius, w * d_turn - sin * turn * d_theta);
            let ahead = -(w * turn * d_theta + sin * d_turn) / radius;
            let [x, y] = bent.map(|c| w * d_theta * c / radius);
            *by = RayByCoefficient { at: [x, y, -sin * d_theta], jacobian: [u, v, bent.map(|c| ahead * c)] };
        }
        by
    }

    fn distort_jacobian(&self, [x, y]: [f64; 2]) -> Matrix2 {
        let radius = hypot(x, y);
        let theta = atan(radius);
        let across = if radius < AXIS { 1.0 } else { self.polynomial().value(theta) / radius };
        radial([x, y], across, self.polynomial().derivative(theta) / (1.0 + radius * radius))
    }

    fn distort_by_coefficients(&self, [x, y]: [f64; 2]) -> [[f64; 2]; Distortion::MOST] {
        let radius = hypot(x, y);
        let mut by = [[0.0; 2]; Distortion::MOST];
        if radius >= AXIS {
            for (by, power) in by.iter_mut().zip(POWERS) {
                let along = atan(radius).powi(power) / radius;
                *by = [along * x, along * y];
            }
        }
        by
    }

    fn undistort_jacobian(&self, bent: [f64; 2], straight: [f64; 2]) -> Matrix2 {
        let (radius, tangent) = (hypot(bent[0], bent[1]), hypot(straight[0], straight[1]));
        let across = if radius < AXIS { 1.0 } else { tangent / radius };
        radial(bent, across, (1.0 + tangent * tangent) / self.polynomial().derivative(atan(tangent)))
    }

    fn undistort_by_coefficients(&self, bent: [f64; 2], straight: [f64; 2]) -> ByCoefficients {
        let (radius, tangent) = (hypot(bent[0], bent[1]), hypot(straight[0], straight[1]));
        let mut by = ByCoefficients::default();
        if radius < AXIS {
            return by;
        }
        let (theta, gain) = (atan(tangent), 1.0 + tangent * tangent);
        let (derivative, second) = (self.polynomial().derivative(theta), self.polynomial().curvature(theta));
        for (by, power) in by.iter_mut().zip(POWERS) {
            let d_theta = -theta.powi(power) / derivative;
            let d_derivative = second * d_theta + f64::from(power) * theta.powi(power - 1);
            let across = gain * d_theta / radius;
            // Of (1 + tan^2 theta) / P'.
            let along = gain * (2.0 * tangent * d_theta - d_derivative / derivative) / derivative;
            *by = ByCoefficient { at: bent.map(|c| across * c), jacobian: radial(bent, across, along) };
        }
        by
    }
}
