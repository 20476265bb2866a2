//! Refinement of one cluster of cameras: the least-squares estimate without outliers. Undetermined focal
//! lengths get a weak prior. The covariances are computed at the minimum.
//!
//! # Outliers
//!
//! A search for outliers starts if the chi-square of all residuals is too large for the noise. It also starts
//! if the chi-square of one landmark is too large for the maximum over all landmarks. The candidate whose
//! removal gives the least chi-square score (leave-one-out) is rejected on one of two conditions: the rest
//! has no misfit, or the candidate is significant against the scatter of the rest. The search then repeats.
//!
//! # Screening of many landmarks
//!
//! Leave-one-out costs one minimisation per candidate, which is too slow for thousands of landmarks. Where
//! many cameras share many landmarks, every landmark is checked by many others. Its own residuals then show
//! whether it is an outlier (data snooping: Baarda 1968, "A Testing Procedure for Use in Geodetic Networks"),
//! and an outlier affects only the residuals of its own cameras. Therefore each round rejects every candidate
//! that satisfies both conditions:
//!
//! - Its chi-square is too large for the maximum over all candidates. The variances are scaled by the median
//!   chi-square of the candidates, so that up to half of them may be wrong.
//! - Its chi-square per degree of freedom is at least a quarter of the largest one in each of its cameras. This
//!   corresponds to half the residual in pixels. A candidate that is pulled by a worse outlier waits for the next
//!   round.
//!
//! The largest residual of a camera at least halves in each round. The number of rounds is therefore the
//! base-2 logarithm of the ratio of a gross error to the noise, however many landmarks are wrong. At the end
//! every rejected landmark is triangulated from the remaining cameras, and restored if they agree about it.
//!
//! # Suspects
//!
//! Two wrong control points can hide each other, so that leaving out one of them changes little. A robust fit
//! of the camera finds such points beforehand (`single/point_fit.rs`). They start rejected, and are restored
//! in the same way.

use crate::bundle::camera::View;
use crate::bundle::converged::{
    Converged, CrossCovariance, LandmarkEstimate, Marginals, OutlierCandidate, PlaneEstimate, Scored,
    converged, nearly_converged, outlier_score_limit,
};
use crate::bundle::copies::Copies;
use crate::bundle::landmark::{DistanceMeasurement, LANDMARK_PARAMS, Landmark};
use crate::bundle::problem::BundleProblem;
use crate::bundle::reliability::{Observed, Reliability, reliabilities};
use crate::bundle::residuals::{ResidualKind, distance_residual};
use crate::bundle::triangulation::triangulate;
use crate::camera::{Camera, Covariance, ObservedPixel, PosedCamera};
use crate::optimize::{chi2_median_per_dof, chi2_score, is_misfit, product, pseudo_invert};
use crate::single::{PlanePrior, Prior, inflation, is_significant, student_factor};

/// Minimum chi-square per degree of freedom of a suspect, as a fraction of the largest such value in each of its
/// cameras.
const MIN_SHARE_OF_LARGEST_CHI2: f64 = 0.25;

impl Converged<'_> {
    /// Returns the candidates to reject in this round, the worst first.
    pub(crate) fn suspects(&self) -> Vec<OutlierCandidate> {
        let candidates = self.candidates();
        let factor = typical_factor(&candidates);
        let limit = outlier_score_limit(candidates.len());
        let mut largest = vec![0.0_f64; self.problem.views.len()];
        for scored in &candidates {
            for view in self.views_of(scored.candidate) {
                largest[view] = largest[view].max(scored.per_dof());
            }
        }
        let is_suspect = |scored: &&Scored| {
            let mut views = self.views_of(scored.candidate).into_iter();
            let is_among_largest =
                |view: usize| scored.per_dof() >= MIN_SHARE_OF_LARGEST_CHI2 * largest[view];
            scored.score(factor) > limit && views.all(is_among_largest)
        };
        let mut suspects: Vec<&Scored> = candidates.iter().filter(is_suspect).collect();
        suspects.sort_by(|a, b| b.per_dof().total_cmp(&a.per_dof()));
        suspects.into_iter().map(|scored| scored.candidate).collect()
    }

    /// Whether a rejected candidate is consistent with `cameras`, so that it can be restored. The assumed variances
    /// are multiplied by `factor`.
    pub(crate) fn agrees_with(&self, rejected: OutlierCandidate, cameras: &[Camera], factor: f64) -> bool {
        let count = self.problem.landmarks.len() + self.problem.distances.len();
        let scored = match rejected {
            OutlierCandidate::Landmark(index) => {
                let landmark = &self.problem.landmarks[index];
                let ground = self.problem.ground(self.state(), index).0;
                let landmark = Landmark { ground, ..landmark.clone() };
                triangulated_chi2(&landmark, cameras).map(|chi2| (chi2, landmark.redundancy()))
            }
            OutlierCandidate::Distance(index) => Some((self.distance_residual(index).powi(2), 1)),
        };
        scored.is_some_and(|(chi2, dof)| {
            Scored { candidate: rejected, chi2, dof }.score(factor) <= outlier_score_limit(count)
        })
    }

    fn distance_residual(&self, index: usize) -> f64 {
        let distance = &self.problem.distances[index];
        let end = |landmark: usize| {
            let ground = self.problem.ground(self.state(), landmark).0;
            let params = self.problem.landmark_params(self.state(), landmark);
            self.problem.landmarks[landmark].model.anchor(&params, &ground)
        };
        distance_residual(distance, &distance.between.map(end)).0
    }

    /// Returns the views that observe a candidate, or the ends of a distance.
    fn views_of(&self, candidate: OutlierCandidate) -> Vec<usize> {
        let landmarks = &self.problem.landmarks;
        match candidate {
            OutlierCandidate::Landmark(index) => landmarks[index].views(),
            OutlierCandidate::Distance(index) => {
                self.problem.distances[index].between.iter().flat_map(|&end| landmarks[end].views()).collect()
            }
        }
    }
}

impl Scored {
    fn per_dof(&self) -> f64 {
        self.chi2 / self.dof as f64
    }
}

/// Returns the factor by which the assumed variances are multiplied to explain the median chi-square of the
/// candidates; at least 1.
fn typical_factor(candidates: &[Scored]) -> f64 {
    let mut factors: Vec<f64> =
        candidates.iter().map(|scored| scored.per_dof() / chi2_median_per_dof(scored.dof as f64)).collect();
    factors.sort_by(f64::total_cmp);
    factors.get(factors.len() / 2).map_or(1.0, |median| median.max(1.0))
}

/// Returns the least chi-square of a landmark for these fixed cameras; `None` if one of them cannot see it.
fn triangulated_chi2(landmark: &Landmark, cameras: &[Camera]) -> Option<f64> {
    /// Number of Gauss-Newton steps; the initial position from the nearest camera is close enough for them to
    /// converge.
    const STEPS: usize = 5;
    let (model, mut params) = triangulate(landmark, cameras, &|_| true)?;
    let landmark = Landmark { model, ..landmark.clone() };
    let mut least = LandmarkNormal::new(&landmark, &params, cameras)?;
    let mut step = Vec::new();
    for _ in 0..STEPS {
        pseudo_invert(&mut least.square, LANDMARK_PARAMS);
        product(&least.square, &least.gradient, LANDMARK_PARAMS, &mut step);
        let next = std::array::from_fn(|k| params[k] - step[k]);
        match LandmarkNormal::new(&landmark, &next, cameras) {
            Some(normal) if normal.chi2 < least.chi2 => (least, params) = (normal, next),
            _ => break,
        }
    }
    Some(least.chi2)
}

/// Normal equations of one landmark with fixed cameras.
struct LandmarkNormal {
    chi2: f64,
    square: [f64; LANDMARK_PARAMS * LANDMARK_PARAMS],
    gradient: [f64; LANDMARK_PARAMS],
}

impl LandmarkNormal {
    fn new(landmark: &Landmark, params: &[f64; LANDMARK_PARAMS], cameras: &[Camera]) -> Option<Self> {
        let mut normal = Self { chi2: 0.0, square: Default::default(), gradient: Default::default() };
        for seen in &landmark.observations {
            let camera = cameras[seen.view];
            let observed = ObservedPixel::new(seen.pixel, &camera.lens)?;
            let pose = PosedCamera::new(camera);
            for error in
                landmark.model.reprojection_error(params, seen.point, &landmark.ground, &pose, &observed)?
            {
                normal.add(error.pixels / seen.sigma, error.d_landmark.map(|by| by / seen.sigma), landmark);
            }
        }
        for (k, prior) in &landmark.priors {
            let mut by = [0.0; LANDMARK_PARAMS];
            by[*k] = prior.sigma.recip();
            normal.add((params[*k] - prior.value) / prior.sigma, by, landmark);
        }
        normal.chi2.is_finite().then_some(normal)
    }

    fn add(&mut self, residual: f64, by: [f64; LANDMARK_PARAMS], landmark: &Landmark) {
        let by: [f64; LANDMARK_PARAMS] = std::array::from_fn(|k| if landmark.free[k] { by[k] } else { 0.0 });
        self.chi2 += residual * residual;
        for i in 0..LANDMARK_PARAMS {
            self.gradient[i] += by[i] * residual;
            for j in 0..LANDMARK_PARAMS {
                self.square[i * LANDMARK_PARAMS + j] += by[i] * by[j];
            }
        }
    }
}

/// Minimum number of landmarks for screening; with fewer, only leave-one-out rejects outliers.
const MIN_LANDMARKS_FOR_SCREENING: usize = 200;

/// Result of the refinement of one cluster of cameras.
#[derive(Clone, Debug)]
pub(crate) struct Refined {
    /// Cameras with the covariance of their estimated parameters.
    pub(crate) cameras: Vec<Camera>,
    /// Estimate of every landmark; `None` if the landmark was not used.
    pub(crate) landmarks: Vec<Option<LandmarkEstimate>>,
    pub(crate) chi2: f64,
    pub(crate) dof: i64,
    /// Factor of the variances of annotated coordinates whose noise was not given.
    pub(crate) inflation: f64,
    pub(crate) rejected: Vec<OutlierCandidate>,
    /// Whether the chi-square is too large for the noise and no outlier explains it.
    pub(crate) is_misfit: bool,
    /// Kind and value of every residual; values in standard deviations.
    pub(crate) residuals: Vec<(ResidualKind, f64)>,
    /// Nuisance parameters of stage 1 (directions and lengths) of every view.
    pub(crate) nuisances: Vec<Vec<f64>>,
    /// Estimate of every plane of the problem; `None` for a plane that is fixed or has no covariance.
    pub(crate) planes: Vec<Option<PlaneEstimate>>,
    /// Cross-covariances of correlated cameras.
    pub(crate) pairs: Vec<([usize; 2], CrossCovariance)>,
    /// Reliability of every annotation and observation that was used, ascending.
    pub(crate) reliabilities: Vec<(Observed, Reliability)>,
}

/// Initialised cluster of cameras with their landmarks and distances; indices refer to the cluster.
#[derive(Clone, Debug)]
pub(crate) struct Refinement<'a> {
    pub(crate) views: Vec<View<'a>>,
    pub(crate) landmarks: Vec<Landmark>,
    pub(crate) distances: Vec<DistanceMeasurement>,
    /// Numbers of copies of the landmarks and distances. The standard deviations of `landmarks` and `distances`
    /// already include these numbers.
    pub(crate) copies: Copies,
    /// Planes other than the floor.
    pub(crate) planes: Vec<PlanePrior>,
    /// Flags of the views whose noise was given. If it was given for all views, the chi-square is a test of the fit.
    pub(crate) noise_is_known: Vec<bool>,
    /// Whether the reliability of every annotation and observation is computed.
    pub(crate) with_reliability: bool,
}

/// Minimum of the adjustment after the rejection of gross outliers.
struct Screened<'a> {
    rejected: Vec<OutlierCandidate>,
    converged: Converged<'a>,
    /// Whether a tenth of the landmarks was rejected and gross outliers remain. Leave-one-out cannot explain
    /// the misfit then.
    is_exhausted: bool,
}

impl Refinement<'_> {
    /// Returns the refined cluster; `None` if the initial state is geometrically impossible.
    pub(crate) fn solve(&self) -> Option<Refined> {
        let Screened { mut rejected, mut converged, is_exhausted } =
            if self.landmarks.len() >= MIN_LANDMARKS_FOR_SCREENING {
                self.screened()?
            } else {
                self.unscreened()?
            };
        // Every rejection costs a search. After a tenth of the landmarks (1 to 20), the rest is reported as a misfit.
        let more = if is_exhausted { 0 } else { (self.landmarks.len() / 10).clamp(1, 20) };
        let max_rejected = rejected.len() + more;
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

    /// Returns the reliability of every annotation and observation. No outlier is rejected.
    pub(crate) fn reliabilities(&self) -> Vec<(Observed, Reliability)> {
        let found = self.solve_without(&[], None).and_then(|mut converged| {
            let covariance = converged.covariance.take().or_else(|| converged.covariance())?;
            Some(reliabilities(&converged, &covariance, &vec![1.0; self.views.len()]))
        });
        found.unwrap_or_default()
    }

    /// Returns the minimum with all landmarks and distances, except the suspects that contradict it.
    fn unscreened(&self) -> Option<Screened<'_>> {
        let suspects = self.suspects();
        let without = if suspects.is_empty() { None } else { self.solve_without(&suspects, None) };
        if let Some(without) = without.filter(|found| found.dof >= 1) {
            let rejected = self.contradictory(&without, suspects.clone());
            let is_same = rejected.len() == suspects.len();
            let converged = if is_same { without } else { self.solve_without(&rejected, Some(&without))? };
            return Some(Screened { rejected, converged, is_exhausted: false });
        }
        let converged = self.solve_without(&[], None)?;
        Some(Screened { rejected: Vec::new(), converged, is_exhausted: false })
    }

    /// Returns the landmarks that a robust fit of their camera contradicts.
    fn suspects(&self) -> Vec<OutlierCandidate> {
        let is_suspect = |landmark: &Landmark| landmark.is_suspect && !landmark.off && !landmark.keep;
        let all = (0..self.landmarks.len()).filter(|&index| is_suspect(&self.landmarks[index]));
        all.map(OutlierCandidate::Landmark).collect()
    }

    /// Returns the rejected candidates that do not agree with the refined cameras.
    fn contradictory(&self, found: &Converged, mut rejected: Vec<OutlierCandidate>) -> Vec<OutlierCandidate> {
        let factor = if self.all_noise_is_known() { 1.0 } else { inflation(found.chi2, found.dof) };
        let cameras: Vec<Camera> = (0..self.views.len()).map(|view| found.camera(view)).collect();
        rejected.retain(|&candidate| !found.agrees_with(candidate, &cameras, factor));
        rejected
    }

    /// Rejects gross outliers, and returns the minimum without them. Their number is at most a tenth of the
    /// number of landmarks. Rejected candidates that agree with the refined cameras are restored.
    fn screened(&self) -> Option<Screened<'_>> {
        let has_weak_prior = self.has_weak_prior();
        let most = self.landmarks.len() / 10;
        let mut rejected = self.suspects();
        let mut found = nearly_converged(self.problem(&rejected, &has_weak_prior, None))?;
        let is_exhausted = loop {
            let suspects = found.suspects();
            let room = most.saturating_sub(rejected.len());
            if suspects.is_empty() || room == 0 {
                break !suspects.is_empty();
            }
            rejected.extend(suspects.into_iter().take(room));
            found = nearly_converged(self.problem(
                &rejected,
                &has_weak_prior,
                Some((&found.problem, found.state())),
            ))?;
        };
        let count = rejected.len();
        let rejected = self.contradictory(&found, rejected);
        let is_same = rejected.len() == count;
        let converged = if is_same {
            self.continue_without_weak_priors(&rejected, found)?
        } else {
            self.solve_without(&rejected, Some(&found))?
        };
        Some(Screened { rejected, converged, is_exhausted })
    }

    /// Returns a flag for every view: whether it has a weak prior on the focal length.
    fn has_weak_prior(&self) -> Vec<bool> {
        self.views.iter().map(|view| view.stage_1.priors.weak_log_focal.is_some()).collect()
    }

    fn all_noise_is_known(&self) -> bool {
        self.noise_is_known.iter().all(|&is_known| is_known)
    }

    /// Whether a candidate is an outlier. `with` is the minimum with the candidate, and `without` the minimum without
    /// it. The candidate is an outlier if it is significant against the scatter of the rest, or if its rejection
    /// explains the misfit. If some noise is unknown, the second condition applies to the first rejection only.
    fn is_outlier(&self, with: &Converged, without: &Converged, is_first: bool) -> bool {
        let count = self.landmarks.len() + self.distances.len();
        let explains = !is_misfit(without.chi2, without.dof);
        is_significant(with.chi2, without.chi2, without.dof, count)
            || (explains && (self.all_noise_is_known() || is_first))
    }

    /// Copies the landmarks and distances, and switches off the rejected ones and the distances to rejected
    /// landmarks.
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

    /// Returns the minimum without the rejected candidates, starting from another minimum or from the initial
    /// state. The weak prior on a focal length is used only if all other residuals, including landmarks,
    /// determine it poorly.
    fn solve_without(
        &self,
        rejected: &[OutlierCandidate],
        from: Option<&Converged>,
    ) -> Option<Converged<'_>> {
        let has_weak_prior = self.has_weak_prior();
        let none = vec![false; self.views.len()];
        let from = from.map(|found| (&found.problem, found.state()));
        let Some(mut without_prior) = converged(self.problem(rejected, &none, from)) else {
            let with_priors = || converged(self.problem(rejected, &has_weak_prior, from));
            return has_weak_prior.contains(&true).then(with_priors).flatten();
        };
        match self.undetermined_focals(&mut without_prior) {
            Some(is_open) => converged(self.problem(rejected, &is_open, from)),
            None => Some(without_prior),
        }
    }

    /// Returns the same minimum as `solve_without`. It starts from `found`, a nearby state that was computed with the
    /// weak priors.
    fn continue_without_weak_priors<'a>(
        &'a self,
        rejected: &[OutlierCandidate],
        found: Converged<'a>,
    ) -> Option<Converged<'a>> {
        let start = found.state().to_vec();
        let Some(mut without_prior) = found.without_weak_priors() else {
            return self.solve_without(rejected, None);
        };
        match self.undetermined_focals(&mut without_prior) {
            Some(is_open) => {
                converged(self.problem(rejected, &is_open, Some((&without_prior.problem, &start))))
            }
            None => Some(without_prior),
        }
    }

    /// Returns a flag for every view: whether its focal length is poorly determined at a minimum without weak
    /// priors. Returns `None` if no flag is set.
    fn undetermined_focals(&self, without_prior: &mut Converged) -> Option<Vec<bool>> {
        let has_weak_prior = self.has_weak_prior();
        if !has_weak_prior.contains(&true) {
            return None;
        }
        without_prior.covariance = without_prior.covariance();
        let is_open = |view: usize| has_weak_prior[view] && without_prior.weak_prior_matters(view);
        let is_open: Vec<bool> = (0..self.views.len()).map(is_open).collect();
        is_open.contains(&true).then_some(is_open)
    }

    /// Builds the problem without the rejected candidates and with the weak priors of the flagged views. It
    /// starts from the initial state, or from the state of another problem.
    fn problem(
        &self,
        rejected: &[OutlierCandidate],
        with_weak_prior: &[bool],
        from: Option<(&BundleProblem, &[f64])>,
    ) -> BundleProblem<'_> {
        let (mut views, (mut landmarks, distances)) = (self.views.clone(), self.without(rejected));
        if let Some((problem, state)) = from {
            for (index, view) in views.iter_mut().enumerate() {
                view.camera = problem.camera(state, index);
                view.nuisance = problem.nuisance(state, index);
            }
            let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
            for (index, landmark) in landmarks.iter_mut().enumerate() {
                landmark.model.clone_from(&problem.landmarks[index].model);
                landmark.params = problem.landmark_params(state, index);
                let is_back = problem.landmarks[index].off && !landmark.off;
                if let Some(found) = is_back.then(|| triangulate(landmark, &cameras, &|_| true)).flatten() {
                    (landmark.model, landmark.params) = found;
                }
            }
        }
        for (view, with) in views.iter_mut().zip(with_weak_prior) {
            let weak: Option<Prior> = view.stage_1.priors.weak_log_focal.filter(|_| *with);
            view.stage_1.priors.weak_log_focal = weak;
        }
        let shared = (landmarks, distances, self.copies.clone());
        BundleProblem::new(views, shared, self.planes.clone())
    }

    /// Returns the candidate whose removal gives the least chi-square score, with the minimum without it.
    fn worst_outlier(
        &self,
        converged: &Converged,
        rejected: &[OutlierCandidate],
    ) -> Option<(OutlierCandidate, Converged<'_>)> {
        // Leave-one-out is exact and is used if it is cheap. A large network has enough redundancy to rank
        // the candidates by residual. The removal of one of many landmarks moves the minimum only slightly, so
        // each minimisation starts from it.
        let max_tried = (4000 / converged.problem.blocks.unknowns().max(1)).clamp(1, 8);
        let from = (self.landmarks.len() >= MIN_LANDMARKS_FOR_SCREENING).then_some(converged);
        let tried = converged.worst_first().into_iter().take(max_tried).filter_map(|scored| {
            let without: Vec<OutlierCandidate> = rejected.iter().copied().chain([scored.candidate]).collect();
            let found = self.solve_without(&without, from)?;
            (found.dof >= 1).then_some((scored.candidate, found))
        });
        let score = |found: &Converged| chi2_score(found.chi2, found.dof as f64);
        tried.min_by(|a, b| score(&a.1).total_cmp(&score(&b.1)))
    }

    fn finish(&self, mut converged: Converged, rejected: Vec<OutlierCandidate>) -> Refined {
        let covariance = converged.covariance.take().or_else(|| converged.covariance());
        let residuals = std::mem::take(&mut converged.residuals);
        let (problem, state) = (&converged.problem, converged.state());
        let Converged { chi2, dof, .. } = &converged;
        let inflation = if self.all_noise_is_known() { 1.0 } else { inflation(*chi2, *dof) };
        // Student's factor, because few residuals determine the noise.
        let spread = if inflation > 1.0 { inflation.sqrt() * student_factor(*dof) } else { 1.0 };
        let mut cameras: Vec<Camera> = (0..problem.views.len()).map(|view| converged.camera(view)).collect();
        let mut pairs = Vec::new();
        let mut reliability = Vec::new();
        if let Some(covariance) = &covariance {
            // Given noise is not scaled.
            let factors: Vec<f64> =
                self.noise_is_known.iter().map(|&known| if known { 1.0 } else { spread }).collect();
            if self.with_reliability {
                reliability = reliabilities(&converged, covariance, &factors);
            }
            let between = converged.covariance_between_cameras();
            let (inflation, between) = (&factors[..], between.as_ref());
            let marginals = Marginals { problem, covariance, cameras: &cameras, inflation, between };
            let own: Vec<CrossCovariance> =
                (0..cameras.len()).map(|view| marginals.camera_covariance([view, view])).collect();
            pairs = marginals.camera_pair_covariances();
            cameras.iter_mut().zip(own).for_each(|(camera, own)| camera.covariance = Covariance(*own));
        }
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
            reliabilities: reliability,
        }
    }
}
