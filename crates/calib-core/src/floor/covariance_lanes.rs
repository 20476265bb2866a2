//! Covariances of many floor points at once, in step, so that the compiler can use vector instructions: what
//! [`Camera::covariance_on`] says of one.
//!
//! A change c of a ray's direction d moves its point of the plane by `D(c) = t (c - d (n . c) / (n . d))`, which is
//! linear, and `D(d) = 0`. With `d = a right + b down + forward` the change by pitch, by roll, by the focal and by
//! every coefficient of the lens is a mixture of `D(right)` and `D(down)`.

use crate::camera::{
    BrownConrady, BrownInverse, Camera, Covariance, FloorCovariance, LANES, Pixel, Plane, sin_cos,
};

type Lanes = [f64; LANES];

/// A camera and a plane prepared for covariances.
#[derive(Clone, Debug)]
pub(super) struct CovarianceLanes<'a> {
    camera: &'a Camera,
    plane: &'a Plane,
    /// The lens, if it bends.
    lens: Option<(&'a BrownInverse, BrownConrady)>,
    /// Rows right, down, forward.
    axes: [[f64; 3]; 3],
    /// The unknowns that were estimated; none where nothing is known of the errors.
    estimated: Option<Vec<usize>>,
}

/// The Jacobian of floor points: rows x and y.
#[derive(Clone, Copy, Debug)]
struct Jacobian([[Lanes; 2]; Covariance::SIZE]);

impl<'a> CovarianceLanes<'a> {
    pub(super) fn new(
        camera: &'a Camera,
        plane: &'a Plane,
        lens: Option<(&'a BrownInverse, BrownConrady)>,
    ) -> Self {
        let is_estimated = |&index: &usize| camera.covariance.sigma(index).is_some();
        let estimated =
            camera.covariance.is_known().then(|| (0..Covariance::SIZE).filter(is_estimated).collect());
        Self { camera, plane, lens, axes: camera.rotation(), estimated }
    }

    /// Of as many pixels as there are lanes; `variance` that of a coordinate of a pixel.
    #[inline(always)]
    pub(super) fn of(&self, u: &Lanes, v: &Lanes, variance: f64) -> [FloorCovariance; LANES] {
        let (Pixel { u: cu, v: cv }, lens_focal) = (self.camera.lens.principal_point, self.camera.lens.focal);
        let mut x = u.map(|u| (u - cu) / lens_focal);
        let mut y = v.map(|v| (v - cv) / lens_focal);
        // The inverse of the Jacobian of the lens, which is symmetric.
        let mut unbend = [[1.0; LANES], [0.0; LANES], [1.0; LANES]];
        if let Some((inverse, brown)) = self.lens {
            inverse.undistort(&mut x, &mut y);
            for i in 0..LANES {
                let [a, b, d] = brown.jacobian([x[i], y[i]]);
                let scale = (a * d - b * b).recip();
                [unbend[0][i], unbend[1][i], unbend[2][i]] = [d * scale, -b * scale, a * scale];
            }
        }
        let (jacobian, by_pixel) = self.jacobian(&x, &y, &unbend);
        let pixel = covariance(|row, i| [by_pixel[0][row][i], by_pixel[1][row][i]], variance);
        let calibration = self.estimated.as_ref().map(|estimated| self.carried(&jacobian, estimated));
        std::array::from_fn(|i| {
            if pixel[0][i].is_finite() {
                let square = |of: &[Lanes; 3]| [[of[0][i], of[1][i]], [of[1][i], of[2][i]]];
                FloorCovariance { pixel: square(&pixel), calibration: calibration.as_ref().map(square) }
            } else {
                FloorCovariance::NONE
            }
        })
    }

    /// By the unknowns of the camera, and by u and v of the raw pixel; NaN where the plane is not seen.
    #[inline(always)]
    fn jacobian(&self, x: &Lanes, y: &Lanes, unbend: &[Lanes; 3]) -> (Jacobian, [[Lanes; 2]; 2]) {
        /// As for one pixel: what is farther is the horizon's rounding.
        const FARTHEST: f64 = 1e12;
        let ([right, down, forward], focal, plane) = (self.axes, self.camera.focal, self.plane);
        let drop = plane.height_at(self.camera.position.on_floor()) - self.camera.position.z;
        let (sin, cos) = sin_cos(self.camera.roll);
        let (rise_right, rise_down, rise_forward) =
            (plane.rise(&right), plane.rise(&down), plane.rise(&forward));
        let ratio = self.camera.lens.focal / focal;
        let mut by = Jacobian([[[0.0; LANES]; 2]; Covariance::SIZE]);
        let mut by_pixel = [[[0.0; LANES]; 2]; 2];
        for i in 0..LANES {
            let (a, b) = (ratio * x[i], ratio * y[i]);
            let along = |k: usize| a * right[k] + b * down[k] + forward[k];
            let direction = [along(0), along(1)];
            let rise = a * rise_right + b * rise_down + rise_forward;
            let (by_rise, square) = (rise.recip(), direction[0] * direction[0] + direction[1] * direction[1]);
            let reach = drop * by_rise;
            let is_seen =
                (reach > 0.0) & (reach * reach * (square + along(2) * along(2)) < FARTHEST * FARTHEST);
            let reach = if is_seen { reach } else { f64::NAN };
            let turned = plane.rise(&[-direction[1], direction[0], 0.0]);
            let back = -(a * sin + b * cos);
            for k in 0..2 {
                let tilt = direction[k] * by_rise;
                let by_right = reach * (right[k] - tilt * rise_right);
                let by_down = reach * (down[k] - tilt * rise_down);
                let unit = |axis: usize| if axis == k { 1.0 } else { 0.0 };
                let yawed = if k == 0 { -direction[1] } else { direction[0] };
                by.0[Covariance::X][k][i] = unit(0) + tilt * plane.slope[0];
                by.0[Covariance::Y][k][i] = unit(1) + tilt * plane.slope[1];
                by.0[Covariance::Z][k][i] = -tilt;
                by.0[Covariance::YAW][k][i] = reach * (yawed - tilt * turned);
                by.0[Covariance::PITCH][k][i] = (sin - back * a) * by_right + (cos - back * b) * by_down;
                by.0[Covariance::ROLL][k][i] = a * by_down - b * by_right;
                by.0[Covariance::FOCAL][k][i] = -(a * by_right + b * by_down) / focal;
                let (by_u, by_v) = (by_right / focal, by_down / focal);
                by_pixel[0][k][i] = unbend[0][i] * by_u + unbend[1][i] * by_v;
                by_pixel[1][k][i] = unbend[1][i] * by_u + unbend[2][i] * by_v;
            }
        }
        if let Some((_, brown)) = self.lens {
            self.add_lens(&mut by, &by_pixel, &brown, x, y);
        }
        (by, by_pixel)
    }

    /// By the coefficients of the lens: a raw pixel that stays is undistorted to another place, by `-A^-1` of what the
    /// coefficient changes.
    #[inline(always)]
    fn add_lens(
        &self,
        by: &mut Jacobian,
        by_pixel: &[[Lanes; 2]; 2],
        brown: &BrownConrady,
        x: &Lanes,
        y: &Lanes,
    ) {
        let focal = self.camera.lens.focal;
        for i in 0..LANES {
            let changes = brown.distorted_by_coefficients([x[i], y[i]]);
            for (index, [dx, dy]) in changes.into_iter().enumerate() {
                for k in 0..2 {
                    let moved = by_pixel[0][k][i] * dx + by_pixel[1][k][i] * dy;
                    by.0[Covariance::LENS + index][k][i] = -focal * moved;
                }
            }
        }
    }

    /// The covariance of the camera, propagated: xx, xy, yy. It is symmetric: every pair of unknowns counts twice.
    #[inline(always)]
    fn carried(&self, by: &Jacobian, estimated: &[usize]) -> [Lanes; 3] {
        let covariance = &self.camera.covariance.0;
        let mut sum = [[0.0; LANES]; 3];
        for (first, &row) in estimated.iter().enumerate() {
            let mut others = [[0.0; LANES]; 2];
            for &column in &estimated[first + 1..] {
                let (entry, [x, y]) = (covariance[row][column], &by.0[column]);
                for i in 0..LANES {
                    others[0][i] += entry * x[i];
                    others[1][i] += entry * y[i];
                }
            }
            let (own, [x, y]) = (covariance[row][row], &by.0[row]);
            for i in 0..LANES {
                sum[0][i] += x[i] * (own * x[i] + 2.0 * others[0][i]);
                sum[1][i] += x[i] * (own * y[i] + others[1][i]) + y[i] * others[0][i];
                sum[2][i] += y[i] * (own * y[i] + 2.0 * others[1][i]);
            }
        }
        sum
    }
}

/// Of a pair of quantities with these derivatives by u and v, row by row: xx, xy, yy.
#[inline(always)]
fn covariance(by_pixel: impl Fn(usize, usize) -> [f64; 2], variance: f64) -> [Lanes; 3] {
    [(0, 0), (0, 1), (1, 1)].map(|(row, column)| {
        std::array::from_fn(|i| {
            let ([a, b], [c, d]) = (by_pixel(row, i), by_pixel(column, i));
            variance * (a * c + b * d)
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::any_camera;
    use crate::floor::projector::FloorProjector;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn covariances_in_step_are_those_of_pixels_by_themselves(
            camera in any_camera(), factors in proptest::collection::vec(-1.0..1.0_f64, 196), is_known: bool,
            at in proptest::collection::vec((0.0..1920.0_f64, -100.0..1080.0_f64), 1..30),
            height in -1.0..1.5_f64, slope in [-0.1..0.1_f64, -0.1..0.1_f64],
        ) {
            /// How sure the unknowns are: metres, radians, pixels, coefficients.
            const SIGMAS: [f64; Covariance::SIZE] =
                [0.03, 0.02, 0.05, 0.01, 0.004, 0.003, 9.0, 0.01, 0.008, 0.005, 1e-4, 1e-4, 0.0, 0.0];
            let mut camera = camera;
            for i in 0..Covariance::SIZE {
                for j in 0..Covariance::SIZE {
                    let sum: f64 = (0..14).map(|k| factors[14 * i + k] * factors[14 * j + k]).sum();
                    camera.covariance.0[i][j] = if is_known { sum * SIGMAS[i] * SIGMAS[j] } else { 0.0 };
                }
            }
            if !is_known {
                camera.covariance = Covariance::UNKNOWN;
            }
            let plane = Plane { height, slope, anchor: camera.position.on_floor() };
            let (u, v): (Vec<f64>, Vec<f64>) = at.iter().copied().unzip();
            let mut found = vec![FloorCovariance::NONE; at.len()];
            FloorProjector::on(&camera, &plane).floor_covariances(&u, &v, 0.7, &mut found);
            for i in 0..at.len() {
                match camera.covariance_on(Pixel { u: u[i], v: v[i] }, 0.7, &plane, &[[0.0; 3]; 3]) {
                    None => prop_assert!(found[i].pixel[0][0].is_nan()),
                    Some(alone) => {
                        // A ray is right to 1e-13 of a focal in step, its place on the floor to that many times
                        // the distance in heights.
                        let range = camera.pixel_to_plane(Pixel { u: u[i], v: v[i] }, &plane).map_or(f64::NAN, |foot| {
                            foot.on_floor().distance(camera.position.on_floor()) / (camera.position.z - height)
                        });
                        prop_assume!(range < 1e6);
                        prop_assert_eq!(alone.calibration.is_some(), found[i].calibration.is_some());
                        for (alone, found) in alone.rows().iter().zip(found[i].rows()) {
                            let size = (1e-10 + 1e-12 * range) * (alone[0] + alone[3]);
                            let near = |k: usize| !(alone[k] - found[k]).is_nan() && (alone[k] - found[k]).abs() <= size;
                            prop_assert!(alone[0].is_nan() || (0..4).all(near), "{alone:?} {found:?}");
                        }
                    }
                }
            }
        }
    }
}
