//! Brown-Conrady model, a radial polynomial with decentring: D. C. Brown, "Decentering distortion of lenses",
//! 1966, after A. E. Conrady, 1919, in the notation of OpenCV.
//!
//! An undistorted point (x, y) has the distorted point (x', y'), both divided by the focal length. With
//! `r^2 = x^2 + y^2` and `R = 1 + k1 r^2 + k2 r^4 + k3 r^6`:
//!
//! ```text
//! x' = x R + 2 p1 x y + p2 (r^2 + 2 x^2)
//! y' = y R + p1 (r^2 + 2 y^2) + 2 p2 x y
//! ```
//!
//! The inverse has no closed form. Its derivatives follow from the implicit function theorem. Let u be the
//! undistorted point, v the distorted point, and A the Jacobian of the formula at u. Then `d u / d v = A^-1`.
//! At a fixed distorted point, the derivatives with respect to a coefficient k are
//! `d u / d k = -A^-1 (d v / d k)` and `d A^-1 / d k = -A^-1 (d A / d k + (d A / d u) (d u / d k)) A^-1`. The
//! formula is the gradient of a function, so A is symmetric and stored as three numbers.
//!
//! # Inversion of many points
//!
//! [`BrownInverse`] inverts several points in lockstep, so that the compiler can use vector instructions.
//!
//! Let d be a distorted point. The radial part alone has the inverse `g(d) = d P(|d|^2)`. The polynomial P is
//! interpolated once for each camera. With the tangential part t, the start `u = g(d - t(g(d)))` is accurate
//! to about 1e-5. One step of Newton's method (`first`) and one step of the chord method (`second`) with the
//! same Jacobian J then reach machine accuracy. The remaining error is at most `|J^-1| H |first| |second|`,
//! where H is a bound of the second derivatives. If this error bound exceeds 1e-13, as at the rim of a lens,
//! the point is solved separately. The result for a point therefore does not depend on the other points.

use nalgebra::{SMatrix, SVector};

use crate::camera::distortion::model::{ByCoefficient, ByCoefficients, Matrix2, Model, RayCurvature};
use crate::camera::distortion::{Coefficient, Distortion, DistortionModel, ModelRow};
use crate::camera::numerics::{OddPolynomial, hypot, positive_roots, sin_cos};

/// Table entry of the Brown-Conrady model in [`MODELS`](super::MODELS).
pub(super) const ROW: ModelRow = ModelRow {
    model: DistortionModel::BrownConrady,
    name: "brown-conrady",
    coefficients: &[Coefficient::K1, Coefficient::K2, Coefficient::K3, Coefficient::P1, Coefficient::P2],
    focal_powers: Some(&[2, 4, 6, 1, 1]),
    in_order: false,
    is_wide: false,
    is_fitted: true,
    default_count: 2,
    zero: Distortion::BrownConrady(BrownConrady { k1: 0.0, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 }),
};

/// Coefficients of the Brown-Conrady model, with the names of OpenCV.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BrownConrady {
    /// Radial coefficient of r^2.
    pub k1: f64,
    /// Radial coefficient of r^4.
    pub k2: f64,
    /// Radial coefficient of r^6.
    pub k3: f64,
    /// Tangential coefficient of the decentring along y.
    pub p1: f64,
    /// Tangential coefficient of the decentring along x.
    pub p2: f64,
}

/// Symmetric 2 x 2 matrix: `[xx, xy, yy]`.
type Symmetric = [f64; 3];

impl BrownConrady {
    /// Returns the radial part of the formula as a polynomial of the undistorted radius.
    pub(crate) fn radial(&self) -> OddPolynomial {
        OddPolynomial([self.k1, self.k2, self.k3, 0.0])
    }

    /// Returns the distorted point of an undistorted point by the formula, also beyond the fold of the model.
    #[inline]
    pub(crate) fn evaluate(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let square = x * x + y * y;
        let radial = 1.0 + square * (self.k1 + square * (self.k2 + square * self.k3));
        [
            x * radial + 2.0 * self.p1 * x * y + self.p2 * (square + 2.0 * x * x),
            y * radial + self.p1 * (square + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        ]
    }

    /// Returns the derivatives of the distorted point with respect to every coefficient, at a fixed
    /// undistorted point.
    #[inline(always)]
    #[expect(clippy::unused_self, reason = "the formula is linear in its coefficients")]
    pub(crate) fn distorted_by_coefficients(&self, [x, y]: [f64; 2]) -> [[f64; 2]; Distortion::MAX_FITTED] {
        let square = x * x + y * y;
        let (fourth, sixth, cross) = (square * square, square * square * square, 2.0 * x * y);
        let radial = [square, fourth, sixth].map(|power| [x * power, y * power]);
        let decentring = [[cross, square + 2.0 * y * y], [square + 2.0 * x * x, cross]];
        [radial[0], radial[1], radial[2], decentring[0], decentring[1]]
    }

    /// Returns the symmetric Jacobian of the formula at an undistorted point: `[dx'/dx, dx'/dy, dy'/dy]`.
    #[inline(always)]
    pub(crate) fn jacobian(&self, [x, y]: [f64; 2]) -> [f64; 3] {
        let square = x * x + y * y;
        let radial = 1.0 + square * (self.k1 + square * (self.k2 + square * self.k3));
        let d_radial = self.k1 + square * (2.0 * self.k2 + 3.0 * self.k3 * square);
        [
            radial + 2.0 * x * x * d_radial + 2.0 * self.p1 * y + 6.0 * self.p2 * x,
            2.0 * x * y * d_radial + 2.0 * self.p1 * x + 2.0 * self.p2 * y,
            radial + 2.0 * y * y * d_radial + 6.0 * self.p1 * y + 2.0 * self.p2 * x,
        ]
    }

    /// Returns the derivatives of [`Self::jacobian`] with respect to x and to y of the undistorted point.
    fn jacobian_by_point(&self, [x, y]: [f64; 2]) -> [Symmetric; 2] {
        let square = x * x + y * y;
        let d_radial = self.k1 + square * (2.0 * self.k2 + 3.0 * self.k3 * square);
        let dd_radial = 4.0 * (2.0 * self.k2 + 6.0 * self.k3 * square);
        // The formula is the gradient of a function of x and y, which has four third derivatives.
        let xxx = 6.0 * x * d_radial + x * x * x * dd_radial + 6.0 * self.p2;
        let xxy = 2.0 * y * d_radial + x * x * y * dd_radial + 2.0 * self.p1;
        let xyy = 2.0 * x * d_radial + x * y * y * dd_radial + 2.0 * self.p2;
        let yyy = 6.0 * y * d_radial + y * y * y * dd_radial + 6.0 * self.p1;
        [[xxx, xxy, xyy], [xxy, xyy, yyy]]
    }

    /// Returns the fold radius: the smallest undistorted radius at which the distorted point stops moving
    /// outwards in some direction. It is infinite if there is no fold.
    ///
    /// At the radius r and the polar angle phi, the radial component of the tangential part is
    /// `3 r^2 (p1 sin phi + p2 cos phi)`.
    fn fold_radius(&self) -> f64 {
        let tangential = hypot(self.p1, self.p2);
        if tangential == 0.0 {
            return self.radial().first_maximum();
        }
        let derivative = [1.0, -6.0 * tangential, 3.0 * self.k1, 0.0, 5.0 * self.k2, 0.0, 7.0 * self.k3];
        positive_roots(&derivative).first().copied().unwrap_or(f64::INFINITY)
    }

    /// Whether the radius of this undistorted point is within the fold radius, up to which the map is
    /// invertible.
    fn is_regular(&self, [x, y]: [f64; 2]) -> bool {
        let radius = hypot(x, y);
        self.is_surely_increasing(radius) || radius <= self.fold_radius()
    }

    /// Whether a lower bound of the radial derivative is positive up to this undistorted radius. If so, the fold
    /// radius is larger and need not be computed.
    fn is_surely_increasing(&self, radius: f64) -> bool {
        self.radial().derivative_lower_bound(radius) > 6.0 * hypot(self.p1, self.p2) * radius
    }

    /// Returns the undistorted radius at which Newton's method starts, and whether it is already the
    /// solution. The start is the solution of the radial part for the distorted radius `radius`. Returns
    /// `None` if no undistorted point maps to this radius.
    fn start_radius(&self, radius: f64) -> Option<(f64, bool)> {
        let tangential = self.p1 != 0.0 || self.p2 != 0.0;
        match self.radial().inverse(radius) {
            Some(undistorted) if !tangential => Some((undistorted, true)),
            None if !tangential => None,
            Some(undistorted) if self.is_surely_increasing(1.1 * undistorted) => Some((undistorted, false)),
            // The start is inside the fold. Newton's method diverges from beyond the fold, and never
            // overshoots from inside.
            undistorted => Some((undistorted.unwrap_or(f64::INFINITY).min(0.99 * self.fold_radius()), false)),
        }
    }
}

/// Returns the derivatives `d A / d coefficient` of the Jacobian A of the formula, at a fixed undistorted
/// point.
fn jacobian_by_coefficients([x, y]: [f64; 2]) -> [Symmetric; Distortion::MAX_FITTED] {
    let square = x * x + y * y;
    // The derivative of x r^2m is r^2m + 2 m x^2 r^(2m - 2).
    let radial = |m: i32| {
        let (value, d_radial) = (square.powi(m), 2.0 * f64::from(m) * square.powi(m - 1));
        [value + x * x * d_radial, x * y * d_radial, value + y * y * d_radial]
    };
    [radial(1), radial(2), radial(3), [2.0 * y, 2.0 * x, 6.0 * y], [6.0 * x, 2.0 * y, 2.0 * x]]
}

/// Returns the inverse of a symmetric matrix, as a full matrix.
fn inverse([a, b, d]: Symmetric) -> Matrix2 {
    let determinant = a * d - b * b;
    [[d / determinant, -b / determinant], [-b / determinant, a / determinant]]
}

/// Returns the product `-B C B` of two symmetric matrices B and C.
fn negated_triple_product([[a, b], [_, d]]: Matrix2, [p, q, s]: Symmetric) -> Matrix2 {
    let (left, right) = ([a * p + b * q, a * q + b * s], [b * p + d * q, b * q + d * s]);
    let cross = -(left[0] * b + left[1] * d);
    [[-(left[0] * a + left[1] * b), cross], [cross, -(right[0] * b + right[1] * d)]]
}

impl Model for BrownConrady {
    fn max_radius(&self) -> f64 {
        self.fold_radius()
    }

    fn distort(&self, undistorted: [f64; 2]) -> Option<[f64; 2]> {
        self.is_regular(undistorted).then(|| self.evaluate(undistorted))
    }

    /// Solves the formula by Newton's method, from the solution of the radial part.
    fn undistort(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        /// Maximum number of Newton steps. The tangential part is small, so five steps usually suffice.
        /// Convergence is only linear at the fold, where each step halves the error.
        const MAX_STEPS: usize = 50;
        /// Largest accepted last step relative to 1 plus the distorted radius, in coordinates divided by the focal
        /// length.
        const TOLERANCE: f64 = 1e-13;
        let radius = hypot(x, y);
        let (undistorted, is_radial) = self.start_radius(radius)?;
        let scale = if radius > 0.0 { undistorted / radius } else { 1.0 };
        let mut point = [scale * x, scale * y];
        if is_radial {
            return Some(point);
        }
        for _ in 0..MAX_STEPS {
            let distorted = self.evaluate(point);
            let (ex, ey) = (distorted[0] - x, distorted[1] - y);
            let [a, b, d] = self.jacobian(point);
            let determinant = a * d - b * b;
            let step = [(d * ex - b * ey) / determinant, (a * ey - b * ex) / determinant];
            point = [point[0] - step[0], point[1] - step[1]];
            if step[0].abs().max(step[1].abs()) < TOLERANCE * (1.0 + radius) {
                let distorted = self.evaluate(point);
                let close = (distorted[0] - x).hypot(distorted[1] - y) < 1e-12 * (1.0 + radius);
                return (close && self.is_regular(point)).then_some(point);
            }
        }
        None
    }

    fn distort_jacobian(&self, undistorted: [f64; 2]) -> Matrix2 {
        let [a, b, d] = self.jacobian(undistorted);
        [[a, b], [b, d]]
    }

    fn distort_by_coefficients(&self, undistorted: [f64; 2]) -> [[f64; 2]; Distortion::MAX_FITTED] {
        self.distorted_by_coefficients(undistorted)
    }

    fn undistort_jacobian(&self, _: [f64; 2], undistorted: [f64; 2]) -> Matrix2 {
        inverse(self.jacobian(undistorted))
    }

    /// Computes `d A^-1 / d v = -A^-1 (d A / d u) A^-1 A^-1`, by the implicit function theorem. A is the
    /// Jacobian of the formula at the undistorted point u, and v the distorted point.
    fn ray_curvature(&self, _: [f64; 2], [x, y, _]: [f64; 3]) -> RayCurvature {
        let by_distorted = inverse(self.jacobian([x, y]));
        let by_point = self.jacobian_by_point([x, y]);
        [0, 1].map(|k| {
            let change = |i: usize| by_point[0][i] * by_distorted[0][k] + by_point[1][i] * by_distorted[1][k];
            let [u, v] = negated_triple_product(by_distorted, std::array::from_fn(change));
            [u, v, [0.0; 2]]
        })
    }

    fn undistort_by_coefficients(&self, _: [f64; 2], undistorted: [f64; 2]) -> ByCoefficients {
        let by_distorted = inverse(self.jacobian(undistorted));
        let distorted = self.distort_by_coefficients(undistorted);
        let (direct, by_point) = (jacobian_by_coefficients(undistorted), self.jacobian_by_point(undistorted));
        std::array::from_fn(|k| {
            let [x, y] = distorted[k];
            let at = by_distorted.map(|row| -(row[0] * x + row[1] * y));
            let change = |i: usize| direct[k][i] + by_point[0][i] * at[0] + by_point[1][i] * at[1];
            ByCoefficient { at, jacobian: negated_triple_product(by_distorted, std::array::from_fn(change)) }
        })
    }
}

/// Number of points that are undistorted in lockstep.
pub(crate) const LANES: usize = 8;
/// Maximum length of the first step for which the error bound is valid, in coordinates divided by the focal
/// length.
const MAX_FIRST_STEP: f64 = 1e-3;
/// Number of coefficients of the polynomial P of the radial inverse.
const RADIAL_TERMS: usize = 8;

/// Brown-Conrady lens, prepared for the undistortion of many points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BrownInverse {
    /// Model to be inverted.
    brown: BrownConrady,
    /// Coefficients of the polynomial P, in ascending powers of the squared distorted radius times `scale`.
    radial: [f64; RADIAL_TERMS],
    /// Scale `1 / reach^2`, where the reach is the largest distorted radius at which P is valid.
    scale: f64,
    /// Largest squared radius of undistorted points that are solved in lockstep. It is inside the fold, and
    /// not far beyond the reach.
    max_square: f64,
    /// Coefficients of H, a bound of the second derivatives, in ascending powers of the squared undistorted
    /// radius.
    curvature: [f64; 4],
}

impl BrownInverse {
    /// Prepares the undistortion of points up to the distorted radius `reach`, divided by the focal length.
    /// More distant points take longer.
    pub(crate) fn new(brown: &BrownConrady, reach: f64) -> Self {
        let (fold, radial) = (brown.max_radius(), brown.radial());
        let reach = reach.min(0.97 * radial.value(0.97 * fold.min(1e3)).abs());
        let undistorted = radial.inverse(reach);
        // Chebyshev nodes of the squared radius, divided by the squared reach.
        let node =
            |i: usize| 0.5 - 0.5 * sin_cos(std::f64::consts::PI * (i as f64 + 0.5) / RADIAL_TERMS as f64).1;
        let powers = SMatrix::<f64, RADIAL_TERMS, RADIAL_TERMS>::from_fn(|i, k| node(i).powi(k as i32));
        let ratios = SVector::<f64, RADIAL_TERMS>::from_fn(|i, _| {
            let distorted = reach * node(i).sqrt();
            radial.inverse(distorted).map_or(1.0, |undistorted| undistorted / distorted)
        });
        let radial = powers.lu().solve(&ratios).map_or([0.0; RADIAL_TERMS], Into::into);
        let most = (fold * (1.0 - 1e-6)).min(1.1 * undistorted.unwrap_or(reach));
        let curvature = second_derivative_bound(brown, undistorted.unwrap_or(reach));
        Self { brown: *brown, radial, scale: (reach * reach).recip(), max_square: most * most, curvature }
    }

    /// Applies the inverse of the radial part, approximated by the polynomial P, to a distorted point.
    #[inline(always)]
    fn invert_radial(&self, x: f64, y: f64) -> (f64, f64) {
        let square = (x * x + y * y) * self.scale;
        let factor = self.radial.iter().rev().fold(0.0, |sum, &term| sum * square + term);
        (x * factor, y * factor)
    }

    /// Returns the undistorted point at which Newton's method starts.
    #[inline(always)]
    fn start_point(&self, distorted_x: f64, distorted_y: f64) -> (f64, f64) {
        let BrownConrady { p1, p2, .. } = self.brown;
        let (x, y) = self.invert_radial(distorted_x, distorted_y);
        let (square, cross) = (x * x + y * y, 2.0 * x * y);
        let across = [p1 * cross + p2 * (square + 2.0 * x * x), p1 * (square + 2.0 * y * y) + p2 * cross];
        self.invert_radial(distorted_x - across[0], distorted_y - across[1])
    }

    /// Returns the bound H of the second derivatives on the path of the Newton step and the chord step.
    /// `square` is the squared radius of the start. The path is at most two times [`MAX_FIRST_STEP`] long.
    #[inline(always)]
    fn curvature_at(&self, square: f64) -> f64 {
        // Largest squared radius: (r + d)^2 <= 1.01 r^2 + 101 d^2 for the radius r and the path length d.
        let square = 1.01 * square + 404.0 * MAX_FIRST_STEP * MAX_FIRST_STEP;
        self.curvature.iter().rev().fold(0.0, |sum, &term| sum * square + term)
    }

    /// Returns the undistorted point after one step of Newton's method and one of the chord method. The flag is
    /// `true` if the error is small enough, and the point is inside the range of lockstep.
    #[inline(always)]
    fn two_steps(&self, distorted_x: f64, distorted_y: f64) -> (f64, f64, bool) {
        let start = self.start_point(distorted_x, distorted_y);
        let [a, b, d] = self.brown.jacobian(start.into());
        let scale = (a * d - b * b).recip();
        let inverse = (a * a + 2.0 * b * b + d * d) * scale * scale;
        let step = |(x, y): (f64, f64)| {
            let distorted = self.brown.evaluate([x, y]);
            let (ex, ey) = (distorted[0] - distorted_x, distorted[1] - distorted_y);
            ((d * ex - b * ey) * scale, (a * ey - b * ex) * scale)
        };
        let first = step(start);
        let near = (start.0 - first.0, start.1 - first.1);
        let second = step(near);
        let (x, y) = (near.0 - second.0, near.1 - second.1);
        let [first, second] = [first, second].map(|(dx, dy)| dx * dx + dy * dy);
        let h = self.curvature_at(start.0 * start.0 + start.1 * start.1);
        let is_near =
            (inverse * h * h * first * second <= 1e-26) & (first <= MAX_FIRST_STEP * MAX_FIRST_STEP);
        let has_converged = is_near | (second < 1e-28);
        (x, y, has_converged & (x * x + y * y <= self.max_square))
    }

    /// Replaces distorted points by their undistorted points. Coordinates are divided by the focal length.
    /// Points outside the lens become NaN.
    #[inline(always)]
    pub(crate) fn undistort(&self, x: &mut [f64; LANES], y: &mut [f64; LANES]) {
        let (distorted_x, distorted_y) = (*x, *y);
        let mut is_solved = [false; LANES];
        for i in 0..LANES {
            (x[i], y[i], is_solved[i]) = self.two_steps(distorted_x[i], distorted_y[i]);
        }
        if is_solved.iter().all(|&solved| solved) {
            return;
        }
        for i in 0..LANES {
            if !is_solved[i] {
                let solved = Distortion::BrownConrady(self.brown).undistort([distorted_x[i], distorted_y[i]]);
                [x[i], y[i]] = solved.unwrap_or([f64::NAN; 2]);
            }
        }
    }
}

/// Returns the coefficients of a bound of the second derivatives of the formula at the undistorted radius r,
/// in ascending powers of r^2.
///
/// For the radial term `k r^2n`, the second derivatives are at most `2n (2n + 1) |k| r^(2n - 1)`, along the
/// radius. For each tangential term, they are at most 6 times its coefficient. Odd powers of r are replaced
/// with `r <= (r^2 / c + c) / 2`, which is true for any c > 0 and exact at r = c. Here c is `about`.
fn second_derivative_bound(brown: &BrownConrady, about: f64) -> [f64; 4] {
    let [k1, k2, k3, p1, p2] = [brown.k1, brown.k2, brown.k3, brown.p1, brown.p2].map(f64::abs);
    let by_radius = [6.0 * k1, 20.0 * k2, 42.0 * k3];
    let mut terms = [6.0 * (p1 + p2), 0.0, 0.0, 0.0];
    for (i, term) in by_radius.into_iter().enumerate() {
        terms[i] += 0.5 * about * term;
        terms[i + 1] += 0.5 / about * term;
    }
    terms
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn barrel_lens_has_a_fold_radius() {
        let b = BrownConrady { k1: -0.35, ..BrownConrady::default() };
        let turn = Distortion::BrownConrady(b).max_radius();
        assert!((1.0 - 3.0 * 0.35 * turn * turn).abs() < 1e-12);
        assert_eq!(Distortion::BrownConrady(b).distort([turn * 1.01, 0.0]), None);
        let last = b.radial().value(turn);
        assert_eq!(Distortion::BrownConrady(b).undistort([last * 1.01, 0.0]), None);
        assert!(Distortion::BrownConrady(b).has_ray([0.0, last * 0.99]));
        assert!(!Distortion::BrownConrady(b).has_ray([0.0, last * 1.01]));
    }

    proptest! {
        #[test]
        fn points_in_lockstep_agree_with_separate_solutions(
            k1 in -0.4..0.3_f64, k2 in -0.2..0.2_f64, k3 in -0.05..0.05_f64, p1 in -0.01..0.01_f64, p2 in -0.01..0.01_f64,
            reach in 0.2..2.0_f64, at in proptest::collection::vec((-1.5..1.5_f64, -1.5..1.5_f64), LANES),
        ) {
            let brown = BrownConrady { k1, k2, k3, p1, p2 };
            let lens = Distortion::BrownConrady(brown);
            let [mut x, mut y] = [0.0, 1.0].map(|axis| std::array::from_fn(|i| if axis == 0.0 { at[i].0 } else { at[i].1 }));
            BrownInverse::new(&brown, reach).undistort(&mut x, &mut y);
            for i in 0..LANES {
                match lens.undistort(at[i].into()) {
                    None => prop_assert!(x[i].is_nan() && y[i].is_nan(), "{:?} {} {}", at[i], x[i], y[i]),
                    // The derivative vanishes at the fold, so digits are lost there.
                    Some(alone) if alone[0].hypot(alone[1]) > 0.98 * lens.max_radius() => {}
                    Some(alone) => prop_assert!((alone[0] - x[i]).hypot(alone[1] - y[i]) < 1e-12, "{alone:?} {} {}", x[i], y[i]),
                }
            }
        }

        #[test]
        fn points_of_a_typical_image_are_solved_in_lockstep(x in -0.7..0.7_f64, y in -0.38..0.38_f64) {
            let brown = BrownConrady { k1: -0.2, k2: 0.05, p1: 0.001, p2: -0.001, k3: 0.01 };
            let inverse = BrownInverse::new(&brown, 1.1);
            let start = inverse.start_point(x, y);
            let [u, v] = brown.undistort([x, y]).unwrap();
            prop_assert!((start.0 - u).hypot(start.1 - v) < 1e-4);
            prop_assert!(inverse.two_steps(x, y).2);
        }

        #[test]
        fn second_derivatives_are_within_their_bound(
            k in [-0.4..0.3_f64, -0.2..0.2_f64, -0.05..0.05_f64], p in [-0.01..0.01_f64, -0.01..0.01_f64],
            radius in 0.01..1.5_f64, about in 0.2..2.0_f64, angle in 0.0..6.3_f64, way in 0.0..6.3_f64,
        ) {
            const STEP: f64 = 1e-5;
            let brown = BrownConrady { k1: k[0], k2: k[1], k3: k[2], p1: p[0], p2: p[1] };
            let inverse = BrownInverse { curvature: second_derivative_bound(&brown, about), ..BrownInverse::new(&brown, 1.0) };
            let ((sin, cos), (along_y, along_x)) = (angle.sin_cos(), way.sin_cos());
            let at = |step: f64| {
                let [a, b, d] = brown.jacobian([radius * cos + step * along_x, radius * sin + step * along_y]);
                [a * along_x + b * along_y, b * along_x + d * along_y]
            };
            let (ahead, behind) = (at(STEP), at(-STEP));
            let second = (ahead[0] - behind[0]).hypot(ahead[1] - behind[1]) / (2.0 * STEP);
            let bound = inverse.curvature_at(radius * radius);
            prop_assert!(second <= bound + 1e-6, "{second} above {bound}");
        }
    }
}
