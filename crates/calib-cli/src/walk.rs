//! `calib walk`: acceptance test from detections of one person who walks through the site.

use calib_core::FloorPoint;

use calib_health::{Disagreement, Walk, WalkResult, Zones};
use calib_report::{WalkPage, disagreement_text, zone_name};
use calib_site::counted;

use crate::args::SiteArgs;
use crate::detections::{DetectionArgs, Detections, TableArgs};
use crate::files;
use crate::site_file::SiteFile;
use crate::solve::Format;
use crate::stop::CommandError;

/// Arguments of `calib walk`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    site: SiteArgs,
    #[command(flatten)]
    detections: DetectionArgs,
    /// Write an HTML acceptance report for signature
    #[arg(short, long, value_name = "FILE")]
    output: Option<String>,
    /// Overwrite the output file
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    limits: Limits,
    /// Output format of the report
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
}

/// Help heading of the walk arguments of `calib report`.
const HEADING: &str = "Walk test in the report";

/// Makes an argument under the walk heading require `--walk`.
pub(crate) fn require_walk(arg: clap::Arg) -> clap::Arg {
    if arg.get_help_heading() == Some(HEADING) && arg.get_id() != "walk" { arg.requires("walk") } else { arg }
}

/// Arguments of `calib report` for the walk test.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = HEADING)]
pub(crate) struct WalkArgs {
    /// Table of detections of one person who walked through the site, tested as with `calib walk`; - is stdin
    #[arg(long, value_name = "FILE")]
    walk: Option<String>,
    #[command(flatten)]
    limits: Limits,
    #[command(flatten)]
    table: TableArgs,
}

impl WalkArgs {
    /// Runs the walk test on the table of `--walk`; `None` without this option.
    pub(crate) fn test(&self, file: &SiteFile) -> Result<Option<WalkTest>, CommandError> {
        self.limits.check()?;
        let of = |table: &String| test_walk(file, self.table.open(table, file)?, &self.limits);
        self.walk.as_ref().map(of).transpose()
    }
}

/// Limits of the acceptance test.
#[derive(Debug, clap::Args)]
struct Limits {
    /// Maximum floor error of a zone, in metres; an excess within the uncertainty passes
    #[arg(long, value_name = "M", default_value_t = 0.5)]
    max_error_m: f64,
    /// Side length of the zones, in metres
    #[arg(long, value_name = "M", default_value_t = 2.0)]
    zone_m: f64,
    /// Minimum fraction of the covered zones, from 0 to 1, that the person must visit
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    min_walked: f64,
}

/// Minimum number of moments at which two or more cameras detect the person; with fewer, the walk test fails.
const MIN_MOMENTS: usize = 20;

/// Result of a walk test, with the reasons why it fails.
pub(crate) struct WalkTest {
    title: String,
    names: Vec<String>,
    result: WalkResult,
    zones: Zones,
    faults: Vec<String>,
}

/// Reads the detections of a walk, tests them against the limits, and reports the result.
pub(crate) fn run(args: &Args) -> Result<(), CommandError> {
    args.limits.check()?;
    if let Some(output) = &args.output {
        files::check_free(output, args.force)?;
    }
    let file = args.site.read()?;
    let test = test_walk(&file, args.detections.open(&file)?, &args.limits)?;
    let page = test.page();
    if let Some(output) = &args.output {
        files::write(output, page.html().as_bytes(), args.force)?;
    }
    match args.format {
        _ if args.output.as_deref() == Some("-") => {}
        Format::Json => files::print(&format!("{:#}\n", as_json(&page)))?,
        Format::Text => files::print(&crate::stop::escape_control_characters(&page.text()))?,
    }
    test.check_passed()
}

impl Limits {
    /// Refuses distances that are not positive, and fractions outside 0 to 1.
    fn check(&self) -> Result<(), CommandError> {
        if !(0.0..=1.0).contains(&self.min_walked) {
            return Err(CommandError::Usage("--min-walked: expected a number from 0 to 1".into()));
        }
        if self.zone_m > 0.0 && self.max_error_m > 0.0 {
            return Ok(());
        }
        Err(CommandError::Usage("--zone-m, --max-error-m: expected numbers of metres above 0".into()))
    }
}

/// Tests a table of detections of one person against the limits.
fn test_walk(file: &SiteFile, mut detections: Detections, limits: &Limits) -> Result<WalkTest, CommandError> {
    let cameras: Vec<_> = detections.calibrations.cameras().map(|c| (c.camera, c.size)).collect();
    let mut walk = Walk::new(&cameras);
    detections.each(0, |seen, _| {
        seen.iter().for_each(|sighting| walk.add_sighting(sighting));
        Ok(())
    })?;
    let (names, result) = (detections.names(), walk.result());
    check_single_person(&names, &result)?;
    let efovs: Vec<Vec<FloorPoint>> = detections.calibrations.efovs().map(<[_]>::to_vec).collect();
    let zones = Zones::new(&result.moments, &efovs, limits.zone_m);
    let faults = faults(limits, &names, &result, &zones);
    let title = file.site.name.clone().unwrap_or_else(|| "Cameras".into());
    Ok(WalkTest { title, names, result, zones, faults })
}

impl WalkTest {
    /// Returns the data of the HTML acceptance report.
    pub(crate) fn page(&self) -> WalkPage<'_> {
        let Self { title, names, result, zones, faults } = self;
        WalkPage { title, names, result, zones, faults }
    }

    /// Fails with exit code 4 and the reasons if the walk failed.
    pub(crate) fn check_passed(&self) -> Result<(), CommandError> {
        if self.faults.is_empty() {
            return Ok(());
        }
        Err(CommandError::Unsolved(format!("the walk test failed: {}", self.faults.join("; "))))
    }
}

/// Refuses a table of several people, because detections of two cameras could then be of different people.
fn check_single_person(names: &[String], result: &WalkResult) -> Result<(), CommandError> {
    /// Maximum fraction of a camera's detections at times with several boxes. A smaller fraction may be duplicate
    /// boxes of one person.
    const MAX_CROWDED_FRACTION: f64 = 0.02;
    let is_crowd = |&camera: &usize| {
        result.crowded_moments[camera] as f64 > MAX_CROWDED_FRACTION * result.seen[camera] as f64
            && result.crowded_moments[camera] > 1
    };
    let Some(camera) = (0..names.len()).find(is_crowd) else { return Ok(()) };
    Err(CommandError::Invalid(format!(
        "camera \"{}\" detected several people at once, at {} moments; keep only the rows of the person who walked",
        names[camera], result.crowded_moments[camera]
    )))
}

/// Returns the reasons why the walk test fails; empty if it passes.
fn faults(limits: &Limits, names: &[String], result: &WalkResult, zones: &Zones) -> Vec<String> {
    let mut faults = Vec::new();
    let together = result.moments.iter().filter(|moment| moment.seen.len() > 1).count();
    if together < MIN_MOMENTS {
        faults.push(format!(
            "two or more cameras detected the person at {}, but at least {MIN_MOMENTS} are needed: walk \
             where views overlap",
            counted(together, "moment", "moments")
        ));
    }
    let accused = result.disagreements.iter();
    faults.extend(accused.map(|one| format!("{} {}", names[one.camera], disagreement_text(one))));
    let is_wrong = |error: Option<f64>, sigma: Option<f64>| {
        error.zip(sigma).is_some_and(|(error, sigma)| error - 2.0 * sigma > limits.max_error_m)
    };
    let wrong = zones.list.iter().filter(|zone| is_wrong(zone.error, zone.error_sigma));
    let wrong: Vec<String> = wrong.map(zone_name).collect();
    if !wrong.is_empty() {
        let list = calib_report::shortened_list(wrong.iter().map(String::as_str));
        faults.push(format!("floor error over {} m (zones: {list})", limits.max_error_m));
    }
    let walked = zones.list.iter().filter(|zone| zone.moments > 0).count() as f64;
    let share = walked / zones.list.len().max(1) as f64;
    if share < limits.min_walked {
        faults.push(format!(
            "{:.0} % of the zones were visited, but {:.0} % are required",
            100.0 * share,
            100.0 * limits.min_walked
        ));
    }
    faults
}

fn as_json(page: &WalkPage<'_>) -> serde_json::Value {
    let WalkPage { names, result, zones, faults, .. } = page;
    let found = |camera: usize| result.disagreements.iter().find(|one| one.camera == camera);
    let camera = |index: usize| {
        let verdict = match (found(index), result.shared_moments[index]) {
            (Some(_), _) => "disagrees",
            (None, 0) => "not-tested",
            (None, _) => "agrees",
        };
        let mut value = serde_json::json!({
            "id": names[index], "verdict": verdict,
            "moments": result.seen[index], "together": result.shared_moments[index],
        });
        if let Some(one) = found(index) {
            value["fault"] = fault_json(one);
        }
        value
    };
    let zone = |zone: &calib_health::Zone| {
        let covered_by: Vec<&String> = zone.covered_by.iter().map(|&camera| &names[camera]).collect();
        serde_json::json!({
            "zone": zone_name(zone), "corner_m": [zone.corner.x, zone.corner.y], "moments": zone.moments,
            "together": zone.shared_moments, "error_m": zone.error, "error_sigma_m": zone.error_sigma,
            "covered_by": covered_by,
        })
    };
    let nobody = zones.list.iter().filter(|zone| zone.moments == 0).map(zone_name);
    serde_json::json!({
        "ok": faults.is_empty(), "faults": faults, "zone_m": zones.side,
        "cameras": (0..names.len()).map(camera).collect::<Vec<_>>(),
        "zones": zones.list.iter().map(zone).collect::<Vec<_>>(),
        "not_walked": nobody.collect::<Vec<_>>(),
    })
}

fn fault_json(one: &Disagreement) -> serde_json::Value {
    let [x, y, z, yaw, pitch, roll, focal] = one.errors;
    serde_json::json!({
        "sigmas_clear": one.significance, "shift_m": one.shift, "shift_sigma_m": one.shift_sigma,
        "says": disagreement_text(one),
        "likeliest": {
            "x_m": x, "y_m": y, "z_m": z, "yaw_deg": yaw.to_degrees(), "pitch_deg": pitch.to_degrees(),
            "roll_deg": roll.to_degrees(), "focal_px": focal,
        },
    })
}
