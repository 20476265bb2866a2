//! How a camera on the plan agrees with every other about the floor that both see.

use std::collections::BTreeSet;

use calib_core::{Camera, Extent, FloorPoint};

use crate::apart::{Apart, pair, pair_apart};
use crate::session::Session;

/// What a camera and another one have in common.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// The other camera.
    pub with: usize,
    /// How much of the camera's own field the other one's covers, 0 to 1.
    pub overlap: f64,
    /// How far the links that both show are apart, root mean square; none where they share none.
    pub apart: Option<Apart>,
    /// The same by the poses before, in metres.
    pub before: Option<f64>,
}

/// The cameras that share floor or links with one that is placed, in the order of the site: rows stay where they are
/// while a camera is dragged. `before` are poses to compare with, or none.
#[must_use]
pub fn agreements(session: &Session, camera: usize, before: &[Option<Camera>]) -> Vec<Agreement> {
    // Links are of the newest stills: a period that ended agrees with nobody.
    let Some(own) = field(session, camera).filter(|_| session.site.has_shared(camera)) else {
        return Vec::new();
    };
    let (inside, linked) = (points_within(own), linked(session, camera));
    let of = |with: usize| {
        let other = field(session, with)?;
        let overlap = share(&inside, other);
        let is_linked = linked.contains(&*session.site.cameras[with].id);
        let both = is_linked.then_some([camera, with]);
        let apart = both.and_then(|both| pair(session, both));
        let before = both.and_then(|both| pair_apart(session, before, both));
        Some(Agreement { with, overlap, apart, before })
    };
    let others =
        (0..session.site.cameras.len()).filter(|&with| with != camera && session.site.has_shared(with));
    let others = others.filter_map(of);
    others.filter(|found| found.overlap > 0.0 || found.apart.is_some()).collect()
}

/// The ids of the cameras that show a link which a camera shows, its own among them.
fn linked(session: &Session, camera: usize) -> BTreeSet<&str> {
    let own = &session.site.cameras[camera].id;
    let links = session.site.links.iter().filter(|link| link.seen.iter().any(|seen| seen.camera == *own));
    links.flat_map(|link| &link.seen).map(|seen| &*seen.camera).collect()
}

/// The field of a camera that stands on the plan.
fn field(session: &Session, camera: usize) -> Option<&[FloorPoint]> {
    session.solved.placed(camera)?;
    session.solved.solution(camera).map(|solution| &*solution.efov_m)
}

/// Points that lie evenly in a polygon.
fn points_within(polygon: &[FloorPoint]) -> Vec<FloorPoint> {
    /// A side of the grid over it: a share is right to a percent or two.
    const STEPS: usize = 32;
    let [low, high] = bounds(polygon);
    let at = |i: usize, low: f64, high: f64| low + (i as f64 + 0.5) / STEPS as f64 * (high - low);
    let extent = Extent { size: [0.0; 2], efov: polygon };
    (0..STEPS * STEPS)
        .map(|k| FloorPoint { x: at(k % STEPS, low.x, high.x), y: at(k / STEPS, low.y, high.y) })
        .filter(|&point| extent.contains(point))
        .collect()
}

/// The share of these points that lies in a polygon.
fn share(points: &[FloorPoint], polygon: &[FloorPoint]) -> f64 {
    let [low, high] = bounds(polygon);
    let is_near = |p: &&FloorPoint| p.x >= low.x && p.x <= high.x && p.y >= low.y && p.y <= high.y;
    let extent = Extent { size: [0.0; 2], efov: polygon };
    let seen = points.iter().filter(is_near).filter(|&&point| extent.contains(point)).count();
    seen as f64 / points.len().max(1) as f64
}

fn bounds(polygon: &[FloorPoint]) -> [FloorPoint; 2] {
    let of = |value: fn(&FloorPoint) -> f64, pick: fn(f64, f64) -> f64, start: f64| {
        polygon.iter().map(value).fold(start, pick)
    };
    let corner = |pick: fn(f64, f64) -> f64, start| FloorPoint {
        x: of(|p| p.x, pick, start),
        y: of(|p| p.y, pick, start),
    };
    [corner(f64::min, f64::INFINITY), corner(f64::max, f64::NEG_INFINITY)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::images::Images;

    fn session() -> Session {
        Session::new(calib_demo::demo_site().site, Images::default(), None)
    }

    #[test]
    fn the_share_of_a_field_is_that_of_its_area() {
        let square = |x: f64, side: f64| {
            [[x, 0.0], [x + side, 0.0], [x + side, side], [x, side]].map(|[x, y]| FloorPoint { x, y })
        };
        let own = points_within(&square(0.0, 4.0));
        for (x, side, wanted) in [(0.0, 4.0, 1.0), (3.0, 4.0, 0.25), (0.0, 2.0, 0.25), (4.5, 4.0, 0.0)] {
            let found = share(&own, &square(x, side));
            assert!((found - wanted).abs() < 0.02, "{found}, not {wanted}");
        }
    }

    #[test]
    fn a_camera_that_is_pushed_away_agrees_less_and_remembers_how_it_was() {
        let session = session();
        let poses: Vec<Option<Camera>> =
            (0..session.site.cameras.len()).map(|i| session.solved.placed(i).copied()).collect();
        let shares = |camera: usize, session: &Session| {
            let all = agreements(session, camera, &poses);
            all.into_iter().find(|found| found.apart.is_some())
        };
        let camera = (0..poses.len()).find(|&i| shares(i, &session).is_some()).unwrap();
        let before = shares(camera, &session).unwrap();
        assert_eq!(before.apart.map(|apart| apart.metres), before.before, "nothing was moved");
        let mut site = session.site.clone();
        site.cameras[camera].control_points.clear();
        site.cameras[camera].placement =
            session.solved.placed(camera).map(|pose| calib_site::PlacementEntry {
                move_m: FloorPoint { x: pose.position.x + 0.5, y: pose.position.y },
                turn_deg: pose.yaw.to_degrees(),
                scale: Some(pose.position.z / calib_core::floor::STAGE_1_HEIGHT),
                fixed: false,
                held: calib_site::HeldEntry::default(),
            });
        let moved = Session::new(site, Images::default(), None);
        let after = agreements(&moved, camera, &poses);
        let after = after.into_iter().find(|found| found.with == before.with).unwrap();
        let [then, now] = [&before, &after].map(|found| found.apart.unwrap().metres);
        // What it shows was moved by half a metre, all of it: no less than that and what they were apart.
        assert!(now > then && now >= 0.5 - then - 1e-6, "{before:?}, {after:?}");
        assert_eq!(after.before, before.before);
    }
}
