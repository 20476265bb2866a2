//! Why a table cannot be mapped.

use std::fmt;

use arrow_schema::ArrowError;

/// Why a table cannot be mapped.
#[derive(Debug)]
pub enum TableError {
    /// What is asked for does not go together.
    Usage(String),
    /// The table is not one that can be mapped.
    Invalid(String),
    /// A camera is not calibrated.
    Unsolved(String),
    /// Arrow cannot do it.
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
