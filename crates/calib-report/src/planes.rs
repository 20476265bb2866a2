//! Solved planes other than the floor, as text and as a section of the report.

use std::fmt::Write as _;

use calib_core::Surface;

use calib_site::Site;

use crate::svg::escape;

/// Solution of a plane, formatted as one line of a table.
pub(crate) struct PlaneRow<'a> {
    pub(crate) title: &'a str,
    pub(crate) height: String,
    pub(crate) fall: String,
    /// Direction in which the plane falls; a dash if the fall is not significant.
    pub(crate) toward: String,
}

/// Returns the solved planes in the order of the file.
pub(crate) fn solved_planes(site: &Site) -> Vec<PlaneRow<'_>> {
    let planes = site.planes.iter().zip(site.surfaces());
    let solved = planes.filter(|(entry, _)| entry.solution.is_some());
    solved.map(|(entry, surface)| PlaneRow::new(entry.title(), &surface)).collect()
}

impl<'a> PlaneRow<'a> {
    fn new(title: &'a str, surface: &Surface) -> Self {
        let (plane, sigmas) = (&surface.plane, surface.sigmas());
        let with_sigma =
            |value: f64, sigma: f64, digits: usize| format!("{value:.digits$} \u{b1} {sigma:.digits$}");
        let [fall, fall_sigma] = [plane.fall(), sigmas.fall].map(f64::to_degrees);
        // A direction with a standard deviation above 90° is meaningless.
        let toward = sigmas.toward.map(f64::to_degrees).filter(|&sigma| sigma < 90.0);
        let direction = plane.toward().to_degrees().rem_euclid(360.0);
        Self {
            title,
            height: with_sigma(plane.height, sigmas.height, 3),
            fall: with_sigma(fall, fall_sigma, 2),
            toward: toward.map_or_else(|| "-".into(), |sigma| with_sigma(direction, sigma, 1)),
        }
    }
}

/// Returns the table of solved planes as text; empty without solved planes.
#[must_use]
pub fn planes_text(site: &Site) -> String {
    let planes = solved_planes(site);
    let mut out = String::new();
    let width = planes.iter().map(|plane| plane.title.chars().count()).max().unwrap_or(0).max(6);
    for (index, PlaneRow { title, height, fall, toward }) in planes.iter().enumerate() {
        if index == 0 {
            let _ = writeln!(
                out,
                "\n{:width$}  {:>15} {:>14} {:>14}",
                "plane", "height m", "slope deg", "towards deg"
            );
        }
        let _ = writeln!(out, "{title:width$}  {height:>15} {fall:>14} {toward:>14}");
    }
    out
}

/// Writes the section about the solved planes; writes nothing without solved planes.
pub(crate) fn planes_section(html: &mut String, site: &Site) {
    let planes = solved_planes(site);
    if planes.is_empty() {
        return;
    }
    html.push_str("<section id=\"the-planes\"><h2>Planes</h2>\n<p class=dim>Planes other than the floor. Heights apply to the mean of the region's corners. Directions are counter-clockwise from +x.</p>\n<table><thead><tr><th>Plane<th class=n>Height, m<th class=n>Slope, \u{b0}<th class=n>Slopes towards, \u{b0}</tr></thead>\n");
    for PlaneRow { title, height, fall, toward } in &planes {
        let [height, fall, toward] = [height, fall, toward].map(|number| number.replace('-', "\u{2212}"));
        let _ = writeln!(
            html,
            "<tr><td>{}<td class=n>{height}<td class=n>{fall}<td class=n>{toward}</tr>",
            escape(title)
        );
    }
    html.push_str("</table></section>\n");
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a site with a ramp that falls by 3° toward +y, and a platform with a known height only.
    fn site() -> Option<Site> {
        let steep = 3_f64.to_radians().tan();
        let text = format!(
            r#"{{"format": "calib-site", "version": 1, "planes": [
                {{"id": "ramp", "name": "North <ramp>", "solution": {{"height_m": 0.4, "slope": [0, {}],
                    "covariance": [4e-4, 0, 0, 1e-4, 0, 1e-4]}}}},
                {{"id": "deck", "solution": {{"height_m": -1.2, "slope": [0, 1e-4],
                    "covariance": [1e-4, 0, 0, 1e-4, 0, 1e-4]}}}},
                {{"id": "given", "height_m": 2}}]}}"#,
            -steep
        );
        Site::from_json(&text).ok()
    }

    #[test]
    fn solved_planes_are_listed_with_their_uncertainty() {
        let text = site().map(|site| planes_text(&site)).unwrap_or_default();
        let lines: Vec<Vec<&str>> =
            text.lines().skip(2).map(|line| line.split_whitespace().collect()).collect();
        let [ramp, deck] = &lines[..] else { panic!("{text}") };
        assert_eq!(
            ramp[2..],
            ["0.400", "\u{b1}", "0.020", "3.00", "\u{b1}", "0.57", "90.0", "\u{b1}", "10.9"]
        );
        assert_eq!(deck[1..4], ["-1.200", "\u{b1}", "0.010"]);
        assert_eq!(deck.last(), Some(&"-"), "an insignificant fall has no direction");
    }

    #[test]
    fn a_report_has_a_section_only_with_solved_planes() {
        let mut html = String::new();
        planes_section(&mut html, &Site::new());
        assert!(html.is_empty());
        if let Some(site) = site() {
            planes_section(&mut html, &site);
        }
        assert!(html.contains("North &lt;ramp&gt;") && html.contains("0.400 \u{b1} 0.020"), "{html}");
        assert!(html.contains("\u{2212}1.200") && !html.contains("given"), "{html}");
    }
}
