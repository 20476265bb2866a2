//! Images that the site names outside its folder.

use std::collections::BTreeSet;
use std::path::PathBuf;

/// What became of the images that the site names outside its folder.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Outside {
    /// Files that wait for a decision, without links in their paths.
    pub asked: BTreeSet<PathBuf>,
    /// Files that are left out.
    pub(crate) left: BTreeSet<PathBuf>,
    /// The names that the site had for its images when they were looked at.
    pub(crate) names: Vec<String>,
}
