//! Stills that the command line names: files, folders of them, and when they were taken.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use calib_core::MAX_BYTES;
use image::RgbImage;
use jiff::Timestamp;

use crate::stop::Stop;

/// The stills that are asked for, those of folders in the order of their names.
pub(crate) fn listed(asked: &[PathBuf]) -> Result<Vec<PathBuf>, Stop> {
    let mut found = Vec::new();
    for path in asked {
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
    match time_in(&stem(path)) {
        Some(time) => Ok(Some(time)),
        None => Ok(calib_input::taken(&bytes(path)?).and_then(|taken| taken.parse().ok())),
    }
}

/// The name of a still without its folder and its ending.
pub(crate) fn stem(path: &Path) -> String {
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

/// The time that a name says, such as `2026-05-01T080000Z` or `20260501_0800`: of UTC, as names of files have no zone.
fn time_in(name: &str) -> Option<Timestamp> {
    (0..name.len()).filter(|&start| begins_a_number(name, start)).find_map(|start| time_at(&name[start..]))
}

fn begins_a_number(name: &str, start: usize) -> bool {
    let is_digit = |at: usize| name.as_bytes().get(at).is_some_and(u8::is_ascii_digit);
    is_digit(start) && !(start > 0 && is_digit(start - 1))
}

/// A time at the start of a text: year, month and day, then hour and minute, then seconds if there are any.
fn time_at(text: &str) -> Option<Timestamp> {
    let mut rest = text;
    let mut number = |digits: usize| {
        let skipped = rest.trim_start_matches(['-', '_', ':', '.', 'T', ' ']);
        // One separator at most.
        if rest.len() - skipped.len() > 1 {
            return None;
        }
        let found = skipped.get(..digits).filter(|part| part.bytes().all(|byte| byte.is_ascii_digit()))?;
        rest = &skipped[digits..];
        found.parse::<u32>().ok()
    };
    let (year, month, day) = (number(4)?, number(2)?, number(2)?);
    let (hour, minute) = (number(2)?, number(2)?);
    let second = number(2).unwrap_or(0);
    let is_of_now = (1990..2200).contains(&year);
    let text = format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z");
    text.parse().ok().filter(|_| is_of_now)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_when_stills_were_taken() {
        let expected: Timestamp = "2026-05-01T08:30:05Z".parse().expect("a time");
        for name in
            ["door-2026-05-01T083005Z", "door_20260501_083005", "20260501083005", "cam12 2026-05-01 08.30.05"]
        {
            assert_eq!(time_in(name), Some(expected), "{name}");
        }
        assert_eq!(
            time_in("door_20260501-0830").map(|at| at.to_string()).as_deref(),
            Some("2026-05-01T08:30:00Z")
        );
        for name in ["door", "shop-1", "20261301_083000", "12345678901234567", "2026-05-01", "tür-2026"] {
            assert_eq!(time_in(name), None, "{name}");
        }
    }
}
