//! Annotating an image: its canvas, the loupe, and the panels of annotations, lens, results,
//! links, marks and measurements.

pub(crate) mod image;
pub(crate) mod loupe;
pub(crate) mod minimap;
pub(crate) mod result;
pub(crate) mod sigmas;
pub(crate) mod annotations;
pub(crate) mod circle;
pub(crate) mod known_values;
pub mod lens;
pub(crate) mod links;
pub(crate) mod measurements;
pub(crate) mod steps;
