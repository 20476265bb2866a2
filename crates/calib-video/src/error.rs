//! Reasons why a video is not read.

use std::fmt;

/// Reason why a video is not read.
#[derive(Debug)]
pub enum VideoError {
    /// File that cannot be read.
    Io(std::io::Error),
    /// Data that is not a video of a supported container.
    NotVideo,
    /// Damaged file, with a description of the damage.
    Broken(String),
    /// Codec that is not supported, by its name in the file.
    Codec(String),
    /// File without a video track.
    NoVideoTrack,
    /// Frame that exceeds the memory limit: width and height, in pixels.
    TooLarge([u32; 2]),
    /// Frames that need more memory than the limit.
    Memory,
    /// File with too many frames.
    TooManyFrames,
    /// No frame could be decoded.
    NoFrames,
    /// Time outside the video, in seconds.
    OutsideVideo {
        /// Requested time.
        time_s: f64,
        /// Duration of the video.
        duration_s: f64,
    },
    /// Reading stopped by the caller.
    Cancelled,
}

impl fmt::Display for VideoError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io(error) => write!(f, "cannot be read: {error}"),
            Self::NotVideo => f.write_str(
                "is not a video of a supported format (MP4, MOV, MKV, WebM, AVI); convert it, for example with \
                 `ffmpeg -i VIDEO video.mp4`",
            ),
            Self::Broken(what) => write!(f, "is damaged: {what}; copy it again from its source"),
            Self::Codec(codec) => write!(
                f,
                "uses the codec {codec}, which is not supported (H.264, H.265 and motion JPEG are); convert it, \
                 for example with `ffmpeg -i VIDEO -c:v libx264 video.mp4`"
            ),
            Self::NoVideoTrack => f.write_str("has no video track; choose another file"),
            Self::TooLarge([w, h]) => {
                write!(f, "has frames of {w} x {h} pixels, more than 64 megapixels; scale the video down")
            }
            Self::Memory => f.write_str(
                "needs more than 2 GB of memory at once; use fewer frames, or a video with more key frames",
            ),
            Self::TooManyFrames => f.write_str("has more than 10 million frames; cut a shorter clip"),
            Self::NoFrames => f.write_str("has no frame that can be decoded; try another time or another video"),
            Self::OutsideVideo { time_s, duration_s } => {
                write!(f, "lasts {duration_s:.2} s, and has no frame at {time_s:.2} s; choose an earlier time")
            }
            Self::Cancelled => f.write_str("was not read completely: cancelled"),
        }
    }
}

impl std::error::Error for VideoError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Io(error) => Some(error),
            _ => None,
        }
    }
}

impl From<std::io::Error> for VideoError {
    fn from(error: std::io::Error) -> Self {
        Self::Io(error)
    }
}
