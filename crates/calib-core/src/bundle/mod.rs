//! Stage 2: bundle adjustment of several cameras from the landmarks that they observe in common.
//!
//! Law: no document. Cameras, landmarks and observations come as values and go as values. The files in the
//! order of the data:
//!
//! - `landmark` landmarks, observations, measured distances, and the reprojection error; `copies` which of them are
//!   there more than once, and count once; `triangulation` the
//!   place of a landmark from cameras; `floor_alignment` the similarities between floors, averaged;
//! - `camera` a camera as it enters the adjustment; `view_graph` components and gauge; `attachment`,
//!   `initialization` cameras placed along a spanning tree;
//! - `common_tilt` the lean of the floor that views share, `plane_parameters`, `shared_planes` the planes that they share;
//!   `parameters` the parameter blocks; `residuals` the list of all residuals with their formulas; `problem` the
//!   least-squares problem that evaluates them: **the residual of a vertical line** is that of stage 1
//!   (`single/residual.rs`), called by `BundleProblem::each_annotation` in
//!   `annotation_residuals`; `local_similarity`, `retraction` where a step of it leads;
//! - `marginals` covariances of cameras and landmarks; `converged` a minimum with what speaks against every
//!   candidate; `screening` several outliers at once; `refinement` the minimum without outliers; `summary` what
//!   was estimated; `adjustment` the front door: [`BundleAdjustment::solve`].
//!
//! **The sigma of a floor point** is the covariance of its camera, from `marginals`, propagated by
//! [`Camera::floor_covariance`](crate::Camera::floor_covariance).

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
mod refinement;
mod adjustment;

pub use adjustment::{BundleAdjustment, BundleError, BundleSummary, CameraEstimate};
pub use camera::{BundleCamera, HeldPose, InitialPose};
pub use converged::{CrossCovariance, OutlierCandidate, PlaneEstimate};
pub use landmark::{DistanceMeasurement, Landmark, LandmarkModel, Observation};
pub use view_graph::Component;

pub use landmark::LANDMARK_PARAMS;
pub use triangulation::{floor_disagreements, triangulate};
