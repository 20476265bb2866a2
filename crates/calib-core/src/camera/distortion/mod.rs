//! Distortion models: the maps between distorted and undistorted points, and their derivatives.
//!
//! Each model has its own file. The file contains the formula and its source, the maps and their derivatives
//! ([`Model`]), and the entry of the model in the table [`MODELS`]. A new model also needs three additions
//! here: its module, its variant of [`Distortion`] and its [`DistortionModel`]. All other code reads the
//! properties of a model from the table. Each external format has its own table of the models that it
//! supports.

mod model;
mod brown_conrady;
mod division;
mod profile;
mod kannala_brandt;
mod double_sphere;
mod eucm;
mod unified;
mod rational;
#[path = "distortion_tests.rs"]
#[cfg(test)]
pub(crate) mod tests;

use crate::camera::distortion::division::Division;
use crate::camera::distortion::double_sphere::DoubleSphere;
use crate::camera::distortion::eucm::Eucm;
use crate::camera::distortion::kannala_brandt::KannalaBrandt;
use crate::camera::distortion::model::Model;

pub use brown_conrady::BrownConrady;
pub(crate) use brown_conrady::{BrownInverse, LANES};
pub(crate) use model::{
    ByCoefficient, ByCoefficients, Matrix2, RayByCoefficient, RayCurvature, RayMatrix, multiply,
};
pub use rational::Rational;
pub use unified::Unified;

/// Lens distortion, on coordinates relative to the principal point and divided by the focal length. The
/// coefficients follow OpenCV. In the formulas, `theta` is the angle between a ray and the optical axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Distortion {
    /// No distortion: a perfect pinhole.
    #[default]
    None,
    /// Brown-Conrady model with the radial coefficients k1, k2, k3 and the tangential coefficients p1, p2.
    /// The order of OpenCV's vector is k1, k2, p1, p2, k3.
    BrownConrady(BrownConrady),
    /// Division model: `x_undistorted = x_distorted / (1 + lambda r^2)`, where r is the distorted radius
    /// (Fitzgibbon 2001).
    Division {
        /// Single coefficient; negative for barrel distortion.
        lambda: f64,
    },
    /// Kannala-Brandt model, OpenCV's fisheye model: `radius = theta (1 + k1 theta^2 + ... + k4 theta^8)`.
    KannalaBrandt {
        /// Coefficients k1 to k4.
        k: [f64; 4],
    },
    /// Unified model of Mei, `omni` of Kalibr: `radius = (1 + xi) sin theta / (xi + cos theta)`, and then
    /// distortion with k1, k2, p1 and p2. The radius is divided by the focal length at the image centre,
    /// which is Mei's gamma divided by `1 + xi`.
    Unified(Unified),
    /// Extended unified model, `eucm` of Kalibr and Basalt:
    /// `radius = sin theta / (alpha d + (1 - alpha) cos theta)` with
    /// `d^2 = beta sin^2 theta + cos^2 theta`.
    Eucm {
        /// Weight of the distance d in the formula, between 0 and 1; 0 is the pinhole camera.
        alpha: f64,
        /// Shape of the surface that rays meet; above 0. For 1, the model equals the unified model.
        beta: f64,
    },
    /// Double-sphere model, `ds` of Kalibr and Basalt:
    /// `radius = (1 + xi) sin theta / (alpha d2 + (1 - alpha) (xi + cos theta))` with
    /// `d2^2 = 1 + 2 xi cos theta + xi^2`. The radius is divided by the focal length at the image centre,
    /// which is Kalibr's focal length divided by `1 + xi`.
    DoubleSphere {
        /// Distance between the centres of the two spheres; above -1.
        xi: f64,
        /// Weight of the second sphere, between 0 and 1.
        alpha: f64,
    },
    /// Rational model of OpenCV with the radial coefficients k1 to k6, the tangential coefficients p1, p2 and
    /// the thin-prism coefficients s1 to s4. The coefficients are never fitted.
    Rational(Rational),
}

/// Names of the distortion models.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum DistortionModel {
    /// Brown-Conrady model with the coefficients k1, k2, k3, p1 and p2 of OpenCV.
    BrownConrady,
    /// Division model with the coefficient lambda.
    Division,
    /// OpenCV's fisheye model with the coefficients k1 to k4.
    KannalaBrandt,
    /// Mei's unified (omnidirectional) model with the coefficients xi, k1, k2, p1 and p2.
    Unified,
    /// Double-sphere model with the coefficients xi and alpha.
    DoubleSphere,
    /// Rational model of OpenCV with the coefficients k1 to k6, p1, p2 and s1 to s4.
    Rational,
    /// Extended unified model with the coefficients alpha and beta.
    Eucm,
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
    K5,
    K6,
    P1,
    P2,
    S1,
    S2,
    S3,
    S4,
    Lambda,
    Xi,
    Alpha,
    Beta,
}

/// Properties of one distortion model: an entry of the table [`MODELS`].
#[derive(Clone, Copy, Debug)]
pub struct ModelRow {
    /// Distortion model that this table entry describes.
    pub model: DistortionModel,
    /// Name of the model in files.
    pub name: &'static str,
    /// Names of the coefficients of the model, in the order of [`Distortion::coefficients`].
    pub coefficients: &'static [Coefficient],
    /// Exponents n, one for each coefficient. If the focal length is multiplied by a factor, coefficients
    /// multiplied by the n-th power of the factor result in the same map of pixels. `None` if the map of
    /// pixels determines the focal length.
    pub focal_powers: Option<&'static [i32]>,
    /// Whether a coefficient can be fitted only together with all coefficients before it in the order.
    pub in_order: bool,
    /// Whether the model shows rays 90° or more from the optical axis.
    pub is_wide: bool,
    /// Whether the model can be fitted to straight edges. Otherwise its coefficients are fixed, and derivatives
    /// with respect to them are zero.
    pub is_fitted: bool,
    /// Number of coefficients that are fitted by default: the first ones in the order.
    pub default_count: usize,
    /// Distortion of this model with all coefficients zero; only beta of the extended unified model is 1.
    pub zero: Distortion,
}

/// Table of all distortion models, in the order of [`DistortionModel`].
pub const MODELS: [ModelRow; 7] = [
    brown_conrady::ROW,
    division::ROW,
    kannala_brandt::ROW,
    unified::ROW,
    double_sphere::ROW,
    rational::ROW,
    eucm::ROW,
];

impl DistortionModel {
    /// Returns the table entry of this model in [`MODELS`].
    #[must_use]
    pub const fn row(self) -> &'static ModelRow {
        &MODELS[self as usize]
    }
}

impl Coefficient {
    /// All distortion coefficients, in the order in which files list them.
    pub const ALL: [Self; 16] = [
        Self::K1,
        Self::K2,
        Self::K3,
        Self::K4,
        Self::K5,
        Self::K6,
        Self::P1,
        Self::P2,
        Self::S1,
        Self::S2,
        Self::S3,
        Self::S4,
        Self::Lambda,
        Self::Xi,
        Self::Alpha,
        Self::Beta,
    ];

    /// Returns the name of the coefficient in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::K1 => "k1",
            Self::K2 => "k2",
            Self::K3 => "k3",
            Self::K4 => "k4",
            Self::K5 => "k5",
            Self::K6 => "k6",
            Self::P1 => "p1",
            Self::P2 => "p2",
            Self::S1 => "s1",
            Self::S2 => "s2",
            Self::S3 => "s3",
            Self::S4 => "s4",
            Self::Lambda => "lambda",
            Self::Xi => "xi",
            Self::Alpha => "alpha",
            Self::Beta => "beta",
        }
    }

    /// Returns the name of the coefficient on screen, with Greek letters.
    #[must_use]
    pub const fn title(self) -> &'static str {
        match self {
            Self::Lambda => "\u{3bb}",
            Self::Xi => "\u{3be}",
            Self::Alpha => "\u{3b1}",
            Self::Beta => "\u{3b2}",
            other => other.name(),
        }
    }

    /// Returns the minimum and the maximum of the coefficient values that describe a lens.
    #[must_use]
    pub const fn bounds(self) -> [f64; 2] {
        match self {
            Self::Xi => [-0.999_999, 1e6],
            Self::Alpha => [0.0, 1.0],
            Self::Beta => [1e-6, 1e6],
            _ => [-1e6, 1e6],
        }
    }

    /// Whether a value of the coefficient is within its bounds; see [`Self::bounds`].
    pub(crate) fn is_valid(self, value: f64) -> bool {
        let [least, most] = self.bounds();
        value >= least && value <= most
    }
}

impl Distortion {
    /// Number of coefficients of the distortion model with the most coefficients.
    pub const MAX_COEFFICIENTS: usize = 12;
    /// Number of coefficients of the fitted model with the most coefficients. Derivatives with respect to
    /// coefficients have this length.
    pub const MAX_FITTED: usize = 5;

    /// Creates a unified model without radial and tangential coefficients.
    #[must_use]
    pub const fn unified(xi: f64) -> Self {
        Self::Unified(Unified { xi, radial: [0.0; 2], tangential: [0.0; 2] })
    }

    /// Returns the model of this distortion, or `None` without distortion.
    #[must_use]
    pub const fn model(&self) -> Option<DistortionModel> {
        match self {
            Self::None => None,
            Self::BrownConrady(_) => Some(DistortionModel::BrownConrady),
            Self::Division { .. } => Some(DistortionModel::Division),
            Self::KannalaBrandt { .. } => Some(DistortionModel::KannalaBrandt),
            Self::Unified(_) => Some(DistortionModel::Unified),
            Self::DoubleSphere { .. } => Some(DistortionModel::DoubleSphere),
            Self::Rational(_) => Some(DistortionModel::Rational),
            Self::Eucm { .. } => Some(DistortionModel::Eucm),
        }
    }

    /// Calls a function with the distortion model and returns its result. Returns `None` without distortion.
    #[inline]
    fn with_model<T>(&self, function: impl FnOnce(&dyn Model) -> T) -> Option<T> {
        Some(match *self {
            Self::None => return None,
            Self::BrownConrady(brown) => function(&brown),
            Self::Division { lambda } => function(&Division { lambda }),
            Self::KannalaBrandt { k } => function(&KannalaBrandt { k }),
            Self::Unified(unified) => function(&unified),
            Self::DoubleSphere { xi, alpha } => function(&DoubleSphere { xi, alpha }),
            Self::Rational(rational) => function(&rational),
            Self::Eucm { alpha, beta } => function(&Eucm { alpha, beta }),
        })
    }

    /// Returns the coefficients in the order of [`ModelRow::coefficients`], padded with zeros.
    #[must_use]
    pub fn coefficients(&self) -> [f64; Self::MAX_COEFFICIENTS] {
        let mut all = [0.0; Self::MAX_COEFFICIENTS];
        let mut put = |values: &[f64]| all[..values.len()].copy_from_slice(values);
        match self {
            Self::None => {}
            Self::BrownConrady(BrownConrady { k1, k2, k3, p1, p2 }) => put(&[*k1, *k2, *k3, *p1, *p2]),
            Self::Division { lambda } => put(&[*lambda]),
            Self::KannalaBrandt { k } => put(k),
            Self::Unified(Unified { xi, radial, tangential }) => {
                put(&[&[*xi], &radial[..], tangential].concat());
            }
            Self::Eucm { alpha, beta } => put(&[*alpha, *beta]),
            Self::DoubleSphere { xi, alpha } => put(&[*xi, *alpha]),
            Self::Rational(Rational { radial, tangential, prism }) => {
                put(&[&radial[..], tangential, prism].concat());
            }
        }
        all
    }

    /// Returns the first [`Self::MAX_FITTED`] coefficients. A model that can be fitted has no others.
    #[must_use]
    pub fn fitted_coefficients(&self) -> [f64; Self::MAX_FITTED] {
        let all = self.coefficients();
        std::array::from_fn(|i| all[i])
    }

    /// Returns the same distortion model with other coefficients. Superfluous coefficients are ignored.
    #[must_use]
    pub fn with_coefficients(&self, all: [f64; Self::MAX_COEFFICIENTS]) -> Self {
        let [a, b, c, d, e, f, g, h, prism @ ..] = all;
        match self {
            Self::None => Self::None,
            Self::BrownConrady(_) => Self::BrownConrady(BrownConrady { k1: a, k2: b, k3: c, p1: d, p2: e }),
            Self::Division { .. } => Self::Division { lambda: a },
            Self::KannalaBrandt { .. } => Self::KannalaBrandt { k: [a, b, c, d] },
            Self::Unified(_) => Self::Unified(Unified { xi: a, radial: [b, c], tangential: [d, e] }),
            Self::Eucm { .. } => Self::Eucm { alpha: a, beta: b },
            Self::DoubleSphere { .. } => Self::DoubleSphere { xi: a, alpha: b },
            Self::Rational(_) => {
                Self::Rational(Rational { radial: [a, b, c, d, e, f], tangential: [g, h], prism })
            }
        }
    }

    /// Returns the same distortion model with other values of the first coefficients; see
    /// [`Self::fitted_coefficients`].
    #[must_use]
    pub fn with_fitted_coefficients(&self, fitted: [f64; Self::MAX_FITTED]) -> Self {
        let mut all = self.coefficients();
        all[..Self::MAX_FITTED].copy_from_slice(&fitted);
        self.with_coefficients(all)
    }

    /// Returns the names of the coefficients of this distortion, in the order of [`Self::coefficients`].
    #[must_use]
    pub fn names(&self) -> &'static [Coefficient] {
        self.model().map_or(&[], |model| model.row().coefficients)
    }

    /// Whether the lens has no distortion, or all its coefficients are zero in a model that is then a pinhole.
    /// Such a lens maps straight lines to straight lines.
    #[must_use]
    pub fn is_pinhole(&self) -> bool {
        /// Test point off the axis, divided by the focal length. A pinhole maps it to itself.
        const POINT: [f64; 2] = [0.5, 0.25];
        // The comparison allows for rounding, because wide lenses are computed with angles.
        let is_there = |[x, y]: [f64; 2]| (x - POINT[0]).abs() + (y - POINT[1]).abs() < 1e-12;
        let is_plain = |model: DistortionModel| model.row().zero.distort(POINT).is_some_and(is_there);
        self.coefficients() == [0.0; Self::MAX_COEFFICIENTS] && self.model().is_none_or(is_plain)
    }

    /// Returns the largest undistorted radius, divided by the focal length, up to which the distorted radius
    /// increases in every direction. It is infinite if there is no limit. Beyond this radius, the model does
    /// not describe a lens.
    #[must_use]
    pub fn max_radius(&self) -> f64 {
        self.with_model(|model| model.max_radius()).unwrap_or(f64::INFINITY)
    }

    /// Maps an undistorted point to the distorted point, both divided by the focal length. Returns `None`
    /// beyond [`Self::max_radius`].
    #[must_use]
    pub fn distort(&self, undistorted: [f64; 2]) -> Option<[f64; 2]> {
        self.with_model(|model| model.distort(undistorted)).unwrap_or(Some(undistorted)).filter(is_finite)
    }

    /// Maps a distorted point to the undistorted point, both divided by the focal length. The accuracy is
    /// 1e-12.
    ///
    /// Returns `None` if no undistorted point within [`Self::max_radius`] maps to this point.
    #[must_use]
    pub fn undistort(&self, distorted: [f64; 2]) -> Option<[f64; 2]> {
        self.with_model(|model| model.undistort(distorted)).unwrap_or(Some(distorted)).filter(is_finite)
    }

    /// Returns the ray at a distorted point, which is divided by the focal length. The ray is the vector (x right, y
    /// down, w forward) in camera axes. The component w is zero or negative for rays 90° or more from the optical
    /// axis. Returns `None` if no ray reaches the point.
    #[must_use]
    pub fn ray(&self, distorted: [f64; 2]) -> Option<[f64; 3]> {
        self.with_model(|model| model.ray(distorted)).unwrap_or(Some([distorted[0], distorted[1], 1.0]))
    }

    /// Maps a ray of any length to its distorted point, divided by the focal length: the inverse of
    /// [`Self::ray`]. Returns `None` if the lens does not show the ray.
    #[must_use]
    pub fn ray_to_distorted(&self, [x, y, w]: [f64; 3]) -> Option<[f64; 2]> {
        let undistorted = || if w > 0.0 { Some([x / w, y / w]) } else { None };
        self.with_model(|model| model.ray_to_distorted([x, y, w]))
            .unwrap_or_else(undistorted)
            .filter(is_finite)
    }

    /// Whether the distortion model shows rays 90° or more from the optical axis.
    #[must_use]
    pub fn is_wide(&self) -> bool {
        self.model().is_some_and(|model| model.row().is_wide)
    }

    /// Returns the Jacobian `d ray / d distorted` at the distorted point `distorted`, whose ray is `ray`.
    pub(crate) fn ray_jacobian(&self, distorted: [f64; 2], ray: [f64; 3]) -> RayMatrix {
        self.with_model(|model| model.ray_jacobian(distorted, ray)).unwrap_or([
            [1.0, 0.0],
            [0.0, 1.0],
            [0.0; 2],
        ])
    }

    /// Returns the derivatives of [`Self::ray_jacobian`] with respect to the distorted point `distorted`,
    /// whose ray is `ray`.
    pub(crate) fn ray_curvature(&self, distorted: [f64; 2], ray: [f64; 3]) -> RayCurvature {
        self.with_model(|model| model.ray_curvature(distorted, ray)).unwrap_or_default()
    }

    /// Returns the derivatives of `ray` and of [`Self::ray_jacobian`] with respect to every coefficient, at
    /// the fixed distorted point `distorted`.
    pub(crate) fn ray_by_coefficients(
        &self,
        distorted: [f64; 2],
        ray: [f64; 3],
    ) -> [RayByCoefficient; Self::MAX_FITTED] {
        self.with_model(|model| model.ray_by_coefficients(distorted, ray)).unwrap_or_default()
    }

    /// Whether a ray of the scene reaches this distorted point. A ray of a fisheye may be 90° or more from
    /// the optical axis.
    pub(crate) fn has_ray(&self, distorted: [f64; 2]) -> bool {
        self.with_model(|model| model.has_ray(distorted)).unwrap_or_else(|| is_finite(&distorted))
    }

    /// Returns the Jacobian `d distorted / d undistorted` at an undistorted point.
    pub(crate) fn distort_jacobian(&self, undistorted: [f64; 2]) -> Matrix2 {
        self.with_model(|model| model.distort_jacobian(undistorted)).unwrap_or(IDENTITY)
    }

    /// Returns the derivatives `d distorted / d coefficient` for every coefficient, at a fixed undistorted
    /// point.
    pub(crate) fn distort_by_coefficients(&self, undistorted: [f64; 2]) -> [[f64; 2]; Self::MAX_FITTED] {
        self.with_model(|model| model.distort_by_coefficients(undistorted)).unwrap_or_default()
    }

    /// Returns the Jacobian `d undistorted / d distorted` at the distorted point `distorted`, whose
    /// undistorted point is `undistorted`.
    pub(crate) fn undistort_jacobian(&self, distorted: [f64; 2], undistorted: [f64; 2]) -> Matrix2 {
        self.with_model(|model| model.undistort_jacobian(distorted, undistorted)).unwrap_or(IDENTITY)
    }

    /// Returns the derivatives of the undistorted point `undistorted` and of [`Self::undistort_jacobian`]
    /// with respect to every coefficient, at the fixed distorted point `distorted`.
    pub(crate) fn undistort_by_coefficients(
        &self,
        distorted: [f64; 2],
        undistorted: [f64; 2],
    ) -> ByCoefficients {
        self.with_model(|model| model.undistort_by_coefficients(distorted, undistorted)).unwrap_or_default()
    }

    /// Returns the exponents of [`ModelRow::focal_powers`] of the first coefficients; zeros if the model has none.
    pub fn focal_powers(&self) -> [i32; Self::MAX_FITTED] {
        let powers = self.model().and_then(|model| model.row().focal_powers).unwrap_or_default();
        std::array::from_fn(|i| powers.get(i).copied().unwrap_or(0))
    }

    /// Returns the distortion that results in the same map of pixels if the focal length is multiplied by
    /// `ratio`.
    ///
    /// Returns `None` for a model whose map of pixels determines its focal length, unless `ratio` is 1.
    #[must_use]
    pub fn rescaled(&self, ratio: f64) -> Option<Self> {
        let Some(model) = self.model() else { return Some(*self) };
        let Some(powers) = model.row().focal_powers else { return (ratio == 1.0).then_some(*self) };
        let coefficients = self.coefficients();
        Some(self.with_coefficients(std::array::from_fn(|i| {
            coefficients[i] * powers.get(i).map_or(1.0, |&power| ratio.powi(power))
        })))
    }
}

/// Identity matrix.
const IDENTITY: Matrix2 = [[1.0, 0.0], [0.0, 1.0]];

/// Whether both coordinates of a point are finite.
fn is_finite(point: &[f64; 2]) -> bool {
    point.iter().all(|value| value.is_finite())
}
