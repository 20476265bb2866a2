//! Safe reading of files and images, and output files that are written completely or not at all. The length
//! of a file and the size of an image are checked before memory is allocated; a lack of memory is an error.
//!
//! Input may come from a stranger: a pipe may never end, and an image of 600 bytes can claim four billion
//! pixels.
//!
//! Files:
//! - `file`: regular files, memory checks, JSON documents
//! - `heic`: HEIC images (feature `heic`)
//! - `still`: images as RGB pixels
//! - `clock`: capture times of images
//! - `relative`: relative paths
//! - `part`: output files

mod clock;
mod file;
#[cfg(feature = "heic")]
mod heic;
mod still;
mod relative;
#[cfg(feature = "write")]
mod part;

pub use clock::{frame_name, second_in_name, time_in_name};
pub use file::{DocumentError, FileError, OutOfMemory, check_memory, json_document, read, read_from};
#[cfg(feature = "write")]
pub use part::{PartialFile, PathError, resolve_target};
pub use relative::relative;
pub use still::{
    ImageFileError, VIDEO_ENDINGS, capture_time, check_decode_memory, decode, image_endings, image_size,
    is_image_or_video, is_video, refusal,
};
