//! The steps of one camera, and what each still needs.
//!
//! What a warning of the site as a whole is about, so that it can be shown.

use calib_core::outcome::WhyNotConnected;
use calib_core::single::straightness_rms;
use calib_core::{Code, Finding, Kind, Parameter, Severity, Subject};
use calib_site::{Names, Report, Site, Stage, Warning, counted};

use crate::session::Session;

/// What a warning that a joint solve gave the site is about. The results of one come as a document, which has the
/// words alone: of the findings that its numbers allow, it is the one that is told in these words.
#[must_use]
pub fn site_subject(site: &Site, report: &Report, warning: &Warning) -> Option<Subject> {
    let told = |finding: &Finding| {
        finding.code() == warning.code && site.in_english(None, finding, Names::InFile) == *warning
    };
    possible(site, report).find(told).map(|finding| finding.subject())
}

/// The findings that a report of this site may have told.
fn possible<'a>(site: &'a Site, report: &'a Report) -> impl Iterator<Item = Finding> + 'a {
    let index = |id: &String| site.cameras.iter().position(|camera| camera.id == *id);
    let links = report.links.iter().enumerate().map(|(i, found)| (Subject::Link(i), found));
    let marks = report.marks.iter().enumerate().map(|(i, found)| (Subject::Mark(i), found));
    let elements = links.chain(marks).filter_map(move |(element, found)| {
        let seen = found.as_ref()?.residuals.iter().filter(|seen| seen.outlier);
        let worst = seen.max_by(|a, b| a.px.total_cmp(&b.px))?;
        Some(Finding::ElementOutlier { element, worst: Some((index(&worst.camera)?, worst.px)) })
    });
    let distances = (0..site.distances.len()).map(|distance| Finding::DistanceOutlier { distance });
    let sliding = (0..site.cameras.len()).map(|camera| Finding::Sliding { camera });
    let components = report.site.components.iter().map(move |ids| ids.iter().filter_map(index).collect());
    let of_components = components.flat_map(|cameras: Vec<usize>| {
        let why = [WhyNotConnected::TooLittle, WhyNotConnected::Placed, WhyNotConnected::Alone];
        let apart = why.map(|why| Finding::NotConnected { cameras: cameras.clone(), why });
        let unscaled = cameras
            .clone()
            .into_iter()
            .map(move |root| Finding::ScaleUnknown { cameras: cameras.clone(), root });
        apart.into_iter().chain(unscaled).collect::<Vec<_>>()
    });
    elements.chain(distances).chain(sliding).chain(of_components)
}

/// A step.
#[derive(Clone, Debug)]
pub struct Step {
    /// Its name.
    pub title: &'static str,
    /// What it has, or needs.
    pub state: String,
    /// Whether it is done.
    pub is_done: bool,
    /// Nothing has to be done for it.
    pub is_optional: bool,
    /// It is done, and a warning says that something of it is wrong.
    pub is_doubted: bool,
}

pub(crate) const LENS: &str = "Lens";
pub(crate) const VERTICALS: &str = "Verticals";
pub(crate) const FLOOR_LINES: &str = "Floor lines";
pub(crate) const FIELD: &str = "Field of view";
pub(crate) const PLACE: &str = "Place on the site";

/// What is contradicted by a warning about no line in particular; what merely says too little is right as it is.
fn contradicted(code: Code) -> Vec<&'static str> {
    if matches!(code, Code::Outlier | Code::Misfit) { vec![VERTICALS, FLOOR_LINES] } else { Vec::new() }
}

/// The steps of which a grave warning says that something is wrong.
fn doubted(session: &Session, camera: usize) -> Vec<&'static str> {
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
            _ => contradicted(warning.code),
        },
        None => contradicted(warning.code),
    };
    solution.warnings.iter().filter(|warning| is_grave(warning.code)).flat_map(of).collect()
}

/// How far edges that were drawn as straight are from it, in pixels, where no lens was fitted to them and drawing
/// alone cannot explain it.
#[must_use]
pub fn bent_px(session: &Session, camera: usize) -> Option<f64> {
    /// In standard deviations of a drawn point.
    const DRAWN: f64 = 3.0;
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
    (worst > DRAWN * entry.sigma_px.unwrap_or(1.0)).then_some(worst)
}

/// Segments of a kind, and annotations of it.
fn drawn(session: &Session, camera: usize, kind: Kind) -> (usize, usize) {
    let Some(entry) = session.site.cameras.get(camera) else { return (0, 0) };
    let of_kind = entry.annotations.iter().filter(|a| a.kind == kind && !a.off);
    let (mut lines, mut groups) = (0, 0);
    for annotation in of_kind {
        groups += 1;
        lines += annotation.polylines().count();
    }
    (lines, groups)
}

/// Whether a camera is a fisheye whose lens is sought: it cannot be taken as straight.
fn is_fisheye(session: &Session, camera: usize) -> bool {
    let Some(entry) = session.site.cameras.get(camera) else { return false };
    let is_told = entry.lens.as_ref().is_some_and(|lens| {
        lens.like.is_some() || lens.distortion.as_ref().is_some_and(|given| given.distortion().is_some())
    });
    !is_told && (entry.image_circle().is_some() || entry.likely_lens().distortion.is_wide())
}

/// Where the lens comes from, and whether it is known.
fn lens(session: &Session, camera: usize) -> (String, bool) {
    let entry = session.site.cameras.get(camera).and_then(|entry| entry.lens.as_ref());
    let like = entry.and_then(|lens| lens.like.as_ref());
    let distortion = entry.and_then(|lens| lens.distortion.as_ref());
    let edges = drawn(session, camera, Kind::Straight).0;
    let solution = session.solved.solution(camera);
    let is_fitted = solution.is_some_and(|solution| solution.distortion.is_some());
    let says_little =
        |warnings: &[Warning]| warnings.iter().any(|warning| warning.code == Code::UninformativePolyline);
    let is_vague = like.is_none() && solution.is_some_and(|solution| says_little(&solution.warnings));
    let drawn = counted(edges, "straight edge", "straight edges");
    if let Some(px) = bent_px(session, camera) {
        return (format!("bent by {px:.0} px, not fitted"), false);
    }
    let from = match (like, distortion, edges) {
        (Some(like), ..) => format!("like {like}"),
        (_, Some(given), _) if given.distortion().is_some() => "given".into(),
        (.., 0) if is_fisheye(session, camera) => "a fisheye, needs straight edges".into(),
        (.., 0) => "taken as straight".into(),
        _ if is_fitted && is_vague => format!("from {drawn}: too little"),
        _ if is_fitted => format!("from {drawn}"),
        _ => format!("{drawn}, not fitted"),
    };
    (from, (is_fitted && !is_vague) || like.is_some())
}

/// The steps of a camera, in the order in which they are done.
#[must_use]
pub fn steps(session: &Session, camera: usize) -> Vec<Step> {
    let Some(entry) = session.site.cameras.get(camera) else { return Vec::new() };
    let count = |kind| drawn(session, camera, kind);
    let solution = session.solved.solution(camera);
    let (lens, has_lens) = lens(session, camera);
    let doubted = doubted(session, camera);
    let (verticals, uprights) = (count(Kind::Vertical).0, count(Kind::Upright).0);
    let plumb = verticals + uprights;
    let (parallels, angles) = (count(Kind::Parallel), count(Kind::Perpendicular));
    let lengths = count(Kind::EqualLength).0 + count(Kind::KnownLength).0;
    let floor = parallels.0 + angles.0 + lengths;
    let directions = parallels.1 + angles.0;
    let corners = entry.efov_px.as_ref().map_or(0, Vec::len);
    let placed = solution.is_some_and(|solution| solution.stage >= Stage::Placed);
    let step = |title, state: String, is_done, is_optional| {
        let is_doubted = is_done && doubted.contains(&title);
        Step { title, state, is_done, is_optional, is_doubted }
    };
    vec![
        step(LENS, lens, has_lens, !is_fisheye(session, camera)),
        step(
            VERTICALS,
            if plumb >= 2 { format!("{plumb}, needs 2") } else { format!("needs 2, has {plumb}") },
            plumb >= 2 || session.solved.pose(camera).is_some() && floor >= 4,
            false,
        ),
        step(
            FLOOR_LINES,
            match (floor, directions) {
                (0 | 1, _) => format!("needs 2, has {floor}"),
                (_, 0 | 1) => format!("{floor} lines"),
                (_, directions) => format!("{floor} lines, {directions} directions"),
            },
            floor >= 2,
            false,
        ),
        step(
            FIELD,
            if corners >= 3 { format!("{corners} corners") } else { "draw its corners".into() },
            corners >= 3,
            false,
        ),
        step(
            PLACE,
            match (placed, session.is_held_by_points(camera)) {
                (true, _) if session.solved.is_out_of_date(camera) => "refined, out of date".into(),
                (true, true) => counted(entry.control_points.len(), "control point", "control points"),
                (true, false) if solution.is_some_and(|s| s.stage == Stage::Refined) => {
                    "refined with the others".into()
                }
                (true, false) => "by hand".into(),
                (false, _) => "on the plan, or by links".into(),
            },
            placed,
            false,
        ),
    ]
}

/// How many steps are open.
#[must_use]
pub fn missing(session: &Session, camera: usize) -> usize {
    steps(session, camera).iter().filter(|step| !step.is_done && !step.is_optional).count()
}

/// Whether nothing is open and the result is fit for use.
#[must_use]
pub fn is_finished(session: &Session, camera: usize) -> bool {
    let is_good = session
        .solved
        .solution(camera)
        .is_some_and(|s| !s.warnings.iter().any(|warning| is_grave(warning.code)));
    let is_fresh = !session.solved.is_out_of_date(camera) && bent_px(session, camera).is_none();
    is_good && is_fresh && missing(session, camera) == 0
}

/// Whether a warning has to be met before a camera is finished.
#[must_use]
pub fn is_grave(code: Code) -> bool {
    code.severity() > Severity::Note || code.fails_check()
}

/// The predicted relative error of lengths on a camera's floor.
#[must_use]
pub fn floor_sigma(session: &Session, camera: usize) -> Option<f64> {
    session.solved.solution(camera)?.sigma.as_ref()?.floor_length_rel
}
