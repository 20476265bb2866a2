//! The horizon on an image; where several cameras fit, those of two of them and all that lies between.

use calib_core::{Camera, Covariance, SiteCamera, horizon};
use egui::{Align2, Painter, Pos2, Stroke, Vec2};

use crate::family::Fit;
use crate::overlay::Overlay;
use crate::paint::{Pen, line, tag};
use crate::theme::on_image;

/// Points between two strokes of the hatching.
const HATCH: f32 = 9.0;
/// Points between the places where its ends are looked for.
const STEP: f32 = 3.0;

fn pen() -> Pen {
    Pen::new(on_image::WHITE, 1.5).dashed(&[14.0, 5.0, 3.0, 5.0])
}

impl Overlay<'_> {
    pub(crate) fn paint_horizon(&self, painter: &Painter, camera: &Camera, entry: &SiteCamera) {
        if !self.layers.horizon {
            return;
        }
        match self.fits {
            Some(fits) => self.paint_band(painter, fits, entry),
            None => {
                let sigma = camera.covariance.0[Covariance::PITCH][Covariance::PITCH].sqrt();
                let text = if sigma > 0.0 {
                    format!("horizon \u{b1} {:.0} px", (sigma * camera.focal).max(1.0))
                } else {
                    "horizon".into()
                };
                let pieces = self.paint_line(painter, camera, entry);
                self.name_horizon(painter, &pieces, 1.0, &text);
            }
        }
    }

    fn paint_line(&self, painter: &Painter, camera: &Camera, entry: &SiteCamera) -> Vec<Vec<Pos2>> {
        let pieces = horizon(camera, entry.size());
        let pieces: Vec<Vec<Pos2>> = pieces.iter().map(|piece| self.path(piece)).collect();
        for piece in &pieces {
            line(painter, piece, pen());
        }
        pieces
    }

    /// A tag on a horizon, at this share of the width that shows it.
    fn name_horizon(&self, painter: &Painter, pieces: &[Vec<Pos2>], share: f32, text: &str) {
        let clip = painter.clip_rect().shrink(40.0);
        let x = clip.left() + share * clip.width();
        let shown = pieces.iter().flatten().filter(|at| clip.contains(**at));
        let nearest = shown.min_by(|a, b| (a.x - x).abs().total_cmp(&(b.x - x).abs()));
        if let Some(&at) = nearest.filter(|_| self.labels) {
            tag(painter, at - Vec2::new(0.0, 4.0), Align2::RIGHT_BOTTOM, text, on_image::WHITE);
        }
    }

    /// The horizons of two cameras that fit, and hatching between them.
    fn paint_band(&self, painter: &Painter, fits: &[Fit; 2], entry: &SiteCamera) {
        let clip = painter.clip_rect();
        let lines = fits.each_ref().map(|fit| self.paint_line(painter, &fit.pose, entry));
        let columns = (clip.width() / STEP).ceil() as usize + 1;
        let heights = lines.each_ref().map(|pieces| heights(pieces, clip.left(), columns));
        let between: Vec<Option<[f32; 2]>> = heights[0]
            .iter()
            .zip(&heights[1])
            .map(|(a, b)| a.zip(*b).map(|(a, b)| [a.min(b).max(clip.top()), a.max(b).min(clip.bottom())]))
            .collect();
        for [a, b] in hatched(&between, clip.left()) {
            painter.line_segment([a, b], Stroke::new(1.0, on_image::DOUBT.gamma_multiply(0.45)));
        }
        for (which, fit) in fits.iter().enumerate() {
            let text = format!("horizon at {:.0}\u{b0}", fit.view);
            self.name_horizon(painter, &lines[which], [0.45, 0.2][which], &text);
        }
        let middle = (7 * columns / 8..columns).chain(0..7 * columns / 8).find_map(|column| {
            let [top, bottom] = between[column].filter(|[top, bottom]| bottom - top > 28.0)?;
            Some(Pos2::new(clip.left() + column as f32 * STEP, 0.5 * (top + bottom)))
        });
        if let Some(at) = middle.filter(|_| self.labels) {
            tag(painter, at, Align2::CENTER_CENTER, "horizon somewhere here", on_image::DOUBT);
        }
    }
}

/// How high a line runs at every column, from the left one on.
fn heights(pieces: &[Vec<Pos2>], left: f32, columns: usize) -> Vec<Option<f32>> {
    let mut heights = vec![None; columns];
    for pair in pieces.iter().flat_map(|piece| piece.windows(2)) {
        let (a, b) = if pair[0].x <= pair[1].x { (pair[0], pair[1]) } else { (pair[1], pair[0]) };
        let column = |x: f32| ((x - left) / STEP).clamp(0.0, columns as f32);
        for (index, height) in
            heights.iter_mut().enumerate().take(column(b.x).ceil() as usize).skip(column(a.x).ceil() as usize)
        {
            let share = (left + index as f32 * STEP - a.x) / (b.x - a.x).max(f32::MIN_POSITIVE);
            *height = Some(a.y + share.clamp(0.0, 1.0) * (b.y - a.y));
        }
    }
    heights
}

/// Rising strokes that fill what lies between.
fn hatched(between: &[Option<[f32; 2]>], left: f32) -> Vec<[Pos2; 2]> {
    let Some(low) = between.iter().flatten().map(|[top, _]| *top).reduce(f32::min) else { return Vec::new() };
    let high = between.iter().flatten().map(|[_, bottom]| *bottom).fold(low, f32::max);
    let right = left + between.len() as f32 * STEP;
    let mut strokes = Vec::new();
    // Along a stroke x + y is the same.
    let count = ((right + high - left - low) / HATCH).ceil() as usize;
    for stroke in 0..count {
        let sum = left + low + stroke as f32 * HATCH;
        let mut start: Option<Pos2> = None;
        let mut last = Pos2::ZERO;
        for (column, ends) in between.iter().enumerate() {
            let x = left + column as f32 * STEP;
            let at = Pos2::new(x, sum - x);
            let is_inside = ends.is_some_and(|[top, bottom]| (top..=bottom).contains(&at.y));
            if is_inside {
                start = start.or(Some(at));
                last = at;
            } else if let Some(from) = start.take() {
                strokes.push([from, last]);
            }
        }
        strokes.extend(start.map(|from| [from, last]));
    }
    strokes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hatching_stays_between_the_lines() {
        let lines = [
            vec![Pos2::new(-50.0, 20.0), Pos2::new(130.0, 60.0), Pos2::new(400.0, 10.0)],
            vec![Pos2::new(400.0, 150.0), Pos2::new(-50.0, 110.0)],
        ];
        let heights = lines.clone().map(|line| heights(&[line], 0.0, 101));
        let between: Vec<_> =
            heights[0].iter().zip(&heights[1]).map(|(a, b)| a.zip(*b).map(|(a, b)| [a, b])).collect();
        assert!(between.iter().all(Option::is_some), "both lines cross every column");
        let strokes = hatched(&between, 0.0);
        assert!(strokes.len() > 30, "{}", strokes.len());
        for at in strokes.into_iter().flatten() {
            let [top, bottom] = between[(at.x / STEP).round() as usize].unwrap();
            assert!(top <= at.y && at.y <= bottom, "{at:?} outside {top} to {bottom}");
        }
    }
}
