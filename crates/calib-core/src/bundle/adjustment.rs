//! The bundle adjustment of several cameras, from the view graph to covariances.

use std::collections::HashSet;

use crate::bundle::camera::{BundleCamera, View};
use crate::bundle::copies::Copies;
use crate::bundle::initialization::{Initialization, initialize};
use crate::bundle::landmark::{DistanceMeasurement, Landmark, LandmarkModel, pairs_among};
use crate::bundle::refinement::Refinement;
use crate::bundle::summary::BundleSummary;
use crate::bundle::view_graph::clusters;
use crate::camera::Camera;
use crate::single::PlanePrior;

/// Several cameras, what they observe in common, and distances that were measured: refined together.
///
/// 1. The view graph is split into components; each is initialised along a spanning tree, every camera placed by
///    the landmarks that it shares with cameras placed before it, and all floors are aligned to close loops.
/// 2. Landmarks are triangulated.
/// 3. Cameras, landmarks and the nuisance parameters of stage 1 are refined by least squares,
///    every residual divided by its standard deviation: observations and annotations in pixels, priors and
///    distances in their units. Outliers among landmarks and distances are rejected one by one.
///
/// Unlike in structure from motion, roll, pitch, focal and lens of every camera are known about right before
/// (from [`Fit`](crate::Fit), or from elsewhere), and the floor is horizontal: only positions and yaws are
/// without initial values. What of the gauge of a component nothing in the base system fixes is fixed by the
/// placement of one camera, its [root](crate::Component::root).
///
/// # Example
///
/// Two cameras of known height, roll, pitch and focal see four points of the floor; the first stands at the
/// origin of the base system. Where is the second, and where does it look?
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
/// let second = summary.cameras[1].as_ref().expect("it is connected");
/// assert!(second.camera.position.distance(truth[1].position) < 1e-6);
/// assert!((second.camera.yaw - 0.5).abs() < 1e-6);
/// assert!(second.camera.covariance.sigma(Covariance::YAW).is_some_and(|sigma| sigma < 0.01));
/// assert!(summary.landmarks[1].position().distance(WorldPoint::new(-0.5, 7.0, 0.0)) < 1e-6);
/// # Ok::<(), calib_core::BundleError>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct BundleAdjustment<'a> {
    /// Observations name them by their index.
    pub cameras: Vec<BundleCamera<'a>>,
    /// What they observe.
    pub landmarks: Vec<Landmark>,
    /// Distances between landmarks.
    pub distances: Vec<DistanceMeasurement>,
    /// Planes besides the floor: those that the constraints of cameras and landmarks name by their index.
    pub planes: Vec<PlanePrior>,
}

/// What of an adjustment names something that does not exist, or has an impossible standard deviation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BundleError {
    /// The lens of this camera is that of a camera that does not exist, or has it from another itself.
    LensOf {
        /// Index of the camera.
        camera: usize,
    },
    /// This camera has constraints and no fit they belong to.
    MissingFit {
        /// Index of the camera.
        camera: usize,
    },
    /// Something is drawn on this camera on a plane that does not exist.
    CameraPlane {
        /// Index of the camera.
        camera: usize,
    },
    /// This landmark stands on a plane that does not exist.
    LandmarkPlane {
        /// Index of the landmark.
        landmark: usize,
    },
    /// An observation of a camera or a point that does not exist, or its standard deviation is not positive.
    Observation {
        /// Index of the landmark.
        landmark: usize,
        /// Index of the observation in the landmark.
        observation: usize,
    },
    /// A prior on a parameter that does not exist, or its standard deviation is not positive.
    LandmarkPrior {
        /// Index of the landmark.
        landmark: usize,
    },
    /// An end of this distance does not exist, or its standard deviation is not positive.
    Distance {
        /// Index of the distance.
        distance: usize,
    },
}

impl std::fmt::Display for BundleError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::LensOf { camera } => write!(f, "camera {camera} has the lens of a camera without one"),
            Self::MissingFit { camera } => write!(f, "camera {camera} has constraints but no fit"),
            Self::CameraPlane { camera } => write!(f, "camera {camera} shows a plane that does not exist"),
            Self::LandmarkPlane { landmark } => {
                write!(f, "landmark {landmark} stands on a plane that does not exist")
            }
            Self::Observation { landmark, observation } => write!(
                f,
                "observation {observation} of landmark {landmark} is of nothing, or its sigma not positive"
            ),
            Self::LandmarkPrior { landmark } => {
                write!(f, "a prior on landmark {landmark} is on nothing, or its sigma not positive")
            }
            Self::Distance { distance } => {
                write!(f, "an end of distance {distance} does not exist, or its sigma is not positive")
            }
        }
    }
}

impl std::error::Error for BundleError {}

impl BundleAdjustment<'_> {
    /// Initialises and refines.
    ///
    /// # Errors
    /// Where an index or a standard deviation is impossible. What cannot be solved is no error: the summary
    /// has its indices.
    pub fn solve(&self) -> Result<BundleSummary, BundleError> {
        self.check()?;
        Ok(self.solve_checked())
    }

    /// As [`Self::solve`], for indices and standard deviations that are right by construction.
    pub fn solve_checked(&self) -> BundleSummary {
        let initial = initialize(&self.cameras, &self.landmarks, &self.distances);
        let Initialization { poses, landmarks, distances, components, unreached, unobservable, loop_closure } =
            initial;
        let mut summary = BundleSummary {
            cameras: vec![None; self.cameras.len()],
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
        summary
    }

    /// Refines a cluster of cameras, given by their indices in ascending order.
    fn refine(&self, cluster: &[usize], poses: &[Camera], summary: &mut BundleSummary) {
        let (landmarks, distances) = summary.observed_by(cluster);
        if is_oversized(landmarks.iter().map(|&landmark| &summary.landmarks[landmark])) {
            summary.oversized.extend(cluster);
            return;
        }
        let mut of_cluster = local_landmarks(&landmarks, cluster, summary);
        let mut between = local_distances(&distances, &landmarks, summary);
        let copies = Copies::of(&of_cluster, &between);
        copies.widen(&mut of_cluster, &mut between);
        let refinement = Refinement {
            views: self.views(cluster, poses, summary),
            landmarks: of_cluster,
            distances: between,
            copies,
            planes: self.planes.clone(),
            noise_is_known: cluster.iter().map(|&camera| self.cameras[camera].noise_is_known).collect(),
        };
        match refinement.solve() {
            Some(refined) => {
                summary.take(refined, (&self.cameras, &self.planes), [cluster, &landmarks, &distances]);
            }
            None => summary.unsolved.extend(cluster),
        }
    }

    /// The cameras of a cluster: at their initial poses where they are connected, else at those given.
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

    fn check(&self) -> Result<(), BundleError> {
        for (index, camera) in self.cameras.iter().enumerate() {
            let owner = camera.lens_owner(index);
            if self.cameras.get(owner).is_none_or(|camera| camera.lens_owner(owner) != owner) {
                return Err(BundleError::LensOf { camera: index });
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

/// Landmarks of a cluster, with the observations of its cameras by their indices in the cluster.
fn local_landmarks(landmarks: &[usize], cluster: &[usize], summary: &BundleSummary) -> Vec<Landmark> {
    let local = |&index: &usize| {
        let mut landmark = summary.landmarks[index].clone();
        let within = |camera: usize| cluster.binary_search(&camera).ok();
        landmark.observations.retain_mut(|seen| within(seen.view).map(|view| seen.view = view).is_some());
        landmark
    };
    landmarks.iter().map(local).collect()
}

/// Distances of a cluster between its landmarks by their indices in the cluster.
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

/// Whether the cameras share so much that the system of equations would fill the memory of any machine.
fn is_oversized<'a>(landmarks: impl Iterator<Item = &'a Landmark>) -> bool {
    /// Pairs of cameras that observe a landmark in common: 450 cameras, every one with every other.
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
