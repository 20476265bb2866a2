//! Middle of the window: one image, image and plan, all cameras, or the scene.

use calib_editor::{Action, Pane};
use egui::{Align2, Rect, ScrollArea, Sense, Stroke, Ui, Vec2};

use crate::command::Command;
use crate::paint::chip;
use crate::pane;
use crate::plan::coverage::{legend_ui, update_coverage};
use crate::scene3d;
use crate::shell::cameras;
use crate::state::{App, Looking, Mode, Orbit, Place};
use crate::theme;
use crate::widgets::number;

/// Height of the header of a view, in points.
const HEADER_HEIGHT: f32 = 28.0;
/// Smallest height of a camera tile, in points.
const MIN_TILE_HEIGHT: f32 = 150.0;

/// Shows the canvases of the current mode.
pub fn views_ui(app: &mut App, ui: &mut Ui) {
    let rect = ui.max_rect();
    app.view.panes.middle = Some(rect);
    match app.view.mode {
        Mode::Image => {
            let camera = app.editor.session().camera;
            let is_tall = rect.height() > 1.8 * cameras::HEIGHT;
            let has_more = app.editor.find_family();
            if has_more && is_tall && app.view.compares_views {
                let (above, below) = rect.split_top_bottom_at_y(rect.bottom() - cameras::HEIGHT);
                single(app, ui, above, camera, Place::Main);
                ui.scope_builder(egui::UiBuilder::new().max_rect(below), |ui| cameras::dock_ui(app, ui));
            } else {
                single(app, ui, rect, camera, Place::Main);
                if has_more {
                    cameras::offer(app, ui, rect, is_tall);
                }
            }
        }
        Mode::Plan => {
            let right = image_beside(app, ui, rect, app.view.beside_plan);
            header(
                app,
                ui,
                right.with_max_y(right.top() + HEADER_HEIGHT),
                "Floor plan",
                &[Command::Coverage, Command::Magnify, Command::Blend, Command::Snap],
            );
            pane::plan(app, ui, right.with_min_y(right.top() + HEADER_HEIGHT), Place::Main);
        }
        Mode::All => all_cameras(app, ui, rect),
        Mode::Scene => {
            let right = image_beside(app, ui, rect, app.view.beside_scene);
            header(app, ui, right.with_max_y(right.top() + HEADER_HEIGHT), "3-D", &[Command::Coverage]);
            scene(app, ui, right.with_min_y(right.top() + HEADER_HEIGHT));
        }
    }
}

/// Shows the image in a part of the rectangle if `is_wanted` is set; returns the remaining rectangle.
fn image_beside(app: &mut App, ui: &mut Ui, rect: Rect, is_wanted: bool) -> Rect {
    /// Fraction of the rectangle for the image.
    const IMAGE_FRACTION: f32 = 0.46;
    if !is_wanted {
        return rect;
    }
    let is_tall = rect.height() > 1.2 * rect.width();
    let (left, right) = if is_tall {
        rect.split_top_bottom_at_fraction(IMAGE_FRACTION)
    } else {
        rect.split_left_right_at_fraction(IMAGE_FRACTION)
    };
    images(app, ui, left);
    let ends = [right.left_top(), if is_tall { right.right_top() } else { right.left_bottom() }];
    ui.painter().line_segment(ends, Stroke::new(1.0, theme::palette(ui.ctx()).line));
    right
}

/// Shows the image of one camera with its header.
fn single(app: &mut App, ui: &mut Ui, rect: Rect, camera: usize, place: Place) {
    let switches = [
        Command::Grid,
        Command::Horizon,
        Command::Field,
        Command::Prism,
        Command::Guide,
        if app.is_fisheye(camera) { Command::NextWindow } else { Command::Straighten },
        Command::ColourByResidual,
    ];
    let above = rect.with_max_y(rect.top() + HEADER_HEIGHT);
    pane::image(app, ui, rect.with_min_y(above.bottom()), camera, place);
    camera_header(app, ui, above, (camera, place), &switches);
}

/// Shows the image of the current camera. If there is room, also shows the image of the camera that sees the most
/// corners of its field of view.
fn images(app: &mut App, ui: &mut Ui, rect: Rect) {
    let camera = app.editor.session().camera;
    let Some(other) = neighbour(app, camera).filter(|_| rect.height() > 500.0) else {
        single(app, ui, rect, camera, Place::Half);
        return;
    };
    let (top, bottom) = rect.split_top_bottom_at_fraction(0.52);
    single(app, ui, top, camera, Place::Half);
    camera_header(app, ui, bottom.with_max_y(bottom.top() + HEADER_HEIGHT), (other, Place::Tile), &[]);
    pane::image(app, ui, bottom.with_min_y(bottom.top() + HEADER_HEIGHT), other, Place::Tile);
}

/// Returns the index of the placed camera that sees the most corners of the field of view of `camera`; `None` if no
/// other camera sees one.
fn neighbour(app: &App, camera: usize) -> Option<usize> {
    let own = app.editor.session().solved.solution(camera)?;
    let shared = |index: usize| {
        let pose = app.editor.session().solved.placed_pose(index)?;
        let [w, h] = app.editor.session().site.cameras.get(index)?.size();
        let is_seen = |p: &&calib_core::FloorPoint| {
            pose.world_to_pixel(p.at_height(0.0))
                .is_some_and(|p| p.u > 0.0 && p.v > 0.0 && p.u < w && p.v < h)
        };
        Some(own.efov_m.iter().filter(is_seen).count())
    };
    let count = app.editor.session().site.cameras.len();
    let others =
        (0..count).filter(|&index| index != camera).filter_map(|index| Some((index, shared(index)?)));
    others.filter(|(_, seen)| *seen > 0).max_by_key(|(_, seen)| *seen).map(|(index, _)| index)
}

fn camera_header(
    app: &mut App,
    ui: &mut Ui,
    rect: Rect,
    (camera, place): (usize, Place),
    switches: &[Command],
) {
    let palette = theme::palette(ui.ctx());
    let Some(entry) = app.editor.session().site.cameras.get(camera) else { return };
    let (id, title) = (entry.id.clone(), entry.name.clone().unwrap_or_else(|| entry.id.clone()));
    let key = (place, Pane::Image(camera));
    let zoom = app.view.panes.views.get(&key).map_or_else(String::new, |view| {
        // The zoom is shown in physical screen pixels per image pixel.
        let zoom = view.zoom * f64::from(ui.ctx().pixels_per_point());
        format!("{} %", number(100.0 * zoom, 0))
    });
    // A narrow view hides the least important switches.
    let room = ((rect.width() - 180.0) / 66.0).max(0.0) as usize;
    let shown = &switches[..switches.len().min(room)];
    header(app, ui, rect, "", shown);
    let clip = ui.painter().with_clip_rect(rect.with_max_x(rect.right() - 66.0 * shown.len() as f32));
    chip(&clip, rect.left_center() + Vec2::new(18.0, 0.0), app.editor.session().camera_slot(camera));
    let at = rect.left_center() + Vec2::new(34.0, 0.0);
    let name = clip.text(at, Align2::LEFT_CENTER, title, theme::medium(12.0), palette.text);
    if !switches.is_empty() {
        let at = name.right_center() + Vec2::new(10.0, 0.0);
        let shown = clip.text(at, Align2::LEFT_CENTER, &zoom, theme::regular(12.0), palette.text2);
        let response = ui.interact(shown, ui.scope_id().with(("zoom", key)), Sense::hover());
        let words = format!("{id} at {zoom}");
        response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Label, true, &words));
        response.on_hover_text("At 100 %, one pixel of the image is one pixel of the screen.");
    }
}

/// Shows the header of a view: a title and switches.
fn header(app: &mut App, ui: &mut Ui, rect: Rect, title: &str, switches: &[Command]) {
    let palette = theme::palette(ui.ctx());
    ui.painter().rect_filled(rect, 0.0, palette.panel);
    let at = rect.left_center() + Vec2::new(12.0, 0.0);
    ui.painter().text(at, Align2::LEFT_CENTER, title, theme::medium(12.0), palette.text);
    let mut chosen = None;
    let inner = rect.shrink2(Vec2::new(8.0, 0.0));
    ui.scope_builder(egui::UiBuilder::new().max_rect(inner), |ui| {
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.spacing_mut().item_spacing.x = 4.0;
            for &switch in switches.iter().rev() {
                let (word, is_on, tip) = state(app, switch);
                let response = ui.selectable_label(is_on, word).on_hover_text(tip);
                if response.clicked() {
                    chosen = Some(switch);
                }
            }
        });
    });
    if let Some(command) = chosen {
        app.send_command(command);
    }
}

/// Returns the label of a switch, whether it is on, and its tooltip.
const fn state(app: &App, command: Command) -> (&'static str, bool, &'static str) {
    match command {
        Command::Grid => ("Grid", app.view.layers.grid, "Show a square grid on the floor"),
        Command::Horizon => {
            ("Horizon", app.view.layers.horizon, "Show the horizon and the vanishing points of the camera")
        }
        Command::Field => {
            ("Field", app.view.layers.field, "Show the floor area that the camera should cover")
        }
        Command::Prism => {
            ("Prism", app.view.layers.prism, "Show the field of view, extended to 2 m above the floor")
        }
        Command::Guide => ("Guide", app.view.layers.guide, "Show a 1.75 m tall person at the pointer"),
        Command::Straighten => ("Undistort", app.view.layers.straight, "Show the image without distortion"),
        Command::NextWindow => (
            "Window",
            !matches!(app.view.looking, Looking::Whole),
            "Show the next undistorted part of the fisheye image",
        ),
        Command::Snap => {
            ("Snap", app.editor.session().tool.snap, "Snap to round positions and angles while dragging")
        }
        Command::ColourByResidual => {
            ("Colour by error", app.view.layers.by_residual, "Colour lines by their residual, not by kind")
        }
        Command::Coverage => {
            ("Coverage", app.view.coverage, "Colour the floor by pixel density or by number of cameras")
        }
        Command::Blend => ("All images", app.view.blend, "Project the images of all cameras onto the floor"),
        Command::Magnify => {
            ("Ellipses \u{d7}10", app.view.magnified, "Draw uncertainty ellipses 10 times larger")
        }
        _ => ("", false, ""),
    }
}

/// Shows the images of all cameras, and the floor plan, as tiles.
fn all_cameras(app: &mut App, ui: &mut Ui, rect: Rect) {
    let count = app.editor.session().site.cameras.len() + 1;
    let columns = columns(count, rect);
    let rows = count.div_ceil(columns);
    let size = Vec2::new(
        rect.width() / columns as f32,
        (rect.height() / rows as f32).max(MIN_TILE_HEIGHT + HEADER_HEIGHT),
    );
    app.view.panes.tiles_overflow = size.y * rows as f32 > rect.height() + 1.0;
    ui.scope_builder(egui::UiBuilder::new().max_rect(rect), |ui| {
        ScrollArea::vertical().auto_shrink([false, false]).show(ui, |ui| {
            ui.spacing_mut().item_spacing = Vec2::ZERO;
            let (area, _) =
                ui.allocate_exact_size(Vec2::new(rect.width(), size.y * rows as f32), Sense::hover());
            for index in 0..count {
                let cell = Vec2::new((index % columns) as f32 * size.x, (index / columns) as f32 * size.y);
                // The plan, which comes last, fills its row.
                let span = if index + 1 == count { columns - index % columns } else { 1 };
                let own = Vec2::new(size.x * span as f32, size.y);
                let tile = Rect::from_min_size(area.min + cell, own).shrink(0.5);
                if !ui.is_rect_visible(tile) {
                    continue;
                }
                let above = tile.with_max_y(tile.top() + HEADER_HEIGHT);
                let below = tile.with_min_y(above.bottom());
                if index + 1 == count {
                    header(app, ui, above, "Floor", &[Command::Blend]);
                    pane::plan(app, ui, below, Place::Tile);
                } else {
                    camera_header(app, ui, above, (index, Place::Tile), &[]);
                    pane::image(app, ui, below, index, Place::Tile);
                    if index == app.editor.session().camera {
                        let stroke = Stroke::new(1.0, theme::palette(ui.ctx()).accent);
                        ui.painter().rect_stroke(tile, 0.0, stroke, egui::StrokeKind::Inside);
                    }
                }
            }
        });
    });
}

/// Returns the number of columns at which the tiles are closest to the shape of an image.
fn columns(count: usize, rect: Rect) -> usize {
    /// Width of a typical image divided by its height.
    const IMAGE_ASPECT: f32 = 1.6;
    let off = |columns: usize| {
        let rows = count.div_ceil(columns);
        let shape = (rect.width() / columns as f32) / (rect.height() / rows as f32).max(MIN_TILE_HEIGHT);
        (shape / IMAGE_ASPECT).ln().abs()
    };
    (1..=count.max(1)).min_by(|&a, &b| off(a).total_cmp(&off(b))).unwrap_or(1)
}

/// Shows the 3-D scene.
fn scene(app: &mut App, ui: &mut Ui, rect: Rect) {
    app.ask_for_plan(ui.ctx());
    if app.view.coverage {
        update_coverage(app);
    }
    let response = ui.interact(rect, ui.scope_id().with("scene"), Sense::click_and_drag());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "Scene"));
    let mut orbit = app.view.orbit.unwrap_or_else(|| Orbit::of(app.editor.session()));
    let by = response.drag_delta();
    let pans = ui.input(|i| i.modifiers.shift || i.pointer.middle_down() || i.pointer.secondary_down());
    if by != Vec2::ZERO {
        if pans { orbit.pan(by) } else { orbit.turn(by) }
    }
    if response.contains_pointer() {
        let factor =
            ui.input(|i| f64::from(i.zoom_delta()) * (f64::from(i.smooth_scroll_delta().y) / 240.0).exp());
        orbit.zoom(factor);
    }
    if let Some(camera) = response
        .clicked()
        .then(|| {
            response
                .interact_pointer_pos()
                .and_then(|at| scene3d::pick(rect, &orbit, app.editor.session(), at))
        })
        .flatten()
    {
        app.send(Action::SelectCamera(camera));
    }
    let painter = ui.painter().with_clip_rect(rect);
    let palette = theme::palette(ui.ctx());
    painter.rect_filled(rect, 0.0, palette.canvas);
    let plan = app.plan_picture().map(|picture| (picture.overview.id(), picture.size()));
    let shown = (app.editor.session(), app.ellipse_size());
    let coverage = app.coverage.as_ref().filter(|_| app.view.coverage);
    scene3d::paint(&painter, rect, (&orbit, ui.visuals().dark_mode), shown, plan, coverage);
    let text = "Drag: orbit.  Shift and drag: pan.  Wheel: zoom.  Click a camera to select it.";
    painter.text(
        rect.left_bottom() + Vec2::new(12.0, -12.0),
        Align2::LEFT_BOTTOM,
        text,
        theme::regular(11.0),
        palette.text2,
    );
    if app.view.coverage {
        legend_ui(app, ui, rect);
    }
    app.view.orbit = Some(orbit);
}
