//! Images of straight lines in space under lens distortion: 3-D polylines, the horizon, and annotated lines
//! between their ends. Also floor lines, and the nearest pixel on the image of a floor line.

use crate::camera::{Camera, FloorPoint, Lens, Pixel, Plane, WorldPoint};
use crate::floor::scene::Polyline;

/// Returns the image of a 3-D polyline, split into pieces if parts of the polyline are not visible.
///
/// The pieces follow the lens distortion. They end at the limit of the lens and, except for a wide lens, at a
/// depth of 5 cm. Parts outside the image are included, for a canvas that is larger than the image.
#[must_use]
pub fn on_image(camera: &Camera, polyline: &[WorldPoint]) -> Vec<Vec<Pixel>> {
    /// Minimum depth of the visible part of a line, in metres; nearer parts are cut off.
    const MIN_DEPTH_M: f64 = 0.05;
    let mut pieces = vec![Vec::new()];
    for pair in polyline.windows(2) {
        let (a, b) = (camera.in_camera(pair[0]), camera.in_camera(pair[1]));
        if camera.lens.distortion.is_wide() {
            append_arc(camera, [a, b], &mut pieces);
            continue;
        }
        let Some(front) = in_front(a, b, MIN_DEPTH_M) else {
            pieces.push(Vec::new());
            continue;
        };
        if a[2] < MIN_DEPTH_M {
            pieces.push(Vec::new());
        }
        append_distorted_segment(camera, front, &mut pieces);
    }
    pieces.retain(|piece| piece.len() > 1);
    pieces
}

/// Returns the part of a straight segment with a depth above `near`, in metres. The points are in camera axes
/// (right, down, forward). Returns `None` if both ends are nearer.
#[must_use]
pub fn in_front(a: [f64; 3], b: [f64; 3], near: f64) -> Option<[[f64; 3]; 2]> {
    let cut = |from: [f64; 3], to: [f64; 3]| -> [f64; 3] {
        let t = (near - from[2]) / (to[2] - from[2]);
        std::array::from_fn(|i| from[i] + t * (to[i] - from[i]))
    };
    match (a[2] < near, b[2] < near) {
        (true, true) => None,
        (true, false) => Some([cut(a, b), b]),
        (false, true) => Some([a, cut(b, a)]),
        (false, false) => Some([a, b]),
    }
}

/// Arc of a great circle between two rays, which contains the rays to all points of a straight segment in space. The
/// axes of the rays may be scaled: planes through the camera remain planes, so the arc contains the same rays.
#[derive(Clone, Copy, Debug)]
struct Arc {
    /// Unit vectors of the two rays.
    ends: [[f64; 3]; 2],
    /// Angle between the ends, in radians.
    angle: f64,
}

impl Arc {
    /// Angle between neighbouring points of the polyline of an arc, in radians. For a fisheye of 180° in 2000
    /// pixels, the chord deviates by 0.2 px.
    const STEP_RAD: f64 = 0.03;

    /// Creates the arc between two rays of any length.
    fn between(ends: [[f64; 3]; 2]) -> Self {
        let unit = |p: [f64; 3]| {
            let length = (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt();
            p.map(|c| c / length.max(f64::MIN_POSITIVE))
        };
        let [a, b] = ends.map(unit);
        let cosine = (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]).clamp(-1.0, 1.0);
        Self { ends: [a, b], angle: cosine.acos() }
    }

    /// Creates the arc between the rays of two pixels. The rays are bearings with the first two components divided by
    /// the focal length of the lens. Returns `None` if the lens shows no ray at one of the pixels.
    fn of_pixels(lens: &Lens, [a, b]: [Pixel; 2]) -> Option<Self> {
        let ray = |pixel| lens.bearing(pixel).map(|[x, y, w]| [x / lens.focal, y / lens.focal, w]);
        Some(Self::between([ray(a)?, ray(b)?]))
    }

    /// Returns the number of steps along the arc, at least 1.
    fn steps(&self) -> usize {
        (self.angle / Self::STEP_RAD).ceil().max(1.0) as usize
    }

    /// Returns the ray at t along the circle: t = 0 and t = 1 are the ends, larger values continue the
    /// circle.
    fn at(&self, t: f64) -> [f64; 3] {
        let ([a, b], angle) = (self.ends, self.angle);
        let [of_a, of_b] =
            if angle > 1e-6 { [((1.0 - t) * angle).sin(), (t * angle).sin()] } else { [1.0 - t, t] };
        std::array::from_fn(|i| of_a * a[i] + of_b * b[i])
    }

    /// Returns the raw pixel of the ray at `t`; `None` if the lens does not show the ray.
    fn pixel_at(&self, lens: &Lens, t: f64) -> Option<Pixel> {
        let [x, y, w] = self.at(t);
        lens.bearing_to_pixel([lens.focal * x, lens.focal * y, w])
    }
}

/// Returns the image of an annotated line. For a wide lens, consecutive points are connected by the distorted
/// image of the straight line in space between them. For other lenses, or where the lens shows no rays, the
/// points are connected directly.
#[must_use]
pub fn annotated_line_curve(lens: &Lens, points: &[Pixel]) -> Vec<Pixel> {
    if !lens.distortion.is_wide() {
        return points.to_vec();
    }
    let mut line: Vec<Pixel> = points.first().copied().into_iter().collect();
    for pair in points.windows(2) {
        if let Some(arc) = Arc::of_pixels(lens, [pair[0], pair[1]]) {
            let steps = arc.steps();
            line.extend((1..steps).filter_map(|step| arc.pixel_at(lens, step as f64 / steps as f64)));
        }
        line.push(pair[1]);
    }
    line
}

/// Extends the straight line in space through two pixels beyond the second one, to the limit of the lens.
/// Returns an empty list if the lens is not wide, or if the pixels do not show two different rays.
#[must_use]
pub fn line_extension(lens: &Lens, ends: [Pixel; 2]) -> Vec<Pixel> {
    let arc = Some(lens).filter(|lens| lens.distortion.is_wide());
    let arc = arc.and_then(|lens| Arc::of_pixels(lens, ends)).filter(|arc| arc.angle > 1e-6);
    let Some(arc) = arc else { return Vec::new() };
    // The extension goes at most once around the circle, without the annotated part.
    let steps = ((std::f64::consts::TAU - arc.angle) / Arc::STEP_RAD) as usize;
    let beyond = |step: usize| arc.pixel_at(lens, 1.0 + step as f64 * Arc::STEP_RAD / arc.angle);
    (0..steps).map_while(beyond).collect()
}

/// Appends the image of a straight segment in camera axes, seen by a wide lens along the arc of rays between
/// its ends.
fn append_arc(camera: &Camera, ends: [[f64; 3]; 2], pieces: &mut Vec<Vec<Pixel>>) {
    let arc = Arc::between(ends);
    let steps = arc.steps();
    for step in 0..=steps {
        match camera.lens.bearing_to_pixel(camera.bearing(arc.at(step as f64 / steps as f64))) {
            Some(pixel) => {
                if let Some(piece) = pieces.last_mut()
                    && piece.last() != Some(&pixel)
                {
                    piece.push(pixel);
                }
            }
            None => pieces.push(Vec::new()),
        }
    }
}

/// Appends the image of a straight segment in camera axes, in steps short enough to follow the lens
/// distortion.
fn append_distorted_segment(camera: &Camera, [a, b]: [[f64; 3]; 2], pieces: &mut Vec<Vec<Pixel>>) {
    /// Distance between points of a distorted line, in pixels. The chord of a curve with a radius of 500 px
    /// deviates by 0.2 px.
    const POINT_DISTANCE_PX: f64 = 24.0;
    /// Maximum number of steps of one segment.
    const MAX_STEPS: f64 = 256.0;
    let centre = camera.lens.principal_point;
    let show = |p: [f64; 3]| {
        let (u, v) = (centre.u + camera.focal * p[0] / p[2], centre.v + camera.focal * p[1] / p[2]);
        crate::camera::UndistortedPixel { u, v }
    };
    let straight = [show(a), show(b)];
    let bent = camera.lens.distortion != crate::camera::Distortion::None;
    let length = straight[0].distance(straight[1]);
    let steps = if bent { (length / POINT_DISTANCE_PX).clamp(1.0, MAX_STEPS).ceil() as usize } else { 1 };
    for step in 0..=steps {
        // The steps are equal on the image, not in space, because of the perspective.
        let t = step as f64 / steps as f64;
        let pixel = crate::camera::UndistortedPixel {
            u: straight[0].u + t * (straight[1].u - straight[0].u),
            v: straight[0].v + t * (straight[1].v - straight[0].v),
        };
        match camera.distort(pixel) {
            Some(pixel) => {
                if let Some(piece) = pieces.last_mut()
                    && piece.last() != Some(&pixel)
                {
                    piece.push(pixel);
                }
            }
            None => pieces.push(Vec::new()),
        }
    }
}

/// Returns the horizon across an image of this size, with lens distortion. It is empty if the horizon is not
/// visible.
#[must_use]
pub fn horizon(camera: &Camera, size: [f64; 2]) -> Vec<Vec<Pixel>> {
    // The ring consists of distant points in the horizontal plane through the camera. Only the points in
    // front of the camera are visible.
    /// Number of points around the camera.
    const HORIZON_POINTS: usize = 180;
    /// Distance of the points from the camera, in metres.
    const HORIZON_DISTANCE_M: f64 = 1e6;
    let ring: Polyline = (0..=HORIZON_POINTS)
        .map(|i| {
            let (sin, cos) = (std::f64::consts::TAU * i as f64 / HORIZON_POINTS as f64).sin_cos();
            let WorldPoint { x, y, z } = camera.position;
            WorldPoint { x: x + HORIZON_DISTANCE_M * cos, y: y + HORIZON_DISTANCE_M * sin, z }
        })
        .collect();
    let margin = 0.5 * (size[0] + size[1]);
    let near_image =
        |p: &Pixel| p.u > -margin && p.u < size[0] + margin && p.v > -margin && p.v < size[1] + margin;
    on_image(camera, &ring).into_iter().filter(|piece| piece.iter().any(near_image)).collect()
}

/// Straight line on the floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FloorLine {
    /// Point on the line, in metres.
    pub through: FloorPoint,
    /// Direction from world +x, counter-clockwise, in radians.
    pub turn: f64,
}

impl FloorLine {
    /// Returns the line through two points. Returns `None` if the points coincide.
    #[must_use]
    pub fn between(a: FloorPoint, b: FloorPoint) -> Option<Self> {
        (a.distance(b) > 0.0).then(|| Self { through: a, turn: (b.y - a.y).atan2(b.x - a.x) })
    }

    /// Returns the point of the line nearest to the projection of a pixel on a plane. Also returns the pixel
    /// on the image of the line nearest to the given pixel.
    ///
    /// Returns `None` if the pixel does not show the plane, or the line is not visible there.
    #[must_use]
    pub fn nearest(&self, camera: &Camera, pixel: Pixel, plane: &Plane) -> Option<(FloorPoint, Pixel)> {
        /// Half the length of a piece of the line, in metres. Distortion is negligible over this length.
        const HALF_PIECE_LENGTH_M: f64 = 1e-3;
        /// Maximum number of iterations. Each centres a short piece of the line on the nearest point of the
        /// previous piece.
        const MAX_ITERATIONS: usize = 40;
        /// Length of a step along the line below which the iteration ends, relative to half the length of a
        /// piece.
        const MIN_RELATIVE_STEP: f64 = 1e-3;
        let floor_point = camera.pixel_to_plane(pixel, plane)?.on_floor();
        let (sin, cos) = self.turn.sin_cos();
        let along = (floor_point.x - self.through.x) * cos + (floor_point.y - self.through.y) * sin;
        let on_line =
            |along: f64| FloorPoint { x: self.through.x + along * cos, y: self.through.y + along * sin };
        let shown = |along: f64| {
            let at = on_line(along);
            camera.world_to_pixel(at.at_height(plane.height_at(at)))
        };
        let mut middle = along;
        let mut nearest = pixel;
        for _ in 0..MAX_ITERATIONS {
            let (a, b) = (shown(middle - HALF_PIECE_LENGTH_M)?, shown(middle + HALF_PIECE_LENGTH_M)?);
            let (du, dv) = (b.u - a.u, b.v - a.v);
            let t = ((pixel.u - a.u) * du + (pixel.v - a.v) * dv) / (du * du + dv * dv);
            nearest = Pixel { u: a.u + t * du, v: a.v + t * dv };
            middle += (2.0 * t - 1.0) * HALF_PIECE_LENGTH_M;
            if (2.0 * t - 1.0).abs() < MIN_RELATIVE_STEP {
                break;
            }
        }
        nearest.is_finite().then_some((on_line(along), nearest))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::camera::{Distortion, any_camera, dot};

    /// Creates a fisheye with a field of view above 180°.
    fn ceiling() -> Lens {
        let distortion = Distortion::KannalaBrandt { k: [0.01, -0.002, 0.0, 0.0] };
        Lens {
            principal_point: Pixel::new(960.0, 950.0),
            focal: 580.0,
            pixel_aspect: 1.0,
            distortion,
            image_circle: None,
        }
    }

    proptest! {
        #[test]
        fn fisheye_line_and_camera_centre_are_in_one_plane(
            a in [100.0..1800.0_f64, 100.0..1800.0_f64], b in [100.0..1800.0_f64, 100.0..1800.0_f64],
        ) {
            let (lens, ends) = (ceiling(), [Pixel::from(a), Pixel::from(b)]);
            prop_assume!(ends[0].distance(ends[1]) > 20.0);
            let ray = |pixel: Pixel| {
                let [x, y, w] = lens.bearing(pixel).unwrap();
                [x / lens.focal, y / lens.focal, w]
            };
            let [p, q] = ends.map(ray);
            let normal = [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
            let length = dot(&normal, &normal).sqrt();
            prop_assume!(length > 1e-3);
            let line = annotated_line_curve(&lens, &ends);
            prop_assert_eq!((line.first(), line.last()), (ends.first(), ends.last()));
            let beyond = [line_extension(&lens, ends), line_extension(&lens, [ends[1], ends[0]])];
            prop_assert!(beyond.iter().all(|side| side.len() > 1));
            for &pixel in line.iter().chain(beyond.iter().flatten()) {
                prop_assert!(dot(&normal, &ray(pixel)).abs() / length < 1e-9, "{pixel:?}");
            }
            // Fine enough for the display: in front of the camera a lens stretches a step by up to pi/2, and
            // slightly more by its coefficients.
            let ahead = line.windows(2).filter(|pair| pair.iter().all(|&pixel| ray(pixel)[2] > 0.0));
            let longest = ahead.map(|pair| pair[0].distance(pair[1])).fold(0.0, f64::max);
            prop_assert!(longest < 2.0 * lens.focal * Arc::STEP_RAD, "{longest}");
        }

        #[test]
        fn annotated_line_without_fisheye_is_unchanged(
            camera in any_camera(), points in prop::collection::vec([0.0..1920.0_f64, 0.0..1080.0_f64], 0..5),
        ) {
            prop_assume!(!camera.lens.distortion.is_wide());
            let points: Vec<Pixel> = points.into_iter().map(Pixel::from).collect();
            prop_assert_eq!(annotated_line_curve(&camera.lens, &points), points);
        }

        #[test]
        fn line_behind_camera_is_cut(
            camera in any_camera(), far in -40.0..40.0_f64, side in -40.0..40.0_f64,
        ) {
            let foot = camera.position;
            let line = [
                WorldPoint { x: foot.x - 30.0, y: foot.y + side, z: 0.0 },
                WorldPoint { x: foot.x + 30.0, y: foot.y + far, z: 1.0 },
            ];
            for piece in on_image(&camera, &line) {
                for pixel in piece {
                    prop_assert!(pixel.is_finite());
                    if let Some(ray) = camera.pixel_to_ray(pixel) {
                        let (a, b) = (line[0], line[1]);
                        // The ray, the line and the camera centre are in one plane.
                        let u = [a.x - foot.x, a.y - foot.y, a.z - foot.z];
                        let v = [b.x - foot.x, b.y - foot.y, b.z - foot.z];
                        let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
                        let norm = dot(&n, &n).sqrt().max(1e-12);
                        prop_assert!(dot(&n, &ray.direction).abs() / norm < 1e-6);
                    }
                }
            }
        }

        #[test]
        fn horizon_pixels_show_only_distant_floor(camera in any_camera()) {
            for pixel in horizon(&camera, [1920.0, 1080.0]).into_iter().flatten() {
                if let Some(floor) = camera.pixel_to_floor(pixel, 0.0) {
                    prop_assert!(floor.distance(camera.position.on_floor()) > 1e3);
                }
            }
        }
    }

    proptest! {
        #[test]
        fn nearest_pixel_is_perpendicular_foot_on_the_line(
            camera in any_camera(), u in 200.0..1700.0_f64, v in 500.0..1000.0_f64, turn in -3.0..3.0_f64, off in -0.3..0.3_f64,
        ) {
            let pixel = Pixel { u, v };
            let Some(put) = camera.pixel_to_floor(pixel, 0.0) else { return Ok(()) };
            let range = put.distance(camera.position.on_floor()) / camera.position.z;
            prop_assume!(range < 4.0);
            let line = FloorLine { through: FloorPoint { x: put.x - off * turn.sin(), y: put.y + off * turn.cos() }, turn };
            let Some((at, shown)) = line.nearest(&camera, pixel, &Plane::FLOOR) else { return Ok(()) };
            // Both results are on the line: one on the floor, the other in the image.
            let across = |p: FloorPoint| (p.y - line.through.y) * turn.cos() - (p.x - line.through.x) * turn.sin();
            prop_assert!(across(at).abs() < 1e-9 && (at.distance(put) - off.abs()).abs() < 1e-9);
            let back = camera.pixel_to_floor(shown, 0.0).unwrap();
            prop_assert!(across(back).abs() < 1e-4, "{} of {off}", across(back));
            // Neighbouring points are not nearer.
            for beside in [-0.1, 0.1] {
                let beside = FloorPoint { x: back.x + beside * turn.cos(), y: back.y + beside * turn.sin() };
                let Some(other) = camera.world_to_pixel(beside.at_height(0.0)) else { continue };
                prop_assert!(other.distance(pixel) > shown.distance(pixel) - 1e-3, "{other:?} {shown:?} {pixel:?}");
            }
        }
    }
}
