//! Detections come from a stream of another size than the still that was calibrated.

use clap::ValueEnum;

use crate::stop::Stop;

/// How the image was brought to the size of the stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Fit {
    /// Each side by itself: the stream shows the whole image and nothing else
    Stretch,
    /// Both sides alike, with equal bars on two sides, as detectors do
    Letterbox,
}

/// The stream that detections are made in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StreamSize {
    /// Width and height, in pixels.
    pub(crate) size: [u32; 2],
    /// Told where the sides are not in the proportion of the still.
    pub(crate) fit: Option<Fit>,
}

/// Where pixels of a stream lie in the still: `stream = scale still + bar`, axis by axis, from the corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stream {
    scale: [f64; 2],
    bar: [f64; 2],
}

impl Stream {
    /// The still itself.
    pub(crate) const STILL: Self = Self { scale: [1.0; 2], bar: [0.0; 2] };

    /// Of a camera's still.
    pub(crate) fn of(stream: StreamSize, still: [f64; 2], camera: &str) -> Result<Self, Stop> {
        let size = stream.size.map(f64::from);
        let scale = [size[0] / still[0], size[1] / still[1]];
        let common = scale[0].min(scale[1]);
        let bar = [0, 1].map(|axis| 0.5 * (size[axis] - common * still[axis]));
        // Scalers round to whole pixels: less than one is no bar.
        let has_bars = bar.iter().any(|bar| 2.0 * bar >= 1.0);
        match stream.fit {
            Some(Fit::Letterbox) => Ok(Self { scale: [common; 2], bar }),
            Some(Fit::Stretch) => Ok(Self { scale, bar: [0.0; 2] }),
            None if !has_bars => Ok(Self { scale, bar: [0.0; 2] }),
            None => {
                let ([w, h], [sw, sh]) = (stream.size, still);
                Err(Stop::Usage(format!(
                    "--stream-size {w}x{h}: the sides of camera \"{camera}\", {sw} x {sh} pixels, are in another \
                     proportion; say how the image was fitted, with --stream-fit stretch or --stream-fit letterbox"
                )))
            }
        }
    }

    /// A coordinate of the still from one of the stream.
    pub(crate) fn in_still(self, axis: usize, value: f64) -> f64 {
        (value - self.bar[axis]) / self.scale[axis]
    }

    /// A coordinate of the stream from one of the still.
    pub(crate) fn in_stream(self, axis: usize, value: f64) -> f64 {
        self.scale[axis] * value + self.bar[axis]
    }

    /// Pixels of the still that a pixel of the stream is, at most.
    pub(crate) fn still_pixels(self) -> f64 {
        1.0 / self.scale[0].min(self.scale[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(size: [u32; 2], fit: Option<Fit>) -> Result<Stream, Stop> {
        Stream::of(StreamSize { size, fit }, [1920.0, 1080.0], "a")
    }

    #[test]
    fn the_corners_of_the_still_are_those_of_its_picture_in_the_stream() {
        let letterbox = of([640, 640], Some(Fit::Letterbox)).unwrap_or(Stream::STILL);
        assert_eq!([letterbox.in_stream(0, 0.0), letterbox.in_stream(1, 0.0)], [0.0, 140.0]);
        assert_eq!([letterbox.in_stream(0, 1920.0), letterbox.in_stream(1, 1080.0)], [640.0, 500.0]);
        let stretch = of([640, 640], Some(Fit::Stretch)).unwrap_or(Stream::STILL);
        assert_eq!([stretch.in_stream(0, 1920.0), stretch.in_stream(1, 1080.0)], [640.0, 640.0]);
        for stream in [letterbox, stretch] {
            assert!((stream.in_still(1, stream.in_stream(1, 333.0)) - 333.0).abs() < 1e-9);
        }
        assert_eq!(letterbox.still_pixels(), 3.0);
    }

    #[test]
    fn another_proportion_is_not_guessed() {
        assert!(of([640, 360], None).is_ok());
        // Rounded to whole pixels.
        assert!(of([704, 396], None).is_ok() && of([1000, 562], None).is_ok());
        assert!(matches!(of([640, 640], None), Err(Stop::Usage(_))));
    }
}
