//! Covariance of a floor point: the covariances of the pixel and of the camera, propagated by the Jacobian of
//! the map from pixels to the floor.
//!
//! The ray of a pixel has the direction `d = a right + b down + forward` in world axes, where `(a, b)` is the
//! undistorted pixel relative to the principal point, divided by the focal length. From the camera position
//! C, the ray meets a plane with the normal `n = (-slope, 1)` at `C + t d`. The symbols d', C' and r denote
//! small changes. A change d' of the direction moves the intersection by `t (d' - d (n . d') / (n . d))`. A
//! change C' of the position moves it by `C' - d (n . C') / (n . d)`. A rise r of the plane at the
//! intersection moves it by `d r / (n . d)`. For the floor, `n . d` is `d_z`.

use crate::camera::covariance::Covariance;
use crate::camera::distortion::{Distortion, RayMatrix};
use crate::camera::lens::Lens;
use crate::camera::numerics::sin_cos;
use crate::camera::pinhole::Camera;
use crate::camera::plane::{Plane, ray_to_plane};
use crate::camera::space::{FloorPoint, Pixel};

/// Covariance of a floor point, as the sum of two parts. Rows and columns are x and y, in square metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FloorCovariance {
    /// Part of the covariance that the pixel noise causes. It is independent for every detection.
    pub pixel: [[f64; 2]; 2],
    /// Part of the covariance that calibration errors cause. It is common to all detections of a camera, so a filter
    /// must not average it away. `None` if the uncertainty of the camera is unknown.
    pub calibration: Option<[[f64; 2]; 2]>,
}

impl FloorCovariance {
    /// Covariance for a pixel that shows no floor point: all entries are NaN.
    pub(crate) const NAN: Self = Self { pixel: [[f64::NAN; 2]; 2], calibration: Some([[f64::NAN; 2]; 2]) };

    /// Returns the total covariance: the sum of the pixel part and the calibration part. Returns `None` if
    /// the calibration part is unknown.
    #[must_use]
    pub fn total(&self) -> Option<[[f64; 2]; 2]> {
        let calibration = self.calibration?;
        Some(std::array::from_fn(|i| std::array::from_fn(|j| self.pixel[i][j] + calibration[i][j])))
    }

    /// Returns the pixel part and the calibration part as rows `[xx, xy, yx, yy]`, for arrays. Unknown values
    /// are NaN.
    #[must_use]
    pub fn rows(&self) -> [[f64; 4]; 2] {
        [self.pixel, self.calibration.unwrap_or([[f64::NAN; 2]; 2])].map(|[[a, b], [c, d]]| [a, b, c, d])
    }

    /// Returns the standard deviation of the floor point in the worst direction, in metres. It is the square
    /// root of the larger eigenvalue of the total covariance. Returns `None` if the calibration part is
    /// unknown.
    #[must_use]
    pub fn worst_sigma(&self) -> Option<f64> {
        let [[a, b], [_, d]] = self.total()?;
        Some((0.5 * (a + d) + (0.25 * (a - d) * (a - d) + b * b).sqrt()).max(0.0).sqrt())
    }
}

impl Camera {
    /// Returns the covariance of the floor point at `pixel`. `pixel_sigma` is the standard deviation of each
    /// pixel coordinate, in pixels.
    ///
    /// Returns `None` if the pixel shows no floor point.
    #[must_use]
    pub fn floor_covariance(&self, pixel: Pixel, pixel_sigma: f64) -> Option<FloorCovariance> {
        self.plane_covariance(pixel, pixel_sigma, 0.0)
    }

    /// Returns the covariance of the point at `pixel` on the horizontal plane at `height` metres. See
    /// [`Self::floor_covariance`].
    ///
    /// Returns `None` if the pixel does not show the plane.
    #[must_use]
    pub fn plane_covariance(&self, pixel: Pixel, pixel_sigma: f64, height: f64) -> Option<FloorCovariance> {
        self.covariance_on(pixel, pixel_sigma, &Plane::level(height), &[[0.0; 3]; 3])
    }

    /// Returns the covariance of the point at `pixel` on a plane. `of_plane` is the covariance of the plane:
    /// its height (metres), and its slope along x and y (rise per metre). Its contribution is added to the
    /// calibration part. See [`Self::floor_covariance`].
    ///
    /// Returns `None` if the pixel does not show the plane.
    #[must_use]
    pub fn covariance_on(
        &self,
        pixel: Pixel,
        pixel_sigma: f64,
        plane: &Plane,
        of_plane: &[[f64; 3]; 3],
    ) -> Option<FloorCovariance> {
        let on_plane = PlaneJacobian::new(self, pixel, *plane)?;
        let columns = on_plane.by_pixel();
        let outer = |i: usize, j: usize| columns.iter().map(|c| c[i] * c[j]).sum::<f64>();
        let pixel_part =
            std::array::from_fn(|i| std::array::from_fn(|j| pixel_sigma * pixel_sigma * outer(i, j)));
        let by = on_plane.by_plane();
        let of_plane = |i: usize, j: usize| {
            let along = |a: usize| (0..3).map(|b| of_plane[a][b] * by[b][j]).sum::<f64>();
            (0..3).map(|a| by[a][i] * along(a)).sum::<f64>()
        };
        let calibration = self
            .covariance
            .propagate(&on_plane.by_estimated())
            .map(|camera| std::array::from_fn(|i| std::array::from_fn(|j| camera[i][j] + of_plane(i, j))));
        Some(FloorCovariance { pixel: pixel_part, calibration })
    }

    /// Returns the derivatives `[dx, dy]` of the floor point of a pixel with respect to every parameter of
    /// [`Covariance`]. They are zero for parameters that were not estimated.
    ///
    /// Returns `None` if the pixel shows no floor point.
    #[must_use]
    pub fn floor_jacobian(&self, pixel: Pixel) -> Option<[[f64; 2]; Covariance::SIZE]> {
        self.plane_jacobian(pixel, 0.0)
    }

    /// Returns the same derivatives as [`Self::floor_jacobian`], for the point at which the ray of the pixel meets
    /// the horizontal plane at `height` metres.
    ///
    /// Returns `None` if the ray does not meet this plane.
    #[must_use]
    pub fn plane_jacobian(&self, pixel: Pixel, height: f64) -> Option<[[f64; 2]; Covariance::SIZE]> {
        Some(PlaneJacobian::new(self, pixel, Plane::level(height))?.by_estimated())
    }

    /// Returns the derivatives of the floor point of a pixel with respect to the pixel and to all camera
    /// parameters, estimated or not.
    ///
    /// Returns `None` if the pixel shows no floor point.
    pub fn floor_derivatives(&self, pixel: Pixel) -> Option<FloorDerivatives> {
        let on_floor = PlaneJacobian::new(self, pixel, Plane::FLOOR)?;
        Some(FloorDerivatives { by_pixel: on_floor.by_pixel(), by_camera: on_floor.by_parameters() })
    }
}

/// Derivatives `[dx, dy]` of a floor point, whose coordinates are in metres.
#[derive(Clone, Copy, Debug)]
pub struct FloorDerivatives {
    /// Derivatives with respect to u and to v of the raw pixel, in metres per pixel.
    pub by_pixel: [[f64; 2]; 2],
    /// Derivatives with respect to every parameter of [`Covariance`], in its order and units.
    pub by_camera: [[f64; 2]; Covariance::SIZE],
}

/// Intersection of the ray of a pixel with a plane, and the terms of its derivatives.
struct PlaneJacobian<'a> {
    camera: &'a Camera,
    pixel: Pixel,
    plane: Plane,
    /// Bearing of the pixel: homogeneous undistorted pixel relative to the principal point.
    bearing: [f64; 3],
    /// Derivatives `d bearing / d raw` with respect to the raw pixel.
    by_raw: RayMatrix,
    /// Bearing divided by the focal length.
    normalised: [f64; 3],
    /// Camera axes right, down and forward, as rows in world axes.
    axes: [[f64; 3]; 3],
    /// Direction `d` of the ray in world axes; its forward component is that of the bearing.
    direction: [f64; 3],
    /// Rise `n . d` of the ray relative to the plane.
    rise: f64,
    /// Distance `t` of the intersection `C + t d`, in multiples of the length of `d`.
    reach: f64,
}

impl<'a> PlaneJacobian<'a> {
    /// Intersects the ray of a pixel with a plane. Returns `None` if the pixel does not show the plane.
    fn new(camera: &'a Camera, pixel: Pixel, plane: Plane) -> Option<Self> {
        let (bearing, by_raw) = camera.lens.bearing_with_jacobian(pixel)?;
        ray_to_plane(&camera.bearing_to_ray(bearing), &plane)?;
        let [x, y, w] = bearing;
        let normalised = [x / camera.focal, y / camera.focal, w];
        let axes = camera.rotation();
        let [right, down, forward] = axes;
        let direction =
            std::array::from_fn(|i| normalised[0] * right[i] + normalised[1] * down[i] + w * forward[i]);
        let rise = plane.rise(&direction);
        let reach = (plane.height_at(camera.position.on_floor()) - camera.position.z) / rise;
        Some(Self { camera, pixel, plane, bearing, by_raw, normalised, axes, direction, rise, reach })
    }

    /// Returns the displacement of the intersection for a change of the direction of the ray.
    fn displacement(&self, change: [f64; 3]) -> [f64; 2] {
        self.displacement_on_plane(change).map(|moved| self.reach * moved)
    }

    /// Returns the displacement of the intersection, along x and y, if the ray is shifted by the vector `change` in
    /// world axes. The direction of the ray does not change.
    fn displacement_on_plane(&self, change: [f64; 3]) -> [f64; 2] {
        let off = self.plane.rise(&change);
        [0, 1].map(|i| change[i] - self.direction[i] * off / self.rise)
    }

    /// Returns the derivatives of the intersection with respect to the height, the x slope and the y slope of
    /// the plane.
    fn by_plane(&self) -> [[f64; 2]; 3] {
        let [x, y, _] = self.direction;
        let origin = self.camera.position;
        let at = FloorPoint { x: origin.x + self.reach * x, y: origin.y + self.reach * y };
        self.plane.height_by_parameters(at).map(|by| [x * by / self.rise, y * by / self.rise])
    }

    /// Returns the displacement of the intersection for a change of the bearing.
    fn displacement_by_bearing(&self, [x, y, w]: [f64; 3]) -> [f64; 2] {
        let [right, down, forward] = self.axes;
        let focal = self.camera.focal;
        self.displacement(std::array::from_fn(|i| (x * right[i] + y * down[i]) / focal + w * forward[i]))
    }

    /// Returns the derivatives of the intersection with respect to u and to v of the raw pixel.
    fn by_pixel(&self) -> [[f64; 2]; 2] {
        [0, 1].map(|k| self.displacement_by_bearing(self.by_raw.map(|row| row[k])))
    }

    /// Returns the derivatives of the intersection with respect to yaw, pitch and roll.
    ///
    /// Yaw rotates the ray about world z. Let `unrolled` be the axis `down` before the roll is applied. Pitch
    /// rotates `unrolled` towards `-forward`, and `forward` towards `unrolled`. Roll rotates `right` towards
    /// `down`, and `down` towards `-right`.
    fn by_angles(&self) -> [[f64; 2]; 3] {
        let ([a, b, w], [right, down, forward]) = (self.normalised, self.axes);
        let (sin, cos) = sin_cos(self.camera.roll);
        let [x, y, _] = self.direction;
        let back = -(a * sin + b * cos);
        let pitched = std::array::from_fn(|i| back * forward[i] + w * (sin * right[i] + cos * down[i]));
        let rolled = std::array::from_fn(|i| a * down[i] - b * right[i]);
        [self.displacement([-y, x, 0.0]), self.displacement(pitched), self.displacement(rolled)]
    }

    /// Returns the derivatives of the intersection with respect to every parameter of [`Covariance`].
    fn by_parameters(&self) -> [[f64; 2]; Covariance::SIZE] {
        let [x, y, _] = self.normalised;
        let mut by = [[0.0; 2]; Covariance::SIZE];
        by[Covariance::X] = self.displacement_on_plane([1.0, 0.0, 0.0]);
        by[Covariance::Y] = self.displacement_on_plane([0.0, 1.0, 0.0]);
        by[Covariance::Z] = self.displacement_on_plane([0.0, 0.0, 1.0]);
        [by[Covariance::YAW], by[Covariance::PITCH], by[Covariance::ROLL]] = self.by_angles();
        by[Covariance::FOCAL] = self.displacement_by_bearing([-x, -y, 0.0]);
        let lens = &self.camera.lens;
        if lens.distortion == Distortion::None {
            let [by_u, by_v] = self.by_pixel();
            let away = |[x, y]: [f64; 2]| [-x, -y];
            [by[Covariance::CENTRE], by[Covariance::CENTRE + 1]] = [away(by_u), away(by_v)];
            let down = lens.to_square_pixel(self.pixel).v - lens.principal_point.v;
            by[Covariance::ASPECT] = away(by_v).map(|by| down * by);
        } else {
            let by_lens = lens.bearing_by_parameters(self.pixel, self.bearing);
            for (by, change) in by[Covariance::LENS..].iter_mut().zip(by_lens) {
                *by = self.displacement_by_bearing(change.at);
            }
            if lens.distortion.is_wide() {
                let [x, y] = std::mem::take(&mut by[Covariance::LENS + Lens::LENS_FOCAL]);
                if self.camera.shares_lens_focal() {
                    let focal = self.camera.focal;
                    by[Covariance::FOCAL][0] += x / focal;
                    by[Covariance::FOCAL][1] += y / focal;
                }
            }
        }
        by
    }

    /// Returns the derivatives of the intersection with respect to every parameter of [`Covariance`]. They
    /// are zero for parameters that were not estimated.
    fn by_estimated(&self) -> [[f64; 2]; Covariance::SIZE] {
        let mut by = self.by_parameters();
        for (index, by) in by.iter_mut().enumerate() {
            if self.camera.covariance.sigma(index).is_none() {
                *by = [0.0; 2];
            }
        }
        by
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::any_camera;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn floor_derivatives_agree_with_finite_differences(
            camera in any_camera(), u in 0.0..1920.0_f64, v in 200.0..1080.0_f64, height in -1.0..1.9_f64,
            slope in [-0.1..0.1_f64, -0.1..0.1_f64], is_level in proptest::bool::ANY,
        ) {
            /// Step of finite differences, in metres, radians and pixels. The step of the focal length is
            /// relative, and the step of distortion coefficients has no unit.
            const STEP: f64 = 1e-5;
            let pixel = Pixel { u, v };
            let slope = if is_level { [0.0; 2] } else { slope };
            let plane = Plane { height, slope, anchor: FloorPoint { x: 3.0, y: -1.0 } };
            let point = |camera: &Camera, pixel: Pixel, plane: &Plane| {
                camera.pixel_to_plane(pixel, plane).map(crate::camera::WorldPoint::on_floor)
            };
            let Some(floor) = point(&camera, pixel, &plane) else { return Ok(()) };
            prop_assume!(floor.distance(camera.position.on_floor()) < 50.0);
            let here = PlaneJacobian::new(&camera, pixel, plane).unwrap();
            let check = |numeric: [f64; 2], analytic: [f64; 2], what: usize| {
                for (a, b) in numeric.into_iter().zip(analytic) {
                    prop_assert!((a - b).abs() < 1e-4 * (1.0 + b.abs()), "{what}: {numeric:?} {analytic:?}");
                }
                Ok(())
            };
            let by = here.by_parameters();
            let of_lens = 0..Covariance::LENS + camera.lens.distortion.names().len();
            for index in of_lens.chain(Covariance::CENTRE..Covariance::SIZE) {
                let step = if index == Covariance::FOCAL { STEP * camera.focal } else { STEP };
                let at = |share: f64| point(&camera.nudged(index, share * step), pixel, &plane);
                let difference = |share: f64| {
                    let (a, b) = (at(share)?, at(-share)?);
                    Some([(a.x - b.x) / (2.0 * share * step), (a.y - b.y) / (2.0 * share * step)])
                };
                let (Some(whole), Some(half)) = (difference(1.0), difference(0.5)) else { continue };
                // Just inside the fold of a lens, the differences have not converged.
                if (0..2).any(|k| (whole[k] - half[k]).abs() > 1e-3 * (1.0 + half[k].abs())) {
                    continue;
                }
                // Richardson extrapolation removes the error term in the square of the step.
                check([0, 1].map(|k| (4.0 * half[k] - whole[k]) / 3.0), by[index], index)?;
            }
            for (k, analytic) in here.by_pixel().into_iter().enumerate() {
                let at = |by: f64| {
                    let moved = if k == 0 { Pixel { u: u + by, v } } else { Pixel { u, v: v + by } };
                    point(&camera, moved, &plane)
                };
                let (Some(a), Some(b)) = (at(1e-3), at(-1e-3)) else { continue };
                check([(a.x - b.x) / 2e-3, (a.y - b.y) / 2e-3], analytic, 20 + k)?;
            }
            for (k, analytic) in here.by_plane().into_iter().enumerate() {
                let at = |by: f64| {
                    let mut moved = plane;
                    match k {
                        0 => moved.height += by,
                        _ => moved.slope[k - 1] += by,
                    }
                    point(&camera, pixel, &moved)
                };
                let (Some(a), Some(b)) = (at(STEP), at(-STEP)) else { continue };
                check([(a.x - b.x) / (2.0 * STEP), (a.y - b.y) / (2.0 * STEP)], analytic, 30 + k)?;
            }
        }

        #[test]
        fn pixel_covariance_is_propagated_to_the_floor(camera in any_camera(), u in 0.0..1920.0_f64, v in 200.0..1080.0_f64) {
            let pixel = Pixel { u, v };
            let (Some(floor), Some(covariance)) = (camera.pixel_to_floor(pixel, 0.0), camera.floor_covariance(pixel, 0.5)) else { return Ok(()) };
            prop_assume!(floor.distance(camera.position.on_floor()) < 50.0);
            prop_assert_eq!(covariance.calibration, Some([[0.0; 2]; 2]));
            let imported = Camera { covariance: Covariance::UNKNOWN, ..camera };
            let of_imported = imported.floor_covariance(pixel, 0.5);
            prop_assert!(of_imported.is_some_and(|c| c.calibration.is_none() && c.pixel == covariance.pixel), "unknown is not zero");
            // A change of 1 % of the pixel noise moves the floor point by at most 1 % of the worst standard
            // deviation.
            for (du, dv) in [(0.005, 0.0), (0.0, 0.005), (0.004, -0.003)] {
                let moved = camera.pixel_to_floor(Pixel { u: u + du, v: v + dv }, 0.0);
                prop_assert!(moved.is_some_and(|m| m.distance(floor) < 0.0102 * covariance.worst_sigma().unwrap()));
            }
        }

        #[test]
        fn height_error_scales_floor_distances(camera in any_camera(), u in 0.0..1920.0_f64, v in 200.0..1080.0_f64) {
            let mut camera = camera;
            camera.covariance.0[Covariance::Z][Covariance::Z] = 0.01_f64.powi(2);
            let (Some(floor), Some(covariance)) = (camera.pixel_to_floor(Pixel { u, v }, 0.0), camera.floor_covariance(Pixel { u, v }, 0.0)) else { return Ok(()) };
            let range = floor.distance(camera.position.on_floor());
            prop_assume!(range < 50.0);
            prop_assert!((covariance.worst_sigma().unwrap() - 0.01 * range / camera.position.z).abs() < 1e-6 * (1.0 + range));
        }
    }
}
