//! Overlapping polylines: edges that are annotated more than once, and the repeat counts of their copies.
//!
//! Two annotations of the same edge share its errors: if the edge is curved or misplaced, every copy has the
//! same error. So the copies together count as one. The variance of each copy is multiplied by its repeat
//! count. The count is 1 plus the fraction of the segment that each other copy covers. A short piece does not
//! count against a longer line. Unknowns of the copies alone, for example the directions of their groups,
//! together count as one unknown.
//!
//! A piece overlaps a piece of another polyline if both its ends are within [`MAX_OVERLAP_DISTANCE_PX`] of the
//! line through the other piece. Polylines that are identical bit by bit share one location, evaluated once.
//! Pieces are sorted by angle. If one piece overlaps another, the sine of the difference of their angles is
//! limited. It is at most twice [`MAX_OVERLAP_DISTANCE_PX`] divided by the length of the first piece. So only
//! few pairs of many lines are compared.

use std::collections::HashMap;

use crate::outcome::Source;

/// Largest distance between two segments of the same edge, in pixels.
pub const MAX_OVERLAP_DISTANCE_PX: f64 = 3.0;
/// Minimum length of a polyline that counts as a copy of another one, as a fraction of the other's length. A segment
/// is a repeat if another one overlaps at least this fraction of it.
const MIN_LENGTH_RATIO: f64 = 0.8;
/// Minimum length, in pixels, of a segment whose angle is used to preselect overlapping segments. A shorter segment
/// is compared with all segments nearby.
const MIN_ANGLE_LENGTH_PX: f64 = 8.0 * MAX_OVERLAP_DISTANCE_PX;

/// Repeat counts of a polyline: 1, plus the fraction of it that each other polyline covers. A class contains the
/// polylines that share an unknown, for example a direction. The counts of a polyline without a class are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Count {
    /// Repeat count among the polylines of all classes.
    pub(crate) all: f64,
    /// Repeat count among the polylines of the same class.
    pub(crate) own: f64,
}

impl Count {
    /// Returns the fraction of all copies of the polyline that are in its class: `own / all`. Returns 1 for a
    /// polyline without a class.
    pub(crate) fn share(&self) -> f64 {
        if self.all > 0.0 { self.own / self.all } else { 1.0 }
    }
}

/// Polylines, grouped by location.
pub(crate) struct Overlaps<'a> {
    /// Distinct polylines, one for each location.
    places: Vec<Extent<'a>>,
    /// Index of the location of every polyline, in `places`.
    place_of: Vec<usize>,
    /// Pieces of all locations, sorted by angle.
    pieces: Vec<Piece>,
}

impl<'a> Overlaps<'a> {
    pub(crate) fn new(polylines: &'a [Vec<[f64; 2]>]) -> Self {
        let mut known: HashMap<Vec<[u64; 2]>, usize> = HashMap::new();
        let mut places: Vec<Extent> = Vec::new();
        let place = |points: &'a Vec<[f64; 2]>| {
            *known.entry(points.iter().map(|p| p.map(f64::to_bits)).collect()).or_insert_with(|| {
                places.push(Extent::new(points));
                places.len() - 1
            })
        };
        let place_of = polylines.iter().map(place).collect();
        let of = |(place, extent): (usize, &Extent<'a>)| {
            segments(extent.points).map(move |ends| Piece::new(place, ends)).collect::<Vec<_>>()
        };
        let mut pieces: Vec<Piece> = places.iter().enumerate().flat_map(of).collect();
        pieces.sort_by(|a, b| a.angle.total_cmp(&b.angle));
        Self { places, place_of, pieces }
    }

    /// Returns the repeat count of every polyline: 1, plus the fraction of it that each overlapping polyline covers.
    pub(crate) fn repeat_counts(&self) -> Vec<f64> {
        self.counts([&|_| Some(0)]).into_iter().map(|[count]| count.all).collect()
    }

    /// Returns the repeat counts of every polyline, one for each classification. A classification maps the index of a
    /// polyline to its class. Polylines without a class (`None`) are not counted.
    pub(crate) fn counts<const N: usize>(
        &self,
        classes: [&dyn Fn(usize) -> Option<usize>; N],
    ) -> Vec<[Count; N]> {
        let tallies: [Vec<Tally>; N] = classes.map(|class| self.tallies(class));
        let mut sums: [Vec<WeightedTally>; N] =
            tallies.each_ref().map(|of| of.iter().map(WeightedTally::new).collect());
        self.each_overlap(|on, other, share| {
            for (sums, tallies) in sums.iter_mut().zip(&tallies) {
                sums[on].add(&tallies[on], &tallies[other], share);
            }
        });
        let of = |(polyline, &place): (usize, &usize)| {
            std::array::from_fn(|k| sums[k][place].count(&tallies[k][place], classes[k](polyline)))
        };
        self.place_of.iter().enumerate().map(of).collect()
    }

    /// Counts the polylines at every location.
    fn tallies(&self, class: &dyn Fn(usize) -> Option<usize>) -> Vec<Tally> {
        let mut classes: Vec<Vec<usize>> = vec![Vec::new(); self.places.len()];
        for (polyline, &place) in self.place_of.iter().enumerate() {
            classes[place].extend(class(polyline));
        }
        classes.into_iter().map(Tally::new).collect()
    }

    /// Calls `sink` for every ordered pair of overlapping locations. The arguments are the indices of both, and the
    /// fraction of the first polyline's length that the second covers.
    fn each_overlap(&self, mut sink: impl FnMut(usize, usize, f64)) {
        // Overlap of the current piece and of the current location with every other location.
        let (mut of_piece, mut of_place) = (Lengths::of(self.places.len()), Lengths::of(self.places.len()));
        for (index, own) in self.places.iter().enumerate().filter(|(_, own)| own.length > 0.0) {
            for ends in segments(own.points) {
                let whole = length(&ends);
                self.each_near(own, &ends, |other| {
                    if other.place != index && own.may_overlap(&self.places[other.place]) {
                        of_piece.add(other.place, common_length(&ends, &other.ends));
                    }
                });
                of_piece.drain(|place, common| of_place.add(place, common.min(whole)));
            }
            of_place.drain(|place, common| sink(index, place, common / own.length));
        }
    }

    /// Calls `sink` with every segment of any polyline that may overlap one segment of the polyline `own`. `ends` are
    /// the ends of that one segment, in pixels.
    fn each_near(&self, own: &Extent, ends: &[[f64; 2]; 2], mut sink: impl FnMut(&Piece)) {
        use std::f64::consts::PI;
        let whole = length(ends);
        if whole < MIN_ANGLE_LENGTH_PX {
            let near = self.places.iter().enumerate().filter(|(_, other)| own.may_overlap(other));
            for (place, other) in near {
                segments(other.points).for_each(|ends| sink(&Piece::new(place, ends)));
            }
            return;
        }
        let (angle, most) = (angle(ends), (2.0 * MAX_OVERLAP_DISTANCE_PX / whole).asin() + 1e-9);
        let mut within = |low: f64, high: f64| {
            let first = self.pieces.partition_point(|piece| piece.angle < low);
            self.pieces[first..].iter().take_while(|piece| piece.angle <= high).for_each(&mut sink);
        };
        within(angle - most, angle + most);
        // A direction has no sign.
        if angle < most {
            within(angle - most + PI, PI);
        }
        if angle > PI - most {
            within(0.0, angle + most - PI);
        }
    }
}

/// Lengths of the overlaps of one piece or polyline with the polylines at all locations, in pixels. Most lengths are
/// zero, so the indices of the others are listed.
struct Lengths {
    /// Length of the overlap at every location, in pixels.
    by_place: Vec<f64>,
    /// Indices of the locations with a non-zero length.
    known: Vec<usize>,
}

impl Lengths {
    /// Returns lengths of zero for `count` locations.
    fn of(count: usize) -> Self {
        Self { by_place: vec![0.0; count], known: Vec::new() }
    }

    /// Adds a length at a location.
    fn add(&mut self, place: usize, length: f64) {
        if length > 0.0 {
            if self.by_place[place] == 0.0 {
                self.known.push(place);
            }
            self.by_place[place] += length;
        }
    }

    /// Calls `sink` with every location of non-zero length, and that length. Resets all lengths to zero.
    fn drain(&mut self, mut sink: impl FnMut(usize, f64)) {
        for place in self.known.drain(..) {
            sink(place, std::mem::take(&mut self.by_place[place]));
        }
    }
}

/// Number of polylines at one location, in total and by class.
struct Tally {
    all: f64,
    /// Classes with the number of polylines in each, sorted by class.
    by_class: Vec<(usize, f64)>,
}

impl Tally {
    fn new(mut classes: Vec<usize>) -> Self {
        classes.sort_unstable();
        let by_class = classes.chunk_by(|a, b| a == b).map(|same| (same[0], same.len() as f64)).collect();
        Self { all: classes.len() as f64, by_class }
    }

    /// Returns the position of a class in `by_class`.
    fn position(&self, class: usize) -> Option<usize> {
        self.by_class.binary_search_by_key(&class, |&(known, _)| known).ok()
    }

    /// Returns the number of polylines of a class.
    fn of(&self, class: usize) -> f64 {
        self.position(class).map_or(0.0, |at| self.by_class[at].1)
    }
}

/// Weighted number of polylines at one location and at overlapping locations, in total and for the classes of
/// the location.
struct WeightedTally {
    all: f64,
    /// Weighted number of polylines of every class, in the order of the tally of the location.
    by_class: Vec<f64>,
}

impl WeightedTally {
    fn new(tally: &Tally) -> Self {
        Self { all: tally.all, by_class: tally.by_class.iter().map(|&(_, drawn)| drawn).collect() }
    }

    /// Adds the polyline counts of an overlapping location, `other`, weighted by the overlapping fraction
    /// `share`. `own` is the tally of this location, and determines the counted classes.
    fn add(&mut self, own: &Tally, other: &Tally, share: f64) {
        self.all += share * other.all;
        for (sum, &(class, _)) in self.by_class.iter_mut().zip(&own.by_class) {
            *sum += share * other.of(class);
        }
    }

    /// Returns the repeat counts of a polyline of this class; 0 without a class.
    fn count(&self, own: &Tally, class: Option<usize>) -> Count {
        let own = class.and_then(|class| own.position(class));
        own.map_or(Count::default(), |at| Count { all: self.all, own: self.by_class[at] })
    }
}

/// Segment of a polyline at a location.
struct Piece {
    /// Index of the location in [`Overlaps::places`].
    place: usize,
    ends: [[f64; 2]; 2],
    /// Angle of the segment, in radians, in [0, pi).
    angle: f64,
}

impl Piece {
    fn new(place: usize, ends: [[f64; 2]; 2]) -> Self {
        Self { place, ends, angle: angle(&ends) }
    }
}

/// Polyline with its length and bounding box.
struct Extent<'a> {
    points: &'a [[f64; 2]],
    length: f64,
    /// Smallest coordinates of the points, in pixels.
    low: [f64; 2],
    /// Largest coordinates of the points, in pixels.
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

    /// Whether another polyline is long enough to be a repeat of this one ([`MIN_LENGTH_RATIO`]), and near enough to
    /// overlap it.
    fn may_overlap(&self, other: &Self) -> bool {
        let is_near = |k: usize| {
            self.low[k] <= other.high[k] + MAX_OVERLAP_DISTANCE_PX
                && other.low[k] <= self.high[k] + MAX_OVERLAP_DISTANCE_PX
        };
        other.length >= MIN_LENGTH_RATIO * self.length && is_near(0) && is_near(1)
    }
}

/// Iterates over the segments of a polyline.
fn segments(points: &[[f64; 2]]) -> impl Iterator<Item = [[f64; 2]; 2]> + '_ {
    points.windows(2).map(|pair| [pair[0], pair[1]])
}

/// Returns the length of a segment, in pixels.
fn length([a, b]: &[[f64; 2]; 2]) -> f64 {
    (b[0] - a[0]).hypot(b[1] - a[1])
}

/// Returns the angle of the line through two points, in radians, in [0, pi).
fn angle([a, b]: &[[f64; 2]; 2]) -> f64 {
    let angle = (b[1] - a[1]).atan2(b[0] - a[0]).rem_euclid(std::f64::consts::PI);
    if angle < std::f64::consts::PI { angle } else { 0.0 }
}

/// Whether a segment overlaps another so far that it counts as a repeat.
pub(crate) fn is_repeat_of(segment: &[[f64; 2]; 2], other: &[[f64; 2]; 2]) -> bool {
    common_length(segment, other) >= MIN_LENGTH_RATIO * length(segment)
}

/// Returns the length of the part of a segment that overlaps another, in pixels.
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
    let [(a, across_a), (b, across_b)] = segment.map(place);
    if !(across_a.abs() <= MAX_OVERLAP_DISTANCE_PX && across_b.abs() <= MAX_OVERLAP_DISTANCE_PX) {
        return 0.0;
    }
    (a.max(b).min(reach) - a.min(b).max(0.0)).max(0.0)
}

/// Repeat counts of segments that are annotated more than once, and the shares of their groups.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Repeats {
    /// Repeat counts by segment, sorted.
    times: Vec<(Source, f64)>,
    /// Share that the lines of each direction group have among all their copies, as pairs of group and share. The
    /// pairs are sorted by group; shares of 1 are omitted.
    directions: Vec<(usize, f64)>,
    /// Share that the segments of each length group have among all their copies, as pairs of group and share. The
    /// pairs are sorted by group; shares of 1 are omitted.
    lengths: Vec<(usize, f64)>,
}

/// Returns the sort key of a segment.
const fn key(source: Source) -> (usize, usize) {
    (source.annotation, source.segment)
}

/// Returns the share of a group in a sorted list; 1 if the list does not contain the group.
fn share(of: &[(usize, f64)], group: usize) -> f64 {
    of.binary_search_by_key(&group, |&(group, _)| group).map_or(1.0, |at| of[at].1)
}

/// Returns the groups whose share is less than 1, with that share.
fn shared(shares: &[f64]) -> Vec<(usize, f64)> {
    shares.iter().copied().enumerate().filter(|&(_, share)| share < 1.0).collect()
}

impl Repeats {
    /// Repeat counts of an image in which every line is drawn once.
    pub const NONE: Self = Self { times: Vec::new(), directions: Vec::new(), lengths: Vec::new() };

    /// Returns the repeat count of a segment; 1 if the segment is not repeated.
    pub(crate) fn repeat_count(&self, source: Source) -> f64 {
        let found = self.times.binary_search_by_key(&key(source), |&(of, _)| key(of));
        found.map_or(1.0, |at| self.times[at].1)
    }

    /// Returns the share that the lines of a direction group have among all their copies, at most 1. Two groups with
    /// the same lines have a share of 1/2 each: their directions count as one unknown together.
    pub(crate) fn share_of_direction(&self, group: usize) -> f64 {
        share(&self.directions, group)
    }

    /// Returns the share that the segments of a length group have among all their copies. The length of the group
    /// counts as this fraction of one unknown.
    pub(crate) fn share_of_length(&self, group: usize) -> f64 {
        share(&self.lengths, group)
    }

    /// Stores the repeat counts of segments; counts of 1 are omitted.
    pub(crate) fn insert(&mut self, times: impl Iterator<Item = (Source, f64)>) {
        self.times.extend(times.filter(|&(_, times)| times > 1.0));
        self.times.sort_by_key(|&(of, _)| key(of));
    }

    /// Stores the shares of the groups of directions; shares of 1 are omitted.
    pub(crate) fn set_direction_shares(&mut self, shares: &[f64]) {
        self.directions = shared(shares);
    }

    /// Stores the shares of the groups of lengths; shares of 1 are omitted.
    pub(crate) fn set_length_shares(&mut self, shares: &[f64]) {
        self.lengths = shared(shares);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn times(polylines: &[Vec<[f64; 2]>]) -> Vec<f64> {
        Overlaps::new(polylines).repeat_counts()
    }

    /// Computes the repeat counts by definition: every polyline against every other.
    fn repeat_counts_by_definition(polylines: &[Vec<[f64; 2]>]) -> Vec<f64> {
        let drawn: Vec<Extent> = polylines.iter().map(|points| Extent::new(points)).collect();
        let common = |own: &Extent, other: &Extent| -> f64 {
            let on = |own: [[f64; 2]; 2]| -> f64 {
                segments(other.points)
                    .map(|theirs| common_length(&own, &theirs))
                    .sum::<f64>()
                    .min(length(&own))
            };
            segments(own.points).map(on).sum::<f64>() / own.length
        };
        let others = |i: usize| (0..drawn.len()).filter(move |&j| j != i);
        let covered = |i: usize| -> f64 {
            let on = others(i).filter(|&j| drawn[i].may_overlap(&drawn[j]));
            on.map(|j| common(&drawn[i], &drawn[j])).sum()
        };
        (0..drawn.len()).map(|i| 1.0 + covered(i)).collect()
    }

    proptest! {
        #[test]
        fn copies_together_count_as_one(
            a in [-900.0..900.0_f64, -500.0..500.0_f64], angle in 0.0..6.0_f64, length in 40.0..900.0_f64, count in 1..30_usize,
        ) {
            let end = |s: f64| [a[0] + s * length * angle.cos(), a[1] + s * length * angle.sin()];
            let together: f64 = times(&vec![vec![end(0.0), end(1.0)]; count]).iter().map(|times| times.recip()).sum();
            prop_assert!((together - 1.0).abs() < 1e-9);
            let apart = [[0.0, 1.0], [1.1, 2.1]].map(|ends| ends.map(end).to_vec());
            prop_assert_eq!(times(&apart), vec![1.0, 1.0], "two consecutive pieces of one edge");
            let pieces = [[0.0, 1.0], [0.2, 0.4], [0.9, 0.5]].map(|ends| ends.map(end).to_vec());
            prop_assert_eq!(times(&pieces)[0], 1.0, "pieces do not count against the whole line");
            prop_assert!(times(&pieces)[1] > 1.999, "the whole line counts against a piece");
        }

        // With nine points, the sagitta between neighbours is 0.9 px on the arc with the smallest radius.
        // Edges with more curvature are drawn with more points.
        #[test]
        fn curved_edge_counts_once_for_any_number_of_points(
            radius in 1800.0..6000.0_f64, counts in proptest::collection::vec(9..40_usize, 1..12),
        ) {
            let at = |s: f64| [radius * (s * 900.0 / radius).sin(), radius * (s * 900.0 / radius).cos()];
            let drawn: Vec<Vec<[f64; 2]>> = counts.iter().map(|&count| {
                (0..count).map(|i| at(i as f64 / (count - 1) as f64)).collect()
            }).collect();
            let together: f64 = times(&drawn).iter().map(|times| times.recip()).sum();
            prop_assert!((together - 1.0).abs() < 0.1, "{together} of {counts:?}");
            let adjacent: Vec<[f64; 2]> = drawn[0].iter().map(|[x, y]| [*x, y + 8.0]).collect();
            prop_assert_eq!(times(&[drawn[0].clone(), adjacent]), vec![1.0, 1.0], "an adjacent edge is a different edge");
        }

        #[test]
        fn angle_search_matches_the_definition(
            drawn in proptest::collection::vec(([0.0..300.0_f64, 0.0..300.0_f64], 0.0..6.3_f64, 1.0..200.0_f64, 2..5_usize), 1..30),
            again in proptest::collection::vec((0..30_usize, [-3.0..3.0_f64, -3.0..3.0_f64], 0.5..1.5_f64), 0..30),
        ) {
            let line = |a: [f64; 2], angle: f64, length: f64, points: usize| -> Vec<[f64; 2]> {
                let at = |s: f64| [a[0] + s * length * angle.cos(), a[1] + s * length * angle.sin()];
                (0..points).map(|i| at(i as f64 / (points - 1) as f64)).collect()
            };
            let mut lines: Vec<Vec<[f64; 2]>> = drawn.iter().map(|&(a, angle, length, points)| line(a, angle, length, points)).collect();
            for &(of, by, scale) in &again {
                let (a, angle, length, points) = drawn[of % drawn.len()];
                lines.push(line([a[0] + by[0], a[1] + by[1]], angle + 0.003 * by[0], scale * length, points));
            }
            for (fast, slow) in times(&lines).into_iter().zip(repeat_counts_by_definition(&lines)) {
                prop_assert!((fast - slow).abs() < 1e-9, "{fast} {slow}");
            }
        }

        #[test]
        fn copies_in_two_classes_share_the_count(
            a in [-900.0..900.0_f64, -500.0..500.0_f64], angle in 0.0..6.0_f64, counts in [1..9_usize, 1..9_usize],
        ) {
            let segment = vec![a, [a[0] + 300.0 * angle.cos(), a[1] + 300.0 * angle.sin()]];
            let drawn = vec![segment; counts[0] + counts[1]];
            let class = |i: usize| Some(usize::from(i >= counts[0]));
            let shares: Vec<f64> = Overlaps::new(&drawn).counts([&class]).iter().map(|[count]| count.share()).collect();
            prop_assert!((shares[0] + shares[counts[0]] - 1.0).abs() < 1e-12);
            prop_assert!((shares[0] - counts[0] as f64 / (counts[0] + counts[1]) as f64).abs() < 1e-12);
        }
    }
}
