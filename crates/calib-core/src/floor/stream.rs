//! Map between the pixels of a stream and the pixels of the calibrated image.

use std::fmt;

/// Origin of pixel coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum PixelOrigin {
    /// Corner of the image: the centre of the first pixel is (0.5, 0.5).
    #[default]
    Corner,
    /// Centre of the first pixel: it is (0, 0).
    Centre,
}

/// Scaling of the image to the size of the stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum StreamFit {
    /// Each side is scaled separately; the stream shows the complete image and nothing else.
    Stretch,
    /// Both sides have the same scale, with equal bars on two sides, as detectors do.
    Letterbox,
}

/// Names of options in other languages.
macro_rules! named {
    ($($type:ident { $($variant:ident = $name:literal),+ })+) => {$(
        impl $type {
            /// All of them.
            pub const ALL: &[Self] = &[$(Self::$variant),+];

            /// Returns the name for programs.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)+
                }
            }

            /// Returns the option with this name.
            #[must_use]
            pub fn of_name(name: &str) -> Option<Self> {
                Self::ALL.iter().copied().find(|one| one.name() == name)
            }
        }
    )+};
}

pub(crate) use named;

named! {
    PixelOrigin { Corner = "corner", Centre = "centre" }
    StreamFit { Stretch = "stretch", Letterbox = "letterbox" }
}

/// Stream to which pixels belong: its pixel origin, and its part of the calibrated image.
///
/// The default is the image itself with the corner as origin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stream {
    /// Origin of its pixel coordinates.
    pub origin: PixelOrigin,
    /// Width and height, in pixels; `None` if they equal the size of the shown part.
    pub size: Option<[u32; 2]>,
    /// Scaling, required if the aspect ratios of the stream and of the shown part differ.
    pub fit: Option<StreamFit>,
    /// Shown part of the image: left, top, width and height, in image pixels; `None` for the whole image.
    pub crop: Option<[f64; 4]>,
}

/// Error of a stream that does not match its image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StreamError {
    /// A side of the stream is 0.
    NoSize,
    /// The aspect ratios of the stream and of the shown part differ, and the scaling is not given.
    Proportion {
        /// Size of the stream.
        size: [u32; 2],
        /// Size of the shown part.
        shown: [f64; 2],
    },
    /// The shown part is outside the image.
    Crop {
        /// Left, top, width and height.
        crop: [f64; 4],
        /// Size of the image.
        still: [f64; 2],
    },
}

impl fmt::Display for StreamError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoSize => {
                f.write_str("the size of the stream is 0; expected its width and height in pixels")
            }
            Self::Proportion { size: [w, h], shown: [sw, sh] } => {
                write!(
                    f,
                    "a stream of {w} x {h} pixels has not the proportion of the image, {sw} x {sh} pixels; "
                )?;
                if has_bars([*h, *w].map(f64::from), [*sw, *sh]) {
                    let height = f64::from(*w) * sh / sw;
                    let fits = "or say how the image was fitted: stretch or letterbox";
                    write!(f, "expected such as {w} x {height:.0}, {fits}")
                } else {
                    write!(f, "{h} x {w} has: are width and height swapped?")
                }
            }
            Self::Crop { crop: [left, top, width, height], still: [w, h] } => write!(
                f,
                "a crop of {width} x {height} pixels at ({left}, {top}) is no part of the image; expected one \
                 within {w} x {h} pixels"
            ),
        }
    }
}

impl std::error::Error for StreamError {}

/// Map from an image to a stream: `stream = scale (image - corner) + bar` for each axis, from the corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamMap {
    scale: [f64; 2],
    bar: [f64; 2],
    corner: [f64; 2],
    /// Offset from the corner of the image to the pixel origin.
    origin: f64,
}

impl Stream {
    /// Returns the map to an image of this width and height.
    ///
    /// # Errors
    /// When the size or the crop of the stream does not match the image.
    pub fn map(&self, still: [f64; 2]) -> Result<StreamMap, StreamError> {
        let [left, top, w, h] = self.crop.unwrap_or([0.0, 0.0, still[0], still[1]]);
        let is_part =
            left >= 0.0 && top >= 0.0 && w > 0.0 && h > 0.0 && left + w <= still[0] && top + h <= still[1];
        if !is_part {
            return Err(StreamError::Crop { crop: [left, top, w, h], still });
        }
        let origin = if self.origin == PixelOrigin::Centre { 0.5 } else { 0.0 };
        let map = StreamMap { origin, corner: [left, top], ..StreamMap::STILL };
        let Some(size) = self.size else { return Ok(map) };
        if size.contains(&0) {
            return Err(StreamError::NoSize);
        }
        let (shown, sides) = ([w, h], size.map(f64::from));
        let scale = [sides[0] / w, sides[1] / h];
        let (common, bar) = letterboxed(sides, shown);
        match self.fit {
            Some(StreamFit::Letterbox) => Ok(StreamMap { scale: [common; 2], bar, ..map }),
            None if has_bars(sides, shown) => Err(StreamError::Proportion { size, shown }),
            Some(StreamFit::Stretch) | None => Ok(StreamMap { scale, ..map }),
        }
    }
}

/// The scale of an image in a stream with bars, and the bars.
fn letterboxed(sides: [f64; 2], shown: [f64; 2]) -> (f64, [f64; 2]) {
    let common = (sides[0] / shown[0]).min(sides[1] / shown[1]);
    (common, [0, 1].map(|axis| 0.5 * (sides[axis] - common * shown[axis])))
}

/// Whether an image has not the proportion of a stream.
fn has_bars(sides: [f64; 2], shown: [f64; 2]) -> bool {
    // Scalers round to whole pixels: less than one is no bar.
    letterboxed(sides, shown).1.iter().any(|bar| 2.0 * bar >= 1.0)
}

impl StreamMap {
    /// Map of the image to itself, with the corner as origin.
    pub const STILL: Self = Self { scale: [1.0; 2], bar: [0.0; 2], corner: [0.0; 2], origin: 0.0 };

    /// Converts a stream coordinate to an image coordinate; axis 0 is x, axis 1 is y.
    #[inline]
    #[must_use]
    pub fn in_still(&self, axis: usize, value: f64) -> f64 {
        (value + self.origin - self.bar[axis]) / self.scale[axis] + self.corner[axis]
    }

    /// Converts an image coordinate to a stream coordinate; axis 0 is x, axis 1 is y.
    #[inline]
    #[must_use]
    pub fn in_stream(&self, axis: usize, value: f64) -> f64 {
        self.scale[axis] * (value - self.corner[axis]) + self.bar[axis] - self.origin
    }

    /// Returns the largest size of a stream pixel, in image pixels.
    #[must_use]
    pub fn still_pixels(&self) -> f64 {
        1.0 / self.scale[0].min(self.scale[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(size: [u32; 2], fit: Option<StreamFit>) -> Result<StreamMap, StreamError> {
        Stream { size: Some(size), fit, ..Stream::default() }.map([1920.0, 1080.0])
    }

    #[test]
    fn the_corners_of_the_still_are_those_of_its_picture_in_the_stream() {
        let letterbox = of([640, 640], Some(StreamFit::Letterbox)).unwrap();
        assert_eq!([letterbox.in_stream(0, 0.0), letterbox.in_stream(1, 0.0)], [0.0, 140.0]);
        assert_eq!([letterbox.in_stream(0, 1920.0), letterbox.in_stream(1, 1080.0)], [640.0, 500.0]);
        let stretch = of([640, 640], Some(StreamFit::Stretch)).unwrap();
        assert_eq!([stretch.in_stream(0, 1920.0), stretch.in_stream(1, 1080.0)], [640.0, 640.0]);
        for stream in [letterbox, stretch] {
            assert!((stream.in_still(1, stream.in_stream(1, 333.0)) - 333.0).abs() < 1e-9);
        }
        assert_eq!(letterbox.still_pixels(), 3.0);
    }

    #[test]
    fn a_crop_shows_its_part_of_the_still_at_its_own_scale() {
        let crop = Stream { crop: Some([480.0, 270.0, 960.0, 540.0]), ..Stream::default() };
        let same = crop.map([1920.0, 1080.0]).unwrap();
        assert_eq!([same.in_still(0, 0.0), same.in_still(1, 540.0)], [480.0, 810.0]);
        let half = Stream { size: Some([480, 270]), ..crop }.map([1920.0, 1080.0]).unwrap();
        assert_eq!([half.in_still(0, 480.0), half.in_stream(0, 1440.0)], [1440.0, 480.0]);
        assert_eq!(half.still_pixels(), 2.0);
        for crop in [[0.0, 0.0, 1921.0, 10.0], [-1.0, 0.0, 10.0, 10.0], [0.0, 0.0, 0.0, 10.0], [f64::NAN; 4]]
        {
            let refused = Stream { crop: Some(crop), ..Stream::default() }.map([1920.0, 1080.0]);
            assert!(matches!(refused, Err(StreamError::Crop { .. })), "{crop:?}");
        }
    }

    #[test]
    fn the_centre_of_the_first_pixel_is_half_a_pixel_of_the_stream_from_its_corner() {
        let stream = Stream { origin: PixelOrigin::Centre, size: Some([960, 540]), ..Stream::default() };
        let map = stream.map([1920.0, 1080.0]).unwrap();
        assert_eq!((map.in_still(0, 0.0), map.in_stream(1, 1.0)), (1.0, 0.0));
    }

    #[test]
    fn another_proportion_is_not_guessed() {
        assert!(of([640, 360], None).is_ok());
        // Rounded to whole pixels.
        assert!(of([704, 396], None).is_ok() && of([1000, 562], None).is_ok());
        let refused = of([640, 640], None).unwrap_err();
        assert!(refused.to_string().contains("640 x 360"), "{refused}");
        let turned = of([360, 640], None).unwrap_err().to_string();
        assert!(turned.ends_with("640 x 360 has: are width and height swapped?"), "{turned}");
        assert_eq!(of([0, 360], None), Err(StreamError::NoSize));
    }

    #[test]
    fn options_are_asked_for_by_their_names() {
        assert_eq!(PixelOrigin::of_name("centre"), Some(PixelOrigin::Centre));
        assert_eq!(
            (PixelOrigin::of_name("center"), StreamFit::of_name("stretch")),
            (None, Some(StreamFit::Stretch))
        );
    }
}
