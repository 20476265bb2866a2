//! Map between the pixels of a video stream and the calibrated image.

use std::fmt;

/// Origin of pixel coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum PixelOrigin {
    /// Corner of the image: the centre of the first pixel is (0.5, 0.5).
    #[default]
    Corner,
    /// Centre of the first pixel, which is (0, 0).
    Centre,
}

impl PixelOrigin {
    /// Returns the distance of the origin from the corner of the image in x and y, in pixels: 0 or 0.5.
    #[must_use]
    pub const fn offset(self) -> f64 {
        match self {
            Self::Corner => 0.0,
            Self::Centre => 0.5,
        }
    }
}

/// Scaling of the image to the size of the stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum StreamFit {
    /// Separate scales for width and height: the image fills the stream without bars.
    Stretch,
    /// Common scale for width and height, with equal bars on two sides (letterboxing of detectors).
    Letterbox,
}

/// Implements the names of the values of an option, as used in other languages.
macro_rules! named {
    ($($type:ident { $($variant:ident = $name:literal),+ })+) => {$(
        impl $type {
            /// All values of the option.
            pub const ALL: &[Self] = &[$(Self::$variant),+];

            /// Returns the name of the value in other languages.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)+
                }
            }

            /// Returns the value with this name; `None` for an unknown name.
            #[must_use]
            pub fn from_name(name: &str) -> Option<Self> {
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

/// Stream of a camera: its pixel origin, its size and the part of the calibrated image that it shows.
///
/// The default is the calibrated image itself, with coordinates from its corner.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stream {
    /// Origin of the pixel coordinates.
    pub origin: PixelOrigin,
    /// Width and height, in pixels; `None` if they equal the visible part of the calibrated image.
    pub size: Option<[u32; 2]>,
    /// Scaling; required if the aspect ratio differs from the visible part of the calibrated image.
    pub fit: Option<StreamFit>,
    /// Visible part of the calibrated image: left, top, width and height, in its pixels; `None` for the whole
    /// image.
    pub crop: Option<[f64; 4]>,
}

/// Reason why the pixels of a stream cannot be mapped to the calibrated image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StreamError {
    /// A side of the stream is 0.
    NoSize,
    /// The aspect ratio of the stream differs from the visible part, and the scaling is not specified.
    Proportion {
        /// Size of the stream, in pixels.
        size: [u32; 2],
        /// Size of the visible part, in pixels.
        shown: [f64; 2],
    },
    /// The crop is not inside the calibrated image.
    Crop {
        /// Left, top, width and height of the crop, in pixels.
        crop: [f64; 4],
        /// Size of the calibrated image, in pixels.
        still: [f64; 2],
    },
}

impl fmt::Display for StreamError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoSize => f.write_str("the width or height of the stream is 0; expected both in pixels"),
            Self::Proportion { size: [w, h], shown: [sw, sh] } => {
                write!(
                    f,
                    "a stream of {w} x {h} pixels does not have the aspect ratio of the image, {sw} x {sh} pixels; "
                )?;
                if has_bars([*h, *w].map(f64::from), [*sw, *sh]) {
                    let height = f64::from(*w) * sh / sw;
                    let fits = "or the fit \"stretch\" or \"letterbox\"";
                    write!(f, "expected a size like {w} x {height:.0}, {fits}")
                } else {
                    write!(f, "width and height seem to be swapped: {h} x {w} fits")
                }
            }
            Self::Crop { crop: [left, top, width, height], still: [w, h] } => write!(
                f,
                "a crop of {width} x {height} pixels at ({left}, {top}) is not inside the image; expected one \
                 within {w} x {h} pixels"
            ),
        }
    }
}

impl std::error::Error for StreamError {}

/// Map between a stream and the calibrated image: `stream = scale (image - corner) + bar - origin`, for each
/// axis. `corner` is the upper left corner of the visible part, in pixels of the calibrated image. `bar` is
/// the width of a letterbox bar, in stream pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamMap {
    /// Stream pixels for each pixel of the calibrated image, in x and y.
    scale: [f64; 2],
    /// Width of the bar on the left and at the top, in stream pixels.
    bar: [f64; 2],
    /// Upper left corner of the visible part, in pixels of the calibrated image.
    corner: [f64; 2],
    /// Offset of the pixel origin from the corner of the stream image, in stream pixels: 0 or 0.5.
    origin: f64,
}

impl Stream {
    /// Returns the map to a calibrated image of this width and height.
    ///
    /// # Errors
    /// If the size of the stream, or its crop, does not match the size of the calibrated image.
    pub fn map(&self, still: [f64; 2]) -> Result<StreamMap, StreamError> {
        let [left, top, w, h] = self.crop.unwrap_or([0.0, 0.0, still[0], still[1]]);
        let is_part =
            left >= 0.0 && top >= 0.0 && w > 0.0 && h > 0.0 && left + w <= still[0] && top + h <= still[1];
        if !is_part {
            return Err(StreamError::Crop { crop: [left, top, w, h], still });
        }
        let map = StreamMap { origin: self.origin.offset(), corner: [left, top], ..StreamMap::STILL };
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

/// Returns the common scale of an image of size `shown` in a stream of size `sides`. Also returns the width
/// of one bar in x and y, in stream pixels.
fn letterboxed(sides: [f64; 2], shown: [f64; 2]) -> (f64, [f64; 2]) {
    let common = (sides[0] / shown[0]).min(sides[1] / shown[1]);
    (common, [0, 1].map(|axis| 0.5 * (sides[axis] - common * shown[axis])))
}

/// Whether the aspect ratio of an image of size `shown` differs from that of a stream of size `sides`.
fn has_bars(sides: [f64; 2], shown: [f64; 2]) -> bool {
    // Scalers round to whole pixels: less than one pixel is not a bar.
    letterboxed(sides, shown).1.iter().any(|bar| 2.0 * bar >= 1.0)
}

impl StreamMap {
    /// Map of the calibrated image itself, with coordinates from its corner.
    pub const STILL: Self = Self { scale: [1.0; 2], bar: [0.0; 2], corner: [0.0; 2], origin: 0.0 };

    /// Maps a stream coordinate to the calibrated image. Axis 0 is x, axis 1 is y.
    #[inline]
    #[must_use]
    pub fn to_image(&self, axis: usize, value: f64) -> f64 {
        (value + self.origin - self.bar[axis]) / self.scale[axis] + self.corner[axis]
    }

    /// Maps a stream coordinate to the calibrated image, as [`Self::to_image`] does. The coordinate counts from the
    /// corner of the stream for either pixel origin.
    #[inline]
    #[must_use]
    pub fn corner_to_image(&self, axis: usize, value: f64) -> f64 {
        self.to_image(axis, value - self.origin)
    }

    /// Maps a coordinate of the calibrated image to the stream. Axis 0 is x, axis 1 is y.
    #[inline]
    #[must_use]
    pub fn to_stream(&self, axis: usize, value: f64) -> f64 {
        self.scale[axis] * (value - self.corner[axis]) + self.bar[axis] - self.origin
    }

    /// Returns the largest size of a stream pixel, in pixels of the calibrated image.
    #[must_use]
    pub fn max_pixel_size(&self) -> f64 {
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
    fn image_corners_map_to_its_corners_in_the_stream() {
        let letterbox = of([640, 640], Some(StreamFit::Letterbox)).unwrap();
        assert_eq!([letterbox.to_stream(0, 0.0), letterbox.to_stream(1, 0.0)], [0.0, 140.0]);
        assert_eq!([letterbox.to_stream(0, 1920.0), letterbox.to_stream(1, 1080.0)], [640.0, 500.0]);
        let stretch = of([640, 640], Some(StreamFit::Stretch)).unwrap();
        assert_eq!([stretch.to_stream(0, 1920.0), stretch.to_stream(1, 1080.0)], [640.0, 640.0]);
        for stream in [letterbox, stretch] {
            assert!((stream.to_image(1, stream.to_stream(1, 333.0)) - 333.0).abs() < 1e-9);
        }
        assert_eq!(letterbox.max_pixel_size(), 3.0);
    }

    #[test]
    fn crop_maps_to_its_part_of_the_image() {
        let crop = Stream { crop: Some([480.0, 270.0, 960.0, 540.0]), ..Stream::default() };
        let same = crop.map([1920.0, 1080.0]).unwrap();
        assert_eq!([same.to_image(0, 0.0), same.to_image(1, 540.0)], [480.0, 810.0]);
        let half = Stream { size: Some([480, 270]), ..crop }.map([1920.0, 1080.0]).unwrap();
        assert_eq!([half.to_image(0, 480.0), half.to_stream(0, 1440.0)], [1440.0, 480.0]);
        assert_eq!(half.max_pixel_size(), 2.0);
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
        assert_eq!((map.to_image(0, 0.0), map.to_stream(1, 1.0)), (1.0, 0.0));
    }

    #[test]
    fn unknown_fit_of_other_aspect_ratio_is_rejected() {
        assert!(of([640, 360], None).is_ok());
        // Rounded to whole pixels.
        assert!(of([704, 396], None).is_ok() && of([1000, 562], None).is_ok());
        let refused = of([640, 640], None).unwrap_err();
        assert!(refused.to_string().contains("640 x 360"), "{refused}");
        let turned = of([360, 640], None).unwrap_err().to_string();
        assert!(turned.ends_with("width and height seem to be swapped: 640 x 360 fits"), "{turned}");
        assert_eq!(of([0, 360], None), Err(StreamError::NoSize));
    }

    #[test]
    fn options_have_names() {
        assert_eq!(PixelOrigin::from_name("centre"), Some(PixelOrigin::Centre));
        assert_eq!(
            (PixelOrigin::from_name("center"), StreamFit::from_name("stretch")),
            (None, Some(StreamFit::Stretch))
        );
    }
}
