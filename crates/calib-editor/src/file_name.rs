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

/// What a camera is called whose still is this file: the file's stem, unless that is but a number, as programs
/// that cut videos give; then the folder tells more.
#[must_use]
pub fn camera_name(path: &Path) -> String {
    let text = |part: Option<&std::ffi::OsStr>| part.map(|part| part.to_string_lossy().into_owned());
    let stem = text(path.file_stem()).unwrap_or_default();
    let words = ["frame", "image", "img", "still", "snapshot", "snap", "shot", "pic", "picture"];
    let rest = stem.trim_matches(|c: char| c.is_ascii_digit() || "_- .()".contains(c)).to_lowercase();
    let says_nothing = rest.is_empty() || words.contains(&rest.as_str());
    let folder = text(path.parent().and_then(Path::file_name));
    folder.filter(|folder| says_nothing && !folder.is_empty()).unwrap_or(stem)
}

/// The type of an image of this name.
#[must_use]
pub fn mime(name: &str) -> &'static str {
    if name.to_lowercase().ends_with(".png") { "image/png" } else { "image/jpeg" }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_is_called_by_what_tells_it_from_the_others() {
        let called = |path: &str| camera_name(Path::new(path));
        assert_eq!(called("/site/yard-north/0000.png"), "yard-north");
        assert_eq!(called("/site/yard-south/frame_0001.jpg"), "yard-south");
        assert_eq!(called("/site/yard-north.png"), "yard-north");
        assert_eq!(called("0000.png"), "0000");
    }
}
