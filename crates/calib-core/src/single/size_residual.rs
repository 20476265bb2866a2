//! Residuals of constraints with a size: lengths on the floor, and uprights.
//!
//! # Lengths
//!
//! The log of a length on the floor is compared with the log length of its group. Its variance is propagated
//! to first order from the four coordinates of the ends: `|grad|^2` for noise of 1 px. The residual divided
//! by the norm of its gradient is the first-order distance of the annotation from one that fulfils the
//! constraint (Sampson 1982; Hartley and Zisserman 2004, section 4.2.6).
//!
//! # Uprights
//!
//! The head is predicted from the foot and the known height. The difference is whitened by the covariance of
//! foot, head and height, propagated to first order.

use crate::camera::Chart;
use crate::optimize::{Number, NumberOver};
use crate::single::constraints::{Endpoint, UprightConstraint};
use crate::single::residual::{LOG_FOCAL, LOG_HEIGHT, PITCH, Parameters, ROLL, TILT, Tilt};

/// Terms that all lengths and uprights share, with their derivatives: sines and cosines of roll and pitch, focal
/// length, inverse height, and tilt.
pub(crate) struct CameraTerms<N> {
    roll: (N, N),
    pitch: (N, N),
    focal: N,
    /// Inverse of the camera height.
    per_height: N,
    tilt: [N; 2],
}

impl<N: Number> CameraTerms<N> {
    pub(crate) fn new(parameters: &Parameters, tilt: Tilt) -> Self {
        Self {
            roll: N::parameter(parameters[ROLL], ROLL).sin_cos(),
            pitch: N::parameter(parameters[PITCH], PITCH).sin_cos(),
            focal: N::parameter(parameters[LOG_FOCAL], LOG_FOCAL).exp(),
            per_height: (-N::parameter(parameters[LOG_HEIGHT], LOG_HEIGHT)).exp(),
            tilt: [N::parameter(tilt[0], TILT), N::parameter(tilt[1], TILT + 1)],
        }
    }
}

/// Returns the log length of a segment on the floor in camera heights, and its standard deviation for noise
/// of 1 px in every coordinate of the ends.
///
/// With the unrolled pixel (u, v), the pitch p and the focal length f, the floor point is (X, Y):
/// `D = cos p v + f sin p`, `X = u / D`, `Y = (f cos p - v sin p) / D`. `None` if an end is on or above the
/// horizon.
#[inline]
pub(crate) fn floor_length<E: Number, N: NumberOver<E>>(
    at: &CameraTerms<N>,
    chart: Option<&Chart>,
    ends: &[Endpoint<E>; 2],
) -> Option<(N, N)> {
    if let Some(chart) = chart {
        return at.floor_length_in(chart, ends);
    }
    let CameraTerms { roll: (sr, cr), pitch: (sp, cp), focal: f, .. } = *at;
    let one = N::constant(1.0);
    let on_floor = |end: &Endpoint<E>| {
        let [x, y] = end.point;
        let (u, v) = (cr * x - sr * y, sr * x + cr * y);
        let depth = cp * v + sp * f;
        // The end must be at least a millionth of a radian below the horizon.
        (depth.value() > 1e-6 * f.value()).then(|| {
            let per_depth = one / depth;
            (u, per_depth, u * per_depth, (cp * f - sp * v) * per_depth)
        })
    };
    let (first, second) = (on_floor(&ends[0])?, on_floor(&ends[1])?);
    let (dx, dy) = (first.2 - second.2, first.3 - second.3);
    let square = dx * dx + dy * dy;
    if square.value() <= 0.0 {
        return None;
    }
    let per_square = one / square;
    // Variance from the derivatives of the log length with respect to (u, v) of one end, rotated back into
    // image axes.
    let variance = |(u, per_depth, _, _): (N, N, N, N), end: &Endpoint<E>| {
        let share = per_square * per_depth;
        let across = dx * share;
        let along = -((dx * u * cp + dy * f) * share * per_depth);
        let by_u = cr * across + sr * along;
        let by_v = cr * along - sr * across;
        let [uu, uv, vv] = end.covariance;
        by_u * by_u * uu + by_u * by_v * (uv * 2.0) + by_v * by_v * vv
    };
    let noise = (variance(first, &ends[0]) + variance(second, &ends[1])).sqrt();
    Some((square.ln() * 0.5, noise))
}

/// Returns the floor direction, of any length, in which the plane through the camera and a segment intersects
/// the floor.
pub(crate) fn floor_direction<E: Number, N: NumberOver<E>>(
    at: &CameraTerms<N>,
    chart: Option<&Chart>,
    ends: &[Endpoint<E>; 2],
) -> [N; 2] {
    let CameraTerms { roll: (sr, cr), pitch: (sp, cp), focal: f, .. } = *at;
    let seen = |end: &Endpoint<E>| match chart {
        Some(chart) => bearing::<E, N>(chart, end.point),
        None => [N::from(end.point[0]), N::from(end.point[1]), N::constant(1.0)],
    };
    let ([x1, y1, w1], [x2, y2, w2]) = (seen(&ends[0]), seen(&ends[1]));
    let (a, b, c) = (y1 * w2 - w1 * y2, w1 * x2 - x1 * w2, x1 * y2 - y1 * x2);
    let (across, down) = (cr * a - sr * b, sr * a + cr * b);
    [cp * c - sp * f * down, -(f * across)]
}

/// Returns the two residuals of a head predicted from its foot, in standard deviations, whitened by the noise
/// of both ends and of the height.
///
/// Let (u, v) be the unrolled foot, p the pitch, f the focal length, H the height of the upright, and z0 the
/// height of the camera. The upward direction of verticals is `(t, -c, -s)` in unrolled axes; without tilt it
/// is `(0, -cos p, -sin p)`. With `D = cos p v + f sin p` and `k = H D / z0`, the head is at
/// `f (u + k t, v - k c) / (f - k s)`. `None` if the foot is above the horizon or the head is behind the
/// camera.
pub(crate) fn upright_residuals<E: Number, N: NumberOver<E>>(
    at: &CameraTerms<N>,
    upright: &UprightConstraint<E>,
    sigma: f64,
) -> Option<[N; 2]> {
    let (off, covariance) = upright_difference(at, upright, sigma)?;
    Some(whitened(off, covariance).map(|residual| residual * sigma.recip()))
}

/// Returns the log of the determinant of the covariance of a predicted head, in units of `sigma`.
///
/// This term is a part of the log likelihood, because the uncertainty of the predicted head depends on the pose. It
/// grows without bound as the camera approaches the height of the heads.
pub(crate) fn upright_log_determinant<E: Number, N: NumberOver<E>>(
    at: &CameraTerms<N>,
    upright: &UprightConstraint<E>,
    sigma: f64,
) -> Option<N> {
    let (_, [caa, cab, cbb]) = upright_difference(at, upright, sigma)?;
    Some((caa * cbb - cab * cab).ln())
}

/// Returns the difference between a predicted head and the annotated one, with its covariance in units of
/// `sigma`.
fn upright_difference<E: Number, N: NumberOver<E>>(
    at: &CameraTerms<N>,
    upright: &UprightConstraint<E>,
    sigma: f64,
) -> Option<([N; 2], [N; 3])> {
    if let Some(chart) = &upright.chart {
        return at.upright_difference_in(chart, upright, sigma);
    }
    let CameraTerms { roll: (sr, cr), pitch: (sp, cp), focal: f, per_height, tilt: [right, ahead] } = *at;
    let (up_y, up_w) = (cp + ahead * sp, sp - ahead * cp);
    let [x, y] = upright.foot.point;
    let (u, v) = (cr * x - sr * y, sr * x + cr * y);
    let depth = cp * v + sp * f;
    let k = depth * per_height * upright.height.value;
    let divisor = f - k * up_w;
    if depth.value() <= 1e-6 * f.value() || divisor.value() <= 1e-6 * f.value() {
        return None;
    }
    let (across, down) = (u + k * right, v - k * up_y);
    let (a, b) = (f * across / divisor, f * down / divisor);
    // Derivatives of the unrolled head with respect to the unrolled foot and the height.
    let k_by_v = cp * per_height * upright.height.value;
    let divide = divisor * divisor;
    let a_by_u = f / divisor;
    let a_by_k = f * (right * divisor + across * up_w) / divide;
    let b_by_k = f * (down * up_w - up_y * divisor) / divide;
    let a_by_v = k_by_v * a_by_k;
    let b_by_v = a_by_u + k_by_v * b_by_k;
    let k_by_h = depth * per_height;
    let (a_by_h, b_by_h) = (a_by_k * k_by_h, b_by_k * k_by_h);
    let turn = |[uu, uv, vv]: [E; 3]| {
        // Rotates a covariance into unrolled axes.
        let off = cr * sr * (uu - vv) + (cr * cr - sr * sr) * uv;
        (
            cr * cr * uu - cr * sr * (uv * 2.0) + sr * sr * vv,
            off,
            sr * sr * uu + cr * sr * (uv * 2.0) + cr * cr * vv,
        )
    };
    let (fuu, fuv, fvv) = turn(upright.foot.covariance);
    let (huu, huv, hvv) = turn(upright.head.covariance);
    let height_sigma = upright.height.sigma.unwrap_or(0.0) / sigma;
    let square = height_sigma * height_sigma;
    let caa = huu
        + a_by_u * a_by_u * fuu
        + a_by_u * a_by_v * fuv * 2.0
        + a_by_v * a_by_v * fvv
        + a_by_h * a_by_h * square;
    let cab = huv + b_by_v * (a_by_u * fuv + a_by_v * fvv) + a_by_h * b_by_h * square;
    let cbb = hvv + b_by_v * b_by_v * fvv + b_by_h * b_by_h * square;
    let [hx, hy] = upright.head.point;
    let off = [a - (cr * hx - sr * hy), b - (sr * hx + cr * hy)];
    Some((off, [caa, cab, cbb]))
}

/// Multiplies a difference by the inverse of the lower Cholesky factor of its covariance.
fn whitened<N: Number>([da, db]: [N; 2], [caa, cab, cbb]: [N; 3]) -> [N; 2] {
    let l11 = caa.sqrt();
    let l21 = cab / l11;
    let l22 = (cbb - l21 * l21).sqrt();
    let first = da / l11;
    [first, (db - l21 * first) / l22]
}

/// Multiplies a constant matrix by a vector that may depend on the camera.
fn rows<N: Number>(matrix: &[[f64; 3]; 3], [x, y, w]: [N; 3]) -> [N; 3] {
    matrix.map(|[a, b, c]| x * a + y * b + w * c)
}

/// Returns the columns u and v of the map from a chart to bearings.
fn columns(chart: &Chart) -> [[f64; 3]; 2] {
    [0, 1].map(|k| chart.bearing_from_chart().map(|row| row[k]))
}

/// Lengths and uprights in the chart of a wide lens.
///
/// The formulas are those of [`floor_length`] and [`upright_residuals`], with a homogeneous bearing (x, y, w)
/// instead of the undistorted pixel (x, y, 1).
impl<N: Number> CameraTerms<N> {
    /// Returns the coefficients of `D`, `X D` and `Y D`, which are linear in the bearing (x, y, w). [`floor_length`]
    /// defines D, X and Y.
    fn forms(&self) -> [[N; 3]; 3] {
        let Self { roll: (sr, cr), pitch: (sp, cp), focal: f, .. } = *self;
        let none = N::constant(0.0);
        [[cp * sr, cp * cr, sp * f], [cr, -sr, none], [-(sp * sr), -(sp * cr), cp * f]]
    }

    fn floor_length_in<E: Number>(&self, chart: &Chart, ends: &[Endpoint<E>; 2]) -> Option<(N, N)>
    where
        N: NumberOver<E>,
    {
        let forms = self.forms();
        let on_floor = |end: &Endpoint<E>| {
            let bearing = bearing::<E, N>(chart, end.point);
            let [depth, x, y] = forms.map(|form| product(form, bearing));
            // The end must be at least a millionth of a radian below the horizon.
            let is_below = depth.value() > 1e-6 * self.focal.value();
            is_below.then(|| (depth, [x / depth, y / depth]))
        };
        let (first, second) = (on_floor(&ends[0])?, on_floor(&ends[1])?);
        let off = [first.1[0] - second.1[0], first.1[1] - second.1[1]];
        let square = off[0] * off[0] + off[1] * off[1];
        if square.value() <= 0.0 {
            return None;
        }
        // d log length / d (u, v) of one end.
        let variance = |(depth, at): (N, [N; 2]), end: &Endpoint<E>| {
            let by = columns(chart).map(|column| {
                let [d_depth, d_x, d_y] = forms.map(|form| constant_product(form, column));
                (off[0] * (d_x - at[0] * d_depth) + off[1] * (d_y - at[1] * d_depth)) / (depth * square)
            });
            quadratic(by, end.covariance)
        };
        let noise = (variance(first, &ends[0]) + variance(second, &ends[1])).sqrt();
        Some((square.ln() * 0.5, noise))
    }

    fn upright_difference_in<E: Number>(
        &self,
        chart: &Chart,
        upright: &UprightConstraint<E>,
        sigma: f64,
    ) -> Option<([N; 2], [N; 3])>
    where
        N: NumberOver<E>,
    {
        let Self { roll: (sr, cr), pitch: (sp, cp), focal: f, per_height, tilt: [right, ahead] } = *self;
        let foot = bearing::<E, N>(chart, upright.foot.point);
        let [form, ..] = self.forms();
        let depth = product(form, foot);
        if depth.value() <= 1e-6 * f.value() {
            return None;
        }
        // Upward direction as a bearing; the head is the foot plus k times this direction.
        let (up_y, up_w) = (cp + ahead * sp, sp - ahead * cp);
        let up = [cr * right - sr * up_y, -(sr * right) - cr * up_y, -(up_w / f)];
        let per_depth = per_height * upright.height.value;
        let k = depth * per_depth;
        let head = rows(chart.chart_from_bearing(), [0, 1, 2].map(|i| foot[i] + k * up[i]));
        if head[2].value() <= 1e-6 {
            return None;
        }
        let at = [head[0] / head[2], head[1] / head[2]];
        let moved = |change: [N; 3]| {
            let [x, y, w] = rows(chart.chart_from_bearing(), change);
            [(x - at[0] * w) / head[2], (y - at[1] * w) / head[2]]
        };
        let by_foot = columns(chart).map(|column| {
            let d_k = constant_product(form, column) * per_depth;
            moved([0, 1, 2].map(|i| d_k * up[i] + N::constant(column[i])))
        });
        let by_height = moved(up.map(|c| c * depth * per_height));
        let height_sigma = upright.height.sigma.unwrap_or(0.0) / sigma;
        let ([huu, huv, hvv], square) = (upright.head.covariance, height_sigma * height_sigma);
        let [fuu, fuv, fvv] = upright.foot.covariance;
        let of_foot = |i: usize, j: usize| {
            let [by_u, by_v] = by_foot;
            by_u[i] * by_u[j] * fuu + (by_u[i] * by_v[j] + by_v[i] * by_u[j]) * fuv + by_v[i] * by_v[j] * fvv
        };
        let entry = |own: E, i: usize, j: usize| of_foot(i, j) + by_height[i] * by_height[j] * square + own;
        let covariance = [entry(huu, 0, 0), entry(huv, 0, 1), entry(hvv, 1, 1)];
        let off = [at[0] - upright.head.point[0], at[1] - upright.head.point[1]];
        Some((off, covariance))
    }
}

/// Returns the bearing of a chart point.
fn bearing<E: Number, N: NumberOver<E>>(chart: &Chart, [u, v]: [E; 2]) -> [N; 3] {
    chart.bearing_from_chart().map(|[a, b, c]| N::from(u * a + v * b + c))
}

fn product<N: Number>(form: [N; 3], [x, y, w]: [N; 3]) -> N {
    form[0] * x + form[1] * y + form[2] * w
}

fn constant_product<N: Number>(form: [N; 3], [x, y, w]: [f64; 3]) -> N {
    form[0] * x + form[1] * y + form[2] * w
}

/// Returns the variance `g' C g` for a gradient g = `[u, v]` and a covariance C = `[uu, uv, vv]`.
fn quadratic<E: Number, N: NumberOver<E>>([u, v]: [N; 2], [uu, uv, vv]: [E; 3]) -> N {
    u * u * uu + u * v * (uv * 2.0) + v * v * vv
}
