//! Covariances of many floor points at once, in step, so that the compiler can use vector instructions: what
//! [`Camera::covariance_on`] says of one.
//!
//! A change c of a ray's direction d moves its point of the plane by `D(c) = t (c - d (n . c) / (n . d))`, which is
//! linear, and `D(d) = 0`. With `d = a right + b down + forward` every change of the camera moves the point as a shift k
//! of (a, b) does, by `T k` with `T = [D(right), D(down)]`. Of the pose and the focal k is quadratic in a and b, the flow
//! of an image of a plane (Longuet-Higgins and Prazdny 1980); so the covariance is `T Q T'`, and Q is quartic, with
//! coefficients that are the same for all pixels.

use crate::camera::{
    BrownConrady, BrownInverse, Camera, Covariance, Distortion, FloorCovariance, LANES, Pixel, Plane, sin_cos,
};

type Lanes = [f64; LANES];
/// Of a polynomial of a and b: the coefficient of `a^i b^j` in row i and column j; of less than N degrees.
type Polynomial<const N: usize> = [[f64; N]; N];

/// A camera and a plane prepared for covariances.
#[derive(Clone, Debug)]
pub(super) struct CovarianceLanes<'a> {
    camera: &'a Camera,
    plane: &'a Plane,
    /// The lens, if it bends.
    lens: Option<(&'a BrownInverse, BrownConrady)>,
    /// Rows right, down, forward.
    axes: [[f64; 3]; 3],
    /// None where nothing is known of the errors.
    flow: Option<Flow>,
}

/// The covariance of (a, b) by the errors of a camera.
#[derive(Clone, Debug)]
struct Flow {
    /// By the pose and the focal: aa, ab, bb.
    pose: [Polynomial<5>; 3],
    /// Which coefficients of the lens were estimated, with the covariance of each with the flow of pose and focal.
    lens: Vec<(usize, [Polynomial<3>; 2])>,
}

/// How points of the plane move with (a, b), as rows x and y of T.
#[derive(Clone, Copy, Debug)]
struct Slopes([[Lanes; 2]; 2]);

impl<'a> CovarianceLanes<'a> {
    pub(super) fn new(
        camera: &'a Camera,
        plane: &'a Plane,
        lens: Option<(&'a BrownInverse, BrownConrady)>,
    ) -> Self {
        let axes = camera.rotation();
        let flow = camera.covariance.is_known().then(|| Flow::new(camera, plane, &axes, lens.is_some()));
        Self { camera, plane, lens, axes, flow }
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
        let ratio = lens_focal / self.camera.focal;
        let (a, b) = (x.map(|x| ratio * x), y.map(|y| ratio * y));
        let slopes = self.slopes(&a, &b);
        let pixel = slopes.carried(&of_pixel(&unbend, variance / (self.camera.focal * self.camera.focal)));
        let calibration = match &self.flow {
            None => None,
            Some(flow) => {
                let mut covariance = flow.of_pose(&a, &b);
                if let Some((_, brown)) = self.lens {
                    let shifts = shifts(&brown, &x, &y, &unbend, -ratio);
                    flow.add_lens(&mut covariance, &self.camera.covariance, [&a, &b], &shifts);
                }
                Some(slopes.carried(&covariance))
            }
        };
        let mut of = [FloorCovariance::NONE; LANES];
        for i in 0..LANES {
            if pixel[0][i].is_finite() {
                let pixel = [[pixel[0][i], pixel[1][i]], [pixel[1][i], pixel[2][i]]];
                let calibration = calibration.as_ref().map(|of| [[of[0][i], of[1][i]], [of[1][i], of[2][i]]]);
                of[i] = FloorCovariance { pixel, calibration };
            }
        }
        of
    }

    /// NaN where the plane is not seen.
    #[inline(always)]
    fn slopes(&self, a: &Lanes, b: &Lanes) -> Slopes {
        /// As for one pixel: what is farther is the horizon's rounding.
        const FARTHEST: f64 = 1e12;
        let [right, down, forward] = self.axes;
        let drop = self.plane.height_at(self.camera.position.on_floor()) - self.camera.position.z;
        let [rise_right, rise_down, rise_forward] = self.axes.map(|axis| self.plane.rise(&axis));
        let mut slopes = Slopes([[[0.0; LANES]; 2]; 2]);
        for i in 0..LANES {
            let mut direction = [0.0; 3];
            for k in 0..3 {
                direction[k] = a[i] * right[k] + b[i] * down[k] + forward[k];
            }
            let by_rise = (a[i] * rise_right + b[i] * rise_down + rise_forward).recip();
            let reach = drop * by_rise;
            let [along_x, along_y, along_z] = direction;
            let square = along_x * along_x + along_y * along_y + along_z * along_z;
            let is_seen = (reach > 0.0) & (reach * reach * square < FARTHEST * FARTHEST);
            let reach = if is_seen { reach } else { f64::NAN };
            for k in 0..2 {
                let tilt = direction[k] * by_rise;
                slopes.0[k][0][i] = reach * (right[k] - tilt * rise_right);
                slopes.0[k][1][i] = reach * (down[k] - tilt * rise_down);
            }
        }
        slopes
    }
}

impl Slopes {
    /// A covariance of (a, b) as one of x and y: xx, xy, yy.
    #[inline(always)]
    fn carried(&self, of: &[Lanes; 3]) -> [Lanes; 3] {
        let mut carried = [[0.0; LANES]; 3];
        for i in 0..LANES {
            let [aa, ab, bb] = [of[0][i], of[1][i], of[2][i]];
            let [x, y] = [[self.0[0][0][i], self.0[0][1][i]], [self.0[1][0][i], self.0[1][1][i]]];
            let by_x = [x[0] * aa + x[1] * ab, x[0] * ab + x[1] * bb];
            let by_y = [y[0] * aa + y[1] * ab, y[0] * ab + y[1] * bb];
            carried[0][i] = x[0] * by_x[0] + x[1] * by_x[1];
            carried[1][i] = y[0] * by_x[0] + y[1] * by_x[1];
            carried[2][i] = y[0] * by_y[0] + y[1] * by_y[1];
        }
        carried
    }
}

impl Flow {
    fn new(camera: &Camera, plane: &Plane, axes: &[[f64; 3]; 3], is_bent: bool) -> Self {
        let flows = flows(camera, plane, axes);
        let is_estimated = |&index: &usize| camera.covariance.sigma(index).is_some();
        let estimated: Vec<usize> = (0..Covariance::LENS).filter(is_estimated).collect();
        let mut pose = [[[0.0; 5]; 5]; 3];
        for (of, [i, j]) in pose.iter_mut().zip([[0, 0], [0, 1], [1, 1]]) {
            for &row in &estimated {
                for &column in &estimated {
                    add_product(of, camera.covariance.0[row][column], &flows[row][i], &flows[column][j]);
                }
            }
        }
        let with = |coefficient: usize| {
            let sum = |axis: usize, i: usize, j: usize| -> f64 {
                let by = |&row: &usize| {
                    camera.covariance.0[row][Covariance::LENS + coefficient] * flows[row][axis][i][j]
                };
                estimated.iter().map(by).sum()
            };
            [0, 1].map(|axis| std::array::from_fn(|i| std::array::from_fn(|j| sum(axis, i, j))))
        };
        let bends = 0..if is_bent { Distortion::MOST } else { 0 };
        let bends = bends.filter(|coefficient| is_estimated(&(Covariance::LENS + coefficient)));
        Self { pose, lens: bends.map(|coefficient| (coefficient, with(coefficient))).collect() }
    }

    #[inline(always)]
    fn of_pose(&self, a: &Lanes, b: &Lanes) -> [Lanes; 3] {
        let [aa, ab, bb] = &self.pose;
        [value(aa, a, b), value(ab, a, b), value(bb, a, b)]
    }

    /// By the coefficients of the lens, which shift (a, b) so: with each other and with the pose, every pair counts twice.
    #[inline(always)]
    fn add_lens(
        &self,
        to: &mut [Lanes; 3],
        Covariance(covariance): &Covariance,
        [a, b]: [&Lanes; 2],
        shifts: &[[Lanes; 2]; Distortion::MOST],
    ) {
        for (first, (coefficient, with_pose)) in self.lens.iter().enumerate() {
            let row = &covariance[Covariance::LENS + coefficient][Covariance::LENS..];
            let mut others = [value(&with_pose[0], a, b), value(&with_pose[1], a, b)];
            for &(other, _) in &self.lens[first + 1..] {
                let (entry, [x, y]) = (row[other], &shifts[other]);
                for i in 0..LANES {
                    others[0][i] += entry * x[i];
                    others[1][i] += entry * y[i];
                }
            }
            let (own, [x, y]) = (row[*coefficient], &shifts[*coefficient]);
            for i in 0..LANES {
                to[0][i] += x[i] * (own * x[i] + 2.0 * others[0][i]);
                to[1][i] += x[i] * (own * y[i] + others[1][i]) + y[i] * others[0][i];
                to[2][i] += y[i] * (own * y[i] + 2.0 * others[1][i]);
            }
        }
    }
}

/// How (a, b) would move for the point to move as it does with every unknown of pose and focal.
fn flows(camera: &Camera, plane: &Plane, axes: &[[f64; 3]; 3]) -> [[Polynomial<3>; 2]; Covariance::LENS] {
    let quadratic =
        |one: f64, [a, b]: [f64; 2], [aa, ab, bb]: [f64; 3]| [[one, b, bb], [a, ab, 0.0], [aa, 0.0, 0.0]];
    let (sin, cos) = sin_cos(camera.roll);
    // One over the reach is linear in a and b.
    let drop = plane.height_at(camera.position.on_floor()) - camera.position.z;
    let [right, down, forward] = axes.map(|axis| plane.rise(&axis) / drop);
    let moved = |axis: usize| {
        let [r, d, f] = axes.map(|of| of[axis]);
        [
            quadratic(r * forward, [r * right - f * forward, r * down], [-f * right, -f * down, 0.0]),
            quadratic(d * forward, [d * right, d * down - f * forward], [0.0, -f * right, -f * down]),
        ]
    };
    let [r, d, f] = axes.map(|of| of[2]);
    let mut flows = [[[[0.0; 3]; 3]; 2]; Covariance::LENS];
    flows[Covariance::X] = moved(0);
    flows[Covariance::Y] = moved(1);
    flows[Covariance::Z] = moved(2);
    flows[Covariance::YAW] = [quadratic(d, [0.0, -f], [d, -r, 0.0]), quadratic(-r, [f, 0.0], [0.0, d, -r])];
    flows[Covariance::PITCH] =
        [quadratic(sin, [0.0; 2], [sin, cos, 0.0]), quadratic(cos, [0.0; 2], [0.0, sin, cos])];
    flows[Covariance::ROLL] = [quadratic(0.0, [0.0, -1.0], [0.0; 3]), quadratic(0.0, [1.0, 0.0], [0.0; 3])];
    let shrunk = -camera.focal.recip();
    flows[Covariance::FOCAL] =
        [quadratic(0.0, [shrunk, 0.0], [0.0; 3]), quadratic(0.0, [0.0, shrunk], [0.0; 3])];
    flows
}

fn add_product(to: &mut Polynomial<5>, factor: f64, left: &Polynomial<3>, right: &Polynomial<3>) {
    for i in 0..3 {
        for j in 0..3 - i {
            for k in 0..3 {
                for l in 0..3 - k {
                    to[i + k][j + l] += factor * left[i][j] * right[k][l];
                }
            }
        }
    }
}

/// By Horner's rule.
#[inline(always)]
fn value<const N: usize>(of: &Polynomial<N>, a: &Lanes, b: &Lanes) -> Lanes {
    let mut value = [of[N - 1][0]; LANES];
    for i in (0..N - 1).rev() {
        let mut row = [of[i][N - 1 - i]; LANES];
        for j in (0..N - 1 - i).rev() {
            for lane in 0..LANES {
                row[lane] = row[lane] * b[lane] + of[i][j];
            }
        }
        for lane in 0..LANES {
            value[lane] = value[lane] * a[lane] + row[lane];
        }
    }
    value
}

/// The covariance of (a, b) for raw pixels of this variance, in squares of a focal: aa, ab, bb.
#[inline(always)]
fn of_pixel(unbend: &[Lanes; 3], variance: f64) -> [Lanes; 3] {
    let mut of = [[0.0; LANES]; 3];
    for i in 0..LANES {
        let [a, b, d] = [unbend[0][i], unbend[1][i], unbend[2][i]];
        of[0][i] = variance * (a * a + b * b);
        of[1][i] = variance * b * (a + d);
        of[2][i] = variance * (b * b + d * d);
    }
    of
}

/// How (a, b) moves with every coefficient of a lens: a raw pixel that stays is undistorted to another place, by `-A^-1`
/// of what the coefficient changes.
#[inline(always)]
fn shifts(
    brown: &BrownConrady,
    x: &Lanes,
    y: &Lanes,
    unbend: &[Lanes; 3],
    scale: f64,
) -> [[Lanes; 2]; Distortion::MOST] {
    let mut shifts = [[[0.0; LANES]; 2]; Distortion::MOST];
    for i in 0..LANES {
        let [a, b, d] = [scale * unbend[0][i], scale * unbend[1][i], scale * unbend[2][i]];
        let changes = brown.distorted_by_coefficients([x[i], y[i]]);
        for coefficient in 0..Distortion::MOST {
            let [dx, dy] = changes[coefficient];
            shifts[coefficient][0][i] = a * dx + b * dy;
            shifts[coefficient][1][i] = b * dx + d * dy;
        }
    }
    shifts
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
