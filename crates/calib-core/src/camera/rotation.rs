//! Rotation and zoom of a camera that stays at its position.
//!
//! A ray `r` in the old camera axes is `R r` in the new camera axes, with the rotation matrix `R`. The pixels
//! of the two images are therefore related by `R` and the ratio of the focal lengths, at any depth. An
//! additional translation `t` of the camera, in camera axes, changes the ray of a point at depth `z` from `r`
//! to `r - t / z` (Hartley & Zisserman 2004, section 13.2).

use crate::camera::{Camera, Covariance, FloorDerivatives, Pixel, UndistortedPixel, angles_from_rotation};

/// Change of yaw, pitch, roll and focal length of a camera at a fixed position.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PanTiltZoom {
    /// Change of the yaw, in radians; positive to the left.
    pub pan: f64,
    /// Change of the pitch, in radians; positive downwards.
    pub tilt: f64,
    /// Change of the roll, in radians; positive clockwise seen from behind.
    pub roll: f64,
    /// Natural logarithm of the new focal length divided by the old focal length.
    pub zoom: f64,
}

impl PanTiltZoom {
    /// Number of parameters: pan, tilt, roll and zoom.
    pub const SIZE: usize = 4;
    /// Index of the pan in the parameters.
    pub const PAN: usize = 0;
    /// Index of the tilt in the parameters.
    pub const TILT: usize = 1;
    /// Index of the roll in the parameters.
    pub const ROLL: usize = 2;
    /// Index of the zoom in the parameters.
    pub const ZOOM: usize = 3;

    /// Creates the change from its parameters: pan, tilt, roll, zoom.
    #[must_use]
    pub const fn from_parameters([pan, tilt, roll, zoom]: [f64; Self::SIZE]) -> Self {
        Self { pan, tilt, roll, zoom }
    }

    /// Returns the total rotation angle of pan, tilt and roll together, in radians. `pitch` is the pitch of
    /// the camera, in radians. The formula is an approximation for small changes.
    #[must_use]
    pub fn rotation_angle(&self, pitch: f64) -> f64 {
        // The axes of pan and roll are perpendicular only for a level camera.
        let along = self.pan * pitch.sin();
        ((self.pan * pitch.cos()).powi(2) + self.tilt.powi(2) + (self.roll - along).powi(2)).sqrt()
    }

    /// Returns the camera after this change of its angles and focal length.
    #[must_use]
    pub fn apply_to(&self, camera: &Camera) -> Camera {
        Camera {
            yaw: camera.yaw + self.pan,
            pitch: camera.pitch + self.tilt,
            roll: camera.roll + self.roll,
            focal: camera.focal * self.zoom.exp(),
            ..*camera
        }
    }

    /// Returns the derivatives `[dx, dy]` of a floor point with respect to pan, tilt, roll and zoom. `of`
    /// contains the derivatives of the floor point with respect to the parameters of `camera`.
    pub fn floor_derivatives(camera: &Camera, of: &FloorDerivatives) -> [[f64; 2]; Self::SIZE] {
        let by = &of.by_camera;
        let zoom = by[Covariance::FOCAL].map(|change| camera.focal * change);
        [by[Covariance::YAW], by[Covariance::PITCH], by[Covariance::ROLL], zoom]
    }
}

/// Rotation and zoom of a camera at a fixed position.
///
/// The distortion of the lens does not change with the zoom.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct RotationZoom {
    /// Rotation vector in the old camera axes (right, down, forward). Its length is the rotation angle, in
    /// radians. Coordinates `x` in the old axes become `R x` in the new axes, where `R` is the matrix
    /// exponential of the vector.
    pub vector: [f64; 3],
    /// Natural logarithm of the new focal length divided by the old focal length.
    pub zoom: f64,
}

/// Matrix of 3 x 3, row by row.
type Matrix = [[f64; 3]; 3];

/// Camera before and after a rotation with zoom, for maps from the old image to the new image.
#[derive(Clone, Debug)]
pub struct RotatedCamera {
    /// Camera before the rotation.
    old: Camera,
    /// Rotation matrix from the old to the new camera axes.
    rotation: Matrix,
    /// Focal length after the zoom, in pixels.
    focal: f64,
}

impl RotationZoom {
    /// Number of parameters: three of the rotation vector and the zoom.
    pub const SIZE: usize = 4;

    /// Creates a rotation with zoom from its parameters: the rotation vector, then the zoom.
    #[must_use]
    pub const fn from_parameters([x, y, z, zoom]: [f64; Self::SIZE]) -> Self {
        Self { vector: [x, y, z], zoom }
    }

    /// Creates a rotation with zoom from the rotation matrix from old to new camera axes. The rows of the
    /// matrix are the new axes, in coordinates of the old axes.
    #[must_use]
    pub fn from_rotation(rotation: &Matrix, zoom: f64) -> Self {
        let r = rotation;
        let axis = [r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]];
        let sine = 0.5 * axis.iter().map(|c| c * c).sum::<f64>().sqrt();
        let angle = sine.atan2(0.5 * (r[0][0] + r[1][1] + r[2][2] - 1.0));
        // Half of `axis` is the sine times the unit vector. For small angles this is the rotation vector.
        let scale = if sine > 1e-12 { 0.5 * angle / sine } else { 0.5 };
        Self { vector: axis.map(|c| scale * c), zoom }
    }

    /// Computes the rotation and zoom between two cameras at the same position.
    #[must_use]
    pub fn between(old: &Camera, new: &Camera) -> Self {
        let rotation = product(&new.rotation(), &transposed(&old.rotation()));
        Self::from_rotation(&rotation, (new.focal / old.focal).ln())
    }

    /// Returns the angle of the rotation, in radians.
    #[must_use]
    pub fn angle(&self) -> f64 {
        self.vector.iter().map(|c| c * c).sum::<f64>().sqrt()
    }

    /// Returns the composition of this rotation with zoom and a later one, `next`.
    #[must_use]
    pub fn followed_by(&self, next: &Self) -> Self {
        Self::from_rotation(&product(&next.rotation(), &self.rotation()), self.zoom + next.zoom)
    }

    /// Returns the rotation matrix from old to new camera axes (Rodrigues 1840). Its rows are the new axes,
    /// in coordinates of the old axes.
    #[must_use]
    pub fn rotation(&self) -> Matrix {
        let angle = self.angle();
        let [x, y, z] = self.vector;
        let cross = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
        let (a, b) = if angle > 1e-9 {
            (angle.sin() / angle, (1.0 - angle.cos()) / (angle * angle))
        } else {
            (1.0, 0.5)
        };
        let square = product(&cross, &cross);
        std::array::from_fn(|i| {
            std::array::from_fn(|j| f64::from(i == j) + a * cross[i][j] + b * square[i][j])
        })
    }

    /// Returns the camera after this rotation and zoom.
    #[must_use]
    pub fn apply_to(&self, camera: &Camera) -> Camera {
        let (roll, pitch, yaw) = angles_from_rotation(&product(&self.rotation(), &camera.rotation()));
        Camera { roll, pitch, yaw, focal: camera.focal * self.zoom.exp(), ..*camera }
    }

    /// Returns the change of yaw, pitch, roll and focal length that this rotation with zoom causes for a
    /// camera.
    #[must_use]
    pub fn pan_tilt_zoom(&self, camera: &Camera) -> PanTiltZoom {
        let new = self.apply_to(camera);
        let half = std::f64::consts::PI;
        let turn = |to: f64, from: f64| (to - from + half).rem_euclid(2.0 * half) - half;
        PanTiltZoom {
            pan: turn(new.yaw, camera.yaw),
            tilt: new.pitch - camera.pitch,
            roll: turn(new.roll, camera.roll),
            zoom: self.zoom,
        }
    }

    /// Prepares the maps from the image of `camera` to its image after this rotation and zoom, for many
    /// pixels.
    #[must_use]
    pub fn for_camera(&self, camera: &Camera) -> RotatedCamera {
        RotatedCamera { old: *camera, rotation: self.rotation(), focal: camera.focal * self.zoom.exp() }
    }
}

impl RotatedCamera {
    /// Maps a raw pixel of the old image to the raw pixel of the new image that shows the same ray. Returns
    /// `None` for rays behind the new camera or outside the lens.
    #[must_use]
    pub fn map_pixel(&self, old: Pixel) -> Option<Pixel> {
        self.ray_to_pixel(pixel_to_camera_ray(&self.old, old)?)
    }

    /// Maps a ray in the axes of the old camera to its raw pixel in the new image. Returns `None` for rays
    /// behind the new camera or outside the lens.
    #[must_use]
    pub fn ray_to_pixel(&self, ray: [f64; 3]) -> Option<Pixel> {
        self.old.lens.distort(self.ray_to_undistorted(ray)?)
    }

    /// Maps a ray in the axes of the old camera to its undistorted pixel in the new image. Returns `None` for
    /// rays behind the new camera.
    #[must_use]
    pub fn ray_to_undistorted(&self, ray: [f64; 3]) -> Option<UndistortedPixel> {
        let [x, y, z] = self.rotation.map(|row| row[0] * ray[0] + row[1] * ray[1] + row[2] * ray[2]);
        let Pixel { u, v } = self.old.lens.principal_point;
        (z > 1e-6).then(|| UndistortedPixel { u: u + self.focal * x / z, v: v + self.focal * y / z })
    }
}

/// Returns the ray of a raw pixel in camera axes (right, down, forward), with the forward component 1.
/// Returns `None` outside the lens.
#[must_use]
pub fn pixel_to_camera_ray(camera: &Camera, pixel: Pixel) -> Option<[f64; 3]> {
    let undistorted = camera.undistort(pixel)?;
    let Pixel { u, v } = camera.lens.principal_point;
    Some([(undistorted.u - u) / camera.focal, (undistorted.v - v) / camera.focal, 1.0])
}

/// Returns the inverse of the depth at which a ray with the forward component 1, in camera axes, meets the
/// floor. The unit is 1/m. Returns 0 at and above the horizon.
#[must_use]
pub fn inverse_floor_depth(camera: &Camera, ray: [f64; 3]) -> f64 {
    let [right, down, forward] = camera.rotation();
    let falls = -(ray[0] * right[2] + ray[1] * down[2] + ray[2] * forward[2]);
    (falls / camera.position.z.max(f64::MIN_POSITIVE)).max(0.0)
}

/// Returns the matrix product `a b`.
fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

/// Returns the transpose of a matrix.
fn transposed(a: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::camera::any_camera;

    proptest! {
        #[test]
        fn rotation_maps_old_pixels_to_the_new_camera(
            camera in any_camera(), x in -0.2..0.2_f64, y in -0.2..0.2_f64, z in -0.3..0.3_f64, zoom in -0.4..0.4_f64,
            u in 300.0..1600.0_f64, v in 200.0..900.0_f64,
        ) {
            let turn = RotationZoom::from_parameters([x, y, z, zoom]);
            let new = turn.apply_to(&camera);
            let Some(ray) = camera.pixel_to_ray(Pixel { u, v }) else { return Ok(()) };
            let [a, b, c] = ray.direction;
            let far = crate::camera::WorldPoint {
                x: ray.origin.x + 9.0 * a, y: ray.origin.y + 9.0 * b, z: ray.origin.z + 9.0 * c,
            };
            if let (Some(told), Some(shown)) = (turn.for_camera(&camera).map_pixel(Pixel { u, v }), new.world_to_pixel(far)) {
                prop_assert!(told.distance(shown) < 1e-5, "{told:?} {shown:?}");
            }
            let again = RotationZoom::between(&camera, &new);
            prop_assert!((0..3).all(|i| (again.vector[i] - turn.vector[i]).abs() < 1e-9), "{again:?} {turn:?}");
            let moved = turn.pan_tilt_zoom(&camera).apply_to(&camera);
            prop_assert!((0..3).all(|i| (0..3).all(|j| (moved.rotation()[i][j] - new.rotation()[i][j]).abs() < 1e-9)));
        }

        #[test]
        fn rotations_compose(
            camera in any_camera(), a in -0.2..0.2_f64, b in -0.2..0.2_f64, u in 300.0..1600.0_f64, v in 200.0..900.0_f64,
        ) {
            let (first, then) = (RotationZoom::from_parameters([a, b, 0.1, 0.05]), RotationZoom::from_parameters([b, 0.0, a, -0.1]));
            let way = first.for_camera(&camera).map_pixel(Pixel { u, v });
            let way = way.and_then(|there| then.for_camera(&first.apply_to(&camera)).map_pixel(there));
            if let (Some(two), Some(one)) = (way, first.followed_by(&then).for_camera(&camera).map_pixel(Pixel { u, v })) {
                prop_assert!(two.distance(one) < 1e-5, "{two:?} {one:?}");
            }
        }
    }
}
