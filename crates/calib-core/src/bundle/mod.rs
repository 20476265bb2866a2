//! Stage 2: bundle adjustment of several cameras from shared landmarks.
//!
//! Rule: this folder does not use the site file. Cameras, landmarks and observations are passed in and
//! returned as values. The files, in the order of the data:
//!
//! - `landmark`: landmarks, observations, measured distances, and the reprojection error of an observation.
//! - `copies`: landmarks and distances that were annotated more than once and count once.
//! - `triangulation`: the position of a landmark from the cameras that observe it.
//! - `floor_alignment`: similarities between the floors of the cameras, averaged over all pairs.
//! - `camera`: a camera as it enters the adjustment, with its priors and free parameters.
//! - `view_graph`: connected components, their gauge, and resection of one more camera.
//! - `initialization`: initial poses along a spanning tree, and the tilt of the floor that several views
//!   share.
//! - `parameters`: the parameter blocks and their positions in the state.
//! - `residuals`: the list of all residuals with their formulas.
//! - `local_similarity`: second-order corrections of a step for cameras that are coupled mostly to each
//!   other.
//! - `problem`: the least-squares problem that evaluates all residuals.
//! - `retraction`: the state after a step, with the corrections of `local_similarity`.
//! - `shared_planes`: planes that views and landmarks share.
//! - `annotation_residuals`: the residuals of stage 1 in the adjustment. **The residual of a vertical line**
//!   is derived in `single/residual.rs` and evaluated here by `BundleProblem::each_annotation`.
//! - `converged`: a minimum, its covariances, and the chi-square of every outlier candidate.
//! - `reliability`: the redundancy of every observation, and the floor displacement that an undetected error causes.
//! - `refinement`: the minimum without outliers.
//! - `adjustment`: the entry point, [`BundleAdjustment::solve`], and its result.
//!
//! **The covariance of a floor point** follows from the covariance of its camera, computed in `converged` and
//! propagated by [`Camera::floor_covariance`](crate::Camera::floor_covariance).

mod landmark;
mod copies;
mod triangulation;
mod floor_alignment;
mod camera;
mod view_graph;
mod initialization;
mod parameters;
mod residuals;
mod local_similarity;
mod problem;
mod retraction;
mod shared_planes;
mod annotation_residuals;
mod converged;
mod reliability;
mod refinement;
mod adjustment;

pub use adjustment::{BundleAdjustment, BundleError, BundleSummary, CameraEstimate};
pub use camera::{BundleCamera, FixedPose, InitialPose};
pub use converged::{CrossCovariance, OutlierCandidate, PlaneEstimate};
pub use landmark::{DistanceMeasurement, Landmark, LandmarkModel, Observation};
pub use reliability::Reliability;
pub use view_graph::Component;

pub use landmark::LANDMARK_PARAMS;
pub use triangulation::{floor_disagreements, triangulate};
