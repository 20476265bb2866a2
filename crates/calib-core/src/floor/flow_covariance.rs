//! The covariance of points of a plane by the errors of the camera that shows them, in step.
//!
//! With the way `d = (x, y, z)` from the camera to a point of the plane, its normal `n = (-slope, 1)` and the drop
//! `q = n . d` to it, a change c of d moves the point by `D(c) = c - d (n . c) / q`.
//!
//! A shift of its place is a c that is the same for all points, a turn makes `c = w x d`, a longer focal
//! `c = forward (forward . d) / f` but for a multiple of d, and `D(d) = 0`. On the plane z is affine in x and y, and so is
//! c. Hence
//!
//! ```text
//! D(c) = m + (x, y) l,    m = (m0 + m1 x + m2 y, m3 + m4 x + m5 y),    l = m6 x + m7 y,
//! ```
//!
//! an infinitesimal homography of the plane, of eight numbers (the "pure parameters" of Tsai and Huang 1981), which are
//! linear in the errors of the camera: they have a covariance of their own, the same for all points.
//!
//! With the point `p = (x, y)` that of D(c) is `cov(m + p l) = cov(m) + p k' + k p'`, `k = cov(m, l) + p var(l) / 2`, a form
//! of the fourth degree. So that every coefficient is used once, what of `var(m_x)` has a factor x stands with k, and what of
//! `var(m_y)` has a factor y:
//!
//! ```text
//! K_x = k_x + (what of var(m_x) has x) / 2x,    K_y = k_y + (what of var(m_y) has y) / 2y,
//! xx = (the rest of var(m_x)) + 2 x K_x,        yy = (the rest of var(m_y)) + 2 y K_y,
//! xy = cov(m_x, m_y) - x (K_y - k_y) - y (K_x - k_x) + x K_y + y K_x,
//! ```
//!
//! and of K the part along p, what of `K_x` has a factor x, is computed once: `K_x = with_x + x along`, `K_y = with_y + y along`.

use crate::camera::{Camera, Covariance, Distortion, LANES, Plane, sin_cos};
use crate::floor::lanes::Lanes;

/// The eight numbers of a flow of the plane.
type Flow = [f64; 8];

/// The covariance of the flow that the errors of a camera make.
#[derive(Clone, Debug)]
pub(super) struct FlowCovariance {
    /// The rest of `var(m_x)`, by 1, y, yy.
    xx: [f64; 3],
    /// The rest of `var(m_y)`, by 1, x, xx.
    yy: [f64; 3],
    /// `cov(m_x, m_y)` without what K took.
    xy: Quadratic,
    /// By 1, y, yy.
    with_x: [f64; 3],
    with_y: Quadratic,
    along: Quadratic,
    /// Of every coefficient of the lens with the flow; zeros for those that were not estimated.
    lens_with_pose: [Flow; Distortion::MOST],
    /// Of the coefficients of the lens with each other.
    lens: [[f64; Distortion::MOST]; Distortion::MOST],
}

/// By 1, x, y, xx, xy, yy.
type Quadratic = [f64; 6];

impl FlowCovariance {
    pub(super) fn new(camera: &Camera, plane: &Plane, axes: &[[f64; 3]; 3], drop: f64) -> Self {
        let Covariance(covariance) = &camera.covariance;
        let flows = flows(camera, plane, axes, drop);
        let is_estimated = |&index: &usize| camera.covariance.sigma(index).is_some();
        let estimated: Vec<usize> = (0..Covariance::LENS).filter(is_estimated).collect();
        // With everything of the camera that has a flow.
        let with = |row: usize| -> Flow {
            std::array::from_fn(|k| {
                estimated.iter().map(|&other| covariance[row][other] * flows[other][k]).sum()
            })
        };
        let rows: Vec<Flow> = estimated.iter().map(|&row| with(row)).collect();
        let of = |i: usize, j: usize| -> f64 {
            estimated.iter().zip(&rows).map(|(&row, with)| flows[row][i] * with[j]).sum()
        };
        let product = |i: usize, j: usize| {
            let both = |k: usize, l: usize| of(i + k, j + l) + if k == l { 0.0 } else { of(i + l, j + k) };
            [both(0, 0), both(0, 1), both(0, 2), both(1, 1), both(1, 2), both(2, 2)]
        };
        let (m_x, m_y, both) = (product(0, 0), product(3, 3), product(0, 3));
        let with_l = |j: usize| [of(6, j), of(7, j), of(6, j + 1), of(6, j + 2) + of(7, j + 1), of(7, j + 2)];
        let ([x, y, xx, xy, yy], of_y) = (with_l(0), with_l(3));
        let (half_x, half_y) = (m_x.map(|by| 0.5 * by), m_y.map(|by| 0.5 * by));
        let along = [x + half_x[3], xx, xy];
        let lens = |i: usize, j: usize| {
            let [i, j] = [i, j].map(|bend| Covariance::LENS + bend);
            if is_estimated(&i) && is_estimated(&j) { covariance[i][j] } else { 0.0 }
        };
        let lens_with_pose = |bend: usize| {
            let bend = Covariance::LENS + bend;
            if is_estimated(&bend) { with(bend) } else { [0.0; 8] }
        };
        Self {
            xx: [m_x[0], m_x[2], m_x[5]],
            yy: [m_y[0], m_y[1], m_y[3]],
            xy: [
                both[0],
                both[1] - half_y[2],
                both[2] - half_x[1],
                both[3] - half_y[4],
                both[4] - half_y[5] - half_x[3],
                both[5] - half_x[4],
            ],
            with_x: [half_x[1], y + half_x[4], yy],
            with_y: [
                half_y[2],
                of_y[0] + half_y[4],
                of_y[1] + half_y[5] - along[0],
                of_y[2],
                of_y[3] - along[1],
                of_y[4] - along[2],
            ],
            along: [along[0], along[1], along[2], 0.5 * of(6, 6), of(6, 7), 0.5 * of(7, 7)],
            lens_with_pose: std::array::from_fn(lens_with_pose),
            lens: std::array::from_fn(|i| std::array::from_fn(|j| lens(i, j))),
        }
    }

    /// By the pose and the focal: xx, xy, yy.
    #[inline(always)]
    pub(super) fn of_pose<const N: usize>(&self, x: &Lanes<N>, y: &Lanes<N>) -> [Lanes<N>; 3] {
        let mut of = [[0.0; N]; 3];
        for i in 0..N {
            let (x, y) = (x[i], y[i]);
            let quadratic = |&[one, by_x, by_y, xx, xy, yy]: &Quadratic| {
                (one + x * (by_x + x * xx)) + y * (by_y + x * xy + y * yy)
            };
            let of_one = |&[one, by, square]: &[f64; 3], x: f64| one + x * (by + x * square);
            let along = quadratic(&self.along);
            let with_x = of_one(&self.with_x, y) + x * along;
            let with_y = quadratic(&self.with_y) + y * along;
            of[0][i] = of_one(&self.xx, y) + (x + x) * with_x;
            of[1][i] = quadratic(&self.xy) + (x * with_y + y * with_x);
            of[2][i] = of_one(&self.yy, x) + (y + y) * with_y;
        }
        of
    }

    /// By the coefficients of the lens: with each other and with the pose, every pair counts twice.
    #[inline(always)]
    pub(super) fn add_lens(
        &self,
        to: &mut [Lanes; 3],
        [at_x, at_y]: [&Lanes; 2],
        [[xa, xb], [ya, yb]]: &[[Lanes; 2]; 2],
        changes: &[[Lanes; 2]; Distortion::MOST],
    ) {
        let [to_xx, to_xy, to_yy] = to;
        for i in 0..LANES {
            // A raw pixel that stays is undistorted to another place.
            let mut moves = [[0.0; 2]; Distortion::MOST];
            for (moved, [dx, dy]) in moves.iter_mut().zip(changes) {
                *moved = [-(xa[i] * dx[i] + xb[i] * dy[i]), -(ya[i] * dx[i] + yb[i] * dy[i])];
            }
            for first in 0..Distortion::MOST {
                let mut with = moved_by(&self.lens_with_pose[first], at_x[i], at_y[i]);
                for other in first + 1..Distortion::MOST {
                    with[0] += self.lens[first][other] * moves[other][0];
                    with[1] += self.lens[first][other] * moves[other][1];
                }
                let (own, [x, y]) = (self.lens[first][first], moves[first]);
                to_xx[i] += x * (own * x + 2.0 * with[0]);
                to_xy[i] += x * (own * y + with[1]) + y * with[0];
                to_yy[i] += y * (own * y + 2.0 * with[1]);
            }
        }
    }
}

/// The flow of the plane by every unknown of pose and focal.
fn flows(camera: &Camera, plane: &Plane, axes: &[[f64; 3]; 3], drop: f64) -> [Flow; Covariance::LENS] {
    // What moves d, of neither x nor y, by x, and by y.
    let flow = |[none, by_x, by_y]: [[f64; 3]; 3]| {
        let [off, off_x, off_y] = [none, by_x, by_y].map(|c| plane.rise(&c) / drop);
        [none[0], by_x[0] - off, by_y[0], none[1], by_x[1], by_y[1] - off, -off_x, -off_y]
    };
    let on_plane = [[0.0, 0.0, drop], [1.0, 0.0, plane.slope[0]], [0.0, 1.0, plane.slope[1]]];
    let shifted = |axis: usize| {
        let mut shift = [[0.0; 3]; 3];
        shift[0][axis] = 1.0;
        flow(shift)
    };
    let [right, down, forward] = axes;
    let (sin, cos) = sin_cos(camera.roll);
    let level: [f64; 3] = std::array::from_fn(|i| sin * right[i] + cos * down[i]);
    let dot = |a: &[f64; 3], b: &[f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    // From one axis to another, by the angle between them.
    let turned = |from: &[f64; 3], to: &[f64; 3]| {
        flow(on_plane.map(|d| std::array::from_fn(|i| dot(from, &d) * to[i] - dot(to, &d) * from[i])))
    };
    let mut flows = [[0.0; 8]; Covariance::LENS];
    flows[Covariance::X] = shifted(0);
    flows[Covariance::Y] = shifted(1);
    flows[Covariance::Z] = shifted(2);
    flows[Covariance::YAW] = turned(&[1.0, 0.0, 0.0], &[0.0, 1.0, 0.0]);
    flows[Covariance::PITCH] = turned(forward, &level);
    flows[Covariance::ROLL] = turned(right, down);
    flows[Covariance::FOCAL] = flow(on_plane.map(|d| forward.map(|c| c * dot(forward, &d) / camera.focal)));
    flows
}

/// How far a flow moves a point.
#[inline(always)]
fn moved_by(&[x0, xx, xy, y0, yx, yy, lx, ly]: &Flow, x: f64, y: f64) -> [f64; 2] {
    let along = x * lx + y * ly;
    [x0 + x * (xx + along) + y * xy, y0 + y * (yy + along) + x * yx]
}
