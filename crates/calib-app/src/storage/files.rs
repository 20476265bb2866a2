//! Site files: opened and saved whole.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::path::{Path, PathBuf};

pub use calib_editor::{FileResult, Images};
use calib_site::Site;

use crate::platform::{Here, Platform as _};

/// Where autosaves and the demonstration's images live.
#[must_use]
pub fn data_dir() -> Option<PathBuf> {
    Here::data_dir()
}

/// What a file held when it was read: another window that writes it makes another one.
#[must_use]
pub fn stamp(bytes: &[u8]) -> u64 {
    let mut hasher = DefaultHasher::new();
    bytes.hash(&mut hasher);
    hasher.finish()
}

/// Reads a site file.
///
/// # Errors
/// When it cannot be read or is no site.
pub fn open(path: &Path) -> FileResult<(Site, Images)> {
    open_stamped(path).map(|(site, images, _)| (site, images))
}

/// Reads a site file, and what it held.
///
/// # Errors
/// When it cannot be read or is no site.
pub fn open_stamped(path: &Path) -> FileResult<(Site, Images, u64)> {
    let bytes = Here::read(path)?;
    let held = stamp(&bytes);
    let text = String::from_utf8(bytes).map_err(|_| format!("{}: not text", path.display()))?;
    let folder = path.parent().map(Path::to_path_buf);
    let (site, images) =
        calib_editor::parse(&text, folder).map_err(|error| format!("{}: {error}", path.display()))?;
    Ok((site, images, held))
}

/// Writes a site file, and tells what it holds; from then on its images are looked for beside it.
///
/// # Errors
/// When it cannot be written.
pub fn save(path: &Path, site: &Site, images: &Images) -> FileResult<u64> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let text = images.put_into(site, Some(folder)).to_json();
    Here::write(path, text.as_bytes()).map(|()| stamp(text.as_bytes()))
}
