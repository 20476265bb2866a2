//! What is opened, within limits: a file says how long it is before it is read, a still how large it is
//! before it is decoded, and memory that is not there is an error. What is written is whole, or not there.
//!
//! Files and stills come from anywhere. A pipe would be waited for without end, a device read without
//! end, and six hundred bytes can promise a picture of four thousand million pixels.

mod clock;
mod file;
mod still;
#[cfg(feature = "write")]
mod part;

pub use clock::time_in_name;
pub use file::{FileError, NotADocument, OutOfMemory, document, read, read_from, room_for};
pub use part::relative;
#[cfg(feature = "write")]
pub use part::{NoPlace, Part, place};
pub use still::{StillError, decode, room_to_decode, size_of, taken};
