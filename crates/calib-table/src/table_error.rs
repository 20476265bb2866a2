//! Error type of this crate.

use std::fmt;

use arrow_schema::ArrowError;

/// Reason why a table cannot be mapped.
#[derive(Debug)]
pub enum TableError {
    /// Contradictory or incomplete options.
    Usage(String),
    /// Table with invalid content.
    Invalid(String),
    /// Camera without a calibration.
    Unsolved(String),
    /// Error of the Arrow library.
    Arrow(ArrowError),
}

impl fmt::Display for TableError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Usage(what) | Self::Invalid(what) | Self::Unsolved(what) => f.write_str(what),
            Self::Arrow(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for TableError {}

impl From<ArrowError> for TableError {
    fn from(error: ArrowError) -> Self {
        Self::Arrow(error)
    }
}
