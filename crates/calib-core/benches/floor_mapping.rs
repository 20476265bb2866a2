//! Benchmark of a million pixels to the floor, without distortion and with the lens of `peers.py`.

mod measure;

use std::hint::black_box;

use calib_core::{
    BrownConrady, Camera, CameraView, Covariance, Distortion, FloorProjector, Lens, Pixel, WorldPoint,
    default_efov,
};
use measure::{median, report};
use rand::{Rng as _, SeedableRng as _};

const COUNT: usize = 1_000_000;

fn camera(distortion: Distortion) -> Camera {
    let focal = 1200.0;
    Camera {
        position: WorldPoint::new(0.0, 0.0, 3.0),
        yaw: 0.0,
        pitch: 0.6,
        roll: 0.03,
        focal,
        lens: Lens {
            principal_point: Pixel::new(960.0, 540.0),
            focal,
            pixel_aspect: 1.0,
            distortion,
            image_circle: None,
        },
        covariance: Covariance::EXACT,
    }
}

/// Returns the time for each pixel, in nanoseconds.
fn pixels_to_floor(distortion: Distortion) -> f64 {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(0);
    let u: Vec<f64> = (0..COUNT).map(|_| random.random_range(0.0..1920.0)).collect();
    let v: Vec<f64> = (0..COUNT).map(|_| random.random_range(0.0..1080.0)).collect();
    let (mut x, mut y) = (vec![0.0; COUNT], vec![0.0; COUNT]);
    let projector = FloorProjector::new(&camera(distortion), 0.0);
    let all = median(9, || projector.pixels_to_floor(black_box(&u), black_box(&v), &mut x, &mut y));
    1e9 * all / COUNT as f64
}

/// Returns the time for each pixel with its status, in nanoseconds.
fn pixels_to_floor_within(distortion: Distortion) -> f64 {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(0);
    let u: Vec<f64> = (0..COUNT).map(|_| random.random_range(0.0..1920.0)).collect();
    let v: Vec<f64> = (0..COUNT).map(|_| random.random_range(0.0..1080.0)).collect();
    let (mut x, mut y, mut status) = (vec![0.0; COUNT], vec![0.0; COUNT], vec![0; COUNT]);
    let (camera, size) = (camera(distortion), [1920.0, 1080.0]);
    let view = CameraView::new(&camera, size, default_efov(&camera, size).polygon);
    let pixels = [&u[..], &v];
    let all = median(9, || view.to_floor(0.0, black_box(pixels), [&mut x, &mut y], &mut status));
    1e9 * all / COUNT as f64
}

/// Returns the time for each world point, in nanoseconds.
fn points_to_pixels(distortion: Distortion) -> f64 {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(0);
    let mut values = |range: std::ops::Range<f64>| -> Vec<f64> {
        (0..COUNT).map(|_| random.random_range(range.clone())).collect()
    };
    let [x, y, z] = [values(-3.0..3.0), values(4.0..12.0), values(0.0..2.0)];
    let (mut u, mut v, mut status) = (vec![0.0; COUNT], vec![0.0; COUNT], vec![0; COUNT]);
    let view = CameraView::new(&camera(distortion), [1920.0, 1080.0], Vec::new());
    let points = [&x[..], &y, &z];
    let all = median(9, || view.to_pixels(black_box(points), [&mut u, &mut v], &mut status));
    1e9 * all / COUNT as f64
}

/// Returns the time for the covariance of each floor point, in nanoseconds. All parameters are uncertain
/// except the principal point, which is fitted only for fisheyes.
fn floor_covariances(distortion: Distortion) -> f64 {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(0);
    let count = COUNT / 10;
    let u: Vec<f64> = (0..count).map(|_| random.random_range(0.0..1920.0)).collect();
    let v: Vec<f64> = (0..count).map(|_| random.random_range(400.0..1080.0)).collect();
    let mut camera = camera(distortion);
    for i in 0..Covariance::CENTRE {
        camera.covariance.0[i][i] = 1e-4;
    }
    let mut of = [(); 6].map(|()| vec![0.0; count]);
    let projector = FloorProjector::new(&camera, 0.0);
    let all = median(9, || {
        let [xx, xy, yy, calibration @ ..] = of.each_mut().map(|column| &mut column[..]);
        projector.floor_covariances([black_box(&u), black_box(&v)], 1.0, [[xx, xy, yy], calibration]);
    });
    1e9 * all / count as f64
}

fn main() {
    let bent = BrownConrady { k1: -0.2, k2: 0.05, p1: 0.001, p2: -0.001, k3: 0.01 };
    report(&[
        ("pixel_to_floor_ns", &|| pixels_to_floor(Distortion::None)),
        ("pixel_to_floor_with_status_ns", &|| pixels_to_floor_within(Distortion::None)),
        ("distorted_pixel_to_floor_with_status_ns", &|| {
            pixels_to_floor_within(Distortion::BrownConrady(bent))
        }),
        ("world_to_pixel_ns", &|| points_to_pixels(Distortion::None)),
        ("distorted_world_to_pixel_ns", &|| points_to_pixels(Distortion::BrownConrady(bent))),
        ("floor_covariance_ns", &|| floor_covariances(Distortion::None)),
        ("distorted_floor_covariance_ns", &|| floor_covariances(Distortion::BrownConrady(bent))),
        ("distorted_pixel_to_floor_ns", &|| pixels_to_floor(Distortion::BrownConrady(bent))),
    ]);
}
