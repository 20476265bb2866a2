//! Site file with the images of its cameras, read within size limits; image files and folders from the
//! command line with their capture times.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use base64::Engine as _;
use calib_core::{Camera, Code};
use calib_input::{FileError, decode, image_endings, image_size};
use calib_plan::{Drawing, View};
use calib_report::shortened_list;
use calib_site::{MAX_BYTES, Names, Options, Plan, Site, SiteCamera, Warning, counted};
use image::RgbImage;
use jiff::Timestamp;
use sha2::{Digest as _, Sha256};

use crate::files::print_message;
use crate::progress::Pulse;
use crate::stop::CommandError;

/// Site with the folder that its image paths are relative to.
pub(crate) struct SiteFile {
    pub(crate) site: Site,
    pub(crate) path: String,
    folder: PathBuf,
    /// Whether images outside `folder` may be read. `None` if they must not be read, and the command has no option to
    /// allow it.
    allows_outside: Option<bool>,
    /// SHA-256 of the file, in hexadecimal digits.
    pub(crate) sha256: String,
}

impl SiteFile {
    /// Reads and checks a site file; `-` is stdin, with images relative to the current folder.
    pub(crate) fn read(path: &str) -> Result<Self, CommandError> {
        Self::read_with(path, None)
    }

    /// Reads a site file as [`Self::read`] does. `allows_outside` states whether images outside the site's folder
    /// may be read; `None` if the command has no option for it.
    pub(crate) fn read_with(path: &str, allows_outside: Option<bool>) -> Result<Self, CommandError> {
        let most = MAX_BYTES as u64;
        let bytes = if path == "-" {
            calib_input::read_from(std::io::stdin().lock(), most)
                .map_err(|why| CommandError::invalid("stdin", why))?
        } else {
            calib_input::read(Path::new(path), most)
                .map_err(|why| CommandError::invalid(path, file_error_message(why)))?
        };
        let sha256 = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        let text = calib_input::json_document(bytes).map_err(|why| CommandError::invalid(path, why))?;
        let folder = Path::new(path).parent().unwrap_or(Path::new("")).to_owned();
        let file = Self { site: Site::new(), path: path.to_owned(), folder, allows_outside, sha256 };
        // If the drawing cannot be read, this error is reported instead of the missing scale that it causes.
        let mut failed = None;
        let site = Site::from_json_with_drawing(&text, |plan| {
            file.drawing(plan)
                .unwrap_or_else(|error| {
                    failed = Some(error);
                    None
                })?
                .facts
                .metres_per_px
        });
        let site = site.map_err(|error| failed.unwrap_or_else(|| CommandError::invalid(path, error)))?;
        Ok(Self { site, ..file })
    }

    /// Reads a site as [`Self::read`] does, solves unsolved cameras, and keeps the calibrations that are
    /// valid at `time`.
    pub(crate) fn read_solved(
        path: &str,
        time: Option<&str>,
        allows_outside: bool,
    ) -> Result<Self, CommandError> {
        let file = Self::read_with(path, Some(allows_outside))?.with_out_of_date_warnings();
        let holds = |camera: &SiteCamera| is_valid_at(camera, time);
        let mut holds =
            file.site.cameras.iter().map(holds).collect::<Result<Vec<bool>, CommandError>>()?.into_iter();
        // All periods are solved first, because their views also constrain the site.
        let mut file = file.solve_new_cameras();
        file.site.cameras.retain(|_| holds.next().unwrap_or_default());
        Ok(file)
    }

    /// Reads a site as [`Self::read_solved`] does, with all periods of its cameras.
    pub(crate) fn read_for_measuring(path: &str) -> Result<Self, CommandError> {
        Ok(Self::read(path)?.with_out_of_date_warnings().solve_new_cameras())
    }

    /// Adds a warning to every solution that does not match the current annotations.
    fn with_out_of_date_warnings(mut self) -> Self {
        for (index, finding) in self.site.out_of_date() {
            let warning = self.site.describe_finding(Some(index), &finding, Names::InFile);
            if let Some(solution) = &mut self.site.cameras[index].solution {
                solution.warnings.push(warning);
            }
        }
        self
    }

    /// Prints the warnings of solutions that do not match the current annotations.
    pub(crate) fn warn_out_of_date(&self) {
        for camera in &self.site.cameras {
            let warnings = camera.solution.iter().flat_map(|solution| &solution.warnings);
            for Warning { message, advice, .. } in warnings.filter(|warning| warning.code == Code::OutOfDate)
            {
                print_message(format_args!("calib: camera \"{}\": {message} {advice}", camera.id));
            }
        }
    }

    /// Refuses an unknown camera id.
    pub(crate) fn has_camera(&self, id: &str) -> Result<(), CommandError> {
        if self.site.cameras.iter().any(|camera| camera.id == id) {
            return Ok(());
        }
        let ids = shortened_list(self.site.cameras.iter().map(|camera| camera.id.as_str()));
        let path = &self.path;
        let known = if ids.is_empty() {
            format!("{path} has no cameras")
        } else {
            format!("cameras in {path}: {ids}")
        };
        Err(CommandError::Usage(format!("--camera {id}: unknown camera; {known}")))
    }

    /// Returns the camera with this id; fails if the id is unknown or has several periods.
    pub(crate) fn camera(&self, id: &str) -> Result<&SiteCamera, CommandError> {
        self.has_camera(id)?;
        let found: Vec<&SiteCamera> = self.site.cameras.iter().filter(|camera| camera.id == id).collect();
        match found[..] {
            [camera] => Ok(camera),
            _ => Err(CommandError::Usage(format!(
                "--camera {id}: several periods have this id; choose one with --at TIME"
            ))),
        }
    }

    /// Solves the cameras that have neither a solution nor an error, so that every command accepts a new
    /// site.
    fn solve_new_cameras(mut self) -> Self {
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

    /// Returns `site` with image paths relative to `file`. Paths stay unchanged if `file` is stdout, because
    /// its folder is unknown.
    pub(crate) fn with_paths_relative_to(&self, site: &Site, file: &str) -> Site {
        let own = if self.folder.as_os_str().is_empty() { Path::new(".") } else { &self.folder };
        let is_same = own.canonicalize().ok() == folder_of(file).canonicalize().ok();
        let mut site = site.clone();
        if file == "-" || is_same {
            return site;
        }
        let plan = site.plan.iter_mut().filter_map(|plan| plan.image.as_mut());
        let images = site.cameras.iter_mut().filter_map(|camera| camera.image.as_mut()).chain(plan);
        for image in images.filter(|image| !image.starts_with("data:") && Path::new(image).is_relative()) {
            *image = path_relative_to_file(&own.join(&*image), file);
        }
        site
    }

    /// Makes the image paths relative to `file`.
    pub(crate) fn relative_to(self, file: &str) -> Self {
        Self { site: self.with_paths_relative_to(&self.site, file), ..self }
    }

    /// Returns the bytes of an image of this site. `image` is a path relative to the site file, or a `data:` URI.
    pub(crate) fn image_bytes(&self, image: &str) -> Result<Vec<u8>, CommandError> {
        if let Some(data) = image.strip_prefix("data:") {
            let (_, encoded) = data.split_once(";base64,").ok_or_else(|| {
                CommandError::invalid(
                    &self.path,
                    "an image is a data: URI without \";base64,\"; encode it as base64",
                )
            })?;
            return base64::engine::general_purpose::STANDARD.decode(encoded.trim()).map_err(|error| {
                CommandError::invalid(
                    &self.path,
                    format!("the data: URI of an image is not valid base64: {error}"),
                )
            });
        }
        if let Some(why) = self.unreadable_reason(image) {
            return Err(CommandError::invalid(image, why));
        }
        let path = self.folder.join(image);
        calib_input::read(&path, MAX_BYTES as u64)
            .map_err(|error| CommandError::invalid(path.display(), error))
    }

    /// Returns the reason why an image of the site must not be read: it is missing, or its real path is outside the
    /// site's folder and `allows_outside` is not set. Without this check, the output for an untrusted site file could
    /// contain any image of this machine.
    fn unreadable_reason(&self, image: &str) -> Option<String> {
        if image.starts_with("data:") {
            return None;
        }
        let folder = if self.folder.as_os_str().is_empty() { Path::new(".") } else { &self.folder };
        let own = match self.path.as_str() {
            "-" => "the current folder".to_owned(),
            path => format!("the folder of {path}"),
        };
        let Ok(real) = self.folder.join(image).canonicalize() else {
            return Some(format!("was not found; image paths are relative to {own}"));
        };
        let is_allowed = self.allows_outside == Some(true);
        let is_inside = is_allowed || folder.canonicalize().is_ok_and(|folder| real.starts_with(folder));
        let outside = || match self.allows_outside {
            Some(_) => format!("is outside {own}; add --allow-outside to read it"),
            None => format!("is outside {own}; copy it into that folder"),
        };
        (!is_inside).then(outside)
    }

    /// Compares the size of every image with the site file, and reports missing images.
    pub(crate) fn check_images(&self) -> Result<(), CommandError> {
        for camera in &self.site.cameras {
            let Some(name) = camera.image.as_deref() else { continue };
            if let Some(why) = self.unreadable_reason(name) {
                print_message(format_args!(
                    "calib: camera \"{}\": solved without its image: {name} {why}",
                    camera.id
                ));
                continue;
            }
            let found = image_size(&self.image_bytes(name)?).map_err(|error| {
                CommandError::invalid(image_label(name), format!("camera \"{}\": {error}", camera.id))
            })?;
            self.check_size(camera, name, found)?;
        }
        Ok(())
    }

    fn check_size(&self, camera: &SiteCamera, name: &str, found: [u32; 2]) -> Result<(), CommandError> {
        if found == camera.size_px {
            return Ok(());
        }
        let [w, h] = camera.size_px;
        let what = format!(
            "the image has {} x {} pixels, but size_px of camera \"{}\" in {} is {w} x {h}; correct one of them",
            found[0], found[1], camera.id, self.path
        );
        Err(CommandError::invalid(image_label(name), what))
    }

    /// Reads a camera's image, rotated according to its EXIF data. Its size must match the site file.
    pub(crate) fn camera_image(&self, camera: &SiteCamera) -> Result<RgbImage, CommandError> {
        let name = camera.image.as_deref().ok_or_else(|| {
            CommandError::invalid(
                &self.path,
                format!(
                    "camera \"{}\" has no image, but this command needs one; enter its path as \"image\"",
                    camera.id
                ),
            )
        })?;
        let bytes = self.image_bytes(name)?;
        let wrong =
            |error| CommandError::invalid(image_label(name), format!("camera \"{}\": {error}", camera.id));
        // The size is checked before the pixels are decoded.
        self.check_size(camera, name, image_size(&bytes).map_err(wrong)?)?;
        decode(&bytes).map_err(wrong)
    }

    /// Reads the image of the plan, if the site has one.
    pub(crate) fn plan_image(&self) -> Result<Option<RgbImage>, CommandError> {
        let Some((plan, name)) =
            self.site.plan.as_ref().and_then(|plan| Some((plan, plan.image.as_deref()?)))
        else {
            return Ok(None);
        };
        let wrong = |error: String| CommandError::invalid(image_label(name), format!("the plan: {error}"));
        let bytes = self.image_bytes(name)?;
        let image = match drawing_of(plan, name, &bytes)? {
            Some(drawing) => drawing.into_image().map_err(|error| wrong(error.to_string()))?,
            None => decode(&bytes).map_err(|error| wrong(error.to_string()))?,
        };
        Ok(Some(image))
    }

    /// Reads the drawing of a plan; `None` if its image is not a drawing.
    fn drawing(&self, plan: &Plan) -> Result<Option<Drawing>, CommandError> {
        let Some(name) = plan.image.as_deref() else { return Ok(None) };
        drawing_of(plan, name, &self.image_bytes(name)?)
    }
}

/// Reads the drawing of a plan from the bytes of its image; `None` if the image is not a drawing.
fn drawing_of(plan: &Plan, name: &str, bytes: &[u8]) -> Result<Option<Drawing>, CommandError> {
    let view = View { page: plan.page, layers: plan.layers.clone() };
    let drawing = calib_plan::read(bytes, &view).transpose();
    drawing.map_err(|error| CommandError::invalid(image_label(name), format!("the plan: {error}")))
}

/// Returns `path` relative to the folder of `file`, as the site in `file` refers to it.
pub(crate) fn path_relative_to_file(path: &Path, file: &str) -> String {
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

/// Returns the calibrated camera of an entry; fails if it has none.
pub(crate) fn calibrated_camera(entry: &SiteCamera) -> Result<Camera, CommandError> {
    entry.camera().ok_or_else(|| {
        let what = format!("camera \"{}\" is not calibrated; run calib solve to see the reason", entry.id);
        CommandError::Unsolved(what)
    })
}

/// Whether a calibration is valid at a time; always if no time is given.
pub(crate) fn is_valid_at(camera: &SiteCamera, time: Option<&str>) -> Result<bool, CommandError> {
    let Some(time) = time else { return Ok(true) };
    camera.is_valid_at(time).map_err(|error| CommandError::Usage(format!("--at: {}", error.message())))
}

/// Returns an image name for messages; a `data:` URI is shortened.
fn image_label(name: &str) -> &str {
    if name.starts_with("data:") { "data: image" } else { name }
}

/// Formats a file error. For a pipe the message advises stdin, because a site file must have a known length.
fn file_error_message(error: FileError) -> String {
    match error {
        FileError::NotAFile("a pipe") => format!("{error}; pass the site on stdin, with -"),
        error => error.to_string(),
    }
}

/// Lists the given images; images in folders are sorted by name.
pub(crate) fn list_images(given: &[PathBuf]) -> Result<Vec<PathBuf>, CommandError> {
    let mut found = Vec::new();
    for path in given {
        if !path.exists() {
            return Err(CommandError::invalid(path.display(), "no such image or folder"));
        }
        if !path.is_dir() {
            found.push(path.clone());
            continue;
        }
        let reading = || format!("cannot read {}", path.display());
        let entries = std::fs::read_dir(path).with_context(reading)?;
        let paths = entries.map(|entry| entry.map(|entry| entry.path()));
        let all = paths.collect::<Result<Vec<PathBuf>, _>>().with_context(reading)?;
        let (mut inside, others): (Vec<PathBuf>, Vec<PathBuf>) =
            all.into_iter().partition(|path| is_image_path(path));
        inside.sort();
        if inside.is_empty() {
            let endings: Vec<String> = image_endings().map(|ending| format!(".{ending}")).collect();
            return Err(CommandError::invalid(
                path.display(),
                format!("this folder contains no supported images ({})", endings.join(", ")),
            ));
        }
        report_skipped(path, others);
        found.extend(inside);
    }
    Ok(found)
}

/// Reports the files of a folder that are not read as images. Files whose names begin with a dot are not reported.
fn report_skipped(folder: &Path, others: Vec<PathBuf>) {
    let name = |path: &PathBuf| path.file_name().map(|name| name.to_string_lossy().into_owned());
    let mut names: Vec<String> = others
        .iter()
        .filter(|path| path.is_file())
        .filter_map(name)
        .filter(|n| !n.starts_with('.'))
        .collect();
    names.sort();
    if names.is_empty() {
        return;
    }
    print_message(format_args!(
        "calib: {}: skipped {} without an image extension: {}",
        folder.display(),
        counted(names.len(), "file", "files"),
        shortened_list(names.iter().map(String::as_str))
    ));
}

fn is_image_path(path: &Path) -> bool {
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase());
    path.is_file() && image_endings().any(|ending| extension.as_deref() == Some(ending))
}

/// Reads an image within size limits.
pub(crate) fn read_image(path: &Path) -> Result<RgbImage, CommandError> {
    decode(&read_image_bytes(path)?).map_err(|error| CommandError::invalid(path.display(), error))
}

/// Reads the bytes of an image within size limits.
pub(crate) fn read_image_bytes(path: &Path) -> Result<Vec<u8>, CommandError> {
    calib_input::read(path, MAX_BYTES as u64).map_err(|error| CommandError::invalid(path.display(), error))
}

/// Returns the capture time of an image, from its name or otherwise its EXIF data.
pub(crate) fn capture_time(path: &Path) -> Result<Option<Timestamp>, CommandError> {
    let time = match calib_input::time_in_name(&stem(path)) {
        Some(time) => Some(time),
        None => calib_input::capture_time(&read_image_bytes(path)?),
    };
    Ok(time.and_then(|time| time.parse().ok()))
}

/// Returns the file name without folder and extension.
pub(crate) fn stem(path: &Path) -> String {
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}
