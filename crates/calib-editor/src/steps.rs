//! Work steps of one camera, and the input that is missing in each step.
//!
//! The file also finds the subject of a warning about the whole site, so that the app can navigate to it.

use calib_core::outcome::DisconnectionReason;
use calib_core::single::straightness_rms;
use calib_core::{Code, Finding, Kind, Parameter, Severity, Subject};
use calib_site::{
    ControlPointEntry, Distance, Mark, Names, Report, Site, SiteCamera, Stage, Warning, counted,
};

use crate::session::Session;

/// Returns the camera, link, mark or other subject of a warning about the whole site; `None` if it is not recognised.
/// A joint result contains warnings only as text, which is compared with the texts of all possible findings.
#[must_use]
pub fn site_subject(site: &Site, report: &Report, warning: &Warning) -> Option<Subject> {
    let matches_warning = |finding: &Finding| {
        finding.code() == warning.code && site.describe_finding(None, finding, Names::InFile) == *warning
    };
    // The text about a distance contains measured lengths, so its subject is recognised by the names of its ends.
    let names_ends = |distance: &Distance| {
        warning.code == Code::Outlier
            && distance.between.iter().all(|id| warning.message.contains(&format!("\"{id}\"")))
    };
    let finding = possible_findings(site, report).find(matches_warning);
    finding
        .map(|finding| finding.subject())
        .or_else(|| site.distances.iter().position(names_ends).map(Subject::Distance))
}

/// Returns all findings about the whole site that a report of this site may contain.
fn possible_findings<'a>(site: &'a Site, report: &'a Report) -> impl Iterator<Item = Finding> + 'a {
    let index = |id: &String| site.cameras.iter().position(|camera| camera.id == *id);
    let links = report.links.iter().enumerate().map(|(i, found)| (Subject::Link(i), found));
    let marks = report.marks.iter().enumerate().map(|(i, found)| (Subject::Mark(i), found));
    let elements = links.chain(marks).filter_map(move |(element, found)| {
        let seen = found.as_ref()?.residuals.iter().filter(|seen| seen.outlier);
        let worst = seen.max_by(|a, b| a.px.total_cmp(&b.px))?;
        Some(Finding::ElementOutlier { element, worst: Some((index(&worst.camera)?, worst.px)) })
    });
    let sliding = (0..site.cameras.len()).map(|camera| Finding::UndeterminedPosition { camera });
    let components = report.site.components.iter().map(move |ids| ids.iter().filter_map(index).collect());
    let of_components = components.flat_map(|cameras: Vec<usize>| {
        let why = [
            DisconnectionReason::TooFewLandmarks,
            DisconnectionReason::PlacedByOperator,
            DisconnectionReason::NoLandmarks,
        ];
        let apart = why.map(|why| Finding::NotConnected { cameras: cameras.clone(), reason: why });
        let unscaled = cameras
            .clone()
            .into_iter()
            .map(move |root| Finding::ScaleUnknown { cameras: cameras.clone(), root });
        apart.into_iter().chain(unscaled).collect::<Vec<_>>()
    });
    elements.chain(sliding).chain(of_components)
}

/// Work step of a camera.
#[derive(Clone, Debug)]
pub struct Step {
    /// Name of the step.
    pub title: &'static str,
    /// State of the step as a text: the available or the missing input.
    pub state: String,
    /// Whether the step is done.
    pub is_done: bool,
    /// Whether the step may be skipped.
    pub is_optional: bool,
    /// Whether the step is done but a warning contradicts it.
    pub is_contradicted: bool,
}

/// Title of the step that determines the distortion.
pub(crate) const LENS: &str = "Lens";
/// Title of the step with vertical lines.
pub(crate) const VERTICALS: &str = "Verticals";
/// Title of the step with floor lines.
pub(crate) const FLOOR_LINES: &str = "Floor lines";
/// Title of the step with the field of view.
pub(crate) const FIELD: &str = "Field of view";
/// Title of the step with the placement of the camera.
pub(crate) const PLACE: &str = "Placement";

/// Returns the titles of the steps that a warning with this code contradicts, if the warning is about no
/// particular line. Warnings about missing information contradict no step.
fn steps_of_code(code: Code) -> Vec<&'static str> {
    if matches!(code, Code::Outlier | Code::Misfit) { vec![VERTICALS, FLOOR_LINES] } else { Vec::new() }
}

/// Returns the titles of the steps that the serious warnings of a camera contradict.
fn contradicted_steps(session: &Session, camera: usize) -> Vec<&'static str> {
    let Some((entry, solution)) = session.site.cameras.get(camera).zip(session.solved.solution(camera))
    else {
        return Vec::new();
    };
    let of_annotation = |index: usize| match entry.annotations.get(index).map(|drawn| drawn.kind.row()) {
        Some(row) if row.is_upright() => vec![VERTICALS],
        Some(row) if row.is_level() => vec![FLOOR_LINES],
        _ => vec![LENS],
    };
    let of = |warning: &Warning| match session.solved.finding(&session.site, camera, warning) {
        Some(finding) => match finding.subject() {
            Subject::Line(line) if warning.code == Code::Outlier => of_annotation(line.annotation),
            Subject::Lens => vec![LENS],
            Subject::Placement | Subject::OwnControlPoint(_) | Subject::ControlPoint { .. } => vec![PLACE],
            Subject::Parameter(Parameter::Height) => vec![PLACE],
            Subject::Efov => vec![FIELD],
            _ => steps_of_code(warning.code),
        },
        None => steps_of_code(warning.code),
    };
    solution.warnings.iter().filter(|warning| is_serious(warning.code)).flat_map(of).collect()
}

/// Returns the largest RMS deviation of an annotated edge from a straight line, in pixels. `None` if a lens
/// was fitted to the edges, or if annotation noise explains the deviation.
#[must_use]
pub fn nonstraightness_px(session: &Session, camera: usize) -> Option<f64> {
    /// Largest RMS deviation that annotation noise explains, in standard deviations of an annotated point.
    const MAX_DEVIATION_SIGMAS: f64 = 3.0;
    let entry = session.site.cameras.get(camera)?;
    let lens = &session.solved.pose(camera)?.lens;
    let known = entry.lens.as_ref();
    let is_fitted = known.is_some_and(|lens| {
        lens.like.is_some()
            || lens.distortion.as_ref().is_some_and(|distortion| distortion.distortion().is_none())
    });
    let is_given = known.is_some_and(|lens| lens.distortion.is_some());
    if is_fitted || (!is_given && lens.distortion != calib_core::Distortion::None) {
        return None;
    }
    let edges = entry.annotations.iter().filter(|drawn| !drawn.off && drawn.kind != Kind::Upright);
    let off = edges.flat_map(|drawn| drawn.polylines().filter(|line| line.len() > 2).collect::<Vec<_>>());
    let worst = off.filter_map(|line| straightness_rms(lens, &line)).max_by(f64::total_cmp)?;
    (worst > MAX_DEVIATION_SIGMAS * entry.sigma_px.unwrap_or(1.0)).then_some(worst)
}

/// Returns the number of lines of a kind, and the number of their annotations. Annotations that are switched off
/// are not counted.
fn line_count(session: &Session, camera: usize, kind: Kind) -> (usize, usize) {
    let Some(entry) = session.site.cameras.get(camera) else { return (0, 0) };
    let of_kind = entry.annotations.iter().filter(|a| a.kind == kind && !a.off);
    let (mut lines, mut groups) = (0, 0);
    for annotation in of_kind {
        groups += 1;
        lines += annotation.polylines().count();
    }
    (lines, groups)
}

/// Whether a camera is a fisheye with an unknown lens, for which distortion cannot be neglected.
fn is_fisheye(session: &Session, camera: usize) -> bool {
    let Some(entry) = session.site.cameras.get(camera) else { return false };
    let is_told = entry.lens.as_ref().is_some_and(|lens| {
        lens.like.is_some() || lens.distortion.as_ref().is_some_and(|given| given.distortion().is_some())
    });
    !is_told && (entry.image_circle().is_some() || entry.likely_lens().distortion.is_wide())
}

/// Returns a text about the source of the lens, and whether the lens is known well enough.
fn lens_state(session: &Session, camera: usize) -> (String, bool) {
    let entry = session.site.cameras.get(camera).and_then(|entry| entry.lens.as_ref());
    let like = entry.and_then(|lens| lens.like.as_ref());
    let distortion = entry.and_then(|lens| lens.distortion.as_ref());
    let edges = line_count(session, camera, Kind::Straight).0;
    let solution = session.solved.solution(camera);
    let is_fitted = solution.is_some_and(|solution| solution.distortion.is_some());
    let says_little =
        |warnings: &[Warning]| warnings.iter().any(|warning| warning.code == Code::UninformativePolyline);
    let is_vague = like.is_none() && solution.is_some_and(|solution| says_little(&solution.warnings));
    let drawn = counted(edges, "straight edge", "straight edges");
    if let Some(px) = nonstraightness_px(session, camera) {
        return (format!("lines curved by {px:.0} px, distortion not fitted"), false);
    }
    let from = match (like, distortion, edges) {
        (Some(like), ..) => format!("same lens as {like}"),
        (_, Some(given), _) if given.distortion().is_some() => "entered".into(),
        (.., 0) if is_fisheye(session, camera) => "fisheye: needs straight edges".into(),
        (.., 0) => "no distortion (assumed)".into(),
        _ if is_fitted && is_vague => format!("{drawn}, not enough"),
        _ if is_fitted => format!("from {drawn}"),
        _ => format!("{drawn}, not fitted"),
    };
    (from, (is_fitted && !is_vague) || like.is_some())
}

/// Describes the placement of a camera, or how to place it.
fn placement_state(session: &Session, camera: usize) -> String {
    let solution = session.solved.solution(camera).filter(|solution| solution.stage >= Stage::Placed);
    let Some(entry) = session.site.cameras.get(camera) else { return String::new() };
    match (solution, session.is_fixed_by_control_points(camera)) {
        (Some(_), _) if session.solved.is_out_of_date(camera) => {
            "changed since the cameras were refined".into()
        }
        (Some(_), true) => counted(used_points(session, entry), "control point", "control points"),
        (Some(solution), false) if solution.stage == Stage::Refined => "refined with other cameras".into(),
        (Some(_), false) if entry.placement.as_ref().is_some_and(|own| own.estimated) => {
            "placed automatically; check it".into()
        }
        (Some(_), false) => "placed by hand".into(),
        (None, _)
            if session.site.plan.is_some()
                && entry.annotations.is_empty()
                && session.solved.pose(camera).is_none() =>
        {
            "click 4 points in the image and on the plan".into()
        }
        (None, _) => "place on the plan, or add links".into(),
    }
}

/// Returns the number of control points of a camera that are switched on and have coordinates.
fn used_points(session: &Session, entry: &SiteCamera) -> usize {
    let is_used = |point: &&ControlPointEntry| !point.off && point.control_point(&session.site).is_some();
    entry.control_points.iter().filter(is_used).count()
}

/// Describes the points that determine a camera without lines: its control points, or the pins of a mark. `None`
/// if there are too few of them.
fn points_state(session: &Session, entry: &SiteCamera) -> Option<String> {
    let used = used_points(session, entry);
    let focal_is_known = entry.lens.as_ref().is_some_and(|lens| lens.focal_px.is_some());
    let from_points = || format!("from {}", counted(used, "control point", "control points"));
    // Three points determine the pose only with a known focal length.
    if used >= 4 || used == 3 && focal_is_known {
        return Some(from_points());
    }
    let pins = |mark: &Mark| mark.seen.iter().filter(|seen| seen.camera == entry.id).count();
    let marks = session.site.marks.iter().enumerate().filter(|(_, mark)| !mark.off && pins(mark) >= 3);
    let best = marks.max_by_key(|(_, mark)| pins(mark));
    best.map(|(index, mark)| format!("from mark {}", mark.label(index)))
        .or_else(|| (used == 3).then(from_points))
}

/// Returns the steps of a camera in working order.
#[must_use]
pub fn steps(session: &Session, camera: usize) -> Vec<Step> {
    let Some(entry) = session.site.cameras.get(camera) else { return Vec::new() };
    let count = |kind| line_count(session, camera, kind);
    let solution = session.solved.solution(camera);
    let (lens, has_lens) = lens_state(session, camera);
    let contradicted = contradicted_steps(session, camera);
    let (verticals, uprights) = (count(Kind::Vertical).0, count(Kind::Upright).0);
    let plumb = verticals + uprights;
    let (parallels, angles) = (count(Kind::Parallel), count(Kind::Perpendicular));
    let lengths = count(Kind::EqualLength).0 + count(Kind::KnownLength).0;
    let floor = parallels.0 + angles.0 + lengths;
    let directions = parallels.1 + angles.0;
    let corners = entry.efov_px.as_ref().map_or(0, Vec::len);
    let placed = solution.is_some_and(|solution| solution.stage >= Stage::Placed);
    // Control points or the corners of a mark may determine a camera. Then it needs no lines.
    let needs_no_lines = plumb + floor == 0 && session.solved.pose(camera).is_some() && !entry.is_given();
    let from_points = points_state(session, entry).filter(|_| needs_no_lines);
    let is_from_points = from_points.is_some();
    let step = |title, state: String, is_done, is_optional| {
        let is_contradicted = is_done && contradicted.contains(&title);
        Step { title, state, is_done, is_optional, is_contradicted }
    };
    vec![
        step(LENS, lens, has_lens, !is_fisheye(session, camera)),
        step(
            VERTICALS,
            match (&from_points, plumb) {
                (Some(text), _) => text.clone(),
                (None, 2..) => format!("{plumb} lines"),
                (None, _) => format!("2 needed, {plumb} drawn"),
            },
            plumb >= 2 || is_from_points || session.solved.pose(camera).is_some() && floor >= 4,
            false,
        ),
        step(
            FLOOR_LINES,
            match (from_points, floor, directions) {
                (Some(text), ..) => text,
                (None, 0 | 1, _) => format!("2 needed, {floor} drawn"),
                (None, _, 0 | 1) => format!("{floor} lines"),
                (None, _, directions) => format!("{floor} lines, {directions} directions"),
            },
            floor >= 2 || is_from_points,
            false,
        ),
        step(
            FIELD,
            if corners >= 3 { format!("{corners} corners") } else { "click the corners".into() },
            corners >= 3,
            is_from_points,
        ),
        step(PLACE, placement_state(session, camera), placed, false),
    ]
}

/// Returns the number of required steps that are not done.
#[must_use]
pub fn missing_steps(session: &Session, camera: usize) -> usize {
    steps(session, camera).iter().filter(|step| !step.is_done && !step.is_optional).count()
}

/// Whether all required steps are done, no link was rejected, and the result is current without a serious warning.
#[must_use]
pub fn is_finished(session: &Session, camera: usize) -> bool {
    let is_good = session
        .solved
        .solution(camera)
        .is_some_and(|s| !s.warnings.iter().any(|warning| is_serious(warning.code)));
    let is_fresh = !session.solved.is_out_of_date(camera) && nonstraightness_px(session, camera).is_none();
    is_good && is_fresh && missing_steps(session, camera) == 0 && rejected_links(session, camera) == 0
}

/// Returns the number of links whose observation in a camera the joint refinement rejected.
pub(crate) fn rejected_links(session: &Session, camera: usize) -> usize {
    let Some(entry) = session.site.cameras.get(camera).filter(|_| session.site.owns_links(camera)) else {
        return 0;
    };
    let is_rejected = |&link: &usize| {
        let solution = session.solved.joint_link(&session.site, link);
        let mut residuals = solution.into_iter().flat_map(|solution| &solution.residuals);
        residuals.any(|residual| residual.outlier && residual.camera == entry.id)
    };
    (0..session.site.links.len()).filter(is_rejected).count()
}

/// Whether a warning must be resolved before a camera is finished.
#[must_use]
pub fn is_serious(code: Code) -> bool {
    code.severity() > Severity::Note
}

/// Returns the predicted relative standard deviation of floor lengths that a camera measures. `None` if this number
/// or the scale is unknown.
#[must_use]
pub fn floor_sigma(session: &Session, camera: usize) -> Option<f64> {
    let rel = session.solved.solution(camera)?.sigma.as_ref()?.floor_length_rel;
    rel.filter(|_| session.solved.scale_is_known(camera))
}
