//! The effective field of view: the polygon on the image, and the part of it that lies on the floor.

use crate::camera::{Camera, FloorPoint, Pixel, Plane};

/// The floor polygon that an image polygon shows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Efov {
    /// Corners on the floor, in metres, in the order drawn.
    pub polygon: Vec<FloorPoint>,
    /// Whether a part of the polygon was cut off at the horizon, at the reach, or outside the lens.
    pub clipped: bool,
}

/// Largest distance of an EFOV from the foot of the camera, in camera heights, where one was drawn and where
/// none was: beyond it a pixel spans more floor than any object on it.
const REACH_DRAWN: f64 = 50.0;
const REACH_DEFAULT: f64 = 5.0;
/// Points per edge of the image polygon: a bent edge stays bent on the floor.
const STEPS: usize = 8;

/// The part of an image polygon that lies on the floor and nearer than 50 camera heights.
///
/// Between corners the edge is followed through the lens; where it bends, points are added.
#[must_use]
pub fn efov_on_floor(camera: &Camera, corners: &[Pixel]) -> Efov {
    efov_on_plane(camera, corners, &Plane::FLOOR)
}

/// As [`efov_on_floor`], of a polygon that lies on a plane: its corners as seen from above.
#[must_use]
pub fn efov_on_plane(camera: &Camera, corners: &[Pixel], plane: &Plane) -> Efov {
    on_plane(camera, corners, plane, REACH_DRAWN)
}

/// The image's floor part nearer than five camera heights: the EFOV where none was drawn.
#[must_use]
pub fn default_efov(camera: &Camera, size: [f64; 2]) -> Efov {
    let [w, h] = size;
    let corners = [[0.0, h], [w, h], [w, 0.0], [0.0, 0.0]].map(Pixel::from);
    Efov { clipped: false, ..on_plane(camera, &corners, &Plane::FLOOR, REACH_DEFAULT) }
}

fn on_plane(camera: &Camera, corners: &[Pixel], plane: &Plane, reach: f64) -> Efov {
    if camera.lens.distortion.is_wide()
        && let Some(centre) = foot_within(camera, corners, plane)
    {
        return about_foot(camera, corners, plane, reach, centre);
    }
    let bent = camera.lens.distortion != crate::camera::Distortion::None;
    let steps = if bent { STEPS } else { 1 };
    let outline: Vec<Pixel> = (0..corners.len())
        .flat_map(|i| {
            let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
            (0..steps).map(move |step| {
                let t = step as f64 / steps as f64;
                Pixel { u: a.u + t * (b.u - a.u), v: a.v + t * (b.v - a.v) }
            })
        })
        .collect();
    let lost = outline.iter().any(|&pixel| camera.lens.bearing(pixel).is_none());
    let bearings: Vec<[f64; 3]> = outline.iter().filter_map(|&pixel| shown(camera, pixel)).collect();
    // In homogeneous floor coordinates (x w, y w, w) the horizon is w = 0 and clipping is linear.
    let h = camera.homography_plane_from_pixel(plane);
    let drop = camera.position.z - plane.height_at(camera.position.on_floor());
    let Pixel { u: cu, v: cv } = camera.lens.principal_point;
    let homogeneous: Vec<[f64; 3]> = bearings
        .iter()
        .map(|[x, y, w]| {
            let [x, y, w] = h.map(|row| row[0] * (x + cu * w) + row[1] * (y + cv * w) + row[2] * w);
            // Relative to the foot of the camera, so that the reach is a circle about the origin.
            [x - w * camera.position.x, y - w * camera.position.y, w]
        })
        .collect();
    // First w above what a floor point at the reach straight ahead has, then the circle itself.
    let ahead = homogeneous.iter().fold(0.0_f64, |most, [x, y, _]| most.max(x.hypot(*y)));
    let least = ahead / (drop.abs() * reach * 1e3) + f64::MIN_POSITIVE;
    let in_front = clip(&homogeneous, |[_, _, w]| w - least);
    let mut polygon: Vec<[f64; 3]> = in_front.clone();
    // The circle is approximated by a regular polygon of half planes.
    const SIDES: usize = 32;
    for side in 0..SIDES {
        let (sin, cos) = (std::f64::consts::TAU * side as f64 / SIDES as f64).sin_cos();
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

/// The bearing of a pixel, or where it has none, that of the last pixel toward the principal point that has one: the
/// border of a fisheye's circle.
fn shown(camera: &Camera, pixel: Pixel) -> Option<[f64; 3]> {
    let centre = camera.lens.principal_point;
    camera.lens.bearing(pixel).or_else(|| {
        let last = last_toward(centre, pixel, |raw| camera.lens.bearing(raw).is_some())?;
        camera.lens.bearing(last)
    })
}

/// The last pixel on the way from a centre for which something holds, by bisection; `None` where it does not at the
/// centre.
fn last_toward(centre: Pixel, pixel: Pixel, holds: impl Fn(Pixel) -> bool) -> Option<Pixel> {
    const HALVINGS: usize = 40;
    let at =
        |t: f64| Pixel { u: centre.u + t * (pixel.u - centre.u), v: centre.v + t * (pixel.v - centre.v) };
    if !holds(centre) {
        return None;
    }
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if holds(at(middle)) { low = middle } else { high = middle }
    }
    Some(at(if holds(pixel) { 1.0 } else { low }))
}

/// The pixel of the point of a plane below the camera, if it lies within a polygon.
fn foot_within(camera: &Camera, corners: &[Pixel], plane: &Plane) -> Option<Pixel> {
    let foot = camera.position.on_floor();
    let pixel = camera.world_to_pixel(foot.at_height(plane.height_at(foot)))?;
    let crosses = |(a, b): (&Pixel, &Pixel)| {
        (a.v > pixel.v) != (b.v > pixel.v) && pixel.u < a.u + (pixel.v - a.v) / (b.v - a.v) * (b.u - a.u)
    };
    let pairs = corners.iter().zip(corners.iter().cycle().skip(1));
    (pairs.filter(|pair| crosses(*pair)).count() % 2 == 1).then_some(pixel)
}

/// The floor that a polygon shows about the foot of a camera: where the horizon runs all round within the image,
/// there is no clipping at it. From the foot toward every point of the outline, the last floor within reach.
fn about_foot(camera: &Camera, corners: &[Pixel], plane: &Plane, reach: f64, foot: Pixel) -> Efov {
    /// Points of the outline an edge.
    const STEPS: usize = 16;
    let below = camera.position.on_floor();
    let most = reach * (camera.position.z - plane.height_at(below)).abs();
    let floor = |pixel: Pixel| {
        let at = camera.pixel_to_plane(pixel, plane)?.on_floor();
        (at.distance(below) <= most).then_some(at)
    };
    let edges = corners.iter().zip(corners.iter().cycle().skip(1));
    let outline = edges.flat_map(|(a, b)| {
        (0..STEPS).map(move |step| {
            let t = step as f64 / STEPS as f64;
            Pixel { u: a.u + t * (b.u - a.u), v: a.v + t * (b.v - a.v) }
        })
    });
    let mut clipped = false;
    let mut polygon = Vec::new();
    for pixel in outline {
        clipped |= floor(pixel).is_none();
        polygon.extend(last_toward(foot, pixel, |raw| floor(raw).is_some()).and_then(floor));
    }
    Efov { polygon, clipped }
}

/// The part of a polygon where `inside` is not negative (Sutherland and Hodgman 1974).
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
    use super::*;
    use crate::camera::{Lens, WorldPoint};

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
            assert!(range < 3.0 * REACH_DRAWN * 1.01, "{range} m is beyond the reach");
        }
    }

    #[test]
    fn a_polygon_in_the_sky_is_empty() {
        let corners = [[100.0, 100.0], [1800.0, 100.0], [1800.0, 0.0]].map(Pixel::from);
        let efov = efov_on_floor(&camera(-0.3), &corners);
        assert!(efov.clipped && efov.polygon.is_empty());
    }

    #[test]
    fn a_fisheye_on_the_ceiling_shows_the_floor_all_around() {
        let lens = Lens {
            focal: 334.0,
            distortion: crate::camera::Distortion::KannalaBrandt { k: [0.0; 4] },
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
    fn of_a_ceiling_that_sees_beyond_the_horizon_the_floor_is_a_disc_and_the_horizon_a_ring() {
        let lens = Lens {
            focal: 300.0,
            distortion: crate::camera::Distortion::KannalaBrandt { k: [0.01, 0.0, 0.0, 0.0] },
            ..Lens::pinhole(Pixel::new(960.0, 540.0))
        };
        let above = Camera { pitch: 1.45, roll: 0.3, lens, focal: 300.0, ..camera(0.0) };
        let disc: Vec<Pixel> = (0..24)
            .map(|i| (std::f64::consts::TAU * f64::from(i) / 24.0).sin_cos())
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
}
