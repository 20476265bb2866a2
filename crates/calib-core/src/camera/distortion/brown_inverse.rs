//! Brown-Conrady inverted for many points at once, in step, so that the compiler can use vector instructions.
//!
//! The radial part alone has an inverse `g(d) = d P(|d|^2)` whose polynomial P is interpolated when a camera is
//! prepared. With the tangential part t, `u = g(d - t(g(d)))` is right to some 1e-5; one step of Newton's method from
//! there and one of the chord method, with the same Jacobian J, end at the accuracy of the numbers. What is left of
//! the error is at most `|J^-1| H |first| |second|`, H the largest second derivative within the image: where that is
//! more than 1e-13, at the rim of a lens, the point is solved by itself, so that no result depends on the points
//! beside it.

use nalgebra::{SMatrix, SVector};

use crate::camera::distortion::model::Model;
use crate::camera::distortion::{BrownConrady, Distortion};
use crate::camera::elementary::sin_cos;

/// Points that are inverted together.
pub(crate) const LANES: usize = 8;
/// Coefficients of the polynomial.
const TERMS: usize = 8;

/// A lens prepared for inverting many points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BrownInverse {
    brown: BrownConrady,
    /// Of P, by powers of the square radius over the square of the reach.
    radial: [f64; TERMS],
    /// `1 / reach^2` of the distorted radius up to which P holds.
    scale: f64,
    /// Largest square radius of undistorted points: just within the fold, and not far beyond the reach.
    most: f64,
    /// Square of H: no second derivative within `most` is larger.
    curvature: f64,
}

impl BrownInverse {
    /// For distorted points within `reach` of the principal point, in focals; farther ones take longer.
    pub(crate) fn new(brown: &BrownConrady, reach: f64) -> Self {
        let (fold, radial) = (brown.max_radius(), brown.radial());
        let reach = reach.min(0.97 * radial.value(0.97 * fold.min(1e3)).abs());
        let straight = radial.inverse(reach);
        // Chebyshev's nodes, of the square radius.
        let node = |i: usize| 0.5 - 0.5 * sin_cos(std::f64::consts::PI * (i as f64 + 0.5) / TERMS as f64).1;
        let powers = SMatrix::<f64, TERMS, TERMS>::from_fn(|i, k| node(i).powi(k as i32));
        let ratios = SVector::<f64, TERMS>::from_fn(|i, _| {
            let bent = reach * node(i).sqrt();
            radial.inverse(bent).map_or(1.0, |straight| straight / bent)
        });
        let radial = powers.lu().solve(&ratios).map_or([0.0; TERMS], Into::into);
        let most = (fold * (1.0 - 1e-6)).min(1.1 * straight.unwrap_or(reach));
        let curvature = curvature_within(most, brown).powi(2);
        Self { brown: *brown, radial, scale: (reach * reach).recip(), most: most * most, curvature }
    }

    /// The inverse of the radial part.
    #[inline(always)]
    fn without_radial(&self, x: f64, y: f64) -> (f64, f64) {
        let square = (x * x + y * y) * self.scale;
        let factor = self.radial.iter().rev().fold(0.0, |sum, &term| sum * square + term);
        (x * factor, y * factor)
    }

    #[inline(always)]
    fn start(&self, bent_x: f64, bent_y: f64) -> (f64, f64) {
        let BrownConrady { p1, p2, .. } = self.brown;
        let (x, y) = self.without_radial(bent_x, bent_y);
        let (square, cross) = (x * x + y * y, 2.0 * x * y);
        let across = [p1 * cross + p2 * (square + 2.0 * x * x), p1 * (square + 2.0 * y * y) + p2 * cross];
        self.without_radial(bent_x - across[0], bent_y - across[1])
    }

    /// Undistorts points, divided by the focal, in place; one outside the lens becomes NaN.
    #[inline(always)]
    pub(crate) fn undistort(&self, x: &mut [f64; LANES], y: &mut [f64; LANES]) {
        let (bent_x, bent_y) = (*x, *y);
        let mut is_solved = [false; LANES];
        for i in 0..LANES {
            let start = self.start(bent_x[i], bent_y[i]);
            let [a, b, d] = self.brown.jacobian(start.into());
            let scale = (a * d - b * b).recip();
            let inverse = (a * a + 2.0 * b * b + d * d) * scale * scale;
            let step = |(x, y): (f64, f64)| {
                let bent = self.brown.distort_anywhere([x, y]);
                let (ex, ey) = (bent[0] - bent_x[i], bent[1] - bent_y[i]);
                ((d * ex - b * ey) * scale, (a * ey - b * ex) * scale)
            };
            let first = step(start);
            let near = (start.0 - first.0, start.1 - first.1);
            let second = step(near);
            (x[i], y[i]) = (near.0 - second.0, near.1 - second.1);
            let [first, second] = [first, second].map(|(dx, dy)| dx * dx + dy * dy);
            let has_converged = (inverse * self.curvature * first * second <= 1e-26) | (second < 1e-28);
            is_solved[i] = has_converged & (x[i] * x[i] + y[i] * y[i] <= self.most);
        }
        if is_solved.iter().all(|&solved| solved) {
            return;
        }
        for i in 0..LANES {
            if !is_solved[i] {
                let solved = Distortion::BrownConrady(self.brown).undistort([bent_x[i], bent_y[i]]);
                [x[i], y[i]] = solved.unwrap_or([f64::NAN; 2]);
            }
        }
    }
}

/// No second derivative of the distortion is larger at points up to that far from the principal point.
fn curvature_within(radius: f64, brown: &BrownConrady) -> f64 {
    let [k1, k2, k3, p1, p2] = [brown.k1, brown.k2, brown.k3, brown.p1, brown.p2].map(f64::abs);
    let square = radius * radius;
    // Of r g(r) along the radius, and twice the one of g(r), across.
    radius * (10.0 * k1 + square * (28.0 * k2 + square * 54.0 * k3)) + 8.0 * (p1 + p2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn points_in_step_are_those_that_are_solved_alone(
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
                    // At the very fold digits vanish with the derivative.
                    Some(alone) if alone[0].hypot(alone[1]) > 0.98 * lens.max_radius() => {}
                    Some(alone) => prop_assert!((alone[0] - x[i]).hypot(alone[1] - y[i]) < 1e-12, "{alone:?} {} {}", x[i], y[i]),
                }
            }
        }

        #[test]
        fn within_the_image_of_a_usual_lens_no_point_is_solved_alone(x in -0.8..0.8_f64, y in -0.45..0.45_f64) {
            let brown = BrownConrady { k1: -0.2, k2: 0.05, p1: 0.001, p2: -0.001, k3: 0.01 };
            let inverse = BrownInverse::new(&brown, 1.0);
            let start = inverse.start(x, y);
            let [u, v] = brown.undistort([x, y]).unwrap();
            prop_assert!((start.0 - u).hypot(start.1 - v) < 1e-4);
        }
    }
}
