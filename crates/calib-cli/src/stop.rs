//! Why a command ends early, and with which exit code.
//!
//! Words as they may be shown on a terminal.

use std::borrow::Cow;
use std::fmt;

#[cfg(feature = "archives")]
use calib_table::TableError;

/// The end of a command that is not success.
#[derive(Debug)]
pub(crate) enum Stop {
    /// Something went wrong that is not the input's fault: 1.
    Failed(anyhow::Error),
    /// The command line asks for something that does not exist: 2.
    Usage(String),
    /// The input is invalid: 3.
    Invalid(String),
    /// A camera could not be solved or a gate failed; results are written: 4.
    Unsolved(String),
    /// A format cannot hold the calibration, and nobody agreed to that: 5.
    Lossy(String),
    /// The reader of our output has gone: success, silently.
    ReaderGone,
}

impl Stop {
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

    /// Why a table cannot be mapped.
    #[cfg(feature = "archives")]
    pub(crate) fn of_table(error: TableError) -> Self {
        match error {
            TableError::Usage(what) => Self::Usage(what),
            TableError::Invalid(what) => Self::Invalid(what),
            TableError::Unsolved(what) => Self::Unsolved(what),
            TableError::Arrow(error) => error.into(),
        }
    }

    /// A failure with what was being done; ends of other kinds say all that there is.
    pub(crate) fn while_doing(self, what: impl FnOnce() -> String) -> Self {
        match self {
            Self::Failed(error) => Self::Failed(error.context(what())),
            other => other,
        }
    }

    /// Invalid input in a file.
    pub(crate) fn invalid(file: impl fmt::Display, what: impl fmt::Display) -> Self {
        Self::Invalid(format!("{file}: {what}"))
    }
}

impl<E: Into<anyhow::Error>> From<E> for Stop {
    fn from(error: E) -> Self {
        let error = error.into();
        let is_gone = |e: &std::io::Error| e.kind() == std::io::ErrorKind::BrokenPipe;
        if error.chain().any(|cause| cause.downcast_ref().is_some_and(is_gone)) {
            return Self::ReaderGone;
        }
        Self::Failed(error)
    }
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
}
