//! Autosaves, recent sites, and the storage of sites in the browser. Every finished gesture is autosaved.
//! After a crash, the next start shows the autosave.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Debug;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use calib_editor::{FileResult, Images, data_uri};
use calib_site::Site;
use image::RgbImage;
use serde::{Deserialize, Serialize};

use crate::picture::Pictures;
use crate::platform::{Here, Platform};

/// Autosave slot: a folder that is written after every gesture and emptied after a save.
#[derive(Clone, Debug)]
pub struct Autosave {
    folder: PathBuf,
}

/// Unsaved site from an autosave that the start page shows, or a site from the storage of the browser.
#[derive(Clone, Debug)]
pub struct Found {
    /// Content of the site.
    pub site: Site,
    /// Images of the site.
    pub images: Images,
    /// Site file from which the site was opened.
    pub path: Option<PathBuf>,
    /// Hash of the site file when it was last read or written.
    pub held: Option<u64>,
    /// Time of the autosave, in seconds since 1970.
    pub at: Option<u64>,
}

/// Content of the autosave file, as JSON.
#[derive(serde::Serialize, serde::Deserialize)]
struct AutosaveFile {
    path: Option<PathBuf>,
    folder: Option<PathBuf>,
    #[serde(default)]
    held: Option<u64>,
    #[serde(default)]
    at: Option<u64>,
    #[serde(default)]
    allowed: BTreeSet<PathBuf>,
    stored: BTreeMap<String, String>,
    site: String,
}

impl Autosave {
    /// Returns the autosave slots of a folder. With several slots, sessions do not overwrite each other's
    /// work.
    pub fn slots(folder: &Path) -> impl Iterator<Item = Self> + '_ {
        /// Number of autosave slots.
        const SLOT_COUNT: usize = 9;
        (0..SLOT_COUNT).map(|slot| {
            let name = if slot == 0 { "autosave".into() } else { format!("autosave-{}", slot + 1) };
            Self::new(folder.join(name))
        })
    }

    /// Creates a slot in this folder.
    #[must_use]
    pub const fn new(folder: PathBuf) -> Self {
        Self { folder }
    }

    /// Returns the folder of the slot.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    fn file(&self) -> PathBuf {
        self.folder.join("autosave.json")
    }

    fn image_file(&self, id: &str) -> PathBuf {
        self.folder.join(format!("image-{}", id.trim_start_matches("stored:")))
    }

    /// Writes the site into the slot; each stored image is written only once.
    ///
    /// # Errors
    /// When the folder of the slot cannot be written to.
    pub fn keep(
        &self,
        site: &Site,
        images: &Images,
        path: Option<&Path>,
        held: Option<u64>,
    ) -> FileResult<()> {
        for (id, _, _, bytes) in images.stored() {
            let file = self.image_file(id);
            if !file.exists() {
                Here::write_quickly(&file, bytes)?;
            }
        }
        let stored = images.stored().map(|(id, mime, ..)| (id.to_owned(), mime.to_owned())).collect();
        let (path, folder) = (path.map(Path::to_path_buf), images.folder.clone());
        let allowed = images.allowed.clone();
        let kept =
            AutosaveFile { path, folder, held, at: Here::now(), allowed, stored, site: site.to_json() };
        Here::write_quickly(&self.file(), &serde_json::to_vec(&kept).map_err(|error| error.to_string())?)
    }

    /// Reads the autosave, if it exists and is readable.
    #[must_use]
    pub fn find(&self) -> Option<Found> {
        let kept: AutosaveFile = serde_json::from_slice(&Here::read(&self.file()).ok()?).ok()?;
        let site = Site::from_json(&kept.site).ok()?;
        let mut images = Images::in_folder(kept.folder, None);
        images.allowed = kept.allowed;
        for (id, mime) in kept.stored {
            if let Ok(bytes) = Here::read(&self.image_file(&id)) {
                images.restore(&id, bytes.into(), &mime, None);
            }
        }
        Some(Found { site, images, path: kept.path, held: kept.held, at: kept.at })
    }

    /// Deletes the autosave after a save, or on request.
    pub fn forget(&self) {
        Here::forget(&self.folder, &self.file());
    }
}

/// Autosave slots of a folder that one window has locked.
#[derive(Debug, Default)]
pub(crate) struct Slots {
    /// Autosaves of sessions that crashed or ended without saving.
    pub(crate) found: Vec<(Autosave, Found)>,
    /// Slot of this window.
    pub(crate) autosave: Option<Autosave>,
    pub(crate) claims: Vec<(PathBuf, <Here as Platform>::Claim)>,
}

impl Slots {
    pub(crate) fn of(folder: Option<&Path>) -> Self {
        let mut slots = Self::default();
        for slot in folder.into_iter().flat_map(Autosave::slots) {
            // Slots of other windows are locked; found autosaves stay until the operator decides.
            let Some(claim) = Here::claim(slot.folder()) else { continue };
            let folder = slot.folder().to_path_buf();
            match slot.find() {
                Some(work) => slots.found.push((slot, work)),
                None if slots.autosave.is_none() => slots.autosave = Some(slot),
                None => continue,
            }
            slots.claims.push((folder, claim));
        }
        slots
    }
}

/// Site that was opened or saved recently.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Recent {
    /// Path of the site file.
    pub path: PathBuf,
    /// Name of the site.
    pub name: String,
    /// Number of cameras.
    pub cameras: usize,
    /// Image of the first camera, if the image is a file.
    pub image: Option<PathBuf>,
    /// Time of opening or saving, in seconds since 1970.
    pub at: u64,
}

/// Largest number of recent sites in the list.
const MAX_RECENT_SITES: usize = 8;

impl Recent {
    /// Creates the entry of a site; image names are relative to the folder of `path`.
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

/// Reads the list of recent sites from a folder, newest first, without missing site files.
#[must_use]
pub(crate) fn list(folder: &Path) -> Vec<Recent> {
    let known = Here::read(&file(folder)).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok());
    let known: Vec<Recent> = known.unwrap_or_default();
    known.into_iter().filter(|recent| recent.path.is_file()).collect()
}

/// Adds an entry at the front of the list of recent sites in a folder; returns the list.
#[must_use]
pub(crate) fn remember(folder: &Path, recent: Recent) -> Vec<Recent> {
    let others = list(folder).into_iter().filter(|known| known.path != recent.path);
    let all: Vec<Recent> = std::iter::once(recent.clone()).chain(others).take(MAX_RECENT_SITES).collect();
    // A failed write is harmless: the site can still be opened from its file.
    let _ = serde_json::to_vec(&all).map(|bytes| Here::write_quickly(&file(folder), &bytes));
    all
}

/// Returns the time since `at` as text; both times are in seconds since 1970.
#[must_use]
pub(crate) fn ago(at: u64, now: u64) -> String {
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

/// Site in the browser's storage.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Entry {
    /// Id of the entry.
    pub id: String,
    /// Name of the site.
    pub name: String,
    /// Number of cameras.
    pub cameras: usize,
    /// Size of the site with its images, in bytes.
    pub bytes: u64,
    /// Time of the last autosave, as text.
    pub when: String,
    /// Name of the last gesture.
    pub last: String,
    /// Thumbnail of the first image, as a `data:` URI.
    pub thumbnail: Option<String>,
}

/// Content of an autosave after a finished gesture.
#[derive(Debug)]
pub struct Work<'a> {
    /// Content of the site.
    pub site: &'a Site,
    /// Images of the site.
    pub images: &'a Images,
    /// Site file from which the site was opened, or to which it was saved.
    pub path: Option<PathBuf>,
    /// Name of the last gesture.
    pub last: &'a str,
    /// Thumbnail of the first image, as a `data:` URI, once it is decoded.
    pub thumbnail: Option<&'a str>,
}

/// Message of the browser storage to the app.
#[derive(Debug)]
pub enum News {
    /// Stored site that the operator opened.
    Opened(Box<Found>),
    /// Error message with advice.
    Trouble(String),
    /// Message that is no error.
    Note(String),
    /// Request to store the open site again with all its images, because another browser tab changed its entry.
    Again,
}

/// Storage of sites in the browser.
pub trait Shelf: Debug {
    /// Returns the stored sites, newest first.
    fn entries(&self) -> Vec<Entry>;
    /// Stores the open site in its entry.
    fn keep(&mut self, work: Work<'_>);
    /// Ends the entry of the open site; the next site gets a new entry.
    fn begin(&mut self);
    /// Requests a stored site; it arrives as [`News::Opened`].
    fn open(&mut self, id: &str);
    /// Removes a stored site.
    fn remove(&mut self, id: &str);
    /// Returns the oldest message that was not returned yet.
    fn news(&mut self) -> Option<News>;
    /// Whether an autosave is still being written, or failed.
    fn is_behind(&self) -> bool;
}

/// Size of a thumbnail, in pixels: twice its size on the start page, for high-resolution screens.
const THUMBNAIL_SIZE_PX: [u32; 2] = [168, 104];

/// Thumbnail of a site: its first image, scaled down once the image is decoded.
#[derive(Debug, Default)]
pub(crate) struct Thumbnail {
    /// Name of the image, and its thumbnail as a `data:` URI.
    made: Option<(String, String)>,
    /// Name of the first image while it is not decoded.
    awaited: Option<String>,
}

impl Thumbnail {
    /// Creates the thumbnail if the first image changed and is decoded.
    pub(crate) fn renew(&mut self, site: &Site, pictures: &Pictures) {
        self.awaited = None;
        let Some(name) =
            first_image(site).filter(|name| self.made.as_ref().is_none_or(|(made, _)| made != name))
        else {
            return;
        };
        let picture = pictures.ready(name);
        self.awaited = picture.is_none().then(|| name.to_owned());
        let small = picture.and_then(|picture| thumbnail_uri(&picture.image));
        self.made = small.map(|small| (name.to_owned(), small)).or(self.made.take());
    }

    /// Whether the awaited image is decoded now.
    pub(crate) fn is_due(&self, pictures: &Pictures) -> bool {
        self.awaited.as_ref().is_some_and(|name| pictures.ready(name).is_some())
    }

    /// Returns the thumbnail of a site as a `data:` URI, if it is up to date.
    pub(crate) fn of(&self, site: &Site) -> Option<&str> {
        let (name, uri) = self.made.as_ref()?;
        (first_image(site)? == name).then_some(uri)
    }
}

/// Returns the name of the first image of a site.
fn first_image(site: &Site) -> Option<&str> {
    site.cameras.iter().find_map(|camera| camera.image.as_deref())
}

/// Returns the middle of an image, scaled down to the size of a thumbnail, as a `data:` URI.
fn thumbnail_uri(still: &RgbImage) -> Option<String> {
    let [w, h] = THUMBNAIL_SIZE_PX;
    let (width, height) = still.dimensions();
    let share = (f64::from(width) / f64::from(w)).min(f64::from(height) / f64::from(h));
    let [cut_w, cut_h] = THUMBNAIL_SIZE_PX.map(|side| ((f64::from(side) * share) as u32).max(1));
    let [x, y] = [width.saturating_sub(cut_w) / 2, height.saturating_sub(cut_h) / 2];
    let cut = image::imageops::crop_imm(still, x, y, cut_w, cut_h);
    let small = image::imageops::thumbnail(&*cut, w, h);
    let mut jpeg = Cursor::new(Vec::new());
    small.write_to(&mut jpeg, image::ImageFormat::Jpeg).ok()?;
    Some(data_uri("image/jpeg", jpeg.get_ref()))
}

#[cfg(test)]
mod tests {
    use calib_site::SiteCamera;

    use super::*;

    #[test]
    fn an_autosave_is_found_again_with_its_images() {
        let folder = tempfile::tempdir().unwrap();
        let autosave = Autosave::new(folder.path().join("new"));
        let mut images = Images::default();
        let mut camera = SiteCamera::new("a", [4, 3]);
        camera.image = Some(images.store((*b"hello").into(), "image/png", None));
        let site = Site { cameras: vec![camera], ..Site::new() };
        autosave.keep(&site, &images, Some(Path::new("/x/site.json")), Some(7)).unwrap();
        let found = autosave.find().unwrap();
        assert_eq!(found.images.embed_into(&found.site, None), images.embed_into(&site, None));
        assert_eq!((found.path.as_deref(), found.held), (Some(Path::new("/x/site.json")), Some(7)));
        autosave.forget();
        assert!(autosave.find().is_none());
    }

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

    #[test]
    fn a_thumbnail_is_the_middle_of_the_still_and_a_few_kilobytes() {
        // White in the middle, black at the sides that are cut off.
        let still = RgbImage::from_fn(2000, 600, |x, _| {
            image::Rgb([if x.abs_diff(1000) < 480 { 255 } else { 0 }; 3])
        });
        let uri = thumbnail_uri(&still).unwrap();
        assert!(uri.starts_with("data:image/jpeg;base64,") && uri.len() < 12_000, "{}", uri.len());
        let bytes =
            calib_editor::Source::from_data_uri(&uri).unwrap().read(|_, _| Err("no file".into())).unwrap();
        let shown = calib_editor::decode(&bytes).unwrap();
        assert_eq!(<[u32; 2]>::from(shown.dimensions()), THUMBNAIL_SIZE_PX);
        assert!(shown.get_pixel(4, 50).0[0] > 240 && shown.get_pixel(163, 50).0[0] > 240);
    }
}
