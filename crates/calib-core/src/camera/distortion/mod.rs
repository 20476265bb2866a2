//! Distortion: the models, both maps of each, and their derivatives.
//!
//! A model is one file: its formula with its source, the maps, their derivatives ([`Model`]) and its row
//! of [`MODELS`]. Here it is named: its module, its arm of [`Distortion`], its [`DistortionModel`]. What
//! else depends on the model reads the row; which formats of other programs hold it, their table says.

mod model;
mod brown_conrady;
mod division;
mod profile;
mod kannala_brandt;
mod double_sphere;
mod unified;
#[path = "distortion_tests.rs"]
#[cfg(test)]
pub(crate) mod tests;

use crate::camera::distortion::division::Division;
use crate::camera::distortion::double_sphere::DoubleSphere;
use crate::camera::distortion::kannala_brandt::KannalaBrandt;
use crate::camera::distortion::model::Model;
use crate::camera::distortion::unified::Unified;

pub use brown_conrady::BrownConrady;
pub(crate) use brown_conrady::{BrownInverse, LANES};
pub(crate) use model::{
    ByCoefficient, ByCoefficients, Matrix2, RayByCoefficient, RayCurvature, RayMatrix, times,
};

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
    /// Mei's, Kalibr's `omni`: `radius = (1 + xi) sin theta / (xi + cos theta)`, over the focal of the middle of the image,
    /// which is Mei's gamma over `1 + xi`.
    Unified {
        /// How far behind the centre of the sphere the pinhole is; above -1.
        xi: f64,
    },
    /// Kalibr's and Basalt's `ds`: `radius = (1 + xi) sin theta / (alpha d2 + (1 - alpha) (xi + cos theta))` with
    /// `d2^2 = 1 + 2 xi cos theta + xi^2`, over the focal of the middle of the image, which is theirs over `1 + xi`.
    DoubleSphere {
        /// Between the centres of the spheres; above -1.
        xi: f64,
        /// Of the second sphere, between 0 and 1.
        alpha: f64,
    },
}

/// Names of the distortion models.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum DistortionModel {
    /// k1, k2, k3, p1, p2 in OpenCV's terms.
    BrownConrady,
    /// lambda.
    Division,
    /// k1 to k4, OpenCV's fisheye.
    KannalaBrandt,
    /// xi, Mei's unified or omnidirectional model.
    Unified,
    /// xi and alpha.
    DoubleSphere,
}

/// Names of the distortion coefficients.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
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
    Xi,
    Alpha,
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
    /// Whether it is fitted to lines: else its coefficients are given.
    pub is_fitted: bool,
    /// How many are fitted, from the first, where it is not said which.
    pub usual: usize,
    /// The model with coefficients of zero.
    pub zero: Distortion,
}

/// Every model of distortion, in the order of [`DistortionModel`].
pub const MODELS: [ModelRow; 5] =
    [brown_conrady::ROW, division::ROW, kannala_brandt::ROW, unified::ROW, double_sphere::ROW];

impl DistortionModel {
    /// This model's row in [`MODELS`].
    #[must_use]
    pub const fn row(self) -> &'static ModelRow {
        &MODELS[self as usize]
    }
}

impl Coefficient {
    /// All of them, in the order of files.
    pub const ALL: [Self; 9] =
        [Self::K1, Self::K2, Self::K3, Self::K4, Self::P1, Self::P2, Self::Lambda, Self::Xi, Self::Alpha];

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
            Self::Xi => "xi",
            Self::Alpha => "alpha",
        }
    }

    /// Its name on screen.
    #[must_use]
    pub const fn title(self) -> &'static str {
        match self {
            Self::Lambda => "\u{3bb}",
            Self::Xi => "\u{3be}",
            Self::Alpha => "\u{3b1}",
            other => other.name(),
        }
    }

    /// The values with which it is one of a lens, least and most.
    #[must_use]
    pub const fn bounds(self) -> [f64; 2] {
        match self {
            Self::Xi => [-0.999_999, 1e6],
            Self::Alpha => [0.0, 1.0],
            _ => [-1e6, 1e6],
        }
    }

    pub(crate) fn holds(self, value: f64) -> bool {
        let [least, most] = self.bounds();
        value >= least && value <= most
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
            Self::Unified { .. } => Some(DistortionModel::Unified),
            Self::DoubleSphere { .. } => Some(DistortionModel::DoubleSphere),
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
            Self::Unified { xi } => question(&Unified { xi }),
            Self::DoubleSphere { xi, alpha } => question(&DoubleSphere { xi, alpha }),
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
            Self::Unified { xi } => [xi, 0.0, 0.0, 0.0, 0.0],
            Self::DoubleSphere { xi, alpha } => [xi, alpha, 0.0, 0.0, 0.0],
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
            Self::Unified { .. } => Self::Unified { xi: a },
            Self::DoubleSphere { .. } => Self::DoubleSphere { xi: a, alpha: b },
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
        // To rounding: the way of a wide lens leads over angles.
        let is_there = |[x, y]: [f64; 2]| (x - POINT[0]).abs() + (y - POINT[1]).abs() < 1e-12;
        let is_plain = |model: DistortionModel| model.row().zero.distort(POINT).is_some_and(is_there);
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

    /// How [`Self::ray_jacobian`] changes with `bent`, which shows `ray`, of a wide lens.
    pub(crate) fn ray_curvature(&self, bent: [f64; 2], ray: [f64; 3]) -> RayCurvature {
        self.ask(|model| model.ray_curvature(bent, ray)).unwrap_or_default()
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
    pub fn powers(&self) -> [i32; Self::MOST] {
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
