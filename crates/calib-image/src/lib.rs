//! What is found in the pixels of a still: straight edges, an edge under a drawn line.
//!
//! Here are no files, threads, clocks or windows: whoever has them hands over pixels. Pixels are raw, with the
//! corner of the image as origin, as in `calib-core`.

mod segment;
pub mod edges;
mod pull;
pub mod proposal;

pub use edges::Edge;
pub use pull::{RADIUS, pull, pull_line};
pub use segment::to_segment;
