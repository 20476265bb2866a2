//! Which pixels detections are of, as the command line says it.

use clap::ValueEnum;

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

impl From<PixelOrigin> for calib_core::floor::PixelOrigin {
    fn from(origin: PixelOrigin) -> Self {
        match origin {
            PixelOrigin::Corner => Self::Corner,
            PixelOrigin::Centre => Self::Centre,
        }
    }
}

impl From<Fit> for calib_core::floor::StreamFit {
    fn from(fit: Fit) -> Self {
        match fit {
            Fit::Stretch => Self::Stretch,
            Fit::Letterbox => Self::Letterbox,
        }
    }
}
