//! Files on disk, written atomically; the system's file chooser; and locks of folders.

use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::pin::Pin;

use calib_editor::{AllowedFiles, FileResult, world_endings};
use calib_input::PartialFile;
use calib_site::MAX_BYTES;

use crate::choice::{Chosen, Purpose, SITE, images, images_and_videos, plans};
use crate::platform::Answer;

/// Reads a file, up to the largest size of a site or an image.
///
/// # Errors
/// When the file is missing, not a regular file, or too large.
pub(super) fn read(path: &Path) -> FileResult<Vec<u8>> {
    calib_input::read(path, MAX_BYTES as u64).map_err(|error| format!("{}: {error}", path.display()))
}

/// Reads a file as [`read`] does, if `reach` allows its path after all links are resolved.
///
/// # Errors
/// When the path is not allowed, and as `read`.
pub(super) fn read_within(path: &Path, reach: &AllowedFiles) -> FileResult<Vec<u8>> {
    let real = path.canonicalize().map_err(|error| format!("{}: {error}", path.display()))?;
    // The checked path is also the path that is read: no link is followed in between.
    if !reach.allows(&real, |path| path.canonicalize().ok()) {
        let why = "This file is outside the site's folder and was not read. To read it, use \
                   \u{201c}Reload images and detect edges again\u{201d}.";
        return Err(format!("{}: {why}", path.display()));
    }
    read(&real)
}

/// Writes a file atomically, and waits until it is on disk.
///
/// # Errors
/// When the folder cannot be written to.
pub(super) fn write(path: &Path, bytes: &[u8]) -> FileResult<()> {
    write_to(path, bytes, true)
}

/// Writes a file atomically, without waiting for the disk.
///
/// # Errors
/// When the folder cannot be written to.
pub(super) fn write_quickly(path: &Path, bytes: &[u8]) -> FileResult<()> {
    write_to(path, bytes, false)
}

/// Writes a file atomically. If `waits` is set, returns only when the file is on disk.
fn write_to(path: &Path, bytes: &[u8], waits: bool) -> FileResult<()> {
    let place = calib_input::resolve_target(path, true).map_err(|error| error.to_string())?;
    let written = place.parent().map_or(Ok(()), std::fs::create_dir_all).and_then(|()| {
        let part = PartialFile::new_for(&place)?;
        part.file().write_all(bytes)?;
        if waits {
            part.file().sync_data()?;
        }
        part.persist(&place, true)
    });
    written.map_err(|error| format!("{} cannot be written: {error}", path.display()))
}

/// Returns the folder of autosaves and of the demonstration's images.
#[must_use]
pub(super) fn data_dir() -> Option<PathBuf> {
    eframe::storage_dir("calib")
}

/// Returns the paths of the visible files in a folder, sorted by name; `None` if the path is not a folder.
#[must_use]
pub(super) fn files_in(folder: &Path) -> Option<Vec<PathBuf>> {
    let is_visible_file = |path: &PathBuf| {
        let is_hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
        path.is_file() && !is_hidden
    };
    let entries = std::fs::read_dir(folder).ok()?.flatten();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(is_visible_file).collect();
    paths.sort();
    Some(paths)
}

/// Returns at most the first `bytes` bytes of a regular file; empty if it cannot be read.
pub(super) fn head(path: &Path, bytes: usize) -> Vec<u8> {
    let mut head = Vec::new();
    // Opening a pipe would wait for its writer.
    if path.is_file()
        && let Ok(file) = std::fs::File::open(path)
    {
        // After an error, the bytes read so far are returned.
        let _ = file.take(bytes as u64).read_to_end(&mut head);
    }
    head
}

/// Deletes the autosave `file` and the images in its folder.
pub(super) fn forget(folder: &Path, file: &Path) {
    // A missing file needs no deletion.
    let _ = std::fs::remove_file(file);
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    for entry in entries.filter(|entry| entry.file_name().to_string_lossy().starts_with("image-")) {
        let _ = std::fs::remove_file(entry.path());
    }
}

/// Lock of an autosave folder. The system releases it when the process ends, even if the process is killed.
#[derive(Debug)]
pub(crate) struct Claim {
    /// Lock file, which the system locks until the file is closed.
    _lock: Option<std::fs::File>,
}

impl Claim {
    /// Locks an autosave folder; `None` if another window has locked it.
    #[must_use]
    pub(crate) fn of(folder: &Path) -> Option<Self> {
        let open = || {
            std::fs::create_dir_all(folder)?;
            std::fs::File::options().create(true).append(true).open(folder.join("lock"))
        };
        // A folder that cannot be written to needs no lock; writing reports the error.
        let Ok(file) = open() else { return Some(Self { _lock: None }) };
        match file.try_lock() {
            Err(std::fs::TryLockError::WouldBlock) => None,
            Ok(()) | Err(std::fs::TryLockError::Error(_)) => Some(Self { _lock: Some(file) }),
        }
    }
}

/// Opens a file chooser for opening or saving, according to the purpose.
pub(super) fn ask(purpose: Purpose) -> Answer {
    let dialog = rfd::AsyncFileDialog::new();
    let one = |file: rfd::FileHandle| Chosen {
        name: file.file_name(),
        path: Some(file.path().to_path_buf()),
        bytes: None,
    };
    let site = |title: &str| dialog.clone().set_title(title).add_filter("Site", SITE);
    let image_endings = images();
    let images = |title: &str| dialog.clone().set_title(title).add_filter("Images", &image_endings);
    let answer: Pin<Box<dyn Future<Output = Vec<rfd::FileHandle>>>> = match purpose {
        Purpose::AddImages => {
            let endings = images_and_videos();
            let files = dialog.set_title("Add images").add_filter("Images and videos", &endings).pick_files();
            Box::pin(async { files.await.unwrap_or_default() })
        }
        Purpose::NewerStill => {
            let files = images("Choose newer images").pick_files();
            Box::pin(async { files.await.unwrap_or_default() })
        }
        Purpose::SaveSite | Purpose::SavePlain => {
            let file = site("Save the site").set_file_name("site.json").save_file();
            Box::pin(async { file.await.into_iter().collect() })
        }
        Purpose::Open => {
            let files = dialog.set_title("Open a site, images, a plan or a calibration").pick_files();
            Box::pin(async { files.await.unwrap_or_default() })
        }
        Purpose::Compare => {
            let file = site("Choose a saved version of the site").pick_file();
            Box::pin(async { file.await.into_iter().collect() })
        }
        Purpose::ReplaceStill => {
            let file = images("Choose an image").pick_file();
            Box::pin(async { file.await.into_iter().collect() })
        }
        Purpose::LoadPlan => {
            let endings = [&plans(), world_endings()].concat();
            let files = dialog.set_title("Choose a floor plan").add_filter("Plans", &endings).pick_files();
            Box::pin(async { files.await.unwrap_or_default() })
        }
        Purpose::Import => {
            let files = dialog.set_title("Import lenses or cameras").pick_files();
            Box::pin(async { files.await.unwrap_or_default() })
        }
        Purpose::SavePicture => {
            let picture = dialog.set_title("Save a screenshot").add_filter("PNG image", &["png"]);
            let file = picture.set_file_name("view.png").save_file();
            Box::pin(async { file.await.into_iter().collect() })
        }
        Purpose::SaveReport => {
            let page = dialog.set_title("Save the report").add_filter("HTML page", &["html"]);
            let file = page.set_file_name("report.html").save_file();
            Box::pin(async { file.await.into_iter().collect() })
        }
        Purpose::Export => {
            let folder = dialog.set_title("Export to a folder").pick_folder();
            Box::pin(async { folder.await.into_iter().collect() })
        }
    };
    Box::pin(async move { answer.await.into_iter().map(one).collect() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_claimed_once_until_it_is_let_go() {
        let folder = tempfile::tempdir().unwrap();
        let claim = Claim::of(folder.path());
        assert!(claim.is_some() && Claim::of(folder.path()).is_none());
        drop(claim);
        assert!(Claim::of(folder.path()).is_some());
    }
}
