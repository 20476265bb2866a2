//! Probabilities as the sigmas of a normal number.

/// As how many sigmas a chi-square of so many degrees of freedom, whole or not, is improbable (Wilson and Hilferty 1931);
/// 0 where it is probable.
#[must_use]
pub fn sigmas(chi2: f64, freedom: f64) -> f64 {
    /// Less than this is no degree of freedom.
    const LEAST: f64 = 0.5;
    if freedom < LEAST {
        return 0.0;
    }
    let variance = 2.0 / (9.0 * freedom);
    ((chi2 / freedom).cbrt() - (1.0 - variance)).max(0.0) / variance.sqrt()
}

/// How often a normal number is farther from 0 than so many sigmas: at most `2 phi(x) / x` (Mills 1926).
#[must_use]
pub fn exceeded(sigmas: f64) -> f64 {
    let density = (-0.5 * sigmas * sigmas).exp() / (2.0 * std::f64::consts::PI).sqrt();
    (2.0 * density / sigmas.max(f64::MIN_POSITIVE)).min(1.0)
}

/// The two-sided quantile of a normal number: beyond so many sigmas it is with this probability, the inverse of
/// [`exceeded`].
#[must_use]
pub fn two_sided_quantile(probability: f64) -> f64 {
    const MOST: f64 = 40.0;
    const HALVINGS: usize = 60;
    let halved = |[low, high]: [f64; 2], _| {
        let middle = 0.5 * (low + high);
        if exceeded(middle) > probability { [middle, high] } else { [low, middle] }
    };
    (0..HALVINGS).fold([0.0, MOST], halved)[1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantile_is_exceeded_with_its_probability() {
        for probability in [0.3, 0.05, 1e-3, 1e-9] {
            assert!((exceeded(two_sided_quantile(probability)) / probability - 1.0).abs() < 1e-9);
        }
        assert!((two_sided_quantile(0.0027) - 3.0).abs() < 0.05);
    }

    #[test]
    fn sigmas_are_those_of_the_tables() {
        // Upper tails of 2.3e-2 and 3.2e-5: chi-square of four degrees exceeds 11.3 and 25.9 as often. So far out the
        // approximation is a tenth of a sigma short, which raises no false alarm.
        assert!((sigmas(11.3, 4.0) - 2.0).abs() < 0.03);
        assert!((3.88..4.0).contains(&sigmas(25.9, 4.0)));
        assert!(sigmas(3.0, 4.0) == 0.0);
        assert!((exceeded(4.6) / 4.2e-6 - 1.0).abs() < 0.06);
    }
}
