//! Stills that the command line names: files, folders of them, and when they were taken.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use calib_site::MAX_BYTES;
use image::RgbImage;
use jiff::Timestamp;

use crate::stop::Stop;

/// The stills that are asked for, those of folders in the order of their names.
pub(crate) fn listed(asked: &[PathBuf]) -> Result<Vec<PathBuf>, Stop> {
    let mut found = Vec::new();
    for path in asked {
        if !path.exists() {
            return Err(Stop::invalid(path.display(), "there is no such still or folder"));
        }
        if !path.is_dir() {
            found.push(path.clone());
            continue;
        }
        let reading = || format!("reading {}", path.display());
        let entries = std::fs::read_dir(path).with_context(reading)?;
        let paths = entries.map(|entry| entry.map(|entry| entry.path()));
        let mut inside = paths.collect::<Result<Vec<PathBuf>, _>>().with_context(reading)?;
        inside.retain(|path| is_still(path));
        inside.sort();
        if inside.is_empty() {
            return Err(Stop::invalid(path.display(), "no stills are in this folder (.png, .jpg, .jpeg)"));
        }
        found.extend(inside);
    }
    Ok(found)
}

fn is_still(path: &Path) -> bool {
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
    path.is_file() && matches!(extension.as_deref(), Some("png" | "jpg" | "jpeg"))
}

/// The pixels of a still, within limits.
pub(crate) fn read(path: &Path) -> Result<RgbImage, Stop> {
    calib_input::decode(&bytes(path)?).map_err(|error| Stop::invalid(path.display(), error))
}

/// The bytes of a still, within limits.
pub(crate) fn bytes(path: &Path) -> Result<Vec<u8>, Stop> {
    calib_input::read(path, MAX_BYTES as u64).map_err(|error| Stop::invalid(path.display(), error))
}

/// When a still was taken: as its name says, else as the clock of its camera.
pub(crate) fn time(path: &Path) -> Result<Option<Timestamp>, Stop> {
    let told = match calib_input::time_in_name(&stem(path)) {
        Some(time) => Some(time),
        None => calib_input::taken(&bytes(path)?),
    };
    Ok(told.and_then(|time| time.parse().ok()))
}

/// The name of a still without its folder and its ending.
pub(crate) fn stem(path: &Path) -> String {
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}
