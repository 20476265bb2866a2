//! Agreement of placed cameras about the floor that they share.
//!
//! The measure is the distance between the floor positions of one link according to two cameras, compared
//! with its predicted standard deviation.

use std::collections::BTreeSet;

use calib_core::floor::FloorLine;
use calib_core::{Camera, Extent, FloorPoint, Plane};
use calib_site::{Link, LinkKind, LinkObservation};

use crate::session::Session;

/// Distance between the floor positions of a link according to two cameras, or the RMS of such distances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkDistance {
    /// Distance, in metres.
    pub metres: f64,
    /// Standard deviation of the distance, in metres, assuming independent cameras; `None` if the uncertainty of
    /// a camera is unknown.
    pub sigma: Option<f64>,
}

impl LinkDistance {
    /// Whether the distance exceeds three standard deviations.
    #[must_use]
    pub fn is_significant(self) -> bool {
        self.z_score() > 3.0
    }

    /// Returns the distance divided by its standard deviation; 0 if the standard deviation is unknown.
    fn z_score(self) -> f64 {
        self.sigma.map_or(0.0, |sigma| self.metres / sigma)
    }
}

/// Returns the distance between the floor positions of a point link, for the pair of cameras with the most
/// significant distance. `None` for other links, and with fewer than two placed cameras.
#[must_use]
pub fn link_distance(session: &Session, link: &Link) -> Option<LinkDistance> {
    if link.kind != LinkKind::Point {
        return None;
    }
    let plane = plane_of(session, link);
    let places: Vec<_> = link.seen.iter().filter_map(|seen| floor_position(session, seen, &plane)).collect();
    let pairs = places.iter().enumerate().flat_map(|(i, a)| places[..i].iter().map(move |b| (a, b)));
    let far = pairs.map(|(a, b)| LinkDistance {
        metres: a.0.distance(b.0),
        sigma: a.1.zip(b.1).map(|(a, b)| a.hypot(b)),
    });
    far.max_by(|a, b| a.z_score().total_cmp(&b.z_score()).then(a.metres.total_cmp(&b.metres)))
}

/// Returns the plane of a link, raised by the height of the link.
fn plane_of(session: &Session, link: &Link) -> Plane {
    let plane = session.solved.plane(&session.site, link.plane.as_deref());
    plane.raised(link.height_m.unwrap_or(0.0))
}

/// Returns the floor position of a point observation and its standard deviation in the worst direction, in
/// metres. `None` if the camera is not placed.
fn floor_position(
    session: &Session,
    seen: &LinkObservation,
    plane: &Plane,
) -> Option<(FloorPoint, Option<f64>)> {
    let index = session.site.cameras.iter().position(|camera| camera.id == seen.camera)?;
    let (camera, px) = (session.solved.placed_pose(index)?, seen.px?);
    let drawn = seen.sigma_px.or(session.site.cameras[index].sigma_px).unwrap_or(1.0);
    let sigma = camera.floor_covariance(px, drawn).and_then(|covariance| covariance.worst_sigma());
    Some((camera.pixel_to_plane(px, plane)?.on_floor(), sigma))
}

/// Returns the RMS floor distance of the point links that two cameras share, and its standard deviation.
pub(crate) fn pair_link_distance(session: &Session, pair: [usize; 2]) -> Option<LinkDistance> {
    if !pair.iter().all(|&camera| session.site.owns_links(camera)) {
        return None;
    }
    let both = |link: &Link| {
        let plane = plane_of(session, link);
        let [a, b] = pair.map(|camera| {
            let id = &session.site.cameras.get(camera)?.id;
            floor_position(session, link.seen.iter().find(|seen| seen.camera == *id)?, &plane)
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
    (!all.is_empty()).then(|| LinkDistance { metres: rms(&mut all.iter().map(|(metres, _)| *metres)), sigma })
}

/// Returns the RMS distance between a camera's line links and the same lines according to the other cameras,
/// in pixels of its image. Also returns the number of lines. `None` if no placed camera shares a line.
#[must_use]
pub fn line_distance_rms(session: &Session, camera: usize) -> Option<(f64, usize)> {
    if !session.site.owns_links(camera) {
        return None;
    }
    let lines = session.site.links.iter().filter(|link| !link.off && link.kind == LinkKind::Line);
    let all: Vec<Vec<f64>> =
        lines.map(|link| line_distances(session, link, camera)).filter(|off| !off.is_empty()).collect();
    let count = all.iter().flatten().count() as f64;
    let square: f64 = all.iter().flatten().map(|px| px * px).sum();
    (count > 0.0).then(|| ((square / count).sqrt(), all.len()))
}

/// Returns the distances between the points of a line link that `camera` observes and the same line according
/// to every other camera, in pixels.
fn line_distances(session: &Session, link: &Link, camera: usize) -> Vec<f64> {
    let plane = plane_of(session, link);
    let id = &session.site.cameras[camera].id;
    let Some(own) = session.solved.placed_pose(camera) else { return Vec::new() };
    let position = |seen: &LinkObservation| {
        let index = session.site.cameras.iter().position(|camera| camera.id == seen.camera)?;
        let other = session.solved.placed_pose(index)?;
        let points = seen.segment.as_ref()?;
        let [a, b] = [points.first()?, points.last()?].map(|&px| other.pixel_to_plane(px, &plane));
        FloorLine::between(a?.on_floor(), b?.on_floor())
    };
    let lines: Vec<FloorLine> =
        link.seen.iter().filter(|seen| seen.camera != *id).filter_map(position).collect();
    let drawn =
        link.seen.iter().filter(|seen| seen.camera == *id).flat_map(|seen| seen.segment.iter().flatten());
    drawn
        .flat_map(|&px| {
            lines.iter().filter_map(move |line| Some(line.nearest(own, px, &plane)?.1.distance(px)))
        })
        .collect()
}

/// Returns the RMS floor distance of the point links that two cameras share, in metres. `poses` contains the
/// pose of every camera.
#[must_use]
pub fn pair_rms_distance(session: &Session, poses: &[Option<Camera>], pair: [usize; 2]) -> Option<f64> {
    if !pair.iter().all(|&camera| session.site.owns_links(camera)) {
        return None;
    }
    let position = |link: &Link, camera: usize| {
        let id = &session.site.cameras.get(camera)?.id;
        let seen = link.seen.iter().find(|seen| seen.camera == *id)?;
        let position = poses.get(camera)?.as_ref()?.pixel_to_plane(seen.px?, &plane_of(session, link))?;
        Some(position.on_floor())
    };
    let points = session.site.links.iter().filter(|link| !link.off && link.kind == LinkKind::Point);
    let squares: Vec<f64> = points
        .filter_map(|link| Some(position(link, pair[0])?.distance(position(link, pair[1])?).powi(2)))
        .collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}

/// Returns the number of a camera's point links whose distance exceeds three standard deviations, and the
/// number of all its point links with a distance.
#[must_use]
pub fn inconsistent_links(session: &Session, camera: usize) -> (usize, usize) {
    if !session.site.owns_links(camera) {
        return (0, 0);
    }
    let id = &session.site.cameras[camera].id;
    let own = |link: &&Link| !link.off && link.seen.iter().any(|seen| seen.camera == *id);
    let known = session.site.links.iter().filter(own).filter_map(|link| link_distance(session, link));
    known.fold((0, 0), |(far, all), apart| (far + usize::from(apart.is_significant()), all + 1))
}

/// Overlap of the fields of view of two cameras, and distance between the positions that both compute for their
/// shared links.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// Index of the other camera.
    pub other: usize,
    /// Fraction of the camera's field of view that the other one covers, 0 to 1.
    pub overlap: f64,
    /// RMS distance of the shared point links; `None` without shared links.
    pub distance: Option<LinkDistance>,
    /// RMS distance of the shared point links with earlier poses, in metres; `None` without earlier poses.
    pub distance_before_m: Option<f64>,
}

/// Returns the agreement of a placed camera with every camera that shares floor or links with it. The order
/// is that of the site, so that it is stable while a camera is dragged. `before` contains the earlier poses
/// of all cameras, or is empty.
#[must_use]
pub fn agreements(session: &Session, camera: usize, before: &[Option<Camera>]) -> Vec<Agreement> {
    // Links belong to the image of the newest period; an ended calibration period has no links.
    let Some(own) = efov_of(session, camera).filter(|_| session.site.owns_links(camera)) else {
        return Vec::new();
    };
    let (inside, linked) = (points_within(own), linked_cameras(session, camera));
    let of = |with: usize| {
        let other = efov_of(session, with)?;
        let overlap = covered_fraction(&inside, other);
        let is_linked = linked.contains(&*session.site.cameras[with].id);
        let both = is_linked.then_some([camera, with]);
        let apart = both.and_then(|both| pair_link_distance(session, both));
        let before = both.and_then(|both| pair_rms_distance(session, before, both));
        Some(Agreement { other: with, overlap, distance: apart, distance_before_m: before })
    };
    let others =
        (0..session.site.cameras.len()).filter(|&with| with != camera && session.site.owns_links(with));
    let others = others.filter_map(of);
    others.filter(|found| found.overlap > 0.0 || found.distance.is_some()).collect()
}

/// Returns the ids of the cameras that share a link with a camera, including the camera itself.
fn linked_cameras(session: &Session, camera: usize) -> BTreeSet<&str> {
    let own = &session.site.cameras[camera].id;
    let links = session.site.links.iter().filter(|link| link.seen.iter().any(|seen| seen.camera == *own));
    links.flat_map(|link| &link.seen).map(|seen| &*seen.camera).collect()
}

/// Returns the EFOV of a placed camera as a polygon in floor metres.
fn efov_of(session: &Session, camera: usize) -> Option<&[FloorPoint]> {
    session.solved.placed_pose(camera)?;
    session.solved.solution(camera).map(|solution| &*solution.efov_m)
}

/// Returns the points of a regular grid over the bounding box of a polygon that are inside the polygon.
fn points_within(polygon: &[FloorPoint]) -> Vec<FloorPoint> {
    /// Number of grid points along each side of the bounding box. A covered fraction is then accurate to 1 or 2 %.
    const GRID_POINTS_PER_SIDE: usize = 32;
    let [low, high] = bounds(polygon);
    let at =
        |i: usize, low: f64, high: f64| low + (i as f64 + 0.5) / GRID_POINTS_PER_SIDE as f64 * (high - low);
    let extent = Extent { size: [0.0; 2], efov: polygon };
    (0..GRID_POINTS_PER_SIDE * GRID_POINTS_PER_SIDE)
        .map(|k| FloorPoint {
            x: at(k % GRID_POINTS_PER_SIDE, low.x, high.x),
            y: at(k / GRID_POINTS_PER_SIDE, low.y, high.y),
        })
        .filter(|&point| extent.contains(point))
        .collect()
}

/// Returns the fraction of the points that are inside a polygon, 0 to 1.
fn covered_fraction(points: &[FloorPoint], polygon: &[FloorPoint]) -> f64 {
    let [low, high] = bounds(polygon);
    let is_near = |p: &&FloorPoint| p.x >= low.x && p.x <= high.x && p.y >= low.y && p.y <= high.y;
    let extent = Extent { size: [0.0; 2], efov: polygon };
    let seen = points.iter().filter(is_near).filter(|&&point| extent.contains(point)).count();
    seen as f64 / points.len().max(1) as f64
}

/// Returns the lower and the upper corner of the bounding box of a polygon.
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
    fn wrong_link_is_inconsistent() {
        let mut site = calib_demo::demo_site().site;
        let is_point = |link: &&mut Link| link.kind == LinkKind::Point && link.seen.len() > 1;
        let link = site.links.iter_mut().find(is_point).unwrap();
        let (id, camera) = (link.id.clone(), link.seen[0].camera.clone());
        let before = Session::new(calib_demo::demo_site().site, Images::default(), None);
        let index = before.site.cameras.iter().position(|known| known.id == camera).unwrap();
        let (far, all) = inconsistent_links(&before, index);
        assert!(all > 0 && far < all, "{far} of {all}");
        link.seen[0].px.as_mut().unwrap().u += 300.0;
        let after = Session::new(site, Images::default(), None);
        let moved = after.site.links.iter().find(|link| link.id == id).unwrap();
        assert!(link_distance(&after, moved).unwrap().is_significant());
        assert!(inconsistent_links(&after, index).0 > far);
    }

    fn session() -> Session {
        Session::new(calib_demo::demo_site().site, Images::default(), None)
    }

    #[test]
    fn overlap_equals_the_fraction_of_the_area() {
        let square = |x: f64, side: f64| {
            [[x, 0.0], [x + side, 0.0], [x + side, side], [x, side]].map(|[x, y]| FloorPoint { x, y })
        };
        let own = points_within(&square(0.0, 4.0));
        for (x, side, wanted) in [(0.0, 4.0, 1.0), (3.0, 4.0, 0.25), (0.0, 2.0, 0.25), (4.5, 4.0, 0.0)] {
            let found = covered_fraction(&own, &square(x, side));
            assert!((found - wanted).abs() < 0.02, "{found}, not {wanted}");
        }
    }

    #[test]
    fn moved_camera_agrees_less_and_keeps_the_previous_distance() {
        let session = session();
        let poses: Vec<Option<Camera>> =
            (0..session.site.cameras.len()).map(|i| session.solved.placed_pose(i).copied()).collect();
        let shares = |camera: usize, session: &Session| {
            let all = agreements(session, camera, &poses);
            all.into_iter().find(|found| found.distance.is_some())
        };
        let camera = (0..poses.len()).find(|&i| shares(i, &session).is_some()).unwrap();
        let before = shares(camera, &session).unwrap();
        assert_eq!(before.distance.map(|apart| apart.metres), before.distance_before_m, "nothing was moved");
        let mut site = session.site.clone();
        site.cameras[camera].control_points.clear();
        site.cameras[camera].placement =
            session.solved.placed_pose(camera).map(|pose| calib_site::PlacementEntry {
                move_m: FloorPoint { x: pose.position.x + 0.5, y: pose.position.y },
                turn_deg: pose.yaw.to_degrees(),
                scale: Some(pose.position.z / calib_core::floor::STAGE_1_HEIGHT),
                fixed: false,
                held: calib_site::FixedEntry::default(),
                estimated: false,
            });
        let moved = Session::new(site, Images::default(), None);
        let after = agreements(&moved, camera, &poses);
        let after = after.into_iter().find(|found| found.other == before.other).unwrap();
        let [then, now] = [&before, &after].map(|found| found.distance.unwrap().metres);
        // All floor points of the camera moved by 0.5 m, so the new distance is at least 0.5 m minus the old one.
        assert!(now > then && now >= 0.5 - then - 1e-6, "{before:?}, {after:?}");
        assert_eq!(after.distance_before_m, before.distance_before_m);
    }
}
