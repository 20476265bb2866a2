//! Distortion: the models, both maps of each, and their derivatives.
//!
//! A model is one file: its formula with its source, the maps, their derivatives ([`Model`]) and its row
//! of [`MODELS`]. Here it is named: its module, its arm of [`Distortion`], its [`DistortionModel`]. What
//! else depends on the model reads the row; which formats of other programs hold it, their table says.

mod model;
mod brown_conrady;
mod brown_inverse;
mod division;
mod kannala_brandt;

use crate::camera::distortion::division::Division;
use crate::camera::distortion::kannala_brandt::KannalaBrandt;
use crate::camera::distortion::model::Model;

pub use brown_conrady::BrownConrady;

pub(crate) use brown_inverse::{BrownInverse, LANES};
pub(crate) use model::{ByCoefficient, ByCoefficients, Matrix2, RayByCoefficient, RayMatrix, times};

/// Distortion of coordinates divided by the focal, in the terms of OpenCV.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Distortion {
    /// A perfect pinhole.
    #[default]
    None,
    /// Radial k1, k2, k3 and tangential p1, p2; OpenCV's order of a vector is k1, k2, p1, p2, k3.
    BrownConrady(BrownConrady),
    /// `x_undistorted = x_distorted / (1 + lambda r_distorted^2)` (Fitzgibbon 2001).
    Division {
        /// The one coefficient; negative for barrel distortion.
        lambda: f64,
    },
    /// OpenCV's fisheye: `theta_distorted = theta (1 + k1 theta^2 + ... + k4 theta^8)`.
    KannalaBrandt {
        /// k1 to k4.
        k: [f64; 4],
    },
}

/// Names of the distortion models.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum DistortionModel {
    /// k1, k2, k3, p1, p2 in OpenCV's terms.
    BrownConrady,
    /// lambda.
    Division,
    /// k1 to k4, OpenCV's fisheye.
    KannalaBrandt,
}

/// Names of the distortion coefficients.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[expect(missing_docs, reason = "the names are those of the coefficients")]
pub enum Coefficient {
    K1,
    K2,
    K3,
    K4,
    P1,
    P2,
    Lambda,
}

/// A row of the table of models.
#[derive(Clone, Copy, Debug)]
pub struct ModelRow {
    /// Which model.
    pub model: DistortionModel,
    /// Its name in files.
    pub name: &'static str,
    /// Its coefficients, in the order of [`Distortion::coefficients`].
    pub coefficients: &'static [Coefficient],
    /// With which power of the focal every coefficient grows when the map of pixels stays what it is;
    /// `None` where a map of pixels has one focal only, so that the coefficients have a focal of their own.
    pub powers: Option<[i32; Distortion::MOST]>,
    /// Whether a coefficient is fitted only with all those before it.
    pub in_order: bool,
    /// Whether it shows rays from beside and behind the camera, too, which no pinhole does.
    pub is_wide: bool,
    /// How many are fitted, from the first, where it is not said which.
    pub usual: usize,
    /// The model with coefficients of zero.
    pub zero: Distortion,
}

/// Every model of distortion, in the order of [`DistortionModel`].
pub const MODELS: [ModelRow; 3] = [brown_conrady::ROW, division::ROW, kannala_brandt::ROW];

impl DistortionModel {
    /// This model's row in [`MODELS`].
    #[must_use]
    pub const fn row(self) -> &'static ModelRow {
        &MODELS[self as usize]
    }
}

impl Coefficient {
    /// All of them, in the order of files.
    pub const ALL: [Self; 7] = [Self::K1, Self::K2, Self::K3, Self::K4, Self::P1, Self::P2, Self::Lambda];

    /// Its name in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::K1 => "k1",
            Self::K2 => "k2",
            Self::K3 => "k3",
            Self::K4 => "k4",
            Self::P1 => "p1",
            Self::P2 => "p2",
            Self::Lambda => "lambda",
        }
    }

    /// Its name on screen.
    #[must_use]
    pub const fn title(self) -> &'static str {
        match self {
            Self::Lambda => "\u{3bb}",
            other => other.name(),
        }
    }
}

impl Distortion {
    /// Number of coefficients of the largest model.
    pub const MOST: usize = 5;

    /// Which model it is; `None` without distortion.
    #[must_use]
    pub const fn model(&self) -> Option<DistortionModel> {
        match self {
            Self::None => None,
            Self::BrownConrady(_) => Some(DistortionModel::BrownConrady),
            Self::Division { .. } => Some(DistortionModel::Division),
            Self::KannalaBrandt { .. } => Some(DistortionModel::KannalaBrandt),
        }
    }

    /// Asks the model; `None` without distortion.
    #[inline]
    fn ask<T>(&self, question: impl FnOnce(&dyn Model) -> T) -> Option<T> {
        Some(match *self {
            Self::None => return None,
            Self::BrownConrady(brown) => question(&brown),
            Self::Division { lambda } => question(&Division { lambda }),
            Self::KannalaBrandt { k } => question(&KannalaBrandt { k }),
        })
    }

    /// The coefficients; zeros beyond those the model has.
    #[must_use]
    pub const fn coefficients(&self) -> [f64; Self::MOST] {
        match *self {
            Self::None => [0.0; Self::MOST],
            Self::BrownConrady(BrownConrady { k1, k2, k3, p1, p2 }) => [k1, k2, k3, p1, p2],
            Self::Division { lambda } => [lambda, 0.0, 0.0, 0.0, 0.0],
            Self::KannalaBrandt { k: [k1, k2, k3, k4] } => [k1, k2, k3, k4, 0.0],
        }
    }

    /// The same model with other coefficients.
    #[must_use]
    pub const fn with_coefficients(&self, [a, b, c, d, e]: [f64; Self::MOST]) -> Self {
        match self {
            Self::None => Self::None,
            Self::BrownConrady(_) => Self::BrownConrady(BrownConrady { k1: a, k2: b, k3: c, p1: d, p2: e }),
            Self::Division { .. } => Self::Division { lambda: a },
            Self::KannalaBrandt { .. } => Self::KannalaBrandt { k: [a, b, c, d] },
        }
    }

    /// Names of the coefficients, in the order of [`Self::coefficients`].
    #[must_use]
    pub fn names(&self) -> &'static [Coefficient] {
        self.model().map_or(&[], |model| model.row().coefficients)
    }

    /// Whether it bends no line: none, or coefficients of zero in a model that is a pinhole then.
    #[must_use]
    pub fn is_pinhole(&self) -> bool {
        const POINT: [f64; 2] = [0.5, 0.25];
        let is_plain = |model: DistortionModel| model.row().zero.distort(POINT) == Some(POINT);
        self.coefficients() == [0.0; Self::MOST] && self.model().is_none_or(is_plain)
    }

    /// Radius of the largest disc of undistorted, focal-normalised coordinates on which the model grows
    /// in every direction; infinite where it always does. Beyond it the model is not a lens.
    #[must_use]
    pub fn max_radius(&self) -> f64 {
        self.ask(|model| model.max_radius()).unwrap_or(f64::INFINITY)
    }

    /// Distorted from undistorted, both divided by the focal. `None` beyond [`Self::max_radius`].
    #[must_use]
    pub fn distort(&self, straight: [f64; 2]) -> Option<[f64; 2]> {
        self.ask(|model| model.distort(straight)).unwrap_or(Some(straight)).filter(is_finite)
    }

    /// Undistorted from distorted, both divided by the focal, to 1e-12.
    ///
    /// `None` where no undistorted point inside [`Self::max_radius`] leads here.
    #[must_use]
    pub fn undistort(&self, bent: [f64; 2]) -> Option<[f64; 2]> {
        self.ask(|model| model.undistort(bent)).unwrap_or(Some(bent)).filter(is_finite)
    }

    /// The ray that is shown at this distorted point, homogeneous: x right, y down, and w ahead, which is not
    /// positive beside and behind the camera; both divided by the focal. `None` where no ray leads here.
    #[must_use]
    pub fn ray(&self, bent: [f64; 2]) -> Option<[f64; 3]> {
        self.ask(|model| model.ray(bent)).unwrap_or(Some([bent[0], bent[1], 1.0]))
    }

    /// Where a ray, of any length, is shown: the inverse of [`Self::ray`]. `None` where the lens does not show it.
    #[must_use]
    pub fn shown(&self, [x, y, w]: [f64; 3]) -> Option<[f64; 2]> {
        let straight = || if w > 0.0 { Some([x / w, y / w]) } else { None };
        self.ask(|model| model.shown([x, y, w])).unwrap_or_else(straight).filter(is_finite)
    }

    /// Whether it shows rays from beside and behind the camera, too.
    #[must_use]
    pub fn is_wide(&self) -> bool {
        self.model().is_some_and(|model| model.row().is_wide)
    }

    /// `d ray / d distorted` at `bent`, which shows `ray`.
    pub(crate) fn ray_jacobian(&self, bent: [f64; 2], ray: [f64; 3]) -> RayMatrix {
        self.ask(|model| model.ray_jacobian(bent, ray)).unwrap_or([[1.0, 0.0], [0.0, 1.0], [0.0; 2]])
    }

    /// How `ray` and [`Self::ray_jacobian`] change with every coefficient, `bent` staying.
    pub(crate) fn ray_by_coefficients(
        &self,
        bent: [f64; 2],
        ray: [f64; 3],
    ) -> [RayByCoefficient; Self::MOST] {
        self.ask(|model| model.ray_by_coefficients(bent, ray)).unwrap_or_default()
    }

    /// Whether the model still grows at this distorted point, so that a ray of the scene leads there:
    /// for a fisheye also one from beside or behind the camera, which no pinhole sees.
    pub(crate) fn reaches(&self, bent: [f64; 2]) -> bool {
        self.ask(|model| model.reaches(bent)).unwrap_or_else(|| is_finite(&bent))
    }

    /// `d distorted / d undistorted`.
    pub(crate) fn distort_jacobian(&self, straight: [f64; 2]) -> Matrix2 {
        self.ask(|model| model.distort_jacobian(straight)).unwrap_or(IDENTITY)
    }

    /// `d distorted / d coefficient`, the undistorted point staying.
    pub(crate) fn distort_by_coefficients(&self, straight: [f64; 2]) -> [[f64; 2]; Self::MOST] {
        self.ask(|model| model.distort_by_coefficients(straight)).unwrap_or_default()
    }

    /// `d undistorted / d distorted` at `bent`, which undistorts to `straight`.
    pub(crate) fn undistort_jacobian(&self, bent: [f64; 2], straight: [f64; 2]) -> Matrix2 {
        self.ask(|model| model.undistort_jacobian(bent, straight)).unwrap_or(IDENTITY)
    }

    /// How `straight` and [`Self::undistort_jacobian`] change with every coefficient, `bent` staying.
    pub(crate) fn undistort_by_coefficients(&self, bent: [f64; 2], straight: [f64; 2]) -> ByCoefficients {
        self.ask(|model| model.undistort_by_coefficients(bent, straight)).unwrap_or_default()
    }

    /// With which power of the focal every coefficient grows when the map of pixels stays what it is.
    pub(crate) fn powers(&self) -> [i32; Self::MOST] {
        self.model().and_then(|model| model.row().powers).unwrap_or_default()
    }

    /// The coefficients of the same map of pixels when the focal is multiplied by `ratio`.
    ///
    /// `None` for a model whose map of pixels exists at one focal only.
    #[must_use]
    pub fn rescaled(&self, ratio: f64) -> Option<Self> {
        let Some(model) = self.model() else { return Some(*self) };
        let Some(powers) = model.row().powers else { return (ratio == 1.0).then_some(*self) };
        let coefficients = self.coefficients();
        Some(self.with_coefficients(std::array::from_fn(|i| coefficients[i] * ratio.powi(powers[i]))))
    }
}

const IDENTITY: Matrix2 = [[1.0, 0.0], [0.0, 1.0]];

fn is_finite(point: &[f64; 2]) -> bool {
    point.iter().all(|value| value.is_finite())
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    pub(crate) fn any_distortion() -> impl Strategy<Value = Distortion> {
        let brown = (-0.4..0.3_f64, -0.2..0.2_f64, -0.05..0.05_f64, -0.003..0.003_f64, -0.003..0.003_f64)
            .prop_map(|(k1, k2, k3, p1, p2)| Distortion::BrownConrady(BrownConrady { k1, k2, k3, p1, p2 }));
        let fisheye = [-0.1..0.1_f64, -0.05..0.05_f64, -0.02..0.02_f64, -0.005..0.005_f64]
            .prop_map(|k| Distortion::KannalaBrandt { k });
        prop_oneof![brown, (-1.0..0.5_f64).prop_map(|lambda| Distortion::Division { lambda }), fisheye]
    }

    /// Step of differences: half the digits are rounding, the other half truncation.
    const STEP: f64 = 1e-6;

    fn nudged(distortion: &Distortion, coefficient: usize, by: f64) -> Distortion {
        let mut coefficients = distortion.coefficients();
        coefficients[coefficient] += by;
        distortion.with_coefficients(coefficients)
    }

    /// Central differences of a pair of numbers, extrapolated from two steps (Richardson), so that the error
    /// in the square of the step is gone; `None` just inside a fold, where they have not converged.
    fn difference_quotient(at: impl Fn(f64) -> Option<[f64; 2]>) -> Option<[f64; 2]> {
        let central = |step: f64| {
            let (ahead, behind) = (at(step)?, at(-step)?);
            Some([0, 1].map(|i| (ahead[i] - behind[i]) / (2.0 * step)))
        };
        let (whole, half) = (central(STEP)?, central(0.5 * STEP)?);
        let has_converged = (0..2).all(|i| (whole[i] - half[i]).abs() < 1e-3 * (1.0 + half[i].abs()));
        has_converged.then(|| [0, 1].map(|i| (4.0 * half[i] - whole[i]) / 3.0))
    }

    /// Whether an analytic derivative is that of differences, or these leave the lens.
    fn agrees(analytic: [f64; 2], numeric: Option<[f64; 2]>) -> bool {
        let size = analytic[0].abs().max(analytic[1].abs());
        numeric.is_none_or(|n| [0, 1].iter().all(|&i| (n[i] - analytic[i]).abs() < 1e-5 * (1.0 + size)))
    }

    fn column(matrix: Matrix2, k: usize) -> [f64; 2] {
        [matrix[0][k], matrix[1][k]]
    }

    #[test]
    fn the_table_is_in_the_order_of_the_models() {
        for row in &MODELS {
            assert_eq!(row.model.row().name, row.name);
            assert_eq!(row.zero.model(), Some(row.model));
            assert!(row.coefficients.len() <= Distortion::MOST && row.usual <= row.coefficients.len());
        }
    }

    proptest! {
        #[test]
        fn undistorting_a_distorted_point_gives_it_back(
            distortion in any_distortion(), x in -1.5..1.5_f64, y in -1.5..1.5_f64,
        ) {
            if let Some(bent) = distortion.distort([x, y]) {
                // At the very fold the derivative vanishes, and digits with it.
                prop_assume!(x.hypot(y) < 0.98 * distortion.max_radius());
                let back = distortion.undistort(bent);
                let near = |back: [f64; 2]| (back[0] - x).hypot(back[1] - y) < 1e-10;
                prop_assert!(back.is_some_and(near), "{back:?} {x} {y}");
            }
        }

        #[test]
        fn distorting_an_undistorted_point_gives_it_back(
            distortion in any_distortion(), x in -1.0..1.0_f64, y in -1.0..1.0_f64,
        ) {
            if let Some(straight) = distortion.undistort([x, y]) {
                prop_assume!(straight[0].hypot(straight[1]) < 100.0);
                let back = distortion.distort(straight);
                prop_assert!(back.is_some(), "undistorted out of the domain: {straight:?}");
                if let Some(back) = back {
                    prop_assert!((back[0] - x).hypot(back[1] - y) < 1e-11, "{back:?} {x} {y}");
                }
            }
        }

        #[test]
        fn a_ray_is_shown_where_it_was_found(distortion in any_distortion(), x in -2.5..2.5_f64, y in -2.5..2.5_f64) {
            let Some(ray) = distortion.ray([x, y]) else { return Ok(()) };
            let [a, b, w] = ray;
            // At the very fold the derivative vanishes, and digits with it; far away a pinhole has none.
            let jacobian = distortion.ray_jacobian([x, y], ray);
            prop_assume!(jacobian.iter().flatten().all(|slope| slope.abs() < 50.0));
            let back = distortion.shown([3.0 * a, 3.0 * b, 3.0 * w]);
            prop_assert!(back.is_some_and(|back| (back[0] - x).hypot(back[1] - y) < 1e-11), "{back:?} {x} {y}");
            prop_assert!(distortion.is_wide() || w == 1.0);
        }

        #[test]
        fn derivatives_of_rays_are_those_of_differences(
            distortion in any_distortion(), x in -1.8..1.8_f64, y in -1.8..1.8_f64,
        ) {
            let Some(ray) = distortion.ray([x, y]) else { return Ok(()) };
            let jacobian = distortion.ray_jacobian([x, y], ray);
            prop_assume!(jacobian.iter().flatten().all(|slope| slope.abs() < 20.0));
            let pair = |at: [f64; 3], i: usize| [at[i], at[2 - i / 2]];
            for i in 0..3 {
                let column = |k: usize| pair(jacobian.map(|row| row[k]), i);
                prop_assert!(agrees(column(0), difference_quotient(|d| Some(pair(distortion.ray([x + d, y])?, i)))), "x");
                prop_assert!(agrees(column(1), difference_quotient(|d| Some(pair(distortion.ray([x, y + d])?, i)))), "y");
            }
            let by = distortion.ray_by_coefficients([x, y], ray);
            for (k, name) in distortion.names().iter().enumerate() {
                for i in 0..3 {
                    let numeric = difference_quotient(|d| Some(pair(nudged(&distortion, k, d).ray([x, y])?, i)));
                    prop_assert!(agrees(pair(by[k].at, i), numeric), "{name:?}: {:?} {numeric:?}", by[k]);
                    let row = |lens: &Distortion| Some(lens.ray_jacobian([x, y], lens.ray([x, y])?)[i]);
                    let numeric = difference_quotient(|d| row(&nudged(&distortion, k, d)));
                    prop_assert!(agrees(by[k].jacobian[i], numeric), "{name:?} {i}: {:?} {numeric:?}", by[k]);
                }
            }
        }

        #[test]
        fn derivatives_of_distortion_are_those_of_differences(
            distortion in any_distortion(), x in -1.5..1.5_f64, y in -1.5..1.5_f64,
        ) {
            // Up to the fold all of them grow without bound.
            prop_assume!(x.hypot(y) < 0.9 * distortion.max_radius());
            let (jacobian, by) = (distortion.distort_jacobian([x, y]), distortion.distort_by_coefficients([x, y]));
            prop_assert!(agrees(column(jacobian, 0), difference_quotient(|d| distortion.distort([x + d, y]))), "x");
            prop_assert!(agrees(column(jacobian, 1), difference_quotient(|d| distortion.distort([x, y + d]))), "y");
            for (k, name) in distortion.names().iter().enumerate() {
                let numeric = difference_quotient(|d| nudged(&distortion, k, d).distort([x, y]));
                prop_assert!(agrees(by[k], numeric), "{name:?}: {:?} {numeric:?}", by[k]);
            }
        }

        #[test]
        fn derivatives_of_undistortion_are_those_of_differences(
            distortion in any_distortion(), x in -1.2..1.2_f64, y in -1.2..1.2_f64,
        ) {
            let Some(straight) = distortion.undistort([x, y]) else { return Ok(()) };
            prop_assume!(straight[0].hypot(straight[1]) < (0.9 * distortion.max_radius()).min(4.0));
            let jacobian_of = |lens: &Distortion| {
                Some(lens.undistort_jacobian([x, y], lens.undistort([x, y])?))
            };
            let jacobian = distortion.undistort_jacobian([x, y], straight);
            prop_assert!(agrees(column(jacobian, 0), difference_quotient(|d| distortion.undistort([x + d, y]))), "x");
            prop_assert!(agrees(column(jacobian, 1), difference_quotient(|d| distortion.undistort([x, y + d]))), "y");
            let by = distortion.undistort_by_coefficients([x, y], straight);
            for (k, name) in distortion.names().iter().enumerate() {
                let numeric = difference_quotient(|d| nudged(&distortion, k, d).undistort([x, y]));
                prop_assert!(agrees(by[k].at, numeric), "{name:?}: {:?} {numeric:?}", by[k]);
                for row in 0..2 {
                    let numeric = difference_quotient(|d| Some(jacobian_of(&nudged(&distortion, k, d))?[row]));
                    prop_assert!(agrees(by[k].jacobian[row], numeric), "{name:?}: {:?} {numeric:?}", by[k]);
                }
            }
        }
    }
}
