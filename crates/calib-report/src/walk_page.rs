//! Result of an acceptance walk through a site, as text and as a page to sign.

use std::fmt::Write as _;

use calib_core::FloorPoint;

use calib_health::{Disagreement, WalkResult, Zone, Zones};

use calib_draw::Rgb;
use calib_site::counted;

use crate::frame::{PAGE_END, page_start};
use crate::svg::{Anchor, Stroke, Svg, escape};
use crate::words::{centimetres, shortened_list};

/// Result of an acceptance walk, with the decision whether the site passed.
#[derive(Clone, Copy, Debug)]
pub struct WalkPage<'a> {
    /// Title of the site.
    pub title: &'a str,
    /// Ids of the cameras, by the camera index of the result.
    pub names: &'a [String],
    /// Result of the walk.
    pub result: &'a WalkResult,
    /// Results of the walk for each zone of the floor.
    pub zones: &'a Zones,
    /// Reasons why the site failed; empty if it passed.
    pub faults: &'a [String],
}

/// Returns the name of a zone: letters for the column and a number for the row, as in "A1".
#[must_use]
pub fn zone_name(zone: &Zone) -> String {
    let [column, row] = zone.cell;
    let letter = |index: usize| char::from(b'A' + (index % 26) as u8);
    let first = if column >= 26 { letter(column / 26 - 1).to_string() } else { String::new() };
    format!("{first}{}{}", letter(column), row + 1)
}

/// Describes the mean offset of the walker positions according to one camera, and the most likely error of
/// this camera.
#[must_use]
pub fn disagreement_text(one: &Disagreement) -> String {
    let [x, y] = one.shift;
    let toward = |value: f64, axis: &str| {
        let sign = if value < 0.0 { '\u{2212}' } else { '+' };
        format!("{} cm too far towards {sign}{axis}", centimetres(value.abs()))
    };
    format!(
        "places the walker {} and {} (\u{b1} {} cm); most likely error: {}",
        toward(x, "x"),
        toward(y, "y"),
        centimetres(one.shift_sigma),
        error_text(&one.errors)
    )
}

/// Describes the most likely error of a camera. Only one of the errors is not zero: x, y, z (metres), yaw, pitch,
/// roll (radians) or focal length (pixels).
fn error_text(errors: &[f64; 7]) -> String {
    let [x, y, z, yaw, pitch, roll, focal] = *errors;
    let length = |name, value: f64| (name, value, format!("{:+.0} cm", 100.0 * value));
    let angle = |name, value: f64| (name, value, format!("{:+.2}\u{b0}", value.to_degrees()));
    let focal = ("focal length", focal, format!("{focal:+.1} px"));
    let all = [
        length("x", x),
        length("y", y),
        length("height", z),
        angle("yaw", yaw),
        angle("pitch", pitch),
        angle("roll", roll),
        focal,
    ];
    let largest = all.into_iter().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    largest.map_or_else(String::new, |(name, _, value)| format!("{name} {value}"))
}

impl WalkPage<'_> {
    /// Returns the result as text.
    #[must_use]
    pub fn text(&self) -> String {
        let mut out = format!("{}\n", self.decision());
        for (index, name) in self.names.iter().enumerate() {
            let _ = writeln!(out, "{name}: {}", self.camera(index));
        }
        for zone in self.zones.list.iter().filter(|zone| zone.error.is_some()) {
            let _ = writeln!(out, "zone {}: {}", zone_name(zone), error(zone));
        }
        let _ = writeln!(out, "zones not walked: {}", self.not_walked());
        out
    }

    /// Returns the decision as a sentence.
    fn decision(&self) -> String {
        if self.faults.is_empty() { "PASSED".into() } else { format!("FAILED: {}", self.faults.join("; ")) }
    }

    fn camera(&self, index: usize) -> String {
        let together = self.result.shared_moments[index];
        match self.result.disagreements.iter().find(|one| one.camera == index) {
            Some(one) => {
                format!("disagrees ({:.1} standard deviations): {}", one.significance, disagreement_text(one))
            }
            None if together == 0 => "not tested: no other camera saw the walker at the same time".into(),
            None => format!("agrees with the other cameras ({})", counted(together, "moment", "moments")),
        }
    }

    /// Returns the names of the zones that the walker did not enter as a shortened list, or "none".
    fn not_walked(&self) -> String {
        let names: Vec<String> =
            self.zones.list.iter().filter(|zone| zone.moments == 0).map(zone_name).collect();
        if names.is_empty() { "none".into() } else { shortened_list(names.iter().map(String::as_str)) }
    }

    /// Returns the result as a self-contained HTML page.
    #[must_use]
    pub fn html(&self) -> String {
        let mut html = page_start(self.title);
        self.section(&mut html);
        html.push_str(PAGE_END);
        html
    }

    /// Writes the result as a section of the report.
    pub(crate) fn section(&self, html: &mut String) {
        let class = if self.faults.is_empty() { "note good" } else { "note bad" };
        let _ =
            writeln!(html, "<h2>Acceptance walk</h2><p class=\"{class}\">{}</p>", escape(&self.decision()));
        let _ = writeln!(html, "<figure>{}</figure>", self.plan());
        html.push_str("<table><thead><tr><th>Camera<th>Result</tr></thead><tbody>\n");
        for (index, name) in self.names.iter().enumerate() {
            let _ = writeln!(html, "<tr><td>{}<td>{}</tr>", escape(name), escape(&self.camera(index)));
        }
        html.push_str(
            "</tbody></table>\n<h2>Floor error by zone</h2><table><thead><tr><th>Zone<th class=n>x, m<th class=n>y, m\
             <th class=n>Moments<th>Floor error</tr></thead><tbody>\n",
        );
        for zone in &self.zones.list {
            let FloorPoint { x, y } = zone.corner;
            let _ = writeln!(
                html,
                "<tr><td>{}<td class=n>{x:.1}<td class=n>{y:.1}<td class=n>{}<td>{}</tr>",
                zone_name(zone),
                zone.moments,
                error(zone)
            );
        }
        html.push_str("</tbody></table>\n<p>Name, date, signature: ________________________________</p>\n");
    }

    /// Returns an SVG of the zones from above, shaded by their error, with the path of the walker.
    fn plan(&self) -> String {
        let Zones { side, list } = self.zones;
        let fold =
            |pick: fn(f64, f64) -> f64, of: fn(&Zone) -> f64| list.iter().map(of).reduce(pick).unwrap_or(0.0);
        let low = [fold(f64::min, |zone| zone.corner.x), fold(f64::min, |zone| zone.corner.y)];
        let high = [fold(f64::max, |zone| zone.corner.x) + side, fold(f64::max, |zone| zone.corner.y) + side];
        let scale = 1000.0 / (high[0] - low[0]).max(*side);
        let size = [1000.0, ((high[1] - low[1]) * scale).max(1.0)];
        let mut svg = Svg::new(size, 1.0);
        // World +y points up on the page, against the y axis of the SVG.
        let at = |point: FloorPoint| [(point.x - low[0]) * scale, size[1] - (point.y - low[1]) * scale];
        let line = Stroke { outlined: false, ..Stroke::new(Rgb::INK, 1.0) };
        for zone in list {
            let FloorPoint { x, y } = zone.corner;
            let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
                .map(|[a, b]| at(FloorPoint::new(x + a * side, y + b * side)));
            if let Some(error) = zone.error {
                /// Smallest error with the darkest shade, in metres.
                const MAX_SHADED_ERROR_M: f64 = 0.5;
                svg.fill(&corners, Rgb::BAD_ON_LIGHT, (0.6 * error / MAX_SHADED_ERROR_M).min(0.6));
            }
            svg.line(&corners, true, line.faint(0.3));
            let [left, top] = corners[3];
            svg.ink([left + 3.0, top + 13.0], &zone_name(zone), Rgb::INK, Anchor::Start);
            if let Some(error) = zone.error {
                let text = format!("{} cm", centimetres(error));
                svg.ink([left + 3.0, top + 28.0], &text, Rgb::INK, Anchor::Start);
            }
        }
        for moment in &self.result.moments {
            let half = 1.5;
            let [x, y] = at(moment.position);
            svg.line(&[[x - half, y], [x + half, y]], false, Stroke { width: 3.0, ..line }.faint(0.7));
        }
        let [w, h] = size;
        svg.finish(&format!(r#"<rect width="{w}" height="{h}" fill="white"/>"#))
    }
}

fn error(zone: &Zone) -> String {
    match (zone.error, zone.error_sigma) {
        (Some(error), Some(sigma)) => {
            let moments = counted(zone.shared_moments, "moment", "moments");
            format!("{} \u{b1} {} cm ({moments})", centimetres(error), centimetres(sigma))
        }
        _ if zone.moments > 0 => "seen by only one camera".into(),
        _ => "not walked".into(),
    }
}
