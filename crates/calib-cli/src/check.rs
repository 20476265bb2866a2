//! `calib check`: the quality gate for the cameras and the site.

use calib_core::Code;
use calib_core::single::MIN_SLOPE_EFFECT_REL;

use calib_site::{Site, SiteCamera, SiteSolution, Solution, Warning};

use crate::args::SiteArgs;
use crate::files;
use crate::site_file::SiteFile;
use crate::solve::Format;
use crate::stop::CommandError;
use crate::stop::escape_control_characters;
use calib_report::{
    MAX_FLOOR_ERROR_REL, MAX_RMS_PX, centimetres, connectivity_text, planes_text, shortened_list, worst_first,
};

/// Arguments of `calib check`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    site: SiteArgs,
    /// Maximum predicted relative error of lengths on the floor: 0.03 is 3 %
    #[arg(long, value_name = "REL", default_value_t = MAX_FLOOR_ERROR_REL)]
    max_floor_error: f64,
    /// Maximum RMS residual, in pixels [default: 5]
    #[arg(long, value_name = "P")]
    max_rms_px: Option<f64>,
    /// Accept a finding by its code (misfit, two-solutions, ...); separate several codes with commas, or
    /// repeat the option
    #[arg(long, value_name = "CODE", value_delimiter = ',', value_parser = code)]
    allow: Vec<Code>,
    /// Also fail cameras whose heights above the floor are unknown while lengths on the floor are known
    #[arg(long)]
    heights: bool,
    /// List, for each camera, the findings that fail the check and the accepted findings, with advice
    #[arg(long)]
    explain: bool,
    /// Maximum distance on the floor, in metres, between the positions of one link or mark from two cameras
    /// (RMS of a pair); also fails if a camera is not connected or a scale is unknown
    #[arg(long, value_name = "M")]
    max_overlap_m: Option<f64>,
    /// Output format of the report
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
}

/// Parses a finding code for `--allow`. Only codes that fail the check are accepted.
fn code(text: &str) -> Result<Code, String> {
    let failing = || Code::ALL.iter().copied().filter(|code| code.fails_check());
    failing().find(|code| code.as_str() == text).ok_or_else(|| {
        let names: Vec<&str> = failing().map(Code::as_str).collect();
        format!(
            "this finding cannot fail the check, or its code is unknown; expected one of {}",
            names.join(", ")
        )
    })
}

/// Reason why a camera fails the check.
struct Fault {
    /// Code of the finding; `None` if the fault is not a finding: a number over its limit, missing residuals, or a
    /// camera that is not solved.
    code: Option<Code>,
    message: String,
    advice: String,
}

impl Fault {
    fn from_number(message: impl Into<String>, advice: &str) -> Self {
        Self { code: None, message: message.into(), advice: advice.into() }
    }

    /// Formats the reason for a report: code and message.
    fn summary(&self) -> String {
        match self.code {
            Some(code) => format!("{code}: {}", self.message.trim_end_matches('.')),
            None => self.message.clone(),
        }
    }

    fn is_allowed(&self, args: &Args) -> bool {
        self.code.is_some_and(|code| args.allow.contains(&code))
    }
}

impl From<&Warning> for Fault {
    fn from(warning: &Warning) -> Self {
        let Warning { code, message, advice } = warning;
        Self { code: Some(*code), message: message.clone(), advice: advice.clone() }
    }
}

/// Camera with the faults that fail the check, and the faults that are allowed.
struct CameraResult<'a> {
    camera: &'a SiteCamera,
    faults: Vec<Fault>,
    allowed: Vec<Fault>,
}

impl<'a> CameraResult<'a> {
    fn new(site: &Site, index: usize, camera: &'a SiteCamera, args: &Args) -> Self {
        let all = faults(site, index, camera, args);
        let heights_known = camera.solution.as_ref().and_then(|solution| solution.heights_known);
        // If lengths on the floor are known but heights are not (camera looking down), the focal length affects
        // only heights.
        let is_height = |fault: &Fault| {
            !args.heights && heights_known == Some(false) && fault.code == Some(Code::FocalUnobservable)
        };
        let (allowed, faults) = all.into_iter().partition(|fault| fault.is_allowed(args) || is_height(fault));
        Self { camera, faults, allowed }
    }

    fn summaries(&self) -> Vec<String> {
        self.faults.iter().map(Fault::summary).collect()
    }
}

/// Checks every camera and the site against the limits.
pub(crate) fn run(args: &Args) -> Result<(), CommandError> {
    if !(args.max_floor_error > 0.0 && args.max_floor_error <= 1.0) {
        let message = format!(
            "--max-floor-error: found {}, expected a fraction above 0 and at most 1, such as 0.03 for 3 %",
            args.max_floor_error
        );
        return Err(CommandError::Usage(message));
    }
    if args.max_rms_px.is_some_and(|most| most.is_nan() || most <= 0.0) {
        return Err(CommandError::Usage("--max-rms-px: expected a number of pixels above 0".into()));
    }
    if args.max_overlap_m.is_some_and(|most| most.is_nan() || most <= 0.0) {
        return Err(CommandError::Usage("--max-overlap-m: expected a number of metres above 0".into()));
    }
    let file = args.site.read_without_warnings()?;
    let cameras = file.site.cameras.iter().enumerate();
    let results: Vec<CameraResult> =
        cameras.map(|(index, camera)| CameraResult::new(&file.site, index, camera, args)).collect();
    if results.is_empty() {
        let none = match args.site.time() {
            Some(time) => format!("{}: no camera is valid at {time}", file.path),
            None => format!("{} has no cameras to check", file.path),
        };
        return Err(CommandError::Unsolved(none));
    }
    let of_site = args.max_overlap_m.map(|most| site_faults(&file, most, &args.allow));
    report(&file, &results, of_site.as_deref(), args)?;
    let failed = results.iter().filter(|result| !result.faults.is_empty()).count();
    let all = calib_site::counted(results.len(), "camera", "cameras");
    match (failed, of_site.is_none_or(|faults| faults.is_empty())) {
        (0, true) => Ok(()),
        (0, false) => Err(CommandError::Unsolved("the site failed the check".into())),
        (_, true) => Err(CommandError::Unsolved(format!("{failed} of {all} failed the check"))),
        (_, false) => Err(CommandError::Unsolved(format!("the site and {failed} of {all} failed the check"))),
    }
}

/// Prints the results of the cameras, and of the site if it was checked.
fn report(
    file: &SiteFile,
    results: &[CameraResult],
    of_site: Option<&[String]>,
    args: &Args,
) -> Result<(), CommandError> {
    if args.format == Format::Json {
        return files::print(&format!("{:#}\n", as_json(&file.site, results, of_site, args)));
    }
    let summary = |faults: &[String]| {
        if faults.is_empty() { "ok".into() } else { format!("FAILED: {}", faults.join("; ")) }
    };
    for result in results {
        let numbers = checked_numbers(&file.site, result.camera);
        files::print(&format!("{}: {}{numbers}\n", result.camera.id, summary(&result.summaries())))?;
        if args.explain {
            files::print(&explanation(result))?;
        }
    }
    files::print(&escape_control_characters(planes_text(&file.site).trim_start_matches('\n')))?;
    let Some(faults) = of_site else { return Ok(()) };
    let numbers = file.site.solution.as_ref().map(checked_site_numbers).unwrap_or_default();
    files::print(&format!("the site: {}{numbers}\n", summary(faults)))
}

/// Formats each finding on its own line with its advice.
fn explanation(result: &CameraResult) -> String {
    let line = |fate: &str, fault: &Fault| {
        let code = fault.code.map_or_else(String::new, |code| format!("{code}: "));
        format!("  {fate} {code}{}. {}\n", fault.message.trim_end_matches('.'), fault.advice)
    };
    let failed = result.faults.iter().map(|fault| line("failed: ", fault));
    failed.chain(result.allowed.iter().map(|fault| line("allowed:", fault))).collect()
}

fn as_json(
    site: &Site,
    results: &[CameraResult],
    of_site: Option<&[String]>,
    args: &Args,
) -> serde_json::Value {
    let fault_json = |fault: &Fault| serde_json::json!({ "code": fault.code, "message": fault.message, "advice": fault.advice });
    let camera = |result: &CameraResult| {
        let (id, faults) = (&result.camera.id, result.summaries());
        let mut value = serde_json::json!({ "camera": id, "ok": faults.is_empty(), "faults": faults });
        if result.camera.solution.is_some() {
            value["scale_known"] = site.scale_is_known(result.camera).into();
        }
        if args.explain {
            value["failed"] = result.faults.iter().map(fault_json).collect();
            value["allowed"] = result.allowed.iter().map(fault_json).collect();
        }
        value
    };
    let list: Vec<_> = results.iter().map(camera).collect();
    let ok =
        results.iter().all(|result| result.faults.is_empty()) && of_site.is_none_or(<[String]>::is_empty);
    let mut value = serde_json::json!({ "ok": ok, "cameras": list });
    if let Some(faults) = of_site {
        value["site"] = serde_json::json!({ "ok": faults.is_empty(), "faults": faults });
    }
    value
}

/// Returns the reasons why the positions of the cameras in the site are not reliable. `most` is the allowed RMS
/// distance, in metres, between the floor positions of shared links and marks from two cameras.
fn site_faults(file: &SiteFile, most: f64, allow: &[Code]) -> Vec<String> {
    let solution = file.site.solution.as_ref();
    let overlaps = solution.map_or(&[][..], |solution| &solution.overlaps[..]);
    let mut faults = Vec::new();
    let far: Vec<String> = worst_first(overlaps)
        .into_iter()
        .filter_map(|pair| Some((pair, pair.floor_rms_m.filter(|&apart| apart > most)?)))
        .map(|(pair, apart)| format!("{} ({} cm)", pair.cameras.join(" \u{2013} "), centimetres(apart)))
        .collect();
    if !far.is_empty() {
        let pairs = shortened_list(far.iter().map(String::as_str));
        faults.push(format!("cameras disagree by more than {} cm on the floor: {pairs}", centimetres(most)));
    }
    let is_measured = overlaps.iter().any(|pair| pair.floor_rms_m.is_some());
    if !is_measured && file.site.cameras.len() > 1 {
        let why = match solution {
            Some(_) => "no link or mark is visible in two cameras",
            None => "the cameras have no joint solution",
        };
        faults.push(format!("{why}, so the cameras cannot be compared on the floor"));
    }
    let warnings = solution.iter().flat_map(|s| &s.warnings);
    let warnings = warnings.filter(|w| w.code.fails_check() && !allow.contains(&w.code));
    faults.extend(warnings.map(|w| format!("{}: {}", w.code, w.message.trim_end_matches('.'))));
    faults
}

/// Formats the connectivity of the cameras and the largest distance between floor positions from two cameras, in
/// parentheses.
fn checked_site_numbers(solution: &SiteSolution) -> String {
    let worst = worst_first(&solution.overlaps).into_iter().find_map(|pair| {
        Some(format!("cameras disagree by at most {} cm on the floor", centimetres(pair.floor_rms_m?)))
    });
    let parts: Vec<String> = connectivity_text(solution).into_iter().chain(worst).collect();
    if parts.is_empty() { String::new() } else { format!(" ({})", parts.join("; ")) }
}

fn faults(site: &Site, index: usize, camera: &SiteCamera, args: &Args) -> Vec<Fault> {
    match (&camera.solution, &camera.error) {
        (Some(solution), _) => {
            let mut faults = over_limit(solution, args);
            faults.extend(findings(site, index, args));
            faults
        }
        (None, Some(failure)) => {
            vec![Fault::from_number(format!("not solved: {}", failure.message), &failure.advice)]
        }
        (None, None) => vec![Fault::from_number("not solved", "Solve the site first.")],
    }
}

/// Returns the findings of a camera that fail the check, except a floor slope within `--max-floor-error`.
fn findings(site: &Site, index: usize, args: &Args) -> Vec<Fault> {
    // The finding about an unknown floor slope is ignored if the error limit allows the error that a slope causes.
    let is_accepted = |code: Code| code == Code::FloorSlope && args.max_floor_error >= MIN_SLOPE_EFFECT_REL;
    site.failing_warnings(index)
        .iter()
        .filter(|warning| !is_accepted(warning.code))
        .map(Fault::from)
        .collect()
}

/// Formats the stage, the uncertainty of floor lengths and the RMS residual of a camera; empty without a solution.
/// The uncertainty does not include the error of an assumed scale.
fn checked_numbers(site: &Site, camera: &SiteCamera) -> String {
    let Some(solution) = &camera.solution else { return String::new() };
    let [lengths, scale] = match site.scale_is_known(camera) {
        true => ["floor lengths", ""],
        false => ["ratios of floor lengths", ", scale assumed"],
    };
    let floor = solution.sigma.as_ref().and_then(|sigma| sigma.floor_length_rel);
    let floor = floor.map_or_else(String::new, |rel| format!(", {lengths} \u{b1} {:.1} %", 100.0 * rel));
    let rms = solution.rms_px.map_or_else(String::new, |rms| format!(", RMS residual {rms:.2} px"));
    let heights = if solution.heights_known == Some(false) { ", heights unknown" } else { "" };
    format!(" ({}{floor}{scale}{heights}{rms})", crate::solve::stage_name(solution.stage))
}

/// Returns the faults of a camera for numbers that exceed their limits.
fn over_limit(solution: &Solution, args: &Args) -> Vec<Fault> {
    let mut faults = Vec::new();
    let floor = solution.sigma.as_ref().and_then(|sigma| sigma.floor_length_rel);
    if let Some(rel) = floor.filter(|&rel| rel > args.max_floor_error) {
        let most = 100.0 * args.max_floor_error;
        faults.push(Fault::from_number(
            format!("floor lengths \u{b1} {:.1} %, allowed {most:.1} %", 100.0 * rel),
            solution.draw_next.as_ref().map_or("Draw more lines.", |next| &next.message),
        ));
    }
    let most = args.max_rms_px.unwrap_or(MAX_RMS_PX);
    match solution.rms_px {
        Some(rms) if rms > most => faults.push(Fault::from_number(
            format!("RMS residual {rms:.2} px, allowed {most:.2} px"),
            "Check the lines with the largest residuals.",
        )),
        None if args.max_rms_px.is_some() => {
            faults.push(Fault::from_number("no residuals are available", "Draw lines on the image."));
        }
        _ => {}
    }
    faults
}
