//! Evidence that is drawn more than once: what is drawn again shares what is wrong with it.
//!
//! A hand that follows an edge again follows the same edge: where it is bent, or is not where it seems to be,
//! every copy errs alike. So the copies together say what one of them says: the variance of each is multiplied
//! by how many there are, counting of every other one the share of the segment that it covers. A short piece
//! beside a long one does not count against the long one. What is unknown of the copies alone, as their direction
//! or their length, is one unknown.

use crate::outcome::Source;

/// How often what is drawn more than once is drawn.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Repeats {
    /// By its source, and in the order of these.
    times: Vec<(Source, f64)>,
    /// Which share a group of directions is of all that draw the same, where it is not all.
    directions: Vec<(usize, f64)>,
    /// Which share a group of lengths is of all that draw the same, where it is not all.
    lengths: Vec<(usize, f64)>,
}

const fn key(source: Source) -> (usize, usize) {
    (source.annotation, source.segment)
}

fn share(of: &[(usize, f64)], group: usize) -> f64 {
    of.binary_search_by_key(&group, |&(group, _)| group).map_or(1.0, |at| of[at].1)
}

/// Those that are not all of what they draw.
fn shared(shares: &[f64]) -> Vec<(usize, f64)> {
    shares.iter().copied().enumerate().filter(|&(_, share)| share < 1.0).collect()
}

impl Repeats {
    /// Everything is drawn once.
    pub const NONE: Self = Self { times: Vec::new(), directions: Vec::new(), lengths: Vec::new() };

    /// How often the edge is drawn that a segment is on.
    pub(crate) fn times(&self, source: Source) -> f64 {
        let found = self.times.binary_search_by_key(&key(source), |&(of, _)| key(of));
        found.map_or(1.0, |at| self.times[at].1)
    }

    /// Which share of an unknown a group of directions is.
    pub(crate) fn share_of_direction(&self, group: usize) -> f64 {
        share(&self.directions, group)
    }

    /// Which share of an unknown a group of lengths is.
    pub(crate) fn share_of_length(&self, group: usize) -> f64 {
        share(&self.lengths, group)
    }

    /// Notes how often these are drawn.
    pub(crate) fn note(&mut self, times: impl Iterator<Item = (Source, f64)>) {
        self.times.extend(times.filter(|&(_, times)| times > 1.0));
        self.times.sort_by_key(|&(of, _)| key(of));
    }

    /// Notes which share every group of directions is.
    pub(crate) fn note_directions(&mut self, shares: &[f64]) {
        self.directions = shared(shares);
    }

    /// Notes which share every group of lengths is.
    pub(crate) fn note_lengths(&mut self, shares: &[f64]) {
        self.lengths = shared(shares);
    }
}
