//! Numbers as the screen writes them: with a real minus, and no more digits than their uncertainty supports.

/// A number with so many digits and a real minus.
#[must_use]
pub fn number(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    let is_zero = text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.');
    if is_zero { text.replace('-', "") } else { text.replace('-', "\u{2212}") }
}

/// Digits behind the point that `\u{b1} sigma` supports: two of sigma's own.
#[must_use]
pub fn digits(sigma: f64) -> usize {
    if !(sigma.is_finite() && sigma > 0.0) {
        return 2;
    }
    (1.0 - sigma.log10().floor()).clamp(0.0, 6.0) as usize
}
