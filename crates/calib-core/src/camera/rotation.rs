//! How a camera moved in its place: turned, and zoomed.
//!
//! How a camera turned and zoomed in its place: where it shows now what it showed before.
//!
//! A ray `r` of the old camera axes is `R r` in the new ones, whatever its depth: the pixels of two stills are bound to
//! each other by `R` and the ratio of the focals alone. What the camera did besides, a step `t` in its axes, moves a
//! thing at depth `z` by the ray `r - t / z` (Hartley & Zisserman 2004, section 13.2).

use crate::camera::{Camera, Covariance, FloorSlopes, Pixel, UndistortedPixel, angles_from_rotation};

/// How a camera moved in its place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Movement {
    /// Change of the yaw, in radians: positive turns to the left.
    pub pan: f64,
    /// Change of the pitch, in radians: positive turns down.
    pub tilt: f64,
    /// Change of the roll, in radians: positive turns clockwise as seen from behind.
    pub roll: f64,
    /// Logarithm of the ratio of the focals, new over old.
    pub zoom: f64,
}

impl Movement {
    /// Number of parameters.
    pub const SIZE: usize = 4;
    /// Index of the pan.
    pub const PAN: usize = 0;
    /// Index of the tilt.
    pub const TILT: usize = 1;
    /// Index of the roll.
    pub const ROLL: usize = 2;
    /// Index of the zoom.
    pub const ZOOM: usize = 3;

    /// The movement of these parameters, in the order of the fields.
    #[must_use]
    pub const fn of([pan, tilt, roll, zoom]: [f64; Self::SIZE]) -> Self {
        Self { pan, tilt, roll, zoom }
    }

    /// The angle of the whole turn, in radians; of small ones.
    #[must_use]
    pub fn turn(&self, pitch: f64) -> f64 {
        // The axes of pan and roll are at right angles only for a level camera.
        let along = self.pan * pitch.sin();
        ((self.pan * pitch.cos()).powi(2) + self.tilt.powi(2) + (self.roll - along).powi(2)).sqrt()
    }

    /// The camera after it.
    #[must_use]
    pub fn applied(&self, camera: &Camera) -> Camera {
        Camera {
            yaw: camera.yaw + self.pan,
            pitch: camera.pitch + self.tilt,
            roll: camera.roll + self.roll,
            focal: camera.focal * self.zoom.exp(),
            ..*camera
        }
    }

    /// Derivatives of a floor point by the parameters.
    pub fn slopes(camera: &Camera, of: &FloorSlopes) -> [[f64; 2]; Self::SIZE] {
        let by = &of.by_camera;
        let zoom = by[Covariance::FOCAL].map(|change| camera.focal * change);
        [by[Covariance::YAW], by[Covariance::PITCH], by[Covariance::ROLL], zoom]
    }
}

/// How a camera turned and zoomed in its place.
///
/// The lens stays the map of pixels that it was.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Turn {
    /// The axis in the old camera's axes (right, down, forward), as long as the angle, in radians: what has the
    /// coordinates `x` in the old axes has `exp(vector) x` in the new ones.
    pub vector: [f64; 3],
    /// Logarithm of the ratio of the focals, new over old.
    pub zoom: f64,
}

type Matrix = [[f64; 3]; 3];

/// A camera before and after a turn.
#[derive(Clone, Debug)]
pub struct Turned {
    old: Camera,
    rotation: Matrix,
    focal: f64,
}

impl Turn {
    /// Number of parameters.
    pub const SIZE: usize = 4;

    /// The turn of these parameters: the vector, then the zoom.
    #[must_use]
    pub const fn of([x, y, z, zoom]: [f64; Self::SIZE]) -> Self {
        Self { vector: [x, y, z], zoom }
    }

    /// The turn that leads from the old camera's axes to new ones by this matrix, whose rows are the new axes in the old.
    #[must_use]
    pub fn of_rotation(rotation: &Matrix, zoom: f64) -> Self {
        let r = rotation;
        let axis = [r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]];
        let sine = 0.5 * axis.iter().map(|c| c * c).sum::<f64>().sqrt();
        let angle = sine.atan2(0.5 * (r[0][0] + r[1][1] + r[2][2] - 1.0));
        // Half the axis is the sine times its unit vector, and for small angles the angle itself.
        let scale = if sine > 1e-12 { 0.5 * angle / sine } else { 0.5 };
        Self { vector: axis.map(|c| scale * c), zoom }
    }

    /// The turn from one camera to another that stands where it stood.
    #[must_use]
    pub fn between(old: &Camera, new: &Camera) -> Self {
        let rotation = product(&new.rotation(), &transposed(&old.rotation()));
        Self::of_rotation(&rotation, (new.focal / old.focal).ln())
    }

    /// The angle, in radians.
    #[must_use]
    pub fn angle(&self) -> f64 {
        self.vector.iter().map(|c| c * c).sum::<f64>().sqrt()
    }

    /// This turn, and then another one.
    #[must_use]
    pub fn then(&self, next: &Self) -> Self {
        Self::of_rotation(&product(&next.rotation(), &self.rotation()), self.zoom + next.zoom)
    }

    /// Rows of the new axes in the old ones (Rodrigues 1840).
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

    /// The camera after it.
    #[must_use]
    pub fn applied(&self, camera: &Camera) -> Camera {
        let (roll, pitch, yaw) = angles_from_rotation(&product(&self.rotation(), &camera.rotation()));
        Camera { roll, pitch, yaw, focal: camera.focal * self.zoom.exp(), ..*camera }
    }

    /// What it does to the angles and the focal of a camera.
    #[must_use]
    pub fn movement(&self, camera: &Camera) -> Movement {
        let new = self.applied(camera);
        let half = std::f64::consts::PI;
        let turn = |to: f64, from: f64| (to - from + half).rem_euclid(2.0 * half) - half;
        Movement {
            pan: turn(new.yaw, camera.yaw),
            tilt: new.pitch - camera.pitch,
            roll: turn(new.roll, camera.roll),
            zoom: self.zoom,
        }
    }

    /// The old camera with this turn.
    #[must_use]
    pub fn at(&self, camera: &Camera) -> Turned {
        Turned { old: *camera, rotation: self.rotation(), focal: camera.focal * self.zoom.exp() }
    }
}

impl Turned {
    /// Where the new still shows what the old one shows at a pixel; `None` behind the camera and outside the lens.
    #[must_use]
    pub fn pixel(&self, old: Pixel) -> Option<Pixel> {
        self.shown(ray_in_camera(&self.old, old)?)
    }

    /// Where the new still shows what lies along a ray of the old camera's axes.
    #[must_use]
    pub fn shown(&self, ray: [f64; 3]) -> Option<Pixel> {
        self.old.lens.distort(self.shown_undistorted(ray)?)
    }

    /// The same, were the lens a pinhole.
    #[must_use]
    pub fn shown_undistorted(&self, ray: [f64; 3]) -> Option<UndistortedPixel> {
        let [x, y, z] = self.rotation.map(|row| row[0] * ray[0] + row[1] * ray[1] + row[2] * ray[2]);
        let Pixel { u, v } = self.old.lens.principal_point;
        (z > 1e-6).then(|| UndistortedPixel { u: u + self.focal * x / z, v: v + self.focal * y / z })
    }
}

/// The ray that a camera shows at a pixel, in its axes with depth 1; `None` outside the lens.
#[must_use]
pub fn ray_in_camera(camera: &Camera, pixel: Pixel) -> Option<[f64; 3]> {
    let straight = camera.undistort(pixel)?;
    let Pixel { u, v } = camera.lens.principal_point;
    Some([(straight.u - u) / camera.focal, (straight.v - v) / camera.focal, 1.0])
}

/// One over the depth at which a ray of the camera's axes meets the floor, per metre; 0 above the horizon.
#[must_use]
pub fn floor_nearness(camera: &Camera, ray: [f64; 3]) -> f64 {
    let [right, down, forward] = camera.rotation();
    let falls = -(ray[0] * right[2] + ray[1] * down[2] + ray[2] * forward[2]);
    (falls / camera.position.z.max(f64::MIN_POSITIVE)).max(0.0)
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

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
        fn what_the_old_camera_shows_the_new_one_shows_where_the_turn_says(
            camera in any_camera(), x in -0.2..0.2_f64, y in -0.2..0.2_f64, z in -0.3..0.3_f64, zoom in -0.4..0.4_f64,
            u in 300.0..1600.0_f64, v in 200.0..900.0_f64,
        ) {
            let turn = Turn::of([x, y, z, zoom]);
            let new = turn.applied(&camera);
            let Some(ray) = camera.pixel_to_ray(Pixel { u, v }) else { return Ok(()) };
            let [a, b, c] = ray.direction;
            let far = crate::camera::WorldPoint {
                x: ray.origin.x + 9.0 * a, y: ray.origin.y + 9.0 * b, z: ray.origin.z + 9.0 * c,
            };
            if let (Some(told), Some(shown)) = (turn.at(&camera).pixel(Pixel { u, v }), new.world_to_pixel(far)) {
                prop_assert!(told.distance(shown) < 1e-5, "{told:?} {shown:?}");
            }
            let again = Turn::between(&camera, &new);
            prop_assert!((0..3).all(|i| (again.vector[i] - turn.vector[i]).abs() < 1e-9), "{again:?} {turn:?}");
            let moved = turn.movement(&camera).applied(&camera);
            prop_assert!((0..3).all(|i| (0..3).all(|j| (moved.rotation()[i][j] - new.rotation()[i][j]).abs() < 1e-9)));
        }

        #[test]
        fn turns_follow_one_another(
            camera in any_camera(), a in -0.2..0.2_f64, b in -0.2..0.2_f64, u in 300.0..1600.0_f64, v in 200.0..900.0_f64,
        ) {
            let (first, then) = (Turn::of([a, b, 0.1, 0.05]), Turn::of([b, 0.0, a, -0.1]));
            let way = first.at(&camera).pixel(Pixel { u, v });
            let way = way.and_then(|there| then.at(&first.applied(&camera)).pixel(there));
            if let (Some(two), Some(one)) = (way, first.then(&then).at(&camera).pixel(Pixel { u, v })) {
                prop_assert!(two.distance(one) < 1e-5, "{two:?} {one:?}");
            }
        }
    }
}
