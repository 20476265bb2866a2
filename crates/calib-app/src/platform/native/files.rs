//! Files of the disk: whole, or none.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use calib_editor::file_name::is_image;
use calib_editor::{FileResult, Reach};
use calib_input::Part;
use calib_site::MAX_BYTES;

/// Reads a file of any size a site or image may have.
///
/// # Errors
/// When it is no regular file that is there, or larger than that.
pub(super) fn read(path: &Path) -> FileResult<Vec<u8>> {
    calib_input::read(path, MAX_BYTES as u64).map_err(|error| format!("{}: {error}", path.display()))
}

/// Reads a file as [`read`] does, if it is within reach.
///
/// # Errors
/// When it is not, and as that.
pub(super) fn read_within(path: &Path, reach: &Reach) -> FileResult<Vec<u8>> {
    let real = path.canonicalize().map_err(|error| format!("{}: {error}", path.display()))?;
    // What is asked about is what is read: no link is followed in between.
    if !reach.holds(&real, |path| path.canonicalize().ok()) {
        let why =
            "outside the folder of the site, and left out. \u{201c}Read images again\u{201d} asks for it.";
        return Err(format!("{}: {why}", path.display()));
    }
    read(&real)
}

/// Writes a file whole or not at all, and waits until the disk has it.
///
/// # Errors
/// When the folder cannot be written to.
pub(super) fn write(path: &Path, bytes: &[u8]) -> FileResult<()> {
    write_to(path, bytes, true)
}

/// Writes a file whole or not at all. It survives the end of this program, not that of the machine.
///
/// # Errors
/// When the folder cannot be written to.
pub(super) fn write_quickly(path: &Path, bytes: &[u8]) -> FileResult<()> {
    write_to(path, bytes, false)
}

fn write_to(path: &Path, bytes: &[u8], waits: bool) -> FileResult<()> {
    let place = calib_input::place(path, true).map_err(|error| error.to_string())?;
    let written = place.parent().map_or(Ok(()), std::fs::create_dir_all).and_then(|()| {
        let part = Part::beside(&place)?;
        part.file().write_all(bytes)?;
        if waits {
            part.file().sync_data()?;
        }
        part.persist(&place, true)
    });
    written.map_err(|error| format!("{}: {error}", path.display()))
}

/// Where autosaves and the demonstration's images live.
#[must_use]
pub(super) fn data_dir() -> Option<PathBuf> {
    eframe::storage_dir("calib")
}

/// The images in a folder, by name.
#[must_use]
pub(super) fn images_in(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(|path| is_image(path)).collect();
    paths.sort();
    paths
}

/// Forgets the file of an autosave, and its images.
pub(super) fn forget(folder: &Path, file: &Path) {
    // What is not there need not be removed.
    let _ = std::fs::remove_file(file);
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    for entry in entries.filter(|entry| entry.file_name().to_string_lossy().starts_with("image-")) {
        let _ = std::fs::remove_file(entry.path());
    }
}
