//! What keeps the site from being written to a file without asking.

use std::path::PathBuf;

/// Why a file is not written without asking.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Why {
    /// It is not what was read: somebody wrote it meanwhile. What differs, in words.
    Changed(Vec<String>),
    /// It may not be written to.
    ReadOnly,
}

/// A file that is not written without asking.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Conflict {
    /// Which.
    pub path: PathBuf,
    /// Why.
    pub why: Why,
}

/// What the operator decides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    /// Opens what the file holds now; the work on the open site is kept aside.
    Reload,
    /// Writes another file.
    SaveAs,
    /// Writes this one all the same.
    Overwrite,
    /// Nothing is written.
    Leave,
}
