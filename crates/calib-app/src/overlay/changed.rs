//! What a newer still shows of the old one: places of edges that are found again and those that are not, and what was drawn
//! where it is now.

use calib_core::Pixel;

use calib_core::camera::Turned;
use calib_editor::Newer;
use egui::{Painter, Pos2, Rect, Stroke};

use crate::overlay::Overlay;
use crate::paint::{Pen, line};
use crate::theme::on_image;

/// A newer still that is looked at.
#[derive(Clone, Copy, Debug)]
pub struct Changed<'a> {
    /// What became of the camera by it.
    pub newer: &'a Newer,
    /// From this place of the screen on, to the right, it is the newer still that is seen.
    pub split: f32,
}

impl<'a> Overlay<'a> {
    /// Looks at a newer still: what lies on the floor of the old one steps back.
    pub(crate) fn compare(&mut self, split: f32, newer: Option<&'a Newer>) {
        self.changed = newer.map(|newer| Changed { newer, split });
        self.suggested.clear();
        let layers = &mut self.layers;
        (layers.grid, layers.prism, layers.horizon, layers.guide) = (false, false, false, false);
        (layers.field, layers.extensions) = (false, false);
    }

    /// Each place on the side of the still that is seen there.
    pub(crate) fn paint_changed(&self, painter: &Painter, Changed { newer, split }: &Changed<'_>) {
        let clip = painter.clip_rect();
        let left = painter.with_clip_rect(clip.intersect(left_of(*split)));
        let right = painter.with_clip_rect(clip.intersect(right_of(*split)));
        let turned = newer.comparison.turn.at(&newer.pose);
        let is_aligned = newer.comparison.became.is_aligned();
        if is_aligned {
            self.paint_carried(&right, &turned);
        }
        for (place, found) in &newer.comparison.seen {
            let Some(found) = *found else { continue };
            dot(&left, self.at(*place), found);
            let now = if is_aligned { turned.pixel(*place) } else { None };
            if let Some(now) = now {
                dot(&right, self.at(now), found);
            }
        }
    }

    /// What was drawn, where the turn puts it.
    fn paint_carried(&self, painter: &Painter, turned: &Turned) {
        let Some(entry) = self.entry() else { return };
        for points in entry.annotations.iter().flat_map(|drawn| drawn.polylines()) {
            let now: Option<Vec<Pixel>> = points.iter().map(|&point| turned.pixel(point)).collect();
            let path = now.map(|now| self.path(&now)).unwrap_or_default();
            line(painter, &path, Pen::new(on_image::ACCENT, 2.0).dashed(&[6.0, 4.0]));
        }
    }
}

/// The part of the screen to the right of a place.
pub(crate) fn right_of(split: f32) -> Rect {
    Rect::EVERYTHING.with_min_x(split)
}

/// The part to its left.
fn left_of(split: f32) -> Rect {
    Rect::EVERYTHING.with_max_x(split)
}

/// A place of an edge: full where it is found again, a ring where it is not.
fn dot(painter: &Painter, at: Pos2, found: bool) {
    if !painter.clip_rect().contains(at) {
        return;
    }
    if found {
        painter.circle_filled(at, 1.1, on_image::ACCENT.gamma_multiply(0.8));
    } else {
        painter.circle_stroke(at, 2.2, Stroke::new(1.2, on_image::BAD));
    }
}
