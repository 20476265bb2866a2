//! One verdict a camera: what is wrong comes before what is open, and that before what is done.

use calib_core::{Code, Severity};

use calib_site::Warning;

use crate::session::Session;
use crate::steps::{FIELD, LENS, PLACE, Step, bent_px, is_grave, steps};

/// How a camera stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Standing {
    /// Fit for use, or ready for the next step.
    Good,
    /// Something is to be done.
    Open,
    /// The result contradicts what was drawn.
    Wrong,
}

/// How a camera stands, in a few words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Verdict {
    /// In a few words.
    pub text: String,
    /// How it stands.
    pub standing: Standing,
}

impl Verdict {
    const fn new(text: String, standing: Standing) -> Self {
        Self { text, standing }
    }
}

/// The verdict on a camera.
#[must_use]
pub fn verdict(session: &Session, camera: usize) -> Verdict {
    let steps = steps(session, camera);
    let open = steps.iter().find(|step| !step.is_done && !step.is_optional);
    wrong(session, camera)
        .or_else(|| open.filter(|step| step.title != PLACE).map(to_do))
        .or_else(|| doubt(session, camera))
        .unwrap_or_else(|| match open {
            Some(_) => Verdict::new("ready to place".into(), Standing::Good),
            None => Verdict::new("done".into(), Standing::Good),
        })
}

/// Evidence that contradicts itself, at whatever step one is.
fn wrong(session: &Session, camera: usize) -> Option<Verdict> {
    let solution = session.solved.solution(camera)?;
    let suspects = solution.warnings.iter().filter(|warning| warning.code == Code::Outlier).count();
    if suspects > 0 {
        let noun = if suspects == 1 { "line needs" } else { "lines need" };
        return Some(Verdict::new(format!("{suspects} {noun} a look"), Standing::Wrong));
    }
    let misfit = solution.warnings.iter().find(|warning| warning.code == Code::Misfit)?;
    let text = match (bent_px(session, camera), solution.chi2, solution.dof) {
        (Some(px), ..) => format!("bent by {px:.0} px, not fitted"),
        // What does not fit may be something else than the lines: the edges of the lens, points of others.
        (None, Some(chi2), Some(dof)) if chi2 > 2.0 * dof as f64 => {
            format!("does not fit: \u{3c7}\u{b2} {chi2:.0} on {dof}")
        }
        _ => first_words(session, camera, misfit),
    };
    Some(Verdict::new(text, Standing::Wrong))
}

/// What keeps a camera whose drawing is complete from being fit for use.
fn doubt(session: &Session, camera: usize) -> Option<Verdict> {
    if let Some(px) = bent_px(session, camera) {
        return Some(Verdict::new(format!("bent by {px:.0} px, not fitted"), Standing::Open));
    }
    let warnings = session.solved.solution(camera).map(|solution| &solution.warnings);
    let grave = warnings.into_iter().flatten().filter(|warning| is_grave(warning.code));
    if let Some(worst) = grave.max_by_key(|warning| warning.code.severity()) {
        let is_error = worst.code.severity() == Severity::Error;
        let standing = if is_error { Standing::Wrong } else { Standing::Open };
        return Some(Verdict::new(first_words(session, camera, worst), standing));
    }
    session.solved.is_out_of_date(camera).then(|| Verdict::new("refined, out of date".into(), Standing::Open))
}

fn first_words(session: &Session, camera: usize, warning: &Warning) -> String {
    let message = session.as_on_screen(camera, warning);
    message.split_once(". ").map_or(message.as_str(), |(first, _)| first).trim_end_matches('.').to_owned()
}

fn to_do(step: &Step) -> Verdict {
    let text = match step.title {
        FIELD => "draw the field of view".into(),
        LENS => step.state.clone(),
        title => format!("{}: {}", title.to_lowercase(), step.state),
    };
    Verdict::new(text, Standing::Open)
}

/// A camera in a line, for a tooltip.
#[must_use]
pub fn summary(session: &Session, camera: usize) -> String {
    let Some(entry) = session.site.cameras.get(camera) else { return String::new() };
    let name = entry.name.as_ref().map_or_else(String::new, |name| format!(", {name}"));
    let [w, h] = entry.size_px;
    let about = match session.solved.result(camera) {
        Some(Err(failure)) => failure.to_string(),
        _ => verdict(session, camera).text,
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
    fn a_camera_that_does_not_fit_is_not_ready_to_place() {
        let ready = session(|site| {
            (site.cameras[0].control_points, site.cameras[0].placement) = Default::default();
        });
        assert_eq!(verdict(&ready, 0).text, "ready to place");
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
        let told = verdict(&askew, 0);
        assert_eq!(told.standing, Standing::Wrong, "{told:?}");
        assert!(steps(&askew, 0).iter().any(|step| step.is_doubted), "and its steps say so");
    }

    #[test]
    fn edges_that_a_given_lens_leaves_bent_are_told_with_their_pixels() {
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
        let px = bent_px(&bent, 0).expect("it is bent");
        assert!((20.0..60.0).contains(&px), "{px}");
        let lens = &steps(&bent, 0)[0];
        assert!(!lens.is_done && lens.state.starts_with("bent by"), "{lens:?}");
    }

    #[test]
    fn what_is_drawn_right_and_says_too_little_is_not_doubted() {
        let few = session(|site| {
            let camera = &mut site.cameras[0];
            camera.annotations.retain(|drawn| drawn.kind == Kind::Vertical);
            (camera.control_points, camera.placement) = Default::default();
        });
        let solution = few.solved.solution(0).unwrap();
        assert!(solution.warnings.iter().any(|warning| is_grave(warning.code)), "the floor is hardly known");
        assert!(steps(&few, 0).iter().all(|step| !step.is_doubted));
        assert!(verdict(&few, 0).text.starts_with("floor lines"), "{:?}", verdict(&few, 0));
    }

    #[test]
    fn without_edges_the_lens_is_not_ticked() {
        let straight = session(|site| {
            site.cameras[0].annotations.retain(|drawn| drawn.kind != Kind::Straight);
            site.cameras[0].lens = None;
        });
        let lens = &steps(&straight, 0)[0];
        assert!(!lens.is_done && lens.is_optional && lens.state == "taken as straight", "{lens:?}");
    }
}
