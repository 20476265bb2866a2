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

use crate::bundle::converged::{Converged, OutlierCandidate, Scored, largest_of};
use crate::bundle::landmark::{LANDMARK_PARAMS, Landmark};
use crate::bundle::residuals::distance_residual;
use crate::bundle::triangulation::triangulate;
use crate::camera::{Camera, ObservedPixel, PosedCamera};
use crate::optimize::{product, pseudo_invert};

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
/// The median of a chi-square of nu degrees of freedom is nu `(1 - 2 / (9 nu))^3` (Wilson and Hilferty 1931).
fn typical_factor(candidates: &[Scored]) -> f64 {
    let median_of = |dof: i64| (1.0 - 2.0 / (9.0 * dof as f64)).powi(3);
    let mut factors: Vec<f64> =
        candidates.iter().map(|scored| scored.per_dof() / median_of(scored.dof)).collect();
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
