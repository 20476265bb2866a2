//! Probabilities as the sigmas of a normal number.

/// As how many sigmas a chi-square of so many degrees of freedom, whole or not, is improbable (Wilson and Hilferty 1931);
/// 0 where it is probable.
pub(crate) fn sigmas(chi2: f64, freedom: f64) -> f64 {
    /// Less than this is no degree of freedom.
    const LEAST: f64 = 0.5;
    if freedom < LEAST {
        return 0.0;
    }
    let variance = 2.0 / (9.0 * freedom);
    ((chi2 / freedom).cbrt() - (1.0 - variance)).max(0.0) / variance.sqrt()
}

/// As how many sigmas F of so many degrees of freedom, above and below, is improbable (Paulson 1942, of the same cube
/// roots, for 3 below or more); 0 where it is probable.
pub(crate) fn sigmas_of_ratio(ratio: f64, above: f64, below: f64) -> f64 {
    let [over, under] = [above, below].map(|freedom| 2.0 / (9.0 * freedom));
    let root = ratio.max(0.0).cbrt();
    let off = (1.0 - under) * root - (1.0 - over);
    off.max(0.0) / (over + under * root * root).sqrt()
}

/// How often a normal number is farther from 0 than so many sigmas: at most `2 phi(x) / x` (Mills 1926).
pub(crate) fn exceeded(sigmas: f64) -> f64 {
    let density = (-0.5 * sigmas * sigmas).exp() / (2.0 * std::f64::consts::PI).sqrt();
    (2.0 * density / sigmas.max(f64::MIN_POSITIVE)).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sigmas_are_those_of_the_tables() {
        // Upper tails of 2.3e-2 and 3.2e-5: chi-square of four degrees exceeds 11.3 and 25.9 as often. So far out the
        // approximation is a tenth of a sigma short, which raises no false alarm.
        assert!((sigmas(11.3, 4.0) - 2.0).abs() < 0.03);
        assert!((3.88..4.0).contains(&sigmas(25.9, 4.0)));
        assert!(sigmas(3.0, 4.0) == 0.0);
        // Upper tails of 2.3e-2 and 1.3e-3 of F with 4 and 20, and of 1.3e-3 with 4 and 1e9 degrees, as of chi-square.
        assert!((sigmas_of_ratio(3.606, 4.0, 20.0) - 2.0).abs() < 0.03);
        assert!((sigmas_of_ratio(6.715, 4.0, 20.0) - 3.0).abs() < 0.06);
        assert!((sigmas_of_ratio(17.8 / 4.0, 4.0, 1e9) - sigmas(17.8, 4.0)).abs() < 1e-6);
        assert!(sigmas_of_ratio(0.9, 4.0, 3.0) == 0.0 && sigmas_of_ratio(1e3, 4.0, 3.0) > 3.0);
        assert!((exceeded(4.6) / 4.2e-6 - 1.0).abs() < 0.06);
    }
}
