//! Words as they may be shown on a terminal.

use std::borrow::Cow;

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
}
