//! Reprojection of points and of lines on a plane. The Jacobians are with respect to the camera and to the
//! point or line.
//!
//! Coordinates are undistorted pixels relative to the principal point, or chart points for a wide lens.
//! Observed pixels are undistorted first. The inverse of the Jacobian of the undistortion then maps residuals
//! to raw pixels.

use crate::camera::chart::Chart;
use crate::camera::lens::Lens;
use crate::camera::numerics::sin_cos;
use crate::camera::pinhole::{Camera, dot};
use crate::camera::plane::Plane;
use crate::camera::space::{FloorPoint, Pixel, WorldPoint};

/// Number of parameters of a camera without its lens: x, y, z, yaw, pitch, roll, log of the focal length.
pub(crate) const POSE_PARAMS: usize = 7;

/// Camera with its precomputed rotation matrix, for the reprojection of many points.
#[derive(Clone, Copy, Debug)]
pub struct PosedCamera {
    pub(crate) camera: Camera,
    /// Rotation matrix from world vectors to camera axes.
    rotation: [[f64; 3]; 3],
    /// Sine and cosine of the roll.
    roll: (f64, f64),
}

/// Reprojection of a world point, with its derivatives with respect to the camera and to the point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reprojection {
    /// Undistorted pixel relative to the principal point, or chart point; in pixels.
    pub(crate) at: [f64; 2],
    /// Derivatives of `at` with respect to the camera parameters, in the order of [`POSE_PARAMS`].
    pub(crate) d_camera: [[f64; POSE_PARAMS]; 2],
    /// Derivatives of `at` with respect to x, y, z of the point.
    pub(crate) d_point: [[f64; 3]; 2],
}

/// Observed pixel: undistorted or, for a wide lens, mapped to a chart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObservedPixel {
    /// Chart of the pixel, for a wide lens.
    pub(crate) chart: Option<Chart>,
    /// Undistorted pixel relative to the principal point, or chart point; in pixels.
    pub(crate) at: [f64; 2],
    /// Derivatives `d at / d raw` with respect to the raw pixel; one row for each coordinate of `at`.
    pub(crate) jacobian: [[f64; 2]; 2],
    /// Derivatives of `at` with respect to the lens parameters; zero for parameters that are not fitted.
    pub(crate) d_lens: [[f64; Lens::PARAMETERS]; 2],
}

/// Image of a line on a plane: a homogeneous line of undistorted pixels relative to the principal point. Its
/// derivatives are with respect to the camera, the line and the plane.
#[derive(Clone, Copy, Debug)]
pub struct ReprojectedLine {
    /// Homogeneous image line: its dot product with a point of the line is zero.
    line: [f64; 3],
    /// Derivatives of `line` with respect to the camera parameters, in the order of [`POSE_PARAMS`].
    d_camera: [[f64; 3]; POSE_PARAMS],
    /// Derivatives of `line` with respect to the offset and the angle of the line on the plane.
    d_line: [[f64; 3]; 2],
    /// Derivatives of `line` with respect to the height, the x slope and the y slope of the plane.
    d_plane: [[f64; 3]; 3],
}

impl ObservedPixel {
    /// Creates the observation of a raw pixel, without derivatives with respect to the lens. Returns `None`
    /// outside the lens.
    pub fn new(pixel: Pixel, lens: &Lens) -> Option<Self> {
        Self::with_derivatives(lens, pixel, lens, [false; Lens::PARAMETERS])
    }

    /// Creates the observation of a raw pixel, with derivatives with respect to the lens parameters that are
    /// flagged in `fitted`. The chart is computed from `start`, the initial lens of the estimation of `lens`.
    /// Returns `None` outside the lens.
    pub(crate) fn with_derivatives(
        start: &Lens,
        pixel: Pixel,
        lens: &Lens,
        fitted: [bool; Lens::PARAMETERS],
    ) -> Option<Self> {
        let chart = Chart::centred_on(start, &[pixel]);
        let found = lens.pixel_to_chart(pixel, chart.as_ref())?;
        let mut d_lens = [[0.0; Lens::PARAMETERS]; 2];
        if fitted.contains(&true) {
            let by = lens.pixel_to_chart_by_parameters(pixel, &found, chart.as_ref());
            for k in (0..Lens::PARAMETERS).filter(|&k| fitted[k]) {
                [d_lens[0][k], d_lens[1][k]] = by[k].at;
            }
        }
        Some(Self { chart, at: found.at, jacobian: found.jacobian, d_lens })
    }

    /// Maps a small difference e of undistorted pixels or chart points to raw pixels: returns `J^-1 e`, where
    /// J is the Jacobian of this observation.
    pub(crate) fn raw_offset(&self, [e, f]: [f64; 2]) -> [f64; 2] {
        let [[a, b], [c, d]] = self.jacobian;
        let determinant = a * d - b * c;
        [(d * e - b * f) / determinant, (a * f - c * e) / determinant]
    }
}

impl PosedCamera {
    /// Creates a posed camera. The rotation matrix is computed once for all observations of the camera.
    #[must_use]
    pub fn new(camera: Camera) -> Self {
        Self { rotation: camera.rotation(), roll: sin_cos(camera.roll), camera }
    }

    /// Converts a vector from world axes to camera axes.
    fn rotate(&self, vector: &[f64; 3]) -> [f64; 3] {
        self.rotation.map(|row| dot(&row, vector))
    }

    /// Returns the derivatives of `p = R q` with respect to yaw, pitch and roll. R is the rotation matrix,
    /// `q` a vector in world axes and `p` the same vector in camera axes.
    ///
    /// A change of yaw rotates `q` about world z in the opposite direction. Pitch moves the components (y, z)
    /// of `p` before the roll by (-z, y). Roll moves the components (x, y) of `p` by (y, -x).
    fn d_angles(&self, q: &[f64; 3], p: &[f64; 3]) -> [[f64; 3]; 3] {
        let (sin, cos) = self.roll;
        let [x, y, z] = *p;
        [self.rotate(&[q[1], -q[0], 0.0]), [-sin * z, -cos * z, sin * x + cos * y], [y, -x, 0.0]]
    }

    /// Returns the reprojection of a world point. Without a chart it is `f (x / z, y / z)`, where f is the
    /// focal length and (x, y, z) the point in camera axes. With a chart it is the chart point. Returns
    /// `None` if the point is not in front of the camera or of the chart.
    pub(crate) fn reproject(&self, point: WorldPoint, chart: Option<&Chart>) -> Option<Reprojection> {
        /// Minimum depth of the point along the optical axis, in metres.
        const MIN_DEPTH: f64 = 1e-6;
        let WorldPoint { x, y, z } = self.camera.position;
        let q = [point.x - x, point.y - y, point.z - z];
        let p = self.rotate(&q);
        if let Some(chart) = chart {
            return self.reproject_to_chart(chart, &q, &p);
        }
        if p[2].is_nan() || p[2] < MIN_DEPTH {
            return None;
        }
        let focal = self.camera.focal;
        let at = [focal * p[0] / p[2], focal * p[1] / p[2]];
        let jacobian = |change: &[f64; 3]| -> [f64; 2] {
            std::array::from_fn(|k| (focal * change[k] - at[k] * change[2]) / p[2])
        };
        let d_axis: [[f64; 2]; 3] = std::array::from_fn(|axis| jacobian(&self.rotation.map(|row| row[axis])));
        let d_angle = self.d_angles(&q, &p).map(|change| jacobian(&change));
        let row = |k: usize| {
            let [x, y, z] = d_axis.map(|s| s[k]);
            let [yaw, pitch, roll] = d_angle.map(|s| s[k]);
            ([-x, -y, -z, yaw, pitch, roll, at[k]], [x, y, z])
        };
        let ((u, d_u), (v, d_v)) = (row(0), row(1));
        Some(Reprojection { at, d_camera: [u, v], d_point: [d_u, d_v] })
    }

    /// Reprojects a point to a chart. `q` is the vector from the camera to the point in world axes, `p` the
    /// same vector in camera axes. Returns `None` if the point is not in front of the chart.
    fn reproject_to_chart(&self, chart: &Chart, q: &[f64; 3], p: &[f64; 3]) -> Option<Reprojection> {
        /// Minimum depth along the optical axis of the chart, divided by the distance of the point. It is the
        /// cosine of the largest angle from the axis.
        const MIN_COSINE: f64 = 1e-6;
        let [x, y, w] = chart.bearing_to_chart(self.camera.bearing(*p));
        if w.is_nan() || w <= MIN_COSINE * dot(p, p).sqrt() {
            return None;
        }
        let at = [x / w, y / w];
        let by_bearing = |bearing: [f64; 3]| -> [f64; 2] {
            let [dx, dy, dw] = chart.bearing_to_chart(bearing);
            [(dx - at[0] * dw) / w, (dy - at[1] * dw) / w]
        };
        let jacobian = |change: &[f64; 3]| by_bearing(self.camera.bearing(*change));
        let d_axis: [[f64; 2]; 3] = std::array::from_fn(|axis| jacobian(&self.rotation.map(|row| row[axis])));
        let d_angle = self.d_angles(q, p).map(|change| jacobian(&change));
        let [across, down, _] = self.camera.bearing(*p);
        let d_focal = by_bearing([across, down, 0.0]);
        let row = |k: usize| {
            let [x, y, z] = d_axis.map(|s| s[k]);
            let [yaw, pitch, roll] = d_angle.map(|s| s[k]);
            ([-x, -y, -z, yaw, pitch, roll, d_focal[k]], [x, y, z])
        };
        let ((u, d_u), (v, d_v)) = (row(0), row(1));
        Some(Reprojection { at, d_camera: [u, v], d_point: [d_u, d_v] })
    }

    /// Returns the image of a line on a plane. Seen from above, the line has the direction `angle`, in
    /// radians counter-clockwise from world +x. It passes `offset` metres to the left of `origin`.
    ///
    /// The image line is the cross product `K R (P - C) x K R d`. K is the intrinsic matrix, R the rotation
    /// matrix and C the camera position. `P = origin + offset (-sin, cos)` is a point of the line and
    /// `d = (cos, sin)` its direction, both raised to the plane.
    pub fn reproject_line(
        &self,
        plane: &Plane,
        origin: [f64; 2],
        offset: f64,
        angle: f64,
    ) -> ReprojectedLine {
        let (sin, cos) = sin_cos(angle);
        let WorldPoint { x, y, z } = self.camera.position;
        let at = FloorPoint { x: origin[0] - offset * sin, y: origin[1] + offset * cos };
        let q = [at.x - x, at.y - y, plane.height_at(at) - z];
        let lifted = |[x, y]: [f64; 2]| [x, y, plane.slope[0] * x + plane.slope[1] * y];
        let (along, left) = (lifted([cos, sin]), lifted([-sin, cos]));
        let focal = self.camera.focal;
        let image = |[x, y, w]: [f64; 3]| [focal * x, focal * y, w];
        let (p, d) = (self.rotate(&q), self.rotate(&along));
        let (point, direction) = (image(p), image(d));
        let jacobian = |d_point: [f64; 3], d_direction: [f64; 3]| -> [f64; 3] {
            let (a, b) = (cross(&d_point, &direction), cross(&point, &d_direction));
            std::array::from_fn(|i| a[i] + b[i])
        };
        let none = [0.0; 3];
        let axis = |k: usize| jacobian(image(self.rotation.map(|row| -row[k])), none);
        let (of_point, of_direction) = (self.d_angles(&q, &p), self.d_angles(&along, &d));
        let angle_of = |k: usize| jacobian(image(of_point[k]), image(of_direction[k]));
        let d_focal = jacobian([point[0], point[1], 0.0], [direction[0], direction[1], 0.0]);
        let moved = self.rotate(&left);
        // A change of the angle moves the point P backwards along the line.
        let back = self.rotate(&along.map(|c| -offset * c));
        let up = image(self.rotate(&[0.0, 0.0, 1.0]));
        let raised = |point: f64, direction: f64| jacobian(up.map(|c| point * c), up.map(|c| direction * c));
        let [by_height, by_x, by_y] = plane.height_by_parameters(at);
        ReprojectedLine {
            line: cross(&point, &direction),
            d_plane: [raised(by_height, 0.0), raised(by_x, cos), raised(by_y, sin)],
            d_camera: [axis(0), axis(1), axis(2), angle_of(0), angle_of(1), angle_of(2), d_focal],
            d_line: [jacobian(image(moved), none), jacobian(image(back), image(moved))],
        }
    }
}

/// Signed distance of an annotated point from the image of a line, with its derivatives.
#[derive(Clone, Copy, Debug)]
pub struct LineDistance {
    /// Signed distance, in raw pixels.
    pub pixels: f64,
    /// Derivatives of the distance with respect to the camera parameters, in the order of [`POSE_PARAMS`].
    pub(crate) d_camera: [f64; POSE_PARAMS],
    /// Derivatives of the distance with respect to the lens parameters, for a fixed Jacobian of the observed
    /// pixel.
    pub(crate) d_lens: [f64; Lens::PARAMETERS],
    /// Derivatives of the distance with respect to the offset and the angle of the line.
    pub(crate) d_line: [f64; 2],
    /// Derivatives of the distance with respect to the height, the x slope and the y slope of the plane.
    pub(crate) d_plane: [f64; 3],
}

impl ReprojectedLine {
    /// Returns the signed distance of an annotated point from this line: `n . (at, 1) / |J' n_xy|`. The
    /// vector n is the homogeneous line, (at, 1) the homogeneous observed pixel and J its Jacobian.
    pub fn distance(&self, observed: &ObservedPixel) -> LineDistance {
        if let Some(chart) = &observed.chart {
            // The transpose of the matrix from chart points to bearings maps lines of bearings to the chart.
            let carried = |line: [f64; 3]| -> [f64; 3] {
                std::array::from_fn(|j| (0..3).map(|i| line[i] * chart.bearing_from_chart()[i][j]).sum())
            };
            let in_chart = Self {
                line: carried(self.line),
                d_camera: self.d_camera.map(carried),
                d_line: self.d_line.map(carried),
                d_plane: self.d_plane.map(carried),
            };
            return in_chart.distance(&ObservedPixel { chart: None, ..*observed });
        }
        let homogeneous = [observed.at[0], observed.at[1], 1.0];
        let [[a, b], [c, d]] = observed.jacobian;
        let raw = |n: &[f64; 3]| [a * n[0] + c * n[1], b * n[0] + d * n[1]];
        let normal = raw(&self.line);
        let length = normal[0].hypot(normal[1]).max(f64::MIN_POSITIVE);
        let distance = dot(&self.line, &homogeneous) / length;
        let jacobian = |change: &[f64; 3]| {
            let turned = raw(change);
            let stretch = (normal[0] * turned[0] + normal[1] * turned[1]) / (length * length);
            dot(change, &homogeneous) / length - distance * stretch
        };
        let d_lens = std::array::from_fn(|k| {
            (self.line[0] * observed.d_lens[0][k] + self.line[1] * observed.d_lens[1][k]) / length
        });
        LineDistance {
            pixels: distance,
            d_camera: self.d_camera.map(|s| jacobian(&s)),
            d_lens,
            d_line: self.d_line.map(|s| jacobian(&s)),
            d_plane: self.d_plane.map(|s| jacobian(&s)),
        }
    }
}

/// Returns the cross product of two vectors.
fn cross(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::any_camera;
    use crate::camera::covariance::Covariance;
    use proptest::prelude::*;

    /// Step of finite differences, in the unit of each parameter.
    const STEP: f64 = 1e-6;

    fn nudged(camera: &Camera, index: usize, by: f64) -> PosedCamera {
        let by = if index == Covariance::FOCAL { camera.focal * by.exp_m1() } else { by };
        PosedCamera::new(camera.nudged(index, by))
    }

    proptest! {
        #[test]
        fn point_jacobian_agrees_with_finite_differences(
            camera in any_camera(), ahead in 2.0..30.0_f64, side in -5.0..5.0_f64, z in 0.0..2.5_f64,
        ) {
            let (sin, cos) = camera.yaw.sin_cos();
            let point = WorldPoint::new(camera.position.x + side * cos - ahead * sin, camera.position.y + side * sin + ahead * cos, z);
            let Some(reprojected) = PosedCamera::new(camera).reproject(point, None) else { return Ok(()) };
            let pinhole = camera.world_to_undistorted(point).unwrap();
            prop_assert!((reprojected.at[0] + camera.lens.principal_point.u - pinhole.u).abs() < 1e-6);
            let check = |numeric: f64, analytic: f64, what: usize| {
                let fine = (numeric - analytic).abs() < 1e-4 * (1.0 + analytic.abs());
                prop_assert!(fine, "{what}: {numeric} {analytic}");
                Ok(())
            };
            for k in 0..2 {
                for index in 0..POSE_PARAMS {
                    let at = |by: f64| nudged(&camera, index, by).reproject(point, None).map(|s| s.at[k]);
                    let (Some(a), Some(b)) = (at(STEP), at(-STEP)) else { continue };
                    check((a - b) / (2.0 * STEP), reprojected.d_camera[k][index], index)?;
                }
                for axis in 0..3 {
                    let at = |by: f64| {
                        let mut moved = <[f64; 3]>::from(point);
                        moved[axis] += by;
                        PosedCamera::new(camera).reproject(moved.into(), None).map(|s| s.at[k])
                    };
                    let (Some(a), Some(b)) = (at(STEP), at(-STEP)) else { continue };
                    check((a - b) / (2.0 * STEP), reprojected.d_point[k][axis], 10 + axis)?;
                }
            }
        }

        #[test]
        fn line_jacobian_agrees_with_finite_differences(
            camera in any_camera(), origin in [-9.0..9.0_f64, -9.0..9.0_f64], offset in -2.0..2.0_f64, angle in -3.0..3.0_f64,
            u in 0.0..1920.0_f64, v in 0.0..1080.0_f64, height in -1.0..1.0_f64, slope in [-0.1..0.1_f64, -0.1..0.1_f64],
        ) {
            let plane = Plane { height, slope, anchor: FloorPoint { x: 2.0, y: 1.0 } };
            let Some(observed) = ObservedPixel::new(Pixel { u, v }, &camera.lens) else { return Ok(()) };
            let LineDistance { pixels: distance, d_camera, d_line, d_plane, .. } = PosedCamera::new(camera).reproject_line(&plane, origin, offset, angle).distance(&observed);
            let check = |a: f64, b: f64, analytic: f64, what: usize| {
                let numeric = (a - b) / (2.0 * STEP);
                let fine = (numeric - analytic).abs() < 1e-3 * (1.0 + analytic.abs() + distance.abs());
                prop_assert!(fine, "{what}: {numeric} {analytic}");
                Ok(())
            };
            for index in 0..POSE_PARAMS {
                let at = |by: f64| nudged(&camera, index, by).reproject_line(&plane, origin, offset, angle).distance(&observed).pixels;
                check(at(STEP), at(-STEP), d_camera[index], index)?;
            }
            let line = |offset: f64, angle: f64| PosedCamera::new(camera).reproject_line(&plane, origin, offset, angle).distance(&observed).pixels;
            check(line(offset + STEP, angle), line(offset - STEP, angle), d_line[0], 10)?;
            check(line(offset, angle + STEP), line(offset, angle - STEP), d_line[1], 11)?;
            for (index, analytic) in d_plane.into_iter().enumerate() {
                let at = |by: f64| {
                    let mut moved = plane;
                    match index {
                        0 => moved.height += by,
                        _ => moved.slope[index - 1] += by,
                    }
                    PosedCamera::new(camera).reproject_line(&moved, origin, offset, angle).distance(&observed).pixels
                };
                check(at(STEP), at(-STEP), analytic, 20 + index)?;
            }
        }

        #[test]
        fn pixel_of_a_line_point_is_on_the_image_line(camera in any_camera(), along in 1.0..20.0_f64, angle in -3.0..3.0_f64) {
            let foot = camera.position.on_floor();
            let (sin, cos) = camera.yaw.sin_cos();
            let origin = [foot.x - along * sin, foot.y + along * cos];
            let point = WorldPoint::new(origin[0] + angle.cos(), origin[1] + angle.sin(), 0.0);
            let Some(pixel) = camera.world_to_pixel(point) else { return Ok(()) };
            // Only points in the image are tested. Far outside it, the inverse of the lens magnifies rounding
            // errors.
            prop_assume!((0.0..1920.0).contains(&pixel.u) && (0.0..1080.0).contains(&pixel.v));
            let Some(observed) = ObservedPixel::new(pixel, &camera.lens) else { return Ok(()) };
            let LineDistance { pixels: distance, .. } = PosedCamera::new(camera).reproject_line(&Plane::FLOOR, origin, 0.0, angle).distance(&observed);
            prop_assert!(distance.abs() < 1e-6, "{distance}");
        }
    }
}
