//! A site with the images that belong to it, read within limits.
//!
//! Stills that the command line names: files, folders of them, and when they were taken.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use base64::Engine as _;
use calib_core::Code;
use calib_input::{FileError, decode, size_of};
use calib_report::few;
use calib_site::{MAX_BYTES, Names, Options, Site, SiteCamera, Warning};
use image::RgbImage;
use jiff::Timestamp;
use sha2::{Digest as _, Sha256};

use crate::files::say;
use crate::progress::Pulse;
use crate::stop::Stop;

/// A site with the folder that its images are relative to.
pub(crate) struct SiteFile {
    pub(crate) site: Site,
    pub(crate) path: String,
    folder: PathBuf,
    /// Whether images may stand elsewhere than in that folder.
    allows_outside: bool,
    /// SHA-256 of the file, in hexadecimal digits.
    pub(crate) sha256: String,
}

impl SiteFile {
    /// Reads and checks a site file; `-` is stdin, with images relative to the current folder.
    pub(crate) fn read(path: &str) -> Result<Self, Stop> {
        let most = MAX_BYTES as u64;
        let bytes = if path == "-" {
            calib_input::read_from(std::io::stdin().lock(), most)
                .map_err(|why| Stop::invalid("stdin", why))?
        } else {
            calib_input::read(Path::new(path), most).map_err(|why| Stop::invalid(path, pipe_advice(why)))?
        };
        let sha256 = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        let text = calib_input::document(bytes).map_err(|why| Stop::invalid(path, why))?;
        let site = Site::from_json(&text).map_err(|error| Stop::invalid(path, error))?;
        let folder = Path::new(path).parent().unwrap_or(Path::new("")).to_owned();
        Ok(Self { site, path: path.to_owned(), folder, allows_outside: false, sha256 })
    }

    /// With images wherever they stand, if that is wanted.
    pub(crate) fn allowing_outside(self, allows_outside: bool) -> Self {
        Self { allows_outside, ..self }
    }

    /// As [`Self::read`], with every camera solved, and of those the ones whose calibration holds at a time.
    pub(crate) fn read_solved(path: &str, time: Option<&str>) -> Result<Self, Stop> {
        let file = Self::read(path)?.noting_out_of_date();
        let holds = |camera: &SiteCamera| holds_at(camera, time);
        let mut holds = file.site.cameras.iter().map(holds).collect::<Result<Vec<bool>, Stop>>()?.into_iter();
        // What other periods show belongs to the site, too.
        let mut file = file.solved();
        file.site.cameras.retain(|_| holds.next().unwrap_or_default());
        Ok(file)
    }

    /// With a warning in every solution that is not of what is drawn.
    fn noting_out_of_date(mut self) -> Self {
        for (index, finding) in self.site.out_of_date() {
            let warning = self.site.in_english(Some(index), &finding, Names::InFile);
            if let Some(solution) = &mut self.site.cameras[index].solution {
                solution.warnings.push(warning);
            }
        }
        self
    }

    /// Says which solutions are not of what is drawn.
    pub(crate) fn tell_out_of_date(&self) {
        for camera in &self.site.cameras {
            let warnings = camera.solution.iter().flat_map(|solution| &solution.warnings);
            for Warning { message, advice, .. } in warnings.filter(|warning| warning.code == Code::OutOfDate)
            {
                say(format_args!("calib: camera \"{}\": {message} {advice}", camera.id));
            }
        }
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
            let pulse = Pulse::new("solving");
            let mut report = self.site.calibrate(&options);
            drop(pulse);
            report.cameras.retain(|(index, _)| is_fresh(&self.site.cameras[*index]));
            self.site = report.write_into(&self.site);
        }
        self
    }

    /// A site with the images of this one, as a file elsewhere names them. On stdout they stay as they are: nobody knows
    /// where that ends.
    pub(crate) fn seen_from(&self, site: &Site, file: &str) -> Site {
        let own = if self.folder.as_os_str().is_empty() { Path::new(".") } else { &self.folder };
        let is_same = own.canonicalize().ok() == folder_of(file).canonicalize().ok();
        let mut site = site.clone();
        if file == "-" || is_same {
            return site;
        }
        let plan = site.plan.iter_mut().filter_map(|plan| plan.image.as_mut());
        let images = site.cameras.iter_mut().filter_map(|camera| camera.image.as_mut()).chain(plan);
        for image in images.filter(|image| !image.starts_with("data:") && Path::new(image).is_relative()) {
            *image = beside(&own.join(&*image), file);
        }
        site
    }

    /// With its images as a file elsewhere names them.
    pub(crate) fn moved_to(self, file: &str) -> Self {
        Self { site: self.seen_from(&self.site, file), ..self }
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
        if let Some(why) = self.out_of_reach(image) {
            return Err(Stop::invalid(image, why));
        }
        let path = self.folder.join(image);
        calib_input::read(&path, MAX_BYTES as u64).map_err(|error| Stop::invalid(path.display(), error))
    }

    /// Why an image is not read: it is not there, or stands, or leads by a link, elsewhere than in the folder of
    /// the site. Whoever made the site would see any picture of this machine in what is handed back.
    fn out_of_reach(&self, image: &str) -> Option<String> {
        if image.starts_with("data:") {
            return None;
        }
        let folder = if self.folder.as_os_str().is_empty() { Path::new(".") } else { &self.folder };
        let Ok(real) = self.folder.join(image).canonicalize() else {
            return Some(format!("is not there; images are looked for beside {}", self.path));
        };
        let is_inside =
            self.allows_outside || folder.canonicalize().is_ok_and(|folder| real.starts_with(folder));
        let outside =
            || format!("is outside the folder of {}; --allow-outside reads it all the same", self.path);
        (!is_inside).then(outside)
    }

    /// Compares the size of every image that is there with the one in the site file; what is missing is told.
    pub(crate) fn check_images(&self) -> Result<(), Stop> {
        for camera in &self.site.cameras {
            let Some(name) = camera.image.as_deref() else { continue };
            if let Some(why) = self.out_of_reach(name) {
                say(format_args!(
                    "calib: camera \"{}\": its image {name} {why}; solved without it",
                    camera.id
                ));
                continue;
            }
            let found = size_of(&self.image_bytes(name)?)
                .map_err(|error| Stop::invalid(shown(name), format!("camera \"{}\": {error}", camera.id)))?;
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
        let bytes = self.image_bytes(name)?;
        let wrong = |error| Stop::invalid(shown(name), format!("camera \"{}\": {error}", camera.id));
        // Before the pixels are decoded.
        self.check_size(camera, name, size_of(&bytes).map_err(wrong)?)?;
        decode(&bytes).map_err(wrong)
    }

    /// The plan's picture, if the site has one.
    pub(crate) fn plan_image(&self) -> Result<Option<RgbImage>, Stop> {
        let Some(name) = self.site.plan.as_ref().and_then(|plan| plan.image.as_deref()) else {
            return Ok(None);
        };
        let bytes = self.image_bytes(name)?;
        decode(&bytes).map(Some).map_err(|error| Stop::invalid(shown(name), format!("the plan: {error}")))
    }
}

/// A path as a site in this file names it: as seen from its folder.
pub(crate) fn beside(path: &Path, file: &str) -> String {
    if file == "-" {
        return path.to_string_lossy().into_owned();
    }
    let real = |path: &Path| path.canonicalize().or_else(|_| std::path::absolute(path));
    match (real(path), real(folder_of(file))) {
        (Ok(path), Ok(folder)) => calib_input::relative(&path, &folder),
        _ => path.to_string_lossy().into_owned(),
    }
}

fn folder_of(file: &str) -> &Path {
    let folder = Path::new(file).parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
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

/// A site is read whole, and what a pipe brings has no length.
fn pipe_advice(error: FileError) -> String {
    match error {
        FileError::NotAFile("a pipe") => format!("{error}; give the site on stdin, as -"),
        error => error.to_string(),
    }
}

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
    decode(&bytes(path)?).map_err(|error| Stop::invalid(path.display(), error))
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
