//! `cargo xtask accuracy`: errors of every estimator on the same noise draws, relative to the Cramér-Rao
//! bound.

use std::process::Command;

use calib_core::{
    Annotation, Camera, Constraints, Covariance, Fit, FitOptions, Lens, Orientation, Pixel, SceneErrors,
};

use calib_core::single::{FixedParameters, paper_minimum};
use calib_demo::random::{AnnotationSet, RandomScene, SIZE};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

use crate::heavy::product::run_command;
use crate::workspace::root;

/// Number of scenes, and of noise draws per scene.
pub(crate) struct Extent {
    pub(crate) scenes: usize,
    pub(crate) draws: usize,
}

/// Table row for one estimator at one noise level: RMS errors divided by their Cramér-Rao bounds, and
/// coverage of the reported intervals.
#[derive(Default)]
struct Row {
    /// RMS errors divided by their bounds, one per scene, for roll, pitch and the logarithm of the focal
    /// length.
    ratios: [Vec<f64>; 3],
    covered: [usize; 3],
    trials: usize,
    /// Number of results whose focal length is wrong by more than 20 %.
    gross: usize,
    failed: usize,
}

type Estimator = fn(&[Annotation], &RandomScene, f64) -> Option<Camera>;

/// Names of the compared estimators, and their functions.
const ESTIMATORS: [(&str, Estimator); 3] =
    [("closed form", closed_form), ("paper's C", paper), ("maximum likelihood", maximum_likelihood)];

/// Prints the accuracy table of automatic calibration.
pub(crate) fn automatic_calibration() -> anyhow::Result<()> {
    run_tests(&[
        "proposals::rooms",
        "proposals::rendered_rooms",
        "proposals::tiled_rooms",
        "proposals::streets",
        "proposals::demonstration_has_no_gross_errors",
    ])
}

/// Prints the table of measured rotation and zoom, on images that were not used for tuning.
pub(crate) fn compare() -> anyhow::Result<()> {
    run_tests(&["compare::table_of", "--ignored"])
}

/// Prints the tables of drift detection from detections alone, and of walk tests.
pub(crate) fn watch() -> anyhow::Result<()> {
    run_tests(&["watch::table_of", "watch::false_alarms", "walk::table_of", "--ignored"])
}

/// Runs the whole-program tests that match `which`, and shows the tables that they print.
fn run_tests(which: &[&str]) -> anyhow::Result<()> {
    let mut cargo = Command::new("cargo");
    cargo.args(["test", "--quiet", "--package", "calib-tests", "--test", "whole", "--", "--nocapture"]);
    run_command(cargo.args(which).arg("--test-threads=1").current_dir(root()))
}

/// Prints the accuracy table of the estimators on simulated scenes, as Markdown.
pub(crate) fn run(extent: &Extent) {
    println!(
        "| annotations | noise px | estimator | roll | pitch | focal | focal > 20 % off | no result | 95 % covers roll, pitch, focal |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for drawn in [AnnotationSet::Directions, AnnotationSet::Lengths] {
        let mut random = ChaCha8Rng::seed_from_u64(if drawn == AnnotationSet::Directions { 1 } else { 2 });
        let scenes: Vec<RandomScene> =
            (0..extent.scenes).map(|_| RandomScene::new(&mut random, drawn, None, None)).collect();
        for noise in [0.5, 1.0, 2.0] {
            for (name, estimator) in ESTIMATORS {
                if name == "closed form" && drawn == AnnotationSet::Lengths {
                    continue;
                }
                let row = measure(&scenes, extent.draws, noise, estimator);
                print_row(drawn, noise, name, &row);
            }
        }
    }
}

fn print_row(drawn: AnnotationSet, noise: f64, name: &str, row: &Row) {
    let median = |ratios: &[f64]| {
        let mut sorted = ratios.to_vec();
        sorted.sort_by(f64::total_cmp);
        if sorted.is_empty() { f64::NAN } else { sorted[sorted.len() / 2] }
    };
    let drawn = if drawn == AnnotationSet::Directions { "1: directions" } else { "2: lengths" };
    let share = |count: usize| 100.0 * count as f64 / row.trials.max(1) as f64;
    let coverage = if row.covered == [0; 3] {
        "-".into()
    } else {
        row.covered.map(|c| format!("{:.1}", share(c))).join(", ")
    };
    let [roll, pitch, focal] = [0, 1, 2].map(|i| median(&row.ratios[i]));
    println!(
        "| {drawn} | {noise} | {name} | {roll:.2} | {pitch:.2} | {focal:.2} | {:.1} % | {:.1} % | {coverage} |",
        share(row.gross),
        share(row.failed),
    );
}

fn measure(scenes: &[RandomScene], draws: usize, noise: f64, estimator: Estimator) -> Row {
    let mut row = Row::default();
    for (index, scene) in scenes.iter().enumerate() {
        let Some(bound) = bound(scene, noise) else { continue };
        let mut square = [0.0; 3];
        let mut count = 0.0;
        for draw in 0..draws {
            let mut random = ChaCha8Rng::seed_from_u64((index * 1000 + draw) as u64);
            let annotations = scene.noisy(&mut random, noise);
            row.trials += 1;
            let Some(found) = estimator(&annotations, scene, noise) else {
                row.failed += 1;
                continue;
            };
            let error = errors(&found, &scene.camera);
            row.gross += usize::from(error[2].abs() > 0.2);
            count += 1.0;
            let sigma =
                [Covariance::ROLL, Covariance::PITCH, Covariance::FOCAL].map(|i| found.covariance.sigma(i));
            for i in 0..3 {
                square[i] += error[i] * error[i];
                let sigma = sigma[i].map(|s| if i == 2 { s / found.focal } else { s });
                row.covered[i] += usize::from(sigma.is_some_and(|s| error[i].abs() < 1.96 * s));
            }
        }
        for i in 0..3 {
            row.ratios[i].push((square[i] / count).sqrt() / bound[i]);
        }
    }
    row
}

/// Returns the errors of an estimated camera: roll and pitch in radians, and the logarithm of the focal
/// length.
fn errors(found: &Camera, truth: &Camera) -> [f64; 3] {
    [found.roll - truth.roll, found.pitch - truth.pitch, (found.focal / truth.focal).ln()]
}

/// Computes the Cramér-Rao bound of roll, pitch (radians) and log focal length. It is the standard deviation
/// that the fit predicts for noise-free lines; `noise` is in pixels.
fn bound(scene: &RandomScene, noise: f64) -> Option<[f64; 3]> {
    let found = maximum_likelihood(&scene.annotations, scene, noise)?;
    let sigma = |index| found.covariance.sigma(index);
    Some([sigma(Covariance::ROLL)?, sigma(Covariance::PITCH)?, sigma(Covariance::FOCAL)? / found.focal])
}

fn lens() -> Lens {
    Lens::pinhole(Pixel::new(0.5 * SIZE[0], 0.5 * SIZE[1]))
}

/// Estimates one camera with the default maximum-likelihood fit.
pub(crate) fn maximum_likelihood(
    annotations: &[Annotation],
    scene: &RandomScene,
    noise: f64,
) -> Option<Camera> {
    let evidence = Constraints::new(annotations, &lens(), SceneErrors::EXACT);
    let options = FitOptions { efov: &scene.efov, sigma: Some(noise), ..FitOptions::new(lens(), SIZE) };
    Some(Fit::new(&evidence, &options).ok()?.camera)
}

fn camera_at(at: Orientation, scene: &RandomScene) -> Camera {
    Camera { roll: at.roll, pitch: at.pitch, focal: at.focal, covariance: Covariance::EXACT, ..scene.camera }
}

/// Estimates one camera with the paper's criterion, minimised by Nelder-Mead.
pub(crate) fn paper(annotations: &[Annotation], scene: &RandomScene, _: f64) -> Option<Camera> {
    let evidence = Constraints::new(annotations, &lens(), SceneErrors::EXACT);
    let (at, _) = paper_minimum(&evidence, FixedParameters::default(), SIZE[0]).ok()?;
    Some(camera_at(at, scene))
}

/// Estimates one camera from two vanishing points by `f^2 = -v . h`. `f` is the focal length. `v` and `h` are
/// the vanishing points of the verticals and of the first parallel group, relative to the principal point, in
/// pixels.
fn closed_form(annotations: &[Annotation], scene: &RandomScene, _: f64) -> Option<Camera> {
    let evidence = Constraints::new(annotations, &lens(), SceneErrors::EXACT);
    let at = calib_core::single::closed_form(&evidence)?;
    Some(camera_at(at, scene))
}
