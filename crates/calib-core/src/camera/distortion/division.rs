//! Division model with one coefficient and a closed inverse: A. Fitzgibbon, "Simultaneous linear estimation
//! of multiple view geometry and lens distortion", 2001, equation 6.
//!
//! A distorted point x' with the radius r has the undistorted point `x = x' / D` with `D = 1 + lambda r^2`.
//! In the other direction, an undistorted point x with the radius s has the distorted point
//! `x' = 2 x / (1 + q)` with `q = sqrt(1 - 4 lambda s^2)`. All coordinates are divided by the focal length.

use crate::camera::distortion::model::{ByCoefficient, ByCoefficients, Matrix2, Model, RayCurvature};
use crate::camera::distortion::{Coefficient, Distortion, DistortionModel, ModelRow};

/// Table entry of the division model in [`MODELS`](super::MODELS).
pub(super) const ROW: ModelRow = ModelRow {
    model: DistortionModel::Division,
    name: "division",
    coefficients: &[Coefficient::Lambda],
    focal_powers: Some(&[2, 0, 0, 0, 0]),
    in_order: true,
    is_wide: false,
    is_fitted: true,
    default_count: 1,
    zero: Distortion::Division { lambda: 0.0 },
};

/// Division model with its coefficient `lambda`, which is negative for barrel distortion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Division {
    pub(super) lambda: f64,
}

impl Division {
    /// Returns `q = sqrt(1 - 4 lambda s^2)` and the scale `2 / (1 + q)` at an undistorted point with the
    /// radius s. Returns `None` beyond the largest radius, where q is not real.
    fn root_and_scale(&self, [x, y]: [f64; 2]) -> Option<(f64, f64)> {
        let square = 1.0 - 4.0 * self.lambda * (x * x + y * y);
        let root = (square >= 0.0).then(|| square.sqrt())?;
        Some((root, 2.0 / (1.0 + root)))
    }

    /// Returns `scale = 2 / (1 + q)` and its derivative with respect to `lambda s^2`, which is `scale^2 / q`.
    /// The derivative is infinite at the largest radius. For s and q, see [`Self::root_and_scale`].
    fn scale_and_derivative(&self, undistorted: [f64; 2]) -> (f64, f64) {
        let (root, scale) = self.root_and_scale(undistorted).unwrap_or((0.0, f64::INFINITY));
        (scale, scale * scale / root)
    }
}

impl Model for Division {
    fn max_radius(&self) -> f64 {
        if self.lambda > 0.0 { 0.5 / self.lambda.sqrt() } else { f64::INFINITY }
    }

    fn distort(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let (_, scale) = self.root_and_scale([x, y])?;
        Some([scale * x, scale * y])
    }

    fn undistort(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let square = x * x + y * y;
        if self.lambda > 0.0 && square > 1.0 / self.lambda {
            return None;
        }
        let divisor = 1.0 + self.lambda * square;
        let scale = (divisor > 0.0).then(|| divisor.recip())?;
        Some([scale * x, scale * y])
    }

    fn distort_jacobian(&self, [x, y]: [f64; 2]) -> Matrix2 {
        let (scale, growth) = self.scale_and_derivative([x, y]);
        let bend = 2.0 * self.lambda * growth;
        [[scale + bend * x * x, bend * x * y], [bend * x * y, scale + bend * y * y]]
    }

    fn distort_by_coefficients(&self, [x, y]: [f64; 2]) -> [[f64; 2]; Distortion::MAX_FITTED] {
        let (_, growth) = self.scale_and_derivative([x, y]);
        let along = growth * (x * x + y * y);
        let mut by = [[0.0; 2]; Distortion::MAX_FITTED];
        by[0] = [along * x, along * y];
        by
    }

    fn undistort_jacobian(&self, [x, y]: [f64; 2], _: [f64; 2]) -> Matrix2 {
        let divisor = 1.0 + self.lambda * (x * x + y * y);
        let square = divisor * divisor;
        let cross = -2.0 * self.lambda * x * y / square;
        let along = |c: f64| 1.0 / divisor - 2.0 * self.lambda * c * c / square;
        [[along(x), cross], [cross, along(y)]]
    }

    /// Differentiates the Jacobian `I / D - 2 lambda p p^T / D^2` with respect to the distorted point p, with
    /// the identity I and `D = 1 + lambda |p|^2`.
    fn ray_curvature(&self, point: [f64; 2], _: [f64; 3]) -> RayCurvature {
        let [x, y] = point;
        let divisor = 1.0 + self.lambda * (x * x + y * y);
        let by_square = -2.0 * self.lambda / (divisor * divisor);
        [0, 1].map(|k| {
            let entry = |i: usize, j: usize| {
                let [same, of_i, of_j] = [i == j, i == k, j == k].map(|is| f64::from(u8::from(is)));
                let bend = -4.0 * self.lambda * point[k] * point[i] * point[j] / divisor;
                by_square * (same * point[k] + of_i * point[j] + of_j * point[i] + bend)
            };
            [[entry(0, 0), entry(0, 1)], [entry(1, 0), entry(1, 1)], [0.0; 2]]
        })
    }

    fn undistort_by_coefficients(&self, [x, y]: [f64; 2], _: [f64; 2]) -> ByCoefficients {
        let radius = x * x + y * y;
        let divisor = 1.0 + self.lambda * radius;
        let square = divisor * divisor;
        // Derivative with respect to lambda of the Jacobian `I / D - 2 lambda p p^T / D^2`, where p is the
        // distorted point.
        let (same, outer) = (-radius / square, (4.0 * self.lambda * radius / divisor - 2.0) / square);
        let jacobian = [[same + outer * x * x, outer * x * y], [outer * x * y, same + outer * y * y]];
        let mut by = ByCoefficients::default();
        by[0] = ByCoefficient { at: [-x * radius / square, -y * radius / square], jacobian };
        by
    }
}
