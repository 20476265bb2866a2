//! The front door of the watch: people as cameras see them go in, what became of the cameras comes out.

use nalgebra::DMatrix;

use crate::change::{ALARM, Changed, Sources, held_heights, held_pairs};
use crate::heights::{FEATURES, SEASON, features};
use crate::moments::{Foot, hash};
use crate::normal_equations::NormalEquations;
use crate::pairs;
use crate::series::Series;
use crate::sighting::Sighting;
use crate::stature::Stature;
use crate::tracks::{Height, Row, Tracks};
use crate::windows::Windows;
use calib_core::camera::Movement;
use calib_core::camera::{Camera, Pixel, WorldPoint};
use calib_core::floor::Extent;
use calib_core::optimize::exceeded;

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
                let nothing = || vec![(NormalEquations::nothing(pairs::UNKNOWNS), 0); count];
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
        false_alarm: (exceeded(change.statistic) * (windows * (Movement::SIZE + 1)) as f64).min(1.0),
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
