//! Since when a camera stands otherwise: the generalized likelihood ratio over all times of the change and all
//! movements (Willsky and Jones 1976).
//!
//! Of a change at the begin of window `t`, what the sources tell of the movement adds up to `H m = g`. Cameras are bumped
//! and zoomed one way at a time, mostly: beside `g' H^-1 g`, a chi-square of up to four degrees of freedom where nothing
//! moved, every parameter is tried by itself, a chi-square of one degree. How improbable the least probable of them
//! is, as the sigmas of a normal number by their weights, is the statistic; its largest value over `t` dates the change.
//! Whether heights changed with the season is told by the other cameras at the same time.
//!
//! Tilt and zoom make all people before a camera taller or shorter, which families, groups and hours do, too: what tells of
//! them counts less ([`BY_PARAMETER`]) than what tells of a roll, by which who is on one side is taller and on the other
//! shorter, or of a pan, which other cameras tell.

use nalgebra::{DMatrix, DVector};

use crate::heights::{FEATURES, MOVED, SEASON};
use crate::normal_equations::NormalEquations;
use crate::pairs::UNKNOWNS;
use crate::series::Series;
use crate::stature::SEEN;
use calib_core::camera::Movement;
use calib_core::optimize::sigmas;

/// The statistic from which on a camera counts as moved.
///
/// Changes are looked for at all times, of many parameters, and people are no normal numbers: of 18,000 simulated days of
/// cameras on which nothing happened it was larger on 15, which the ignored test of `tests/watch.rs` counts.
pub(crate) const ALARM: f64 = 4.8;
/// What evidence counts, by the parameter that it tells of: on 6,000 of those days the largest sigmas of pan, tilt, roll and
/// zoom were, once in a thousand, 3.4, 6.3, 4.1 and 6.6.
const BY_PARAMETER: [f64; Movement::SIZE] = [1.0, 0.7, 1.1, 0.7];
/// What evidence of several parameters counts: no more than of any.
const TOGETHER: f64 = 0.7;
/// By how much a movement of several parameters must be clearer than one of a single one: of few people, odd
/// ones among them, some combination tells something soon.
const CLEARER: f64 = 1.5;
/// Times whose squared statistic is so much lower than the largest are not ruled out.
const NOT_RULED_OUT: f64 = 8.0;
/// What the heights before one camera change by themselves, as a standard deviation of the logarithm: another public.
const LOCAL: f64 = 0.003;
/// What they change by everywhere, before any camera says so.
const SEASONAL: f64 = 0.02;
/// Windows before and after a change, at least.
const WINDOWS: usize = 2;

/// All sources of evidence of a site.
#[derive(Debug)]
pub(crate) struct Sources {
    /// Heights, by camera.
    pub(crate) heights: Vec<Series>,
    /// By pair of cameras.
    pub(crate) pairs: Vec<([usize; 2], Series)>,
    /// Number of windows.
    pub(crate) windows: usize,
}

/// A change of one camera.
#[derive(Clone, Debug)]
pub(crate) struct Changed {
    /// The first window after it, and the first and last one that are not ruled out.
    pub(crate) at: usize,
    pub(crate) earliest: usize,
    pub(crate) latest: usize,
    pub(crate) movement: DVector<f64>,
    pub(crate) covariance: DMatrix<f64>,
    pub(crate) statistic: f64,
    /// The part of the statistic that heights have by themselves, and that other cameras have.
    pub(crate) by: [f64; 2],
}

/// Precisions of what stays the same of the heights: the camera's own errors, and the detector's.
pub(crate) fn held_heights() -> DVector<f64> {
    DVector::from_row_slice(&[0.3, 0.05, 0.05, 0.05, 0.3].map(|sigma: f64| sigma.powi(-2)))
}

/// The same of a pair.
pub(crate) fn held_pairs() -> DVector<f64> {
    DVector::from_element(UNKNOWNS, 0.05_f64.powi(-2))
}

/// Precisions about no movement: nobody turns a camera by more than about this and still asks.
fn held_movement() -> DVector<f64> {
    DVector::from_element(Movement::SIZE, 0.5_f64.powi(-2))
}

impl Sources {
    /// What the heights before all cameras tell of a change of the season at the begin of a window.
    fn seasons(&self, at: usize, moved: &[Option<usize>]) -> Vec<[f64; 2]> {
        let of = |(camera, series): (usize, &Series)| {
            let end = moved[camera].unwrap_or(self.windows);
            if end <= at {
                return [0.0; 2];
            }
            let change = series.change(at, end);
            let own = change.information[(SEASON, SEASON)];
            // A camera knows its own public, which is not everybody.
            let share = 1.0 / (1.0 + own * LOCAL * LOCAL);
            [own * share, change.score[SEASON] * share]
        };
        self.heights.iter().enumerate().map(of).collect()
    }

    /// What heights tell of the movement of a camera.
    fn by_heights(&self, camera: usize, at: usize, end: usize, seasons: &[[f64; 2]]) -> NormalEquations {
        let others = seasons.iter().enumerate().filter(|(other, _)| *other != camera);
        let [information, score] =
            others.fold([SEASONAL.powi(-2), 0.0], |sum, (_, of)| [sum[0] + of[0], sum[1] + of[1]]);
        let precision = 1.0 / (1.0 / information + LOCAL * LOCAL);
        let some: [usize; FEATURES - 1] = [SEASON, MOVED, MOVED + 1, MOVED + 2];
        let change = self.heights[camera].change(at, end).of(&some);
        change.without_first(score / information, precision).placed(&SEEN, Movement::SIZE)
    }

    /// What the other cameras tell of the movement of a camera.
    fn by_others(&self, camera: usize, at: usize, end: usize, moved: &[Option<usize>]) -> NormalEquations {
        let mut sum = NormalEquations::nothing(Movement::SIZE);
        for (pair, series) in self.pairs.iter().filter(|(pair, _)| pair.contains(&camera)) {
            let [first, second] = *pair;
            let other = if first == camera { second } else { first };
            let end = end.min(moved[other].unwrap_or(self.windows));
            if end > at {
                let from = if first == camera { 0 } else { Movement::SIZE };
                let own: Vec<usize> = (from..from + Movement::SIZE).collect();
                sum.add(&series.change(at, end).of(&own));
            }
        }
        sum
    }

    /// Both, of a change at the begin of a window.
    fn of_camera(&self, camera: usize, at: usize, moved: &[Option<usize>]) -> [NormalEquations; 2] {
        let end = moved[camera].unwrap_or(self.windows);
        let seasons = self.seasons(at, moved);
        [self.by_heights(camera, at, end, &seasons), self.by_others(camera, at, end, moved)]
    }

    fn times(&self) -> std::ops::Range<usize> {
        WINDOWS..(self.windows + 1).saturating_sub(WINDOWS).max(WINDOWS)
    }

    /// The statistic of a camera at every time that a change may have been.
    pub(crate) fn statistics(&self, camera: usize, moved: &[Option<usize>]) -> Vec<(usize, f64)> {
        let held = held_movement();
        let of = |at: usize| {
            let [mut sum, others] = self.of_camera(camera, at, moved);
            sum.add(&others);
            (at, clearness(&sum, &held))
        };
        self.times().map(of).collect()
    }

    /// The likeliest change of a camera, whether it is one or not.
    pub(crate) fn likeliest(&self, camera: usize, moved: &[Option<usize>]) -> Option<Changed> {
        let held = held_movement();
        let all = self.statistics(camera, moved);
        let &(at, statistic) = all.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let open = || all.iter().filter(|(_, value)| value * value > statistic * statistic - NOT_RULED_OUT);
        let (earliest, latest) = (open().next()?.0, open().next_back()?.0);
        let [heights, others] = self.of_camera(camera, at, moved);
        let by = [&heights, &others].map(|part| clearness(part, &held));
        let mut sum = heights;
        sum.add(&others);
        let (movement, covariance) = sum.solved(&held)?;
        Some(Changed { at, earliest, latest, movement, covariance, statistic, by })
    }

    /// The smallest movements of each kind by itself that would be found, if they were where most can be seen.
    pub(crate) fn smallest(&self, camera: usize) -> [f64; Movement::SIZE] {
        let mut most = [0.0_f64; Movement::SIZE];
        let nobody = vec![None; self.heights.len()];
        for at in self.times().step_by(1 + self.windows / 16) {
            let [mut sum, others] = self.of_camera(camera, at, &nobody);
            sum.add(&others);
            (0..Movement::SIZE).for_each(|i| most[i] = most[i].max(sum.information[(i, i)]));
        }
        std::array::from_fn(|i| ALARM / (BY_PARAMETER[i] * most[i].sqrt()))
    }

    /// Every camera with its likeliest change, if that is one: the clearest first, and those that saw a person
    /// together with it are heard without it from then on.
    pub(crate) fn changes(&self) -> Vec<Option<Changed>> {
        let mut found: Vec<Option<Changed>> = vec![None; self.heights.len()];
        let mut moved = vec![None; self.heights.len()];
        loop {
            let open = (0..found.len()).filter(|&camera| found[camera].is_none());
            let candidates = open.filter_map(|camera| Some((camera, self.likeliest(camera, &moved)?)));
            let clearest = candidates.max_by(|a, b| a.1.statistic.total_cmp(&b.1.statistic));
            let Some((camera, change)) = clearest.filter(|(_, change)| change.statistic > ALARM) else {
                return found;
            };
            moved[camera] = Some(change.at);
            found[camera] = Some(change);
        }
    }
}

/// The statistic, the largest of these: as how many sigmas all parameters together are improbable, less than alone and by
/// their weight, and each by itself, by its own.
fn clearness(of: &NormalEquations, held: &DVector<f64>) -> f64 {
    let chi2 = of.chi2(held).map_or(0.0, |(chi2, freedom)| sigmas(chi2, freedom));
    let together = TOGETHER * (chi2 - CLEARER).max(0.0);
    let alone = |i: usize| {
        let variance = of.information[(i, i)];
        // What is hardly told of says nothing.
        if variance > held[i] { BY_PARAMETER[i] * of.score[i].abs() / variance.sqrt() } else { 0.0 }
    };
    (0..Movement::SIZE).map(alone).fold(together, f64::max)
}
