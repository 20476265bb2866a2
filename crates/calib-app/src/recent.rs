//! The sites that were opened or saved last, to be gone on with from the start page.

use std::path::{Path, PathBuf};

use calib_site::Site;
use serde::{Deserialize, Serialize};

use crate::platform::{Here, Platform as _};

/// A site that was opened or saved.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Recent {
    /// Its file.
    pub path: PathBuf,
    /// What its operator calls it.
    pub name: String,
    /// How many cameras it has.
    pub cameras: usize,
    /// The still of its first camera, if that is a file.
    pub image: Option<PathBuf>,
    /// When, in seconds since 1970.
    pub at: u64,
}

/// So many are remembered.
const MOST: usize = 8;

impl Recent {
    /// A site as it is remembered; its images are looked for beside `path`.
    #[must_use]
    pub fn of(path: &Path, site: &Site, at: u64) -> Self {
        let stem = path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
        let image = site.cameras.iter().find_map(|camera| camera.image.as_deref());
        let is_file = |image: &&str| !image.starts_with("data:") && !image.starts_with("stored:");
        let folder = path.parent().unwrap_or(Path::new("."));
        Self {
            path: path.to_path_buf(),
            name: site.name.clone().unwrap_or(stem),
            cameras: site.cameras.len(),
            image: image.filter(is_file).map(|image| folder.join(image)),
            at,
        }
    }
}

fn file(folder: &Path) -> PathBuf {
    folder.join("recent.json")
}

/// What is remembered in a folder, the newest first; files that are gone are left out.
#[must_use]
pub fn list(folder: &Path) -> Vec<Recent> {
    let known = Here::read(&file(folder)).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok());
    let known: Vec<Recent> = known.unwrap_or_default();
    known.into_iter().filter(|recent| recent.path.is_file()).collect()
}

/// The list with one more in front, as it is kept in a folder from now on.
#[must_use]
pub fn remember(folder: &Path, recent: Recent) -> Vec<Recent> {
    let others = list(folder).into_iter().filter(|known| known.path != recent.path);
    let all: Vec<Recent> = std::iter::once(recent.clone()).chain(others).take(MOST).collect();
    // What cannot be remembered is opened by its name.
    let _ = serde_json::to_vec(&all).map(|bytes| Here::write_quickly(&file(folder), &bytes));
    all
}

/// How long ago something was, in words.
#[must_use]
pub fn ago(at: u64, now: u64) -> String {
    let minutes = now.saturating_sub(at) / 60;
    let count = |number: u64, one: &str| {
        if number == 1 { format!("1 {one} ago") } else { format!("{number} {one}s ago") }
    };
    match minutes {
        0 => "just now".into(),
        1..60 => count(minutes, "minute"),
        60..1440 => count(minutes / 60, "hour"),
        _ => count(minutes / 1440, "day"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_is_first_each_is_there_once_and_what_is_gone_is_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let site = |name: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, "{}").unwrap();
            Recent::of(&path, &Site::new(), 100)
        };
        let (a, b) = (site("a.json"), site("b.json"));
        for recent in [&a, &b, &a] {
            let _ = remember(folder.path(), recent.clone());
        }
        assert_eq!(list(folder.path()), [a.clone(), b.clone()]);
        std::fs::remove_file(&a.path).unwrap();
        assert_eq!(list(folder.path()), [b]);
    }

    #[test]
    fn time_is_told_as_one_says_it() {
        assert_eq!(ago(1000, 1030), "just now");
        assert_eq!(ago(0, 65), "1 minute ago");
        assert_eq!(ago(0, 3 * 3600), "3 hours ago");
        assert_eq!(ago(0, 50 * 3600), "2 days ago");
    }
}
