//! A bundle problem at its minimum: its cameras and landmarks, their covariance, and how well every outlier
//! candidate agrees with the rest.
//!
//! Covariances of cameras and landmarks, from the inverse of the normal equations at the minimum.

use std::collections::{BTreeSet, HashMap};

use nalgebra::DMatrix;

use crate::bundle::camera::CAMERA_PARAMS;
use crate::bundle::landmark::{
    DistanceMeasurement, LANDMARK_PARAMS, Landmark, LandmarkModel, observing_in_common,
};
use crate::bundle::problem::BundleProblem;
use crate::bundle::residuals::ResidualKind;
use crate::camera::{Camera, Covariance, Plane};
use crate::optimize::{BlockCovariance, LevenbergMarquardt, MISFIT_SCORE, chi2_score, is_misfit};
use crate::single::PRIOR_TELLS;

/// Covariance of the parameters of one camera (rows) with those of another (columns), in the order and
/// units of [`Covariance`].
pub type CrossCovariance = Box<[[f64; Covariance::SIZE]; Covariance::SIZE]>;

/// Covariances of a problem at a state.
pub(crate) struct Marginals<'a> {
    pub(crate) problem: &'a BundleProblem<'a>,
    pub(crate) covariance: &'a BlockCovariance,
    /// The cameras at the state.
    pub(crate) cameras: &'a [Camera],
    /// Factor of the standard deviations of every view.
    pub(crate) inflation: &'a [f64],
    /// Of all blocks of all cameras, by their pairs, where there are few cameras.
    pub(crate) between: Option<&'a HashMap<[usize; 2], DMatrix<f64>>>,
}

/// Most pairs of cameras, those of 45, of which all covariances are given; of more cameras only those are that the
/// cameras have which observe something in common.
const MOST_PAIRS: usize = 1000;

/// Whether there are so few views that the covariances of all pairs are given.
pub(crate) fn are_few(views: usize) -> bool {
    views > 1 && views * (views - 1) / 2 <= MOST_PAIRS
}

/// The blocks of all cameras.
pub(crate) fn camera_blocks(problem: &BundleProblem) -> Vec<usize> {
    let of = |view: usize| problem.camera_layout(view).iter().flatten().map(|&(block, _)| block);
    (0..problem.views.len()).flat_map(of).collect::<BTreeSet<usize>>().into_iter().collect()
}

impl Marginals<'_> {
    /// Covariance of the parameters of two cameras, or of one, with the focal in pixels.
    pub(crate) fn of_cameras(&self, [a, b]: [usize; 2]) -> CrossCovariance {
        let inflation = self.inflation[a] * self.inflation[b];
        let mut found = Box::new([[0.0; CAMERA_PARAMS]; CAMERA_PARAMS]);
        // The few blocks that two cameras have, each taken from the inverse once.
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

    fn block(&self, pair: [usize; 2]) -> DMatrix<f64> {
        let known = self.between.and_then(|between| between.get(&pair)).cloned();
        known.unwrap_or_else(|| self.covariance.block(&self.problem.blocks, pair[0], pair[1]))
    }

    /// Derivative of a reported value by its parameter: 1, but of the focal by its log.
    fn per_parameter(&self, index: usize, view: usize) -> f64 {
        if index == Covariance::FOCAL { self.cameras[view].focal } else { 1.0 }
    }

    /// Pairs of cameras that err together, the lower index first, with their covariance.
    pub(crate) fn of_pairs(&self) -> Vec<([usize; 2], CrossCovariance)> {
        let views = self.cameras.len();
        let pairs = match self.between {
            Some(_) => (0..views).flat_map(|a| (a + 1..views).map(move |b| [a, b])).collect(),
            None => observing_in_common(&self.problem.landmarks),
        };
        let with_covariance = pairs.into_iter().map(|pair| (pair, self.of_cameras(pair)));
        with_covariance.filter(|(_, found)| found.iter().flatten().any(|&value| value != 0.0)).collect()
    }
}

/// Covariance of the parameters of a landmark; zeros for those that are not free.
pub(crate) fn of_landmark(
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

/// Most accepted steps of a minimisation; from an initialised state few are needed.
const MAX_STEPS: usize = 60;
/// Regularisation of the covariance: this share of the information of its own residuals is added to every
/// parameter, so that what is not determined has a large, not an infinite, variance.
const REGULARIZATION: f64 = 1e-12;

/// Something that may be rejected as an outlier, by its index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutlierCandidate {
    /// A landmark with all its observations.
    Landmark(usize),
    /// A measured distance.
    Distance(usize),
}

/// A landmark, its parameters with their covariance, zeros for those that are not free.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LandmarkEstimate {
    /// A line with the origin that its parameters are of.
    pub(crate) model: LandmarkModel,
    pub(crate) place: [f64; LANDMARK_PARAMS],
    pub(crate) covariance: [[f64; LANDMARK_PARAMS]; LANDMARK_PARAMS],
}

/// A plane as it was estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneEstimate {
    /// Where it is.
    pub plane: Plane,
    /// Covariance of height and slope, in square metres and squares of rise per metre.
    pub covariance: [[f64; 3]; 3],
}

/// What may be rejected, with what its own residuals say against it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scored {
    pub(crate) candidate: OutlierCandidate,
    /// Sum of its squared residuals in sigmas.
    pub(crate) chi2: f64,
    /// Number of these residuals minus the number of its own parameters.
    pub(crate) dof: i64,
}

impl Scored {
    /// The standard normal score of its chi-square where variances are `factor` times those assumed.
    pub(crate) fn score(&self, factor: f64) -> f64 {
        chi2_score(self.chi2 / factor, self.dof as f64)
    }
}

/// The score beyond which the largest of so many is an outlier.
pub(crate) fn largest_of(count: usize) -> f64 {
    (MISFIT_SCORE * MISFIT_SCORE + 2.0 * (count.max(1) as f64).ln()).sqrt()
}

/// A problem at its minimum, or on the way there.
pub(crate) struct Converged<'a> {
    pub(crate) problem: BundleProblem<'a>,
    /// What led there.
    run: LevenbergMarquardt<BundleProblem<'a>>,
    pub(crate) chi2: f64,
    pub(crate) dof: i64,
    /// Every residual in sigmas.
    pub(crate) residuals: Vec<(ResidualKind, f64)>,
    /// Where it has been computed already.
    pub(crate) covariance: Option<BlockCovariance>,
}

/// The angle in [-180, 180) degrees, in radians.
fn wrapped(angle: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    (angle + PI).rem_euclid(TAU) - PI
}

/// A problem so near its minimum that its residuals tell gross errors, if not more.
pub(crate) fn nearly_converged(problem: BundleProblem<'_>) -> Option<Converged<'_>> {
    /// Relative decrease of the cost by a step after which it is, if the step was not a short one.
    const NEAR: f64 = 0.02;
    let mut run = LevenbergMarquardt::new(&problem, problem.start())?;
    for _ in 0..MAX_STEPS {
        let before = run.cost;
        if run.advance(&problem).is_some() {
            // From here it may go on: where a last step was believed it is looked at.
            run = LevenbergMarquardt::new(&problem, run.state)?;
            break;
        }
        if before - run.cost <= NEAR * before && run.is_undamped() {
            break;
        }
    }
    Converged::new(problem, run)
}

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

    /// The minimum without weak priors on focals, from where few steps with them led.
    pub(crate) fn without_weak_priors(self) -> Option<Self> {
        let Self { mut problem, run: LevenbergMarquardt { state, mut normal, .. }, .. } = self;
        problem.drop_weak_priors(&state, &mut normal);
        let mut run = LevenbergMarquardt::at(&problem, state, normal.cost, normal);
        run.run(&problem, MAX_STEPS);
        Self::new(problem, run)
    }

    /// The parameters.
    pub(crate) fn state(&self) -> &[f64] {
        &self.run.state
    }

    pub(crate) fn covariance(&self) -> Option<BlockCovariance> {
        self.problem.blocks.covariance(&self.run.normal, REGULARIZATION)
    }

    /// The covariances of all cameras with each other, where they are few.
    pub(crate) fn covariance_between_cameras(&self) -> Option<HashMap<[usize; 2], DMatrix<f64>>> {
        if !are_few(self.problem.views.len()) {
            return None;
        }
        self.problem.blocks.covariance_between(
            &self.run.normal,
            REGULARIZATION,
            &camera_blocks(&self.problem),
        )
    }

    /// A camera without covariance, a free yaw in [-180, 180) degrees.
    pub(crate) fn camera(&self, view: usize) -> Camera {
        let camera = self.problem.camera(self.state(), view);
        let is_free = self.problem.camera_layout(view)[Covariance::YAW].is_some();
        let yaw = if is_free { wrapped(camera.yaw) } else { camera.yaw };
        Camera { yaw, covariance: Covariance::EXACT, ..camera }
    }

    pub(crate) fn landmarks(
        &self,
        covariance: Option<&BlockCovariance>,
        inflation: f64,
    ) -> Vec<Option<LandmarkEstimate>> {
        let problem = &self.problem;
        let estimate = |landmark: usize| {
            let unknown = [[0.0; LANDMARK_PARAMS]; LANDMARK_PARAMS];
            let covariance = covariance
                .map_or(unknown, |covariance| of_landmark(problem, covariance, landmark, inflation));
            let model = problem.landmarks[landmark].model.clone();
            LandmarkEstimate { model, place: problem.place(self.state(), landmark), covariance }
        };
        let count = problem.landmarks.len();
        (0..count).map(|index| (!problem.landmarks[index].off).then(|| estimate(index))).collect()
    }

    /// The planes that were estimated, as far as the covariance is known.
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

    /// Whether the focal of a view is estimated and its log has so large a variance that the weak prior tells something, or
    /// none that is a number.
    pub(crate) fn prior_tells(&self, view: usize) -> bool {
        let Some((block, place)) = self.problem.camera_layout(view)[Covariance::FOCAL] else { return false };
        let own = self.covariance.as_ref().map(|known| known.block(&self.problem.blocks, block, block));
        !own.is_some_and(|own| own[(place, place)] < PRIOR_TELLS * PRIOR_TELLS)
    }

    /// What may be rejected, with its chi-square.
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

    /// What may be rejected, the largest score first.
    pub(crate) fn worst_first(&self) -> Vec<Scored> {
        let mut candidates = self.candidates();
        candidates.sort_by(|a, b| b.score(1.0).total_cmp(&a.score(1.0)));
        candidates
    }

    /// Sums of the squared residuals of every landmark and every distance.
    fn chi2_by_candidate(&self) -> (Vec<f64>, Vec<f64>) {
        let mut landmarks = vec![0.0; self.problem.landmarks.len()];
        let mut distances = vec![0.0; self.problem.distances.len()];
        for &(kind, residual) in &self.residuals {
            match kind {
                ResidualKind::Observation { landmark } | ResidualKind::LandmarkPrior { landmark } => {
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

    /// Whether the chi-square of all residuals, or that of one candidate as the largest of many, is too large
    /// for the noise.
    pub(crate) fn has_outliers(&self) -> bool {
        let candidates = self.candidates();
        let worst = candidates.iter().map(|scored| scored.score(1.0)).fold(0.0, f64::max);
        is_misfit(self.chi2, self.dof) || worst > largest_of(candidates.len())
    }
}
