//! Distortion from polylines along edges that are straight in space: the plumb-line method (Brown 1971,
//! "Close-Range Camera Calibration"). The fit runs first, because stage 1 uses undistorted points.
//!
//! The residual of a point is its distance from the best line through its undistorted polyline, measured in
//! raw pixels: `(n . U(p) - c) / |J' n|`. U is the undistortion, J its derivative at the point, and
//! `n . x = c` the line with the smallest sum of squares (`straightness.rs`). The coefficients refer to
//! coordinates divided by half the diagonal of the image, because the focal length is not known yet.
//!
//! The cost includes the priors on lenses (`lens_problem.rs`). If the caller does not choose coefficients,
//! the number of radial coefficients is selected by the largest evidence. Let chi2 be the chi-square of edges
//! and priors, H its normal matrix, and L the normal matrix of the priors alone. To first order (Laplace),
//! `-2 log evidence = chi2 + log det H - log det L`.

use crate::camera::DistortionModel::KannalaBrandt;
use crate::camera::{DistortionModel, ImageCircle, Lens, Pixel};
use crate::optimize::is_misfit;
use crate::single::constraints::Source;
use crate::single::lens_problem::{LensProblem, undistorted_by_parameters};
use crate::single::parameters::FittedCoefficients;
use crate::single::straightness::{Edge, edge_redundancy, outermost, repeat_counts, straightness};

/// Twice the log of the smallest evidence ratio that counts as very strong (Kass and Raftery 1995).
const STRONG_EVIDENCE: f64 = 10.0;

/// Largest number of free parameters of a fisheye: two coefficients, focal length and principal point.
const MAX_FREE_PARAMETERS: i64 = 5;

/// Numbers of radial coefficients (k1, k2, k3) that are compared.
const MODEL_SIZES: [usize; 3] = [1, 2, 3];

/// Estimate of a lens from straight edges.
#[derive(Clone, Debug)]
pub struct LensFit {
    /// Estimated lens. Its coefficients refer to half the diagonal of the image, or to the focal length if
    /// the model has its own.
    pub lens: Lens,
    /// Fitted coefficients; `None` if the edges support no distortion.
    pub fitted: Option<FittedCoefficients>,
    /// Root mean square distance of the points from their lines, in raw pixels, before and after the fit.
    pub straightness: [f64; 2],
    /// Root mean square deviation of every polyline from a straight line, in raw pixels.
    pub residuals: Vec<(Source, f64)>,
    /// Whether each parameter is fitted, in the order of [`Lens::PARAMETERS`]. The fitted parameters are the
    /// coefficients, and the focal length and principal point of a fisheye unless they are fixed.
    pub free: [bool; Lens::PARAMETERS],
    /// Covariance of the parameters; zero for parameters that are not fitted.
    pub covariance: [[f64; Lens::PARAMETERS]; Lens::PARAMETERS],
    /// Predicted standard deviation of the undistorted position at three pixels, in pixels: halfway
    /// to the end of the longer image axis, at that end, and in the corner. For a fisheye, the
    /// image circle replaces the border.
    pub map_error: [f64; 3],
    /// Polylines with almost no information, with their sagitta under a distortion that moves the corner by
    /// 10 px, in pixels.
    pub uninformative: Vec<(Source, f64)>,
    /// Chi-square: sum of squared residuals divided by `sigma^2`.
    pub chi2: f64,
    /// Degrees of freedom: the number of points, minus two for every line, minus the fitted parameters.
    pub dof: i64,
}

/// Options of a lens fit.
#[derive(Clone, Debug, PartialEq)]
pub struct LensOptions {
    /// Principal point, in raw pixels; for a fisheye with a free focal length, its expected position.
    pub principal_point: Pixel,
    /// Whether the principal point is fixed even if the focal length is free.
    pub is_centre_fixed: bool,
    /// Pixel aspect; see [`Lens::pixel_aspect`].
    pub pixel_aspect: f64,
    /// Width and height of the image, in pixels.
    pub size: [f64; 2],
    /// Image circle of a fisheye, if known; then the lens is a fisheye.
    pub circle: Option<ImageCircle>,
    /// Coefficients to fit; selected by the evidence if absent.
    pub fitted: Option<FittedCoefficients>,
    /// Focal length of a model that has its own, in pixels. The coefficients refer to it. Fitted if absent.
    pub focal: Option<f64>,
    /// Standard deviation of an annotated coordinate, in pixels.
    pub sigma: f64,
}

impl LensFit {
    /// Fits a lens to polylines. Polylines of fewer than three points are ignored.
    ///
    /// Returns `None` without redundancy, for example if no polyline has three points.
    #[must_use]
    pub fn new(edges: &[Edge], options: &LensOptions) -> Option<Self> {
        /// Maximum number of points of all polylines: enough for any lens, and a limit on the run time for
        /// hostile files.
        const MAX_POINTS: usize = 20_000;
        let mut room = MAX_POINTS;
        let edges: Vec<&Edge> = edges
            .iter()
            .filter(|edge| edge.points.len() > 2)
            .take_while(|edge| {
                let fits = edge.points.len() <= room;
                room = room.saturating_sub(edge.points.len());
                fits
            })
            .collect();
        let times = repeat_counts(edges.iter().copied());
        let redundancy = edge_redundancy(edges.iter().copied(), &times);
        if redundancy < 1 {
            return None;
        }
        let problem = |fitted: FittedCoefficients| {
            let half_diagonal = 0.5 * options.size[0].hypot(options.size[1]);
            let unit = options.focal.filter(|_| fitted.has_own_focal()).unwrap_or(half_diagonal);
            let LensOptions { principal_point, pixel_aspect, size, circle, sigma, .. } = *options;
            let (edges, times) = (edges.clone(), times.clone());
            let open = Vec::new();
            LensProblem {
                edges,
                repeat_counts: times,
                fitted,
                free: open,
                principal_point,
                pixel_aspect,
                unit,
                size,
                circle,
                sigma,
            }
        };
        let undistorted =
            FittedModel::undistorted(problem(FittedCoefficients::first(DistortionModel::BrownConrady, 0)))?;
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
                    FittedModel::solved(
                        problem(FittedCoefficients::first(KannalaBrandt, row.default_count)),
                        options,
                    )
                };
                let fisheye = model.may_be_fisheye(redundancy, options).then(fisheye).flatten();
                fisheye.filter(|fisheye| fisheye.is_better_than(&model, redundancy, options)).unwrap_or(model)
            }
        };
        Some(Self::of(&model, cost_before, redundancy, options))
    }

    /// Returns the lens of a fitted model, with its covariance and residuals.
    fn of(model: &FittedModel, cost_before: f64, redundancy: i64, options: &LensOptions) -> Self {
        let FittedModel { problem, values, cost, rejected } = model;
        let edges = problem.edges.iter().zip(&problem.repeat_counts);
        let points: f64 = edges.map(|(edge, times)| edge.points.len() as f64 / times).sum();
        let lens = problem.lens(values);
        let per_edge = |edge: &&Edge| {
            let distances = straightness(&lens, &edge.points).unwrap_or_default();
            let square = distances.iter().map(|d| d * d).sum::<f64>() / distances.len().max(1) as f64;
            (edge.source, square.sqrt())
        };
        Self {
            lens: if values.is_empty() && !problem.fitted.has_own_focal() {
                Lens { pixel_aspect: options.pixel_aspect, ..Lens::pinhole(options.principal_point) }
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

/// Distortion model with its estimated coefficients.
struct FittedModel<'a> {
    problem: LensProblem<'a>,
    /// Values of the fitted parameters, in the order of the problem.
    values: Vec<f64>,
    /// Sum of the squared residuals of all edges, in square pixels.
    cost: f64,
    /// Rejected larger model, with its posterior probability relative to this one.
    rejected: Option<(Lens, f64)>,
}

impl<'a> FittedModel<'a> {
    /// Returns the model without distortion.
    fn undistorted(problem: LensProblem<'a>) -> Option<Self> {
        let undistorted = Self::of(problem, Vec::new());
        undistorted.cost.is_finite().then_some(undistorted)
    }

    /// Fits a model, with the focal length and principal point of a fisheye unless they are given.
    fn solved(problem: LensProblem<'a>, options: &LensOptions) -> Option<Self> {
        let is_open = problem.fitted.has_own_focal() && options.focal.is_none();
        let problem = if is_open { problem.with_free_focal(options.is_centre_fixed) } else { problem };
        let start = vec![0.0; problem.indices().len()];
        let (values, _) = problem.solve(if is_open { &start } else { &[] })?;
        Some(Self::of(problem, values))
    }

    /// Whether the fisheye model should be tried: the redundancy is sufficient, and either an image circle is
    /// known or this model misfits.
    fn may_be_fisheye(&self, redundancy: i64, options: &LensOptions) -> bool {
        let dof = redundancy - self.values.len() as i64;
        let is_bent_otherwise = || is_misfit(self.cost / (options.sigma * options.sigma), dof);
        redundancy > MAX_FREE_PARAMETERS && (options.circle.is_some() || is_bent_otherwise())
    }

    /// Whether the edges support this fisheye model very strongly against the other model.
    ///
    /// Several edges must support it, because a single edge may not be straight in space. The edges must be
    /// in a region of the image that only fisheyes see. With an image circle, the fisheye need only fit
    /// equally well.
    fn is_better_than(&self, other: &Self, redundancy: i64, options: &LensOptions) -> bool {
        /// Largest angle from the axis that other lenses are built for, in radians.
        const MAX_RECTILINEAR_ANGLE_RAD: f64 = 0.9;
        if options.circle.is_some() {
            return self.cost <= other.cost;
        }
        let of = |model: &Self| model.problem.evidence(&model.values).unwrap_or(f64::INFINITY);
        let shared = shared_gain(other, &self.problem, &self.values) / (options.sigma * options.sigma);
        let is_shared = shared > MAX_FREE_PARAMETERS as f64 * (redundancy as f64).ln();
        is_shared && of(self) < of(other) - STRONG_EVIDENCE && self.max_angle() > MAX_RECTILINEAR_ANGLE_RAD
    }

    /// Returns the angle of the outermost annotated point from the axis of the lens, in radians.
    fn max_angle(&self) -> f64 {
        let lens = self.problem.lens(&self.values);
        let drawn = self.problem.edges.iter().flat_map(|edge| &edge.points);
        let bearing = outermost(drawn, lens.principal_point).and_then(|pixel| lens.bearing(pixel));
        bearing.map_or(0.0, |[x, y, ahead]| x.hypot(y).atan2(lens.focal * ahead))
    }

    /// Returns the model with these values of its parameters.
    fn of(problem: LensProblem<'a>, values: Vec<f64>) -> Self {
        let cost = problem.cost(&values);
        Self { problem, values, cost, rejected: None }
    }
}

/// Returns the model with the largest evidence, among the models with 0 to 3 radial coefficients.
///
/// The edges must also support the model if the edge with the largest cost reduction is left out. Alternatively, all
/// edges together must support it very strongly (Kass and Raftery 1995), and the rest must not contradict it very
/// strongly.
fn select_model<'a>(
    undistorted: FittedModel<'a>,
    redundancy: i64,
    problem: &dyn Fn(FittedCoefficients) -> LensProblem<'a>,
) -> FittedModel<'a> {
    let mut lowest = undistorted.problem.evidence(&[]).unwrap_or(f64::INFINITY);
    let mut best = undistorted;
    for count in MODEL_SIZES {
        let next = problem(FittedCoefficients::first(DistortionModel::BrownConrady, count));
        if redundancy <= count as i64 {
            continue;
        }
        let Some((values, _)) = next.solve(&best.values) else { continue };
        let Some(score) = next.evidence(&values) else { continue };
        let noise = noise_variance(&next, &values, redundancy - count as i64);
        let shared = shared_gain(&best, &next, &values) / noise;
        let is_shared = shared > count as f64 * (redundancy as f64).ln();
        let is_strong = lowest - score > STRONG_EVIDENCE * noise / (next.sigma * next.sigma);
        if score < lowest && (is_shared || shared > -STRONG_EVIDENCE && is_strong) {
            lowest = score;
            best = FittedModel::of(next, values);
            continue;
        }
        // Two coefficients may be supported if one is not, so the larger models are tried as well.
        let probability = (1.0 + (0.5 * (score - lowest)).exp()).recip();
        if best.rejected.as_ref().is_none_or(|(_, other)| probability > *other) {
            best.rejected = Some((next.lens(&values), probability));
        }
    }
    best
}

/// Returns the variance of an annotated coordinate, in square pixels: the assumed one, or a larger one estimated
/// from the edges.
///
/// Models are compared in units of this variance (overdispersion, Burnham and Anderson 2002, section 2.5).
fn noise_variance(problem: &LensProblem, values: &[f64], dof: i64) -> f64 {
    (problem.cost(values) / dof.max(1) as f64).max(problem.sigma * problem.sigma)
}

/// Returns the cost reduction by a larger model, in square pixels, summed over all edges except the edge with the
/// largest reduction. One edge that is not straight in space must not determine the lens.
fn shared_gain(smaller: &FittedModel, larger: &LensProblem, values: &[f64]) -> f64 {
    let gains = smaller.problem.costs(&smaller.values).zip(larger.costs(values)).map(|(was, is)| was - is);
    let gains = gains.zip(&larger.repeat_counts);
    let (total, most) =
        gains.fold((0.0, 0.0), |(sum, most): (f64, f64), (gain, times)| (sum + gain / times, most.max(gain)));
    total - most
}

/// Returns the standard deviation of the undistorted position at three pixels.
///
/// It combines the covariance of the coefficients with the difference from the rejected larger model,
/// weighted by its probability.
fn map_error(
    problem: &LensProblem,
    values: &[f64],
    rejected: Option<&(Lens, f64)>,
    options: &LensOptions,
) -> [f64; 3] {
    let Some(covariance) = problem.covariance(values) else { return [f64::INFINITY; 3] };
    let lens = problem.lens(values);
    let variance = |place: Pixel| {
        let by = undistorted_by_parameters(&lens, place)?;
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
    // If the distortion cannot be inverted, the position is undefined.
    problem.reference_pixels().map(|place| variance(place).map_or(f64::INFINITY, f64::sqrt))
}

/// Returns the covariance with a row and a column for every parameter of the lens.
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
