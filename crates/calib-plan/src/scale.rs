//! Scales in texts, such as "1:100" and `1/8" = 1'-0"`.

/// Usual denominators of the scales of plans. Other ratios in a text are slopes, times or mixtures.
const USUAL: [u32; 28] = [
    4, 8, 10, 12, 16, 20, 24, 25, 32, 48, 50, 64, 75, 96, 100, 125, 128, 150, 192, 200, 250, 300, 400, 500,
    1000, 1250, 2000, 2500,
];

/// Words before a ratio that is a slope.
const SLOPES: [&str; 6] = ["slope", "ramp", "fall", "gradient", "gef\u{e4}lle", "neigung"];
/// Length of the text before a ratio in which the words [`SLOPES`] are searched, in characters.
const MAX_WORD: usize = 16;

/// Returns the different denominators of the scales in a text, in ascending order: 100 for "1:100", and 96 for
/// `1/8" = 1'-0"`.
pub(crate) fn denominators(text: &str) -> Vec<u32> {
    let mut found: Vec<u32> =
        ratios(text).chain(inches_per_foot(text)).filter(|one| USUAL.contains(one)).collect();
    found.sort_unstable();
    found.dedup();
    found
}

/// Returns the numbers after "1:" and "1 :". A digit or separator before the 1 makes it another number. A
/// ratio after a word in [`SLOPES`] is left out.
fn ratios(text: &str) -> impl Iterator<Item = u32> {
    text.match_indices(':').filter_map(|(at, _)| {
        let before = text[..at].trim_end().strip_suffix('1')?;
        if before.ends_with(|c: char| c.is_ascii_digit() || matches!(c, '.' | ',' | ':' | '/')) {
            return None;
        }
        let tail = before.char_indices().rev().take(MAX_WORD).last().map_or(0, |(at, _)| at);
        let words = before[tail..].to_lowercase();
        if SLOPES.iter().any(|slope| words.contains(slope)) {
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
        let feet: String = text[at + 1..].trim_start().chars().take(2).collect();
        if !matches!(feet.as_str(), "1'" | "1\u{2032}" | "1\u{2019}") {
            return None;
        }
        let inches = text[..at].trim_end().strip_suffix(['"', '\u{2033}', '\u{201d}'])?;
        let is_part = |c: char| c.is_ascii_digit() || matches!(c, '/' | ' ' | '-');
        let start = inches.char_indices().rev().take_while(|(_, c)| is_part(*c)).last()?.0;
        // A mixed number such as "1 1/2" or "1-1/2" is a sum.
        let mut sum = 0.0;
        for part in inches[start..].split([' ', '-']).filter(|part| !part.is_empty()) {
            let (top, bottom) = part.split_once('/').unwrap_or((part, "1"));
            sum += top.parse::<f64>().ok()? / bottom.parse::<f64>().ok()?;
        }
        let denominator = (12.0 / sum).round();
        let is_whole = (12.0 / sum - denominator).abs() < 1e-9 && (1.0..1e6).contains(&denominator);
        is_whole.then_some(denominator as u32)
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
            ("1 1/2\" = 1'-0\"", vec![8]),
            ("1-1/2\" = 1'-0\"", vec![8]),
            ("Ramp 1:12, scale 1:50", vec![50]),
            ("Gef\u{e4}lle 1:50", vec![]),
            ("", vec![]),
        ] {
            assert_eq!(denominators(text), expected, "{text}");
        }
    }
}
