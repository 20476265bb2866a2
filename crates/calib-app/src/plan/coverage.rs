//! Measured coverage. The floor plan shows the visible floor in colours for the pixel density or the number of cameras,
//! with a legend. The images show the borders of the levels.

use calib_report::level_colour;
use calib_site::Site;
use egui::{Align2, Color32, ComboBox, Frame, Mesh, Painter, Pos2, Rect, RichText, Shape, Stroke, Ui, Vec2};

use crate::canvas::Mapping;
use crate::paint::{Pen, handle, line, tag};
use crate::state::{App, Computed, Shading, ShownBorder, ShownCoverage};
use crate::theme::{self, colour, on_image};
use crate::widgets::{decimals, number};

/// Target: name, and height above the floor in metres.
type Target = (&'static str, f64);

/// Targets to choose from, with usual heights.
const TARGETS: [Target; 3] = [("the floor", 0.0), ("number plates", 0.6), ("faces", 1.6)];

/// Opacity of the colours over the plan.
const OPACITY: f32 = 0.66;

/// Computes the coverage of the open site again if its inputs have changed.
pub(crate) fn update_coverage(app: &mut App) {
    let mut shown = app.coverage.take().unwrap_or_default();
    shown.update(app.editor.session());
    app.coverage = Some(shown);
}

/// Paints the levels, the walls, the areas of interest, and the hand-over zone whose list row is under the pointer.
pub(crate) fn paint_coverage(
    shown: Option<&ShownCoverage>,
    site: &Site,
    painter: &Painter,
    mapping: &Mapping,
) {
    let found = shown.and_then(|shown| shown.result.as_ref().ok());
    let mut mesh = Mesh::default();
    for rectangle in found.into_iter().flat_map(|found| &found.rectangles) {
        let base = mesh.vertices.len() as u32;
        let fill = colour(rectangle.value).gamma_multiply(OPACITY);
        for corner in rectangle.corners() {
            mesh.colored_vertex(mapping.screen(corner.into()), fill);
        }
        mesh.add_triangle(base, base + 1, base + 2);
        mesh.add_triangle(base, base + 2, base + 3);
    }
    painter.add(Shape::mesh(mesh));
    paint_survey(site, found, painter, mapping);
    let pointed = shown.and_then(|shown| shown.pointed).zip(found);
    if let Some(zone) = pointed.and_then(|(index, found)| found.hand_overs.get(index)) {
        let at = mapping.screen(zone.middle.into());
        let text = zone.cameras.join(" \u{2013} ");
        handle(painter, at, on_image::WAITING);
        tag(painter, at + Vec2::new(0.0, 14.0), Align2::CENTER_TOP, &text, on_image::WHITE);
    }
}

/// Paints the borders of the levels in the image of a camera, if the coverage is shown. No border is painted while the
/// scale is unknown.
///
/// Returns the labels with their screen positions. A label contains the level, its limit, and the standard deviation of
/// the border on the floor.
pub(crate) fn paint_borders(
    app: &mut App,
    camera: usize,
    painter: &Painter,
    mapping: &Mapping,
) -> Vec<(Pos2, String)> {
    let session = app.editor.session();
    let is_shown = app.view.coverage && !app.view.layers.hidden && session.solved.scale_is_known(camera);
    let pose = session.solved.pose(camera).copied().filter(|_| is_shown);
    let Some((pose, entry)) = pose.zip(session.site.cameras.get(camera)) else { return Vec::new() };
    let (units, size, limits) = (session.site.units, entry.size(), session.site.level_limits());
    let borders = app.coverage.get_or_insert_default().borders(camera, &pose, size, limits);
    for border in borders.iter().map(|shown| &shown.border) {
        let paths: Vec<Vec<Pos2>> = border.segments.iter().map(|ends| mapping.path(ends)).collect();
        for pen in [Pen::new(on_image::WHITE, 4.0), Pen::new(colour(level_colour(Some(border.level))), 2.0)] {
            paths.iter().for_each(|path| line(painter, path, pen));
        }
    }
    let label = |shown: &ShownBorder| {
        let (pixel, sigma) = shown.label?;
        let level = shown.border.level;
        let sigma = sigma.map_or_else(String::new, |sigma| {
            let sigma = sigma / units.metres();
            format!(", border \u{b1} {} {}", number(sigma, decimals(sigma)), units.symbol())
        });
        let text = format!("{}: {} px/m{sigma}", level.name(), limits.of(level));
        Some((mapping.screen(pixel.into()), text))
    };
    borders.iter().filter_map(label).collect()
}

/// Paints walls, and the outlines of the areas of interest, with their results once they are computed.
fn paint_survey(site: &Site, found: Option<&Computed>, painter: &Painter, mapping: &Mapping) {
    for wall in &site.walls {
        let ends = [wall.from_m, wall.to_m].map(|end| mapping.screen(end.into()));
        line(painter, &ends, Pen::new(Color32::BLACK, 4.0));
    }
    for (index, area) in site.areas.iter().enumerate() {
        let is_met = found.and_then(|found| found.results.get(index)).map(|(_, is_met)| *is_met);
        let corners: Vec<Pos2> = area
            .polygon_m
            .iter()
            .chain(area.polygon_m.first())
            .map(|&corner| mapping.screen(corner.into()))
            .collect();
        let pen = if is_met == Some(false) { on_image::BAD } else { on_image::WHITE };
        line(painter, &corners, Pen::new(pen, 2.0));
        let count = area.polygon_m.len().max(1) as f32;
        let middle = corners.iter().take(area.polygon_m.len()).fold(Vec2::ZERO, |sum, at| sum + at.to_vec2());
        let name = area.name.as_ref().unwrap_or(&area.id);
        let text = match is_met {
            Some(true) => format!("{name}: met"),
            Some(false) => format!("{name}: missed"),
            None => name.clone(),
        };
        tag(painter, (middle / count).to_pos2(), Align2::CENTER_CENTER, &text, on_image::WHITE);
    }
}

/// Shows the legend in a corner of the plan, with the choices of the colours and the targets. Returns its rectangle;
/// `None` if the plan is too small.
pub(crate) fn legend_ui(app: &mut App, ui: &mut Ui, rect: Rect) -> Option<Rect> {
    /// Smallest size of a plan with a legend, in points.
    const MIN_SIZE: Vec2 = Vec2::new(320.0, 300.0);
    const WIDTH: f32 = 214.0;
    if rect.width() < MIN_SIZE.x || rect.height() < MIN_SIZE.y {
        return None;
    }
    let palette = theme::palette(ui.ctx());
    let corner = rect.left_top() + Vec2::new(12.0, 12.0);
    let place = Rect::from_min_size(corner, Vec2::new(WIDTH, rect.height() - 24.0));
    let shown = ui.scope_builder(egui::UiBuilder::new().max_rect(place), |ui| {
        let frame = Frame::new().fill(palette.panel).corner_radius(4.0).inner_margin(8.0);
        frame.show(ui, |ui| {
            ui.set_width(WIDTH - 16.0);
            ui.spacing_mut().item_spacing.y = 3.0;
            target_ui(app, ui);
            let units = app.editor.session().site.units;
            let Some(shown) = &app.coverage else { return };
            let found = match &shown.result {
                Ok(found) => found,
                Err(why) => {
                    ui.label(RichText::new(format!("No coverage: {why}.")).small().color(palette.warn));
                    return;
                }
            };
            for (fill, text, area) in &found.legend {
                ui.horizontal(|ui| {
                    let (sample, _) = ui.allocate_exact_size(Vec2::splat(10.0), egui::Sense::hover());
                    let stroke = Stroke::new(0.5, palette.text3);
                    ui.painter().rect(sample, 1.0, colour(*fill), stroke, egui::StrokeKind::Inside);
                    ui.label(RichText::new(text).small());
                    ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                        let size = area / units.metres().powi(2);
                        let text = format!("{size:.0} {}\u{b2}", units.symbol());
                        ui.label(RichText::new(text).small().color(palette.text2));
                    });
                });
            }
            for (ids, why) in
                [(&found.left_out, "not placed, so not included"), (&found.assumed, "assumed scale")]
            {
                if !ids.is_empty() {
                    let text = format!("{}: {why}", ids.join(", "));
                    ui.label(RichText::new(text).small().color(palette.warn));
                }
            }
        });
    });
    Some(shown.response.rect)
}

/// Shows the choices of the quantity by which the floor is coloured, and of the targets.
fn target_ui(app: &mut App, ui: &mut Ui) {
    let palette = theme::palette(ui.ctx());
    let units = app.editor.session().site.units;
    let Some(shown) = &mut app.coverage else { return };
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new("Colours").small().color(palette.text2));
        let name = |shading: Shading| match shading {
            Shading::Level => "pixel density",
            Shading::Cameras => "number of cameras",
        };
        ComboBox::from_id_salt("coverage colours")
            .selected_text(RichText::new(name(shown.shading)).small())
            .width(120.0)
            .show_ui(ui, |ui| {
                for shading in [Shading::Level, Shading::Cameras] {
                    ui.selectable_value(&mut shown.shading, shading, name(shading));
                }
            })
            .response
            .labelled_by(label.id);
    });
    let now = shown.height;
    ui.horizontal(|ui| {
        let label = ui.label(RichText::new("Targets").small().color(palette.text2));
        let named = |(name, _): &Target| (*name).to_owned();
        let chosen = TARGETS.iter().find(|(_, height)| *height == now).map_or_else(String::new, named);
        ComboBox::from_id_salt("coverage targets")
            .selected_text(RichText::new(chosen).small())
            .width(90.0)
            .show_ui(ui, |ui| {
                for (name, height) in TARGETS {
                    let text = format!("{name}, {}", units.length(height, 1));
                    ui.selectable_value(&mut shown.height, height, text);
                }
            })
            .response
            .labelled_by(label.id)
            .on_hover_text(
                "Height of the targets above the floor. The names of the levels follow EN 62676-4.",
            );
    });
}
