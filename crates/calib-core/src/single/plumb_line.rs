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

use crate::camera::DistortionModel::KannalaBrandt;
use crate::camera::{DistortionModel, ImageCircle, Lens, Pixel};
use crate::optimize::is_misfit;
use crate::single::constraints::Source;
use crate::single::lens_problem::{LensProblem, shown_by_parameters};
use crate::single::parameters::Fitted;
use crate::single::straightness::{Edge, edge_redundancy, outermost, straightness, times_drawn};

/// Twice the log of the evidence that is very strong (Kass and Raftery 1995).
const STRONG: f64 = 10.0;

/// What a fisheye has open: two coefficients, focal and principal point.
const MOST_OPEN: i64 = 5;

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
    /// Which parameters were fitted, in the order of [`Lens::PARAMETERS`]: the coefficients, of a fisheye whose focal
    /// nobody gave that, too, and the principal point where nobody gave it.
    pub free: [bool; Lens::PARAMETERS],
    /// Covariance of the parameters; zeros for those that were not fitted.
    pub covariance: [[f64; Lens::PARAMETERS]; Lens::PARAMETERS],
    /// Predicted standard deviation of the undistorted position halfway to the edge, at the middle
    /// of the longer edge, and in the corner, in pixels; of a fisheye halfway to its image circle and on it.
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
    /// Principal point, raw pixel; of a fisheye whose focal is fitted, where it is believed to be.
    pub principal_point: Pixel,
    /// Whether it is held then, too.
    pub centre_is_held: bool,
    /// Width and height of the image, in pixels.
    pub size: [f64; 2],
    /// Where the scene is in the image of a fisheye, if that is known: then it is one.
    pub circle: Option<ImageCircle>,
    /// Which coefficients to fit; selected by the data if absent.
    pub fitted: Option<Fitted>,
    /// The focal that the coefficients refer to, of a model that has one of its own, in pixels; fitted if absent.
    pub focal: Option<f64>,
    /// Standard deviation of a drawn coordinate, in pixels.
    pub sigma: f64,
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
            let LensOptions { principal_point, size, circle, sigma, .. } = *options;
            let (edges, times) = (edges.clone(), times.clone());
            let open = Vec::new();
            LensProblem { edges, times, fitted, open, principal_point, unit, size, circle, sigma }
        };
        let undistorted = FittedModel::undistorted(problem(Fitted::first(DistortionModel::BrownConrady, 0)))?;
        let cost_before = undistorted.cost;
        let model = match &options.fitted {
            Some(fitted) => {
                let solved = FittedModel::solved(problem(fitted.clone()), options);
                solved.unwrap_or(undistorted)
            }
            None => {
                let model = select_model(undistorted, redundancy, &problem);
                let fisheye = || {
                    let row = KannalaBrandt.row();
                    FittedModel::solved(problem(Fitted::first(KannalaBrandt, row.usual)), options)
                };
                let fisheye = model.may_be_fisheye(redundancy, options).then(fisheye).flatten();
                fisheye.filter(|fisheye| fisheye.is_better_than(&model, redundancy, options)).unwrap_or(model)
            }
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
            lens: if values.is_empty() && !problem.fitted.has_own_focal() {
                Lens::pinhole(options.principal_point)
            } else {
                lens
            },
            fitted: (!values.is_empty()).then(|| problem.fitted.clone()),
            straightness: [cost_before, *cost].map(|cost| (cost / points).sqrt()),
            residuals: problem.edges.iter().map(per_edge).collect(),
            free: std::array::from_fn(|k| problem.indices()[..values.len()].contains(&k)),
            covariance: full_covariance(problem, values, options.sigma),
            map_error: map_error(problem, values, rejected.as_ref(), options),
            uninformative: problem.uninformative(values),
            chi2: cost / (options.sigma * options.sigma),
            dof: redundancy - values.len() as i64,
        }
    }
}

/// A distortion model with its estimated coefficients.
struct FittedModel<'a> {
    problem: LensProblem<'a>,
    values: Vec<f64>,
    cost: f64,
    /// The larger model that was rejected, with its posterior probability against this one.
    rejected: Option<(Lens, f64)>,
}

impl<'a> FittedModel<'a> {
    /// No distortion.
    fn undistorted(problem: LensProblem<'a>) -> Option<Self> {
        let undistorted = Self::of(problem, Vec::new());
        undistorted.cost.is_finite().then_some(undistorted)
    }

    /// What is fitted, with the focal and the principal point of a fisheye where nobody gave them.
    fn solved(problem: LensProblem<'a>, options: &LensOptions) -> Option<Self> {
        let is_open = problem.fitted.has_own_focal() && options.focal.is_none();
        let problem = if is_open { problem.opened(options.centre_is_held) } else { problem };
        let start = vec![0.0; problem.indices().len()];
        let (values, _) = problem.solve(if is_open { &start } else { &[] })?;
        Some(Self::of(problem, values))
    }

    /// Whether it is worth while to see if the lens is a fisheye.
    fn may_be_fisheye(&self, redundancy: i64, options: &LensOptions) -> bool {
        let dof = redundancy - self.values.len() as i64;
        let is_bent_otherwise = || is_misfit(self.cost / (options.sigma * options.sigma), dof);
        redundancy > MOST_OPEN && (options.circle.is_some() || is_bent_otherwise())
    }

    /// Whether the edges say very strongly that the lens is a fisheye and not this other one, all of them and not one
    /// that is not straight in space, and are drawn where only fisheyes see; where there is an image circle it need
    /// only be as straight.
    fn is_better_than(&self, other: &Self, redundancy: i64, options: &LensOptions) -> bool {
        /// Angle off the axis to which other lenses are built, in radians.
        const OTHERS: f64 = 0.9;
        if options.circle.is_some() {
            return self.cost <= other.cost;
        }
        let of = |model: &Self| model.problem.evidence(&model.values).unwrap_or(f64::INFINITY);
        let shared = shared_gain(other, &self.problem, &self.values) / (options.sigma * options.sigma);
        let is_shared = shared > MOST_OPEN as f64 * (redundancy as f64).ln();
        is_shared && of(self) < of(other) - STRONG && self.reach() > OTHERS
    }

    /// How far off the axis of the lens the outermost point is that is drawn, in radians.
    fn reach(&self) -> f64 {
        let lens = self.problem.lens(&self.values);
        let drawn = self.problem.edges.iter().flat_map(|edge| &edge.points);
        let bearing = outermost(drawn, lens.principal_point).and_then(|pixel| lens.bearing(pixel));
        bearing.map_or(0.0, |[x, y, ahead]| x.hypot(y).atan2(lens.focal * ahead))
    }

    fn of(problem: LensProblem<'a>, values: Vec<f64>) -> Self {
        let cost = problem.cost(&values);
        Self { problem, values, cost, rejected: None }
    }
}

/// Of the nested models the one of the largest evidence: that the edges support, too, when the one whose cost it
/// lowers most is left out, or do not contradict very strongly while that one speaks very strongly (Kass and Raftery
/// 1995).
fn select_model<'a>(
    undistorted: FittedModel<'a>,
    redundancy: i64,
    problem: &dyn Fn(Fitted) -> LensProblem<'a>,
) -> FittedModel<'a> {
    let mut lowest = undistorted.problem.evidence(&[]).unwrap_or(f64::INFINITY);
    let mut best = undistorted;
    for count in MODEL_SIZES {
        let next = problem(Fitted::first(DistortionModel::BrownConrady, count));
        if redundancy <= count as i64 {
            continue;
        }
        let Some((values, _)) = next.solve(&best.values) else { continue };
        let Some(score) = next.evidence(&values) else { continue };
        let noise = noise_variance(&next, &values, redundancy - count as i64);
        let shared = shared_gain(&best, &next, &values) / noise;
        let is_shared = shared > count as f64 * (redundancy as f64).ln();
        let is_strong = lowest - score > STRONG * noise / (next.sigma * next.sigma);
        if score < lowest && (is_shared || shared > -STRONG && is_strong) {
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

/// The variance of a drawn coordinate, in pixels squared: as was said, or as the edges show it under a model where the hand
/// is less sure. Models are compared in units of it (overdispersion, Burnham and Anderson 2002, section 2.5).
fn noise_variance(problem: &LensProblem, values: &[f64], dof: i64) -> f64 {
    (problem.cost(values) / dof.max(1) as f64).max(problem.sigma * problem.sigma)
}

/// By how much a larger model lowers the cost, without the edge whose cost it lowers most: one edge that is
/// not straight in space must not determine the lens.
fn shared_gain(smaller: &FittedModel, larger: &LensProblem, values: &[f64]) -> f64 {
    let gains = smaller.problem.costs(&smaller.values).zip(larger.costs(values)).map(|(was, is)| was - is);
    let gains = gains.zip(&larger.times);
    let (total, most) =
        gains.fold((0.0, 0.0), |(sum, most): (f64, f64), (gain, times)| (sum + gain / times, most.max(gain)));
    total - most
}

/// Standard deviation of the undistorted position at three places: from the covariance of the coefficients,
/// and from the difference to the rejected larger model, weighted by its probability.
fn map_error(
    problem: &LensProblem,
    values: &[f64],
    rejected: Option<&(Lens, f64)>,
    options: &LensOptions,
) -> [f64; 3] {
    let Some(covariance) = problem.covariance(values) else { return [f64::INFINITY; 3] };
    let lens = problem.lens(values);
    let variance = |place: Pixel| {
        let by = shown_by_parameters(&lens, place)?;
        let jacobian: Vec<[f64; 2]> = problem.indices().iter().map(|&k| by[k].at).collect();
        let mut variance = 0.0;
        for i in 0..values.len() {
            for j in 0..values.len() {
                variance +=
                    covariance[(i, j)] * (jacobian[i][0] * jacobian[j][0] + jacobian[i][1] * jacobian[j][1]);
            }
        }
        let model_variance = match rejected {
            Some((other, probability)) => {
                let apart = lens.undistort(place)?.distance(other.undistort(place)?);
                probability * apart * apart
            }
            None => 0.0,
        };
        Some(options.sigma * options.sigma * variance.max(0.0) + model_variance)
    };
    // Where the distortion cannot be inverted there is no position.
    problem.places().map(|place| variance(place).map_or(f64::INFINITY, f64::sqrt))
}

/// The covariance with a row and a column for every parameter of the lens.
fn full_covariance(
    problem: &LensProblem,
    values: &[f64],
    sigma: f64,
) -> [[f64; Lens::PARAMETERS]; Lens::PARAMETERS] {
    let mut full = [[0.0; Lens::PARAMETERS]; Lens::PARAMETERS];
    let Some(covariance) = problem.covariance(values) else { return full };
    let indices = problem.indices();
    for (i, &a) in indices.iter().enumerate().take(values.len()) {
        for (j, &b) in indices.iter().enumerate().take(values.len()) {
            full[a][b] = sigma * sigma * covariance[(i, j)];
        }
    }
    full
}
