//! `calib check`: the quality gate.

use calib_core::{Method, SiteCamera, SiteSolution, Solution};

use crate::args::SiteArgs;
use crate::files::{self, SiteFile};
use crate::site_summary::{together, worst_first};
use crate::solve::Format;
use crate::stop::Stop;
use crate::words::{centimetres, few};

/// Arguments of `calib check`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    site: SiteArgs,
    /// Largest predicted relative error of lengths on the floor: 0.03 is 3 %
    #[arg(long, value_name = "REL", default_value_t = 0.03)]
    max_floor_error: f64,
    /// Largest root mean square of the residuals, in pixels
    #[arg(long, value_name = "P")]
    max_rms_px: Option<f64>,
    /// Largest distance on the floor, in metres, between where two cameras put what both show (root mean square of
    /// a pair); with it, a camera that nothing ties to the rest and an unknown scale fail, too
    #[arg(long, value_name = "M")]
    max_overlap_m: Option<f64>,
    /// How to report
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
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
    let file = args.site.read()?;
    let verdicts: Vec<(&str, Vec<String>)> =
        file.site.cameras.iter().map(|camera| (camera.id.as_str(), faults(camera, args))).collect();
    if verdicts.is_empty() {
        return Err(Stop::Unsolved(format!("{} has no cameras to check", file.path)));
    }
    let of_site = args.max_overlap_m.map(|most| site_faults(&file, most));
    report(&file, &verdicts, of_site.as_deref(), args.format)?;
    let failed = verdicts.iter().filter(|(_, faults)| !faults.is_empty()).count();
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
    verdicts: &[(&str, Vec<String>)],
    of_site: Option<&[String]>,
    format: Format,
) -> Result<(), Stop> {
    if format == Format::Json {
        let list: Vec<_> = verdicts
            .iter()
            .map(
                |(id, faults)| serde_json::json!({ "camera": id, "ok": faults.is_empty(), "faults": faults }),
            )
            .collect();
        let ok =
            verdicts.iter().all(|(_, faults)| faults.is_empty()) && of_site.is_none_or(<[String]>::is_empty);
        let mut value = serde_json::json!({ "ok": ok, "cameras": list });
        if let Some(faults) = of_site {
            value["site"] = serde_json::json!({ "ok": faults.is_empty(), "faults": faults });
        }
        return files::print(&format!("{value:#}\n"));
    }
    let verdict = |faults: &[String]| {
        if faults.is_empty() { "ok".into() } else { format!("FAILED: {}", faults.join("; ")) }
    };
    for ((id, faults), camera) in verdicts.iter().zip(&file.site.cameras) {
        let judged = camera.solution.as_ref().map(judged);
        files::print(&format!("{id}: {}{}\n", verdict(faults), judged.unwrap_or_default()))?;
    }
    let Some(faults) = of_site else { return Ok(()) };
    let judged = file.site.solution.as_ref().map(judged_site).unwrap_or_default();
    files::print(&format!("the site: {}{judged}\n", verdict(faults)))
}

/// What keeps the cameras from being one site whose positions can be relied on.
fn site_faults(file: &SiteFile, most: f64) -> Vec<String> {
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
    let warnings = solution.iter().flat_map(|s| &s.warnings).filter(|w| w.code.fails_check());
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

fn faults(camera: &SiteCamera, args: &Args) -> Vec<String> {
    match (&camera.solution, &camera.error) {
        (Some(solution), _) => gate(solution, args),
        (None, Some(failure)) => vec![format!("not solved: {}", failure.message)],
        (None, None) => vec!["not solved".into()],
    }
}

/// The numbers that were judged.
fn judged(solution: &Solution) -> String {
    let floor = solution.sigma.as_ref().and_then(|sigma| sigma.floor_length_rel);
    let floor = floor.map_or_else(String::new, |rel| format!(", floor \u{b1} {:.1} %", 100.0 * rel));
    let rms = solution.rms_px.map_or_else(String::new, |rms| format!(", residuals {rms:.2} px rms"));
    format!(" ({}{floor}{rms})", crate::solve::stage_name(solution.stage))
}

fn gate(solution: &Solution, args: &Args) -> Vec<String> {
    let mut faults = Vec::new();
    let floor = solution.sigma.as_ref().and_then(|sigma| sigma.floor_length_rel);
    if floor.is_none() && solution.method != Method::Given {
        faults.push("nothing tells how good the floor is".into());
    }
    if args.max_rms_px.is_some() && solution.rms_px.is_none() {
        faults.push("there are no residuals".into());
    }
    if let Some(rel) = floor.filter(|&rel| rel > args.max_floor_error) {
        faults.push(format!(
            "floor lengths \u{b1} {:.1} %, allowed {:.1} %",
            100.0 * rel,
            100.0 * args.max_floor_error
        ));
    }
    if let (Some(rms), Some(most)) = (solution.rms_px, args.max_rms_px)
        && rms > most
    {
        faults.push(format!("residuals {rms:.2} px rms, allowed {most:.2} px"));
    }
    faults.extend(
        solution
            .warnings
            .iter()
            .filter(|w| w.code.fails_check())
            .map(|w| format!("{}: {}", w.code, w.message)),
    );
    faults
}
