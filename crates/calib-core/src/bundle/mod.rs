//! Stage 2: several cameras from what they see in common.
//!
//! Law: no document. Cameras, landmarks and observations come as values and go as values.

mod landmark;
mod triangulation;
mod floor_alignment;
mod view_graph;
mod parameters;
mod problem;
mod adjustment;

pub(crate) use adjustment::{Adjustment, BundleAdjustment, CrossCovariance, OutlierCandidate};
pub(crate) use landmark::{DistanceMeasurement, LANDMARK_PARAMS, Landmark, LandmarkModel, Observation};
pub(crate) use parameters::CAMERA_PARAMS;
pub(crate) use problem::{ResidualBlock, View};
pub(crate) use triangulation::{floor_disagreements, triangulate};
pub(crate) use view_graph::{Component, InitialPose, Start, start};
