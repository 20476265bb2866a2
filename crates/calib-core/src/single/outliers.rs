//! Outliers among the annotations of one camera: a chi-square test of all residuals, and where it fails
//! leave-one-out.
//!
//! Where the test fails, the fit is repeated without each annotation; the one without which the rest agrees
//! best is rejected. A large residual is no substitute for that: an outlier pulls the fit toward itself,
//! and with few lines its residual may be the smallest. Of many lines only those are left out in turn without
//! which the linear model promises most ([`Problem::chi2_without`]): residuals freed of their own leverage,
//! which cost a four by four system each and no fit.

use crate::single::chi_square::{chi2_score, is_misfit};
use crate::single::constraints::Source;
use crate::single::fixed_parameters::FixedParameters;
use crate::single::likelihood::Problem;
use crate::single::minima::{Minimum, Solutions, minima_beside, minimum_near, solve};

/// The factor of the assumed variance of a drawn coordinate that the residuals estimate: `chi2 / dof`, at
/// least 1. It is 1 where there are too few residuals for an estimate, unless they are a misfit.
pub(crate) fn inflation(chi2: f64, dof: i64) -> f64 {
    /// Least degrees of freedom from which the noise is estimated.
    const MIN_DOF: i64 = 10;
    if dof >= MIN_DOF || is_misfit(chi2, dof) { (chi2 / dof as f64).max(1.0) } else { 1.0 }
}

/// Whether a constraint is an outlier against the scatter of the rest, whatever the noise is: its externally
/// studentised residual, `t^2 = (chi2 - chi2') / (chi2' / dof')` with the primes for the fit without it, at a
/// level of 1 % for the largest of `count` constraints.
pub(crate) fn is_significant(chi2: f64, chi2_without: f64, dof_without: i64, count: usize) -> bool {
    /// Normal quantile of 0.005: two sides of 1 %.
    const TWO_SIDED: f64 = 2.576;
    if dof_without < 3 {
        return false;
    }
    let nu = dof_without as f64;
    // The normal quantile for the largest of many, and Student's from it.
    let z = (TWO_SIDED * TWO_SIDED + 2.0 * (count as f64).ln()).sqrt();
    let student = student_quantile(z, nu);
    chi2 - chi2_without > student * student * chi2_without / nu
}

/// The quantile of Student's distribution at the level of a normal quantile `z`, for three degrees of freedom
/// or more (Abramowitz and Stegun 1964, 26.7.5).
fn student_quantile(z: f64, nu: f64) -> f64 {
    z + (z.powi(3) + z) / (4.0 * nu)
        + (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / (96.0 * nu * nu)
        + (3.0 * z.powi(7) + 19.0 * z.powi(5) + 17.0 * z.powi(3) - 15.0 * z) / (384.0 * nu.powi(3))
}

/// The factor by which a standard deviation is wider whose noise is estimated from residuals: so many times
/// the normal interval is the interval of 95 % of Student's distribution.
pub(crate) fn student_factor(dof: i64) -> f64 {
    /// Normal quantile of 0.975.
    const Z: f64 = 1.959_964;
    // Of one and of two degrees of freedom the distribution has a closed form: tan(0.475 pi), and
    // 0.95 sqrt(2 / (1 - 0.95^2)).
    match dof {
        ..=1 => 12.706_205 / Z,
        2 => 4.302_653 / Z,
        _ => student_quantile(Z, dof as f64) / Z,
    }
}

/// Whether residuals are so large that what was drawn is no drawing of a scene of this kind: over five times
/// the noise that was assumed. Hands and bent edges err by a few pixels; beyond that, lines are not what they
/// are said to be, their errors are not noise, and no factor makes a standard deviation of them.
pub fn is_inconsistent(chi2: f64, dof: i64) -> bool {
    const MOST_SIGMAS: f64 = 5.0;
    is_misfit(chi2, dof) && chi2 > MOST_SIGMAS * MOST_SIGMAS * dof as f64
}

/// What the residuals tell of the drawing noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Noise {
    /// The factor of its assumed variance.
    pub(crate) inflation: f64,
    /// From how many degrees of freedom it is estimated; `None` where it is assumed.
    pub(crate) dof: Option<i64>,
}

impl Noise {
    /// The noise that was given.
    pub(crate) const GIVEN: Self = Self { inflation: 1.0, dof: None };

    /// The noise by [`inflation`]. Where lines were rejected so that the rest would agree, the noise that was
    /// assumed is refuted, and only what is left speaks for it.
    pub(crate) fn estimated(chi2: f64, dof: i64, rejected: usize) -> Self {
        let inflation = inflation(chi2, dof);
        let is_estimated = inflation > 1.0 || rejected > 0;
        Self { inflation, dof: is_estimated.then_some(dof) }
    }

    /// The factor of covariances: by the noise, and by how few residuals tell it.
    pub(crate) fn spread(&self) -> f64 {
        self.inflation * self.widening().powi(2)
    }

    /// The factor of standard deviations for so few degrees of freedom ([`student_factor`]).
    pub(crate) fn widening(&self) -> f64 {
        self.dof.map_or(1.0, student_factor)
    }
}

/// How outliers are searched for.
#[derive(Clone, Copy)]
pub(crate) struct OutlierSearch<'a> {
    pub(crate) fixed: FixedParameters,
    /// Whether the weak prior on the focal may enter.
    pub(crate) weak_prior: bool,
    /// Whether the drawing noise was given, so that a chi-square is a test of the fit. If not, the noise may
    /// be larger than assumed, and where more than one constraint is rejected each must be significant
    /// against the scatter of the others ([`is_significant`]).
    pub(crate) noise_is_known: bool,
    /// Which constraints are never rejected.
    pub(crate) keep: &'a dyn Fn(Source) -> bool,
}

/// The solutions without outliers, and the outliers.
///
/// At most a third of the degrees of freedom, and at most four constraints, are rejected; where no rejection
/// explains the misfit, none is made.
pub(crate) fn solve_without_outliers(problem: &Problem, search: OutlierSearch) -> (Solutions, Vec<Source>) {
    let mut rejected: Vec<Source> = Vec::new();
    let mut results = vec![solve(problem, search.fixed, search.weak_prior)];
    // How many of the rejections, from the first, are confirmed.
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
        if !may_explain(&without, best, most - round) {
            break;
        }
        let Some(Outlier { source, chi2, runner_up }) = worst_outlier(&without, best, search) else { break };
        let count = sources(&without).len();
        let chi2_before = best.chi2;
        rejected.push(source);
        let fewer = Problem { rejected: &rejected, ..problem.clone() };
        // Where another one explains as well, nobody knows which is wrong: all stay.
        if !is_misfit(runner_up, fewer.dof()) && runner_up < chi2 + AS_WELL {
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

/// From more constraints than so many one moves the minimum too little to lead to another, and has next to no
/// leverage: its residual tells what its rejection gains.
const MANY: usize = 400;

/// Whether leaving out so many of the constraints may make a fit of the rest. Of few constraints nobody knows before
/// it is tried; of many the largest residuals tell, with a margin for what they pull.
fn may_explain(problem: &Problem, best: &Minimum, most: i64) -> bool {
    const MARGIN: f64 = 4.0;
    let count = sources(problem).len();
    if count <= MANY {
        return true;
    }
    let mut squares: Vec<f64> = Vec::with_capacity(count);
    let _ = problem.each_residual(&best.state, |residual: f64, _, source| {
        squares.extend(source.map(|_| residual * residual));
    });
    squares.sort_by(|a, b| b.total_cmp(a));
    let gain: f64 = squares.iter().take(usize::try_from(most).unwrap_or(0)).sum();
    !is_misfit(best.chi2 - MARGIN * gain, problem.dof() - most)
}

/// Chi-square by which the next best rejection must be worse for the best one to be told from it.
const AS_WELL: f64 = 2.0;

/// The constraint without which the rest has the least chi-square score.
struct Outlier {
    source: Source,
    /// The chi-square without it.
    chi2: f64,
    /// The least chi-square without any other one.
    runner_up: f64,
}

fn worst_outlier(problem: &Problem, best: &Minimum, search: OutlierSearch) -> Option<Outlier> {
    /// Most constraints for all of which every start is tried again, and how many of more are.
    const MAX_MULTISTART: usize = 40;
    const MULTISTART_OF_MORE: usize = 10;
    let candidates = outlier_candidates(problem, best, search);
    let multistart = match sources(problem).len() {
        count if count > MANY => 0,
        _ if candidates.len() <= MAX_MULTISTART => candidates.len(),
        _ => MULTISTART_OF_MORE,
    };
    let mut scored: Vec<(f64, Source, f64)> = Vec::new();
    for (rank, &source) in candidates.iter().enumerate() {
        let rejected: Vec<Source> = problem.rejected.iter().copied().chain([source]).collect();
        let without = Problem { rejected: &rejected, ..problem.clone() };
        // Without degrees of freedom every chi-square is 0.
        if without.dof() < 1 {
            continue;
        }
        // A gross error may have led the fit to another minimum: all starts are tried, not only this one.
        let mut found: Vec<Minimum> = minimum_near(&without, &best.state).into_iter().collect();
        if rank < multistart {
            found = minima_beside(found, &without, search.fixed);
        }
        let chi2 = found.iter().map(|minimum| minimum.chi2).fold(f64::INFINITY, f64::min);
        scored.push((chi2_score(chi2, without.dof()), source, chi2));
    }
    scored.sort_by(|a, b| a.0.total_cmp(&b.0));
    let &(_, source, chi2) = scored.first()?;
    Some(Outlier { source, chi2, runner_up: scored.get(1).map_or(f64::INFINITY, |&(_, _, chi2)| chi2) })
}

/// The constraints that are left out in turn, the largest residuals first; of many, the most promising first.
fn outlier_candidates(problem: &Problem, best: &Minimum, search: OutlierSearch) -> Vec<Source> {
    /// From more than so many they are chosen.
    const FEW: usize = 40;
    /// How many are.
    const MOST: usize = 16;
    let mut found = problem.residuals_in_pixels(&best.state).unwrap_or_default();
    found.retain(|(source, _)| !(search.keep)(*source));
    found.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    let mut sources: Vec<Source> = found.into_iter().map(|(source, _)| source).collect();
    if sources.len() > MANY {
        sources.truncate(MOST);
    } else if sources.len() > FEW {
        let promised = problem.chi2_without(&best.state);
        let of = |source: &Source| promised.get(source).copied().unwrap_or(f64::INFINITY);
        sources.sort_by(|a, b| of(a).total_cmp(&of(b)));
        sources.truncate(MOST);
    }
    sources
}

fn sources(problem: &Problem) -> Vec<Source> {
    let lines = problem.lines().map(|line| line.source);
    let lengths = problem.lengths().map(|length| length.source);
    let uprights = problem.uprights().map(|upright| upright.source);
    lines.chain(lengths).chain(uprights).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_of_few_residuals_are_those_of_student() {
        // Quantiles of Student's distribution at 0.975 (any table).
        for (dof, quantile) in [(1, 12.706), (2, 4.303), (3, 3.182), (4, 2.776), (6, 2.447), (30, 2.042)] {
            let off = student_factor(dof) * 1.96 / quantile - 1.0;
            assert!(off.abs() < 0.01, "dof {dof}: {off}");
        }
    }

    #[test]
    fn the_test_is_at_the_one_percent_level() {
        // Quantiles of the chi-square distribution at 0.99 (any table).
        for (dof, quantile) in [(1, 6.635), (2, 9.210), (5, 15.086), (10, 23.209), (30, 50.892)] {
            assert!(!is_misfit(quantile * 0.97, dof) && is_misfit(quantile * 1.03, dof), "dof {dof}");
        }
    }
}
