//! People in view of one camera: the rows of one person are gathered into one observation.
//!
//! What is off in one row is off in the next: the person is as tall as before, and the detector draws the box alike.
//! So a track is what counts as independent. Its rows are `y = f . b + a + e`, with `y` the logarithm of a height, `f`
//! the features, a person's own `a ~ N(0, BETWEEN^2)` and the box's `e ~ N(0, WITHIN^2)`. With the weights
//! `w` of a robust estimate ([`Height`]), `W` their sum and `k = BETWEEN^2 / (WITHIN^2 + W BETWEEN^2)` the normal equations of `b` are (Harville 1977)
//!
//! ```text
//! H = (sum w f f' - k (sum w f) (sum w f)') / WITHIN^2,   g = (sum w f y - k (sum w f) (sum w y)) / WITHIN^2
//! ```

use crate::stature::{FEATURES, Heights, PACKED, packed};

/// Spread of the logarithm of adults' heights, as a standard deviation.
const BETWEEN: f64 = 0.06;
/// Of the logarithm of the height of a box about that of its person.
const WITHIN: f64 = 0.04;
/// A box is drawn anew so often, per second: in between, errors are those of the box before.
const DRAWN: f64 = 2.0;
/// Nanoseconds of a second.
const SECOND: f64 = 1e9;
/// Who is not seen for so long is gone, in seconds: by where they were, and by their number.
const GONE: f64 = 2.0;
const GONE_BY_NUMBER: f64 = 30.0;
/// Who stays longer, in seconds, begins a new track.
const LONGEST: f64 = 30.0;
/// People in view of one camera at a time, at most.
const MOST: usize = 96;

/// One row of a track.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    pub(crate) at: i64,
    pub(crate) person: Option<u64>,
    /// The foot, and the height of the box, in pixels.
    pub(crate) foot: [f64; 2],
    pub(crate) tall: f64,
    /// `None` where it is no adult's.
    pub(crate) height: Option<Height>,
    /// Of the heights of all people, as their logarithm.
    pub(crate) middle: f64,
}

/// The height of a person in one row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Height {
    log: f64,
    features: [f64; FEATURES],
    weight: f64,
}

impl Height {
    /// The logarithm of a height, with the weight of Tukey's biweight about the middle of all: children, and people
    /// whose feet are hidden, are far from it and do not count.
    pub(crate) fn new(log: f64, middle: f64, features: [f64; FEATURES]) -> Option<Self> {
        const NEAR: f64 = 0.25;
        let share = ((log - middle) / NEAR).powi(2);
        let weight = (1.0 - share) * (1.0 - share);
        (share < 1.0).then_some(Self { log, features, weight })
    }

    /// Whether it is one that counts.
    pub(crate) fn is_usual(&self) -> bool {
        self.weight > 0.3
    }
}

/// One person in view.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
struct Track {
    person: Option<u64>,
    first: i64,
    last: i64,
    foot: [f64; 2],
    tall: f64,
    middle: f64,
    count: f64,
    weight: f64,
    y: f64,
    f: [f64; FEATURES],
    fy: [f64; FEATURES],
    ff: [f64; PACKED],
}

/// People in view of one camera.
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

    /// How far a row is from where it would be of this person, in heights of the box; `None` of another one.
    fn distance(&self, row: &Row) -> Option<f64> {
        /// Heights of a box that people walk in a second, and that the next box may be off.
        const SPEED: f64 = 1.2;
        const OFF: f64 = 0.25;
        if self.person.is_some() || row.person.is_some() {
            return (self.person == row.person).then_some(0.0);
        }
        let elapsed = (row.at - self.last) as f64 / SECOND;
        let tall = 0.5 * (self.tall + row.tall);
        let ratio = row.tall / self.tall;
        let away = (row.foot[0] - self.foot[0]).hypot(row.foot[1] - self.foot[1]) / tall;
        let is_near = away < OFF + SPEED * elapsed.abs() && (0.6..1.7).contains(&ratio);
        // Two boxes of one moment are two people.
        (elapsed != 0.0 && is_near).then_some(away)
    }

    fn is_over(&self, at: i64) -> bool {
        let gone = if self.person.is_some() { GONE_BY_NUMBER } else { GONE };
        let [since_last, since_first] = [self.last, self.first].map(|then| (at - then) as f64 / SECOND);
        since_last.abs() > gone || since_first > LONGEST
    }

    /// What the track tells; nothing where no row was a person's.
    fn heights(&self) -> Option<Heights> {
        if self.weight == 0.0 {
            return None;
        }
        let drawn = 1.0 + DRAWN * (self.last - self.first) as f64 / SECOND;
        let within = WITHIN * WITHIN * (self.count / drawn).max(1.0);
        let between = BETWEEN * BETWEEN;
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
    /// Takes a row; `over` gets what tracks tell that have ended, with the time that they began.
    pub(crate) fn see(&mut self, row: &Row, mut over: impl FnMut(i64, Heights)) {
        let mut nearest: Option<(usize, f64)> = None;
        let mut index = 0;
        while index < self.open.len() {
            if self.open[index].is_over(row.at) {
                self.close(index, &mut over);
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
        if self.open.len() >= MOST {
            self.close(0, &mut over);
        }
        let mut track = Track::new(row);
        track.add(row);
        self.open.push(track);
    }

    fn close(&mut self, index: usize, over: &mut impl FnMut(i64, Heights)) {
        let track = self.open.swap_remove(index);
        if let Some(heights) = track.heights() {
            over(track.first, heights);
        }
    }

    /// What the tracks tell that have not ended.
    pub(crate) fn open(&self) -> impl Iterator<Item = (i64, Heights)> {
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
    fn people_are_told_apart_by_where_they_are() {
        let (mut tracks, mut ended) = (Tracks::default(), Vec::new());
        for at in 0..20 {
            for (person, y) in [(300.0, 0.5), (900.0, 0.6)] {
                tracks.see(&row(at, person + 4.0 * at as f64, y), |first, heights| {
                    ended.push((first, heights));
                });
            }
        }
        assert_eq!((tracks.open.len(), ended.len()), (2, 0));
        tracks.see(&row(100, 300.0, 0.5), |first, heights| ended.push((first, heights)));
        assert_eq!((tracks.open.len(), ended.len()), (1, 2));
    }

    #[test]
    fn many_rows_of_one_person_tell_no_more_of_people_than_one_person_does() {
        let mut tracks = Tracks::default();
        (0..250).for_each(|at| tracks.see(&row(at, 300.0, 0.5), |_, _| {}));
        let (_, heights) = tracks.open().next().unwrap();
        assert!(heights.information[0] < 1.0 / (BETWEEN * BETWEEN));
        assert!(heights.information[0] > 0.9 / (BETWEEN * BETWEEN));
        let mut one = Tracks::default();
        one.see(&row(0, 300.0, 0.5), |_, _| {});
        let (_, heights) = one.open().next().unwrap();
        assert!((heights.information[0] - 1.0 / (BETWEEN * BETWEEN + WITHIN * WITHIN)).abs() < 1e-9);
    }
}
