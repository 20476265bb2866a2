//! Covariances of many points of a plane at once, in step, so that the compiler can use vector instructions: what
//! [`Camera::covariance_on`] says of one.
//!
//! Let `d = (x, y, z)` be the way from the camera to a point of the plane, whose normal is `n = (-slope, 1)`: `n . d` is the
//! drop q to the plane, the same for all points. A change c of d moves the point where its ray meets the plane by
//! `D(c) = c - d (n . c) / q`.
//!
//! **By the camera**: `flow_covariance.rs`.
//!
//! **By the pixel.** With a and b in pixels from the principal point a ray is `a right + b down + f forward`,
//! `d = t (a right + b down + f forward)` with `t = q / r`, and r is affine in a and b. So the point moves with (a, b) by
//! `T = t [D(right), D(down)]`, in which what is quadratic cancels: `T = t^2 / q (M + b K, N - a K)`, with columns M, N and K
//! that are the same for all pixels.

use crate::camera::{BrownConrady, BrownInverse, Camera, Distortion, LANES, Pixel, Plane};
use crate::floor::flow_covariance::FlowCovariance;
use crate::floor::lanes::Lanes;

/// As many pixels of a straight lens as are fastest in step: with two steps of the widest instructions side by side, one
/// does not wait for the other.
pub(super) const STRAIGHT_LANES: usize = 2 * LANES;

/// A camera and a plane prepared for covariances.
#[derive(Clone, Debug)]
pub(super) struct CovarianceLanes<'a> {
    camera: &'a Camera,
    /// That of a coordinate of a pixel, in pixels.
    sigma: f64,
    /// Rows right, down and f times forward, of each its x, its y and `(n . axis) / q`.
    axes: [[f64; 3]; 3],
    /// M, N and K over q, of x and of y.
    minors: [[f64; 3]; 2],
    /// The same times sigma.
    of_sigma: [[f64; 3]; 2],
    /// None where nothing is known of the errors.
    flow: Option<FlowCovariance>,
}

/// Points of the plane, from the point above which the camera is.
struct Points<const N: usize> {
    x: Lanes<N>,
    y: Lanes<N>,
    /// Square of t; NaN where the plane is not seen.
    square: Lanes<N>,
}

/// How points of the plane move with (a, b), as rows x and y of T, or of T over t^2.
#[derive(Clone, Copy, Debug)]
struct Slopes<const N: usize>([[Lanes<N>; 2]; 2]);

impl<'a> CovarianceLanes<'a> {
    /// `sigma` is that of a coordinate of a pixel.
    pub(super) fn new(camera: &'a Camera, plane: &Plane, sigma: f64) -> Self {
        let axes = camera.rotation();
        let drop = plane.height_at(camera.position.on_floor()) - camera.position.z;
        let flow = camera.covariance.is_known().then(|| FlowCovariance::new(camera, plane, &axes, drop));
        let [right, down, forward] = axes;
        let axes = [right, down, forward.map(|axis| camera.focal * axis)];
        let rise = axes.map(|axis| plane.rise(&axis));
        let minors = [0, 1].map(|k| {
            let minor = |i: usize, j: usize| (axes[i][k] * rise[j] - axes[j][k] * rise[i]) / drop;
            [minor(0, 2), minor(1, 2), minor(0, 1)]
        });
        let axes = [0, 1, 2].map(|i| [axes[i][0], axes[i][1], rise[i] / drop]);
        let of_sigma = minors.map(|row| row.map(|minor| sigma * minor));
        Self { camera, sigma, axes, minors, of_sigma, flow }
    }

    /// Of pixels of a straight lens. That of the pixel and that of the calibration, each xx, xy, yy: NaN where the plane is
    /// not seen, and where nothing is known of the errors.
    #[inline(always)]
    pub(super) fn straight<const N: usize>(&self, u: &Lanes<N>, v: &Lanes<N>) -> [[Lanes<N>; 3]; 2] {
        let Pixel { u: cu, v: cv } = self.camera.lens.principal_point;
        let (a, b) = (u.map(|u| u - cu), v.map(|v| v - cv));
        let points = self.points(&a, &b);
        let mut pixel = slopes(&self.of_sigma, &a, &b).squared();
        for column in &mut pixel {
            for i in 0..N {
                column[i] *= points.square[i] * points.square[i];
            }
        }
        // No closure: it would be compiled without the instructions of who calls.
        let Some(flow) = &self.flow else { return [pixel, [[f64::NAN; N]; 3]] };
        [pixel, flow.of_pose(&points.x, &points.y)]
    }

    /// The same of a lens that bends.
    #[inline(always)]
    pub(super) fn bent(
        &self,
        (inverse, brown): (&BrownInverse, &BrownConrady),
        u: &Lanes,
        v: &Lanes,
    ) -> [[Lanes; 3]; 2] {
        let (Pixel { u: cu, v: cv }, lens_focal) = (self.camera.lens.principal_point, self.camera.lens.focal);
        let mut x = u.map(|u| (u - cu) / lens_focal);
        let mut y = v.map(|v| (v - cv) / lens_focal);
        inverse.undistort(&mut x, &mut y);
        let (a, b) = (x.map(|x| lens_focal * x), y.map(|y| lens_focal * y));
        let points = self.points(&a, &b);
        let mut by_raw = slopes(&self.minors, &a, &b).by_raw(brown, &x, &y);
        for column in by_raw.0.as_flattened_mut() {
            for i in 0..LANES {
                column[i] *= points.square[i];
            }
        }
        let pixel = by_raw.times(self.sigma).squared();
        let Some(flow) = &self.flow else { return [pixel, [[f64::NAN; LANES]; 3]] };
        let mut calibration = flow.of_pose(&points.x, &points.y);
        let mut changes = [[[0.0; LANES]; 2]; Distortion::MOST];
        for i in 0..LANES {
            let by = brown.distorted_by_coefficients([x[i], y[i]]);
            for coefficient in 0..Distortion::MOST {
                changes[coefficient][0][i] = by[coefficient][0];
                changes[coefficient][1][i] = by[coefficient][1];
            }
        }
        flow.add_lens(&mut calibration, [&points.x, &points.y], &by_raw.times(lens_focal).0, &changes);
        [pixel, calibration]
    }

    #[inline(always)]
    fn points<const N: usize>(&self, a: &Lanes<N>, b: &Lanes<N>) -> Points<N> {
        /// As for one pixel: what is farther is the horizon's rounding.
        const FARTHEST: f64 = 1e12;
        let [right, down, forward] = self.axes;
        let mut points = Points { x: [0.0; N], y: [0.0; N], square: [0.0; N] };
        for i in 0..N {
            let along = |k: usize| a[i] * right[k] + b[i] * down[k] + forward[k];
            let reach = along(2).recip();
            let is_seen =
                (reach > 0.0) & (reach * reach * self.square_of_ray(a[i], b[i]) < FARTHEST * FARTHEST);
            let reach = if is_seen { reach } else { f64::NAN };
            [points.x[i], points.y[i], points.square[i]] =
                [reach * along(0), reach * along(1), reach * reach];
        }
        points
    }

    /// The axes are orthonormal.
    #[inline(always)]
    fn square_of_ray(&self, a: f64, b: f64) -> f64 {
        a * a + b * b + self.camera.focal * self.camera.focal
    }
}

/// `T / t^2`, of M, N and K over q.
#[inline(always)]
fn slopes<const N: usize>([x, y]: &[[f64; 3]; 2], a: &Lanes<N>, b: &Lanes<N>) -> Slopes<N> {
    let mut slopes = Slopes([[[0.0; N]; 2]; 2]);
    for i in 0..N {
        slopes.0[0][0][i] = x[0] + b[i] * x[2];
        slopes.0[0][1][i] = x[1] - a[i] * x[2];
        slopes.0[1][0][i] = y[0] + b[i] * y[2];
        slopes.0[1][1][i] = y[1] - a[i] * y[2];
    }
    slopes
}

impl<const N: usize> Slopes<N> {
    #[inline(always)]
    fn times(mut self, factor: f64) -> Self {
        for column in self.0.as_flattened_mut() {
            for i in 0..N {
                column[i] *= factor;
            }
        }
        self
    }

    /// How the points move with the raw pixel: T times the inverse of the Jacobian of the lens, which is symmetric.
    #[inline(always)]
    fn by_raw(mut self, brown: &BrownConrady, x: &Lanes<N>, y: &Lanes<N>) -> Self {
        let mut unbend = [[0.0; N]; 3];
        for i in 0..N {
            let [a, b, d] = brown.jacobian([x[i], y[i]]);
            let scale = (a * d - b * b).recip();
            [unbend[0][i], unbend[1][i], unbend[2][i]] = [d * scale, -b * scale, a * scale];
        }
        for [by_a, by_b] in &mut self.0 {
            for i in 0..N {
                let [a, b] = [by_a[i], by_b[i]];
                by_a[i] = a * unbend[0][i] + b * unbend[1][i];
                by_b[i] = a * unbend[1][i] + b * unbend[2][i];
            }
        }
        self
    }

    /// The covariance of x and y by two independent coordinates of the variance 1: xx, xy, yy.
    #[inline(always)]
    fn squared(&self) -> [Lanes<N>; 3] {
        let mut squared = [[0.0; N]; 3];
        for i in 0..N {
            let [x, y] = [[self.0[0][0][i], self.0[0][1][i]], [self.0[1][0][i], self.0[1][1][i]]];
            squared[0][i] = x[0] * x[0] + x[1] * x[1];
            squared[1][i] = x[0] * y[0] + x[1] * y[1];
            squared[2][i] = y[0] * y[0] + y[1] * y[1];
        }
        squared
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Covariance, any_camera};
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
            let mut found = [(); 6].map(|()| vec![0.0; at.len()]);
            let [xx, xy, yy, calibration @ ..] = found.each_mut().map(|column| &mut column[..]);
            FloorProjector::on(&camera, &plane).floor_covariances([&u, &v], 0.7, [[xx, xy, yy], calibration]);
            for i in 0..at.len() {
                match camera.covariance_on(Pixel { u: u[i], v: v[i] }, 0.7, &plane, &[[0.0; 3]; 3]) {
                    None => prop_assert!(found.iter().all(|column| column[i].is_nan())),
                    Some(alone) => {
                        // A ray is right to 1e-13 of a focal in step, its place on the floor to that many times
                        // the distance in heights.
                        let range = camera.pixel_to_plane(Pixel { u: u[i], v: v[i] }, &plane).map_or(f64::NAN, |foot| {
                            foot.on_floor().distance(camera.position.on_floor()) / (camera.position.z - height)
                        });
                        prop_assume!(range < 1e6);
                        prop_assert_eq!(alone.calibration.is_some(), !found[3][i].is_nan());
                        for (part, [xx, xy, _, yy]) in alone.rows().into_iter().enumerate() {
                            let size = (1e-10 + 1e-12 * range) * (xx + yy);
                            for (column, alone) in found[3 * part..].iter().zip([xx, xy, yy]) {
                                let off = (alone - column[i]).abs();
                                prop_assert!(off <= size || alone.is_nan(), "{alone:?} {}", column[i]);
                            }
                        }
                    }
                }
            }
        }
    }
}
