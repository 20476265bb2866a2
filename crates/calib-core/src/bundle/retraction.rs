//! Where a step leads: cameras that hold to each other and to little else turn and scale as a whole, by a similarity and
//! not along its tangent.
//!
//! Let a step scale such a hall by `1 + s` and turn it by theta. Heights and yaws take that as it is, and with a floor point
//! as a complex number p, every place should move by `((1 + s) e^(i theta) - 1) (p - p0)`. The step, which is linear, moves
//! it by `a (p - p0)`, `a = s + i theta`. What is between is of the second order, but it turns all places against all yaws,
//! which thousands of observations tell, while s and theta are what a single camera tells: without it steps along such a
//! hall stay short. So the step of every place is multiplied by
//!
//! `g = ((1 + s) e^(i theta) - 1) / a`,
//!
//! with the a that is nearest to the steps of all cameras. It is a retraction (Absil, Mahony and Sepulchre 2008,
//! "Optimization Algorithms on Matrix Manifolds", section 4.1): of the first order it changes nothing, and what stays where
//! it is stays there. Offsets of lines and slopes of planes are left to the next step.

use nalgebra::Complex;

use crate::bundle::landmark::LandmarkModel;
use crate::bundle::problem::BundleProblem;
use crate::camera::{Covariance, sin_cos};

impl BundleProblem<'_> {
    /// The state that a step leads to.
    pub(crate) fn retract(&self, state: &[f64], step: &[f64]) -> Vec<f64> {
        let mut next: Vec<f64> = state.iter().zip(step).map(|(value, step)| value + step).collect();
        let at = |values: &[f64], [x, y]: [usize; 2]| Complex::new(values[x], values[y]);
        let cameras: Vec<[usize; 2]> =
            (0..self.views.len()).filter_map(|view| self.camera_place(view)).collect();
        let moves = cameras.iter().map(|&place| (at(state, place), at(step, place)));
        let Some(factor) = nearest_tangent(&moves.collect::<Vec<_>>()).and_then(factor) else { return next };
        let landmarks = (0..self.landmarks.len()).filter_map(|landmark| self.landmark_place(landmark));
        for [x, y] in cameras.iter().copied().chain(landmarks) {
            let to = at(state, [x, y]) + factor * at(step, [x, y]);
            (next[x], next[y]) = (to.re, to.im);
        }
        next
    }

    /// Where in the state x and y of a camera are; `None` where they are not free.
    fn camera_place(&self, view: usize) -> Option<[usize; 2]> {
        let of = |axis: usize| {
            self.camera_layout(view)[axis].map(|(block, place)| self.blocks.offsets[block] + place)
        };
        Some([of(Covariance::X)?, of(Covariance::Y)?])
    }

    /// The same of a landmark that is a point or has one.
    fn landmark_place(&self, landmark: usize) -> Option<[usize; 2]> {
        let is_line = matches!(self.landmarks[landmark].model, LandmarkModel::Line { .. });
        let is_free = self.landmarks[landmark].free[..2] == [true; 2];
        let at = self.blocks.offsets[self.landmark_block(landmark)?];
        (is_free && !is_line).then_some([at, at + 1])
    }
}

/// The `a` of the similarity about any point that is nearest to these moves, of places and the steps there; `None` where
/// all are in one place.
fn nearest_tangent(moves: &[(Complex<f64>, Complex<f64>)]) -> Option<Complex<f64>> {
    let count = moves.len() as f64;
    let centre = moves.iter().map(|(place, _)| place).sum::<Complex<f64>>() / count;
    let shift = moves.iter().map(|(_, step)| step).sum::<Complex<f64>>() / count;
    let with: Complex<f64> = moves.iter().map(|(place, step)| (place - centre).conj() * (step - shift)).sum();
    let square: f64 = moves.iter().map(|(place, _)| (place - centre).norm_sqr()).sum();
    (square > 0.0).then(|| with / square)
}

/// `g`; `None` where there is neither a turn nor a scale.
fn factor(tangent: Complex<f64>) -> Option<Complex<f64>> {
    let Complex { re: s, im: theta } = tangent;
    let [(sin, cos), (half, _)] = [theta, 0.5 * theta].map(sin_cos);
    // Without the difference of nearly equal numbers that 1 - cos is.
    let moved = Complex::new(s * cos - 2.0 * half * half, (1.0 + s) * sin);
    let factor = moved / tangent;
    factor.is_finite().then_some(factor)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn steps_along_the_tangent_of_a_similarity_end_on_it(
            places in proptest::collection::vec((-50.0..50.0_f64, -50.0..50.0_f64), 2..20),
            about in (-50.0..50.0_f64, -50.0..50.0_f64), scale in -0.4..0.4_f64, turn in -1.0..1.0_f64,
        ) {
            let about = Complex::new(about.0, about.1);
            let places: Vec<Complex<f64>> = places.iter().map(|&(x, y)| Complex::new(x, y)).collect();
            prop_assume!(places.iter().any(|place| (place - places[0]).norm() > 1.0));
            prop_assume!(scale.hypot(turn) > 1e-3);
            let moves: Vec<_> =
                places.iter().map(|&from| (from, Complex::new(scale, turn) * (from - about))).collect();
            let factor = factor(nearest_tangent(&moves).unwrap()).unwrap();
            for (from, step) in moves {
                let exact = about + (1.0 + scale) * Complex::from_polar(1.0, turn) * (from - about);
                prop_assert!((from + factor * step - exact).norm() < 1e-9);
            }
        }

        #[test]
        fn of_the_first_order_it_changes_nothing(
            size in -17.0..-0.5_f64, scale in -1.0..1.0_f64, turn in -1.0..1.0_f64,
        ) {
            let tangent = 10.0_f64.powf(size) * Complex::new(scale, turn);
            prop_assume!(tangent.norm() > 0.0);
            let factor = factor(tangent).unwrap();
            prop_assert!((factor - 1.0).norm() <= 1.01 * tangent.norm() + 1e-15, "{tangent} {factor}");
        }
    }

    #[test]
    fn without_a_turn_or_a_scale_there_is_none() {
        let one = (Complex::new(3.0, 4.0), Complex::new(0.1, 0.2));
        assert!(nearest_tangent(&[one, one]).is_none());
        assert!(nearest_tangent(&[]).is_none());
        assert!(factor(Complex::default()).is_none());
    }
}
