//! What `calib solve` prints of the site as a whole.

use std::fmt::Write as _;

use calib_site::{Overlap, Site, Warning};

use calib_draw::{Element, View, elements};
use calib_report::{centimetres, kinds, together, worst_first};

/// Rows of each table: the worst, whatever the size of the site.
const ROWS: usize = 5;

/// What hangs together, how far cameras disagree, the worst links, what the operator should know; nothing
/// for a site of which there is nothing to say.
pub(crate) fn site_summary(site: &Site) -> String {
    let mut out = String::new();
    let Some(solution) = &site.solution else { return out };
    out.push_str("\nsite\n");
    if let Some(line) = together(solution) {
        let _ = writeln!(out, "  {line}");
    }
    overlaps(&mut out, &solution.overlaps);
    errors(&mut out, &elements(site));
    warnings(&mut out, &solution.warnings);
    out
}

fn overlaps(out: &mut String, overlaps: &[Overlap]) {
    if overlaps.is_empty() {
        return;
    }
    let sorted = worst_first(overlaps);
    let shown = &sorted[..sorted.len().min(ROWS)];
    let names: Vec<String> = shown.iter().map(|pair| pair.cameras.join(" \u{2013} ")).collect();
    let width = names.iter().map(|name| name.chars().count()).chain([30]).max().unwrap_or(0);
    let _ = writeln!(out, "\n  {:width$} {:>9} {:>10}", "apart on the floor, cm", "measured", "predicted");
    for (pair, name) in shown.iter().zip(&names) {
        let cell = |value: Option<f64>| value.map_or_else(|| "-".into(), centimetres);
        let _ =
            writeln!(out, "  {name:width$} {:>9} {:>10}", cell(pair.floor_rms_m), cell(pair.floor_sigma_m));
    }
    more(out, sorted.len() - shown.len(), "pair", "pairs");
    let _ = writeln!(
        out,
        "  (predicted: one sigma of the calibration alone; what is measured has the noise of pixels, too)"
    );
}

/// What is not shown.
fn more(out: &mut String, hidden: usize, one: &str, many: &str) {
    if hidden > 0 {
        let what = if hidden == 1 { one } else { many };
        let _ = writeln!(out, "  and {hidden} more {what}, none worse");
    }
}

/// Views of what took part, the worst in the image first.
fn worst_views<'a>(elements: &'a [Element<'a>]) -> Vec<(&'a Element<'a>, &'a View<'a>)> {
    let used = elements.iter().filter(|element| element.is_used());
    let mut views: Vec<_> =
        used.flat_map(|element| element.views.iter().map(move |v| (element, v))).collect();
    views.sort_by(|(_, a), (_, b)| b.px().total_cmp(&a.px()));
    views
}

fn errors(out: &mut String, elements: &[Element]) {
    let views = worst_views(elements);
    if views.is_empty() {
        return;
    }
    let shown = &views[..views.len().min(ROWS)];
    let names: Vec<String> = shown
        .iter()
        .map(|(element, view)| format!("{} {} in {}", element.what, element.id, view.entry.id))
        .collect();
    let width = names.iter().map(|name| name.chars().count()).chain([30]).max().unwrap_or(0);
    let _ = writeln!(out, "\n  {:width$} {:>9} {:>10}", "worst of links and marks", "px", "cm");
    for ((_, view), name) in shown.iter().zip(&names) {
        let floor = view.floor_m().map_or_else(|| "-".into(), centimetres);
        let _ = writeln!(out, "  {name:width$} {:>9.2} {floor:>10}", view.px());
    }
    more(out, views.len() - shown.len(), "view", "views");
}

fn warnings(out: &mut String, warnings: &[Warning]) {
    for (index, kind) in kinds(warnings).iter().enumerate() {
        if index == 0 && !out.ends_with("site\n") {
            out.push('\n');
        }
        for message in &kind.messages {
            let _ = writeln!(out, "  {}: {message}", kind.code);
        }
        let _ = writeln!(out, "    {}", kind.advice);
    }
}
