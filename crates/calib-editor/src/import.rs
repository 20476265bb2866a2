//! Files of other programs: what format they are, and their lenses brought to the size of our images.

use calib_core::Pixel;

use calib_formats::{FORMATS, File, Format, Imported};
use calib_site::{LensEntry, Plan, SiteCamera};

/// Shapes of images that differ by less than this are the same.
const SHAPE: f64 = 2e-3;

/// World files, among the formats that are read.
fn world_format() -> Option<&'static Format> {
    FORMATS.iter().find(|format| format.name == "worldfile")
}

/// Endings of world files.
#[must_use]
pub fn world_endings() -> &'static [&'static str] {
    world_format().map_or(&[], |format| format.extensions)
}

/// The plan without its picture, as a world file has it.
///
/// # Errors
/// When it cannot be read, or tells of no plan.
pub fn plan_told_by(file: File) -> Result<Plan, String> {
    let format = world_format().ok_or_else(|| format!("{}: no world files are read", file.name))?;
    let read = calib_formats::import(format, &[file]).map_err(|error| error.to_string())?;
    read.site.plan.ok_or_else(|| "A world file without a plan.".into())
}

/// The first format that reads the files, by their extensions.
///
/// # Errors
/// When none does; what every one that was tried says.
pub fn recognise(files: &[File]) -> Result<(&'static Format, Imported), String> {
    let extension = |file: &File| {
        file.name.rsplit_once('.').map_or_else(String::new, |(_, extension)| extension.to_lowercase())
    };
    let fits = |format: &&Format| {
        format.can_import() && files.iter().any(|file| format.extensions.contains(&extension(file).as_str()))
    };
    let mut wrong = Vec::new();
    for format in FORMATS.iter().filter(fits) {
        match calib_formats::import(format, files) {
            Ok(imported) => return Ok((format, imported)),
            Err(error) => wrong.push(format!("as {}: {error}", format.name)),
        }
    }
    if wrong.is_empty() {
        let known: Vec<&str> =
            FORMATS.iter().filter(|format| format.can_import()).map(|format| format.name).collect();
        return Err(format!("No format with this ending is known. Known are {}.", known.join(", ")));
    }
    Err(format!("The files cannot be read. {}", wrong.join("; ")))
}

/// The lens of a camera for images of another size but the same shape.
pub(crate) fn scaled(camera: &SiteCamera, size: [u32; 2]) -> Result<LensEntry, String> {
    let mut lens = camera.lens.clone().unwrap_or_default();
    let ratio = [0, 1].map(|axis| f64::from(size[axis]) / f64::from(camera.size_px[axis].max(1)));
    if (ratio[0] / ratio[1] - 1.0).abs() > SHAPE {
        let [w, h] = camera.size_px;
        return Err(format!(
            "Camera {:?}: its lens was calibrated on images of {w} \u{d7} {h} px, which are not of the shape of this still, {} \u{d7} {} px. Import the lens of the mode in which the still was taken.",
            camera.id, size[0], size[1]
        ));
    }
    scale_lens(&mut lens, ratio[0]);
    Ok(lens)
}

/// Brings a lens to images that are so many times as large.
pub(crate) fn scale_lens(lens: &mut LensEntry, by: f64) {
    if let Some(focal) = &mut lens.focal_px {
        (focal.value, focal.sigma) = (by * focal.value, focal.sigma.map(|sigma| by * sigma));
    }
    lens.principal_point_px = lens.principal_point_px.map(|at| Pixel::new(by * at.u, by * at.v));
    lens.image_circle_px = lens.image_circle_px.map(|circle| <[f64; 3]>::from(circle).map(|c| by * c).into());
    if let Some(focal) = lens.distortion.as_mut().and_then(|distortion| distortion.focal_px.as_mut()) {
        *focal *= by;
    }
}
