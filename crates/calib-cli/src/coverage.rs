//! `calib coverage`: visible floor, pixel densities and blind spots of the installed cameras.

use std::fmt::Write as _;
use std::path::Path;

use calib_core::floor::DensityLevel;
use calib_formats::{coverage_geojson, is_spreadsheet_formula};
use calib_report::{CoveragePage, coverage_html, shortened_list};
use calib_site::{CoverageError, CoverageOptions, SiteCamera, SiteCoverage};
use serde_json::{Value, json};

use crate::args::SiteArgs;
use crate::files::{self, print_message};
use crate::painting::draw_on;
use crate::picture;
use crate::plan_ground::coverage_view;
use crate::progress::Pulse;
use crate::report::plan_picture;
use crate::solve::Format;
use crate::stop::{CommandError, escape_control_characters};

/// Arguments of `calib coverage`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    site: SiteArgs,
    /// Pixel density level that all areas must reach; replaces the level of each area
    #[arg(long, value_name = "LEVEL", value_parser = level)]
    level: Option<DensityLevel>,
    /// Height of the targets above the floor, in metres: 0 for feet, 1.6 for faces, 0.6 for number plates
    #[arg(long, value_name = "H", default_value_t = 0.0, allow_negative_numbers = true)]
    height_m: f64,
    /// Distance between grid points, in metres [default: from the size of the site]
    #[arg(long, value_name = "S")]
    step_m: Option<f64>,
    /// File to write: .csv (one row for each grid point), .geojson, .png or .jpg (on the plan), .html; - is
    /// CSV on stdout
    #[arg(short, long, value_name = "FILE")]
    output: Option<String>,
    /// Overwrite the output file
    #[arg(long)]
    force: bool,
    /// Output format of the report [default: text on a terminal, otherwise json]
    #[arg(long, value_enum)]
    format: Option<Format>,
}

/// Parses the name of a pixel density level.
fn level(text: &str) -> Result<DensityLevel, String> {
    DensityLevel::from_name(text).ok_or_else(|| {
        let names = DensityLevel::ALL.map(DensityLevel::name).join(", ");
        format!("unknown level; expected one of {names}")
    })
}

/// Kind of the output file, from its extension.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Csv,
    GeoJson,
    Picture,
    Page,
}

impl Kind {
    fn from_path(path: &str) -> Result<Self, CommandError> {
        let extension = Path::new(path).extension().map(|text| text.to_string_lossy().to_lowercase());
        match extension.as_deref() {
            _ if path == "-" => Ok(Self::Csv),
            Some("csv") => Ok(Self::Csv),
            Some("geojson") => Ok(Self::GeoJson),
            Some("png" | "jpg" | "jpeg") => Ok(Self::Picture),
            Some("html" | "htm") => Ok(Self::Page),
            _ => Err(CommandError::Usage(format!(
                "--output {path}: unknown extension; expected .csv, .geojson, .png, .jpg or .html"
            ))),
        }
    }
}

/// Computes the coverage, writes the output file, and prints the report.
pub(crate) fn run(args: &Args) -> Result<(), CommandError> {
    if !args.height_m.is_finite() {
        return Err(CommandError::Usage("--height-m: expected a number of metres".into()));
    }
    if args.step_m.is_some_and(|step| !(step.is_finite() && step >= 1e-3)) {
        return Err(CommandError::Usage("--step-m: expected a number of metres, at least 0.001".into()));
    }
    let output = args
        .output
        .as_deref()
        .map(|path| Ok::<_, CommandError>((path, Kind::from_path(path)?)))
        .transpose()?;
    if let Some((path, _)) = output {
        files::check_free(path, args.force)?;
        if path == "-" && args.format == Some(Format::Json) {
            let what =
                "--format json needs stdout for the report; write the table to a file with --output FILE";
            return Err(CommandError::Usage(what.into()));
        }
    }
    let file = args.site.read()?;
    let options = CoverageOptions {
        height: args.height_m,
        step: args.step_m,
        level: args.level,
        points_per_zone: None,
    };
    let pulse = Pulse::new("computing the coverage");
    let coverage = file.site.coverage(&options).map_err(|error| match error {
        CoverageError::NoCamera => CommandError::Unsolved(format!("{}: {error}", file.path)),
        CoverageError::TooManyPoints { .. } | CoverageError::Step => {
            CommandError::Usage(format!("--step-m: {error}"))
        }
        CoverageError::SeveralPeriods { .. } => CommandError::Usage(format!("{error} with --at TIME")),
    })?;
    drop(pulse);
    let page = CoveragePage { site: &file.site, coverage: &coverage };
    page.notes().iter().for_each(|note| print_message(format_args!("calib: {note}")));
    if let Some((path, kind)) = output {
        let bytes = match kind {
            Kind::Csv => csv(&coverage).into_bytes(),
            Kind::GeoJson => coverage_geojson(&file.site, &coverage).into_bytes(),
            Kind::Picture => {
                let (ground, svg) = coverage_view(&file.site, file.plan_image()?, &coverage);
                picture::encode(&draw_on(&svg, &ground)?, path)?
            }
            Kind::Page => coverage_html(&page, plan_picture(&file)?.as_ref()).into_bytes(),
        };
        files::write(path, &bytes, args.force)?;
    }
    report(&page, args)?;
    let missed: Vec<&str> = coverage
        .areas
        .iter()
        .filter(|result| !result.is_met())
        .map(|result| result.area.id.as_str())
        .collect();
    if missed.is_empty() {
        return Ok(());
    }
    Err(CommandError::Unsolved(format!("areas below their required level: {}", shortened_list(missed))))
}

/// Prints the report; on stderr if the table goes to stdout.
fn report(page: &CoveragePage<'_>, args: &Args) -> Result<(), CommandError> {
    let text = match Format::given_or_usual(args.format) {
        Format::Json => format!("{:#}\n", as_json(page.coverage)),
        Format::Text => escape_control_characters(&page.text()).into_owned(),
    };
    if args.output.as_deref() == Some("-") {
        print_message(escape_control_characters(page.text().trim_end()));
        return Ok(());
    }
    files::print(&text)
}

/// Returns the table with one row for each grid point.
fn csv(coverage: &SiteCoverage<'_>) -> String {
    let height = coverage.height;
    let mut text = String::from("x_m,y_m,height_m,px_per_m,best,seen_by\n");
    // Multiples of the step without their rounding error.
    let rounded = |value: f64| (value * 1e9).round() / 1e9;
    for at in 0..coverage.grid.len() {
        let point = coverage.grid.point(at);
        let best = coverage.coverage.best[at].map_or("", |camera| coverage.cameras[camera].id.as_str());
        let best = csv_cell(best);
        let _ = writeln!(
            text,
            "{},{},{height},{},{best},{}",
            rounded(point.x),
            rounded(point.y),
            coverage.coverage.density[at],
            coverage.coverage.seen_by[at]
        );
    }
    text
}

/// Returns a cell of a CSV table. A formula for spreadsheets gets an apostrophe in front, which makes it text.
fn csv_cell(text: &str) -> String {
    let mark = if is_spreadsheet_formula(text.as_bytes()) { "'" } else { "" };
    match text.contains([',', '"']) {
        true => format!("\"{mark}{}\"", text.replace('"', "\"\"")),
        false => format!("{mark}{text}"),
    }
}

fn as_json(coverage: &SiteCoverage<'_>) -> Value {
    let areas: Vec<Value> = coverage
        .areas
        .iter()
        .map(|result| {
            let found = result.coverage;
            json!({"id": result.area.id, "level": result.level, "met": result.is_met(),
                "share": found.map(|area| area.share), "blind_share": found.map(|area| area.blind_share),
                "worst_px_per_m": found.and_then(|area| area.worst_density)})
        })
        .collect();
    let cameras: Vec<Value> = coverage
        .cameras
        .iter()
        .zip(coverage.reaches())
        .map(|(entry, reaches)| {
            let reach = |level: DensityLevel| {
                reaches[level as usize].map(|reach| {
                    json!({"distance_m": reach.distance, "sigma_m": reach.sigma,
                        "limited_by": if reach.is_limited_by_density { "density" } else { "view" }})
                })
            };
            let reaches: serde_json::Map<String, Value> = DensityLevel::ALL
                .into_iter()
                .map(|level| (level.name().to_owned(), json!(reach(level))))
                .collect();
            json!({"id": entry.id, "reach": reaches})
        })
        .collect();
    let hand_overs: Vec<Value> = coverage
        .hand_overs
        .iter()
        .map(|zone| {
            let (found, why) = match &zone.disagreement {
                Ok(found) => (Some(found), None),
                Err(why) => (None, Some(coverage.unknown_text(*why))),
            };
            json!({"cameras": coverage.ids_of(zone), "area_m2": coverage.area_of(zone),
                "middle_m": [zone.middle.x, zone.middle.y], "disagreement_m": found.map(|found| found.rms),
                "worst_disagreement_m": found.map(|found| found.worst),
                "worst_m": found.map(|found| [found.worst_at.x, found.worst_at.y]), "unknown": why})
        })
        .collect();
    let limits: serde_json::Map<String, Value> = DensityLevel::ALL
        .into_iter()
        .map(|level| (level.name().to_owned(), json!(coverage.limits.of(level))))
        .collect();
    let ids = |entries: &[&SiteCamera]| entries.iter().map(|entry| entry.id.clone()).collect::<Vec<_>>();
    json!({"visible_m2": coverage.visible_area(|_| true), "step_m": coverage.grid.step,
        "left_out": ids(&coverage.left_out), "scale_assumed": ids(&coverage.scale_assumed),
        "level_px_per_m": limits, "cameras": cameras, "areas": areas, "hand_overs": hand_overs})
}
