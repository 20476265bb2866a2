//! Words and numbers as the operator reads them.

use std::borrow::Cow;

/// Names in a row, cut short: "a, b, c and 997 more".
pub(crate) fn few<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    /// A list that the eye takes in is written out.
    const MOST: usize = 6;
    const SHOWN: usize = 3;
    let names: Vec<&str> = names.into_iter().collect();
    if names.len() <= MOST {
        return names.join(", ");
    }
    format!("{} and {} more", names[..SHOWN].join(", "), names.len() - SHOWN)
}

/// Metres as centimetres, with a decimal as long as it says something.
pub(crate) fn centimetres(metres: f64) -> String {
    let value = 100.0 * metres;
    if value < 100.0 { format!("{value:.1}") } else { format!("{value:.0}") }
}

/// A distance in the unit that suits it.
pub(crate) fn distance(metres: f64) -> String {
    if metres < 1.0 { format!("{} cm", centimetres(metres)) } else { format!("{metres:.1} m") }
}

/// Text as it may be shown on a terminal: names come from anywhere, and what would move the cursor, colour the
/// screen or turn the direction of writing is spelt out.
pub(crate) fn visible(text: &str) -> Cow<'_, str> {
    let is_shown = |c: char| matches!(c, '\n' | '\t') || !(c.is_control() || turns_writing(c));
    if text.chars().all(is_shown) {
        return Cow::Borrowed(text);
    }
    let spelt = |c: char| if is_shown(c) { c.to_string() } else { c.escape_unicode().to_string() };
    Cow::Owned(text.chars().map(spelt).collect())
}

/// Marks, embeddings, overrides and isolates of the direction of writing (Unicode standard annex 9).
fn turns_writing(c: char) -> bool {
    matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_terminal_would_obey_is_spelt_out() {
        assert_eq!(visible("Tür 3\n\tok"), "Tür 3\n\tok");
        assert_eq!(visible("a\u{1b}[2Jb\r\u{9b}31m"), "a\\u{1b}[2Jb\\u{d}\\u{9b}31m");
        assert_eq!(visible("gnp.\u{202e}exe"), "gnp.\\u{202e}exe");
    }

    #[test]
    fn long_lists_of_names_are_cut_short() {
        assert_eq!(few(["a", "b"]), "a, b");
        let many: Vec<String> = (0..1000).map(|i| format!("c{i}")).collect();
        assert_eq!(few(many.iter().map(String::as_str)), "c0, c1, c2 and 997 more");
    }
}
