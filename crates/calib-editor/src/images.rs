//! Images of a site: files in the folder of the site, or stored bytes with ids.
//!
//! The file also decodes images, determines which files may be read without asking the operator, and derives
//! camera names from file names.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use base64::Engine as _;
use calib_input::relative;
use calib_site::{Plan, Site};
use image::RgbImage;

/// Whether a file name has this extension, ignoring case.
#[must_use]
pub fn has_ending(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(ending))
}

/// Whether a file name has the extension of a supported image format.
#[must_use]
pub fn is_image(path: &Path) -> bool {
    calib_input::image_endings().any(|ending| has_ending(path, ending))
}

/// Returns the part of a path after its last separator, `/` or `\`.
#[must_use]
pub fn file_name(name: &str) -> &str {
    name.rsplit(['/', '\\']).next().unwrap_or(name)
}

/// Returns the name of a camera from the path of its image: the file name without extension. Programs that
/// extract video frames write names like "frame" or a number; the result is then the name of the folder.
#[must_use]
pub fn camera_name(path: &Path) -> String {
    let text = |part: Option<&std::ffi::OsStr>| part.map(|part| part.to_string_lossy().into_owned());
    let stem = text(path.file_stem()).unwrap_or_default();
    let words = ["frame", "image", "img", "still", "snapshot", "snap", "shot", "pic", "picture"];
    let rest = stem.trim_matches(|c: char| c.is_ascii_digit() || "_- .()".contains(c)).to_lowercase();
    let is_generic = rest.is_empty() || words.contains(&rest.as_str());
    let folder = text(path.parent().and_then(Path::file_name));
    folder.filter(|folder| is_generic && !folder.is_empty()).unwrap_or(stem)
}

/// Returns the MIME type of an image from the extension of its file name; JPEG if the extension is unknown.
#[must_use]
pub fn mime(name: &str) -> &'static str {
    let ending = Path::new(name).extension().map(|ending| ending.to_string_lossy().to_lowercase());
    MIME_TYPES
        .iter()
        .find(|(own, ..)| ending.as_deref() == Some(*own))
        .map_or("image/jpeg", |(_, mime, _)| *mime)
}

/// Endings, MIME types and first bytes of image files. The first ending of a type is the usual one.
const MIME_TYPES: [(&str, &str, &[u8]); 10] = [
    ("jpg", "image/jpeg", b"\xFF\xD8"),
    ("jpeg", "image/jpeg", b"\xFF\xD8"),
    ("png", "image/png", b"\x89PNG"),
    ("webp", "image/webp", b"RIFF"),
    ("bmp", "image/bmp", b"BM"),
    ("gif", "image/gif", b"GIF8"),
    ("tif", "image/tiff", b"II*\0"),
    ("tiff", "image/tiff", b"MM\0*"),
    ("pdf", "application/pdf", b"%PDF-"),
    ("dxf", "image/vnd.dxf", b"AutoCAD Binary DXF"),
];

/// Files that may be read without asking: files in the site's folder, and files that the operator chose or
/// allowed. Without this limit, the author of a site file could name any image on this computer, and receive
/// it in a report.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AllowedFiles {
    /// Folder of the site; `None` if the site has no file yet.
    pub folder: Option<PathBuf>,
    /// Files outside the folder that the operator allowed, as canonical paths.
    pub allowed: BTreeSet<PathBuf>,
}

impl AllowedFiles {
    /// Whether a file may be read without asking. `real` returns the canonical path of a file; `None` if the
    /// file does not exist.
    #[must_use]
    pub fn allows(&self, file: &Path, real: impl Fn(&Path) -> Option<PathBuf>) -> bool {
        let Some(file) = real(file) else { return false };
        // A file name without a folder is relative to the current folder.
        let of_site = self.folder.as_deref();
        let folder =
            of_site.map(|folder| if folder.as_os_str().is_empty() { Path::new(".") } else { folder });
        self.allowed.contains(&file) || folder.and_then(real).is_some_and(|folder| file.starts_with(folder))
    }
}

/// Base64 encoding of `data:` URIs.
const BASE64: base64::engine::GeneralPurpose = base64::engine::general_purpose::STANDARD;
/// Prefix of the ids of images that are kept in memory.
const STORED_PREFIX: &str = "stored:";

/// Result of a file operation; the error is a message for the operator.
pub type FileResult<T> = Result<T, String>;

/// Function of the platform that reads a file, if the file is allowed.
pub type ReadFile = fn(&Path, &AllowedFiles) -> FileResult<Vec<u8>>;

/// Function that renders the image with this name if its file is missing.
pub type RenderImage = fn(&str) -> FileResult<Vec<u8>>;

/// Image source of a site.
#[derive(Clone, Debug, Default)]
pub struct Images {
    /// Base folder of image names in the site.
    pub folder: Option<PathBuf>,
    /// Function that renders images whose file is missing, if any.
    pub missing: Option<RenderImage>,
    /// Allowed files outside the folder, as canonical paths.
    pub allowed: BTreeSet<PathBuf>,
    stored: BTreeMap<String, Stored>,
    /// Images that `missing` rendered, by name, so that each is rendered once.
    rendered_images: Arc<Mutex<BTreeMap<String, Arc<[u8]>>>>,
}

/// Image whose encoded bytes are kept in memory, for example from a `data:` URI.
#[derive(Clone, Debug)]
struct Stored {
    bytes: Arc<[u8]>,
    mime: String,
    /// Name of the source file, if any.
    name: Option<String>,
}

impl Images {
    /// Creates an image source for files in a folder. `missing` renders images whose file is missing.
    #[must_use]
    pub fn in_folder(folder: Option<PathBuf>, missing: Option<RenderImage>) -> Self {
        Self { folder, missing, ..Self::default() }
    }

    /// Stores the bytes of an image and returns its id, by which the site refers to the image. Equal bytes
    /// are stored once.
    pub fn store(&mut self, bytes: Arc<[u8]>, mime: &str, name: Option<&str>) -> String {
        let known = self.stored.iter().find(|(_, stored)| stored.bytes == bytes).map(|(id, _)| id.clone());
        known.unwrap_or_else(|| {
            let id = format!("{STORED_PREFIX}{}", self.stored.len() + 1);
            self.restore(&id, bytes, mime, name);
            id
        })
    }

    /// Returns the name of an image for the operator: its file name without folders.
    #[must_use]
    pub fn shown_name(&self, name: &str) -> String {
        let own = self.stored.get(name).map_or(Some(name), |stored| stored.name.as_deref());
        let base = own.and_then(|own| own.rsplit(['/', '\\']).next());
        base.unwrap_or("an image of this site").to_owned()
    }

    /// Stores the bytes of an image under the id that they had before, for example after a crash.
    pub fn restore(&mut self, id: &str, bytes: Arc<[u8]>, mime: &str, name: Option<&str>) {
        let stored = Stored { bytes, mime: mime.to_owned(), name: name.map(str::to_owned) };
        self.stored.insert(id.to_owned(), stored);
    }

    /// Returns all stored images: id, MIME type, file name, bytes.
    pub fn stored(&self) -> impl Iterator<Item = (&str, &str, Option<&str>, &[u8])> {
        self.stored
            .iter()
            .map(|(id, stored)| (id.as_str(), stored.mime.as_str(), stored.name.as_deref(), &*stored.bytes))
    }

    /// Whether this name is the id of a stored image.
    #[must_use]
    pub fn is_stored(&self, name: &str) -> bool {
        self.stored.contains_key(name)
    }

    /// Moves images in `data:` URIs from the site to the stored images, so that snapshots of the site contain
    /// only ids.
    pub fn extract_from(&mut self, site: &mut Site) {
        for image in images_mut(site) {
            let Some((mime, bytes)) = parse_data_uri(image) else { continue };
            *image = self.store(bytes.into(), &mime, None);
        }
    }

    /// Returns the site with stored images as `data:` URIs, and other image paths relative to `folder`. If the site
    /// has no folder, images that `missing` renders are also `data:` URIs.
    #[must_use]
    pub fn embed_into(&self, site: &Site, folder: Option<&Path>) -> Site {
        let mut site = site.clone();
        for image in images_mut(&mut site) {
            if let Some(stored) = self.stored.get(image.as_str()) {
                *image = data_uri(&stored.mime, &stored.bytes);
            } else if self.folder.is_none()
                && let Some(Ok(bytes)) = self.missing.map(|render| self.reader(image).render(render))
            {
                *image = data_uri(mime_of(&bytes), &bytes);
            }
        }
        folder.map_or_else(|| site.clone(), |folder| self.rebased(&site, folder))
    }

    /// Returns an image as a `data:` URI for embedding in a page, and its bytes; `read` reads files.
    ///
    /// # Errors
    /// The file cannot be read and the image cannot be rendered, or its format cannot be converted for browsers.
    pub fn embedded(&self, name: &str, read: ReadFile) -> FileResult<(String, Arc<[u8]>)> {
        let bytes = shown_by_browsers(self.reader(name).read(read)?)?;
        Ok((data_uri(mime_of(&bytes), &bytes), bytes))
    }

    /// Returns the site with stored images replaced by their file names.
    #[must_use]
    pub fn with_file_names(&self, site: &Site) -> Site {
        let mut site = site.clone();
        for image in images_mut(&mut site) {
            if let Some(stored) = self.stored.get(image.as_str()) {
                let of_type = MIME_TYPES.iter().find(|(_, mime, _)| *mime == stored.mime);
                let end = of_type.map_or("jpg", |(ending, ..)| *ending);
                let made_up = || format!("{}.{end}", image.trim_start_matches(STORED_PREFIX));
                *image = stored.name.clone().unwrap_or_else(made_up);
            }
        }
        site
    }

    /// Returns the site with image paths relative to another folder.
    #[must_use]
    pub fn rebased(&self, site: &Site, folder: &Path) -> Site {
        let mut site = site.clone();
        images_mut(&mut site).for_each(|image| *image = self.rebased_name(image, folder));
        site
    }

    /// Returns an image name relative to another folder. Names of stored images do not change.
    #[must_use]
    pub fn rebased_name(&self, image: &str, folder: &Path) -> String {
        if self.stored.contains_key(image) || image.starts_with("data:") {
            return image.to_owned();
        }
        let from = self.folder.as_ref().map_or_else(|| PathBuf::from(image), |own| own.join(image));
        relative(&from, folder)
    }

    /// Joins the folder of the site and an image name.
    fn path(&self, name: &str) -> PathBuf {
        self.folder.as_ref().map_or_else(|| PathBuf::from(name), |folder| folder.join(name))
    }

    /// Returns the path of an image's file; `None` for a stored image.
    #[must_use]
    pub fn file(&self, name: &str) -> Option<PathBuf> {
        let is_file = !self.stored.contains_key(name) && !name.starts_with("data:");
        is_file.then(|| self.path(name))
    }

    /// Returns the files that may be read without asking.
    #[must_use]
    pub fn allowed_files(&self) -> AllowedFiles {
        AllowedFiles { folder: self.folder.clone(), allowed: self.allowed.clone() }
    }

    /// Returns the source of an image, which can be read on another thread.
    #[must_use]
    pub fn reader(&self, name: &str) -> Source {
        Source {
            stored: self.stored.get(name).map(|stored| Arc::clone(&stored.bytes)),
            path: self.path(name),
            allowed_files: self.allowed_files(),
            missing: self.missing,
            name: name.to_owned(),
            rendered_images: Arc::clone(&self.rendered_images),
        }
    }
}

/// Source of the bytes of one image: memory, file or renderer. It can be sent to another thread.
#[derive(Clone, Debug)]
pub struct Source {
    stored: Option<Arc<[u8]>>,
    path: PathBuf,
    allowed_files: AllowedFiles,
    missing: Option<RenderImage>,
    name: String,
    rendered_images: Arc<Mutex<BTreeMap<String, Arc<[u8]>>>>,
}

impl Source {
    /// Creates the source of an image in a `data:` URI.
    #[must_use]
    pub fn from_data_uri(uri: &str) -> Option<Self> {
        let (mime, bytes) = parse_data_uri(uri)?;
        let mut images = Images::default();
        let id = images.store(bytes.into(), &mime, None);
        Some(images.reader(&id))
    }

    /// Reads the bytes of the image; `read` reads files. A missing file is rendered if possible.
    ///
    /// # Errors
    /// The file cannot be read, and the image cannot be rendered.
    pub fn read(self, read: ReadFile) -> FileResult<Arc<[u8]>> {
        match (&self.stored, self.missing) {
            (Some(bytes), _) => Ok(Arc::clone(bytes)),
            (None, Some(render)) => {
                read(&self.path, &self.allowed_files).map(Into::into).or_else(|_| self.render(render))
            }
            (None, None) => read(&self.path, &self.allowed_files).map(Into::into),
        }
    }

    /// Returns the name of the image if it may have to be rendered: it has a renderer, and is neither stored nor
    /// rendered yet.
    #[must_use]
    pub fn name_to_render(&self) -> Option<&str> {
        let is_to_be_made = self.stored.is_none() && self.missing.is_some() && self.rendered().is_none();
        is_to_be_made.then_some(self.name.as_str())
    }

    /// Returns the bytes of the image if it was rendered already.
    fn rendered(&self) -> Option<Arc<[u8]>> {
        self.rendered_images.lock().unwrap_or_else(PoisonError::into_inner).get(&self.name).cloned()
    }

    /// Stores the bytes of the rendered image, so that it is rendered once.
    pub fn store_rendered(&self, bytes: Arc<[u8]>) {
        self.rendered_images.lock().unwrap_or_else(PoisonError::into_inner).insert(self.name.clone(), bytes);
    }

    /// Renders the image, unless it was rendered already.
    fn render(&self, render: RenderImage) -> FileResult<Arc<[u8]>> {
        if let Some(known) = self.rendered() {
            return Ok(known);
        }
        let bytes: Arc<[u8]> = render(&self.name)?.into();
        self.store_rendered(Arc::clone(&bytes));
        Ok(bytes)
    }
}

/// Returns the names of the images of a site: of its cameras, then of its plan.
#[must_use]
pub fn image_names(site: &Site) -> Vec<String> {
    let plan = site.plan.iter().filter_map(|plan| plan.image.clone());
    site.cameras.iter().filter_map(|camera| camera.image.clone()).chain(plan).collect()
}

/// Returns mutable references to the names of the images of a site.
pub(crate) fn images_mut(site: &mut Site) -> impl Iterator<Item = &mut String> {
    let plan = site.plan.iter_mut().filter_map(|plan| plan.image.as_mut());
    site.cameras.iter_mut().filter_map(|camera| camera.image.as_mut()).chain(plan)
}

/// Returns the MIME type of an image from its first bytes; PNG if they are unknown.
fn mime_of(bytes: &[u8]) -> &'static str {
    let known = MIME_TYPES.iter().find(|(.., head)| bytes.starts_with(head));
    known.map_or("image/png", |(_, mime, _)| *mime)
}

/// Converts an image to JPEG if browsers do not support its format; otherwise returns it unchanged.
fn shown_by_browsers(bytes: Arc<[u8]>) -> FileResult<Arc<[u8]>> {
    let is_shown = |(_, mime, head): &(&str, &str, &[u8])| *mime != "image/tiff" && bytes.starts_with(head);
    // Bytes of no known image or video format are taken for an SVG, which browsers support.
    let is_svg = !calib_input::is_image_or_video(&bytes);
    if MIME_TYPES.iter().any(is_shown) || is_svg {
        return Ok(bytes);
    }
    let image = calib_input::decode(&bytes).map_err(|error| error.to_string())?;
    let mut jpeg = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 95);
    image.write_with_encoder(encoder).map_err(|error| error.to_string())?;
    Ok(jpeg.into())
}

/// Encodes an image as PNG.
///
/// # Errors
/// If the image has no pixels, or the memory is too small.
pub fn png(image: &RgbImage) -> FileResult<Vec<u8>> {
    let mut png = std::io::Cursor::new(Vec::new());
    image.write_to(&mut png, image::ImageFormat::Png).map_err(|error| error.to_string())?;
    Ok(png.into_inner())
}

/// Returns bytes with their MIME type as a `data:` URI.
#[must_use]
pub fn data_uri(mime: &str, bytes: &[u8]) -> String {
    format!("data:{mime};base64,{}", BASE64.encode(bytes))
}

/// Returns the MIME type and the bytes of a `data:` URI; `None` if it is not valid base64.
fn parse_data_uri(text: &str) -> Option<(String, Vec<u8>)> {
    let (mime, encoded) = text.strip_prefix("data:")?.split_once(";base64,")?;
    Some((mime.to_owned(), BASE64.decode(encoded.trim()).ok()?))
}

/// Parses the text of a site file. Embedded images are moved to the returned image source; other images are
/// read from `folder`.
///
/// # Errors
/// The text is not a valid site; the message names the field.
pub fn parse(text: &str, folder: Option<PathBuf>) -> FileResult<(Site, Images)> {
    parse_with_drawing(text, folder, |_| None)
}

/// Parses the text of a site file as [`parse`] does. If the plan in the site file has no scale, `metres_per_px` is
/// called with the plan and returns its scale from the drawing, or `None`.
///
/// # Errors
/// The text is not a valid site; the message names the field.
pub fn parse_with_drawing(
    text: &str,
    folder: Option<PathBuf>,
    metres_per_px: impl FnOnce(&Plan) -> Option<f64>,
) -> FileResult<(Site, Images)> {
    let mut site = Site::from_json_with_drawing(text, metres_per_px).map_err(|error| error.to_string())?;
    let mut images = Images::in_folder(folder, None);
    images.extract_from(&mut site);
    Ok((site, images))
}

/// Decodes an image, rotated upright by its EXIF orientation.
///
/// # Errors
/// The bytes are not an image, or the image is too large.
pub fn decode(bytes: &[u8]) -> Result<RgbImage, String> {
    calib_input::decode(bytes).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use calib_site::SiteCamera;

    use super::*;

    #[test]
    fn camera_name_is_the_stem_or_the_folder_of_a_generic_stem() {
        let called = |path: &str| camera_name(Path::new(path));
        assert_eq!(called("/site/yard-north/0000.png"), "yard-north");
        assert_eq!(called("/site/yard-south/frame_0001.jpg"), "yard-south");
        assert_eq!(called("/site/yard-north.png"), "yard-north");
        assert_eq!(called("0000.png"), "0000");
    }

    /// Returns the canonical path on a test disk where `/site/link.png` is a link to another folder.
    fn real(path: &Path) -> Option<PathBuf> {
        match path.to_str()? {
            "/site/link.png" | "/site/../private.png" => Some("/private.png".into()),
            "/site/gone.png" => None,
            other => Some(other.into()),
        }
    }

    #[test]
    fn files_outside_the_folder_need_permission() {
        let mut reach = AllowedFiles { folder: Some("/site".into()), ..AllowedFiles::default() };
        let holds = |reach: &AllowedFiles, path: &str| reach.allows(Path::new(path), real);
        assert!(holds(&reach, "/site/a.png") && holds(&reach, "/site/stills/a.png"));
        for out in ["/site/link.png", "/site/../private.png", "/siteless/a.png", "/site/gone.png"] {
            assert!(!holds(&reach, out), "{out}");
        }
        reach.allowed.insert("/private.png".into());
        assert!(holds(&reach, "/site/link.png") && holds(&reach, "/private.png"));
        assert!(!holds(&AllowedFiles::default(), "/a.png"), "without a folder only chosen files are allowed");
    }

    fn site() -> Site {
        let mut camera = SiteCamera::new("a", [4, 3]);
        camera.image = Some("data:image/png;base64,aGVsbG8=".into());
        Site { cameras: vec![camera], ..Site::new() }
    }

    #[test]
    fn data_uris_are_stored_and_restored() {
        let (parsed, images) = parse(&site().to_json(), None).unwrap();
        assert_eq!(parsed.cameras[0].image.as_deref(), Some("stored:1"));
        assert_eq!(images.embed_into(&parsed, None), site());
    }

    #[test]
    fn rendered_images_are_embedded_with_their_own_type() {
        let mut camera = SiteCamera::new("a", [4, 3]);
        camera.image = Some("a.png".into());
        let site = Site { cameras: vec![camera], ..Site::new() };
        let images = Images::in_folder(None, Some(|name| Err(format!("{name} is rendered unnecessarily"))));
        images.reader("a.png").store_rendered(Arc::from([0xff, 0xd8, 0xff].as_slice()));
        assert_eq!(images.reader("a.png").name_to_render(), None);
        let sent = images.embed_into(&site, None);
        assert_eq!(sent.cameras[0].image.as_deref(), Some("data:image/jpeg;base64,/9j/"));
    }

    #[test]
    fn bytes_that_are_not_an_image_are_an_error() {
        assert!(decode(b"not an image").is_err());
    }
}
