//! State after a step, with points moved along the similarities of their neighbours (`local_similarity.rs`).
//!
//! The mapping from a step to the new state is a retraction (Absil, Mahony and Sepulchre 2008, "Optimization
//! Algorithms on Matrix Manifolds", section 4.1). To first order the correction is zero. Fixed cameras and
//! measured landmarks follow the linear step, and the other positions are corrected relative to them. Offsets
//! of lines and slopes of planes are corrected by the next step.

use nalgebra::Complex;

use crate::bundle::landmark::{Landmark, LandmarkModel, covisible_pairs};
use crate::bundle::local_similarity::{Correction, LocalSimilarities, PointStep};
use crate::bundle::problem::BundleProblem;
use crate::camera::Covariance;

/// Indices in the state of the x and y coordinates of a camera or landmark; `None` for a fixed coordinate, and for a
/// line.
type Axes = [Option<usize>; 2];

impl BundleProblem<'_> {
    /// Builds the graph for the corrections. Its points are the views, followed by the measured landmarks. Its pairs
    /// are views that share landmarks, and measured landmarks with their views.
    pub(crate) fn local_similarities(&self) -> Option<LocalSimilarities> {
        let is_free = (0..self.views.len()).map(|view| is_free(self.camera_axes(view)));
        let is_free = is_free.chain(self.measured().map(|_| false)).collect::<Vec<_>>();
        let with_measured = |(k, landmark): (usize, usize)| {
            let views = self.landmarks[landmark].views();
            views.into_iter().map(move |view| [view, self.views.len() + k])
        };
        let mut pairs = covisible_pairs(&self.landmarks);
        pairs.extend(self.measured().enumerate().flat_map(with_measured));
        LocalSimilarities::new(&is_free, pairs)
    }

    /// Returns the state after a step, with the second-order corrections of positions.
    pub(crate) fn retract(&self, state: &[f64], step: &[f64]) -> Vec<f64> {
        let mut next: Vec<f64> = state.iter().zip(step).map(|(value, step)| value + step).collect();
        let Some(similarities) = &self.similarities else { return next };
        let moved = |axes: Axes, fixed: [f64; 2]| -> PointStep {
            let position = [0, 1].map(|k| axes[k].map_or(fixed[k], |at| state[at]));
            let step = axes.map(|at| at.map_or(0.0, |at| step[at]));
            (Complex::new(position[0], position[1]), Complex::new(step[0], step[1]))
        };
        let of_view = |view: usize| {
            let fixed = self.views[view].camera.position;
            moved(self.camera_axes(view), [fixed.x, fixed.y])
        };
        let of_landmark = |landmark: usize| {
            let [x, y, _] = self.landmarks[landmark].params;
            moved(self.landmark_axes(landmark), [x, y])
        };
        let moves: Vec<PointStep> =
            (0..self.views.len()).map(of_view).chain(self.measured().map(of_landmark)).collect();
        let corrections = similarities.corrections(&moves);
        let mut correct = |axes: Axes, more: Complex<f64>| {
            if let [Some(x), Some(y)] = axes {
                next[x] += more.re;
                next[y] += more.im;
            }
        };
        (0..self.views.len()).for_each(|view| correct(self.camera_axes(view), corrections[view].shift));
        for landmark in (0..self.landmarks.len()).filter(|&landmark| !self.landmarks[landmark].is_measured())
        {
            let seen = &self.landmarks[landmark].observations;
            let position = of_landmark(landmark).0;
            let neighbour_step = |view: usize| {
                let Correction { shift, similarity } = corrections[view];
                shift + similarity * (position - moves[view].0)
            };
            let sum: Complex<f64> = seen.iter().map(|seen| neighbour_step(seen.view)).sum();
            correct(self.landmark_axes(landmark), sum / seen.len().max(1) as f64);
        }
        next
    }

    /// Returns the active landmarks with measured positions.
    fn measured(&self) -> impl Iterator<Item = usize> + '_ {
        let landmarks = self.landmarks.iter().enumerate();
        landmarks.filter(|(_, landmark)| !landmark.off && landmark.is_measured()).map(|(index, _)| index)
    }

    /// Returns the indices of x and y of a camera in the state.
    fn camera_axes(&self, view: usize) -> Axes {
        let layout = self.camera_layout(view);
        [Covariance::X, Covariance::Y].map(|axis| layout[axis].map(|at| self.blocks.parameter_index(at)))
    }

    /// Returns the indices of x and y of a landmark in the state; none for a line, which has no point.
    fn landmark_axes(&self, landmark: usize) -> Axes {
        let Landmark { model, free: [x, y, _], .. } = &self.landmarks[landmark];
        let block = self.landmark_block(landmark);
        let Some(block) = block.filter(|_| !matches!(model, LandmarkModel::Line { .. })) else {
            return [None; 2];
        };
        let first = self.blocks.offsets[block];
        [x.then_some(first), y.then_some(first + usize::from(*x))]
    }
}

/// Whether both x and y are free.
fn is_free(axes: Axes) -> bool {
    axes.iter().all(Option::is_some)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bundle::camera::{CAMERA_PARAMS, View};
    use crate::bundle::copies::Copies;
    use crate::bundle::landmark::Observation;
    use crate::camera::{Camera, Lens, Pixel, WorldPoint};
    use crate::single::{Constraints, FixedParameters, PrincipalPointPrior, Prior, Priors, Problem};

    static NONE: Constraints = Constraints::EMPTY;

    /// Builds six cameras in a row that share points with their neighbours. The first two observe a measured
    /// point at the origin.
    fn row(free: [bool; CAMERA_PARAMS], sigma: Option<f64>) -> BundleProblem<'static> {
        let camera = |index: usize| Camera {
            position: WorldPoint::new(5.0 * index as f64, 1.0, 3.0),
            yaw: 0.0,
            pitch: 0.6,
            roll: 0.0,
            focal: 1100.0,
            lens: Lens::pinhole(Pixel::new(960.0, 540.0)),
            covariance: Covariance::EXACT,
        };
        let view = |index: usize| {
            let stage_1 = Problem::new(&NONE, FixedParameters::default(), Priors::default(), 1.0, 1920.0);
            View {
                outermost: None,
                camera: camera(index),
                free,
                lens: index,
                annotations: &[],
                nuisance: vec![0.0; stage_1.nuisances().count()],
                stage_1,
                shares_floor: true,
                edges: Vec::new(),
                edge_counts: Vec::new(),
                size: [1920.0, 1080.0],
                principal_point: PrincipalPointPrior::of_image([1920.0, 1080.0]),
                pixel_aspect: Some(Prior { value: 1.0, sigma: 0.01 }),
                has_tied_focal: false,
            }
        };
        let seen =
            |views: [usize; 2]| views.map(|view| Observation::new(view, Pixel::new(960.0, 700.0))).to_vec();
        let point = |index: usize| Landmark {
            params: [5.0 * index as f64 + 2.0, 4.0, 0.0],
            ..Landmark::new(LandmarkModel::Point { height: 0.0 }, seen([index, index + 1]))
        };
        let measured = Landmark::measured(WorldPoint::new(0.0, 0.0, 0.0), sigma, seen([0, 1]));
        let landmarks = std::iter::once(measured).chain((0..5).map(point)).collect();
        let views = (0..6).map(view).collect();
        BundleProblem::new(views, (landmarks, Vec::new(), Copies::default()), Vec::new())
    }

    /// Builds the step that moves every position by `moved`.
    fn step(problem: &BundleProblem, moved: impl Fn(Complex<f64>) -> Complex<f64>) -> Vec<f64> {
        let state = problem.start();
        let mut step = vec![0.0; state.len()];
        for axes in all_axes(problem) {
            if let [Some(x), Some(y)] = axes {
                let Complex { re, im } = moved(Complex::new(state[x], state[y]));
                (step[x], step[y]) = (re, im);
            }
        }
        step
    }

    fn all_axes(problem: &BundleProblem) -> Vec<Axes> {
        let landmarks = (0..problem.landmarks.len()).map(|landmark| problem.landmark_axes(landmark));
        (0..problem.views.len()).map(|view| problem.camera_axes(view)).chain(landmarks).collect()
    }

    #[test]
    fn row_rotates_exactly_about_a_measured_point() {
        for sigma in [None, Some(0.01)] {
            let problem = row([true; CAMERA_PARAMS], sigma);
            let state = problem.start();
            let tangent = Complex::new(0.1, 0.4);
            let next = problem.retract(&state, &step(&problem, |position| tangent * position));
            let turned = 1.1 * Complex::from_polar(1.0, 0.4);
            for axes in all_axes(&problem) {
                if let [Some(x), Some(y)] = axes {
                    let exact: Complex<f64> = turned * Complex::new(state[x], state[y]);
                    assert!((Complex::new(next[x], next[y]) - exact).norm() < 1e-6, "{exact}");
                }
            }
        }
    }

    #[test]
    fn cameras_fixed_along_one_axis_follow_the_linear_step_along_the_other() {
        let mut free = [true; CAMERA_PARAMS];
        free[Covariance::X] = false;
        let problem = row(free, None);
        let state = problem.start();
        let mut step = step(&problem, |_| Complex::new(0.0, 1.0));
        (0..6).for_each(|view| step[problem.camera_axes(view)[1].unwrap()] = 1.0);
        let next = problem.retract(&state, &step);
        let [_, y] = problem.camera_axes(5);
        assert!((next[y.unwrap()] - state[y.unwrap()] - 1.0).abs() < 1e-12);
        // The measured point stays, which slightly rotates the points seen by the first two cameras. Points
        // seen only by the other cameras move with them.
        let [Some(x), Some(y)] = problem.landmark_axes(5) else { panic!("a point is free") };
        assert!((next[x] - state[x]).abs() < 1e-12 && (next[y] - state[y] - 1.0).abs() < 1e-12);
    }
}
