//! What the name of a file tells of what is in it.

use std::path::Path;

/// Whether a name has this ending, in capitals or not.
#[must_use]
pub fn has_ending(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(ending))
}

/// Whether a name ends like an image that can be read.
#[must_use]
pub fn is_image(path: &Path) -> bool {
    ["png", "jpg", "jpeg"].iter().any(|ending| has_ending(path, ending))
}

/// The part of a path after its last separator, whichever system wrote it.
#[must_use]
pub fn base(name: &str) -> &str {
    name.rsplit(['/', '\\']).next().unwrap_or(name)
}

/// The type of an image of this name.
#[must_use]
pub fn mime(name: &str) -> &'static str {
    if name.to_lowercase().ends_with(".png") { "image/png" } else { "image/jpeg" }
}
