//! Wrong lines: a chi-square test, then every piece of evidence is left out in turn.

use crate::criterion::Held;
use crate::evidence::Source;
use crate::likelihood::Problem;
use crate::minima::{Found, Minimum, minimum_near, solve};

/// Normal quantile of the test's level of 1 %: at 5 % good lines would be dropped, and accuracy with them.
const LEVEL: f64 = 2.326;

/// How many standard deviations a chi-square lies above its mean (Wilson and Hilferty 1931).
pub(crate) fn chi2_score(chi2: f64, dof: i64) -> f64 {
    if dof < 1 {
        return 0.0;
    }
    let spread = 2.0 / (9.0 * dof as f64);
    ((chi2 / dof as f64).cbrt() - (1.0 - spread)) / spread.sqrt()
}

/// Whether a chi-square is too large to come from drawing noise.
pub(crate) fn is_misfit(chi2: f64, dof: i64) -> bool {
    chi2_score(chi2, dof) > LEVEL
}

/// The result with wrong lines set aside, and which they are.
///
/// At most a third of the redundancy is spent on it; where nothing explains the misfit, nothing is set aside.
pub(crate) fn solve_without_outliers(
    problem: &Problem,
    held: Held,
    belief: bool,
    keep: &dyn Fn(Source) -> bool,
) -> (Found, Vec<Source>) {
    let all = solve(problem, held, belief);
    let mut aside: Vec<Source> = Vec::new();
    let mut current = all.clone();
    let most = (problem.dof() / 3).clamp(1, 4);
    for _ in 0..most {
        let without = Problem { aside: &aside, ..problem.clone() };
        let Some(best) = current.minima.first() else { break };
        if !is_misfit(best.chi2, without.dof()) {
            return (current, aside);
        }
        let Some((culprit, found, explains)) = culprit(&without, best, held, belief, keep) else { break };
        aside.push(culprit);
        current = found;
        if explains {
            let done = Problem { aside: &aside, ..problem.clone() };
            let fits = current.minima.first().is_some_and(|best| !is_misfit(best.chi2, done.dof()));
            if fits {
                return (current, aside);
            }
        }
    }
    (all, Vec::new())
}

/// The piece of evidence without which the rest agrees best, the result without it, and whether
/// leaving it out makes a difference that chance does not.
fn culprit(
    problem: &Problem,
    best: &Minimum,
    held: Held,
    belief: bool,
    keep: &dyn Fn(Source) -> bool,
) -> Option<(Source, Found, bool)> {
    let sources = sources(problem);
    let mut lowest: Option<(f64, Source)> = None;
    for source in sources.into_iter().filter(|&source| !keep(source)) {
        let aside: Vec<Source> = problem.aside.iter().copied().chain([source]).collect();
        let without = Problem { aside: &aside, ..problem.clone() };
        // Without redundancy everything agrees, whatever is left out.
        if without.dof() < 1 {
            continue;
        }
        let near = minimum_near(&without, &best.state);
        let anywhere = solve(&without, held, belief).minima.into_iter().next();
        let chi2 = near.iter().chain(&anywhere).map(|m| m.chi2).fold(f64::INFINITY, f64::min);
        let score = chi2_score(chi2, without.dof());
        if lowest.is_none_or(|(least, _)| score < least) {
            lowest = Some((score, source));
        }
    }
    let (_, source) = lowest?;
    let aside: Vec<Source> = problem.aside.iter().copied().chain([source]).collect();
    let without = Problem { aside: &aside, ..problem.clone() };
    let found = solve(&without, held, belief);
    let explains = found.minima.first().is_some_and(|m| m.chi2 < best.chi2);
    Some((source, found, explains))
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
    fn the_test_is_at_the_one_percent_level() {
        // Quantiles of the chi-square distribution at 0.99 (any table).
        for (dof, quantile) in [(1, 6.635), (2, 9.210), (5, 15.086), (10, 23.209), (30, 50.892)] {
            assert!(!is_misfit(quantile * 0.97, dof) && is_misfit(quantile * 1.03, dof), "dof {dof}");
        }
    }
}
