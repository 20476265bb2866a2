//! Open, save, autosave: whole files or none. Images that are not files live in a store by id.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use base64::Engine as _;
use calib_core::Site;

const BASE64: base64::engine::GeneralPurpose = base64::engine::general_purpose::STANDARD;
/// Prefix of the ids of stored images in the site as the app holds it.
const STORED: &str = "stored:";

/// Makes the bytes of an image that is not there.
pub type Make = fn(&str) -> FileResult<Vec<u8>>;

/// Where the images of a site come from.
#[derive(Clone, Debug, Default)]
pub struct Images {
    /// What names in the site are relative to.
    pub folder: Option<PathBuf>,
    /// Makes an image that is not there.
    pub missing: Option<Make>,
    stored: BTreeMap<String, Stored>,
    /// What `missing` made, so that it is made once.
    made: Arc<Mutex<BTreeMap<String, Arc<[u8]>>>>,
}

#[derive(Clone, Debug)]
struct Stored {
    bytes: Arc<[u8]>,
    mime: String,
    /// The file that the bytes are from, if they are from one.
    name: Option<String>,
}

impl Images {
    /// Images of files in a folder; one that is not there, `missing` makes.
    #[must_use]
    pub fn beside(folder: Option<PathBuf>, missing: Option<Make>) -> Self {
        Self { folder, missing, ..Self::default() }
    }

    /// Stores bytes and returns the id by which the site refers to them.
    pub fn store(&mut self, bytes: Arc<[u8]>, mime: &str, name: Option<&str>) -> String {
        let known = self.stored.iter().find(|(_, stored)| stored.bytes == bytes).map(|(id, _)| id.clone());
        known.unwrap_or_else(|| {
            let id = format!("{STORED}{}", self.stored.len() + 1);
            self.restore(&id, bytes, mime, name);
            id
        })
    }

    /// What an operator calls an image: the name of its file, without folders.
    #[must_use]
    pub fn shown_name(&self, name: &str) -> String {
        let own = self.stored.get(name).map_or(Some(name), |stored| stored.name.as_deref());
        let base = own.and_then(|own| own.rsplit(['/', '\\']).next());
        base.unwrap_or("a picture of this site").to_owned()
    }

    /// Stores bytes under the id that they had before.
    pub fn restore(&mut self, id: &str, bytes: Arc<[u8]>, mime: &str, name: Option<&str>) {
        let stored = Stored { bytes, mime: mime.to_owned(), name: name.map(str::to_owned) };
        self.stored.insert(id.to_owned(), stored);
    }

    /// Whatever is stored: id, type, name of the file, bytes.
    pub fn stored(&self) -> impl Iterator<Item = (&str, &str, Option<&str>, &[u8])> {
        self.stored
            .iter()
            .map(|(id, stored)| (id.as_str(), stored.mime.as_str(), stored.name.as_deref(), &*stored.bytes))
    }

    /// Whether bytes are stored under this name.
    #[must_use]
    pub fn is_stored(&self, name: &str) -> bool {
        self.stored.contains_key(name)
    }

    /// Takes `data:` URIs out of the site into the store, so that a snapshot holds ids only.
    pub fn take_from(&mut self, site: &mut Site) {
        for image in images_mut(site) {
            let Some((mime, bytes)) = parse_data_uri(image) else { continue };
            *image = self.store(bytes.into(), &mime, None);
        }
    }

    /// The site with stored images as `data:` URIs again, and paths relative to `folder`.
    #[must_use]
    pub fn put_into(&self, site: &Site, folder: Option<&Path>) -> Site {
        let mut site = site.clone();
        for image in images_mut(&mut site) {
            if let Some(stored) = self.stored.get(image.as_str()) {
                *image = data_uri(&stored.mime, &stored.bytes);
            } else if self.folder.is_none()
                && let Some(Ok(bytes)) = self.missing.map(|make| self.reader(image).make(make))
            {
                *image = data_uri("image/png", &bytes);
            }
        }
        folder.map_or_else(|| site.clone(), |folder| self.rebased(&site, folder))
    }

    /// The site with the names of its images alone, as files beside it are called.
    #[must_use]
    pub fn name_into(&self, site: &Site) -> Site {
        let mut site = site.clone();
        for image in images_mut(&mut site) {
            if let Some(stored) = self.stored.get(image.as_str()) {
                let end = if stored.mime == "image/png" { "png" } else { "jpg" };
                let made_up = || format!("{}.{end}", image.trim_start_matches(STORED));
                *image = stored.name.clone().unwrap_or_else(made_up);
            }
        }
        site
    }

    /// The site with the paths of its images as seen from another folder.
    #[must_use]
    pub fn rebased(&self, site: &Site, folder: &Path) -> Site {
        let mut site = site.clone();
        let is_path = |image: &String| !self.stored.contains_key(image) && !image.starts_with("data:");
        for image in images_mut(&mut site).filter(|image| is_path(image)) {
            let from = self.folder.as_ref().map_or_else(|| PathBuf::from(&*image), |f| f.join(&*image));
            *image = relative(&from, folder);
        }
        site
    }

    /// Where an image comes from, to be read off the frame's path.
    #[must_use]
    pub fn reader(&self, name: &str) -> Source {
        Source {
            stored: self.stored.get(name).map(|stored| Arc::clone(&stored.bytes)),
            path: self.folder.as_ref().map_or_else(|| PathBuf::from(name), |folder| folder.join(name)),
            missing: self.missing,
            name: name.to_owned(),
            made: Arc::clone(&self.made),
        }
    }
}

/// Where an image comes from.
#[derive(Clone, Debug)]
pub struct Source {
    stored: Option<Arc<[u8]>>,
    path: PathBuf,
    missing: Option<Make>,
    name: String,
    made: Arc<Mutex<BTreeMap<String, Arc<[u8]>>>>,
}

impl Source {
    /// Its bytes.
    ///
    /// # Errors
    /// When it is not there and cannot be made.
    pub fn read(self) -> FileResult<Arc<[u8]>> {
        match (&self.stored, self.missing) {
            (Some(bytes), _) => Ok(Arc::clone(bytes)),
            (None, Some(make)) => read(&self.path).map(Into::into).or_else(|_| self.make(make)),
            (None, None) => read(&self.path).map(Into::into),
        }
    }

    /// The name of an image that has to be made, and was not made yet.
    #[must_use]
    pub fn made_by_name(&self) -> Option<&str> {
        let is_to_be_made = self.stored.is_none() && self.missing.is_some() && self.known().is_none();
        is_to_be_made.then_some(self.name.as_str())
    }

    fn known(&self) -> Option<Arc<[u8]>> {
        self.made.lock().unwrap_or_else(PoisonError::into_inner).get(&self.name).cloned()
    }

    /// Keeps what was made, so that it is made once.
    pub fn keep(&self, bytes: Arc<[u8]>) {
        self.made.lock().unwrap_or_else(PoisonError::into_inner).insert(self.name.clone(), bytes);
    }

    fn make(&self, make: Make) -> FileResult<Arc<[u8]>> {
        if let Some(known) = self.known() {
            return Ok(known);
        }
        let bytes: Arc<[u8]> = make(&self.name)?.into();
        self.keep(Arc::clone(&bytes));
        Ok(bytes)
    }
}

/// The names of a site's images.
#[must_use]
pub fn image_names(site: &Site) -> Vec<String> {
    let plan = site.plan.iter().filter_map(|plan| plan.image.clone());
    site.cameras.iter().filter_map(|camera| camera.image.clone()).chain(plan).collect()
}

/// The names of a site's images, to be changed.
pub(crate) fn images_mut(site: &mut Site) -> impl Iterator<Item = &mut String> {
    let plan = site.plan.iter_mut().filter_map(|plan| plan.image.as_mut());
    site.cameras.iter_mut().filter_map(|camera| camera.image.as_mut()).chain(plan)
}

fn data_uri(mime: &str, bytes: &[u8]) -> String {
    format!("data:{mime};base64,{}", BASE64.encode(bytes))
}

fn parse_data_uri(text: &str) -> Option<(String, Vec<u8>)> {
    let (mime, encoded) = text.strip_prefix("data:")?.split_once(";base64,")?;
    Some((mime.to_owned(), BASE64.decode(encoded.trim()).ok()?))
}

/// `path` as seen from `folder`, with `/` between its parts; as it is where they share no root.
fn relative(path: &Path, folder: &Path) -> String {
    let parts = |path: &Path| -> Vec<String> {
        path.components().map(|part| part.as_os_str().to_string_lossy().into_owned()).collect()
    };
    if path.is_absolute() != folder.is_absolute() {
        return path.to_string_lossy().into_owned();
    }
    let (path_parts, folder_parts) = (parts(path), parts(folder));
    let shared = path_parts.iter().zip(&folder_parts).take_while(|(a, b)| a == b).count();
    if shared == 0 && path.is_absolute() {
        return path.to_string_lossy().into_owned();
    }
    let up = std::iter::repeat_n("..".to_owned(), folder_parts.len() - shared);
    up.chain(path_parts.into_iter().skip(shared)).collect::<Vec<_>>().join("/")
}

/// What can be said of a document that cannot be opened or saved.
pub type FileResult<T> = Result<T, String>;

/// Reads a site from text; stored images go to the returned store.
///
/// # Errors
/// When the text is no site: the message names the field.
pub fn parse(text: &str, folder: Option<PathBuf>) -> FileResult<(Site, Images)> {
    let mut site = Site::from_json(text).map_err(|error| error.to_string())?;
    let mut images = Images { folder, ..Images::default() };
    images.take_from(&mut site);
    Ok((site, images))
}

/// Whether a name has this ending, in capitals or not.
#[must_use]
pub(crate) fn has_ending(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(ending))
}

/// Whether a name ends like an image that can be read.
#[must_use]
pub fn is_image(path: &Path) -> bool {
    ["png", "jpg", "jpeg"].iter().any(|ending| has_ending(path, ending))
}

#[cfg(not(target_arch = "wasm32"))]
mod native {
    use std::io::{Read as _, Write as _};

    use calib_core::MAX_BYTES;

    use super::*;

    /// Reads a file of any size a site or image may have.
    ///
    /// # Errors
    /// When it is not there, or larger than that.
    pub fn read(path: &Path) -> FileResult<Vec<u8>> {
        let what = |error: std::io::Error| format!("{}: {error}", path.display());
        let file = std::fs::File::open(path).map_err(what)?;
        let mut bytes = Vec::new();
        file.take(MAX_BYTES as u64 + 1).read_to_end(&mut bytes).map_err(what)?;
        if bytes.len() > MAX_BYTES {
            return Err(format!("{}: larger than {} MB", path.display(), MAX_BYTES >> 20));
        }
        Ok(bytes)
    }

    /// Writes a file whole or not at all, and waits until the disk has it.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn write(path: &Path, bytes: &[u8]) -> FileResult<()> {
        write_to(path, bytes, true)
    }

    /// Writes a file whole or not at all. It survives the end of this program, not that of the machine.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn write_quickly(path: &Path, bytes: &[u8]) -> FileResult<()> {
        write_to(path, bytes, false)
    }

    fn write_to(path: &Path, bytes: &[u8], waits: bool) -> FileResult<()> {
        let what = |error: std::io::Error| format!("{}: {error}", path.display());
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(what)?;
        }
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(format!(".{}.part", std::process::id()));
        let part = path.with_file_name(name);
        let written = std::fs::File::create(&part).and_then(|mut file| {
            file.write_all(bytes)?;
            if waits { file.sync_data() } else { Ok(()) }
        });
        written.and_then(|()| std::fs::rename(&part, path)).map_err(|error| {
            // Best effort: the error that matters is the first.
            let _ = std::fs::remove_file(&part);
            what(error)
        })
    }

    /// Where autosaves and the demonstration's images live.
    #[must_use]
    pub fn data_dir() -> Option<PathBuf> {
        eframe::storage_dir("calib")
    }

    /// The images in a folder, by name.
    #[must_use]
    pub fn images_in(folder: &Path) -> Vec<PathBuf> {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let mut paths: Vec<PathBuf> =
            entries.map(|entry| entry.path()).filter(|path| is_image(path)).collect();
        paths.sort();
        paths
    }
}

#[cfg(target_arch = "wasm32")]
mod web {
    use super::*;

    /// What the browser was not given is not there.
    pub fn read(path: &Path) -> FileResult<Vec<u8>> {
        Err(format!("{}: drop this image here", path.display()))
    }

    /// A file that is written is a download.
    pub fn write(path: &Path, bytes: &[u8]) -> FileResult<()> {
        crate::web::download(path, bytes);
        Ok(())
    }

    /// There are no such files in the browser: the shelf keeps sites.
    pub fn write_quickly(path: &Path, _: &[u8]) -> FileResult<()> {
        Err(format!("{}: there are no files here", path.display()))
    }

    /// There is none in the browser.
    pub fn data_dir() -> Option<PathBuf> {
        None
    }

    /// There are no folders in the browser.
    pub fn images_in(_: &Path) -> Vec<PathBuf> {
        Vec::new()
    }
}

#[cfg(not(target_arch = "wasm32"))]
pub use native::{data_dir, images_in, read, write, write_quickly};
#[cfg(target_arch = "wasm32")]
pub use web::{data_dir, images_in, read, write, write_quickly};

/// Reads a site file.
///
/// # Errors
/// When it cannot be read or is no site.
pub fn open(path: &Path) -> FileResult<(Site, Images)> {
    let bytes = read(path)?;
    let text = String::from_utf8(bytes).map_err(|_| format!("{}: not text", path.display()))?;
    let folder = path.parent().map(Path::to_path_buf);
    parse(&text, folder).map_err(|error| format!("{}: {error}", path.display()))
}

/// Writes a site file; from then on its images are looked for beside it.
///
/// # Errors
/// When it cannot be written.
pub fn save(path: &Path, site: &Site, images: &Images) -> FileResult<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    write(path, images.put_into(site, Some(folder)).to_json().as_bytes())
}

/// What a crash must not take: written after every gesture, gone after a save.
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
}

#[derive(serde::Serialize, serde::Deserialize)]
struct Kept {
    path: Option<PathBuf>,
    folder: Option<PathBuf>,
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
        self.folder.join(format!("image-{}", id.trim_start_matches(STORED)))
    }

    /// Writes the site; stored images are written once.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn keep(&self, site: &Site, images: &Images, path: Option<&Path>) -> FileResult<()> {
        for (id, stored) in &images.stored {
            let file = self.image_file(id);
            if !file.exists() {
                write_quickly(&file, &stored.bytes)?;
            }
        }
        let stored = images.stored.iter().map(|(id, stored)| (id.clone(), stored.mime.clone())).collect();
        let (path, folder) = (path.map(Path::to_path_buf), images.folder.clone());
        let kept = Kept { path, folder, stored, site: site.to_json() };
        write_quickly(&self.file(), &serde_json::to_vec(&kept).map_err(|error| error.to_string())?)
    }

    /// What was kept, if it can be read.
    #[must_use]
    pub fn find(&self) -> Option<Found> {
        let kept: Kept = serde_json::from_slice(&read(&self.file()).ok()?).ok()?;
        let site = Site::from_json(&kept.site).ok()?;
        let mut images = Images { folder: kept.folder, ..Images::default() };
        for (id, mime) in kept.stored {
            if let Ok(bytes) = read(&self.image_file(&id)) {
                images.restore(&id, bytes.into(), &mime, None);
            }
        }
        Some(Found { site, images, path: kept.path })
    }

    /// Forgets what was kept: it is saved elsewhere, or not wanted.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn forget(&self) {
        // What is not there need not be removed.
        let _ = std::fs::remove_file(self.file());
        let entries = std::fs::read_dir(&self.folder).into_iter().flatten().flatten();
        for entry in entries.filter(|entry| entry.file_name().to_string_lossy().starts_with("image-")) {
            let _ = std::fs::remove_file(entry.path());
        }
    }

    /// There are no such files in the browser: the shelf keeps sites.
    #[cfg(target_arch = "wasm32")]
    pub fn forget(&self) {}
}

#[cfg(test)]
mod tests {
    use super::*;
    use calib_core::SiteCamera;

    fn site() -> Site {
        let mut camera = SiteCamera::new("a", [4, 3]);
        camera.image = Some("data:image/png;base64,aGVsbG8=".into());
        Site { cameras: vec![camera], ..Site::new() }
    }

    #[test]
    fn data_uris_go_to_the_store_and_come_back() {
        let (held, images) = parse(&site().to_json(), None).unwrap();
        assert_eq!(held.cameras[0].image.as_deref(), Some("stored:1"));
        assert_eq!(images.put_into(&held, None), site());
    }

    #[test]
    fn paths_are_relative_to_the_file() {
        assert_eq!(relative(Path::new("/a/b/c.png"), Path::new("/a/d")), "../b/c.png");
        assert_eq!(relative(Path::new("/a/d/c.png"), Path::new("/a/d")), "c.png");
    }

    #[test]
    fn an_autosave_is_found_again_with_its_images() {
        let folder = tempfile::tempdir().unwrap();
        let autosave = Autosave::new(folder.path().join("new"));
        let (held, images) = parse(&site().to_json(), None).unwrap();
        autosave.keep(&held, &images, Some(Path::new("/x/site.json"))).unwrap();
        let found = autosave.find().unwrap();
        assert_eq!(found.images.put_into(&found.site, None), site());
        assert_eq!(found.path.as_deref(), Some(Path::new("/x/site.json")));
        autosave.forget();
        assert!(autosave.find().is_none());
    }
}
