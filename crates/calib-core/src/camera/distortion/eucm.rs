//! Extended unified camera model (EUCM): B. Khomutenko, G. Garcia, P. Martinet, "An enhanced unified camera
//! model", 2016, equations 5 to 9; `eucm` of Kalibr and Basalt.
//!
//! A ray in the direction (x, y, z) meets an ellipsoid or a hyperboloid:
//! `u = f x / (alpha d + (1 - alpha) z)` with `d^2 = beta (x^2 + y^2) + z^2`. On the axis the denominator is
//! z, so f is the focal length at the image centre. A unit ray at the angle theta from the optical axis has
//! the image radius, divided by f,
//!
//! `P = sin theta / D`, `D = alpha d + (1 - alpha) cos theta`, `d^2 = beta sin^2 theta + cos^2 theta`.
//!
//! Primes are derivatives with respect to theta: `d' = (beta - 1) sin theta cos theta / d`,
//! `D' = -g sin theta` with `g = 1 - alpha - alpha (beta - 1) cos theta / d`, and `P' = Q / D^2` with
//! `Q = D cos theta + g sin^2 theta = 1 - alpha + alpha cos theta / d`.
//!
//! D and Q are positive while `cos theta / d > -w`, where w is the smaller of `alpha / (1 - alpha)` and its
//! inverse. The angle at the bound has `cos theta = -w sqrt(beta / (1 - w^2 + w^2 beta))`.

use crate::camera::distortion::profile::Profile;
use crate::camera::distortion::{Coefficient, Distortion, DistortionModel, ModelRow};
use crate::camera::numerics::{angle_from_axis, sin_cos};

/// Table entry of the extended unified model in [`MODELS`](super::MODELS).
pub(super) const ROW: ModelRow = ModelRow {
    model: DistortionModel::Eucm,
    name: "eucm",
    coefficients: &[Coefficient::Alpha, Coefficient::Beta],
    focal_powers: None,
    in_order: true,
    is_wide: true,
    is_fitted: false,
    default_count: 2,
    zero: Distortion::Eucm { alpha: 0.0, beta: 1.0 },
};

/// Extended unified model with its coefficients: `alpha` is the weight of the distance d, and `beta` the
/// shape of the surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Eucm {
    pub(super) alpha: f64,
    pub(super) beta: f64,
}

/// Common terms of the formulas of the extended unified model at one angle theta.
struct Terms {
    /// Sine of theta.
    sin: f64,
    /// Distance d, with `d^2 = beta sin^2 theta + cos^2 theta`.
    d: f64,
    /// Denominator D of the image radius P.
    denominator: f64,
    /// Factor `g = -D' / sin theta` of the derivative of D.
    g: f64,
    /// Factor Q of the derivative `P' = Q / D^2`.
    q: f64,
}

impl Eucm {
    /// Whether the coefficients describe a lens.
    fn is_lens(&self) -> bool {
        Coefficient::Alpha.is_valid(self.alpha) && Coefficient::Beta.is_valid(self.beta)
    }

    /// Computes the common terms at the angle `theta` from the optical axis, in radians.
    fn terms(&self, theta: f64) -> Terms {
        let Self { alpha, beta } = *self;
        let (sin, cos) = sin_cos(theta);
        let d = (beta * sin * sin + cos * cos).sqrt();
        let g = 1.0 - alpha - alpha * (beta - 1.0) * cos / d;
        Terms { sin, d, denominator: alpha * d + (1.0 - alpha) * cos, g, q: 1.0 - alpha + alpha * cos / d }
    }
}

impl Profile for Eucm {
    fn radius(&self, theta: f64) -> f64 {
        let Terms { sin, denominator, .. } = self.terms(theta);
        sin / denominator.max(0.0)
    }

    fn slope(&self, theta: f64) -> f64 {
        let Terms { denominator, q, .. } = self.terms(theta);
        q / (denominator * denominator)
    }

    /// Returns `P'' = (Q' + 2 Q g sin theta / D) / D^2` with `Q' = -alpha beta sin theta / d^3`.
    fn curvature(&self, theta: f64) -> f64 {
        let Terms { sin, d, denominator, g, q, .. } = self.terms(theta);
        let q_turn = -self.alpha * self.beta * sin / (d * d * d);
        (q_turn + 2.0 * q * sin * g / denominator) / (denominator * denominator)
    }

    /// Inverts P by equation 9 of the paper: the ray of the image radius r is `(r, 0, z)` with
    /// `z = (1 - beta alpha^2 r^2) / (alpha sqrt(1 - (2 alpha - 1) beta r^2) + 1 - alpha)`.
    fn inverse(&self, radius: f64) -> Option<f64> {
        let Self { alpha, beta } = *self;
        let square = beta * radius * radius;
        let under = 1.0 - (2.0 * alpha - 1.0) * square;
        if !self.is_lens() || under.is_nan() || under < 0.0 {
            return None;
        }
        let ahead = (1.0 - alpha * alpha * square) / (alpha * under.sqrt() + (1.0 - alpha));
        // The image centre has the angle 0 exactly.
        let theta = if radius > 0.0 { angle_from_axis(radius, ahead) } else { 0.0 };
        theta.is_finite().then_some(theta)
    }

    fn max_angle(&self) -> f64 {
        /// Relative margin that is subtracted from the largest angle, because the formulas lose digits there.
        const MARGIN: f64 = 1e-12;
        let Self { alpha, beta } = *self;
        if !self.is_lens() {
            return -1.0;
        }
        let w = alpha.min(1.0 - alpha) / alpha.max(1.0 - alpha);
        let cos = -w * (beta / (1.0 - w * w + w * w * beta)).sqrt();
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        angle_from_axis(sin, cos) * (1.0 - MARGIN)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::numerics::hypot;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn model_agrees_with_the_formula_of_the_paper(
            alpha in 0.0..1.0_f64, beta in 0.2..3.0_f64, f in 100.0..900.0_f64, x in -1.0..1.0_f64,
            y in -1.0..1.0_f64, z in -1.0..1.0_f64,
        ) {
            let lens = Eucm { alpha, beta };
            let denominator = alpha * (beta * (x * x + y * y) + z * z).sqrt() + (1.0 - alpha) * z;
            let theta = angle_from_axis(hypot(x, y), z);
            prop_assume!(theta < 0.99 * lens.max_angle() && theta < 2.4 && hypot(x, y) > 1e-3);
            let shown = Distortion::Eucm { alpha, beta }.ray_to_distorted([x, y, z]).map(|at| at.map(|c| f * c));
            let [u, v] = shown.ok_or_else(|| TestCaseError::fail("not shown"))?;
            let size = 1.0 + u.hypot(v) / f;
            prop_assert!((u - f * x / denominator).hypot(v - f * y / denominator) < 1e-10 * f * size * size, "{u} {v}");
        }

        #[test]
        fn model_is_the_unified_model_for_beta_one(alpha in 0.0..0.8_f64, theta in 0.0..1.5_f64) {
            let unified = Distortion::unified(alpha / (1.0 - alpha));
            let shown = |lens: Distortion| lens.ray_to_distorted([theta.sin(), 0.0, theta.cos()]);
            let (a, b) = (shown(Distortion::Eucm { alpha, beta: 1.0 }), shown(unified));
            prop_assert!(a.zip(b).is_some_and(|(a, b)| (a[0] - b[0]).abs() < 1e-12 * (1.0 + a[0])), "{a:?} {b:?}");
        }

        #[test]
        fn radius_grows_exactly_up_to_the_largest_angle(alpha in 0.0..1.0_f64, beta in 0.2..4.0_f64) {
            let lens = Eucm { alpha, beta };
            let turn = lens.max_angle();
            for step in 0..200 {
                let theta = turn * f64::from(step) / 200.0;
                prop_assert!(lens.slope(theta) > 0.0 && lens.terms(theta).denominator > 0.0, "{theta} of {turn}");
            }
            let beyond = lens.terms(turn + 1e-3);
            prop_assert!(turn > 0.999 * std::f64::consts::PI || beyond.q < 0.0 || beyond.denominator < 0.0, "{turn}");
        }

        #[test]
        fn inverse_of_the_radius_returns_the_angle(alpha in 0.0..1.0_f64, beta in 0.2..4.0_f64, share in 0.0..1.0_f64) {
            let lens = Eucm { alpha, beta };
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
