//! The joint fit as a whole: the minimum, wrong landmarks, priors, sigmas.

use nalgebra::DMatrix;

use crate::bundle::landmark::{DistanceMeasurement, LANDMARK_PARAMS, Landmark};
use crate::bundle::parameters::CAMERA_PARAMS;
use crate::bundle::problem::{BundleProblem, ResidualBlock, View};
use crate::camera::{Camera, Covariance};
use crate::optimize::{BlockCovariance, Summary, least_squares};
use crate::single::{LEVEL, OPEN_FOCAL, Prior, chi2_score, inflation, is_misfit, is_significant};

/// Steps of one run; a start along a spanning tree is near.
const ROUNDS: usize = 60;
/// Share of the information of its own residuals that an unknown gets on top, so that what they leave
/// open together has a large variance and not an infinite one.
const OPEN: f64 = 1e-12;

/// Something that may be rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum OutlierCandidate {
    /// A landmark, by its index.
    Landmark(usize),
    /// A measured distance, by its index.
    Distance(usize),
}

/// Where a landmark is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LandmarkEstimate {
    pub(crate) place: [f64; LANDMARK_PARAMS],
    /// Of the unknowns of the place; zeros for those held.
    pub(crate) covariance: [[f64; LANDMARK_PARAMS]; LANDMARK_PARAMS],
}

/// What the joint fit found.
#[derive(Clone, Debug)]
pub(crate) struct Adjustment {
    /// With the covariance of what was estimated.
    pub(crate) cameras: Vec<Camera>,
    /// Of landmarks that were used.
    pub(crate) places: Vec<Option<LandmarkEstimate>>,
    pub(crate) chi2: f64,
    pub(crate) dof: i64,
    /// By which the variances of what was drawn are multiplied.
    pub(crate) inflation: f64,
    /// Landmarks and distances that were rejected.
    pub(crate) rejected: Vec<OutlierCandidate>,
    /// The evidence contradicts itself, and nothing that may be rejected explains it.
    pub(crate) misfit: bool,
    /// Every residual in sigmas.
    pub(crate) residuals: Vec<(ResidualBlock, f64)>,
    /// Directions and lengths of stage 1, of every camera.
    pub(crate) nuisance: Vec<Vec<f64>>,
    /// Covariance of cameras that see landmarks in common, for the first and the second of a pair.
    pub(crate) pairs: Vec<([usize; 2], CrossCovariance)>,
}

/// Covariance of the unknowns of one camera with those of another, as [`Covariance`] has them.
pub(crate) type CrossCovariance = Box<[[f64; CAMERA_PARAMS]; CAMERA_PARAMS]>;

/// A state of a joint problem that is a minimum.
struct Converged<'a> {
    problem: BundleProblem<'a>,
    state: Vec<f64>,
    chi2: f64,
    dof: i64,
    /// Where something had to be asked of it already.
    covariance: Option<BlockCovariance>,
}

/// Everything that is known together: cameras, lenses, landmarks and distances, and the noise.
#[derive(Clone, Debug)]
pub(crate) struct BundleAdjustment<'a> {
    pub(crate) views: Vec<View<'a>>,
    pub(crate) landmarks: Vec<Landmark>,
    pub(crate) measurements: Vec<DistanceMeasurement>,
    /// Whose drawing noise was given; where all of it was, a chi-square is a judgement.
    pub(crate) noise_is_given: Vec<bool>,
}

impl BundleAdjustment<'_> {
    fn noise_is_known(&self) -> bool {
        self.noise_is_given.iter().all(|&given| given)
    }

    /// The joint fit; `None` where the start is impossible.
    pub(crate) fn adjust(&self) -> Option<Adjustment> {
        let mut rejected = Vec::new();
        let mut converged = self.solve_without(&rejected)?;
        // Every wrong landmark costs a search; many wrong ones are a misfit that the operator must see.
        let most = (self.landmarks.len() / 10).clamp(1, 20);
        while rejected.len() < most && converged.has_outliers() {
            let Some((candidate, without)) = self.worst_outlier(&converged, &rejected) else { break };
            let explains = !is_misfit(without.chi2, without.dof);
            let count = self.landmarks.len() + self.measurements.len();
            let stark = is_significant(converged.chi2, without.chi2, without.dof, count);
            if !(stark || explains && (self.noise_is_known() || rejected.is_empty())) {
                break;
            }
            rejected.push(candidate);
            converged = without;
        }
        Some(self.finish(converged, rejected))
    }

    /// Landmarks and distances with some of them rejected.
    fn without(&self, rejected: &[OutlierCandidate]) -> (Vec<Landmark>, Vec<DistanceMeasurement>) {
        let (mut landmarks, mut measurements) = (self.landmarks.clone(), self.measurements.clone());
        for candidate in rejected {
            match *candidate {
                OutlierCandidate::Landmark(landmark) => {
                    landmarks[landmark].off = true;
                    measurements
                        .iter_mut()
                        .filter(|measurement| measurement.between.contains(&landmark))
                        .for_each(|measurement| measurement.off = true);
                }
                OutlierCandidate::Distance(measurement) => measurements[measurement].off = true,
            }
        }
        (landmarks, measurements)
    }

    /// The minimum without what is rejected. The weak prior about a focal enters where nothing else
    /// tells it, links included.
    fn solve_without(&self, rejected: &[OutlierCandidate]) -> Option<Converged<'_>> {
        let weak_prior_used: Vec<Option<Prior>> =
            self.views.iter().map(|view| view.stage_1.priors.weak_log_focal).collect();
        let with = |which: &dyn Fn(usize) -> bool| {
            let mut views = self.views.clone();
            for (index, view) in views.iter_mut().enumerate() {
                view.stage_1.priors.weak_log_focal = weak_prior_used[index].filter(|_| which(index));
            }
            let (landmarks, measurements) = self.without(rejected);
            BundleProblem::new(views, landmarks, measurements)
        };
        if weak_prior_used.iter().all(Option::is_none) {
            return converged(with(&|_| false));
        }
        let Some(alone) = converged(with(&|_| false)) else { return converged(with(&|_| true)) };
        let asked: Vec<(usize, (usize, usize))> = (0..self.views.len())
            .filter(|&view| weak_prior_used[view].is_some())
            .filter_map(|view| Some((view, alone.problem.camera_layout(view)[Covariance::FOCAL]?)))
            .collect();
        let covariance = alone.covariance();
        let mut open = vec![false; self.views.len()];
        for (view, (block, place)) in asked {
            let own = covariance.as_ref().map(|known| known.block(&alone.problem.blocks, block, block));
            // A focal is as sure as the variance of its log; not a number is not sure.
            open[view] = !own.is_some_and(|own| own[(place, place)] < OPEN_FOCAL * OPEN_FOCAL);
        }
        if open.contains(&true) {
            converged(with(&|view| open[view]))
        } else {
            Some(Converged { covariance, ..alone })
        }
    }

    /// What the rest agrees best without, with the minimum there.
    fn worst_outlier(
        &self,
        converged: &Converged,
        rejected: &[OutlierCandidate],
    ) -> Option<(OutlierCandidate, Converged<'_>)> {
        // Exact where it is cheap; a big network has the redundancy to show it by the residual alone.
        let most = (4000 / converged.problem.blocks.unknowns().max(1)).clamp(1, 8);
        let mut candidates = converged.candidates();
        candidates.truncate(most);
        let tried = candidates.into_iter().filter_map(|candidate| {
            let without: Vec<OutlierCandidate> = rejected.iter().copied().chain([candidate]).collect();
            let found = self.solve_without(&without)?;
            (found.dof >= 1).then_some((candidate, found))
        });
        tried.min_by(|a, b| {
            let score = |found: &Converged| chi2_score(found.chi2, found.dof);
            score(&a.1).total_cmp(&score(&b.1))
        })
    }

    fn finish(&self, mut converged: Converged, rejected: Vec<OutlierCandidate>) -> Adjustment {
        let covariance = converged.covariance.take().or_else(|| converged.covariance());
        let Converged { problem, state, chi2, dof, .. } = converged;
        let misfit = is_misfit(chi2, dof);
        let inflation = if self.noise_is_known() { 1.0 } else { inflation(chi2, dof) };
        let mut residuals = Vec::new();
        let _ = problem.each_residual(&state, |residual, _, of| residuals.push((of, residual)));
        let mut cameras: Vec<Camera> = (0..problem.views.len())
            .map(|view| {
                let camera = problem.camera(&state, view);
                let is_free = problem.camera_layout(view)[Covariance::YAW].is_some();
                let yaw = if is_free { wrapped(camera.yaw) } else { camera.yaw };
                Camera { yaw, covariance: Covariance::EXACT, ..camera }
            })
            .collect();
        // Noise that was given is used as it is.
        let inflated = |views: [usize; 2]| -> f64 {
            views.iter().map(|&view| if self.noise_is_given[view] { 1.0 } else { inflation.sqrt() }).product()
        };
        let mut pairs = Vec::new();
        if let Some(covariance) = &covariance {
            let all: Vec<CrossCovariance> = (0..cameras.len())
                .map(|view| {
                    cross_covariance(&problem, covariance, [view, view], &cameras, inflated([view, view]))
                })
                .collect();
            for (camera, own) in cameras.iter_mut().zip(all) {
                camera.covariance = Covariance(*own);
            }
            let coupled: std::collections::BTreeSet<[usize; 2]> = problem
                .landmarks
                .iter()
                .filter(|landmark| !landmark.off)
                .flat_map(|landmark| {
                    let views = landmark.views();
                    let pairs = |i: usize| views[i + 1..].iter().map(|&b| [views[i], b]).collect::<Vec<_>>();
                    (0..views.len()).flat_map(pairs).collect::<Vec<_>>()
                })
                .collect();
            pairs = coupled
                .into_iter()
                .map(|pair| (pair, cross_covariance(&problem, covariance, pair, &cameras, inflated(pair))))
                .collect();
        }
        let placed = |landmark: usize| {
            (!problem.landmarks[landmark].off).then(|| LandmarkEstimate {
                place: problem.place(&state, landmark),
                covariance: covariance
                    .as_ref()
                    .map_or([[0.0; LANDMARK_PARAMS]; LANDMARK_PARAMS], |covariance| {
                        place_covariance(&problem, covariance, landmark, inflation)
                    }),
            })
        };
        let places = (0..problem.landmarks.len()).map(placed).collect();
        let nuisance = (0..problem.views.len()).map(|view| problem.nuisance(&state, view)).collect();
        Adjustment { nuisance, cameras, places, chi2, dof, inflation, rejected, misfit, residuals, pairs }
    }
}

/// The same angle between minus and plus half a turn.
fn wrapped(angle: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    (angle + PI).rem_euclid(TAU) - PI
}

fn converged(problem: BundleProblem<'_>) -> Option<Converged<'_>> {
    let Summary { state, cost: chi2, .. } = least_squares(&problem, problem.start(), ROUNDS)?;
    let dof = problem.dof(&state)?;
    Some(Converged { problem, state, chi2, dof, covariance: None })
}

impl Converged<'_> {
    fn covariance(&self) -> Option<BlockCovariance> {
        self.problem.blocks.covariance(self.problem.normal(&self.state)?, OPEN)
    }

    /// What may be rejected with its chi-square and its spare residuals, the worst first.
    fn scores(&self) -> Vec<(OutlierCandidate, f64)> {
        let mut landmarks = vec![0.0; self.problem.landmarks.len()];
        let mut measurements = vec![0.0; self.problem.measurements.len()];
        let _ = self.problem.each_residual(&self.state, |residual, _, of| match of {
            ResidualBlock::Observation { landmark, .. } | ResidualBlock::LandmarkPrior { landmark } => {
                landmarks[landmark] += residual * residual
            }
            ResidualBlock::Distance { measurement } => measurements[measurement] += residual * residual,
            ResidualBlock::Annotation { .. } | ResidualBlock::StraightEdge { .. } | ResidualBlock::Prior => {}
        });
        let landmark = |(index, landmark): (usize, &Landmark)| {
            let free = !landmark.off && !landmark.keep && landmark.redundancy() > 0;
            free.then(|| {
                (OutlierCandidate::Landmark(index), chi2_score(landmarks[index], landmark.redundancy()))
            })
        };
        let measurement = |(index, measurement): (usize, &DistanceMeasurement)| {
            (!measurement.off && !measurement.keep)
                .then(|| (OutlierCandidate::Distance(index), chi2_score(measurements[index], 1)))
        };
        let mut scores: Vec<(OutlierCandidate, f64)> =
            self.problem.landmarks.iter().enumerate().filter_map(landmark).collect();
        scores.extend(self.problem.measurements.iter().enumerate().filter_map(measurement));
        scores.sort_by(|a, b| b.1.total_cmp(&a.1));
        scores
    }

    fn candidates(&self) -> Vec<OutlierCandidate> {
        self.scores().into_iter().map(|(candidate, _)| candidate).collect()
    }

    /// The whole is too far off for drawing noise, or one of the landmarks is, as the worst of so many.
    fn has_outliers(&self) -> bool {
        let scores = self.scores();
        let worst = scores.first().map_or(0.0, |(_, score)| *score);
        let limit = (LEVEL * LEVEL + 2.0 * (scores.len().max(1) as f64).ln()).sqrt();
        is_misfit(self.chi2, self.dof) || worst > limit
    }
}

/// Covariance of the unknowns of two cameras, or of one, with the focal in pixels.
fn cross_covariance(
    problem: &BundleProblem,
    covariance: &BlockCovariance,
    [a, b]: [usize; 2],
    cameras: &[Camera],
    inflation: f64,
) -> CrossCovariance {
    let mut found = Box::new([[0.0; CAMERA_PARAMS]; CAMERA_PARAMS]);
    let mut cache: Vec<([usize; 2], DMatrix<f64>)> = Vec::new();
    for (i, from) in problem.camera_layout(a).iter().enumerate() {
        for (j, to) in problem.camera_layout(b).iter().enumerate() {
            let (Some((p, row)), Some((q, column))) = (from, to) else { continue };
            let known = cache.iter().position(|(pair, _)| *pair == [*p, *q]);
            let at = known.unwrap_or_else(|| {
                cache.push(([*p, *q], covariance.block(&problem.blocks, *p, *q)));
                cache.len() - 1
            });
            let focal = |index: usize, view: usize| {
                if index == Covariance::FOCAL { cameras[view].focal } else { 1.0 }
            };
            found[i][j] = cache[at].1[(*row, *column)] * focal(i, a) * focal(j, b) * inflation;
        }
    }
    found
}

fn place_covariance(
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
