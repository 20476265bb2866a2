//! `calib check`: the quality gate.

use calib_core::{Code, Method, SiteCamera, Solution};

use crate::args::SiteArgs;
use crate::files;
use crate::solve::Format;
use crate::stop::Stop;

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
    let file = args.site.read()?.solved();
    let verdicts: Vec<(&str, Vec<String>)> =
        file.site.cameras.iter().map(|camera| (camera.id.as_str(), faults(camera, args))).collect();
    let failed = verdicts.iter().filter(|(_, faults)| !faults.is_empty()).count();
    if verdicts.is_empty() {
        return Err(Stop::Unsolved(format!("{} has no cameras to check", file.path)));
    }
    match args.format {
        Format::Json => {
            let list: Vec<_> = verdicts
                .iter()
                .map(|(id, faults)| serde_json::json!({ "camera": id, "ok": faults.is_empty(), "faults": faults }))
                .collect();
            let value = serde_json::json!({ "ok": failed == 0, "cameras": list });
            files::print(&format!("{value:#}\n"))?;
        }
        Format::Text => {
            for (id, faults) in &verdicts {
                let verdict =
                    if faults.is_empty() { "ok".into() } else { format!("FAILED: {}", faults.join("; ")) };
                let judged = file.site.camera(id).and_then(|camera| camera.solution.as_ref()).map(judged);
                files::print(&format!("{id}: {verdict}{}\n", judged.unwrap_or_default()))?;
            }
        }
    }
    if failed == 0 {
        Ok(())
    } else {
        Err(Stop::Unsolved(format!("{failed} of {} cameras fail", verdicts.len())))
    }
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
    let grave = [Code::Unusable, Code::ScaleConflict, Code::DistortionNotInvertible];
    faults.extend(
        solution
            .warnings
            .iter()
            .filter(|w| grave.contains(&w.code))
            .map(|w| format!("{}: {}", w.code, w.message)),
    );
    faults
}
