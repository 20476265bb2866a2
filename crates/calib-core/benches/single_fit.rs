//! Benchmark of the complete default solve of one camera: from its lines (median over the medians of 15 rooms), and
//! from control points alone.

mod measure;

use std::hint::black_box;

use calib_core::single::{FixedParameters, PointFit, PointFitOptions};
use calib_core::{Annotation, Camera, Constraints, ControlPoint, Covariance, Fit, FitOptions, Lens};
use calib_core::{Pixel, Priors, SceneErrors, WorldPoint};
use calib_demo::random::{AnnotationSet, RandomScene, SIZE};
use measure::{median, report};
use rand::SeedableRng as _;

fn fit(annotations: &[Annotation], scene: &RandomScene) -> Option<Fit> {
    let lens = Lens::pinhole(Pixel::new(0.5 * SIZE[0], 0.5 * SIZE[1]));
    let options = FitOptions { efov: &scene.efov, sigma: Some(1.0), ..FitOptions::new(lens, SIZE) };
    Fit::new(&Constraints::new(annotations, &lens, SceneErrors::EXACT), &options).ok()
}

/// Returns the time for each solve, in microseconds.
fn solve(drawn: AnnotationSet) -> f64 {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(700);
    let scenes: Vec<(RandomScene, Vec<Annotation>)> = (0..15)
        .map(|_| {
            let scene = RandomScene::new(&mut random, drawn, None, None);
            let noisy = scene.noisy(&mut random, 1.0);
            (scene, noisy)
        })
        .collect();
    let solve = |(scene, noisy): &(RandomScene, Vec<Annotation>)| {
        median(50, || {
            black_box(fit(black_box(noisy), scene));
        })
    };
    let mut took: Vec<f64> = scenes.iter().map(solve).collect();
    took.sort_by(f64::total_cmp);
    1e6 * took[took.len() / 2]
}

/// Returns the time for each solve from control points with an unknown focal length, in microseconds.
fn solve_points(count: usize) -> f64 {
    let camera = Camera {
        position: WorldPoint::new(0.0, 0.0, 5.0),
        yaw: 0.3,
        pitch: 0.6,
        roll: 0.03,
        focal: 1300.0,
        lens: Lens::pinhole(Pixel::new(0.5 * SIZE[0], 0.5 * SIZE[1])),
        covariance: Covariance::EXACT,
    };
    // Pixels are spread over the lower part of the image, and have errors of about a pixel.
    let point = |i: usize| {
        let spread = |by: usize, of: usize| (i * by % of) as f64 / of as f64;
        let pixel = Pixel::new(150.0 + 1600.0 * spread(37, 101), 300.0 + 700.0 * spread(53, 97));
        let world = camera.pixel_to_floor(pixel, 0.0).expect("the pixel shows floor").at_height(0.0);
        let error = |by: usize| (i * by % 5) as f64 - 2.0;
        ControlPoint { world, pixel: Pixel::new(pixel.u + 0.5 * error(7), pixel.v + 0.5 * error(3)) }
    };
    let points: Vec<ControlPoint> = (0..count).map(point).collect();
    let options = PointFitOptions {
        lens: camera.lens,
        size: SIZE,
        fixed: FixedParameters::default(),
        priors: Priors::default(),
        sigma: 1.0,
        position_sigmas: &[],
    };
    let took = median(200, || {
        black_box(PointFit::new(black_box(&points), &options));
    });
    1e6 * took
}

fn main() {
    report(&[
        ("solve_option1_us", &|| solve(AnnotationSet::Directions)),
        ("solve_option2_us", &|| solve(AnnotationSet::Lengths)),
        ("solve_4_points_us", &|| solve_points(4)),
        ("solve_20_points_us", &|| solve_points(20)),
    ]);
}
