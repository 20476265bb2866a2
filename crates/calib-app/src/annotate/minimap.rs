//! Minimap: the whole image in a corner of a zoomed canvas; a drag moves the view.

use calib_editor::Pane;
use egui::{Color32, Painter, Pos2, Rect, Role, Sense, Stroke, StrokeKind, Ui, Vec2, WidgetInfo};

use crate::annotate::image;
use crate::canvas::{Mapping, View};
use crate::state::{App, Place};

/// Longer side of the minimap, in points.
const SIDE: f32 = 124.0;
/// Distance of the minimap from the border of the canvas, in points.
const MARGIN: f32 = 10.0;
/// Smallest side of a canvas that shows a minimap, in points.
const MIN_CANVAS_SIDE: f32 = 360.0;

/// Returns the rectangle of the minimap; `None` if the canvas is small or shows the whole image. A fisheye window
/// does not count as the whole image.
pub(crate) fn rect(mapping: &Mapping, size: [f64; 2]) -> Option<Rect> {
    let [w, h] = size;
    let corners = [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]].map(|at| mapping.screen(at));
    let is_window = mapping.bend.is_some_and(|bend| bend.size().is_some());
    let is_whole = !is_window && corners.iter().all(|&at| mapping.rect.expand(1.0).contains(at));
    if is_whole || mapping.rect.width().min(mapping.rect.height()) < MIN_CANVAS_SIDE || w <= 0.0 || h <= 0.0 {
        return None;
    }
    let share = f64::from(SIDE) / w.max(h);
    let size = Vec2::new((w * share) as f32, (h * share) as f32);
    let corner = mapping.rect.left_bottom() + Vec2::new(MARGIN, -MARGIN - size.y);
    Some(Rect::from_min_size(corner, size))
}

/// Paints the visible part of the image: a rectangle, or the outline of a fisheye window.
fn paint_shown(painter: &Painter, mapping: &Mapping, small: &Mapping) {
    /// Number of segments along each side of the outline of a fisheye window.
    const SAMPLES_PER_SIDE: u16 = 24;
    let stroke = Stroke::new(1.5, Color32::WHITE);
    if mapping.bend.is_none_or(|bend| bend.size().is_none()) {
        let shown = [mapping.rect.min, mapping.rect.max].map(|at| small.screen(mapping.document(at)));
        let shown = Rect::from_two_pos(shown[0], shown[1]).intersect(small.rect);
        painter.rect_stroke(shown, 0.0, stroke, StrokeKind::Inside);
        return;
    }
    let Rect { min, max } = mapping.rect;
    let corners = [min, Pos2::new(max.x, min.y), max, Pos2::new(min.x, max.y), min];
    for side in corners.windows(2) {
        let share = |step: u16| f32::from(step) / f32::from(SAMPLES_PER_SIDE);
        let at = |step: u16| mapping.bent_at(side[0] + share(step) * (side[1] - side[0]));
        for step in 0..SAMPLES_PER_SIDE {
            if let (Some(a), Some(b)) = (at(step), at(step + 1)) {
                painter.line_segment([a, b].map(|pixel| small.screen(pixel.into())), stroke);
            }
        }
    }
}

/// Shows the minimap over the canvas; a drag moves the view.
pub(crate) fn minimap_ui(app: &mut App, ui: &Ui, camera: usize, mapping: &Mapping, size: [f64; 2]) {
    let key = (Place::Main, Pane::Image(camera));
    // The minimap is hidden during a gesture, which may need the space.
    let rect = rect(mapping, size).filter(|_| app.editor.tool().is_idle());
    app.view.panes.minimap = rect.map(|rect| (key, rect));
    let Some(rect) = rect else { return };
    let small = Mapping::new(View::of([0.0, 0.0], size, rect, false, true), rect);
    let painter = ui.painter().with_clip_rect(rect);
    painter.rect_filled(rect, 0.0, Color32::BLACK);
    let name = app.editor.session().site.cameras.get(camera).and_then(|entry| entry.image.clone());
    image::paint(app, &painter, name.as_deref(), &small, rect);
    painter.rect_filled(rect, 0.0, Color32::from_black_alpha(90));
    paint_shown(&painter, mapping, &small);
    ui.painter().rect_stroke(rect, 0.0, Stroke::new(1.0, Color32::from_white_alpha(90)), StrokeKind::Outside);
    let is_window = mapping.bend.is_some_and(|bend| bend.size().is_some());
    let response = ui.interact(rect, ui.scope_id().with("minimap"), Sense::click_and_drag());
    response.widget_info(|| WidgetInfo::labeled(Role::Image, true, "Whole image: drag to move the view"));
    let pans = ui.input(|i| !i.pointer.primary_down() || i.key_down(egui::Key::Space));
    let is_held = response.is_pointer_button_down_on() && !pans;
    if let Some(to) = response.interact_pointer_pos().filter(|_| is_held) {
        let to = small.document(to.clamp(rect.min, rect.max));
        if is_window {
            app.look_at(to.into());
        } else {
            app.view.panes.views.insert(key, View { centre: mapping.flat(to), ..mapping.view });
        }
    }
    if response.hovered() {
        ui.ctx().set_cursor_icon(egui::CursorIcon::Grab);
    }
}
