//! How a solve ended: residuals, warnings as a closed list, failures.

use std::fmt;

/// Declares a closed list of codes that read and write in kebab case.
macro_rules! codes {
    ($(#[$doc:meta])* $name:ident { $($(#[$code_doc:meta])* $code:ident = $text:literal),+ $(,)? }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
        #[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
        pub enum $name {
            $($(#[$code_doc])* #[cfg_attr(feature = "serde", serde(rename = $text))] $code),+
        }

        impl $name {
            /// Every code of the list.
            pub const ALL: &'static [Self] = &[$(Self::$code),+];

            /// The code as files and programs know it.
            #[must_use]
            pub const fn as_str(self) -> &'static str {
                match self { $(Self::$code => $text),+ }
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(self.as_str())
            }
        }
    };
}

codes! {
    /// What an operator should know about a result that exists.
    Code {
        /// The predicted standard deviation of the focal, before the weak prior, is over 20 %.
        FocalUnobservable = "focal-unobservable",
        /// A second minimum has a chi-square within 6 of the best.
        TwoSolutions = "two-solutions",
        /// The predicted relative error of floor lengths is over 3 %.
        Weak = "weak",
        /// The predicted relative error of floor lengths is over 10 %.
        Unusable = "unusable",
        /// One annotation contradicts the others and was rejected.
        Outlier = "outlier",
        /// The annotations contradict each other and none of them explains it.
        Misfit = "misfit",
        /// The weak prior on the focal lowers its standard deviation by more than half.
        PriorDominates = "prior-dominates",
        /// The method does not use this annotation, control point, link or mark.
        UnusedAnnotation = "unused-annotation",
        /// A part of the EFOV lies on or above the horizon.
        EfovAboveHorizon = "efov-above-horizon",
        /// A polyline says next to nothing about distortion.
        UninformativePolyline = "uninformative-polyline",
        /// The distortion folds back on itself inside the image.
        DistortionNotInvertible = "distortion-not-invertible",
        /// Nothing gives the scale of the site.
        ScaleUnknown = "scale-unknown",
        /// Placement and a height, length or upright disagree beyond 3 sigma.
        ScaleConflict = "scale-conflict",
        /// Nothing ties the camera to the rest of the site.
        NotConnected = "not-connected",
    }
}

codes! {
    /// Why a camera has no result.
    FailureCode {
        /// Fewer lines than the method needs.
        TooFewLines = "too-few-lines",
        /// The lines leave more than one unknown open.
        Underdetermined = "underdetermined",
        /// No minimum with possible geometry was found.
        NoSolution = "no-solution",
        /// A value the method needs is missing or contradicts another.
        MissingValue = "missing-value",
    }
}

/// A remark on a result, with what to do about it.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Warning {
    /// Which remark.
    pub code: Code,
    /// What is so, in a sentence.
    pub message: String,
    /// What the operator can do, in a sentence.
    pub advice: String,
}

impl Warning {
    pub(crate) fn new(code: Code, message: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { code, message: message.into(), advice: advice.into() }
    }
}

/// Why there is no result, with what to do about it.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Failure {
    /// Which reason.
    pub code: FailureCode,
    /// What is so, in a sentence.
    pub message: String,
    /// What the operator can do, in a sentence.
    pub advice: String,
}

impl Failure {
    pub(crate) fn new(code: FailureCode, message: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { code, message: message.into(), advice: advice.into() }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.message, self.advice)
    }
}

impl std::error::Error for Failure {}

/// What a residual belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum ResidualOf {
    /// A drawn annotation.
    Annotation,
    /// A point with known coordinates.
    ControlPoint,
    /// Evidence shared by cameras.
    Link,
    /// A virtual element tied to a pixel.
    Mark,
}

/// How far one piece of evidence is from what the result predicts.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Residual {
    /// What it belongs to.
    pub of: ResidualOf,
    /// Index of the annotation in its camera.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub annotation: Option<usize>,
    /// Index of the segment in its annotation.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub segment: Option<usize>,
    /// Id of a control point, link or mark.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub id: Option<String>,
    /// Distance from the prediction, in pixels; of lines and lengths with a sign for the side.
    pub px: f64,
    /// Whether it was rejected.
    pub outlier: bool,
}
