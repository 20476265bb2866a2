//! How straight a polyline is once a lens is taken out.

use crate::camera::{Lens, Pixel};
use crate::single::annotation::{Annotation, Kind};
use crate::single::constraints::Source;

/// A polyline and where it was drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Edge {
    /// Raw pixels along an edge that is straight in space.
    pub points: Vec<Pixel>,
    /// Where it comes from.
    pub source: Source,
}

/// Lines of three points and more, of whatever kind, that are not switched off.
pub(crate) fn edges(annotations: &[Annotation]) -> Vec<Edge> {
    let used = annotations.iter().enumerate().filter(|(_, a)| !a.off && a.kind != Kind::Upright);
    used.flat_map(|(annotation, drawn)| {
        let lines = drawn.polylines().enumerate().filter(|(_, points)| points.len() > 2);
        lines
            .map(move |(segment, points)| Edge { points, source: Source { annotation, segment } })
            .collect::<Vec<_>>()
    })
    .collect()
}

/// Distances of the points of a polyline from the best line through them once undistorted, in raw
/// pixels; `None` where the lens shows nothing.
pub(crate) fn straightness(lens: &Lens, points: &[Pixel]) -> Option<Vec<f64>> {
    let mut straight = Vec::with_capacity(points.len());
    let mut jacobian = Vec::with_capacity(points.len());
    for &point in points {
        let (at, gradient) = lens.undistort_with_jacobian(point)?;
        straight.push([at.u, at.v]);
        jacobian.push(gradient);
    }
    // The weights hang on the line's direction: twice is enough, for they change slowly with it.
    let mut weights = vec![1.0; points.len()];
    for _ in 0..2 {
        let ([x, y], _) = best_line(&straight, &weights);
        for (weight, [[a, b], [c, d]]) in weights.iter_mut().zip(&jacobian) {
            *weight = ((a * x + c * y).powi(2) + (b * x + d * y).powi(2)).max(f64::MIN_POSITIVE).recip();
        }
    }
    let ([x, y], c) = best_line(&straight, &weights);
    let distance = |([u, v], weight): (&[f64; 2], &f64)| (x * u + y * v - c) * weight.sqrt();
    // The side of the line that counts as positive must not jump with the coefficients: the left of
    // the way from the first point to the last.
    let (first, last) = (straight.first()?, straight.last()?);
    let sign = if x * (first[1] - last[1]) + y * (last[0] - first[0]) < 0.0 { -1.0 } else { 1.0 };
    Some(straight.iter().zip(&weights).map(|pair| sign * distance(pair)).collect())
}

/// Unit normal and offset of the line with the least weighted sum of squared distances.
pub(crate) fn best_line(points: &[[f64; 2]], weights: &[f64]) -> ([f64; 2], f64) {
    let total: f64 = weights.iter().sum();
    let mean = |k: usize| points.iter().zip(weights).map(|(p, w)| w * p[k]).sum::<f64>() / total;
    let (mu, mv) = (mean(0), mean(1));
    let (mut uu, mut uv, mut vv) = (0.0, 0.0, 0.0);
    for ([u, v], w) in points.iter().zip(weights) {
        uu += w * (u - mu) * (u - mu);
        uv += w * (u - mu) * (v - mv);
        vv += w * (v - mv) * (v - mv);
    }
    let along = 0.5 * (2.0 * uv).atan2(uu - vv);
    let normal = [-along.sin(), along.cos()];
    (normal, normal[0] * mu + normal[1] * mv)
}

/// Distances of a polyline's points from straight under a lens that is held, root mean square in raw
/// pixels; `None` where the lens shows nothing.
#[must_use]
pub fn straightness_rms(lens: &Lens, points: &[Pixel]) -> Option<f64> {
    let distances = straightness(lens, points)?;
    Some((distances.iter().map(|d| d * d).sum::<f64>() / distances.len().max(1) as f64).sqrt())
}

/// Range of movements across a line once a movement that keeps it straight is taken out.
pub(crate) fn sagitta(points: &[[f64; 2]], moved: &[f64]) -> f64 {
    let count = points.len() as f64;
    let (first, last) = (points[0], points[points.len() - 1]);
    let length = (last[0] - first[0]).hypot(last[1] - first[1]).max(f64::MIN_POSITIVE);
    let along = |p: &[f64; 2]| {
        ((p[0] - first[0]) * (last[0] - first[0]) + (p[1] - first[1]) * (last[1] - first[1])) / length
    };
    let (mean_t, mean_m) = (points.iter().map(along).sum::<f64>() / count, moved.iter().sum::<f64>() / count);
    let (mut tt, mut tm) = (f64::MIN_POSITIVE, 0.0);
    for (p, m) in points.iter().zip(moved) {
        tt += (along(p) - mean_t).powi(2);
        tm += (along(p) - mean_t) * (m - mean_m);
    }
    let off = points.iter().zip(moved).map(|(p, m)| m - mean_m - tm / tt * (along(p) - mean_t));
    let (low, high) =
        off.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), o| (low.min(o), high.max(o)));
    high - low
}
