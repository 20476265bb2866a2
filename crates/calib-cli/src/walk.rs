//! `calib walk`: acceptance by a walker whom several cameras see.

use calib_core::FloorPoint;

use calib_health::{Disagreement, Walk, WalkResult, Zones};
use calib_report::{WalkPage, direction, zone_name};

use crate::args::SiteArgs;
use crate::detections::{DetectionArgs, Detections, TableArgs};
use crate::files;
use crate::site_file::SiteFile;
use crate::solve::Format;
use crate::stop::Stop;

/// Arguments of `calib walk`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    site: SiteArgs,
    #[command(flatten)]
    detections: DetectionArgs,
    /// Write a page to hand over and sign
    #[arg(short, long, value_name = "FILE")]
    output: Option<String>,
    /// Overwrite the page
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    limits: Limits,
    /// How to report
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
}

/// Over what is said of the walk that a report takes in.
const HEADING: &str = "The walk that the page takes in";

/// An argument of a report; what is said of the walk wants one.
pub(crate) fn goes_with_a_walk(arg: clap::Arg) -> clap::Arg {
    if arg.get_help_heading() == Some(HEADING) && arg.get_id() != "walk" { arg.requires("walk") } else { arg }
}

/// A walk that a report takes in.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = HEADING)]
pub(crate) struct WalkedArgs {
    /// Table of detections of one person who walked through the site, judged as by `calib walk`; - is stdin
    #[arg(long, value_name = "FILE")]
    walk: Option<String>,
    #[command(flatten)]
    limits: Limits,
    #[command(flatten)]
    table: TableArgs,
}

impl WalkedArgs {
    /// What it shows of a site, if there is one.
    pub(crate) fn judged(&self, file: &SiteFile) -> Result<Option<Judged>, Stop> {
        self.limits.check()?;
        let of = |table: &String| judged(file, self.table.open(table, file)?, &self.limits);
        self.walk.as_ref().map(of).transpose()
    }
}

/// What a walk must keep to.
#[derive(Debug, clap::Args)]
struct Limits {
    /// Largest floor error of a zone, in metres, beyond its ±
    #[arg(long, value_name = "M", default_value_t = 0.5)]
    max_error_m: f64,
    /// Length of a side of the zones, in metres
    #[arg(long, value_name = "M", default_value_t = 2.0)]
    zone_m: f64,
    /// Least share of the zones that cameras cover where somebody must have walked
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    min_walked: f64,
}

/// Moments that several cameras must have seen: fewer tell nothing.
const MOMENTS: usize = 20;

/// A walk that was judged.
pub(crate) struct Judged {
    title: String,
    names: Vec<String>,
    result: WalkResult,
    zones: Zones,
    faults: Vec<String>,
}

/// Reads the walk, and judges.
pub(crate) fn run(args: &Args) -> Result<(), Stop> {
    args.limits.check()?;
    if let Some(output) = &args.output {
        files::check_free(output, args.force)?;
    }
    let file = args.site.read()?;
    let judged = judged(&file, args.detections.open(&file)?, &args.limits)?;
    let page = judged.page();
    if let Some(output) = &args.output {
        files::write(output, page.html().as_bytes(), args.force)?;
    }
    match args.format {
        _ if args.output.as_deref() == Some("-") => {}
        Format::Json => files::print(&format!("{:#}\n", as_json(&page)))?,
        Format::Text => files::print(&crate::stop::visible(&page.text()))?,
    }
    judged.verdict()
}

impl Limits {
    /// Refuses limits that are none.
    fn check(&self) -> Result<(), Stop> {
        if self.zone_m > 0.0 && self.max_error_m > 0.0 {
            return Ok(());
        }
        Err(Stop::Usage("--zone-m, --max-error-m: expected lengths above 0".into()))
    }
}

/// What a table of one walker shows of a site.
fn judged(file: &SiteFile, mut detections: Detections, limits: &Limits) -> Result<Judged, Stop> {
    let cameras: Vec<_> = detections.calibrations.cameras().map(|c| (c.camera, c.size)).collect();
    let mut walk = Walk::new(&cameras);
    detections.each(0, |seen, _| {
        seen.iter().for_each(|sighting| walk.see(sighting));
        Ok(())
    })?;
    let (names, result) = (detections.names(), walk.result());
    refuse_a_crowd(&names, &result)?;
    let efovs: Vec<Vec<FloorPoint>> = detections.calibrations.efovs().map(<[_]>::to_vec).collect();
    let zones = Zones::new(&result.moments, &efovs, limits.zone_m);
    let faults = faults(limits, &names, &result, &zones);
    let title = file.site.name.clone().unwrap_or_else(|| "Cameras".into());
    Ok(Judged { title, names, result, zones, faults })
}

impl Judged {
    /// It as a page.
    pub(crate) fn page(&self) -> WalkPage<'_> {
        let Self { title, names, result, zones, faults } = self;
        WalkPage { title, names, result, zones, faults }
    }

    /// Exit 4 where it failed, with why.
    pub(crate) fn verdict(&self) -> Result<(), Stop> {
        if self.faults.is_empty() {
            return Ok(());
        }
        Err(Stop::Unsolved(format!("failed: {}", self.faults.join("; "))))
    }
}

/// A table of several people says nothing of a walker: whom one camera sees need not be whom another sees.
fn refuse_a_crowd(names: &[String], result: &WalkResult) -> Result<(), Stop> {
    /// Of what a camera saw: so much may be a second box of one person.
    const SHARE: f64 = 0.02;
    let is_crowd = |&camera: &usize| {
        result.crowded[camera] as f64 > SHARE * result.seen[camera] as f64 && result.crowded[camera] > 1
    };
    let Some(camera) = (0..names.len()).find(is_crowd) else { return Ok(()) };
    Err(Stop::Invalid(format!(
        "{} saw more than one person at {} times, and a walk is of one: give the rows of the walker alone",
        names[camera], result.crowded[camera]
    )))
}

/// What keeps the walk from passing.
fn faults(limits: &Limits, names: &[String], result: &WalkResult, zones: &Zones) -> Vec<String> {
    let mut faults = Vec::new();
    let together = result.moments.iter().filter(|moment| moment.seen.len() > 1).count();
    if together < MOMENTS {
        faults.push(format!(
            "{together} moments at which two cameras saw the walker, and {MOMENTS} are needed: walk where views overlap"
        ));
    }
    let accused = result.disagreements.iter();
    faults.extend(accused.map(|one| format!("{} {}", names[one.camera], direction(one))));
    let is_wrong = |error: Option<f64>, sigma: Option<f64>| {
        error.zip(sigma).is_some_and(|(error, sigma)| error - 2.0 * sigma > limits.max_error_m)
    };
    let wrong = zones.list.iter().filter(|zone| is_wrong(zone.error, zone.error_sigma));
    let wrong: Vec<String> = wrong.map(zone_name).collect();
    if !wrong.is_empty() {
        let list = calib_report::few(wrong.iter().map(String::as_str));
        faults.push(format!("floor error over {} m in the zones {list}", limits.max_error_m));
    }
    let walked = zones.list.iter().filter(|zone| zone.moments > 0).count() as f64;
    let share = walked / zones.list.len().max(1) as f64;
    if share < limits.min_walked {
        faults.push(format!(
            "{:.0} % of the zones were walked, {:.0} % asked",
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
        let verdict = match (found(index), result.together[index]) {
            (Some(_), _) => "disagrees",
            (None, 0) => "not-tested",
            (None, _) => "agrees",
        };
        let mut value = serde_json::json!({
            "id": names[index], "verdict": verdict,
            "moments": result.seen[index], "together": result.together[index],
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
            "together": zone.together, "error_m": zone.error, "error_sigma_m": zone.error_sigma,
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
        "sigmas_clear": one.sigmas_clear, "shift_m": one.shift, "shift_sigma_m": one.shift_sigma,
        "says": direction(one),
        "likeliest": {
            "x_m": x, "y_m": y, "z_m": z, "yaw_deg": yaw.to_degrees(), "pitch_deg": pitch.to_degrees(),
            "roll_deg": roll.to_degrees(), "focal_px": focal,
        },
    })
}
