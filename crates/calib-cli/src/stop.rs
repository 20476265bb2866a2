//! Errors of commands with their exit codes, and text that is safe to show on a terminal.

use std::borrow::Cow;
use std::fmt;

#[cfg(feature = "archives")]
use calib_table::TableError;

/// Reason why a command did not succeed, with its exit code.
#[derive(Debug)]
pub(crate) enum CommandError {
    /// General failure that is not caused by the input: exit code 1.
    Failed(anyhow::Error),
    /// Invalid arguments on the command line: exit code 2.
    Usage(String),
    /// Invalid input: exit code 3.
    Invalid(String),
    /// Unsolved or changed camera, or failed quality gate: exit code 4. Results may have been written.
    Unsolved(String),
    /// Export refused because the format loses data: exit code 5.
    Lossy(String),
    /// Reader of the output closed the pipe: success, without a message.
    ReaderGone,
}

impl CommandError {
    pub(crate) fn code(&self) -> u8 {
        match self {
            Self::Failed(_) => 1,
            Self::Usage(_) => 2,
            Self::Invalid(_) => 3,
            Self::Unsolved(_) => 4,
            Self::Lossy(_) => 5,
            Self::ReaderGone => 0,
        }
    }

    pub(crate) fn message(&self) -> Option<String> {
        match self {
            Self::Failed(error) => Some(format!("{error:#}")),
            Self::Usage(message)
            | Self::Invalid(message)
            | Self::Unsolved(message)
            | Self::Lossy(message) => Some(message.clone()),
            Self::ReaderGone => None,
        }
    }

    /// Converts an error of a table.
    #[cfg(feature = "archives")]
    pub(crate) fn from_table_error(error: TableError) -> Self {
        match error {
            TableError::Usage(what) => Self::Usage(what),
            TableError::Invalid(what) => Self::Invalid(what),
            TableError::Unsolved(what) => Self::Unsolved(what),
            TableError::Arrow(error) => error.into(),
        }
    }

    /// Adds the current operation to a general failure; other errors are already complete.
    pub(crate) fn add_context(self, what: impl FnOnce() -> String) -> Self {
        match self {
            Self::Failed(error) => Self::Failed(error.context(what())),
            other => other,
        }
    }

    /// Creates an error for invalid input in a file.
    pub(crate) fn invalid(file: impl fmt::Display, what: impl fmt::Display) -> Self {
        Self::Invalid(format!("{file}: {what}"))
    }
}

impl<E: Into<anyhow::Error>> From<E> for CommandError {
    fn from(error: E) -> Self {
        let error = error.into();
        let is_gone = |e: &std::io::Error| e.kind() == std::io::ErrorKind::BrokenPipe;
        if error.chain().any(|cause| cause.downcast_ref().is_some_and(is_gone)) {
            return Self::ReaderGone;
        }
        Self::Failed(error)
    }
}

/// Escapes characters that could move the cursor, change colours or reverse the writing direction on a
/// terminal. Names in a site may contain any character.
pub(crate) fn escape_control_characters(text: &str) -> Cow<'_, str> {
    let is_shown = |c: char| matches!(c, '\n' | '\t') || !(c.is_control() || is_direction_mark(c));
    if text.chars().all(is_shown) {
        return Cow::Borrowed(text);
    }
    let spelt = |c: char| if is_shown(c) { c.to_string() } else { c.escape_unicode().to_string() };
    Cow::Owned(text.chars().map(spelt).collect())
}

/// Whether a character is a mark, embedding, override or isolate of writing direction (Unicode Standard Annex
/// 9).
fn is_direction_mark(c: char) -> bool {
    matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_escaped() {
        assert_eq!(escape_control_characters("Tür 3\n\tok"), "Tür 3\n\tok");
        assert_eq!(escape_control_characters("a\u{1b}[2Jb\r\u{9b}31m"), "a\\u{1b}[2Jb\\u{d}\\u{9b}31m");
        assert_eq!(escape_control_characters("gnp.\u{202e}exe"), "gnp.\\u{202e}exe");
    }
}
