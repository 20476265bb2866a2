//! Import of files of other programs: detection of their format, and scaling of their lenses to the size of
//! the images of the site.

use std::borrow::Cow;

use calib_formats::{FORMATS, File, Format, Imported};
use calib_site::{LensEntry, Plan, SiteCamera};

/// Largest relative difference between two aspect ratios that are treated as equal.
const MAX_ASPECT_DIFFERENCE: f64 = 2e-3;

/// Returns the world file format.
fn world_format() -> Option<&'static Format> {
    FORMATS.iter().find(|format| format.name == "worldfile")
}

/// Returns the file name extensions of world files.
#[must_use]
pub fn world_endings() -> &'static [&'static str] {
    world_format().map_or(&[], |format| format.extensions)
}

/// Reads the position and scale of a plan from a world file. The plan has no image.
///
/// # Errors
/// The file cannot be read, or does not describe a plan.
pub fn plan_from_world_file(file: File) -> Result<Plan, String> {
    let format = world_format().ok_or_else(|| format!("{}: world files are not supported", file.name))?;
    let read = calib_formats::import(format, &[file]).map_err(|error| error.to_string())?;
    read.site.plan.ok_or_else(|| "The world file does not describe a plan.".into())
}

/// Returns the extension of a file name, in lower case.
fn extension(name: &str) -> String {
    name.rsplit_once('.').map_or_else(String::new, |(_, extension)| extension.to_lowercase())
}

/// Whether a format that can be imported has the extension of this file.
#[must_use]
pub fn is_importable(name: &str) -> bool {
    let own = extension(name);
    FORMATS.iter().any(|format| format.can_import() && format.extensions.contains(&own.as_str()))
}

/// Imports files with the first format that accepts them; formats with the extension of the files are tried.
///
/// # Errors
/// No format accepts the files. The message contains the error of each format that was tried.
pub fn import_any(files: &[File]) -> Result<(&'static Format, Imported), String> {
    let fits = |format: &&Format| {
        format.can_import()
            && files.iter().any(|file| format.extensions.contains(&extension(&file.name).as_str()))
    };
    let mut wrong = Vec::new();
    for format in FORMATS.iter().filter(fits) {
        match calib_formats::import(format, files) {
            Ok(imported) => return Ok((format, imported)),
            Err(error) => wrong.push(format!("{} ({error})", format.name)),
        }
    }
    if wrong.is_empty() {
        let known: Vec<&str> =
            FORMATS.iter().filter(|format| format.can_import()).map(|format| format.name).collect();
        return Err(format!("Supported formats: {}.", known.join(", ")));
    }
    Err(format!("Formats tried: {}.", wrong.join("; ")))
}

/// Returns the lens of a camera, scaled to images of another width and height. Returns an error message if the aspect
/// ratios differ.
pub(crate) fn scaled(camera: &SiteCamera, size: [u32; 2]) -> Result<LensEntry, String> {
    let mut lens = camera.lens_of_image().map(Cow::into_owned).unwrap_or_default();
    let ratio = [0, 1].map(|axis| f64::from(size[axis]) / f64::from(camera.size_px[axis].max(1)));
    if (ratio[0] / ratio[1] - 1.0).abs() > MAX_ASPECT_DIFFERENCE {
        let [w, h] = camera.size_px;
        return Err(format!(
            "Camera {:?}: the lens was calibrated for {w} \u{d7} {h} px, but this image ({} \u{d7} {} px) \
             has a different aspect ratio. Import the lens for the recording mode of this image.",
            camera.id, size[0], size[1]
        ));
    }
    scale_lens(&mut lens, ratio[0]);
    Ok(lens)
}

/// Multiplies all pixel values of a lens by a factor, for images that are larger by this factor.
pub(crate) fn scale_lens(lens: &mut LensEntry, by: f64) {
    if let Some(focal) = &mut lens.focal_px {
        (focal.value, focal.sigma) = (by * focal.value, focal.sigma.map(|sigma| by * sigma));
    }
    lens.principal_point_px = lens.principal_point_px.map(|entry| entry.scaled(by));
    lens.image_circle_px = lens.image_circle_px.map(|circle| <[f64; 3]>::from(circle).map(|c| by * c).into());
    if let Some(focal) = lens.distortion.as_mut().and_then(|distortion| distortion.focal_px.as_mut()) {
        *focal *= by;
    }
}
