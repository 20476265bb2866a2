//! Lens distortion from control points alone, for cameras without straight edges.
//!
//! Points of a wide lens contradict every camera without distortion. Their errors grow with the cube of the
//! distance from the image centre, so correct points near the border look wrong. Therefore the lens
//!
//! `radius' = radius (1 + k1 radius^2 + k2 radius^4)`
//!
//! is searched before points are rejected, with coordinates divided by half the image diagonal. The criterion
//! is Cauchy's loss of all points, see [`PointFit`], plus a loss for k1 and k2 from the priors of a lens fit.
//! The expected k2 is `min(k1, 0)^2`. An error of e standard deviations adds about `e^2 / 9` to the loss.
//!
//! 1. A grid of k1, with k2 at its expected value, and a complete search for the camera at each lens.
//! 2. Golden-section searches from the best lens, alternately along k1 and along a direction that changes the
//!    radius mainly near the corners. Each camera fit starts from the best camera so far.
//!
//! The joint solve then estimates k1 and k2 with their priors.

use crate::camera::{BrownConrady, Distortion, Lens};
use crate::floor::ControlPoint;
use crate::optimize::is_misfit;
use crate::single::lens_problem::{K1_SIGMA, K2_SIGMA};
use crate::single::point_fit::{PointFit, PointFitOptions};

/// Range of k1, in units of half the image diagonal: three standard deviations of its prior.
const RANGE: [f64; 2] = [-0.6, 0.6];
/// Number of intervals of the search grid.
const INTERVALS: u32 = 12;
/// Directions of the golden-section searches, as changes of (k1, k2). The second direction mainly affects the
/// corners. Within 0.8 of half the diagonal, it changes the radius by less than a fifth of the change in the corners.
const DIRECTIONS: [[f64; 2]; 2] = [[1.0, 0.0], [-0.6, 1.0]];
/// Half the length of the first interval of a golden-section search.
const FIRST_REACH: f64 = 0.1;
/// Number of golden-section searches along each direction, and the factor by which their intervals shrink.
const ROUNDS: i32 = 4;
const SHRINKAGE: f64 = 0.4;
/// Number of steps of a golden-section search, which shrink its interval to 2 %.
const STEPS: usize = 8;
/// Least decrease of the loss by the lens that counts as evidence: a chi-square of 10, as for straight edges.
const MIN_GAIN: f64 = 10.0 / 9.0;
/// Least redundancy of all points, and of the inliers of the result, before the two coefficients of the lens are
/// subtracted.
const MIN_DOF: i64 = 5;

/// Candidate lens, and the camera that is fitted to the control points under this lens.
struct Candidate {
    /// Coefficients k1 and k2.
    k: [f64; 2],
    fit: PointFit,
    /// Cauchy's loss of the points, plus the loss for the coefficients.
    loss: f64,
}

/// Control points with the inputs of their fit.
#[derive(Clone, Copy)]
struct Search<'a> {
    points: &'a [ControlPoint],
    options: &'a PointFitOptions<'a>,
}

impl Search<'_> {
    /// Returns the best candidate of the grid, refined along both directions.
    fn best(&self) -> Option<Candidate> {
        let [low, high] = RANGE;
        let step = (high - low) / f64::from(INTERVALS);
        let grid = (0..=INTERVALS).map(|i| low + step * f64::from(i));
        let on_grid = grid.filter_map(|k1| self.candidate([k1, k1.min(0.0).powi(2)], None));
        let mut best = on_grid.min_by(|a, b| a.loss.total_cmp(&b.loss))?;
        for round in 0..ROUNDS {
            for direction in DIRECTIONS {
                best = self.refined(best, direction, FIRST_REACH * SHRINKAGE.powi(round));
            }
        }
        Some(best)
    }

    /// Fits the camera under the lens with the coefficients `k`. The fit starts from the camera of `start`; without
    /// it, the search is complete.
    fn candidate(&self, k: [f64; 2], start: Option<&Candidate>) -> Option<Candidate> {
        let [k1, k2] = k;
        let [width, height] = self.options.size;
        let distortion = Distortion::BrownConrady(BrownConrady { k1, k2, ..BrownConrady::default() });
        let lens = Lens { focal: 0.5 * width.hypot(height), distortion, ..self.options.lens };
        let options = PointFitOptions { lens, ..*self.options };
        let fit = match start {
            None => PointFit::new(self.points, &options),
            Some(start) => PointFit::near(self.points, &options, &start.fit.camera),
        }?;
        let of_k2 = (k2 - k1.min(0.0).powi(2)) / K2_SIGMA;
        let loss = fit.loss + ((k1 / K1_SIGMA).powi(2) + of_k2 * of_k2) / 9.0;
        Some(Candidate { k, fit, loss })
    }

    /// Returns the best candidate on the line through a candidate, by golden-section search within `reach`.
    fn refined(&self, best: Candidate, direction: [f64; 2], reach: f64) -> Candidate {
        /// Golden ratio minus 1.
        const GOLDEN: f64 = 0.618_033_988_749_894_8;
        let along = |by: f64| {
            let k = [best.k[0] + by * direction[0], best.k[1] + by * direction[1]];
            self.candidate(k, Some(&best))
        };
        let loss = |found: &Option<Candidate>| found.as_ref().map_or(f64::INFINITY, |found| found.loss);
        let at = |low: f64, high: f64| low + GOLDEN * (high - low);
        let (mut low, mut high) = (-reach, reach);
        let (mut left, mut right) = (along(at(high, low)), along(at(low, high)));
        for _ in 0..STEPS {
            if loss(&left) < loss(&right) {
                high = at(low, high);
                right = left;
                left = along(at(high, low));
            } else {
                low = at(high, low);
                left = right;
                right = along(at(low, high));
            }
        }
        let found = [left, right].into_iter().flatten().min_by(|a, b| a.loss.total_cmp(&b.loss));
        match found {
            Some(found) if found.loss < best.loss => found,
            _ => best,
        }
    }
}

impl PointFit {
    /// Fits the camera together with the distortion of its lens. Returns `None` if the points agree with `self`, the
    /// fit without distortion, or if they do not support a distortion. The camera of the result has the estimated
    /// lens.
    #[must_use]
    pub fn with_lens(&self, points: &[ControlPoint], options: &PointFitOptions) -> Option<Self> {
        let has_doubts = !self.outliers.is_empty() || is_misfit(self.chi2, self.dof);
        let redundancy = self.dof + 2 * self.outliers.len() as i64;
        if !has_doubts || redundancy < MIN_DOF || options.lens.distortion != Distortion::None {
            return None;
        }
        let best = Search { points, options }.best()?;
        let is_evident = best.loss < self.loss - MIN_GAIN;
        let keeps_inliers = best.fit.outliers.len() <= self.outliers.len();
        (is_evident && keeps_inliers && best.fit.dof >= MIN_DOF).then_some(best.fit)
    }
}
