//! Numbers as the screen writes them.

/// A number with so many digits and a real minus.
#[must_use]
pub fn number(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    let is_zero = text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.');
    if is_zero { text.replace('-', "") } else { text.replace('-', "\u{2212}") }
}
