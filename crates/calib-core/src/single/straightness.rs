//! Residuals of the plumb-line method: distances of undistorted points from a straight line, in raw pixels,
//! with their Jacobian with respect to the distortion coefficients.
//!
//! The residual of a point is `(n . u - c) / |J' n|`. It is the distance of the undistorted point u from the
//! line `n . x = c`, divided by the noise magnification across the line. J is the Jacobian of the
//! undistortion. The line minimises the sum of squares of the polyline. As the weights depend on n, the line
//! is fitted three times, each time with the weights of the previous line.
//!
//! The file also determines which straight edges carry information about the lens, from the sagitta that a
//! distortion gives them. A line through the principal point stays straight under radial distortion and
//! carries no information.

use crate::camera::{BrownConrady, ByCoefficient, Chart, ChartPoint, Distortion, Lens, Matrix2, Pixel};
use crate::single::annotation::{Annotation, Kind};
use crate::single::constraints::Source;
use crate::single::overlaps::Overlaps;

/// Straight edge: a polyline, and the annotated segment that it comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct Edge {
    /// Raw pixels along an edge that is straight in space.
    pub points: Vec<Pixel>,
    /// Annotated segment.
    pub source: Source,
}

/// Returns the straight edges of a camera: all annotated lines of three or more points that are switched on,
/// except uprights.
pub fn edges(annotations: &[Annotation]) -> Vec<Edge> {
    let used = annotations.iter().enumerate().filter(|(_, a)| !a.off && a.kind != Kind::Upright);
    used.flat_map(|(annotation, drawn)| {
        let lines = drawn.polylines().enumerate().filter(|(_, points)| points.len() > 2);
        lines
            .map(move |(segment, points)| Edge { points, source: Source { annotation, segment } })
            .collect::<Vec<_>>()
    })
    .collect()
}

/// Returns the annotated point that is farthest from the centre of the lens.
pub fn outermost<'a>(points: impl Iterator<Item = &'a Pixel>, centre: Pixel) -> Option<Pixel> {
    points.copied().max_by(|a, b| a.distance(centre).total_cmp(&b.distance(centre)))
}

/// Returns the repeat count of every edge. Residuals are divided by the square root of the count, so that the
/// copies together count as one edge (`overlaps.rs`).
pub(crate) fn repeat_counts<'a>(edges: impl Iterator<Item = &'a Edge>) -> Vec<f64> {
    let points = |edge: &Edge| edge.points.iter().map(|&point| <[f64; 2]>::from(point)).collect();
    Overlaps::new(&edges.map(points).collect::<Vec<_>>()).repeat_counts()
}

/// Returns the number of residuals minus the two parameters of every line, with repeated edges counted once.
pub(crate) fn edge_redundancy<'a>(edges: impl Iterator<Item = &'a Edge>, times: &[f64]) -> i64 {
    let each = edges.zip(times).map(|(edge, times)| (edge.points.len() as f64 - 2.0) / times);
    (each.sum::<f64>() - 1e-9).ceil() as i64
}

/// Returns the distances of the undistorted points of a polyline from the best line through them, in raw
/// pixels.
///
/// `None` if a point cannot be undistorted.
#[must_use]
pub fn straightness(lens: &Lens, points: &[Pixel]) -> Option<Vec<f64>> {
    straightness_in_charts_of([lens, lens], points)
}

/// Computes [`straightness`] under the first lens, in the charts of the second lens. The second lens is the initial
/// value of the estimate of the first.
pub(crate) fn straightness_in_charts_of(lenses: [&Lens; 2], points: &[Pixel]) -> Option<Vec<f64>> {
    UndistortedPolyline::new(lenses, points).map(|polyline| polyline.distances())
}

/// Computes [`straightness_in_charts_of`], and the column of the Jacobian for each of these parameters.
pub(crate) fn straightness_with_jacobian(
    [lens, start]: [&Lens; 2],
    points: &[Pixel],
    parameters: &[usize],
) -> Option<(Vec<f64>, Vec<Vec<f64>>)> {
    let polyline = UndistortedPolyline::new([lens, start], points)?;
    let distances = polyline.distances();
    let mut changes = vec![Vec::with_capacity(points.len()); parameters.len()];
    for (&raw, (&at, &jacobian)) in points.iter().zip(polyline.points.iter().zip(&polyline.jacobians)) {
        let by =
            lens.pixel_to_chart_by_parameters(raw, &ChartPoint { at, jacobian }, polyline.chart.as_ref());
        changes.iter_mut().zip(parameters).for_each(|(changes, &k)| changes.push(by[k]));
    }
    let columns = changes.iter().map(|changes| polyline.jacobian_column(changes)).collect();
    Some((distances, columns))
}

/// Undistorted polyline with the lines fitted to it.
///
/// The weights `w = 1 / |J' n|^2` of the points depend only slowly on the direction of the line, so three
/// fits are enough.
struct UndistortedPolyline {
    /// Chart of the points, for a wide lens.
    chart: Option<Chart>,
    /// Undistorted points; for a wide lens, in the chart.
    points: Vec<[f64; 2]>,
    /// `d undistorted / d raw` of every point.
    jacobians: Vec<Matrix2>,
    /// Lines of the three fits, in order.
    lines: [BestLine; 3],
    /// Weights of the points in the three fits, in order.
    weights: [Vec<f64>; 3],
    /// Sign (1 or -1) that makes distances positive on the side `(-dy, dx)` of the direction `(dx, dy)` from the
    /// first to the last point.
    sign: f64,
}

impl UndistortedPolyline {
    fn new([lens, start]: [&Lens; 2], raw: &[Pixel]) -> Option<Self> {
        let mut points: Vec<[f64; 2]> = Vec::with_capacity(raw.len());
        let mut jacobians = Vec::with_capacity(raw.len());
        let chart = Chart::centred_on(start, raw);
        for &point in raw {
            let ChartPoint { at, jacobian } = lens.pixel_to_chart(point, chart.as_ref())?;
            points.push(at);
            jacobians.push(jacobian);
        }
        let weights_of = |BestLine { normal: [x, y], .. }: &BestLine| -> Vec<f64> {
            let weight = |[[a, b], [c, d]]: &Matrix2| {
                ((a * x + c * y).powi(2) + (b * x + d * y).powi(2)).max(f64::MIN_POSITIVE).recip()
            };
            jacobians.iter().map(weight).collect()
        };
        let uniform = vec![1.0; points.len()];
        let first = BestLine::through(&points, &uniform);
        let by_first = weights_of(&first);
        let second = BestLine::through(&points, &by_first);
        let by_second = weights_of(&second);
        let third = BestLine::through(&points, &by_second);
        // The sign must not change with the coefficients, so it is defined by the direction from the first to
        // the last point; see `sign`.
        let ([x, y], (start, end)) = (third.normal, (points.first()?, points.last()?));
        let sign = if x * (start[1] - end[1]) + y * (end[0] - start[0]) < 0.0 { -1.0 } else { 1.0 };
        let (lines, weights) = ([first, second, third], [uniform, by_first, by_second]);
        Some(Self { chart, points, jacobians, lines, weights, sign })
    }

    /// Returns the signed distance `(n . u - c) sqrt(w)` of every point u with weight w from the line
    /// `n . x = c`, in raw pixels.
    fn distances(&self) -> Vec<f64> {
        let BestLine { normal: [x, y], offset: c, .. } = self.lines[2];
        let distance = |([u, v], weight): (&[f64; 2], &f64)| self.sign * (x * u + y * v - c) * weight.sqrt();
        self.points.iter().zip(&self.weights[2]).map(distance).collect()
    }

    /// Returns the derivatives of the distances with respect to a coefficient, by the chain rule through the
    /// three fits.
    ///
    /// `changes` are the derivatives of the points and their Jacobians with respect to that coefficient.
    fn jacobian_column(&self, changes: &[ByCoefficient]) -> Vec<f64> {
        let mut d_weights = vec![0.0; self.points.len()];
        let mut d_line = ([0.0; 2], 0.0);
        for step in 0..3 {
            if step > 0 {
                self.change_weights(step, changes, d_line.0, &mut d_weights);
            }
            d_line = self.lines[step].derivative(&self.points, &self.weights[step], changes, &d_weights);
        }
        let (BestLine { normal: [x, y], offset: c, .. }, ([dx, dy], dc)) = (&self.lines[2], d_line);
        let derivative = |i: usize| {
            let ([u, v], [du, dv], weight) = (self.points[i], changes[i].at, self.weights[2][i]);
            let distance = x * u + y * v - c;
            let d_distance = dx * u + dy * v + x * du + y * dv - dc;
            self.sign * weight.sqrt() * (d_distance + 0.5 * distance * d_weights[i] / weight)
        };
        (0..self.points.len()).map(derivative).collect()
    }

    /// Computes the derivatives of the weights of a fit, `d w = -2 w^2 (J' n) . d(J' n)`. `[dx, dy]` is the
    /// derivative of the normal of the previous line.
    fn change_weights(
        &self,
        step: usize,
        changes: &[ByCoefficient],
        [dx, dy]: [f64; 2],
        d_weights: &mut [f64],
    ) {
        let [x, y] = self.lines[step - 1].normal;
        let each = self.jacobians.iter().zip(changes).zip(&self.weights[step]);
        for ((([[a, b], [c, d]], by), weight), d_weight) in each.zip(d_weights) {
            let [[da, db], [dc, dd]] = by.jacobian;
            let normal = [a * x + c * y, b * x + d * y];
            let d_normal = [da * x + dc * y + a * dx + c * dy, db * x + dd * y + b * dx + d * dy];
            *d_weight = -2.0 * weight * weight * (normal[0] * d_normal[0] + normal[1] * d_normal[1]);
        }
    }
}

/// Line with the smallest weighted sum of squared distances from points.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BestLine {
    /// Unit normal.
    pub(crate) normal: [f64; 2],
    /// Offset of the line from the origin along the normal, in the unit of the points.
    pub(crate) offset: f64,
    /// Sum of the weights.
    total: f64,
    /// Weighted mean of the points.
    mean: [f64; 2],
    /// Second moments S about the mean: twice `S_uv`, and `S_uu - S_vv`.
    moments: [f64; 2],
}

impl BestLine {
    /// Fits a line: its angle is `atan2(2 S_uv, S_uu - S_vv) / 2`, and it passes through the mean.
    pub(crate) fn through(points: &[[f64; 2]], weights: &[f64]) -> Self {
        let (mut total, mut mean) = (0.0, [0.0; 2]);
        for ([u, v], w) in points.iter().zip(weights) {
            total += w;
            mean = [mean[0] + w * u, mean[1] + w * v];
        }
        let mean = mean.map(|sum| sum / total);
        let (mut sine, mut cosine) = (0.0, 0.0);
        for ([u, v], w) in points.iter().zip(weights) {
            let (u, v) = (u - mean[0], v - mean[1]);
            sine += 2.0 * w * u * v;
            cosine += w * (u * u - v * v);
        }
        let (sin, cos) = (0.5 * sine.atan2(cosine)).sin_cos();
        let normal = [-sin, cos];
        let offset = normal[0] * mean[0] + normal[1] * mean[1];
        Self { normal, offset, total, mean, moments: [sine, cosine] }
    }

    /// Returns the derivatives of normal and offset, computed from the derivatives of points and weights.
    fn derivative(
        &self,
        points: &[[f64; 2]],
        weights: &[f64],
        changes: &[ByCoefficient],
        d_weights: &[f64],
    ) -> ([f64; 2], f64) {
        let Self { normal, total, mean, moments: [sine, cosine], .. } = self;
        let (mut d_mean, mut d_sine, mut d_cosine) = ([0.0; 2], 0.0, 0.0);
        // The change of the mean does not affect the moments, because offsets from the mean sum to 0.
        for (([u, v], w), (by, dw)) in points.iter().zip(weights).zip(changes.iter().zip(d_weights)) {
            let ([u, v], [du, dv]) = ([u - mean[0], v - mean[1]], by.at);
            d_mean = [d_mean[0] + dw * u + w * du, d_mean[1] + dw * v + w * dv];
            d_sine += 2.0 * (dw * u * v + w * (du * v + u * dv));
            d_cosine += dw * (u * u - v * v) + 2.0 * w * (u * du - v * dv);
        }
        let square = (sine * sine + cosine * cosine).max(f64::MIN_POSITIVE);
        let d_angle = 0.5 * (cosine * d_sine - sine * d_cosine) / square;
        let d_normal = [-d_angle * normal[1], d_angle * normal[0]];
        let d_offset = d_normal[0] * mean[0]
            + d_normal[1] * mean[1]
            + (normal[0] * d_mean[0] + normal[1] * d_mean[1]) / total;
        (d_normal, d_offset)
    }
}

/// Returns the root mean square deviation of a polyline from a straight line after undistortion, converted to
/// raw pixels.
///
/// `None` if a point cannot be undistorted.
#[must_use]
pub fn straightness_rms(lens: &Lens, points: &[Pixel]) -> Option<f64> {
    let distances = straightness(lens, points)?;
    Some((distances.iter().map(|d| d * d).sum::<f64>() / distances.len().max(1) as f64).sqrt())
}

/// Returns the sagitta of a line whose points are displaced across it by `moved`. It is the range of the
/// displacements after subtraction of their best linear fit, in their unit.
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
    let residuals = points.iter().zip(moved).map(|(p, m)| m - mean_m - tm / tt * (along(p) - mean_t));
    let (low, high) =
        residuals.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), r| (low.min(r), high.max(r)));
    high - low
}

/// Returns the uninformative edges with their sagitta under a distortion of 10 px in the corner, in pixels.
///
/// The sagitta of an uninformative edge is less than one sigma, and less than a third of the largest.
pub(crate) fn uninformative(edges: &[&Edge], lens: &Lens, size: [f64; 2], sigma: f64) -> Vec<(Source, f64)> {
    /// Displacement of the corner, in pixels.
    const CORNER_DISPLACEMENT_PX: f64 = 10.0;
    let half_diagonal = 0.5 * size[0].hypot(size[1]);
    let k1 = CORNER_DISPLACEMENT_PX / half_diagonal;
    let brown = |k1: f64| Distortion::BrownConrady(BrownConrady { k1, ..BrownConrady::default() });
    let extra = Lens { focal: half_diagonal, distortion: brown(-k1), ..*lens };
    let bend = |edge: &Edge| {
        // Sagitta of the edge under the additional distortion; infinite if a point has no undistorted position.
        let points: Vec<[f64; 2]> =
            edge.points.iter().filter_map(|&p| extra.undistort(p)).map(|p| [p.u, p.v]).collect();
        let plain: Vec<[f64; 2]> = edge.points.iter().map(|p| [p.u, p.v]).collect();
        if points.len() < plain.len() {
            return f64::INFINITY;
        }
        let moved: Vec<f64> = {
            let BestLine { normal, .. } = BestLine::through(&plain, &vec![1.0; plain.len()]);
            points
                .iter()
                .zip(&plain)
                .map(|(a, b)| normal[0] * (a[0] - b[0]) + normal[1] * (a[1] - b[1]))
                .collect()
        };
        sagitta(&plain, &moved)
    };
    let bent: Vec<(Source, f64)> = edges.iter().map(|edge| (edge.source, bend(edge))).collect();
    let best = bent.iter().map(|(_, sagitta)| *sagitta).filter(|s| s.is_finite()).fold(0.0, f64::max);
    // If even the largest sagitta is less than one sigma, no edge is informative.
    let most = if best < sigma { f64::INFINITY } else { best / 3.0 };
    bent.into_iter().filter(|(_, sagitta)| *sagitta < sigma && *sagitta <= most).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::camera::any_distortion;

    proptest! {
        #[test]
        fn jacobian_of_straightness_matches_finite_differences(
            distortion in any_distortion(), start in [100.0..1800.0_f64, 100.0..900.0_f64],
            way in [-1.0..1.0_f64, -1.0..1.0_f64], off in prop::collection::vec(-2.0..2.0_f64, 5),
        ) {
            const STEP: f64 = 1e-6;
            // Other models have no derivatives with respect to their coefficients.
            prop_assume!(distortion.model().is_some_and(|model| model.row().is_fitted));
            let lens = Lens { principal_point: Pixel::new(950.0, 530.0), focal: 1200.0, pixel_aspect: 1.0, distortion, image_circle: None };
            let length = way[0].hypot(way[1]);
            prop_assume!(length > 0.3);
            let point = |(i, off): (usize, &f64)| {
                let along = 40.0 * i as f64 / length;
                Pixel::new(start[0] + along * way[0] + off, start[1] + along * way[1] - off)
            };
            let points: Vec<Pixel> = off.iter().enumerate().map(point).collect();
            let indices: Vec<usize> = (0..distortion.names().len()).collect();
            let Some((distances, slopes)) = straightness_with_jacobian([&lens, &lens], &points, &indices) else { return Ok(()) };
            // Near the fold, differences do not approximate derivatives.
            let regular = points.iter().all(|&p| {
                lens.undistort_jacobian(p).is_some_and(|j| j.iter().flatten().all(|slope| slope.abs() < 5.0))
            });
            prop_assume!(regular);
            prop_assert_eq!(Some(distances), straightness(&lens, &points));
            for (k, column) in slopes.iter().enumerate() {
                let at = |by: f64| straightness_in_charts_of([&lens.nudged(k, by), &lens], &points);
                let (Some(ahead), Some(behind)) = (at(STEP), at(-STEP)) else { continue };
                let size = column.iter().fold(1.0, |most: f64, slope| most.max(slope.abs()));
                for (i, slope) in column.iter().enumerate() {
                    let numeric = (ahead[i] - behind[i]) / (2.0 * STEP);
                    prop_assert!((numeric - slope).abs() < 1e-4 * size, "{k} {i}: {numeric} {slope}");
                }
            }
        }
    }
}
