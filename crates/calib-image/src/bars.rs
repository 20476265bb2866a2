//! Black bars at the sides of an image, as video players and recorders add them.
//!
//! A bar is a band of dark, uniform rows or columns from one side of the image, with a sharp straight end. The
//! picture between the bars has its own centre, near which the principal point is.

use calib_core::Pixel;
use image::RgbImage;

use crate::edges::{line_segments, pixel_brightness};
use crate::line_segment::LineSegment;

/// Thickness of the black bars at the four sides of an image, in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Bars {
    /// Width at the left side.
    pub left: u32,
    /// Width at the right side.
    pub right: u32,
    /// Height at the top.
    pub top: u32,
    /// Height at the bottom.
    pub bottom: u32,
}

/// Largest brightness of a bar, 0 to 255.
const MAX_BRIGHTNESS: u8 = 40;
/// Largest difference between the brightest and the darkest pixel of a bar; compression adds some noise.
const MAX_RANGE: u8 = 20;
/// Smallest thickness of a bar, as a fraction of the width or height of the image.
const MIN_FRACTION: f64 = 0.02;
/// Largest thickness of a bar, as a fraction of the width or height of the image.
const MAX_FRACTION: f64 = 0.45;
/// Smallest increase of the brightness from a bar to the picture at a pixel of the border between them, 0 to 255.
const MIN_STEP: u8 = 24;
/// Smallest fraction of the pixels along the border of a bar at which the brightness increases by [`MIN_STEP`].
const MIN_STEP_FRACTION: f64 = 0.25;
/// Number of rows or columns over which compression blurs the end of a bar.
const BLUR_PX: u32 = 3;

impl Bars {
    /// No bars.
    pub const NONE: Self = Self { left: 0, right: 0, top: 0, bottom: 0 };

    /// Finds the bars of an image.
    #[must_use]
    pub fn find(image: &RgbImage) -> Self {
        let (w, h) = image.dimensions();
        let grey = |x: u32, y: u32| pixel_brightness(image.get_pixel(x, y));
        Self {
            left: bar_width(w, h, grey),
            right: bar_width(w, h, |i, j| grey(w - 1 - i, j)),
            top: bar_width(h, w, |i, j| grey(j, i)),
            bottom: bar_width(h, w, |i, j| grey(j, h - 1 - i)),
        }
    }

    /// Whether the image has no bars.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self == Self::NONE
    }

    /// Whether opposite bars are equally wide to a few pixels, so that the picture is in the middle of the
    /// image.
    #[must_use]
    pub const fn are_symmetric(self) -> bool {
        self.left.abs_diff(self.right) <= 2 * BLUR_PX && self.top.abs_diff(self.bottom) <= 2 * BLUR_PX
    }

    /// Returns the centre of the picture between the bars, in raw pixels, for an image of this width and
    /// height.
    #[must_use]
    pub fn picture_centre(self, [w, h]: [u32; 2]) -> Pixel {
        let middle = |size: u32, before: u32, after: u32| {
            0.5 * (f64::from(size) + f64::from(before) - f64::from(after))
        };
        Pixel::new(middle(w, self.left, self.right), middle(h, self.top, self.bottom))
    }

    /// Returns the width and height of the picture between the bars, in pixels.
    #[must_use]
    pub const fn picture_size(self, [w, h]: [u32; 2]) -> [u32; 2] {
        [w.saturating_sub(self.left + self.right), h.saturating_sub(self.top + self.bottom)]
    }

    /// Whether a raw pixel is in the picture, beyond the blurred ends of the bars.
    #[must_use]
    pub fn is_in_picture(self, at: Pixel, [w, h]: [u32; 2]) -> bool {
        let is_inside = |at: f64, size: u32, before: u32, after: u32| {
            let margin = |bar: u32| if bar > 0 { f64::from(bar + BLUR_PX) } else { f64::NEG_INFINITY };
            at >= margin(before) && at <= f64::from(size) - margin(after)
        };
        is_inside(at.u, w, self.left, self.right) && is_inside(at.v, h, self.top, self.bottom)
    }
}

/// Messages for the operator: the width of each bar.
impl std::fmt::Display for Bars {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let sides = [("left", self.left), ("right", self.right), ("top", self.top), ("bottom", self.bottom)];
        let mut widths = sides.into_iter().filter(|(_, width)| *width > 0);
        if let Some((side, width)) = widths.next() {
            write!(f, "{side} {width} px")?;
        }
        widths.try_for_each(|(side, width)| write!(f, ", {side} {width} px"))
    }
}

/// Measurements of an image for an automatic calibration: its straight edges and its black bars.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ImageEdges {
    /// Straight edges with their standard deviations, the longest first.
    pub segments: Vec<LineSegment>,
    /// Black bars at the sides of the image.
    pub bars: Bars,
}

impl ImageEdges {
    /// Measures an image.
    #[must_use]
    pub fn measure(image: &RgbImage) -> Self {
        Self { segments: line_segments(image), bars: Bars::find(image) }
    }
}

/// Returns the width of the bar at one side. `grey(i, j)` is the brightness of pixel `j` of line `i`, counted
/// from this side; there are `depth` lines of `count` pixels.
fn bar_width(depth: u32, count: u32, grey: impl Fn(u32, u32) -> u8) -> u32 {
    let (mut low, mut high) = (u8::MAX, 0);
    let is_bar = |i: &u32| {
        let (least, most) =
            (0..count).map(|j| grey(*i, j)).fold((low, high), |(l, m), value| (l.min(value), m.max(value)));
        (low, high) = (least, most);
        most <= MAX_BRIGHTNESS && most - least <= MAX_RANGE
    };
    let width = (0..depth).take_while(is_bar).count() as u32;
    let fraction = f64::from(width) / f64::from(depth.max(1));
    if !(MIN_FRACTION..=MAX_FRACTION).contains(&fraction) {
        return 0;
    }
    let beyond = (width + BLUR_PX).min(depth - 1);
    let is_step = |j: &u32| grey(beyond, *j).saturating_sub(grey(width - 1, *j)) >= MIN_STEP;
    let steps = (0..count).filter(is_step).count() as f64;
    if steps >= MIN_STEP_FRACTION * f64::from(count) { width } else { 0 }
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    #[test]
    fn a_picture_is_found_between_its_bars() {
        let size = [320, 200];
        let image = RgbImage::from_fn(320, 200, |x, y| match x {
            0..80 => Rgb([16; 3]),
            _ => Rgb([(60 + (x * 7 + y * 3) % 150) as u8; 3]),
        });
        let bars = Bars::find(&image);
        assert_eq!(bars, Bars { left: 80, ..Bars::NONE });
        assert_eq!(bars.to_string(), "left 80 px");
        assert_eq!(bars.picture_centre(size), Pixel::new(200.0, 100.0));
        assert!(!bars.are_symmetric() && bars.picture_size(size) == [240, 200]);
        assert!(bars.is_in_picture(Pixel::new(90.0, 0.0), size));
        assert!(!bars.is_in_picture(Pixel::new(81.0, 50.0), size));
    }

    #[test]
    fn dark_images_have_no_bars() {
        let night = RgbImage::from_fn(320, 200, |x, y| {
            Rgb([if y > 80 + x / 10 { 90 } else { (10 + (x + y) % 3) as u8 }; 3])
        });
        assert!(Bars::find(&night).is_empty());
        assert!(Bars::find(&RgbImage::new(64, 48)).is_empty());
        assert!(Bars::find(&RgbImage::new(1, 1)).is_empty());
    }
}
