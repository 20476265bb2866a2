//! Refinement of one cluster of cameras: the least-squares estimate without outliers, with weak priors on the
//! focals that are not determined otherwise, and the covariances there.
//!
//! Outliers are searched for where the chi-square of all residuals is too large for the noise, or that of one
//! landmark, as the largest of many. The candidate without which the rest has the least chi-square score
//! (leave-one-out) is rejected, if the rest has no misfit or the candidate is significant against its
//! scatter; then again. Of many landmarks those that are plainly wrong go before, several at once
//! (`screening.rs`).

use crate::bundle::camera::View;
use crate::bundle::converged::{
    Converged, LandmarkEstimate, OutlierCandidate, PlaneEstimate, converged, nearly_converged,
};
use crate::bundle::copies::Copies;
use crate::bundle::landmark::{DistanceMeasurement, Landmark};
use crate::bundle::marginals::{CrossCovariance, Marginals};
use crate::bundle::problem::BundleProblem;
use crate::bundle::residuals::ResidualKind;
use crate::bundle::triangulation::triangulate;
use crate::camera::{Camera, Covariance};
use crate::single::{PlanePrior, Prior, chi2_score, inflation, is_misfit, is_significant, student_factor};

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
        let score = |found: &Converged| chi2_score(found.chi2, found.dof);
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
