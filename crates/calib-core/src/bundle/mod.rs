//! Stage 2: several cameras from what they observe in common.
//!
//! Law: no document. Cameras, landmarks and observations come as values and go as values.

mod landmark;
mod triangulation;
mod floor_alignment;
mod camera;
mod view_graph;
mod attachment;
mod initialization;
mod parameters;
mod residuals;
mod problem;
mod marginals;
mod refinement;
mod summary;
mod adjustment;

pub use adjustment::{BundleAdjustment, BundleError};
pub use camera::{BundleCamera, InitialPose};
pub use landmark::{DistanceMeasurement, Landmark, LandmarkModel, Observation};
pub use marginals::CrossCovariance;
pub use refinement::OutlierCandidate;
pub use summary::{BundleSummary, CameraEstimate};
pub use view_graph::Component;

pub(crate) use landmark::LANDMARK_PARAMS;
pub(crate) use triangulation::{floor_disagreements, triangulate};
