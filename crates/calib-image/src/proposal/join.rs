//! Straight edges as evidence for vanishing points, and the joining of broken edges.
//!
//! # Joining
//!
//! An edge is often detected in pieces, because objects occlude it or its contrast changes. A piece is joined
//! to a longer one under two conditions. Both its ends are on the line through the longer piece, within the
//! uncertainty of that line. The gap is not longer than a fraction of the visible length of both pieces. The joined
//! line is the least-squares line through the ends of all pieces.
//!
//! # Evidence
//!
//! The ends of an edge have independent noise. The residual `r` is the smallest displacement of the ends that
//! makes their line pass through the vanishing point `V`. It is the residual of `single/residual.rs` of the
//! core, with weights 1. With `q = p Vw - Vxy` for either end `p`, `T = |q1|^2 + |q2|^2` and the line `l`
//! through both ends,
//!
//! `r = sqrt(2) (l . V) / sqrt(T + sqrt((|q1|^2 - |q2|^2)^2 + 4 (q1 . q2)^2))`.
//!
//! The edges of a direction deviate from this direction, slightly for walls and much more for movable
//! objects: `r ~ (1 - b) N(0, s^2) + b N(0, t^2)`, with `b` the fraction of movable objects. Here
//! `s^2 = sigma^2 + (length angle)^2 / 2`, with `sigma` the noise of the ends and `angle` the standard
//! deviation for walls. `t^2` is the same with the larger angle of movable objects. For any other edge every
//! angle is equally likely. As `r = length |angle| / sqrt(2)`, the density of `r` is then
//! `sqrt(2) / (pi length)`. The ratio of the two densities is the evidence of an edge for `V`.

use std::f64::consts::{FRAC_1_SQRT_2, PI, SQRT_2, TAU};

use calib_core::{Lens, Pixel};

use super::frame::Point;
use crate::line_segment::LineSegment;

/// Standard deviations of the angle between an edge and its direction, in radians: for buildings, then for
/// movable objects.
const ANGLE_SIGMAS: [f64; 2] = [0.004, 0.05];
/// Fraction of movable objects among the edges of a direction.
const MOVABLE_FRACTION: f64 = 0.3;

/// Straight edge in the undistorted image, in pixels relative to the principal point.
#[derive(Clone, Debug)]
pub(super) struct Line {
    /// Ends of the edge.
    pub(super) ends: [[f64; 2]; 2],
    /// Standard deviation of either end, across the edge, in pixels.
    pub(super) end_sigma: f64,
    /// Length, in pixels.
    pub(super) length: f64,
    /// Homogeneous coordinates of the line through both ends.
    pub(super) through: [f64; 3],
    /// Standard deviations of the residual, for buildings and for movable objects, in pixels.
    sigmas: [f64; 2],
    /// Indices of the detected segments that form the edge.
    pub(super) pieces: Vec<usize>,
}

/// Evidence of an edge for a vanishing point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Evidence {
    /// Signed residual, in standard deviations.
    pub(super) residual: f64,
    /// Derivative of the residual with respect to the vanishing point.
    pub(super) by_point: [f64; 3],
}

/// Residual of an edge at a vanishing point, with the intermediate values that its derivative needs.
///
/// The symbols are in the documentation of this file.
struct Offset {
    /// Residual `r`, in pixels.
    pixels: f64,
    /// Factor of `l . V` in `r`.
    factor: f64,
    /// Product `l . V`.
    incidence: f64,
    /// Vectors `q1` and `q2`.
    q: [[f64; 2]; 2],
    /// Squares `|q1|^2` and `|q2|^2`.
    squares: [f64; 2],
    /// Product `q1 . q2`.
    along: f64,
    /// Inner square root of `r`.
    root: f64,
}

impl Line {
    /// Undistorts the detected segment with this index; `None` outside the lens model.
    pub(super) fn from_segment(segment: &LineSegment, index: usize, lens: &Lens) -> Option<Self> {
        let centre = lens.principal_point;
        let end = |pixel: Pixel| {
            let straight = lens.undistort(pixel)?;
            Some([straight.u - centre.u, straight.v - centre.v])
        };
        Self::new([end(segment.ends[0])?, end(segment.ends[1])?], segment.sigma, vec![index])
    }

    /// Creates the edge between two undistorted ends; `None` if it has no length.
    pub(super) fn new(ends: [[f64; 2]; 2], end_sigma: f64, pieces: Vec<usize>) -> Option<Self> {
        let [a, b] = ends;
        let length = (b[0] - a[0]).hypot(b[1] - a[1]);
        let through = [a[1] - b[1], b[0] - a[0], a[0] * b[1] - a[1] * b[0]];
        let sigmas = ANGLE_SIGMAS.map(|turn| end_sigma.hypot(turn * length * FRAC_1_SQRT_2));
        (length.is_finite() && length > 0.0 && end_sigma > 0.0).then_some(Self {
            ends,
            end_sigma,
            length,
            through,
            sigmas,
            pieces,
        })
    }

    /// Computes the residual at a vanishing point; `None` for a point between the ends, which cannot be the
    /// vanishing point of the edge.
    fn offset(&self, v: Point) -> Option<Offset> {
        let q = self.ends.map(|p| [p[0] * v[2] - v[0], p[1] * v[2] - v[1]]);
        let (squares, along) = ([dot(q[0], q[0]), dot(q[1], q[1])], dot(q[0], q[1]));
        let apart = squares[0] - squares[1];
        let root = (apart * apart + 4.0 * along * along).sqrt();
        if along <= 0.0 || root <= 0.0 {
            return None;
        }
        let factor = (2.0 / (squares[0] + squares[1] + root)).sqrt();
        let incidence = self.through[0] * v[0] + self.through[1] * v[1] + self.through[2] * v[2];
        Some(Offset { pixels: factor * incidence, factor, incidence, q, squares, along, root })
    }

    /// Returns the probability densities of a residual in pixels, for buildings, then for movable objects. Each
    /// density is multiplied by the fraction of its class.
    fn densities(&self, pixels: f64) -> [f64; 2] {
        let shares = [1.0 - MOVABLE_FRACTION, MOVABLE_FRACTION];
        std::array::from_fn(|k| {
            let sigma = self.sigmas[k];
            shares[k] * (-0.5 * (pixels / sigma).powi(2)).exp() / (TAU.sqrt() * sigma)
        })
    }

    /// Returns the likelihood ratio of two hypotheses: the edge points to this vanishing point, or its direction is
    /// random.
    pub(super) fn odds(&self, v: Point) -> f64 {
        /// Residual beyond which the odds are zero, in standard deviations of movable objects.
        const MAX_RESIDUAL_SIGMAS: f64 = 6.0;
        let Some(offset) =
            self.offset(v).filter(|offset| offset.pixels.abs() < MAX_RESIDUAL_SIGMAS * self.sigmas[1])
        else {
            return 0.0;
        };
        let [tight, loose] = self.densities(offset.pixels);
        (tight + loose) * PI * self.length / SQRT_2
    }

    /// Computes the residual at a vanishing point, weighted by the mixture of both standard deviations;
    /// `None` for a point between the ends.
    pub(super) fn evidence(&self, v: Point) -> Option<Evidence> {
        let offset = self.offset(v)?;
        let [tight, loose] = self.densities(offset.pixels);
        let [s, t] = self.sigmas.map(|sigma| sigma.powi(-2));
        let precision = (tight * s + loose * t) / (tight + loose).max(f64::MIN_POSITIVE);
        let by_point = self.by_point(&offset).map(|by| precision.sqrt() * by);
        Some(Evidence { residual: precision.sqrt() * offset.pixels, by_point })
    }

    /// Returns the derivative of the residual, in pixels, with respect to the vanishing point.
    fn by_point(&self, offset: &Offset) -> [f64; 3] {
        let Offset { factor, incidence, q, squares: [a, b], along, root, .. } = *offset;
        std::array::from_fn(|k| {
            let by = self.ends.map(|p| [[-1.0, 0.0], [0.0, -1.0], p][k]);
            let (by_a, by_b) = (2.0 * dot(q[0], by[0]), 2.0 * dot(q[1], by[1]));
            let by_along = dot(q[0], by[1]) + dot(q[1], by[0]);
            let by_root = ((a - b) * (by_a - by_b) + 4.0 * along * by_along) / root;
            let share = 0.5 * incidence / (a + b + root);
            factor * (self.through[k] - share * (by_a + by_b + by_root))
        })
    }
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// Largest distance of the ends of a joined piece from the line, in standard deviations.
const MAX_OFFSET_SIGMAS: f64 = 2.0;
/// Longest gap between a line and a joined piece, as a fraction of the sum of their lengths.
const MAX_GAP_FRACTION: f64 = 0.7;
/// Largest overlap of a line and a joined piece, in pixels.
const MAX_OVERLAP_PX: f64 = 2.0;
/// Largest number of detected edges before joining, which limits the computing time; the shortest are
/// dropped.
const MAX_EDGES: usize = 1_500;

/// Joins the pieces of broken edges, in pixels without distortion. Returns all edges, the longest first.
#[must_use]
pub fn join_edges(segments: &[LineSegment]) -> Vec<LineSegment> {
    let origin = Lens::pinhole(Pixel::new(0.0, 0.0));
    let whole = |line: Line| LineSegment::new(line.ends.map(Pixel::from), line.end_sigma);
    lines(segments, &origin).into_iter().map(whole).collect()
}

/// Undistorts the segments and joins broken edges, the longest first.
pub(super) fn lines(segments: &[LineSegment], lens: &Lens) -> Vec<Line> {
    let each = segments.iter().enumerate();
    let mut left: Vec<Line> =
        each.filter_map(|(index, segment)| Line::from_segment(segment, index, lens)).collect();
    left.sort_by(|a, b| b.length.total_cmp(&a.length));
    left.truncate(MAX_EDGES);
    let mut is_used = vec![false; left.len()];
    let mut whole: Vec<Line> =
        (0..left.len()).filter_map(|first| extend_line(first, &left, &mut is_used)).collect();
    whole.sort_by(|a, b| b.length.total_cmp(&a.length));
    whole
}

/// Extends a line by all its pieces; `None` if the line is already part of another line.
fn extend_line(first: usize, all: &[Line], is_used: &mut [bool]) -> Option<Line> {
    if is_used[first] {
        return None;
    }
    let mut pieces = vec![&all[first]];
    let mut line = all[first].clone();
    // Nearest piece first; otherwise a piece inside a gap would be parallel to the line already joined over
    // it.
    let nearest = |line: &Line, is_used: &[bool]| {
        let free = (first + 1..all.len()).filter(|&i| !is_used[i]);
        let gaps = free.filter_map(|i| Some((i, gap(line, &all[i])?)));
        gaps.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i)
    };
    while let Some(next) = nearest(&line, is_used) {
        is_used[next] = true;
        pieces.push(&all[next]);
        line = fit_line(&pieces).unwrap_or(line);
    }
    Some(line)
}

/// Coordinate system along and across a line, with the origin at its middle.
struct Axis {
    /// Middle of the line, in pixels.
    middle: [f64; 2],
    /// Unit vector along the line.
    along: [f64; 2],
}

impl Axis {
    fn from_line(line: &Line) -> Self {
        let [a, b] = line.ends;
        let along = [0, 1].map(|k| (b[k] - a[k]) / line.length);
        Self { middle: [0, 1].map(|k| 0.5 * (a[k] + b[k])), along }
    }

    /// Converts a point to coordinates along and across the line.
    fn to_axis(&self, p: [f64; 2]) -> [f64; 2] {
        let ([x, y], [u, v]) = (self.along, [p[0] - self.middle[0], p[1] - self.middle[1]]);
        [u * x + v * y, v * x - u * y]
    }

    /// Converts coordinates along and across the line to a point.
    fn point_at(&self, [s, t]: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.along;
        [self.middle[0] + s * x - t * y, self.middle[1] + s * y + t * x]
    }
}

/// Returns the gap between a line and a piece of the same edge, in pixels; `None` for a piece of another
/// edge.
fn gap(line: &Line, piece: &Line) -> Option<f64> {
    let axis = Axis::from_line(line);
    let ends = piece.ends.map(|end| axis.to_axis(end));
    let gap = ends.iter().map(|[s, _]| s.abs() - 0.5 * line.length).fold(f64::INFINITY, f64::min);
    // A piece beside the line is another, parallel edge.
    if gap < -MAX_OVERLAP_PX
        || gap > MAX_GAP_FRACTION * (line.length + piece.length)
        || ends[0][0] * ends[1][0] < 0.0
    {
        return None;
    }
    let is_on = ends.iter().all(|&[s, t]| {
        let of_line = line.end_sigma * (0.5 + 2.0 * (s / line.length).powi(2)).sqrt();
        t.abs() < MAX_OFFSET_SIGMAS * of_line.hypot(piece.end_sigma)
    });
    is_on.then_some(gap)
}

/// Fits the line through the ends of all pieces by least squares; `None` if the line has no length.
fn fit_line(pieces: &[&Line]) -> Option<Line> {
    let axis = Axis::from_line(pieces[0]);
    let ends = pieces.iter().flat_map(|piece| piece.ends.map(|end| axis.to_axis(end)));
    let ends: Vec<[f64; 2]> = ends.collect();
    let mean = |k: usize| ends.iter().map(|at| at[k]).sum::<f64>() / ends.len() as f64;
    let (ms, mt) = (mean(0), mean(1));
    let square: f64 = ends.iter().map(|at| (at[0] - ms).powi(2)).sum();
    let tilt = ends.iter().map(|at| (at[0] - ms) * (at[1] - mt)).sum::<f64>() / square;
    let reach = ends
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], [s, _]| [low.min(*s), high.max(*s)]);
    let fitted = reach.map(|s| axis.point_at([s, mt + tilt * (s - ms)]));
    let indices = pieces.iter().flat_map(|piece| piece.pieces.clone()).collect();
    Line::new(fitted, pieces[0].end_sigma, indices)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_equal_finite_differences() {
        const STEP: f64 = 1e-5;
        let line = Line::new([[120.0, -40.0], [180.0, 90.0]], 0.5, vec![0]).unwrap();
        for v in [[300.0, 400.0, 1.0], [30.0, 70.0, 0.01], [-500.0, 20.0, 0.3]] {
            let exact = line.by_point(&line.offset(v).unwrap());
            for k in 0..3 {
                let at = |by: f64| {
                    let mut moved = v;
                    moved[k] += by;
                    line.offset(moved).unwrap().pixels
                };
                let numeric = (at(STEP) - at(-STEP)) / (2.0 * STEP);
                assert!(
                    (numeric - exact[k]).abs() < 1e-5 * (1.0 + exact[k].abs()),
                    "{v:?} {k}: {numeric} {exact:?}"
                );
            }
        }
    }

    #[test]
    fn an_edge_supports_its_vanishing_point_and_no_point_on_itself() {
        let line = Line::new([[0.0, 0.0], [100.0, 0.0]], 0.5, vec![0]).unwrap();
        assert!(line.odds([400.0, 0.0, 1.0]) > 20.0, "{}", line.odds([400.0, 0.0, 1.0]));
        assert!(line.odds([400.0, 300.0, 1.0]) < 0.1);
        assert_eq!(line.odds([50.0, 0.0, 1.0]), 0.0);
    }

    fn segment(a: [f64; 2], b: [f64; 2]) -> LineSegment {
        LineSegment::new([a.into(), b.into()], 0.5)
    }

    #[test]
    fn pieces_of_one_edge_are_joined_and_a_parallel_edge_is_not() {
        let pieces = [
            segment([10.0, 100.2], [90.0, 100.0]),
            segment([250.0, 100.4], [180.0, 99.8]),
            segment([100.0, 100.1], [170.0, 100.3]),
            segment([10.0, 105.0], [90.0, 105.0]),
            segment([320.0, 160.0], [320.0, 200.0]),
        ];
        let found = join_edges(&pieces);
        assert_eq!(found.len(), 3, "{found:?}");
        assert!((found[0].length() - 240.0).abs() < 0.1, "{found:?}");
        assert!((found[0].ends[0].v - 100.0).abs() < 0.5);
    }

    #[test]
    fn distant_pieces_are_not_joined() {
        let pieces = [segment([10.0, 100.0], [60.0, 100.0]), segment([300.0, 100.0], [350.0, 100.0])];
        assert_eq!(join_edges(&pieces).len(), 2);
    }
}
