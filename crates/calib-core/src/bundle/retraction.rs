//! Where a step leads: cameras that hold to each other and to little else turn and scale as a whole, by a similarity and
//! not along its tangent.
//!
//! Let a step scale such a hall by `1 + s` and turn it by theta. Heights and yaws take that as it is, and with a floor point
//! as a complex number p, every place should go to `p0 + (1 + s) e^(i theta) (p - p0)`. The step, which is linear, says
//! `p + a (p - p0)`, `a = s + i theta`. What is between is of the second order, but it turns all places against all yaws,
//! which thousands of observations tell, while s and theta are what a single camera tells: without it steps along such a
//! hall stay short. It is a retraction (Absil, Mahony and Sepulchre 2008, "Optimization Algorithms on Matrix Manifolds",
//! section 4.1): of the first order it changes nothing.

use nalgebra::Complex;

use crate::bundle::landmark::LandmarkModel;
use crate::bundle::problem::BundleProblem;
use crate::camera::{Covariance, sin_cos};

impl BundleProblem<'_> {
    /// The state that a step leads to.
    pub(crate) fn retract(&self, state: &[f64], step: &[f64]) -> Vec<f64> {
        let mut next: Vec<f64> = state.iter().zip(step).map(|(value, step)| value + step).collect();
        let moves: Vec<Move> =
            (0..self.views.len()).map(|view| self.camera_move(state, step, view)).collect();
        let Some(bend) = Bend::of(&moves) else { return next };
        let cameras = (0..self.views.len()).map(|view| self.camera_place(view));
        let landmarks = (0..self.landmarks.len()).map(|landmark| self.landmark_place(landmark));
        for place in cameras.chain(landmarks) {
            if let [Some(x), Some(y)] = place {
                let more = bend.at(Complex::new(state[x], state[y]));
                next[x] += more.re;
                next[y] += more.im;
            }
        }
        next
    }

    fn camera_move(&self, state: &[f64], step: &[f64], view: usize) -> Move {
        let [x, y] = self.camera_place(view);
        let held = self.views[view].camera.position;
        let value = |index: Option<usize>, held: f64| index.map_or(held, |index| state[index]);
        let moved = |index: Option<usize>| index.map_or(0.0, |index| step[index]);
        Move { from: Complex::new(value(x, held.x), value(y, held.y)), by: Complex::new(moved(x), moved(y)) }
    }

    /// Where in the state x and y of a camera are, as far as they are free.
    fn camera_place(&self, view: usize) -> [Option<usize>; 2] {
        [Covariance::X, Covariance::Y].map(|axis| {
            self.camera_layout(view)[axis].map(|(block, place)| self.blocks.offsets[block] + place)
        })
    }

    /// The same of a landmark. A line has none.
    fn landmark_place(&self, landmark: usize) -> [Option<usize>; 2] {
        let is_line = matches!(self.landmarks[landmark].model, LandmarkModel::Line { .. });
        let is_free = self.landmarks[landmark].free[..2] == [true; 2];
        match self.landmark_block(landmark) {
            Some(block) if is_free && !is_line => [0, 1].map(|axis| Some(self.blocks.offsets[block] + axis)),
            _ => [None; 2],
        }
    }
}

/// How a step moves a camera on the floor.
struct Move {
    from: Complex<f64>,
    by: Complex<f64>,
}

/// What a similarity moves besides its tangent.
struct Bend {
    /// Of the cameras.
    centre: Complex<f64>,
    /// How far the step moves it.
    shift: Complex<f64>,
    /// `a = s + i theta`.
    tangent: Complex<f64>,
    /// `((1 + s) e^(i theta) - 1 - a) / a`: the share of a move along the tangent that is to be added to it.
    share: Complex<f64>,
}

impl Bend {
    /// Of the similarity whose tangent is nearest to these moves; `None` where they are no turn and no scale.
    fn of(moves: &[Move]) -> Option<Self> {
        let count = moves.len() as f64;
        let centre = moves.iter().map(|one| one.from).sum::<Complex<f64>>() / count;
        let shift = moves.iter().map(|one| one.by).sum::<Complex<f64>>() / count;
        let with: Complex<f64> = moves.iter().map(|one| (one.from - centre).conj() * (one.by - shift)).sum();
        let square: f64 = moves.iter().map(|one| (one.from - centre).norm_sqr()).sum();
        let tangent = with / square;
        let (sin, cos) = sin_cos(tangent.im);
        let exact = (1.0 + tangent.re) * Complex::new(cos, sin) - 1.0;
        let share = (exact - tangent) / tangent;
        share.is_finite().then_some(Self { centre, shift, tangent, share })
    }

    fn at(&self, place: Complex<f64>) -> Complex<f64> {
        self.share * (self.tangent * (place - self.centre) + self.shift)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn moves_along_the_tangent_of_a_similarity_end_on_it(
            places in proptest::collection::vec((-50.0..50.0_f64, -50.0..50.0_f64), 2..20),
            about in (-50.0..50.0_f64, -50.0..50.0_f64), scale in -0.4..0.4_f64, turn in -1.0..1.0_f64,
        ) {
            let about = Complex::new(about.0, about.1);
            let places: Vec<Complex<f64>> = places.iter().map(|&(x, y)| Complex::new(x, y)).collect();
            prop_assume!(places.iter().any(|place| (place - places[0]).norm() > 1.0));
            prop_assume!(scale.hypot(turn) > 1e-3);
            let moves: Vec<Move> =
                places.iter().map(|&from| Move { from, by: Complex::new(scale, turn) * (from - about) }).collect();
            let bend = Bend::of(&moves).unwrap();
            for Move { from, by } in &moves {
                let exact = about + (1.0 + scale) * Complex::from_polar(1.0, turn) * (from - about);
                prop_assert!((from + by + bend.at(*from) - exact).norm() < 1e-9);
            }
        }

        #[test]
        fn of_small_steps_it_is_the_square(
            places in proptest::collection::vec((-50.0..50.0_f64, -50.0..50.0_f64, -1.0..1.0_f64, -1.0..1.0_f64), 2..20),
        ) {
            let most = |size: f64| {
                let moves: Vec<Move> = places
                    .iter()
                    .map(|&(x, y, dx, dy)| Move { from: Complex::new(x, y), by: size * Complex::new(dx, dy) })
                    .collect();
                let bend = Bend::of(&moves);
                moves.iter().map(|one| bend.as_ref().map_or(0.0, |bend| bend.at(one.from).norm())).fold(0.0, f64::max)
            };
            prop_assume!(places.iter().any(|place| (place.0 - places[0].0).hypot(place.1 - places[0].1) > 1.0));
            prop_assert!(most(1e-4) <= 1.01e-2 * most(1e-3) + 1e-12, "{} {}", most(1e-4), most(1e-3));
        }
    }

    #[test]
    fn cameras_in_one_place_have_none() {
        let one = || Move { from: Complex::new(3.0, 4.0), by: Complex::new(0.1, 0.2) };
        assert!(Bend::of(&[one(), one()]).is_none());
        assert!(Bend::of(&[]).is_none());
    }
}
