//! What solving writes into the site file.

use std::fmt;

use serde::{Deserialize, Serialize};

use calib_core::camera::{Coefficient, DistortionModel, FloorPoint, ImageCircle, Pixel, WorldPoint};
use calib_core::outcome::{Code, Drawing, FailureCode, Residual};
use calib_core::single::Kind;

/// Declares plain structs of the document: strict, with optional fields left out when absent.
macro_rules! document {
    ($($(#[$attribute:meta])* struct $name:ident { $($(#[$field_doc:meta])* $field:ident: $type:ty,)+ })+) => {$(
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
        #[serde(deny_unknown_fields)]
        $(#[$attribute])*
        pub struct $name {
            $($(#[$field_doc])* pub $field: $type,)+
        }
    )+};
}

pub(crate) use document;

document! {
    /// Coefficients of a distortion model, or which of them to fit.
    struct DistortionEntry {
        /// Which model.
        model: DistortionModel,
        /// Brown-Conrady or Kannala-Brandt.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        k1: Option<f64>,
        /// Brown-Conrady or Kannala-Brandt.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        k2: Option<f64>,
        /// Brown-Conrady or Kannala-Brandt.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        k3: Option<f64>,
        /// Kannala-Brandt.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        k4: Option<f64>,
        /// Brown-Conrady.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        p1: Option<f64>,
        /// Brown-Conrady.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        p2: Option<f64>,
        /// Division.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        lambda: Option<f64>,
        /// Unified or double sphere.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        xi: Option<f64>,
        /// Double sphere.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        alpha: Option<f64>,
        /// Focal that the coefficients refer to, in pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        focal_px: Option<f64>,
        /// Coefficients to fit.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        fit: Option<Vec<Coefficient>>,
    }

    /// What solving found out about a camera.
    struct Solution {
        /// By which method.
        method: Method,
        /// How far it got.
        stage: Stage,
        /// x0, y0, z0, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        position_m: Option<WorldPoint>,
        /// In degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        yaw_deg: Option<f64>,
        /// In degrees, positive down.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pitch_deg: Option<f64>,
        /// In degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        roll_deg: Option<f64>,
        /// In pixels.
        focal_px: f64,
        /// Raw pixel.
        principal_point_px: Pixel,
        /// The disc in which a fisheye shows the scene, outside of which it has no answer: middle and radius, in pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        image_circle_px: Option<ImageCircle>,
        /// Coefficients for `focal_px`, or for a focal of their own.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        distortion: Option<DistortionEntry>,
        /// Standard deviations of what was estimated.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma: Option<Sigmas>,
        /// Covariance of everything estimated.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        covariance: Option<CovarianceEntry>,
        /// Standard deviation of a drawn coordinate that the sigmas stand on, in pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma_px: Option<f64>,
        /// Root mean square of the residuals, in pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        rms_px: Option<f64>,
        /// Sum of the squared residuals over their variances.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        chi2: Option<f64>,
        /// Residuals minus unknowns.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        dof: Option<usize>,
        /// The EFOV on the floor, in metres.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        efov_m: Vec<FloorPoint>,
        /// One for every piece of evidence.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        residuals: Vec<Residual>,
        /// Other minima that the data cannot rule out.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        alternatives: Vec<Alternative>,
        /// What the operator should know.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        warnings: Vec<Warning>,
        /// The drawing that would help most.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        draw_next: Option<DrawNext>,
    }

    /// A remark on a result, with what to do about it.
    struct Warning {
        /// Which remark.
        code: Code,
        /// What is so, in a sentence.
        message: String,
        /// What the operator can do, in a sentence.
        advice: String,
    }

    /// Why there is no result, with what to do about it.
    #[cfg_attr(feature = "schema", schemars(rename = "Failure"))]
    struct FailureEntry {
        /// Which reason.
        code: FailureCode,
        /// What is so, in a sentence.
        message: String,
        /// What the operator can do, in a sentence.
        advice: String,
    }

    /// A drawing that would help most.
    struct DrawNext {
        /// What to draw, and where.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        drawing: Option<Drawing>,
        /// The kind of annotation that it makes; none of links.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        kind: Option<Kind>,
        /// The same in a sentence.
        message: String,
        /// Raw pixels of an example, segment by segment.
        segments_px: Vec<[Pixel; 2]>,
        /// The predicted relative error of floor lengths with it.
        floor_length_rel: f64,
        /// What would help as well, the best first.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        otherwise: Vec<DrawNext>,
    }

    /// Standard deviations of what was estimated; absent where nothing was.
    #[derive(Default)]
    struct Sigmas {
        /// In metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        x_m: Option<f64>,
        /// In metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        y_m: Option<f64>,
        /// In metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        z_m: Option<f64>,
        /// In degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        yaw_deg: Option<f64>,
        /// In degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pitch_deg: Option<f64>,
        /// In degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        roll_deg: Option<f64>,
        /// In pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        focal_px: Option<f64>,
        /// Coefficient of the distortion.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        k1: Option<f64>,
        /// Coefficient of the distortion.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        k2: Option<f64>,
        /// Coefficient of the distortion.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        k3: Option<f64>,
        /// Coefficient of the distortion.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        k4: Option<f64>,
        /// Coefficient of the distortion.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        p1: Option<f64>,
        /// Coefficient of the distortion.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        p2: Option<f64>,
        /// Coefficient of the distortion.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        lambda: Option<f64>,
        /// In pixels, of a principal point that was fitted.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        principal_point_u_px: Option<f64>,
        /// In pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        principal_point_v_px: Option<f64>,
        /// Relative standard deviation of lengths on the floor inside the EFOV.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        floor_length_rel: Option<f64>,
    }

    /// A covariance matrix: what its rows are, and its upper triangle row by row.
    struct CovarianceEntry {
        /// Names as in the solution, with their units.
        of: Vec<String>,
        /// Upper triangle, row by row.
        upper: Vec<f64>,
    }

    /// Another minimum that the data cannot rule out.
    struct Alternative {
        /// In pixels.
        focal_px: f64,
        /// Horizontal field of view, in degrees.
        hfov_deg: f64,
        /// In degrees.
        pitch_deg: f64,
        /// In degrees.
        roll_deg: f64,
        /// Its sum of squared residuals over their variances.
        chi2: f64,
    }
}

/// How a solution came about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The joint fit in pixels.
    MaximumLikelihood,
    /// The paper's criterion.
    Paper,
    /// Imported or typed.
    Given,
    /// Of a period that has ended: as it was found, together with what its camera shared with others then.
    Kept,
}

impl Method {
    /// Whether it was entered, or is kept: solving does not find it again.
    #[must_use]
    pub const fn is_entered(self) -> bool {
        matches!(self, Self::Given | Self::Kept)
    }
}

/// How far a solution got.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// Only the distortion.
    Lens,
    /// Roll, pitch and focal: stage 1.
    Partial,
    /// Position and yaw, too: stage 2.
    Placed,
    /// Improved together with other cameras.
    Refined,
}

impl DistortionEntry {
    /// The field of a coefficient.
    #[must_use]
    pub const fn coefficient(&self, which: Coefficient) -> Option<f64> {
        match which {
            Coefficient::K1 => self.k1,
            Coefficient::K2 => self.k2,
            Coefficient::K3 => self.k3,
            Coefficient::K4 => self.k4,
            Coefficient::P1 => self.p1,
            Coefficient::P2 => self.p2,
            Coefficient::Lambda => self.lambda,
            Coefficient::Xi => self.xi,
            Coefficient::Alpha => self.alpha,
        }
    }

    /// The field of a coefficient, to be changed.
    pub const fn coefficient_mut(&mut self, which: Coefficient) -> &mut Option<f64> {
        match which {
            Coefficient::K1 => &mut self.k1,
            Coefficient::K2 => &mut self.k2,
            Coefficient::K3 => &mut self.k3,
            Coefficient::K4 => &mut self.k4,
            Coefficient::P1 => &mut self.p1,
            Coefficient::P2 => &mut self.p2,
            Coefficient::Lambda => &mut self.lambda,
            Coefficient::Xi => &mut self.xi,
            Coefficient::Alpha => &mut self.alpha,
        }
    }
}

impl Solution {
    /// A solution that says nothing but its focal, in pixels, and its principal point.
    #[must_use]
    pub const fn new(method: Method, stage: Stage, focal_px: f64, principal_point_px: Pixel) -> Self {
        Self {
            method,
            stage,
            position_m: None,
            yaw_deg: None,
            pitch_deg: None,
            roll_deg: None,
            focal_px,
            principal_point_px,
            image_circle_px: None,
            distortion: None,
            sigma: None,
            covariance: None,
            sigma_px: None,
            rms_px: None,
            chi2: None,
            dof: None,
            efov_m: Vec::new(),
            residuals: Vec::new(),
            alternatives: Vec::new(),
            warnings: Vec::new(),
            draw_next: None,
        }
    }

    /// Whether one of its warnings has this code.
    #[must_use]
    pub fn warns_of(&self, code: Code) -> bool {
        self.warnings.iter().any(|warning| warning.code == code)
    }
}

impl fmt::Display for FailureEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.message, self.advice)
    }
}

impl std::error::Error for FailureEntry {}
