//! Colours of overlays; lines on images have the same colour in the light and the dark theme.

use std::fmt;

/// Colour as red, green and blue, each from 0 to 255.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Rgb(pub [u8; 3]);

impl Rgb {
    /// Creates a colour from `0xRRGGBB`.
    #[must_use]
    pub const fn hex(rgb: u32) -> Self {
        let [_, red, green, blue] = rgb.to_be_bytes();
        Self([red, green, blue])
    }

    /// Colour of control points, marks, links, grid and horizon.
    pub const WHITE: Self = Self::hex(0xFFFFFF);
    /// Colour of a link that needs another view, and of its epipolar line.
    pub const INCOMPLETE: Self = Self::hex(0xF2DF4A);
    /// Colour of values that are unknown.
    pub const UNKNOWN: Self = Self::hex(0xFFB020);
    /// Colour of suspected outliers and gross errors.
    pub const BAD: Self = Self::hex(0xFF5470);
    /// Darker variant of [`Self::BAD`] for a light plan.
    pub const BAD_ON_LIGHT: Self = Self::hex(0xC4123A);
    /// Colour of selected and focused items.
    pub const ACCENT: Self = Self::hex(0x8E9BFF);
    /// Colour of the lens grid.
    pub const LENS: Self = Self::hex(0x8CE6FF);
    /// Colour of the outline under every line on an image, for contrast with any background.
    pub const OUTLINE: Self = Self::hex(0x07090B);
    /// Background of labels on an image.
    pub const TAG: Self = Self::hex(0x0D0F12);
    /// Colour of text and lines on a light plan.
    pub const INK: Self = Self::hex(0x1B1F23);

    /// Returns the colour of a camera, for images and dark backgrounds. With many cameras, hues become
    /// similar; always show the name of the camera too.
    #[must_use]
    pub fn camera(index: usize) -> Self {
        CAMERA_COLOURS.get(index).map_or_else(|| Self::of_hue(index, 0.7, 0.74), |[on_dark, _]| *on_dark)
    }

    /// Returns the hue of [`Self::camera`] in a darker colour, for lines on a light plan.
    #[must_use]
    pub fn camera_on_light(index: usize) -> Self {
        CAMERA_COLOURS.get(index).map_or_else(|| Self::of_hue(index, 0.7, 0.37), |[_, on_light]| *on_light)
    }

    /// Returns a colour whose hue differs from the hue of the previous index by the golden angle. Saturation
    /// and lightness are from 0 to 1.
    fn of_hue(index: usize, saturation: f64, lightness: f64) -> Self {
        /// Golden angle, as a fraction of a full turn.
        const GOLDEN_ANGLE_TURNS: f64 = 0.381_966_011_250_105;
        let hue = (index as f64 * GOLDEN_ANGLE_TURNS).fract() * 6.0;
        let chroma = (1.0 - (2.0 * lightness - 1.0).abs()) * saturation;
        // The channels peak one after the other, 120 degrees apart.
        let channel = |shift: f64| {
            let from_top = ((hue + shift).rem_euclid(6.0) - 3.0).abs() - 1.0;
            let value = lightness + chroma * (from_top.clamp(0.0, 1.0) - 0.5);
            (255.0 * value).round() as u8
        };
        Self([channel(0.0), channel(4.0), channel(2.0)])
    }
}

/// Colours of the first cameras: for images and dark backgrounds, and for light backgrounds.
const CAMERA_COLOURS: [[Rgb; 2]; 8] = [
    [Rgb::hex(0xFF9D7A), Rgb::hex(0xC4552B)],
    [Rgb::hex(0x6FE0D2), Rgb::hex(0x0F8A7A)],
    [Rgb::hex(0xC3A6FF), Rgb::hex(0x7A4FD0)],
    [Rgb::hex(0xE6DC6A), Rgb::hex(0x857300)],
    [Rgb::hex(0x8DB7FF), Rgb::hex(0x2F62C4)],
    [Rgb::hex(0xF7A1C4), Rgb::hex(0xB8437C)],
    [Rgb::hex(0xA9D66B), Rgb::hex(0x4F8010)],
    [Rgb::hex(0xD9B38C), Rgb::hex(0x8A6038)],
];

/// Formats the colour for style sheets and SVG.
impl fmt::Display for Rgb {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self([red, green, blue]) = self;
        write!(f, "#{red:02X}{green:02X}{blue:02X}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_colour_survives_formatting() {
        assert_eq!(Rgb::hex(0x0B76B8).to_string(), "#0B76B8");
    }

    #[test]
    fn no_two_cameras_share_a_colour() {
        for colour in [Rgb::camera, Rgb::camera_on_light] {
            let all: std::collections::HashSet<Rgb> = (0..64).map(colour).collect();
            assert_eq!(all.len(), 64);
        }
    }
}
