//! Outliers among the annotations of one camera: a chi-square test of all residuals, then leave-one-out if it
//! fails.
//!
//! If the test fails, the fit is repeated without each annotation in turn. The annotation whose removal gives
//! the best agreement of the rest is rejected. The largest residual is not a reliable criterion: an outlier
//! pulls the fit toward itself, and with few lines its residual may be the smallest. With many lines, only the
//! most promising ones are left out, ranked by the linear model ([`Problem::chi2_without`]). The model corrects
//! the residuals for their own leverage. It solves a four by four system for each constraint instead of a fit.
//!
//! # Contradictory uprights
//!
//! Each upright alone determines the camera height. If these heights contradict each other, the wrong upright
//! is the lowest or the highest.
//!
//! For a known orientation, let `z` be the height of the camera. Let `f` be the horizontal vector that the
//! ray of the foot covers while it falls one metre. The foot is at the distance `z |f|` from the point below
//! the camera. Let the ray of the head have the component `a` along `f` and the rise `c`. It passes above the
//! foot at the height `z + z |f| c / a`, which equals the height `h` of the upright. So
//! `z = h a / (a + |f| c)`.

use crate::camera::{Camera, Pixel};
use crate::optimize::{chi2_score, is_misfit};
use crate::single::annotation::Annotation;
use crate::single::constraints::Source;
use crate::single::likelihood::Problem;
use crate::single::minima::{Minimum, Solutions, minima_including, minimum_near, solve};
use crate::single::parameters::FixedParameters;

/// Returns the uprights that give the lowest and the highest camera height, each with that height in metres,
/// if they contradict each other.
pub fn contradictory_uprights(camera: &Camera, annotations: &[Annotation]) -> Option<[(Source, f64); 2]> {
    /// Largest ratio of heights that can result from the usual noise of foot and head.
    const MAX_HEIGHT_RATIO: f64 = 1.04;
    let on = annotations.iter().enumerate().filter(|(_, annotation)| !annotation.off);
    let mut heights: Vec<(Source, f64)> = on
        .filter_map(|(index, annotation)| {
            let height = height_from_upright(camera, annotation)?;
            Some((Source { annotation: index, segment: 0 }, height))
        })
        .collect();
    heights.sort_by(|a, b| a.1.total_cmp(&b.1));
    let (lowest, highest) = (*heights.first()?, *heights.last()?);
    (highest.1 > MAX_HEIGHT_RATIO * lowest.1).then_some([lowest, highest])
}

/// Returns the camera height determined by one upright of known height on the floor, for the orientation of
/// `camera`.
fn height_from_upright(camera: &Camera, annotation: &Annotation) -> Option<f64> {
    let on_floor = annotation.plane.is_none();
    let (foot, head) = annotation.foot.zip(annotation.head).filter(|_| on_floor)?;
    let upright = annotation.height()?.value;
    let ray = |pixel: Pixel| camera.pixel_to_ray(pixel).map(|ray| ray.direction);
    let ([x, y, fall], [u, v, rise]) = (ray(foot)?, ray(head)?);
    let along = [-x / fall, -y / fall];
    let reach = along[0].hypot(along[1]);
    let forward = (along[0] * u + along[1] * v) / reach;
    let height = upright * forward / (forward + reach * rise);
    (fall < 0.0 && forward > 0.0 && height.is_finite() && height > 0.0).then_some(height)
}

/// Returns the estimated factor of the assumed variance of an annotated coordinate: `chi2 / dof`, at least 1.
///
/// The factor is 1 if there are too few residuals for an estimate, unless the residuals are a misfit.
pub(crate) fn inflation(chi2: f64, dof: i64) -> f64 {
    /// Minimum degrees of freedom for an estimate of the noise.
    const MIN_DOF: i64 = 10;
    if dof >= MIN_DOF || is_misfit(chi2, dof) { (chi2 / dof as f64).max(1.0) } else { 1.0 }
}

/// Whether a constraint is an outlier relative to the scatter of the rest, for any noise level.
///
/// The test uses its externally studentised residual, `t^2 = (chi2 - chi2') / (chi2' / dof')`, with primes
/// for the fit without it. The level is 1 % for the largest of `count` constraints.
pub(crate) fn is_significant(chi2: f64, chi2_without: f64, dof_without: i64, count: usize) -> bool {
    /// Normal quantile at 0.995, for a two-sided level of 1 %.
    const TWO_SIDED_QUANTILE: f64 = 2.576;
    if dof_without < 3 {
        return false;
    }
    let nu = dof_without as f64;
    // Normal quantile for the largest of many, and Student's quantile from it.
    let z = (TWO_SIDED_QUANTILE * TWO_SIDED_QUANTILE + 2.0 * (count as f64).ln()).sqrt();
    let student = student_quantile(z, nu);
    chi2 - chi2_without > student * student * chi2_without / nu
}

/// Returns the quantile of Student's distribution at the level of a normal quantile `z`, for at least three
/// degrees of freedom (Abramowitz and Stegun 1964, 26.7.5).
fn student_quantile(z: f64, nu: f64) -> f64 {
    z + (z.powi(3) + z) / (4.0 * nu)
        + (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / (96.0 * nu * nu)
        + (3.0 * z.powi(7) + 19.0 * z.powi(5) + 17.0 * z.powi(3) - 15.0 * z) / (384.0 * nu.powi(3))
}

/// Returns the factor that widens a standard deviation if its noise is estimated from residuals.
///
/// The widened normal interval equals the 95 % interval of Student's distribution.
pub(crate) fn student_factor(dof: i64) -> f64 {
    /// Normal quantile of 0.975.
    const NORMAL_QUANTILE: f64 = 1.959_964;
    // One and two degrees of freedom have closed forms: tan(0.475 pi), and 0.95 sqrt(2 / (1 - 0.95^2)).
    match dof {
        ..=1 => 12.706_205 / NORMAL_QUANTILE,
        2 => 4.302_653 / NORMAL_QUANTILE,
        _ => student_quantile(NORMAL_QUANTILE, dof as f64) / NORMAL_QUANTILE,
    }
}

/// Whether the residuals contradict the model of the scene: their RMS is more than five times the assumed
/// noise.
///
/// Clicks and curved edges have errors of a few pixels. Larger errors come from wrong annotations, so scaling
/// the standard deviations would not account for them.
pub fn is_inconsistent(chi2: f64, dof: i64) -> bool {
    /// Largest ratio of the estimated to the assumed standard deviation of the noise.
    const MAX_SIGMAS: f64 = 5.0;
    is_misfit(chi2, dof) && chi2 > MAX_SIGMAS * MAX_SIGMAS * dof as f64
}

/// Annotation noise as estimated from the residuals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Noise {
    /// Factor by which the assumed variance of an annotated coordinate is multiplied.
    pub(crate) inflation: f64,
    /// Degrees of freedom of the estimate; `None` if the noise is assumed.
    pub(crate) dof: Option<i64>,
}

impl Noise {
    /// Noise whose standard deviation is given by the caller.
    pub(crate) const GIVEN: Self = Self { inflation: 1.0, dof: None };

    /// Estimates the noise with [`inflation`].
    ///
    /// If lines were rejected to make the rest agree, the assumed noise is refuted. Then only the remaining
    /// residuals are evidence of the noise.
    pub(crate) fn estimated(chi2: f64, dof: i64, rejected: usize) -> Self {
        let inflation = inflation(chi2, dof);
        let is_estimated = inflation > 1.0 || rejected > 0;
        Self { inflation, dof: is_estimated.then_some(dof) }
    }

    /// Returns the factor of covariances: the inflation times the square of the widening for few residuals.
    pub(crate) fn spread(&self) -> f64 {
        self.inflation * self.widening().powi(2)
    }

    /// Returns the factor of standard deviations for few degrees of freedom ([`student_factor`]).
    pub(crate) fn widening(&self) -> f64 {
        self.dof.map_or(1.0, student_factor)
    }
}

/// Options of the outlier search.
#[derive(Clone, Copy)]
pub(crate) struct OutlierSearch<'a> {
    pub(crate) fixed: FixedParameters,
    /// Whether the weak prior on the focal length is allowed.
    pub(crate) weak_prior: bool,
    /// Whether the noise was given, so that a chi-square tests the fit.
    ///
    /// If not, the noise may be larger than assumed. Then, if more than one constraint is rejected, each must
    /// be significant relative to the scatter of the others ([`is_significant`]).
    pub(crate) noise_is_known: bool,
    /// Predicate for constraints that are never rejected.
    pub(crate) keep: &'a dyn Fn(Source) -> bool,
}

/// Returns the solutions without outliers, and the outliers.
///
/// The number of rejected constraints is at most four, and at most a third of the degrees of freedom, but one
/// rejection is always tried. If the misfit remains, only significant outliers are rejected ([`is_significant`]).
pub(crate) fn solve_without_outliers(problem: &Problem, search: OutlierSearch) -> (Solutions, Vec<Source>) {
    let mut rejected: Vec<Source> = Vec::new();
    let mut results = vec![solve(problem, search.fixed, search.weak_prior)];
    // Number of confirmed rejections, counted from the first.
    let mut confirmed = 0;
    let most = (problem.dof() / 3).clamp(1, 4);
    for round in 0..=most {
        let without = Problem { rejected: &rejected, ..problem.clone() };
        let Some(best) = results.last().and_then(|found| found.minima.first()) else { break };
        if !is_misfit(best.chi2, without.dof()) {
            if search.noise_is_known || rejected.len() < 2 || confirmed == rejected.len() {
                confirmed = rejected.len();
            }
            break;
        }
        if round == most {
            break;
        }
        if !may_remove_misfit(&without, best, most - round) {
            break;
        }
        let Some(Outlier { source, chi2, runner_up }) = worst_outlier(&without, best, search) else { break };
        let count = sources(&without).len();
        let chi2_before = best.chi2;
        rejected.push(source);
        let fewer = Problem { rejected: &rejected, ..problem.clone() };
        // If another rejection explains the misfit equally well, the outlier is ambiguous and is not
        // rejected.
        if !is_misfit(runner_up, fewer.dof()) && runner_up < chi2 + MIN_RUNNER_UP_CHI2_DIFFERENCE {
            break;
        }
        if confirmed + 1 == rejected.len() && is_significant(chi2_before, chi2, fewer.dof(), count) {
            confirmed = rejected.len();
        }
        results.push(solve(&fewer, search.fixed, search.weak_prior));
    }
    rejected.truncate(confirmed);
    (results.swap_remove(confirmed), rejected)
}

/// Largest number of constraints for which leaving one out may lead to another minimum.
///
/// With more constraints each has almost no leverage, so its residual predicts the gain of its rejection.
const MAX_REFITTED_CONSTRAINTS: usize = 400;

/// Whether rejecting up to `most` constraints may remove the misfit.
///
/// With few constraints this is unknown before trying. With many, the largest residuals predict it, with a
/// margin for their influence on the fit.
fn may_remove_misfit(problem: &Problem, best: &Minimum, most: i64) -> bool {
    /// Factor of the predicted gain, for the influence of the residuals on the fit.
    const GAIN_MARGIN: f64 = 4.0;
    let count = sources(problem).len();
    if count <= MAX_REFITTED_CONSTRAINTS {
        return true;
    }
    let mut squares: Vec<f64> = Vec::with_capacity(count);
    let _ = problem.each_residual(&best.state, |residual: f64, _, source| {
        squares.extend(source.map(|_| residual * residual));
    });
    squares.sort_by(|a, b| b.total_cmp(a));
    let gain: f64 = squares.iter().take(usize::try_from(most).unwrap_or(0)).sum();
    !is_misfit(best.chi2 - GAIN_MARGIN * gain, problem.dof() - most)
}

/// Minimum difference in chi-square between the best and the second-best rejection.
const MIN_RUNNER_UP_CHI2_DIFFERENCE: f64 = 2.0;

/// Constraint whose rejection gives the smallest chi-square score of the rest.
struct Outlier {
    source: Source,
    /// Chi-square of the other constraints after this rejection.
    chi2: f64,
    /// Chi-square if the second-best candidate is rejected instead; infinite if there is only one candidate.
    runner_up: f64,
}

/// Returns the constraint whose rejection gives the best agreement of the rest.
fn worst_outlier(problem: &Problem, best: &Minimum, search: OutlierSearch) -> Option<Outlier> {
    /// Largest number of candidates for which every leave-one-out fit uses all start values.
    const MAX_MULTISTART: usize = 40;
    /// Number of candidates whose leave-one-out fit uses all start values, if there are more than `MAX_MULTISTART`.
    const REDUCED_MULTISTART: usize = 10;
    let candidates = outlier_candidates(problem, best, search);
    let multistart = match sources(problem).len() {
        count if count > MAX_REFITTED_CONSTRAINTS => 0,
        _ if candidates.len() <= MAX_MULTISTART => candidates.len(),
        _ => REDUCED_MULTISTART,
    };
    let mut scored: Vec<(f64, Source, f64)> = Vec::new();
    for (rank, &source) in candidates.iter().enumerate() {
        let rejected: Vec<Source> = problem.rejected.iter().copied().chain([source]).collect();
        let without = Problem { rejected: &rejected, ..problem.clone() };
        // Without degrees of freedom every chi-square is 0.
        if without.dof() < 1 {
            continue;
        }
        // A gross error may have led the fit to another minimum, so all starts are tried, not only the
        // present minimum.
        let mut found: Vec<Minimum> = minimum_near(&without, &best.state).into_iter().collect();
        if rank < multistart {
            found = minima_including(found, &without, search.fixed);
        }
        let chi2 = found.iter().map(|minimum| minimum.chi2).fold(f64::INFINITY, f64::min);
        scored.push((chi2_score(chi2, without.dof() as f64), source, chi2));
    }
    scored.sort_by(|a, b| a.0.total_cmp(&b.0));
    let &(_, source, chi2) = scored.first()?;
    Some(Outlier { source, chi2, runner_up: scored.get(1).map_or(f64::INFINITY, |&(_, _, chi2)| chi2) })
}

/// Returns the constraints to leave out in turn, the largest residuals first. With many constraints, returns
/// only the most promising ones.
fn outlier_candidates(problem: &Problem, best: &Minimum, search: OutlierSearch) -> Vec<Source> {
    /// Largest number of constraints for which all are candidates.
    const MAX_UNSELECTED: usize = 40;
    /// Number of candidates if there are more constraints than `MAX_UNSELECTED`.
    const MAX_CANDIDATES: usize = 16;
    let mut found = problem.residuals_in_pixels(&best.state).unwrap_or_default();
    found.retain(|(source, _)| !(search.keep)(*source));
    found.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    let mut sources: Vec<Source> = found.into_iter().map(|(source, _)| source).collect();
    if sources.len() > MAX_REFITTED_CONSTRAINTS {
        sources.truncate(MAX_CANDIDATES);
    } else if sources.len() > MAX_UNSELECTED {
        let promised = problem.chi2_without(&best.state);
        let of = |source: &Source| promised.get(source).copied().unwrap_or(f64::INFINITY);
        sources.sort_by(|a, b| of(a).total_cmp(&of(b)));
        sources.truncate(MAX_CANDIDATES);
    }
    sources
}

/// Returns the sources of all constraints that are not rejected.
fn sources(problem: &Problem) -> Vec<Source> {
    let lines = problem.lines().map(|line| line.source);
    let lengths = problem.lengths().map(|length| length.source);
    let uprights = problem.uprights().map(|upright| upright.source);
    lines.chain(lengths).chain(uprights).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::camera::{WorldPoint, any_camera};
    use crate::single::annotation::{Kind, Known};

    /// Returns the annotation of an upright with `height`, annotated with the height `stated`.
    fn upright(camera: &Camera, [x, y]: [f64; 2], height: f64, stated: f64) -> Option<Annotation> {
        let shown = |z: f64| camera.world_to_pixel(WorldPoint::new(x, y, z));
        let mut annotation = Annotation::new(Kind::Upright);
        annotation.foot = Some(shown(0.0)?);
        annotation.head = Some(shown(height)?);
        annotation.height_m = Some(Known::fixed(stated));
        Some(annotation)
    }

    proptest! {
        #[test]
        fn camera_height_is_proportional_to_the_height_of_the_upright(
            camera in any_camera(), x in -4.0..4.0_f64, y in 3.0..9.0_f64, stated in 0.5..3.0_f64,
        ) {
            let Some(annotation) = upright(&camera, [x, y], 1.7, stated) else { return Ok(()) };
            let Some(height) = height_from_upright(&camera, &annotation) else { return Ok(()) };
            let expected = camera.position.z * stated / 1.7;
            prop_assert!((height / expected - 1.0).abs() < 1e-5, "{height} for {expected}");
        }
    }

    #[test]
    fn contradictory_uprights_are_the_lowest_and_the_highest() {
        let camera = Camera {
            position: WorldPoint::new(0.0, 0.0, 3.0),
            yaw: 0.0,
            pitch: 0.5,
            roll: 0.02,
            focal: 1400.0,
            lens: crate::camera::Lens::pinhole(Pixel::new(960.0, 540.0)),
            covariance: crate::camera::Covariance::EXACT,
        };
        let at = |place, stated| upright(&camera, place, 1.75, stated);
        let mut all: Vec<Annotation> = [at([-1.0, 5.0], 1.75), at([1.0, 6.0], 1.4), at([0.5, 4.5], 1.76)]
            .into_iter()
            .flatten()
            .collect();
        assert_eq!(all.len(), 3, "all uprights are visible");
        let [(wrong, low), (right, high)] = contradictory_uprights(&camera, &all).unwrap();
        assert_eq!([wrong.annotation, right.annotation], [1, 2]);
        assert!((low - 2.4).abs() < 1e-6 && (high - 3.0 * 1.76 / 1.75).abs() < 1e-6, "{low} {high}");
        all[1].off = true;
        assert_eq!(contradictory_uprights(&camera, &all), None, "the remaining uprights agree");
        assert_eq!(
            contradictory_uprights(&camera, &all[..1]),
            None,
            "a single upright cannot contradict another"
        );
    }

    #[test]
    fn intervals_with_few_residuals_match_student_quantiles() {
        // Quantiles of Student's distribution at 0.975 (any table).
        for (dof, quantile) in [(1, 12.706), (2, 4.303), (3, 3.182), (4, 2.776), (6, 2.447), (30, 2.042)] {
            let off = student_factor(dof) * 1.96 / quantile - 1.0;
            assert!(off.abs() < 0.01, "dof {dof}: {off}");
        }
    }

    #[test]
    fn misfit_test_has_the_one_percent_level() {
        // Quantiles of the chi-square distribution at 0.99 (any table).
        for (dof, quantile) in [(1, 6.635), (2, 9.210), (5, 15.086), (10, 23.209), (30, 50.892)] {
            assert!(!is_misfit(quantile * 0.97, dof) && is_misfit(quantile * 1.03, dof), "dof {dof}");
        }
    }
}
