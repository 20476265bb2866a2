//! How a camera on the plan agrees with every other about the floor that both see.
//!
//! How far two views put one link from each other, and how far they may by their own uncertainty.

use std::collections::BTreeSet;

use calib_core::floor::FloorLine;
use calib_core::{Camera, Extent, FloorPoint, Plane};
use calib_site::{Link, LinkKind, LinkSeen};

use crate::session::Session;

/// The distance between where two views put a link, of those that contradict each other most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Apart {
    /// In metres.
    pub metres: f64,
    /// Its standard deviation, in metres, as if the two cameras had nothing in common; `None` where nothing is
    /// known of the errors of one of them.
    pub sigma: Option<f64>,
}

impl Apart {
    /// Whether chance does not explain it.
    #[must_use]
    pub fn is_far(self) -> bool {
        self.clear() > 3.0
    }

    /// The distance over its standard deviation; 0 where nothing is known of that.
    fn clear(self) -> f64 {
        self.sigma.map_or(0.0, |sigma| self.metres / sigma)
    }
}

/// How far the views of a point are apart on the floor; none of what fewer than two placed cameras show.
#[must_use]
pub fn apart(session: &Session, link: &Link) -> Option<Apart> {
    if link.kind != LinkKind::Point {
        return None;
    }
    let plane = plane_of(session, link);
    let places: Vec<_> = link.seen.iter().filter_map(|seen| place(session, seen, &plane)).collect();
    let pairs = places.iter().enumerate().flat_map(|(i, a)| places[..i].iter().map(move |b| (a, b)));
    let far =
        pairs.map(|(a, b)| Apart { metres: a.0.distance(b.0), sigma: a.1.zip(b.1).map(|(a, b)| a.hypot(b)) });
    far.max_by(|a, b| a.clear().total_cmp(&b.clear()).then(a.metres.total_cmp(&b.metres)))
}

/// The plane on which a point of a link is.
fn plane_of(session: &Session, link: &Link) -> Plane {
    let plane = session.solved.plane(&session.site, link.plane.as_deref());
    plane.raised(link.height_m.unwrap_or(0.0))
}

/// Where a view puts a point, and how uncertain it is there.
fn place(session: &Session, seen: &LinkSeen, plane: &Plane) -> Option<(FloorPoint, Option<f64>)> {
    let index = session.site.cameras.iter().position(|camera| camera.id == seen.camera)?;
    let (camera, px) = (session.solved.placed(index)?, seen.px?);
    let drawn = seen.sigma_px.or(session.site.cameras[index].sigma_px).unwrap_or(1.0);
    let sigma = camera.floor_covariance(px, drawn).and_then(|covariance| covariance.worst_sigma());
    Some((camera.pixel_to_plane(px, plane)?.on_floor(), sigma))
}

/// How far the points that two cameras show are apart on the floor, root mean square, and how far they may be.
pub(crate) fn pair(session: &Session, pair: [usize; 2]) -> Option<Apart> {
    if !pair.iter().all(|&camera| session.site.has_shared(camera)) {
        return None;
    }
    let both = |link: &Link| {
        let plane = plane_of(session, link);
        let [a, b] = pair.map(|camera| {
            let id = &session.site.cameras.get(camera)?.id;
            place(session, link.seen.iter().find(|seen| seen.camera == *id)?, &plane)
        });
        let ((a, sigma_a), (b, sigma_b)) = (a?, b?);
        Some((a.distance(b), sigma_a.zip(sigma_b).map(|(a, b)| a.hypot(b))))
    };
    let points = session.site.links.iter().filter(|link| !link.off && link.kind == LinkKind::Point);
    let all: Vec<(f64, Option<f64>)> = points.filter_map(both).collect();
    let rms = |values: &mut dyn Iterator<Item = f64>| {
        (values.map(|value| value * value).sum::<f64>() / all.len() as f64).sqrt()
    };
    let sigmas: Option<Vec<f64>> = all.iter().map(|(_, sigma)| *sigma).collect();
    let sigma = sigmas.map(|sigmas| rms(&mut sigmas.into_iter()));
    (!all.is_empty()).then(|| Apart { metres: rms(&mut all.iter().map(|(metres, _)| *metres)), sigma })
}

/// How far the lines of the floor that a camera shows pass from where the others put them, as they stand now: root mean
/// square of the distances of its ends from them in its image, in pixels, and how many lines that are. None where it
/// shares none with a camera that stands somewhere.
#[must_use]
pub fn lines_off(session: &Session, camera: usize) -> Option<(f64, usize)> {
    if !session.site.has_shared(camera) {
        return None;
    }
    let lines = session.site.links.iter().filter(|link| !link.off && link.kind == LinkKind::Line);
    let all: Vec<Vec<f64>> =
        lines.map(|link| line_off(session, link, camera)).filter(|off| !off.is_empty()).collect();
    let count = all.iter().flatten().count() as f64;
    let square: f64 = all.iter().flatten().map(|px| px * px).sum();
    (count > 0.0).then(|| ((square / count).sqrt(), all.len()))
}

/// The distances of the points that a camera shows of a line from where every other camera puts it, in pixels.
fn line_off(session: &Session, link: &Link, camera: usize) -> Vec<f64> {
    let plane = plane_of(session, link);
    let id = &session.site.cameras[camera].id;
    let Some(own) = session.solved.placed(camera) else { return Vec::new() };
    let put = |seen: &LinkSeen| {
        let index = session.site.cameras.iter().position(|camera| camera.id == seen.camera)?;
        let other = session.solved.placed(index)?;
        let points = seen.segment.as_ref()?;
        let [a, b] = [points.first()?, points.last()?].map(|&px| other.pixel_to_plane(px, &plane));
        FloorLine::between(a?.on_floor(), b?.on_floor())
    };
    let lines: Vec<FloorLine> = link.seen.iter().filter(|seen| seen.camera != *id).filter_map(put).collect();
    let drawn =
        link.seen.iter().filter(|seen| seen.camera == *id).flat_map(|seen| seen.segment.iter().flatten());
    drawn
        .flat_map(|&px| {
            lines.iter().filter_map(move |line| Some(line.nearest(own, px, &plane)?.1.distance(px)))
        })
        .collect()
}

/// How far two cameras of these poses put the points that both show from each other on the floor: root mean
/// square, in metres.
#[must_use]
pub fn pair_apart(session: &Session, poses: &[Option<Camera>], pair: [usize; 2]) -> Option<f64> {
    if !pair.iter().all(|&camera| session.site.has_shared(camera)) {
        return None;
    }
    let put = |link: &Link, camera: usize| {
        let id = &session.site.cameras.get(camera)?.id;
        let seen = link.seen.iter().find(|seen| seen.camera == *id)?;
        let put = poses.get(camera)?.as_ref()?.pixel_to_plane(seen.px?, &plane_of(session, link))?;
        Some(put.on_floor())
    };
    let points = session.site.links.iter().filter(|link| !link.off && link.kind == LinkKind::Point);
    let squares: Vec<f64> =
        points.filter_map(|link| Some(put(link, pair[0])?.distance(put(link, pair[1])?).powi(2))).collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}

/// Of the links of which a camera shows a part: how many are farther apart than chance explains, and of how many.
#[must_use]
pub fn far_links(session: &Session, camera: usize) -> (usize, usize) {
    if !session.site.has_shared(camera) {
        return (0, 0);
    }
    let id = &session.site.cameras[camera].id;
    let own = |link: &&Link| !link.off && link.seen.iter().any(|seen| seen.camera == *id);
    let known = session.site.links.iter().filter(own).filter_map(|link| apart(session, link));
    known.fold((0, 0), |(far, all), apart| (far + usize::from(apart.is_far()), all + 1))
}

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

    #[test]
    fn a_link_put_on_another_thing_is_apart_and_the_others_are_not() {
        let mut site = calib_demo::demo_site().site;
        let is_point = |link: &&mut Link| link.kind == LinkKind::Point && link.seen.len() > 1;
        let link = site.links.iter_mut().find(is_point).unwrap();
        let (id, camera) = (link.id.clone(), link.seen[0].camera.clone());
        let before = Session::new(calib_demo::demo_site().site, Images::default(), None);
        let index = before.site.cameras.iter().position(|known| known.id == camera).unwrap();
        let (far, all) = far_links(&before, index);
        assert!(all > 0 && far < all, "{far} of {all}");
        link.seen[0].px.as_mut().unwrap().u += 300.0;
        let after = Session::new(site, Images::default(), None);
        let moved = after.site.links.iter().find(|link| link.id == id).unwrap();
        assert!(apart(&after, moved).unwrap().is_far());
        assert!(far_links(&after, index).0 > far);
    }

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
