//! Where a step leads: cameras that hold to each other and to little else turn and scale as a whole, by a similarity and
//! not along its tangent.
//!
//! Let a step scale such a hall by s and turn it by theta. Heights and yaws take s and theta as they are, and with a floor
//! point as a complex number p, every place should go to `p0 + (1 + s) e^(i theta) (p - p0)`. The step, which is linear, says
//! `p + a (p - p0)`, `a = s + i theta`. What is between is of the second order, but it is a turn of all places against all
//! yaws, which thousands of observations tell, while what keeps s and theta is what a single camera sees: without it steps
//! along such a hall stay short.

use nalgebra::Complex;

use crate::bundle::landmark::LandmarkModel;
use crate::bundle::problem::BundleProblem;
use crate::camera::{Covariance, sin_cos};

impl BundleProblem<'_> {
    /// The state that a step leads to.
    pub(crate) fn retract(&self, state: &[f64], step: &[f64]) -> Vec<f64> {
        let mut next: Vec<f64> = state.iter().zip(step).map(|(value, step)| value + step).collect();
        let Some(bend) = self.bend(state, step) else { return next };
        let places = (0..self.views.len()).map(|view| self.camera_place(view));
        for [x, y] in places.chain((0..self.landmarks.len()).map(|landmark| self.landmark_place(landmark))) {
            if let (Some(x), Some(y)) = (x, y) {
                let more = bend.at(Complex::new(state[x], state[y]));
                next[x] += more.re;
                next[y] += more.im;
            }
        }
        next
    }

    /// By the similarity that is nearest to the moves of the cameras.
    fn bend(&self, state: &[f64], step: &[f64]) -> Option<Bend> {
        let of_view = |view: usize| {
            let [x, y] = self.camera_place(view);
            let at = self.views[view].camera.position;
            let value = |place: Option<usize>, held: f64| place.map_or(held, |place| state[place]);
            let moved = |place: Option<usize>| place.map_or(0.0, |place| step[place]);
            (Complex::new(value(x, at.x), value(y, at.y)), Complex::new(moved(x), moved(y)))
        };
        let cameras: Vec<(Complex<f64>, Complex<f64>)> = (0..self.views.len()).map(of_view).collect();
        let (places, moves): (Complex<f64>, Complex<f64>) =
            cameras.iter().fold(Default::default(), |(p, w), (place, moved)| (p + place, w + moved));
        let count = cameras.len() as f64;
        let (centre, shift) = (places / count, moves / count);
        let sums = cameras.iter().fold((Complex::default(), 0.0), |(with, square), (place, moved)| {
            let from_centre = place - centre;
            (with + from_centre.conj() * (moved - shift), square + from_centre.norm_sqr())
        });
        let by = sums.0 / sums.1;
        let (sin, cos) = sin_cos(by.im);
        let exact = (1.0 + by.re) * Complex::new(cos, sin) - 1.0;
        let share = (exact - by) / by;
        share.is_finite().then_some(Bend { centre, shift, by, share })
    }

    fn camera_place(&self, view: usize) -> [Option<usize>; 2] {
        [Covariance::X, Covariance::Y].map(|axis| {
            self.camera_layout(view)[axis].map(|(block, place)| self.blocks.offsets[block] + place)
        })
    }

    /// That of a line is no point.
    fn landmark_place(&self, landmark: usize) -> [Option<usize>; 2] {
        let Some(block) = self.landmark_block(landmark) else { return [None; 2] };
        match &self.landmarks[landmark] {
            of if of.free[..2] != [true; 2] || matches!(of.model, LandmarkModel::Line { .. }) => [None; 2],
            _ => [0, 1].map(|axis| Some(self.blocks.offsets[block] + axis)),
        }
    }
}

/// What a similarity moves besides its tangent.
struct Bend {
    /// Of the cameras.
    centre: Complex<f64>,
    /// How far the step moves it.
    shift: Complex<f64>,
    /// `s + i theta`.
    by: Complex<f64>,
    /// Of the move along the tangent.
    share: Complex<f64>,
}

impl Bend {
    fn at(&self, place: Complex<f64>) -> Complex<f64> {
        self.share * (self.by * (place - self.centre) + self.shift)
    }
}
