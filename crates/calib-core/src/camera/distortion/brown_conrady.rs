//! Radial polynomial with decentring: D. C. Brown, "Decentering distortion of lenses", 1966, after
//! A. E. Conrady, 1919, in the terms of OpenCV.
//!
//! With `r^2 = x^2 + y^2` and `R = 1 + k1 r^2 + k2 r^4 + k3 r^6`:
//!
//! ```text
//! x' = x R + 2 p1 x y + p2 (r^2 + 2 x^2)
//! y' = y R + p1 (r^2 + 2 y^2) + 2 p2 x y
//! ```
//!
//! There is no closed inverse. Its derivatives are those of the implicit function: with the Jacobian A of
//! the formula at the undistorted point u, `d u / d x' = A^-1`, and at a distorted point that stays
//! `d u / d k = -A^-1 (d x' / d k)`, `d A^-1 / d k = -A^-1 (d A / d k + (d A / d u) (d u / d k)) A^-1`.
//! A is symmetric, for the formula is the gradient of a function, so that it is kept as three numbers.

use crate::camera::distortion::model::{ByCoefficient, ByCoefficients, Matrix2, Model};
use crate::camera::distortion::{Coefficient, Distortion, DistortionModel, ModelRow};
use crate::camera::elementary::hypot;
use crate::camera::polynomial::{OddPolynomial, positive_roots};

pub(super) const ROW: ModelRow = ModelRow {
    model: DistortionModel::BrownConrady,
    name: "brown-conrady",
    coefficients: &[Coefficient::K1, Coefficient::K2, Coefficient::K3, Coefficient::P1, Coefficient::P2],
    powers: Some([2, 4, 6, 1, 1]),
    in_order: false,
    is_wide: false,
    is_fitted: true,
    usual: 2,
    zero: Distortion::BrownConrady(BrownConrady { k1: 0.0, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 }),
};

/// Coefficients of the Brown-Conrady model, as OpenCV names them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BrownConrady {
    /// Radial, with r^2.
    pub k1: f64,
    /// Radial, with r^4.
    pub k2: f64,
    /// Radial, with r^6.
    pub k3: f64,
    /// Tangential: vertical decentring.
    pub p1: f64,
    /// Tangential: horizontal decentring.
    pub p2: f64,
}

/// A symmetric matrix: `[xx, xy, yy]`.
type Symmetric = [f64; 3];

impl BrownConrady {
    /// The radial part, as a polynomial of the radius.
    pub(crate) fn radial(&self) -> OddPolynomial {
        OddPolynomial([self.k1, self.k2, self.k3, 0.0])
    }

    /// The formula, also where the model folds back on itself.
    #[inline]
    pub(crate) fn distort_anywhere(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let square = x * x + y * y;
        let radial = 1.0 + square * (self.k1 + square * (self.k2 + square * self.k3));
        [
            x * radial + 2.0 * self.p1 * x * y + self.p2 * (square + 2.0 * x * x),
            y * radial + self.p1 * (square + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        ]
    }

    /// Derivative of the formula by every coefficient, the undistorted point staying.
    #[inline(always)]
    #[expect(clippy::unused_self, reason = "the formula is linear in its coefficients")]
    pub(crate) fn distorted_by_coefficients(&self, [x, y]: [f64; 2]) -> [[f64; 2]; Distortion::MOST] {
        let square = x * x + y * y;
        let (fourth, sixth, cross) = (square * square, square * square * square, 2.0 * x * y);
        let radial = [square, fourth, sixth].map(|power| [x * power, y * power]);
        let decentring = [[cross, square + 2.0 * y * y], [square + 2.0 * x * x, cross]];
        [radial[0], radial[1], radial[2], decentring[0], decentring[1]]
    }

    /// Derivative of the formula, which is symmetric: `[dx'/dx, dx'/dy, dy'/dy]`.
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

    /// Change of [`Self::jacobian`] with the point: by x, and by y.
    fn jacobian_by_point(&self, [x, y]: [f64; 2]) -> [Symmetric; 2] {
        let square = x * x + y * y;
        let d_radial = self.k1 + square * (2.0 * self.k2 + 3.0 * self.k3 * square);
        let dd_radial = 4.0 * (2.0 * self.k2 + 6.0 * self.k3 * square);
        // The formula is the gradient of a function of x and y, whose third derivatives are four numbers.
        let xxx = 6.0 * x * d_radial + x * x * x * dd_radial + 6.0 * self.p2;
        let xxy = 2.0 * y * d_radial + x * x * y * dd_radial + 2.0 * self.p1;
        let xyy = 2.0 * x * d_radial + x * y * y * dd_radial + 2.0 * self.p2;
        let yyy = 6.0 * y * d_radial + y * y * y * dd_radial + 6.0 * self.p1;
        [[xxx, xxy, xyy], [xxy, xyy, yyy]]
    }

    /// The smallest radius at which the model stops growing in some direction; infinite if there is none.
    ///
    /// Across a radius the tangential part is `3 r^2 (p1 sin + p2 cos)` of its direction.
    fn fold(&self) -> f64 {
        let tangential = hypot(self.p1, self.p2);
        if tangential == 0.0 {
            return self.radial().first_turn();
        }
        let derivative = [1.0, -6.0 * tangential, 3.0 * self.k1, 0.0, 5.0 * self.k2, 0.0, 7.0 * self.k3];
        positive_roots(&derivative).first().copied().unwrap_or(f64::INFINITY)
    }

    /// Whether the map can be inverted within the radius of this undistorted point.
    fn is_regular(&self, [x, y]: [f64; 2]) -> bool {
        let radius = hypot(x, y);
        self.surely_grows(radius) || radius <= self.fold()
    }

    /// Whether the model grows up to this radius by what only takes from its derivative: where even that
    /// leaves some, no root need be looked for.
    fn surely_grows(&self, radius: f64) -> bool {
        self.radial().least_derivative(radius) > 6.0 * hypot(self.p1, self.p2) * radius
    }

    /// Where Newton's method starts, and whether that is the answer: the solution of the radial part, which a
    /// bracket guards.
    fn start(&self, radius: f64) -> Option<(f64, bool)> {
        let tangential = self.p1 != 0.0 || self.p2 != 0.0;
        match self.radial().inverse(radius) {
            Some(straight) if !tangential => Some((straight, true)),
            None if !tangential => None,
            Some(straight) if self.surely_grows(1.1 * straight) => Some((straight, false)),
            // From within: beyond the fold Newton's method runs away, up to it it never oversteps.
            straight => Some((straight.unwrap_or(f64::INFINITY).min(0.99 * self.fold()), false)),
        }
    }
}

/// `d A / d coefficient` of the Jacobian A of the formula: `[xx, xy, yy]`.
fn jacobian_by_coefficients([x, y]: [f64; 2]) -> [Symmetric; Distortion::MOST] {
    let square = x * x + y * y;
    // Of x r^2m: r^2m + 2 m x^2 r^(2m - 2).
    let radial = |m: i32| {
        let (value, d_radial) = (square.powi(m), 2.0 * f64::from(m) * square.powi(m - 1));
        [value + x * x * d_radial, x * y * d_radial, value + y * y * d_radial]
    };
    [radial(1), radial(2), radial(3), [2.0 * y, 2.0 * x, 6.0 * y], [6.0 * x, 2.0 * y, 2.0 * x]]
}

/// Of a symmetric matrix, as a matrix.
fn inverse([a, b, d]: Symmetric) -> Matrix2 {
    let determinant = a * d - b * b;
    [[d / determinant, -b / determinant], [-b / determinant, a / determinant]]
}

/// `-B C B` of symmetric matrices.
fn sandwiched([[a, b], [_, d]]: Matrix2, [p, q, s]: Symmetric) -> Matrix2 {
    let (left, right) = ([a * p + b * q, a * q + b * s], [b * p + d * q, b * q + d * s]);
    let cross = -(left[0] * b + left[1] * d);
    [[-(left[0] * a + left[1] * b), cross], [cross, -(right[0] * b + right[1] * d)]]
}

impl Model for BrownConrady {
    fn max_radius(&self) -> f64 {
        self.fold()
    }

    fn distort(&self, straight: [f64; 2]) -> Option<[f64; 2]> {
        self.is_regular(straight).then(|| self.distort_anywhere(straight))
    }

    /// Newton's method from the solution of the radial part.
    fn undistort(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        /// Newton doubles its digits: the tangential part is small, five steps are many; at the very fold
        /// it only halves the error.
        const ROUNDS: usize = 50;
        /// Of the focal-normalised coordinates; a millionth of a millionth of the focal.
        const TOLERANCE: f64 = 1e-13;
        let radius = hypot(x, y);
        let (straight, is_radial) = self.start(radius)?;
        let scale = if radius > 0.0 { straight / radius } else { 1.0 };
        let mut point = [scale * x, scale * y];
        if is_radial {
            return Some(point);
        }
        for _ in 0..ROUNDS {
            let bent = self.distort_anywhere(point);
            let (ex, ey) = (bent[0] - x, bent[1] - y);
            let [a, b, d] = self.jacobian(point);
            let determinant = a * d - b * b;
            let step = [(d * ex - b * ey) / determinant, (a * ey - b * ex) / determinant];
            point = [point[0] - step[0], point[1] - step[1]];
            if step[0].abs().max(step[1].abs()) < TOLERANCE * (1.0 + radius) {
                let bent = self.distort_anywhere(point);
                let close = (bent[0] - x).hypot(bent[1] - y) < 1e-12 * (1.0 + radius);
                return (close && self.is_regular(point)).then_some(point);
            }
        }
        None
    }

    fn distort_jacobian(&self, straight: [f64; 2]) -> Matrix2 {
        let [a, b, d] = self.jacobian(straight);
        [[a, b], [b, d]]
    }

    fn distort_by_coefficients(&self, straight: [f64; 2]) -> [[f64; 2]; Distortion::MOST] {
        self.distorted_by_coefficients(straight)
    }

    fn undistort_jacobian(&self, _: [f64; 2], straight: [f64; 2]) -> Matrix2 {
        inverse(self.jacobian(straight))
    }

    fn undistort_by_coefficients(&self, _: [f64; 2], straight: [f64; 2]) -> ByCoefficients {
        let by_bent = inverse(self.jacobian(straight));
        let bent = self.distort_by_coefficients(straight);
        let (direct, by_point) = (jacobian_by_coefficients(straight), self.jacobian_by_point(straight));
        std::array::from_fn(|k| {
            let [x, y] = bent[k];
            let at = by_bent.map(|row| -(row[0] * x + row[1] * y));
            let change = |i: usize| direct[k][i] + by_point[0][i] * at[0] + by_point[1][i] * at[1];
            ByCoefficient { at, jacobian: sandwiched(by_bent, std::array::from_fn(change)) }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_barrel_lens_says_where_it_folds() {
        let b = BrownConrady { k1: -0.35, ..BrownConrady::default() };
        let turn = Distortion::BrownConrady(b).max_radius();
        assert!((1.0 - 3.0 * 0.35 * turn * turn).abs() < 1e-12);
        assert_eq!(Distortion::BrownConrady(b).distort([turn * 1.01, 0.0]), None);
        let last = b.radial().value(turn);
        assert_eq!(Distortion::BrownConrady(b).undistort([last * 1.01, 0.0]), None);
        assert!(Distortion::BrownConrady(b).reaches([0.0, last * 0.99]));
        assert!(!Distortion::BrownConrady(b).reaches([0.0, last * 1.01]));
    }
}
