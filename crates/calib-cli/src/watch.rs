//! `calib watch`: detects moved cameras from detections of people.

use std::collections::BTreeMap;
use std::path::Path;

use calib_core::Camera;

use calib_core::camera::PanTiltZoom;

use calib_health::{CameraHealth, Change, DriftStatus, Memory, Watch};
use calib_report::WatchedCamera;
use serde::{Deserialize, Serialize};

use crate::args::SiteArgs;
use crate::detections::{DetectionArgs, Detections, instant};
use crate::files;
use crate::solve::Format;
use crate::stop::CommandError;

/// Arguments of `calib watch`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    site: SiteArgs,
    #[command(flatten)]
    detections: DetectionArgs,
    /// Write an HTML page with a plot for every camera
    #[arg(short, long, value_name = "FILE")]
    output: Option<String>,
    /// Overwrite the output file
    #[arg(long)]
    force: bool,
    /// Keep the accumulated statistics in this file between runs; rows that were already read are skipped
    #[arg(long, value_name = "FILE")]
    state: Option<String>,
    /// Output format of the report
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
}

/// Minimum number of rows between two saves of the state.
const SAVE_INTERVAL_ROWS: u64 = 1 << 21;
/// Largest accepted state file, in bytes.
const MAX_STATE_BYTES: u64 = 1 << 30;

/// Accumulated statistics that one run saves for the next run.
#[derive(Debug, Serialize, Deserialize)]
struct State {
    format: String,
    version: u32,
    /// SHA-256 of the site file. The state is valid for this calibration only.
    site_sha256: String,
    cameras: Vec<String>,
    /// Number of rows read, by table.
    read: BTreeMap<String, u64>,
    memory: Memory,
}

/// Reads the table of detections and reports the cameras that moved.
pub(crate) fn run(args: &Args) -> Result<(), CommandError> {
    if args.site.is_stdin() && args.detections.input == "-" {
        let what = "the site and the table cannot both come from stdin; give --input FILE";
        return Err(CommandError::Usage(what.into()));
    }
    if let Some(output) = &args.output {
        files::check_free(output, args.force)?;
    }
    let file = args.site.read()?;
    let mut detections = args.detections.open(&file)?;
    let mut watching = WatchRun::new(args, &detections, &file.sha256)?;
    watching.read(&mut detections)?;
    let health = watching.watch.health();
    let names = detections.names();
    if let Some(output) = &args.output {
        let cameras: Vec<WatchedCamera> =
            names.iter().zip(&health).map(|(id, health)| WatchedCamera { id, health }).collect();
        let title = file.site.name.as_deref().unwrap_or("Cameras");
        files::write(output, calib_report::watch_page(title, &cameras, &instant).as_bytes(), args.force)?;
    }
    let from: Vec<Option<&str>> = detections.calibrations.cameras().map(|camera| camera.valid_from).collect();
    if args.output.as_deref() != Some("-") {
        report(args.format, &names, &from, &health)?;
    }
    let moved = names.iter().zip(&health).filter(|(_, health)| health.status == DriftStatus::Moved);
    let moved: Vec<&str> = moved.map(|(id, _)| id.as_str()).collect();
    if moved.is_empty() {
        return Ok(());
    }
    Err(CommandError::Unsolved(format!("cameras that moved: {}", calib_report::shortened_list(moved))))
}

/// Drift detection with its saved state.
struct WatchRun<'a> {
    watch: Watch,
    state: State,
    path: Option<&'a Path>,
    input: &'a str,
}

impl<'a> WatchRun<'a> {
    fn new(args: &'a Args, detections: &Detections, site_sha256: &str) -> Result<Self, CommandError> {
        let cameras: Vec<(Camera, [f64; 2])> =
            detections.calibrations.cameras().map(|camera| (camera.camera, camera.size)).collect();
        let watch = Watch::new(&cameras);
        let (path, input) = (args.state.as_deref().map(Path::new), args.detections.input.as_str());
        let fresh = State {
            format: "calib-watch".into(),
            version: 1,
            site_sha256: site_sha256.into(),
            cameras: detections.names(),
            read: BTreeMap::new(),
            memory: watch.memory().clone(),
        };
        let Some(found) = path.filter(|path| path.exists()) else {
            return Ok(Self { watch, state: fresh, path, input });
        };
        let wrong = |what: &str| CommandError::invalid(found.display(), what);
        let bytes = calib_input::read(found, MAX_STATE_BYTES).map_err(|why| wrong(&why.to_string()))?;
        let state: State = serde_json::from_slice(&bytes)
            .map_err(|error| wrong(&format!("is not a state file of calib watch: {error}")))?;
        if state.site_sha256 != fresh.site_sha256 || state.cameras != fresh.cameras {
            let what = "belongs to another calibration or other cameras; choose another file, or delete this \
                        one to start again";
            return Err(wrong(what));
        }
        let watch = watch.with_memory(state.memory.clone());
        let watch =
            watch.ok_or_else(|| wrong("belongs to other cameras; delete this file to start again"))?;
        Ok(Self { watch, state, path, input })
    }

    fn read(&mut self, detections: &mut Detections) -> Result<(), CommandError> {
        // Rows from a pipe are always new.
        let is_file = self.input != "-";
        let skip = if is_file { self.state.read.get(self.input).copied().unwrap_or(0) } else { 0 };
        let mut saved = skip;
        detections.each(skip, |seen, rows| {
            seen.iter().for_each(|sighting| self.watch.add_sighting(sighting));
            if is_file {
                self.state.read.insert(self.input.to_owned(), rows);
            }
            if rows > saved + SAVE_INTERVAL_ROWS {
                saved = rows;
                self.save()?;
            }
            Ok(())
        })?;
        self.save()
    }

    fn save(&mut self) -> Result<(), CommandError> {
        let Some(path) = self.path else { return Ok(()) };
        self.state.memory = self.watch.memory().clone();
        files::write_atomically(path, &serde_json::to_vec(&self.state)?)
    }
}

fn report(
    format: Format,
    names: &[String],
    from: &[Option<&str>],
    health: &[CameraHealth],
) -> Result<(), CommandError> {
    let cameras = || names.iter().zip(from).zip(health);
    if format == Format::Json {
        let list: Vec<_> = cameras().map(|((id, from), health)| as_json(id, *from, health)).collect();
        return files::print(&format!("{:#}\n", serde_json::json!({ "cameras": list })));
    }
    for ((id, _), health) in cameras() {
        let text = calib_report::watch_text(health, &instant);
        files::print(&crate::stop::escape_control_characters(&format!("{id}: {text}\n")))?;
    }
    Ok(())
}

fn as_json(id: &str, from: Option<&str>, health: &CameraHealth) -> serde_json::Value {
    let mut value = serde_json::json!({
        "id": id,
        "verdict": health.status.name(),
        "since": health.change.map(|change| instant(change.since)),
        "since_low": health.change.map(|change| instant(change.between[0])),
        "since_high": health.change.map(|change| instant(change.between[1])),
        "tracks": health.tracks,
        "matches": health.matches,
        "would_find": parameters(health.smallest_detectable, health.smallest_detectable.map(|_| 0.0)),
    });
    if let Some(from) = from {
        value["valid_from"] = from.into();
    }
    if let Some(change) = &health.change {
        value["change"] = change_json(change);
    }
    value
}

fn change_json(change: &Change) -> serde_json::Value {
    let PanTiltZoom { pan, tilt, roll, zoom } = change.movement;
    let evidence = [("heights", change.is_seen_in_heights), ("other-cameras", change.is_seen_by_others)];
    let evidence: Vec<&str> =
        evidence.into_iter().filter(|(_, is_evidence)| *is_evidence).map(|(name, _)| name).collect();
    serde_json::json!({
        "by": parameters([pan, tilt, roll, zoom], change.sigmas),
        "sigma": parameters(change.sigmas, change.sigmas),
        "sigmas_clear": change.significance,
        "false_alarm": change.false_alarm,
        "told_by": evidence,
    })
}

/// Formats angles in degrees, and the zoom as the natural logarithm of the ratio of focal lengths. A value is null
/// if it or its standard deviation is unknown.
fn parameters(values: [f64; PanTiltZoom::SIZE], sigmas: [f64; PanTiltZoom::SIZE]) -> serde_json::Value {
    let known =
        |i: usize, scale: f64| Some(values[i] * scale).filter(|v| v.is_finite() && sigmas[i].is_finite());
    let degree = 1.0_f64.to_degrees();
    serde_json::json!({
        "pan_deg": known(PanTiltZoom::PAN, degree),
        "tilt_deg": known(PanTiltZoom::TILT, degree),
        "roll_deg": known(PanTiltZoom::ROLL, degree),
        "zoom_rel": known(PanTiltZoom::ZOOM, 1.0),
    })
}
