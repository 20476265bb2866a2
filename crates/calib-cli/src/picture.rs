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

/// Returns whether an image is written as JPEG under this file name: JPEG for .jpg and .jpeg; PNG for .png, for names
/// without an extension, and for the standard output.
///
/// # Errors
/// If the name has another extension. The content of the file would not match its name.
pub(crate) fn is_jpeg_name(name: &str) -> Result<bool, CommandError> {
    let extension = Path::new(name).extension().map(|extension| extension.to_string_lossy().to_lowercase());
    match extension.as_deref() {
        Some("jpg" | "jpeg") => Ok(true),
        Some("png") | None => Ok(false),
        Some(_) => {
            Err(CommandError::Usage(format!("{name}: expected a file name that ends in .png or .jpg")))
        }
    }
}

/// Encodes an image in the format of the file name.
pub(crate) fn encode(image: &RgbImage, name: &str) -> Result<Vec<u8>, CommandError> {
    if is_jpeg_name(name)? { jpeg(image) } else { png(image) }
}

/// Encodes an image as JPEG, with a quality that preserves lines.
pub(crate) fn jpeg(image: &RgbImage) -> Result<Vec<u8>, CommandError> {
    /// JPEG quality, from 1 to 100.
    const QUALITY: u8 = 88;
    let mut bytes = Vec::new();
    image.write_with_encoder(image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, QUALITY))?;
    Ok(bytes)
}
