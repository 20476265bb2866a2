//! Benchmark of the complete default solve of one camera from its lines: median over the medians of 15 rooms.

mod measure;

use std::hint::black_box;

use calib_core::{Annotation, Constraints, Fit, FitOptions, Lens, Pixel, SceneErrors};
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

fn main() {
    report(&[
        ("solve_option1_us", &|| solve(AnnotationSet::Directions)),
        ("solve_option2_us", &|| solve(AnnotationSet::Lengths)),
    ]);
}
