//! A newer still on the canvas of its camera: beside the old one by a line that wipes, or both by turns.

use calib_editor::Pane;
use egui::{Color32, CursorIcon, Painter, Rect, Role, Sense, Ui, WidgetInfo};

use crate::canvas::Mapping;
use crate::overlay::right_of;
use crate::paint::{Pen, line};
use crate::platform::{Here, Platform as _};
use crate::state::{App, Glance, Mode, Place, Showing};
use crate::theme::on_image;

/// How long one of two stills is shown, in seconds.
const TURN: f64 = 0.7;

/// Paints the newer still of the camera in hand over the old one. From which place of the screen on, to the right, it is
/// the newer one that is seen; none where no newer still is looked at.
pub(crate) fn paint(
    app: &mut App,
    painter: &Painter,
    (camera, place): (usize, Place),
    mapping: &Mapping,
    [w, h]: [f64; 2],
) -> Option<f32> {
    let is_shown = place == Place::Main && app.mode == Mode::Image && camera == app.editor.session().camera;
    let name = app.editor.newer(camera).filter(|_| is_shown)?.image.clone();
    let split = split(app.glance, painter, mapping, w);
    let images = &app.editor.session().images;
    let picture = app.pictures.get(painter.ctx(), &name, || images.reader(&name))?;
    let right = painter.with_clip_rect(painter.clip_rect().intersect(right_of(split)));
    for piece in picture.pieces(painter.ctx()) {
        piece.paint(&right, mapping, Color32::WHITE);
    }
    if app.glance.showing == Showing::Wipe {
        let ends = [0.0, h].map(|v| mapping.screen([w * f64::from(app.glance.share), v]));
        line(painter, &ends.map(|end| egui::pos2(split, end.y)), Pen::new(on_image::WHITE, 1.5));
    }
    Some(split)
}

/// The line that wipes is dragged by itself while nothing is in the hand.
pub(crate) fn slide(app: &mut App, ui: &Ui, camera: usize, mapping: &Mapping, (width, split): (f64, f32)) {
    /// How far beside it a press still takes it, in points.
    const BESIDE: f32 = 6.0;
    let is_free =
        app.glance.showing == Showing::Wipe && app.editor.tool_row() == 0 && app.editor.tool().is_idle();
    let strip = Rect::everything_right_of(split - BESIDE).with_max_x(split + BESIDE).intersect(mapping.rect);
    let strip = Some(strip).filter(|strip| is_free && strip.is_positive());
    app.panes.wipe = strip.map(|strip| ((Place::Main, Pane::Image(camera)), strip));
    let Some(strip) = strip else { return };
    let response = ui.interact(strip, ui.scope_id().with("wipe"), Sense::drag());
    response.widget_info(|| WidgetInfo::labeled(Role::Slider, true, "The line between the stills"));
    if let Some(to) = response.interact_pointer_pos() {
        let [u, _] = mapping.document(to);
        app.glance.share = (u / width).clamp(0.0, 1.0) as f32;
    }
    if response.hovered() || response.dragged() {
        ui.ctx().set_cursor_icon(CursorIcon::ResizeHorizontal);
    }
}

fn split(glance: Glance, painter: &Painter, mapping: &Mapping, width: f64) -> f32 {
    match glance.showing {
        Showing::Wipe => mapping.screen([width * f64::from(glance.share), 0.0]).x,
        Showing::Old => f32::INFINITY,
        Showing::New => f32::NEG_INFINITY,
        // Nothing blinks for whoever asked for less motion.
        Showing::Blink if Here::wants_stillness() => f32::NEG_INFINITY,
        Showing::Blink => {
            let time = painter.ctx().input(|input| input.time);
            let left = TURN - time.rem_euclid(TURN);
            painter.ctx().request_repaint_after(std::time::Duration::from_secs_f64(left));
            if ((time / TURN) as u64).is_multiple_of(2) { f32::NEG_INFINITY } else { f32::INFINITY }
        }
    }
}
