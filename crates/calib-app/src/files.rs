//! Site files: opened and saved whole.

use std::path::{Path, PathBuf};

use calib_core::Site;
pub use calib_editor::{FileResult, Images};

use crate::platform::{Here, Platform as _};

/// Where autosaves and the demonstration's images live.
#[must_use]
pub fn data_dir() -> Option<PathBuf> {
    Here::data_dir()
}

/// Reads a site file.
///
/// # Errors
/// When it cannot be read or is no site.
pub fn open(path: &Path) -> FileResult<(Site, Images)> {
    let text = String::from_utf8(Here::read(path)?).map_err(|_| format!("{}: not text", path.display()))?;
    let folder = path.parent().map(Path::to_path_buf);
    calib_editor::parse(&text, folder).map_err(|error| format!("{}: {error}", path.display()))
}

/// Writes a site file; from then on its images are looked for beside it.
///
/// # Errors
/// When it cannot be written.
pub fn save(path: &Path, site: &Site, images: &Images) -> FileResult<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    Here::write(path, images.put_into(site, Some(folder)).to_json().as_bytes())
}
