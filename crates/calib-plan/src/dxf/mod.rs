//! Lines, texts and layers of DXF drawings.
//!
//! A DXF is a list of pairs: a group code and a value. The code 0 starts a record, such as a line or a layer. The
//! reader accepts damaged pairs and unknown records, because programs write many versions of the format. It draws
//! the model space; paper space, points, images and endless lines are not drawn.
//!
//! The modules, in data-flow order:
//!
//! - `pairs`: pairs of text and binary files, grouped into records;
//! - `tables`: unit, layers and blocks;
//! - `curves`: paths of single records;
//! - `model`: visible paths and texts of the model space, with nested blocks;
//! - `sheet`: pixels of the model space, and its SVG document.

mod pairs;
mod tables;
mod curves;
mod model;
mod sheet;

pub(crate) use sheet::read;
