//! From light to the bytes of an image: tone curve, falling off to the corners, the sensor's noise.

use image::{Rgb, RgbImage};

use crate::texture::{chance, mix};
use crate::vector::{Vec3, vec3};

/// The curve of film: dark tones as they are, lights that roll off. Linear in, what the screen shows out.
pub(crate) fn tone(light: Vec3) -> Vec3 {
    const EXPOSURE: f32 = 1.28;
    // Narkowicz's fit to the reference curve of the Academy.
    let curve = |x: f32| {
        let x = x * EXPOSURE;
        ((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)).clamp(0.0, 1.0).sqrt()
    };
    let shown = light.map(curve);
    // A camera's colours are paler than paints: a part of every pixel is grey.
    Vec3::grey(shown.luminance()).towards(shown, 0.82)
}

/// The finished image.
pub(crate) fn develop(picture: &[Vec3], [width, height]: [u32; 2]) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        let colour = picture[(y * width + x) as usize];
        let (dx, dy) = ((x as f32 + 0.5) / width as f32 - 0.5, (y as f32 + 0.5) / height as f32 - 0.5);
        let corner = 1.0 - 0.22 * (dx * dx + dy * dy);
        let seed = mix(x ^ mix(y));
        let shown = colour * corner + noise(seed, colour.luminance());
        let byte = |value: f32| (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
        Rgb([byte(shown.x), byte(shown.y), byte(shown.z)])
    })
}

/// Noise of the sensor: mostly in brightness, more of it in the shadows.
fn noise(seed: u32, brightness: f32) -> Vec3 {
    let amount = 0.012 - 0.007 * brightness.clamp(0.0, 1.0);
    // The sum of three even chances is as good as a bell here.
    let bell = |s: u32| chance(seed ^ s) + chance(seed ^ (s << 8)) + chance(seed ^ (s << 16)) - 1.5;
    (Vec3::grey(bell(0x11)) + vec3(bell(0x23), bell(0x35), bell(0x47)) * 0.4) * (2.0 * amount)
}
