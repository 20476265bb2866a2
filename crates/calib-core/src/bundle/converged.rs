//! Bundle problem at its minimum: its cameras and landmarks, their covariances, and the agreement of every
//! outlier candidate with the rest.
//!
//! Covariances of cameras and landmarks are computed from the inverse of the normal equations at the minimum.

use std::collections::{BTreeSet, HashMap};

use nalgebra::DMatrix;

use crate::bundle::camera::CAMERA_PARAMS;
use crate::bundle::landmark::{
    DistanceMeasurement, LANDMARK_PARAMS, Landmark, LandmarkModel, covisible_pairs,
};
use crate::bundle::problem::BundleProblem;
use crate::bundle::residuals::ResidualKind;
use crate::camera::{Camera, Covariance, Plane};
use crate::optimize::{BlockCovariance, LevenbergMarquardt, MISFIT_SCORE, chi2_score, is_misfit};
use crate::single::MIN_LOG_FOCAL_SIGMA_FOR_PRIOR;

/// Covariance between the parameters of one camera (rows) and of another (columns), in the order and units of
/// [`Covariance`].
pub type CrossCovariance = Box<[[f64; Covariance::SIZE]; Covariance::SIZE]>;

/// Marginal covariances of the cameras of a bundle problem at a state.
pub(crate) struct Marginals<'a> {
    pub(crate) problem: &'a BundleProblem<'a>,
    pub(crate) covariance: &'a BlockCovariance,
    /// Cameras at the state.
    pub(crate) cameras: &'a [Camera],
    /// Factor by which the standard deviations of each view are multiplied.
    pub(crate) inflation: &'a [f64],
    /// Covariances of all pairs of camera blocks, if there are few cameras; otherwise each block is computed
    /// on request.
    pub(crate) between: Option<&'a HashMap<[usize; 2], DMatrix<f64>>>,
}

/// Largest number of camera pairs whose covariances are all computed: 45 cameras. With more cameras, only
/// pairs with shared landmarks are computed.
const MAX_CAMERA_PAIRS: usize = 1000;

/// Whether there are few enough views to compute the covariances of all pairs.
pub(crate) fn has_all_pair_covariances(views: usize) -> bool {
    views > 1 && views * (views - 1) / 2 <= MAX_CAMERA_PAIRS
}

/// Returns the indices of the parameter blocks of all cameras, ascending.
pub(crate) fn camera_blocks(problem: &BundleProblem) -> Vec<usize> {
    let of = |view: usize| problem.camera_layout(view).iter().flatten().map(|&(block, _)| block);
    (0..problem.views.len()).flat_map(of).collect::<BTreeSet<usize>>().into_iter().collect()
}

impl Marginals<'_> {
    /// Returns the covariance between the parameters of the views `a` (rows) and `b` (columns), which may be
    /// equal, with the focal length in pixels.
    pub(crate) fn camera_covariance(&self, [a, b]: [usize; 2]) -> CrossCovariance {
        let inflation = self.inflation[a] * self.inflation[b];
        let mut found = Box::new([[0.0; CAMERA_PARAMS]; CAMERA_PARAMS]);
        // Two cameras have few blocks; each is computed from the inverse only once.
        let mut blocks: Vec<([usize; 2], DMatrix<f64>)> = Vec::new();
        for (i, from) in self.problem.camera_layout(a).iter().enumerate() {
            for (j, to) in self.problem.camera_layout(b).iter().enumerate() {
                let (Some((p, row)), Some((q, column))) = (from, to) else { continue };
                let known = blocks.iter().position(|(pair, _)| *pair == [*p, *q]);
                let at = known.unwrap_or_else(|| {
                    blocks.push(([*p, *q], self.block([*p, *q])));
                    blocks.len() - 1
                });
                let scale = self.per_parameter(i, a) * self.per_parameter(j, b);
                found[i][j] = blocks[at].1[(*row, *column)] * scale * inflation;
            }
        }
        found
    }

    /// Returns the covariance between two parameter blocks.
    fn block(&self, pair: [usize; 2]) -> DMatrix<f64> {
        let known = self.between.and_then(|between| between.get(&pair)).cloned();
        known.unwrap_or_else(|| self.covariance.block(&self.problem.blocks, pair[0], pair[1]))
    }

    /// Returns the derivative of a reported camera value with respect to its parameter in the state. The
    /// derivative is 1, except for the focal length, which the state contains as a logarithm.
    fn per_parameter(&self, index: usize, view: usize) -> f64 {
        if index == Covariance::FOCAL { self.cameras[view].focal } else { 1.0 }
    }

    /// Returns the pairs of correlated cameras, the lower index first, with their cross-covariance.
    pub(crate) fn camera_pair_covariances(&self) -> Vec<([usize; 2], CrossCovariance)> {
        let views = self.cameras.len();
        let pairs = match self.between {
            Some(_) => (0..views).flat_map(|a| (a + 1..views).map(move |b| [a, b])).collect(),
            None => covisible_pairs(&self.problem.landmarks),
        };
        let with_covariance = pairs.into_iter().map(|pair| (pair, self.camera_covariance(pair)));
        with_covariance.filter(|(_, found)| found.iter().flatten().any(|&value| value != 0.0)).collect()
    }
}

/// Returns the covariance of the parameters of a landmark, multiplied by `inflation`; zeros for fixed
/// parameters.
pub(crate) fn landmark_covariance(
    problem: &BundleProblem,
    covariance: &BlockCovariance,
    landmark: usize,
    inflation: f64,
) -> [[f64; LANDMARK_PARAMS]; LANDMARK_PARAMS] {
    let mut found = [[0.0; LANDMARK_PARAMS]; LANDMARK_PARAMS];
    let Some(block) = problem.landmark_block(landmark) else { return found };
    let own = covariance.block(&problem.blocks, block, block);
    let free: Vec<usize> = (0..LANDMARK_PARAMS).filter(|&k| problem.landmarks[landmark].free[k]).collect();
    for (i, &k) in free.iter().enumerate() {
        for (j, &l) in free.iter().enumerate() {
            found[k][l] = own[(i, j)] * inflation;
        }
    }
    found
}

/// Largest number of accepted steps of a minimisation; an initialised state needs few.
const MAX_STEPS: usize = 60;
/// Regularisation of the covariance: the fraction of a parameter's own information that is added to it. An
/// undetermined parameter then has a large variance, not an infinite one.
const REGULARIZATION: f64 = 1e-12;

/// Candidate for rejection as an outlier: a landmark or a measured distance, by its index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutlierCandidate {
    /// Landmark with all its observations.
    Landmark(usize),
    /// Measured distance between two landmarks.
    Distance(usize),
}

/// Landmark with its estimated parameters and their covariance, zeros for fixed parameters.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LandmarkEstimate {
    /// Kind of the landmark; a line includes the origin to which its parameters refer.
    pub(crate) model: LandmarkModel,
    pub(crate) params: [f64; LANDMARK_PARAMS],
    pub(crate) covariance: [[f64; LANDMARK_PARAMS]; LANDMARK_PARAMS],
}

/// Estimated plane with the covariance of its parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneEstimate {
    /// Height and slope of the plane.
    pub plane: Plane,
    /// Covariance of the height (in metres) and the slopes along x and y (rise per metre), in this order.
    pub covariance: [[f64; 3]; 3],
}

/// Outlier candidate with the chi-square of its residuals.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scored {
    pub(crate) candidate: OutlierCandidate,
    /// Sum of the squared residuals of the candidate, in standard deviations.
    pub(crate) chi2: f64,
    /// Degrees of freedom: number of residuals minus number of free parameters of the candidate.
    pub(crate) dof: i64,
}

impl Scored {
    /// Returns the standard normal score of the candidate's chi-square, with the assumed variances multiplied
    /// by `factor`.
    pub(crate) fn score(&self, factor: f64) -> f64 {
        chi2_score(self.chi2 / factor, self.dof as f64)
    }
}

/// Returns the standard normal score above which the candidate with the largest score of `count` candidates
/// is an outlier.
pub(crate) fn outlier_score_limit(count: usize) -> f64 {
    (MISFIT_SCORE * MISFIT_SCORE + 2.0 * (count.max(1) as f64).ln()).sqrt()
}

/// Bundle problem at its minimum, or close to its minimum.
pub(crate) struct Converged<'a> {
    pub(crate) problem: BundleProblem<'a>,
    /// Minimisation that produced the state.
    run: LevenbergMarquardt<BundleProblem<'a>>,
    pub(crate) chi2: f64,
    pub(crate) dof: i64,
    /// Kind and value of every residual; values in standard deviations.
    pub(crate) residuals: Vec<(ResidualKind, f64)>,
    /// Covariance of the parameter blocks that share residuals; `None` until it is computed.
    pub(crate) covariance: Option<BlockCovariance>,
}

/// Wraps an angle, in radians, to [-180°, 180°).
fn wrapped(angle: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    (angle + PI).rem_euclid(TAU) - PI
}

/// Minimises a problem until its residuals are accurate enough to detect gross errors.
pub(crate) fn nearly_converged(problem: BundleProblem<'_>) -> Option<Converged<'_>> {
    /// Relative decrease of the cost below which an undamped step ends the minimisation.
    const MAX_RELATIVE_DECREASE: f64 = 0.02;
    let mut run = LevenbergMarquardt::new(&problem, problem.start())?;
    for _ in 0..MAX_STEPS {
        let before = run.cost;
        if run.advance(&problem).is_some() {
            // The last step may have been accepted without an evaluation, so a new run evaluates its end.
            run = LevenbergMarquardt::new(&problem, run.state)?;
            break;
        }
        if before - run.cost <= MAX_RELATIVE_DECREASE * before && run.is_undamped() {
            break;
        }
    }
    Converged::new(problem, run)
}

/// Minimises a problem until convergence; `None` if the geometry is impossible.
pub(crate) fn converged(problem: BundleProblem<'_>) -> Option<Converged<'_>> {
    let mut run = LevenbergMarquardt::new(&problem, problem.start())?;
    run.run(&problem, MAX_STEPS);
    Converged::new(problem, run)
}

impl<'a> Converged<'a> {
    fn new(problem: BundleProblem<'a>, run: LevenbergMarquardt<BundleProblem<'a>>) -> Option<Self> {
        let mut residuals = Vec::with_capacity(run.normal.residuals);
        problem.each_residual(&run.state, |residual, _, kind| residuals.push((kind, residual)))?;
        let chi2 = residuals.iter().map(|(_, residual)| residual * residual).sum();
        let dof = problem.dof(residuals.len());
        Some(Self { problem, run, chi2, dof, residuals, covariance: None })
    }

    /// Minimises the problem again without the weak priors on focal lengths, starting from this state.
    pub(crate) fn without_weak_priors(self) -> Option<Self> {
        let Self { mut problem, run: LevenbergMarquardt { state, mut normal, .. }, .. } = self;
        problem.drop_weak_priors(&state, &mut normal);
        let mut run = LevenbergMarquardt::from_normal(&problem, state, normal.cost, normal);
        run.run(&problem, MAX_STEPS);
        Self::new(problem, run)
    }

    /// Returns the values of all estimated parameters.
    pub(crate) fn state(&self) -> &[f64] {
        &self.run.state
    }

    /// Computes the covariance of the parameter blocks that share residuals; `None` if the factorisation
    /// fails.
    pub(crate) fn covariance(&self) -> Option<BlockCovariance> {
        self.problem.blocks.covariance(&self.run.normal, REGULARIZATION)
    }

    /// Returns the covariances of all pairs of camera blocks; `None` if there are too many cameras.
    pub(crate) fn covariance_between_cameras(&self) -> Option<HashMap<[usize; 2], DMatrix<f64>>> {
        if !has_all_pair_covariances(self.problem.views.len()) {
            return None;
        }
        self.problem.blocks.covariance_between(
            &self.run.normal,
            REGULARIZATION,
            &camera_blocks(&self.problem),
        )
    }

    /// Returns the camera of a view without covariance. A free yaw is wrapped to [-180°, 180°).
    pub(crate) fn camera(&self, view: usize) -> Camera {
        let camera = self.problem.camera(self.state(), view);
        let is_free = self.problem.camera_layout(view)[Covariance::YAW].is_some();
        let yaw = if is_free { wrapped(camera.yaw) } else { camera.yaw };
        Camera { yaw, covariance: Covariance::EXACT, ..camera }
    }

    /// Returns the estimate of every landmark; `None` if it is switched off. The covariance is multiplied by
    /// `inflation`.
    pub(crate) fn landmarks(
        &self,
        covariance: Option<&BlockCovariance>,
        inflation: f64,
    ) -> Vec<Option<LandmarkEstimate>> {
        let problem = &self.problem;
        let estimate = |landmark: usize| {
            let unknown = [[0.0; LANDMARK_PARAMS]; LANDMARK_PARAMS];
            let covariance = covariance
                .map_or(unknown, |covariance| landmark_covariance(problem, covariance, landmark, inflation));
            let model = problem.landmarks[landmark].model.clone();
            LandmarkEstimate { model, params: problem.landmark_params(self.state(), landmark), covariance }
        };
        let count = problem.landmarks.len();
        (0..count).map(|index| (!problem.landmarks[index].off).then(|| estimate(index))).collect()
    }

    /// Returns the estimate of every plane; `None` for a plane that is fixed or has no covariance.
    pub(crate) fn planes(
        &self,
        covariance: Option<&BlockCovariance>,
        inflation: f64,
    ) -> Vec<Option<PlaneEstimate>> {
        let estimate = |plane: usize| {
            let block = self.problem.plane_blocks[plane]?;
            let own = covariance?.block(&self.problem.blocks, block, block);
            let entry = |i: usize, j: usize| own[(i, j)] * inflation;
            let covariance = std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)));
            Some(PlaneEstimate { plane: self.problem.plane(self.state(), plane), covariance })
        };
        (0..self.problem.planes.len()).map(estimate).collect()
    }

    /// Whether the weak prior on the focal length of a view matters: the focal length is estimated, and its variance
    /// is large, not finite or unknown.
    pub(crate) fn weak_prior_matters(&self, view: usize) -> bool {
        let Some((block, index)) = self.problem.camera_layout(view)[Covariance::FOCAL] else { return false };
        let own = self.covariance.as_ref().map(|known| known.block(&self.problem.blocks, block, block));
        !own.is_some_and(|own| {
            own[(index, index)] < MIN_LOG_FOCAL_SIGMA_FOR_PRIOR * MIN_LOG_FOCAL_SIGMA_FOR_PRIOR
        })
    }

    /// Returns all candidates for rejection as outliers, with their chi-squares.
    pub(crate) fn candidates(&self) -> Vec<Scored> {
        let (landmarks, distances) = self.chi2_by_candidate();
        let landmark = |(index, landmark): (usize, &Landmark)| {
            let dof = landmark.redundancy();
            let is_candidate = !landmark.off && !landmark.keep && dof > 0;
            let candidate = OutlierCandidate::Landmark(index);
            is_candidate.then(|| Scored { candidate, chi2: landmarks[index], dof })
        };
        let distance = |(index, distance): (usize, &DistanceMeasurement)| {
            let is_candidate = !distance.off && !distance.keep;
            let candidate = OutlierCandidate::Distance(index);
            is_candidate.then(|| Scored { candidate, chi2: distances[index], dof: 1 })
        };
        let of_landmarks = self.problem.landmarks.iter().enumerate().filter_map(landmark);
        of_landmarks.chain(self.problem.distances.iter().enumerate().filter_map(distance)).collect()
    }

    /// Returns the outlier candidates, the largest score first.
    pub(crate) fn worst_first(&self) -> Vec<Scored> {
        let mut candidates = self.candidates();
        candidates.sort_by(|a, b| b.score(1.0).total_cmp(&a.score(1.0)));
        candidates
    }

    /// Returns the sums of the squared residuals of every landmark and every distance.
    fn chi2_by_candidate(&self) -> (Vec<f64>, Vec<f64>) {
        let mut landmarks = vec![0.0; self.problem.landmarks.len()];
        let mut distances = vec![0.0; self.problem.distances.len()];
        for &(kind, residual) in &self.residuals {
            match kind {
                ResidualKind::Observation { landmark, .. } | ResidualKind::LandmarkPrior { landmark } => {
                    landmarks[landmark] += residual * residual;
                }
                ResidualKind::Distance { distance } => distances[distance] += residual * residual,
                ResidualKind::Annotation { .. }
                | ResidualKind::StraightEdge
                | ResidualKind::CameraPrior
                | ResidualKind::PlanePrior => {}
            }
        }
        (landmarks, distances)
    }

    /// Whether the chi-square of all residuals, or the largest chi-square of a candidate, is too large for
    /// the noise.
    pub(crate) fn has_outliers(&self) -> bool {
        let candidates = self.candidates();
        let worst = candidates.iter().map(|scored| scored.score(1.0)).fold(0.0, f64::max);
        is_misfit(self.chi2, self.dof) || worst > outlier_score_limit(candidates.len())
    }
}
