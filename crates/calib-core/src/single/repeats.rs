//! Evidence that is drawn more than once: segments and polylines on one edge share what is wrong with it.
//!
//! A hand that follows an edge again follows the same edge: where it is bent, or is not where it seems to be,
//! every copy errs alike. So the copies together say what one of them says: the variance of each is multiplied
//! by how many there are, counting of every other one the share of the segment that it covers. A short piece
//! beside a long one does not count against the long one.

use crate::optimize::Number;
use crate::outcome::Source;
use crate::single::endpoint::Endpoint;

/// How far a segment may lie beside another, in pixels, to be on the same edge.
const BESIDE: f64 = 3.0;
/// Of what length, relative to a segment's own, a segment is that counts against it.
const AS_LONG: f64 = 0.8;

/// How often what is drawn more than once is drawn, by its source and in the order of these.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Repeats(Vec<(Source, f64)>);

/// A segment with the covariances of its ends.
pub(crate) struct Drawn<'a, E> {
    source: Source,
    at: [[f64; 2]; 2],
    covariances: [&'a mut [E; 3]; 2],
}

impl<'a, E: Number> Drawn<'a, E> {
    pub(crate) fn new((source, ends): (Source, [&'a mut Endpoint<E>; 2])) -> Self {
        let at = [0, 1].map(|end: usize| ends[end].point.map(|coordinate| coordinate.value()));
        Self { source, at, covariances: ends.map(|end| &mut end.covariance) }
    }
}

const fn key(source: Source) -> (usize, usize) {
    (source.annotation, source.segment)
}

impl Repeats {
    /// Everything is drawn once.
    pub const NONE: Self = Self(Vec::new());

    /// How often the edge is drawn that a segment is on.
    pub(crate) fn times(&self, source: Source) -> f64 {
        let found = self.0.binary_search_by_key(&key(source), |&(of, _)| key(of));
        found.map_or(1.0, |at| self.0[at].1)
    }

    /// Multiplies the variances of what of these is drawn more than once, and notes it.
    pub(crate) fn share<E: Number>(&mut self, drawn: Vec<Drawn<E>>) {
        let times = repeats(&drawn.iter().map(|drawn| drawn.at.to_vec()).collect::<Vec<_>>());
        for (Drawn { source, covariances, .. }, times) in drawn.into_iter().zip(times) {
            if times > 1.0 {
                covariances.into_iter().flatten().for_each(|entry| *entry = *entry * times);
                self.0.push((source, times));
            }
        }
        self.0.sort_by_key(|&(of, _)| key(of));
    }
}

/// How often each of these polylines is drawn: 1 for what is drawn once.
pub(crate) fn repeats(polylines: &[Vec<[f64; 2]>]) -> Vec<f64> {
    let drawn: Vec<Extent> = polylines.iter().map(|points| Extent::new(points)).collect();
    let covered = |i: usize| -> f64 {
        let against = drawn.iter().enumerate().filter(|&(j, other)| j != i && drawn[i].may_lie_on(other));
        against.map(|(_, other)| drawn[i].covered_by(other)).sum()
    };
    (0..drawn.len()).map(|i| 1.0 + covered(i)).collect()
}

/// A polyline with its length and the box around it.
struct Extent<'a> {
    points: &'a [[f64; 2]],
    length: f64,
    low: [f64; 2],
    high: [f64; 2],
}

impl<'a> Extent<'a> {
    fn new(points: &'a [[f64; 2]]) -> Self {
        let fold = |k: usize, pick: fn(f64, f64) -> f64, start| points.iter().map(|p| p[k]).fold(start, pick);
        Self {
            points,
            length: segments(points).map(|segment| length(&segment)).sum(),
            low: [0, 1].map(|k| fold(k, f64::min, f64::INFINITY)),
            high: [0, 1].map(|k| fold(k, f64::max, f64::NEG_INFINITY)),
        }
    }

    /// Whether another is long enough to count, and anywhere near.
    fn may_lie_on(&self, other: &Self) -> bool {
        let is_near =
            |k: usize| self.low[k] <= other.high[k] + BESIDE && other.low[k] <= self.high[k] + BESIDE;
        other.length >= AS_LONG * self.length && is_near(0) && is_near(1)
    }

    /// Which share of it lies on another.
    fn covered_by(&self, other: &Self) -> f64 {
        let covered = |own: [[f64; 2]; 2]| -> f64 {
            let whole = length(&own);
            segments(other.points).map(|theirs| common_length(&own, &theirs)).sum::<f64>().min(whole)
        };
        let covered: f64 = segments(self.points).map(covered).sum();
        if self.length > 0.0 { covered / self.length } else { 0.0 }
    }
}

fn segments(points: &[[f64; 2]]) -> impl Iterator<Item = [[f64; 2]; 2]> + '_ {
    points.windows(2).map(|pair| [pair[0], pair[1]])
}

fn length([a, b]: &[[f64; 2]; 2]) -> f64 {
    (b[0] - a[0]).hypot(b[1] - a[1])
}

/// The length of a segment that lies on another.
fn common_length(segment: &[[f64; 2]; 2], other: &[[f64; 2]; 2]) -> f64 {
    let [from, to] = *other;
    let reach = length(other);
    if reach <= 0.0 {
        return 0.0;
    }
    let along = [(to[0] - from[0]) / reach, (to[1] - from[1]) / reach];
    let place = |p: [f64; 2]| {
        let (dx, dy) = (p[0] - from[0], p[1] - from[1]);
        (dx * along[0] + dy * along[1], dx * along[1] - dy * along[0])
    };
    let [(a, beside_a), (b, beside_b)] = segment.map(place);
    if !(beside_a.abs() <= BESIDE && beside_b.abs() <= BESIDE) {
        return 0.0;
    }
    (a.max(b).min(reach) - a.min(b).max(0.0)).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn copies_together_are_one(
            a in [-900.0..900.0_f64, -500.0..500.0_f64], angle in 0.0..6.0_f64, length in 40.0..900.0_f64, count in 1..30_usize,
        ) {
            let end = |s: f64| [a[0] + s * length * angle.cos(), a[1] + s * length * angle.sin()];
            let drawn = repeats(&vec![vec![end(0.0), end(1.0)]; count]);
            let together: f64 = drawn.iter().map(|times| times.recip()).sum();
            prop_assert!((together - 1.0).abs() < 1e-9);
            let apart = [[0.0, 1.0], [1.1, 2.1]].map(|ends| ends.map(end).to_vec());
            prop_assert_eq!(repeats(&apart), vec![1.0, 1.0], "two pieces of one edge, one after the other");
            let pieces = [[0.0, 1.0], [0.2, 0.4], [0.9, 0.5]].map(|ends| ends.map(end).to_vec());
            prop_assert_eq!(repeats(&pieces)[0], 1.0, "pieces do not count against the whole");
            prop_assert!(repeats(&pieces)[1] > 1.999, "the whole counts against a piece");
        }

        #[test]
        fn a_bent_edge_is_one_wherever_its_points_are_set(
            radius in 1500.0..6000.0_f64, counts in proptest::collection::vec(9..40_usize, 1..12),
        ) {
            let at = |s: f64| [radius * (s * 900.0 / radius).sin(), radius * (s * 900.0 / radius).cos()];
            let drawn: Vec<Vec<[f64; 2]>> = counts.iter().map(|&count| {
                (0..count).map(|i| at(i as f64 / (count - 1) as f64)).collect()
            }).collect();
            let together: f64 = repeats(&drawn).iter().map(|times| times.recip()).sum();
            prop_assert!((together - 1.0).abs() < 0.1, "{together} of {counts:?}");
            let beside: Vec<[f64; 2]> = drawn[0].iter().map(|[x, y]| [*x, y + 8.0]).collect();
            prop_assert_eq!(repeats(&[drawn[0].clone(), beside]), vec![1.0, 1.0], "an edge beside it is another");
        }
    }
}
