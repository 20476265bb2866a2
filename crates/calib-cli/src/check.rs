//! `calib check`: the quality gate.

use calib_core::Code;

use calib_site::{Names, Site, SiteCamera, SiteSolution, Solution, Warning};

use crate::args::SiteArgs;
use crate::files;
use crate::site_file::SiteFile;
use crate::solve::Format;
use crate::stop::Stop;
use crate::stop::visible;
use calib_report::{centimetres, few, planes_text, together, worst_first};

/// Arguments of `calib check`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    site: SiteArgs,
    /// Largest predicted relative error of lengths on the floor: 0.03 is 3 %
    #[arg(long, value_name = "REL", default_value_t = 0.03)]
    max_floor_error: f64,
    /// Largest root mean square of the residuals, in pixels; 5 where it is not given, of cameras that have any
    #[arg(long, value_name = "P")]
    max_rms_px: Option<f64>,
    /// Let this finding pass, by its code (misfit, two-solutions, ...); several with commas, or one by one
    #[arg(long, value_name = "CODE", value_delimiter = ',', value_parser = code)]
    allow: Vec<Code>,
    /// Say of every camera what failed or was allowed, and what to do about it
    #[arg(long)]
    explain: bool,
    /// Largest distance on the floor, in metres, between where two cameras put what both show (root mean square of
    /// a pair); with it, a camera that nothing ties to the rest and an unknown scale fail, too
    #[arg(long, value_name = "M")]
    max_overlap_m: Option<f64>,
    /// How to report
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
}

/// The most of [`Args::max_rms_px`] where it is not given: hands and edges err by a pixel or two.
const MAX_RMS_PX: f64 = 5.0;

/// A code that can fail the check.
fn code(text: &str) -> Result<Code, String> {
    let failing = || Code::ALL.iter().copied().filter(|code| code.fails_check());
    failing().find(|code| code.as_str() == text).ok_or_else(|| {
        let names: Vec<&str> = failing().map(Code::as_str).collect();
        format!("no finding that fails a check; those are {}", names.join(", "))
    })
}

/// What keeps a camera from passing.
struct Fault {
    /// Of the finding; none of a number over its limit.
    code: Option<Code>,
    message: String,
    advice: String,
}

impl Fault {
    fn of_number(message: impl Into<String>, advice: &str) -> Self {
        Self { code: None, message: message.into(), advice: advice.into() }
    }

    /// As a report has it.
    fn short(&self) -> String {
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

/// A camera, and what is wrong with it.
struct Verdict<'a> {
    camera: &'a SiteCamera,
    faults: Vec<Fault>,
    allowed: Vec<Fault>,
}

impl<'a> Verdict<'a> {
    fn new(site: &Site, index: usize, camera: &'a SiteCamera, args: &Args) -> Self {
        let all = faults(site, index, camera, args);
        let (allowed, faults) = all.into_iter().partition(|fault| fault.is_allowed(args));
        Self { camera, faults, allowed }
    }

    fn short(&self) -> Vec<String> {
        self.faults.iter().map(Fault::short).collect()
    }
}

/// Checks every camera against the gates.
pub(crate) fn run(args: &Args) -> Result<(), Stop> {
    if !(args.max_floor_error > 0.0 && args.max_floor_error <= 1.0) {
        let message = format!(
            "--max-floor-error: found {}, expected a share up to 1: 0.03 is 3 %",
            args.max_floor_error
        );
        return Err(Stop::Usage(message));
    }
    if args.max_rms_px.is_some_and(|most| most.is_nan() || most <= 0.0) {
        return Err(Stop::Usage("--max-rms-px: expected a number of pixels above 0".into()));
    }
    if args.max_overlap_m.is_some_and(|most| most.is_nan() || most <= 0.0) {
        return Err(Stop::Usage("--max-overlap-m: expected metres above 0".into()));
    }
    let file = args.site.read_to_judge()?;
    let cameras = file.site.cameras.iter().enumerate();
    let verdicts: Vec<Verdict> =
        cameras.map(|(index, camera)| Verdict::new(&file.site, index, camera, args)).collect();
    if verdicts.is_empty() {
        return Err(Stop::Unsolved(format!("{} has no cameras to check", file.path)));
    }
    let of_site = args.max_overlap_m.map(|most| site_faults(&file, most, &args.allow));
    report(&file, &verdicts, of_site.as_deref(), args)?;
    let failed = verdicts.iter().filter(|verdict| !verdict.faults.is_empty()).count();
    match (failed, of_site.is_none_or(|faults| faults.is_empty())) {
        (0, true) => Ok(()),
        (0, false) => Err(Stop::Unsolved("the site fails".into())),
        (_, true) => Err(Stop::Unsolved(format!("{failed} of {} cameras fail", verdicts.len()))),
        (_, false) => {
            Err(Stop::Unsolved(format!("the site and {failed} of {} cameras fail", verdicts.len())))
        }
    }
}

/// Prints what was found; of the site, if it was judged.
fn report(
    file: &SiteFile,
    verdicts: &[Verdict],
    of_site: Option<&[String]>,
    args: &Args,
) -> Result<(), Stop> {
    if args.format == Format::Json {
        return files::print(&format!("{:#}\n", as_json(verdicts, of_site, args)));
    }
    let said = |faults: &[String]| {
        if faults.is_empty() { "ok".into() } else { format!("FAILED: {}", faults.join("; ")) }
    };
    for verdict in verdicts {
        let judged = verdict.camera.solution.as_ref().map(judged).unwrap_or_default();
        files::print(&format!("{}: {}{judged}\n", verdict.camera.id, said(&verdict.short())))?;
        if args.explain {
            files::print(&explained(verdict))?;
        }
    }
    files::print(&visible(planes_text(&file.site).trim_start_matches('\n')))?;
    let Some(faults) = of_site else { return Ok(()) };
    let judged = file.site.solution.as_ref().map(judged_site).unwrap_or_default();
    files::print(&format!("the site: {}{judged}\n", said(faults)))
}

/// Line by line, with what to do.
fn explained(verdict: &Verdict) -> String {
    let line = |fate: &str, fault: &Fault| {
        let code = fault.code.map_or_else(String::new, |code| format!("{code}: "));
        format!("  {fate} {code}{} {}\n", fault.message, fault.advice)
    };
    let failed = verdict.faults.iter().map(|fault| line("failed: ", fault));
    failed.chain(verdict.allowed.iter().map(|fault| line("allowed:", fault))).collect()
}

fn as_json(verdicts: &[Verdict], of_site: Option<&[String]>, args: &Args) -> serde_json::Value {
    let told = |fault: &Fault| serde_json::json!({ "code": fault.code, "message": fault.message, "advice": fault.advice });
    let camera = |verdict: &Verdict| {
        let (id, faults) = (&verdict.camera.id, verdict.short());
        let mut value = serde_json::json!({ "camera": id, "ok": faults.is_empty(), "faults": faults });
        if args.explain {
            value["failed"] = verdict.faults.iter().map(told).collect();
            value["allowed"] = verdict.allowed.iter().map(told).collect();
        }
        value
    };
    let list: Vec<_> = verdicts.iter().map(camera).collect();
    let ok =
        verdicts.iter().all(|verdict| verdict.faults.is_empty()) && of_site.is_none_or(<[String]>::is_empty);
    let mut value = serde_json::json!({ "ok": ok, "cameras": list });
    if let Some(faults) = of_site {
        value["site"] = serde_json::json!({ "ok": faults.is_empty(), "faults": faults });
    }
    value
}

/// What keeps the cameras from being one site whose positions can be relied on.
fn site_faults(file: &SiteFile, most: f64, allow: &[Code]) -> Vec<String> {
    let solution = file.site.solution.as_ref();
    let overlaps = solution.map_or(&[][..], |solution| &solution.overlaps[..]);
    let mut faults = Vec::new();
    let far: Vec<String> = worst_first(overlaps)
        .into_iter()
        .filter_map(|pair| Some((pair, pair.floor_rms_m.filter(|&apart| apart > most)?)))
        .map(|(pair, apart)| format!("{} {} cm", pair.cameras.join(" \u{2013} "), centimetres(apart)))
        .collect();
    if !far.is_empty() {
        let pairs = few(far.iter().map(String::as_str));
        faults.push(format!("apart on the floor {pairs}, allowed {} cm", centimetres(most)));
    }
    let is_measured = overlaps.iter().any(|pair| pair.floor_rms_m.is_some());
    if !is_measured && file.site.cameras.len() > 1 {
        faults.push("no two cameras show the same link or mark: nothing tells how far they are apart".into());
    }
    let warnings = solution.iter().flat_map(|s| &s.warnings);
    let warnings = warnings.filter(|w| w.code.fails_check() && !allow.contains(&w.code));
    faults.extend(warnings.map(|w| format!("{}: {}", w.code, w.message.trim_end_matches('.'))));
    faults
}

/// The numbers of the site that were judged.
fn judged_site(solution: &SiteSolution) -> String {
    let worst = worst_first(&solution.overlaps)
        .into_iter()
        .find_map(|pair| Some(format!("at most {} cm apart on the floor", centimetres(pair.floor_rms_m?))));
    let parts: Vec<String> = together(solution).into_iter().chain(worst).collect();
    if parts.is_empty() { String::new() } else { format!(" ({})", parts.join("; ")) }
}

fn faults(site: &Site, index: usize, camera: &SiteCamera, args: &Args) -> Vec<Fault> {
    match (&camera.solution, &camera.error) {
        (Some(solution), _) => {
            let mut faults = over_limit(solution, args);
            faults.extend(findings(site, index, camera, solution));
            faults
        }
        (None, Some(failure)) => {
            vec![Fault::of_number(format!("not solved: {}", failure.message), &failure.advice)]
        }
        (None, None) => vec![Fault::of_number("not solved", "Solve the site first.")],
    }
}

/// The findings of its solution that fail a check, and those that a pose and where things are drawn show by
/// themselves: a camera that was imported has no others.
fn findings(site: &Site, index: usize, camera: &SiteCamera, solution: &Solution) -> Vec<Fault> {
    let mut warnings: Vec<Warning> = solution.warnings.clone();
    for finding in camera.pose_findings().into_iter().chain(site.points_outside(camera)) {
        if warnings.iter().all(|warning| warning.code != finding.code()) {
            warnings.push(site.in_english(Some(index), &finding, Names::InFile));
        }
    }
    warnings.iter().filter(|warning| warning.code.fails_check()).map(Fault::from).collect()
}

/// The numbers that were judged.
fn judged(solution: &Solution) -> String {
    let floor = solution.sigma.as_ref().and_then(|sigma| sigma.floor_length_rel);
    let floor = floor.map_or_else(String::new, |rel| format!(", floor \u{b1} {:.1} %", 100.0 * rel));
    let rms = solution.rms_px.map_or_else(String::new, |rms| format!(", residuals {rms:.2} px rms"));
    format!(" ({}{floor}{rms})", crate::solve::stage_name(solution.stage))
}

/// The numbers that are over their limits.
fn over_limit(solution: &Solution, args: &Args) -> Vec<Fault> {
    let mut faults = Vec::new();
    let floor = solution.sigma.as_ref().and_then(|sigma| sigma.floor_length_rel);
    if let Some(rel) = floor.filter(|&rel| rel > args.max_floor_error) {
        let most = 100.0 * args.max_floor_error;
        faults.push(Fault::of_number(
            format!("floor lengths \u{b1} {:.1} %, allowed {most:.1} %", 100.0 * rel),
            solution.draw_next.as_ref().map_or("Draw more lines.", |next| &next.message),
        ));
    }
    let most = args.max_rms_px.unwrap_or(MAX_RMS_PX);
    match solution.rms_px {
        Some(rms) if rms > most => faults.push(Fault::of_number(
            format!("residuals {rms:.2} px rms, allowed {most:.2} px"),
            "Look at the lines with the largest residuals.",
        )),
        None if args.max_rms_px.is_some() => {
            faults.push(Fault::of_number("there are no residuals", "Draw lines on the image."));
        }
        _ => {}
    }
    faults
}
