//! Horizon on an image; if several solutions of the camera fit equally well, the band between their horizons.

use calib_core::{Camera, Covariance, Pixel};

use calib_draw::{Geometry, Look, Meaning, horizon};
use calib_site::SiteCamera;
use egui::{Align2, Painter, Pos2, Stroke, Vec2};

use crate::overlay::Overlay;
use crate::paint::{Pen, line, tag};
use crate::theme::on_image;

/// Spacing of the hatch lines along the x axis, in points.
const HATCH_SPACING: f32 = 9.0;
/// Width of the columns at which the band between horizons is sampled, in points.
const COLUMN_WIDTH: f32 = 3.0;

impl Overlay<'_> {
    pub(crate) fn paint_horizon(&self, painter: &Painter, camera: &Camera, entry: &SiteCamera) {
        if !self.layers.horizon {
            return;
        }
        let Some(family) = self.family else {
            let sigma = camera.covariance.0[Covariance::PITCH][Covariance::PITCH].sqrt();
            let text = if sigma > 1.0 {
                // A sigma above one radian is shown as unknown.
                "horizon, uncertain".into()
            } else if sigma > 0.0 {
                format!("horizon \u{b1} {:.0} px", (sigma * camera.focal).max(1.0))
            } else {
                "horizon".into()
            };
            self.paint_named(painter, camera, entry, (1.0, &text));
            return;
        };
        if let Some(ends) = &family.ends {
            self.paint_band(painter, ends, entry);
        }
        for (fit, at) in family.shown.iter().zip([0.45, 0.2]) {
            let text = format!("horizon, field of view {:.0}\u{b0}", fit.view);
            self.paint_named(painter, &fit.pose, entry, (at, &text));
        }
    }

    /// Returns the visible pieces of the horizon of a camera, on the screen.
    fn horizon_of(&self, camera: &Camera, entry: &SiteCamera) -> Vec<Vec<Pos2>> {
        let items = horizon(camera, entry.size());
        items
            .iter()
            .filter_map(|item| match &item.geometry {
                Geometry::Polyline(points) => Some(self.path(points)),
                _ => None,
            })
            .collect()
    }

    /// Paints the horizon of a camera with its label at the fraction `share` of the canvas width.
    pub(crate) fn paint_named(
        &self,
        painter: &Painter,
        camera: &Camera,
        entry: &SiteCamera,
        (share, text): (f32, &str),
    ) {
        let pieces = self.horizon_of(camera, entry);
        for piece in &pieces {
            line(painter, piece, Pen::of(Look::of(Meaning::Horizon)));
        }
        let clip = painter.clip_rect().shrink(40.0);
        let x = clip.left() + share * clip.width();
        let shown = pieces.iter().flatten().filter(|at| clip.contains(**at));
        let nearest = shown.min_by(|a, b| (a.x - x).abs().total_cmp(&(b.x - x).abs()));
        if let Some(&at) = nearest.filter(|_| self.labels) {
            tag(painter, at - Vec2::new(0.0, 4.0), Align2::RIGHT_BOTTOM, text, on_image::WHITE);
        }
    }

    /// Hatches the band between the horizons of the two extreme solutions that fit the annotations.
    fn paint_band(&self, painter: &Painter, ends: &[Camera; 2], entry: &SiteCamera) {
        let clip = painter.clip_rect();
        let columns = (clip.width() / COLUMN_WIDTH).ceil() as usize + 1;
        let [w, h] = entry.size();
        let heights = ends.each_ref().map(|camera| {
            // The horizon of a camera that sees the floor in the middle of its image can be above the image.
            let sees_floor = camera.pixel_to_floor(Pixel::new(0.5 * w, 0.5 * h), 0.0).is_some();
            let beyond = if sees_floor { clip.top() } else { clip.bottom() };
            let heights = heights(&self.horizon_of(camera, entry), clip.left(), columns);
            heights.into_iter().map(|height| height.unwrap_or(beyond)).collect::<Vec<f32>>()
        });
        let between: Vec<[f32; 2]> = heights[0]
            .iter()
            .zip(&heights[1])
            .map(|(a, b)| [a.min(*b).max(clip.top()), a.max(*b).min(clip.bottom())])
            .collect();
        for [a, b] in hatched(&between, clip.left()) {
            painter.line_segment([a, b], Stroke::new(1.0, on_image::DOUBT.gamma_multiply(0.45)));
        }
        let start = 7 * columns / 8;
        let wide =
            (start..columns).chain(0..start).find(|&column| between[column][1] - between[column][0] > 28.0);
        if let Some(column) = wide.filter(|_| self.labels) {
            let [top, bottom] = between[column];
            let at = Pos2::new(clip.left() + column as f32 * COLUMN_WIDTH, 0.5 * (top + bottom));
            tag(painter, at, Align2::CENTER_CENTER, "horizon in this band", on_image::DOUBT);
        }
    }
}

/// Returns the screen y of a line at every column, from the left; `None` for a column that the line does not cross.
fn heights(pieces: &[Vec<Pos2>], left: f32, columns: usize) -> Vec<Option<f32>> {
    let mut heights = vec![None; columns];
    for pair in pieces.iter().flat_map(|piece| piece.windows(2)) {
        let (a, b) = if pair[0].x <= pair[1].x { (pair[0], pair[1]) } else { (pair[1], pair[0]) };
        let column = |x: f32| ((x - left) / COLUMN_WIDTH).clamp(0.0, columns as f32);
        for (index, height) in
            heights.iter_mut().enumerate().take(column(b.x).ceil() as usize).skip(column(a.x).ceil() as usize)
        {
            let share = (left + index as f32 * COLUMN_WIDTH - a.x) / (b.x - a.x).max(f32::MIN_POSITIVE);
            *height = Some(a.y + share.clamp(0.0, 1.0) * (b.y - a.y));
        }
    }
    heights
}

/// Returns rising strokes that hatch the band; `between` contains the upper and lower screen y of every
/// column.
fn hatched(between: &[[f32; 2]], left: f32) -> Vec<[Pos2; 2]> {
    let filled = between.iter().filter(|[top, bottom]| top < bottom);
    let Some(low) = filled.clone().map(|[top, _]| *top).reduce(f32::min) else { return Vec::new() };
    let high = filled.map(|[_, bottom]| *bottom).fold(low, f32::max);
    let right = left + between.len() as f32 * COLUMN_WIDTH;
    let mut strokes = Vec::new();
    // Strokes have constant x + y, at multiples of the spacing, so that they do not move with the band.
    let numbers =
        ((left + low) / HATCH_SPACING).floor() as i32..=((right + high) / HATCH_SPACING).ceil() as i32;
    for sum in numbers.map(|number| number as f32 * HATCH_SPACING) {
        let column = |x: f32| (((x - left) / COLUMN_WIDTH).max(0.0) as usize).min(between.len());
        let (from, to) = (column(sum - high), column(sum - low + COLUMN_WIDTH));
        let mut begun: Option<[Pos2; 2]> = None;
        for (column, [top, bottom]) in between.iter().enumerate().take(to).skip(from) {
            let x = left + column as f32 * COLUMN_WIDTH;
            let at = Pos2::new(x, sum - x);
            if (*top..=*bottom).contains(&at.y) {
                begun = Some([begun.map_or(at, |[start, _]| start), at]);
            } else {
                strokes.extend(begun.take());
            }
        }
        strokes.extend(begun);
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
        let between: Vec<[f32; 2]> =
            heights[0].iter().zip(&heights[1]).map(|(a, b)| [a.unwrap(), b.unwrap()]).collect();
        let strokes = hatched(&between, 0.0);
        assert!(strokes.len() > 30, "{}", strokes.len());
        for at in strokes.into_iter().flatten() {
            let [top, bottom] = between[(at.x / COLUMN_WIDTH).round() as usize];
            assert!(top <= at.y && at.y <= bottom, "{at:?} outside {top} to {bottom}");
        }
    }
}
