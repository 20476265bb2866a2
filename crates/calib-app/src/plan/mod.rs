//! The floor plan: painting it, placing cameras on it, planes, distances, and the agreement of cameras.

pub(crate) mod mesh;
pub(crate) mod coverage;
pub mod floor;
pub(crate) mod drawing_fields;
pub mod placement;
pub mod agreement;
pub(crate) mod planes;
pub(crate) mod survey;
pub(crate) mod distances;
pub(crate) mod ground_points;
pub(crate) mod north;
