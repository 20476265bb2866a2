//! The front door of the watch: people as cameras see them go in, what became of the cameras comes out.
//!
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

use calib_core::camera::{Camera, Movement, Pixel, WorldPoint};
use calib_core::floor::Extent;
use calib_core::optimize::{chi2_score, two_sided_tail};
use nalgebra::{DMatrix, DVector};

use crate::moments::{Foot, hash};
use crate::normal_equations::NormalEquations;
use crate::pairs;
use crate::pairs::{Series, UNKNOWNS};
use crate::stature::{FEATURES, MOVED, SEASON, SEEN, Sighting, Stature, features};
use crate::tracks::{Height, Row, Tracks};
use crate::windows::Windows;

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
    let chi2 = of.chi2(held).map_or(0.0, |(chi2, freedom)| chi2_score(chi2, freedom).max(0.0));
    let together = TOGETHER * (chi2 - CLEARER).max(0.0);
    let alone = |i: usize| {
        let variance = of.information[(i, i)];
        // What is hardly told of says nothing.
        if variance > held[i] { BY_PARAMETER[i] * of.score[i].abs() / variance.sqrt() } else { 0.0 }
    };
    (0..Movement::SIZE).map(alone).fold(together, f64::max)
}

/// Logarithm of the height in metres that heights are counted from.
const USUAL: f64 = 0.53;

/// A camera that is watched.
#[derive(Clone, Debug)]
struct Watched {
    camera: Camera,
    size: [f64; 2],
    stature: Stature,
}

/// What is remembered of all that was seen.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Memory {
    windows: Windows,
    tracks: Vec<Tracks>,
    /// Of every camera, the logarithm of the height of people before it, over [`USUAL`]: what is far from it is no
    /// adult on the floor.
    middle: Vec<f64>,
    boxes: u64,
}

/// Watches the cameras of a site by the people that they see.
///
/// Memory does not grow with what is seen. People are seen in order of time, camera by camera at least.
#[derive(Clone, Debug)]
pub struct Watch {
    cameras: Vec<Watched>,
    memory: Memory,
}

/// What is to be said of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It stands as it stood.
    Unchanged,
    /// It moved.
    Moved,
    /// Too few people were seen to tell.
    CannotTell,
}

impl Verdict {
    /// Its name in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unchanged => "unchanged",
            Self::Moved => "moved",
            Self::CannotTell => "cannot-tell",
        }
    }
}

/// A camera that moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// Nanoseconds since 1970.
    pub since: i64,
    /// Not before, and not after.
    pub between: [i64; 2],
    /// By how much.
    pub movement: Movement,
    /// Standard deviations of the parameters, in their order; infinite where nothing tells one.
    pub sigmas: [f64; Movement::SIZE],
    /// How clear it is: as the sigmas of a normal number; those of a tilt and a zoom, which crowds look like, count less.
    pub sigmas_clear: f64,
    /// How often a camera that stands still would be taken for moved by as much evidence.
    pub false_alarm: f64,
    /// Whether people's heights tell of it by themselves.
    pub by_heights: bool,
    /// Whether other cameras do.
    pub by_others: bool,
}

/// Heights before a camera in one window of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeightThen {
    /// Begin and end, in nanoseconds since 1970.
    pub span: [i64; 2],
    /// The logarithm of heights, over their mean of all times.
    pub height: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

/// What the watch found of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraHealth {
    /// What is to be said.
    pub verdict: Verdict,
    /// What moved it, if it did.
    pub change: Option<Change>,
    /// People that were seen: tracks.
    pub tracks: u64,
    /// People that another camera saw at the same moments, in those that were looked at.
    pub matches: u64,
    /// The smallest pan, tilt, roll and zoom by itself that would have been found; infinite where nothing tells one.
    pub smallest: [f64; Movement::SIZE],
    /// Heights over time.
    pub heights: Vec<HeightThen>,
    /// How clear a change at every time is that it may have been, in nanoseconds since 1970.
    pub statistics: Vec<(i64, f64)>,
}

impl Watch {
    /// How clear a change must be to count.
    pub const ALARM: f64 = ALARM;

    /// Watches cameras with images of these widths and heights.
    #[must_use]
    pub fn new(cameras: &[(Camera, [f64; 2])]) -> Self {
        let watched = |&(camera, size): &(Camera, [f64; 2])| Watched {
            camera,
            size,
            stature: Stature::new(&camera, size),
        };
        let count = cameras.len();
        let memory = Memory {
            windows: Windows::new(count),
            tracks: vec![Tracks::default(); count],
            middle: vec![0.0; count],
            boxes: 0,
        };
        Self { cameras: cameras.iter().map(watched).collect(), memory }
    }

    /// What is remembered, to go on with another time.
    #[must_use]
    pub const fn memory(&self) -> &Memory {
        &self.memory
    }

    /// Goes on with what was remembered; `None` where that is of other cameras.
    #[must_use]
    pub fn with_memory(self, memory: Memory) -> Option<Self> {
        let count = self.cameras.len();
        (memory.tracks.len() == count && memory.middle.len() == count).then_some(Self { memory, ..self })
    }

    /// Takes what a camera saw; a camera that is not watched is not heard.
    pub fn see(&mut self, sighting: &Sighting) {
        let Some(watched) = self.cameras.get(sighting.camera) else { return };
        let Memory { windows, tracks, middle, boxes } = &mut self.memory;
        *boxes += 1;
        if sighting.is_cut(watched.size) {
            return;
        }
        let mut is_on_floor = true;
        if let Some(head) = sighting.head {
            let height = watched.height(sighting, head, &mut middle[sighting.camera]);
            // Whose height is odd stands elsewhere than the box ends, often.
            is_on_floor = height.is_some_and(|height| height.is_usual());
            let foot = [sighting.foot.u, sighting.foot.v];
            let (person, middle) = (sighting.person, middle[sighting.camera]);
            let row = Row { at: sighting.at, person, foot, tall: sighting.tall(), height, middle };
            tracks[sighting.camera].see(&row, |at, heights| {
                windows.at(at).heights[sighting.camera].add(&heights);
            });
        }
        if is_on_floor {
            self.see_moment(sighting);
        }
    }

    /// Keeps the foot, if its moment is one of those that are kept and another camera sees the place.
    fn see_moment(&mut self, sighting: &Sighting) {
        let hash = hash(sighting.at);
        let windows = &mut self.memory.windows;
        if !windows.find(sighting.at).is_none_or(|window| window.moments.keeps(hash)) {
            return;
        }
        let own = &self.cameras[sighting.camera].camera;
        let Some(floor) = own.pixel_to_floor(sighting.foot, 0.0) else { return };
        let others = self.cameras.iter().enumerate().filter(|(index, _)| *index != sighting.camera);
        if others.into_iter().any(|(_, other)| other.shows(floor.at_height(0.0))) {
            let Sighting { camera, at, foot: pixel, .. } = *sighting;
            let foot = Foot { camera, at, pixel, sigma: sighting.foot_sigma() };
            windows.at(at).moments.see(hash, foot);
        }
    }

    /// What became of every camera.
    #[must_use]
    pub fn health(&self) -> Vec<CameraHealth> {
        let mut windows = self.memory.windows.clone();
        for (camera, tracks) in self.memory.tracks.iter().enumerate() {
            tracks.open().for_each(|(at, heights)| windows.at(at).heights[camera].add(&heights));
        }
        let (sources, matches) = self.sources(&windows);
        let spans: Vec<[i64; 2]> = windows.iter().map(|(span, _)| span).collect();
        let changes = sources.changes();
        let moved: Vec<Option<usize>> = changes.iter().map(|c| c.as_ref().map(|c| c.at)).collect();
        let of = |(camera, change): (usize, &Option<Changed>)| {
            let smallest = sources.smallest(camera);
            let tracks = windows.iter().map(|(_, window)| window.heights[camera].tracks).sum();
            let mut others = moved.clone();
            others[camera] = None;
            let statistics = sources.statistics(camera, &others);
            CameraHealth {
                verdict: verdict(change.is_some(), &smallest),
                change: change.as_ref().map(|change| dated(change, &spans, sources.windows)),
                tracks,
                matches: matches[camera],
                smallest,
                heights: heights(&windows, camera),
                statistics: statistics.into_iter().map(|(at, value)| (border(&spans, at), value)).collect(),
            }
        };
        changes.iter().enumerate().map(of).collect()
    }

    /// All evidence, window by window, and the matches of every camera.
    fn sources(&self, windows: &Windows) -> (Sources, Vec<u64>) {
        let cameras: Vec<Camera> = self.cameras.iter().map(|watched| watched.camera).collect();
        let count = windows.iter().count();
        let heights = |camera: usize| {
            let of = || windows.iter().map(|(_, window)| &window.heights[camera]);
            let variance = of().fold(DMatrix::zeros(FEATURES, FEATURES), |sum, one| sum + one.variance());
            let of: Vec<(NormalEquations, u64)> =
                of().map(|heights| (heights.equations(), heights.tracks)).collect();
            Series::new(&of, held_heights(), Some(variance))
        };
        let mut pairs = std::collections::BTreeMap::new();
        let mut matches = vec![0; cameras.len()];
        for (index, (_, window)) in windows.iter().enumerate() {
            for (pair, (equations, found)) in pairs::of_window(&cameras, &window.moments) {
                pair.iter().for_each(|&camera| matches[camera] += found);
                let nothing = || vec![(NormalEquations::nothing(UNKNOWNS), 0); count];
                pairs.entry(pair).or_insert_with(nothing)[index] = (equations, found);
            }
        }
        let pairs = pairs.into_iter().map(|(pair, of)| (pair, Series::new(&of, held_pairs(), None)));
        let sources = Sources {
            heights: (0..cameras.len()).map(heights).collect(),
            pairs: pairs.collect(),
            windows: count,
        };
        (sources, matches)
    }
}

impl Watched {
    /// The height of who is in a box; `None` where it is no adult's.
    fn height(&self, of: &Sighting, head: Pixel, middle: &mut f64) -> Option<Height> {
        /// How fast the middle follows: it is the median of all (Robbins and Monro 1951).
        const STEP: f64 = 0.0005;
        let height = self.stature.log_height(of.foot, head)? - USUAL;
        let usual = self.stature.usual(of.foot)?;
        *middle += STEP * (height - *middle).signum();
        Height::new(height, *middle, features(usual))
    }

    fn shows(&self, point: WorldPoint) -> bool {
        let extent = Extent { size: self.size, efov: &[] };
        self.camera.world_to_pixel(point).is_some_and(|pixel| extent.shows(pixel))
    }
}

/// A camera that stands still is said to do so only if a tilt or zoom that matters would have been found.
fn verdict(moved: bool, smallest: &[f64; Movement::SIZE]) -> Verdict {
    /// Radians, and of the focal.
    const TILT: f64 = 0.035;
    const ZOOM: f64 = 0.06;
    let tells = smallest[Movement::TILT] < TILT && smallest[Movement::ZOOM] < ZOOM;
    match (moved, tells) {
        (true, _) => Verdict::Moved,
        (false, true) => Verdict::Unchanged,
        (false, false) => Verdict::CannotTell,
    }
}

/// The time between a window and the one before it.
fn border(spans: &[[i64; 2]], at: usize) -> i64 {
    let before = spans[at - 1][1];
    before + (spans[at][0] - before) / 2
}

fn dated(change: &Changed, spans: &[[i64; 2]], windows: usize) -> Change {
    let variance = |i: usize| change.covariance[(i, i)];
    // What evidence hardly makes surer than a guess is not known.
    let sigmas = std::array::from_fn(|i| if variance(i) < 0.04 { variance(i).sqrt() } else { f64::INFINITY });
    let parameters = std::array::from_fn(|i| if sigmas[i].is_finite() { change.movement[i] } else { 0.0 });
    Change {
        since: border(spans, change.at),
        between: [spans[change.earliest - 1][0], spans[change.latest][1]],
        movement: Movement::of(parameters),
        sigmas,
        sigmas_clear: change.statistic,
        // Every parameter by itself and all together are tried at every time.
        false_alarm: (two_sided_tail(change.statistic) * (windows * (Movement::SIZE + 1)) as f64).min(1.0),
        by_heights: change.by[0] > ALARM,
        by_others: change.by[1] > ALARM,
    }
}

/// Heights before a camera, window by window, over their mean.
fn heights(windows: &Windows, camera: usize) -> Vec<HeightThen> {
    let of = |window: &crate::windows::Window| {
        let equations = window.heights[camera].equations();
        [equations.information[(SEASON, SEASON)], equations.score[SEASON]]
    };
    let all = windows.iter().map(|(_, window)| of(window));
    let [information, score] = all.fold([0.0; 2], |sum, one| [sum[0] + one[0], sum[1] + one[1]]);
    let then = |(span, window)| {
        let [own, score_then] = of(window);
        let height = score_then / own - score / information;
        (own > 0.0).then(|| HeightThen { span, height, sigma: own.sqrt().recip() })
    };
    windows.iter().filter_map(then).collect()
}
