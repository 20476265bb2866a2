//! `calib compare`: detects changed cameras from newer images, and recovers their calibrations.
//!
//! A recovery transfers the annotations of the old image to the newer one and solves the camera again. A
//! rendered comparison shows which edges of the old image were found again.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use calib_core::{Camera, Pixel};
use calib_image::{CameraChange, Comparison, SizeMismatchError, annotation_edges, recover};
use calib_report::{decimals, shortened_list};
use calib_site::{NewImage, Site, SiteCamera};
use image::{Rgb, RgbImage};
use jiff::Timestamp;

use crate::args::SiteArgs;
use crate::files::ThreadsArgs;
use crate::files::print_message;
use crate::progress::Pulse;
use crate::site_file::{SiteFile, calibrated_camera, path_relative_to_file};
use crate::solve::Format;
use crate::stop::CommandError;
use crate::stop::escape_control_characters;
use crate::{files, picture, site_file};

/// Arguments of `calib compare`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    site: SiteArgs,
    /// Compare this camera; by default the start of the image's name is the id of the camera
    #[arg(long, value_name = "ID")]
    camera: Option<String>,
    /// Newer images (PNG, JPEG) or folders of images, ordered by the time in their names (2026-05-01T0830,
    /// UTC) or in their EXIF data
    #[arg(long = "still", required = true, num_args = 1.., value_name = "FILE")]
    images: Vec<PathBuf>,
    /// Output format of the report
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
    /// Write the newest image of each camera, with matched and missing edges drawn on it, to this folder
    #[arg(long, value_name = "DIR")]
    render: Option<PathBuf>,
    /// Transfer the annotations to the newer images, and solve the cameras that moved
    #[arg(long, requires = "output", conflicts_with = "at")]
    recover: bool,
    /// Write the site with the recovered cameras to this file
    #[arg(short, long, value_name = "FILE", requires = "recover")]
    output: Option<String>,
    /// Start of validity of the new calibrations (RFC 3339) [default: time of the first image after the
    /// change]
    #[arg(long, value_name = "TIME", requires = "recover")]
    since: Option<Timestamp>,
    /// Overwrite the output file and rendered images
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    threads: ThreadsArgs,
}

/// Comparison of one newer image with the calibrated image of its camera.
pub(crate) struct ImageComparison {
    pub(crate) path: PathBuf,
    pub(crate) time: Option<Timestamp>,
    pub(crate) comparison: Comparison,
}

/// Comparisons of one camera with its newer images, oldest first.
pub(crate) struct CameraComparison {
    /// Index of the camera's entry in the site.
    pub(crate) index: usize,
    pub(crate) id: String,
    pub(crate) camera: Camera,
    pub(crate) images: Vec<ImageComparison>,
}

impl CameraComparison {
    /// Returns the newest comparison, which determines the status of the camera.
    pub(crate) fn newest(&self) -> Option<&ImageComparison> {
        self.images.last()
    }

    /// Returns the first image of the current state: it has the newest image's status, and no later image
    /// shows the camera unchanged.
    pub(crate) fn first_changed(&self) -> Option<&ImageComparison> {
        let last = self.newest()?.comparison.change;
        let unchanged =
            self.images.iter().rposition(|seen| seen.comparison.change == CameraChange::Unchanged);
        let after = &self.images[unchanged.map_or(0, |index| index + 1)..];
        after.iter().find(|seen| seen.comparison.change.name() == last.name())
    }
}

/// Compares the cameras with the newer images, reports the changes, and recovers cameras if requested.
pub(crate) fn run(args: &Args) -> Result<(), CommandError> {
    if let Some(output) = &args.output {
        files::check_free(output, args.force)?;
    }
    let file = args.site.read()?;
    let mut compared = Vec::new();
    for (index, images) in images_by_camera(args, &file)? {
        let pulse = Pulse::new("comparing");
        compared.push(compare(&file, index, images, args.threads)?);
        drop(pulse);
    }
    report(args, &compared)?;
    if let Some(folder) = &args.render {
        draw(&compared, folder, args.force)?;
    }
    if let Some(output) = args.output.as_deref().filter(|_| args.recover) {
        write_recovered(&file, &compared, args.since, output, args.force)?;
    }
    let changed: Vec<&str> = compared.iter().filter(|of| has_changed(of)).map(|of| of.id.as_str()).collect();
    if changed.is_empty() {
        return Ok(());
    }
    let changed = shortened_list(changed);
    Err(CommandError::Unsolved(format!("cameras that changed, or could not be compared: {changed}")))
}

fn has_changed(of: &CameraComparison) -> bool {
    of.newest().is_some_and(|seen| seen.comparison.change != CameraChange::Unchanged)
}

/// Image with its capture time, if known.
type DatedImage = (Option<Timestamp>, PathBuf);

/// Groups the newer images by the index of the camera's entry, each group in order of time.
fn images_by_camera(args: &Args, file: &SiteFile) -> Result<Vec<(usize, Vec<DatedImage>)>, CommandError> {
    let mut of: Vec<(usize, Vec<DatedImage>)> = Vec::new();
    for path in site_file::list_images(&args.images)? {
        let id = match &args.camera {
            Some(id) => id.clone(),
            None => camera_id_of_image(file, &path)?,
        };
        let time = site_file::capture_time(&path)?;
        let index = entry_index(file, &id, time)?;
        match of.iter_mut().find(|(other, _)| *other == index) {
            Some((_, images)) => images.push((time, path)),
            None => of.push((index, vec![(time, path)])),
        }
    }
    of.iter_mut().for_each(|(_, images)| images.sort());
    of.sort_by_key(|(index, _)| *index);
    Ok(of)
}

/// Returns the id of the camera at the start of the image's name.
fn camera_id_of_image(file: &SiteFile, path: &Path) -> Result<String, CommandError> {
    let found = file.site.camera_id_from_name(&site_file::stem(path));
    found.map(str::to_owned).ok_or_else(|| {
        let what = format!(
            "{}: the camera of this image is unknown; add --camera ID, or start the file name with a camera id: {}",
            path.display(),
            shortened_list(file.site.cameras.iter().map(|camera| camera.id.as_str()))
        );
        CommandError::Usage(what)
    })
}

/// Returns the index of the camera's entry that is valid at the image's time.
fn entry_index(file: &SiteFile, id: &str, time: Option<Timestamp>) -> Result<usize, CommandError> {
    file.has_camera(id)?;
    let time = time.map(|time| time.to_string());
    file.site.entry_index_at(id, time.as_deref()).ok_or_else(|| {
        CommandError::Usage(match &time {
            Some(time) => {
                format!("camera \"{id}\": no calibration is valid at {time}; choose one with --at TIME")
            }
            None => format!(
                "camera \"{id}\": the time of the image is unknown; choose a calibration with --at TIME"
            ),
        })
    })
}

fn compare(
    file: &SiteFile,
    index: usize,
    images: Vec<DatedImage>,
    threads: ThreadsArgs,
) -> Result<CameraComparison, CommandError> {
    let entry = &file.site.cameras[index];
    let camera = calibrated_camera(entry)?;
    let old = file.camera_image(entry)?;
    let edges = annotation_edges(entry);
    let compare_image = |(time, path): DatedImage| {
        let new = read_newer_image(&path)?;
        let comparison = Comparison::new(&camera, &edges, &old, &new)
            .map_err(|error| size_mismatch(&path, entry, error))?;
        Ok::<_, CommandError>(ImageComparison { time, path, comparison })
    };
    let images = threads.run(images, compare_image, |_| ())?;
    Ok(CameraComparison { index, id: entry.id.clone(), camera, images })
}

/// Writes the newest image of every camera with its matched and missing edges into a folder.
fn draw(compared: &[CameraComparison], folder: &Path, force: bool) -> Result<(), CommandError> {
    files::create_folder(folder)?;
    for (of, seen) in compared.iter().filter_map(|of| Some((of, of.newest()?))) {
        let image = draw_edges(of, seen, read_newer_image(&seen.path)?);
        let name = folder.join(format!("{}.png", of.id)).to_string_lossy().into_owned();
        files::write(&name, &picture::encode(&image, &name)?, force)?;
    }
    Ok(())
}

/// Reads a newer image of a camera.
pub(crate) fn read_newer_image(path: &Path) -> Result<RgbImage, CommandError> {
    let bytes = site_file::read_image_bytes(path)?;
    calib_input::decode(&bytes).map_err(|error| CommandError::invalid(path.display(), error))
}

fn size_mismatch(path: &Path, entry: &SiteCamera, error: SizeMismatchError) -> CommandError {
    CommandError::invalid(path.display(), format!("camera \"{}\": {error}", entry.id))
}

fn report(args: &Args, compared: &[CameraComparison]) -> Result<(), CommandError> {
    // With the site on stdout, a text report goes to stderr, and a JSON report is omitted.
    let to_stdout = args.output.as_deref() == Some("-");
    match args.format {
        Format::Text if to_stdout => print_message(text(compared)),
        Format::Text => files::print(&escape_control_characters(&text(compared)))?,
        Format::Json if to_stdout => {}
        Format::Json => files::print(&format!("{:#}\n", json(args, compared)))?,
    }
    Ok(())
}

/// Returns one object for a single camera chosen with `--camera`, otherwise an object with a list of cameras.
fn json(args: &Args, compared: &[CameraComparison]) -> serde_json::Value {
    let of = |of: &CameraComparison| {
        let images: Vec<_> = of.images.iter().map(|seen| image_json(of, seen)).collect();
        let mut value = images.last().cloned().unwrap_or_default();
        value["since"] = of.first_changed().and_then(|seen| seen.time).map(|time| time.to_string()).into();
        if images.len() > 1 {
            value["stills"] = images.into();
        }
        value
    };
    match compared {
        [only] if args.camera.is_some() => of(only),
        _ => serde_json::json!({ "cameras": compared.iter().map(of).collect::<Vec<_>>() }),
    }
}

fn image_json(
    of: &CameraComparison,
    ImageComparison { path, time, comparison }: &ImageComparison,
) -> serde_json::Value {
    let became = comparison.change;
    let known = |value: f64| Some(value).filter(|value| became.is_aligned() && value.is_finite());
    let (turned, turned_sigma) = comparison.angle(&of.camera);
    let (zoom, zoom_sigma) = comparison.zoom();
    let movement = comparison.movement(&of.camera);
    let degrees = |index: usize| known(movement[index].0.to_degrees());
    let sigma = |index: usize| known(movement[index].1.to_degrees());
    serde_json::json!({
        "camera": of.id,
        "still": path.to_string_lossy(),
        "time": time.map(|time| time.to_string()),
        "verdict": became.name(),
        "shifted": became == CameraChange::Shifted,
        "turned_deg": known(turned.to_degrees()),
        "turned_sigma_deg": known(turned_sigma.to_degrees()),
        "zoom": known(zoom),
        "zoom_sigma": known(zoom_sigma),
        "yaw_deg": degrees(0),
        "pitch_deg": degrees(1),
        "roll_deg": degrees(2),
        "sigma": { "yaw_deg": sigma(0), "pitch_deg": sigma(1), "roll_deg": sigma(2) },
        "window_px": comparison.window.map(|window| window.px()),
        "sigmas_clear": known(comparison.z_score),
        "moved_px": known(comparison.shift),
        "places": comparison.visible_samples,
        "found": comparison.found_fraction,
        "found_by_chance": comparison.chance_fraction,
        "reason": became.to_string(),
    })
}

fn text(compared: &[CameraComparison]) -> String {
    let mut out = String::new();
    let names = compared.iter().map(|of| of.id.chars().count());
    let width = names.max().unwrap_or(0).max(6);
    let _ = writeln!(
        out,
        "{:width$}  {:11} {:>23} {:>22} {:>8} {:>8} {:>8} {:>6}",
        "camera", "status", "rotation deg", "zoom", "yaw", "pitch", "roll", "found"
    );
    for of in compared {
        for seen in &of.images {
            let _ = writeln!(out, "{:width$}  {}", of.id, row(of, &seen.comparison));
            let time = seen.time.map(|time| format!(" ({time})")).unwrap_or_default();
            let part = seen.comparison.window.map(|window| {
                let [left, top, width, height] = window.px();
                format!(" ({left:.0}, {top:.0}, {width:.0} x {height:.0} px)")
            });
            let (path, change, part) =
                (seen.path.display(), seen.comparison.change, part.unwrap_or_default());
            let _ = writeln!(out, "{:width$}    {path}{time}: {change}{part}", "");
        }
    }
    out
}

/// Formats a value and its standard deviation with equal decimals, so that the standard deviation has two
/// significant digits.
fn with_sigma(value: f64, sigma: f64) -> String {
    /// Number of decimals of a value without uncertainty.
    const DEFAULT_DECIMALS: usize = 7;
    let decimals = if sigma > 0.0 { decimals(sigma) } else { DEFAULT_DECIMALS };
    format!("{value:.decimals$} \u{b1} {sigma:.decimals$}")
}

fn row(of: &CameraComparison, comparison: &Comparison) -> String {
    let became = comparison.change;
    if !became.is_aligned() {
        return format!(
            "{:11} {:>23} {:>22} {:>8} {:>8} {:>8} {:>5.0}%",
            became.name(),
            "-",
            "-",
            "-",
            "-",
            "-",
            100.0 * comparison.found_fraction
        );
    }
    let (turned, turned_sigma) = comparison.angle(&of.camera);
    let (zoom, zoom_sigma) = comparison.zoom();
    let movement = comparison.movement(&of.camera);
    let [yaw, pitch, roll] = [0, 1, 2].map(|index| movement[index].0.to_degrees());
    format!(
        "{:11} {:>23} {:>22} {yaw:>+8.3} {pitch:>+8.3} {roll:>+8.3} {:>5.0}%",
        became.name(),
        with_sigma(turned.to_degrees(), turned_sigma.to_degrees()),
        with_sigma(zoom, zoom_sigma),
        100.0 * comparison.found_fraction,
    )
}

/// Colour of an edge that was found at its predicted position.
const FOUND_COLOUR: Rgb<u8> = Rgb([40, 220, 90]);
/// Colour of an edge that was not found: it is hidden, or the object moved.
const MISSING_COLOUR: Rgb<u8> = Rgb([255, 90, 40]);

/// Draws a dot on the newer image at the predicted position of every compared edge sample. Its colour shows
/// whether the edge was found.
pub(crate) fn draw_edges(of: &CameraComparison, seen: &ImageComparison, mut image: RgbImage) -> RgbImage {
    let by = seen.comparison.pixel_map(&of.camera);
    for (place, found) in &seen.comparison.samples {
        if let (Some(found), Some(at)) = (found, by(*place)) {
            draw_dot(&mut image, at, if *found { FOUND_COLOUR } else { MISSING_COLOUR });
        }
    }
    image
}

/// Draws a square of 3 x 3 pixels.
fn draw_dot(image: &mut RgbImage, at: Pixel, colour: Rgb<u8>) {
    /// Distance of the square's border from its centre, in pixels.
    const HALF: i64 = 1;
    for (x, y) in (-HALF..=HALF).flat_map(|x| (-HALF..=HALF).map(move |y| (x, y))) {
        let (x, y) = (at.u as i64 + x, at.v as i64 + y);
        let pixel = u32::try_from(x).ok().zip(u32::try_from(y).ok());
        if let Some(pixel) = pixel.and_then(|(x, y)| image.get_pixel_mut_checked(x, y)) {
            *pixel = colour;
        }
    }
}

/// Writes the site with all changed cameras recovered. A camera that cannot be recovered stays unchanged and is
/// reported. If no camera is recovered, no file is written.
pub(crate) fn write_recovered(
    file: &SiteFile,
    compared: &[CameraComparison],
    since: Option<Timestamp>,
    output: &str,
    force: bool,
) -> Result<(), CommandError> {
    // Image paths are relative to the output file.
    let mut site = file.with_paths_relative_to(&file.site, output);
    let mut count = 0;
    let has_changed = |of: &&CameraComparison| {
        of.newest().is_some_and(|seen| seen.comparison.change != CameraChange::Unchanged)
    };
    for of in compared.iter().filter(has_changed) {
        match recover_camera(file, &site, of, since, output)? {
            Ok(with) => {
                site = with;
                count += 1;
            }
            Err(why) => print_message(format_args!("calib: camera \"{}\" was not recovered: {why}", of.id)),
        }
    }
    if count == 0 {
        print_message(format_args!("calib: no camera was recovered; {output} was not written"));
        return Ok(());
    }
    files::write(output, site.to_json().as_bytes(), force)
}

/// Returns the site with one camera recovered, or the reason why it cannot be. Fails if the images cannot be
/// read.
fn recover_camera(
    file: &SiteFile,
    site: &Site,
    of: &CameraComparison,
    since: Option<Timestamp>,
    output: &str,
) -> Result<Result<Site, String>, CommandError> {
    let Some(seen) = of.newest() else { return Ok(Err("it has no newer image".into())) };
    let Some(since) = since.or_else(|| of.first_changed().and_then(|seen| seen.time)) else {
        return Ok(Err("its newer image has no capture time; give --since TIME".into()));
    };
    let entry = &file.site.cameras[of.index];
    let (old, new) = (file.camera_image(entry)?, read_newer_image(&seen.path)?);
    let newer = NewImage { image: path_relative_to_file(&seen.path, output), since: since.to_string() };
    let pulse = Pulse::new("solving");
    let found = recover(site, of.index, &seen.comparison, [&old, &new], &newer);
    drop(pulse);
    Ok(found.map_err(|refusal| refusal.to_string()).map(|found| {
        if !found.left_out.is_empty() {
            let names = shortened_list(found.left_out.iter().map(String::as_str));
            print_message(format_args!(
                "calib: camera \"{}\": annotations left out because they were not found in the newer image: {names}",
                of.id
            ));
        }
        found.site
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn standard_deviation_has_two_digits_and_value_equal_decimals() {
        assert_eq!(with_sigma(0.999_991_3, 0.000_003_24), "0.9999913 \u{b1} 0.0000032");
        assert_eq!(with_sigma(2.014_9, 0.031), "2.015 \u{b1} 0.031");
        assert_eq!(with_sigma(12.34, 25.0), "12 \u{b1} 25");
        assert_eq!(with_sigma(1.0, 0.0), "1.0000000 \u{b1} 0.0000000");
        assert_eq!(with_sigma(1.0, f64::NAN), "1.0000000 \u{b1} NaN");
    }
}
