//! Residuals of stage 1 and their Jacobians with respect to roll, pitch, log focal length and log height
//! ([`Parameters`]).
//!
//! This file contains the residual of a line. Lengths and uprights are in `size_residual.rs`.
//!
//! | constraint | residual | evaluated over all constraints by |
//! |---|---|---|
//! | vertical line | [`LineResidual`] at the vanishing point [`Angles::nadir`] | `Problem::each_line` |
//! | floor line | [`LineResidual`] at the vanishing point [`Angles::floor`] | `Problem::each_line` |
//! | length | log of `floor_length` minus the log length of its group | `Problem::each_length` |
//! | upright | `upright_residuals` | `Problem::each_upright` |
//!
//! `Problem` is defined in `likelihood.rs`. It divides by the noise and adds the priors.
//!
//! # A line toward a vanishing point
//!
//! The two end points `p1`, `p2` of a segment have independent, isotropic noise. The true line passes through
//! the vanishing point V = (Vxy, Vw) of a direction. V is homogeneous and relative to the principal point.
//! The unknown line is a nuisance parameter and is eliminated exactly. Let `q_i = p_i Vw - Vxy` be the vector
//! from V to the end point, times Vw. Let `w_i` be the inverse variance of the end point across the segment.
//! A line through V with unit normal n has the weighted sum of squared distances
//!
//! `n' M n / Vw^2`, `M = w1 q1 q1' + w2 q2 q2'`.
//!
//! The minimum over n is the smaller eigenvalue of M divided by `Vw^2`. M is 2 x 2, with `T = tr M = w1
//! |q1|^2 + w2 |q2|^2` and `D = det M = w1 w2 (q1 x q2)^2`. So the eigenvalue is `(T - sqrt(T^2 - 4 D)) / 2 =
//! 2 D / (T + sqrt(T^2 - 4 D))`. With the line `l = p1 x p2`, `q1 x q2 = Vw (l . V)`, and Vw cancels. The
//! signed root is
//!
//! `r = sqrt(2 w1 w2) (l . V) / sqrt(T + sqrt(T^2 - 4 D))`.
//!
//! r is finite for V at infinity. It is the exact maximum-likelihood residual: its `J'J` equals the Schur
//! complement of the full problem with the line as an unknown. On the sphere of rays, `l . V = 0` means that
//! V is on the great circle of the segment. In coordinates divided by the focal length, `(l . V) / (|l| |V|)`
//! is the sine of the angle between V and that circle. r is the same error in pixels at the annotated ends,
//! where the noise arises.
//!
//! r is smooth except at equal eigenvalues (q1 and q2 orthogonal and of equal weighted length). There the
//! mean of the one-sided derivatives is used.

use crate::camera::Chart;
use crate::optimize::Number;
use crate::single::constraints::Endpoint;
use crate::single::vanishing_point::line_through;

/// Core parameters: roll in radians, pitch in radians, log of the focal length in pixels, log of the height
/// in metres.
pub(crate) type Parameters = [f64; 4];

/// Index of the roll in [`Parameters`].
pub(crate) const ROLL: usize = 0;
/// Index of the pitch in [`Parameters`].
pub(crate) const PITCH: usize = 1;
/// Index of the log focal length in [`Parameters`].
pub(crate) const LOG_FOCAL: usize = 2;
/// Index of the log height in [`Parameters`].
pub(crate) const LOG_HEIGHT: usize = 3;

/// Lean of the verticals relative to the normal of the floor: to the right, and away from the camera, in
/// radians.
pub(crate) type Tilt = [f64; 2];

/// Index of the first tilt among the derivatives of a residual, after the core parameters.
pub(crate) const TILT: usize = 4;

/// Vanishing point relative to the principal point, homogeneous, with its derivatives.
#[derive(Clone, Copy)]
pub(crate) struct VanishingPoint {
    /// Homogeneous coordinates, relative to the principal point.
    pub(crate) at: [f64; 3],
    /// Derivatives of the coordinates with respect to the roll.
    pub(crate) d_roll: [f64; 3],
    /// Derivatives of the coordinates with respect to the pitch.
    pub(crate) d_pitch: [f64; 3],
    /// Derivatives of the coordinates with respect to the log focal length.
    pub(crate) d_log_focal: [f64; 3],
    /// Derivatives with respect to two further parameters: angle and elevation of a floor direction, or the two
    /// tilts for the nadir.
    pub(crate) d_own: [[f64; 3]; 2],
}

impl VanishingPoint {
    /// Transforms the vanishing point into the chart of a wide lens.
    #[inline]
    pub(crate) fn in_chart(self, chart: Option<&Chart>) -> Self {
        let Some(chart) = chart else { return self };
        let Self { at, d_roll, d_pitch, d_log_focal, d_own } = self;
        let [at, d_roll, d_pitch, d_log_focal] =
            [at, d_roll, d_pitch, d_log_focal].map(|vector| chart.bearing_to_chart(vector));
        Self { at, d_roll, d_pitch, d_log_focal, d_own: d_own.map(|vector| chart.bearing_to_chart(vector)) }
    }
}

/// Sines and cosines of roll and pitch, and focal length of a camera. Vanishing points are computed from them.
pub(crate) struct Angles {
    roll: (f64, f64),
    pitch: (f64, f64),
    focal: f64,
}

impl Angles {
    pub(crate) fn new(parameters: &Parameters) -> Self {
        Self {
            roll: parameters[ROLL].sin_cos(),
            pitch: parameters[PITCH].sin_cos(),
            focal: parameters[LOG_FOCAL].exp(),
        }
    }

    /// Returns the vanishing point of the verticals, toward the nadir.
    ///
    /// Without tilt it is `(f cos p sin r, f cos p cos r, sin p)`. In unrolled axes up is
    /// `(0, -cos p, -sin p)` and ahead on the floor is `(0, -sin p, cos p)`.
    pub(crate) fn nadir(&self, [right, ahead]: Tilt) -> VanishingPoint {
        let (sp, cp) = self.pitch;
        let (y, w) = (cp + ahead * sp, sp - ahead * cp);
        self.vanishing([-right, y, w], [0.0, -w, y], [[-1.0, 0.0, 0.0], [0.0, sp, -cp]])
    }

    /// Returns the vanishing point of a direction at `angle`, counter-clockwise from the camera's right.
    ///
    /// `level` is the tangent of its elevation above the floor.
    pub(crate) fn floor(&self, angle: f64, level: f64) -> VanishingPoint {
        let ((sa, ca), (sp, cp)) = (angle.sin_cos(), self.pitch);
        let (y, w) = (-sp * sa - level * cp, cp * sa - level * sp);
        self.vanishing([ca, y, w], [0.0, -w, y], [[-sa, -sp * ca, cp * ca], [0.0, -cp, -sp]])
    }

    /// Returns the vanishing point of a direction in unrolled camera axes, with its derivatives.
    ///
    /// `d_own` are the derivatives of the direction with respect to its own two parameters.
    fn vanishing(&self, direction: [f64; 3], d_pitch: [f64; 3], d_own: [[f64; 3]; 2]) -> VanishingPoint {
        let ((sr, cr), f) = (self.roll, self.focal);
        let image = |[x, y, w]: [f64; 3]| [f * (cr * x + sr * y), f * (cr * y - sr * x), w];
        let at = image(direction);
        VanishingPoint {
            at,
            d_roll: [at[1], -at[0], 0.0],
            d_pitch: image(d_pitch),
            d_log_focal: [at[0], at[1], 0.0],
            d_own: d_own.map(image),
        }
    }
}

/// Residual of a line: smallest movement of the segment's ends, in pixels, that makes the line pass through
/// the vanishing point V; signed.
///
/// Without distortion, the weights are 1 for a segment of two points that is annotated once. The terms of the
/// formula in the module documentation are stored for the derivative.
pub(crate) struct LineResidual<E = f64> {
    /// Residual r, in pixels.
    pub(crate) pixels: E,
    /// End points `p1` and `p2` of the segment.
    ends: [[E; 2]; 2],
    /// Vanishing point V.
    v: [f64; 3],
    /// Line `l = p1 x p2`.
    line: [E; 3],
    /// Inverse variances `w1` and `w2` of the ends across the segment.
    weights: [E; 2],
    /// Incidence `l . V` of the vanishing point with the line.
    incidence: E,
    /// Trace `T` of M.
    trace: E,
    /// Root `sqrt(T^2 - 4 D)`.
    root: E,
    /// Sum `T + sqrt(T^2 - 4 D)`.
    sum: E,
    /// Factor `r / (l . V)`.
    factor: E,
}

impl<E: Number> LineResidual<E> {
    #[inline]
    pub(crate) fn new(ends: &[Endpoint<E>; 2], v: [f64; 3]) -> Self {
        let [p1, p2] = [ends[0].point, ends[1].point];
        let line = line_through(p1, p2);
        let weights = weights_across(ends, &line);
        let [w1, w2] = weights;
        let [q1, q2] = [p1, p2].map(|p| direction(p, v));
        let incidence = line[0] * v[0] + line[1] * v[1] + line[2] * v[2];
        let (a, b) = (w1 * (q1[0] * q1[0] + q1[1] * q1[1]), w2 * (q2[0] * q2[0] + q2[1] * q2[1]));
        let weight = w1 * w2;
        let along = q1[0] * q2[0] + q1[1] * q2[1];
        // `T^2 - 4 D = (w1 |q1|^2 - w2 |q2|^2)^2 + 4 w1 w2 (q1 . q2)^2`, without cancellation.
        let discriminant = (a - b) * (a - b) + weight * along * along * 4.0;
        let trace = a + b;
        // sqrt has no derivative at 0; 0 is the mean of the two one-sided derivatives.
        let root = if discriminant.value() > 0.0 { discriminant.sqrt() } else { discriminant };
        let sum = (trace + root).at_least(f64::MIN_POSITIVE);
        let factor = (weight * 2.0 / sum).sqrt();
        Self {
            pixels: factor * incidence,
            ends: [p1, p2],
            v,
            line,
            weights,
            incidence,
            trace,
            root,
            sum,
            factor,
        }
    }

    /// Returns the derivative of the residual with respect to V.
    #[inline]
    pub(crate) fn d_point(&self) -> [f64; 3] {
        let v = self.v;
        let [p1, p2] = self.ends.map(|end| end.map(Number::value));
        let ([w1, w2], line) = (self.weights.map(Number::value), self.line.map(Number::value));
        let [incidence, trace, root, sum, factor] =
            [self.incidence, self.trace, self.root, self.sum, self.factor].map(Number::value);
        let [q1, q2] = [p1, p2].map(|p| direction(p, v));
        // At equal eigenvalues the root has a kink; the mean of its two derivatives is 0.
        let by_root = if root > 1e-9 * trace { root.recip() } else { 0.0 };
        let share = 0.5 * incidence / sum;
        std::array::from_fn(|k| {
            let by_trace = match k {
                0 => -2.0 * (w1 * q1[0] + w2 * q2[0]),
                1 => -2.0 * (w1 * q1[1] + w2 * q2[1]),
                _ => 2.0 * (w1 * (q1[0] * p1[0] + q1[1] * p1[1]) + w2 * (q2[0] * p2[0] + q2[1] * p2[1])),
            };
            let direct = if k == 2 { incidence } else { 0.0 };
            let by_determinant = 2.0 * w1 * w2 * v[2] * incidence * (direct + v[2] * line[k]);
            let by_sum = by_trace + (trace * by_trace - 2.0 * by_determinant) * by_root;
            factor * (line[k] - share * by_sum)
        })
    }
}

/// Returns the vector from the homogeneous point V to a pixel, times Vw.
#[inline]
fn direction<E: Number>(p: [E; 2], v: [f64; 3]) -> [E; 2] {
    [p[0] * v[2] - v[0], p[1] * v[2] - v[1]]
}

/// Returns the inverse variances of the two ends across the line.
fn weights_across<E: Number>(ends: &[Endpoint<E>; 2], line: &[E; 3]) -> [E; 2] {
    let [a, b, _] = *line;
    let square = (a * a + b * b).at_least(f64::MIN_POSITIVE);
    ends.map(|end| {
        let [uu, uv, vv] = end.covariance;
        square / (a * a * uu + a * b * uv * 2.0 + b * b * vv)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn line_through_the_vanishing_point_has_no_residual(
            a in [-900.0..900.0_f64, -500.0..500.0_f64], v in [-3e3..3e3_f64, -3e3..3e3_f64], t in 0.05..0.9_f64,
            weights in [0.5..2.0_f64, 0.5..2.0_f64],
        ) {
            let b = [a[0] + t * (v[0] - a[0]), a[1] + t * (v[1] - a[1])];
            let end = |point, w: f64| Endpoint { point, covariance: [w, 0.0, w] };
            let residual = LineResidual::new(&[end(a, weights[0]), end(b, weights[1])], [v[0], v[1], 1.0]).pixels;
            prop_assert!(residual.abs() < 1e-8, "{residual}");
        }

        #[test]
        fn residual_is_the_smallest_movement_of_the_ends(
            a in [-900.0..900.0_f64, -500.0..500.0_f64], b in [-900.0..900.0_f64, -500.0..500.0_f64],
            v in [-3e3..3e3_f64, -3e3..3e3_f64], weights in [0.5..2.0_f64, 0.5..2.0_f64],
        ) {
            let end = |point, w: f64| Endpoint { point, covariance: [1.0 / w, 0.0, 1.0 / w] };
            let residual = LineResidual::new(&[end(a, weights[0]), end(b, weights[1])], [v[0], v[1], 1.0]).pixels;
            // Sum of the weighted squared distances of the ends from the line through v at this angle.
            let cost = |angle: f64| {
                let (sin, cos) = angle.sin_cos();
                let distance = |p: [f64; 2]| (p[0] - v[0]) * sin - (p[1] - v[1]) * cos;
                weights[0] * distance(a).powi(2) + weights[1] * distance(b).powi(2)
            };
            let least = (0..20_000).map(|i| cost(std::f64::consts::PI * f64::from(i) / 20_000.0)).fold(f64::INFINITY, f64::min);
            let reach = weights[0] * (a[0] - v[0]).hypot(a[1] - v[1]).powi(2) + weights[1] * (b[0] - v[0]).hypot(b[1] - v[1]).powi(2);
            prop_assert!(residual * residual <= least + 1e-6, "{} above {least}", residual * residual);
            prop_assert!(least - residual * residual < 1e-7 * reach, "{} below {least}", residual * residual);
        }
    }
}
