//! Effective field of view (EFOV): the polygon on the image, and its part on the floor.

use std::f64::consts::TAU;

use crate::camera::{Camera, FloorPoint, Pixel, Plane};

/// Effective field of view (EFOV) on the floor.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Efov {
    /// Corners on the floor, in metres, in the order of the annotation.
    pub polygon: Vec<FloorPoint>,
    /// Whether a part of the polygon was clipped at the horizon, at the reach, or outside the lens.
    pub clipped: bool,
}

/// Largest distance of an annotated EFOV from the foot of the camera, in camera heights. Farther away, a pixel
/// covers more floor than any object.
const MAX_ANNOTATED_REACH: f64 = 50.0;
/// Largest distance of a default EFOV from the foot of the camera, in camera heights.
const MAX_DEFAULT_REACH: f64 = 5.0;
/// Number of points for each edge of the image polygon, so that the polygon on the floor follows the
/// distorted edge.
const POINTS_PER_EDGE: usize = 8;

/// Projects the part of an image polygon that is on the floor and nearer than 50 camera heights to the foot
/// of the camera.
///
/// Points are added between the corners if the lens has distortion.
#[must_use]
pub fn efov_on_floor(camera: &Camera, corners: &[Pixel]) -> Efov {
    efov_on_plane(camera, corners, &Plane::FLOOR)
}

/// Projects an image polygon to a plane as [`efov_on_floor`] does. The result contains x and y of the corners.
#[must_use]
pub fn efov_on_plane(camera: &Camera, corners: &[Pixel], plane: &Plane) -> Efov {
    on_plane(camera, corners, plane, MAX_ANNOTATED_REACH)
}

/// Returns the default EFOV: the visible part of the floor that is nearer than five camera heights to the foot
/// of the camera. [`Efov::clipped`] is always `false`.
#[must_use]
pub fn default_efov(camera: &Camera, size: [f64; 2]) -> Efov {
    let [w, h] = size;
    let corners = [[0.0, h], [w, h], [w, 0.0], [0.0, 0.0]].map(Pixel::from);
    Efov { clipped: false, ..on_plane(camera, &corners, &Plane::FLOOR, MAX_DEFAULT_REACH) }
}

/// Projects an image polygon to a plane, clipped at `reach` camera heights from the foot of the camera.
fn on_plane(camera: &Camera, corners: &[Pixel], plane: &Plane, reach: f64) -> Efov {
    if camera.lens.distortion.is_wide() {
        return project_wide_polygon(camera, corners, plane, reach);
    }
    let bent = camera.lens.distortion != crate::camera::Distortion::None;
    let outline = outline(corners, if bent { POINTS_PER_EDGE } else { 1 });
    let lost = outline.iter().any(|&pixel| camera.lens.bearing(pixel).is_none());
    let seen = |&pixel: &Pixel| camera.lens.bearing(last_visible_pixel(camera, pixel)?);
    let bearings: Vec<[f64; 3]> = outline.iter().filter_map(seen).collect();
    // In homogeneous floor coordinates (x w, y w, w) the horizon is w = 0, and clipping is linear.
    let h = camera.homography_plane_from_pixel(plane);
    let drop = camera.position.z - plane.height_at(camera.position.on_floor());
    let Pixel { u: cu, v: cv } = camera.lens.principal_point;
    let homogeneous: Vec<[f64; 3]> = bearings
        .iter()
        .map(|[x, y, w]| {
            let [x, y, w] = h.map(|row| row[0] * (x + cu * w) + row[1] * (y + cv * w) + row[2] * w);
            // The origin is the foot of the camera, so the reach is a circle around the origin.
            [x - w * camera.position.x, y - w * camera.position.y, w]
        })
        .collect();
    // First clip at a minimum w, below the w of a floor point at the reach. Then clip at the circle.
    let ahead = homogeneous.iter().fold(0.0_f64, |most, [x, y, _]| most.max(x.hypot(*y)));
    let least = ahead / (drop.abs() * reach * 1e3) + f64::MIN_POSITIVE;
    let in_front = clip(&homogeneous, |[_, _, w]| w - least);
    let mut polygon: Vec<[f64; 3]> = in_front.clone();
    // A regular polygon of half planes approximates the circle.
    const SIDES: usize = 32;
    for side in 0..SIDES {
        let (sin, cos) = (TAU * side as f64 / SIDES as f64).sin_cos();
        polygon = clip(&polygon, |[x, y, w]| w * drop.abs() * reach - (x * cos + y * sin));
    }
    let clipped = lost || polygon != homogeneous;
    let polygon = polygon
        .into_iter()
        .map(|[x, y, w]| FloorPoint { x: camera.position.x + x / w, y: camera.position.y + y / w })
        .filter(|point| point.is_finite())
        .collect();
    Efov { polygon, clipped }
}

/// Returns the outline of a polygon, with `steps` points for each edge.
fn outline(corners: &[Pixel], steps: usize) -> Vec<Pixel> {
    let edges = corners.iter().zip(corners.iter().cycle().skip(1));
    edges.flat_map(|(&a, &b)| (0..steps).map(move |step| between(a, b, step as f64 / steps as f64))).collect()
}

/// Returns the pixel at the fraction `t` of the way from `a` to `b`.
fn between(a: Pixel, b: Pixel, t: f64) -> Pixel {
    Pixel { u: a.u + t * (b.u - a.u), v: a.v + t * (b.v - a.v) }
}

/// Returns the pixel itself if the lens shows a ray there. Otherwise returns the last visible pixel on the way
/// from the principal point to it. Returns `None` if the principal point is not visible.
fn last_visible_pixel(camera: &Camera, pixel: Pixel) -> Option<Pixel> {
    let centre = camera.lens.principal_point;
    let is_seen = |raw: Pixel| camera.lens.bearing(raw).is_some();
    if is_seen(pixel) {
        return Some(pixel);
    }
    is_seen(centre).then(|| bisect_border(centre, pixel, is_seen)[0])
}

/// Returns the last pixel on the way for which the condition `holds`, and the next one for which it does not,
/// by bisection. The condition must hold at `from`, and not at `to`.
fn bisect_border(from: Pixel, to: Pixel, holds: impl Fn(Pixel) -> bool) -> [Pixel; 2] {
    /// Number of bisection steps.
    const HALVINGS: usize = 40;
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if holds(between(from, to, middle)) { low = middle } else { high = middle }
    }
    [low, high].map(|t| between(from, to, t))
}

/// Whether a pixel is inside a polygon.
fn is_within(pixel: Pixel, corners: &[Pixel]) -> bool {
    let crosses = |(a, b): (&Pixel, &Pixel)| {
        (a.v > pixel.v) != (b.v > pixel.v) && pixel.u < a.u + (pixel.v - a.v) / (b.v - a.v) * (b.u - a.u)
    };
    corners.iter().zip(corners.iter().cycle().skip(1)).filter(|pair| crosses(*pair)).count() % 2 == 1
}

/// Returns twice the signed area of a polygon, positive for the rotation from the u axis to the v axis.
fn doubled_signed_area(corners: &[Pixel]) -> f64 {
    corners.iter().zip(corners.iter().cycle().skip(1)).map(|(a, b)| a.u * b.v - a.v * b.u).sum()
}

/// Projects an image polygon of a wide lens to a plane, within `reach` camera heights of the foot of the
/// camera. Clipping at the horizon is not possible, because points behind the camera are visible in the
/// image.
///
/// The result contains the floor points of the outline that are within the reach. Between an exit of the outline
/// from the reach and its next entry, the result contains the arc of the circle of the reach. It keeps the
/// orientation of the outline.
fn project_wide_polygon(camera: &Camera, corners: &[Pixel], plane: &Plane, reach: f64) -> Efov {
    /// Number of points for each edge of the outline.
    const WIDE_POINTS_PER_EDGE: usize = 32;
    /// Number of points on the circle of the reach.
    const CIRCLE_POINTS: f64 = 64.0;
    let foot = camera.position.on_floor();
    let drop = camera.position.z - plane.height_at(foot);
    let most = reach * drop.abs();
    let floor = |pixel: Pixel| {
        let at = camera.pixel_to_plane(pixel, plane)?.on_floor();
        (at.distance(foot) <= most).then_some(at)
    };
    let angle = |at: FloorPoint| (at.y - foot.y).atan2(at.x - foot.x);
    let on_circle =
        |angle: f64| FloorPoint { x: foot.x + most * angle.cos(), y: foot.y + most * angle.sin() };
    let drawn = outline(corners, WIDE_POINTS_PER_EDGE);
    let seen: Vec<Pixel> = drawn.iter().filter_map(|&pixel| last_visible_pixel(camera, pixel)).collect();
    let clipped = drawn.iter().any(|&pixel| floor(pixel).is_none());
    // v is downwards, so the orientation on the floor, seen from above, is opposite to the orientation on the
    // image.
    let way = -(doubled_signed_area(corners) * drop).signum();
    let Some(first) = seen.iter().position(|&pixel| floor(pixel).is_some()) else {
        let below = camera.world_to_pixel(foot.at_height(plane.height_at(foot)));
        let is_all = below.is_some_and(|pixel| is_within(pixel, corners));
        let round =
            (0..if is_all { CIRCLE_POINTS as usize } else { 0 }).map(|step| step as f64 / CIRCLE_POINTS);
        return Efov { polygon: round.map(|turns| on_circle(way * turns * TAU)).collect(), clipped };
    };
    let mut polygon = Vec::new();
    let mut left = None;
    for step in 0..seen.len() {
        let [here, next] = [step, step + 1].map(|step| seen[(first + step) % seen.len()]);
        polygon.extend(floor(here));
        match (floor(here), floor(next)) {
            (Some(_), None) => {
                let last = floor(bisect_border(here, next, |pixel| floor(pixel).is_some())[0]);
                left = last.map(angle);
                polygon.extend(last);
            }
            (None, Some(_)) => {
                let back = floor(bisect_border(here, next, |pixel| floor(pixel).is_none())[1]);
                if let (Some(from), Some(to)) = (left.take(), back.map(angle)) {
                    let round = (way * (to - from)).rem_euclid(TAU);
                    let steps = (round / TAU * CIRCLE_POINTS) as usize;
                    polygon.extend(
                        (1..=steps)
                            .map(|step| on_circle(from + way * round * step as f64 / (steps + 1) as f64)),
                    );
                }
                polygon.extend(back);
            }
            _ => {}
        }
    }
    Efov { polygon, clipped }
}

/// Returns the part of a homogeneous polygon where `inside` is not negative (Sutherland and Hodgman 1974).
fn clip(polygon: &[[f64; 3]], inside: impl Fn([f64; 3]) -> f64) -> Vec<[f64; 3]> {
    let mut kept = Vec::with_capacity(polygon.len() + 2);
    for (i, &here) in polygon.iter().enumerate() {
        let before = polygon[(i + polygon.len() - 1) % polygon.len()];
        let (at_before, at_here) = (inside(before), inside(here));
        if (at_before < 0.0) != (at_here < 0.0) {
            let t = at_before / (at_before - at_here);
            kept.push(std::array::from_fn(|k| before[k] + t * (here[k] - before[k])));
        }
        if at_here >= 0.0 {
            kept.push(here);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::camera::{Distortion, Lens, WorldPoint};

    fn camera(pitch: f64) -> Camera {
        Camera {
            position: WorldPoint::new(4.0, -2.0, 3.0),
            yaw: 0.7,
            pitch,
            roll: 0.05,
            focal: 1000.0,
            lens: Lens::pinhole(Pixel::new(960.0, 540.0)),
            covariance: crate::camera::Covariance::EXACT,
        }
    }

    #[test]
    fn a_polygon_below_the_horizon_keeps_its_corners() {
        let camera = camera(0.6);
        let corners = [[100.0, 1000.0], [1800.0, 1000.0], [1500.0, 400.0], [400.0, 400.0]].map(Pixel::from);
        let efov = efov_on_floor(&camera, &corners);
        assert!(!efov.clipped);
        for (floor, pixel) in efov.polygon.iter().zip(corners) {
            assert!(camera.world_to_pixel(floor.at_height(0.0)).unwrap().distance(pixel) < 1e-6);
        }
    }

    #[test]
    fn a_polygon_that_crosses_the_horizon_is_cut_before_it() {
        let camera = camera(0.1);
        let corners = [[100.0, 1000.0], [1800.0, 1000.0], [1800.0, 0.0], [100.0, 0.0]].map(Pixel::from);
        let efov = efov_on_floor(&camera, &corners);
        assert!(efov.clipped && efov.polygon.len() > 4);
        for point in efov.polygon {
            let range = point.distance(camera.position.on_floor());
            assert!(range < 3.0 * MAX_ANNOTATED_REACH * 1.01, "{range} m is beyond the reach");
        }
    }

    #[test]
    fn polygon_above_the_horizon_is_empty() {
        let corners = [[100.0, 100.0], [1800.0, 100.0], [1800.0, 0.0]].map(Pixel::from);
        let efov = efov_on_floor(&camera(-0.3), &corners);
        assert!(efov.clipped && efov.polygon.is_empty());
    }

    #[test]
    fn a_fisheye_on_the_ceiling_shows_the_floor_all_around() {
        let lens = Lens {
            focal: 334.0,
            distortion: Distortion::KannalaBrandt { k: [0.0; 4] },
            ..Lens::pinhole(Pixel::new(960.0, 540.0))
        };
        let above = Camera { pitch: std::f64::consts::FRAC_PI_2, roll: 0.0, lens, ..camera(0.0) };
        let efov = default_efov(&above, [1920.0, 1080.0]);
        assert!(efov.polygon.len() >= 8, "{efov:?}");
        for point in &efov.polygon {
            let off = point.distance(above.position.on_floor());
            assert!((14.0..15.5).contains(&off), "{off} m: five camera heights all around");
        }
    }

    #[test]
    fn fisheye_beyond_the_horizon_has_disc_efov_and_ring_horizon() {
        let lens = Lens {
            focal: 300.0,
            distortion: Distortion::KannalaBrandt { k: [0.01, 0.0, 0.0, 0.0] },
            ..Lens::pinhole(Pixel::new(960.0, 540.0))
        };
        let above = Camera { pitch: 1.45, roll: 0.3, lens, focal: 300.0, ..camera(0.0) };
        let disc: Vec<Pixel> = (0..24)
            .map(|i| (TAU * f64::from(i) / 24.0).sin_cos())
            .map(|(sin, cos)| Pixel::new(960.0 + 530.0 * cos, 540.0 + 530.0 * sin))
            .collect();
        let efov = efov_on_floor(&above, &disc);
        assert!(efov.clipped, "the horizon is within");
        for point in &efov.polygon {
            let off = point.distance(above.position.on_floor());
            assert!((off - 50.0 * above.position.z).abs() < 1e-3, "{off} m: the reach all around");
        }
        let ring = crate::floor::image_curve::horizon(&above, [1920.0, 1080.0]);
        assert_eq!(ring.len(), 1);
        for &pixel in &ring[0] {
            assert!(above.pixel_to_ray(pixel).unwrap().direction[2].abs() < 1e-6);
        }
    }

    proptest! {
        #[test]
        fn efov_of_wide_lens_is_the_visible_floor(
            (pitch, roll) in (0.0..1.57, -0.5..0.5),
            k in [-0.03..0.03, -0.01..0.01, -0.005..0.005, -0.002..0.002],
            focal in 250.0..900.0,
            cut in [0.0..0.4, 0.0..0.4, 0.6..1.0, 0.6..1.0],
            mirrored in any::<bool>(),
        ) {
            let lens = Lens { focal, distortion: Distortion::KannalaBrandt { k }, ..Lens::pinhole(Pixel::new(960.0, 540.0)) };
            let camera = Camera { pitch, roll, focal, lens, ..camera(0.0) };
            let [left, top, right, bottom] = [cut[0] * 1920.0, cut[1] * 1080.0, cut[2] * 1920.0, cut[3] * 1080.0];
            let mut corners = [[left, bottom], [right, bottom], [right, top], [left, top]].map(Pixel::from);
            if mirrored {
                corners.reverse();
            }
            let efov = on_plane(&camera, &corners, &Plane::FLOOR, 5.0);
            let flat = |at: &FloorPoint| Pixel::new(at.x, at.y);
            let polygon: Vec<Pixel> = efov.polygon.iter().map(flat).collect();
            let foot = camera.position.on_floor();
            let shows = |at: FloorPoint| camera.world_to_pixel(at.at_height(0.0)).is_some_and(|pixel| is_within(pixel, &corners));
            for i in 0..400 {
                let off = 14.7 * (f64::from(i) / 400.0).sqrt();
                let beside = |at: FloorPoint, angle: f64, by: f64| FloorPoint { x: at.x + by * angle.cos(), y: at.y + by * angle.sin() };
                let at = beside(foot, 2.4 * f64::from(i), off);
                // Between two points of the outline, the border deviates from a straight line.
                let is_off_the_edges = camera.world_to_pixel(at.at_height(0.0)).is_none_or(|pixel| {
                    [pixel.u - left, pixel.u - right, pixel.v - top, pixel.v - bottom].iter().all(|by| by.abs() > 3.0)
                });
                let is_off_the_rim = (0..8).all(|side| shows(beside(at, TAU * f64::from(side) / 8.0, 0.2 + 0.1 * off)) == shows(at));
                let is_clear = is_off_the_edges && is_off_the_rim;
                prop_assert!(!is_clear || is_within(flat(&at), &polygon) == shows(at), "{at:?}");
            }
        }
    }
}
