//! Edges that are broken, joined again.
//!
//! An edge of a wall is found in pieces where something stands before it or its contrast changes. A piece is joined
//! to a longer one where both its ends lie on the line through that one, within the noise of where that line is
//! there, and the gap between them is not longer than a share of what was seen of both. Through the ends of all
//! pieces goes the line of least squares.

use calib_core::{Lens, Pixel};

use crate::line_segment::LineSegment;

use super::line::Line;

/// Sigmas that an end may be off the line.
const OFF: f64 = 2.0;
/// Longest gap, as a share of what was seen of both.
const GAP: f64 = 0.7;
/// Pieces may overlap by so many pixels.
const OVERLAP: f64 = 2.0;
/// Of more edges than this the shortest are left out: a bound on time.
const MOST: usize = 1_500;

/// The same edges, the longest first, with broken ones joined.
#[must_use]
pub fn joined(segments: &[LineSegment]) -> Vec<LineSegment> {
    let origin = Lens::pinhole(Pixel::new(0.0, 0.0));
    let whole = |line: Line| LineSegment { ends: line.ends.map(Pixel::from), sigma: line.end_sigma };
    lines(segments, &origin).into_iter().map(whole).collect()
}

/// The lines of segments under a lens, the longest first, with broken ones joined.
pub(super) fn lines(segments: &[LineSegment], lens: &Lens) -> Vec<Line> {
    let each = segments.iter().enumerate();
    let mut left: Vec<Line> =
        each.filter_map(|(index, segment)| Line::of_segment(segment, index, lens)).collect();
    left.sort_by(|a, b| b.length.total_cmp(&a.length));
    left.truncate(MOST);
    let mut is_used = vec![false; left.len()];
    let mut whole: Vec<Line> =
        (0..left.len()).filter_map(|first| grown(first, &left, &mut is_used)).collect();
    whole.sort_by(|a, b| b.length.total_cmp(&a.length));
    whole
}

/// A line with all the pieces that continue it; `None` of one that is part of another.
fn grown(first: usize, all: &[Line], is_used: &mut [bool]) -> Option<Line> {
    if is_used[first] {
        return None;
    }
    let mut pieces = vec![&all[first]];
    let mut line = all[first].clone();
    // The nearest piece first: what lies in a gap would be beside the line that was joined over it.
    let nearest = |line: &Line, is_used: &[bool]| {
        let free = (first + 1..all.len()).filter(|&i| !is_used[i]);
        let gaps = free.filter_map(|i| Some((i, gap(line, &all[i])?)));
        gaps.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i)
    };
    while let Some(next) = nearest(&line, is_used) {
        is_used[next] = true;
        pieces.push(&all[next]);
        line = through(&pieces).unwrap_or(line);
    }
    Some(line)
}

/// Coordinates along and across a line, from its middle.
struct Axis {
    middle: [f64; 2],
    along: [f64; 2],
}

impl Axis {
    fn of(line: &Line) -> Self {
        let [a, b] = line.ends;
        let along = [0, 1].map(|k| (b[k] - a[k]) / line.length);
        Self { middle: [0, 1].map(|k| 0.5 * (a[k] + b[k])), along }
    }

    fn to_axis(&self, p: [f64; 2]) -> [f64; 2] {
        let ([x, y], [u, v]) = (self.along, [p[0] - self.middle[0], p[1] - self.middle[1]]);
        [u * x + v * y, v * x - u * y]
    }

    fn of_axis(&self, [s, t]: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.along;
        [self.middle[0] + s * x - t * y, self.middle[1] + s * y + t * x]
    }
}

/// How far a piece of the same edge is from the line, in pixels; none for a piece of another edge.
fn gap(line: &Line, piece: &Line) -> Option<f64> {
    let axis = Axis::of(line);
    let ends = piece.ends.map(|end| axis.to_axis(end));
    let gap = ends.iter().map(|[s, _]| s.abs() - 0.5 * line.length).fold(f64::INFINITY, f64::min);
    // What runs beside it is another edge.
    if gap < -OVERLAP || gap > GAP * (line.length + piece.length) || ends[0][0] * ends[1][0] < 0.0 {
        return None;
    }
    let is_on = ends.iter().all(|&[s, t]| {
        let of_line = line.end_sigma * (0.5 + 2.0 * (s / line.length).powi(2)).sqrt();
        t.abs() < OFF * of_line.hypot(piece.end_sigma)
    });
    is_on.then_some(gap)
}

/// The line through all of its pieces.
fn through(pieces: &[&Line]) -> Option<Line> {
    let axis = Axis::of(pieces[0]);
    let ends = pieces.iter().flat_map(|piece| piece.ends.map(|end| axis.to_axis(end)));
    let ends: Vec<[f64; 2]> = ends.collect();
    let mean = |k: usize| ends.iter().map(|at| at[k]).sum::<f64>() / ends.len() as f64;
    let (ms, mt) = (mean(0), mean(1));
    let square: f64 = ends.iter().map(|at| (at[0] - ms).powi(2)).sum();
    let tilt = ends.iter().map(|at| (at[0] - ms) * (at[1] - mt)).sum::<f64>() / square;
    let reach = ends
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], [s, _]| [low.min(*s), high.max(*s)]);
    let fitted = reach.map(|s| axis.of_axis([s, mt + tilt * (s - ms)]));
    let indices = pieces.iter().flat_map(|piece| piece.pieces.clone()).collect();
    Line::new(fitted, pieces[0].end_sigma, indices)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(a: [f64; 2], b: [f64; 2]) -> LineSegment {
        LineSegment { ends: [a.into(), b.into()], sigma: 0.5 }
    }

    #[test]
    fn pieces_of_one_edge_are_one_and_a_parallel_edge_is_another() {
        let pieces = [
            segment([10.0, 100.2], [90.0, 100.0]),
            segment([250.0, 100.4], [180.0, 99.8]),
            segment([100.0, 100.1], [170.0, 100.3]),
            segment([10.0, 105.0], [90.0, 105.0]),
            segment([320.0, 160.0], [320.0, 200.0]),
        ];
        let found = joined(&pieces);
        assert_eq!(found.len(), 3, "{found:?}");
        assert!((found[0].length() - 240.0).abs() < 0.1, "{found:?}");
        assert!((found[0].ends[0].v - 100.0).abs() < 0.5);
    }

    #[test]
    fn what_begins_far_away_is_not_the_same_edge() {
        let pieces = [segment([10.0, 100.0], [60.0, 100.0]), segment([300.0, 100.0], [350.0, 100.0])];
        assert_eq!(joined(&pieces).len(), 2);
    }
}
