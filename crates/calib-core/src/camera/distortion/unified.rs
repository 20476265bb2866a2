//! Unified model with one sphere: C. Geyer, K. Daniilidis, "A unifying theory for central panoramic systems",
//! 2000; C. Mei, P. Rives, "Single view point omnidirectional camera calibration from planar grids", 2007,
//! without its distortion.
//!
//! A ray in the direction (x, y, z) meets a unit sphere. A pinhole with the focal length gamma observes the
//! sphere from the distance `xi` behind its centre: `u = gamma x / (xi |(x, y, z)| + z)`. The model is a
//! [`DoubleSphere`] with alpha = 0. A ray at the angle theta from the optical axis has the image radius
//! `P = (1 + xi) sin theta / (xi + cos theta)`, divided by the focal length `gamma / (1 + xi)` at the image
//! centre.

use crate::camera::distortion::double_sphere::DoubleSphere;
use crate::camera::distortion::profile::Profile;
use crate::camera::distortion::{Coefficient, Distortion, DistortionModel, ModelRow};

/// Table entry of the unified model in [`MODELS`](super::MODELS).
pub(super) const ROW: ModelRow = ModelRow {
    model: DistortionModel::Unified,
    name: "unified",
    coefficients: &[Coefficient::Xi],
    focal_powers: None,
    in_order: true,
    is_wide: true,
    is_fitted: false,
    default_count: 1,
    zero: Distortion::Unified { xi: 0.0 },
};

/// Unified model with its coefficient `xi`: the distance of the pinhole behind the centre of the unit sphere.
#[derive(Clone, Copy, Debug)]
pub(super) struct Unified {
    pub(super) xi: f64,
}

impl Unified {
    /// Returns the equal double-sphere model, with alpha = 0.
    const fn as_double_sphere(self) -> DoubleSphere {
        DoubleSphere { xi: self.xi, alpha: 0.0 }
    }
}

impl Profile for Unified {
    const COEFFICIENTS: usize = 1;

    fn radius(&self, theta: f64) -> f64 {
        self.as_double_sphere().radius(theta)
    }

    fn slope(&self, theta: f64) -> f64 {
        self.as_double_sphere().slope(theta)
    }

    fn curvature(&self, theta: f64) -> f64 {
        self.as_double_sphere().curvature(theta)
    }

    fn by_coefficients(&self, theta: f64) -> [[f64; 2]; Distortion::MAX_FITTED] {
        self.as_double_sphere().by_coefficients(theta)
    }

    fn inverse(&self, radius: f64) -> Option<f64> {
        self.as_double_sphere().inverse(radius)
    }

    fn max_angle(&self) -> f64 {
        self.as_double_sphere().max_angle()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn model_agrees_with_the_formula_of_the_paper(
            xi in -0.6..3.0_f64, gamma in 100.0..900.0_f64, x in -1.0..1.0_f64, y in -1.0..1.0_f64, z in -1.0..1.0_f64,
        ) {
            let length = (x * x + y * y + z * z).sqrt();
            let below = xi * length + z;
            // The model shows a ray if the radius still increases, and the angle is within the limit of all
            // lenses.
            let is_shown = below > 1e-3 * length && length + xi * z > 1e-6 && z > -0.8 * length;
            prop_assume!(is_shown && length > 0.1);
            let shown = Distortion::Unified { xi }.ray_to_distorted([x, y, z]).map(|at| at.map(|c| gamma / (1.0 + xi) * c));
            let [u, v] = shown.ok_or_else(|| TestCaseError::fail("not shown"))?;
            let size = 1.0 + (u.hypot(v) / gamma).powi(2);
            prop_assert!((u - gamma * x / below).hypot(v - gamma * y / below) < 1e-12 * gamma * size, "{u} {v}");
        }

        #[test]
        fn model_is_a_pinhole_for_xi_zero(x in -3.0..3.0_f64, y in -3.0..3.0_f64) {
            let lens = Distortion::Unified { xi: 0.0 };
            for other in [lens.distort([x, y]), lens.undistort([x, y])] {
                prop_assert!(other.is_some_and(|[a, b]| (a - x).hypot(b - y) < 1e-13 * (1.0 + x * x + y * y)));
            }
            prop_assert!(lens.is_pinhole() && lens.ray_to_distorted([x, y, -0.01]).is_none());
        }

        #[test]
        fn unified_model_is_a_double_sphere_with_one_parameter_zero(
            xi in -0.9..3.0_f64, alpha in 0.0..0.8_f64, x in -2.0..2.0_f64, y in -2.0..2.0_f64,
        ) {
            let ray = Distortion::Unified { xi }.ray([x, y]);
            prop_assert_eq!(ray, Distortion::DoubleSphere { xi, alpha: 0.0 }.ray([x, y]));
            // The model also equals a double sphere with xi = 0 and another alpha.
            let ray = Distortion::Unified { xi: alpha / (1.0 - alpha) }.ray([x, y]);
            let other = Distortion::DoubleSphere { xi: 0.0, alpha }.ray([x, y]);
            match (ray, other) {
                (Some(a), Some(b)) => {
                    let off = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                    let slopes = Distortion::Unified { xi: alpha / (1.0 - alpha) }.ray_jacobian([x, y], a);
                    prop_assert!(off < 1e-12 || slopes.iter().flatten().any(|s| s.abs() > 50.0), "{a:?} {b:?}");
                }
                (a, b) => prop_assert_eq!(a.is_some(), b.is_some()),
            }
        }
    }
}
