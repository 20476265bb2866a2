//! Still images from video files and from the addresses of cameras: single frames, and the median of several
//! frames.
//!
//! Containers: MP4 and MOV (also fragmented), Matroska and `WebM`, AVI. Codecs: H.264, H.265 and motion JPEG. Frames
//! have the same pixels as in a tracker that reads the same file: rotated as the file demands, and not scaled.
//! [`Video::pixel_aspect`] returns the aspect of these pixels.
//!
//! Rule: a file may be hostile. Sizes are checked before memory is allocated, and a panic in a library is an
//! error of the file. The modules, in data-flow order:
//!
//! - `error`: reasons why a video is not read;
//! - `stream`: codec, times and positions of the frames of a file;
//! - `mp4`, `matroska`, `avi`: streams of the three containers;
//! - `decoder`: frames of a group of packets;
//! - `video`: frames by time, and the median of frames;
//! - `address`: addresses of cameras, credentials, and errors (feature `http`);
//! - `http`, `rtsp`: snapshots by HTTP, and key frames of video streams (features `http` and `rtsp`);
//! - `snapshot`: snapshots from any address (feature `http`).

// A module uses only the modules above it.
mod error;
mod stream;
mod mp4;
mod matroska;
mod avi;
mod decoder;
mod video;
#[cfg(feature = "http")]
mod address;
#[cfg(feature = "http")]
mod http;
#[cfg(feature = "rtsp")]
mod rtsp;
#[cfg(feature = "http")]
mod snapshot;

#[cfg(feature = "http")]
pub use address::{Credentials, Snapshot, SnapshotError, SnapshotErrorKind, SnapshotOptions, is_address};
pub use error::VideoError;
#[cfg(feature = "http")]
pub use snapshot::snapshot;
pub use video::{Median, Video, is_video};
