//! Edges curved by distortion, traced as an operator would trace them.
//!
//! A curved edge is an arc in the image that is detected as several straight pieces. Let `v = c u^2` be an
//! arc of length `L` with the curvature `2 c`. The least-squares line through the arc is `v = c L^2 / 12`.
//! The line crosses the arc at `L / (2 sqrt 3)` on either side of its middle, for any curvature. These two
//! points of each piece are on the edge; the ends of the piece are not.

use std::f64::consts::FRAC_1_SQRT_2;

use calib_core::{Lens, Pixel, UndistortedPixel};

use crate::line_segment::LineSegment;

use super::curvature::rise_of_point;
use super::join::Line;

/// Largest number of edges returned.
const MAX_EDGES: usize = 8;
/// Smallest rise of an arc above its chord, in standard deviations of its points.
const MIN_RISE_SIGMAS: f64 = 4.0;
/// Smallest distance between the middles of two returned edges, as a fraction of the image diagonal; closer
/// edges are redundant.
const MIN_DISTANCE: f64 = 0.06;

/// Curved edge.
struct Arc {
    /// Points on the edge, in raw pixels.
    points: Vec<Pixel>,
    /// Rise of the middle of the edge above its chord, in standard deviations.
    rise: f64,
}

/// Returns the edges that constrain the distortion the most, as polylines in raw pixels, the most curved first.
pub(super) fn curved_edges(lines: &[Line], segments: &[LineSegment], lens: &Lens) -> Vec<Vec<Pixel>> {
    let mut arcs: Vec<Arc> = lines.iter().filter_map(|line| arc(line, segments, lens)).collect();
    arcs.sort_by(|a, b| b.rise.total_cmp(&a.rise));
    let diagonal = 2.0 * lens.principal_point.distance(Pixel::new(0.0, 0.0));
    let mut shown: Vec<Vec<Pixel>> = Vec::new();
    for Arc { points, .. } in arcs {
        let is_apart = |other: &Vec<Pixel>| middle(other).distance(middle(&points)) > MIN_DISTANCE * diagonal;
        if shown.len() < MAX_EDGES && shown.iter().all(is_apart) {
            shown.push(points);
        }
    }
    shown
}

/// Returns the mean of the points.
fn middle(points: &[Pixel]) -> Pixel {
    let count = points.len().max(1) as f64;
    let sum = |of: fn(&Pixel) -> f64| points.iter().map(of).sum::<f64>() / count;
    Pixel::new(sum(|p| p.u), sum(|p| p.v))
}

/// Traces an edge detected in several pieces; `None` if its curvature is not significant.
fn arc(line: &Line, segments: &[LineSegment], lens: &Lens) -> Option<Arc> {
    let pieces: Vec<&LineSegment> = line.pieces.iter().filter_map(|&index| segments.get(index)).collect();
    if pieces.len() < 2 {
        return None;
    }
    let rise = rise(line, lens)? / line.end_sigma;
    let [a, b] = line.ends;
    let along = |p: &Pixel| p.u * (b[0] - a[0]) + p.v * (b[1] - a[1]);
    let mut points: Vec<Pixel> = pieces.into_iter().flat_map(points_on_edge).collect();
    points.sort_by(|p, q| along(p).total_cmp(&along(q)));
    (rise > MIN_RISE_SIGMAS).then_some(Arc { points, rise })
}

/// Returns the two points of a piece that are on the edge for any curvature.
fn points_on_edge(piece: &LineSegment) -> [Pixel; 2] {
    /// Distance of the points from the middle, as a fraction of half the length: 1 / sqrt(3).
    const CROSSING_FRACTION: f64 = 0.577_350_269_189_625_8;
    let [a, b] = piece.ends;
    let at = |t: f64| {
        Pixel::new(0.5 * ((1.0 - t) * a.u + (1.0 + t) * b.u), 0.5 * ((1.0 - t) * a.v + (1.0 + t) * b.v))
    };
    [at(-CROSSING_FRACTION), at(CROSSING_FRACTION)]
}

/// Returns the rise of the middle of an edge above its chord, caused by distortion, in pixels. The rise is
/// divided by sqrt(2), for the noise of the chord.
fn rise(line: &Line, lens: &Lens) -> Option<f64> {
    let centre = lens.principal_point;
    let shown = |p: [f64; 2]| lens.distort(UndistortedPixel { u: p[0] + centre.u, v: p[1] + centre.v });
    let [a, b] = line.ends;
    let (from, to) = (shown(a)?, shown(b)?);
    let top = shown([0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])])?;
    // The chord is assumed to be as uncertain as the middle.
    Some(rise_of_point(top, [from, to]).abs() * FRAC_1_SQRT_2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proposal::join;
    use calib_core::{BrownConrady, Distortion};

    /// Creates a horizontal edge at image row `v`, distorted with this k1, in pieces as from a detector.
    fn pieces(k1: f64, v: f64) -> Vec<LineSegment> {
        let lens = lens(k1);
        let at = |u: f64| lens.distort(UndistortedPixel { u, v }).unwrap();
        let piece = |i: u32| {
            let (from, to) = (100.0 + 280.0 * f64::from(i), 370.0 + 280.0 * f64::from(i));
            let points: Vec<Pixel> = (0..=60).map(|k| at(from + (to - from) * f64::from(k) / 60.0)).collect();
            let mean = |of: &dyn Fn(&Pixel) -> f64| points.iter().map(of).sum::<f64>() / 61.0;
            let (mu, mv) = (mean(&|p| p.u), mean(&|p| p.v));
            let tilt = mean(&|p| (p.u - mu) * (p.v - mv)) / mean(&|p| (p.u - mu).powi(2));
            let end = |u: f64| Pixel::new(u, mv + tilt * (u - mu));
            LineSegment::new([end(points[0].u), end(points[60].u)], 0.3)
        };
        (0..6).map(piece).collect()
    }

    fn lens(k1: f64) -> Lens {
        let brown = BrownConrady { k1, k2: k1 * k1, ..BrownConrady::default() };
        let distortion = if k1 == 0.0 { Distortion::None } else { Distortion::BrownConrady(brown) };
        Lens { focal: 0.5 * 1920.0_f64.hypot(1080.0), distortion, ..Lens::pinhole(Pixel::new(960.0, 540.0)) }
    }

    #[test]
    fn an_arc_detected_in_straight_pieces_is_traced_on_the_edge() {
        let (k1, v) = (-0.2, 60.0);
        let segments = pieces(k1, v);
        let lines = join::lines(&segments, &lens(k1));
        let found = curved_edges(&lines, &segments, &lens(k1));
        assert!(found.len() == 1 && found[0].len() >= 8, "{found:?}");
        let off = |p: &Pixel| (lens(k1).undistort(*p).unwrap().v - v).abs();
        let traced = found[0].iter().map(off).fold(0.0, f64::max);
        let ends = segments.iter().flat_map(|s| s.ends).map(|p| off(&p)).fold(0.0, f64::max);
        assert!(traced < 0.1 && ends > 3.0 * traced, "{traced} px off the edge, the ends {ends} px");
    }

    #[test]
    fn undistorted_edges_are_not_returned() {
        let segments = pieces(0.0, 60.0);
        assert!(curved_edges(&join::lines(&segments, &lens(0.0)), &segments, &lens(0.0)).is_empty());
    }
}
