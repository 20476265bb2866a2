//! Pinhole camera of the paper with a lens: the maps between pixels and space, rays and matrices.

use crate::camera::covariance::Covariance;
use crate::camera::lens::Lens;
use crate::camera::numerics::sin_cos;
use crate::camera::space::{FloorPoint, Pixel, UndistortedPixel, WorldPoint};

/// Calibrated camera.
///
/// With yaw = pitch = roll = 0 the optical axis points along world +y, image right is world +x, and image
/// down is world -z. The angles are applied in the order yaw, pitch, roll, as in Abramov's camera equations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Centre of projection: x0, y0, z0, in metres.
    pub position: WorldPoint,
    /// Rotation about world z, counter-clockwise seen from above, in radians.
    pub yaw: f64,
    /// Angle of the optical axis below the horizontal, in radians; positive if the camera looks down.
    pub pitch: f64,
    /// Rotation about the optical axis, positive if the camera is rotated clockwise seen from behind, in
    /// radians.
    pub roll: f64,
    /// Focal length, in undistorted pixels, which are square.
    pub focal: f64,
    /// Lens: principal point and distortion.
    pub lens: Lens,
    /// Covariance of the pose, the focal length and the lens.
    pub covariance: Covariance,
}

/// Half line of the points that a pixel can show, in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Centre of projection, in metres.
    pub origin: WorldPoint,
    /// Direction in world axes. The ray of a pixel has a unit vector; other rays may have any length.
    pub direction: [f64; 3],
}

/// Minimum depth along the optical axis of a point that a pinhole shows, in metres.
pub(crate) const MIN_DEPTH: f64 = 1e-9;

/// Returns the rotation matrix from world vectors to camera vectors (x right, y down, z forward, as in
/// OpenCV). Its rows are right, down and forward in world axes. Angles are in radians.
#[must_use]
pub fn camera_from_world(roll: f64, pitch: f64, yaw: f64) -> [[f64; 3]; 3] {
    let ((sy, cy), (sp, cp), (sr, cr)) = (sin_cos(yaw), sin_cos(pitch), sin_cos(roll));
    let forward = [-sy * cp, cy * cp, -sp];
    let down_unrolled = [sy * sp, -cy * sp, -cp];
    let right_unrolled = [cy, sy, 0.0];
    let mix = |a: f64, b: f64| -> [f64; 3] {
        std::array::from_fn(|i| a * right_unrolled[i] + b * down_unrolled[i])
    };
    [mix(cr, sr), mix(-sr, cr), forward]
}

/// Returns roll, pitch and yaw, in radians, of a rotation matrix with the rows right, down, forward.
///
/// If the camera looks straight up or down, roll and yaw are not separable, and the returned roll is 0.
#[must_use]
pub fn angles_from_rotation(rotation: &[[f64; 3]; 3]) -> (f64, f64, f64) {
    let [right, _, forward] = rotation;
    let level = forward[0].hypot(forward[1]);
    if level < 1e-12 {
        let pitch = if forward[2] < 0.0 { std::f64::consts::FRAC_PI_2 } else { -std::f64::consts::FRAC_PI_2 };
        return (0.0, pitch, right[1].atan2(right[0]));
    }
    let pitch = (-forward[2]).atan2(level);
    let yaw = (-forward[0]).atan2(forward[1]);
    let [right_unrolled, down_unrolled, _] = camera_from_world(0.0, pitch, yaw);
    (dot(right, &down_unrolled).atan2(dot(right, &right_unrolled)), pitch, yaw)
}

impl Camera {
    /// Whether the lens is wide and has the same focal length as the camera, as in the fisheye models of
    /// other programs. In this case, both focal lengths change together and scale the image.
    #[must_use]
    pub fn shares_lens_focal(&self) -> bool {
        self.lens.distortion.is_wide() && self.lens.focal == self.focal
    }

    /// Returns the rotation matrix of this camera, with the rows right, down, forward in world axes.
    #[must_use]
    pub fn rotation(&self) -> [[f64; 3]; 3] {
        camera_from_world(self.roll, self.pitch, self.yaw)
    }

    /// Returns the translation `t = -R C` of the map `x_camera = R x_world + t`, in metres. R is the rotation
    /// matrix, C the position of the camera.
    #[must_use]
    pub fn translation(&self) -> [f64; 3] {
        let centre = <[f64; 3]>::from(self.position);
        self.rotation().map(|row| -dot(&row, &centre))
    }

    /// Maps a world point to camera axes (right, down, forward), in metres.
    #[must_use]
    pub fn in_camera(&self, point: WorldPoint) -> [f64; 3] {
        let from_centre = [point.x - self.position.x, point.y - self.position.y, point.z - self.position.z];
        self.rotation().map(|row| dot(&row, &from_centre))
    }

    /// Maps a world point to its raw pixel: `f3d->pix` of the paper, with lens distortion.
    ///
    /// Returns `None` if the lens cannot show the point. Only a wide lens can show points 90° or more from the
    /// optical axis.
    #[must_use]
    pub fn world_to_pixel(&self, point: WorldPoint) -> Option<Pixel> {
        self.project(self.in_camera(point))
    }

    /// Maps a point in camera axes, in metres, to its raw pixel. Returns `None` if the lens does not show the
    /// point.
    pub(crate) fn project(&self, [x, y, z]: [f64; 3]) -> Option<Pixel> {
        if self.lens.distortion.is_wide() {
            return self.lens.bearing_to_pixel(self.bearing([x, y, z]));
        }
        let is_in_front = z > MIN_DEPTH;
        is_in_front
            .then(|| self.undistorted_from_normalised([x / z, y / z]))
            .and_then(|at| self.lens.distort(at))
    }

    /// Returns the bearing of a point or vector that is given in camera axes; see [`Lens::bearing`].
    pub(crate) fn bearing(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        [self.focal * x, self.focal * y, z]
    }

    /// Maps a world point to its undistorted pixel. Returns `None` for points behind the camera.
    #[must_use]
    pub fn world_to_undistorted(&self, point: WorldPoint) -> Option<UndistortedPixel> {
        let [x, y, z] = self.in_camera(point);
        (z > MIN_DEPTH).then(|| self.undistorted_from_normalised([x / z, y / z]))
    }

    /// Maps a pixel to the horizontal plane at `height` metres: `fpix->3d` of the paper.
    ///
    /// Returns `None` if the ray of the pixel does not meet the plane in front of the camera, or the pixel is
    /// outside the lens.
    #[must_use]
    pub fn pixel_to_floor(&self, pixel: Pixel, height: f64) -> Option<FloorPoint> {
        self.ray_to_floor(self.pixel_to_ray(pixel)?, height)
    }

    /// Maps an undistorted pixel to the horizontal plane at `height` metres. Returns `None` if the ray of the
    /// pixel does not meet the plane in front of the camera.
    #[must_use]
    pub fn undistorted_to_floor(&self, pixel: UndistortedPixel, height: f64) -> Option<FloorPoint> {
        self.ray_to_floor(self.undistorted_to_ray(pixel), height)
    }

    /// Intersects a ray with the horizontal plane at `height` metres. Returns `None` if they do not meet in
    /// front of the camera.
    fn ray_to_floor(&self, ray: Ray, height: f64) -> Option<FloorPoint> {
        /// Maximum distance of a floor point along its ray, in metres. A larger value is a rounding error at
        /// the horizon.
        const MAX_DISTANCE_M: f64 = 1e12;
        let distance = (height - self.position.z) / ray.direction[2];
        (distance > 0.0 && distance < MAX_DISTANCE_M).then(|| FloorPoint {
            x: ray.origin.x + distance * ray.direction[0],
            y: ray.origin.y + distance * ray.direction[1],
        })
    }

    /// Returns the ray of a raw pixel in world coordinates. Returns `None` outside the lens.
    #[must_use]
    pub fn pixel_to_ray(&self, pixel: Pixel) -> Option<Ray> {
        Some(self.bearing_to_ray(self.lens.bearing(pixel)?))
    }

    /// Returns the ray of an undistorted pixel in world coordinates.
    pub(crate) fn undistorted_to_ray(&self, pixel: UndistortedPixel) -> Ray {
        let Pixel { u: cu, v: cv } = self.lens.principal_point;
        self.bearing_to_ray([pixel.u - cu, pixel.v - cv, 1.0])
    }

    /// Returns the ray of a bearing in world coordinates. The bearing may have any length.
    pub(crate) fn bearing_to_ray(&self, [x, y, w]: [f64; 3]) -> Ray {
        let ray = [x / self.focal, y / self.focal, w];
        let [right, down, forward] = self.rotation();
        let length = dot(&ray, &ray).sqrt();
        let direction =
            std::array::from_fn(|i| (ray[0] * right[i] + ray[1] * down[i] + ray[2] * forward[i]) / length);
        Ray { origin: self.position, direction }
    }

    /// Maps a raw pixel to the undistorted pixel. Returns `None` outside the lens.
    #[must_use]
    pub fn undistort(&self, pixel: Pixel) -> Option<UndistortedPixel> {
        self.lens.undistort(pixel)
    }

    /// Maps an undistorted pixel to the raw pixel. Returns `None` outside the lens.
    #[must_use]
    pub fn distort(&self, pixel: UndistortedPixel) -> Option<Pixel> {
        self.lens.distort(pixel)
    }

    /// Returns the 3 x 4 matrix `P = K R [I | -C]` from homogeneous world points, in metres, to homogeneous
    /// undistorted pixels, row by row. K is the intrinsic matrix, R the rotation matrix, I the identity and C
    /// the camera position.
    #[must_use]
    pub fn projection_matrix(&self) -> [[f64; 4]; 3] {
        let (rotation, t) = (self.rotation(), self.translation());
        let Pixel { u: cu, v: cv } = self.lens.principal_point;
        let extended = |i: usize| [rotation[i][0], rotation[i][1], rotation[i][2], t[i]];
        let (x, y, z) = (extended(0), extended(1), extended(2));
        [
            std::array::from_fn(|j| self.focal * x[j] + cu * z[j]),
            std::array::from_fn(|j| self.focal * y[j] + cv * z[j]),
            z,
        ]
    }

    /// Returns the camera with the change `by` added to the parameter of [`Covariance`] with this index.
    pub(crate) fn nudged(&self, index: usize, by: f64) -> Self {
        let mut camera = *self;
        match index {
            Covariance::X => camera.position.x += by,
            Covariance::Y => camera.position.y += by,
            Covariance::Z => camera.position.z += by,
            Covariance::YAW => camera.yaw += by,
            Covariance::PITCH => camera.pitch += by,
            Covariance::ROLL => camera.roll += by,
            Covariance::FOCAL => {
                camera.focal += by;
                if self.shares_lens_focal() {
                    camera.lens.focal = camera.focal;
                }
            }
            coefficient => camera.lens = camera.lens.nudged(coefficient - Covariance::LENS, by),
        }
        camera
    }

    /// Returns the horizontal and vertical field of view, in radians, of an undistorted image whose centre is
    /// the principal point. `size` is the width and height of the image, in pixels.
    #[must_use]
    pub fn field_of_view(&self, size: [f64; 2]) -> [f64; 2] {
        size.map(|length| 2.0 * (0.5 * length / self.focal).atan())
    }

    /// Returns the vanishing point of a world direction, as a homogeneous undistorted pixel relative to the
    /// principal point.
    #[must_use]
    pub fn vanishing_point(&self, direction: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = self.rotation().map(|row| dot(&row, &direction));
        [self.focal * x, self.focal * y, z]
    }

    /// Returns the undistorted pixel of a point `(x / z, y / z)` in camera axes.
    pub(crate) fn undistorted_from_normalised(&self, [x, y]: [f64; 2]) -> UndistortedPixel {
        let Pixel { u: cu, v: cv } = self.lens.principal_point;
        UndistortedPixel { u: cu + self.focal * x, v: cv + self.focal * y }
    }
}

/// Returns the dot product of two vectors.
#[inline(always)]
pub(crate) fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::camera::distortion::{BrownConrady, Distortion};
    use proptest::prelude::*;

    pub(crate) fn any_camera() -> impl Strategy<Value = Camera> {
        let pose =
            (-50.0..50.0_f64, -50.0..50.0_f64, 2.0..8.0_f64, -3.1..3.1_f64, -0.2..1.5_f64, -0.6..0.6_f64);
        let brown = (-0.3..0.1_f64, -0.05..0.1_f64, -0.01..0.01_f64, -0.002..0.002_f64, -0.002..0.002_f64);
        let aspect = prop_oneof![Just(1.0), 0.5..2.1_f64];
        (pose, 600.0..2500.0_f64, brown, any::<bool>(), aspect).prop_map(
            |((x, y, z, yaw, pitch, roll), focal, (k1, k2, k3, p1, p2), distorted, pixel_aspect)| {
                let brown = Distortion::BrownConrady(BrownConrady { k1, k2, k3, p1, p2 });
                let distortion = if distorted { brown } else { Distortion::None };
                let lens = Lens {
                    principal_point: Pixel::new(955.0, 545.0),
                    focal,
                    pixel_aspect,
                    distortion,
                    image_circle: None,
                };
                let covariance = Covariance::EXACT;
                Camera { position: WorldPoint { x, y, z }, yaw, pitch, roll, focal, lens, covariance }
            },
        )
    }

    fn level() -> Camera {
        Camera {
            position: WorldPoint::new(0.0, 0.0, 3.0),
            yaw: 0.0,
            pitch: 0.0,
            roll: 0.0,
            focal: 1000.0,
            lens: Lens::pinhole(Pixel::new(960.0, 540.0)),
            covariance: Covariance::EXACT,
        }
    }

    #[test]
    fn axes_follow_the_conventions() {
        let at = |camera: Camera, x, y, z| camera.world_to_pixel(WorldPoint { x, y, z }).unwrap();
        assert_eq!(at(level(), 0.0, 5.0, 3.0), Pixel::new(960.0, 540.0));
        assert!(at(level(), 1.0, 5.0, 3.0).u > 960.0, "world x is to the right");
        assert!(at(level(), 0.0, 5.0, 2.0).v > 540.0, "below is down");
        assert!(at(Camera { yaw: 0.2, ..level() }, 0.0, 5.0, 3.0).u > 960.0, "yaw turns the camera left");
        assert!(at(Camera { pitch: 0.2, ..level() }, 0.0, 5.0, 3.0).v < 540.0, "pitch looks down");
        assert!(
            at(Camera { roll: 0.2, ..level() }, 1.0, 5.0, 3.0).v < 540.0,
            "roll turns the camera clockwise"
        );
    }

    #[test]
    fn a_pixel_above_the_horizon_has_no_floor() {
        let tilted = Camera { pitch: 0.5, ..level() };
        assert_eq!(tilted.pixel_to_floor(Pixel::new(640.0, -2000.0), 0.0), None);
        assert_eq!(level().pixel_to_floor(Pixel::new(640.0, 540.0), 0.0), None, "the horizon itself");
    }

    #[test]
    fn a_point_behind_the_camera_has_no_pixel() {
        assert_eq!(level().world_to_pixel(WorldPoint::new(0.0, -1.0, 3.0)), None);
    }

    proptest! {
        #[test]
        fn floor_point_of_a_pixel_maps_back_to_the_pixel(
            camera in any_camera(), u in 0.0..1920.0_f64, v in 0.0..1080.0_f64, height in -1.0..1.9_f64,
        ) {
            if let Some(floor) = camera.pixel_to_floor(Pixel { u, v }, height) {
                let range = floor.distance(camera.position.on_floor());
                prop_assume!(range < 1e5);
                let back = camera.world_to_pixel(floor.at_height(height));
                prop_assert!(back.is_some_and(|p| p.distance(Pixel { u, v }) < 1e-7), "{back:?} of {u} {v}");
            }
        }

        #[test]
        fn matrices_agree_with_the_maps(
            camera in any_camera(), x in -60.0..60.0_f64, y in -60.0..60.0_f64, z in -1.0..1.9_f64,
        ) {
            let point = WorldPoint { x, y, z };
            if let Some(pixel) = camera.world_to_undistorted(point) {
                prop_assume!(camera.in_camera(point)[2] > 0.1);
                let p = camera.projection_matrix().map(|row| row[0] * x + row[1] * y + row[2] * z + row[3]);
                prop_assert!((p[0] / p[2] - pixel.u).hypot(p[1] / p[2] - pixel.v) < 1e-6 * (1.0 + pixel.u.abs() + pixel.v.abs()));
                let h = camera.homography_floor_from_pixel(z).map(|row| row[0] * pixel.u + row[1] * pixel.v + row[2]);
                prop_assert!(h[2] > 0.0, "the floor lies in front");
                prop_assert!((h[0] / h[2] - x).hypot(h[1] / h[2] - y) < 1e-6 * (1.0 + camera.position.distance(point).powi(2)));
            }
        }

        #[test]
        fn fisheye_maps_rays_beyond_90_degrees_and_back(
            camera in any_camera(), k in [-0.03..0.03_f64, -0.004..0.004_f64], angle in 0.0..1.66_f64, turn in -3.2..3.2_f64,
        ) {
            let lens = Lens { distortion: Distortion::KannalaBrandt { k: [k[0], k[1], 0.0, 0.0] }, ..camera.lens };
            let camera = Camera { lens, focal: lens.focal, ..camera };
            let (sin, cos) = angle.sin_cos();
            let ray = [sin * turn.cos(), sin * turn.sin(), cos];
            let Some(pixel) = lens.bearing_to_pixel(camera.bearing(ray)) else { return Ok(()) };
            let shown = camera.pixel_to_ray(pixel).map(|ray| ray.direction);
            let expected: [f64; 3] = std::array::from_fn(|i| (0..3).map(|k| ray[k] * camera.rotation()[k][i]).sum());
            prop_assert!(shown.is_some_and(|shown| (0..3).all(|i| (shown[i] - expected[i]).abs() < 1e-12)), "{shown:?} {expected:?}");
            if let Some(floor) = camera.pixel_to_floor(pixel, 0.0) {
                prop_assume!(floor.distance(camera.position.on_floor()) < 1e4);
                let back = camera.world_to_pixel(floor.at_height(0.0));
                prop_assert!(back.is_some_and(|back| back.distance(pixel) < 1e-9), "{back:?} {pixel:?}");
            }
        }

        #[test]
        fn angles_survive_the_rotation_matrix(camera in any_camera()) {
            let (roll, pitch, yaw) = angles_from_rotation(&camera.rotation());
            prop_assert!((roll - camera.roll).abs() + (pitch - camera.pitch).abs() + (yaw - camera.yaw).abs() < 1e-9);
        }

        #[test]
        fn vertical_vanishing_point_agrees_with_the_formula(camera in any_camera()) {
            let [x, y, w] = camera.vanishing_point([0.0, 0.0, -1.0]);
            let (f, p, r) = (camera.focal, camera.pitch, camera.roll);
            let expected = [f * p.cos() * r.sin(), f * p.cos() * r.cos(), p.sin()];
            prop_assert!((x - expected[0]).abs() + (y - expected[1]).abs() + (w - expected[2]).abs() < 1e-9 * f);
        }
    }
}
