//! Straight edges of a still, to be offered under the cursor.

use calib_core::Pixel;
use image::{Rgb, RgbImage};

use crate::segment::to_segment;

/// A straight edge, in raw pixels.
pub type Edge = [Pixel; 2];

/// Edges shorter than this say too little to be offered, in pixels.
const LEAST: f64 = 24.0;
/// So much of an edge at either end is left to drawing by hand.
const ENDS: f64 = 0.15;

/// Brightness of every pixel.
fn grey(image: &RgbImage) -> Vec<u8> {
    let brightness = |pixel: &Rgb<u8>| {
        let [r, g, b] = pixel.0.map(u32::from);
        ((299 * r + 587 * g + 114 * b) / 1000) as u8
    };
    image.pixels().map(brightness).collect()
}

/// The straight edges of an image (Grompone von Gioi et al. 2012), the longest first.
#[must_use]
pub fn find(image: &RgbImage) -> Vec<Edge> {
    let (width, height) = image.dimensions();
    let found = lsdetect::detect(&grey(image), width as usize, height as usize, lsdetect::SCALE);
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

/// Edges as numbers, four each.
#[must_use]
pub fn to_numbers(edges: &[Edge]) -> Vec<f64> {
    edges.iter().flatten().flat_map(|pixel| [pixel.u, pixel.v]).collect()
}

/// Edges of numbers.
#[must_use]
pub fn from_numbers(numbers: &[f64]) -> Vec<Edge> {
    numbers.chunks_exact(4).map(|n| [Pixel::new(n[0], n[1]), Pixel::new(n[2], n[3])]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_edge_of_a_step_is_found_where_it_is() {
        let picture = RgbImage::from_fn(160, 120, |x, _| Rgb([if x < 70 { 40 } else { 200 }; 3]));
        let edges = find(&picture);
        let [a, b] = edges[0];
        assert!((a.u - 70.0).abs() < 1.0 && (b.u - 70.0).abs() < 1.0, "{a:?} {b:?}");
        assert_eq!(under(&edges, Pixel::new(71.0, 60.0), 3.0), Some([a, b]));
        assert_eq!(under(&edges, Pixel::new(71.0, a.v.min(b.v) + 2.0), 3.0), None);
    }

    #[test]
    fn edges_survive_as_numbers() {
        let edges =
            [[Pixel::new(1.0, 2.0), Pixel::new(3.0, 4.0)], [Pixel::new(5.0, 6.5), Pixel::new(7.0, 8.0)]];
        assert_eq!(from_numbers(&to_numbers(&edges)), edges);
    }
}
