//! Benchmark of the undistortion of an image of 1920 x 1080 RGB pixels, with and without a stored map.

mod measure;

use std::hint::black_box;

use calib_core::{BrownConrady, Distortion, Lens, Pixel, Undistortion};

use calib_core::floor::Crop;
use measure::{median, report};
use rand::{Rng as _, SeedableRng as _};

const SIZE: [usize; 2] = [1920, 1080];

fn view() -> Undistortion {
    let bent = BrownConrady { k1: -0.2, k2: 0.05, p1: 0.001, p2: -0.001, k3: 0.01 };
    let lens = Lens {
        principal_point: Pixel::new(960.0, 540.0),
        focal: 0.7 * 1920.0,
        distortion: Distortion::BrownConrady(bent),
        image_circle: None,
        pixel_aspect: 1.0,
    };
    Undistortion::new(&lens, SIZE[0], SIZE[1], Crop::SameFocal).expect("the lens shows the whole image")
}

/// Returns the time for each image, in milliseconds.
fn undistort(apply: impl Fn(&[u8], &mut [u8]) -> bool) -> f64 {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let image: Vec<u8> = (0..SIZE[0] * SIZE[1] * 3).map(|_| random.random()).collect();
    let mut out = vec![0; image.len()];
    1e3 * median(15, || {
        assert!(apply(black_box(&image), &mut out), "sizes match");
        black_box(&out);
    })
}

fn main() {
    let view = view();
    let kept = view.remap();
    report(&[
        ("undistort_1080p_ms", &|| undistort(|image, out| view.apply_into(image, out))),
        ("undistort_1080p_cached_ms", &|| undistort(|image, out| kept.apply_into(image, out))),
    ]);
}
