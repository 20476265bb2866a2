//! Comparison of a new image with the calibrated image of a camera, and the detected change of the
//! camera.

use std::cell::OnceCell;
use std::fmt;

use calib_core::{Camera, Covariance, Pixel};

use calib_core::camera::{PanTiltZoom, RotationZoom};

use calib_site::SiteCamera;

use crate::FitParameters;
use image::RgbImage;
use serde::{Deserialize, Serialize};

use crate::compare::alignment::{Alignment, chance_fraction};
use crate::compare::coarse::{CornerMatch, coarse_rotation, corners};
use crate::compare::edge_sample::{EdgeSample, edge_samples};
use crate::compare::feature::{Feature, Luma, SMOOTHING_PX, features};
use crate::compare::step_test::StepAlignment;
use crate::compare::window::{FoundWindow, ShownWindow, disagreement, find_window};
use crate::edges::{Edge, detect};

/// Smallest z-score of a rotation or zoom that counts as a change. A camera that did not move is reported as
/// moved in at most one of some hundred images.
const MIN_Z_SCORE: f64 = 3.0;
/// Smallest displacement of the image by a rotation or zoom that counts as a change, RMS in pixels. Codecs
/// and thermal drift of lenses cause smaller displacements.
const MIN_SHIFT_PX: f64 = 0.05;

/// Variance of an unknown value; finite, because files store finite numbers.
const UNKNOWN_VARIANCE: f64 = f64::MAX;

/// Detected change of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum CameraChange {
    /// No change.
    Unchanged,
    /// Rotated or zoomed at the same position.
    Moved,
    /// Not moved: the new image shows a window of the old one (digital zoom, crop or another resolution).
    Windowed,
    /// Moved to another position: near and far edges do not fit one rotation.
    Shifted,
    /// Different image content: another camera, another view, or an obstruction.
    DifferentView,
    /// New image too dark.
    TooDark,
    /// New image almost without edges: lens covered, or out of focus.
    Blind,
    /// Old image with too few edges.
    TooFewEdges,
}

impl CameraChange {
    /// Returns the name of the change in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unchanged => "unchanged",
            Self::Moved | Self::Windowed | Self::Shifted => "moved",
            Self::DifferentView => "replaced",
            Self::TooDark | Self::Blind | Self::TooFewEdges => "cannot-tell",
        }
    }

    /// Whether pixels of the old image can be mapped to the new image.
    #[must_use]
    pub const fn is_aligned(self) -> bool {
        matches!(self, Self::Unchanged | Self::Moved | Self::Windowed | Self::Shifted)
    }
}

impl fmt::Display for CameraChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Unchanged => "the camera is unchanged",
            Self::Moved => "the camera rotated or zoomed",
            Self::Windowed => {
                "the new image shows a part of the old one: digital zoom, crop or another resolution"
            }
            Self::Shifted => "the camera was moved to another position",
            Self::DifferentView => {
                "the new image shows something else: another camera, another view, or an obstruction"
            }
            Self::TooDark => "the new image is too dark to compare",
            Self::Blind => "the new image has almost no edges: the lens is covered or out of focus",
            Self::TooFewEdges => "the old image has too few edges to compare",
        })
    }
}

/// Error for an old and a new image of different sizes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SizeMismatchError {
    /// Width and height of the old image, in pixels.
    pub old: [u32; 2],
    /// Width and height of the new image, in pixels.
    pub new: [u32; 2],
}

impl fmt::Display for SizeMismatchError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([ow, oh], [nw, nh]) = (self.old, self.new);
        write!(
            f,
            "the new image has {nw} x {nh} pixels, but the calibrated image has {ow} x {oh}; take an image of \
             {ow} x {oh} pixels from the same stream"
        )
    }
}

impl std::error::Error for SizeMismatchError {}

/// Reason why a camera cannot be compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ComparisonError {
    /// Camera without a solution.
    NotCalibrated,
    /// Old and new image of different sizes.
    SizeMismatch(SizeMismatchError),
}

impl fmt::Display for ComparisonError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotCalibrated => f.write_str("the camera is not calibrated; calibrate it first"),
            Self::SizeMismatch(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for ComparisonError {}

/// Returns the annotated lines of a camera as edges, in raw pixels; disabled annotations are ignored.
#[must_use]
pub fn annotation_edges(entry: &SiteCamera) -> Vec<Edge> {
    let lines = entry.annotations.iter().filter(|annotation| !annotation.off).flat_map(|a| a.polylines());
    lines.flat_map(|line| line.windows(2).map(|pair| [pair[0], pair[1]]).collect::<Vec<Edge>>()).collect()
}

/// Result of comparing two images of one camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// Detected change of the camera.
    pub change: CameraChange,
    /// Rotation and zoom of the camera from the old to the new image; zero if the images could not be
    /// aligned.
    pub rotation: RotationZoom,
    /// Covariance of the rotation vector, in radians, and the zoom (logarithm of the focal ratio).
    pub covariance: [[f64; RotationZoom::SIZE]; RotationZoom::SIZE],
    /// Covariance under the assumption that only the shifts of edges and of image blocks are common to several
    /// samples. It is an approximate lower bound for any estimate from these edges.
    pub bound: [[f64; RotationZoom::SIZE]; RotationZoom::SIZE],
    /// Significance of the rotation and zoom, as a z-score.
    pub z_score: f64,
    /// Displacement of the image by the rotation and zoom, RMS over the edge samples, in pixels.
    pub shift: f64,
    /// Number of edge samples visible in the new image.
    pub visible_samples: usize,
    /// Fraction of the visible samples that were found again.
    pub found_fraction: f64,
    /// Window of the old image that the new image shows, if the camera changed in this way.
    #[serde(default)]
    pub window: Option<ShownWindow>,
    /// Fraction of the visible samples that are found by chance, under wrong rotations.
    pub chance_fraction: f64,
    /// Positions of the edge samples in the old image, each with its result: whether the edge is at its
    /// predicted position; `None` outside the new image.
    pub samples: Vec<(Pixel, Option<bool>)>,
}

impl Comparison {
    /// Compares a new image with the calibrated image `old` of a camera. Edges of the old image are detected;
    /// the annotated edges in `drawn` take precedence.
    ///
    /// # Errors
    /// Returns an error if the images differ in size, and the new image is no window of the old one.
    pub fn new(
        camera: &Camera,
        drawn: &[Edge],
        old: &RgbImage,
        new: &RgbImage,
    ) -> Result<Self, SizeMismatchError> {
        let size = |image: &RgbImage| [image.width(), image.height()];
        let [before, after] = [old, new].map(Luma::new);
        if size(old) != size(new) {
            let mismatch = SizeMismatchError { old: size(old), new: size(new) };
            let upright = features(&before, &[0.0]);
            let found = find_window(&before, &upright, &after).ok_or(mismatch)?;
            return Ok(Self::windowed(&found, size(new), Vec::new()));
        }
        let [fine, later] = [&before, &after].map(|luma| luma.smoothed(SMOOTHING_PX));
        let edges: Vec<Edge> = drawn.iter().copied().chain(detect(old)).collect();
        let places = edge_samples(camera, &fine, &edges);
        let (upright, corners) = (OnceCell::new(), OnceCell::new());
        let pair = ImagePair { camera, before, after, later, places, upright, corners };
        let moved = pair.compare(new);
        Ok(pair.window(&moved, size(new)).unwrap_or(moved))
    }

    /// Compares a new image with the calibrated image `old` of a camera of a site. The annotated lines of the
    /// camera take precedence over detected edges.
    ///
    /// # Errors
    /// Returns an error if the camera is not calibrated. Returns an error if the images differ in size, and the
    /// new image is no window of the old one.
    pub fn from_entry(entry: &SiteCamera, old: &RgbImage, new: &RgbImage) -> Result<Self, ComparisonError> {
        let camera = entry.camera().ok_or(ComparisonError::NotCalibrated)?;
        Self::new(&camera, &annotation_edges(entry), old, new).map_err(ComparisonError::SizeMismatch)
    }

    /// Returns the map from pixels of the old image to pixels of the new image. The map returns
    /// `None` for rays behind the rotated camera or outside the lens; a result may be outside the
    /// new image.
    pub fn pixel_map(&self, camera: &Camera) -> impl Fn(Pixel) -> Option<Pixel> + use<> {
        let (turned, window) = (self.rotation.for_camera(camera), self.window);
        move |at| window.map_or_else(|| turned.map_pixel(at), |window| Some(window.map.pixel(at)))
    }

    /// Returns the changes of yaw, pitch and roll, in radians, and of the log focal length, each with its
    /// standard deviation.
    ///
    /// Edges measure the rotation in pixels. The uncertainty of the focal length therefore increases the
    /// uncertainty of pan and tilt.
    #[must_use]
    pub fn movement(&self, camera: &Camera) -> [(f64, f64); PanTiltZoom::SIZE] {
        /// Step of the finite differences, in radians or as the log of the focal ratio.
        const DIFFERENCE_STEP: f64 = 1e-6;
        let of = |turn: &RotationZoom| {
            let PanTiltZoom { pan, tilt, roll, zoom } = turn.pan_tilt_zoom(camera);
            [pan, tilt, roll, zoom]
        };
        let here = of(&self.rotation);
        let slope = |turn: &RotationZoom, i: usize| (of(turn)[i] - here[i]) / DIFFERENCE_STEP;
        let perturbed: [RotationZoom; RotationZoom::SIZE] = std::array::from_fn(|k| {
            let mut step = [0.0; RotationZoom::SIZE];
            step[k] = DIFFERENCE_STEP;
            self.rotation.followed_by(&RotationZoom::from_parameters(step))
        });
        let [x, y, z] = self.rotation.vector;
        let larger = RotationZoom {
            vector: [x * (1.0 + DIFFERENCE_STEP), y * (1.0 + DIFFERENCE_STEP), z],
            ..self.rotation
        };
        std::array::from_fn(|i| {
            let slopes = perturbed.map(|turn| slope(&turn, i));
            let variance = self.variance(slopes) + (slope(&larger, i) * focal_sigma(camera)).powi(2);
            (here[i], variance.sqrt())
        })
    }

    /// Returns the variance of a quantity with these derivatives with respect to rotation and zoom.
    fn variance(&self, slopes: [f64; RotationZoom::SIZE]) -> f64 {
        let row = |j: usize| (0..RotationZoom::SIZE).map(|k| self.covariance[j][k] * slopes[k]).sum::<f64>();
        (0..RotationZoom::SIZE).map(|j| slopes[j] * row(j)).sum::<f64>().max(0.0)
    }

    /// Returns the rotation angle and its standard deviation, in radians. Without a rotation, the standard
    /// deviation is the root mean square over all axes.
    #[must_use]
    pub fn angle(&self, camera: &Camera) -> (f64, f64) {
        let angle = self.rotation.angle();
        if angle < 1e-9 {
            let mean = (0..3).map(|k| self.covariance[k][k]).sum::<f64>() / 3.0;
            return (angle, mean.sqrt());
        }
        let [x, y, z] = self.rotation.vector.map(|part| part / angle);
        let of_focal = angle * (x * x + y * y) * focal_sigma(camera);
        (angle, (self.variance([x, y, z, 0.0]) + of_focal.powi(2)).sqrt())
    }

    /// Returns the result for an image that shows a window of the old image.
    fn windowed(found: &FoundWindow, size: [u32; 2], samples: Vec<(Pixel, Option<bool>)>) -> Self {
        let mut covariance = [[0.0; RotationZoom::SIZE]; RotationZoom::SIZE];
        covariance[3][3] = found.sigma * found.sigma;
        Self {
            change: CameraChange::Windowed,
            rotation: RotationZoom { zoom: found.map.scale[0].ln(), ..RotationZoom::default() },
            covariance,
            bound: covariance,
            z_score: (found.map.scale[0].ln() / found.sigma.max(1e-9)).abs().min(1e9),
            shift: 0.0,
            visible_samples: samples.iter().filter(|(_, found)| found.is_some()).count(),
            found_fraction: found.share,
            window: Some(ShownWindow { map: found.map, size }),
            chance_fraction: 0.0,
            samples,
        }
    }

    /// Returns the ratio of the new to the old focal length, and its standard deviation.
    #[must_use]
    pub fn zoom(&self) -> (f64, f64) {
        let ratio = self.rotation.zoom.exp();
        (ratio, ratio * self.covariance[3][3].max(0.0).sqrt())
    }
}

/// Returns the relative standard deviation of the focal length of a camera.
fn focal_sigma(camera: &Camera) -> f64 {
    camera.covariance.sigma(Covariance::FOCAL).map_or(0.0, |sigma| sigma / camera.focal)
}

/// Two images prepared for comparison.
struct ImagePair<'a> {
    camera: &'a Camera,
    /// Log brightness of the old image.
    before: Luma,
    /// Log brightness of the new image.
    after: Luma,
    /// Smoothed log brightness of the new image.
    later: Luma,
    /// Edge samples of the old image.
    places: Vec<EdgeSample>,
    /// Corners of the old image, computed on first use.
    upright: OnceCell<Vec<Feature>>,
    /// Corners matched between both images, computed on first use.
    corners: OnceCell<Vec<CornerMatch>>,
}

impl ImagePair<'_> {
    /// Compares the prepared images; `new` is the new image.
    fn compare(&self, new: &RgbImage) -> Comparison {
        /// Smallest number of edge samples for a comparison.
        const MIN_SAMPLES: usize = 60;
        /// Mean brightness below which an image is always too dark, 0 to 255. Differences of single grey
        /// levels then shift edges.
        const MIN_MEAN_BRIGHTNESS: f64 = 8.0;
        if self.places.len() < MIN_SAMPLES {
            return self.unaligned(CameraChange::TooFewEdges, 0.0);
        }
        if mean(new) < MIN_MEAN_BRIGHTNESS {
            return self.unaligned(CameraChange::TooDark, 0.0);
        }
        let Some(found) = self.alignment() else { return self.unaligned(self.unaligned_reason(new), 0.0) };
        let chance = chance_fraction(self.camera, &self.later, &self.places, &found.motion.turn);
        if !self.is_found(&found, chance) {
            return Comparison {
                found_fraction: found.found_fraction(),
                ..self.unaligned(self.unaligned_reason(new), chance)
            };
        }
        self.evaluate(&found, chance)
    }

    /// Returns the better of two alignments: started without a rotation, and from the rotation estimated from
    /// corners. Returns `None` if both fail.
    fn alignment(&self) -> Option<Alignment> {
        /// Fraction of samples found again above which no second alignment is tried. In repetitive scenes an
        /// alignment that is off by one period finds about half of the samples.
        const SUFFICIENT_FRACTION: f64 = 0.8;
        let from = |turn: RotationZoom, reaches: &[usize]| {
            let of = FitParameters::RotationAndTone;
            Alignment::new(self.camera, &self.later, &self.places, turn.into(), of, reaches)
        };
        let unmoved = from(RotationZoom::default(), &[5, 3, 2, 2]);
        if unmoved.as_ref().is_some_and(|found| found.found_fraction() > SUFFICIENT_FRACTION) {
            return unmoved;
        }
        let rotation = coarse_rotation(self.camera, self.corners());
        let rotated = rotation.and_then(|turn| from(turn, &[10, 5, 3, 2, 2]));
        let both = [unmoved, rotated].into_iter().flatten();
        both.max_by_key(|found| found.coverage(&self.places))
    }

    /// Whether clearly more samples are found than by chance, in enough parts of the image. `chance` is the
    /// fraction found by chance.
    fn is_found(&self, found: &Alignment, chance: f64) -> bool {
        /// Smallest coverage: the number of inliers, limited for each block of the image.
        const MIN_COVERAGE: usize = 36;
        /// Smallest ratio of the found fraction to the fraction found by chance.
        const MIN_CHANCE_RATIO: f64 = 2.0;
        /// Smallest fraction of the visible samples that must be found.
        const MIN_FOUND_FRACTION: f64 = 0.1;
        found.found_fraction() > (MIN_CHANCE_RATIO * chance).max(MIN_FOUND_FRACTION)
            && found.coverage(&self.places) >= MIN_COVERAGE
    }

    /// Returns the result of a successful alignment; `chance` is the fraction of samples found by chance.
    fn evaluate(&self, found: &Alignment, chance: f64) -> Comparison {
        let [covariance, bound] = [&found.fit.covariance, &found.fit.bound]
            .map(|matrix| std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)])));
        let z_score = self.z_score(found);
        let shift = self.shift(&found.motion.turn);
        let change = match (z_score > MIN_Z_SCORE && shift > MIN_SHIFT_PX, self.is_shifted(found, chance)) {
            (_, true) => CameraChange::Shifted,
            (true, false) => CameraChange::Moved,
            (false, false) => CameraChange::Unchanged,
        };
        let samples = self.places.iter().zip(&found.found).map(|(place, found)| (place.at, *found)).collect();
        Comparison {
            change,
            rotation: found.motion.turn,
            covariance,
            bound,
            z_score,
            shift,
            visible_samples: found.found.iter().flatten().count(),
            found_fraction: found.found_fraction(),
            window: None,
            chance_fraction: chance,
            samples,
        }
    }

    /// Returns the result for a window of the old image, if a window explains the new image better than the
    /// comparison `moved`. `size` is the width and height of the new image, in pixels.
    fn window(&self, moved: &Comparison, size: [u32; 2]) -> Option<Comparison> {
        /// Largest ratio of the mean squared brightness difference under a window to that under
        /// a rotation and zoom, at which the window is accepted.
        const MAX_RATIO: f64 = 0.8;
        let is_open = matches!(
            moved.change,
            CameraChange::Moved | CameraChange::Shifted | CameraChange::DifferentView | CameraChange::Blind
        );
        let found = is_open.then(|| find_window(&self.before, self.upright(), &self.after))??;
        if moved.change.is_aligned() {
            let turned = moved.rotation.for_camera(self.camera);
            let images = [&self.before, &self.after];
            let by_window = disagreement(images, found.map, |at| Some(found.map.pixel(at)))?;
            let by_rotation = disagreement(images, found.map, |at| turned.map_pixel(at));
            if by_rotation.is_some_and(|by_rotation| by_window > MAX_RATIO * by_rotation) {
                return None;
            }
        }
        let [width, height] = size.map(f64::from);
        let is_shown = |at: Pixel| {
            let Pixel { u, v } = found.map.pixel(at);
            (0.0..width).contains(&u) && (0.0..height).contains(&v)
        };
        let samples =
            self.places.iter().map(|place| (place.at, is_shown(place.at).then_some(true))).collect();
        Some(Comparison::windowed(&found, size, samples))
    }

    /// Returns the significance of the rotation and zoom of an alignment, as a z-score.
    fn z_score(&self, found: &Alignment) -> f64 {
        let [x, y, z] = found.motion.turn.vector;
        let mut whole = found.fit.clone();
        whole.estimate.rows_mut(0, RotationZoom::SIZE).copy_from_slice(&[x, y, z, found.motion.turn.zoom]);
        whole.z_score(0, RotationZoom::SIZE)
    }

    /// Returns the corners matched between both images, computed on first use.
    fn corners(&self) -> &[CornerMatch] {
        self.corners.get_or_init(|| corners(self.camera, &self.before, self.upright(), &self.after))
    }

    /// Returns the corners of the old image, computed on first use.
    fn upright(&self) -> &[Feature] {
        self.upright.get_or_init(|| features(&self.before, &[0.0]))
    }

    /// Whether near and far edges contradict a pure rotation: the camera is at another position.
    fn is_shifted(&self, found: &Alignment, chance: f64) -> bool {
        let all = StepAlignment::candidates(self.camera, &self.later, &self.places, || self.corners(), found);
        all.iter().any(|stepped| stepped.is_significant(self.camera, &self.places, found, chance))
    }

    /// Returns the displacement of the image by a rotation and zoom, RMS over the edge samples, in pixels.
    fn shift(&self, turn: &RotationZoom) -> f64 {
        let turned = turn.for_camera(self.camera);
        let moved =
            |place: &EdgeSample| Some(turned.ray_to_pixel(place.sights[0].ray)?.distance(place.at).powi(2));
        let squares: Vec<f64> = self.places.iter().filter_map(moved).collect();
        (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
    }

    /// Returns the result for images that could not be aligned, with this reason.
    fn unaligned(&self, change: CameraChange, chance_fraction: f64) -> Comparison {
        Comparison {
            change,
            rotation: RotationZoom::default(),
            covariance: [[UNKNOWN_VARIANCE; 4]; 4],
            bound: [[UNKNOWN_VARIANCE; 4]; 4],
            z_score: 0.0,
            shift: 0.0,
            visible_samples: self.places.len(),
            found_fraction: 0.0,
            window: None,
            chance_fraction,
            samples: self.places.iter().map(|place| (place.at, Some(false))).collect(),
        }
    }

    /// Returns the reason why the old edges are not found.
    fn unaligned_reason(&self, new: &RgbImage) -> CameraChange {
        /// Mean brightness below which an image counts as too dark, 0 to 255.
        const MIN_MEAN_BRIGHTNESS: f64 = 16.0;
        /// Ratio of the contrast of the new image to the contrast of the old image, below which the camera
        /// counts as blind.
        const MIN_CONTRAST_RATIO: f32 = 0.25;
        if mean(new) < MIN_MEAN_BRIGHTNESS {
            return CameraChange::TooDark;
        }
        if contrast(&self.after) < MIN_CONTRAST_RATIO * contrast(&self.before) {
            CameraChange::Blind
        } else {
            CameraChange::DifferentView
        }
    }
}

/// Returns the mean of all colour values of an image, 0 to 255.
fn mean(image: &RgbImage) -> f64 {
    let bytes = image.as_raw();
    bytes.iter().map(|&byte| f64::from(byte)).sum::<f64>() / bytes.len().max(1) as f64
}

/// Returns the contrast of an image: the ninth decile of its horizontal log brightness gradient, at a reduced
/// size.
fn contrast(luma: &Luma) -> f32 {
    let small = luma.reduced((luma.width as f64 / 320.0).max(1.0));
    let rows = small.values.chunks_exact(small.width.max(1));
    let mut slopes: Vec<f32> =
        rows.flat_map(|row| row.windows(2).map(|pair| (pair[1] - pair[0]).abs())).collect();
    let at = slopes.len() * 9 / 10;
    if slopes.is_empty() { 0.0 } else { *slopes.select_nth_unstable_by(at, f32::total_cmp).1 }
}
