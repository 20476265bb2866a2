//! `calib propose`: calibrates images automatically from their edges.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use calib_core::single::Known;
use calib_core::{Annotation, ImageCircle};
use calib_image::{
    AutomaticCalibration, Bars, Confidence, EdgeImage, Group, ImageEdges, SitePlacement, image_circle,
};
use calib_report::{is_lens_estimated, overlay, shortened_list, straight_down_text};
use calib_site::{DataSheet, LensEntry, Options, PixelAspectEntry, Site, SiteCamera};
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressStyle};

use crate::files::ThreadsArgs;
use crate::files::{self, print_message};
use crate::painting::draw_on;
use crate::picture;
use crate::placing;
use crate::plan::{self, DrawingArgs};
use crate::site_file;
use crate::site_file::path_relative_to_file;
use crate::solve::Format;
use crate::stop::CommandError;
use crate::stop::escape_control_characters;

/// Lowest confidence of accepted automatic calibrations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Accept {
    /// Only results that can be used without review
    Sure,
    /// Also results that need review
    Check,
    /// Every result, even a rejected one
    All,
}

impl Accept {
    fn accepts(self, proposal: &AutomaticCalibration) -> bool {
        match self {
            Self::Sure => proposal.confidence == Confidence::Sure,
            Self::Check => proposal.confidence != Confidence::None,
            Self::All => proposal.solution.is_some(),
        }
    }
}

/// Arguments of `calib propose`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Images (PNG, JPEG), or folders of images
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
    /// Write the site to this file (- is stdout)
    #[arg(short, long, value_name = "FILE")]
    output: Option<String>,
    /// Automatic calibrations to accept into the site
    #[arg(long, value_enum, default_value = "check")]
    accept: Accept,
    /// Write every image, with its automatic calibration drawn on it, to this folder
    #[arg(long, value_name = "DIR")]
    render: Option<PathBuf>,
    /// Floor plan on which to place the cameras: PDF, DXF, SVG, or an image with --metres-per-px
    #[arg(long, value_name = "PLAN", conflicts_with = "no_places")]
    plan: Option<String>,
    #[command(flatten)]
    drawing: DrawingArgs,
    /// Do not place the cameras relative to each other
    #[arg(long)]
    no_places: bool,
    /// Data sheet of the cameras, such as "2.8 mm 1/2.7" or "horizontal 98°"
    #[arg(long, value_name = "TEXT")]
    data_sheet: Option<String>,
    /// Pixel aspect of the images: width over height of a pixel
    #[arg(long, value_name = "RATIO")]
    pixel_aspect: Option<f64>,
    /// Roll of the cameras, in degrees: 180 if they hang upside down, 90 or -90 if they hang on their side
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    roll: Option<f64>,
    /// Output format of the report
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
    /// Overwrite the output file and rendered images
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    threads: ThreadsArgs,
}

/// Standard deviation of a roll that is stated for all images, in degrees.
const ROLL_SIGMA_DEG: f64 = 5.0;

impl Args {
    /// Returns the known values of the lens for images of this size, in pixels.
    fn known_lens(&self, size: [u32; 2]) -> Result<LensEntry, CommandError> {
        let mut lens = LensEntry {
            pixel_aspect: self.pixel_aspect.map(PixelAspectEntry::Known),
            roll_deg: self.roll.map(|roll| Known::prior(roll, ROLL_SIGMA_DEG)),
            ..LensEntry::default()
        };
        let sheet = self.data_sheet.as_deref().map(|text| DataSheet::parse(text, size)).transpose();
        lens.set_data_sheet(
            sheet.map_err(|error| CommandError::Usage(format!("--data-sheet: {error}")))?.unwrap_or_default(),
        );
        let camera = SiteCamera { lens: Some(lens.clone()), ..SiteCamera::new("camera", size) };
        let site = Site { cameras: vec![camera], ..Site::new() };
        site.check()
            .map_err(|error| CommandError::Usage(format!("--data-sheet, --pixel-aspect, --roll: {error}")))?;
        Ok(lens)
    }
}

/// Image with its automatic calibration.
struct ImageCalibration {
    path: PathBuf,
    size: [u32; 2],
    /// Known values of the lens, from the command line.
    known: LensEntry,
    /// Image circle of a fisheye lens, in raw pixels.
    image_circle: Option<ImageCircle>,
    /// Black bars at the sides of the image.
    bars: Bars,
    calibration: AutomaticCalibration,
    is_accepted: bool,
}

/// Calibrates the images automatically, writes the site, and prints the report.
pub(crate) fn run(args: &Args) -> Result<(), CommandError> {
    if let Some(output) = &args.output {
        files::check_free(output, args.force)?;
    }
    // Wrong values are reported before the first image is read.
    args.known_lens([1920, 1080])?;
    if let Some(option) = args.drawing.given().filter(|_| args.plan.is_none()) {
        return Err(CommandError::Usage(format!("{option} requires --plan; add --plan, or remove {option}")));
    }
    let output = args.output.as_deref().unwrap_or("-");
    let plan = args.plan.as_ref().map(|name| plan::read_entry(name, &args.drawing, output)).transpose()?;
    let (plan_entry, plan_image) = plan.unzip();
    let mut images = site_file::list_images(&args.images)?;
    if let Some(plan) = args.plan.as_ref().and_then(|plan| std::fs::canonicalize(plan).ok()) {
        // The plan may be in the folder of the images.
        images.retain(|image| std::fs::canonicalize(image).ok().as_ref() != Some(&plan));
    }
    let ids = ids(&images);
    let mut progress = BatchProgress::new(images.len());
    let results =
        args.threads.run(images, |path| calibrate_image(path, args), |result| progress.done(&result.path))?;
    drop(progress);
    let cameras = results.iter().zip(ids).map(|(result, id)| camera(result, id, output)).collect();
    let site = solved(Site { cameras, plan: plan_entry, ..Site::new() }, &results);
    let placement = if args.no_places || results.len() < 2 && plan_image.is_none() {
        None
    } else {
        let read = |index: usize| site_file::read_image(&results[index].path);
        Some(placing::place(&site, args.threads, plan_image.as_ref(), read)?)
    };
    let site = placement.iter().fold(site, |site, placement| solved(placement.write_into(site), &results));
    if let Some(output) = &args.output {
        files::write(output, site.to_json().as_bytes(), args.force)?;
        warn_about_outside_images(&site, output);
    }
    if let Some(folder) = &args.render {
        draw(&site, &results, folder, args.force)?;
    }
    report(args, &site, &results, placement.as_ref())?;
    check_all_accepted(&site, &results)
}

/// Warns about images that other commands read only with `--allow-outside`.
fn warn_about_outside_images(site: &Site, output: &str) {
    let is_outside = |image: &str| Path::new(image).is_absolute() || Path::new(image).starts_with("..");
    let outside =
        site.cameras.iter().filter(|camera| camera.image.as_deref().is_some_and(is_outside)).count();
    if outside > 0 && output != "-" {
        print_message(format_args!(
            "calib: images outside the folder of {output}: {outside} of {}. Write the site to the folder of \
             the images, or add --allow-outside to other commands",
            site.cameras.len()
        ));
    }
}

/// Calibrates one image automatically.
fn calibrate_image(path: PathBuf, args: &Args) -> Result<ImageCalibration, CommandError> {
    let image = site_file::read_image(&path)?;
    let size = [image.width(), image.height()];
    let image_circle = image_circle(&image);
    let ImageEdges { segments, bars } = ImageEdges::measure(&image);
    let known = args.known_lens(size)?;
    let edges = EdgeImage::new(segments, size).with_bars(bars);
    let proposal = AutomaticCalibration::new(&EdgeImage { image_circle, known: known.clone(), ..edges });
    let is_accepted = args.accept.accepts(&proposal);
    Ok(ImageCalibration { path, size, known, image_circle, bars, calibration: proposal, is_accepted })
}

/// Returns a unique id for every image: its file name without the extension, with a number if it is already used.
fn ids(images: &[PathBuf]) -> Vec<String> {
    let mut used = BTreeSet::new();
    let mut id = |path: &PathBuf| {
        let stem =
            path.file_stem().map_or_else(|| "still".into(), |stem| stem.to_string_lossy().into_owned());
        let numbered = (2..).map(|number| format!("{stem}-{number}"));
        let mut names = std::iter::once(stem.clone()).chain(numbered);
        let name = names.find(|name| !used.contains(name)).unwrap_or(stem);
        used.insert(name.clone());
        name
    };
    images.iter().map(&mut id).collect()
}

/// Returns the camera of an image, with the automatic calibration if it was accepted.
fn camera(result: &ImageCalibration, id: String, output: &str) -> SiteCamera {
    let camera = result.calibration.camera.clone().filter(|_| result.is_accepted);
    let known = Some(result.known.clone()).filter(|lens| *lens != LensEntry::default());
    let mut camera =
        camera.unwrap_or_else(|| SiteCamera { lens: known, ..SiteCamera::new(String::new(), result.size) });
    if result.is_accepted {
        // The straight edges determine the distortion if it is later estimated; they have no effect while the
        // lens is fixed.
        camera
            .annotations
            .extend(result.calibration.curved_edges.iter().cloned().map(Annotation::from_points));
    }
    if result.known.roll_deg.is_some() {
        camera.lens.get_or_insert_default().roll_deg = result.known.roll_deg;
    }
    if result.image_circle.is_some() {
        let lens = camera.lens.get_or_insert_default();
        // The entry needs no principal point: without one, the centre of the image circle is used.
        (lens.image_circle_px, lens.principal_point_px) = (result.image_circle, None);
    }
    SiteCamera { id, image: Some(path_relative_to_file(&result.path, output)), ..camera }
}

/// Solves the cameras with an accepted automatic calibration.
fn solved(site: Site, results: &[ImageCalibration]) -> Site {
    let cameras = site.cameras.iter().zip(results).filter(|(_, result)| result.is_accepted);
    let cameras: Vec<String> = cameras.map(|(camera, _)| camera.id.clone()).collect();
    if cameras.is_empty() {
        return site;
    }
    site.calibrate(&Options { cameras: Some(cameras), ..Options::default() }).write_into(&site)
}

/// Draws every image with its automatic calibration, whether accepted or not.
fn draw(site: &Site, results: &[ImageCalibration], folder: &Path, force: bool) -> Result<(), CommandError> {
    files::create_folder(folder)?;
    for (camera, result) in site.cameras.iter().zip(results) {
        let ImageCalibration { path, calibration: proposal, .. } = result;
        let shown = SiteCamera {
            annotations: proposal.groups.iter().map(|group| group.annotation.clone()).collect(),
            solution: camera.solution.clone().or_else(|| proposal.solution.clone()),
            ..camera.clone()
        };
        let alone = Site { cameras: vec![shown], ..Site::new() };
        let shown = &alone.cameras[0];
        let picture =
            draw_on(&overlay(&alone, shown, is_lens_estimated(shown)), &site_file::read_image(path)?)?;
        let name = folder.join(format!("{}.png", camera.id)).to_string_lossy().into_owned();
        files::write(&name, &picture::encode(&picture, &name)?, force)?;
    }
    Ok(())
}

/// Prints the report. If the site goes to stdout, a text report goes to stderr, and a JSON report is omitted.
fn report(
    args: &Args,
    site: &Site,
    results: &[ImageCalibration],
    placement: Option<&SitePlacement>,
) -> Result<(), CommandError> {
    let text = || {
        text(site, results) + &placement.map_or_else(String::new, |placement| placing::text(placement, site))
    };
    let to_stdout = args.output.as_deref() == Some("-");
    match args.format {
        Format::Text if to_stdout => print_message(text()),
        Format::Text => files::print(&escape_control_characters(&text()))?,
        Format::Json if to_stdout => {}
        Format::Json => files::print(&json(site, results, placement)?)?,
    }
    Ok(())
}

/// Returns the reasons why an automatic calibration is not sure; empty if it is.
fn reason(proposal: &AutomaticCalibration) -> String {
    proposal.reasons.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

fn text(site: &Site, results: &[ImageCalibration]) -> String {
    let mut out = String::new();
    let width = site.cameras.iter().map(|camera| camera.id.chars().count()).max().unwrap_or(0).max(6);
    let _ = writeln!(
        out,
        "{:width$}  {:10} {:>7} {:>9} {:>10} {:>14} {:>8}",
        "camera", "confidence", "lines", "roll deg", "pitch deg", "focal px", "sigma"
    );
    for (camera, ImageCalibration { calibration: proposal, bars, .. }) in site.cameras.iter().zip(results) {
        let lines: usize = proposal.groups.iter().map(|group| group.probabilities.len()).sum();
        let _ = write!(out, "{:width$}  {:10} {lines:>7}", camera.id, proposal.confidence.name());
        if let (Some(solution), Some(sigma)) = (&proposal.solution, proposal.focal_sigma_rel) {
            let angle = |angle: Option<f64>| angle.map_or_else(|| "-".into(), |angle| format!("{angle:.2}"));
            // The roll of a camera that looks straight down is not determined separately from its yaw.
            let roll = solution.roll_deg.filter(|_| straight_down_text(solution).is_none());
            let (roll, pitch) = (angle(roll), angle(solution.pitch_deg));
            let _ =
                write!(out, " {roll:>9} {pitch:>10} {:>14.1} {:>6.1} %", solution.focal_px, 100.0 * sigma);
        }
        out.push('\n');
        if !bars.is_empty() {
            let _ = writeln!(out, "{:width$}    note: the image has black bars ({bars})", "");
        }
        for reason in &proposal.reasons {
            let _ = writeln!(out, "{:width$}    {reason}", "");
        }
    }
    out
}

fn json(
    site: &Site,
    results: &[ImageCalibration],
    placement: Option<&SitePlacement>,
) -> Result<String, CommandError> {
    let group = |(index, group): (usize, &Group)| {
        serde_json::json!({
            "annotation": index,
            "kind": group.annotation.kind.row().name,
            "probability": group.probability(),
            "segments": group.probabilities,
            "lies": group.classes,
        })
    };
    let of = |(camera, ImageCalibration { calibration: proposal, is_accepted, bars, .. }): (
        &SiteCamera,
        &ImageCalibration,
    )| {
        let groups: Vec<_> = proposal.groups.iter().enumerate().map(group).collect();
        serde_json::json!({
            "id": camera.id,
            "verdict": proposal.confidence.name(),
            "reason": reason(proposal),
            "accepted": is_accepted,
            "focal_px": proposal.solution.as_ref().map(|solution| solution.focal_px),
            "focal_sigma_rel": proposal.focal_sigma_rel,
            "groups": groups,
            "bars_px": (!bars.is_empty()).then_some(bars),
            "alternative": proposal.alternative.as_ref().map(|other| serde_json::json!({
                "focal_px": other.orientation.focal,
                "pitch_deg": other.orientation.pitch.to_degrees(),
                "roll_deg": other.orientation.roll.to_degrees(),
                "annotations": other.groups.iter().map(|group| &group.annotation).collect::<Vec<_>>(),
            })),
        })
    };
    let mut cameras: Vec<_> = site.cameras.iter().zip(results).map(of).collect();
    let mut report = serde_json::json!({});
    if let Some(placement) = placement {
        for (index, camera) in cameras.iter_mut().enumerate() {
            camera["place"] = placing::camera_json(placement, index);
        }
        report["site"] = placing::json(placement, site);
    }
    report["cameras"] = cameras.into();
    let mut text = serde_json::to_string_pretty(&report)?;
    text.push('\n');
    Ok(text)
}

/// Fails with exit code 4 if an image has no accepted calibration, and names all such images.
fn check_all_accepted(site: &Site, results: &[ImageCalibration]) -> Result<(), CommandError> {
    let unaccepted = site.cameras.iter().zip(results).filter(|(_, result)| !result.is_accepted);
    let unaccepted: Vec<&str> = unaccepted.map(|(camera, _)| camera.id.as_str()).collect();
    if unaccepted.is_empty() {
        return Ok(());
    }
    Err(CommandError::Unsolved(format!(
        "no accepted calibration for {} of {}: {}. Draw the lines by hand, or write all results to the site with \
         --accept all, and check each camera",
        unaccepted.len(),
        calib_site::counted(results.len(), "image", "images"),
        shortened_list(unaccepted.iter().copied())
    )))
}

/// Progress of a batch of images: a bar on a terminal, otherwise at most one message every 10 seconds.
struct BatchProgress {
    bar: ProgressBar,
    done: usize,
    total: usize,
    last_message: Instant,
}

impl BatchProgress {
    /// Time between two messages in a log.
    const MESSAGE_INTERVAL: Duration = Duration::from_secs(10);

    fn new(total: usize) -> Self {
        let bar = ProgressBar::new(total as u64);
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg}, {eta} left") {
            bar.set_style(style);
        }
        // The bar is shown before the first image is done.
        bar.tick();
        Self { bar, done: 0, total, last_message: Instant::now() }
    }

    fn done(&mut self, image: &Path) {
        self.done += 1;
        self.bar.set_message(escape_control_characters(&image.to_string_lossy()).into_owned());
        self.bar.set_position(self.done as u64);
        if self.bar.is_hidden() && self.last_message.elapsed() >= Self::MESSAGE_INTERVAL {
            self.last_message = Instant::now();
            print_message(format_args!("calib: {} of {} images done", self.done, self.total));
        }
    }
}

impl Drop for BatchProgress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
