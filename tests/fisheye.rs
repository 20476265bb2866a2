//! Fisheye lenses with up to 190° field of view: poses and lenses from simulated annotations, against the
//! truth.

use std::process::Command;

use calib_core::{
    Annotation, Camera, Constraints, Covariance, Distortion, DistortionModel, Fit, FitOptions, ImageCircle,
    Kind, Lens, LensFit, LensOptions, Pixel, SceneErrors, WorldPoint,
};

use calib_core::outcome::Source;

use calib_core::single::Edge;

use calib_demo::random::normal;
use calib_image::image_circle;
use calib_site::{DistortionEntry, LensEntry, Options, SceneEntry, Site, SiteCamera};
use calib_tests::{peers_python, root, shared};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// Width and height of the image, in pixels.
const SIZE: [f64; 2] = [1920.0, 1920.0];

/// Returns a random camera with a field of view in degrees across the image circle, and a pitch in radians.
fn fisheye(random: &mut ChaCha8Rng, field: f64, pitch: f64) -> Camera {
    let k = [0.01 + 0.01 * normal(random), -0.002 + 0.001 * normal(random), 0.0, 0.0];
    fisheye_with(random, field, pitch, k)
}

fn fisheye_with(random: &mut ChaCha8Rng, field: f64, pitch: f64, k: [f64; 4]) -> Camera {
    let half = 0.5 * field.to_radians();
    let square = half * half;
    let focal = 930.0 / (half * (1.0 + square * (k[0] + square * k[1])));
    let lens = Lens {
        principal_point: Pixel::new(960.0, 960.0),
        focal,
        distortion: Distortion::KannalaBrandt { k },
        image_circle: None,
        pixel_aspect: 1.0,
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

/// Returns the pixel of a point inside the image circle, with 1 px of noise.
fn drawn(random: &mut ChaCha8Rng, camera: &Camera, point: WorldPoint, field: f64) -> Option<Pixel> {
    let toward = [point.x - camera.position.x, point.y - camera.position.y, point.z - camera.position.z];
    let [x, y, z] = camera.rotation().map(|row| row[0] * toward[0] + row[1] * toward[1] + row[2] * toward[2]);
    let shown = camera.world_to_pixel(point)?;
    let is_within = x.hypot(y).atan2(z) < 0.5 * field.to_radians();
    is_within.then(|| Pixel::new(shown.u + normal(random), shown.v + normal(random)))
}

/// Draws verticals and floor lines of two perpendicular directions anywhere in view, each with `points`
/// points.
fn room(random: &mut ChaCha8Rng, camera: &Camera, field: f64, points: usize) -> [Annotation; 3] {
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
            let along = |k: usize| {
                let (t, [a, b]) = (k as f64 / (points - 1) as f64, [foot, end]);
                WorldPoint::new(a.x + t * (b.x - a.x), a.y + t * (b.y - a.y), a.z + t * (b.z - a.z))
            };
            let shown: Option<Vec<Pixel>> =
                (0..points).map(|k| drawn(random, camera, along(k), field)).collect();
            if let Some(shown) = shown.filter(|shown| shown[0].distance(shown[points - 1]) > 80.0) {
                found.push(shown);
            }
        }
        found
    };
    let verticals = segments(None, 6);
    let [along, across] = [segments(Some(turn), 5), segments(Some(turn + std::f64::consts::FRAC_PI_2), 5)];
    [
        Annotation::from_segments(Kind::Vertical, verticals),
        Annotation { id: Some("along".into()), ..Annotation::from_segments(Kind::Parallel, along) },
        Annotation {
            at_right_angles_to: Some("along".into()),
            ..Annotation::from_segments(Kind::Parallel, across)
        },
    ]
}

/// Returns the errors of pitch, roll and focal length, in standard deviations.
fn errors(random: &mut ChaCha8Rng, field: f64, pitch: f64) -> Option<[f64; 3]> {
    let camera = fisheye(random, field, pitch);
    let annotations = room(random, &camera, field, 2);
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
fn pose_errors_of_a_fisheye_match_their_sigmas() {
    const TRIALS: usize = 1000;
    for (field, pitch) in [(100.0, 0.5), (140.0, 0.7), (180.0, 0.3), (180.0, 1.2), (190.0, 0.9), (190.0, 1.5)]
    {
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let all: Vec<[f64; 3]> = (0..TRIALS).filter_map(|_| errors(&mut random, field, pitch)).collect();
        let rms =
            [0, 1, 2].map(|k| (all.iter().map(|of| of[k] * of[k]).sum::<f64>() / all.len() as f64).sqrt());
        let coverage =
            [0, 1, 2].map(|k| all.iter().filter(|of| of[k].abs() < 1.96).count() as f64 / all.len() as f64);
        println!(
            "{field} degrees, pitch {pitch}: {} of {TRIALS}, rms {rms:.2?}, coverage of 95 % {coverage:.3?}",
            all.len()
        );
        assert_eq!(all.len(), TRIALS);
        // With 1000 trials, the standard deviation is 0.7 % for a fraction and 2.2 % for a root mean square.
        assert!(rms.iter().all(|rms| (0.93..1.07).contains(rms)), "{rms:?}");
        assert!(coverage.iter().all(|coverage| (0.925..0.975).contains(coverage)), "{coverage:?}");
    }
}

/// Returns the vertical in the camera frame: its components to the right and down, as part of a unit vector.
fn vertical(camera: &Camera) -> [f64; 2] {
    let [right, down, _] = camera.rotation();
    [right[2], down[2]]
}

#[test]
fn covariance_of_the_vertical_is_correct_looking_straight_down() {
    const TRIALS: usize = 1000;
    const STEP: f64 = 1e-6;
    for off in [0.0, 0.0005, 0.002, 0.01] {
        let mut random = ChaCha8Rng::seed_from_u64(23);
        // Squared Mahalanobis distance of the two components, with the covariance of pitch and roll.
        let mut distances: Vec<f64> = (0..TRIALS)
            .map(|_| {
                let camera = fisheye(&mut random, 185.0, std::f64::consts::FRAC_PI_2 - off);
                let annotations = room(&mut random, &camera, 185.0, 2);
                let constraints = Constraints::new(&annotations, &camera.lens, SceneErrors::EXACT);
                let options = FitOptions { sigma: Some(1.0), ..FitOptions::new(camera.lens, SIZE) };
                let found = Fit::new(&constraints, &options).unwrap().camera;
                assert!(found.pitch > 0.0, "the camera must look down: {}", found.pitch);
                let [was, is] = [camera, found].map(|camera| vertical(&camera));
                let by = |at: Camera| {
                    let moved = vertical(&at);
                    [(moved[0] - is[0]) / STEP, (moved[1] - is[1]) / STEP]
                };
                let by = [
                    by(Camera { pitch: found.pitch - STEP, ..found }).map(|of| -of),
                    by(Camera { roll: found.roll + STEP, ..found }),
                ];
                let of = [Covariance::PITCH, Covariance::ROLL];
                let entry = |i: usize, j: usize| {
                    let sum = |k: usize, l: usize| by[k][i] * found.covariance.0[of[k]][of[l]] * by[l][j];
                    sum(0, 0) + sum(0, 1) + sum(1, 0) + sum(1, 1)
                };
                let (a, b, c) = (entry(0, 0), entry(0, 1), entry(1, 1));
                let [u, v] = [is[0] - was[0], is[1] - was[1]];
                (c * u * u - 2.0 * b * u * v + a * v * v) / (a * c - b * b)
            })
            .collect();
        distances.sort_by(f64::total_cmp);
        let mean = distances.iter().sum::<f64>() / TRIALS as f64;
        // Chi-square distribution with two degrees of freedom: the mean is 2, and 95 % are below 5.99.
        let coverage = distances.iter().filter(|square| **square < 5.99).count() as f64 / TRIALS as f64;
        println!(
            "{off} from straight down: mean {mean:.2}, coverage of 95 % {coverage:.3}, most {:.1}",
            distances[TRIALS - 1]
        );
        assert!((1.8..2.2).contains(&mean) && (0.925..0.975).contains(&coverage), "{mean}, {coverage}");
    }
}

/// Returns an unknown fisheye with annotations. Its principal point is some pixels off the image centre.
fn drawn_room(random: &mut ChaCha8Rng, field: f64, pitch: f64) -> (Camera, Site) {
    /// Standard deviations of the prior: k1, k2, log of the slope at the rim, and principal point in pixels.
    const BELIEF: [f64; 4] = [0.07, 0.03, 0.6, 54.3];
    let half = 0.5 * field.to_radians();
    let slope = |k: [f64; 2], theta: f64| 1.0 + theta * theta * (3.0 * k[0] + theta * theta * 5.0 * k[1]);
    let grows = |k: [f64; 2]| (0..=20).all(|step| slope(k, half * 1.1 * f64::from(step) / 20.0) > 0.2);
    let is_likely = |k: [f64; 2], draw: f64| {
        let sigmas = slope(k, half).ln() / BELIEF[2];
        draw < (-0.5 * sigmas * sigmas).exp()
    };
    let mut k = [f64::NAN; 2];
    while !grows(k) || !is_likely(k, random.random()) {
        k = [BELIEF[0] * normal(random), BELIEF[1] * normal(random)];
    }
    let mut camera = fisheye_with(random, field, pitch, [k[0], k[1], 0.0, 0.0]);
    let off: [f64; 2] = std::array::from_fn(|_| BELIEF[3] * normal(random));
    camera.lens.principal_point = Pixel::new(960.0 + off[0], 960.0 + off[1]);
    let mut entry = SiteCamera::new("ceiling", [1920, 1920]);
    let distortion = Some(DistortionEntry::new(DistortionModel::KannalaBrandt));
    entry.lens = Some(LensEntry { distortion, ..LensEntry::default() });
    entry.scene = Some(SceneEntry::EXACT);
    entry.sigma_px = Some(1.0);
    entry.annotations = room(random, &camera, field, 7).into();
    (camera, Site { cameras: vec![entry], ..Site::default() })
}

/// Estimated parameters, in the order of the errors.
const ESTIMATED: [usize; 7] = [
    Covariance::PITCH,
    Covariance::ROLL,
    Covariance::FOCAL,
    Covariance::LENS,
    Covariance::LENS + 1,
    Covariance::CENTRE,
    Covariance::CENTRE + 1,
];

/// Returns the errors of all estimated parameters in standard deviations, or `None` if the uncertainty is
/// unknown.
fn joint_errors(random: &mut ChaCha8Rng, field: f64, pitch: f64) -> Option<[f64; ESTIMATED.len()]> {
    let (camera, site) = drawn_room(random, field, pitch);
    let report = site.calibrate(&Options::default());
    let solution = report.cameras[0].1.as_ref().unwrap();
    let found = solution.camera().unwrap();
    if !found.covariance.is_known() {
        println!("unknown uncertainty: {:?}", solution.warnings);
        return None;
    }
    assert_eq!(found.focal, found.lens.focal, "{:?}", solution.warnings);
    let turn = (found.roll - camera.roll + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU);
    let [k, truth] = [found, camera].map(|camera| camera.lens.distortion.coefficients());
    let [c, centre] = [found, camera].map(|camera| camera.lens.principal_point);
    let off = [
        found.pitch - camera.pitch,
        turn - std::f64::consts::PI,
        found.focal - camera.focal,
        k[0] - truth[0],
        k[1] - truth[1],
        c.u - centre.u,
        c.v - centre.v,
    ];
    Some(std::array::from_fn(|i| off[i] / found.covariance.sigma(ESTIMATED[i]).unwrap()))
}

#[test]
fn joint_errors_of_an_unknown_fisheye_match_their_sigmas() {
    const TRIALS: usize = 100;
    for (field, pitch) in [(120.0, 0.5), (180.0, 0.4), (180.0, 1.2), (190.0, 1.5)] {
        let mut random = ChaCha8Rng::seed_from_u64(11);
        let all: Vec<[f64; 7]> =
            (0..TRIALS).filter_map(|_| joint_errors(&mut random, field, pitch)).collect();
        assert!(all.len() > TRIALS - 2, "{} of {TRIALS} have an uncertainty", all.len());
        let share = |of: f64| of / all.len() as f64;
        let rms: [f64; 7] =
            std::array::from_fn(|k| share(all.iter().map(|of| of[k] * of[k]).sum::<f64>()).sqrt());
        let coverage: [f64; 7] =
            std::array::from_fn(|k| share(all.iter().filter(|of| of[k].abs() < 1.96).count() as f64));
        println!("{field} degrees, pitch {pitch}: rms {rms:.2?}, coverage of 95 % {coverage:.3?}");
        // With 100 trials, the standard deviation is 7 % for a root mean square and 2.2 % for a fraction.
        assert!(rms.iter().all(|rms| (0.78..1.22).contains(rms)), "{rms:?}");
        assert!(coverage.iter().all(|coverage| *coverage >= 0.87), "{coverage:?}");
    }
}

#[test]
fn cameras_with_a_common_lens_share_edges_despite_different_image_circles() {
    const SHIFT: [f64; 2] = [14.0, -9.0];
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let (_, mut site) = drawn_room(&mut random, 180.0, 0.6);
    let circle = |[u, v]: [f64; 2]| Some(ImageCircle { u: 960.0 + u, v: 960.0 + v, radius: 930.0 });
    let own = site.cameras[0].lens.get_or_insert_default();
    own.image_circle_px = circle([0.0; 2]);
    let mut other = SiteCamera { id: "aisle".into(), ..site.cameras[0].clone() };
    for point in other.annotations.iter_mut().flat_map(|drawn| drawn.segments.iter_mut().flatten().flatten())
    {
        *point = Pixel::new(point.u + SHIFT[0], point.v + SHIFT[1]);
    }
    let like = Some("ceiling".into());
    other.lens = Some(LensEntry { like, image_circle_px: circle(SHIFT), ..LensEntry::default() });
    let lens_of = |site: &Site, index: usize| {
        let report = site.calibrate(&Options::default());
        let camera = report.cameras[index].1.as_ref().unwrap().camera().unwrap();
        (camera.lens, camera.covariance.sigma(Covariance::LENS).unwrap())
    };
    let (_, alone) = lens_of(&site, 0);
    site.cameras.push(other);
    let (lens, together) = lens_of(&site, 0);
    let (its, _) = lens_of(&site, 1);
    assert!(together < 0.85 * alone, "sigma of k1: {together} jointly, {alone} alone");
    let [a, b] = [lens, its].map(|lens| <[f64; 2]>::from(lens.principal_point));
    // The prior on the slope of the lens counts once, in the owner of the lens. It moves the principal point by
    // a small part of its standard deviation of 9 px.
    assert!((0..2).all(|k| (b[k] - a[k] - SHIFT[k]).abs() < 1.0), "{a:?} {b:?}");
}

#[test]
fn fisheye_model_is_selected_from_edges() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let model = |site: &Site| {
        let report = site.calibrate(&Options::default());
        let solution = report.cameras[0].1.as_ref().unwrap();
        solution.distortion.as_ref().map(|distortion| distortion.model)
    };
    let mut recognised = 0;
    for _ in 0..20 {
        let (_, mut site) = drawn_room(&mut random, 180.0, 0.6);
        site.cameras[0].lens = None;
        site.cameras[0].annotations[0].kind = Kind::Vertical;
        let edges = site.cameras[0].annotations.clone();
        // Without a lens in the file, distortion is fitted only if straight edges are annotated.
        site.cameras[0].annotations.extend(edges.iter().map(|drawn| {
            Annotation::from_segments(Kind::Straight, drawn.segments.clone().unwrap_or_default())
        }));
        recognised += usize::from(model(&site) == Some(DistortionModel::KannalaBrandt));
    }
    assert!(recognised >= 19, "{recognised} of 20 lenses are recognised as fisheye");
}

#[test]
fn pixel_outside_the_image_circle_has_no_ray() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let (truth, mut site) = drawn_room(&mut random, 185.0, 1.4);
    let centre = truth.lens.principal_point;
    let circle = ImageCircle { u: centre.u + 4.0, v: centre.v - 3.0, radius: 940.0 };
    let lens = site.cameras[0].lens.as_mut().unwrap();
    lens.image_circle_px = Some(circle);
    let report = site.calibrate(&Options::default());
    let solved = report.write_into(&site);
    let camera = solved.cameras[0].solution.as_ref().unwrap().camera().unwrap();
    // Files are read with twelve digits.
    assert!(camera.lens.image_circle.is_some_and(|own| (own.radius - circle.radius).abs() < 1e-9));
    let along = |share: f64, angle: f64| {
        let radius = share * circle.radius;
        Pixel::new(circle.u + radius * angle.cos(), circle.v + radius * angle.sin())
    };
    for step in 0..36 {
        let angle = f64::from(step).to_radians() * 10.0;
        let (inside, outside) = (along(0.999, angle), along(1.001, angle));
        assert!(camera.pixel_to_ray(inside).is_some() && camera.pixel_to_ray(outside).is_none());
        assert!(camera.pixel_to_floor(outside, 0.0).is_none());
    }
    // The image circle determines the principal point to about one percent of its radius.
    assert!(camera.lens.principal_point.distance(centre) < 15.0);
}

/// Returns the root mean square distance, in pixels, between the pixels that two lenses give to the same rays. The
/// rays belong to the pixels of a disc.
fn rms_distance(one: &Lens, other: &Lens, disc: ImageCircle) -> f64 {
    let across = |i: u32| disc.radius * (f64::from(i) / 40.0 - 1.0);
    let pixels = (0..=80).flat_map(|i| (0..=80).map(move |j| (across(i), across(j))));
    let in_disc =
        pixels.map(|(u, v)| Pixel::new(disc.u + u, disc.v + v)).filter(|&pixel| disc.contains(pixel));
    let square = |pixel: Pixel| {
        let [x, y, ahead] = one.bearing(pixel).unwrap();
        let ratio = other.focal / one.focal;
        other.bearing_to_pixel([x * ratio, y * ratio, ahead]).unwrap().distance(pixel).powi(2)
    };
    let squares: Vec<f64> = in_disc.map(square).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn real_fisheye_from_straight_edges_agrees_with_its_board_calibration() {
    let (Some(folder), Some(python)) = (shared("real/fisheye"), peers_python()) else { return };
    let script = root().join("tests/fisheye_boards.py");
    let output = Command::new(python).arg(script).arg(&folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let size: [f64; 2] = serde_json::from_value(found["size"].clone()).unwrap();
    let lines: Vec<Vec<Pixel>> = serde_json::from_value(found["edges"].clone()).unwrap();
    let [fx, fy, cu, cv, k @ ..]: [f64; 8] = serde_json::from_value(found["board"].clone()).unwrap();
    // All images have the same image circle. Glare outside the circle prevents its detection in two of them.
    let stills = std::fs::read_dir(&folder).unwrap().map(|entry| image::open(entry.unwrap().path()).unwrap());
    let circles: Vec<ImageCircle> = stills.filter_map(|still| image_circle(&still.to_rgb8())).collect();
    let centre = Pixel::new(cu, cv);
    let mut radii: Vec<f64> = circles.iter().map(|circle| circle.radius).collect();
    radii.sort_by(f64::total_cmp);
    println!("image circles: {circles:.1?}");
    assert!(
        radii.len() >= 12 && radii[radii.len() - 1] - radii[0] < 0.03 * radii[radii.len() / 2],
        "{radii:.1?}"
    );
    assert!(
        circles.iter().all(|circle| circle.centre().distance(centre) < 0.02 * circle.radius),
        "{circles:.1?}"
    );
    // The pixels are square to 0.2 %, so the mean of both focal lengths is used.
    assert!((fx / fy - 1.0).abs() < 2e-3);
    let board = Lens {
        principal_point: Pixel::new(cu, cv),
        focal: 0.5 * (fx + fy),
        distortion: Distortion::KannalaBrandt { k },
        image_circle: None,
        pixel_aspect: 1.0,
    };
    let edge = |(annotation, points): (usize, Vec<Pixel>)| Edge {
        points,
        source: Source { annotation, segment: 0 },
    };
    let edges: Vec<Edge> = lines.into_iter().enumerate().map(edge).collect();
    let disc = ImageCircle { radius: 455.0, ..circles[0] };
    // With four coefficients, straightness alone does not determine the focal length; stage 1 does.
    for circle in [None, Some(circles[0])] {
        let options = LensOptions {
            principal_point: Pixel::new(0.5 * size[0], 0.5 * size[1]),
            is_centre_fixed: false,
            pixel_aspect: 1.0,
            circle,
            size,
            fitted: None,
            focal: None,
            sigma: 0.15,
        };
        let fit = LensFit::new(&edges, &options).unwrap();
        let off = rms_distance(&fit.lens, &board, disc);
        println!(
            "{circle:?}: {off:.2} px rms over the disc, straight to {:.3?} px, {:?}; board {board:?}",
            fit.straightness, fit.lens
        );
        assert!(fit.lens.distortion.is_wide() && off < 1.0, "{off} px: {:?}", fit.lens);
    }
}
