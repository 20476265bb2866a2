//! Bundle adjustment of several cameras, from the view graph to the covariances, and its result.

use std::collections::{HashMap, HashSet};

use crate::bundle::camera::{BundleCamera, View};
use crate::bundle::converged::{CrossCovariance, OutlierCandidate, PlaneEstimate};
use crate::bundle::copies::Copies;
use crate::bundle::initialization::{Initialization, initialize};
use crate::bundle::landmark::{DistanceMeasurement, Landmark, LandmarkModel, pairs_among};
use crate::bundle::refinement::{Refined, Refinement};
use crate::bundle::reliability::{Observed, Reliability};
use crate::bundle::residuals::ResidualKind;
use crate::bundle::view_graph::{Component, clusters};
use crate::camera::Camera;
use crate::single::{Constraints, PlanePrior, Problem, Source, State, predictable};

/// Estimate of one camera after the bundle adjustment.
#[derive(Clone, Debug)]
pub struct CameraEstimate {
    /// Camera with the covariance of its estimated parameters.
    pub camera: Camera,
    /// Whether the pose is estimated: in the base system, or in the common system of a component that is not located
    /// or oriented. Otherwise x, y and yaw keep their input values. In this case only roll, pitch, focal length and
    /// lens are refined, and the height if the camera's own annotations determine it.
    pub is_connected: bool,
    /// Sum of the squared residuals, in standard deviations, of all cameras refined together with this one.
    pub chi2: f64,
    /// Degrees of freedom of `chi2`: number of residuals minus number of parameters.
    pub dof: i64,
    /// Standard deviation of the annotated pixels, in pixels: the given value, or the value estimated from
    /// the residuals.
    pub sigma: f64,
    /// Distance of every annotation from its prediction, in pixels, including rejected annotations.
    pub residuals: Vec<(Source, f64)>,
    /// Whether the chi-square of the joint refinement is too large for the noise, at a level of 1 %, and no
    /// outlier explains it.
    pub is_misfit: bool,
}

/// Result of a bundle adjustment. Indices refer to the lists of the [`BundleAdjustment`].
#[derive(Clone, Debug, Default)]
pub struct BundleSummary {
    /// Estimate of every camera. It is `None` if the camera is not connected and its lens is neither estimated nor
    /// shared, or if it is [`oversized`](Self::oversized) or [`unsolved`](Self::unsolved).
    pub cameras: Vec<Option<CameraEstimate>>,
    /// Landmarks at their estimated positions; rejected and unused landmarks are switched off.
    pub landmarks: Vec<Landmark>,
    /// Reliability of the used annotations of every camera, ascending by source; empty if it is not computed.
    pub annotation_reliabilities: Vec<Vec<(Source, Reliability)>>,
    /// Reliability of the observations of every refined landmark, each with the index of its camera.
    pub landmark_reliabilities: Vec<Vec<(usize, Reliability)>>,
    /// Covariance of the parameters of every refined landmark, in the order and units of its model; zeros for
    /// fixed parameters.
    pub landmark_covariances: Vec<Option<[[f64; 3]; 3]>>,
    /// Estimate of every plane; `None` if the plane is fixed or not used.
    pub planes: Vec<Option<PlaneEstimate>>,
    /// Measured distances; rejected and unused distances are switched off.
    pub distances: Vec<DistanceMeasurement>,
    /// Landmarks and distances that were rejected as outliers.
    pub rejected: Vec<OutlierCandidate>,
    /// Connected components of the view graph.
    pub components: Vec<Component>,
    /// Cameras that share too few landmarks with the other cameras of their component to be placed.
    pub unreached: Vec<usize>,
    /// Cameras that are not adjusted because their shared landmarks would lead to a system of equations that
    /// is too large for the memory.
    pub oversized: Vec<usize>,
    /// Cameras that are not adjusted because a shared landmark of their cluster is not visible from the
    /// initial poses.
    pub unsolved: Vec<usize>,
    /// Landmarks that are not used: they cannot be triangulated, or their position is not visible in one of the
    /// observing cameras.
    pub unobservable: Vec<usize>,
    /// Largest root mean square disagreement on the floor after initialisation, in metres, over camera pairs
    /// that share landmarks but no edge of the spanning tree. It is `None` without loops.
    pub loop_closure: Option<f64>,
    /// Cross-covariance of every pair of cameras refined together, the lower index first. With more than 45
    /// cameras, only pairs that observe a common landmark are included.
    pub cross_covariances: HashMap<[usize; 2], CrossCovariance>,
}

impl BundleSummary {
    /// Whether the camera with this index has enough shared landmarks to be positioned within its
    /// connected component of the view graph.
    pub(crate) fn is_connected(&self, camera: usize) -> bool {
        !self.unreached.contains(&camera) && self.components.iter().any(|c| c.views.contains(&camera))
    }

    /// Returns the component of a camera; `None` if the camera is unreached or in no component.
    pub(crate) fn component(&self, camera: usize) -> Option<&Component> {
        let component = self.components.iter().find(|component| component.views.contains(&camera));
        component.filter(|_| !self.unreached.contains(&camera))
    }

    /// Returns the indices of the active landmarks that the cameras of a cluster observe, and of the active
    /// distances between these landmarks. `cluster` must be ascending.
    pub(crate) fn observed_by(&self, cluster: &[usize]) -> (Vec<usize>, Vec<usize>) {
        let is_observed = |landmark: &Landmark| {
            let mut seen = landmark.observations.iter();
            !landmark.off && seen.any(|seen| cluster.binary_search(&seen.view).is_ok())
        };
        let landmarks: Vec<usize> =
            (0..self.landmarks.len()).filter(|&i| is_observed(&self.landmarks[i])).collect();
        let is_between = |distance: &DistanceMeasurement| {
            let mut ends = distance.between.iter();
            !distance.off && ends.all(|landmark| landmarks.binary_search(landmark).is_ok())
        };
        let distances = (0..self.distances.len()).filter(|&i| is_between(&self.distances[i])).collect();
        (landmarks, distances)
    }

    /// Adds the result of a refined cluster with the given indices of cameras, landmarks and distances.
    pub(crate) fn add_refined(
        &mut self,
        refined: Refined,
        of: (&[BundleCamera], &[PlanePrior]),
        [cluster, landmarks, distances]: [&[usize]; 3],
    ) {
        let own = annotation_residuals(&refined, cluster.len());
        self.add_reliabilities(&refined.reliabilities, cluster, landmarks);
        for (plane, estimate) in self.planes.iter_mut().zip(&refined.planes) {
            *plane = estimate.or(*plane);
        }
        for (view, &camera) in cluster.iter().enumerate() {
            let estimate =
                CameraEstimate::new(of, &refined, [camera, view], &own[view], self.is_connected(camera));
            self.cameras[camera] = Some(estimate);
        }
        for (estimate, &landmark) in refined.landmarks.iter().zip(landmarks) {
            if let Some(estimate) = estimate {
                let Landmark { model, params, plane, ground, .. } = &mut self.landmarks[landmark];
                (*model, *params) = (estimate.model.clone(), estimate.params);
                let found = plane.and_then(|plane| refined.planes[plane]);
                *ground = found.map_or(*ground, |found| found.plane);
                self.landmark_covariances[landmark] = Some(estimate.covariance);
            }
        }
        for candidate in &refined.rejected {
            self.rejected.push(match *candidate {
                OutlierCandidate::Landmark(landmark) => {
                    self.landmarks[landmarks[landmark]].off = true;
                    OutlierCandidate::Landmark(landmarks[landmark])
                }
                OutlierCandidate::Distance(distance) => {
                    self.distances[distances[distance]].off = true;
                    OutlierCandidate::Distance(distances[distance])
                }
            });
        }
        let pairs = refined.pairs.into_iter();
        self.cross_covariances.extend(pairs.map(|(pair, block)| (pair.map(|view| cluster[view]), block)));
    }
}

impl BundleSummary {
    /// Adds the reliabilities of a cluster with the given indices of cameras and landmarks.
    fn add_reliabilities(
        &mut self,
        found: &[(Observed, Reliability)],
        cluster: &[usize],
        landmarks: &[usize],
    ) {
        for &(observed, reliability) in found {
            match observed {
                Observed::Annotation { view, source } => {
                    self.annotation_reliabilities[cluster[view]].push((source, reliability));
                }
                Observed::Landmark { landmark, observation } => {
                    let landmark = landmarks[landmark];
                    // The index counts only the observations of cameras of the cluster.
                    let observations = self.landmarks[landmark].observations.iter();
                    let mut own = observations.filter(|seen| cluster.binary_search(&seen.view).is_ok());
                    let found = own.nth(observation).map(|seen| (seen.view, reliability));
                    self.landmark_reliabilities[landmark].extend(found);
                }
            }
        }
    }
}

impl CameraEstimate {
    fn new(
        (cameras, planes): (&[BundleCamera], &[PlanePrior]),
        refined: &Refined,
        [index, view]: [usize; 2],
        residuals: &[(Source, f64)],
        is_connected: bool,
    ) -> Self {
        let (entry, camera) = (&cameras[index], refined.cameras[view]);
        let inflation = if entry.noise_is_known { 1.0 } else { refined.inflation };
        let sigma = entry.fit.map_or(1.0, |fit| fit.sigma);
        let stage_1 = entry.stage_1();
        let pixels = |&(source, residual): &(Source, f64)| {
            (
                source,
                residual * stage_1.sigma_of(source) * entry.constraints.repeats.repeat_count(source).sqrt(),
            )
        };
        let mut residuals: Vec<(Source, f64)> = residuals.iter().map(pixels).collect();
        residuals.extend(rejected_residuals(entry, &camera, &refined.nuisances[view], planes));
        Self {
            camera,
            is_connected,
            chi2: refined.chi2,
            dof: refined.dof,
            sigma: sigma * inflation.sqrt(),
            residuals,
            is_misfit: refined.is_misfit,
        }
    }
}

/// Returns the residuals of the annotations of every view, in standard deviations. Several residuals of one
/// annotation, for example of an upright, are combined into their norm.
fn annotation_residuals(refined: &Refined, views: usize) -> Vec<Vec<(Source, f64)>> {
    let mut own: Vec<Vec<(Source, f64)>> = vec![Vec::new(); views];
    for (kind, residual) in &refined.residuals {
        let ResidualKind::Annotation { view, source } = kind else { continue };
        match own[*view].last_mut() {
            Some((last, sum)) if last == source => *sum = sum.hypot(*residual),
            _ => own[*view].push((*source, *residual)),
        }
    }
    own
}

/// Returns the distances, in pixels, of the annotations rejected by stage 1 from the prediction of the
/// refined camera.
fn rejected_residuals(
    entry: &BundleCamera,
    camera: &Camera,
    nuisance: &[f64],
    planes: &[PlanePrior],
) -> Vec<(Source, f64)> {
    let rejected = entry.fit.map_or(&[][..], |fit| &fit.outliers[..]);
    if rejected.is_empty() {
        return Vec::new();
    }
    let scene = entry.constraints.scene;
    let constraints = Constraints::on_planes(entry.annotations, &camera.lens, scene, planes);
    let log_height = camera.position.z.abs().max(1e-9).ln();
    let parameters = [camera.roll, camera.pitch, camera.focal.ln(), log_height];
    let constraints = predictable(&constraints, &parameters);
    let everything = Problem { rejected: &[], constraints: &constraints, ..entry.stage_1() };
    let state = State { parameters, nuisance: nuisance.to_vec() };
    let mut residuals = everything.residuals_in_pixels(&state).unwrap_or_default();
    residuals.retain(|(source, _)| rejected.contains(source));
    residuals
}

/// Joint refinement of several cameras from shared landmarks and measured distances.
///
/// 1. The view graph is split into components. Each component is initialised along a spanning tree: every
///    camera is placed from the landmarks that it shares with cameras placed before it. All floors are then
///    aligned to close loops.
/// 2. Landmarks are triangulated.
/// 3. Cameras, landmarks and the nuisance parameters of stage 1 are refined by least squares. Every residual
///    is divided by its standard deviation: observations and annotations in pixels, priors and distances in
///    their units. Outliers among landmarks and distances are rejected one by one.
///
/// Unlike in structure from motion, roll, pitch, focal length and lens of every camera are approximately
/// known in advance, for example from [`Fit`](crate::Fit). The floor is horizontal. Only positions and yaws
/// have no initial values. If no known value in the base system fixes the gauge of a component, the placement
/// of one camera fixes it: the [root](crate::bundle::Component::root).
///
/// # Example
///
/// Two cameras of known height, roll, pitch and focal length observe four points of the floor. The first
/// camera is at the origin of the base system. The example computes the position and yaw of the second.
///
/// ```
/// use calib_core::{
///     BundleAdjustment, BundleCamera, Camera, Covariance, InitialPose, Landmark, LandmarkModel, Lens,
///     Observation, Pixel, WorldPoint,
/// };
///
/// let camera = |x: f64, y: f64, yaw: f64| Camera {
///     position: WorldPoint::new(x, y, 4.0),
///     yaw,
///     pitch: 0.6,
///     roll: 0.02,
///     focal: 1200.0,
///     lens: Lens::pinhole(Pixel::new(960.0, 540.0)),
///     covariance: Covariance::EXACT,
/// };
/// let truth = [camera(0.0, 0.0, 0.0), camera(3.0, 1.0, 0.5)];
/// let landmarks = [(0.5, 5.0), (-0.5, 7.0), (1.2, 6.0), (0.0, 8.0)].map(|(x, y)| {
///     let point = WorldPoint::new(x, y, 0.0);
///     let seen = truth.iter().enumerate();
///     let seen = seen.filter_map(|(view, camera)| Some(Observation::new(view, camera.world_to_pixel(point)?)));
///     Landmark::new(LandmarkModel::Point { height: 0.0 }, seen.collect())
/// });
///
/// let size = [1920.0, 1080.0];
/// let first = BundleCamera { initial_pose: InitialPose::Fixed, ..BundleCamera::new(truth[0], size) };
/// let second = BundleCamera::new(camera(0.0, 0.0, 0.0), size);
/// let adjustment =
///     BundleAdjustment { cameras: vec![first, second], landmarks: landmarks.to_vec(), ..Default::default() };
/// let summary = adjustment.solve()?;
///
/// let second = summary.cameras[1].as_ref().expect("the second camera is connected");
/// assert!(second.camera.position.distance(truth[1].position) < 1e-6);
/// assert!((second.camera.yaw - 0.5).abs() < 1e-6);
/// assert!(second.camera.covariance.sigma(Covariance::YAW).is_some_and(|sigma| sigma < 0.01));
/// assert!(summary.landmarks[1].position().distance(WorldPoint::new(-0.5, 7.0, 0.0)) < 1e-6);
/// # Ok::<(), calib_core::BundleError>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct BundleAdjustment<'a> {
    /// Cameras; observations refer to them by index.
    pub cameras: Vec<BundleCamera<'a>>,
    /// Landmarks with their observations.
    pub landmarks: Vec<Landmark>,
    /// Distances between landmarks.
    pub distances: Vec<DistanceMeasurement>,
    /// Planes other than the floor; constraints and landmarks refer to them by index.
    pub planes: Vec<PlanePrior>,
    /// Whether the reliability of every annotation and observation is computed.
    pub with_reliability: bool,
}

/// Invalid index or standard deviation in an adjustment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BundleError {
    /// Camera that shares the lens of a missing camera, or of a camera that itself shares another lens.
    SharedLens {
        /// Index of the camera.
        camera: usize,
    },
    /// Camera with constraints but without a fit.
    MissingFit {
        /// Index of the camera.
        camera: usize,
    },
    /// Camera with an annotation on a missing plane.
    CameraPlane {
        /// Index of the camera.
        camera: usize,
    },
    /// Landmark on a missing plane.
    LandmarkPlane {
        /// Index of the landmark.
        landmark: usize,
    },
    /// Observation of a missing camera or point, or with a standard deviation that is not positive.
    Observation {
        /// Index of the landmark.
        landmark: usize,
        /// Index of the observation in the landmark.
        observation: usize,
    },
    /// Landmark with a prior on a missing parameter, or with a standard deviation that is not positive.
    LandmarkPrior {
        /// Index of the landmark.
        landmark: usize,
    },
    /// Distance to a missing landmark, or with a standard deviation that is not positive.
    Distance {
        /// Index of the distance.
        distance: usize,
    },
}

impl std::fmt::Display for BundleError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::SharedLens { camera } => write!(
                f,
                "camera {camera} shares the lens of a camera that does not exist, or that itself shares a lens"
            ),
            Self::MissingFit { camera } => write!(f, "camera {camera} has constraints but no fit"),
            Self::CameraPlane { camera } => {
                write!(f, "camera {camera} has an annotation on an unknown plane")
            }
            Self::LandmarkPlane { landmark } => {
                write!(f, "landmark {landmark} is on an unknown plane")
            }
            Self::Observation { landmark, observation } => write!(
                f,
                "observation {observation} of landmark {landmark} is invalid: unknown camera or point, or sigma not positive"
            ),
            Self::LandmarkPrior { landmark } => {
                write!(
                    f,
                    "a prior on landmark {landmark} is invalid: unknown parameter, or sigma not positive"
                )
            }
            Self::Distance { distance } => {
                write!(f, "distance {distance} is invalid: unknown landmark, or sigma not positive")
            }
        }
    }
}

impl std::error::Error for BundleError {}

impl BundleAdjustment<'_> {
    /// Initialises and refines all cameras and landmarks.
    ///
    /// # Errors
    /// Returns an error for an invalid index or standard deviation. Cameras and landmarks that cannot be
    /// solved are not an error: the summary lists their indices.
    pub fn solve(&self) -> Result<BundleSummary, BundleError> {
        self.check()?;
        Ok(self.solve_checked())
    }

    /// Initialises and refines all cameras and landmarks like [`Self::solve`], without a check of indices and
    /// standard deviations. They must be valid by construction.
    pub fn solve_checked(&self) -> BundleSummary {
        let initial = initialize(&self.cameras, &self.landmarks, &self.distances);
        let Initialization { poses, landmarks, distances, components, unreached, unobservable, loop_closure } =
            initial;
        let mut summary = BundleSummary {
            cameras: vec![None; self.cameras.len()],
            annotation_reliabilities: vec![Vec::new(); self.cameras.len()],
            landmark_reliabilities: vec![Vec::new(); landmarks.len()],
            landmark_covariances: vec![None; landmarks.len()],
            planes: vec![None; self.planes.len()],
            landmarks,
            distances,
            components,
            unreached,
            unobservable,
            loop_closure,
            ..BundleSummary::default()
        };
        for cluster in clusters(&self.cameras, &summary.components, &summary.unreached) {
            self.refine(&cluster, &poses, &mut summary);
        }
        if self.with_reliability {
            self.add_single_reliabilities(&poses, &mut summary);
        }
        summary
    }

    /// Refines a cluster of cameras, given by their indices in ascending order, and adds the result to the
    /// summary.
    fn refine(&self, cluster: &[usize], poses: &[Camera], summary: &mut BundleSummary) {
        let (landmarks, distances) = summary.observed_by(cluster);
        if is_oversized(landmarks.iter().map(|&landmark| &summary.landmarks[landmark])) {
            summary.oversized.extend(cluster);
            return;
        }
        let mut of_cluster = local_landmarks(&landmarks, cluster, summary);
        let mut between = local_distances(&distances, &landmarks, summary);
        let copies = Copies::new(&of_cluster, &between);
        copies.inflate(&mut of_cluster, &mut between);
        let refinement = Refinement {
            views: self.views(cluster, poses, summary),
            landmarks: of_cluster,
            distances: between,
            copies,
            planes: self.planes.clone(),
            noise_is_known: cluster.iter().map(|&camera| self.cameras[camera].noise_is_known).collect(),
            with_reliability: self.with_reliability,
        };
        match refinement.solve() {
            Some(refined) => {
                summary.add_refined(
                    refined,
                    (&self.cameras, &self.planes),
                    [cluster, &landmarks, &distances],
                );
            }
            None => summary.unsolved.extend(cluster),
        }
    }

    /// Adds the reliability of the annotations of cameras that have only a result of stage 1.
    fn add_single_reliabilities(&self, poses: &[Camera], summary: &mut BundleSummary) {
        for camera in 0..self.cameras.len() {
            let is_solved = summary.cameras[camera].is_some() || summary.unsolved.contains(&camera);
            let has_shared_lens = self.cameras[camera].lens_owner(camera) != camera;
            if is_solved || has_shared_lens || self.cameras[camera].fit.is_none() {
                continue;
            }
            let refinement = Refinement {
                views: self.views(&[camera], poses, summary),
                landmarks: Vec::new(),
                distances: Vec::new(),
                copies: Copies::new(&[], &[]),
                planes: self.planes.clone(),
                noise_is_known: vec![self.cameras[camera].noise_is_known],
                with_reliability: true,
            };
            summary.add_reliabilities(&refinement.reliabilities(), &[camera], &[]);
        }
    }

    /// Returns the views of a cluster. Connected cameras start at their initial poses; the other cameras
    /// start at their input poses.
    fn views(&self, cluster: &[usize], poses: &[Camera], summary: &BundleSummary) -> Vec<View<'_>> {
        let view = |&index: &usize| {
            let camera = &self.cameras[index];
            let gauge = summary.component(index).map(|component| component.gauge(index));
            let start = if gauge.is_some() { &poses[index] } else { &camera.camera };
            let owner = camera.lens_owner(index);
            let lens = cluster.binary_search(&owner).unwrap_or(0);
            View::new(camera, start, &self.cameras[owner], lens, gauge)
        };
        cluster.iter().map(view).collect()
    }

    /// Checks all indices and standard deviations.
    fn check(&self) -> Result<(), BundleError> {
        for (index, camera) in self.cameras.iter().enumerate() {
            let owner = camera.lens_owner(index);
            if self.cameras.get(owner).is_none_or(|camera| camera.lens_owner(owner) != owner) {
                return Err(BundleError::SharedLens { camera: index });
            }
            if camera.fit.is_none() && !camera.constraints.is_empty() {
                return Err(BundleError::MissingFit { camera: index });
            }
        }
        for (index, camera) in self.cameras.iter().enumerate() {
            if camera.constraints.planes.iter().any(|drawn| drawn.index >= self.planes.len()) {
                return Err(BundleError::CameraPlane { camera: index });
            }
        }
        for (index, landmark) in self.landmarks.iter().enumerate() {
            if landmark.plane.is_some_and(|plane| plane >= self.planes.len()) {
                return Err(BundleError::LandmarkPlane { landmark: index });
            }
            self.check_landmark(index, landmark)?;
        }
        for (index, distance) in self.distances.iter().enumerate() {
            let ends_exist = distance.between.iter().all(|&landmark| landmark < self.landmarks.len());
            if !(ends_exist && distance.length.sigma > 0.0) {
                return Err(BundleError::Distance { distance: index });
            }
        }
        Ok(())
    }

    /// Checks the indices and standard deviations of a landmark's observations and priors.
    fn check_landmark(&self, index: usize, landmark: &Landmark) -> Result<(), BundleError> {
        let points = match &landmark.model {
            LandmarkModel::Point { .. } | LandmarkModel::Measured => 1,
            LandmarkModel::Post => 2,
            LandmarkModel::Mark { points, .. } => points.len(),
            LandmarkModel::Line { .. } => usize::MAX,
        };
        let is_wrong = landmark
            .observations
            .iter()
            .position(|seen| !(seen.view < self.cameras.len() && seen.point < points && seen.sigma > 0.0));
        if let Some(observation) = is_wrong {
            return Err(BundleError::Observation { landmark: index, observation });
        }
        if landmark.priors.iter().all(|(k, prior)| *k < landmark.free.len() && prior.sigma > 0.0) {
            Ok(())
        } else {
            Err(BundleError::LandmarkPrior { landmark: index })
        }
    }
}

/// Copies the landmarks of a cluster, with the observations of its cameras renumbered to the cluster.
fn local_landmarks(landmarks: &[usize], cluster: &[usize], summary: &BundleSummary) -> Vec<Landmark> {
    let local = |&index: &usize| {
        let mut landmark = summary.landmarks[index].clone();
        let within = |camera: usize| cluster.binary_search(&camera).ok();
        landmark.observations.retain_mut(|seen| within(seen.view).map(|view| seen.view = view).is_some());
        landmark
    };
    landmarks.iter().map(local).collect()
}

/// Copies the distances of a cluster, with their landmarks renumbered to the cluster.
fn local_distances(
    distances: &[usize],
    landmarks: &[usize],
    summary: &BundleSummary,
) -> Vec<DistanceMeasurement> {
    let local = |&index: &usize| {
        let distance = summary.distances[index];
        let within = |landmark: usize| landmarks.binary_search(&landmark).unwrap_or(0);
        DistanceMeasurement { between: distance.between.map(within), ..distance }
    };
    distances.iter().map(local).collect()
}

/// Whether so many pairs of cameras share landmarks that the system of equations would be too large for the
/// memory.
fn is_oversized<'a>(landmarks: impl Iterator<Item = &'a Landmark>) -> bool {
    /// Largest number of camera pairs that observe a common landmark: 450 cameras, each paired with every
    /// other.
    const MAX_PAIRS: usize = 100_000;
    let mut pairs = HashSet::new();
    for landmark in landmarks {
        let views = landmark.views();
        if views.len() * views.len() > 2 * MAX_PAIRS {
            return true;
        }
        pairs.extend(pairs_among(&views));
        if pairs.len() > MAX_PAIRS {
            return true;
        }
    }
    false
}
