//! What the operator can do about a finding.

use crate::outcome::{Finding, Suggestion, WhyUnused};
use crate::site::english::suggestion::what_to_draw;

/// What the operator can do about a finding.
pub(crate) fn advice(finding: &Finding) -> String {
    use Finding as F;
    let next = || next(finding.suggestion());
    match finding {
        F::FocalUnobservable { looks_down: true, .. } => {
            format!("Enter the focal if heights matter, or draw verticals. {}", next())
        }
        F::FocalUnobservable { .. } => format!(
            "Draw floor lines that run away from the camera, or a right angle at about 45 degrees to the view, or enter the focal. {}",
            next()
        ),
        F::TwoSolutions { .. } => format!("One more line decides. {}", next()),
        F::Weak { .. } | F::Unusable { .. } => next(),
        F::Unused { why, .. } => advice_on_unused(*why).into(),
        _ => fixed_advice(finding).into(),
    }
}

/// Advice that is the same whatever the numbers.
const fn fixed_advice(finding: &Finding) -> &'static str {
    use Finding as F;
    match finding {
        F::PriorDominates { .. } => "Enter the focal if you know it, or draw what tells it.",
        F::NoFloor => {
            "Check that floor lines and verticals were not exchanged; draw the field of view on the floor."
        }
        F::LineOutlier { .. } => "Draw it again, delete it, or mark it \"keep\" if it is right.",
        F::Misfit { .. } => {
            "Look at the largest residuals: a line off its edge, a direction that is not parallel, or a bent lens."
        }
        F::JointMisfit { .. } => "Look for the largest residuals among links, marks and control points.",
        F::BentEdges { .. } => "Look for an edge that is not straight in space, or fit another model.",
        F::UninformativeEdges { .. } => "Draw long edges far from the image centre that do not point at it.",
        F::UncertainCorners { .. } => "Draw straight edges that reach into the corners.",
        F::UnusedEdges { .. } => "Take the coefficients out of lens.distortion to have them fitted.",
        F::UnusedKind { .. } => "Switch it off, or use a method that does.",
        F::TooFewSegments { .. } => "Draw the missing segments.",
        F::UnusedPrior { .. } => "Hold it with \"fixed\": true, or use --method ml.",
        F::OutsideLens { .. } => "Move the point inward, or correct the distortion.",
        F::NoLength { .. } => "Draw it again, or delete it.",
        F::TooFewControlPoints { .. } => {
            "Two points far apart inside the lens are needed, and more make it sure."
        }
        F::HiddenControlPoints { .. } => "Check their coordinates and pixels.",
        F::FarControlPoints { .. } => {
            "Check the worst one's coordinates and pixel, or switch it off and look again."
        }
        F::ScaleConflict { .. } => {
            "Check the scale of the plan, the heights and lengths, and the size of the EFOV polygon."
        }
        F::EfovAboveHorizon { .. } => {
            "Draw the far edge of the EFOV lower, where the floor can still be told."
        }
        F::DistortionNotInvertible => "Draw straight edges nearer to the corners, or fit fewer coefficients.",
        F::ControlPointOutlier { .. } => {
            "Check its coordinates and its pixel; \"keep\" has it used all the same."
        }
        F::ElementOutlier { .. } => {
            "Check that every camera shows the same thing there; \"keep\" has it used all the same."
        }
        F::DistanceOutlier { .. } => "Check the length and its unit.",
        F::NotConnected { .. } => {
            "Link two points or more with a camera that is tied, or give control points."
        }
        F::Sliding { .. } => "Link points far apart from each other.",
        F::ScaleUnknown { .. } => "Enter one known distance, height or length, or two points of the plan.",
        F::TooManyCameras { .. } => "Let every link and mark be seen by fewer cameras.",
        F::UnusedTies { .. } => "Let the cameras be refined together, by the maximum-likelihood method.",
        F::FocalUnobservable { .. }
        | F::TwoSolutions { .. }
        | F::Weak { .. }
        | F::Unusable { .. }
        | F::Unused { .. } => "",
    }
}

const fn advice_on_unused(why: WhyUnused) -> &'static str {
    match why {
        WhyUnused::OutOfSight => {
            "Check that it is drawn below the horizon, inside the lens, and on the same thing in every view."
        }
        WhyUnused::SeenOnce => "Draw it in a second camera, or give it a distance to something else.",
        WhyUnused::Unmeasured => "Measure between links or marks that cameras show, and say how well.",
        WhyUnused::Unfitted => "Switch links and marks off one by one, the farthest first.",
    }
}

fn next(suggestion: Option<Suggestion>) -> String {
    suggestion.map_or_else(
        || "Draw lines elsewhere and in other directions.".into(),
        |suggestion| what_to_draw(&suggestion),
    )
}
