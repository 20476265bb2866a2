//! Pictures as files.

use std::path::Path;

use image::RgbImage;

use crate::stop::Stop;

/// An image as PNG bytes.
pub(crate) fn png(image: &RgbImage) -> Result<Vec<u8>, Stop> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, image::ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

/// An image in the format that the name of a file asks for: JPEG for .jpg and .jpeg, else PNG.
pub(crate) fn encoded(image: &RgbImage, name: &str) -> Result<Vec<u8>, Stop> {
    let extension = Path::new(name).extension().map(|e| e.to_string_lossy().to_lowercase());
    if matches!(extension.as_deref(), Some("jpg" | "jpeg")) { jpeg(image) } else { png(image) }
}

/// An image as JPEG bytes, good enough to judge lines by.
pub(crate) fn jpeg(image: &RgbImage) -> Result<Vec<u8>, Stop> {
    const QUALITY: u8 = 88;
    let mut bytes = Vec::new();
    image.write_with_encoder(image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, QUALITY))?;
    Ok(bytes)
}
