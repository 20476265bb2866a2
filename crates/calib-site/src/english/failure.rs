//! Why there is no result.

use crate::solution::FailureEntry;
use calib_core::outcome::{Failure, Parameter};

impl From<&Failure> for FailureEntry {
    fn from(failure: &Failure) -> Self {
        let [message, advice] = why_not(failure);
        Self { code: failure.code(), message, advice }
    }
}

/// Why there is no result, and what the operator can do.
fn why_not(failure: &Failure) -> [String; 2] {
    match failure {
        Failure::TooFewVerticals { count } => [
            format!("The paper's method needs two vertical lines for the roll, and has {count}."),
            ANOTHER_VERTICAL.into(),
        ],
        Failure::CoincidentVerticals => [
            "The vertical lines coincide, so that they do not meet in one point.".into(),
            ANOTHER_VERTICAL.into(),
        ],
        Failure::NothingOnTheFloor => [
            "Nothing on the floor tells pitch and focal apart.".into(),
            "Draw two parallel floor lines, a right angle, or segments of equal length; or enter the focal.".into(),
        ],
        Failure::NothingDrawn => [
            "Nothing is drawn that tells how the camera is turned.".into(),
            "Draw two verticals and two parallel floor lines that run away from the camera.".into(),
        ],
        Failure::NoPitchAndFocal => {
            ["No pitch and focal put these lines on a floor.".into(), EXCHANGED.into()]
        }
        Failure::NoOrientation => {
            ["No roll, pitch and focal put these lines on a floor.".into(), EXCHANGED.into()]
        }
        Failure::Underdetermined { weakest } => [
            format!("The lines leave the {} of the camera open.", weakest.map_or("orientation", parameter)),
            "Draw two verticals, one on each side of the image, and two parallel floor lines that run away from the camera.".into(),
        ],
        Failure::NoLens { camera, because } => [
            format!("The lens is that of camera \"{camera}\", which has no result: {}", why_not(because)[0]),
            format!("Complete camera \"{camera}\" first, or give this camera a lens of its own."),
        ],
        Failure::TooExtreme => [
            "The numbers drawn and entered are too extreme to be calculated with.".into(),
            "Look for a value that is thousands of times too large or too small.".into(),
        ],
    }
}

const ANOTHER_VERTICAL: &str = "Draw another vertical, far to the side of the first, or hold lens.roll_deg.";
const EXCHANGED: &str = "Check that floor lines were not drawn as verticals, and lengths above the horizon.";

const fn parameter(parameter: Parameter) -> &'static str {
    match parameter {
        Parameter::Roll => "roll",
        Parameter::Pitch => "pitch",
        Parameter::Focal => "focal",
        Parameter::Height => "height",
    }
}
