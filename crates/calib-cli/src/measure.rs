//! `calib measure`: lengths, heights, areas and speeds in the images, with standard deviations.

use calib_core::Pixel;
use calib_core::floor::Measured;
use calib_report::{measurement_text, shortened_list, speed_remark};
use calib_site::{
    CameraViewError, Measurement, MeasurementError, MeasurementKind, MeasurementPoint, Site, speed_limits,
};
use jiff::Timestamp;
use serde_json::{Value, json};

use crate::files::{self, print_message};
use crate::site_file::SiteFile;
use crate::solve::Format;
use crate::stop::{CommandError, escape_control_characters};

/// Arguments of `calib measure`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Site file, or - for stdin; without points, its stored measurements are computed
    site: String,
    /// Camera of the first point
    #[arg(long, value_name = "ID", requires = "from")]
    camera: Option<String>,
    /// Raw pixel of the first point, such as 812.5,640
    #[arg(long, value_name = "U,V", value_parser = pixel, requires = "camera")]
    from: Option<Pixel>,
    /// Raw pixel of the next point; repeat for a line of several parts, or for the corners of an area
    #[arg(long, value_name = "U,V", value_parser = pixel, requires = "from")]
    to: Vec<Pixel>,
    /// Camera of the points of --to, if it differs from --camera
    #[arg(long, value_name = "ID", requires = "to")]
    to_camera: Option<String>,
    /// Measured quantity: length, height (of the second point vertically above the first), area (seen from above)
    /// or speed (length divided by time) [default: speed if the times differ, otherwise length]
    #[arg(long, value_name = "KIND", value_parser = kind, requires = "from")]
    kind: Option<MeasurementKind>,
    /// Height of the points above the floor, in metres
    #[arg(long, value_name = "H", default_value_t = 0.0, allow_negative_numbers = true)]
    height_m: f64,
    /// Time of the first point (RFC 3339); also selects the calibration
    #[arg(long, value_name = "TIME", requires = "from")]
    from_at: Option<String>,
    /// Time of the last point (RFC 3339); also selects the calibration [default: the time of the first point]
    #[arg(long, value_name = "TIME", requires = "to")]
    to_at: Option<String>,
    /// Standard deviation of each pixel coordinate [default: the standard deviation of the camera's annotations]
    #[arg(long, value_name = "S", requires = "from")]
    sigma_px: Option<f64>,
    /// Output format [default: text on a terminal, otherwise json]
    #[arg(long, value_enum)]
    format: Option<Format>,
}

/// Parses the name of a measured quantity.
fn kind(text: &str) -> Result<MeasurementKind, String> {
    MeasurementKind::from_name(text).ok_or_else(|| {
        let names = MeasurementKind::ALL.map(MeasurementKind::name).join(", ");
        format!("unknown quantity; expected one of {names}")
    })
}

/// Parses a pixel such as 812.5,640.
fn pixel(text: &str) -> Result<Pixel, String> {
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|value| value.is_finite());
    text.split_once(',')
        .and_then(|(u, v)| Some(Pixel { u: number(u)?, v: number(v)? }))
        .ok_or_else(|| "expected U,V, such as 812.5,640".into())
}

/// Measures between the given pixels, or computes the stored measurements.
pub(crate) fn run(args: &Args) -> Result<(), CommandError> {
    if args.sigma_px.is_some_and(|sigma| !(sigma.is_finite() && sigma > 0.0)) {
        return Err(CommandError::Usage("--sigma-px: expected a number of pixels above 0".into()));
    }
    if !args.height_m.is_finite() {
        return Err(CommandError::Usage("--height-m: expected a number of metres".into()));
    }
    for (name, time) in [("--from-at", &args.from_at), ("--to-at", &args.to_at)] {
        if time.as_ref().is_some_and(|time| time.parse::<Timestamp>().is_err()) {
            return Err(CommandError::Usage(format!("{name}: expected a time such as 2026-05-01T08:00:00Z")));
        }
    }
    // All periods are kept, because every point can have its own time.
    let file = SiteFile::read_for_measuring(&args.site)?;
    file.warn_out_of_date();
    let Some(measurement) = typed_measurement(args)? else { return stored(&file, args) };
    for id in args.camera.iter().chain(&args.to_camera) {
        if file.site.cameras.iter().all(|camera| camera.id != *id) {
            let ids = shortened_list(file.site.cameras.iter().map(|camera| camera.id.as_str()));
            let what = format!("{id}: unknown camera; cameras in {}: {ids}", file.path);
            return Err(CommandError::Usage(what));
        }
    }
    warn_assumed_scale(&file.site, &measurement);
    let found = file.site.measure(&measurement).map_err(|error| match &error {
        MeasurementError::TooFewPoints { least, .. } => CommandError::Usage(format!(
            "--to: this kind of measurement needs at least {least} points, including the point of --from"
        )),
        MeasurementError::NoDuration => {
            CommandError::Usage("a speed needs --from-at and a later --to-at".into())
        }
        MeasurementError::Camera { why: CameraViewError::Camera(_), .. } => {
            CommandError::Usage(format!("{error} (--from-at, --to-at)"))
        }
        MeasurementError::Camera { .. } | MeasurementError::NotComparable { .. } => {
            CommandError::Unsolved(error.to_string())
        }
        _ => CommandError::Invalid(error.to_string()),
    })?;
    files::print(&match Format::given_or_usual(args.format) {
        Format::Json => format!("{}\n", as_json(&measurement, found)),
        Format::Text => format!("{}\n", measurement_text(&measurement, found, file.site.units)),
    })?;
    remark(&file.site, "", &measurement, found);
    Ok(())
}

/// Returns the measurement of the command line; `None` without points.
fn typed_measurement(args: &Args) -> Result<Option<Measurement>, CommandError> {
    let (Some(camera), Some(from)) = (&args.camera, args.from) else { return Ok(None) };
    let to_at = args.to_at.as_ref().or(args.from_at.as_ref());
    let has_two_times = args.from_at.is_some() && to_at != args.from_at.as_ref();
    let usual = if has_two_times { MeasurementKind::Speed } else { MeasurementKind::Length };
    let kind = args.kind.unwrap_or(usual);
    if kind == MeasurementKind::Height && args.to.len() > 1 {
        let what = "--to: a height has only one point above the first; give --to once";
        return Err(CommandError::Usage(what.into()));
    }
    let point = |camera: &String, px: Pixel, at: Option<&String>| MeasurementPoint {
        height_m: Some(args.height_m),
        at: at.cloned(),
        sigma_px: args.sigma_px,
        ..MeasurementPoint::new(camera.clone(), px)
    };
    let to_camera = args.to_camera.as_ref().unwrap_or(camera);
    let others = args.to.iter().map(|&px| point(to_camera, px, to_at));
    let points = std::iter::once(point(camera, from, args.from_at.as_ref())).chain(others).collect();
    Ok(Some(Measurement::new(kind, points)))
}

/// Prints the stored measurements of the site.
fn stored(file: &SiteFile, args: &Args) -> Result<(), CommandError> {
    let mut failed = 0;
    let mut list = Vec::new();
    let mut text = String::new();
    for (index, measurement) in file.site.measurements.iter().enumerate() {
        let name = measurement.name.clone().or_else(|| measurement.id.clone());
        let name = name.unwrap_or_else(|| format!("measurement {}", index + 1));
        warn_assumed_scale(&file.site, measurement);
        match file.site.measure(measurement) {
            Ok(found) => {
                let mut value = as_json(measurement, found);
                remark(&file.site, &format!("{name}: "), measurement, found);
                value["id"] = json!(measurement.id);
                list.push(value);
                text.push_str(&format!(
                    "{name}: {}\n",
                    measurement_text(measurement, found, file.site.units)
                ));
            }
            Err(error) => {
                failed += 1;
                list.push(json!({"id": measurement.id, "error": error.to_string()}));
                text.push_str(&format!("{name}: {error}\n"));
            }
        }
    }
    if file.site.measurements.is_empty() {
        let message = "has no stored measurements; measure with --camera ID --from U,V --to U,V";
        return Err(CommandError::Usage(format!("{} {message}", file.path)));
    }
    files::print(&match Format::given_or_usual(args.format) {
        Format::Json => format!("{:#}\n", json!({ "measurements": list })),
        Format::Text => escape_control_characters(&text).into_owned(),
    })?;
    match failed {
        0 => Ok(()),
        _ => {
            let all = calib_site::counted(list.len(), "measurement", "measurements");
            Err(CommandError::Unsolved(format!("{failed} of {all} failed")))
        }
    }
}

/// Warns about cameras whose scale is assumed.
fn warn_assumed_scale(site: &Site, measurement: &Measurement) {
    let note =
        |point: &MeasurementPoint| site.scale_note(site.camera_at(&point.camera, point.at.as_deref()).ok()?);
    let mut notes: Vec<String> = measurement.points.iter().filter_map(note).collect();
    notes.dedup();
    notes.iter().for_each(|note| print_message(format_args!("calib: {note}")));
}

/// Prints a sentence about a speed whose times are whole seconds, after `prefix`.
fn remark(site: &Site, prefix: &str, measurement: &Measurement, found: Measured) {
    if let Some(remark) = speed_remark(measurement, found, site.units) {
        print_message(format_args!("calib: {}{remark}", escape_control_characters(prefix)));
    }
}

/// Returns the result with SI units in the names of its fields.
fn as_json(measurement: &Measurement, found: Measured) -> Value {
    let Measured { value, sigma } = found;
    let kind = measurement.kind;
    let [field, sigma_field] = match kind {
        MeasurementKind::Length | MeasurementKind::Height => ["length_m", "sigma_m"],
        MeasurementKind::Area => ["area_m2", "sigma_m2"],
        MeasurementKind::Speed => ["speed_mps", "sigma_mps"],
    };
    let mut result = json!({ "kind": kind, field: value, sigma_field: sigma });
    if let Some(limits) = speed_limits(measurement, value) {
        result["limits_mps"] = json!(limits);
    }
    result
}
