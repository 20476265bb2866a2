//! Reading and writing of site files.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::path::{Path, PathBuf};

use calib_editor::parse_with_drawing;
pub use calib_editor::{FileResult, Images};
use calib_site::{Plan, Site};

use crate::drawing::plan_view;
use crate::platform::{Here, Platform as _};

/// Returns the folder of autosaves and of the demonstration's images; `None` in the browser.
#[must_use]
pub fn data_dir() -> Option<PathBuf> {
    Here::data_dir()
}

/// Returns the hash of a file's content, which shows whether another program changed it.
#[must_use]
pub fn stamp(bytes: &[u8]) -> u64 {
    let mut hasher = DefaultHasher::new();
    bytes.hash(&mut hasher);
    hasher.finish()
}

/// Reads a site file; returns the site and its image source.
///
/// # Errors
/// When the file cannot be read or is not a valid site.
pub fn open(path: &Path) -> FileResult<(Site, Images)> {
    open_stamped(path).map(|(site, images, _)| (site, images))
}

/// Reads a site file; returns the site, its image source, and the hash of the file content.
///
/// # Errors
/// When the file cannot be read or is not a valid site.
pub fn open_stamped(path: &Path) -> FileResult<(Site, Images, u64)> {
    let bytes = Here::read(path)?;
    let held = stamp(&bytes);
    let text = site_text(bytes).map_err(|error| format!("{}: {error}", path.display()))?;
    let folder = path.parent().map(Path::to_path_buf);
    let drawings = Images::in_folder(folder.clone(), None);
    let (site, images) = parse_with_drawing(&text, folder, |plan| scale_of_drawing(plan, &drawings))
        .map_err(|error| format!("{}: {error}", path.display()))?;
    Ok((site, images, held))
}

/// Returns the text of a site file.
///
/// # Errors
/// When the bytes are not UTF-8.
pub(super) fn site_text(bytes: Vec<u8>) -> FileResult<String> {
    String::from_utf8(bytes).map_err(|_| "the file is not UTF-8 text. Choose a site file.".into())
}

/// Returns the scale in the drawing of a plan, in metres per pixel. `None` if the plan is not a drawing or contains
/// no scale.
fn scale_of_drawing(plan: &Plan, images: &Images) -> Option<f64> {
    let bytes = images.reader(plan.image.as_ref()?).read(Here::read_within).ok()?;
    calib_plan::read(&bytes, &plan_view(plan))?.ok()?.facts.metres_per_px
}
/// Writes a site file; returns the hash of the file content. Image names in the file are relative to its
/// folder.
///
/// # Errors
/// When the file cannot be written.
pub fn save(path: &Path, site: &Site, images: &Images) -> FileResult<u64> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let text = images.embed_into(site, Some(folder)).to_json();
    Here::write(path, text.as_bytes()).map(|()| stamp(text.as_bytes()))
}
