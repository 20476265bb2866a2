//! Double-sphere model: V. Usenko, N. Demmel, D. Cremers, "The double sphere camera model", 2018, equations
//! 40 to 51.
//!
//! A ray in the direction (x, y, z) meets a unit sphere. A second unit sphere has its centre at the distance
//! `xi` behind the first centre. A unified camera with the weight `alpha` observes the intersection from
//! there: `u = fx x / (alpha d2 + (1 - alpha) (xi d1 + z))` with `d1 = |(x, y, z)|` and
//! `d2 = |(x, y, xi d1 + z)|`. Here fx is the focal length of the paper. A unit ray at the angle theta from
//! the optical axis has `x = sin theta` and `z = cos theta`. Near the axis, `d2` and the denominator are
//! `1 + xi` for every alpha. The focal length near the axis is therefore `fx / (1 + xi)`. The image radius,
//! divided by this focal length, is
//!
//! `P = (1 + xi) sin theta / D`, `D = alpha d2 + (1 - alpha) (xi + cos theta)`,
//! `d2^2 = 1 + 2 xi cos theta + xi^2`.
//!
//! Primes are derivatives with respect to theta: `d2' = -xi sin theta / d2`, `D' = -g sin theta` with
//! `g = alpha xi / d2 + 1 - alpha`, and `P' = (1 + xi) Q / D^2` with `Q = D cos theta + g sin^2 theta`.
//!
//! From the second centre, the intersection is at the angle phi from the optical axis, with
//! `tan phi = sin theta / (xi + cos theta)`. P increases with phi while `cos phi > -w`, where w is the
//! smaller of `alpha / (1 - alpha)` and its inverse. Phi increases with theta while `1 + xi cos theta > 0`.
//! The bound in equation 44 of the paper differs slightly: depending on the coefficients, it is tighter or
//! wider.

use crate::camera::distortion::profile::Profile;
use crate::camera::distortion::{Coefficient, Distortion, DistortionModel, ModelRow};
use crate::camera::numerics::{angle_from_axis, hypot, sin_cos};

/// Table entry of the double-sphere model in [`MODELS`](super::MODELS).
pub(super) const ROW: ModelRow = ModelRow {
    model: DistortionModel::DoubleSphere,
    name: "double-sphere",
    coefficients: &[Coefficient::Xi, Coefficient::Alpha],
    focal_powers: None,
    in_order: true,
    is_wide: true,
    is_fitted: false,
    default_count: 2,
    zero: Distortion::DoubleSphere { xi: 0.0, alpha: 0.0 },
};

/// Double-sphere model with its coefficients: `xi` is the distance between the centres of the two spheres,
/// `alpha` the weight of the second sphere.
#[derive(Clone, Copy, Debug)]
pub(super) struct DoubleSphere {
    pub(super) xi: f64,
    pub(super) alpha: f64,
}

/// Common terms of the formulas of the double-sphere model at one angle theta.
struct Terms {
    /// Sine of theta.
    sin: f64,
    /// Cosine of theta.
    cos: f64,
    /// Distance d2 of the intersection from the second centre.
    d2: f64,
    /// Denominator D of the image radius P.
    denominator: f64,
    /// Factor `g = -D' / sin theta` of the derivative of D.
    g: f64,
    /// Factor Q of the derivative `P' = (1 + xi) Q / D^2`.
    q: f64,
}

impl DoubleSphere {
    /// Whether the coefficients describe a lens.
    fn is_lens(&self) -> bool {
        Coefficient::Xi.is_valid(self.xi) && Coefficient::Alpha.is_valid(self.alpha)
    }

    /// Computes the common terms at the angle `theta` from the optical axis, in radians.
    fn terms(&self, theta: f64) -> Terms {
        let Self { xi, alpha } = *self;
        let (sin, cos) = sin_cos(theta);
        let d2 = hypot(sin, xi + cos);
        let below = alpha * d2 + (1.0 - alpha) * (xi + cos);
        let g = alpha * xi / d2 + (1.0 - alpha);
        Terms { sin, cos, d2, denominator: below, g, q: below * cos + g * sin * sin }
    }
}

impl Profile for DoubleSphere {
    fn radius(&self, theta: f64) -> f64 {
        let Terms { sin, denominator: below, .. } = self.terms(theta);
        (1.0 + self.xi) * sin / below.max(0.0)
    }

    fn slope(&self, theta: f64) -> f64 {
        let Terms { denominator: below, q, .. } = self.terms(theta);
        (1.0 + self.xi) * q / (below * below)
    }

    fn curvature(&self, theta: f64) -> f64 {
        let Self { xi, alpha } = *self;
        let Terms { sin, cos, d2, denominator: below, g, q } = self.terms(theta);
        let g_turn = alpha * xi * xi * sin / d2.powi(3);
        let q_turn = sin * (cos * g - below + sin * g_turn);
        (1.0 + xi) * (q_turn + 2.0 * q * sin * g / below) / (below * below)
    }

    /// Inverts P by equations 46 to 51 of the paper, with the angle phi at the second centre instead of its
    /// tangent: `d2 = xi cos phi + sqrt(1 - xi^2 sin^2 phi)`, `sin theta = d2 sin phi` and
    /// `cos theta = d2 cos phi - xi`.
    fn inverse(&self, radius: f64) -> Option<f64> {
        let Self { xi, alpha } = *self;
        let r = radius / (1.0 + xi);
        let under = 1.0 - (2.0 * alpha - 1.0) * r * r;
        if !self.is_lens() || under.is_nan() || under < 0.0 {
            return None;
        }
        let ahead = (1.0 - alpha * alpha * r * r) / (alpha * under.sqrt() + (1.0 - alpha));
        let length = hypot(r, ahead);
        let (sin, cos) = (r / length, ahead / length);
        let beside = xi * sin;
        let root = (1.0 - beside * beside >= 0.0).then(|| (1.0 - beside * beside).sqrt())?;
        let d2 = xi * cos + root;
        // The image centre has the angle 0 exactly.
        let theta = if r > 0.0 { angle_from_axis(d2 * sin, d2 * cos - xi) } else { 0.0 };
        theta.is_finite().then_some(theta)
    }

    fn max_angle(&self) -> f64 {
        /// Relative margin that is subtracted from the largest angle, because the formulas lose digits there.
        const MARGIN: f64 = 1e-12;
        let Self { xi, alpha } = *self;
        if !self.is_lens() {
            return -1.0;
        }
        let across = if xi > 1.0 {
            -xi.recip()
        } else {
            let w = alpha.min(1.0 - alpha) / alpha.max(1.0 - alpha);
            let square = 1.0 - w * w;
            -xi * square - w * (1.0 - xi * xi * square).max(0.0).sqrt()
        };
        let up = (1.0 - across * across).max(0.0).sqrt();
        angle_from_axis(up, across) * (1.0 - MARGIN)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn model_agrees_with_the_formula_of_the_paper(
            xi in -0.6..1.5_f64, alpha in 0.0..1.0_f64, fx in 100.0..900.0_f64, x in -1.0..1.0_f64, y in -1.0..1.0_f64,
            z in -1.0..1.0_f64,
        ) {
            // Equations 40 to 44 of the paper, in pixels.
            let d1 = (x * x + y * y + z * z).sqrt();
            let d2 = (x * x + y * y + (xi * d1 + z).powi(2)).sqrt();
            let below = alpha * d2 + (1.0 - alpha) * (xi * d1 + z);
            let w1 = if alpha <= 0.5 { alpha / (1.0 - alpha) } else { (1.0 - alpha) / alpha };
            let w2 = (w1 + xi) / (2.0 * w1 * xi + xi * xi + 1.0).sqrt();
            prop_assume!(z > -w2.min(0.7) * d1 && below > 0.05 * d1 && d1 > 0.1);
            let shown = Distortion::DoubleSphere { xi, alpha }.ray_to_distorted([x, y, z]);
            let Some([u, v]) = shown.map(|at| at.map(|c| fx / (1.0 + xi) * c)) else {
                // The bound of the paper is wider than the range in which the image radius increases.
                let (theta, turn) = (angle_from_axis(hypot(x, y), z), DoubleSphere { xi, alpha }.max_angle());
                prop_assert!(theta > 0.999 * turn, "{theta} of {turn}: {xi} {alpha} {z}");
                return Ok(());
            };
            prop_assert!((u - fx * x / below).hypot(v - fx * y / below) < 1e-9 * fx, "{u} {v}");
        }

        #[test]
        fn radius_grows_exactly_up_to_the_largest_angle(xi in -0.9..3.0_f64, alpha in 0.0..1.0_f64) {
            let lens = DoubleSphere { xi, alpha };
            let turn = lens.max_angle();
            for step in 0..200 {
                let theta = turn * f64::from(step) / 200.0;
                prop_assert!(lens.slope(theta) > 0.0 && lens.terms(theta).denominator > 0.0, "{theta} of {turn}");
            }
            let beyond = lens.terms(turn + 1e-4);
            prop_assert!(turn > 0.999 * std::f64::consts::PI || beyond.q < 0.0 || beyond.denominator < 0.0, "{turn}");
        }

        #[test]
        fn inverse_of_the_radius_returns_the_angle(xi in -0.9..3.0_f64, alpha in 0.0..1.0_f64, share in 0.0..1.0_f64) {
            let lens = DoubleSphere { xi, alpha };
            let theta = share * lens.max_angle().min(2.5);
            let slope = lens.slope(theta);
            // The inverse is not accurate where the image radius hardly increases.
            prop_assume!(slope > 1e-2 && lens.radius(theta) < 100.0);
            let back = lens.inverse(lens.radius(theta));
            let off = 1e-12 * (1.0 + slope.recip() + slope);
            prop_assert!(back.is_some_and(|back| (back - theta).abs() < off), "{theta} {back:?}");
        }
    }
}
