//! The table of accuracy: every estimator on the same draws, beside the Cramér-Rao bound.

use std::process::Command;

use calib_core::{
    Annotation, Camera, Constraints, Covariance, Fit, FitOptions, Lens, Orientation, Pixel, SceneErrors,
};

use calib_core::single::{FixedParameters, paper_minimum};
use calib_demo::random::{AnnotationSet, RandomScene, SIZE};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

use crate::heavy::product::done;
use crate::workspace::root;

/// Scenes and draws of noise per scene.
pub(crate) struct Extent {
    pub(crate) scenes: usize,
    pub(crate) draws: usize,
}

/// Root mean square errors over bounds, and coverage, of one estimator at one noise level.
#[derive(Default)]
struct Row {
    /// Ratios of root mean square error to bound, scene by scene, of roll, pitch and log focal.
    ratios: [Vec<f64>; 3],
    covered: [usize; 3],
    trials: usize,
    /// Results whose focal is more than 20 % off.
    wild: usize,
    failed: usize,
}

type Estimator = fn(&[Annotation], &RandomScene, f64) -> Option<Camera>;

const ESTIMATORS: [(&str, Estimator); 3] =
    [("closed form", closed_form), ("paper's C", paper), ("maximum likelihood", likelihood)];

/// Prints the table of what stills propose by themselves: that of the test which holds it.
pub(crate) fn proposals() -> anyhow::Result<()> {
    of_test("proposals", &["told", "rooms"])
}

/// Prints the table of turns and zooms that newer stills tell, on the stills that constants were not chosen on.
pub(crate) fn compare() -> anyhow::Result<()> {
    of_test("compare", &["the_table", "--ignored"])
}

/// Prints the tables of cameras that moved, of walks and of time, by detections alone.
pub(crate) fn watch() -> anyhow::Result<()> {
    of_test("watch", &["the_table", "alarms", "--ignored"])?;
    of_test("walk", &["the_table", "--ignored"])
}

/// Runs the tests that print a table.
fn of_test(name: &str, which: &[&str]) -> anyhow::Result<()> {
    let mut cargo = Command::new("cargo");
    cargo.args(["test", "--quiet", "--package", "calib-tests", "--test", name, "--", "--nocapture"]);
    done(cargo.args(which).arg("--test-threads=1").current_dir(root()))
}

/// Prints the table as Markdown.
pub(crate) fn run(extent: &Extent) {
    println!(
        "| drawn | noise px | estimator | roll | pitch | focal | focal > 20 % off | no result | 95 % covers roll, pitch, focal |"
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
        share(row.wild),
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
            row.wild += usize::from(error[2].abs() > 0.2);
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

/// Roll and pitch in radians, and the log of the focal.
fn errors(found: &Camera, truth: &Camera) -> [f64; 3] {
    [found.roll - truth.roll, found.pitch - truth.pitch, (found.focal / truth.focal).ln()]
}

/// The Cramér-Rao bound: the covariance that the fit predicts on exact lines.
fn bound(scene: &RandomScene, noise: f64) -> Option<[f64; 3]> {
    let found = likelihood(&scene.annotations, scene, noise)?;
    let sigma = |index| found.covariance.sigma(index);
    Some([sigma(Covariance::ROLL)?, sigma(Covariance::PITCH)?, sigma(Covariance::FOCAL)? / found.focal])
}

fn lens() -> Lens {
    Lens::pinhole(Pixel::new(0.5 * SIZE[0], 0.5 * SIZE[1]))
}

/// The whole default solve of one camera.
pub(crate) fn likelihood(annotations: &[Annotation], scene: &RandomScene, noise: f64) -> Option<Camera> {
    let evidence = Constraints::new(annotations, &lens(), SceneErrors::EXACT);
    let options = FitOptions { efov: &scene.efov, sigma: Some(noise), ..FitOptions::new(lens(), SIZE) };
    Some(Fit::new(&evidence, &options).ok()?.camera)
}

fn camera_at(at: Orientation, scene: &RandomScene) -> Camera {
    Camera { roll: at.roll, pitch: at.pitch, focal: at.focal, covariance: Covariance::EXACT, ..scene.camera }
}

/// The paper's criterion, minimised by Nelder-Mead.
pub(crate) fn paper(annotations: &[Annotation], scene: &RandomScene, _: f64) -> Option<Camera> {
    let evidence = Constraints::new(annotations, &lens(), SceneErrors::EXACT);
    let (at, _) = paper_minimum(&evidence, FixedParameters::default(), SIZE[0]).ok()?;
    Some(camera_at(at, scene))
}

/// Two vanishing points: `f^2 = -v . h` of the nadir and the first parallel group.
fn closed_form(annotations: &[Annotation], scene: &RandomScene, _: f64) -> Option<Camera> {
    let evidence = Constraints::new(annotations, &lens(), SceneErrors::EXACT);
    let at = calib_core::single::closed_form(&evidence)?;
    Some(camera_at(at, scene))
}
