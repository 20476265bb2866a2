//! Stills as plain pixels.

use image::RgbImage;

/// Turns bytes into an image, upright as its EXIF data says.
///
/// # Errors
/// When the bytes are no image, or one too large.
pub fn decode(bytes: &[u8]) -> Result<RgbImage, String> {
    calib_input::decode(bytes).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_image_is_an_error() {
        assert!(decode(b"not an image").is_err());
    }
}
