//! Reasons why a drawing is not read.

use thiserror::Error;

/// Reason why a drawing is not read, with advice for the operator.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PlanError {
    /// Page number that the document does not have.
    #[error("page {page} does not exist; the last page is {pages}")]
    Page {
        /// Number of the page, from 1.
        page: u32,
        /// Number of pages.
        pages: usize,
    },
    /// Drawing without visible lines; contains advice for the message, or an empty text.
    #[error("the drawing has no visible lines in its model space{0}")]
    Empty(String),
    /// Document that is protected by a password.
    #[error("the PDF is protected by a password; save it without the password")]
    Password,
    /// Damaged file.
    #[error("the {kind} is damaged: {reason}; export it again")]
    Damaged {
        /// File type.
        kind: &'static str,
        /// Description of the damage.
        reason: String,
    },
    /// Drawing that exceeds a limit of memory, time or nesting.
    #[error("the {kind} is too large: {reason}")]
    Limit {
        /// File type.
        kind: &'static str,
        /// Limit, and advice.
        reason: String,
    },
    /// File type that is not supported; contains the message, with advice.
    #[error("{0}")]
    Unsupported(String),
}
