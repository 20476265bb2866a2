//! Reading sites and images with limits, and writing files whole or not at all.

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use base64::Engine as _;
use calib_core::{MAX_BYTES, Options, Site, SiteCamera};
use image::{DynamicImage, ImageDecoder as _, ImageReader, RgbImage};
use sha2::{Digest as _, Sha256};

use crate::part::Part;
use crate::stop::Stop;
use crate::words::few;

/// Most memory that decoding one image may take, in bytes.
const MAX_IMAGE_BYTES: u64 = 1 << 30;

/// A site with the folder that its images are relative to.
pub(crate) struct SiteFile {
    pub(crate) site: Site,
    pub(crate) path: String,
    folder: PathBuf,
    /// SHA-256 of the file, in hexadecimal digits.
    pub(crate) sha256: String,
}

impl SiteFile {
    /// Reads and checks a site file; `-` is stdin, with images relative to the current folder.
    pub(crate) fn read(path: &str) -> Result<Self, Stop> {
        let bytes = if path == "-" {
            read_limited(std::io::stdin().lock(), "stdin")?
        } else {
            let file = File::open(path).map_err(|error| Stop::invalid(path, error))?;
            read_limited(file, path)?
        };
        let sha256 = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        let text = String::from_utf8(bytes)
            .map_err(|_| Stop::invalid(path, "not text; a site file (JSON) is expected here"))?;
        let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
        let site = Site::from_json(text).map_err(|error| Stop::invalid(path, error))?;
        let folder = Path::new(path).parent().unwrap_or(Path::new("")).to_owned();
        Ok(Self { site, path: path.to_owned(), folder, sha256 })
    }

    /// As [`Self::read`], with every camera solved, and of those the ones whose calibration holds at a time.
    pub(crate) fn read_solved(path: &str, time: Option<&str>) -> Result<Self, Stop> {
        let file = Self::read(path)?;
        let holds = |camera: &SiteCamera| holds_at(camera, time);
        let mut holds = file.site.cameras.iter().map(holds).collect::<Result<Vec<bool>, Stop>>()?.into_iter();
        // What other periods show belongs to the site, too.
        let mut file = file.solved();
        file.site.cameras.retain(|_| holds.next().unwrap_or_default());
        Ok(file)
    }

    /// Refuses an id that no camera has.
    pub(crate) fn has_camera(&self, id: &str) -> Result<(), Stop> {
        if self.site.cameras.iter().any(|camera| camera.id == id) {
            return Ok(());
        }
        let ids = few(self.site.cameras.iter().map(|camera| camera.id.as_str()));
        let has = if ids.is_empty() { "no cameras".into() } else { format!("the cameras {ids}") };
        Err(Stop::Usage(format!("--camera {id}: {} has {has}", self.path)))
    }

    /// The one camera of this id.
    pub(crate) fn camera(&self, id: &str) -> Result<&SiteCamera, Stop> {
        self.has_camera(id)?;
        let found: Vec<&SiteCamera> = self.site.cameras.iter().filter(|camera| camera.id == id).collect();
        match found[..] {
            [camera] => Ok(camera),
            _ => Err(Stop::Usage(format!(
                "--camera {id}: several periods have this id; choose one with --at TIME"
            ))),
        }
    }

    /// Solves the cameras that nobody tried to solve yet, so that every command works on a fresh site.
    fn solved(mut self) -> Self {
        let is_fresh = |camera: &SiteCamera| camera.solution.is_none() && camera.error.is_none();
        let fresh: Vec<String> =
            self.site.cameras.iter().filter(|c| is_fresh(c)).map(|c| c.id.clone()).collect();
        if !fresh.is_empty() {
            let options = Options { cameras: Some(fresh), ..Options::default() };
            let mut report = self.site.calibrate(&options);
            report.cameras.retain(|(index, _)| is_fresh(&self.site.cameras[*index]));
            self.site = report.write_into(&self.site);
        }
        self
    }

    /// The bytes of an image of this site: a path relative to the site file, or a `data:` URI.
    pub(crate) fn image_bytes(&self, image: &str) -> Result<Vec<u8>, Stop> {
        if let Some(data) = image.strip_prefix("data:") {
            let (_, encoded) = data.split_once(";base64,").ok_or_else(|| {
                Stop::invalid(&self.path, "an image is a data: URI without \";base64,\", expected base64")
            })?;
            return base64::engine::general_purpose::STANDARD
                .decode(encoded.trim())
                .map_err(|error| Stop::invalid(&self.path, format!("an image is not base64: {error}")));
        }
        let path = self.folder.join(image);
        let file = File::open(&path).map_err(|error| {
            Stop::invalid(path.display(), format!("{error}; images are looked for beside {}", self.path))
        })?;
        read_limited(file, &path.display().to_string())
    }

    /// Compares the size of every image that is there with the one in the site file; what is missing is told.
    pub(crate) fn check_images(&self) -> Result<(), Stop> {
        for camera in &self.site.cameras {
            let Some(name) = camera.image.as_deref() else { continue };
            if !name.starts_with("data:") && !self.folder.join(name).exists() {
                say(format_args!(
                    "calib: camera \"{}\": its image {name} is not there; solved without it",
                    camera.id
                ));
                continue;
            }
            let found = size_of(&self.image_bytes(name)?).map_err(|error| {
                Stop::invalid(shown(name), format!("camera \"{}\": {error:#}", camera.id))
            })?;
            self.check_size(camera, name, found)?;
        }
        Ok(())
    }

    fn check_size(&self, camera: &SiteCamera, name: &str, found: [u32; 2]) -> Result<(), Stop> {
        if found == camera.size_px {
            return Ok(());
        }
        let [w, h] = camera.size_px;
        let what = format!(
            "the image is {} x {} pixels, and size_px of camera \"{}\" in {} says {w} x {h}; correct the one that is wrong",
            found[0], found[1], camera.id, self.path
        );
        Err(Stop::invalid(shown(name), what))
    }

    /// A camera's image, turned as its EXIF data says; its size must be the one in the site file.
    pub(crate) fn camera_image(&self, camera: &SiteCamera) -> Result<RgbImage, Stop> {
        let name = camera.image.as_deref().ok_or_else(|| {
            Stop::invalid(
                &self.path,
                format!("camera \"{}\" has no image, and this command needs one", camera.id),
            )
        })?;
        let image = decode(&self.image_bytes(name)?)
            .map_err(|error| Stop::invalid(shown(name), format!("{error:#}")))?;
        self.check_size(camera, name, [image.width(), image.height()])?;
        Ok(image)
    }

    /// The plan's picture, if the site has one.
    pub(crate) fn plan_image(&self) -> Result<Option<RgbImage>, Stop> {
        let Some(name) = self.site.plan.as_ref().and_then(|plan| plan.image.as_deref()) else {
            return Ok(None);
        };
        let bytes = self.image_bytes(name)?;
        decode(&bytes).map(Some).map_err(|error| Stop::invalid(shown(name), format!("{error:#}")))
    }
}

/// Whether a calibration holds at a time, if one is asked for.
pub(crate) fn holds_at(camera: &SiteCamera, time: Option<&str>) -> Result<bool, Stop> {
    let Some(time) = time else { return Ok(true) };
    camera.is_valid_at(time).map_err(|error| Stop::Usage(format!("--at: {}", error.message())))
}

/// A data: URI does not fill the screen.
fn shown(name: &str) -> &str {
    if name.starts_with("data:") { "data: image" } else { name }
}

fn read_limited(reader: impl std::io::Read, name: &str) -> Result<Vec<u8>, Stop> {
    let mut bytes = Vec::new();
    reader.take(MAX_BYTES as u64 + 1).read_to_end(&mut bytes).map_err(|error| Stop::invalid(name, error))?;
    if bytes.len() > MAX_BYTES {
        return Err(Stop::invalid(
            name,
            format!("larger than {} MiB, the most that is read", MAX_BYTES >> 20),
        ));
    }
    Ok(bytes)
}

/// Width and height of an image after EXIF turning, from its header.
fn size_of(bytes: &[u8]) -> anyhow::Result<[u32; 2]> {
    let (decoder, orientation) = decoder(bytes)?;
    let (width, height) = decoder.dimensions();
    use image::metadata::Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
    let is_on_its_side = matches!(orientation, Rotate90 | Rotate90FlipH | Rotate270 | Rotate270FlipH);
    Ok(if is_on_its_side { [height, width] } else { [width, height] })
}

/// Decodes an image within limits and turns it as its EXIF data says.
pub(crate) fn decode(bytes: &[u8]) -> anyhow::Result<RgbImage> {
    let (decoder, orientation) = decoder(bytes)?;
    let mut image = DynamicImage::from_decoder(decoder)?;
    image.apply_orientation(orientation);
    Ok(image.into_rgb8())
}

fn decoder(bytes: &[u8]) -> anyhow::Result<(impl image::ImageDecoder + '_, image::metadata::Orientation)> {
    let mut reader = ImageReader::new(std::io::Cursor::new(bytes)).with_guessed_format()?;
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(calib_core::MAX_SIDE);
    limits.max_image_height = Some(calib_core::MAX_SIDE);
    limits.max_alloc = Some(MAX_IMAGE_BYTES);
    reader.limits(limits);
    let mut decoder = reader.into_decoder().context("not a PNG or JPEG image")?;
    let orientation = decoder.orientation()?;
    Ok((decoder, orientation))
}

/// An image as PNG bytes.
pub(crate) fn png(image: &RgbImage) -> Result<Vec<u8>, Stop> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

/// An image in the format that the name of a file asks for: JPEG for .jpg and .jpeg, else PNG.
pub(crate) fn encoded(image: &RgbImage, name: &str) -> Result<Vec<u8>, Stop> {
    let extension = Path::new(name).extension().map(|e| e.to_string_lossy().to_lowercase());
    if matches!(extension.as_deref(), Some("jpg" | "jpeg")) { jpeg(image) } else { png(image) }
}

/// An image as JPEG bytes, good enough to judge lines by.
pub(crate) fn jpeg(image: &RgbImage) -> Result<Vec<u8>, Stop> {
    const QUALITY: u8 = 88;
    let mut bytes = Vec::new();
    image.write_with_encoder(image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, QUALITY))?;
    Ok(bytes)
}

/// Writes a file whole or not at all; `-` is stdout. A file that is there needs `force`.
pub(crate) fn write(path: &str, bytes: &[u8], force: bool) -> Result<(), Stop> {
    if path == "-" {
        std::io::stdout().lock().write_all(bytes)?;
        return Ok(());
    }
    check_free(path, force)?;
    write_atomically(Path::new(path), bytes)
}

/// Refuses a path that is taken, before any work is done for it.
pub(crate) fn check_free(path: &str, force: bool) -> Result<(), Stop> {
    if path != "-" && !force && Path::new(path).exists() && !is_stream(Path::new(path)) {
        return Err(Stop::Failed(anyhow::anyhow!("{path} exists; --force overwrites it")));
    }
    Ok(())
}

/// Whether a path leads to a pipe or a device: nothing to replace.
fn is_stream(path: &Path) -> bool {
    path.metadata().is_ok_and(|about| !about.is_file() && !about.is_dir())
}

/// Writes out of sight, then puts the file in its place: a killed run leaves the old one or the new one.
pub(crate) fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), Stop> {
    write_through(path, |mut file| Ok(file.write_all(bytes)?))
}

/// As [`write_atomically`], what is written handed out piece by piece.
pub(crate) fn write_through(path: &Path, fill: impl FnOnce(&File) -> Result<(), Stop>) -> Result<(), Stop> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let writing = || format!("writing {}", path.display());
    if is_stream(path) {
        return fill(&File::options().write(true).open(path).with_context(writing)?);
    }
    let part = Part::new_in(folder).with_context(writing)?;
    fill(part.file())?;
    part.persist(path).with_context(writing)?;
    Ok(())
}

/// Prints data to stdout.
pub(crate) fn print(text: &str) -> Result<(), Stop> {
    std::io::stdout().lock().write_all(text.as_bytes())?;
    Ok(())
}

/// Tells the operator something that is not data.
pub(crate) fn say(text: impl std::fmt::Display) {
    // A closed stderr leaves nobody to tell.
    let _ = writeln!(std::io::stderr(), "{text}");
}
