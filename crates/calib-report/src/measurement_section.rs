//! Section of the report with the measurements of the site.

use std::fmt::Write as _;

use calib_core::floor::Measured;
use calib_site::{Measurement, MeasurementKind, Site, Units, speed_limits};

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
            Ok(found) => {
                let remark = speed_remark(measurement, found, site.units);
                let value = measurement_text(measurement, found, site.units);
                remark.map_or_else(|| value.clone(), |remark| format!("{value}. {remark}"))
            }
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
        "</tbody></table>\n<p class=\"dim foot\">The \u{b1} is one standard deviation. It includes the errors of \
         the clicks and of the calibration. Measurements do not change the calibration.</p>\n",
    );
}

/// Returns the name of a measurement: its own, otherwise its kind and number, such as "length 2".
#[must_use]
pub fn measurement_name(index: usize, measurement: &Measurement) -> String {
    let own = measurement.name.clone().or_else(|| measurement.id.clone());
    own.unwrap_or_else(|| format!("{} {}", measurement.kind.name(), index + 1))
}

/// Describes a measured value with the height of its points, such as "3.20 m ± 0.05 m, 0.6 m above the floor".
#[must_use]
pub fn measurement_text(measurement: &Measurement, found: Measured, units: Units) -> String {
    let value = measured_text(measurement.kind, found, units);
    let heights: Vec<f64> = measurement.points.iter().map(|point| point.height_m.unwrap_or(0.0)).collect();
    let of_height =
        if measurement.kind == MeasurementKind::Height { heights.get(..1) } else { Some(&heights[..]) };
    let [low, high] = of_height
        .into_iter()
        .flatten()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &at| [low.min(at), high.max(at)]);
    match (low, high) {
        (low, high) if low == 0.0 && high == 0.0 => value,
        (low, high) if low == high => format!("{value}, {} above the floor", units.trimmed_length(low)),
        _ => format!("{value}, between points at different heights"),
    }
}

/// Returns a sentence with the smallest and largest possible speed if the times are in whole seconds. Returns
/// `None` for all other measurements.
#[must_use]
pub fn speed_remark(measurement: &Measurement, found: Measured, units: Units) -> Option<String> {
    let (low, high) = speed_limits(measurement, found.value)?;
    let text = |speed: f64| units.number(speed, 2);
    let (unit, low) = (format!("{}/s", units.symbol()), text(low));
    Some(match high {
        Some(high) => {
            let limits = format!("{low} to {} {unit}", text(high));
            format!(
                "The times are in whole seconds, so the speed can be anywhere from {limits}. The \u{b1} does not \
                 include this uncertainty."
            )
        }
        None => format!(
            "The times are in whole seconds, so the speed can be anything above {low} {unit}. The \u{b1} does \
             not include this uncertainty."
        ),
    })
}

/// Returns the ids of the cameras in which a measurement was clicked.
fn cameras(measurement: &Measurement) -> String {
    let mut ids: Vec<&str> = measurement.points.iter().map(|point| point.camera.as_str()).collect();
    ids.sort_unstable();
    ids.dedup();
    shortened_list(ids)
}
