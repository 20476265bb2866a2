//! The same site for an operator who has no plan: the cameras of the shop are tied by links and by
//! virtual elements put on real things; store and barn share nothing with them.

use calib_core::{MarkKind, Placement, WorldPoint};

use calib_site::{Mark, MarkSeen, Site};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

use crate::cameras::{cameras, is_in_shop};
use crate::hand::{Hand, TREMOR};
use crate::random::normal;
use crate::world::visible;

/// What may hide the last stretch of the way to a point of a mark, in metres: the thing it stands in.
const SLACK: f64 = 0.35;

/// Takes plan, placements and control points away, and has the marks seen instead.
///
/// The first camera keeps its place, exactly: it is the base system that everything else is told in.
pub(crate) fn without_plan(mut site: Site) -> Site {
    site.plan = None;
    site.georeference = None;
    for (index, (camera, (_, truth, _))) in site.cameras.iter_mut().zip(cameras()).enumerate() {
        camera.control_points.clear();
        camera.placement = (index == 0).then(|| Placement::of(&truth).into());
    }
    let mut hands: Vec<(&str, Hand)> = cameras()
        .into_iter()
        .enumerate()
        .filter(|(_, (id, ..))| is_in_shop(id))
        .map(|(i, (id, camera, size))| {
            let random = ChaCha8Rng::seed_from_u64(3000 + i as u64);
            (id, Hand { camera, size, tremor: TREMOR, random })
        })
        .collect();
    let mut random = ChaCha8Rng::seed_from_u64(4000);
    for mark in &mut site.marks {
        mark.seen = seen(mark, &mut hands);
        // Dropped about where the thing stands; the fit moves it there.
        let WorldPoint { x, y, z } = mark.at_m;
        let mut off =
            |sigma: f64, value: f64| ((value + sigma * normal(&mut random)) * 100.0).round() / 100.0;
        mark.at_m = WorldPoint { x: off(0.15, x), y: off(0.15, y), z };
        mark.turn_deg = off(3.0, mark.turn_deg);
    }
    site
}

/// Named points of a mark that stand for something that can be seen.
fn names(kind: MarkKind) -> &'static [&'static str] {
    match kind {
        MarkKind::Cross => &["centre"],
        MarkKind::Post => &["base"],
        MarkKind::Box => &["b0", "b1", "b2", "b3", "t0", "t1", "t2", "t3"],
        MarkKind::Cylinder => &["top"],
        MarkKind::Circle => &["centre"],
        MarkKind::Person => &["foot", "head"],
        MarkKind::Grid => &["0,0", "6,0", "0,3", "6,3"],
    }
}

fn seen(mark: &Mark, hands: &mut [(&str, Hand)]) -> Vec<MarkSeen> {
    let shape = mark.shape();
    let mut seen = Vec::new();
    for name in names(mark.kind) {
        let Some(point) = shape.point(name) else { continue };
        for (id, hand) in hands.iter_mut() {
            // The middle of a thing is seen through its own side.
            let slack = if matches!(mark.kind, MarkKind::Box | MarkKind::Grid) { 0.03 } else { SLACK };
            if !visible(&hand.camera, hand.size, point, slack) {
                continue;
            }
            if let Some(px) = hand.touch(point) {
                seen.push(MarkSeen { camera: (*id).into(), point: (*name).into(), px });
            }
        }
    }
    seen
}
