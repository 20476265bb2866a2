//! Tests of the demonstration site against the truth: annotations match the scene and their stated
//! properties.

use calib_core::{Annotation, Camera, Distortion, Kind, MarkShape, Pixel};

use calib_core::floor::STAGE_1_HEIGHT;

use calib_site::{LinkObservation, Site, SiteCamera};

use crate::element::marks;
use crate::hand::TREMOR;
use crate::shape::Line;
use crate::site::cameras;
use crate::site::{KnownLens, site};
use crate::vector::{Vec3, vec3};
use crate::world::{is_inside, world};

/// Largest direction error, in radians, that rounding to a hundredth of a pixel causes. It applies to lines
/// of at least a hundred pixels.
const MAX_ROUNDING_ERROR_RAD: f64 = 2e-3;

/// Returns the true cameras, and the site entries with annotations without tremor.
fn exact_entries() -> Vec<(Camera, SiteCamera)> {
    let truth = cameras().into_iter().map(|(_, camera, _)| camera);
    truth.zip(site(KnownLens::Given, 0.0).cameras).collect()
}

/// Returns the direction of a level line in the plane of the rays of a segment's ends: a unit vector of x and
/// y.
fn level_direction(camera: &Camera, segment: &[Pixel]) -> [f64; 2] {
    let ray = |pixel: &Pixel| camera.pixel_to_ray(*pixel).unwrap().direction;
    let (a, b) = (ray(&segment[0]), ray(segment.last().unwrap()));
    let normal = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2]];
    let length = normal[0].hypot(normal[1]);
    [-normal[1] / length, normal[0] / length]
}

/// Returns the absolute cross product of two directions.
fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] * b[1] - a[1] * b[0]).abs()
}

/// Returns the largest deviation of points from a straight line after undistortion. It is the angle between
/// the ray of a point and the plane of the rays of both end points, times the focal length, in pixels.
fn straightness_error(camera: &Camera, points: &[Pixel]) -> f64 {
    let rays: Vec<Vec3> = points.iter().map(|&p| ray(camera, p)).collect();
    let plane = normal(rays[0], rays[rays.len() - 1]);
    rays.iter().map(|ray| f64::from(ray.dot(plane).abs()) * camera.focal).fold(0.0, f64::max)
}

fn ray(camera: &Camera, pixel: Pixel) -> Vec3 {
    let [x, y, z] = camera.pixel_to_ray(pixel).unwrap().direction;
    vec3(x as f32, y as f32, z as f32)
}

/// Returns the unit normal of the plane of two rays.
fn normal(a: Vec3, b: Vec3) -> Vec3 {
    vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x).unit()
}

fn of_kind(camera: &SiteCamera, kind: Kind) -> impl Iterator<Item = &Annotation> {
    camera.annotations.iter().filter(move |annotation| annotation.kind == kind)
}

#[test]
fn the_site_is_valid_and_round_trips() {
    for lens in [KnownLens::Given, KnownLens::Fitted] {
        let site = site(lens, TREMOR);
        assert_eq!(site.check(), Ok(()));
        assert_eq!(Site::from_json(&site.to_json()), Ok(site));
    }
}

#[test]
fn the_tremor_is_within_four_sigmas() {
    let pixels = |camera: &SiteCamera| -> Vec<Pixel> {
        camera.annotations.iter().flat_map(Annotation::polylines).flatten().collect()
    };
    let shaken = site(KnownLens::Given, TREMOR);
    for ((_, clean), shaken) in exact_entries().iter().zip(&shaken.cameras) {
        assert_eq!(pixels(clean).len(), pixels(shaken).len(), "{}", clean.id);
        for (a, b) in pixels(clean).iter().zip(pixels(shaken)) {
            let off = (a.u - b.u).abs().max((a.v - b.v).abs());
            assert!(off < 4.0 * TREMOR + 0.01, "{off} on {}", clean.id);
        }
    }
}

#[test]
fn verticals_are_vertical_and_parallels_are_parallel() {
    for (camera, entry) in exact_entries() {
        for segment in of_kind(&entry, Kind::Vertical).flat_map(Annotation::polylines) {
            let plane = normal(ray(&camera, segment[0]), ray(&camera, segment[segment.len() - 1]));
            assert!(plane.z.abs() < MAX_ROUNDING_ERROR_RAD as f32, "{} on {}", plane.z, entry.id);
        }
        let directions: Vec<Vec<[f64; 2]>> = of_kind(&entry, Kind::Parallel)
            .map(|annotation| annotation.polylines().map(|line| level_direction(&camera, &line)).collect())
            .collect();
        let (along, across) = ([1.0, 0.0], [0.0, 1.0]);
        for (direction, axis) in directions.iter().zip([along, across]) {
            assert!((3..=4).contains(&direction.len()), "{} has {} lines", entry.id, direction.len());
            for line in direction {
                assert!(cross(*line, axis) < 5.0 * MAX_ROUNDING_ERROR_RAD, "{line:?} on {}", entry.id);
            }
        }
        for pair in of_kind(&entry, Kind::Perpendicular) {
            let lines: Vec<[f64; 2]> = pair.polylines().map(|line| level_direction(&camera, &line)).collect();
            assert!(
                (lines[0][0] * lines[1][0] + lines[0][1] * lines[1][1]).abs() < 5.0 * MAX_ROUNDING_ERROR_RAD,
                "{}",
                entry.id
            );
        }
    }
}

#[test]
fn lengths_and_heights_match_their_stated_values() {
    for (camera, entry) in exact_entries() {
        let length = |line: &[Pixel]| {
            let floor = |p: &Pixel| camera.pixel_to_floor(*p, 0.0).unwrap();
            floor(&line[0]).distance(floor(line.last().unwrap()))
        };
        for line in of_kind(&entry, Kind::EqualLength).flat_map(Annotation::polylines) {
            assert!((length(&line) - 1.8).abs() < 0.01, "{} on {}", length(&line), entry.id);
        }
        for annotation in of_kind(&entry, Kind::KnownLength) {
            let line = annotation.polylines().next().unwrap();
            assert!((length(&line) - annotation.length_m.unwrap()).abs() < 0.01, "{}", entry.id);
        }
        for annotation in of_kind(&entry, Kind::Upright) {
            let foot = camera.pixel_to_floor(annotation.foot.unwrap(), 0.0).unwrap();
            let known = annotation.height_m.unwrap();
            let head = camera.world_to_pixel(foot.at_height(known.value)).unwrap();
            let scale =
                camera.world_to_pixel(foot.at_height(known.value + 0.1)).unwrap().distance(head) / 0.1;
            assert!(head.distance(annotation.head.unwrap()) < 2.0 * known.sigma.unwrap() * scale);
        }
    }
}

#[test]
fn straight_edges_are_straight_after_undistortion() {
    for (camera, entry) in exact_entries() {
        let bent = camera.lens.distortion != Distortion::None;
        let lines: Vec<Vec<Pixel>> =
            of_kind(&entry, Kind::Straight).flat_map(Annotation::polylines).collect();
        assert_eq!(bent, (5..=9).contains(&lines.len()), "{}: {}", entry.id, lines.len());
        for line in lines {
            assert!(
                (6..=10).contains(&line.len()) && straightness_error(&camera, &line) < 0.05,
                "{}",
                entry.id
            );
        }
    }
}

#[test]
fn placement_errors_are_small() {
    for (camera, entry) in exact_entries() {
        let placed = entry.placement.unwrap();
        assert!(placed.move_m.distance(camera.position.on_floor()) < 0.11, "{}", entry.id);
        assert!((placed.turn_deg - camera.yaw.to_degrees()).abs() < 0.42, "{}", entry.id);
        assert!(
            (placed.scale.unwrap() * STAGE_1_HEIGHT / camera.position.z - 1.0).abs() < 0.01,
            "{}",
            entry.id
        );
    }
}

#[test]
fn efovs_lie_on_the_floor_and_inside_the_image() {
    for (camera, entry) in exact_entries() {
        let corners = entry.efov_px.unwrap();
        assert!((4..=6).contains(&corners.len()));
        for corner in corners {
            assert!(is_inside(corner, entry.size_px, 20.0), "{corner:?} on {}", entry.id);
            let floor = camera.pixel_to_floor(corner, 0.0).unwrap();
            assert!(floor.distance(camera.position.on_floor()) < 24.0, "{}", entry.id);
        }
    }
}

#[test]
fn named_points_match_their_projection() {
    let site = site(KnownLens::Given, 0.0);
    let truth = cameras();
    for (entry, (id, camera, _)) in site.cameras.iter().zip(&truth) {
        for point in &entry.control_points {
            let shown = camera.world_to_pixel(point.world_m.unwrap()).unwrap();
            assert!(shown.distance(point.px) < 0.01, "{:?} on {id}", point.id);
        }
    }
    assert!(site.links.len() >= 7);
    for link in &site.links {
        assert!(link.seen.len() >= 2, "{:?}", link.id);
        let floor = |seen: &LinkObservation| {
            let (_, camera, _) = truth.iter().find(|(id, ..)| *id == seen.camera).unwrap();
            camera.pixel_to_floor(seen.px.or(seen.foot).unwrap(), 0.0).unwrap()
        };
        for seen in &link.seen {
            assert!(floor(seen).distance(floor(&link.seen[0])) < 0.01, "{:?}", link.id);
        }
    }
}

#[test]
fn marks_coincide_with_objects() {
    let top = |x: f64, y: f64, from: f32| {
        let line = Line::new(vec3(x as f32, y as f32, from), -Vec3::UP);
        world().tree.nearest(&line, 10.0).map(|hit| from - hit.distance)
    };
    for mark in marks() {
        let MarkShape { at, size, .. } = mark.shape();
        let (height, from) = match mark.id.as_deref() {
            Some("pallet" | "till") => (size[2], 1.3),
            Some("barrel") => (size[1], 1.3),
            Some("customer") => (size[0], 2.5),
            _ => continue,
        };
        // The test uses a point 3 cm beside the centre. At the centre, two cartons may meet.
        let found = top(at.x + 0.03, at.y + 0.03, from).unwrap();
        assert!((f64::from(found) - height).abs() < 0.03, "{:?}: {found} for {height}", mark.id);
    }
}
