//! The steps of one camera, and what each still needs.

use calib_core::{Code, Kind, Severity, Stage};

use crate::session::Session;

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

/// The steps of a camera, in the order in which they are done.
#[must_use]
pub fn steps(session: &Session, camera: usize) -> Vec<Step> {
    let Some(entry) = session.site.cameras.get(camera) else { return Vec::new() };
    let count = |kind| drawn(session, camera, kind);
    let solution = session.solved.solution(camera);
    let distortion = entry.lens.as_ref().and_then(|lens| lens.distortion.as_ref());
    let edges = count(Kind::Straight).0;
    let like = entry.lens.as_ref().and_then(|lens| lens.like.as_ref());
    let lens = match (distortion, edges) {
        _ if like.is_some() => format!("like {}", like.map_or("", String::as_str)),
        (Some(given), _) if given.fit.is_none() => "given".into(),
        (_, 0) => "taken as straight".into(),
        (_, edges) => format!("from {edges} straight edges"),
    };
    let (verticals, uprights) = (count(Kind::Vertical).0, count(Kind::Upright).0);
    let plumb = verticals + uprights;
    let (parallels, angles) = (count(Kind::Parallel), count(Kind::Perpendicular));
    let lengths = count(Kind::EqualLength).0 + count(Kind::KnownLength).0;
    let floor = parallels.0 + angles.0 + lengths;
    let directions = parallels.1 + angles.0;
    let corners = entry.efov_px.as_ref().map_or(0, Vec::len);
    let placed = solution.is_some_and(|solution| solution.stage >= Stage::Placed);
    let step = |title, state: String, is_done, is_optional| Step { title, state, is_done, is_optional };
    vec![
        step("Lens", lens, true, true),
        step(
            "Verticals",
            if plumb >= 2 { format!("{plumb}, needs 2") } else { format!("needs 2, has {plumb}") },
            plumb >= 2 || session.solved.pose(camera).is_some() && floor >= 4,
            false,
        ),
        step(
            "Floor lines",
            match (floor, directions) {
                (0 | 1, _) => format!("needs 2, has {floor}"),
                (_, 0 | 1) => format!("{floor} lines"),
                (_, directions) => format!("{floor} lines, {directions} directions"),
            },
            floor >= 2,
            false,
        ),
        step(
            "Field of view",
            if corners >= 3 { format!("{corners} corners") } else { "draw its corners".into() },
            corners >= 3,
            false,
        ),
        step(
            "Place on the site",
            match (placed, session.is_held_by_points(camera)) {
                (true, true) => format!("{} control points", entry.control_points.len()),
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
    steps(session, camera).iter().filter(|step| !step.is_done).count()
}

/// Whether nothing is open and the result is fit for use.
#[must_use]
pub fn is_finished(session: &Session, camera: usize) -> bool {
    let is_good = session
        .solved
        .solution(camera)
        .is_some_and(|s| !s.warnings.iter().any(|warning| is_grave(warning.code)));
    is_good && missing(session, camera) == 0
}

/// Whether a warning has to be met before a camera is finished.
#[must_use]
pub fn is_grave(code: Code) -> bool {
    code.severity() > Severity::Note
}

/// The predicted relative error of lengths on a camera's floor.
#[must_use]
pub fn floor_sigma(session: &Session, camera: usize) -> Option<f64> {
    session.solved.solution(camera)?.sigma.as_ref()?.floor_length_rel
}

/// What to do next, in a few words, and whether that is nothing.
#[must_use]
pub fn next(session: &Session, camera: usize) -> (String, bool) {
    let open = steps(session, camera).into_iter().find(|step| !step.is_done);
    let count = |code| {
        let warnings = session.solved.solution(camera).map(|solution| &solution.warnings);
        warnings.into_iter().flatten().filter(|warning| warning.code == code).count()
    };
    let suspects = count(Code::Outlier);
    match open {
        Some(step) if step.title == "Place on the site" && suspects == 0 => ("ready to place".into(), true),
        Some(step) if step.title == "Field of view" => ("draw the field of view".into(), false),
        Some(step) if suspects == 0 => (format!("{}: {}", step.title.to_lowercase(), step.state), false),
        _ if suspects > 0 => {
            let noun = if suspects == 1 { "line needs" } else { "lines need" };
            (format!("{suspects} {noun} a look"), false)
        }
        _ => match session.solved.solution(camera).and_then(|s| s.warnings.iter().find(|w| is_grave(w.code)))
        {
            Some(warning) => {
                let message = session.as_on_screen(camera, warning);
                (message.trim_end_matches('.').to_owned(), false)
            }
            None => ("done".into(), true),
        },
    }
}

/// A camera in a line, for a tooltip.
#[must_use]
pub fn summary(session: &Session, camera: usize) -> String {
    let Some(entry) = session.site.cameras.get(camera) else { return String::new() };
    let name = entry.name.as_ref().map_or_else(String::new, |name| format!(", {name}"));
    let [w, h] = entry.size_px;
    let about = match session.solved.result(camera) {
        Some(Err(failure)) => failure.to_string(),
        _ => next(session, camera).0,
    };
    format!("{}{name}\n{w} \u{d7} {h} px\n{about}", entry.id)
}
