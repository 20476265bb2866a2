//! Tables of pixels to the floor, and of points of space to pixels, batch by batch: every row by its camera, and by the
//! calibration that held at its time.
//!
//! This is what `calib project` and `Site.project` of Python do between reading and writing: [`Calibrations`] are those
//! of a site, a [`Mapping`] says which columns are mapped and how, and gives every batch of Arrow its new columns.

mod wording;
mod table_error;
mod json_text;
mod cast;
mod columns;
mod calibrations;
mod mapping;
mod sightings;

pub use calibrations::{ByCamera, Calibrations, TableCamera, Wanted};
pub use columns::{AtColumn, AtUnit, BadCells, BadRows, Place};
pub use json_text::{is_json, json_field, plain};
pub use mapping::{Columns, Mapping, Rows, To};
pub use sightings::{SightingColumns, usual_at_column, usual_camera_column};
pub use table_error::TableError;
pub use wording::Wording;
