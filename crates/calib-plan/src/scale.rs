//! Scales in texts, such as "1:100" and `1/8" = 1'-0"`.

/// Usual denominators of the scales of plans. Other ratios in a text are slopes, times or mixtures.
const USUAL: [u32; 26] = [
    10, 12, 16, 20, 24, 25, 32, 48, 50, 64, 75, 96, 100, 125, 128, 150, 192, 200, 250, 300, 400, 500, 1000,
    1250, 2000, 2500,
];

/// Returns the different denominators of the scales in a text, in ascending order: 100 for "1:100", and 96 for
/// `1/8" = 1'-0"`.
pub(crate) fn denominators(text: &str) -> Vec<u32> {
    let mut found: Vec<u32> =
        ratios(text).chain(inches_per_foot(text)).filter(|one| USUAL.contains(one)).collect();
    found.sort_unstable();
    found.dedup();
    found
}

/// Returns the numbers after "1:" and "1 :". A digit or separator before the 1 makes it another number.
fn ratios(text: &str) -> impl Iterator<Item = u32> {
    text.match_indices(':').filter_map(|(at, _)| {
        let before = text[..at].trim_end().strip_suffix('1')?;
        if before.ends_with(|c: char| c.is_ascii_digit() || matches!(c, '.' | ',' | ':' | '/')) {
            return None;
        }
        leading_number(text[at + 1..].trim_start())
    })
}

/// Returns the number at the start of a text. Digits of a longer expression, such as a time, are no number.
fn leading_number(text: &str) -> Option<u32> {
    let digits = text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit()).len();
    let (number, rest) = text.split_at(digits);
    let is_longer = rest.starts_with([':', '/'])
        || (rest.starts_with(['.', ',', '\'']) && rest[1..].starts_with(|c: char| c.is_ascii_digit()));
    if is_longer { None } else { number.parse().ok() }
}

/// Returns the denominators of scales in inches of paper per foot: `1/8" = 1'-0"` is 1:96.
fn inches_per_foot(text: &str) -> impl Iterator<Item = u32> {
    text.match_indices('=').filter_map(|(at, _)| {
        let feet = text[at + 1..].trim_start().replace(['\u{2032}', '\u{2019}'], "'");
        if !feet.starts_with("1'") {
            return None;
        }
        let inches = text[..at].trim_end().strip_suffix(['"', '\u{2033}', '\u{201d}'])?;
        let start = inches.rfind(|c: char| !(c.is_ascii_digit() || c == '/')).map_or(0, |at| at + 1);
        let inches = &inches[start..];
        let (top, bottom) = inches.split_once('/').unwrap_or((inches, "1"));
        let (top, bottom): (u32, u32) = (top.parse().ok()?, bottom.parse().ok()?);
        bottom.checked_mul(12)?.checked_div(top)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_are_found_in_texts() {
        for (text, expected) in [
            ("Ground floor  Scale 1:100  12.05.2024", vec![100]),
            ("M 1 : 50", vec![50]),
            ("1:100 (A3), details 1:20", vec![20, 100]),
            ("1/8\" = 1'-0\"", vec![96]),
            ("SCALE: 1/4\u{201d} = 1\u{2019}-0\u{201d}", vec![48]),
            ("printed at 11:100, slope 1:40, at 1:30:00, 21:50", vec![]),
            ("ratio 1:100.5", vec![]),
            ("", vec![]),
        ] {
            assert_eq!(denominators(text), expected, "{text}");
        }
    }
}
