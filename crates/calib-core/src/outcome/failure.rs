//! Why a camera has no result, as values.

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
    /// No drawing on the floor separates pitch from focal.
    NothingOnTheFloor,
    /// No drawing constrains the orientation.
    NothingDrawn,
    /// No pitch and focal have possible geometry for the lines.
    NoPitchAndFocal,
    /// No roll, pitch and focal have possible geometry for the lines.
    NoOrientation,
    /// The constraints do not determine a parameter.
    Underdetermined {
        /// The one of largest variance, if any is estimated.
        weakest: Option<Parameter>,
    },
    /// The camera whose lens this one shares has no result.
    NoLens {
        /// The id of that camera.
        camera: String,
        /// Why that camera has none.
        because: Box<Self>,
    },
    /// The result is not finite, or beyond the bounds of a document.
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
