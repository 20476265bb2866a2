//! Refinement of one cluster of cameras: the least-squares estimate without outliers, with weak priors on the
//! focals that are not determined otherwise, and the covariances there.
//!
//! Outliers are searched for where the chi-square of all residuals is too large for the noise, or that of one
//! landmark, as the largest of many. The candidate without which the rest has the least chi-square score
//! (leave-one-out) is rejected, if the rest has no misfit or the candidate is significant against its
//! scatter; then again.

use crate::bundle::camera::View;
use crate::bundle::landmark::{DistanceMeasurement, LANDMARK_PARAMS, Landmark};
use crate::bundle::marginals::{CrossCovariance, Marginals, of_landmark};
use crate::bundle::problem::BundleProblem;
use crate::bundle::residuals::ResidualKind;
use crate::camera::{Camera, Covariance, Plane};
use crate::optimize::{BlockCovariance, Summary, least_squares};
use crate::single::{
    LEVEL, OPEN_FOCAL, PlanePrior, Prior, chi2_score, inflation, is_misfit, is_significant, student_factor,
};

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

/// Parameters of a landmark with their covariance, zeros for those that are not free.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LandmarkEstimate {
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

/// A refined cluster.
#[derive(Clone, Debug)]
pub(crate) struct Refined {
    /// With the covariance of what was estimated.
    pub(crate) cameras: Vec<Camera>,
    /// Of landmarks that took part.
    pub(crate) landmarks: Vec<Option<LandmarkEstimate>>,
    pub(crate) chi2: f64,
    pub(crate) dof: i64,
    /// Factor of the variances of drawn coordinates where they were not given.
    pub(crate) inflation: f64,
    pub(crate) rejected: Vec<OutlierCandidate>,
    /// The chi-square is too large for the noise, and no outlier explains it.
    pub(crate) is_misfit: bool,
    /// Every residual in sigmas.
    pub(crate) residuals: Vec<(ResidualKind, f64)>,
    /// Directions and lengths of stage 1, of every view.
    pub(crate) nuisances: Vec<Vec<f64>>,
    /// Planes that were estimated.
    pub(crate) planes: Vec<Option<PlaneEstimate>>,
    /// Covariance of cameras that observe landmarks in common.
    pub(crate) pairs: Vec<([usize; 2], CrossCovariance)>,
}

/// A problem at its minimum.
struct Converged<'a> {
    problem: BundleProblem<'a>,
    state: Vec<f64>,
    chi2: f64,
    dof: i64,
    /// Where it has been computed already.
    covariance: Option<BlockCovariance>,
}

/// A cluster of cameras with what they observe, initialised; indices are those within the cluster.
#[derive(Clone, Debug)]
pub(crate) struct Refinement<'a> {
    pub(crate) views: Vec<View<'a>>,
    pub(crate) landmarks: Vec<Landmark>,
    pub(crate) distances: Vec<DistanceMeasurement>,
    /// Planes besides the floor.
    pub(crate) planes: Vec<PlanePrior>,
    /// Of which views the noise was given; where it is of all, a chi-square is a test of the fit.
    pub(crate) noise_is_known: Vec<bool>,
}

impl Refinement<'_> {
    /// `None` where the start is impossible.
    pub(crate) fn solve(&self) -> Option<Refined> {
        let mut rejected = Vec::new();
        let mut converged = self.solve_without(&rejected)?;
        // Every rejection costs a search; beyond a tenth of the landmarks the fit is reported as a misfit.
        let max_rejected = (self.landmarks.len() / 10).clamp(1, 20);
        while rejected.len() < max_rejected && converged.has_outliers() {
            let Some((candidate, without)) = self.worst_outlier(&converged, &rejected) else { break };
            if !self.is_outlier(&converged, &without, rejected.is_empty()) {
                break;
            }
            rejected.push(candidate);
            converged = without;
        }
        Some(self.finish(converged, rejected))
    }

    fn all_noise_is_known(&self) -> bool {
        self.noise_is_known.iter().all(|&is_known| is_known)
    }

    /// Whether the candidate by which two minima differ is an outlier: it is significant against the scatter
    /// of the rest, or its rejection explains the misfit.
    fn is_outlier(&self, with: &Converged, without: &Converged, is_first: bool) -> bool {
        let count = self.landmarks.len() + self.distances.len();
        let explains = !is_misfit(without.chi2, without.dof);
        is_significant(with.chi2, without.chi2, without.dof, count)
            || (explains && (self.all_noise_is_known() || is_first))
    }

    /// Landmarks and distances with some of them rejected, and distances to rejected landmarks.
    fn without(&self, rejected: &[OutlierCandidate]) -> (Vec<Landmark>, Vec<DistanceMeasurement>) {
        let (mut landmarks, mut distances) = (self.landmarks.clone(), self.distances.clone());
        for candidate in rejected {
            match *candidate {
                OutlierCandidate::Landmark(landmark) => {
                    landmarks[landmark].off = true;
                    let ends = distances.iter_mut().filter(|distance| distance.between.contains(&landmark));
                    ends.for_each(|distance| distance.off = true);
                }
                OutlierCandidate::Distance(distance) => distances[distance].off = true,
            }
        }
        (landmarks, distances)
    }

    /// The minimum without the rejected. The weak prior on a focal enters where nothing else, the landmarks
    /// included, determines it.
    fn solve_without(&self, rejected: &[OutlierCandidate]) -> Option<Converged<'_>> {
        let has_weak_prior: Vec<bool> =
            self.views.iter().map(|view| view.stage_1.priors.weak_log_focal.is_some()).collect();
        let none = vec![false; self.views.len()];
        if !has_weak_prior.contains(&true) {
            return converged(self.problem(rejected, &none));
        }
        let Some(mut without_prior) = converged(self.problem(rejected, &none)) else {
            return converged(self.problem(rejected, &has_weak_prior));
        };
        without_prior.covariance = without_prior.covariance();
        let is_open: Vec<bool> = (0..self.views.len())
            .map(|view| has_weak_prior[view] && without_prior.focal_is_open(view))
            .collect();
        if is_open.contains(&true) {
            converged(self.problem(rejected, &is_open))
        } else {
            Some(without_prior)
        }
    }

    /// The problem without what is rejected, with the weak priors of the flagged views.
    fn problem(&self, rejected: &[OutlierCandidate], with_weak_prior: &[bool]) -> BundleProblem<'_> {
        let mut views = self.views.clone();
        for (view, with) in views.iter_mut().zip(with_weak_prior) {
            let weak: Option<Prior> = view.stage_1.priors.weak_log_focal.filter(|_| *with);
            view.stage_1.priors.weak_log_focal = weak;
        }
        let (landmarks, distances) = self.without(rejected);
        BundleProblem::new(views, landmarks, distances, self.planes.clone())
    }

    /// The candidate without which the rest has the least chi-square score, with the minimum there.
    fn worst_outlier(
        &self,
        converged: &Converged,
        rejected: &[OutlierCandidate],
    ) -> Option<(OutlierCandidate, Converged<'_>)> {
        // Leave-one-out is exact and used where it is cheap; a large network has the redundancy for the
        // residuals to rank the candidates.
        let max_tried = (4000 / converged.problem.blocks.unknowns().max(1)).clamp(1, 8);
        let candidates = converged.scores().into_iter().map(|(candidate, _)| candidate).take(max_tried);
        let tried = candidates.filter_map(|candidate| {
            let without: Vec<OutlierCandidate> = rejected.iter().copied().chain([candidate]).collect();
            let found = self.solve_without(&without)?;
            (found.dof >= 1).then_some((candidate, found))
        });
        let score = |found: &Converged| chi2_score(found.chi2, found.dof);
        tried.min_by(|a, b| score(&a.1).total_cmp(&score(&b.1)))
    }

    fn finish(&self, mut converged: Converged, rejected: Vec<OutlierCandidate>) -> Refined {
        let covariance = converged.covariance.take().or_else(|| converged.covariance());
        let Converged { problem, state, chi2, dof, .. } = &converged;
        let inflation = if self.all_noise_is_known() { 1.0 } else { inflation(*chi2, *dof) };
        // Student's, where few residuals tell the noise.
        let spread = if inflation > 1.0 { inflation.sqrt() * student_factor(*dof) } else { 1.0 };
        let mut cameras: Vec<Camera> = (0..problem.views.len()).map(|view| converged.camera(view)).collect();
        let mut pairs = Vec::new();
        if let Some(covariance) = &covariance {
            // Noise that was given is not scaled.
            let factors: Vec<f64> =
                self.noise_is_known.iter().map(|&known| if known { 1.0 } else { spread }).collect();
            let marginals = Marginals { problem, covariance, cameras: &cameras, inflation: &factors };
            let own: Vec<CrossCovariance> =
                (0..cameras.len()).map(|view| marginals.of_cameras([view, view])).collect();
            pairs = marginals.of_pairs();
            cameras.iter_mut().zip(own).for_each(|(camera, own)| camera.covariance = Covariance(*own));
        }
        let mut residuals = Vec::new();
        let _ = problem.each_residual(state, |residual, _, kind| residuals.push((kind, residual)));
        Refined {
            landmarks: converged.landmarks(covariance.as_ref(), spread * spread),
            nuisances: (0..cameras.len()).map(|view| problem.nuisance(state, view)).collect(),
            cameras,
            chi2: *chi2,
            dof: *dof,
            inflation,
            rejected,
            is_misfit: is_misfit(*chi2, *dof),
            residuals,
            planes: converged.planes(covariance.as_ref(), spread * spread),
            pairs,
        }
    }
}

/// The angle in [-180, 180) degrees, in radians.
fn wrapped(angle: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    (angle + PI).rem_euclid(TAU) - PI
}

fn converged(problem: BundleProblem<'_>) -> Option<Converged<'_>> {
    let Summary { state, cost: chi2, .. } = least_squares(&problem, problem.start(), MAX_STEPS)?;
    let dof = problem.dof(&state)?;
    Some(Converged { problem, state, chi2, dof, covariance: None })
}

impl Converged<'_> {
    fn covariance(&self) -> Option<BlockCovariance> {
        self.problem.blocks.covariance(self.problem.normal(&self.state)?, REGULARIZATION)
    }

    /// A camera without covariance, a free yaw in [-180, 180) degrees.
    fn camera(&self, view: usize) -> Camera {
        let camera = self.problem.camera(&self.state, view);
        let is_free = self.problem.camera_layout(view)[Covariance::YAW].is_some();
        let yaw = if is_free { wrapped(camera.yaw) } else { camera.yaw };
        Camera { yaw, covariance: Covariance::EXACT, ..camera }
    }

    fn landmarks(
        &self,
        covariance: Option<&BlockCovariance>,
        inflation: f64,
    ) -> Vec<Option<LandmarkEstimate>> {
        let problem = &self.problem;
        let estimate = |landmark: usize| {
            let unknown = [[0.0; LANDMARK_PARAMS]; LANDMARK_PARAMS];
            let covariance = covariance
                .map_or(unknown, |covariance| of_landmark(problem, covariance, landmark, inflation));
            LandmarkEstimate { place: problem.place(&self.state, landmark), covariance }
        };
        let count = problem.landmarks.len();
        (0..count).map(|index| (!problem.landmarks[index].off).then(|| estimate(index))).collect()
    }

    /// The planes that were estimated, as far as the covariance is known.
    fn planes(&self, covariance: Option<&BlockCovariance>, inflation: f64) -> Vec<Option<PlaneEstimate>> {
        let estimate = |plane: usize| {
            let block = self.problem.plane_blocks[plane]?;
            let own = covariance?.block(&self.problem.blocks, block, block);
            let entry = |i: usize, j: usize| own[(i, j)] * inflation;
            let covariance = std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)));
            Some(PlaneEstimate { plane: self.problem.plane(&self.state, plane), covariance })
        };
        (0..self.problem.planes.len()).map(estimate).collect()
    }

    /// Whether the focal of a view is estimated and its log has a large variance, or none that is a number.
    fn focal_is_open(&self, view: usize) -> bool {
        let Some((block, place)) = self.problem.camera_layout(view)[Covariance::FOCAL] else { return false };
        let own = self.covariance.as_ref().map(|known| known.block(&self.problem.blocks, block, block));
        !own.is_some_and(|own| own[(place, place)] < OPEN_FOCAL * OPEN_FOCAL)
    }

    /// The outlier candidates with the score of their chi-squares, the largest first.
    fn scores(&self) -> Vec<(OutlierCandidate, f64)> {
        let (landmarks, distances) = self.chi2_by_candidate();
        let landmark = |(index, landmark): (usize, &Landmark)| {
            let is_candidate = !landmark.off && !landmark.keep && landmark.redundancy() > 0;
            let score = || chi2_score(landmarks[index], landmark.redundancy());
            is_candidate.then(|| (OutlierCandidate::Landmark(index), score()))
        };
        let distance = |(index, distance): (usize, &DistanceMeasurement)| {
            let is_candidate = !distance.off && !distance.keep;
            is_candidate.then(|| (OutlierCandidate::Distance(index), chi2_score(distances[index], 1)))
        };
        let mut scores: Vec<(OutlierCandidate, f64)> =
            self.problem.landmarks.iter().enumerate().filter_map(landmark).collect();
        scores.extend(self.problem.distances.iter().enumerate().filter_map(distance));
        scores.sort_by(|a, b| b.1.total_cmp(&a.1));
        scores
    }

    /// Sums of the squared residuals of every landmark and every distance.
    fn chi2_by_candidate(&self) -> (Vec<f64>, Vec<f64>) {
        let mut landmarks = vec![0.0; self.problem.landmarks.len()];
        let mut distances = vec![0.0; self.problem.distances.len()];
        let _ = self.problem.each_residual(&self.state, |residual, _, kind| match kind {
            ResidualKind::Observation { landmark } | ResidualKind::LandmarkPrior { landmark } => {
                landmarks[landmark] += residual * residual;
            }
            ResidualKind::Distance { distance } => distances[distance] += residual * residual,
            ResidualKind::Annotation { .. }
            | ResidualKind::StraightEdge
            | ResidualKind::CameraPrior
            | ResidualKind::PlanePrior => {}
        });
        (landmarks, distances)
    }

    /// Whether the chi-square of all residuals, or that of one candidate as the largest of many, is too large
    /// for the noise.
    fn has_outliers(&self) -> bool {
        let scores = self.scores();
        let worst = scores.first().map_or(0.0, |(_, score)| *score);
        let limit = (LEVEL * LEVEL + 2.0 * (scores.len().max(1) as f64).ln()).sqrt();
        is_misfit(self.chi2, self.dof) || worst > limit
    }
}
