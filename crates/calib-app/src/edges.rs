//! Straight edges of stills, found once an image and off the frame's path, to be offered under the cursor.

use std::collections::BTreeMap;
use std::sync::Arc;

use calib_core::Pixel;
use egui::Context;
use image::RgbImage;

use crate::hit::to_segment;
use crate::task::Task;
use crate::work;

/// A straight edge, in raw pixels.
pub type Edge = [Pixel; 2];

/// Edges shorter than this say too little to be offered, in pixels.
const LEAST: f64 = 24.0;
/// So much of an edge at either end is left to drawing by hand.
const ENDS: f64 = 0.15;

#[derive(Debug)]
enum State {
    Looking(Task<Vec<Edge>>),
    Found(Vec<Edge>),
}

/// The edges of every still that was asked for.
#[derive(Debug, Default)]
pub struct Edges {
    stills: BTreeMap<String, State>,
    stopped: bool,
}

/// The straight edges of an image (Grompone von Gioi et al. 2012), the longest first.
#[must_use]
pub fn find(image: &RgbImage) -> Vec<Edge> {
    let (width, height) = image.dimensions();
    let grey: Vec<u8> = image
        .pixels()
        .map(|pixel| {
            let [r, g, b] = pixel.0.map(u32::from);
            ((299 * r + 587 * g + 114 * b) / 1000) as u8
        })
        .collect();
    let found = lsdetect::detect(&grey, width as usize, height as usize, lsdetect::SCALE);
    // The detector counts from the centre of the first pixel, we from its corner.
    let pixel = |x: f64, y: f64| Pixel::new(x + 0.5, y + 0.5);
    let mut edges: Vec<Edge> = found
        .unwrap_or_default()
        .into_iter()
        .map(|segment| [pixel(segment.x1, segment.y1), pixel(segment.x2, segment.y2)])
        .filter(|[a, b]| a.distance(*b) >= LEAST && a.is_finite() && b.is_finite())
        .collect();
    edges.sort_by(|a, b| b[0].distance(b[1]).total_cmp(&a[0].distance(a[1])));
    edges
}

impl Edges {
    /// The edges of a still; the first question starts the search.
    pub fn of(&mut self, ctx: &Context, name: &str, image: &Arc<RgbImage>) -> &[Edge] {
        if self.stopped && !self.stills.contains_key(name) {
            return &[];
        }
        let look = || State::Looking(work::find_edges(ctx, image));
        let state = self.stills.entry(name.to_owned()).or_insert_with(look);
        if let State::Looking(task) = state
            && let Some(edges) = task.poll()
        {
            *state = State::Found(edges);
        }
        match state {
            State::Found(edges) => edges,
            State::Looking(_) => &[],
        }
    }

    /// How many stills are being searched.
    #[must_use]
    pub fn looking(&self) -> usize {
        self.stills.values().filter(|state| matches!(state, State::Looking(_))).count()
    }

    /// Looks no further, until it is told to.
    pub fn stop(&mut self) {
        self.stopped = true;
        self.stills.retain(|_, state| matches!(state, State::Found(_)));
    }

    /// Looks on.
    pub const fn resume(&mut self) {
        self.stopped = false;
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.stills.clear();
        self.stopped = false;
    }
}

/// The edge under a pixel, if the pixel is not near one of its ends.
#[must_use]
pub fn under(edges: &[Edge], at: Pixel, radius: f64) -> Option<Edge> {
    let is_inner = |[a, b]: &Edge| {
        let along = (at.u - a.u) * (b.u - a.u) + (at.v - a.v) * (b.v - a.v);
        let share = along / a.distance(*b).powi(2);
        (ENDS..=1.0 - ENDS).contains(&share)
    };
    let near =
        edges.iter().filter(|edge| is_inner(edge)).map(|edge| (*edge, to_segment(edge[0], edge[1], at)));
    near.filter(|(_, far)| *far <= radius).min_by(|a, b| a.1.total_cmp(&b.1)).map(|(edge, _)| edge)
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    #[test]
    fn the_edge_of_a_step_is_found_where_it_is() {
        let picture = RgbImage::from_fn(160, 120, |x, _| Rgb([if x < 70 { 40 } else { 200 }; 3]));
        let edges = find(&picture);
        let [a, b] = edges[0];
        assert!((a.u - 70.0).abs() < 1.0 && (b.u - 70.0).abs() < 1.0, "{a:?} {b:?}");
        assert_eq!(under(&edges, Pixel::new(71.0, 60.0), 3.0), Some([a, b]));
        assert_eq!(under(&edges, Pixel::new(71.0, a.v.min(b.v) + 2.0), 3.0), None);
    }
}
