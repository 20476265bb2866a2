//! Words and numbers as the operator reads them.
//!
//! What is known of a lens, and whether it was found here.

use std::fmt::Write as _;

use calib_core::{Distortion, Lens, SceneErrors};
use calib_site::{Method, SiteCamera, Solution, Stage};

/// Names in a row, cut short: "a, b, c and 997 more".
#[must_use]
pub fn few<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    /// A list that the eye takes in is written out.
    const MOST: usize = 6;
    const SHOWN: usize = 3;
    let names: Vec<&str> = names.into_iter().collect();
    if names.len() <= MOST {
        return names.join(", ");
    }
    format!("{} and {} more", names[..SHOWN].join(", "), names.len() - SHOWN)
}

/// Decimals that a standard deviation supports: two digits of its own.
#[must_use]
pub fn decimals(sigma: f64) -> usize {
    /// Where there is none to go by.
    const USUAL: usize = 2;
    const MOST: f64 = 7.0;
    if !(sigma.is_finite() && sigma > 0.0) {
        return USUAL;
    }
    (1.0 - sigma.log10().floor()).clamp(0.0, MOST) as usize
}

/// Metres as centimetres, with a decimal as long as it says something.
#[must_use]
pub fn centimetres(metres: f64) -> String {
    let value = 100.0 * metres;
    if value < 100.0 { format!("{value:.1}") } else { format!("{value:.0}") }
}

/// A distance in the unit that suits it.
#[must_use]
pub fn distance(metres: f64) -> String {
    if metres < 1.0 { format!("{} cm", centimetres(metres)) } else { format!("{metres:.1} m") }
}

/// How far the scene may be from what is drawn.
#[must_use]
pub fn scene_errors(errors: &SceneErrors) -> String {
    if *errors == SceneErrors::EXACT {
        return "Taken for exactly what is drawn".into();
    }
    let SceneErrors { floor_tilt, crossfall, angle, length } = errors;
    let to_the_side = match crossfall.to_degrees() {
        degrees if degrees > 0.0 => format!(" and {degrees:.1}\u{b0} to the side of marks of equal length"),
        _ => String::new(),
    };
    format!(
        "One sigma: floor falls {:.1}\u{b0}{to_the_side}, corners {:.1}\u{b0} off square, equal lengths {:.1} %",
        floor_tilt.to_degrees(),
        angle.to_degrees(),
        100.0 * length,
    )
}

/// How a camera that looks straight down looks, in place of its roll and, once it stands somewhere, its yaw; `None`
/// for any other.
#[must_use]
pub fn straight_down(solution: &Solution) -> Option<String> {
    let down = solution.camera()?.straight_down()?;
    let degrees = |value: f64, sigma: Option<f64>| {
        let sure = sigma.map_or_else(String::new, |sigma| format!(" \u{b1} {:.2}", sigma.to_degrees()));
        format!("{:.2}{sure}", value.to_degrees())
    };
    let tilt = degrees(down.tilt, down.tilt_sigma);
    let mut text = format!("looks straight down, {tilt} degrees off");
    if solution.stage >= Stage::Placed {
        let heading = degrees(down.heading, down.heading_sigma);
        let _ = write!(text, "; the top of its image heads {heading} degrees, counted as yaw is");
    }
    Some(text)
}

/// The lens of a camera, which may be known where its pose is not.
#[must_use]
pub fn lens_of(entry: &SiteCamera) -> Lens {
    entry.solution.as_ref().map_or_else(|| entry.lens(), Solution::lens)
}

/// Whether the lens of a camera was found from what is drawn on its image, or on that of its like.
#[must_use]
pub fn is_fitted(entry: &SiteCamera) -> bool {
    let solved = entry.solution.as_ref().is_some_and(|solution| solution.method != Method::Given);
    solved && lens_of(entry).distortion != Distortion::None && entry.lens().distortion == Distortion::None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lists_of_names_are_cut_short() {
        assert_eq!(few(["a", "b"]), "a, b");
        let many: Vec<String> = (0..1000).map(|i| format!("c{i}")).collect();
        assert_eq!(few(many.iter().map(String::as_str)), "c0, c1, c2 and 997 more");
    }
}
