//! The colours of what is drawn; lines on images have one colour in a light and a dark theme.

use std::fmt;

/// A colour: red, green and blue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Rgb(pub [u8; 3]);

impl Rgb {
    /// From `0xRRGGBB`.
    #[must_use]
    pub const fn hex(rgb: u32) -> Self {
        let [_, red, green, blue] = rgb.to_be_bytes();
        Self([red, green, blue])
    }

    /// Control points, marks, links, grid, horizon.
    pub const WHITE: Self = Self::hex(0xFFFFFF);
    /// A link that waits for another view, and its epipolar line.
    pub const WAITING: Self = Self::hex(0xF2DF4A);
    /// What is not known yet.
    pub const DOUBT: Self = Self::hex(0xFFB020);
    /// Suspects and gross errors.
    pub const BAD: Self = Self::hex(0xFF5470);
    /// The same, dark enough for a light plan.
    pub const BAD_ON_LIGHT: Self = Self::hex(0xC4123A);
    /// What is held or in focus.
    pub const ACCENT: Self = Self::hex(0x8E9BFF);
    /// The grid that is straight in the scene, bent by the lens.
    pub const LENS: Self = Self::hex(0x8CE6FF);
    /// Under every line on an image, so that it is legible on any ground.
    pub const OUTLINE: Self = Self::hex(0x07090B);
    /// Behind words on an image.
    pub const TAG: Self = Self::hex(0x0D0F12);
    /// Text and lines on a light plan.
    pub const INK: Self = Self::hex(0x1B1F23);

    /// The colour of a camera; hues come near each other where there are many, so it never stands without a name.
    #[must_use]
    pub fn camera(index: usize) -> Self {
        CAMERAS.get(index).map_or_else(|| Self::of_hue(index, 0.7, 0.74), |[on_dark, _]| *on_dark)
    }

    /// The same hue, dark enough for lines on a light plan.
    #[must_use]
    pub fn camera_on_light(index: usize) -> Self {
        CAMERAS.get(index).map_or_else(|| Self::of_hue(index, 0.7, 0.37), |[_, on_light]| *on_light)
    }

    /// A colour whose hue no lower index has: each turns by the golden angle from the one before.
    fn of_hue(index: usize, saturation: f64, lightness: f64) -> Self {
        const GOLDEN: f64 = 0.381_966_011_250_105;
        let hue = (index as f64 * GOLDEN).fract() * 6.0;
        let chroma = (1.0 - (2.0 * lightness - 1.0).abs()) * saturation;
        // One channel after the other is at its most, 120 degrees apart.
        let channel = |shift: f64| {
            let from_top = ((hue + shift).rem_euclid(6.0) - 3.0).abs() - 1.0;
            let value = lightness + chroma * (from_top.clamp(0.0, 1.0) - 0.5);
            (255.0 * value).round() as u8
        };
        Self([channel(0.0), channel(4.0), channel(2.0)])
    }
}

/// Of every camera: on images and dark grounds, and on light ones.
const CAMERAS: [[Rgb; 2]; 8] = [
    [Rgb::hex(0xFF9D7A), Rgb::hex(0xC4552B)],
    [Rgb::hex(0x6FE0D2), Rgb::hex(0x0F8A7A)],
    [Rgb::hex(0xC3A6FF), Rgb::hex(0x7A4FD0)],
    [Rgb::hex(0xE6DC6A), Rgb::hex(0x857300)],
    [Rgb::hex(0x8DB7FF), Rgb::hex(0x2F62C4)],
    [Rgb::hex(0xF7A1C4), Rgb::hex(0xB8437C)],
    [Rgb::hex(0xA9D66B), Rgb::hex(0x4F8010)],
    [Rgb::hex(0xD9B38C), Rgb::hex(0x8A6038)],
];

/// As style sheets and SVG write it.
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
    fn a_colour_is_written_as_it_is_read() {
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
