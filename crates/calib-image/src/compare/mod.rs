//! Two stills of one camera compared: how it turned and zoomed between them, or why that is not known.
//!
//! Corners that look the same tell a turn of any size to a few pixels; edges that are looked for where it tells them, tell
//! it to hundredths. The files in the order of the data:
//!
//! - `luma` brightness on a scale that light and exposure shift; `feature` corners found again; `coarse` the turn that most
//!   parts of the image agree on;
//! - `place` places along the edges of the old still; `search` such a place in the new one; `alignment` all of them, pass
//!   by pass; `motion` what it is told by; `stepped` whether the camera stands elsewhere; `comparison` the front door: [`Comparison`]; `carry` what was drawn, on the new still; `recovery` the camera
//!   solved from it: [`recovered`]. `edge_offset`, `turn_equations`, `turn_fit` fit one rotation and zoom to all edge offsets.

mod feature;
mod turn_fit;
mod motion;
mod coarse;
mod place;
mod alignment;
mod stepped;
mod comparison;
mod carry;
mod recovery;

pub use comparison::{Became, Comparison, OtherSize, Uncompared, drawn_edges};
pub use recovery::{Refusal, recovered};
pub use turn_fit::{EdgeOffset, Estimated, STEP, TONE, TurnFit};
