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

pub(crate) use adjustment::{Across, Adjusted, Network, Suspect};
pub(crate) use landmark::{Gap, PLACE, Sighting, Thing, Tie};
pub(crate) use parameters::VIEW;
pub(crate) use problem::{Of, View};
pub(crate) use triangulation::{floor_gaps, locate};
pub(crate) use view_graph::{Component, Stand, Start, start};
