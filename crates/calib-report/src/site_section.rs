//! Section of the report about the whole site: connectivity, the largest differences between cameras, and
//! warnings.

use std::fmt::Write as _;

use calib_core::Code;
use calib_draw::{Element, elements};
use calib_site::{Overlap, Scale, Site, SiteSolution, Warning};

use crate::svg::escape;
use crate::words::{centimetres, distance, shortened_list};

/// Describes the connectivity of a site in one line: connected components, source of the scale, and loop
/// closure.
#[must_use]
pub fn connectivity_text(solution: &SiteSolution) -> Option<String> {
    let mut groups: Vec<&Vec<String>> = solution.components.iter().collect();
    groups.sort_by_key(|group| std::cmp::Reverse(group.len()));
    let (largest, others) = groups.split_first()?;
    let all: usize = groups.iter().map(|group| group.len()).sum();
    let mut line = if others.is_empty() {
        match all {
            1 => "one camera".into(),
            _ => format!("{all} cameras are connected"),
        }
    } else if largest.len() == 1 {
        format!("the {all} cameras are not connected to each other")
    } else {
        let names: Vec<String> =
            others.iter().map(|group| shortened_list(group.iter().map(String::as_str))).collect();
        let names: Vec<String> =
            others.iter().zip(names).map(|(g, n)| if g.len() > 1 { format!("({n})") } else { n }).collect();
        format!(
            "{} of {all} cameras are connected; not connected: {}",
            largest.len(),
            shortened_list(names.iter().map(String::as_str))
        )
    };
    match solution.scale {
        Some(Scale::Known) => line.push_str("; scale known"),
        Some(Scale::Unknown) => line.push_str("; scale unknown"),
        None => {}
    }
    if let Some(gap) = solution.loop_closure_m {
        let _ = write!(line, "; loop closure error {} before the refinement", distance(gap));
    }
    Some(line)
}

/// Returns the pairs of cameras sorted by measured error, then by predicted error; the largest errors are
/// first.
#[must_use]
pub fn worst_first(overlaps: &[Overlap]) -> Vec<&Overlap> {
    let mut sorted: Vec<&Overlap> = overlaps.iter().collect();
    let key = |pair: &Overlap| (pair.floor_rms_m.unwrap_or(-1.0), pair.floor_sigma_m.unwrap_or(-1.0));
    sorted.sort_by(|a, b| {
        let (a, b) = (key(a), key(b));
        b.0.total_cmp(&a.0).then(b.1.total_cmp(&a.1))
    });
    sorted
}

/// Warnings with the same code and advice.
#[derive(Clone, Debug)]
pub struct WarningGroup<'a> {
    /// Code that all warnings of the group have.
    pub code: Code,
    /// Messages of the first warnings; the last entry gives the number of further warnings, if any.
    pub messages: Vec<String>,
    /// Advice that all warnings of the group have.
    pub advice: &'a str,
}

/// Groups warnings by code and advice.
#[must_use]
pub fn group_warnings(warnings: &[Warning]) -> Vec<WarningGroup<'_>> {
    /// Largest number of lines in a group, including the line about further warnings.
    const MAX_MESSAGES: usize = 4;
    let mut kinds: Vec<WarningGroup> = Vec::new();
    for Warning { code, message, advice } in warnings {
        match kinds.iter_mut().find(|kind| kind.code == *code && kind.advice == advice) {
            Some(kind) => kind.messages.push(message.clone()),
            None => kinds.push(WarningGroup { code: *code, messages: vec![message.clone()], advice }),
        }
    }
    for WarningGroup { messages, .. } in &mut kinds {
        if messages.len() > MAX_MESSAGES {
            let more = format!("and {} more", messages.len() - (MAX_MESSAGES - 1));
            messages.truncate(MAX_MESSAGES - 1);
            messages.push(more);
        }
    }
    kinds
}

/// Largest number of visible rows in the table of camera pairs; further rows are collapsed.
const MAX_VISIBLE_PAIRS: usize = 30;
/// Largest number of visible links and marks in their table; further ones are collapsed.
const MAX_VISIBLE_ELEMENTS: usize = 15;

/// Writes the section about the whole site; writes nothing without a joint solution.
pub(crate) fn site_section(html: &mut String, site: &Site) {
    let Some(solution) = &site.solution else { return };
    html.push_str("<section id=\"the-site\"><h2>The site</h2>\n");
    if let Some(line) = connectivity_text(solution) {
        let _ = writeln!(html, "<p>{}.</p>", escape(&capitalized(&line)));
    }
    for kind in group_warnings(&solution.warnings) {
        let messages: Vec<String> = kind.messages.iter().map(|message| escape(message)).collect();
        let _ = writeln!(
            html,
            "<p class=\"note\"><b>{}</b> {}<br><i>{}</i></p>",
            kind.code,
            messages.join("<br>"),
            escape(kind.advice)
        );
    }
    html.push_str("<div class=side>\n");
    write_overlaps(html, &solution.overlaps);
    write_links(html, &elements(site));
    html.push_str("</div></section>\n");
}

/// Returns the text with a capital first letter.
fn capitalized(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// Writes a table. `rows` are sorted, the worst first; rows beyond the first `most` are collapsed.
fn write_table(html: &mut String, head: &str, rows: &[String], most: usize) {
    let _ = writeln!(html, "<table><thead><tr>{head}</tr></thead>");
    let (shown, hidden) = rows.split_at(rows.len().min(most));
    let _ = writeln!(html, "{}</table>", shown.concat());
    if !hidden.is_empty() {
        let _ = writeln!(
            html,
            "<details><summary>{} more, none worse</summary><table><thead><tr>{head}</tr></thead>{}</table></details>",
            hidden.len(),
            hidden.concat()
        );
    }
}

/// Writes the table of camera pairs with overlapping views.
fn write_overlaps(html: &mut String, overlaps: &[Overlap]) {
    if overlaps.is_empty() {
        return;
    }
    html.push_str("<div><h3>Cameras with overlapping views</h3>\n");
    html.push_str("<p class=dim>Distance between the positions of the same floor point according to two cameras. Measured: RMS over their common links and marks, including pixel noise. Predicted: one standard deviation of the calibration alone.</p>\n");
    let cell = |value: Option<f64>| value.map_or_else(|| "\u{2013}".into(), centimetres);
    let rows: Vec<String> = worst_first(overlaps)
        .into_iter()
        .map(|pair| {
            let [a, b] = pair.cameras.each_ref().map(|id| escape(id));
            format!(
                "<tr><td><a href=\"#{a}\">{a}</a> \u{2013} <a href=\"#{b}\">{b}</a><td class=n>{}<td class=n>{}</tr>\n",
                cell(pair.floor_rms_m),
                cell(pair.floor_sigma_m)
            )
        })
        .collect();
    write_table(
        html,
        "<th>Cameras<th class=n>Measured, cm<th class=n>Predicted, cm",
        &rows,
        MAX_VISIBLE_PAIRS,
    );
    html.push_str("</div>\n");
}

/// Writes the table of links and marks with their errors in each camera.
fn write_links(html: &mut String, elements: &[Element]) {
    let mut sorted: Vec<&Element> = elements.iter().filter(|element| !element.views.is_empty()).collect();
    if sorted.is_empty() {
        return;
    }
    let key = |element: &Element| (element.is_rejected, element.worst_px());
    sorted.sort_by(|a, b| {
        let (a, b) = (key(a), key(b));
        b.0.cmp(&a.0).then(b.1.total_cmp(&a.1))
    });
    html.push_str("<div class=links><h3>Links and marks</h3>\n");
    html.push_str("<p class=dim>Error in each camera: the distance from the solved position, in the image (px) and on the floor (cm).</p>\n");
    let rows: Vec<String> = sorted.into_iter().map(element_rows).collect();
    let head = "<th>Link or mark<th><th class=n>x, m<th class=n>y, m<th>Camera<th class=n>px<th class=n>cm";
    write_table(html, head, &rows, MAX_VISIBLE_ELEMENTS);
    html.push_str("</div>\n");
}

/// Returns the table rows of a link or mark, one for every camera that shows it.
fn element_rows(element: &Element) -> String {
    let note = match (element.is_rejected, element.is_off) {
        (true, _) => "rejected",
        (false, true) => "off",
        (false, false) => "",
    };
    let sigma = element.solution.sigma.as_ref();
    let at = |value: f64, sigma: Option<f64>| {
        let sigma = sigma.map_or_else(String::new, |sigma| format!(" \u{b1} {sigma:.3}"));
        format!("{value:.3}{sigma}").replace('-', "\u{2212}")
    };
    let mut row = format!("<tbody{}>", if element.is_rejected { " class=bad" } else { "" });
    for (index, view) in element.views.iter().enumerate() {
        row.push_str("<tr>");
        if index == 0 {
            let _ = write!(
                row,
                "<td rowspan={}>{} {}<td rowspan={0}>{note}<td class=n rowspan={0}>{}<td class=n rowspan={0}>{}",
                element.views.len(),
                capitalized(element.kind),
                escape(&element.id),
                at(element.solution.at_m.x, sigma.and_then(|s| s.x_m)),
                at(element.solution.at_m.y, sigma.and_then(|s| s.y_m)),
            );
        }
        let floor = view.floor_m().map_or_else(|| "\u{2013}".into(), centimetres);
        let id = escape(&view.entry.id);
        let _ = write!(row, "<td>{id}<td class=n>{:.2}<td class=n>{floor}</tr>", view.px());
    }
    row.push_str("</tbody>\n");
    row
}
