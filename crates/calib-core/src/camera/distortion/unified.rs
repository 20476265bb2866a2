//! Unified model with one sphere: C. Geyer, K. Daniilidis, "A unifying theory for central panoramic systems",
//! 2000; C. Mei, P. Rives, "Single view point omnidirectional camera calibration from planar grids", 2007.
//! `omni` of Kalibr, `MEI` of camodocal.
//!
//! A ray in the direction (x, y, z) meets a unit sphere. A pinhole observes the sphere from the distance `xi`
//! behind its centre: `m = (x, y) / (xi |(x, y, z)| + z)`. The Brown-Conrady formula with k1, k2, p1 and p2
//! distorts m, and the focal length gamma of Mei maps it to pixels. Near the image centre the focal length is
//! `f = gamma / (1 + xi)`, and coordinates divided by f are `q = (1 + xi) m`. In these coordinates, the sphere
//! is a [`DoubleSphere`] with alpha = 0, and the distortion is a Brown-Conrady model with the coefficients
//! `k1 / (1 + xi)^2`, `k2 / (1 + xi)^4`, `p1 / (1 + xi)` and `p2 / (1 + xi)`. Derivatives follow from the
//! chain rule.

use crate::camera::distortion::brown_conrady::BrownConrady;
use crate::camera::distortion::double_sphere::DoubleSphere;
use crate::camera::distortion::model::{Matrix2, Model, RayCurvature, RayMatrix, product};
use crate::camera::distortion::profile::Profile as _;
use crate::camera::distortion::{Coefficient, Distortion, DistortionModel, ModelRow};
use crate::camera::numerics::tan;

/// Table entry of the unified model in [`MODELS`](super::MODELS).
pub(super) const ROW: ModelRow = ModelRow {
    model: DistortionModel::Unified,
    name: "unified",
    coefficients: &[Coefficient::Xi, Coefficient::K1, Coefficient::K2, Coefficient::P1, Coefficient::P2],
    focal_powers: None,
    in_order: true,
    is_wide: true,
    is_fitted: false,
    default_count: 1,
    zero: Distortion::Unified(Unified { xi: 0.0, radial: [0.0; 2], tangential: [0.0; 2] }),
};

/// Coefficients of the unified model of Mei.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Unified {
    /// Distance of the pinhole behind the centre of the unit sphere; above -1.
    pub xi: f64,
    /// Radial distortion coefficients k1 and k2, applied to the points that the pinhole observes.
    pub radial: [f64; 2],
    /// Tangential distortion coefficients p1 and p2, applied to the points that the pinhole observes.
    pub tangential: [f64; 2],
}

impl Unified {
    /// Returns the map of the sphere without distortion: the double-sphere model with alpha = 0.
    const fn sphere(&self) -> DoubleSphere {
        DoubleSphere { xi: self.xi, alpha: 0.0 }
    }

    /// Returns the distortion of the points that the pinhole observes, on coordinates divided by the focal
    /// length near the image centre.
    fn lens(&self) -> BrownConrady {
        let gain = (1.0 + self.xi).recip();
        let ([k1, k2], [p1, p2]) = (self.radial, self.tangential);
        let square = gain * gain;
        BrownConrady { k1: k1 * square, k2: k2 * square * square, k3: 0.0, p1: p1 * gain, p2: p2 * gain }
    }

    /// Returns the point before distortion whose distorted point is `distorted`.
    fn before_lens(&self, distorted: [f64; 2]) -> Option<[f64; 2]> {
        if self.radial == [0.0; 2] && self.tangential == [0.0; 2] {
            return Some(distorted);
        }
        self.lens().undistort(distorted)
    }

    /// Returns the point of a ray before the distortion. Returns the image centre for a ray that the lens does not
    /// show, but callers pass only rays that the lens shows.
    fn point_of_ray(&self, ray: [f64; 3]) -> [f64; 2] {
        self.sphere().ray_to_distorted(ray).unwrap_or_default()
    }
}

impl Model for Unified {
    fn max_radius(&self) -> f64 {
        let fold = self.lens().max_radius();
        let theta = if fold.is_finite() { self.sphere().inverse(fold) } else { None };
        let of_lens = theta.filter(|&theta| theta < std::f64::consts::FRAC_PI_2).map_or(f64::INFINITY, tan);
        self.sphere().max_radius().min(of_lens)
    }

    fn distort(&self, undistorted: [f64; 2]) -> Option<[f64; 2]> {
        self.lens().distort(self.sphere().distort(undistorted)?)
    }

    fn undistort(&self, distorted: [f64; 2]) -> Option<[f64; 2]> {
        self.sphere().undistort(self.before_lens(distorted)?)
    }

    fn has_ray(&self, distorted: [f64; 2]) -> bool {
        self.before_lens(distorted).is_some_and(|point| self.sphere().has_ray(point))
    }

    fn ray(&self, distorted: [f64; 2]) -> Option<[f64; 3]> {
        self.sphere().ray(self.before_lens(distorted)?)
    }

    fn ray_to_distorted(&self, ray: [f64; 3]) -> Option<[f64; 2]> {
        self.lens().distort(self.sphere().ray_to_distorted(ray)?)
    }

    fn distort_jacobian(&self, undistorted: [f64; 2]) -> Matrix2 {
        let point = self.sphere().distort(undistorted).unwrap_or_default();
        product(self.lens().distort_jacobian(point), self.sphere().distort_jacobian(undistorted))
    }

    fn undistort_jacobian(&self, distorted: [f64; 2], undistorted: [f64; 2]) -> Matrix2 {
        let point = self.sphere().distort(undistorted).unwrap_or_default();
        let of_sphere = self.sphere().undistort_jacobian(point, undistorted);
        product(of_sphere, self.lens().undistort_jacobian(distorted, point))
    }

    fn ray_jacobian(&self, distorted: [f64; 2], ray: [f64; 3]) -> RayMatrix {
        let point = self.point_of_ray(ray);
        product(self.sphere().ray_jacobian(point, ray), self.lens().undistort_jacobian(distorted, point))
    }

    /// Returns the derivatives of the product `R J` with respect to the distorted point. J is the Jacobian of
    /// the point q before the distortion. R is the Jacobian of the ray with respect to q. The derivative with
    /// respect to coordinate k is `sum_m (dR / dq_m) J_mk J + R dJ / dk`.
    fn ray_curvature(&self, distorted: [f64; 2], ray: [f64; 3]) -> RayCurvature {
        let point @ [x, y] = self.point_of_ray(ray);
        let (sphere, lens) = (self.sphere(), self.lens());
        let of_sphere = sphere.ray_jacobian(point, ray);
        let by_point = sphere.ray_curvature(point, ray);
        let of_lens = lens.undistort_jacobian(distorted, point);
        let lens_by_point = lens.ray_curvature(distorted, [x, y, 1.0]);
        [0, 1].map(|k| {
            let entry =
                |i: usize, j: usize| by_point[0][i][j] * of_lens[0][k] + by_point[1][i][j] * of_lens[1][k];
            let turned = product([0, 1, 2].map(|i| [entry(i, 0), entry(i, 1)]), of_lens);
            let [u, v, _] = lens_by_point[k];
            let bent = product(of_sphere, [u, v]);
            [0, 1, 2].map(|i| [0, 1].map(|j| turned[i][j] + bent[i][j]))
        })
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
            let shown = Distortion::unified(xi).ray_to_distorted([x, y, z]).map(|at| at.map(|c| gamma / (1.0 + xi) * c));
            let [u, v] = shown.ok_or_else(|| TestCaseError::fail("not shown"))?;
            let size = 1.0 + (u.hypot(v) / gamma).powi(2);
            prop_assert!((u - gamma * x / below).hypot(v - gamma * y / below) < 1e-12 * gamma * size, "{u} {v}");
        }

        #[test]
        fn distortion_agrees_with_the_formula_of_mei(
            xi in 0.0..2.0_f64, gamma in 100.0..900.0_f64, radial in [-0.3..0.2_f64, 0.0..0.1_f64],
            tangential in [-0.003..0.003_f64, -0.003..0.003_f64], x in -1.0..1.0_f64, y in -1.0..1.0_f64, z in 0.2..1.0_f64,
        ) {
            // Equations 9 and 10 of Mei and Rives, in pixels.
            let below = xi * (x * x + y * y + z * z).sqrt() + z;
            let (mx, my) = (x / below, y / below);
            let ([k1, k2], [p1, p2], s) = (radial, tangential, mx * mx + my * my);
            let scale = 1.0 + k1 * s + k2 * s * s;
            let right = [
                gamma * (mx * scale + 2.0 * p1 * mx * my + p2 * (s + 2.0 * mx * mx)),
                gamma * (my * scale + p1 * (s + 2.0 * my * my) + 2.0 * p2 * mx * my),
            ];
            let lens = Distortion::Unified(Unified { xi, radial, tangential });
            let Some([u, v]) = lens.ray_to_distorted([x, y, z]).map(|at| at.map(|c| gamma / (1.0 + xi) * c)) else {
                // The lens ends at the fold of its distortion.
                prop_assert!(x.hypot(y) / z > 0.999 * lens.max_radius());
                return Ok(());
            };
            prop_assert!((u - right[0]).hypot(v - right[1]) < 1e-9 * gamma, "{u} {v} {right:?}");
        }

        #[test]
        fn model_is_a_pinhole_for_xi_zero(x in -3.0..3.0_f64, y in -3.0..3.0_f64) {
            let lens = Distortion::unified(0.0);
            for other in [lens.distort([x, y]), lens.undistort([x, y])] {
                prop_assert!(other.is_some_and(|[a, b]| (a - x).hypot(b - y) < 1e-13 * (1.0 + x * x + y * y)));
            }
            prop_assert!(lens.is_pinhole() && lens.ray_to_distorted([x, y, -0.01]).is_none());
        }

        #[test]
        fn unified_model_is_a_double_sphere_with_one_parameter_zero(
            xi in -0.9..3.0_f64, alpha in 0.0..0.8_f64, x in -2.0..2.0_f64, y in -2.0..2.0_f64,
        ) {
            let ray = Distortion::unified(xi).ray([x, y]);
            prop_assert_eq!(ray, Distortion::DoubleSphere { xi, alpha: 0.0 }.ray([x, y]));
            // The model also equals a double sphere with xi = 0 and another alpha.
            let ray = Distortion::unified(alpha / (1.0 - alpha)).ray([x, y]);
            let other = Distortion::DoubleSphere { xi: 0.0, alpha }.ray([x, y]);
            match (ray, other) {
                (Some(a), Some(b)) => {
                    let off = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                    let slopes = Distortion::unified(alpha / (1.0 - alpha)).ray_jacobian([x, y], a);
                    prop_assert!(off < 1e-12 || slopes.iter().flatten().any(|s| s.abs() > 50.0), "{a:?} {b:?}");
                }
                (a, b) => prop_assert_eq!(a.is_some(), b.is_some()),
            }
        }
    }
}
