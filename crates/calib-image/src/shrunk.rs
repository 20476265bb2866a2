//! Smaller copies of images.

use image::RgbImage;

/// Returns a smaller copy of an image whose longer side is above `max_side` pixels; `None` for other images.
#[must_use]
pub fn shrunk(image: &RgbImage, max_side: u32) -> Option<RgbImage> {
    let (width, height) = image.dimensions();
    let scale = f64::from(max_side) / f64::from(width.max(height));
    let [width, height] = [width, height].map(|side| ((f64::from(side) * scale).round() as u32).max(1));
    (scale < 1.0).then(|| image::imageops::thumbnail(image, width, height))
}
