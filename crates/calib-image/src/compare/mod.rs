//! Comparison of two images of one camera: its rotation and zoom between them, or the reason why these are
//! unknown.
//!
//! Matched corners determine a rotation of any size to a few pixels. Edges searched near their predicted
//! positions determine it to hundredths of a pixel. The files in data-flow order:
//!
//! - `feature`: log brightness, corners and their descriptors and matches;
//! - `coarse`: the rotation and zoom common to most parts of the image;
//! - `motion`: the motion of a camera and its derivatives; `edge_sample`: samples along the edges of the old image;
//! - `turn_fit`: one rotation and zoom fitted to all edge offsets; `alignment`: iterated search and fit;
//! - `step_test`: the test for a moved camera;
//! - `window`: a digital zoom or crop instead of a rotation;
//! - `comparison`: the entry point, [`Comparison`];
//! - `transfer`: annotations transferred to the new image; `recovery`: the camera solved from them,
//!   [`recover`].

mod feature;
mod turn_fit;
mod motion;
mod coarse;
mod edge_sample;
mod alignment;
mod step_test;
mod window;
mod comparison;
mod transfer;
mod recovery;

pub use comparison::{CameraChange, Comparison, ComparisonError, SizeMismatchError, annotation_edges};
pub use recovery::{RecoveryError, recover};
pub(crate) use turn_fit::median;
pub use turn_fit::{EdgeOffset, FitParameters, RotationFit, STEP_SIZE, TONE_SIZE};
pub use window::ShownWindow;
