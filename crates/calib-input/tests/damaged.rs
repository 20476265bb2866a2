//! Damaged images in every format: each gives an image or an error, in a limited time.

use std::io::Cursor;
use std::time::{Duration, Instant};

use calib_input::{capture_time, decode, image_size};
use image::{DynamicImage, ImageFormat, Rgb, RgbImage};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// Number of damaged copies of each image.
const COPIES: usize = 2_000;
/// Longest accepted time for one image. Undamaged images take less than a millisecond.
const MAX_TIME: Duration = Duration::from_secs(5);

fn encoded(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    assert!(image.write_to(&mut bytes, format).is_ok(), "{format:?}");
    bytes.into_inner()
}

#[test]
fn damaged_images_are_errors() {
    let image =
        DynamicImage::ImageRgb8(RgbImage::from_fn(40, 30, |x, y| Rgb([6 * x as u8, 8 * y as u8, 90])));
    let images = [
        encoded(&image, ImageFormat::WebP),
        encoded(&image, ImageFormat::Tiff),
        encoded(&DynamicImage::ImageRgb16(image.to_rgb16()), ImageFormat::Tiff),
        encoded(&image, ImageFormat::Bmp),
        encoded(&image, ImageFormat::Gif),
        encoded(&image, ImageFormat::Png),
        encoded(&image, ImageFormat::Jpeg),
    ];
    let mut random = ChaCha8Rng::seed_from_u64(1);
    for whole in &images {
        assert!(decode(whole).is_ok());
        for copy in 0..COPIES {
            let mut bytes = whole.clone();
            for _ in 0..random.random_range(1..5) {
                // Headers are short, and damage in them is more interesting.
                let end = if random.random_range(0..2) == 0 { bytes.len().min(64) } else { bytes.len() };
                bytes[random.random_range(0..end)] = random.random();
            }
            if random.random_range(0..8) == 0 {
                bytes.truncate(random.random_range(0..bytes.len()));
            }
            let start = Instant::now();
            // The result is an image or an error; a panic fails the test.
            let _ = (image_size(&bytes), capture_time(&bytes), decode(&bytes));
            let time = start.elapsed();
            assert!(time < MAX_TIME, "{:?}, copy {copy}: {time:?}", whole.get(..4));
        }
    }
}
