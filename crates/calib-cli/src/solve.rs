//! `calib solve`: calibrates a site and reports the result.

use std::fmt::Write as _;
use std::io::IsTerminal as _;

use calib_core::{Finding, Residual, ResidualOf};
use calib_draw::{Element, View, elements};
use calib_report::{
    centimetres, connectivity_text, group_warnings, planes_text, shortened_list, straight_down_text,
    worst_first,
};
use calib_site::{FailureEntry, Method, Options, Overlap, Site, SiteCamera, Solution, Stage, Warning};
use clap::ValueEnum;

use crate::args::ImageArgs;
use crate::progress::Pulse;
use crate::site_file::SiteFile;
use crate::stop::{CommandError, escape_control_characters};
use crate::{files, site_file};

/// Maximum number of rows of each table in the summary of the site. The worst rows are shown.
const MAX_ROWS: usize = 5;

/// Formats the joint solution: connected cameras, disagreement between cameras, the worst links, and
/// warnings. Empty if the site has no joint solution.
pub(crate) fn site_summary(site: &Site) -> String {
    let mut out = String::new();
    let Some(solution) = &site.solution else { return out };
    out.push_str("\nsite\n");
    if let Some(line) = connectivity_text(solution) {
        let _ = writeln!(out, "  {line}");
    }
    write_overlaps(&mut out, &solution.overlaps);
    write_errors(&mut out, &elements(site));
    write_warnings(&mut out, &solution.warnings);
    out
}

fn write_overlaps(out: &mut String, overlaps: &[Overlap]) {
    if overlaps.is_empty() {
        return;
    }
    let sorted = worst_first(overlaps);
    let shown = &sorted[..sorted.len().min(MAX_ROWS)];
    let names: Vec<String> = shown.iter().map(|pair| pair.cameras.join(" \u{2013} ")).collect();
    let width = names.iter().map(|name| name.chars().count()).chain([30]).max().unwrap_or(0);
    let _ =
        writeln!(out, "\n  {:width$} {:>9} {:>10}", "disagreement on the floor, cm", "measured", "predicted");
    for (pair, name) in shown.iter().zip(&names) {
        let cell = |value: Option<f64>| value.map_or_else(|| "-".into(), centimetres);
        let _ =
            writeln!(out, "  {name:width$} {:>9} {:>10}", cell(pair.floor_rms_m), cell(pair.floor_sigma_m));
    }
    write_hidden_rows(out, sorted.len() - shown.len(), "pair", "pairs");
    let _ = writeln!(
        out,
        "  (predicted: standard deviation of the calibration alone; measured: also contains pixel noise)"
    );
}

/// Writes the number of rows that a table does not show. `one` and `many` are the noun in singular and
/// plural.
fn write_hidden_rows(out: &mut String, hidden: usize, one: &str, many: &str) {
    if hidden > 0 {
        let what = if hidden == 1 { one } else { many };
        let _ = writeln!(out, "  and {hidden} more {what}, none worse");
    }
}

/// Returns the views of all used links and marks, with the largest reprojection error first.
fn worst_views<'a>(elements: &'a [Element<'a>]) -> Vec<(&'a Element<'a>, &'a View<'a>)> {
    let used = elements.iter().filter(|element| element.is_used());
    let mut views: Vec<_> =
        used.flat_map(|element| element.views.iter().map(move |v| (element, v))).collect();
    views.sort_by(|(_, a), (_, b)| b.px().total_cmp(&a.px()));
    views
}

fn write_errors(out: &mut String, elements: &[Element]) {
    let views = worst_views(elements);
    if views.is_empty() {
        return;
    }
    let shown = &views[..views.len().min(MAX_ROWS)];
    let names: Vec<String> = shown
        .iter()
        .map(|(element, view)| format!("{} {} in {}", element.kind, element.id, view.entry.id))
        .collect();
    let width = names.iter().map(|name| name.chars().count()).chain([30]).max().unwrap_or(0);
    let _ = writeln!(out, "\n  {:width$} {:>9} {:>10}", "worst links and marks", "px", "cm");
    for ((_, view), name) in shown.iter().zip(&names) {
        let floor = view.floor_m().map_or_else(|| "-".into(), centimetres);
        let _ = writeln!(out, "  {name:width$} {:>9.2} {floor:>10}", view.px());
    }
    write_hidden_rows(out, views.len() - shown.len(), "view", "views");
}

fn write_warnings(out: &mut String, warnings: &[Warning]) {
    for (index, kind) in group_warnings(warnings).iter().enumerate() {
        if index == 0 && !out.ends_with("site\n") {
            out.push('\n');
        }
        for message in &kind.messages {
            let _ = writeln!(out, "  {}: {message}", kind.code);
        }
        let _ = writeln!(out, "    {}", kind.advice);
    }
}

/// Method of stage 1, the calibration of each camera alone.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum MethodArg {
    /// Maximum likelihood in pixels, with standard deviations
    Ml,
    /// The criterion of the paper, minimised by Nelder-Mead
    Paper,
}

/// Output format of a report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Format {
    /// Text for people
    Text,
    /// JSON for programs
    Json,
}

impl Format {
    /// Returns the given format; if absent, text on a terminal and JSON for programs.
    pub(crate) fn given_or_usual(given: Option<Self>) -> Self {
        given.unwrap_or_else(|| if std::io::stdout().is_terminal() { Self::Text } else { Self::Json })
    }
}

/// Arguments of `calib solve`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Site file, or - for stdin
    site: String,
    #[command(flatten)]
    images: ImageArgs,
    /// Write the solved site to this file (- is stdout)
    #[arg(short, long, value_name = "FILE")]
    output: Option<String>,
    /// Solve only this camera (repeat for more)
    #[arg(long, value_name = "ID")]
    camera: Vec<String>,
    /// Report only the calibrations that are valid at this time (RFC 3339)
    #[arg(long, value_name = "TIME")]
    at: Option<String>,
    /// Method of stage 1, the calibration of each camera alone
    #[arg(long, value_enum, default_value = "ml")]
    method: MethodArg,
    /// Solve each camera separately; skip joint refinement
    #[arg(long)]
    no_refine: bool,
    /// Disable the weak prior on the focal length
    #[arg(long)]
    no_prior: bool,
    /// Output format of the report
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
    /// Overwrite the output file
    #[arg(long)]
    force: bool,
}

/// Solves a site and prints the report.
pub(crate) fn run(args: &Args) -> Result<(), CommandError> {
    let file = SiteFile::read_with(&args.site, Some(args.images.allow_outside))?;
    file.check_images()?;
    for id in &args.camera {
        file.has_camera(id)?;
    }
    if let Some(output) = &args.output {
        files::check_free(output, args.force)?;
    }
    if let Some(camera) = file.site.cameras.first() {
        site_file::is_valid_at(camera, args.at.as_deref())?;
    }
    let options = Options {
        method: match args.method {
            MethodArg::Ml => Method::MaximumLikelihood,
            MethodArg::Paper => Method::Paper,
        },
        refine: !args.no_refine,
        prior: !args.no_prior,
        cameras: (!args.camera.is_empty()).then(|| args.camera.clone()),
    };
    let pulse = Pulse::new("solving");
    let report = file.site.calibrate(&options);
    drop(pulse);
    let solved = report.write_into(&file.site);
    if let Some(output) = &args.output {
        files::write(output, file.with_paths_relative_to(&solved, output).to_json().as_bytes(), args.force)?;
    }
    let mut reports: Vec<CameraReport> = Vec::new();
    for ((index, _), found) in report.cameras.iter().zip(&report.findings) {
        let camera = &solved.cameras[*index];
        if site_file::is_valid_at(camera, args.at.as_deref())? {
            reports.push(CameraReport { camera, findings: found.as_deref().unwrap_or_default() });
        }
    }
    let cameras: Vec<&SiteCamera> = reports.iter().map(|report| report.camera).collect();
    let to_stdout = args.output.as_deref() == Some("-");
    match args.format {
        // With the site on stdout, a text report goes to stderr, and a JSON report is omitted.
        Format::Text if to_stdout => files::print_message(text(&solved, &reports)),
        Format::Text => files::print(&text(&solved, &reports))?,
        Format::Json if to_stdout => {}
        Format::Json => files::print(&json(&cameras)?)?,
    }
    check_all_solved(&cameras)
}

/// Solved camera with its findings.
struct CameraReport<'a> {
    camera: &'a SiteCamera,
    findings: &'a [Finding],
}

/// Fails with exit code 4 if a camera has no solution, and names all such cameras.
pub(crate) fn check_all_solved(cameras: &[&SiteCamera]) -> Result<(), CommandError> {
    let failed: Vec<&str> =
        cameras.iter().filter(|camera| camera.solution.is_none()).map(|camera| camera.id.as_str()).collect();
    if failed.is_empty() {
        return Ok(());
    }
    Err(CommandError::Unsolved(format!(
        "{} of {} could not be solved: {}",
        failed.len(),
        calib_site::counted(cameras.len(), "camera", "cameras"),
        shortened_list(failed.iter().copied())
    )))
}

/// Formats the solutions by camera id; an unsolved camera has its error instead.
pub(crate) fn json(cameras: &[&SiteCamera]) -> Result<String, CommandError> {
    let mut map = serde_json::Map::new();
    for camera in cameras {
        let value = match (&camera.solution, &camera.error) {
            (Some(solution), _) => serde_json::to_value(solution)?,
            (None, error) => serde_json::json!({ "error": error }),
        };
        // An id may repeat for periods that do not overlap.
        let period = camera.valid_from.as_deref().unwrap_or("before");
        let key =
            if map.contains_key(&camera.id) { format!("{} {period}", camera.id) } else { camera.id.clone() };
        map.insert(key, value);
    }
    let mut text = serde_json::to_string_pretty(&map)?;
    text.push('\n');
    Ok(text)
}

/// Mark of an assumed height and of values that depend on it.
const ASSUMED_MARK: &str = "*";

/// Formats the text report: a table of cameras, then warnings and advice.
fn text(site: &Site, reports: &[CameraReport]) -> String {
    let mut out = String::new();
    if let Some(name) = &site.name {
        let _ = writeln!(out, "{name}\n");
    }
    let width = reports.iter().map(|report| report.camera.id.chars().count()).max().unwrap_or(0).max(6);
    let _ = writeln!(
        out,
        "{:width$}  {:8} {:>14} {:>14} {:>14} {:>18} {:>9} {:>7} {:>6}",
        "camera",
        "stage",
        "roll deg",
        "pitch deg",
        "yaw deg",
        "focal px",
        format!("height {}", site.units.symbol()),
        "floor",
        "rms px",
    );
    for CameraReport { camera, .. } in reports {
        match (&camera.solution, &camera.error) {
            (Some(solution), _) => write_row(&mut out, width, site, (camera, solution)),
            (None, Some(failure)) => write_unsolved(&mut out, width, camera, failure),
            (None, None) => {}
        }
    }
    let is_assumed =
        |report: &CameraReport| report.camera.solution.is_some() && !site.scale_is_known(report.camera);
    if reports.iter().any(is_assumed) {
        let what = "assumed height; the \u{b1} of the floor excludes the error of the scale.";
        let _ = writeln!(out, "{ASSUMED_MARK} {what}");
    }
    let has_centre = |report: &CameraReport| {
        let sigma = report.camera.solution.as_ref().and_then(|solution| solution.sigma.as_ref());
        sigma.is_some_and(|sigma| sigma.cx_px.is_some())
    };
    if reports.iter().any(has_centre) {
        out.push_str(
            "The \u{b1} values include the uncertainty of the principal point. To reduce them, enter \
             lens.principal_point_px, or draw lines in a third direction.\n",
        );
    }
    for CameraReport { camera, .. } in reports {
        if let Some(down) = camera.solution.as_ref().and_then(straight_down_text) {
            let _ = writeln!(out, "{:width$}  {down}", camera.id);
        }
    }
    for CameraReport { camera, findings } in reports {
        let Some(solution) = &camera.solution else { continue };
        write_remarks(&mut out, camera, solution, findings);
    }
    out.push_str(&planes_text(site));
    out.push_str(&site_summary(site));
    escape_control_characters(&out).into_owned()
}

/// Returns the name of a stage of calibration, for reports.
pub(crate) fn stage_name(stage: Stage) -> &'static str {
    match stage {
        Stage::Lens => "lens",
        Stage::Partial => "partial",
        Stage::Placed => "placed",
        Stage::Refined => "refined",
    }
}

fn write_row(out: &mut String, width: usize, site: &Site, (camera, solution): (&SiteCamera, &Solution)) {
    let sigma = solution.sigma.as_ref();
    let number = |value: Option<f64>, sigma: Option<f64>, digits: usize| match (value, sigma) {
        (Some(value), Some(sigma)) => format!("{value:.digits$} \u{b1} {sigma:.digits$}"),
        (Some(value), None) => format!("{value:.digits$}"),
        (None, _) => "-".into(),
    };
    let stage = stage_name(solution.stage);
    let placed = solution.stage >= Stage::Placed;
    let assumed = if site.scale_is_known(camera) { "" } else { ASSUMED_MARK };
    // Roll and yaw are one rotation for a camera that looks straight down.
    let is_down = straight_down_text(solution).is_some();
    let own_turn = |angle: Option<f64>| angle.filter(|_| !is_down);
    let _ = writeln!(
        out,
        "{:width$}  {stage:8} {:>14} {:>14} {:>14} {:>18} {:>9} {:>7} {:>6}",
        camera.id,
        number(own_turn(solution.roll_deg), sigma.and_then(|s| s.roll_deg), 2),
        number(solution.pitch_deg, sigma.and_then(|s| s.pitch_deg), 2),
        if placed {
            number(own_turn(solution.yaw_deg), sigma.and_then(|s| s.yaw_deg), 2)
        } else {
            "-".into()
        },
        number(Some(solution.focal_px), sigma.and_then(|s| s.focal_px), 1),
        solution
            .position_m
            .map_or_else(|| "-".into(), |p| format!("{:.2}{assumed}", p.z / site.units.metres())),
        sigma
            .and_then(|s| s.floor_length_rel)
            .filter(|rel| *rel < 1.0)
            .map_or_else(|| "-".into(), |rel| format!("{:.1} %{assumed}", 100.0 * rel)),
        solution.rms_px.map_or_else(|| "-".into(), |rms| format!("{rms:.2}")),
    );
}

/// Writes the table row of a camera that could not be solved.
fn write_unsolved(out: &mut String, width: usize, camera: &SiteCamera, failure: &FailureEntry) {
    let _ = writeln!(out, "{:width$}  not solved: {} {}", camera.id, failure.message, failure.advice);
}

/// Writes the residuals of the control points, the warnings and the advice for a camera.
fn write_remarks(out: &mut String, camera: &SiteCamera, solution: &Solution, findings: &[Finding]) {
    let worst = worst_control_point(camera, &solution.residuals);
    if solution.warnings.is_empty() && worst.is_none() && solution.draw_next.is_none() {
        return;
    }
    let _ = writeln!(out, "\n{}", camera.id);
    if let Some((rms, worst, count)) = worst {
        let points = calib_site::counted(count, "control point", "control points");
        let _ = writeln!(out, "  {points}: RMS residual {rms:.2} px, largest {worst:.2} px");
    }
    for warning in &solution.warnings {
        let _ = writeln!(out, "  {}: {}\n    {}", warning.code, warning.message, warning.advice);
    }
    let is_advised = findings.iter().any(|finding| finding.suggestion().is_some());
    if let Some(next) = solution.draw_next.as_ref().filter(|_| !is_advised) {
        let _ = writeln!(out, "  next: {}", next.message);
    }
}

/// Returns the RMS and the largest residual of the used control points, in pixels, and their number; `None` if no
/// control point is used.
fn worst_control_point(camera: &SiteCamera, residuals: &[Residual]) -> Option<(f64, f64, usize)> {
    let off = camera.control_points.iter().enumerate().filter(|(_, point)| point.off);
    let off: Vec<String> = off.map(|(index, point)| point.label(index)).collect();
    let is_used = |r: &&Residual| !r.outlier && !r.id.as_ref().is_some_and(|id| off.contains(id));
    let points: Vec<f64> =
        residuals.iter().filter(|r| r.of == ResidualOf::ControlPoint).filter(is_used).map(|r| r.px).collect();
    let rms = (points.iter().map(|px| px * px).sum::<f64>() / points.len() as f64).sqrt();
    (!points.is_empty()).then(|| (rms, points.iter().copied().fold(0.0, f64::max), points.len()))
}
