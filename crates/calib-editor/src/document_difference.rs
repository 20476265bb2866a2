//! Differences between two versions of a site, as text for an operator who has to choose one.

use calib_site::{Site, SiteCamera};

/// Returns the differences of the site `to` from the site `from`, one text each. Results are ignored, because
/// they follow from the inputs.
#[must_use]
pub fn differences(from: &Site, to: &Site) -> Vec<String> {
    let mut differences: Vec<String> =
        to.cameras.iter().filter_map(|camera| camera_difference(from, camera)).collect();
    let is_there = |camera: &&SiteCamera| to.cameras.iter().any(|other| other.is_same_period(camera));
    let removed = from.cameras.iter().filter(|camera| !is_there(camera));
    differences.extend(removed.map(|camera| format!("{}: removed", camera.id)));
    if from.units != to.units {
        differences.push(format!("lengths are shown in {}", to.units.name()));
    }
    let counted = [
        (
            "links",
            from.links.len(),
            to.links.len(),
            without_shared_solutions(from).links != without_shared_solutions(to).links,
        ),
        (
            "marks",
            from.marks.len(),
            to.marks.len(),
            without_shared_solutions(from).marks != without_shared_solutions(to).marks,
        ),
        (
            "planes",
            from.planes.len(),
            to.planes.len(),
            without_shared_solutions(from).planes != without_shared_solutions(to).planes,
        ),
        ("distances", from.distances.len(), to.distances.len(), from.distances != to.distances),
        ("walls", from.walls.len(), to.walls.len(), from.walls != to.walls),
        ("areas", from.areas.len(), to.areas.len(), from.areas != to.areas),
        (
            "measurements",
            from.measurements.len(),
            to.measurements.len(),
            from.measurements != to.measurements,
        ),
        (
            "ground points",
            from.ground_points.len(),
            to.ground_points.len(),
            from.ground_points != to.ground_points,
        ),
    ];
    differences.extend(
        counted.into_iter().filter(|(.., differ)| *differ).map(|(what, a, b, _)| count_text(what, a, b)),
    );
    if from.level_px_per_m != to.level_px_per_m {
        differences.push("pixel density limits".into());
    }
    if from.plan != to.plan {
        differences.push("floor plan".into());
    }
    if from.name != to.name {
        differences.push("site name".into());
    }
    differences
}

/// Returns the site without the solutions of links, marks and planes.
fn without_shared_solutions(site: &Site) -> Site {
    let mut bare = site.clone();
    bare.links.iter_mut().for_each(|link| link.solution = None);
    bare.marks.iter_mut().for_each(|mark| mark.solution = None);
    bare.planes.iter_mut().for_each(|plane| plane.solution = None);
    bare
}

/// Describes a change of a list, from `a` to `b` entries.
fn count_text(what: &str, a: usize, b: usize) -> String {
    if a == b { format!("{what}: changed") } else { format!("{what}: {a} \u{2192} {b}") }
}

/// Describes the changes of the inputs of a camera; `None` without changes.
fn camera_difference(from: &Site, camera: &SiteCamera) -> Option<String> {
    let own = from.cameras.iter().find(|own| own.is_same_period(camera));
    let Some(own) = own else { return Some(format!("{}: added", camera.id)) };
    let lines = |camera: &SiteCamera| camera.annotations.iter().map(|a| a.polylines().count()).sum::<usize>();
    let mut parts = Vec::new();
    if own.annotations != camera.annotations {
        let (a, b) = (lines(own), lines(camera));
        parts.push(if a == b { "lines".into() } else { format!("lines {a} \u{2192} {b}") });
    }
    let others = [
        ("lens", own.lens != camera.lens),
        ("field of view", own.efov_px != camera.efov_px || own.efov_plane != camera.efov_plane),
        ("placement", own.placement != camera.placement || own.height_m != camera.height_m),
        ("control points", own.control_points != camera.control_points),
        ("scene", own.scene != camera.scene),
        ("image size", own.size_px != camera.size_px),
    ];
    parts.extend(others.into_iter().filter(|(_, differ)| *differ).map(|(what, _)| what.to_owned()));
    (!parts.is_empty()).then(|| format!("{}: {}", camera.id, parts.join(", ")))
}

#[cfg(test)]
mod tests {
    use calib_core::{Annotation, Kind, Pixel};

    use super::*;

    #[test]
    fn differences_are_listed_per_camera() {
        let mut from = Site::new();
        from.cameras = ["a", "b"].map(|id| SiteCamera::new(id, [640, 480])).to_vec();
        let mut to = from.clone();
        let line = vec![Pixel::new(1.0, 2.0), Pixel::new(3.0, 4.0)];
        to.cameras[0].annotations.push(Annotation::from_segments(Kind::Vertical, vec![line]));
        to.cameras[1] = SiteCamera::new("c", [640, 480]);
        assert_eq!(differences(&from, &to), ["a: lines 0 \u{2192} 1", "c: added", "b: removed"]);
        assert!(differences(&to, &to).is_empty());
    }
}
