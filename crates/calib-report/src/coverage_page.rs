//! Coverage of a site, as text and as a page for the customer.

use std::fmt::Write as _;

use calib_core::floor::{DensityLevel, HandOver, LevelLimits, Reach};
use calib_site::{AreaResult, Site, SiteCamera, SiteCoverage, Units};

use crate::coverage_layer::{level_text, levels};
use crate::frame::{PAGE_END, page_start};
use crate::svg::escape;
use crate::words::{decimals, shortened_list};

/// Coverage of a site for a height of the targets.
#[derive(Clone, Copy, Debug)]
pub struct CoveragePage<'a> {
    /// Site.
    pub site: &'a Site,
    /// Coverage of the site.
    pub coverage: &'a SiteCoverage<'a>,
}

impl CoveragePage<'_> {
    /// Returns the coverage as text.
    #[must_use]
    pub fn text(&self) -> String {
        let mut out = format!("{}\n", self.summary());
        for (level, area) in self.levels() {
            let _ = writeln!(out, "{}: {}", level_text(level, &self.coverage.limits), self.area(area));
        }
        for (entry, reaches) in self.coverage.cameras.iter().zip(self.coverage.reaches()) {
            let _ = writeln!(out, "{}: {}", entry.id, self.reaches_text(&reaches));
        }
        for result in &self.coverage.areas {
            let _ = writeln!(out, "area {}: {}", result.area.id, area_text(result));
        }
        for zone in &self.coverage.hand_overs {
            let ([a, b], text) =
                (self.coverage.ids_of(zone), hand_over_text(self.coverage, zone, self.site.units));
            let _ = writeln!(
                out,
                "hand-over {a} \u{2013} {b}: {}; expected disagreement {text}",
                self.area(self.coverage.area_of(zone))
            );
        }
        out
    }

    /// Returns the coverage as a self-contained HTML page. `figure` is the SVG code of the plan view.
    #[must_use]
    pub fn html(&self, figure: &str) -> String {
        let mut html = page_start(self.site.name.as_deref().unwrap_or("Coverage"));
        self.section(&mut html, figure);
        html.push_str(PAGE_END);
        html
    }

    /// Writes the coverage as a section of a report. `figure` is the SVG code of the plan view.
    pub(crate) fn section(&self, html: &mut String, figure: &str) {
        let _ = writeln!(html, "<h2>Coverage</h2><p>{}</p>", escape(&self.summary()));
        for note in self.notes() {
            let _ = writeln!(html, "<p class=\"note bad\">{}</p>", escape(&note));
        }
        let _ = writeln!(html, "<figure>{figure}</figure>");
        html.push_str(
            "<p class=dim>The pixel density is the number of pixels that show one metre of a person or object. \
             At \u{201c}recognise\u{201d}, for example, an operator can recognise a known person. ",
        );
        html.push_str(match self.coverage.limits == LevelLimits::default() {
            true => "The levels follow EN 62676-4.</p>\n",
            false => {
                "The names of the levels follow EN 62676-4. The limits were entered for this site.</p>\n"
            }
        });
        self.write_areas(html);
        html.push_str("<h3>Visible floor area at each level</h3><table><thead><tr><th>Level<th class=n>Area</tr></thead><tbody>\n");
        for (level, area) in self.levels() {
            let (level, area) = (escape(&level_text(level, &self.coverage.limits)), self.area(area));
            let _ = writeln!(html, "<tr><td>{level}<td class=n>{area}</tr>");
        }
        let symbol = self.site.units.symbol();
        let _ = write!(
            html,
            "</tbody></table>\n<h3>Farthest distance at each level, {symbol}</h3><table><thead><tr><th>Camera"
        );
        for level in DensityLevel::ALL {
            let _ = write!(html, "<th class=n>{}", level.name());
        }
        html.push_str("</tr></thead><tbody>\n");
        for (entry, reaches) in self.coverage.cameras.iter().zip(self.coverage.reaches()) {
            let _ = write!(html, "<tr><td>{}", escape(&entry.id));
            for reach in reaches {
                let text =
                    reach.map_or_else(|| "\u{2013}".into(), |reach| reach_text(&reach, self.site.units));
                let _ = write!(html, "<td class=n>{text}");
            }
            html.push_str("</tr>\n");
        }
        html.push_str(
            "</tbody></table>\n<p class=dim>\u{201c}\u{2265}\u{201d}: the camera reaches the level as far as it sees the floor.</p>\n",
        );
        self.write_hand_overs(html);
    }

    /// Writes the largest hand-over zones.
    fn write_hand_overs(&self, html: &mut String) {
        /// Largest number of zones in the table.
        const MAX_ZONES: usize = 50;
        let zones = &self.coverage.hand_overs;
        if zones.is_empty() {
            return;
        }
        html.push_str(
            "<h3>Hand-over zones</h3><p class=dim>Floor area that two cameras see. Both compute the position \
             of the same target. The expected disagreement is the RMS distance between the two positions. It \
             includes the errors of the calibration, for targets exactly at the stated height. It does not \
             include the errors of a detector or of the height.</p>\n<table><thead><tr><th>Cameras<th class=n>Area<th>Expected disagreement</tr></thead><tbody>\n",
        );
        for zone in zones.iter().take(MAX_ZONES) {
            let [a, b] = self.coverage.ids_of(zone).map(escape);
            let area = self.area(self.coverage.area_of(zone));
            let text = escape(&hand_over_text(self.coverage, zone, self.site.units));
            let _ = writeln!(html, "<tr><td>{a} \u{2013} {b}<td class=n>{area}<td>{text}</tr>");
        }
        html.push_str("</tbody></table>\n");
        if zones.len() > MAX_ZONES {
            let _ =
                writeln!(html, "<p class=dim>Smaller zones, not listed: {}.</p>", zones.len() - MAX_ZONES);
        }
    }

    fn write_areas(&self, html: &mut String) {
        if self.coverage.areas.is_empty() {
            return;
        }
        html.push_str(
            "<h3>Areas of interest</h3><table><thead><tr><th>Area<th>Required<th class=n>Reached<th class=n>Blind<th class=n>Lowest density, px/m<th>Result</tr></thead><tbody>\n",
        );
        for result in &self.coverage.areas {
            let name = escape(result.area.name.as_deref().unwrap_or(&result.area.id));
            let level = result.level.map_or("visible", DensityLevel::name);
            let (share, blind, worst) = match result.coverage {
                Some(found) => (
                    percent(found.share),
                    percent(found.blind_share),
                    found.worst_density.map_or_else(|| "\u{2013}".into(), |worst| format!("{worst:.0}")),
                ),
                None => ("\u{2013}".into(), "\u{2013}".into(), "\u{2013}".into()),
            };
            let decision = if result.is_met() { "<td>met" } else { "<td class=bad>missed" };
            let _ = writeln!(
                html,
                "<tr><td>{name}<td>{level}<td class=n>{share}<td class=n>{blind}<td class=n>{worst}{decision}</tr>"
            );
        }
        html.push_str("</tbody></table>\n");
    }

    /// Returns sentences about cameras that are left out, and about cameras whose scale is assumed.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        let names = |entries: &[&SiteCamera]| shortened_list(entries.iter().map(|entry| entry.id.as_str()));
        let mut notes = Vec::new();
        if !self.coverage.left_out.is_empty() {
            notes.push(format!(
                "Cameras without a position relative to the others are left out: {}. Place them on \
                 the plan, or link them.",
                names(&self.coverage.left_out)
            ));
        }
        if !self.coverage.scale_assumed.is_empty() {
            notes.push(format!(
                "The scale of these cameras is assumed: {}. Their distances and pixel densities can be wrong \
                 by a common factor: enter a height or a length.",
                names(&self.coverage.scale_assumed)
            ));
        }
        notes
    }

    /// Describes the visible floor in one sentence.
    fn summary(&self) -> String {
        let seen =
            |least: usize| self.coverage.visible_area(|at| self.coverage.coverage.seen_by[at] >= least);
        let target = match self.coverage.height {
            0.0 => "on the floor".into(),
            height => format!("at a height of {}", self.length(height)),
        };
        format!(
            "The cameras see {} of floor; two or more cameras see {} of it. Targets are {target}.",
            self.area(seen(1)),
            self.area(seen(2))
        )
    }

    /// Formats an area, given in square metres, in the units of the site.
    fn area(&self, area: f64) -> String {
        let units = self.site.units;
        format!("{:.1} {}\u{b2}", area / units.metres().powi(2), units.symbol())
    }

    /// Formats a length, given in metres, in the units of the site.
    fn length(&self, length: f64) -> String {
        let units = self.site.units;
        let hundredths = (100.0 * length / units.metres()).round() / 100.0;
        format!("{hundredths} {}", units.symbol())
    }

    /// Returns the visible floor area at each level, in square metres.
    fn levels(&self) -> impl Iterator<Item = (Option<DensityLevel>, f64)> {
        let reached = |at: usize| self.coverage.limits.reached_by(self.coverage.coverage.density[at]);
        levels().map(move |level| (level, self.coverage.visible_area(|at| reached(at) == level)))
    }

    /// Describes how far a camera reaches each level.
    fn reaches_text(&self, reaches: &[Option<Reach>]) -> String {
        let reaches = DensityLevel::ALL.iter().zip(reaches).rev();
        let of = |(level, reach): (&DensityLevel, &Option<Reach>)| {
            let units = self.site.units;
            Some(format!("{} to {} {}", level.name(), reach_text(reach.as_ref()?, units), units.symbol()))
        };
        let parts: Vec<String> = reaches.filter_map(of).collect();
        if parts.is_empty() { "reaches no level".into() } else { parts.join(", ") }
    }
}

/// Describes the expected disagreement of a hand-over zone, as in "8.0 cm RMS, 21.0 cm at the worst point".
pub fn hand_over_text(coverage: &SiteCoverage<'_>, zone: &HandOver, units: Units) -> String {
    match &zone.disagreement {
        Ok(found) => {
            let [usual, worst] = [found.rms, found.worst].map(|length| units.short_length(length));
            format!("{usual} RMS, {worst} at the worst point")
        }
        Err(why) => coverage.unknown_text(*why),
    }
}

/// Formats the farthest distance of a level, without the unit.
fn reach_text(reach: &Reach, units: Units) -> String {
    let distance = reach.distance / units.metres();
    match (reach.is_limited_by_density, reach.sigma.map(|sigma| sigma / units.metres())) {
        (false, _) => format!("\u{2265} {distance:.1}"),
        (true, Some(sigma)) => {
            let digits = decimals(sigma).min(2);
            format!("{distance:.digits$} \u{b1} {sigma:.digits$}")
        }
        (true, None) => format!("{distance:.1}"),
    }
}

/// Describes the coverage of an area, as in "98.2 % recognise, 1.8 % blind, lowest 41 px/m: missed".
fn area_text(result: &AreaResult<'_>) -> String {
    let Some(found) = result.coverage else { return "the polygon has no area, or is too narrow".into() };
    let level = result.level.map_or("visible", DensityLevel::name);
    let worst = found.worst_density.map_or_else(String::new, |worst| format!(", lowest {worst:.0} px/m"));
    let decision = if result.is_met() { "met" } else { "missed" };
    format!("{} {level}, {} blind{worst}: {decision}", percent(found.share), percent(found.blind_share))
}

/// Formats a share, 0 to 1, as a percentage. Only exactly 1 is shown as 100 %, and only exactly 0 as 0 %.
fn percent(share: f64) -> String {
    let shown = (1000.0 * share).round() / 10.0;
    let shown = if share < 1.0 && shown >= 100.0 { 99.9 } else { shown };
    let shown = if share > 0.0 && shown <= 0.0 { 0.1 } else { shown };
    format!("{shown:.1} %")
}
