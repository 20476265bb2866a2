//! Agreement with other implementations: the reference camera model, and the paper's criterion in SciPy.

use std::io::Write as _;
use std::process::{Command, Stdio};

use calib_core::{
    Annotation, BrownConrady, Camera, Constraints, Covariance, Distortion, Kind, Lens, Pixel, SceneErrors,
    WorldPoint,
};

use calib_core::single::{FixedParameters, paper_minimum};
use calib_demo::random::{AnnotationSet, RandomScene, SIZE};
use calib_tests::{peers_python, root, shared};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

/// Runs a script of this folder with the folder of the peers as its argument.
fn python(script: &str, input: &Value) -> Option<Value> {
    let (peers, python) = (shared("peers")?, peers_python()?);
    let mut child = Command::new(python)
        .arg(root().join("tests").join(script))
        .arg(peers)
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    stdin.write_all(input.to_string().as_bytes()).unwrap();
    drop(stdin);
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{script} failed");
    Some(serde_json::from_slice(&output.stdout).unwrap())
}

fn camera(case: &Value) -> Camera {
    let number = |key: &str| case["camera"][key].as_f64().unwrap();
    let pinhole = Lens::pinhole(Pixel::new(0.5 * number("w"), 0.5 * number("h")));
    let focal = number("focal");
    let lens = match case["lens"].as_array() {
        None => pinhole,
        Some(k) => {
            let k: Vec<f64> = k.iter().map(|k| k.as_f64().unwrap()).collect();
            let brown = BrownConrady { k1: k[0], k2: k[1], p1: k[2], p2: k[3], k3: k[4] };
            Lens { focal, distortion: Distortion::BrownConrady(brown), ..pinhole }
        }
    };
    Camera {
        position: WorldPoint::new(number("x0"), number("y0"), number("z0")),
        yaw: number("yaw"),
        pitch: number("pitch"),
        roll: number("roll"),
        focal,
        lens,
        covariance: Covariance::EXACT,
    }
}

#[test]
fn camera_agrees_with_the_reference_model() {
    let Some(cases) = python("peers_model.py", &Value::Null) else { return };
    let mut compared = 0;
    for case in cases.as_array().unwrap() {
        let camera = camera(case);
        let rotation: [[f64; 3]; 3] = serde_json::from_value(case["rotation"].clone()).unwrap();
        for (ours, theirs) in camera.rotation().iter().flatten().zip(rotation.iter().flatten()) {
            assert!((ours - theirs).abs() < 1e-14);
        }
        let points = |key: &str| -> Vec<Vec<f64>> { serde_json::from_value(case[key].clone()).unwrap() };
        for ((world, pixel), floor) in points("world").iter().zip(points("pixels")).zip(points("floor")) {
            let ours = camera.world_to_pixel(WorldPoint::new(world[0], world[1], world[2])).unwrap();
            let off = ours.distance(Pixel::new(pixel[0], pixel[1]));
            assert!(off < 1e-9, "{off} px");
            let ours = camera.pixel_to_floor(Pixel::new(pixel[0], pixel[1]), 0.0);
            let range = (floor[0] - camera.position.x).hypot(floor[1] - camera.position.y);
            match ours {
                // Near the horizon, a rounding error of the pixel is metres on the floor.
                Some(ours) if range < 1e3 => {
                    let off = (ours.x - floor[0]).hypot(ours.y - floor[1]);
                    assert!(off < 1e-9 * (1.0 + range * range), "{off} m at {range} m");
                    compared += 1;
                }
                Some(_) => {}
                None => assert!(range > 1e6, "a floor point was lost at {range} m"),
            }
        }
    }
    assert!(compared > 1000);
}

fn segments(annotations: &[Annotation], kind: Kind) -> Vec<Vec<[f64; 4]>> {
    annotations
        .iter()
        .filter(|annotation| annotation.kind == kind)
        .map(|annotation| {
            let lines = annotation.segments.iter().flatten();
            lines.map(|ends| [ends[0].u, ends[0].v, ends[1].u, ends[1].v]).collect()
        })
        .collect()
}

/// Returns the median.
fn median(mut errors: Vec<f64>) -> f64 {
    errors.sort_by(f64::total_cmp);
    errors[errors.len() / 2]
}

#[test]
fn paper_method_is_as_accurate_as_in_scipy() {
    for (drawn, seed) in [(AnnotationSet::Directions, 11), (AnnotationSet::Lengths, 12)] {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let scenes: Vec<(RandomScene, Vec<Annotation>)> = (0..200)
            .map(|_| {
                let scene = RandomScene::new(&mut random, drawn, None, None);
                let noisy = scene.noisy(&mut random, 1.0);
                (scene, noisy)
            })
            .collect();
        let input: Vec<Value> = scenes
            .iter()
            .map(|(_, noisy)| {
                json!({
                    "vertical": segments(noisy, Kind::Vertical),
                    "parallel": segments(noisy, Kind::Parallel),
                    "perpendicular": segments(noisy, Kind::Perpendicular),
                    "equal_length": segments(noisy, Kind::EqualLength),
                })
            })
            .collect();
        let Some(theirs) = python("peers_paper.py", &Value::Array(input)) else { return };
        let theirs: Vec<f64> = serde_json::from_value(theirs).unwrap();
        let lens = Lens::pinhole(Pixel::new(0.5 * SIZE[0], 0.5 * SIZE[1]));
        let error = |focal: f64, scene: &RandomScene| (focal / scene.camera.focal - 1.0).abs();
        let ours = scenes.iter().map(|(scene, noisy)| {
            let (at, _) = paper_minimum(
                &Constraints::new(noisy, &lens, SceneErrors::EXACT),
                FixedParameters::default(),
                SIZE[0],
            )
            .unwrap();
            error(at.focal, scene)
        });
        let (ours, theirs) = (
            median(ours.collect()),
            median(scenes.iter().zip(theirs).map(|((s, _), f)| error(f, s)).collect()),
        );
        println!(
            "{drawn:?}: median focal error {:.3} % here, {:.3} % in SciPy",
            100.0 * ours,
            100.0 * theirs
        );
        assert!(ours < 1.1 * theirs, "{ours} here, {theirs} in SciPy");
    }
}
