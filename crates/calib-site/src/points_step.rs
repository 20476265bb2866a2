//! Stage 1 of one camera from its control points: pose and focal length where its lines do not determine
//! them, and the points that contradict the others.

use crate::camera_result::CameraResult;
use crate::document::{Mark, Site, SiteCamera};
use crate::solution::{Alternative, Method, Solution, Stage};
use calib_core::bundle::{Landmark, Observation};
use calib_core::camera::{Camera, Covariance, Lens, WorldPoint};
use calib_core::floor::{ControlPoint, view_angle};
use calib_core::optimize::is_misfit;
use calib_core::outcome::{Failure, Finding, OtherMinimum};
use calib_core::single::{
    Fit, FixedParameters, MAX_LOG_FOCAL_SIGMA, PointFit, PointFitOptions, Prior, Priors, is_inconsistent,
};

/// Points of a camera for stage 1: its control points with known coordinates that are switched on, or the points of a
/// mark.
#[derive(Clone, Debug, Default)]
pub(crate) struct UsedPoints {
    /// Indices of the control points; empty for the points of a mark.
    indices: Vec<usize>,
    points: Vec<ControlPoint>,
    /// Standard deviations of their coordinates, in metres; 0 for exact coordinates.
    position_sigmas: Vec<f64>,
    /// Index of the mark to which the points belong; `None` for control points.
    pub(crate) mark: Option<usize>,
}

/// Mistake that explains control points which contradict each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Explanation {
    /// The pixels of two control points are exchanged. The variant contains the indices of both points.
    Exchanged([usize; 2]),
    /// The world coordinates of the points are mirrored.
    Mirrored,
}

impl Explanation {
    /// Returns the failure of a camera whose control points contain this mistake and have no consistent subset.
    pub(crate) fn failure(self, entry: &SiteCamera) -> Failure {
        match self {
            Self::Mirrored => Failure::MirroredControlPoints,
            Self::Exchanged(pair) => Failure::ExchangedControlPoints {
                points: pair.map(|index| entry.control_points[index].label(index)),
            },
        }
    }
}

/// Smallest number of points for which a wrong point can be detected.
const MIN_POINTS: usize = 4;

impl UsedPoints {
    pub(crate) fn new(site: &Site, entry: &SiteCamera) -> Self {
        let used = entry.control_points.iter().enumerate().filter(|(_, point)| !point.off);
        let known = used.filter_map(|(index, point)| Some((index, point.control_point(site)?)));
        let (indices, points): (Vec<usize>, Vec<ControlPoint>) = known.unzip();
        let sigma = |&index: &usize| entry.control_points[index].position_sigma();
        Self { position_sigmas: indices.iter().map(sigma).collect(), indices, points, mark: None }
    }

    /// Returns the points of the mark with the most observations in the camera, at its position in the file.
    /// Orientation, focal length and height of the camera do not depend on that position.
    pub(crate) fn from_mark(site: &Site, entry: &SiteCamera) -> Self {
        let points = |mark: &Mark| -> Vec<ControlPoint> {
            let shape = mark.shape_at(mark.at_m, mark.turn_deg);
            let own = mark.seen.iter().filter(|seen| seen.camera == entry.id);
            own.filter_map(|seen| Some(ControlPoint { world: shape.point(&seen.point)?, pixel: seen.px }))
                .collect()
        };
        let marks = site.marks.iter().enumerate().filter(|(_, mark)| !mark.off);
        let best = marks.map(|(index, mark)| (index, points(mark))).max_by_key(|(_, points)| points.len());
        best.map_or_else(Self::default, |(index, points)| Self {
            points,
            mark: Some(index),
            ..Self::default()
        })
    }

    /// Returns the inputs of a fit to the points.
    pub(crate) fn options(
        &self,
        entry: &SiteCamera,
        lens: Lens,
        fixed: FixedParameters,
    ) -> PointFitOptions<'_> {
        let priors = entry.priors(&lens);
        let focal = priors.focal.filter(|_| fixed.focal.is_none());
        PointFitOptions {
            lens,
            size: entry.size(),
            fixed,
            priors: Priors { focal, ..priors },
            sigma: entry.sigma_px.unwrap_or(1.0),
            position_sigmas: &self.position_sigmas,
        }
    }

    /// Returns the points as landmarks with exact positions, for a bundle adjustment with one camera. `sigma` is the
    /// standard deviation of a pixel coordinate, in pixels.
    pub(crate) fn landmarks(&self, sigma: f64) -> Vec<Landmark> {
        let seen = |pixel| vec![Observation { sigma, ..Observation::new(0, pixel) }];
        self.points.iter().map(|point| Landmark::measured(point.world, None, seen(point.pixel))).collect()
    }

    pub(crate) fn len(&self) -> usize {
        self.points.len()
    }

    /// Fits the camera to the points. `None` if they determine no pose.
    fn fit(&self, options: &PointFitOptions) -> Option<PointFit> {
        if self.points.is_empty() { None } else { PointFit::new(&self.points, options) }
    }

    /// Whether the points, with the priors, contradict each other beyond any noise.
    pub(crate) fn are_contradictory(&self, options: &PointFitOptions) -> bool {
        self.fit(options).is_some_and(|found| is_inconsistent(found.chi2, found.dof))
    }

    /// Fits the camera to the points. With `fits_lens`, also fits the distortion, if the points support one. Returns
    /// `None` if points and priors do not determine the pose and the focal length, or contradict each other beyond
    /// any noise.
    pub(crate) fn determined(&self, options: &PointFitOptions, fits_lens: bool) -> Option<PointFit> {
        let plain = self.fit(options)?;
        let curved = if fits_lens { plain.with_lens(&self.points, options) } else { None };
        let found = curved.unwrap_or(plain);
        let is_sharp = found.log_focal_sigma.is_none_or(|sigma| sigma < MAX_LOG_FOCAL_SIGMA);
        let is_usable = is_sharp && found.dof >= 0 && !is_inconsistent(found.chi2, found.dof);
        (is_usable && found.camera.covariance.is_known()).then_some(found)
    }

    /// Returns the indices of the points that contradict a fit.
    pub(crate) fn suspects(&self, fit: &PointFit) -> Vec<usize> {
        fit.outliers.iter().map(|&outlier| self.indices[outlier]).collect()
    }

    /// Returns the indices of the points that contradict the others, for a camera that its lines determine. `fit` is
    /// the fit to the lines, whose orientation and focal length become priors of the fit to the points.
    ///
    /// Returns an empty list for fewer than [`MIN_POINTS`] points.
    pub(crate) fn suspects_beside(&self, fit: &Fit, options: &PointFitOptions) -> Vec<usize> {
        /// Factor that enlarges the standard deviations of the fit to the lines, because the lines may be slightly
        /// wrong.
        const SPREAD: f64 = 3.0;
        if self.len() < MIN_POINTS {
            return Vec::new();
        }
        let priors = priors_from(&fit.camera, SPREAD, &options.priors);
        let Some(found) = self.fit(&PointFitOptions { priors, ..*options }) else { return Vec::new() };
        self.suspects(&found)
    }

    /// Returns the mistake that explains points which contradict each other: two exchanged points, or mirrored
    /// points. Returns `None` if the points do not contradict each other, or if there is no unique explanation.
    pub(crate) fn explanation(&self, options: &PointFitOptions, suspects: &[usize]) -> Option<Explanation> {
        /// Largest number of points for which the exchange of every pair is tried if no point is suspect. Otherwise
        /// only pairs of suspect points are tried.
        const MAX_POINTS_FOR_PAIRS: usize = 12;
        let is_good = |found: &PointFit| {
            found.outliers.is_empty()
                && found.dof >= 1
                && !is_misfit(found.chi2, found.dof)
                && is_possible(&found.camera, options.size)
        };
        let n = self.len();
        if n < MIN_POINTS || suspects.is_empty() && self.fit(options).as_ref().is_some_and(is_good) {
            return None;
        }
        let mirrored: Vec<ControlPoint> = self
            .points
            .iter()
            .map(|point| ControlPoint { world: WorldPoint { x: -point.world.x, ..point.world }, ..*point })
            .collect();
        if PointFit::new(&mirrored, options).as_ref().is_some_and(is_good) {
            return Some(Explanation::Mirrored);
        }
        let is_tried = |i: usize, j: usize| {
            let both = [i, j].map(|k| suspects.contains(&self.indices[k]));
            if suspects.is_empty() { n <= MAX_POINTS_FOR_PAIRS } else { both == [true, true] }
        };
        let pairs = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))).filter(|&(i, j)| is_tried(i, j));
        let exchanged = |(i, j): (usize, usize)| {
            let mut points = self.points.clone();
            (points[i].pixel, points[j].pixel) = (points[j].pixel, points[i].pixel);
            PointFit::new(&points, options).filter(is_good).map(|found| (found.chi2, [i, j]))
        };
        let found: Vec<(f64, [usize; 2])> = pairs.filter_map(exchanged).collect();
        match found[..] {
            [(_, pair)] => Some(Explanation::Exchanged(pair.map(|k| self.indices[k]))),
            _ => None,
        }
    }
}

/// Whether a camera can exist: above its floor, at most 200 m high, with a focal length of at most 50 image
/// widths.
pub(crate) fn is_possible(camera: &Camera, [width, _]: [f64; 2]) -> bool {
    (0.0..=200.0).contains(&camera.position.z) && camera.focal <= 50.0 * width
}

/// Returns priors on the orientation and focal length from an estimate, with its standard deviations
/// multiplied by `spread`. The prior on the height is that of `entered`.
pub(crate) fn priors_from(camera: &Camera, spread: f64, entered: &Priors) -> Priors {
    /// Least standard deviations of an angle in radians, and of the log focal length.
    const MIN_SIGMA: [f64; 2] = [1e-3, 2e-3];
    let sigma = |index: usize, least: f64| {
        let sigma = camera.covariance.sigma(index).map_or(0.0, |sigma| spread * sigma);
        sigma.max(least)
    };
    let angle = |value: f64, index: usize| Some(Prior { value, sigma: sigma(index, MIN_SIGMA[0]) });
    Priors {
        roll: angle(camera.roll, Covariance::ROLL),
        pitch: angle(camera.pitch, Covariance::PITCH),
        focal: Some(Prior {
            value: camera.focal,
            sigma: sigma(Covariance::FOCAL, MIN_SIGMA[1] * camera.focal),
        }),
        height: entered.height,
        weak_log_focal: None,
    }
}

/// Returns the camera above the origin with yaw 0: the result of stage 1. Position and yaw are exact.
pub(crate) fn unplaced(camera: &Camera) -> Camera {
    let mut covariance = camera.covariance;
    for index in [Covariance::X, Covariance::Y, Covariance::YAW] {
        for k in 0..Covariance::SIZE {
            covariance.0[index][k] = 0.0;
            covariance.0[k][index] = 0.0;
        }
    }
    let position = WorldPoint::new(0.0, 0.0, camera.position.z);
    Camera { position, yaw: 0.0, covariance, ..*camera }
}

/// Returns the result of stage 1 of a camera that only control points determine. Stage 2 places it.
pub(crate) fn from_points(entry: &SiteCamera, found: &PointFit) -> CameraResult {
    let camera = unplaced(&found.camera);
    let mut solution = Solution::from_camera(&camera, Method::MaximumLikelihood, Stage::Partial);
    solution.set_uncertainty(&camera, None);
    solution.chi2 = Some(found.chi2);
    solution.dof = usize::try_from(found.dof.max(0)).ok();
    let other = |other: &Camera| Alternative {
        focal_px: other.focal,
        hfov_deg: view_angle(&other.lens, other.focal, entry.size()).to_degrees(),
        pitch_deg: other.pitch.to_degrees(),
        roll_deg: other.roll.to_degrees(),
        chi2: found.chi2,
    };
    solution.alternatives = found.alternatives.iter().map(other).collect();
    let mut findings = Vec::new();
    if !found.alternatives.is_empty() {
        let others = found.alternatives.iter();
        let others =
            others.map(|&Camera { focal, pitch, roll, .. }| OtherMinimum { focal, pitch, roll }).collect();
        findings.push(Finding::TwoSolutions { others, is_turned: false, next: None });
    }
    CameraResult { findings, ..CameraResult::new(solution) }
}
