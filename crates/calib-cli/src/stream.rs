//! Which pixels detections are of, as the command line says it.

use calib_core::{Stream, StreamError, StreamMap};
use clap::ValueEnum;

use crate::stop::Stop;

/// Where pixels are counted from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum PixelOrigin {
    /// From the corner of the image: the centre of the first pixel is (0.5, 0.5)
    Corner,
    /// From the centre of the first pixel, which is (0, 0)
    Centre,
}

/// How the image was brought to the size of the stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Fit {
    /// Each side by itself: the stream shows the whole image and nothing else
    Stretch,
    /// Both sides alike, with equal bars on two sides, as detectors do
    Letterbox,
}

impl From<PixelOrigin> for calib_core::PixelOrigin {
    fn from(origin: PixelOrigin) -> Self {
        match origin {
            PixelOrigin::Corner => Self::Corner,
            PixelOrigin::Centre => Self::Centre,
        }
    }
}

impl From<Fit> for calib_core::StreamFit {
    fn from(fit: Fit) -> Self {
        match fit {
            Fit::Stretch => Self::Stretch,
            Fit::Letterbox => Self::Letterbox,
        }
    }
}

/// Where the pixels of a stream lie in the still of a camera.
pub(crate) fn map_of(stream: &Stream, still: [f64; 2], camera: &str) -> Result<StreamMap, Stop> {
    stream.map(still).map_err(|why| match why {
        StreamError::Proportion { size: [w, h], shown: [sw, sh] } => Stop::Usage(format!(
            "--stream-size {w}x{h}: the sides of camera \"{camera}\", {sw} x {sh} pixels, are in another proportion; \
             say how the image was fitted, with --stream-fit stretch or --stream-fit letterbox"
        )),
        other => Stop::Usage(format!("--stream-size: {other}")),
    })
}
