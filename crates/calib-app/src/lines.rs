//! Drawn lines on an image: in the colour of their kind or residual, with a second sign, extended.

use calib_core::{Annotation, Kind, Pixel, Residual, SiteCamera, line_name};
use egui::{Align2, Color32, Painter, Pos2, Stroke, Vec2};

use crate::hit::Part;
use crate::overlay::Overlay;
use crate::paint::{Pen, handle, is_lit, line, tag};
use crate::theme::{self, on_image};
use crate::units::Units;

impl Overlay<'_> {
    pub(crate) fn paint_annotation(
        &self,
        painter: &Painter,
        entry: &SiteCamera,
        index: usize,
        drawn: &Annotation,
    ) {
        let sigma = entry.sigma_px.unwrap_or(1.0);
        let dark = theme::palette(painter.ctx());
        for (segment, pixels) in drawn.polylines().enumerate() {
            let of = |r: &&Residual| r.annotation == Some(index) && r.segment == Some(segment);
            let residual = self.residual(of);
            let suspect = residual.is_some_and(|r| r.outlier);
            let mut colour = theme::kind(drawn.kind);
            if let Some(residual) = residual.filter(|_| self.layers.by_residual) {
                colour = theme::residual(dark, residual.px.abs() / sigma);
            }
            let lit = self.lit == Some((index, segment))
                || self.session.camera == self.camera
                    && self.session.selection.contains(&Part::Line { annotation: index, segment });
            let width = if lit { 3.0 } else { 2.0 };
            let points = self.path(&pixels);
            let pen = match (drawn.off, suspect) {
                (true, _) => Pen::new(colour.gamma_multiply(0.6), width).dashed(&[3.0, 6.0]),
                (false, true) => {
                    self.halo(painter, &points);
                    Pen::new(on_image::BAD, width).dashed(&[6.0, 4.0])
                }
                (false, false) => Pen::new(colour, width),
            };
            let colour = if suspect { on_image::BAD } else { colour };
            if self.layers.extensions && lit && drawn.kind != Kind::Straight {
                self.extend(painter, &pixels, colour);
            }
            line(painter, &points, pen);
            second_cue(painter, (drawn, segment), &points, colour, self.session.units);
            for &at in &points {
                handle(painter, at, colour);
            }
            if self.labels && (lit || suspect) {
                self.name_line(painter, entry, (index, segment), &points, residual);
            }
        }
    }

    fn name_line(
        &self,
        painter: &Painter,
        entry: &SiteCamera,
        (index, segment): (usize, usize),
        points: &[Pos2],
        residual: Option<&Residual>,
    ) {
        let Some(&at) = points.last() else { return };
        let name = line_name(&entry.annotations, index, segment);
        let (text, colour) = match residual {
            Some(r) if r.outlier => (format!("{name} set aside {:.1} px", r.px.abs()), on_image::BAD),
            Some(r) => (format!("{name} {:.1} px", r.px.abs()), on_image::WHITE),
            None => (name, on_image::WHITE),
        };
        tag(painter, at + Vec2::new(14.0, 8.0), Align2::LEFT_TOP, &text, colour);
    }

    /// Blinks for a while, then stays lit.
    fn halo(&self, painter: &Painter, points: &[Pos2]) {
        if is_lit(painter.ctx(), self.time) {
            line(painter, points, Pen::new(on_image::BAD.gamma_multiply(0.35), 9.0).bare());
        }
    }

    /// The line beyond its ends, to its vanishing point, as the lens bends it.
    fn extend(&self, painter: &Painter, pixels: &[Pixel], colour: Color32) {
        let (Some(camera), Some(&a), Some(&b)) =
            (self.session.solved.pose(self.camera), pixels.first(), pixels.last())
        else {
            return;
        };
        let (Some(p), Some(q)) = (camera.undistort(a), camera.undistort(b)) else { return };
        const STEPS: i32 = 60;
        const REACH: f64 = 8.0;
        let at = |t: f64| {
            let point = calib_core::UndistortedPixel::new(p.u + t * (q.u - p.u), p.v + t * (q.v - p.v));
            camera.distort(point).map(|pixel| self.at(pixel))
        };
        let side = |from: f64, to: f64| -> Vec<Pos2> {
            (0..=STEPS).map_while(|i| at(from + (to - from) * f64::from(i) / f64::from(STEPS))).collect()
        };
        for points in [side(0.0, -REACH), side(1.0, 1.0 + REACH)] {
            line(painter, &points, Pen::new(colour, 1.25).dashed(&[2.0, 5.0]).bare());
        }
    }
}

/// The sign of a kind, so that colour is never alone.
fn second_cue(
    painter: &Painter,
    (drawn, segment): (&Annotation, usize),
    points: &[Pos2],
    colour: Color32,
    units: Units,
) {
    let (Some(&a), Some(&b)) = (points.first(), points.last()) else { return };
    let (middle, by) = (a + 0.5 * (b - a), b - a);
    if by.length() < 24.0 || !by.length().is_finite() {
        return;
    }
    let along = by.normalized();
    let across = Vec2::new(-along.y, along.x);
    let at = |s: f32, t: f32| middle + s * along + t * across;
    let pen = Pen::new(colour, 1.5).faint();
    let stroke = |points: &[Pos2]| line(painter, points, pen);
    match drawn.kind {
        Kind::Vertical => {
            let down = if along.y >= 0.0 { 1.0 } else { -1.0 };
            let points = vec![at(4.0 * down, 0.0), at(-4.0 * down, 4.0), at(-4.0 * down, -4.0)];
            painter.add(egui::Shape::convex_polygon(points, colour, Stroke::NONE));
        }
        Kind::Parallel => {
            for s in [-3.0, 2.0] {
                stroke(&[at(s - 4.0, 4.0), at(s, 0.0), at(s - 4.0, -4.0)]);
            }
        }
        Kind::Perpendicular => stroke(&[at(-4.0, 0.0), at(-4.0, -8.0), at(4.0, -8.0), at(4.0, 0.0)]),
        Kind::EqualLength => {
            for s in [-2.0, 2.0] {
                stroke(&[at(s, 5.0), at(s, -5.0)]);
            }
        }
        Kind::KnownLength => {
            for end in [a, b] {
                stroke(&[end + 6.0 * across, end - 6.0 * across]);
            }
            let length = drawn.length_m.unwrap_or(1.0);
            tag(painter, middle, Align2::CENTER_CENTER, &units.length(length, 2), colour);
        }
        Kind::Upright => {
            painter.circle_stroke(a, 7.0, Stroke::new(1.5, colour));
            painter.circle_filled(b, 5.0, colour);
        }
        // An edge, and what has no sign of its own.
        _ => {}
    }
    // A second direction at right angles to a parallel group carries the square too.
    if drawn.may_be_tied() && drawn.at_right_angles_to.is_some() && segment == 0 {
        stroke(&[at(6.0, 0.0), at(6.0, -8.0), at(14.0, -8.0), at(14.0, 0.0)]);
    }
}
