//! Fisheyes that look beside and behind themselves: what drawn lines tell of them, against what was simulated.

#![allow(clippy::unwrap_used, reason = "a test that fails may panic")]

use calib_core::{
    Annotation, Camera, Constraints, Covariance, Distortion, Fit, FitOptions, Kind, Lens, Pixel, SceneErrors,
    WorldPoint,
};
use calib_demo::random::normal;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// Width and height of the image, in pixels.
const SIZE: [f64; 2] = [1920.0, 1920.0];

/// A camera of this field of view, in degrees across its image circle, in this height and pitch.
fn fisheye(random: &mut ChaCha8Rng, field: f64, pitch: f64) -> Camera {
    let k = [0.01 + 0.01 * normal(random), -0.002 + 0.001 * normal(random), 0.0, 0.0];
    let half = 0.5 * field.to_radians();
    let square = half * half;
    let focal = 930.0 / (half * (1.0 + square * (k[0] + square * k[1])));
    let lens = Lens {
        principal_point: Pixel::new(960.0, 960.0),
        focal,
        distortion: Distortion::KannalaBrandt { k },
    };
    Camera {
        position: WorldPoint::new(0.0, 0.0, random.random_range(2.5..5.0)),
        yaw: 0.0,
        pitch,
        roll: random.random_range(-0.3..0.3),
        focal,
        lens,
        covariance: Covariance::EXACT,
    }
}

/// Where a camera shows a point inside its image circle, as a hand draws it: to 1 px.
fn drawn(random: &mut ChaCha8Rng, camera: &Camera, point: WorldPoint, field: f64) -> Option<Pixel> {
    let toward = [point.x - camera.position.x, point.y - camera.position.y, point.z - camera.position.z];
    let [x, y, z] = camera.rotation().map(|row| row[0] * toward[0] + row[1] * toward[1] + row[2] * toward[2]);
    let shown = camera.world_to_pixel(point)?;
    let is_within = x.hypot(y).atan2(z) < 0.5 * field.to_radians();
    is_within.then(|| Pixel::new(shown.u + normal(random), shown.v + normal(random)))
}

/// Verticals, and floor lines of two directions at right angles, anywhere that the camera sees them.
fn room(random: &mut ChaCha8Rng, camera: &Camera, field: f64) -> [Annotation; 3] {
    let turn: f64 = random.random_range(0.0..1.5);
    let mut segments = |direction: Option<f64>, count: usize| {
        let mut found: Vec<Vec<Pixel>> = Vec::new();
        while found.len() < count {
            let (away, around): (f64, f64) = (random.random_range(1.0..9.0), random.random_range(0.0..6.3));
            let foot = WorldPoint::new(away * around.cos(), away * around.sin(), 0.0);
            let length: f64 = random.random_range(1.5..4.0);
            let end = match direction {
                None => WorldPoint { z: 0.8 * camera.position.z, ..foot },
                Some(angle) => {
                    WorldPoint { x: foot.x + length * angle.cos(), y: foot.y + length * angle.sin(), z: 0.0 }
                }
            };
            let ends = [drawn(random, camera, foot, field), drawn(random, camera, end, field)];
            if let [Some(a), Some(b)] = ends
                && a.distance(b) > 80.0
            {
                found.push(vec![a, b]);
            }
        }
        found
    };
    let verticals = segments(None, 6);
    let [along, across] = [segments(Some(turn), 5), segments(Some(turn + std::f64::consts::FRAC_PI_2), 5)];
    [
        Annotation::of_segments(Kind::Vertical, verticals),
        Annotation { id: Some("along".into()), ..Annotation::of_segments(Kind::Parallel, along) },
        Annotation {
            at_right_angles_to: Some("along".into()),
            ..Annotation::of_segments(Kind::Parallel, across)
        },
    ]
}

/// Errors of pitch, of roll as it turns the verticals, and of the focal, in sigmas.
fn errors(random: &mut ChaCha8Rng, field: f64, pitch: f64) -> Option<[f64; 3]> {
    let camera = fisheye(random, field, pitch);
    let annotations = room(random, &camera, field);
    let constraints = Constraints::new(&annotations, &camera.lens, SceneErrors::EXACT);
    assert!(constraints.invalid.is_empty(), "{:?}", constraints.invalid);
    let options = FitOptions { sigma: Some(1.0), ..FitOptions::new(camera.lens, SIZE) };
    let fit = Fit::new(&constraints, &options).ok()?;
    let sigma = |index: usize| fit.camera.covariance.sigma(index).unwrap();
    let turn = fit.camera.roll - camera.roll;
    let turned = (turn + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
    Some([
        (fit.camera.pitch - camera.pitch) / sigma(Covariance::PITCH),
        turned / sigma(Covariance::ROLL),
        (fit.camera.focal - camera.focal) / sigma(Covariance::FOCAL),
    ])
}

#[test]
fn lines_beside_and_behind_a_fisheye_tell_its_pose_as_surely_as_they_say() {
    const TRIALS: usize = 1000;
    for (field, pitch) in [(100.0, 0.5), (140.0, 0.7), (180.0, 0.3), (180.0, 1.2), (190.0, 0.9), (190.0, 1.5)]
    {
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let all: Vec<[f64; 3]> = (0..TRIALS).filter_map(|_| errors(&mut random, field, pitch)).collect();
        let rms =
            [0, 1, 2].map(|k| (all.iter().map(|of| of[k] * of[k]).sum::<f64>() / all.len() as f64).sqrt());
        let held =
            [0, 1, 2].map(|k| all.iter().filter(|of| of[k].abs() < 1.96).count() as f64 / all.len() as f64);
        println!(
            "{field} degrees, pitch {pitch}: {} of {TRIALS}, rms {rms:.2?}, 95 % hold {held:.3?}",
            all.len()
        );
        assert_eq!(all.len(), TRIALS);
        // Of so many trials a share has a standard deviation of 0.7 %, a root mean square one of 2.2 %.
        assert!(rms.iter().all(|rms| (0.93..1.07).contains(rms)), "{rms:?}");
        assert!(held.iter().all(|held| (0.925..0.975).contains(held)), "{held:?}");
    }
}
