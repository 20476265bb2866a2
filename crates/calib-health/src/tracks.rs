//! Tracks of people in one camera: the rows of one person are combined into one observation.
//!
//! Errors in successive rows are correlated: the person has the same height, and the detector places the box
//! in the same way. A track is therefore the independent unit. The rows of a track are `y = f . b + a + e`,
//! with `y` the log height, `f` the features and `b` their coefficients. The deviation of the person is
//! `a ~ N(0, PERSON_SIGMA^2)`, and the deviation of the box is `e ~ N(0, BOX_SIGMA^2)`.
//!
//! Let `w` be the weights of a robust estimate ([`Height`]), `W` their sum and `k = PERSON_SIGMA^2 /
//! (BOX_SIGMA^2 + W PERSON_SIGMA^2)`. If errors of the boxes are correlated, `BOX_SIGMA^2` is multiplied by the
//! number of boxes for each independent box. The normal equations of `b` are (Harville 1977)
//!
//! ```text
//! H = (sum w f f' - k (sum w f) (sum w f)') / BOX_SIGMA^2
//! g = (sum w f y - k (sum w f) (sum w y)) / BOX_SIGMA^2
//! ```

use crate::stature::{FEATURES, Heights, PACKED, packed};

/// Standard deviation of the natural logarithm of the body height of adults.
const PERSON_SIGMA: f64 = 0.06;
/// Standard deviation of the log height measured from one box, relative to the log height of its person.
const BOX_SIGMA: f64 = 0.04;
/// Number of boxes with independent errors per second of a track.
const INDEPENDENT_BOXES_PER_S: f64 = 2.0;
/// Nanoseconds per second.
const NANOSECONDS_PER_SECOND: f64 = 1e9;
/// Longest gap in a track without an identifier from a tracker, in seconds.
const MAX_GAP_S: f64 = 2.0;
/// Longest gap in a track with an identifier from a tracker, in seconds.
const MAX_GAP_WITH_ID_S: f64 = 30.0;
/// Longest duration of a track, in seconds; a new track starts after it.
const MAX_TRACK_S: f64 = 30.0;
/// Largest number of open tracks of a camera.
const MAX_OPEN_TRACKS: usize = 96;

/// Row of a track: one detection of a person.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    /// Time, in nanoseconds since 1970.
    pub(crate) at: i64,
    /// Identifier of the person from a tracker, if any.
    pub(crate) person: Option<u64>,
    /// Foot, in pixels.
    pub(crate) foot: [f64; 2],
    /// Height of the box, in pixels.
    pub(crate) tall: f64,
    /// Log height of the person with its features; `None` if the detection is not an adult.
    pub(crate) height: Option<Height>,
    /// Median log height of all people at the camera.
    pub(crate) middle: f64,
}

/// Log height of a person in one row, with its features and its weight.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Height {
    /// Natural logarithm of the ratio of the person's height to a usual height.
    log: f64,
    features: [f64; FEATURES],
    /// Robust weight, 0 to 1.
    weight: f64,
}

impl Height {
    /// Creates a height from its logarithm `log`, with the weight of Tukey's biweight about the median log
    /// height `middle`. Returns `None` far from the median, as for children and for people with hidden feet.
    pub(crate) fn new(log: f64, middle: f64, features: [f64; FEATURES]) -> Option<Self> {
        /// Deviation from the median log height at which the weight is zero.
        const MAX_DEVIATION: f64 = 0.25;
        let share = ((log - middle) / MAX_DEVIATION).powi(2);
        let weight = (1.0 - share) * (1.0 - share);
        (share < 1.0).then_some(Self { log, features, weight })
    }

    /// Whether the height is close to the median height of the people at this camera (weight above 0.3).
    pub(crate) fn is_usual(&self) -> bool {
        self.weight > 0.3
    }
}

/// Track of one person: the last row, and the weighted sums of all rows for the normal equations.
///
/// The symbols of the sums are in the documentation of this file.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
struct Track {
    /// Identifier from a tracker, if any.
    person: Option<u64>,
    /// Time of the first row, in nanoseconds since 1970.
    first: i64,
    /// Time of the last row, in nanoseconds since 1970.
    last: i64,
    /// Foot in the last row, in pixels.
    foot: [f64; 2],
    /// Height of the box in the last row, in pixels.
    tall: f64,
    /// Median log height of all people at the camera, at the first row.
    middle: f64,
    /// Number of rows with a height.
    count: f64,
    /// Sum of the robust weights: `sum w`.
    weight: f64,
    /// Weighted sum of the log heights: `sum w y`.
    y: f64,
    /// Weighted sum of the features: `sum w f`.
    f: [f64; FEATURES],
    /// Weighted sum of the features times the log height: `sum w f y`.
    fy: [f64; FEATURES],
    /// Weighted sum of the outer products of the features, `sum w f f'`: upper triangle, row by row.
    ff: [f64; PACKED],
}

/// Open tracks of the people in view of one camera.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Tracks {
    open: Vec<Track>,
}

impl Track {
    const fn new(row: &Row) -> Self {
        Self {
            person: row.person,
            first: row.at,
            last: row.at,
            foot: row.foot,
            tall: row.tall,
            middle: row.middle,
            count: 0.0,
            weight: 0.0,
            y: 0.0,
            f: [0.0; FEATURES],
            fy: [0.0; FEATURES],
            ff: [0.0; PACKED],
        }
    }

    fn add(&mut self, row: &Row) {
        (self.foot, self.tall, self.last) = (row.foot, row.tall, row.at);
        let Some(Height { log, features: f, weight }) = row.height else { return };
        self.count += 1.0;
        self.weight += weight;
        self.y += weight * log;
        let mut next = 0;
        for i in 0..FEATURES {
            self.f[i] += weight * f[i];
            self.fy[i] += weight * f[i] * log;
            for j in i..FEATURES {
                self.ff[next] += weight * f[i] * f[j];
                next += 1;
            }
        }
    }

    /// Returns the distance between a row and the last row of this track, in box heights; `None` if the row
    /// is of another person. With identifiers from a tracker the distance is 0.
    fn distance(&self, row: &Row) -> Option<f64> {
        /// Largest walking speed, in box heights per second.
        const MAX_SPEED: f64 = 1.2;
        /// Largest distance between two boxes of one person without motion, in box heights.
        const MAX_JUMP: f64 = 0.25;
        if self.person.is_some() || row.person.is_some() {
            return (self.person == row.person).then_some(0.0);
        }
        let elapsed = (row.at - self.last) as f64 / NANOSECONDS_PER_SECOND;
        let tall = 0.5 * (self.tall + row.tall);
        let ratio = row.tall / self.tall;
        let away = (row.foot[0] - self.foot[0]).hypot(row.foot[1] - self.foot[1]) / tall;
        let is_near = away < MAX_JUMP + MAX_SPEED * elapsed.abs() && (0.6..1.7).contains(&ratio);
        // Two boxes at the same time belong to different people.
        (elapsed != 0.0 && is_near).then_some(away)
    }

    /// Whether the track has ended before the time `at`, in nanoseconds since 1970.
    fn has_ended(&self, at: i64) -> bool {
        let gone = if self.person.is_some() { MAX_GAP_WITH_ID_S } else { MAX_GAP_S };
        let [since_last, since_first] =
            [self.last, self.first].map(|then| (at - then) as f64 / NANOSECONDS_PER_SECOND);
        since_last.abs() > gone || since_first > MAX_TRACK_S
    }

    /// Returns the normal equations of the height coefficients `b` from all rows of the track; `None` if no row is
    /// a detection of an adult.
    fn heights(&self) -> Option<Heights> {
        if self.weight == 0.0 {
            return None;
        }
        let drawn = 1.0 + INDEPENDENT_BOXES_PER_S * (self.last - self.first) as f64 / NANOSECONDS_PER_SECOND;
        let within = BOX_SIGMA * BOX_SIGMA * (self.count / drawn).max(1.0);
        let between = PERSON_SIGMA * PERSON_SIGMA;
        let shared = between / (within + self.weight * between);
        let weigh = |sum: f64, a: f64, b: f64| (sum - shared * a * b) / within;
        let mut information = [0.0; PACKED];
        for i in 0..FEATURES {
            for j in i..FEATURES {
                information[packed(i, j)] = weigh(self.ff[packed(i, j)], self.f[i], self.f[j]);
            }
        }
        let score = std::array::from_fn(|i| weigh(self.fy[i], self.f[i], self.y));
        Some(Heights::of_track(information, score, self.middle))
    }
}

impl Tracks {
    /// Adds a row to the nearest open track, or to a new one. `on_end` receives the start time of every track
    /// that has ended, in nanoseconds since 1970, and its normal equations.
    pub(crate) fn add(&mut self, row: &Row, mut on_end: impl FnMut(i64, Heights)) {
        let mut nearest: Option<(usize, f64)> = None;
        let mut index = 0;
        while index < self.open.len() {
            if self.open[index].has_ended(row.at) {
                self.close(index, &mut on_end);
                continue;
            }
            let distance = self.open[index].distance(row);
            if let Some(distance) = distance.filter(|&d| nearest.is_none_or(|(_, least)| d < least)) {
                nearest = Some((index, distance));
            }
            index += 1;
        }
        if let Some((index, _)) = nearest {
            self.open[index].add(row);
            return;
        }
        if self.open.len() >= MAX_OPEN_TRACKS {
            self.close(0, &mut on_end);
        }
        let mut track = Track::new(row);
        track.add(row);
        self.open.push(track);
    }

    /// Removes an open track and passes its normal equations to `on_end`.
    fn close(&mut self, index: usize, on_end: &mut impl FnMut(i64, Heights)) {
        let track = self.open.swap_remove(index);
        if let Some(heights) = track.heights() {
            on_end(track.first, heights);
        }
    }

    /// Returns the start times of the open tracks, in nanoseconds since 1970, with their normal equations.
    pub(crate) fn open_heights(&self) -> impl Iterator<Item = (i64, Heights)> {
        self.open.iter().filter_map(|track| Some((track.first, track.heights()?)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(at: i64, u: f64, y: f64) -> Row {
        Row {
            at: at * 100_000_000,
            person: None,
            foot: [u, 600.0],
            tall: 200.0,
            middle: y,
            height: Height::new(y, y, [1.0, 0.5, 0.1, 1.0, 0.3]),
        }
    }

    #[test]
    fn people_are_separated_by_position() {
        let (mut tracks, mut ended) = (Tracks::default(), Vec::new());
        for at in 0..20 {
            for (person, y) in [(300.0, 0.5), (900.0, 0.6)] {
                tracks.add(&row(at, person + 4.0 * at as f64, y), |first, heights| {
                    ended.push((first, heights));
                });
            }
        }
        assert_eq!((tracks.open.len(), ended.len()), (2, 0));
        tracks.add(&row(100, 300.0, 0.5), |first, heights| ended.push((first, heights)));
        assert_eq!((tracks.open.len(), ended.len()), (1, 2));
    }

    #[test]
    fn many_rows_of_one_person_count_as_one_person() {
        let mut tracks = Tracks::default();
        (0..250).for_each(|at| tracks.add(&row(at, 300.0, 0.5), |_, _| {}));
        let (_, heights) = tracks.open_heights().next().unwrap();
        assert!(heights.information[0] < 1.0 / (PERSON_SIGMA * PERSON_SIGMA));
        assert!(heights.information[0] > 0.9 / (PERSON_SIGMA * PERSON_SIGMA));
        let mut one = Tracks::default();
        one.add(&row(0, 300.0, 0.5), |_, _| {});
        let (_, heights) = one.open_heights().next().unwrap();
        assert!(
            (heights.information[0] - 1.0 / (PERSON_SIGMA * PERSON_SIGMA + BOX_SIGMA * BOX_SIGMA)).abs()
                < 1e-9
        );
    }
}
