//! Lens distortion from control points alone, for cameras without straight edges.
//!
//! Points of a wide lens contradict every camera without distortion. Their errors grow with the cube of the
//! distance from the image centre, so correct points near the border look wrong. Therefore the lens is
//! searched before points are rejected, over the family of usual lenses
//!
//! `radius' = radius (1 + k1 radius^2 + k2 radius^4)`, `k2 = min(k1, 0)^2`,
//!
//! with coordinates divided by half the image diagonal. The family is the expected lens of the priors of a
//! lens fit. The criterion is Cauchy's loss of all points, see [`PointFit`]. An error e of an inlier adds
//! `e^2 / 9` to it, in standard deviations. The joint solve then estimates k1 and k2 with their priors.

use crate::camera::{BrownConrady, Distortion, Lens};
use crate::floor::ControlPoint;
use crate::optimize::is_misfit;
use crate::single::lens_problem::K1_SIGMA;
use crate::single::point_fit::{PointFit, PointFitOptions};

/// Range of k1, in units of half the image diagonal: three standard deviations of its prior.
const RANGE: [f64; 2] = [-0.6, 0.6];
/// Number of intervals of the search grid.
const INTERVALS: u32 = 12;
/// Number of steps of the golden-section search between the neighbours of the best grid point. The interval
/// shrinks from 0.2 to 0.002, which moves a corner by less than a pixel.
const STEPS: usize = 10;
/// Least decrease of the loss by the lens that counts as evidence: a chi-square of 10, as for straight edges.
const MIN_GAIN: f64 = 10.0 / 9.0;
/// Least redundancy of the points without the lens. A lens has two coefficients.
const MIN_DOF: i64 = 5;

/// Camera from control points with a lens.
struct Candidate {
    k1: f64,
    fit: PointFit,
    /// Cauchy's loss of the points, and of k1 by its prior.
    loss: f64,
}

impl Candidate {
    fn new(points: &[ControlPoint], options: &PointFitOptions, k1: f64) -> Option<Self> {
        let fit = PointFit::new(points, &PointFitOptions { lens: usual_lens(options, k1), ..*options })?;
        let loss = fit.loss + (k1 / K1_SIGMA).powi(2) / 9.0;
        Some(Self { k1, fit, loss })
    }
}

/// Returns the lens of the family with this k1.
fn usual_lens(options: &PointFitOptions, k1: f64) -> Lens {
    let [width, height] = options.size;
    let brown = BrownConrady { k1, k2: k1.min(0.0).powi(2), ..BrownConrady::default() };
    Lens { focal: 0.5 * width.hypot(height), distortion: Distortion::BrownConrady(brown), ..options.lens }
}

impl PointFit {
    /// Fits the camera together with the distortion of its lens, if the points contradict this fit with the
    /// lens of the options, and support a distortion. The camera of the result has the lens. Returns `None` if
    /// this fit is kept.
    #[must_use]
    pub fn with_lens(&self, points: &[ControlPoint], options: &PointFitOptions) -> Option<Self> {
        let has_doubts = !self.outliers.is_empty() || is_misfit(self.chi2, self.dof);
        let redundancy = self.dof + 2 * self.outliers.len() as i64;
        if !has_doubts || redundancy < MIN_DOF || options.lens.distortion != Distortion::None {
            return None;
        }
        let [low, high] = RANGE;
        let step = (high - low) / f64::from(INTERVALS);
        let grid = (0..=INTERVALS).map(|i| low + step * f64::from(i));
        let candidate = |k1: f64| Candidate::new(points, options, k1);
        let best = grid.filter_map(candidate).min_by(|a, b| a.loss.total_cmp(&b.loss))?;
        let best = narrowed(best, step, candidate);
        let is_evident = best.loss < self.loss - MIN_GAIN;
        let keeps_inliers = best.fit.outliers.len() <= self.outliers.len();
        (is_evident && keeps_inliers && best.fit.dof >= MIN_DOF).then_some(best.fit)
    }
}

/// Returns the best candidate between the neighbours of a grid point, by golden-section search.
fn narrowed(best: Candidate, step: f64, candidate: impl Fn(f64) -> Option<Candidate>) -> Candidate {
    /// Golden ratio minus 1.
    const GOLDEN: f64 = 0.618_033_988_749_894_8;
    let loss = |found: &Option<Candidate>| found.as_ref().map_or(f64::INFINITY, |found| found.loss);
    let (mut low, mut high) = (best.k1 - step, best.k1 + step);
    let at = |low: f64, high: f64| low + GOLDEN * (high - low);
    let (mut left, mut right) = (candidate(at(high, low)), candidate(at(low, high)));
    for _ in 0..STEPS {
        if loss(&left) < loss(&right) {
            high = at(low, high);
            right = left;
            left = candidate(at(high, low));
        } else {
            low = at(high, low);
            left = right;
            right = candidate(at(low, high));
        }
    }
    [left, right]
        .into_iter()
        .flatten()
        .fold(best, |best, other| if other.loss < best.loss { other } else { best })
}
