//! Automatic calibration of an image from its straight edges: annotations with probabilities, a solution, and
//! its confidence.
//!
//! Rule: edges enter as numbers with their noise; no pixel of the image is read. The files in data-flow
//! order:
//!
//! - `frame`: vanishing points of a camera;
//! - `join`: evidence of an edge for a vanishing point, and the joining of broken edges;
//! - `mixture`: the prior of cameras, and the likelihood of all edges under one camera;
//! - `search`: vanishing points, and the cameras that they allow;
//! - `curvature`: the lens, from the curvature of single edges;
//! - `edge_class`: classification of edges as on the floor or above it;
//! - `strokes`: the most informative edges as annotations, and their solution;
//! - `curved_edge`: edges curved by distortion, for fitting the lens;
//! - `quarter_turn`: rotation of the edges for cameras upside down or on their side;
//! - `confidence`: the confidence, and the reasons that reduce it;
//! - `calibration`: the entry point, [`AutomaticCalibration::new`], and the confidence.

mod frame;
mod join;
mod mixture;
mod search;
mod curvature;
mod edge_class;
mod strokes;
mod curved_edge;
mod quarter_turn;
mod confidence;
mod calibration;

pub use calibration::{Alternative, AutomaticCalibration, EdgeImage};
pub use confidence::{Confidence, Reason};
pub use edge_class::EdgeClass;
pub use join::join_edges;
pub use strokes::Group;
