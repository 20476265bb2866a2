//! Rational model of `OpenCV` with decentring and thin-prism terms: D. Claus and A. W. Fitzgibbon, "A
//! rational function lens distortion model for general cameras", 2005, in the form of `OpenCV`'s `calib3d`.
//!
//! An undistorted point (x, y) has the distorted point (x', y'), both divided by the focal length. With
//! `s = x^2 + y^2` and `R = N / D`, `N = 1 + k1 s + k2 s^2 + k3 s^3`, `D = 1 + k4 s + k5 s^2 + k6 s^3`:
//!
//! ```text
//! x' = x R + 2 p1 x y + p2 (s + 2 x^2) + s1 s + s2 s^2
//! y' = y R + p1 (s + 2 y^2) + 2 p2 x y + s3 s + s4 s^2
//! ```
//!
//! The inverse has no closed form. Let u be the undistorted point, v the distorted point, and A the Jacobian
//! of the formula at u. By the implicit function theorem, `d u / d v = A^-1`, and
//! `d A^-1 / d v = -A^-1 (d A / d u A^-1) A^-1`. The coefficients are never fitted, so there are no derivatives
//! with respect to them.

use crate::camera::distortion::model::{Matrix2, Model, RayCurvature, product};
use crate::camera::distortion::{Coefficient, Distortion, DistortionModel, ModelRow};
use crate::camera::numerics::{hypot, positive_roots};

/// Table entry of the rational model in [`MODELS`](super::MODELS).
pub(super) const ROW: ModelRow = ModelRow {
    model: DistortionModel::Rational,
    name: "rational",
    coefficients: &[
        Coefficient::K1,
        Coefficient::K2,
        Coefficient::K3,
        Coefficient::K4,
        Coefficient::K5,
        Coefficient::K6,
        Coefficient::P1,
        Coefficient::P2,
        Coefficient::S1,
        Coefficient::S2,
        Coefficient::S3,
        Coefficient::S4,
    ],
    focal_powers: Some(&[2, 4, 6, 2, 4, 6, 1, 1, 1, 3, 1, 3]),
    in_order: false,
    is_wide: false,
    is_fitted: false,
    default_count: 0,
    zero: Distortion::Rational(Rational { radial: [0.0; 6], tangential: [0.0; 2], prism: [0.0; 4] }),
};

/// Coefficients of the rational model, with the names of `OpenCV`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rational {
    /// Radial coefficients k1 to k3 of the numerator, and k4 to k6 of the denominator.
    pub radial: [f64; 6],
    /// Tangential coefficients p1, p2.
    pub tangential: [f64; 2],
    /// Thin-prism coefficients s1 to s4.
    pub prism: [f64; 4],
}

/// Value and first two derivatives of a function of the squared radius s, with respect to s.
struct Expansion {
    value: f64,
    slope: f64,
    curvature: f64,
}

/// Returns the expansion of `1 + a s + b s^2 + c s^3`.
fn cubic([a, b, c]: [f64; 3], s: f64) -> Expansion {
    Expansion {
        value: 1.0 + s * (a + s * (b + s * c)),
        slope: a + s * (2.0 * b + 3.0 * s * c),
        curvature: 2.0 * b + 6.0 * s * c,
    }
}

impl Rational {
    /// Returns the numerator and the denominator of the radial factor, each as three coefficients.
    const fn halves(&self) -> [[f64; 3]; 2] {
        let [k1, k2, k3, k4, k5, k6] = self.radial;
        [[k1, k2, k3], [k4, k5, k6]]
    }

    /// Returns the radial factor R and its derivatives at a squared radius s.
    fn factor(&self, s: f64) -> Expansion {
        let [over, under] = self.halves().map(|terms| cubic(terms, s));
        let value = over.value / under.value;
        let slope = (over.slope - value * under.slope) / under.value;
        let curvature = (over.curvature - 2.0 * slope * under.slope - value * under.curvature) / under.value;
        Expansion { value, slope, curvature }
    }

    /// Returns the distorted point of an undistorted point by the formula, also beyond the fold of the model.
    fn evaluate(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (s, [p1, p2], [s1, s2, s3, s4]) = (x * x + y * y, self.tangential, self.prism);
        let radial = self.factor(s).value;
        [
            x * radial + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x) + s * (s1 + s * s2),
            y * radial + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y + s * (s3 + s * s4),
        ]
    }

    /// Returns the Jacobian A of the formula at an undistorted point.
    fn jacobian(&self, [x, y]: [f64; 2]) -> Matrix2 {
        let (s, [p1, p2], [s1, s2, s3, s4]) = (x * x + y * y, self.tangential, self.prism);
        let Expansion { value, slope, .. } = self.factor(s);
        let (prism_x, prism_y) = (s1 + 2.0 * s2 * s, s3 + 2.0 * s4 * s);
        let cross = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
        [
            [
                value + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x + 2.0 * x * prism_x,
                cross + 2.0 * y * prism_x,
            ],
            [
                cross + 2.0 * x * prism_y,
                value + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x + 2.0 * y * prism_y,
            ],
        ]
    }

    /// Returns the derivatives of [`Self::jacobian`] with respect to x and to y of the undistorted point.
    fn jacobian_by_point(&self, [x, y]: [f64; 2]) -> [Matrix2; 2] {
        let (s, [p1, p2], [s1, s2, s3, s4]) = (x * x + y * y, self.tangential, self.prism);
        let Expansion { slope: q, curvature: t, .. } = self.factor(s);
        let (prism_x, prism_y) = (2.0 * (s1 + 2.0 * s2 * s), 2.0 * (s3 + 2.0 * s4 * s));
        let (xxy, xyy) =
            (2.0 * y * q + 4.0 * x * x * y * t + 2.0 * p1, 2.0 * x * q + 4.0 * x * y * y * t + 2.0 * p2);
        let of_x = [
            6.0 * x * q + 4.0 * x * x * x * t + 6.0 * p2 + prism_x + 8.0 * s2 * x * x,
            xxy + 8.0 * s2 * x * y,
            xyy + prism_x + 8.0 * s2 * y * y,
        ];
        let of_y = [
            xxy + prism_y + 8.0 * s4 * x * x,
            xyy + 8.0 * s4 * x * y,
            6.0 * y * q + 4.0 * y * y * y * t + 6.0 * p1 + prism_y + 8.0 * s4 * y * y,
        ];
        [[[of_x[0], of_x[1]], [of_y[0], of_y[1]]], [[of_x[1], of_x[2]], [of_y[1], of_y[2]]]]
    }

    /// Returns the undistorted radius at which the radial part stops increasing, or at which its denominator is
    /// zero. It is infinite if there is no such radius. The tangential and prism terms are ignored.
    ///
    /// The radial part `r R` with `R = N / D` increases while `(N + 2 s N') D - 2 s N D' > 0`. Primes are
    /// derivatives with respect to `s = r^2`.
    fn fold_radius(&self) -> f64 {
        let [[a, b, c], [d, e, f]] = self.halves();
        let over = [1.0, a, b, c];
        let under = [1.0, d, e, f];
        let mut growth = [0.0; 7];
        for (i, over) in over.iter().enumerate() {
            for (j, under) in under.iter().enumerate() {
                growth[i + j] += over * under * (1.0 + 2.0 * i as f64 - 2.0 * j as f64);
            }
        }
        let first = |roots: Vec<f64>| roots.first().map_or(f64::INFINITY, |s| s.sqrt());
        first(positive_roots(&growth)).min(first(positive_roots(&under)))
    }

    /// Returns the undistorted radius whose radial part is `distorted`, by bisection below the fold; `None`
    /// if the radial part is never so large.
    fn radial_inverse(&self, distorted: f64, fold: f64) -> Option<f64> {
        /// Largest undistorted radius: 89.9999 degrees from the axis.
        const MAX_RADIUS: f64 = 1e6;
        /// Number of bisection steps, enough for the start of Newton's method.
        const HALVINGS: usize = 60;
        let radius = |r: f64| r * self.factor(r * r).value;
        let (mut low, mut high) = (0.0, distorted.max(0.1));
        while high < fold.min(MAX_RADIUS) && radius(high) < distorted {
            (low, high) = (high, 2.0 * high);
        }
        high = high.min(fold * (1.0 - 1e-12)).min(MAX_RADIUS);
        if radius(high) < distorted {
            return None;
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if radius(middle) < distorted { low = middle } else { high = middle }
        }
        Some(0.5 * (low + high))
    }
}

/// Returns the inverse of a matrix.
fn inverse([[a, b], [c, d]]: Matrix2) -> Matrix2 {
    let determinant = a * d - b * c;
    [[d / determinant, -b / determinant], [-c / determinant, a / determinant]]
}

impl Model for Rational {
    fn max_radius(&self) -> f64 {
        self.fold_radius()
    }

    fn distort(&self, undistorted: [f64; 2]) -> Option<[f64; 2]> {
        (hypot(undistorted[0], undistorted[1]) <= self.fold_radius()).then(|| self.evaluate(undistorted))
    }

    /// Solves the formula by Newton's method, from the solution of the radial part.
    fn undistort(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        /// Maximum number of Newton steps; convergence is quadratic except at the fold.
        const MAX_STEPS: usize = 50;
        /// Largest accepted last step, relative to the size of the point.
        const TOLERANCE: f64 = 1e-13;
        let (radius, fold) = (hypot(x, y), self.fold_radius());
        // The tangential and prism terms may move a point at the fold inwards.
        let start = self.radial_inverse(radius, fold).or_else(|| fold.is_finite().then_some(0.99 * fold))?;
        let scale = if radius > 0.0 { start / radius } else { 1.0 };
        let mut point = [scale * x, scale * y];
        for _ in 0..MAX_STEPS {
            let [found_x, found_y] = self.evaluate(point);
            let (ex, ey) = (found_x - x, found_y - y);
            let [[a, b], [c, d]] = inverse(self.jacobian(point));
            let step = [a * ex + b * ey, c * ex + d * ey];
            point = [point[0] - step[0], point[1] - step[1]];
            let size = 1.0 + hypot(point[0], point[1]);
            if step[0].abs().max(step[1].abs()) < TOLERANCE * size {
                let [found_x, found_y] = self.evaluate(point);
                let is_close = (found_x - x).hypot(found_y - y) < 1e-12 * (1.0 + radius);
                return (is_close && hypot(point[0], point[1]) <= fold).then_some(point);
            }
        }
        None
    }

    fn distort_jacobian(&self, undistorted: [f64; 2]) -> Matrix2 {
        self.jacobian(undistorted)
    }

    fn undistort_jacobian(&self, _: [f64; 2], undistorted: [f64; 2]) -> Matrix2 {
        inverse(self.jacobian(undistorted))
    }

    fn ray_curvature(&self, _: [f64; 2], [x, y, _]: [f64; 3]) -> RayCurvature {
        let back = inverse(self.jacobian([x, y]));
        let by_point = self.jacobian_by_point([x, y]);
        [0, 1].map(|k| {
            let entry = |i: usize, j: usize| by_point[0][i][j] * back[0][k] + by_point[1][i][j] * back[1][k];
            let change = [0, 1].map(|i| [entry(i, 0), entry(i, 1)]);
            let [u, v] = product(product(back, change), back).map(|row| row.map(|value| -value));
            [u, v, [0.0; 2]]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn model_agrees_with_the_formula_of_opencv() {
        let lens = Rational {
            radial: [0.5, 0.15, 0.01, 0.83, 0.3, 0.05],
            tangential: [2e-4, -1e-4],
            prism: [0.0; 4],
        };
        // A point of a calibrated camera with a focal length of 730 px and the centre at (960, 540).
        let [x, y] = lens.evaluate([-0.6, 0.3]);
        let (s, f) = (0.45_f64, 730.0);
        let radial = (1.0 + 0.5 * s + 0.15 * s * s + 0.01 * s.powi(3))
            / (1.0 + 0.83 * s + 0.3 * s * s + 0.05 * s.powi(3));
        let right = [
            -0.6 * radial + 2.0 * 2e-4 * -0.18 - 1e-4 * (s + 0.72),
            0.3 * radial + 2e-4 * (s + 0.18) + 2.0 * -1e-4 * -0.18,
        ];
        assert!((f * (x - right[0])).abs() + (f * (y - right[1])).abs() < 1e-9);
    }

    #[test]
    fn without_denominator_and_prism_it_is_the_brown_conrady_model() {
        let brown = super::super::BrownConrady { k1: -0.2, k2: 0.05, k3: -0.01, p1: 1e-3, p2: -2e-3 };
        let lens = Rational {
            radial: [-0.2, 0.05, -0.01, 0.0, 0.0, 0.0],
            tangential: [1e-3, -2e-3],
            prism: [0.0; 4],
        };
        for point in [[0.1, 0.2], [-0.5, 0.3], [0.7, -0.4]] {
            let [a, b] = [brown.distort(point), lens.distort(point)].map(|shown| shown.unwrap_or_default());
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-15);
        }
    }

    proptest! {
        #[test]
        fn a_pole_of_the_radial_part_ends_the_lens(k4 in -2.0..-0.5_f64) {
            let lens = Rational { radial: [0.0, 0.0, 0.0, k4, 0.0, 0.0], ..Rational::default() };
            let fold = lens.max_radius();
            prop_assert!((fold - (-1.0 / k4).sqrt()).abs() < 1e-9, "{fold}");
            prop_assert!(lens.distort([1.01 * fold, 0.0]).is_none());
        }
    }
}
