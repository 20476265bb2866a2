//! What is wrong with a file, and where in it.

use std::fmt;

/// Why a file could not be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FormatError {
    /// The file, and the place in it: a JSON pointer or a line.
    pub place: String,
    /// What was found and what is expected.
    pub message: String,
}

impl FormatError {
    pub(crate) fn new(place: impl Into<String>, message: impl Into<String>) -> Self {
        Self { place: place.into(), message: message.into() }
    }

    pub(crate) fn expected(
        place: impl Into<String>,
        found: impl fmt::Display,
        wanted: impl fmt::Display,
    ) -> Self {
        Self::new(place, format!("found {found}, expected {wanted}"))
    }
}

impl fmt::Display for FormatError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.place, self.message)
    }
}

impl std::error::Error for FormatError {}

/// A hostile text does not fill the screen.
pub(crate) fn quoted(text: &str) -> String {
    const MOST: usize = 60;
    let short: String = text.chars().take(MOST).collect();
    if short.len() < text.len() { format!("{short:?}...") } else { format!("{short:?}") }
}
