//! Status of each camera. Contradictions have priority over missing steps, and missing steps over completion.

use calib_core::{Code, Severity};

use calib_site::{Warning, counted};

use crate::session::Session;
use crate::steps::{FIELD, LENS, PLACE, Step, is_serious, nonstraightness_px, rejected_links, steps};

/// Level of a camera's status.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum StatusLevel {
    /// The camera is fit for use, or ready for the next step.
    Good,
    /// Work steps of the camera are missing, or its result has warnings or is out of date.
    Incomplete,
    /// The annotations contradict each other, or the result has an error.
    Contradictory,
}

/// Status of a camera, as a short text with a level.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CameraStatus {
    /// Text of the status for the list of cameras.
    pub text: String,
    /// Level of the status, which determines its colour.
    pub level: StatusLevel,
}

impl CameraStatus {
    const fn new(text: String, level: StatusLevel) -> Self {
        Self { text, level }
    }
}

/// Returns the status of the camera with this index.
#[must_use]
pub fn camera_status(session: &Session, camera: usize) -> CameraStatus {
    let steps = steps(session, camera);
    let open = steps.iter().find(|step| !step.is_done && !step.is_optional);
    contradiction(session, camera)
        .or_else(|| open.filter(|step| step.title != PLACE).map(step_status))
        .or_else(|| remaining_problem(session, camera))
        .unwrap_or_else(|| match open {
            Some(_) => CameraStatus::new("ready to place".into(), StatusLevel::Good),
            None => CameraStatus::new("done".into(), StatusLevel::Good),
        })
}

/// Returns the status of a camera whose annotations contradict each other; `None` for other cameras.
fn contradiction(session: &Session, camera: usize) -> Option<CameraStatus> {
    let solution = session.solved.solution(camera)?;
    let suspects = solution.warnings.iter().filter(|warning| warning.code == Code::Outlier).count();
    if suspects > 0 {
        let rejected = counted(suspects, "rejected line or point", "rejected lines or points");
        return Some(CameraStatus::new(format!("check {rejected}"), StatusLevel::Contradictory));
    }
    let links = rejected_links(session, camera);
    if links > 0 {
        let text = format!("check {}", counted(links, "rejected link", "rejected links"));
        return Some(CameraStatus::new(text, StatusLevel::Contradictory));
    }
    let misfit = solution.warnings.iter().find(|warning| warning.code == Code::Misfit)?;
    let text = match (nonstraightness_px(session, camera), solution.chi2, solution.dof) {
        (Some(px), ..) => format!("lines curved by {px:.0} px, distortion not fitted"),
        // The misfit may not come from the lines alone, but from straight edges or from points of other
        // cameras.
        (None, Some(chi2), Some(dof)) if chi2 > 2.0 * dof as f64 => {
            let dof = counted(dof, "degree of freedom", "degrees of freedom");
            format!("lines contradict each other: \u{3c7}\u{b2} {chi2:.0} for {dof}")
        }
        _ => first_sentence(session, camera, misfit),
    };
    Some(CameraStatus::new(text, StatusLevel::Contradictory))
}

/// Returns the status of a camera whose annotations are complete but which is not fit for use; `None` for
/// other cameras.
fn remaining_problem(session: &Session, camera: usize) -> Option<CameraStatus> {
    if let Some(px) = nonstraightness_px(session, camera) {
        return Some(CameraStatus::new(
            format!("lines curved by {px:.0} px, distortion not fitted"),
            StatusLevel::Incomplete,
        ));
    }
    let warnings = session.solved.solution(camera).map(|solution| &solution.warnings);
    let grave = warnings.into_iter().flatten().filter(|warning| is_serious(warning.code));
    if let Some(worst) = grave.max_by_key(|warning| warning.code.severity()) {
        let is_error = worst.code.severity() == Severity::Error;
        let level = if is_error { StatusLevel::Contradictory } else { StatusLevel::Incomplete };
        return Some(CameraStatus::new(first_sentence(session, camera, worst), level));
    }
    session
        .solved
        .is_out_of_date(camera)
        .then(|| CameraStatus::new("changed since the cameras were refined".into(), StatusLevel::Incomplete))
}

/// Returns the first sentence of a warning, without the full stop.
fn first_sentence(session: &Session, camera: usize, warning: &Warning) -> String {
    let message = session.warning_text(camera, warning);
    message.split_once(". ").map_or(message.as_str(), |(first, _)| first).trim_end_matches('.').to_owned()
}

/// Returns the status of a camera whose first unfinished required step is `step`.
fn step_status(step: &Step) -> CameraStatus {
    let text = match step.title {
        FIELD => "draw the field of view".into(),
        LENS => step.state.clone(),
        title => format!("{}: {}", title.to_lowercase(), step.state),
    };
    CameraStatus::new(text, StatusLevel::Incomplete)
}

/// Returns a short summary of a camera for a tooltip: id, name, image size and status.
#[must_use]
pub fn summary(session: &Session, camera: usize) -> String {
    let Some(entry) = session.site.cameras.get(camera) else { return String::new() };
    let name = entry.name.as_ref().map_or_else(String::new, |name| format!(", {name}"));
    let [w, h] = entry.size_px;
    let about = match session.solved.result(camera) {
        Some(Err(failure)) => failure.to_string(),
        _ => camera_status(session, camera).text,
    };
    format!("{}{name}\n{w} \u{d7} {h} px\n{about}", entry.id)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::Images;
    use calib_core::{Annotation, DistortionModel, Kind, Pixel};
    use calib_site::{DistortionEntry, LensEntry, Site};

    fn session(change: impl FnOnce(&mut Site)) -> Session {
        let mut site = calib_demo::demo_site().site;
        site.cameras.truncate(1);
        (site.links, site.marks, site.distances) = Default::default();
        change(&mut site);
        Session::new(site, Images::default(), None)
    }

    #[test]
    fn camera_with_a_misfit_is_not_ready_to_place() {
        let ready = session(|site| {
            (site.cameras[0].control_points, site.cameras[0].placement) = Default::default();
        });
        assert_eq!(camera_status(&ready, 0).text, "ready to place");
        let askew = session(|site| {
            let camera = &mut site.cameras[0];
            (camera.control_points, camera.placement) = Default::default();
            for drawn in camera.annotations.iter_mut().filter(|drawn| drawn.kind == Kind::Vertical) {
                drawn.keep = true;
                for (index, line) in drawn.segments.iter_mut().flatten().enumerate() {
                    line[0].u += if index % 2 == 0 { 14.0 } else { -14.0 };
                }
            }
        });
        let warnings = &askew.solved.solution(0).unwrap().warnings;
        assert!(warnings.iter().any(|warning| warning.code == Code::Misfit), "{warnings:?}");
        let status = camera_status(&askew, 0);
        assert_eq!(status.level, StatusLevel::Contradictory, "{status:?}");
        assert!(steps(&askew, 0).iter().any(|step| step.is_contradicted), "its steps are marked");
    }

    #[test]
    fn edges_that_a_fixed_lens_leaves_curved_are_reported_in_pixels() {
        let bent = session(|site| {
            let camera = &mut site.cameras[0];
            camera.annotations.retain(|drawn| drawn.kind != Kind::Straight);
            let at = |i: i32| {
                let t = f64::from(i) / 10.0 - 0.5;
                Pixel::new(1920.0 * t + 960.0, 60.0 + 120.0 * (1.0 - 4.0 * t * t))
            };
            let points = Some((1..10).map(at).collect());
            camera.annotations.push(Annotation { points, ..Annotation::new(Kind::Straight) });
            let model = DistortionModel::BrownConrady;
            let straight = DistortionEntry { k1: Some(0.0), k2: Some(0.0), ..DistortionEntry::new(model) };
            camera.lens = Some(LensEntry { distortion: Some(straight), ..LensEntry::default() });
        });
        let px = nonstraightness_px(&bent, 0).expect("the edge is curved");
        assert!((20.0..60.0).contains(&px), "{px}");
        let lens = &steps(&bent, 0)[0];
        assert!(!lens.is_done && lens.state.starts_with("lines curved by"), "{lens:?}");
    }

    #[test]
    fn consistent_but_insufficient_lines_are_not_contradicted() {
        let few = session(|site| {
            let camera = &mut site.cameras[0];
            camera.annotations.retain(|drawn| drawn.kind == Kind::Vertical);
            (camera.control_points, camera.placement) = Default::default();
        });
        let solution = few.solved.solution(0).unwrap();
        assert!(solution.warnings.iter().any(|warning| is_serious(warning.code)), "the floor is uncertain");
        assert!(steps(&few, 0).iter().all(|step| !step.is_contradicted));
        assert!(camera_status(&few, 0).text.starts_with("floor lines"), "{:?}", camera_status(&few, 0));
    }

    #[test]
    fn lens_step_is_not_done_without_straight_edges() {
        let straight = session(|site| {
            site.cameras[0].annotations.retain(|drawn| drawn.kind != Kind::Straight);
            site.cameras[0].lens = None;
        });
        let lens = &steps(&straight, 0)[0];
        assert!(!lens.is_done && lens.is_optional && lens.state == "no distortion (assumed)", "{lens:?}");
    }
}
