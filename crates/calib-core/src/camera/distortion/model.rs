//! Interface of a distortion model, and the types of its derivatives.

use crate::camera::distortion::Distortion;

/// Matrix of 2 x 2, row by row; the rows are x and y.
pub(crate) type Matrix2 = [[f64; 2]; 2];

/// Derivatives of an undistorted point and of its Jacobian with respect to one coefficient, at a fixed
/// distorted point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct ByCoefficient {
    /// Derivative of the undistorted point.
    pub(crate) at: [f64; 2],
    /// Derivative of `d undistorted / d distorted`.
    pub(crate) jacobian: Matrix2,
}

impl ByCoefficient {
    /// Returns the derivatives times a factor.
    pub(crate) fn times(self, factor: f64) -> Self {
        let scaled = |row: [f64; 2]| row.map(|by| factor * by);
        Self { at: scaled(self.at), jacobian: self.jacobian.map(scaled) }
    }
}

/// Derivatives of an undistorted point and of its Jacobian with respect to every coefficient, in the order of
/// [`Distortion::coefficients`].
pub(crate) type ByCoefficients = [ByCoefficient; Distortion::MAX_FITTED];

/// Jacobian `d ray / d distorted` of a ray with respect to its distorted point; the rows are x, y and w.
pub(crate) type RayMatrix = [[f64; 2]; 3];

/// Derivatives of a [`RayMatrix`] with respect to the two coordinates of the distorted point.
pub(crate) type RayCurvature = [RayMatrix; 2];

/// Derivatives of a ray and of its Jacobian with respect to one coefficient, at a fixed distorted point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct RayByCoefficient {
    /// Derivative of the ray.
    pub(crate) at: [f64; 3],
    /// Derivative of `d ray / d distorted`.
    pub(crate) jacobian: RayMatrix,
}

impl RayByCoefficient {
    /// Returns the derivatives times a factor.
    pub(crate) fn times(self, factor: f64) -> Self {
        Self {
            at: self.at.map(|by| factor * by),
            jacobian: self.jacobian.map(|row| row.map(|by| factor * by)),
        }
    }
}

/// Distortion model: the maps in both directions and their derivatives, on coordinates divided by the focal
/// length.
pub(crate) trait Model {
    /// Returns the largest undistorted radius of the model; see [`Distortion::max_radius`].
    fn max_radius(&self) -> f64;

    /// Maps an undistorted point to the distorted point; see [`Distortion::distort`].
    fn distort(&self, undistorted: [f64; 2]) -> Option<[f64; 2]>;

    /// Maps a distorted point to the undistorted point; see [`Distortion::undistort`].
    fn undistort(&self, distorted: [f64; 2]) -> Option<[f64; 2]>;

    /// Whether a ray of the scene reaches this distorted point.
    fn has_ray(&self, distorted: [f64; 2]) -> bool {
        self.undistort(distorted).is_some()
    }

    /// Returns the Jacobian `d distorted / d undistorted` at an undistorted point.
    fn distort_jacobian(&self, undistorted: [f64; 2]) -> Matrix2;

    /// Returns the derivatives `d distorted / d coefficient` for every coefficient, at a fixed undistorted point. All
    /// derivatives with respect to coefficients are zero for models that are not fitted.
    fn distort_by_coefficients(&self, _undistorted: [f64; 2]) -> [[f64; 2]; Distortion::MAX_FITTED] {
        Default::default()
    }

    /// Returns the Jacobian `d undistorted / d distorted` at the distorted point `distorted`, whose
    /// undistorted point is `undistorted`.
    fn undistort_jacobian(&self, distorted: [f64; 2], undistorted: [f64; 2]) -> Matrix2;

    /// Returns the derivatives of `undistorted` and of [`Self::undistort_jacobian`] with respect to every
    /// coefficient, at the fixed distorted point `distorted`.
    fn undistort_by_coefficients(&self, _distorted: [f64; 2], _undistorted: [f64; 2]) -> ByCoefficients {
        ByCoefficients::default()
    }

    /// Returns the ray at a distorted point; see [`Distortion::ray`].
    fn ray(&self, distorted: [f64; 2]) -> Option<[f64; 3]> {
        self.undistort(distorted).map(|[x, y]| [x, y, 1.0])
    }

    /// Maps a ray to its distorted point; see [`Distortion::ray_to_distorted`].
    fn ray_to_distorted(&self, [x, y, w]: [f64; 3]) -> Option<[f64; 2]> {
        if w > 0.0 { self.distort([x / w, y / w]) } else { None }
    }

    /// Returns the Jacobian `d ray / d distorted` at a distorted point (divided by the focal length). The second
    /// argument is the ray at this point, as returned by [`Self::ray`].
    fn ray_jacobian(&self, distorted: [f64; 2], [x, y, _]: [f64; 3]) -> RayMatrix {
        let [u, v] = self.undistort_jacobian(distorted, [x, y]);
        [u, v, [0.0; 2]]
    }

    /// Returns the derivatives of [`Self::ray_jacobian`] with respect to the distorted point, which has the
    /// given ray.
    fn ray_curvature(&self, distorted: [f64; 2], ray: [f64; 3]) -> RayCurvature;

    /// Returns the derivatives of the ray and of [`Self::ray_jacobian`] with respect to every coefficient, at
    /// the fixed distorted point `distorted`.
    fn ray_by_coefficients(
        &self,
        distorted: [f64; 2],
        [x, y, _]: [f64; 3],
    ) -> [RayByCoefficient; Distortion::MAX_FITTED] {
        self.undistort_by_coefficients(distorted, [x, y]).map(|by| {
            let ([x, y], [u, v]) = (by.at, by.jacobian);
            RayByCoefficient { at: [x, y, 0.0], jacobian: [u, v, [0.0; 2]] }
        })
    }
}

/// Returns the Jacobian `across I + (along - across) n n'` of a radial map at a point. I is the identity, and
/// n the unit vector from the centre to the point. `across` and `along` are the scale factors perpendicular
/// to n and along n. For derivatives of the scale factors, the result is the derivative of the Jacobian.
pub(crate) fn radial([x, y]: [f64; 2], across: f64, along: f64) -> Matrix2 {
    let square = x * x + y * y;
    if square == 0.0 {
        return [[along, 0.0], [0.0, along]];
    }
    let bend = (along - across) / square;
    [[across + bend * x * x, bend * x * y], [bend * x * y, across + bend * y * y]]
}

/// Returns the product `A B` of a matrix A with two columns and a 2 x 2 matrix B.
pub(crate) fn product<const N: usize>(a: [[f64; 2]; N], b: Matrix2) -> [[f64; 2]; N] {
    a.map(|row| [0, 1].map(|k| row[0] * b[0][k] + row[1] * b[1][k]))
}

/// Returns the product `A x` of a 2 x 2 matrix A and a vector x.
pub(crate) fn multiply([[a, b], [c, d]]: Matrix2, [x, y]: [f64; 2]) -> [f64; 2] {
    [a * x + b * y, c * x + d * y]
}
