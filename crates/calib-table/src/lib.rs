//! Mapping of tables of detections to the floor, and of 3D points to pixels, in batches of Apache Arrow. Each
//! row is mapped by the calibration of its camera that is valid at its time.
//!
//! `calib project` and Python's `Site.project` call this crate between reading and writing. [`Calibrations`]
//! contains the calibrations of a site. A [`Mapping`] selects the columns and adds the results to every batch.
//!
//! Files, in the order of the data:
//! - `cast`, `json_text`: conversion of Arrow and JSON columns to numbers and text
//! - `columns`: columns of numbers and times, with the handling of invalid cells
//! - `calibrations`: selection of the calibration of each row
//! - `boxes`: columns and forms of boxes
//! - `mapping`: mapped columns of a table
//! - `sightings`: sightings of people, for drift detection
//! - `table_error`, `wording`: errors, and the style of option names in messages

mod wording;
mod table_error;
mod json_text;
mod cast;
mod columns;
mod calibrations;
mod boxes;
mod mapping;
mod sightings;

pub use boxes::{Boxes, TableBoxForm};
pub use calibrations::{CalibrationRequest, Calibrations, CameraSource, TableCamera};
pub use columns::{AtColumn, AtUnit, BadCells, BadRows, RowName};
pub use json_text::{is_json, json_field, plain};
pub use mapping::{Columns, Mapping, Rows, To};
pub use sightings::{SightingColumns, usual_at_column, usual_camera_column};
pub use table_error::TableError;
pub use wording::Wording;
