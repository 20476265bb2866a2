//! Stills as plain pixels.

use std::io::Cursor;

use image::{DynamicImage, ImageDecoder as _, ImageReader, RgbImage};

/// In a browser there are 4 GB at most, and a phone has less.
const IS_SMALL: bool = cfg!(target_pointer_width = "32");
/// Most memory that decoding one image may take, in bytes.
const MAX_IMAGE_BYTES: u64 = if IS_SMALL { 1 << 28 } else { 1 << 30 };

/// Turns bytes into an image, upright as its EXIF data says.
///
/// # Errors
/// When the bytes are no image, or one too large.
pub fn decode(bytes: &[u8]) -> Result<RgbImage, String> {
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| e.to_string())?;
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(MAX_IMAGE_BYTES);
    reader.limits(limits);
    let mut decoder = reader.into_decoder().map_err(|e| e.to_string())?;
    let orientation = decoder.orientation().map_err(|e| e.to_string())?;
    let mut image = DynamicImage::from_decoder(decoder).map_err(|e| e.to_string())?;
    image.apply_orientation(orientation);
    Ok(image.into_rgb8())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_image_is_an_error() {
        assert!(decode(b"not an image").is_err());
    }
}
