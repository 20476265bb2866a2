//! Loupe: the image and its lines around a dragged point, enlarged.

use egui::{Color32, Pos2, Rect, Ui, Vec2};

use crate::annotate::image;
use crate::canvas::{Mapping, View};
use crate::paint::{Pen, line};
use crate::state::{App, Place};
use crate::theme::{self, on_image};

/// Side of the square loupe, in points.
const SIDE: f32 = 172.0;
/// Magnification of the loupe relative to its canvas.
const ZOOM: f64 = 6.0;

/// Returns the rectangle of the loupe: above and left of the pointer, or on the other side if there is no
/// room.
fn loupe_rect(held: Pos2, canvas: Rect) -> Rect {
    /// Distance between the pointer and the loupe, in points.
    const POINTER_GAP: Vec2 = Vec2::new(62.0, 44.0);
    let side = SIDE.min(0.45 * canvas.width()).min(0.6 * canvas.height());
    let mut corner = held - POINTER_GAP - Vec2::splat(side);
    if corner.x < canvas.left() {
        corner.x = held.x + POINTER_GAP.x;
    }
    if corner.y < canvas.top() {
        corner.y = held.y + POINTER_GAP.y;
    }
    let most = (canvas.max - Vec2::splat(side)).max(canvas.min);
    Rect::from_min_size(corner.clamp(canvas.min, most), Vec2::splat(side))
}

/// Paints the neighbourhood of the dragged point, with the overlay.
pub(crate) fn loupe_ui(app: &mut App, ui: &Ui, camera: usize, mapping: &Mapping, at: [f64; 2]) {
    let rect = loupe_rect(mapping.screen(at), mapping.rect);
    let view = View { centre: mapping.flat(at), zoom: ZOOM * mapping.view.zoom, y_up: false };
    let large = Mapping { view, rect, ..*mapping };
    let painter = ui.painter().with_clip_rect(rect);
    painter.rect_filled(rect, 0.0, theme::palette(ui.ctx()).canvas);
    let name = app.editor.session().site.cameras.get(camera).and_then(|entry| entry.image.clone());
    image::paint(app, &painter, name.as_deref(), &large, rect);
    let mut overlay = image::overlay(app, ui, camera, large, Place::Tile);
    (overlay.labels, overlay.cursor, overlay.lines) = (false, None, true);
    overlay.paint(&painter);
    let centre = rect.center();
    for by in [Vec2::new(14.0, 0.0), Vec2::new(0.0, 14.0)] {
        for sign in [-1.0, 1.0] {
            line(&painter, &[centre + 0.3 * sign * by, centre + sign * by], Pen::new(Color32::WHITE, 1.0));
        }
    }
    let text = format!("{ZOOM:.0}\u{d7}   {:.1}, {:.1}", at[0], at[1]);
    let bar = Rect::from_min_max(Pos2::new(rect.left(), rect.bottom() - 18.0), rect.max);
    painter.rect_filled(bar, 0.0, on_image::TAG);
    painter.text(bar.center(), egui::Align2::CENTER_CENTER, text, theme::regular(11.0), Color32::WHITE);
    let outside = ui.painter();
    outside.rect_stroke(rect, 3.0, egui::Stroke::new(2.0, Color32::WHITE), egui::StrokeKind::Outside);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_loupe_stays_on_the_canvas_wherever_the_hand_is() {
        for size in [Vec2::new(320.0, 400.0), Vec2::new(1200.0, 800.0)] {
            let canvas = Rect::from_min_size(Pos2::new(44.0, 68.0), size);
            for step in 0..400_u16 {
                let share = [f32::from(step % 20) / 19.0, f32::from(step / 20) / 19.0];
                let held = canvas.min + Vec2::new(share[0] * size.x, share[1] * size.y);
                assert!(canvas.contains_rect(loupe_rect(held, canvas)), "{held:?} on {canvas:?}");
            }
        }
    }
}
