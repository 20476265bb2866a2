//! Distortion from polylines along edges that are straight in space: the plumb-line method (Brown 1971,
//! "Close-Range Camera Calibration"). It comes first, for every constraint of stage 1 is undistorted.
//!
//! The residual of a point is its distance from the best line through its undistorted polyline,
//! measured in raw pixels: `(n . U(p) - c) / |J' n|` with the undistortion U, its derivative J at the
//! point, and the line `n . x = c` that makes the sum of squares least (`straightness.rs`). The
//! coefficients refer to coordinates divided by half the diagonal of the image, for the focal is not known
//! yet.
//!
//! What is believed of lenses (`lens_prior.rs`) is part of the cost. Where the caller does not say which
//! coefficients to fit, the number of radial coefficients is the one of the largest evidence: with the chi-square
//! of edges and priors, the normal matrix H, both in sigmas, and the priors' own L,
//! `-2 log evidence = chi2 + log det H - log det L`, to first order (Laplace).

use nalgebra::{DMatrix, DVector};

use crate::camera::{Distortion, DistortionModel, Lens, Pixel};
use crate::optimize::{LeastSquares, least_squares};
use crate::single::constraints::Source;
use crate::single::edge_information::uninformative;
use crate::single::fitted::Fitted;
use crate::single::lens_prior::{LensResidual, lens_prior};
use crate::single::straightness::{
    Edge, edge_redundancy, straightness, straightness_with_jacobian, times_drawn,
};

/// How many of k1, k2, k3 are tried, one after the other, when the number is selected.
const MODEL_SIZES: [usize; 3] = [1, 2, 3];

/// The estimate of a lens from straight edges.
#[derive(Clone, Debug)]
pub struct LensFit {
    /// The lens; its coefficients refer to half the diagonal of the image, or to the focal where the model has
    /// one of its own.
    pub lens: Lens,
    /// What was fitted; `None` when no distortion is supported by the edges.
    pub fitted: Option<Fitted>,
    /// Root mean square distance of the points from their lines, in raw pixels, before and after.
    pub straightness: [f64; 2],
    /// Root mean square distance of every polyline from straight, in raw pixels.
    pub residuals: Vec<(Source, f64)>,
    /// Covariance of the coefficients, in the order of [`Distortion::coefficients`]; zeros for those that
    /// were not fitted.
    pub covariance: [[f64; Distortion::MOST]; Distortion::MOST],
    /// Predicted standard deviation of the undistorted position halfway to the edge, at the middle
    /// of the longer edge, and in the corner, in pixels.
    pub map_error: [f64; 3],
    /// Polylines that carry next to no information, with how far a distortion that moves the corner by 10 px
    /// would bend them, in pixels.
    pub uninformative: Vec<(Source, f64)>,
    /// Sum of squares over `sigma^2`.
    pub chi2: f64,
    /// Points minus two for every line minus coefficients.
    pub dof: i64,
}

/// Everything that a fit of a lens needs besides the polylines.
#[derive(Clone, Debug, PartialEq)]
pub struct LensOptions {
    /// Principal point, raw pixel.
    pub principal_point: Pixel,
    /// Width and height of the image, in pixels.
    pub size: [f64; 2],
    /// Which coefficients to fit; selected by the data if absent.
    pub fitted: Option<Fitted>,
    /// The focal that the coefficients refer to, of a model that has one of its own, in pixels.
    pub focal: Option<f64>,
    /// Standard deviation of a drawn coordinate, in pixels.
    pub sigma: f64,
}

/// The fit of some coefficients to some polylines, as a least-squares problem.
struct Problem<'a> {
    edges: Vec<&'a Edge>,
    /// How often each of them is drawn.
    times: Vec<f64>,
    fitted: Fitted,
    principal_point: Pixel,
    /// Pixels by which coordinates are divided: the focal that the coefficients refer to.
    unit: f64,
    /// Width and height of the image, in pixels.
    size: [f64; 2],
    /// Standard deviation of a drawn coordinate, in pixels.
    sigma: f64,
}

impl Problem<'_> {
    fn lens(&self, values: &[f64]) -> Lens {
        Lens {
            principal_point: self.principal_point,
            focal: self.unit,
            distortion: self.fitted.distortion(values),
        }
    }

    /// The cost of every edge by one of its polylines: the sum of its squared residuals.
    fn costs(&self, values: &[f64]) -> impl Iterator<Item = f64> {
        let lens = self.lens(values);
        self.edges.iter().map(move |edge| edge_cost(&lens, edge))
    }

    /// What is believed of the coefficients, in sigmas.
    fn priors(&self, values: &[f64]) -> Vec<LensResidual> {
        lens_prior(&self.lens(values), self.size, &self.fitted.indices()[..values.len()])
    }

    /// Residuals and Jacobian by what is fitted, those of the priors last, as pixels; the line of every edge is
    /// refitted, so it is eliminated. `None` where the lens folds back on itself before a corner of the image.
    fn residuals_and_jacobian(&self, values: &[f64]) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let lens = self.lens(values);
        let indices = &self.fitted.indices()[..values.len()];
        if !lens.shows_image(self.size) {
            return None;
        }
        let edges: Vec<(Vec<f64>, Vec<Vec<f64>>)> = self
            .edges
            .iter()
            .zip(&self.times)
            .map(|(edge, times)| {
                let (mut distances, mut columns) = straightness_with_jacobian(&lens, &edge.points, indices)?;
                let values = columns.iter_mut().flatten().chain(&mut distances);
                values.for_each(|value| *value /= times.sqrt());
                Some((distances, columns))
            })
            .collect::<Option<_>>()?;
        let priors = self.priors(values);
        let believed = priors.iter().map(|prior| self.sigma * prior.value);
        let residuals: Vec<f64> =
            edges.iter().flat_map(|(distances, _)| distances.iter().copied()).chain(believed).collect();
        let count = residuals.len();
        let column = |k: usize| {
            let believed = priors.iter().map(move |prior| self.sigma * prior.by[indices[k]]);
            edges.iter().flat_map(move |(_, columns)| columns[k].iter().copied()).chain(believed)
        };
        let jacobian = DMatrix::from_iterator(count, values.len(), (0..values.len()).flat_map(column));
        Some((DVector::from_vec(residuals), jacobian))
    }

    /// Minus twice the log of the evidence for what is fitted, up to what all models have in common.
    fn evidence(&self, values: &[f64]) -> Option<f64> {
        let per_variance = (self.sigma * self.sigma).recip();
        let (residuals, jacobian) = self.residuals_and_jacobian(values)?;
        let determinant = (jacobian.tr_mul(&jacobian) * per_variance).determinant();
        let of_priors: f64 = self.priors(values).iter().map(|prior| 2.0 * prior.sigma.ln()).sum();
        Some(residuals.norm_squared() * per_variance + determinant.ln() + of_priors)
    }

    /// Edges that say next to nothing: of a lens that was fitted those without which the corner would be hardly
    /// less certain, else those that a distortion would hardly bend.
    fn uninformative(&self, values: &[f64]) -> Vec<(Source, f64)> {
        /// How much less certain.
        const HARDLY: f64 = 1.05;
        let lens = self.lens(values);
        let hardly_bent = uninformative(&self.edges, &lens, self.size, self.sigma);
        let Some(corner) = self.corner_variance(values, |_| true).filter(|_| !values.is_empty()) else {
            return hardly_bent;
        };
        let says_nothing = |(source, _): &(Source, f64)| {
            let without = self.corner_variance(values, |edge| edge.source != *source);
            without.is_some_and(|variance| variance < HARDLY * HARDLY * corner)
        };
        hardly_bent.into_iter().filter(says_nothing).collect()
    }

    /// Variance of the undistorted corner of the image in square pixels, as far as some edges tell it.
    fn corner_variance(&self, values: &[f64], is_used: impl Fn(&Edge) -> bool) -> Option<f64> {
        let [w, h] = self.size;
        let corner = Pixel::from([w, h]);
        let used = self.edges.iter().copied().zip(self.times.iter().copied());
        let (edges, times) = used.filter(|(edge, _)| is_used(edge)).unzip();
        let some = Problem { edges, times, fitted: self.fitted.clone(), ..*self };
        let covariance = some.covariance(values)?;
        let lens = self.lens(values);
        let by = lens.undistort_by_coefficients(corner, lens.undistort(corner)?);
        let jacobian: Vec<[f64; 2]> = self.fitted.indices().iter().map(|&k| by[k].at).collect();
        let pairs = (0..values.len()).flat_map(|i| (0..values.len()).map(move |j| (i, j)));
        let along = |(i, j): (usize, usize)| {
            covariance[(i, j)] * (jacobian[i][0] * jacobian[j][0] + jacobian[i][1] * jacobian[j][1])
        };
        Some(self.sigma * self.sigma * pairs.map(along).sum::<f64>())
    }

    /// Covariance of what is fitted, for points with a standard deviation of one pixel.
    fn covariance(&self, values: &[f64]) -> Option<DMatrix<f64>> {
        let (_, jacobian) = self.residuals_and_jacobian(values)?;
        jacobian.tr_mul(&jacobian).try_inverse()
    }

    /// The lowest of the minima reached from several starts, the values of the next smaller model among them.
    fn solve(&self, smaller: &[f64]) -> Option<(Vec<f64>, f64)> {
        /// Most accepted steps to a minimum.
        const MAX_STEPS: usize = 60;
        /// Steps from every start, after which the candidates are ranked.
        const FIRST_STEPS: usize = 6;
        /// Candidates that are refined to a minimum.
        const MAX_CANDIDATES: usize = 3;
        /// Candidates whose coefficients are nearer than this are one.
        const NEAR: f64 = 1e-4;
        let count = self.fitted.len();
        let padded = |values: &[f64]| -> Vec<f64> {
            (0..count).map(|i| values.get(i).copied().unwrap_or(0.0)).collect()
        };
        let starts = STARTS.iter().map(|start| padded(start));
        let mut candidates: Vec<(Vec<f64>, f64)> = starts
            .chain([padded(smaller)])
            .filter_map(|start| {
                least_squares(self, start, FIRST_STEPS).map(|summary| (summary.state, summary.cost))
            })
            .collect();
        candidates.sort_by(|a, b| a.1.total_cmp(&b.1));
        candidates.dedup_by(|a, b| a.0.iter().zip(&b.0).all(|(a, b)| (a - b).abs() < NEAR));
        candidates.truncate(MAX_CANDIDATES);
        candidates
            .into_iter()
            .filter_map(|(start, _)| {
                least_squares(self, start, MAX_STEPS).map(|summary| (summary.state, summary.cost))
            })
            .min_by(|a, b| a.1.total_cmp(&b.1))
    }
}

/// Normal equations of a fit of a lens.
struct Normal {
    square: DMatrix<f64>,
    gradient: DVector<f64>,
}

impl LeastSquares for Problem<'_> {
    type State = Vec<f64>;
    type Normal = Normal;

    fn linearize(&self, values: &Vec<f64>) -> Option<(f64, Normal)> {
        let (residuals, jacobian) = self.residuals_and_jacobian(values)?;
        let cost = residuals.norm_squared();
        let normal = Normal { square: jacobian.tr_mul(&jacobian), gradient: jacobian.tr_mul(&residuals) };
        cost.is_finite().then_some((cost, normal))
    }

    fn step(&self, values: &Vec<f64>, normal: &Normal, damping: f64) -> Option<(Vec<f64>, f64, f64)> {
        let mut damped = normal.square.clone();
        for i in 0..values.len() {
            damped[(i, i)] *= 1.0 + damping;
        }
        let step = damped.cholesky()?.solve(&(-&normal.gradient));
        let predicted: f64 = (0..values.len())
            .map(|i| step[i] * (damping * normal.square[(i, i)] * step[i] - normal.gradient[i]))
            .sum();
        let next = values.iter().zip(step.iter()).map(|(value, step)| value + step).collect();
        Some((next, predicted, step.amax()))
    }
}

impl LensFit {
    /// The fit of a lens to polylines. Those of fewer than three points are left out.
    ///
    /// `None` when there is no polyline of three points.
    #[must_use]
    pub fn new(edges: &[Edge], options: &LensOptions) -> Option<Self> {
        /// Most points that are used: enough for any lens, and a bound on the time that a hostile file takes.
        const MOST: usize = 20_000;
        let mut room = MOST;
        let edges: Vec<&Edge> = edges
            .iter()
            .filter(|edge| edge.points.len() > 2)
            .take_while(|edge| {
                let fits = edge.points.len() <= room;
                room = room.saturating_sub(edge.points.len());
                fits
            })
            .collect();
        let times = times_drawn(edges.iter().copied());
        let redundancy = edge_redundancy(edges.iter().copied(), &times);
        if redundancy < 1 {
            return None;
        }
        let problem = |fitted: Fitted| {
            let half_diagonal = 0.5 * options.size[0].hypot(options.size[1]);
            let unit = options.focal.filter(|_| fitted.has_own_focal()).unwrap_or(half_diagonal);
            let LensOptions { principal_point, size, .. } = *options;
            let (edges, times) = (edges.clone(), times.clone());
            Problem { edges, times, fitted, principal_point, unit, size, sigma: options.sigma }
        };
        let undistorted = FittedModel::undistorted(problem(Fitted::first(DistortionModel::BrownConrady, 0)))?;
        let cost_before = undistorted.cost;
        let model = match &options.fitted {
            Some(fitted) => {
                let problem = problem(fitted.clone());
                let solved = problem.solve(&[]);
                solved.map_or(undistorted, |(values, _)| FittedModel::of(problem, values))
            }
            None => select_model(undistorted, redundancy, &problem),
        };
        Some(Self::of(&model, cost_before, redundancy, options))
    }

    fn of(model: &FittedModel, cost_before: f64, redundancy: i64, options: &LensOptions) -> Self {
        let FittedModel { problem, values, cost, rejected } = model;
        let edges = problem.edges.iter().zip(&problem.times);
        let points: f64 = edges.map(|(edge, times)| edge.points.len() as f64 / times).sum();
        let lens = problem.lens(values);
        let per_edge = |edge: &&Edge| {
            let distances = straightness(&lens, &edge.points).unwrap_or_default();
            let square = distances.iter().map(|d| d * d).sum::<f64>() / distances.len().max(1) as f64;
            (edge.source, square.sqrt())
        };
        Self {
            lens: if values.is_empty() { Lens::pinhole(options.principal_point) } else { lens },
            fitted: (!values.is_empty()).then(|| problem.fitted.clone()),
            straightness: [cost_before, *cost].map(|cost| (cost / points).sqrt()),
            residuals: problem.edges.iter().map(per_edge).collect(),
            covariance: full_covariance(problem, values, options.sigma),
            map_error: map_error(problem, values, rejected.as_ref(), options),
            uninformative: problem.uninformative(values),
            chi2: cost / (options.sigma * options.sigma),
            dof: redundancy - values.len() as i64,
        }
    }
}

/// Values of the first two coefficients from which a fit starts, in units of half the diagonal.
const STARTS: [[f64; 2]; 7] =
    [[0.0, 0.0], [-0.1, 0.0], [0.1, 0.0], [-0.25, 0.05], [-0.4, 0.15], [-0.55, 0.3], [-0.1, -0.02]];

/// A distortion model with its estimated coefficients.
struct FittedModel<'a> {
    problem: Problem<'a>,
    values: Vec<f64>,
    cost: f64,
    /// The larger model that was rejected, with its posterior probability against this one.
    rejected: Option<(Lens, f64)>,
}

impl<'a> FittedModel<'a> {
    /// No distortion.
    fn undistorted(problem: Problem<'a>) -> Option<Self> {
        let undistorted = Self::of(problem, Vec::new());
        undistorted.cost.is_finite().then_some(undistorted)
    }

    fn of(problem: Problem<'a>, values: Vec<f64>) -> Self {
        let cost = problem.costs(&values).zip(&problem.times).map(|(cost, times)| cost / times).sum();
        Self { problem, values, cost, rejected: None }
    }
}

/// Of the nested models the one of the largest evidence: that the edges support, too, when the one whose cost it
/// lowers most is left out, or do not contradict while that one speaks very strongly (Kass and Raftery 1995).
fn select_model<'a>(
    undistorted: FittedModel<'a>,
    redundancy: i64,
    problem: &dyn Fn(Fitted) -> Problem<'a>,
) -> FittedModel<'a> {
    /// By how many variances the cost of the other edges may rise.
    const AGAINST: f64 = 4.0;
    /// Twice the log of the evidence that is very strong.
    const STRONG: f64 = 10.0;
    let mut lowest = undistorted.problem.evidence(&[]).unwrap_or(f64::INFINITY);
    let mut best = undistorted;
    for count in MODEL_SIZES {
        let next = problem(Fitted::first(DistortionModel::BrownConrady, count));
        if redundancy <= count as i64 {
            continue;
        }
        let Some((values, _)) = next.solve(&best.values) else { continue };
        let Some(score) = next.evidence(&values) else { continue };
        let shared = shared_gain(&best, &next, &values) / (next.sigma * next.sigma);
        let is_shared = shared > count as f64 * (redundancy as f64).ln();
        if score < lowest && (is_shared || shared > -AGAINST && score < lowest - STRONG) {
            lowest = score;
            best = FittedModel::of(next, values);
            continue;
        }
        // Two coefficients may be supported where one is not: the larger models are tried as well.
        let probability = (1.0 + (0.5 * (score - lowest)).exp()).recip();
        if best.rejected.as_ref().is_none_or(|(_, other)| probability > *other) {
            best.rejected = Some((next.lens(&values), probability));
        }
    }
    best
}

/// By how much a larger model lowers the cost, without the edge whose cost it lowers most: one edge that is
/// not straight in space must not determine the lens.
fn shared_gain(smaller: &FittedModel, larger: &Problem, values: &[f64]) -> f64 {
    let gains = smaller.problem.costs(&smaller.values).zip(larger.costs(values)).map(|(was, is)| was - is);
    let gains = gains.zip(&larger.times);
    let (total, most) =
        gains.fold((0.0, 0.0), |(sum, most): (f64, f64), (gain, times)| (sum + gain / times, most.max(gain)));
    total - most
}

/// Sum of the squared distances of a polyline's points from straight; infinite where one cannot be
/// undistorted.
fn edge_cost(lens: &Lens, edge: &Edge) -> f64 {
    straightness(lens, &edge.points).map_or(f64::INFINITY, |distances| distances.iter().map(|d| d * d).sum())
}

/// Standard deviation of the undistorted position at three places: from the covariance of the coefficients,
/// and from the difference to the rejected larger model, weighted by its probability.
fn map_error(
    problem: &Problem,
    values: &[f64],
    rejected: Option<&(Lens, f64)>,
    options: &LensOptions,
) -> [f64; 3] {
    let Some(covariance) = problem.covariance(values) else { return [f64::INFINITY; 3] };
    let lens = problem.lens(values);
    let [w, h] = options.size;
    let edge = if w > h { [w, 0.5 * h] } else { [0.5 * w, h] };
    let halfway = [0.25 * w + 0.5 * edge[0], 0.25 * h + 0.5 * edge[1]];
    let variance = |place: [f64; 2]| {
        let place = Pixel::from(place);
        let straight = lens.undistort(place)?;
        let by = lens.undistort_by_coefficients(place, straight);
        let jacobian: Vec<[f64; 2]> = problem.fitted.indices().iter().map(|&k| by[k].at).collect();
        let mut variance = 0.0;
        for i in 0..values.len() {
            for j in 0..values.len() {
                variance +=
                    covariance[(i, j)] * (jacobian[i][0] * jacobian[j][0] + jacobian[i][1] * jacobian[j][1]);
            }
        }
        let model_variance = match rejected {
            Some((other, probability)) => {
                let apart = straight.distance(other.undistort(place)?);
                probability * apart * apart
            }
            None => 0.0,
        };
        Some(options.sigma * options.sigma * variance.max(0.0) + model_variance)
    };
    // Where the distortion cannot be inverted there is no position.
    [halfway, edge, [w, h]].map(|place| variance(place).map_or(f64::INFINITY, f64::sqrt))
}

/// The covariance with a row and a column for every coefficient of the model.
fn full_covariance(
    problem: &Problem,
    values: &[f64],
    sigma: f64,
) -> [[f64; Distortion::MOST]; Distortion::MOST] {
    let mut full = [[0.0; Distortion::MOST]; Distortion::MOST];
    let Some(covariance) = problem.covariance(values) else { return full };
    let indices = problem.fitted.indices();
    for (i, &a) in indices.iter().enumerate().take(values.len()) {
        for (j, &b) in indices.iter().enumerate().take(values.len()) {
            full[a][b] = sigma * sigma * covariance[(i, j)];
        }
    }
    full
}
