//! Refinement of one cluster of cameras: the least-squares estimate without outliers, with weak priors on the
//! focals that are not determined otherwise, and the covariances there.
//!
//! Outliers are searched for where the chi-square of all residuals is too large for the noise, or that of one
//! landmark, as the largest of many. The candidate without which the rest has the least chi-square score
//! (leave-one-out) is rejected, if the rest has no misfit or the candidate is significant against its
//! scatter; then again. Of many landmarks those that are plainly wrong go before, several at once
//! (`screening.rs`).
//!
//! Screening of many landmarks for outliers, several a round.
//!
//! Leave-one-out costs a minimisation for every candidate, which few landmarks can afford to need and thousands
//! cannot. Where many cameras share much, every landmark is checked by so many others that its own residuals
//! tell whether it is wrong (data snooping: Baarda 1968, "A Testing Procedure for Use in Geodetic Networks"), and
//! an outlier spoils the residuals of its own cameras only. So in every round a candidate is a suspect if
//!
//! - its chi-square is too large as the largest of so many, with the variances that the median of all residuals
//!   tells: half of the landmarks may be wrong before that follows them; and
//! - it is no less than a quarter of the largest of any of its cameras: half the residual in pixels. What is
//!   pulled by a worse one waits for the round after that is gone.
//!
//! The largest residual of a camera falls by half in a round, so that there are as many rounds as there are bits
//! in the ratio of a gross error to the noise, however many are wrong. At the end each is located from the
//! cameras without it, and comes back where they agree about it after all.

use crate::bundle::camera::View;
use crate::bundle::converged::{
    Converged, CrossCovariance, LandmarkEstimate, Marginals, OutlierCandidate, PlaneEstimate, Scored,
    converged, largest_of, nearly_converged,
};
use crate::bundle::copies::Copies;
use crate::bundle::landmark::{DistanceMeasurement, LANDMARK_PARAMS, Landmark};
use crate::bundle::problem::BundleProblem;
use crate::bundle::residuals::{ResidualKind, distance_residual};
use crate::bundle::triangulation::triangulate;
use crate::camera::{Camera, Covariance, ObservedPixel, PosedCamera};
use crate::optimize::{chi2_median_per_dof, chi2_score, is_misfit, product, pseudo_invert};
use crate::single::{PlanePrior, Prior, inflation, is_significant, student_factor};

/// Share of the largest chi-square of its cameras that a suspect has.
const OF_THE_LARGEST: f64 = 0.25;

impl Converged<'_> {
    /// What is to be rejected at once, the worst first.
    pub(crate) fn suspects(&self) -> Vec<OutlierCandidate> {
        let candidates = self.candidates();
        let factor = typical_factor(&candidates);
        let limit = largest_of(candidates.len());
        let mut largest = vec![0.0_f64; self.problem.views.len()];
        for scored in &candidates {
            for view in self.views_of(scored.candidate) {
                largest[view] = largest[view].max(scored.per_dof());
            }
        }
        let is_suspect = |scored: &&Scored| {
            let mut views = self.views_of(scored.candidate).into_iter();
            let is_among_largest = |view: usize| scored.per_dof() >= OF_THE_LARGEST * largest[view];
            scored.score(factor) > limit && views.all(is_among_largest)
        };
        let mut suspects: Vec<&Scored> = candidates.iter().filter(is_suspect).collect();
        suspects.sort_by(|a, b| b.per_dof().total_cmp(&a.per_dof()));
        suspects.into_iter().map(|scored| scored.candidate).collect()
    }

    /// Whether the cameras agree about what was rejected, with variances `factor` times those assumed.
    pub(crate) fn agrees_with(&self, rejected: OutlierCandidate, cameras: &[Camera], factor: f64) -> bool {
        let count = self.problem.landmarks.len() + self.problem.distances.len();
        let scored = match rejected {
            OutlierCandidate::Landmark(index) => {
                let landmark = &self.problem.landmarks[index];
                let ground = self.problem.ground(self.state(), index).0;
                let landmark = Landmark { ground, ..landmark.clone() };
                located_chi2(&landmark, cameras).map(|chi2| (chi2, landmark.redundancy()))
            }
            OutlierCandidate::Distance(index) => Some((self.distance_residual(index).powi(2), 1)),
        };
        scored.is_some_and(|(chi2, dof)| {
            Scored { candidate: rejected, chi2, dof }.score(factor) <= largest_of(count)
        })
    }

    fn distance_residual(&self, index: usize) -> f64 {
        let distance = &self.problem.distances[index];
        let end = |landmark: usize| {
            let ground = self.problem.ground(self.state(), landmark).0;
            let place = self.problem.place(self.state(), landmark);
            self.problem.landmarks[landmark].model.anchor(&place, &ground)
        };
        distance_residual(distance, &distance.between.map(end)).0
    }

    /// The views that a candidate is seen by, or its ends.
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

/// The factor of the assumed variances that the median of the chi-squares tells, at least 1.
///
fn typical_factor(candidates: &[Scored]) -> f64 {
    let mut factors: Vec<f64> =
        candidates.iter().map(|scored| scored.per_dof() / chi2_median_per_dof(scored.dof as f64)).collect();
    factors.sort_by(f64::total_cmp);
    factors.get(factors.len() / 2).map_or(1.0, |median| median.max(1.0))
}

/// The least chi-square of a landmark that these cameras observe; `None` where one of them cannot see it.
fn located_chi2(landmark: &Landmark, cameras: &[Camera]) -> Option<f64> {
    /// Gauss-Newton from the place that the nearest camera gives converges at once.
    const STEPS: usize = 5;
    let (model, mut place) = triangulate(landmark, cameras, &|_| true)?;
    let landmark = Landmark { model, ..landmark.clone() };
    let mut least = LandmarkNormal::new(&landmark, &place, cameras)?;
    let mut step = Vec::new();
    for _ in 0..STEPS {
        pseudo_invert(&mut least.square, LANDMARK_PARAMS);
        product(&least.square, &least.gradient, LANDMARK_PARAMS, &mut step);
        let next = std::array::from_fn(|k| place[k] - step[k]);
        match LandmarkNormal::new(&landmark, &next, cameras) {
            Some(normal) if normal.chi2 < least.chi2 => (least, place) = (normal, next),
            _ => break,
        }
    }
    Some(least.chi2)
}

/// The normal equations of one landmark with its cameras held.
struct LandmarkNormal {
    chi2: f64,
    square: [f64; LANDMARK_PARAMS * LANDMARK_PARAMS],
    gradient: [f64; LANDMARK_PARAMS],
}

impl LandmarkNormal {
    fn new(landmark: &Landmark, place: &[f64; LANDMARK_PARAMS], cameras: &[Camera]) -> Option<Self> {
        let mut normal = Self { chi2: 0.0, square: Default::default(), gradient: Default::default() };
        for seen in &landmark.observations {
            let camera = cameras[seen.view];
            let observed = ObservedPixel::new(seen.pixel, &camera.lens)?;
            let pose = PosedCamera::new(camera);
            for error in
                landmark.model.reprojection_error(place, seen.point, &landmark.ground, &pose, &observed)?
            {
                normal.add(error.pixels / seen.sigma, error.d_landmark.map(|by| by / seen.sigma), landmark);
            }
        }
        for (k, prior) in &landmark.priors {
            let mut by = [0.0; LANDMARK_PARAMS];
            by[*k] = prior.sigma.recip();
            normal.add((place[*k] - prior.value) / prior.sigma, by, landmark);
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

/// Landmarks from which on they are screened.
const SCREENED_FROM: usize = 200;

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
    /// Covariance of cameras that err together.
    pub(crate) pairs: Vec<([usize; 2], CrossCovariance)>,
}

/// A cluster of cameras with what they observe, initialised; indices are those within the cluster.
#[derive(Clone, Debug)]
pub(crate) struct Refinement<'a> {
    pub(crate) views: Vec<View<'a>>,
    pub(crate) landmarks: Vec<Landmark>,
    pub(crate) distances: Vec<DistanceMeasurement>,
    /// How often landmarks and distances are there, which are widened by that already.
    pub(crate) copies: Copies,
    /// Planes besides the floor.
    pub(crate) planes: Vec<PlanePrior>,
    /// Of which views the noise was given; where it is of all, a chi-square is a test of the fit.
    pub(crate) noise_is_known: Vec<bool>,
}

/// A minimum without what is plainly wrong.
struct Screened<'a> {
    rejected: Vec<OutlierCandidate>,
    converged: Converged<'a>,
    /// A tenth was left out, and more is plainly wrong: leaving out one by one explains nothing.
    is_exhausted: bool,
}

impl Refinement<'_> {
    /// `None` where the start is impossible.
    pub(crate) fn solve(&self) -> Option<Refined> {
        let Screened { mut rejected, mut converged, is_exhausted } =
            if self.landmarks.len() >= SCREENED_FROM { self.screened()? } else { self.unscreened()? };
        // Every rejection costs a search; beyond a tenth of the landmarks the fit is reported as a misfit.
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

    /// With everything.
    fn unscreened(&self) -> Option<Screened<'_>> {
        let converged = self.solve_without(&[], None)?;
        Some(Screened { rejected: Vec::new(), converged, is_exhausted: false })
    }

    /// Without what is plainly wrong among many, at most a tenth; what the rest agrees with comes back.
    fn screened(&self) -> Option<Screened<'_>> {
        let has_weak_prior = self.has_weak_prior();
        let most = self.landmarks.len() / 10;
        let mut rejected = Vec::new();
        let mut found = nearly_converged(self.problem(&[], &has_weak_prior, None))?;
        let is_exhausted = loop {
            let suspects = found.suspects();
            let room = most - rejected.len();
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
        let factor = if self.all_noise_is_known() { 1.0 } else { inflation(found.chi2, found.dof) };
        let cameras: Vec<Camera> = (0..self.views.len()).map(|view| found.camera(view)).collect();
        let count = rejected.len();
        rejected.retain(|&candidate| !found.agrees_with(candidate, &cameras, factor));
        let is_same = rejected.len() == count;
        let converged = if is_same {
            self.continued(&rejected, found)?
        } else {
            self.solve_without(&rejected, Some(&found))?
        };
        Some(Screened { rejected, converged, is_exhausted })
    }

    /// Of which views the weak prior on the focal may enter.
    fn has_weak_prior(&self) -> Vec<bool> {
        self.views.iter().map(|view| view.stage_1.priors.weak_log_focal.is_some()).collect()
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

    /// The minimum without the rejected, from another one or from the start. The weak prior on a focal enters
    /// where everything else, the landmarks included, tells little of it.
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
        match self.open_focals(&mut without_prior) {
            Some(is_open) => converged(self.problem(rejected, &is_open, from)),
            None => Some(without_prior),
        }
    }

    /// The same from what a few steps with the weak priors led to.
    fn continued<'a>(&'a self, rejected: &[OutlierCandidate], found: Converged<'a>) -> Option<Converged<'a>> {
        let start = found.state().to_vec();
        let Some(mut without_prior) = found.without_weak_priors() else {
            return self.solve_without(rejected, None);
        };
        match self.open_focals(&mut without_prior) {
            Some(is_open) => {
                converged(self.problem(rejected, &is_open, Some((&without_prior.problem, &start))))
            }
            None => Some(without_prior),
        }
    }

    /// Of which views a weak prior would tell something, at a minimum without any; `None` where of none.
    fn open_focals(&self, without_prior: &mut Converged) -> Option<Vec<bool>> {
        let has_weak_prior = self.has_weak_prior();
        if !has_weak_prior.contains(&true) {
            return None;
        }
        without_prior.covariance = without_prior.covariance();
        let is_open = |view: usize| has_weak_prior[view] && without_prior.prior_tells(view);
        let is_open: Vec<bool> = (0..self.views.len()).map(is_open).collect();
        is_open.contains(&true).then_some(is_open)
    }

    /// The problem without what is rejected, with the weak priors of the flagged views, at the start or where
    /// another one converged.
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
                landmark.place = problem.place(state, index);
                let is_back = problem.landmarks[index].off && !landmark.off;
                if let Some(found) = is_back.then(|| triangulate(landmark, &cameras, &|_| true)).flatten() {
                    (landmark.model, landmark.place) = found;
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

    /// The candidate without which the rest has the least chi-square score, with the minimum there.
    fn worst_outlier(
        &self,
        converged: &Converged,
        rejected: &[OutlierCandidate],
    ) -> Option<(OutlierCandidate, Converged<'_>)> {
        // Leave-one-out is exact and used where it is cheap; a large network has the redundancy for the
        // residuals to rank the candidates, and one of many landmarks moves the minimum too little to lead to
        // another.
        let max_tried = (4000 / converged.problem.blocks.unknowns().max(1)).clamp(1, 8);
        let from = (self.landmarks.len() >= SCREENED_FROM).then_some(converged);
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
        // Student's, where few residuals tell the noise.
        let spread = if inflation > 1.0 { inflation.sqrt() * student_factor(*dof) } else { 1.0 };
        let mut cameras: Vec<Camera> = (0..problem.views.len()).map(|view| converged.camera(view)).collect();
        let mut pairs = Vec::new();
        if let Some(covariance) = &covariance {
            // Noise that was given is not scaled.
            let factors: Vec<f64> =
                self.noise_is_known.iter().map(|&known| if known { 1.0 } else { spread }).collect();
            let between = converged.covariance_between_cameras();
            let (inflation, between) = (&factors[..], between.as_ref());
            let marginals = Marginals { problem, covariance, cameras: &cameras, inflation, between };
            let own: Vec<CrossCovariance> =
                (0..cameras.len()).map(|view| marginals.of_cameras([view, view])).collect();
            pairs = marginals.of_pairs();
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
        }
    }
}
