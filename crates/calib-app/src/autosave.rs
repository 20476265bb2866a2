//! What a crash must not take: every finished gesture is kept, and offered when the app is started again.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use calib_editor::{FileResult, Images};
use calib_site::Site;

use crate::platform::{Here, Platform};

/// A place that is written after every gesture, and empty after a save.
#[derive(Clone, Debug)]
pub struct Autosave {
    folder: PathBuf,
}

/// An autosave that was found.
#[derive(Clone, Debug)]
pub struct Found {
    /// The site.
    pub site: Site,
    /// Its images.
    pub images: Images,
    /// The file it was opened from.
    pub path: Option<PathBuf>,
    /// What that file held when it was read or written last.
    pub held: Option<u64>,
    /// When it was kept, in seconds since 1970.
    pub at: Option<u64>,
}

#[derive(serde::Serialize, serde::Deserialize)]
struct Kept {
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
    /// The places for autosaves in a folder: more than one, so that unsaved work of one session is not
    /// overwritten by the next.
    pub fn slots(folder: &Path) -> impl Iterator<Item = Self> + '_ {
        const SLOTS: usize = 9;
        (0..SLOTS).map(|slot| {
            let name = if slot == 0 { "autosave".into() } else { format!("autosave-{}", slot + 1) };
            Self::new(folder.join(name))
        })
    }

    /// Keeps in this folder.
    #[must_use]
    pub const fn new(folder: PathBuf) -> Self {
        Self { folder }
    }

    /// Where it keeps.
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

    /// Writes the site; stored images are written once.
    ///
    /// # Errors
    /// When the folder cannot be written to.
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
        let kept = Kept { path, folder, held, at: Here::now(), allowed, stored, site: site.to_json() };
        Here::write_quickly(&self.file(), &serde_json::to_vec(&kept).map_err(|error| error.to_string())?)
    }

    /// What was kept, if it can be read.
    #[must_use]
    pub fn find(&self) -> Option<Found> {
        let kept: Kept = serde_json::from_slice(&Here::read(&self.file()).ok()?).ok()?;
        let site = Site::from_json(&kept.site).ok()?;
        let mut images = Images::beside(kept.folder, None);
        images.allowed = kept.allowed;
        for (id, mime) in kept.stored {
            if let Ok(bytes) = Here::read(&self.image_file(&id)) {
                images.restore(&id, bytes.into(), &mime, None);
            }
        }
        Some(Found { site, images, path: kept.path, held: kept.held, at: kept.at })
    }

    /// Forgets what was kept: it is saved elsewhere, or not wanted.
    pub fn forget(&self) {
        Here::forget(&self.folder, &self.file());
    }
}

/// The autosaves of a folder, as one window finds them.
#[derive(Debug, Default)]
pub(crate) struct Slots {
    /// What crashed sessions left.
    pub(crate) found: Vec<(Autosave, Found)>,
    /// Where this one keeps its own.
    pub(crate) autosave: Option<Autosave>,
    pub(crate) claims: Vec<(PathBuf, <Here as Platform>::Claim)>,
}

impl Slots {
    pub(crate) fn of(folder: Option<&Path>) -> Self {
        let mut slots = Self::default();
        for slot in folder.into_iter().flat_map(Autosave::slots) {
            // What another window keeps is its own; what was found stays until the operator has decided.
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

#[cfg(test)]
mod tests {
    use super::*;
    use calib_site::SiteCamera;

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
        assert_eq!(found.images.put_into(&found.site, None), images.put_into(&site, None));
        assert_eq!((found.path.as_deref(), found.held), (Some(Path::new("/x/site.json")), Some(7)));
        autosave.forget();
        assert!(autosave.find().is_none());
    }
}
