//! Normal and chi-square statistics: scores, quantiles and tail probabilities.
//!
//! The cube root of a chi-square divided by its degrees of freedom nu is very nearly normal. Its mean is
//! `1 - 2 / (9 nu)`, its variance `2 / (9 nu)` (Wilson and Hilferty 1931). The score of a chi-square test is
//! therefore computed without tables.

/// Standard normal score above which the misfit test rejects: the one-sided quantile of 1 %. At 5 %, too many
/// inliers are rejected, which reduces the accuracy.
pub const MISFIT_SCORE: f64 = 2.326;

/// Minimum degrees of freedom of a chi-square test. Estimated degrees of freedom may be fractions.
const MIN_DOF: f64 = 0.5;

/// Returns the standard normal score of a chi-square with `dof` degrees of freedom. Large scores are
/// improbable. Returns 0 for fewer than 0.5 degrees of freedom.
#[must_use]
pub fn chi2_score(chi2: f64, dof: f64) -> f64 {
    if dof < MIN_DOF {
        return 0.0;
    }
    let variance = 2.0 / (9.0 * dof);
    ((chi2 / dof).cbrt() - (1.0 - variance)) / variance.sqrt()
}

/// Returns the median of a chi-square divided by its degrees of freedom nu = `dof`: `(1 - 2 / (9 nu))^3`.
#[must_use]
pub fn chi2_median_per_dof(dof: f64) -> f64 {
    (1.0 - 2.0 / (9.0 * dof)).powi(3)
}

/// Whether a chi-square with `dof` degrees of freedom is too large for annotation noise: its score exceeds
/// [`MISFIT_SCORE`].
#[must_use]
pub fn is_misfit(chi2: f64, dof: i64) -> bool {
    chi2_score(chi2, dof as f64) > MISFIT_SCORE
}

/// Returns an upper bound of the probability that the absolute value of a standard normal number exceeds
/// `sigmas`. The bound is `2 phi(x) / x` with x = `sigmas` and the normal density phi (Mills 1926).
#[must_use]
pub fn two_sided_tail(sigmas: f64) -> f64 {
    let density = (-0.5 * sigmas * sigmas).exp() / (2.0 * std::f64::consts::PI).sqrt();
    (2.0 * density / sigmas.max(f64::MIN_POSITIVE)).min(1.0)
}

/// Returns the number of standard deviations that the absolute value of a standard normal number exceeds with
/// this probability: the inverse of [`two_sided_tail`].
#[must_use]
pub fn two_sided_quantile(probability: f64) -> f64 {
    /// Upper end of the bisection, in standard deviations.
    const MAX_SIGMAS: f64 = 40.0;
    /// Number of bisection steps.
    const BISECTION_STEPS: usize = 60;
    let halve = |[low, high]: [f64; 2], _| {
        let middle = 0.5 * (low + high);
        if two_sided_tail(middle) > probability { [middle, high] } else { [low, middle] }
    };
    (0..BISECTION_STEPS).fold([0.0, MAX_SIGMAS], halve)[1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantile_is_exceeded_with_its_probability() {
        for probability in [0.3, 0.05, 1e-3, 1e-9] {
            assert!((two_sided_tail(two_sided_quantile(probability)) / probability - 1.0).abs() < 1e-9);
        }
        assert!((two_sided_quantile(0.0027) - 3.0).abs() < 0.05);
    }

    #[test]
    fn scores_agree_with_tables() {
        // Upper tails of 2.3e-2 and 3.2e-5: chi-square of four degrees exceeds 11.3 and 25.9 with these
        // probabilities. For the second, the approximation is a tenth of a standard deviation too small,
        // which causes no false alarm.
        assert!((chi2_score(11.3, 4.0) - 2.0).abs() < 0.03);
        assert!((3.88..4.0).contains(&chi2_score(25.9, 4.0)));
        assert!(chi2_score(3.0, 4.0) < 0.0);
        assert!((two_sided_tail(4.6) / 4.2e-6 - 1.0).abs() < 0.06);
    }
}
