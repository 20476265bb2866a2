//! The images of a site: files beside it, or bytes in a store by id.
//!
//! Stills as plain pixels.
//!
//! From where images of a site are read without asking.
//!
//! What the name of a file tells of what is in it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use base64::Engine as _;
use calib_input::relative;
use calib_site::Site;
use image::RgbImage;

/// Whether a name has this ending, in capitals or not.
#[must_use]
pub fn has_ending(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(ending))
}

/// Whether a name ends like an image that can be read.
#[must_use]
pub fn is_image(path: &Path) -> bool {
    ["png", "jpg", "jpeg"].iter().any(|ending| has_ending(path, ending))
}

/// The part of a path after its last separator, whichever system wrote it.
#[must_use]
pub fn base(name: &str) -> &str {
    name.rsplit(['/', '\\']).next().unwrap_or(name)
}

/// What a camera is called whose still is this file: the file's stem, unless that is but a number, as programs
/// that cut videos give; then the folder tells more.
#[must_use]
pub fn camera_name(path: &Path) -> String {
    let text = |part: Option<&std::ffi::OsStr>| part.map(|part| part.to_string_lossy().into_owned());
    let stem = text(path.file_stem()).unwrap_or_default();
    let words = ["frame", "image", "img", "still", "snapshot", "snap", "shot", "pic", "picture"];
    let rest = stem.trim_matches(|c: char| c.is_ascii_digit() || "_- .()".contains(c)).to_lowercase();
    let says_nothing = rest.is_empty() || words.contains(&rest.as_str());
    let folder = text(path.parent().and_then(Path::file_name));
    folder.filter(|folder| says_nothing && !folder.is_empty()).unwrap_or(stem)
}

/// The type of an image of this name.
#[must_use]
pub fn mime(name: &str) -> &'static str {
    if name.to_lowercase().ends_with(".png") { "image/png" } else { "image/jpeg" }
}

/// The folder of a site, and the files elsewhere that its operator chose or allowed. Whoever made a site file may
/// name any picture of this machine in it, and would see that in what is handed back.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Reach {
    /// The folder of the site; of a site that has no file yet, none.
    pub folder: Option<PathBuf>,
    /// Files elsewhere, without links in their paths.
    pub allowed: BTreeSet<PathBuf>,
}

impl Reach {
    /// Whether a file is within it. `real` tells where a path leads once every link is followed; none where it
    /// leads nowhere.
    #[must_use]
    pub fn holds(&self, file: &Path, real: impl Fn(&Path) -> Option<PathBuf>) -> bool {
        let Some(file) = real(file) else { return false };
        // The folder of a file that is named without one is the current one.
        let of_site = self.folder.as_deref();
        let folder =
            of_site.map(|folder| if folder.as_os_str().is_empty() { Path::new(".") } else { folder });
        self.allowed.contains(&file) || folder.and_then(real).is_some_and(|folder| file.starts_with(folder))
    }
}

const BASE64: base64::engine::GeneralPurpose = base64::engine::general_purpose::STANDARD;
/// Prefix of the ids of stored images in the site as the app holds it.
const STORED: &str = "stored:";

/// What can be said of a document that cannot be opened or saved.
pub type FileResult<T> = Result<T, String>;

/// Reads a file that is within reach, as the platform does.
pub type ReadFile = fn(&Path, &Reach) -> FileResult<Vec<u8>>;

/// Makes the bytes of an image that is not there.
pub type Make = fn(&str) -> FileResult<Vec<u8>>;

/// Where the images of a site come from.
#[derive(Clone, Debug, Default)]
pub struct Images {
    /// What names in the site are relative to.
    pub folder: Option<PathBuf>,
    /// Makes an image that is not there.
    pub missing: Option<Make>,
    /// Files outside the folder that are read all the same, without links in their paths.
    pub allowed: BTreeSet<PathBuf>,
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
                *image = data_uri(mime_of(&bytes), &bytes);
            }
        }
        folder.map_or_else(|| site.clone(), |folder| self.rebased(&site, folder))
    }

    /// An image as a `data:` URI, for a page that is to have it within; files are read by `read`.
    ///
    /// # Errors
    /// When it is not there and cannot be made.
    pub fn embedded(&self, name: &str, read: ReadFile) -> FileResult<(String, Arc<[u8]>)> {
        let bytes = self.reader(name).read(read)?;
        Ok((data_uri(mime_of(&bytes), &bytes), bytes))
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
        images_mut(&mut site).for_each(|image| *image = self.rebased_name(image, folder));
        site
    }

    /// The name of an image as seen from another folder: what is stored has the same everywhere.
    #[must_use]
    pub fn rebased_name(&self, image: &str, folder: &Path) -> String {
        if self.stored.contains_key(image) || image.starts_with("data:") {
            return image.to_owned();
        }
        let from = self.folder.as_ref().map_or_else(|| PathBuf::from(image), |own| own.join(image));
        relative(&from, folder)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.as_ref().map_or_else(|| PathBuf::from(name), |folder| folder.join(name))
    }

    /// Where the file of an image is looked for; none of one that is stored.
    #[must_use]
    pub fn file(&self, name: &str) -> Option<PathBuf> {
        let is_file = !self.stored.contains_key(name) && !name.starts_with("data:");
        is_file.then(|| self.path(name))
    }

    /// From where files are read without asking.
    #[must_use]
    pub fn reach(&self) -> Reach {
        Reach { folder: self.folder.clone(), allowed: self.allowed.clone() }
    }

    /// Where an image comes from, to be read off the frame's path.
    #[must_use]
    pub fn reader(&self, name: &str) -> Source {
        Source {
            stored: self.stored.get(name).map(|stored| Arc::clone(&stored.bytes)),
            path: self.path(name),
            reach: self.reach(),
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
    reach: Reach,
    missing: Option<Make>,
    name: String,
    made: Arc<Mutex<BTreeMap<String, Arc<[u8]>>>>,
}

impl Source {
    /// The image that a `data:` URI holds.
    #[must_use]
    pub fn of_data_uri(uri: &str) -> Option<Self> {
        let (mime, bytes) = parse_data_uri(uri)?;
        let mut images = Images::default();
        let id = images.store(bytes.into(), &mime, None);
        Some(images.reader(&id))
    }

    /// Its bytes; those of a file come from `read`.
    ///
    /// # Errors
    /// When it is not there and cannot be made.
    pub fn read(self, read: ReadFile) -> FileResult<Arc<[u8]>> {
        match (&self.stored, self.missing) {
            (Some(bytes), _) => Ok(Arc::clone(bytes)),
            (None, Some(make)) => read(&self.path, &self.reach).map(Into::into).or_else(|_| self.make(make)),
            (None, None) => read(&self.path, &self.reach).map(Into::into),
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

/// What the bytes of an image are.
fn mime_of(bytes: &[u8]) -> &'static str {
    if bytes.starts_with(&[0xff, 0xd8]) { "image/jpeg" } else { "image/png" }
}

/// Bytes as a `data:` URI.
#[must_use]
pub fn data_uri(mime: &str, bytes: &[u8]) -> String {
    format!("data:{mime};base64,{}", BASE64.encode(bytes))
}

fn parse_data_uri(text: &str) -> Option<(String, Vec<u8>)> {
    let (mime, encoded) = text.strip_prefix("data:")?.split_once(";base64,")?;
    Some((mime.to_owned(), BASE64.decode(encoded.trim()).ok()?))
}

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

/// Turns bytes into an image, upright as its EXIF data says.
///
/// # Errors
/// When the bytes are no image, or one too large.
pub fn decode(bytes: &[u8]) -> Result<RgbImage, String> {
    calib_input::decode(bytes).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use calib_site::SiteCamera;

    use super::*;

    #[test]
    fn a_camera_is_called_by_what_tells_it_from_the_others() {
        let called = |path: &str| camera_name(Path::new(path));
        assert_eq!(called("/site/yard-north/0000.png"), "yard-north");
        assert_eq!(called("/site/yard-south/frame_0001.jpg"), "yard-south");
        assert_eq!(called("/site/yard-north.png"), "yard-north");
        assert_eq!(called("0000.png"), "0000");
    }

    /// A disk on which `/site/link.png` leads elsewhere.
    fn real(path: &Path) -> Option<PathBuf> {
        match path.to_str()? {
            "/site/link.png" | "/site/../private.png" => Some("/private.png".into()),
            "/site/gone.png" => None,
            other => Some(other.into()),
        }
    }

    #[test]
    fn what_leads_out_of_the_folder_is_out_of_reach_until_it_is_allowed() {
        let mut reach = Reach { folder: Some("/site".into()), ..Reach::default() };
        let holds = |reach: &Reach, path: &str| reach.holds(Path::new(path), real);
        assert!(holds(&reach, "/site/a.png") && holds(&reach, "/site/stills/a.png"));
        for out in ["/site/link.png", "/site/../private.png", "/siteless/a.png", "/site/gone.png"] {
            assert!(!holds(&reach, out), "{out}");
        }
        reach.allowed.insert("/private.png".into());
        assert!(holds(&reach, "/site/link.png") && holds(&reach, "/private.png"));
        assert!(!holds(&Reach::default(), "/a.png"), "what has no folder reaches what was chosen alone");
    }

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
    fn what_came_with_the_page_goes_out_as_what_it_is() {
        let mut camera = SiteCamera::new("a", [4, 3]);
        camera.image = Some("a.png".into());
        let site = Site { cameras: vec![camera], ..Site::new() };
        let images = Images::beside(None, Some(|name| Err(format!("{name} is rendered for nothing"))));
        images.reader("a.png").keep(Arc::from([0xff, 0xd8, 0xff].as_slice()));
        assert_eq!(images.reader("a.png").made_by_name(), None);
        let sent = images.put_into(&site, None);
        assert_eq!(sent.cameras[0].image.as_deref(), Some("data:image/jpeg;base64,/9j/"));
    }

    #[test]
    fn what_is_no_image_is_an_error() {
        assert!(decode(b"not an image").is_err());
    }
}
