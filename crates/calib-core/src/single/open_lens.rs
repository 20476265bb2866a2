//! What is open of a fisheye besides its coefficients: its own focal and, where nobody gave it, its principal point,
//! fitted with them to straight edges.
//!
//! Edges that pass beside the camera tell the focal, and the priors on the coefficients where none does: what stays
//! open is its ratio to the focal of the camera, which stage 1 estimates. The principal point has a belief.

use nalgebra::{DMatrix, DVector};

use crate::camera::Pixel;
use crate::optimize::{LeastSquares, least_squares};
use crate::single::lens_problem::{LensProblem, Normal};

/// Standard deviation of a principal point from the middle of the image, as a share of the image's diagonal: sensors of
/// small fisheyes sit some percent beside their lens.
const CENTRE: f64 = 0.02;

/// A fit with its own focal: log focal, principal point u and v, coefficients.
struct OpenLens<'a> {
    problem: &'a LensProblem<'a>,
    /// Standard deviation of the principal point, in pixels; without, it is held.
    centre_sigma: Option<f64>,
}

impl<'a> LensProblem<'a> {
    /// The same problem with the focal, and the principal point unless it is held, at which the edges are straightest.
    pub(super) fn opened(self, centre_is_held: bool) -> Self {
        /// Focals of fisheyes from 60 to 250 degrees, in units of half the diagonal of the image.
        const STARTS: [f64; 5] = [0.4, 0.52, 0.68, 0.9, 1.2];
        const FIRST_STEPS: usize = 8;
        const MAX_STEPS: usize = 60;
        let [w, h] = self.size;
        let diagonal = w.hypot(h);
        let open = OpenLens { problem: &self, centre_sigma: (!centre_is_held).then_some(CENTRE * diagonal) };
        let Pixel { u, v } = self.principal_point;
        let from = |focal: f64| {
            let mut start = vec![(0.5 * diagonal * focal).ln(), u, v];
            start.resize(3 + self.fitted.len(), 0.0);
            least_squares(&open, start, FIRST_STEPS)
        };
        let starts = STARTS.into_iter().filter_map(from);
        let best = starts.min_by(|a, b| a.cost.total_cmp(&b.cost));
        let Some(found) = best.and_then(|best| least_squares(&open, best.state, MAX_STEPS)) else {
            return self;
        };
        let [log_focal, u, v] = [found.state[0], found.state[1], found.state[2]];
        Self { unit: log_focal.exp(), principal_point: Pixel { u, v }, ..self }
    }
}

impl OpenLens<'_> {
    /// Residuals and their Jacobian by the coefficients, at a state.
    fn at(&self, state: &[f64]) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let LensProblem { edges, times, fitted, size, sigma, .. } = self.problem;
        let at = LensProblem {
            edges: edges.clone(),
            times: times.clone(),
            fitted: fitted.clone(),
            principal_point: Pixel { u: state[1], v: state[2] },
            unit: state[0].exp(),
            size: *size,
            sigma: *sigma,
        };
        at.residuals_and_jacobian(&state[3..])
    }

    /// The central difference of the residuals by focal or principal point.
    fn column(&self, state: &[f64], index: usize) -> Option<DVector<f64>> {
        let step = if index == 0 { 1e-5 } else { 1e-3 };
        let moved = |by: f64| {
            let mut to = state.to_vec();
            to[index] += by;
            self.at(&to).map(|(residuals, _)| residuals)
        };
        Some((moved(step)? - moved(-step)?) / (2.0 * step))
    }
}

impl LeastSquares for OpenLens<'_> {
    type State = Vec<f64>;
    type Normal = Normal;

    fn linearize(&self, state: &Vec<f64>) -> Option<(f64, Normal)> {
        let (own, by_coefficients) = self.at(state)?;
        let Pixel { u, v } = self.problem.principal_point;
        let count = own.len();
        let mut residuals = own.resize_vertically(count + 2, 0.0);
        let mut jacobian = DMatrix::zeros(count + 2, state.len());
        jacobian.view_mut((0, 3), by_coefficients.shape()).copy_from(&by_coefficients);
        for index in 0..3 {
            if index == 0 || self.centre_sigma.is_some() {
                jacobian.view_mut((0, index), (count, 1)).copy_from(&self.column(state, index)?);
            }
        }
        // What is believed of the principal point; one that is held is moved by nothing.
        let weight = self.problem.sigma / self.centre_sigma.unwrap_or(1.0);
        for (k, off) in [state[1] - u, state[2] - v].into_iter().enumerate() {
            residuals[count + k] = weight * off;
            jacobian[(count + k, 1 + k)] = weight;
        }
        let (cost, normal) = Normal::new(&residuals, &jacobian);
        cost.is_finite().then_some((cost, normal))
    }

    fn step(&self, state: &Vec<f64>, normal: &Normal, damping: f64) -> Option<(Vec<f64>, f64, f64)> {
        normal.step(state, damping)
    }
}
