//! The loupe beside what is held: the image and its lines, enlarged.

use egui::{Color32, Pos2, Rect, Ui, Vec2};

use crate::canvas::{Mapping, View};
use crate::paint::{Pen, line};
use crate::state::{App, Place};
use crate::still;
use crate::theme::{self, on_image};

/// Its side, in points.
const SIDE: f32 = 172.0;
/// How much it enlarges.
const ZOOM: f64 = 6.0;

/// The neighbourhood of what is held, enlarged, lines and all.
pub(crate) fn show(app: &mut App, ui: &Ui, camera: usize, mapping: &Mapping, at: [f64; 2]) {
    let here = mapping.screen(at);
    let mut corner = here - Vec2::new(62.0 + SIDE, 44.0 + SIDE);
    if corner.x < mapping.rect.left() {
        corner.x = here.x + 62.0;
    }
    if corner.y < mapping.rect.top() {
        corner.y = here.y + 44.0;
    }
    let rect = Rect::from_min_size(corner, Vec2::splat(SIDE));
    let view = View { centre: mapping.flat(at), zoom: ZOOM * mapping.view.zoom, y_up: false };
    let large = Mapping { view, rect, ..*mapping };
    let painter = ui.painter().with_clip_rect(rect);
    painter.rect_filled(rect, 0.0, theme::palette(ui.ctx()).canvas);
    let name = app.editor.session().site.cameras.get(camera).and_then(|entry| entry.image.clone());
    still::paint(app, &painter, name.as_deref(), &large, rect);
    let mut overlay = still::overlay(app, ui, camera, large, Place::Tile);
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
