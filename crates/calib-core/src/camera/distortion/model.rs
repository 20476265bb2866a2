//! What every model of distortion says of itself.

use crate::camera::distortion::Distortion;

/// Rows x and y.
pub(crate) type Matrix2 = [[f64; 2]; 2];

/// How an undistorted point and its Jacobian by the distorted one, which stays, change with a coefficient.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct ByCoefficient {
    /// Of the undistorted point.
    pub(crate) at: [f64; 2],
    /// Of `d undistorted / d distorted`.
    pub(crate) jacobian: Matrix2,
}

/// One for every coefficient, in the order of [`Distortion::coefficients`].
pub(crate) type ByCoefficients = [ByCoefficient; Distortion::MOST];

/// Rows x, y and w of a ray by the two coordinates of its distorted point.
pub(crate) type RayMatrix = [[f64; 2]; 3];

/// How a [`RayMatrix`] changes with each of the two coordinates of its distorted point.
pub(crate) type RayCurvature = [RayMatrix; 2];

/// How a ray and its Jacobian by the distorted point, which stays, change with a coefficient.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct RayByCoefficient {
    /// Of the ray.
    pub(crate) at: [f64; 3],
    /// Of `d ray / d distorted`.
    pub(crate) jacobian: RayMatrix,
}

/// A model of distortion: both maps and their derivatives, on coordinates divided by the focal.
pub(crate) trait Model {
    /// As [`Distortion::max_radius`].
    fn max_radius(&self) -> f64;

    /// As [`Distortion::distort`].
    fn distort(&self, straight: [f64; 2]) -> Option<[f64; 2]>;

    /// As [`Distortion::undistort`].
    fn undistort(&self, bent: [f64; 2]) -> Option<[f64; 2]>;

    /// Whether a ray of the scene leads to this distorted point.
    fn reaches(&self, bent: [f64; 2]) -> bool {
        self.undistort(bent).is_some()
    }

    /// `d distorted / d undistorted`.
    fn distort_jacobian(&self, straight: [f64; 2]) -> Matrix2;

    /// `d distorted / d coefficient`, the undistorted point staying.
    fn distort_by_coefficients(&self, straight: [f64; 2]) -> [[f64; 2]; Distortion::MOST];

    /// `d undistorted / d distorted` at `bent`, which undistorts to `straight`.
    fn undistort_jacobian(&self, bent: [f64; 2], straight: [f64; 2]) -> Matrix2;

    /// How `straight` and [`Self::undistort_jacobian`] change with every coefficient, `bent` staying.
    fn undistort_by_coefficients(&self, bent: [f64; 2], straight: [f64; 2]) -> ByCoefficients;

    /// As [`Distortion::ray`].
    fn ray(&self, bent: [f64; 2]) -> Option<[f64; 3]> {
        self.undistort(bent).map(|[x, y]| [x, y, 1.0])
    }

    /// As [`Distortion::shown`].
    fn shown(&self, [x, y, w]: [f64; 3]) -> Option<[f64; 2]> {
        if w > 0.0 { self.distort([x / w, y / w]) } else { None }
    }

    /// `d ray / d distorted` at `bent`, which shows `ray`.
    fn ray_jacobian(&self, bent: [f64; 2], [x, y, _]: [f64; 3]) -> RayMatrix {
        let [u, v] = self.undistort_jacobian(bent, [x, y]);
        [u, v, [0.0; 2]]
    }

    /// How [`Self::ray_jacobian`] changes with `bent`, which shows `ray`; of a model that looks beside and behind itself.
    fn ray_curvature(&self, _bent: [f64; 2], _ray: [f64; 3]) -> RayCurvature {
        RayCurvature::default()
    }

    /// How `ray` and [`Self::ray_jacobian`] change with every coefficient, `bent` staying.
    fn ray_by_coefficients(
        &self,
        bent: [f64; 2],
        [x, y, _]: [f64; 3],
    ) -> [RayByCoefficient; Distortion::MOST] {
        self.undistort_by_coefficients(bent, [x, y]).map(|by| {
            let ([x, y], [u, v]) = (by.at, by.jacobian);
            RayByCoefficient { at: [x, y, 0.0], jacobian: [u, v, [0.0; 2]] }
        })
    }
}

/// The derivative of a map along radii at `point`, from how it stretches across and along the radius:
/// `across I + (along - across) n n'` with the radius' direction n. A change of such a derivative has the
/// same form.
pub(crate) fn radial([x, y]: [f64; 2], across: f64, along: f64) -> Matrix2 {
    let square = x * x + y * y;
    if square == 0.0 {
        return [[along, 0.0], [0.0, along]];
    }
    let bend = (along - across) / square;
    [[across + bend * x * x, bend * x * y], [bend * x * y, across + bend * y * y]]
}

/// `A x`.
pub(crate) fn times([[a, b], [c, d]]: Matrix2, [x, y]: [f64; 2]) -> [f64; 2] {
    [a * x + b * y, c * x + d * y]
}
