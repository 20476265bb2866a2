//! Benchmarks: one JSON object on stdout. Times are of one thread; quote ratios to the peers of one
//! run, never absolute times.

use std::hint::black_box;
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::{Context as _, bail};
use calib_core::{
    Annotation, BrownConrady, Camera, Covariance, Crop, Distortion, FloorProjector, Lens, Options, Pixel,
    Solution, Stage, Straightened, WorldPoint,
};
use calib_demo::layout::Layout;
use calib_demo::random::{Drawn, RandomScene};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::{Map, Value, json};

use crate::{accuracy, archives};

/// The key that is printed, and what measures it.
type Bench = (&'static str, fn() -> f64);

/// Every benchmark.
const BENCHES: [Bench; 8] = [
    ("pixel_to_floor_ns", || 1e9 * pixels_to_floor(Distortion::None)),
    ("distorted_pixel_to_floor_ns", || 1e9 * pixels_to_floor(bent())),
    ("undistort_1080p_ms", || 1e3 * undistort(false)),
    ("undistort_1080p_cached_ms", || 1e3 * undistort(true)),
    ("solve_option1_us", || 1e6 * solve(Drawn::Directions)),
    ("solve_option2_us", || 1e6 * solve(Drawn::Lengths)),
    ("refine_100_cameras_ms", || 1e3 * refine([10, 10])),
    ("refine_1000_cameras_ms", || 1e3 * refine([40, 25])),
];

/// What `archives` measures in one run: ratios.
const ARCHIVES: [&str; 3] =
    ["project_time_over_duckdb", "project_processor_over_duckdb", "projection_share_of_project"];
/// What the app's own program measures: it is not linked here, so that every other command of this one
/// is built without a window.
const OF_THE_APP: [&str; 4] = [
    "app_frame_16_cameras_ms",
    "app_frame_16_cameras_worst_ms",
    "app_drag_solve_ms",
    "app_pan_12_megapixels_ms",
];

/// Runs all benchmarks whose key contains `filter`.
pub(crate) fn run(filter: &str) -> anyhow::Result<()> {
    let chosen = BENCHES.iter().filter(|(key, _)| key.contains(filter));
    let mut results: Map<String, Value> =
        chosen.map(|(key, bench)| ((*key).to_owned(), json!(bench()))).collect();
    if ARCHIVES.iter().any(|key| key.contains(filter)) {
        match archives::measure() {
            Ok(ratios) => {
                let values = [ratios.time, ratios.processor, ratios.projection];
                results.extend(ARCHIVES.map(str::to_owned).into_iter().zip(values.map(|value| json!(value))));
            }
            Err(error) => eprintln!("SKIPPED {}: {error:#}", ARCHIVES.join(", ")),
        }
    }
    if OF_THE_APP.iter().any(|key| key.contains(filter)) {
        let measured = of_the_app()?;
        results.extend(measured.into_iter().filter(|(key, _)| key.contains(filter)));
    }
    println!("{}", Value::Object(results));
    Ok(())
}

/// Frames and solves of the app.
fn of_the_app() -> anyhow::Result<Map<String, Value>> {
    let arguments = ["bench", "--quiet", "--package", "calib-app", "--bench", "frame"];
    let output = Command::new("cargo").args(arguments).stderr(Stdio::inherit()).output()?;
    if !output.status.success() {
        bail!("cargo {} failed", arguments.join(" "));
    }
    serde_json::from_slice(&output.stdout).context("what the app measured is no JSON object")
}

/// Median seconds of `work` over some runs, after one to warm up.
pub(crate) fn median(runs: usize, mut work: impl FnMut()) -> f64 {
    work();
    let mut took: Vec<f64> = (0..runs)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64()
        })
        .collect();
    took.sort_by(f64::total_cmp);
    took[took.len() / 2]
}

/// The lens of `peers/time_peers.py`.
fn bent() -> Distortion {
    Distortion::BrownConrady(BrownConrady { k1: -0.2, k2: 0.05, p1: 0.001, p2: -0.001, k3: 0.01 })
}

fn camera(distortion: Distortion) -> Camera {
    let focal = 1200.0;
    Camera {
        position: WorldPoint::new(0.0, 0.0, 3.0),
        yaw: 0.0,
        pitch: 0.6,
        roll: 0.03,
        focal,
        lens: Lens { principal_point: Pixel::new(960.0, 540.0), focal, distortion },
        covariance: Covariance::EXACT,
    }
}

fn pixels_to_floor(distortion: Distortion) -> f64 {
    const COUNT: usize = 1_000_000;
    let mut random = ChaCha8Rng::seed_from_u64(0);
    let u: Vec<f64> = (0..COUNT).map(|_| random.random_range(0.0..1920.0)).collect();
    let v: Vec<f64> = (0..COUNT).map(|_| random.random_range(0.0..1080.0)).collect();
    let (mut x, mut y) = (vec![0.0; COUNT], vec![0.0; COUNT]);
    let projector = FloorProjector::new(&camera(distortion), 0.0);
    median(9, || projector.pixels_to_floor(black_box(&u), black_box(&v), &mut x, &mut y)) / COUNT as f64
}

fn undistort(cached: bool) -> f64 {
    let (width, height) = (1920, 1080);
    let lens = Lens {
        principal_point: Pixel::new(960.0, 540.0),
        focal: 0.7 * 1920.0,
        distortion: Distortion::BrownConrady(BrownConrady {
            k1: -0.2,
            k2: 0.05,
            p1: 0.001,
            p2: -0.001,
            k3: 0.01,
        }),
    };
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let image: Vec<u8> = (0..width * height * 3).map(|_| random.random()).collect();
    let mut out = vec![0; image.len()];
    let Some(view) = Straightened::new(&lens, width, height, Crop::SameFocal) else { return f64::NAN };
    let kept = view.remap();
    median(15, || {
        let image = black_box(&image);
        let done = if cached { kept.apply_into(image, &mut out) } else { view.apply_into(image, &mut out) };
        assert!(done, "sizes match");
        black_box(&out);
    })
}

/// The complete default solve of one camera: median over the medians of 15 scenes.
fn solve(drawn: Drawn) -> f64 {
    let mut random = ChaCha8Rng::seed_from_u64(700);
    let scenes: Vec<(RandomScene, Vec<Annotation>)> = (0..15)
        .map(|_| {
            let scene = RandomScene::new(&mut random, drawn, None, None);
            let noisy = scene.noisy(&mut random, 1.0);
            (scene, noisy)
        })
        .collect();
    let mut took: Vec<f64> = scenes
        .iter()
        .map(|(scene, noisy)| {
            median(50, || {
                black_box(accuracy::likelihood(black_box(noisy), scene, 1.0));
            })
        })
        .collect();
    took.sort_by(f64::total_cmp);
    took[took.len() / 2]
}

/// A hall of cameras with eight links between neighbours, calibrated whole: stage 1, the start along
/// the spanning tree, the joint fit, sigmas and quality.
fn refine(sides: [usize; 2]) -> f64 {
    let mut layout = Layout::grid(&mut ChaCha8Rng::seed_from_u64(900), sides, 8, 1.0);
    layout.place_first();
    median(3, || {
        let report = black_box(&layout.site).calibrate(&Options::default());
        let refined = |solution: &Solution| solution.stage == Stage::Refined;
        assert!(report.cameras.iter().all(|(_, solution)| solution.as_ref().is_ok_and(refined)));
    })
}
