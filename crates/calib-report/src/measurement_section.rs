//! Section of the report with the measurements of the site.

use std::fmt::Write as _;

use calib_site::{Measurement, Site};

use crate::svg::escape;
use crate::words::{measured_text, shortened_list};

/// Writes the measurements with their values and standard deviations, if the site has any.
pub(crate) fn measurement_section(html: &mut String, site: &Site) {
    if site.measurements.is_empty() {
        return;
    }
    html.push_str(
        "<h2>Measurements</h2><table><thead><tr><th>Measurement<th>Value<th>Cameras</tr></thead><tbody>\n",
    );
    for (index, measurement) in site.measurements.iter().enumerate() {
        let value = match site.measure(measurement) {
            Ok(found) => measured_text(measurement.kind, found, site.units),
            Err(why) => why.to_string(),
        };
        let _ = writeln!(
            html,
            "<tr><td>{}<td class=why>{}<td>{}</tr>",
            escape(&measurement_name(index, measurement)),
            escape(&value),
            escape(&cameras(measurement))
        );
    }
    html.push_str(
        "</tbody></table>\n<p class=\"dim foot\">The \u{b1} is one standard deviation. It contains the errors of the \
         clicks and of the calibration. Measurements do not change the calibration.</p>\n",
    );
}

/// Returns the name of a measurement: its own, otherwise its kind and number, such as "length 2".
#[must_use]
pub fn measurement_name(index: usize, measurement: &Measurement) -> String {
    let own = measurement.name.clone().or_else(|| measurement.id.clone());
    own.unwrap_or_else(|| format!("{} {}", measurement.kind.name(), index + 1))
}

/// Returns the ids of the cameras in which a measurement was clicked.
fn cameras(measurement: &Measurement) -> String {
    let mut ids: Vec<&str> = measurement.points.iter().map(|point| point.camera.as_str()).collect();
    ids.sort_unstable();
    ids.dedup();
    shortened_list(ids)
}
