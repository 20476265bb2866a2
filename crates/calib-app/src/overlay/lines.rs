//! Overlay of annotations, in the colour of their kind or residual, with sign and extension. Also the overlay
//! of a newer image with matched edge points.

use calib_core::Pixel;
use calib_core::single::line_name;
use calib_draw::{AnnotatedLine, Look, Meaning, PlacedShape, Sign, extension, place_sign};
use calib_editor::{NewerImage, Part};
use egui::{Align2, Color32, Painter, Pos2, Rect, Shape, Stroke, Vec2};

use crate::overlay::Overlay;
use crate::paint::{Pen, is_lit, line, tag};
use crate::theme::{self, on_image};

/// Newer image that is compared on the canvas.
#[derive(Clone, Copy, Debug)]
pub struct Changed<'a> {
    /// Newer image with the result of its comparison.
    pub newer: &'a NewerImage,
    /// Screen x from which the newer image is visible.
    pub split: f32,
}

impl<'a> Overlay<'a> {
    /// Sets the newer image that the overlay compares, and the screen x from which it is visible. Hides suggestions,
    /// grid, prism, horizon, guide, field of view and line extensions.
    pub(crate) fn compare(&mut self, split: f32, newer: Option<&'a NewerImage>) {
        self.changed = newer.map(|newer| Changed { newer, split });
        self.suggested.clear();
        let layers = &mut self.layers;
        (layers.grid, layers.prism, layers.horizon, layers.guide) = (false, false, false, false);
        (layers.field, layers.extensions) = (false, false);
    }

    /// Paints the edge points of each image on its side of the wipe line. If the images are aligned, also paints the
    /// annotations at their new positions.
    pub(crate) fn paint_changed(&self, painter: &Painter, Changed { newer, split }: &Changed<'_>) {
        let clip = painter.clip_rect();
        let left = painter.with_clip_rect(clip.intersect(left_of(*split)));
        let right = painter.with_clip_rect(clip.intersect(right_of(*split)));
        let by = newer.comparison.pixel_map(&newer.pose);
        let is_aligned = newer.comparison.change.is_aligned();
        if is_aligned {
            self.paint_carried(&right, &by);
        }
        for (place, found) in &newer.comparison.samples {
            let Some(found) = *found else { continue };
            dot(&left, self.at(*place), found);
            let now = if is_aligned { by(*place) } else { None };
            if let Some(now) = now {
                dot(&right, self.at(now), found);
            }
        }
    }

    /// Paints the annotations at their positions in the newer image; `by` maps pixels of the old image to it.
    fn paint_carried(&self, painter: &Painter, by: &dyn Fn(Pixel) -> Option<Pixel>) {
        let Some(entry) = self.entry() else { return };
        for points in entry.annotations.iter().flat_map(|drawn| drawn.polylines()) {
            let now: Option<Vec<Pixel>> = points.iter().map(|&point| by(point)).collect();
            let path = now.map(|now| self.path(&now)).unwrap_or_default();
            line(painter, &path, Pen::new(on_image::ACCENT, 2.0).dashed(&[6.0, 4.0]));
        }
    }
}

/// Returns the part of the screen right of the screen x `split`.
pub(crate) fn right_of(split: f32) -> Rect {
    Rect::EVERYTHING.with_min_x(split)
}

/// Returns the part of the screen left of the screen x `split`.
fn left_of(split: f32) -> Rect {
    Rect::EVERYTHING.with_max_x(split)
}

/// Paints an edge point as a disc if it was matched in the newer image, otherwise as a ring.
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

impl Overlay<'_> {
    /// Whether a line is highlighted: the line is selected, or the line or its table row is under the
    /// pointer.
    fn is_bright(&self, drawn: &AnnotatedLine) -> bool {
        let AnnotatedLine { annotation, segment, .. } = *drawn;
        self.lit == Some((annotation, segment))
            || self.session.camera == self.camera
                && self.session.selection.contains(&Part::Line { annotation, segment })
    }

    /// Returns the colour of a line by its kind or, if colouring by residual is on, by its residual.
    fn used_colour(&self, painter: &Painter, drawn: &AnnotatedLine) -> Color32 {
        match drawn.over_sigma.filter(|_| self.layers.by_residual) {
            Some(over_sigma) => theme::residual(theme::palette(painter.ctx()), over_sigma),
            None => theme::kind(drawn.kind),
        }
    }

    /// Returns the colour of a line; outliers have a separate colour.
    pub(crate) fn line_colour(&self, painter: &Painter, drawn: &AnnotatedLine) -> Color32 {
        if drawn.is_outlier { theme::colour(drawn.colour()) } else { self.used_colour(painter, drawn) }
    }

    pub(crate) fn paint_line(&self, painter: &Painter, pixels: &[Pixel], drawn: &AnnotatedLine) {
        let (points, is_bright) = (self.path(pixels), self.is_bright(drawn));
        let is_aside = drawn.is_outlier && !drawn.is_off;
        let look = Look::of(Meaning::Annotation(*drawn));
        let width = if is_bright { 3.0 } else { calib_draw::LINE_WIDTH as f32 };
        let mut pen = Pen { width, ..Pen::of(look) };
        if is_aside {
            self.paint_halo(painter, &points);
        } else {
            pen = pen.coloured(self.used_colour(painter, drawn));
        }
        if self.layers.extensions && is_bright {
            self.paint_extension(painter, pixels, drawn);
        }
        line(painter, &points, pen);
        if self.labels && (is_bright || drawn.is_outlier) {
            self.paint_line_name(painter, drawn, &points);
        }
    }

    /// Paints the name of a line with its residual in pixels.
    fn paint_line_name(&self, painter: &Painter, drawn: &AnnotatedLine, points: &[Pos2]) {
        // The label of an outlier is in the middle of the line, because another line may begin at its end.
        let named = if drawn.is_outlier { points.get(points.len() / 2) } else { points.last() };
        let (Some(&at), Some(entry)) = (named, self.entry()) else { return };
        let at = match points {
            [a, b] if drawn.is_outlier => a.lerp(*b, 0.5),
            _ => at,
        };
        let name = line_name(&entry.annotations, drawn.annotation, drawn.segment);
        let (text, colour) = match drawn.residual_px.map(f64::abs) {
            Some(px) if drawn.is_outlier => (format!("{name} rejected, {px:.1} px"), on_image::BAD),
            Some(px) => (format!("{name} {px:.1} px"), on_image::WHITE),
            None => (name, on_image::WHITE),
        };
        tag(painter, at + Vec2::new(14.0, 8.0), Align2::LEFT_TOP, &text, colour);
    }

    /// Paints the halo of an outlier, which blinks for a few seconds and then stays.
    fn paint_halo(&self, painter: &Painter, points: &[Pos2]) {
        if is_lit(painter.ctx(), self.time) {
            line(painter, points, Pen::new(on_image::BAD.gamma_multiply(0.35), 9.0).bare());
        }
    }

    /// Paints the extension of a line beyond its ends.
    fn paint_extension(&self, painter: &Painter, pixels: &[Pixel], drawn: &AnnotatedLine) {
        let Some(camera) = self.session.solved.pose(self.camera) else { return };
        let colour = self.line_colour(painter, drawn);
        for item in extension(camera, drawn.kind, pixels) {
            if let calib_draw::Geometry::Polyline(points) = &item.geometry {
                line(painter, &self.path(points), Pen::of(Look::of(item.meaning)).coloured(colour));
            }
        }
    }

    /// Paints the sign of the annotation kind on a line, and its length if the kind has one. Kinds must not
    /// differ by colour alone.
    pub(crate) fn paint_sign(&self, painter: &Painter, sign: Sign, [a, b]: [Pos2; 2], drawn: &AnnotatedLine) {
        /// Length of the shortest line that gets a sign, in points.
        const MIN_LINE_LENGTH: f32 = 24.0;
        let far = (b - a).length();
        if far < MIN_LINE_LENGTH || !far.is_finite() {
            return;
        }
        let colour = self.line_colour(painter, drawn);
        for part in place_sign(sign, [a, b].map(|at| [f64::from(at.x), f64::from(at.y)]), 1.0) {
            paint_part(painter, part, colour);
        }
        let entry = self.entry().and_then(|entry| entry.annotations.get(drawn.annotation));
        if let Some(annotation) = entry.filter(|_| drawn.kind.row().has_length) {
            let text = self.session.site.units.length(annotation.length_m.unwrap_or(1.0), 2);
            tag(painter, a + 0.5 * (b - a), Align2::CENTER_CENTER, &text, colour);
        }
    }
}

fn paint_part(painter: &Painter, part: PlacedShape, colour: Color32) {
    let at = |[x, y]: [f64; 2]| Pos2::new(x as f32, y as f32);
    let path = |points: Vec<[f64; 2]>| points.into_iter().map(at).collect::<Vec<Pos2>>();
    match part {
        PlacedShape::Stroke(points) => line(painter, &path(points), Pen::new(colour, 1.5).faint()),
        PlacedShape::Fill(points) => {
            painter.add(Shape::convex_polygon(path(points), colour, Stroke::NONE));
        }
        PlacedShape::Ring(centre, radius) => {
            painter.circle_stroke(at(centre), radius as f32, Stroke::new(1.5, colour));
        }
        PlacedShape::Disc(centre, radius) => {
            painter.circle_filled(at(centre), radius as f32, colour);
        }
    }
}
