//! Where a step leads: places follow the similarities of their neighbours (`local_similarity.rs`).
//!
//! It is a retraction (Absil, Mahony and Sepulchre 2008, "Optimization Algorithms on Matrix Manifolds", section 4.1): of the
//! first order it changes nothing, and what stays where it is stays there. Offsets of lines and slopes of planes are left
//! to the next step.

use nalgebra::Complex;

use crate::bundle::landmark::LandmarkModel;
use crate::bundle::local_similarity::ViewLaplacian;
use crate::bundle::problem::BundleProblem;
use crate::camera::Covariance;

impl BundleProblem<'_> {
    /// The views that see something in common.
    pub(crate) fn view_laplacian(&self) -> Option<ViewLaplacian> {
        let mut pairs: Vec<[usize; 2]> = Vec::new();
        for landmark in self.landmarks.iter().filter(|landmark| !landmark.off) {
            let views = landmark.views();
            for (k, &a) in views.iter().enumerate() {
                pairs.extend(views[k + 1..].iter().map(|&b| [a, b]));
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        let is_free = |view: usize| self.camera_place(view).is_some();
        ViewLaplacian::new(&(0..self.views.len()).map(is_free).collect::<Vec<_>>(), pairs)
    }

    /// The state that a step leads to.
    pub(crate) fn retract(&self, state: &[f64], step: &[f64]) -> Vec<f64> {
        let mut next: Vec<f64> = state.iter().zip(step).map(|(value, step)| value + step).collect();
        let Some(laplacian) = &self.laplacian else { return next };
        let at = |values: &[f64], [x, y]: [usize; 2]| Complex::new(values[x], values[y]);
        let moved = |view: usize| match self.camera_place(view) {
            Some(place) => (at(state, place), at(step, place)),
            None => {
                let held = self.views[view].camera.position;
                (Complex::new(held.x, held.y), Complex::default())
            }
        };
        let moves: Vec<_> = (0..self.views.len()).map(moved).collect();
        let missing = laplacian.missing(&moves);
        let mut add = |[x, y]: [usize; 2], more: Complex<f64>| {
            next[x] += more.re;
            next[y] += more.im;
        };
        for (view, missing) in missing.iter().enumerate() {
            self.camera_place(view).iter().for_each(|&place| add(place, missing.shift));
        }
        for (index, landmark) in self.landmarks.iter().enumerate() {
            let Some(place) = self.landmark_place(index) else { continue };
            let from =
                |view: usize| missing[view].shift + missing[view].slope * (at(state, place) - moves[view].0);
            let sum: Complex<f64> = landmark.observations.iter().map(|seen| from(seen.view)).sum();
            add(place, sum / landmark.observations.len().max(1) as f64);
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
