//! Image encoders for output files.

use std::path::Path;

use image::RgbImage;

use crate::stop::CommandError;

/// Encodes an image as PNG.
pub(crate) fn png(image: &RgbImage) -> Result<Vec<u8>, CommandError> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

/// Encodes an image in the format of the file name: JPEG for .jpg and .jpeg, otherwise PNG.
pub(crate) fn encode(image: &RgbImage, name: &str) -> Result<Vec<u8>, CommandError> {
    let extension = Path::new(name).extension().map(|e| e.to_string_lossy().to_lowercase());
    if matches!(extension.as_deref(), Some("jpg" | "jpeg")) { jpeg(image) } else { png(image) }
}

/// Encodes an image as JPEG, in a quality that preserves lines.
pub(crate) fn jpeg(image: &RgbImage) -> Result<Vec<u8>, CommandError> {
    /// JPEG quality, from 1 to 100.
    const QUALITY: u8 = 88;
    let mut bytes = Vec::new();
    image.write_with_encoder(image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, QUALITY))?;
    Ok(bytes)
}
