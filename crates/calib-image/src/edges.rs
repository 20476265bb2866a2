//! Straight edges of an image, to a fraction of a pixel, each with its own standard deviation.
//!
//! The cursor of the editor snaps to these edges, and the automatic calibration uses them. At samples along
//! an edge, the position of the steepest brightness change across the edge deviates from the fitted line. The
//! RMS of these deviations is `r`. Neighbouring pixels share their noise, because of blur. Of `n` pixels,
//! only `m = n / NOISE_LENGTH_PX` samples are therefore independent. The ends of the line have the standard
//! deviation `2 r / sqrt(m)`: a fitted line has four times as much variance at its end as on average. A
//! systematic part, for example from shading, is common to all samples of an edge and does not average out:
//! `SYSTEMATIC_SIGMA_PX`.

use calib_core::Pixel;
use image::{Rgb, RgbImage};

use nalgebra::{Matrix3, Vector3};

use crate::line_segment::{LineSegment, Rise, distance_to_segment};
use crate::pull::{FoundEdge, MAX_INLIER_DISTANCE_PX, MIN_COVERED_FRACTION, find_edge_along, robust_line};

/// Straight edge, by its ends in raw pixels.
pub type Edge = [Pixel; 2];

/// Smallest length of a detected edge, in pixels.
const MIN_LENGTH_PX: f64 = 24.0;
/// Fraction of an edge, at either end, that does not attract the cursor, so that lines can start there
/// freely.
const END_FRACTION: f64 = 0.15;

/// Converts an image to brightness, one byte a pixel, row by row.
fn grey(image: &RgbImage) -> Vec<u8> {
    image.pixels().map(pixel_brightness).collect()
}

/// Returns the brightness of a pixel, 0 to 255.
pub(crate) fn pixel_brightness(pixel: &Rgb<u8>) -> u8 {
    let [r, g, b] = pixel.0.map(u32::from);
    ((299 * r + 587 * g + 114 * b) / 1000) as u8
}

/// Detects the straight edges of an image (Grompone von Gioi et al. 2012), the longest first.
#[must_use]
pub fn detect(image: &RgbImage) -> Vec<Edge> {
    let (width, height) = image.dimensions();
    let found = lsdetect::detect(&grey(image), width as usize, height as usize, lsdetect::SCALE);
    // The detector has its origin at the centre of the first pixel; our pixels start at the corner.
    let pixel = |x: f64, y: f64| Pixel::new(x + 0.5, y + 0.5);
    let mut edges: Vec<Edge> = found
        .unwrap_or_default()
        .into_iter()
        .map(|segment| [pixel(segment.x1, segment.y1), pixel(segment.x2, segment.y2)])
        .filter(|[a, b]| a.distance(*b) >= MIN_LENGTH_PX && a.is_finite() && b.is_finite())
        .collect();
    edges.sort_by(|a, b| b[0].distance(b[1]).total_cmp(&a[0].distance(a[1])));
    edges
}

/// Returns the nearest edge within `radius` pixels of a pixel. Edges with an end near the pixel are ignored.
#[must_use]
pub fn edge_at(edges: &[Edge], at: Pixel, radius: f64) -> Option<Edge> {
    let is_inner = |[a, b]: &Edge| {
        let along = (at.u - a.u) * (b.u - a.u) + (at.v - a.v) * (b.v - a.v);
        let share = along / a.distance(*b).powi(2);
        (END_FRACTION..=1.0 - END_FRACTION).contains(&share)
    };
    let near = edges
        .iter()
        .filter(|edge| is_inner(edge))
        .map(|edge| (*edge, distance_to_segment(edge[0], edge[1], at)));
    near.filter(|(_, far)| *far <= radius).min_by(|a, b| a.1.total_cmp(&b.1)).map(|(edge, _)| edge)
}

/// Converts edges to a list of numbers, four for each edge: u and v of both ends, in raw pixels.
#[must_use]
pub fn to_numbers(edges: &[Edge]) -> Vec<f64> {
    edges.iter().flatten().flat_map(|pixel| [pixel.u, pixel.v]).collect()
}

/// Converts a list of numbers, as from [`to_numbers`], to edges.
#[must_use]
pub fn from_numbers(numbers: &[f64]) -> Vec<Edge> {
    numbers.chunks_exact(4).map(|n| [Pixel::new(n[0], n[1]), Pixel::new(n[2], n[3])]).collect()
}

/// Correlation length of the noise along an edge, in pixels.
const NOISE_LENGTH_PX: f64 = 4.0;
/// Standard deviation of the error common to all points of an edge, across the edge, in pixels.
const SYSTEMATIC_SIGMA_PX: f64 = 0.3;
/// Largest number of edges with measured noise, which limits the computing time. The remaining, shorter edges
/// have the standard deviation of the detector.
const MAX_MEASURED_EDGES: usize = 800;
/// Largest displacement of an edge by the measurement, in pixels; beyond it, the measured edge is a different
/// one.
const MAX_DISPLACEMENT_PX: f64 = 2.0;

/// Detects the straight edges of an image with their standard deviations, the longest first.
#[must_use]
pub fn line_segments(image: &RgbImage) -> Vec<LineSegment> {
    let edges = detect(image).into_iter().enumerate();
    edges
        .map(|(rank, edge)| if rank < MAX_MEASURED_EDGES { measure(image, edge) } else { as_detected(edge) })
        .collect()
}

/// Returns an edge as detected, with the standard deviation of the detector.
const fn as_detected(ends: Edge) -> LineSegment {
    LineSegment::new(ends, LineSegment::DETECTOR_SIGMA_PX)
}

/// Refines an edge and measures its standard deviation, from the steepest brightness changes along the edge.
/// Without a refined edge nearby, the edge stays as detected.
fn measure(image: &RgbImage, edge: Edge) -> LineSegment {
    let Some(found) = find_edge_along(image, edge) else { return as_detected(edge) };
    if found.ends.iter().zip(edge).any(|(end, was)| end.distance(was) > MAX_DISPLACEMENT_PX) {
        return as_detected(edge);
    }
    let independent = (found.covered_length / NOISE_LENGTH_PX).max(1.0);
    let sigma = SYSTEMATIC_SIGMA_PX.hypot(2.0 * found.rms / independent.sqrt());
    LineSegment {
        rise: measure_rise(&found, edge[0].distance(edge[1])),
        ..LineSegment::new(found.ends, sigma)
    }
}

/// Measures the rise of an edge of this length from samples `[s, t]` along and across it, all in pixels.
///
/// A parabola `t = a + b x + c x^2`, with `x` from the middle of the edge, is fitted robustly. Its rise is
/// `-c / 4` if `x` is in units of the length. With `m` independent samples of the standard deviation `r`,
/// evenly spaced over the length, `c` has the standard deviation `r sqrt(180 / m)`.
fn measure_rise(FoundEdge { samples, searched, .. }: &FoundEdge, length: f64) -> Option<Rise> {
    /// Number of fits, each to the samples near the line or parabola of the previous fit.
    const ROUNDS: usize = 4;
    let row = |[s, _]: &[f64; 2]| {
        let x = s / length - 0.5;
        Vector3::new(1.0, x, x * x)
    };
    let (_, _, mut used) = robust_line(samples, (MIN_COVERED_FRACTION * samples.len() as f64) as usize)?;
    let mut parabola = Vector3::zeros();
    for _ in 0..ROUNDS {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for sample in &used {
            normal += row(sample) * row(sample).transpose();
            right += row(sample) * sample[1];
        }
        parabola = normal.cholesky()?.solve(&right);
        let is_near =
            |sample: &[f64; 2]| (sample[1] - parabola.dot(&row(sample))).abs() <= MAX_INLIER_DISTANCE_PX;
        used = samples.iter().copied().filter(is_near).collect();
        if (used.len() as f64) < MIN_COVERED_FRACTION * samples.len() as f64 {
            return None;
        }
    }
    let square: f64 = used.iter().map(|sample| (sample[1] - parabola.dot(&row(sample))).powi(2)).sum();
    let rms = (square / used.len() as f64).sqrt();
    let covered = length * used.len() as f64 / *searched as f64;
    let independent = (covered / NOISE_LENGTH_PX).max(1.0);
    Some(Rise { px: -0.25 * parabola[2], sigma: 0.25 * rms * (180.0 / independent).sqrt() })
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    #[test]
    fn the_edge_of_a_step_is_found_at_its_position() {
        let picture = RgbImage::from_fn(160, 120, |x, _| Rgb([if x < 70 { 40 } else { 200 }; 3]));
        let edges = detect(&picture);
        let [a, b] = edges[0];
        assert!((a.u - 70.0).abs() < 1.0 && (b.u - 70.0).abs() < 1.0, "{a:?} {b:?}");
        assert_eq!(edge_at(&edges, Pixel::new(71.0, 60.0), 3.0), Some([a, b]));
        assert_eq!(edge_at(&edges, Pixel::new(71.0, a.v.min(b.v) + 2.0), 3.0), None);
    }

    #[test]
    fn edges_survive_the_conversion_to_numbers() {
        let edges =
            [[Pixel::new(1.0, 2.0), Pixel::new(3.0, 4.0)], [Pixel::new(5.0, 6.5), Pixel::new(7.0, 8.0)]];
        assert_eq!(from_numbers(&to_numbers(&edges)), edges);
    }

    #[test]
    fn the_rise_of_an_arc_is_measured() {
        // A slanted arc, integrated over each pixel; the middle is 1.2 px off its chord.
        let at = |v: f64| 80.0 + 0.2 * v - 1.2 * (1.0 - ((v - 75.0) / 75.0).powi(2));
        let picture = RgbImage::from_fn(200, 150, |x, y| {
            let covered = (f64::from(x) + 1.0 - at(f64::from(y) + 0.5)).clamp(0.0, 1.0);
            Rgb([(60.0 + 120.0 * covered) as u8; 3])
        });
        let measured = measure(&picture, [Pixel::new(at(10.0), 10.0), Pixel::new(at(140.0), 140.0)]);
        let rise = measured.rise.expect("the arc is followed");
        // The part between both ends has (130 / 150)^2 of the rise, across the slanted chord.
        let expected = 1.2 * (130.0 / 150.0_f64).powi(2) / 1.0_f64.hypot(0.2);
        assert!((rise.px - expected).abs() < 0.1 && rise.sigma < 0.1, "{rise:?}, expected {expected}");
    }

    #[test]
    fn an_edge_is_found_within_its_noise() {
        // A slanted step, integrated over each pixel.
        let at = |v: f64| 80.37 + 0.21 * v;
        let picture = RgbImage::from_fn(200, 150, |x, y| {
            let covered = (f64::from(x) + 1.0 - at(f64::from(y) + 0.5)).clamp(0.0, 1.0);
            Rgb([(60.0 + 120.0 * covered) as u8; 3])
        });
        let found = line_segments(&picture);
        let edge = found.first().expect("one edge is found");
        for end in edge.ends {
            let off = (end.u - at(end.v)) / 1.0_f64.hypot(0.21);
            assert!(off.abs() < 2.0 * edge.sigma && edge.sigma < 0.6, "{off} px off, sigma {}", edge.sigma);
        }
    }
}
