//! Evidence that is drawn more than once: segments on one edge share what is wrong with it.
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
        let times = repeats(&drawn.iter().map(|drawn| drawn.at).collect::<Vec<_>>());
        for (Drawn { source, covariances, .. }, times) in drawn.into_iter().zip(times) {
            if times > 1.0 {
                covariances.into_iter().flatten().for_each(|entry| *entry = *entry * times);
                self.0.push((source, times));
            }
        }
        self.0.sort_by_key(|&(of, _)| key(of));
    }
}

/// How often each of these segments is drawn: 1 for what is drawn once.
fn repeats(segments: &[[[f64; 2]; 2]]) -> Vec<f64> {
    let lengths: Vec<f64> = segments.iter().map(length).collect();
    let covered = |i: usize| -> f64 {
        let against = (0..segments.len()).filter(|&j| j != i && lengths[j] >= AS_LONG * lengths[i]);
        against.map(|j| covered_share(&segments[i], lengths[i], &segments[j])).sum()
    };
    (0..segments.len()).map(|i| 1.0 + covered(i)).collect()
}

fn length([a, b]: &[[f64; 2]; 2]) -> f64 {
    (b[0] - a[0]).hypot(b[1] - a[1])
}

/// Which share of a segment, `length` long, lies on another.
fn covered_share(segment: &[[f64; 2]; 2], length: f64, other: &[[f64; 2]; 2]) -> f64 {
    let [from, to] = *other;
    let reach = (to[0] - from[0]).hypot(to[1] - from[1]);
    let along = [(to[0] - from[0]) / reach, (to[1] - from[1]) / reach];
    let place = |p: [f64; 2]| {
        let (dx, dy) = (p[0] - from[0], p[1] - from[1]);
        (dx * along[0] + dy * along[1], dx * along[1] - dy * along[0])
    };
    let [(a, beside_a), (b, beside_b)] = segment.map(place);
    if !(beside_a.abs() <= BESIDE && beside_b.abs() <= BESIDE) {
        return 0.0;
    }
    let common = a.max(b).min(reach) - a.min(b).max(0.0);
    (common / length).clamp(0.0, 1.0)
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
            let drawn = repeats(&vec![[end(0.0), end(1.0)]; count]);
            let together: f64 = drawn.iter().map(|times| times.recip()).sum();
            prop_assert!((together - 1.0).abs() < 1e-9);
            let apart = [[end(0.0), end(1.0)], [end(1.1), end(2.1)]];
            prop_assert_eq!(repeats(&apart), vec![1.0, 1.0], "two pieces of one edge, one after the other");
            let pieces = [[end(0.0), end(1.0)], [end(0.2), end(0.4)], [end(0.9), end(0.5)]];
            prop_assert_eq!(repeats(&pieces)[0], 1.0, "pieces do not count against the whole");
            prop_assert!(repeats(&pieces)[1] > 1.999, "the whole counts against a piece");
        }
    }
}
