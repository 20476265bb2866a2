//! Benchmark of a complete calibration: a grid of cameras with eight links between neighbours. It covers
//! stage 1, initial poses along the spanning tree, joint refinement, uncertainties and quality.

#[path = "../../calib-core/benches/measure/mod.rs"]
mod measure;

use std::hint::black_box;

use calib_demo::layout::Layout;
use calib_site::{Options, Solution, Stage};
use measure::{median, report};
use rand::SeedableRng as _;

/// Measures the seconds to calibrate a grid of cameras, as the median of several runs.
fn refine_seconds(sides: [usize; 2], runs: usize) -> f64 {
    let mut layout = Layout::grid(&mut rand_chacha::ChaCha8Rng::seed_from_u64(900), sides, 8, 1.0);
    layout.place_first();
    median(runs, || {
        let report = black_box(&layout.site).calibrate(&Options::default());
        let refined = |solution: &Solution| solution.stage == Stage::Refined;
        assert!(report.cameras.iter().all(|(_, solution)| solution.as_ref().is_ok_and(refined)));
    })
}

fn main() {
    report(&[
        ("refine_100_cameras_ms", &|| 1e3 * refine_seconds([10, 10], 5)),
        ("refine_1000_cameras_ms", &|| 1e3 * refine_seconds([40, 25], 3)),
        ("refine_10000_cameras_s", &|| refine_seconds([125, 80], 1)),
    ]);
}
