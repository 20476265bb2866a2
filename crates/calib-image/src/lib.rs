//! What is found in the pixels of a still: straight edges, the edge under a drawn line, and the calibration that
//! the edges propose; the circle that a fisheye's image fills; and what became of a camera between two stills.
//!
//! Here are no files, threads, clocks or windows: whoever has them hands over pixels. Pixels are raw, with the
//! corner of the image as origin, as in `calib-core`.
//!
//! ```
//! use calib_image::{Proposal, Still, Verdict, line_segments};
//! use image::{Rgb, RgbImage};
//!
//! let wall = RgbImage::from_fn(320, 240, |x, _| Rgb([if x < 160 { 60 } else { 180 }; 3]));
//! let still = Still::new(line_segments(&wall), [320, 240]);
//! assert_eq!(Proposal::new(&still).verdict, Verdict::None, "one edge tells no camera");
//! ```

// A file uses only those above it.
mod line_segment;
mod pull;
pub mod edges;
mod image_circle;
mod proposal;
mod compare;

pub use compare::{
    Became, Comparison, EdgeOffset, Estimated, OtherSize, Refusal, STEP, TONE, TurnFit, Uncompared,
    drawn_edges, recovered,
};
pub use edges::{Edge, line_segments};
pub use image_circle::image_circle;
pub use line_segment::{LineSegment, to_segment};
pub use proposal::{Alternative, Group, Lies, Proposal, Reason, Still, Verdict, joined};
pub use pull::{RADIUS, pull, pull_drawn, pull_line};
