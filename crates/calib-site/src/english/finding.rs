//! A finding in words: what is so, and what the operator can do about it. A new finding has its two arms here.
//!
//! Why there is no result.

use calib_core::outcome::{Drawing, Failure, Finding, Parameter, Suggestion, WhyUnused};

use crate::document::Site;
use crate::english::phrase::what_to_draw;
use crate::english::phrase::{
    English, Names, bent, corners, efov, estimator, evidence, few_residuals, field, floor, from_prior,
    joint_misfit, open_focal, other_minima, scale_assumed, scale_conflict, unchecked,
};
use crate::solution::{FailureEntry, Warning};

impl Site {
    /// A finding as a message and an advice: about the result of a camera, or about the site as a whole.
    #[must_use]
    pub fn in_english(&self, camera: Option<usize>, finding: &Finding, names: Names) -> Warning {
        let entry = camera.and_then(|index| self.cameras.get(index));
        let message = English { site: self, entry, names }.message(finding);
        Warning { code: finding.code(), message, advice: advice(finding) }
    }
}

impl English<'_> {
    fn message(&self, finding: &Finding) -> String {
        use Finding as F;
        match finding {
            F::FocalUnobservable { sigma, looks_down, good_floor, .. } => {
                open_focal(*sigma, good_floor.filter(|_| *looks_down))
            }
            F::PriorDominates { focal, sigma } => from_prior(*focal, *sigma),
            F::TwoSolutions { others, .. } => other_minima(others),
            F::Weak { floor_length_rel, .. } | F::Unusable { floor_length_rel, .. } => {
                floor(*floor_length_rel)
            }
            F::Unchecked { dof, rejected, .. } => unchecked(*dof, *rejected),
            F::FewResiduals { dof, factor } => few_residuals(*dof, *factor),
            F::UncertaintyUnknown => "How well the camera is known, nothing tells: nothing is drawn, or what is drawn contradicts itself.".into(),
            F::OutOfDate { what, stored, now } => self.out_of_date(*what, *stored, *now),
            F::PointsOutside { .. } => self.points_outside(finding),
            F::BelowFloor { height } => format!("The camera stands {:.2} m below the floor.", -height),
            F::NoFloor => "The camera sees no floor where its field of view is.".into(),
            F::LineOutlier { line, px } => self.line_outlier(*line, *px),
            F::Misfit { chi2, dof, worst } => self.misfit(*chi2, *dof, *worst),
            F::HeightsApart { lowest, highest } => self.heights_apart(*lowest, *highest),
            F::JointMisfit { chi2, dof } => joint_misfit(*chi2, *dof),
            F::BentEdges { px, px_without_lens } => bent(*px, *px_without_lens),
            F::BentOneWay { px } => bent_one_way(*px),
            F::UninformativeEdges { edges, drawn, bend_px } => self.says_little(edges, *drawn, *bend_px),
            F::UncertainCorners { px, is_round, .. } => corners(*px, *is_round),
            F::UnusedEdges { first, count, is_undistorted, px } => {
                self.unused_edges(*first, *count, *is_undistorted, *px)
            }
            F::UnusedKind { annotation, by } => format!("{} {}.", estimator(*by), self.label(*annotation)),
            F::TooFewSegments { annotation, by, drawn, least } => {
                self.too_few(*annotation, *by, [*drawn, *least])
            }
            F::UnusedPrior { parameter } => unused_prior(field(*parameter)),
            F::OutsideLens { line } => {
                format!("{} has a point where the lens shows nothing.", self.line_of(*line))
            }
            F::NoLength { line } => format!("{} has no length.", self.line_of(*line)),
            F::TooFewControlPoints { count } => format!("{count} control point(s) do not place the camera."),
            F::HiddenControlPoints { points } => self.hidden(points),
            F::FarControlPoints { rms_px, worst, worst_px } => self.far(*rms_px, *worst, *worst_px),
            F::ScaleAssumed { height } => scale_assumed(*height),
            F::PlacedByHand => "A hand says where the camera stands, and nothing tells how well.".into(),
            F::ScaleConflict { estimated, placed } => scale_conflict(*estimated, *placed),
            F::EfovAboveHorizon { is_whole } => efov(*is_whole).into(),
            F::DistortionNotInvertible => {
                "The distortion folds back on itself inside the image: a corner shows no ray.".into()
            }
            F::ControlPointOutlier { camera, point } => self.control_point_outlier(*camera, *point),
            F::ElementOutlier { element, worst } => self.element_outlier(*element, *worst),
            F::DistanceOutlier { distance } => self.distance_outlier(*distance),
            F::NotConnected { cameras, why } => self.not_connected(cameras, *why),
            F::Sliding { camera } => format!("The links of {} leave open where it stands.", self.id(*camera)),
            F::ScaleUnknown { cameras, root } => self.scale_unknown(cameras, *root),
            F::TooManyCameras { count, first } => self.too_many(*count, *first),
            F::Unused { what, why } => self.unused(what, *why),
            F::UnusedEvidence { evidence: shared, count } => {
                format!("{count} {} are not used: every camera is solved by itself.", evidence(*shared))
            }
        }
    }
}

/// What the operator can do about a finding.
fn advice(finding: &Finding) -> String {
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
        F::Weak { scale_rel: Some(scale), next, .. } | F::Unusable { scale_rel: Some(scale), next, .. }
            if next.is_none_or(|next| next.drawing == Drawing::KnownSize) =>
        {
            measure_one(*scale)
        }
        F::Weak { .. } | F::Unusable { .. } | F::Unchecked { .. } => next(),
        F::HeightsApart { .. } => HEIGHTS_APART.into(),
        F::Unused { why, .. } => advice_on_unused(*why).into(),
        F::PointsOutside { fits_exchanged, is_other_image, .. } => {
            advice_on_points(*fits_exchanged, *is_other_image).into()
        }
        _ => fixed_advice(finding).into(),
    }
}

const HEIGHTS_APART: &str = "Check the heights, feet and heads of both: they must stand on the floor. Switch one off to see what the others give.";

const FLOOR_OR_UPRIGHT: &str =
    "Check that floor lines and verticals were not exchanged; draw the field of view on the floor.";

const TIE_OR_HOLD: &str =
    "Give two control points, or links with a camera that has some, and refine; or hold what is measured.";

const ANOTHER_EDGE: &str =
    "If it is the lens, draw a straight edge of another direction with three points and more.";

const GIVE_A_SCALE: &str = "Enter one known distance, height or length, or two points of the plan.";

fn unused_prior(field: &str) -> String {
    format!("The paper's method does not use the prior {field}.")
}

fn bent_one_way(px: f64) -> String {
    format!(
        "The lines of one direction are bent, {px:.1} px rms: by the lens, because what they follow curves, or a point is off."
    )
}

/// What tells the corners of an image, or the rim of a round one.
const fn farther_edges(is_round: bool, is_reached: bool) -> &'static str {
    match (is_round, is_reached) {
        (true, true) => {
            "Edges reach the rim already: draw verticals and floor lines, or link points with another camera."
        }
        (true, false) => "Draw straight edges that reach out to the rim.",
        (false, _) => "Draw straight edges that reach into the corners.",
    }
}

/// Advice that is the same whatever the numbers.
const fn fixed_advice(finding: &Finding) -> &'static str {
    use Finding as F;
    match finding {
        F::PriorDominates { .. } => "Enter the focal if you know it, or draw what tells it.",
        F::NoFloor => FLOOR_OR_UPRIGHT,
        F::FewResiduals { .. } => "Draw more lines: each makes the noise better known.",
        F::UncertaintyUnknown => {
            "Mend the lines that do not fit, if there are such; else draw lines on its image, or import it with standard \
             deviations (\"sigma\" in the solution)."
        }
        F::OutOfDate { .. } => "Solve the site again: calib solve, or Solve in the app.",
        F::BelowFloor { .. } => "Check its height, and that up is z in what it came from.",
        F::LineOutlier { .. } => "Draw it again, delete it, or use it anyway (\"keep\") if it is right.",
        F::Misfit { .. } => {
            "Look at the largest residuals: a line off its edge, a direction that is not parallel, or a bent lens."
        }
        F::JointMisfit { .. } => "Look for the largest residuals among links, marks and control points.",
        F::BentEdges { .. } => "Look for a point off its edge, then for an edge that is bent in space.",
        F::BentOneWay { .. } => ANOTHER_EDGE,
        F::UninformativeEdges { .. } => "Draw long edges far from the image centre that do not point at it.",
        F::UncertainCorners { is_round, is_reached, .. } => farther_edges(*is_round, *is_reached),
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
        F::EfovAboveHorizon { .. } => "Draw the far edge of the EFOV lower, where the floor can be told.",
        F::DistortionNotInvertible => "Draw straight edges nearer to the corners, or fit fewer coefficients.",
        F::ControlPointOutlier { .. } => {
            "Check its coordinates and its pixel, or use it anyway (\"keep\") if it is right."
        }
        F::ElementOutlier { .. } => {
            "Check that every camera shows the same thing there, or use it anyway (\"keep\") if it is right."
        }
        F::DistanceOutlier { .. } => "Check the length and its unit.",
        F::NotConnected { .. } => "Link two points with a camera that is tied, or give control points.",
        F::Sliding { .. } => "Link points far apart from each other.",
        F::ScaleAssumed { .. } | F::ScaleUnknown { .. } => GIVE_A_SCALE,
        F::PlacedByHand => TIE_OR_HOLD,
        F::TooManyCameras { .. } => "Let every link and mark be seen by fewer cameras.",
        F::UnusedEvidence { .. } => "Let the cameras be refined together, by the maximum-likelihood method.",
        F::FocalUnobservable { .. }
        | F::TwoSolutions { .. }
        | F::Weak { .. }
        | F::Unusable { .. }
        | F::Unchecked { .. }
        | F::HeightsApart { .. }
        | F::PointsOutside { .. }
        | F::Unused { .. } => "",
    }
}

const fn advice_on_points(fits_exchanged: bool, is_other_image: bool) -> &'static str {
    match (fits_exchanged, is_other_image) {
        (true, _) => {
            "Check whether u and v are swapped in what is drawn, or width and height in size_px: an image of NumPy has \
             the shape (height, width), and is read at [v, u]."
        }
        (false, true) => {
            "Check that size_px is the size of the image that it was drawn on: a still, or a stream of another size."
        }
        (false, false) => "Check these points; a line may be drawn a little beyond the border.",
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

fn measure_one(scale: f64) -> String {
    format!(
        "The shape of the floor is good; what limits it is the scale: a size or height is known to \u{b1} {:.1} % only. Measure one, the longer the better, and enter its length with the uncertainty of the measurement.",
        100.0 * scale
    )
}

fn next(suggestion: Option<Suggestion>) -> String {
    suggestion.map_or_else(
        || "Draw lines elsewhere and in other directions.".into(),
        |suggestion| what_to_draw(&suggestion),
    )
}

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
