//! The straight edges of a still, to a fraction of a pixel, each with its own noise.
//!
//! Along an edge the steepest places across it are off the line through them by an rms r. What is next to each other
//! shares its noise (the pixels of one blur), so that of n pixels `m = n / BLUR` places are independent, and the ends of
//! the line are known to `2 r / sqrt(m)`: the variance of a fitted line at its end is four times that of its mean. A
//! part is in common to all places of an edge, as its shade is, and does not average: `COMMON`.

use image::RgbImage;

use crate::edges::{self, Edge};
use crate::line_segment::LineSegment;
use crate::pull::found;

/// Pixels along an edge that share their noise.
const BLUR: f64 = 4.0;
/// What a whole edge may be off, in pixels.
const COMMON: f64 = 0.3;
/// Of more edges than this the shortest keep the noise of the detector: a bound on time.
const MOST: usize = 800;
/// An edge that moves by more than this is another one, in pixels.
const SAME: f64 = 2.0;

/// The straight edges of an image with their noise, the longest first.
#[must_use]
pub fn line_segments(image: &RgbImage) -> Vec<LineSegment> {
    let edges = edges::find(image).into_iter().enumerate();
    edges.map(|(rank, edge)| if rank < MOST { measured(image, edge) } else { as_detected(edge) }).collect()
}

const fn as_detected(ends: Edge) -> LineSegment {
    LineSegment { ends, sigma: LineSegment::DETECTED }
}

/// An edge pulled onto the steepest places along it.
fn measured(image: &RgbImage, edge: Edge) -> LineSegment {
    let Some(found) = found(image, edge) else { return as_detected(edge) };
    if found.ends.iter().zip(edge).any(|(end, was)| end.distance(was) > SAME) {
        return as_detected(edge);
    }
    let independent = (found.seen / BLUR).max(1.0);
    LineSegment { ends: found.ends, sigma: COMMON.hypot(2.0 * found.rms / independent.sqrt()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    #[test]
    fn an_edge_is_found_within_its_noise() {
        // A step that leans, as a pixel integrates it.
        let at = |v: f64| 80.37 + 0.21 * v;
        let picture = RgbImage::from_fn(200, 150, |x, y| {
            let covered = (f64::from(x) + 1.0 - at(f64::from(y) + 0.5)).clamp(0.0, 1.0);
            Rgb([(60.0 + 120.0 * covered) as u8; 3])
        });
        let found = line_segments(&picture);
        let edge = found.first().expect("there is one edge");
        for end in edge.ends {
            let off = (end.u - at(end.v)) / 1.0_f64.hypot(0.21);
            assert!(off.abs() < 2.0 * edge.sigma && edge.sigma < 0.6, "{off} px off, sigma {}", edge.sigma);
        }
    }
}
