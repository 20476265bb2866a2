//! Formats of texts and numbers for reports, and the lens of a camera.

use std::fmt::Write as _;

use calib_core::floor::Measured;
use calib_core::{Distortion, Lens, SceneErrors};
use calib_site::{MeasurementKind, Method, SiteCamera, Solution, Stage, Units};

/// Joins names to a list; a long list is shortened to "a, b, c and 997 more".
#[must_use]
pub fn shortened_list<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    /// Largest number of names in a list that is written in full.
    const MAX_FULL_LIST: usize = 6;
    /// Number of names of a longer list that are written.
    const SHOWN_NAMES: usize = 3;
    let names: Vec<&str> = names.into_iter().collect();
    if names.len() <= MAX_FULL_LIST {
        return names.join(", ");
    }
    format!("{} and {} more", names[..SHOWN_NAMES].join(", "), names.len() - SHOWN_NAMES)
}

/// Returns the number of decimals for a value with this standard deviation. Two significant digits of the
/// standard deviation are shown.
#[must_use]
pub fn decimals(sigma: f64) -> usize {
    /// Number of decimals without a valid standard deviation.
    const DEFAULT_DECIMALS: usize = 2;
    /// Largest number of decimals.
    const MAX_DECIMALS: f64 = 7.0;
    if !(sigma.is_finite() && sigma > 0.0) {
        return DEFAULT_DECIMALS;
    }
    (1.0 - sigma.log10().floor()).clamp(0.0, MAX_DECIMALS) as usize
}

/// Formats a length in metres as centimetres without the unit; lengths below one metre have one decimal.
#[must_use]
pub fn centimetres(metres: f64) -> String {
    let value = 100.0 * metres;
    if value < 100.0 { format!("{value:.1}") } else { format!("{value:.0}") }
}

/// Formats a distance given in metres, with the unit: centimetres below one metre, otherwise metres.
#[must_use]
pub fn distance(metres: f64) -> String {
    if metres < 1.0 { format!("{} cm", centimetres(metres)) } else { format!("{metres:.1} m") }
}

/// Describes the assumed accuracy of the scene (scene errors) in one sentence.
#[must_use]
pub fn scene_errors_text(errors: &SceneErrors) -> String {
    if *errors == SceneErrors::EXACT {
        return "The scene is assumed to be exact: level floor, exact right angles, equal lengths".into();
    }
    let SceneErrors { floor_tilt, crossfall, angle, length } = errors;
    let across = match crossfall.to_degrees() {
        degrees if degrees > 0.0 => {
            format!(" (plus {degrees:.1}\u{b0} at right angles to markings of equal length)")
        }
        _ => String::new(),
    };
    format!(
        "Assumed accuracy of the scene (standard deviations): floor slope {:.1}\u{b0}{across}, right angles {:.1}\u{b0}, equal lengths {:.1} %",
        floor_tilt.to_degrees(),
        angle.to_degrees(),
        100.0 * length,
    )
}

/// Describes the orientation of a camera that looks straight down; `None` for other cameras. The text
/// replaces the roll and, if the camera is placed, the yaw.
#[must_use]
pub fn straight_down_text(solution: &Solution) -> Option<String> {
    let down = solution.camera()?.straight_down()?;
    let degrees = |value: f64, sigma: Option<f64>| {
        let sure = sigma.map_or_else(String::new, |sigma| format!(" \u{b1} {:.2}", sigma.to_degrees()));
        format!("{:.2}{sure}", value.to_degrees())
    };
    let tilt = degrees(down.tilt, down.tilt_sigma);
    let mut text = format!("looks straight down (tilt {tilt} degrees)");
    if solution.stage >= Stage::Placed {
        let heading = degrees(down.heading, down.heading_sigma);
        let _ = write!(text, "; top of the image at yaw {heading} degrees");
    }
    Some(text)
}

/// Returns the lens of a camera: the solved lens, otherwise the lens as entered.
#[must_use]
pub fn camera_lens(entry: &SiteCamera) -> Lens {
    entry.solution.as_ref().map_or_else(|| entry.lens(), Solution::lens)
}

/// Whether the lens of a camera was estimated from annotations on its image or on images of other cameras
/// that share the lens.
#[must_use]
pub fn is_lens_estimated(entry: &SiteCamera) -> bool {
    let solved = entry.solution.as_ref().is_some_and(|solution| solution.method != Method::Given);
    solved && camera_lens(entry).distortion != Distortion::None && entry.lens().distortion == Distortion::None
}

/// Describes a measured value in the units of the site, such as "3.42 m ± 0.05 m".
#[must_use]
pub fn measured_text(kind: MeasurementKind, found: Measured, units: Units) -> String {
    /// Speed of one mile per hour, in metres per second.
    const MILE_PER_HOUR: f64 = 0.44704;
    let symbol = units.symbol();
    let (unit, size) = match kind {
        MeasurementKind::Length | MeasurementKind::Height => (symbol.to_owned(), units.metres()),
        MeasurementKind::Area => (format!("{symbol}\u{b2}"), units.metres() * units.metres()),
        MeasurementKind::Speed => (format!("{symbol}/s"), units.metres()),
    };
    let speed = match (kind, units) {
        (MeasurementKind::Speed, Units::Metres) => format!(" ({:.1} km/h)", 3.6 * found.value),
        (MeasurementKind::Speed, Units::Feet) => format!(" ({:.1} mph)", found.value / MILE_PER_HOUR),
        _ => String::new(),
    };
    let value = found.value / size;
    match found.sigma.map(|sigma| sigma / size) {
        Some(sigma) => {
            let digits = decimals(sigma);
            format!("{value:.digits$} {unit} \u{b1} {sigma:.digits$} {unit}{speed}")
        }
        None => format!("{value:.2} {unit}, uncertainty unknown{speed}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lists_of_names_are_cut_short() {
        assert_eq!(shortened_list(["a", "b"]), "a, b");
        let many: Vec<String> = (0..1000).map(|i| format!("c{i}")).collect();
        assert_eq!(shortened_list(many.iter().map(String::as_str)), "c0, c1, c2 and 997 more");
    }
}
