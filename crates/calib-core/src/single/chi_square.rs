//! Whether residuals are larger than the noise: a chi-square test.
//!
//! The sum of squared residuals in sigmas of a fit with the right noise is chi-square distributed with the
//! degrees of freedom nu; the cube root of chi-square over nu is very nearly normal with mean
//! `1 - 2 / (9 nu)` and variance `2 / (9 nu)` (Wilson and Hilferty 1931), which gives the score of a test
//! at a level without tables.

/// Normal quantile of the level of the test, 1 %. At 5 % too many inliers are rejected, which costs accuracy.
pub(crate) const LEVEL: f64 = 2.326;

/// The standard normal score of a chi-square (Wilson and Hilferty 1931); 0 without degrees of freedom.
pub(crate) fn chi2_score(chi2: f64, dof: i64) -> f64 {
    if dof < 1 {
        return 0.0;
    }
    let variance = 2.0 / (9.0 * dof as f64);
    ((chi2 / dof as f64).cbrt() - (1.0 - variance)) / variance.sqrt()
}

/// Whether a chi-square is too large to come from drawing noise.
pub fn is_misfit(chi2: f64, dof: i64) -> bool {
    chi2_score(chi2, dof) > LEVEL
}
