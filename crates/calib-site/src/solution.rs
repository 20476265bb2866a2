//! Results of solving a camera, as stored in the site file.

use std::fmt;

use serde::{Deserialize, Serialize};

use calib_core::camera::{Coefficient, DistortionModel, FloorPoint, ImageCircle, Pixel, WorldPoint};
use calib_core::outcome::{Code, FailureCode, Residual, SuggestedAnnotation};
use calib_core::single::Kind;

use crate::pixel_aspect::{is_square, square};

/// Declares structs of the document. Unknown fields are errors, and absent optional fields are not written.
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
    /// Lens distortion: a model with its coefficients, or the coefficients to fit.
    struct DistortionEntry {
        /// Distortion model, which defines the meaning of the coefficients.
        model: DistortionModel,
        /// Coefficient k1 of Brown-Conrady, Kannala-Brandt, the rational or the unified model.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        k1: Option<f64>,
        /// Coefficient k2 of Brown-Conrady, Kannala-Brandt, the rational or the unified model.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        k2: Option<f64>,
        /// Coefficient k3 of Brown-Conrady, Kannala-Brandt or the rational model.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        k3: Option<f64>,
        /// Coefficient k4 of Kannala-Brandt or the rational model.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        k4: Option<f64>,
        /// Coefficient k5 of the rational model.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        k5: Option<f64>,
        /// Coefficient k6 of the rational model.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        k6: Option<f64>,
        /// Coefficient p1 of Brown-Conrady, the rational or the unified model.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        p1: Option<f64>,
        /// Coefficient p2 of Brown-Conrady, the rational or the unified model.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        p2: Option<f64>,
        /// Thin-prism coefficient s1 of the rational model.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        s1: Option<f64>,
        /// Thin-prism coefficient s2 of the rational model.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        s2: Option<f64>,
        /// Thin-prism coefficient s3 of the rational model.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        s3: Option<f64>,
        /// Thin-prism coefficient s4 of the rational model.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        s4: Option<f64>,
        /// Coefficient lambda of the division model.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        lambda: Option<f64>,
        /// Coefficient xi of the unified or the double-sphere model.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        xi: Option<f64>,
        /// Coefficient alpha of the double-sphere model or of `eucm`.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        alpha: Option<f64>,
        /// Coefficient beta of `eucm`.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        beta: Option<f64>,
        /// Focal length to which the coefficients refer, in pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        focal_px: Option<f64>,
        /// Names of the coefficients to fit.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        fit: Option<Vec<Coefficient>>,
    }

    /// Result of solving a camera.
    struct Solution {
        /// Method that computed the result.
        method: Method,
        /// Last completed stage of the calibration.
        stage: Stage,
        /// Position x0, y0, z0 of the camera, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        position_m: Option<WorldPoint>,
        /// Yaw, in degrees, counter-clockwise seen from above. With yaw 0 the camera looks along +y.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        yaw_deg: Option<f64>,
        /// Pitch, in degrees, positive downwards.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pitch_deg: Option<f64>,
        /// Roll, in degrees; positive if the camera is rotated clockwise, seen from behind.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        roll_deg: Option<f64>,
        /// Focal length, in pixels.
        focal_px: f64,
        /// Principal point, in raw pixels.
        principal_point_px: Pixel,
        /// Pixel aspect `fy / fx`: width over height of a pixel. `focal_px` is fx.
        #[serde(default = "square", skip_serializing_if = "is_square")]
        pixel_aspect: f64,
        /// Image circle of a fisheye, in pixels: centre and radius. Pixels outside it are not mapped.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        image_circle_px: Option<ImageCircle>,
        /// Distortion coefficients. They refer to `focal_px` of the solution, unless the distortion has its
        /// own `focal_px`.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        distortion: Option<DistortionEntry>,
        /// Standard deviations of the estimated parameters.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma: Option<Sigmas>,
        /// Covariance of the estimated parameters.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        covariance: Option<CovarianceEntry>,
        /// Standard deviation of an annotated coordinate on which `sigma` and `covariance` are based, in
        /// pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma_px: Option<f64>,
        /// Root mean square of the residuals, in pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        rms_px: Option<f64>,
        /// Chi-square: sum of the squared residuals divided by their variances.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        chi2: Option<f64>,
        /// Degrees of freedom: number of residuals minus number of unknowns.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        dof: Option<usize>,
        /// `false` if lengths on the floor are known, but heights above it are not: the camera looks down, so that
        /// the lines do not determine its focal length. Absent otherwise.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        heights_known: Option<bool>,
        /// Effective field of view (EFOV) projected onto the floor, in metres.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        efov_m: Vec<FloorPoint>,
        /// Residuals of all annotations and control points.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        residuals: Vec<Residual>,
        /// Other solutions that fit the data equally well.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        alternatives: Vec<Alternative>,
        /// Warnings about the result.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        warnings: Vec<Warning>,
        /// Next annotation that would improve the result most.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        draw_next: Option<SuggestionEntry>,
    }

    /// Warning about a result, with advice.
    struct Warning {
        /// Code of the finding.
        code: Code,
        /// Description, as a sentence.
        message: String,
        /// Advice for the operator, as a sentence.
        advice: String,
    }

    /// Reason for a missing result, with advice.
    #[cfg_attr(feature = "schema", schemars(rename = "Failure"))]
    struct FailureEntry {
        /// Code of the failure.
        code: FailureCode,
        /// Description, as a sentence.
        message: String,
        /// Advice for the operator, as a sentence.
        advice: String,
    }

    /// Suggestion for the next annotation.
    struct SuggestionEntry {
        /// Suggested annotation and its approximate position in the image.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        drawing: Option<SuggestedAnnotation>,
        /// Kind of annotation; absent for links.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        kind: Option<Kind>,
        /// Suggestion as a sentence.
        message: String,
        /// Example of the suggested segments: their ends, in raw pixels.
        segments_px: Vec<[Pixel; 2]>,
        /// Predicted relative standard deviation of floor lengths with the suggested annotation.
        floor_length_rel: f64,
        /// Other suggestions, best first.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        otherwise: Vec<SuggestionEntry>,
    }

    /// Standard deviations of the estimated parameters; absent for parameters that were not estimated.
    #[derive(Default)]
    struct Sigmas {
        /// Standard deviation of x0, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        x_m: Option<f64>,
        /// Standard deviation of y0, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        y_m: Option<f64>,
        /// Standard deviation of z0, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        z_m: Option<f64>,
        /// Standard deviation of the yaw, in degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        yaw_deg: Option<f64>,
        /// Standard deviation of the pitch, in degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pitch_deg: Option<f64>,
        /// Standard deviation of the roll, in degrees.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        roll_deg: Option<f64>,
        /// Standard deviation of the focal length, in pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        focal_px: Option<f64>,
        /// Standard deviation of the distortion coefficient k1.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        k1: Option<f64>,
        /// Standard deviation of the distortion coefficient k2.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        k2: Option<f64>,
        /// Standard deviation of the distortion coefficient k3.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        k3: Option<f64>,
        /// Standard deviation of the distortion coefficient k4.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        k4: Option<f64>,
        /// Standard deviation of the distortion coefficient p1.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        p1: Option<f64>,
        /// Standard deviation of the distortion coefficient p2.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        p2: Option<f64>,
        /// Standard deviation of the distortion coefficient lambda.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        lambda: Option<f64>,
        /// Standard deviation of the principal point along u, in pixels.
        #[serde(default, skip_serializing_if = "Option::is_none", alias = "principal_point_u_px")]
        cx_px: Option<f64>,
        /// Standard deviation of the principal point along v, in pixels.
        #[serde(default, skip_serializing_if = "Option::is_none", alias = "principal_point_v_px")]
        cy_px: Option<f64>,
        /// Standard deviation of the pixel aspect.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pixel_aspect: Option<f64>,
        /// Relative standard deviation of floor lengths inside the EFOV.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        floor_length_rel: Option<f64>,
    }

    /// Covariance matrix: parameter names and upper triangle.
    struct CovarianceEntry {
        /// Names of the parameters with their units, as in the solution.
        of: Vec<String>,
        /// Upper triangle of the matrix, row by row, in the units of the parameters.
        upper: Vec<f64>,
    }

    /// Another solution that fits the data equally well.
    struct Alternative {
        /// Focal length, in pixels.
        focal_px: f64,
        /// Horizontal field of view, in degrees.
        hfov_deg: f64,
        /// Pitch, in degrees, positive downwards.
        pitch_deg: f64,
        /// Roll, in degrees; positive if the camera is rotated clockwise, seen from behind.
        roll_deg: f64,
        /// Chi-square of this solution: sum of the squared residuals divided by their variances.
        chi2: f64,
    }
}

/// Method that produced a solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Maximum-likelihood fit of all annotations, with residuals in pixels.
    MaximumLikelihood,
    /// Criterion of the paper on two-stage calibration that this project extends, for roll, pitch and focal length.
    Paper,
    /// Imported or entered calibration, not computed from annotations.
    Given,
    /// Solution of a validity period that has ended. It is not recomputed, because links and marks refer to
    /// the newest period of the camera.
    Kept,
}

impl Method {
    /// Whether the solution was entered or is kept, so that solving does not recompute it.
    #[must_use]
    pub const fn is_entered(self) -> bool {
        matches!(self, Self::Given | Self::Kept)
    }
}

/// Last completed stage of a solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// Lens only: the distortion is known, but not the orientation.
    Lens,
    /// Stage 1: roll, pitch and focal length.
    Partial,
    /// Stage 2: position, yaw and height in addition.
    Placed,
    /// Joint refinement with other cameras.
    Refined,
}

impl DistortionEntry {
    /// Returns the value of a distortion coefficient; `None` if it is not entered.
    #[must_use]
    pub const fn coefficient(&self, which: Coefficient) -> Option<f64> {
        match which {
            Coefficient::K1 => self.k1,
            Coefficient::K2 => self.k2,
            Coefficient::K3 => self.k3,
            Coefficient::K4 => self.k4,
            Coefficient::K5 => self.k5,
            Coefficient::K6 => self.k6,
            Coefficient::S1 => self.s1,
            Coefficient::S2 => self.s2,
            Coefficient::S3 => self.s3,
            Coefficient::S4 => self.s4,
            Coefficient::P1 => self.p1,
            Coefficient::P2 => self.p2,
            Coefficient::Lambda => self.lambda,
            Coefficient::Xi => self.xi,
            Coefficient::Alpha => self.alpha,
            Coefficient::Beta => self.beta,
        }
    }

    /// Returns a mutable reference to the value of a coefficient.
    pub const fn coefficient_mut(&mut self, which: Coefficient) -> &mut Option<f64> {
        match which {
            Coefficient::K1 => &mut self.k1,
            Coefficient::K2 => &mut self.k2,
            Coefficient::K3 => &mut self.k3,
            Coefficient::K4 => &mut self.k4,
            Coefficient::K5 => &mut self.k5,
            Coefficient::K6 => &mut self.k6,
            Coefficient::S1 => &mut self.s1,
            Coefficient::S2 => &mut self.s2,
            Coefficient::S3 => &mut self.s3,
            Coefficient::S4 => &mut self.s4,
            Coefficient::P1 => &mut self.p1,
            Coefficient::P2 => &mut self.p2,
            Coefficient::Lambda => &mut self.lambda,
            Coefficient::Xi => &mut self.xi,
            Coefficient::Alpha => &mut self.alpha,
            Coefficient::Beta => &mut self.beta,
        }
    }
}

impl Solution {
    /// Creates a solution with only a focal length, in pixels, and a principal point.
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
            pixel_aspect: 1.0,
            image_circle_px: None,
            distortion: None,
            sigma: None,
            covariance: None,
            sigma_px: None,
            rms_px: None,
            chi2: None,
            dof: None,
            heights_known: None,
            efov_m: Vec::new(),
            residuals: Vec::new(),
            alternatives: Vec::new(),
            warnings: Vec::new(),
            draw_next: None,
        }
    }

    /// Whether one of the warnings of the solution has this code.
    #[must_use]
    pub fn has_warning(&self, code: Code) -> bool {
        self.warnings.iter().any(|warning| warning.code == code)
    }
}

impl fmt::Display for FailureEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.message, self.advice)
    }
}

impl std::error::Error for FailureEntry {}
