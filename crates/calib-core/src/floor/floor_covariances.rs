//! Covariances of many points of a plane, computed in lockstep so that the compiler can use vector
//! instructions. The results equal [`Camera::covariance_on`] for each point.
//!
//! Let `d = (x, y, z)` be the vector from the camera to a point of the plane, and `n = (-slope, 1)` the
//! normal of the plane. The drop to the plane, `q = n . d`, is the same for all points. A change c of d moves
//! the intersection of the ray with the plane by `D(c) = c - d (n . c) / q`.
//!
//! # Calibration part
//!
//! A translation of the camera is a change c that is the same for all points. A rotation w changes d by
//! `c = w x d`. A change of the focal length f is `c = forward (forward . d) / f`, plus a multiple of d, and
//! `D(d) = 0`. On the plane z is affine in x and y, and so is c. Hence
//!
//! ```text
//! D(c) = m + (x, y) l,    m = (m0 + m1 x + m2 y, m3 + m4 x + m5 y),    l = m6 x + m7 y,
//! ```
//!
//! which is an infinitesimal homography of the plane with eight numbers (the "pure parameters" of Tsai and
//! Huang 1981). They are linear in the errors of the camera. Their covariance is therefore the same for all
//! points.
//!
//! A prime denotes the transpose. With the point `p = (x, y)`, the covariance of D(c) is
//! `cov(m + p l) = cov(m) + p k' + k p'` with `k = cov(m, l) + p var(l) / 2`, a polynomial of degree four.
//! Every coefficient should be used only once. Therefore the terms of `var(m_x)` with a factor x are added to
//! `k_x`, and the terms of `var(m_y)` with a factor y to `k_y`:
//!
//! ```text
//! K_x = k_x + (terms of var(m_x) with x) / 2x,    K_y = k_y + (terms of var(m_y) with y) / 2y,
//! xx = (other terms of var(m_x)) + 2 x K_x,       yy = (other terms of var(m_y)) + 2 y K_y,
//! xy = cov(m_x, m_y) - x (K_y - k_y) - y (K_x - k_x) + x K_y + y K_x.
//! ```
//!
//! The part of K along p, which consists of the terms of `K_x` with a factor x, is computed once:
//! `K_x = with_x + x along`, `K_y = with_y + y along`.
//!
//! # Pixel part
//!
//! With a and b in pixels from the principal point, a ray is `a right + b down + f forward`, and
//! `d = t (a right + b down + f forward)` with `t = q / r`, where r is affine in a and b. The derivative of
//! the point with respect to (a, b) is `T = t [D(right), D(down)]`. Its quadratic terms cancel:
//! `T = t^2 / q (M + b K, N - a K)`, with columns M, N and K that are the same for all pixels.

use crate::camera::{BrownConrady, BrownInverse, Camera, Covariance, LANES, Lens, Pixel, Plane, sin_cos};

/// Values of `N` points that are computed together.
pub(super) type Lanes<const N: usize = LANES> = [f64; N];

/// Returns the first `N` values, padded with `filling`.
#[inline(always)]
pub(super) fn lanes<const N: usize>(values: &[f64], filling: f64) -> [f64; N] {
    let filled = || std::array::from_fn(|i| values.get(i).copied().unwrap_or(filling));
    values.first_chunk().copied().unwrap_or_else(filled)
}

/// Copies the values to `to`, as many as fit.
#[inline(always)]
pub(super) fn store<T: Copy, const N: usize>(values: &[T; N], to: &mut [T]) {
    match to.first_chunk_mut() {
        Some(all) => *all = *values,
        None => to.copy_from_slice(&values[..to.len()]),
    }
}

/// Returns the first `N` values. If there are fewer values, copies them to the start of `spare` and returns `spare`.
#[inline(always)]
pub(super) fn block<'a, const N: usize>(values: &'a [f64], spare: &'a mut [f64; N]) -> &'a [f64; N] {
    if let Some(all) = values.first_chunk() {
        return all;
    }
    spare[..values.len()].copy_from_slice(values);
    spare
}

/// Numbers m0 to m7 of an infinitesimal homography of the plane (see the module documentation).
type Flow = [f64; 8];

/// Covariance of the infinitesimal homography from the errors of a camera.
#[derive(Clone, Debug)]
pub(super) struct FlowCovariance {
    /// Coefficients of 1, y and yy in `var(m_x)`: the terms without a factor x.
    xx: [f64; 3],
    /// Coefficients of 1, x and xx in `var(m_y)`: the terms without a factor y.
    yy: [f64; 3],
    /// Coefficients of `cov(m_x, m_y)` without the terms that are in K.
    xy: Quadratic,
    /// Coefficients of 1, y and yy in `with_x` of the module documentation.
    with_x: [f64; 3],
    /// Coefficients of `with_y` of the module documentation.
    with_y: Quadratic,
    /// Coefficients of `along` of the module documentation.
    along: Quadratic,
    /// Covariance of every lens parameter with the homography; zeros for parameters that were not estimated.
    lens_with_pose: [Flow; Lens::PARAMETERS],
    /// Covariance of the lens parameters.
    lens: [[f64; Lens::PARAMETERS]; Lens::PARAMETERS],
    /// Number of estimated lens parameters after the distortion coefficients: 0, 2 (principal point) or 3
    /// (with the pixel aspect).
    after_coefficients: usize,
}

/// Coefficients of 1, x, y, xx, xy and yy of a polynomial in x and y.
type Quadratic = [f64; 6];

impl FlowCovariance {
    pub(super) fn new(camera: &Camera, plane: &Plane, axes: &[[f64; 3]; 3], drop: f64) -> Self {
        let Covariance(covariance) = &camera.covariance;
        let flows = flows(camera, plane, axes, drop);
        let is_estimated = |&index: &usize| camera.covariance.sigma(index).is_some();
        let estimated: Vec<usize> = (0..Covariance::LENS).filter(is_estimated).collect();
        // Covariance of one parameter with the homography: the sum over the estimated pose and focal length.
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
            after_coefficients: (Covariance::CENTRE..Covariance::SIZE)
                .rposition(|index| is_estimated(&index))
                .map_or(0, |last| (last + 1).max(2)),
        }
    }

    /// Returns the covariance of the points (x, y) from pose and focal length: xx, xy, yy in square metres.
    #[inline(always)]
    pub(super) fn pose_covariance<const N: usize>(&self, x: &Lanes<N>, y: &Lanes<N>) -> [Lanes<N>; 3] {
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

    /// Adds the covariance of lens parameters, with each other and with the pose. `moves` contains the
    /// derivatives of every point with respect to the parameters from `first` on. Every pair of different
    /// parameters counts twice.
    #[inline(always)]
    fn add_lens<const N: usize>(
        &self,
        to: &mut [Lanes<N>; 3],
        [at_x, at_y]: [&Lanes<N>; 2],
        first: usize,
        moves: &[[Lanes<N>; 2]],
    ) {
        let [to_xx, to_xy, to_yy] = to;
        for (one, [move_x, move_y]) in moves.iter().enumerate() {
            let (with_pose, with_lens) = (&self.lens_with_pose[first + one], &self.lens[first + one]);
            let own = with_lens[first + one];
            for i in 0..N {
                let mut with = moved_by(with_pose, at_x[i], at_y[i]);
                for (other, [other_x, other_y]) in moves.iter().enumerate().skip(one + 1) {
                    with[0] += with_lens[first + other] * other_x[i];
                    with[1] += with_lens[first + other] * other_y[i];
                }
                let [x, y] = [move_x[i], move_y[i]];
                to_xx[i] += x * (own * x + 2.0 * with[0]);
                to_xy[i] += x * (own * y + with[1]) + y * with[0];
                to_yy[i] += y * (own * y + 2.0 * with[1]);
            }
        }
    }
}

/// Returns the derivatives of the homography of a plane with respect to the pose parameters and the focal
/// length. `drop` is the vertical distance from the camera up to the plane, in metres; it is negative for the floor.
fn flows(camera: &Camera, plane: &Plane, axes: &[[f64; 3]; 3], drop: f64) -> [Flow; Covariance::LENS] {
    // The arguments are the change of d at x = y = 0, and its derivatives with respect to x and y.
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
    // Homography of a rotation from one axis toward another, per radian.
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

/// Returns the displacement of the point (x, y) by an infinitesimal homography.
#[inline(always)]
fn moved_by(&[x0, xx, xy, y0, yx, yy, lx, ly]: &Flow, x: f64, y: f64) -> [f64; 2] {
    let along = x * lx + y * ly;
    [x0 + x * (xx + along) + y * xy, y0 + y * (yy + along) + x * yx]
}

/// Number of pixels of a lens without distortion that are computed together. Two of the widest instructions
/// run in parallel, which is fastest.
pub(super) const STRAIGHT_LANES: usize = 2 * LANES;

/// Camera and plane, prepared for covariances.
#[derive(Clone, Debug)]
pub(super) struct CovarianceLanes<'a> {
    camera: &'a Camera,
    /// Standard deviation of a pixel coordinate, in pixels.
    sigma: f64,
    /// Rows right, down and f times forward. Each contains the x and y components of the axis, and
    /// `(n . axis) / q`.
    axes: [[f64; 3]; 3],
    /// Columns M, N and K of the module documentation, divided by q: their x components, then their y
    /// components.
    minors: [[f64; 3]; 2],
    /// `minors` multiplied by sigma.
    of_sigma: [[f64; 3]; 2],
    /// Covariance of the homography; `None` if the uncertainty of the camera is unknown.
    flow: Option<FlowCovariance>,
}

/// Points of the plane: x and y relative to the camera, in metres.
struct Points<const N: usize> {
    x: Lanes<N>,
    y: Lanes<N>,
    /// Square of the factor t of the module documentation; NaN if the plane is not visible.
    square: Lanes<N>,
}

/// Derivatives of points of the plane with respect to (a, b): rows x and y of T, or of T divided by t^2. For
/// the symbols, see the module documentation.
#[derive(Clone, Copy, Debug)]
struct Slopes<const N: usize>([[Lanes<N>; 2]; 2]);

impl<'a> CovarianceLanes<'a> {
    /// Prepares a camera and a plane. `sigma` is the standard deviation of a pixel coordinate, in pixels.
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

    /// Returns the pixel part and the calibration part for pixels of a lens without distortion, each as xx,
    /// xy, yy. Both parts are NaN if the plane is not visible. The calibration part is also NaN if the
    /// uncertainty of the camera is unknown.
    #[inline(always)]
    pub(super) fn straight<const N: usize>(&self, u: &Lanes<N>, v: &Lanes<N>) -> [[Lanes<N>; 3]; 2] {
        let Pixel { u: cu, v: cv } = self.camera.lens.principal_point;
        let aspect = self.camera.lens.pixel_aspect;
        let (a, b) = (u.map(|u| u - cu), v.map(|v| (v - cv) / aspect));
        let points = self.points(&a, &b);
        let mut pixel = slopes(&self.of_sigma, &a, &b).by_pixel_of_aspect(aspect).squared();
        for column in &mut pixel {
            for i in 0..N {
                column[i] *= points.square[i] * points.square[i];
            }
        }
        // A closure would be compiled without the vector instructions of the caller.
        let Some(flow) = &self.flow else { return [pixel, [[f64::NAN; N]; 3]] };
        let mut calibration = flow.pose_covariance(&points.x, &points.y);
        if flow.after_coefficients > 0 {
            let by_raw = slopes(&self.minors, &a, &b).by_pixel_of_aspect(aspect).at_points(&points.square);
            let moves = &by_raw.by_centre_and_aspect(&b)[..flow.after_coefficients];
            flow.add_lens(&mut calibration, [&points.x, &points.y], Lens::CENTRE, moves);
        }
        [pixel, calibration]
    }

    /// Returns the covariances as [`Self::straight`] does, but for a lens with distortion.
    #[inline(always)]
    pub(super) fn distorted(
        &self,
        (inverse, brown): (&BrownInverse, &BrownConrady),
        u: &Lanes,
        v: &Lanes,
    ) -> [[Lanes; 3]; 2] {
        let (Pixel { u: cu, v: cv }, lens_focal) = (self.camera.lens.principal_point, self.camera.lens.focal);
        let aspect = self.camera.lens.pixel_aspect;
        let focal_v = lens_focal * aspect;
        let mut x = u.map(|u| (u - cu) / lens_focal);
        let mut y = v.map(|v| (v - cv) / focal_v);
        inverse.undistort(&mut x, &mut y);
        let (a, b) = (x.map(|x| lens_focal * x), y.map(|y| lens_focal * y));
        let points = self.points(&a, &b);
        let by_square = slopes(&self.minors, &a, &b).by_raw(brown, &x, &y).at_points(&points.square);
        let by_raw = by_square.by_pixel_of_aspect(aspect);
        let pixel = by_raw.times(self.sigma).squared();
        let Some(flow) = &self.flow else { return [pixel, [[f64::NAN; LANES]; 3]] };
        let mut calibration = flow.pose_covariance(&points.x, &points.y);
        let mut moves = [[[0.0; LANES]; 2]; Lens::PARAMETERS];
        let [[xa, xb], [ya, yb]] = by_square.times(lens_focal).0;
        for i in 0..LANES {
            // A change of a coefficient moves the undistorted point of a fixed raw pixel.
            let by = brown.distorted_by_coefficients([x[i], y[i]]);
            for (moved, [dx, dy]) in moves.iter_mut().zip(by) {
                moved[0][i] = -(xa[i] * dx + xb[i] * dy);
                moved[1][i] = -(ya[i] * dx + yb[i] * dy);
            }
        }
        let down = v.map(|v| (v - cv) / aspect);
        moves[Lens::CENTRE..].copy_from_slice(&by_raw.by_centre_and_aspect(&down));
        let moves = &moves[..Lens::CENTRE + flow.after_coefficients];
        flow.add_lens(&mut calibration, [&points.x, &points.y], 0, moves);
        [pixel, calibration]
    }

    /// Returns the points of the plane at the pixels (a, b), which are relative to the principal point. Points
    /// are NaN if the pixel does not show the plane.
    #[inline(always)]
    fn points<const N: usize>(&self, a: &Lanes<N>, b: &Lanes<N>) -> Points<N> {
        /// Largest distance of a point from the camera, in metres, as for a single pixel. A larger value is a
        /// rounding error at the horizon.
        const MAX_DISTANCE_M: f64 = 1e12;
        let [right, down, forward] = self.axes;
        let mut points = Points { x: [0.0; N], y: [0.0; N], square: [0.0; N] };
        for i in 0..N {
            let along = |k: usize| a[i] * right[k] + b[i] * down[k] + forward[k];
            let reach = along(2).recip();
            let is_seen = (reach > 0.0)
                & (reach * reach * self.square_of_ray(a[i], b[i]) < MAX_DISTANCE_M * MAX_DISTANCE_M);
            let reach = if is_seen { reach } else { f64::NAN };
            [points.x[i], points.y[i], points.square[i]] =
                [reach * along(0), reach * along(1), reach * reach];
        }
        points
    }

    /// Returns the squared length of the ray `a right + b down + f forward`. The axes are orthonormal.
    #[inline(always)]
    fn square_of_ray(&self, a: f64, b: f64) -> f64 {
        a * a + b * b + self.camera.focal * self.camera.focal
    }
}

/// Returns `T / t^2` from M, N and K divided by q.
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
    /// Returns T from `T / t^2` and the squares of t.
    #[inline(always)]
    fn at_points(mut self, square: &Lanes<N>) -> Self {
        for column in self.0.as_flattened_mut() {
            for i in 0..N {
                column[i] *= square[i];
            }
        }
        self
    }

    /// Returns the derivatives of the points with respect to u and v of the principal point and the pixel
    /// aspect. The first two are the negative derivatives with respect to the raw pixel. The third is the
    /// second, multiplied by the distance `down` of the distorted square pixel below the principal point.
    #[inline(always)]
    fn by_centre_and_aspect(&self, down: &Lanes<N>) -> [[Lanes<N>; 2]; 3] {
        let mut by = [[[0.0; N]; 2]; 3];
        for row in 0..2 {
            for i in 0..N {
                by[0][row][i] = -self.0[row][0][i];
                by[1][row][i] = -self.0[row][1][i];
                by[2][row][i] = -self.0[row][1][i] * down[i];
            }
        }
        by
    }

    /// Converts derivatives with respect to a square pixel to those for the raw pixel with this `aspect`.
    #[inline(always)]
    fn by_pixel_of_aspect(mut self, aspect: f64) -> Self {
        if aspect != 1.0 {
            for [_, by_v] in &mut self.0 {
                for value in by_v.iter_mut() {
                    *value /= aspect;
                }
            }
        }
        self
    }

    /// Returns the derivatives multiplied by a factor.
    #[inline(always)]
    fn times(mut self, factor: f64) -> Self {
        for column in self.0.as_flattened_mut() {
            for i in 0..N {
                column[i] *= factor;
            }
        }
        self
    }

    /// Returns the derivatives with respect to the raw pixel: T times the inverse of the Jacobian of the lens.
    /// The Jacobian is symmetric.
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

    /// Returns the covariance of the point (x, y) for two independent pixel coordinates with variance 1: xx,
    /// xy, yy.
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
    use proptest::prelude::*;

    use super::*;
    use crate::camera::{Covariance, any_camera};
    use crate::floor::projector::FloorProjector;

    proptest! {
        #[test]
        fn lane_covariances_equal_single_pixel_covariances(
            camera in any_camera(), factors in proptest::collection::vec(-1.0..1.0_f64, 225), is_known: bool,
            at in proptest::collection::vec((0.0..1920.0_f64, -100.0..1080.0_f64), 1..30),
            height in -1.0..1.5_f64, slope in [-0.1..0.1_f64, -0.1..0.1_f64],
        ) {
            /// Standard deviations of the parameters: metres, radians, pixels, coefficients.
            const SIGMAS: [f64; Covariance::SIZE] =
                [0.03, 0.02, 0.05, 0.01, 0.004, 0.003, 9.0, 0.01, 0.008, 0.005, 1e-4, 1e-4, 12.0, 9.0, 0.02];
            let mut camera = camera;
            for i in 0..Covariance::SIZE {
                for j in 0..Covariance::SIZE {
                    let sum: f64 = (0..15).map(|k| factors[15 * i + k] * factors[15 * j + k]).sum();
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
                        // In lockstep a ray is accurate to 1e-13 of the focal length. Its floor position is
                        // accurate to 1e-13 times the distance in camera heights.
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
