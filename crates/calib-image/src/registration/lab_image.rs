//! Small image in CIE Lab, with normalised white.

use calib_core::Pixel;
use image::RgbImage;

use crate::registration::local_view::{LocalView, View};

/// Width of the small image, in pixels.
pub(crate) const WIDTH_PX: usize = 480;
/// Factor of the lightness. Shading and exposure change the lightness more than the hue.
const LIGHTNESS_FACTOR: f32 = 0.4;
/// Largest brightness of a pixel outside an unknown image circle, 0 to 255.
const MAX_BLACK: f32 = 16.0;

/// Image scaled to [`WIDTH_PX`], in CIE Lab.
#[derive(Clone, Debug)]
pub(crate) struct LabImage {
    /// Width and height, in pixels.
    pub(crate) size: [usize; 2],
    /// Colours (reduced L, a, b), row by row.
    pub(crate) colours: Vec<[f32; 3]>,
    /// Whether each pixel shows the scene.
    pub(crate) is_visible: Vec<bool>,
    /// Pixels of this image per pixel of the calibrated size.
    pub(crate) scale: f64,
}

impl LabImage {
    /// Scales an image, normalises its white and converts it to CIE Lab.
    pub(crate) fn new(View { image, size_px, .. }: &View, local: &LocalView) -> Self {
        let scale = WIDTH_PX as f64 / f64::from(size_px[0].max(1));
        let height = ((f64::from(size_px[1]) * scale).round() as usize).max(1);
        let size = [WIDTH_PX, height];
        let mut rgb = resize(image, size);
        let is_shown = |(index, rgb): (usize, &[f32; 3])| {
            let [x, y] = [index % WIDTH_PX, index / WIDTH_PX].map(|i| (i as f64 + 0.5) / scale);
            let is_black = rgb.iter().all(|&level| level <= MAX_BLACK);
            local.shows(Pixel::new(x, y)) && !(local.is_black_hidden && is_black)
        };
        let is_visible: Vec<bool> = rgb.iter().enumerate().map(is_shown).collect();
        normalise_white(&mut rgb, &is_visible);
        Self { size, colours: rgb.into_iter().map(lab_from_srgb).collect(), is_visible, scale }
    }

    /// Returns the colours after a Gaussian blur with standard deviation `sigma`, in pixels. Hidden pixels are ignored.
    pub(crate) fn blurred(&self, sigma: f32) -> Vec<[f32; 3]> {
        let radius = (3.0 * sigma).ceil() as isize;
        let kernel: Vec<(isize, f32)> =
            (-radius..=radius).map(|i| (i, (-0.5 * (i as f32 / sigma).powi(2)).exp())).collect();
        // The fourth value is the weight of the visible pixels.
        let weighted: Vec<[f32; 4]> = (self.colours.iter().zip(&self.is_visible))
            .map(|(&[l, a, b], &is_visible)| if is_visible { [l, a, b, 1.0] } else { [0.0; 4] })
            .collect();
        let rows = convolve(&weighted, self.size, &kernel, [1, 0]);
        let sums = convolve(&rows, self.size, &kernel, [0, 1]);
        sums.iter().map(|[l, a, b, weight]| [l, a, b].map(|sum| sum / weight.max(1e-6))).collect()
    }

    /// Returns the colours of the visible pixels.
    pub(crate) fn visible(&self) -> impl Iterator<Item = &[f32; 3]> {
        self.colours.iter().zip(&self.is_visible).filter(|(_, is_visible)| **is_visible).map(|(lab, _)| lab)
    }
}

/// Returns the sums of shifted pixels, weighted by the kernel. `step` is the direction of the shifts.
fn convolve(
    pixels: &[[f32; 4]],
    [width, height]: [usize; 2],
    kernel: &[(isize, f32)],
    step: [isize; 2],
) -> Vec<[f32; 4]> {
    let sum = |index: usize| {
        let [x, y] = [index % width, index / width];
        let mut sum = [0.0; 4];
        for &(shift, weight) in kernel {
            let at = [x.checked_add_signed(shift * step[0]), y.checked_add_signed(shift * step[1])];
            let [Some(x), Some(y)] = at else { continue };
            if x < width && y < height {
                let pixel = &pixels[y * width + x];
                (0..4).for_each(|i| sum[i] += weight * pixel[i]);
            }
        }
        sum
    };
    (0..pixels.len()).map(sum).collect()
}

/// Returns, for each of `count` equal parts of a row or column, the source pixels that it covers, with
/// weights of sum 1.
fn coverage(length: usize, count: usize) -> Vec<Vec<(usize, f32)>> {
    let step = length as f64 / count as f64;
    let part = |i: usize| {
        let (from, to) = (i as f64 * step, (i as f64 + 1.0) * step);
        let last = (to.ceil() as usize).min(length);
        let weight = |j: usize| ((to.min(j as f64 + 1.0) - from.max(j as f64)) / step) as f32;
        (from as usize..last).map(|j| (j, weight(j))).filter(|(_, weight)| *weight > 0.0).collect()
    };
    (0..count).map(part).collect()
}

/// Scales an image: each new pixel is the mean of the area that it covers.
fn resize(image: &RgbImage, [width, height]: [usize; 2]) -> Vec<[f32; 3]> {
    let [w, h] = [image.width(), image.height()].map(|side| side as usize);
    let (columns, rows) = (coverage(w, width), coverage(h, height));
    let mut result = vec![[0.0; 3]; width * height];
    for (y, row) in rows.iter().enumerate() {
        let line = &mut result[y * width..(y + 1) * width];
        for &(source, by) in row {
            let pixels = &image.as_raw()[3 * w * source..3 * w * (source + 1)];
            for (sum, column) in line.iter_mut().zip(&columns) {
                for &(x, weight) in column {
                    let weight = weight * by;
                    (0..3).for_each(|c| sum[c] += weight * f32::from(pixels[3 * x + c]));
                }
            }
        }
    }
    result
}

/// Scales each colour channel so that the brightest surfaces are equally white in all images. Cameras differ
/// in their exposure and white balance.
fn normalise_white(rgb: &mut [[f32; 3]], is_visible: &[bool]) {
    /// Quantile of a channel that counts as white.
    const QUANTILE: f64 = 0.85;
    /// Value of white after the normalisation, 0 to 255.
    const WHITE: f32 = 215.0;
    /// Smallest sum of the channels of a pixel that is not black.
    const MIN_SUM: f32 = 40.0;
    for channel in 0..3 {
        let is_used =
            |(rgb, is_visible): &(&[f32; 3], &bool)| **is_visible && rgb.iter().sum::<f32>() > MIN_SUM;
        let mut levels: Vec<f32> =
            rgb.iter().zip(is_visible).filter(is_used).map(|(rgb, _)| rgb[channel]).collect();
        let rank = (QUANTILE * levels.len() as f64) as usize;
        if rank >= levels.len() {
            continue;
        }
        let (_, white, _) = levels.select_nth_unstable_by(rank, f32::total_cmp);
        let gain = (WHITE / white.max(1.0)).clamp(0.5, 8.0);
        rgb.iter_mut().for_each(|rgb| rgb[channel] = (rgb[channel] * gain).min(255.0));
    }
}

/// Converts an sRGB colour, 0 to 255, to CIE Lab (D65) with reduced lightness.
fn lab_from_srgb(rgb: [f32; 3]) -> [f32; 3] {
    let [r, g, b] = rgb.map(|level| {
        let level = level / 255.0;
        if level <= 0.04045 { level / 12.92 } else { ((level + 0.055) / 1.055).powf(2.4) }
    });
    let root = |t: f32| if t > 0.008_856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 };
    let x = root((0.412_453 * r + 0.357_580 * g + 0.180_423 * b) / 0.950_456);
    let y = root(0.212_671 * r + 0.715_160 * g + 0.072_169 * b);
    let z = root((0.019_334 * r + 0.119_193 * g + 0.950_227 * b) / 1.088_754);
    [LIGHTNESS_FACTOR * (116.0 * y - 16.0), 500.0 * (x - y), 200.0 * (y - z)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lab_of_known_colours_is_correct() {
        let near = |rgb: [f32; 3], lab: [f32; 3]| {
            let found = lab_from_srgb(rgb);
            assert!(found.iter().zip(lab).all(|(a, b)| (a - b).abs() < 0.3), "{found:?} {lab:?}");
        };
        near([255.0; 3], [40.0, 0.0, 0.0]);
        near([0.0; 3], [0.0; 3]);
        near([255.0, 0.0, 0.0], [0.4 * 53.24, 80.09, 67.20]);
    }

    #[test]
    fn a_blur_keeps_a_uniform_colour_and_ignores_hidden_pixels() {
        let is_visible: Vec<bool> = (0..200).map(|index| index % 3 > 0).collect();
        let colour = |&is_visible: &bool| if is_visible { [30.0, -4.0, 9.0] } else { [0.0; 3] };
        let colours = is_visible.iter().map(colour).collect();
        let image = LabImage { size: [20, 10], colours, is_visible, scale: 1.0 };
        let blurred = image.blurred(1.5);
        assert!(
            blurred.iter().flatten().zip([30.0, -4.0, 9.0].iter().cycle()).all(|(a, b)| (a - b).abs() < 1e-4)
        );
    }

    #[test]
    fn scaling_preserves_the_mean_in_both_directions() {
        let image = RgbImage::from_fn(70, 50, |x, y| image::Rgb([(3 * x) as u8, (4 * y) as u8, 90]));
        for size in [[30, 20], [200, 110]] {
            let small = resize(&image, size);
            let mean = |c: usize| small.iter().map(|rgb| f64::from(rgb[c])).sum::<f64>() / small.len() as f64;
            let found = [0, 1, 2].map(mean);
            assert!((found[0] - 103.5).abs() < 0.1 && (found[1] - 98.0).abs() < 0.1, "{found:?}");
            assert!((found[2] - 90.0).abs() < 0.01);
        }
    }
}
