//! Why there is no result, as values.

use std::fmt;

use crate::outcome::code::codes;
use crate::outcome::subject::Parameter;

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

/// Why a camera has no result.
#[derive(Clone, Debug, PartialEq)]
pub enum Failure {
    /// The paper's method needs two vertical lines for the roll.
    TooFewVerticals {
        /// How many there are.
        count: usize,
    },
    /// The vertical lines do not meet in one point.
    CoincidentVerticals,
    /// Nothing on the floor tells pitch and focal apart.
    NothingOnTheFloor,
    /// Nothing is drawn that tells how the camera is turned.
    NothingDrawn,
    /// No pitch and focal put the lines on a floor.
    NoPitchAndFocal,
    /// No roll, pitch and focal put the lines on a floor.
    NoOrientation,
    /// The lines leave an unknown open.
    Underdetermined {
        /// The one that is known worst, if one stands out.
        weakest: Option<Parameter>,
    },
    /// The camera whose lens this one shares has no result.
    NoLens {
        /// The id of that camera.
        camera: String,
        /// Why it has none.
        because: Box<Self>,
    },
    /// The numbers drawn and entered lead to others that are none.
    TooExtreme,
}

impl Failure {
    /// Which reason.
    #[must_use]
    pub const fn code(&self) -> FailureCode {
        match self {
            Self::TooFewVerticals { .. }
            | Self::CoincidentVerticals
            | Self::NothingOnTheFloor
            | Self::NothingDrawn => FailureCode::TooFewLines,
            Self::NoPitchAndFocal | Self::NoOrientation | Self::TooExtreme => FailureCode::NoSolution,
            Self::Underdetermined { .. } => FailureCode::Underdetermined,
            Self::NoLens { .. } => FailureCode::MissingValue,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.code().fmt(f)
    }
}

impl std::error::Error for Failure {}
