//! What the report says of the site as a whole.

use std::fmt::Write as _;

use calib_site::{Overlap, Site};

use crate::site_words::{kinds, together, worst_first};
use crate::svg::escape;
use crate::words::centimetres;
use calib_draw::{Element, elements};

/// Rows that are shown at once; the others unfold.
const PAIRS: usize = 30;
const ELEMENTS: usize = 15;

/// The section on the site; nothing for a site of which there is nothing to say.
pub(crate) fn site_section(html: &mut String, site: &Site) {
    let Some(solution) = &site.solution else { return };
    html.push_str("<section id=\"the-site\"><h2>The site</h2>\n");
    if let Some(line) = together(solution) {
        let _ = writeln!(html, "<p>{}.</p>", escape(&sentence(&line)));
    }
    for kind in kinds(&solution.warnings) {
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
    overlaps(html, &solution.overlaps);
    links(html, &elements(site));
    html.push_str("</div></section>\n");
}

fn sentence(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// A table whose rows beyond the first unfold; the worst come first.
fn table(html: &mut String, head: &str, rows: &[String], most: usize) {
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

fn overlaps(html: &mut String, overlaps: &[Overlap]) {
    if overlaps.is_empty() {
        return;
    }
    html.push_str("<div><h3>Cameras that see the same floor</h3>\n");
    html.push_str("<p class=dim>How far apart two cameras put the same thing: measured on what both show, noise of the pixels included; predicted, one sigma of the calibration alone.</p>\n");
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
    table(html, "<th>Cameras<th class=n>Measured, cm<th class=n>Predicted, cm", &rows, PAIRS);
    html.push_str("</div>\n");
}

fn links(html: &mut String, elements: &[Element]) {
    let mut sorted: Vec<&Element> = elements.iter().filter(|element| !element.views.is_empty()).collect();
    if sorted.is_empty() {
        return;
    }
    let key = |element: &Element| (element.is_aside, element.worst_px());
    sorted.sort_by(|a, b| {
        let (a, b) = (key(a), key(b));
        b.0.cmp(&a.0).then(b.1.total_cmp(&a.1))
    });
    html.push_str("<div class=links><h3>Links and marks</h3>\n");
    html.push_str("<p class=dim>How far every camera shows them from where they are, in the image and on the floor.</p>\n");
    let rows: Vec<String> = sorted.into_iter().map(row).collect();
    let head = "<th>Link or mark<th><th class=n>x, m<th class=n>y, m<th>Camera<th class=n>px<th class=n>cm";
    table(html, head, &rows, ELEMENTS);
    html.push_str("</div>\n");
}

/// One element, a line for every camera.
fn row(element: &Element) -> String {
    let note = match (element.is_aside, element.is_off) {
        (true, _) => "set aside",
        (false, true) => "off",
        (false, false) => "",
    };
    let sigma = element.found.sigma.as_ref();
    let at = |value: f64, sigma: Option<f64>| {
        let sigma = sigma.map_or_else(String::new, |sigma| format!(" \u{b1} {sigma:.3}"));
        format!("{value:.3}{sigma}").replace('-', "\u{2212}")
    };
    let mut row = format!("<tbody{}>", if element.is_aside { " class=bad" } else { "" });
    for (index, view) in element.views.iter().enumerate() {
        row.push_str("<tr>");
        if index == 0 {
            let _ = write!(
                row,
                "<td rowspan={}>{} {}<td rowspan={0}>{note}<td class=n rowspan={0}>{}<td class=n rowspan={0}>{}",
                element.views.len(),
                sentence(element.what),
                escape(&element.id),
                at(element.found.at_m.x, sigma.and_then(|s| s.x_m)),
                at(element.found.at_m.y, sigma.and_then(|s| s.y_m)),
            );
        }
        let floor = view.floor_m().map_or_else(|| "\u{2013}".into(), centimetres);
        let id = escape(&view.entry.id);
        let _ = write!(row, "<td>{id}<td class=n>{:.2}<td class=n>{floor}</tr>", view.px());
    }
    row.push_str("</tbody>\n");
    row
}
