//! Plane of the scene other than the floor: another carriageway, a ramp, a platform, a stair step.
//!
//! The equation of a plane is `z = height + slope . ((x, y) - anchor)`. A ray `C + t d` with the origin C and
//! the direction d meets the plane at `t = (height + slope . (C_xy - anchor) - C_z) / (d_z - slope . d_xy)`.

use crate::camera::numerics::{atan, hypot, sin_cos, tan};
use crate::camera::pinhole::{Camera, Ray};
use crate::camera::space::{FloorPoint, Pixel, WorldPoint};

/// Plane that is not vertical, in world coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Plane {
    /// Height above the floor at the anchor, in metres.
    pub height: f64,
    /// Slope: rise of the plane per metre along world x and along world y.
    pub slope: [f64; 2],
    /// Floor point (x, y) at which the plane has the height `height`.
    pub anchor: FloorPoint,
}

impl Plane {
    /// Floor plane: z = 0.
    pub const FLOOR: Self = Self::level(0.0);

    /// Creates a horizontal plane `height` metres above the floor.
    #[must_use]
    pub const fn level(height: f64) -> Self {
        Self { height, slope: [0.0; 2], anchor: FloorPoint { x: 0.0, y: 0.0 } }
    }

    /// Creates a plane with the height `height` at the anchor, in metres, which falls in the direction
    /// `toward`. The direction is counter-clockwise from world +x. `fall` is the angle below the horizontal.
    /// Both angles are in radians.
    #[must_use]
    pub fn falling(height: f64, toward: f64, fall: f64, anchor: FloorPoint) -> Self {
        let ((sin, cos), rise) = (sin_cos(toward), -tan(fall));
        Self { height, slope: [rise * cos, rise * sin], anchor }
    }

    /// Returns the angle between the plane and the horizontal, in radians; 0 for a horizontal plane.
    #[must_use]
    pub fn fall(&self) -> f64 {
        atan(hypot(self.slope[0], self.slope[1]))
    }

    /// Returns the direction in which the plane falls most steeply, in radians counter-clockwise from world
    /// +x. Returns 0 for a horizontal plane.
    #[must_use]
    pub fn toward(&self) -> f64 {
        if self.slope == [0.0; 2] { 0.0 } else { (-self.slope[1]).atan2(-self.slope[0]) }
    }

    /// Returns the height of the plane above the floor at the floor point `at`, in metres.
    #[must_use]
    pub fn height_at(&self, at: FloorPoint) -> f64 {
        self.height + self.slope[0] * (at.x - self.anchor.x) + self.slope[1] * (at.y - self.anchor.y)
    }

    /// Returns the plane `height` metres vertically above this one.
    #[must_use]
    pub fn raised(&self, height: f64) -> Self {
        Self { height: self.height + height, ..*self }
    }

    /// Returns the derivatives of the height of the plane at a floor point. They are with respect to the
    /// height at the anchor, the x slope and the y slope.
    pub(crate) fn height_by_parameters(&self, at: FloorPoint) -> [f64; 3] {
        [1.0, at.x - self.anchor.x, at.y - self.anchor.y]
    }

    /// Returns the height above the plane that a point gains if it moves by the vector `direction`.
    pub(crate) fn rise(&self, direction: &[f64; 3]) -> f64 {
        direction[2] - (self.slope[0] * direction[0] + self.slope[1] * direction[1])
    }
}

impl Camera {
    /// Intersects the ray of a raw pixel with a plane. Returns the intersection as a world point.
    ///
    /// Returns `None` if the ray does not meet the plane in front of the camera, or the pixel is outside the
    /// lens.
    #[must_use]
    pub fn pixel_to_plane(&self, pixel: Pixel, plane: &Plane) -> Option<WorldPoint> {
        ray_to_plane(&self.pixel_to_ray(pixel)?, plane)
    }

    /// Intersects the ray from the camera through a world point with a plane. The camera shows the point and
    /// the intersection at the same pixel.
    ///
    /// Returns `None` if the ray does not meet the plane in front of the camera.
    #[must_use]
    pub fn point_to_plane(&self, at: WorldPoint, plane: &Plane) -> Option<WorldPoint> {
        let origin = self.position;
        let direction = [at.x - origin.x, at.y - origin.y, at.z - origin.z];
        ray_to_plane(&Ray { origin, direction }, plane)
    }

    /// Returns the homography from undistorted pixels to x and y, in metres, on the horizontal plane at
    /// `height` metres. It is a 3 x 3 matrix of homogeneous points, row by row.
    ///
    /// For planes below the camera, the third coordinate of a mapped point is positive for pixels that show
    /// the plane. It is zero or negative on and above the horizon.
    #[must_use]
    pub fn homography_floor_from_pixel(&self, height: f64) -> [[f64; 3]; 3] {
        self.homography_plane_from_pixel(&Plane::level(height))
    }

    /// Returns the homography from undistorted pixels to x and y, in metres, of the points of a plane. It is
    /// a 3 x 3 matrix of homogeneous points, row by row. The third coordinate of a mapped point is positive for
    /// pixels that show the plane from above.
    ///
    /// Let d be the direction of the ray of a pixel, and C the camera position. Let D be the height of the
    /// plane at C minus the height of C. The ray meets the plane at `C + d D / rise` with
    /// `rise = d_z - slope . d_xy`. The homogeneous point `(-C_x rise - D d_x, -C_y rise - D d_y, -rise)` is
    /// linear in the pixel.
    #[must_use]
    pub fn homography_plane_from_pixel(&self, plane: &Plane) -> [[f64; 3]; 3] {
        let Pixel { u: cu, v: cv } = self.lens.principal_point;
        let [right, down, forward] = self.rotation();
        // Components of the ray times the focal length, as linear functions of (u, v, 1).
        let direction =
            |i: usize| [right[i], down[i], self.focal * forward[i] - cu * right[i] - cv * down[i]];
        let (dx, dy, dz) = (direction(0), direction(1), direction(2));
        let rises: [f64; 3] = std::array::from_fn(|j| plane.rise(&[dx[j], dy[j], dz[j]]));
        let WorldPoint { x: x0, y: y0, z: z0 } = self.position;
        let drop = z0 - plane.height_at(self.position.on_floor());
        [
            std::array::from_fn(|j| drop * dx[j] - x0 * rises[j]),
            std::array::from_fn(|j| drop * dy[j] - y0 * rises[j]),
            rises.map(|rise| -rise),
        ]
    }
}

/// Intersects a ray with a plane. The direction of the ray may have any length. Returns `None` if they do not
/// meet in front of the origin of the ray.
pub(crate) fn ray_to_plane(ray: &Ray, plane: &Plane) -> Option<WorldPoint> {
    /// Maximum distance of an intersection from the origin of the ray, in multiples of the length of the direction. A
    /// larger value is a rounding error at the horizon.
    const MAX_DISTANCE: f64 = 1e12;
    let drop = plane.height_at(ray.origin.on_floor()) - ray.origin.z;
    let distance = drop / plane.rise(&ray.direction);
    (distance > 0.0 && distance < MAX_DISTANCE).then(|| {
        let [x, y, _] = ray.direction;
        let at = FloorPoint { x: ray.origin.x + distance * x, y: ray.origin.y + distance * y };
        WorldPoint { x: at.x, y: at.y, z: plane.height_at(at) }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::any_camera;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn plane_point_of_a_pixel_maps_back_to_the_pixel(
            camera in any_camera(), u in 0.0..1920.0_f64, v in 0.0..1080.0_f64, height in -1.0..1.0_f64,
            toward in -3.0..3.0_f64, fall in 0.0..0.2_f64,
        ) {
            let plane = Plane::falling(height, toward, fall, FloorPoint { x: 1.0, y: -2.0 });
            prop_assert!((plane.fall() - fall).abs() < 1e-12);
            let Some(at) = camera.pixel_to_plane(Pixel { u, v }, &plane) else { return Ok(()) };
            prop_assume!(at.on_floor().distance(camera.position.on_floor()) < 100.0);
            let back = camera.world_to_pixel(at).unwrap();
            prop_assert!(back.distance(Pixel { u, v }) < 1e-6, "{back:?}");
        }

        #[test]
        fn plane_homography_agrees_with_the_ray_intersection(
            camera in any_camera(), u in 0.0..1920.0_f64, v in 0.0..1080.0_f64, height in -1.0..1.0_f64,
            slope in [-0.1..0.1_f64, -0.1..0.1_f64],
        ) {
            let plane = Plane { height, slope, anchor: FloorPoint { x: 1.0, y: -2.0 } };
            let Some(at) = camera.pixel_to_plane(Pixel { u, v }, &plane) else { return Ok(()) };
            prop_assume!(at.on_floor().distance(camera.position.on_floor()) < 100.0);
            prop_assume!(camera.position.z > plane.height_at(camera.position.on_floor()));
            let undistorted = camera.undistort(Pixel { u, v }).unwrap();
            let [x, y, w] = camera.homography_plane_from_pixel(&plane).map(|[a, b, c]| a * undistorted.u + b * undistorted.v + c);
            prop_assert!(w > 0.0);
            let mapped = FloorPoint { x: x / w, y: y / w };
            prop_assert!(mapped.distance(at.on_floor()) < 1e-6);
        }

        #[test]
        fn level_plane_agrees_with_the_floor_at_its_height(
            camera in any_camera(), u in 0.0..1920.0_f64, v in 0.0..1080.0_f64, height in -1.0..1.0_f64,
        ) {
            let on_plane = camera.pixel_to_plane(Pixel { u, v }, &Plane::level(height));
            let on_floor = camera.pixel_to_floor(Pixel { u, v }, height);
            prop_assert_eq!(on_plane.map(WorldPoint::on_floor), on_floor);
        }
    }
}
