//! The calibration that a still proposes: edges in, ordinary annotations with probabilities out, and a verdict.
//!
//! Law: edges are numbers here, with their noise; no pixel of the still is read. The files in the order of the data:
//!
//! - `frame` a camera as its vanishing points; `line` what an edge says of one; `join` broken edges made whole;
//! - `belief` what is believed of cameras;
//! - `search` vanishing points that many edges lead to, and the cameras that these allow;
//! - `mixture` the likelihood of all edges under one camera, each of one direction or of none;
//! - `bend` the distortion under which the grouping is likeliest;
//! - `lies` which edges lie on the floor;
//! - `strokes` the few edges that tell most; `drawn` these as annotations, solved as what an operator draws is;
//! - `straight` edges that the lens bends, to fit its distortion to;
//! - `verdict` whether to believe it; [`Proposal::new`] runs all of it.

mod frame;
mod join;
mod mixture;
mod search;
mod lies;
mod strokes;
mod straight;
mod still;

pub use join::joined;
pub use lies::Lies;
pub use still::{Alternative, Proposal, Reason, Still, Verdict};
pub use strokes::Group;
