//! Reasons why a camera has no result.

use std::fmt;

use crate::outcome::code::codes;
use crate::outcome::subject::Parameter;

codes! {
    /// Code of the reason why a camera has no result.
    FailureCode {
        /// There are fewer lines than the method needs.
        TooFewLines = "too-few-lines",
        /// The lines or control points do not determine the pose and the focal length.
        Underdetermined = "underdetermined",
        /// No possible camera fits the lines or control points.
        NoSolution = "no-solution",
        /// A value that the method needs is missing or contradicts another value.
        MissingValue = "missing-value",
        /// The pixels of two control points are exchanged.
        PointsExchanged = "points-exchanged",
        /// The control points fit only the mirror image of the scene.
        Mirrored = "mirrored",
    }
}

/// Reason why a camera has no result.
#[derive(Clone, Debug, PartialEq)]
pub enum Failure {
    /// Fewer than two vertical lines: the paper's method cannot compute the roll.
    TooFewVerticals {
        /// Number of vertical lines.
        count: usize,
    },
    /// The vertical lines coincide, so they have no vanishing point.
    CoincidentVerticals,
    /// No annotation on the floor separates pitch from focal length.
    NoFloorAnnotations,
    /// No annotation constrains the orientation.
    NoAnnotations,
    /// The control points do not determine the pose and the focal length.
    UndeterminedByPoints {
        /// Number of control points that are switched on.
        count: usize,
    },
    /// No pose and focal length fit the control points, even if the pixels of two points are exchanged.
    ContradictoryPoints {
        /// Number of control points that are switched on.
        count: usize,
    },
    /// The control points fit a camera only if the pixels of two of them are exchanged.
    ExchangedControlPoints {
        /// Names of the two control points.
        points: [String; 2],
    },
    /// The control points fit only the mirror image of the scene.
    MirroredControlPoints,
    /// Contradictory evidence leads to a camera that cannot exist.
    ImpossibleCamera {
        /// Focal length, in pixels.
        focal: f64,
        /// Height of the camera above the floor, in metres.
        height: f64,
    },
    /// The lines have no possible geometry at any pitch and focal length.
    NoPitchAndFocal,
    /// The lines have no possible geometry at any roll, pitch and focal length.
    NoOrientation,
    /// The constraints do not determine a parameter.
    Underdetermined {
        /// Parameter with the largest variance, if any parameter is estimated.
        weakest: Option<Parameter>,
    },
    /// The camera that this one shares its lens with has no result.
    SharedLensFailed {
        /// Id of the camera that owns the lens.
        camera: String,
        /// Reason why the camera that owns the lens has no result.
        reason: Box<Self>,
    },
    /// The result is not finite, or exceeds the bounds of the site file.
    TooExtreme,
}

impl Failure {
    /// Returns the code of the reason.
    #[must_use]
    pub const fn code(&self) -> FailureCode {
        match self {
            Self::TooFewVerticals { .. }
            | Self::CoincidentVerticals
            | Self::NoFloorAnnotations
            | Self::NoAnnotations => FailureCode::TooFewLines,
            Self::NoPitchAndFocal
            | Self::NoOrientation
            | Self::TooExtreme
            | Self::ContradictoryPoints { .. }
            | Self::ImpossibleCamera { .. } => FailureCode::NoSolution,
            Self::ExchangedControlPoints { .. } => FailureCode::PointsExchanged,
            Self::MirroredControlPoints => FailureCode::Mirrored,
            Self::Underdetermined { .. } | Self::UndeterminedByPoints { .. } => FailureCode::Underdetermined,
            Self::SharedLensFailed { .. } => FailureCode::MissingValue,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.code().fmt(f)
    }
}

impl std::error::Error for Failure {}
