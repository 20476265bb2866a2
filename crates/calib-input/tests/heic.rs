//! A small HEIC image, and damaged copies of it. The image was made with libheif: its pixel (x, y) has the colour
//! (2 x, 2 y, 255 - x).

#![cfg(feature = "heic")]

use calib_input::{capture_time, decode, image_size};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

const IMAGE: &[u8] = include_bytes!("gradient.heic");

#[test]
fn a_heic_image_is_decoded() {
    assert_eq!(image_size(IMAGE).ok(), Some([128, 96]));
    assert_eq!(capture_time(IMAGE).as_deref(), Some("2024-05-06T07:08:09Z"));
    let image = decode(IMAGE).unwrap_or_default();
    assert_eq!(image.dimensions(), (128, 96));
    for (x, y, pixel) in image.enumerate_pixels() {
        let expected = [2 * x as u8, 2 * y as u8, 255 - x as u8];
        let off = (0..3).map(|k| pixel.0[k].abs_diff(expected[k])).max();
        assert!(off <= Some(12), "({x}, {y}): {pixel:?}");
    }
}

#[test]
fn damaged_heic_images_are_errors() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    for _ in 0..3_000 {
        let mut bytes = IMAGE.to_vec();
        for _ in 0..random.random_range(1..4) {
            let at = random.random_range(0..bytes.len());
            bytes[at] = random.random();
        }
        if random.random_range(0..4) == 0 {
            bytes.truncate(random.random_range(0..bytes.len()));
        }
        // The result is an image or an error; a panic or a hang fails the test.
        let _ = (image_size(&bytes), capture_time(&bytes), decode(&bytes));
    }
}
