//! Detection of camera movements from detections of people: the entry point of the drift watch.
//!
//! The time of a change is estimated by the generalized likelihood ratio over all times of the change and all
//! movements (Willsky and Jones 1976).
//!
//! For a change at the start of window `t`, the evidence of all sources about the movement adds up to
//! `H m = g`. Without a movement, `g' H^-1 g` is a chi-square of up to four degrees of freedom. Most real
//! movements change one parameter. Therefore every parameter is also tested alone, a chi-square of one degree
//! of freedom. The statistic is the most significant of these tests, in standard deviations of a normal
//! variable and multiplied by a weight. Its maximum over `t` dates the change. The other cameras determine
//! whether heights changed with the season at the same time.
//!
//! Tilt and zoom make all people in an image taller or shorter, and so do families, groups and the time of
//! day. Their evidence therefore has a lower weight ([`PARAMETER_WEIGHTS`]) than that of a roll or a pan. A
//! roll makes people taller on one side of the image and shorter on the other. A pan is observed only
//! together with other cameras.

use calib_core::camera::{Camera, PanTiltZoom, Pixel, WorldPoint};
use calib_core::floor::Extent;
use calib_core::optimize::{chi2_score, two_sided_tail};
use nalgebra::{DMatrix, DVector};

use crate::moments::{Foot, hash};
use crate::normal_equations::NormalEquations;
use crate::pairs;
use crate::pairs::{Series, UNKNOWNS};
use crate::stature::{FEATURES, HEIGHT_PARAMS, MOVEMENT, SEASON, Sighting, Stature, features};
use crate::tracks::{Height, Row, Tracks};
use crate::windows::Windows;

/// Threshold of the statistic above which a camera counts as moved.
///
/// Changes are tested at all times and for many parameters, and heights of people are not normally distributed.
/// On 15 of 18,000 simulated camera days without a movement the statistic was larger. An ignored test of
/// `tests/watch.rs` repeats the count, by default on 6,000 camera days.
pub(crate) const ALARM: f64 = 4.8;
/// Weights of the evidence for pan, tilt, roll and zoom. Without weights, the 99.9 % quantiles on 6,000 of
/// the simulated camera days of [`ALARM`] were 3.4, 6.3, 4.1 and 6.6 standard deviations.
const PARAMETER_WEIGHTS: [f64; PanTiltZoom::SIZE] = [1.0, 0.7, 1.1, 0.7];
/// Weight of the joint evidence of all parameters: the smallest weight of a single parameter.
const JOINT_WEIGHT: f64 = 0.7;
/// Extra significance required of a movement of several parameters, in standard deviations. With few people,
/// some combination fits outliers by chance.
const JOINT_PENALTY: f64 = 1.5;
/// Largest difference between the maximum of the squared statistic and its value at a plausible time of the change.
const MAX_PLAUSIBLE_DROP: f64 = 8.0;
/// Standard deviation of the change of the mean log body height at a camera that did not move, because its
/// visitors change.
const LOCAL_HEIGHT_SIGMA: f64 = 0.003;
/// Prior standard deviation of the seasonal change of the mean log body height, which all cameras share.
const SEASONAL_HEIGHT_SIGMA: f64 = 0.02;
/// Minimum number of windows before and after a change.
const MIN_WINDOWS: usize = 2;

/// All sources of evidence of a site.
#[derive(Debug)]
pub(crate) struct Sources {
    /// Evidence of body heights, by camera.
    pub(crate) heights: Vec<Series>,
    /// Evidence of shared sightings, by pair of cameras.
    pub(crate) pairs: Vec<([usize; 2], Series)>,
    /// Number of windows.
    pub(crate) windows: usize,
}

/// Detected change of one camera.
#[derive(Clone, Debug)]
pub(crate) struct DetectedChange {
    /// Index of the first window after the change.
    pub(crate) at: usize,
    /// Smallest plausible value of `at`.
    pub(crate) earliest: usize,
    /// Largest plausible value of `at`.
    pub(crate) latest: usize,
    /// Estimated pan, tilt, roll and zoom.
    pub(crate) movement: DVector<f64>,
    /// Covariance of `movement`.
    pub(crate) covariance: DMatrix<f64>,
    /// Weighted significance of the change, in standard deviations.
    pub(crate) statistic: f64,
    /// Statistic of the evidence from heights alone, and of the evidence from the other cameras alone.
    pub(crate) significance_by_source: [f64; 2],
}

/// Returns the prior precisions (inverse variances) of the constant errors of heights, in the order of the
/// features: season, tilt, roll, zoom and padding.
pub(crate) fn height_prior_precisions() -> DVector<f64> {
    DVector::from_row_slice(&[0.3, 0.05, 0.05, 0.05, 0.3].map(|sigma: f64| sigma.powi(-2)))
}

/// Returns the prior precisions (inverse variances) of the constant errors of a pair of cameras.
pub(crate) fn pair_prior_precisions() -> DVector<f64> {
    DVector::from_element(UNKNOWNS, 0.05_f64.powi(-2))
}

/// Returns the prior precisions (inverse variances) of pan, tilt, roll and zoom. Movements beyond this prior
/// are obvious without a test.
fn movement_prior_precisions() -> DVector<f64> {
    DVector::from_element(PanTiltZoom::SIZE, 0.5_f64.powi(-2))
}

impl Sources {
    /// Returns the information and score of every camera about a seasonal change of heights at the start of
    /// window `at`. `moved` contains the first window after the change of each moved camera.
    fn seasons(&self, at: usize, moved: &[Option<usize>]) -> Vec<[f64; 2]> {
        let of = |(camera, series): (usize, &Series)| {
            let end = moved[camera].unwrap_or(self.windows);
            if end <= at {
                return [0.0; 2];
            }
            let change = series.change(at, end);
            let own = change.information[(SEASON, SEASON)];
            // The visitors of one camera differ from the visitors of the site.
            let share = 1.0 / (1.0 + own * LOCAL_HEIGHT_SIGMA * LOCAL_HEIGHT_SIGMA);
            [own * share, change.score[SEASON] * share]
        };
        self.heights.iter().enumerate().map(of).collect()
    }

    /// Returns the evidence of heights about a movement of a camera at the start of window `at`, from the
    /// windows before index `end`. `seasons` contains the information and score of every camera about the
    /// season.
    fn height_evidence(&self, camera: usize, at: usize, end: usize, seasons: &[[f64; 2]]) -> NormalEquations {
        let others = seasons.iter().enumerate().filter(|(other, _)| *other != camera);
        let [information, score] = others
            .fold([SEASONAL_HEIGHT_SIGMA.powi(-2), 0.0], |sum, (_, of)| [sum[0] + of[0], sum[1] + of[1]]);
        let precision = 1.0 / (1.0 / information + LOCAL_HEIGHT_SIGMA * LOCAL_HEIGHT_SIGMA);
        let some: [usize; FEATURES - 1] = [SEASON, MOVEMENT, MOVEMENT + 1, MOVEMENT + 2];
        let change = self.heights[camera].change(at, end).subset(&some);
        change.eliminate_first(score / information, precision).expanded(&HEIGHT_PARAMS, PanTiltZoom::SIZE)
    }

    /// Returns the evidence of the other cameras about a movement of a camera at the start of window `at`,
    /// from the windows before index `end`. Windows after the change of another camera are ignored.
    fn pair_evidence(
        &self,
        camera: usize,
        at: usize,
        end: usize,
        moved: &[Option<usize>],
    ) -> NormalEquations {
        let mut sum = NormalEquations::zeros(PanTiltZoom::SIZE);
        for (pair, series) in self.pairs.iter().filter(|(pair, _)| pair.contains(&camera)) {
            let [first, second] = *pair;
            let other = if first == camera { second } else { first };
            let end = end.min(moved[other].unwrap_or(self.windows));
            if end > at {
                let from = if first == camera { 0 } else { PanTiltZoom::SIZE };
                let own: Vec<usize> = (from..from + PanTiltZoom::SIZE).collect();
                sum.add(&series.change(at, end).subset(&own));
            }
        }
        sum
    }

    /// Returns the evidence of heights and of the other cameras about a movement at the start of window `at`.
    fn camera_evidence(&self, camera: usize, at: usize, moved: &[Option<usize>]) -> [NormalEquations; 2] {
        let end = moved[camera].unwrap_or(self.windows);
        let seasons = self.seasons(at, moved);
        [self.height_evidence(camera, at, end, &seasons), self.pair_evidence(camera, at, end, moved)]
    }

    /// Returns the indices of the windows at whose start a change is tested.
    fn times(&self) -> std::ops::Range<usize> {
        MIN_WINDOWS..(self.windows + 1).saturating_sub(MIN_WINDOWS).max(MIN_WINDOWS)
    }

    /// Returns the statistic of a change of a camera at every tested time. A time is the index of the first window
    /// after the change. `moved` contains this index for every camera with a known change.
    pub(crate) fn statistics(&self, camera: usize, moved: &[Option<usize>]) -> Vec<(usize, f64)> {
        let prior_precisions = movement_prior_precisions();
        let of = |at: usize| {
            let [mut sum, others] = self.camera_evidence(camera, at, moved);
            sum.add(&others);
            (at, significance(&sum, &prior_precisions))
        };
        self.times().map(of).collect()
    }

    /// Returns the most likely change of a camera, significant or not. Returns `None` if there are too few windows,
    /// or if the evidence gives no estimate of the movement.
    pub(crate) fn likeliest(&self, camera: usize, moved: &[Option<usize>]) -> Option<DetectedChange> {
        let prior_precisions = movement_prior_precisions();
        let all = self.statistics(camera, moved);
        let &(at, statistic) = all.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let plausible =
            || all.iter().filter(|(_, value)| value * value > statistic * statistic - MAX_PLAUSIBLE_DROP);
        let (earliest, latest) = (plausible().next()?.0, plausible().next_back()?.0);
        let [heights, others] = self.camera_evidence(camera, at, moved);
        let by = [&heights, &others].map(|part| significance(part, &prior_precisions));
        let mut sum = heights;
        sum.add(&others);
        let (movement, covariance) = sum.solve(&prior_precisions)?;
        Some(DetectedChange {
            at,
            earliest,
            latest,
            movement,
            covariance,
            statistic,
            significance_by_source: by,
        })
    }

    /// Returns the smallest detectable pan, tilt, roll and zoom of a camera, for a change at the most
    /// favourable time.
    pub(crate) fn smallest_detectable(&self, camera: usize) -> [f64; PanTiltZoom::SIZE] {
        let mut most = [0.0_f64; PanTiltZoom::SIZE];
        let nobody = vec![None; self.heights.len()];
        for at in self.times().step_by(1 + self.windows / 16) {
            let [mut sum, others] = self.camera_evidence(camera, at, &nobody);
            sum.add(&others);
            (0..PanTiltZoom::SIZE).for_each(|i| most[i] = most[i].max(sum.information[(i, i)]));
        }
        std::array::from_fn(|i| ALARM / (PARAMETER_WEIGHTS[i] * most[i].sqrt()))
    }

    /// Returns the significant change of every camera. Changes are accepted from the most significant to the
    /// least. Shared sightings with a moved camera are ignored from its change on.
    pub(crate) fn changes(&self) -> Vec<Option<DetectedChange>> {
        let mut found: Vec<Option<DetectedChange>> = vec![None; self.heights.len()];
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

/// Returns the statistic of the evidence about a movement, in standard deviations. It is the largest of the
/// weighted joint test, reduced by [`JOINT_PENALTY`], and the weighted tests of the single parameters.
fn significance(of: &NormalEquations, prior_precisions: &DVector<f64>) -> f64 {
    let chi2 = of.chi2(prior_precisions).map_or(0.0, |(chi2, freedom)| chi2_score(chi2, freedom).max(0.0));
    let together = JOINT_WEIGHT * (chi2 - JOINT_PENALTY).max(0.0);
    let alone = |i: usize| {
        let variance = of.information[(i, i)];
        // A poorly determined parameter is ignored.
        if variance > prior_precisions[i] {
            PARAMETER_WEIGHTS[i] * of.score[i].abs() / variance.sqrt()
        } else {
            0.0
        }
    };
    (0..PanTiltZoom::SIZE).map(alone).fold(together, f64::max)
}

/// Natural logarithm of a usual body height in metres: 1.70 m.
const USUAL_LOG_HEIGHT: f64 = 0.53;

/// Camera with the derivatives that the drift watch needs.
#[derive(Clone, Debug)]
struct WatchedCamera {
    camera: Camera,
    /// Width and height of the image, in pixels.
    size: [f64; 2],
    stature: Stature,
}

/// Accumulated evidence of all sightings.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Memory {
    windows: Windows,
    /// Open tracks, by camera.
    tracks: Vec<Tracks>,
    /// Median log height of people at every camera, relative to [`USUAL_LOG_HEIGHT`]. Detections far from the
    /// median are not adults on the floor.
    middle: Vec<f64>,
    /// Number of sightings.
    boxes: u64,
}

/// Drift watch: detection of movements of the cameras of a site from detections of people.
///
/// Memory is bounded. The sightings of each camera must be in order of time.
#[derive(Clone, Debug)]
pub struct Watch {
    cameras: Vec<WatchedCamera>,
    memory: Memory,
}

/// Status of a camera in the drift watch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DriftStatus {
    /// The camera has not moved.
    Unchanged,
    /// The camera moved.
    Moved,
    /// Too few people were seen for a result.
    CannotTell,
}

impl DriftStatus {
    /// Returns the name used in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unchanged => "unchanged",
            Self::Moved => "moved",
            Self::CannotTell => "cannot-tell",
        }
    }
}

/// Movement of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// Time of the movement, in nanoseconds since 1970.
    pub since: i64,
    /// Earliest and latest plausible time of the movement, in nanoseconds since 1970.
    pub between: [i64; 2],
    /// Estimated movement.
    pub movement: PanTiltZoom,
    /// Standard deviations of pan, tilt and roll, in radians, and of zoom (logarithm of the focal ratio);
    /// infinite for undetermined parameters.
    pub sigmas: [f64; PanTiltZoom::SIZE],
    /// Significance of the movement, in standard deviations of a normal variable. Tilt and zoom have a lower
    /// weight, because crowds have a similar effect.
    pub significance: f64,
    /// Probability that a camera that did not move causes this significance or a larger one.
    pub false_alarm: f64,
    /// Whether the significance of the heights of people alone exceeds [`Watch::ALARM`].
    pub is_seen_in_heights: bool,
    /// Whether the significance of the other cameras alone exceeds [`Watch::ALARM`].
    pub is_seen_by_others: bool,
}

/// Mean height of people in front of a camera in one window of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WindowHeight {
    /// Start and end of the window, in nanoseconds since 1970.
    pub span: [i64; 2],
    /// Mean of the natural logarithm of body heights, relative to the mean over all times.
    pub height: f64,
    /// Standard deviation of `height`.
    pub sigma: f64,
}

/// Result of the drift watch for one camera, with its evidence.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraHealth {
    /// Status of the camera: moved, unchanged or unknown.
    pub status: DriftStatus,
    /// Detected movement, if any.
    pub change: Option<Change>,
    /// Number of tracks of people.
    pub tracks: u64,
    /// Number of people that another camera saw at the same moment, among the sampled moments.
    pub matches: u64,
    /// Smallest detectable pan, tilt and roll, in radians, and zoom (logarithm of the focal ratio), each
    /// alone; infinite for undetermined parameters.
    pub smallest_detectable: [f64; PanTiltZoom::SIZE],
    /// Mean body height at the camera in every window of time.
    pub heights: Vec<WindowHeight>,
    /// Possible times of a change, in nanoseconds since 1970, each with the significance of a change, in
    /// standard deviations.
    pub statistics: Vec<(i64, f64)>,
}

impl Watch {
    /// Significance above which a camera counts as moved, in standard deviations of a normal variable.
    pub const ALARM: f64 = ALARM;

    /// Creates the watch of these cameras, each with the width and height of its image, in pixels.
    #[must_use]
    pub fn new(cameras: &[(Camera, [f64; 2])]) -> Self {
        let watched = |&(camera, size): &(Camera, [f64; 2])| WatchedCamera {
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

    /// Returns the accumulated evidence, to continue later.
    #[must_use]
    pub const fn memory(&self) -> &Memory {
        &self.memory
    }

    /// Continues with accumulated evidence; `None` if the evidence has another number of cameras.
    #[must_use]
    pub fn with_memory(self, memory: Memory) -> Option<Self> {
        let count = self.cameras.len();
        (memory.tracks.len() == count && memory.middle.len() == count).then_some(Self { memory, ..self })
    }

    /// Adds a sighting. Sightings of unknown cameras, and boxes cut by the image border, are not used as evidence.
    pub fn add_sighting(&mut self, sighting: &Sighting) {
        let Some(watched) = self.cameras.get(sighting.camera) else { return };
        let Memory { windows, tracks, middle, boxes } = &mut self.memory;
        *boxes += 1;
        if sighting.is_cut(watched.size) {
            return;
        }
        let mut is_on_floor = true;
        if let Some(head) = sighting.head {
            let height = watched.height(sighting, head, &mut middle[sighting.camera]);
            // The box of a person with an unusual height often does not end at the foot.
            is_on_floor = height.is_some_and(|height| height.is_usual());
            let foot = [sighting.foot.u, sighting.foot.v];
            let (person, middle) = (sighting.person, middle[sighting.camera]);
            let row = Row { at: sighting.at, person, foot, tall: sighting.box_height(), height, middle };
            tracks[sighting.camera].add(&row, |at, heights| {
                windows.at(at).heights[sighting.camera].add(&heights);
            });
        }
        if is_on_floor {
            self.add_to_moment(sighting);
        }
    }

    /// Adds the foot of a sighting to its moment, if the moment is sampled and another camera shows the floor
    /// position.
    fn add_to_moment(&mut self, sighting: &Sighting) {
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
            windows.at(at).moments.add(hash, foot);
        }
    }

    /// Returns the result of the drift watch for every camera.
    #[must_use]
    pub fn health(&self) -> Vec<CameraHealth> {
        let mut windows = self.memory.windows.clone();
        for (camera, tracks) in self.memory.tracks.iter().enumerate() {
            tracks.open_heights().for_each(|(at, heights)| windows.at(at).heights[camera].add(&heights));
        }
        let (sources, matches) = self.sources(&windows);
        let spans: Vec<[i64; 2]> = windows.iter().map(|(span, _)| span).collect();
        let changes = sources.changes();
        let moved: Vec<Option<usize>> = changes.iter().map(|c| c.as_ref().map(|c| c.at)).collect();
        let of = |(camera, change): (usize, &Option<DetectedChange>)| {
            let smallest = sources.smallest_detectable(camera);
            let tracks = windows.iter().map(|(_, window)| window.heights[camera].tracks).sum();
            let mut others = moved.clone();
            others[camera] = None;
            let statistics = sources.statistics(camera, &others);
            CameraHealth {
                status: drift_status(change.is_some(), &smallest),
                change: change.as_ref().map(|change| to_change(change, &spans, sources.windows)),
                tracks,
                matches: matches[camera],
                smallest_detectable: smallest,
                heights: window_heights(&windows, camera),
                statistics: statistics
                    .into_iter()
                    .map(|(at, value)| (boundary_time(&spans, at), value))
                    .collect(),
            }
        };
        changes.iter().enumerate().map(of).collect()
    }

    /// Returns all sources of evidence over the windows, and the number of matches of every camera.
    fn sources(&self, windows: &Windows) -> (Sources, Vec<u64>) {
        let cameras: Vec<Camera> = self.cameras.iter().map(|watched| watched.camera).collect();
        let count = windows.iter().count();
        let heights = |camera: usize| {
            let of = || windows.iter().map(|(_, window)| &window.heights[camera]);
            let variance = of().fold(DMatrix::zeros(FEATURES, FEATURES), |sum, one| sum + one.variance());
            let of: Vec<(NormalEquations, u64)> =
                of().map(|heights| (heights.equations(), heights.tracks)).collect();
            Series::new(&of, height_prior_precisions(), Some(variance))
        };
        let mut pairs = std::collections::BTreeMap::new();
        let mut matches = vec![0; cameras.len()];
        for (index, (_, window)) in windows.iter().enumerate() {
            for (pair, (equations, found)) in pairs::window_evidence(&cameras, &window.moments) {
                pair.iter().for_each(|&camera| matches[camera] += found);
                let nothing = || vec![(NormalEquations::zeros(UNKNOWNS), 0); count];
                pairs.entry(pair).or_insert_with(nothing)[index] = (equations, found);
            }
        }
        let pairs =
            pairs.into_iter().map(|(pair, of)| (pair, Series::new(&of, pair_prior_precisions(), None)));
        let sources = Sources {
            heights: (0..cameras.len()).map(heights).collect(),
            pairs: pairs.collect(),
            windows: count,
        };
        (sources, matches)
    }
}

impl WatchedCamera {
    /// Returns the log height of the detected person; `None` if the detection is not an adult. Updates the
    /// median log height `middle` of the camera.
    fn height(&self, of: &Sighting, head: Pixel, middle: &mut f64) -> Option<Height> {
        /// Step of the median estimate for each sighting, in log height (Robbins and Monro 1951).
        const STEP: f64 = 0.0005;
        let height = self.stature.log_height(of.foot, head)? - USUAL_LOG_HEIGHT;
        let usual = self.stature.reference_person(of.foot)?;
        *middle += STEP * (height - *middle).signum();
        Height::new(height, *middle, features(usual))
    }

    /// Whether the image shows a world point.
    fn shows(&self, point: WorldPoint) -> bool {
        let extent = Extent { size: self.size, efov: &[] };
        self.camera.world_to_pixel(point).is_some_and(|pixel| extent.shows(pixel))
    }
}

/// Returns the status of a camera. An unmoved camera is `Unchanged` only if a relevant tilt or zoom would
/// have been detected.
fn drift_status(moved: bool, smallest: &[f64; PanTiltZoom::SIZE]) -> DriftStatus {
    /// Smallest relevant tilt, in radians.
    const MIN_RELEVANT_TILT: f64 = 0.035;
    /// Smallest relevant zoom, as a fraction of the focal length.
    const MIN_RELEVANT_ZOOM: f64 = 0.06;
    let is_sensitive =
        smallest[PanTiltZoom::TILT] < MIN_RELEVANT_TILT && smallest[PanTiltZoom::ZOOM] < MIN_RELEVANT_ZOOM;
    match (moved, is_sensitive) {
        (true, _) => DriftStatus::Moved,
        (false, true) => DriftStatus::Unchanged,
        (false, false) => DriftStatus::CannotTell,
    }
}

/// Returns the middle of the gap between window `at` and the previous window, in nanoseconds since 1970.
fn boundary_time(spans: &[[i64; 2]], at: usize) -> i64 {
    let before = spans[at - 1][1];
    before + (spans[at][0] - before) / 2
}

/// Converts a detected change from window indices to times. `spans` are the start and end of every window, and
/// `windows` is the number of windows. Undetermined parameters are zero.
fn to_change(change: &DetectedChange, spans: &[[i64; 2]], windows: usize) -> Change {
    let variance = |i: usize| change.covariance[(i, i)];
    // A parameter whose variance is close to its prior variance is undetermined.
    let sigmas = std::array::from_fn(|i| if variance(i) < 0.04 { variance(i).sqrt() } else { f64::INFINITY });
    let parameters = std::array::from_fn(|i| if sigmas[i].is_finite() { change.movement[i] } else { 0.0 });
    Change {
        since: boundary_time(spans, change.at),
        between: [spans[change.earliest - 1][0], spans[change.latest][1]],
        movement: PanTiltZoom::from_parameters(parameters),
        sigmas,
        significance: change.statistic,
        // Every parameter alone and all together are tested at every time.
        false_alarm: (two_sided_tail(change.statistic) * (windows * (PanTiltZoom::SIZE + 1)) as f64).min(1.0),
        is_seen_in_heights: change.significance_by_source[0] > ALARM,
        is_seen_by_others: change.significance_by_source[1] > ALARM,
    }
}

/// Returns the mean log heights of people at a camera, window by window, relative to the mean over all
/// windows.
fn window_heights(windows: &Windows, camera: usize) -> Vec<WindowHeight> {
    let of = |window: &crate::windows::Window| {
        let equations = window.heights[camera].equations();
        [equations.information[(SEASON, SEASON)], equations.score[SEASON]]
    };
    let all = windows.iter().map(|(_, window)| of(window));
    let [information, score] = all.fold([0.0; 2], |sum, one| [sum[0] + one[0], sum[1] + one[1]]);
    let then = |(span, window)| {
        let [own, score_then] = of(window);
        let height = score_then / own - score / information;
        (own > 0.0).then(|| WindowHeight { span, height, sigma: own.sqrt().recip() })
    };
    windows.iter().filter_map(then).collect()
}
