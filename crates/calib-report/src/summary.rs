//! Summary for customers at the start of the report: which cameras may be used, and why.

use std::fmt::Write as _;

use calib_core::{Code, Severity};
use calib_site::{Site, SiteCamera, Solution, Warning};

use crate::svg::escape;

/// Largest relative standard deviation of floor lengths with which a camera passes `calib check`, unless
/// another limit is given.
pub const MAX_FLOOR_ERROR_REL: f64 = 0.03;

/// Largest RMS residual in pixels with which a camera passes `calib check`, unless another limit is given.
/// Annotations and edges typically have errors of one or two pixels.
pub const MAX_RMS_PX: f64 = 5.0;

/// Reason in the summary for a camera whose lengths have an unknown common factor.
const UNKNOWN_SCALE: &str = "The scale is unknown: no height, length, distance or known point determines it.";

/// Relative standard deviation of floor lengths from which a camera is not usable.
const UNUSABLE_FLOOR_ERROR_REL: f64 = 0.10;

/// Usability of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Usability {
    /// The camera passes `calib check`.
    Good,
    /// The camera is usable after the reason is resolved.
    Check,
    /// The camera has no result, an error, or floor lengths that are too uncertain.
    Bad,
}

impl Usability {
    const ALL: [Self; 3] = [Self::Good, Self::Check, Self::Bad];

    const fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Check => "check",
            Self::Bad => "bad",
        }
    }
}

/// Row of the summary.
struct Row<'a> {
    camera: &'a SiteCamera,
    usability: Usability,
    /// Reason why the camera is not good; empty for a good camera.
    reason: String,
}

impl<'a> Row<'a> {
    fn new(site: &Site, index: usize, camera: &'a SiteCamera) -> Self {
        let (usability, reason) = match &camera.solution {
            Some(solution) => usability(site, index, solution),
            None => {
                let why = camera.error.as_ref().map_or("Not solved.", |error| &error.message);
                (Usability::Bad, why.to_owned())
            }
        };
        Self { camera, usability, reason }
    }

    fn write(&self, html: &mut String) {
        let id = escape(&self.camera.id);
        let name = self.camera.name.as_ref().map_or_else(String::new, |name| escape(name));
        let floor = floor_error_rel(self.camera.solution.as_ref())
            .filter(|rel| *rel < 1.0)
            .map_or_else(|| "\u{2013}".into(), |rel| format!("\u{b1} {:.1} %", 100.0 * rel));
        let usability = self.usability.name();
        let _ = writeln!(
            html,
            "<tr><td><a href=\"#{id}\">{id}</a><td>{name}<td class=\"mark {usability}\">{usability}\
             <td class=n>{floor}<td class=why>{}</tr>",
            escape(&self.reason)
        );
    }
}

/// Returns the predicted relative error of floor lengths; `None` if it is unknown.
fn floor_error_rel(solution: Option<&Solution>) -> Option<f64> {
    solution?.sigma.as_ref()?.floor_length_rel
}

/// Returns the usability of a solved camera and its reason. Errors come before warnings.
fn usability(site: &Site, index: usize, solution: &Solution) -> (Usability, String) {
    let mut warnings = site.failing_warnings(index);
    // A wrong focal length of a camera that looks straight down changes only heights.
    let heights_are_unknown = solution.heights_known == Some(false);
    warnings.retain(|warning| !(heights_are_unknown && warning.code == Code::FocalUnobservable));
    let first = |is_wanted: &dyn Fn(&Warning) -> bool| {
        warnings.iter().find(|warning| is_wanted(warning)).map(|warning| warning.message.clone())
    };
    if let Some(error) = first(&|warning| warning.code.severity() == Severity::Error) {
        return (Usability::Bad, error);
    }
    let floor = floor_error_rel(Some(solution));
    let inaccurate = |rel: f64| format!("Lengths on the floor are uncertain by \u{b1} {:.1} %.", 100.0 * rel);
    if let Some(rel) = floor.filter(|&rel| rel > UNUSABLE_FLOOR_ERROR_REL) {
        return (Usability::Bad, inaccurate(rel));
    }
    let large_residuals = solution
        .rms_px
        .filter(|&rms| rms > MAX_RMS_PX)
        .map(|rms| format!("The RMS residual is {rms:.1} px; the limit is {MAX_RMS_PX:.0} px."));
    let has_scale = site.cameras.get(index).is_some_and(|entry| site.scale_is_known(entry));
    let reason = first(&|_| true)
        .or_else(|| floor.filter(|&rel| rel > MAX_FLOOR_ERROR_REL).map(inaccurate))
        .or(large_residuals)
        .or_else(|| (!has_scale).then(|| UNKNOWN_SCALE.to_owned()));
    match reason {
        Some(reason) => (Usability::Check, reason),
        None => (Usability::Good, String::new()),
    }
}

/// Writes the summary: the number of cameras of each usability, and one row for each camera.
pub(crate) fn write_summary(html: &mut String, site: &Site) {
    let rows: Vec<Row<'_>> =
        site.cameras.iter().enumerate().map(|(index, camera)| Row::new(site, index, camera)).collect();
    let count = |usability| rows.iter().filter(|row| row.usability == usability).count();
    let counts: Vec<String> = Usability::ALL
        .into_iter()
        .filter(|&usability| count(usability) > 0)
        .map(|usability| {
            format!("<span class=\"mark {0}\">{1} {0}</span>", usability.name(), count(usability))
        })
        .collect();
    let plural = if rows.len() == 1 { "" } else { "s" };
    let _ = writeln!(html, "<p class=counts>{} camera{plural}: {}</p>", rows.len(), counts.join(", "));
    html.push_str(
        "<table><thead><tr><th>Camera<th>Name<th>Result<th class=n>Lengths on the floor<th>Reason</tr></thead><tbody>\n",
    );
    rows.iter().for_each(|row| row.write(html));
    let _ = writeln!(
        html,
        "</tbody></table>\n<p class=\"dim foot\">About two in three lengths have an error smaller than the \u{b1} \
         (one standard deviation). Good: lengths on the floor are accurate to \u{b1} {:.0} %, and no check failed. \
         Check: fix the stated problem before use. Bad: do not use this camera.</p>",
        100.0 * MAX_FLOOR_ERROR_REL
    );
}
