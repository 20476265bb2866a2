//! A path that is typed where the system has no file chooser.

use crate::choice::Purpose;

/// A path that is being typed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PathField {
    /// What for.
    pub purpose: Purpose,
    /// What was typed.
    pub text: String,
}
