//! Messages and advice for findings, and for failures (cameras without a result).
//!
//! A new finding needs an arm in `message` and one in `advice`.

use calib_core::camera::Pixel;
use calib_core::outcome::{Failure, Finding, Parameter, SuggestedAnnotation, Suggestion, UnusedReason};

use crate::document::Site;
use crate::english::phrase::suggestion_text;
use crate::english::phrase::{
    Names, SentenceContext, corners, counted, curved, default_focal, efov, estimator, evidence,
    few_residuals, field, floor, joint_misfit, other_minima, unchecked, unchecked_points, undetermined_focal,
};
use crate::solution::{FailureEntry, Warning};

impl Site {
    /// Describes a finding as a message and advice. The camera is an index into `cameras`, or `None` for a
    /// finding about the whole site.
    #[must_use]
    pub fn describe_finding(&self, camera: Option<usize>, finding: &Finding, names: Names) -> Warning {
        let entry = camera.and_then(|index| self.cameras.get(index));
        let message = SentenceContext { site: self, entry, names }.message(finding);
        Warning { code: finding.code(), message, advice: advice(finding) }
    }

    /// Returns the findings of a solved camera that fail `calib check`: the warnings of its solution, and
    /// findings that follow from pose and annotations only. An imported camera has only the latter.
    #[must_use]
    pub fn failing_warnings(&self, index: usize) -> Vec<Warning> {
        let Some((entry, solution)) =
            self.cameras.get(index).and_then(|entry| Some((entry, entry.solution.as_ref()?)))
        else {
            return Vec::new();
        };
        let mut warnings: Vec<Warning> = solution.warnings.clone();
        for finding in entry.pose_findings().into_iter().chain(self.points_outside(entry)) {
            if warnings.iter().all(|warning| warning.code != finding.code()) {
                warnings.push(self.describe_finding(Some(index), &finding, Names::InFile));
            }
        }
        warnings.retain(|warning| warning.code.fails_check());
        warnings
    }
}

/// Message for a camera with an unknown uncertainty.
const UNCERTAINTY_UNKNOWN: &str =
    "The uncertainty of this camera is unknown: it has no annotations, or they contradict each other.";
/// Advice for a camera whose lines also fit a camera rotated by about 180 degrees.
const TURNED_ADVICE: &str = "The same lines fit a camera that is mounted the other way up. Enter the roll, draw a \
                             person or a length on the floor, or draw the field of view on the floor.";
/// Message for an imported camera whose file contains no standard deviations.
const NO_STANDARD_DEVIATIONS: &str =
    "The calibration was imported without standard deviations, so its uncertainty is unknown.";
/// Message for a camera with a placement, but without points and links.
const PLACED_BY_HAND: &str =
    "No point or link confirms the placement of the camera, so the uncertainty of its position is unknown.";
/// Advice for two exchanged control points.
const EXCHANGE: &str = "Swap the pixels or the coordinates of the two points.";
/// Message for a distortion that is not invertible over the image.
const NOT_INVERTIBLE: &str = "The distortion cannot be inverted in a corner of the image.";

impl SentenceContext<'_> {
    /// Returns the description of a finding, as sentences. Every finding has an arm in this function, in
    /// [`Self::shared_message`] or in [`lens`], and one in [`fixed_advice`], [`shared_advice`] or
    /// [`lens_advice`]; `tests.rs` finds empty texts.
    fn message(&self, finding: &Finding) -> String {
        use Finding as F;
        match finding {
            F::FocalUnobservable { sigma, looks_down, good_floor, .. } => {
                undetermined_focal(*sigma, good_floor.filter(|_| *looks_down))
            }
            F::PriorDominates { focal, sigma } => default_focal(*focal, *sigma),
            F::TwoSolutions { others, .. } => other_minima(others),
            F::Weak { floor_length_rel, .. } | F::Unusable { floor_length_rel, .. } => {
                floor(*floor_length_rel)
            }
            F::Unchecked { dof, rejected, .. } => unchecked(*dof, *rejected),
            F::FewResiduals { dof, factor } => few_residuals(*dof, *factor),
            F::UncertaintyUnknown => UNCERTAINTY_UNKNOWN.into(),
            F::NoStandardDeviations => NO_STANDARD_DEVIATIONS.into(),
            F::OutOfDate { subject: what, stored, now } => self.out_of_date(*what, *stored, *now),
            F::PointsOutside { .. } => self.points_outside(finding),
            F::BelowFloor { height } => format!("The camera is {} below the floor.", self.length(-height)),
            F::NoFloor => "No floor is visible in the field of view of the camera.".into(),
            F::LineOutlier { line, px, lengths } => self.line_outlier(*line, *px, *lengths),
            F::Misfit { chi2, dof, worst } => self.misfit(*chi2, *dof, *worst),
            F::ContradictoryUprights { lowest, highest } => self.heights_apart(*lowest, *highest),
            F::JointMisfit { chi2, dof } => joint_misfit(*chi2, *dof),
            F::CurvedEdges { px, px_without_lens } => curved(*px, *px_without_lens),
            F::CurvedInOneDirection { px } => curved_one_way(*px),
            F::UninformativeEdges { edges, total: drawn, sagitta_px: bend_px } => {
                self.uninformative(edges, *drawn, *bend_px)
            }
            F::UncertainCorners { px, is_round, .. } => corners(*px, *is_round),
            F::UnusedEdges { first, count, is_undistorted, px } => {
                self.unused_edges(*first, *count, *is_undistorted, *px)
            }
            F::UnusedKind { annotation, by } => format!("{} {}.", estimator(*by), self.label(*annotation)),
            F::TooFewSegments { annotation, by, count: drawn, required: least } => {
                self.too_few(*annotation, *by, [*drawn, *least])
            }
            F::UnusedPrior { parameter } => unused_prior(field(*parameter)),
            F::OutsideLens { line } => {
                format!("{} has a point outside the field of view of the lens.", self.line_of(*line))
            }
            F::NoLength { line } => format!("{} has zero length.", self.line_of(*line)),
            F::TooFewControlPoints { count } => format!(
                "{} not enough to place the camera.",
                counted(*count, "control point is", "control points are")
            ),
            F::HiddenControlPoints { points } => self.hidden_control_points(points),
            F::FarControlPoints { rms_px, worst, worst_px } => {
                self.far_control_points(*rms_px, *worst, *worst_px)
            }
            F::ScaleAssumed { height } => self.scale_assumed(*height),
            F::PlacedByHand => PLACED_BY_HAND.into(),
            F::ScaleConflict { estimated, placed } => self.scale_conflict(*estimated, *placed),
            F::EfovAboveHorizon { is_whole } => efov(*is_whole).into(),
            F::DistortionNotInvertible => NOT_INVERTIBLE.into(),
            F::UnknownSlope { usual, sloping } => unknown_slope(*usual, *sloping),
            _ => self.shared_message(finding),
        }
    }

    /// Returns the message of a finding about points, evidence that cameras share, or entered lens values.
    fn shared_message(&self, finding: &Finding) -> String {
        use Finding as F;
        match finding {
            F::UncheckedPoints { dof } => unchecked_points(*dof).into(),
            F::ExchangedControlPoints { points } => self.exchanged_control_points(*points),
            F::ControlPointOutlier { camera, point } => self.control_point_outlier(*camera, *point),
            F::FarFromMap { camera, point, distance } => self.far_from_map(*camera, *point, *distance),
            F::LargeSite { camera, distance, drop, .. } => self.large_site(*camera, *distance, *drop),
            F::ElementOutlier { element, worst } => self.element_outlier(*element, *worst),
            F::UncheckedLinks { elements, cameras } => self.unchecked_links(elements, cameras),
            F::DistanceOutlier { distance, lengths } => self.distance_outlier(*distance, *lengths),
            F::NotConnected { cameras, reason: why } => self.not_connected(cameras, *why),
            F::UndeterminedPosition { camera } => {
                format!("The links of {} do not determine its position.", self.id(*camera))
            }
            F::ScaleUnknown { cameras, root } => self.scale_unknown(cameras, *root),
            F::TooManyCameras { count, first } => self.too_many(*count, *first),
            F::Unused { subjects: what, reason: why } => self.unused(what, *why),
            F::UnusedEvidence { evidence: shared, count } => {
                format!("{} not used, because each camera is solved separately.", evidence(*shared, *count))
            }
            _ => lens(finding),
        }
    }
}

/// Returns the advice for a finding, as sentences; empty if none is needed.
fn advice(finding: &Finding) -> String {
    use Finding as F;
    let next = || next(finding.suggestion());
    match finding {
        F::FocalUnobservable { looks_down: true, .. } => {
            format!("Enter the focal length if heights matter, or draw verticals. {}", next())
        }
        F::FocalUnobservable { .. } => format!(
            "Draw floor lines that run away from the camera, or a right angle on the floor with both sides at about \
             45\u{b0} to the view. Or enter the focal length. {}",
            next()
        ),
        F::TwoSolutions { is_turned: true, .. } => TURNED_ADVICE.into(),
        F::TwoSolutions { .. } => {
            format!("Draw one more line to decide between the solutions. {}", next())
        }
        F::Weak { scale_rel: Some(scale), next, .. } | F::Unusable { scale_rel: Some(scale), next, .. }
            if next.is_none_or(|next| next.annotation == SuggestedAnnotation::KnownSize) =>
        {
            measure_length_advice(*scale)
        }
        F::Weak { .. } | F::Unusable { .. } | F::Unchecked { .. } => next(),
        F::ContradictoryUprights { .. } => CHECK_HEIGHTS.into(),
        F::Unused { reason: why, .. } => advice_on_unused(*why).into(),
        F::PointsOutside { fits_exchanged, is_other_image, .. } => {
            advice_on_points(*fits_exchanged, *is_other_image).into()
        }
        _ => fixed_advice(finding).into(),
    }
}

/// Advice for uprights that contradict each other.
const CHECK_HEIGHTS: &str = "Check the height, foot and head of both uprights: each must stand on the floor. To \
                             compare, switch one off and solve again.";

/// Advice for a camera that shows no floor.
const CHECK_FLOOR_LINES: &str =
    "Check that floor lines and verticals are not mixed up, and draw the field of view on the floor.";

/// Advice for a camera that was placed by hand.
const CONNECT_OR_FIX: &str = "Add two control points, or link the camera to another camera with control points, \
                              then refine. If the position was measured, fix the placement.";

/// Advice for lines that are curved in one direction only.
const ANOTHER_EDGE: &str =
    "If the lens is the cause, draw a straight edge in another direction, with three or more points.";

/// Advice for points that contradict each other.
const CHECK_POINTS: &str = "Check the links, marks and control points with the largest residuals. If many residuals are large, the lens may have distortion: draw straight edges.";

/// Advice for an unknown scale.
const ENTER_A_SCALE: &str = "Enter a known distance, height or length, or two control points on the plan.";

/// Returns the message for a prior that the paper's method does not use; `field` is its JSON field.
fn unused_prior(field: &str) -> String {
    format!("The paper's method does not use the prior on {field}.")
}

/// Returns the message for lines that are curved in one direction only; `px` is their RMS deviation.
fn curved_one_way(px: f64) -> String {
    format!(
        "The lines in one direction are curved by {px:.1} px RMS. The cause is the lens, a curved edge, or a misplaced point."
    )
}

/// Returns the advice for uncertain distortion in the corners of an image, or at the rim of a round image.
const fn extend_edges(is_round: bool, is_reached: bool) -> &'static str {
    match (is_round, is_reached) {
        (true, true) => {
            "Edges already reach the rim. Draw verticals and floor lines, or link points to another camera."
        }
        (true, false) => "Draw straight edges that reach the rim.",
        (false, _) => "Draw straight edges that reach the corners.",
    }
}

/// Returns the advice for findings whose advice does not depend on their numbers.
const fn fixed_advice(finding: &Finding) -> &'static str {
    use Finding as F;
    match finding {
        F::PriorDominates { .. } => {
            "Enter the focal length if you know it, or draw lines that determine it, such as a right angle on the floor."
        }
        F::NoFloor => CHECK_FLOOR_LINES,
        F::FewResiduals { .. } => "Draw more lines: each one improves the estimate of the noise.",
        F::UncertaintyUnknown => "Correct the lines that do not fit, or draw lines if the image has none.",
        F::NoStandardDeviations => {
            "If you trust the calibration, pass --allow uncertainty-unknown to calib check. If not, add standard \
             deviations (\"sigma\" in the solution), or draw lines and solve."
        }
        F::OutOfDate { .. } => "Solve the site again: run calib solve, or choose Refine all (F9) in the app.",
        F::BelowFloor { .. } => {
            "Check the height of the camera. In an imported calibration, the z axis must point up."
        }
        F::LineOutlier { .. } => {
            "Redraw or delete the line. If it is correct, choose \"Use anyway\" in the app, or add \"keep\": true to its annotation."
        }
        F::Misfit { .. } => {
            "Check the lines with the largest residuals: a line may be misplaced, not parallel, or curved by distortion."
        }
        F::JointMisfit { .. } => CHECK_POINTS,
        F::CurvedEdges { .. } => {
            "Look for a point that is not on its edge, then for an edge that is not straight in reality."
        }
        F::CurvedInOneDirection { .. } => ANOTHER_EDGE,
        F::UninformativeEdges { .. } => {
            "Draw long edges that are far from the image centre and do not point towards it."
        }
        F::UncertainCorners { is_round, is_reached, .. } => extend_edges(*is_round, *is_reached),
        F::UnusedEdges { .. } => {
            "To estimate the distortion from the edges, remove lens.distortion and lens.like, or choose \"from straight edges\" in the app."
        }
        F::UnusedKind { .. } => "Switch the annotation off, or use a method that supports it.",
        F::TooFewSegments { .. } => "Draw the missing segments.",
        F::UnusedPrior { .. } => "Fix the value with \"fixed\": true, or use --method ml.",
        F::OutsideLens { .. } => "Move the point inwards, or correct the distortion.",
        F::NoLength { .. } => "Redraw or delete the line.",
        F::TooFewControlPoints { .. } => {
            "Add control points. At least two are required, far apart; more points make the result more reliable."
        }
        F::HiddenControlPoints { .. } => "Check the coordinates and pixels of these points.",
        F::FarControlPoints { .. } => {
            "Check the coordinates and the pixel of the worst point, or switch it off and solve again."
        }
        F::UncheckedPoints { .. } => "Click another point, or draw lines.",
        F::UnknownSlope { .. } => {
            "Choose the scene type in the app, or enter floor_tilt_sigma_deg in \"scene\". Or draw a right angle on the ground."
        }
        F::ExchangedControlPoints { .. } => EXCHANGE,
        F::ScaleConflict { .. } => {
            "Check the scale of the plan, the heights and lengths, and the size of the field of view on the plan."
        }
        F::EfovAboveHorizon { .. } => {
            "Move the far edge of the field of view down, onto floor that is clearly visible."
        }
        F::DistortionNotInvertible => "Draw straight edges nearer to the corners, or fit fewer coefficients.",
        _ => shared_advice(finding),
    }
}

/// Returns the advice for findings about the data sheet, the principal point, the resolution and the pixels of a
/// lens; empty for other findings.
const fn lens_advice(finding: &Finding) -> &'static str {
    match finding {
        Finding::WrongPrincipalPoint { is_exchanged: true, .. } => {
            "Swap the coordinates of the principal point: the order is [u, v], from the left and from \
             the top."
        }
        Finding::WrongPrincipalPoint { .. } => {
            "Check lens.principal_point_px: it must be in pixels of this image. Or remove it to have it estimated."
        }
        Finding::OffCentre { .. } => {
            "If the image is not cropped, check the right angles and the verticals. If you know the principal point, enter it."
        }
        Finding::OtherResolution { .. } => {
            "Enter the lens for this resolution: multiply its focal length and principal point by the width of this \
             image divided by the other width."
        }
        Finding::DataSheetConflict { .. } => {
            "Check the focal length and the sensor size, or the field of view. Correct or remove them. They do not \
             apply to an image that is cropped or zoomed."
        }
        Finding::PixelsNotSquare { .. } => ENTER_ASPECT,
        _ => "",
    }
}

/// Returns the message for ground of unknown slope, with the errors of floor lengths on usual and steep ground.
fn unknown_slope(usual: f64, sloping: Option<f64>) -> String {
    let usual = 100.0 * usual;
    let sloping = match sloping {
        Some(sloping) => {
            format!("but only to \u{b1} {:.1} % on ground that rises by 6 %", 100.0 * sloping)
        }
        None => "but their accuracy is unknown on ground that rises by 6 %".into(),
    };
    format!(
        "Floor lengths depend on the slope of the ground. They are accurate to \u{b1} {usual:.1} % on nearly level \
         ground, {sloping}."
    )
}

/// Returns the advice for findings about evidence that cameras share, placements, and entered lens values.
const fn shared_advice(finding: &Finding) -> &'static str {
    use Finding as F;
    match finding {
        F::FarFromMap { .. } => {
            "Check the map coordinates and the pixel of the point, then the scale of the plan."
        }
        F::LargeSite { is_compact: true, .. } => "Move the origin of the site close to its cameras.",
        F::LargeSite { .. } => "Divide the site into smaller sites, each within 5 km of its origin.",
        F::ControlPointOutlier { .. } => {
            "Check the coordinates and the pixel of the point. If both are correct, choose \"Use anyway\" in the app, or add \"keep\": true to the point."
        }
        F::UncheckedLinks { cameras, .. } if cameras.is_empty() => {
            "Click one more point of the link or mark, or draw a line."
        }
        F::UncheckedLinks { .. } => "Add one more link between these cameras, far from the existing links.",
        F::ElementOutlier { .. } => {
            "Check that the pixels are on the same object in every camera. If so, choose \"Use anyway\" in the app, or add \"keep\": true to the link or mark."
        }
        F::DistanceOutlier { .. } => "Check the length and its unit.",
        F::NotConnected { .. } => "Link three points to a connected camera, or add control points.",
        F::UndeterminedPosition { .. } => {
            "Link another point, far from the others, or fix the placement of the camera."
        }
        F::ScaleAssumed { .. } | F::ScaleUnknown { .. } => ENTER_A_SCALE,
        F::PlacedByHand => CONNECT_OR_FIX,
        F::TooManyCameras { .. } => "Use fewer cameras for each link and mark.",
        F::UnusedEvidence { .. } => "Refine the cameras together, with the maximum-likelihood method.",
        _ => lens_advice(finding),
    }
}

/// Returns the advice for annotated points outside the image.
const fn advice_on_points(fits_exchanged: bool, is_other_image: bool) -> &'static str {
    match (fits_exchanged, is_other_image) {
        (true, _) => {
            "Check whether u and v are swapped in the annotations, or width and height in size_px. NumPy images have \
             the shape (height, width) and are indexed by [v, u]."
        }
        (false, true) => {
            "Check that size_px is the size of the annotated image. A stream from the same camera may have a different size."
        }
        (false, false) => "Check these points. A line may extend a little beyond the border.",
    }
}

/// Returns the advice for unused links, marks, distances and cameras.
const fn advice_on_unused(why: UnusedReason) -> &'static str {
    match why {
        UnusedReason::NotVisible => {
            "Check that the pixels are below the horizon, inside the field of view of the lens, and on the \
             same object in every image."
        }
        UnusedReason::SingleView => {
            "Annotate the link or mark in a second camera, or enter its distance from another link or mark."
        }
        UnusedReason::UnknownLengthOrEnd => {
            "Use links or marks that are annotated in images, and enter \"sigma\" or \"fixed\" for the length."
        }
        UnusedReason::NoPoses => "Switch off links and marks one at a time, the farthest first.",
        UnusedReason::NoGeoreference => {
            "Add a second point with map coordinates to a solved camera, or enter \"georeference\"."
        }
    }
}

/// Returns the advice to measure a length; `scale` is the relative uncertainty of the scale.
fn measure_length_advice(scale: f64) -> String {
    format!(
        "The scale limits the accuracy: it comes from a size or height known only to \u{b1} {:.1} %. Measure a length, as long as possible, and enter it with its uncertainty.",
        100.0 * scale
    )
}

/// Describes the suggested annotation. Without a suggestion, returns general advice.
fn next(suggestion: Option<Suggestion>) -> String {
    suggestion.map_or_else(
        || "Draw lines in other parts of the image and in other directions.".into(),
        |suggestion| suggestion_text(&suggestion),
    )
}

impl From<&Failure> for FailureEntry {
    fn from(failure: &Failure) -> Self {
        let [message, advice] = failure_text(failure);
        Self { code: failure.code(), message, advice }
    }
}

/// Returns the message and the advice for a camera without a result.
fn failure_text(failure: &Failure) -> [String; 2] {
    match failure {
        Failure::TooFewVerticals { count: 0 } => [
            "The paper's method needs two verticals to determine the roll.".into(),
            "Draw two verticals, far apart.".into(),
        ],
        Failure::TooFewVerticals { .. } => [
            "The paper's method needs two verticals to determine the roll, but only one can be used.".into(),
            ANOTHER_VERTICAL.into(),
        ],
        Failure::CoincidentVerticals => [
            "The verticals coincide, so they do not intersect in a single point.".into(),
            ANOTHER_VERTICAL.into(),
        ],
        Failure::NoFloorAnnotations => [
            "The annotations on the floor do not determine pitch and focal length.".into(),
            "Draw two parallel floor lines, a right angle, or segments of equal length. Or enter the focal length.".into(),
        ],
        Failure::NoAnnotations => [
            "There are no lines that determine the orientation of the camera.".into(),
            "Draw two verticals and two parallel floor lines that run away from the camera, or click four control points.".into(),
        ],
        Failure::ExchangedControlPoints { .. }
        | Failure::ContradictoryPoints { .. }
        | Failure::MirroredControlPoints
        | Failure::ImpossibleCamera { .. }
        | Failure::UndeterminedByPoints { .. } => points_failure_text(failure),
        Failure::NoPitchAndFocal => {
            ["No combination of pitch and focal length fits these lines.".into(), CHECK_KINDS.into()]
        }
        Failure::NoOrientation => {
            ["No combination of roll, pitch and focal length fits these lines.".into(), CHECK_KINDS.into()]
        }
        Failure::Underdetermined { weakest } => [
            format!("The lines do not determine the {} of the camera.", weakest.map_or("orientation", parameter)),
            "Draw two verticals, one on each side of the image, and two parallel floor lines that run away from the camera.".into(),
        ],
        Failure::SharedLensFailed { camera, reason: because } => [
            format!("This camera uses the lens of camera \"{camera}\", which has no result: {}", failure_text(because)[0]),
            format!("Calibrate camera \"{camera}\" first, or enter a separate lens for this camera."),
        ],
        Failure::TooExtreme => [
            "A drawn or entered value is too extreme for the calculation.".into(),
            "Look for a value that is thousands of times too large or too small.".into(),
        ],
    }
}

/// Returns the message and the advice for a camera whose control points give no result; both are empty for
/// other failures.
fn points_failure_text(failure: &Failure) -> [String; 2] {
    match failure {
        Failure::ExchangedControlPoints { points: [a, b] } => [
            format!("Control points {a} and {b} are swapped: all points fit if you swap the pixels of these two."),
            EXCHANGE.into(),
        ],
        Failure::ContradictoryPoints { count } => [
            format!("The {count} control points contradict each other: no camera shows them at these pixels."),
            "Check the coordinates and pixels of the control points. Switch off one at a time to find a wrong point.".into(),
        ],
        Failure::MirroredControlPoints => [
            "The control points fit no camera, but their mirror image does.".into(),
            "Check the order of the points, the signs of the coordinates, and whether the image is mirrored.".into(),
        ],
        Failure::ImpossibleCamera { focal, height } => [
            format!(
                "The control points and annotations contradict each other: they lead to a focal length of {focal:.0} px and a height of {height:.1} m."
            ),
            "Check the coordinates and pixels of the control points, the known lengths and the units.".into(),
        ],
        Failure::UndeterminedByPoints { count } => [
            format!(
                "{} not determine the camera.",
                counted(*count, "control point alone does", "control points alone do")
            ),
            "Click at least four control points that are not all on one line. Three are enough if the focal length is known.".into(),
        ],
        _ => Default::default(),
    }
}

/// Returns the message of a finding about the data sheet, the principal point, the resolution or the pixels of a
/// lens; empty for other findings.
fn lens(finding: &Finding) -> String {
    let point = |at: &Pixel| format!("({:.0}, {:.0})", at.u, at.v);
    match finding {
        Finding::WrongPrincipalPoint { entered, estimated, is_exchanged } => {
            let cause = if *is_exchanged { " The entered coordinates are probably swapped." } else { "" };
            format!(
                "The entered principal point {} contradicts the lines, which all fit with a principal point at {}.{cause}",
                point(entered),
                point(estimated)
            )
        }
        Finding::OffCentre { estimated, distance } => format!(
            "The principal point {} is {:.0} % of the longer side away from the image centre: the image is probably cropped.",
            point(estimated),
            100.0 * distance
        ),
        Finding::DataSheetConflict { entered, entered_sigma, estimated, sigma } => {
            let spread = entered_sigma.map_or_else(String::new, |sigma| format!(" \u{b1} {sigma:.0}"));
            format!(
                "The data sheet gives a focal length of {entered:.0}{spread} px, but the lines give {estimated:.0} \u{b1} {sigma:.0} px."
            )
        }
        Finding::OtherResolution { entered, size: [w, h] } => format!(
            "The entered principal point {} is the centre of an image of {:.0} x {:.0} pixels, but this image has {w} x {h}. \
             The lens probably belongs to another resolution.",
            point(entered),
            2.0 * entered.u,
            2.0 * entered.v
        ),
        Finding::PixelsNotSquare { size: [w, h], aspect } => format!(
            "Images of {w} x {h} pixels usually have pixels that are not square (aspect {aspect:.3}), and no pixel aspect is entered."
        ),
        _ => String::new(),
    }
}

/// Advice for pixels that are probably not square.
const ENTER_ASPECT: &str = "If round objects look squeezed in the image, enter the aspect from this message as \
                            lens.pixel_aspect. If they look round, enter 1.";
/// Advice for a roll that the verticals do not determine.
const ANOTHER_VERTICAL: &str = "Draw another vertical, far to the side of the first, or fix lens.roll_deg.";
/// Advice for lines that fit no camera.
const CHECK_KINDS: &str =
    "Check that no floor line was drawn as a vertical, and that no length is above the horizon.";

const fn parameter(parameter: Parameter) -> &'static str {
    match parameter {
        Parameter::Roll => "roll",
        Parameter::Pitch => "pitch",
        Parameter::Focal => "focal length",
        Parameter::Height => "height",
    }
}
