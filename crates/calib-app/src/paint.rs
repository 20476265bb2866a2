//! Lines and labels on images; every line has a dark outline, so that it is legible on any background.

use calib_draw::{Look, Outline};
use egui::{Align2, Color32, CornerRadius, Painter, Pos2, Rect, Shape, Stroke, Vec2};

use crate::theme::{self, on_image};

/// Whether a blinking line is lit now, `since` seconds after its blinking started. The line blinks once a
/// second for three seconds, then stays lit. With reduced motion it is always lit.
#[must_use]
pub fn is_lit(ctx: &egui::Context, since: f64) -> bool {
    /// Duration of the blinking, in seconds.
    const BLINK_DURATION_S: f64 = 3.0;
    if since > BLINK_DURATION_S || theme::is_still(ctx) {
        return true;
    }
    ctx.request_repaint_after(std::time::Duration::from_millis(100));
    since.rem_euclid(1.0) < 0.5
}

/// Appearance of a line.
#[derive(Clone, Copy, Debug)]
pub struct Pen {
    /// Colour of the line.
    pub colour: Color32,
    /// Width of the line, in points.
    pub width: f32,
    /// Lengths of dashes and gaps, in points; empty for a solid line.
    pub dash: &'static [f64],
    /// Colour of the outline below the line.
    pub below: Color32,
}

impl Pen {
    /// Creates a pen for solid lines with a dark outline; `width` is in points.
    #[must_use]
    pub const fn new(colour: Color32, width: f32) -> Self {
        Self { colour, width, dash: &[], below: on_image::OUTLINE }
    }

    /// Creates the pen that draws a line with this appearance.
    #[must_use]
    pub fn of(look: Look) -> Self {
        let colour = theme::colour(look.colour);
        let pen = Self::new(colour.gamma_multiply(look.opacity as f32), look.width as f32).dashed(look.dash);
        match look.outline {
            Outline::Dark => pen,
            Outline::Faint => pen.faint(),
            Outline::None => pen.bare(),
        }
    }

    /// Returns the pen in another colour with the same opacity.
    #[must_use]
    pub fn coloured(self, colour: Color32) -> Self {
        Self { colour: colour.gamma_multiply(f32::from(self.colour.a()) / 255.0), ..self }
    }

    /// Returns the pen with dashes and gaps of these lengths, in points.
    #[must_use]
    pub const fn dashed(self, dash: &'static [f64]) -> Self {
        Self { dash, ..self }
    }

    /// Returns the pen without its outline.
    #[must_use]
    pub const fn bare(self) -> Self {
        Self { below: Color32::TRANSPARENT, ..self }
    }

    /// Returns the pen with a faint outline.
    #[must_use]
    pub const fn faint(self) -> Self {
        Self { below: Color32::from_black_alpha(56), ..self }
    }
}

/// Margin around the visible area that clipped lines may enter, in points.
const CLIP_MARGIN: f32 = 64.0;

/// Paints a polyline of screen points, clipped to the visible area.
pub fn line(painter: &Painter, points: &[Pos2], pen: Pen) {
    for piece in clipped(points, painter.clip_rect().expand(CLIP_MARGIN)) {
        if pen.below != Color32::TRANSPARENT {
            let below = Stroke::new(pen.width + 2.0, pen.below);
            painter.add(dashes(&piece, pen.dash, below));
        }
        painter.add(dashes(&piece, pen.dash, Stroke::new(pen.width, pen.colour)));
    }
}

/// Returns the dashes of a polyline.
fn dashes(points: &[Pos2], dash: &[f64], stroke: Stroke) -> Shape {
    if dash.len() < 2 {
        return Shape::line(points.to_vec(), stroke);
    }
    let (strokes, gaps): (Vec<f32>, Vec<f32>) =
        dash.chunks_exact(2).map(|pair| (pair[0] as f32, pair[1] as f32)).unzip();
    Shape::Vec(Shape::dashed_line_with_offset(points, stroke, &strokes, &gaps, 0.0))
}

/// Clips a polyline to a rectangle (Liang and Barsky 1984); returns the visible pieces.
fn clipped(points: &[Pos2], rect: Rect) -> Vec<Vec<Pos2>> {
    let mut pieces: Vec<Vec<Pos2>> = Vec::new();
    for pair in points.windows(2) {
        let Some([a, b]) = clip(pair[0], pair[1], rect) else { continue };
        match pieces.last_mut() {
            Some(piece) if piece.last() == Some(&a) => piece.push(b),
            _ => pieces.push(vec![a, b]),
        }
    }
    pieces
}

/// Clips a line segment to a rectangle; `None` if the segment is outside.
fn clip(a: Pos2, b: Pos2, rect: Rect) -> Option<[Pos2; 2]> {
    if !(a.is_finite() && b.is_finite()) {
        return None;
    }
    let (mut enter, mut leave) = (0.0_f32, 1.0_f32);
    let by = b - a;
    let sides = [
        (-by.x, a.x - rect.left()),
        (by.x, rect.right() - a.x),
        (-by.y, a.y - rect.top()),
        (by.y, rect.bottom() - a.y),
    ];
    for (slope, room) in sides {
        if slope == 0.0 {
            if room < 0.0 {
                return None;
            }
        } else if slope < 0.0 {
            enter = enter.max(room / slope);
        } else {
            leave = leave.min(room / slope);
        }
    }
    (enter <= leave).then(|| {
        let at = |t: f32| {
            if t == 0.0 {
                a
            } else if t == 1.0 {
                b
            } else {
                a + t * by
            }
        };
        [at(enter), at(leave)]
    })
}

/// Paints a round handle with a dark rim.
pub fn handle(painter: &Painter, at: Pos2, colour: Color32) {
    painter.circle(at, theme::HANDLE, colour, Stroke::new(1.0, on_image::OUTLINE));
}

/// Paints the ring of a handle that is hovered, selected or dragged.
pub fn ring(painter: &Painter, at: Pos2, colour: Color32, held: bool) {
    let radius = if held { 9.0 } else { 6.0 };
    painter.circle_stroke(at, radius, Stroke::new(3.0, on_image::OUTLINE));
    painter.circle_stroke(at, radius, Stroke::new(1.5, colour));
    painter.circle_filled(at, 2.0, Color32::WHITE);
}

/// Paints a label with a dark background; returns its rectangle.
pub fn tag(painter: &Painter, at: Pos2, align: Align2, text: &str, colour: Color32) -> Rect {
    let galley = painter.layout_no_wrap(text.to_owned(), theme::regular(11.0), colour);
    let size = galley.size() + Vec2::new(12.0, 4.0);
    let rect = align.anchor_size(at, size);
    if rect.intersects(painter.clip_rect()) {
        painter.rect_filled(rect, CornerRadius::same(3), on_image::TAG);
        painter.galley(rect.min + Vec2::new(6.0, 2.0), galley, colour);
    }
    rect
}

/// Paints the letter of a camera on its colour; returns the rectangle. `slot` is the camera's number, from
/// `Session::camera_slot`.
pub fn chip(painter: &Painter, at: Pos2, slot: usize) -> Rect {
    let rect = Rect::from_center_size(at, Vec2::new(16.0, 16.0));
    painter.rect_filled(rect, CornerRadius::same(3), theme::camera(slot));
    let letter = theme::camera_letter(slot);
    painter.text(rect.center(), Align2::CENTER_CENTER, letter, theme::medium(11.0), Color32::BLACK);
    rect
}

/// Paints the crosshair that the arrow keys move, above all other content. `at` is in screen points.
pub(crate) fn paint_crosshair(ctx: &egui::Context, at: Pos2) {
    /// Ends of the four lines, in points from the position.
    const ENDS: [f32; 2] = [4.0, 14.0];
    let layer = egui::LayerId::new(egui::Order::Foreground, egui::Id::unique("crosshair"));
    let painter = ctx.layer_painter(layer);
    for by in [Vec2::new(1.0, 0.0), Vec2::new(0.0, 1.0), Vec2::new(-1.0, 0.0), Vec2::new(0.0, -1.0)] {
        let ends = ENDS.map(|end| at + end * by);
        for (width, colour) in [(4.0, Color32::BLACK), (2.0, Color32::WHITE)] {
            painter.line_segment(ends, Stroke::new(width, colour));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_cut_where_it_leaves_the_rectangle() {
        let rect = Rect::from_min_max(Pos2::ZERO, Pos2::new(100.0, 100.0));
        let [a, b] = clip(Pos2::new(-1e6, 50.0), Pos2::new(1e6, 50.0), rect).unwrap();
        assert!(a.x.abs() < 1.0 && (b.x - 100.0).abs() < 1.0, "{a:?} {b:?}");
        assert_eq!(clip(Pos2::new(-5.0, -5.0), Pos2::new(-5.0, 200.0), rect), None);
        assert_eq!(clip(Pos2::new(f32::NAN, 0.0), Pos2::new(50.0, 50.0), rect), None);
    }
}
