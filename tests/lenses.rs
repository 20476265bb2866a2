//! Distortion from polylines: a real lens with chessboard images, and synthetic edges.

use calib_core::{
    Annotation, BrownConrady, Camera, Code, Covariance, Distortion, DistortionModel, FittedCoefficients,
    Kind, Lens, LensFit, LensOptions, Pixel, UndistortedPixel, WorldPoint,
};

use calib_core::camera::{Rational, Unified};

use calib_core::outcome::Source;

use calib_core::single::Edge;

use calib_demo::random::normal;
use calib_demo::{KnownLens, demo_site_with};
use calib_site::{LensCache, Options, SceneEntry, Site, SiteCamera};
use calib_tests::{map_distance, shared};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

fn edge(points: Vec<Pixel>, annotation: usize) -> Edge {
    Edge { points, source: Source { annotation, segment: 0 } }
}

/// Draws four to nine straight edges anywhere in the image, with 0.3 px of noise.
fn drawn(random: &mut ChaCha8Rng, lens: &Lens, size: [f64; 2]) -> Vec<Edge> {
    let count = random.random_range(4..10);
    let mut edges = Vec::new();
    while edges.len() < count {
        let mut raw = || Pixel::new(random.random_range(0.0..size[0]), random.random_range(0.0..size[1]));
        let (Some(a), Some(b)) = (lens.undistort(raw()), lens.undistort(raw())) else { continue };
        if a.distance(b) < 700.0 {
            continue;
        }
        let points: Vec<Pixel> = (0..9)
            .filter_map(|i| {
                let t = f64::from(i) / 8.0;
                let p =
                    lens.distort(UndistortedPixel { u: a.u + t * (b.u - a.u), v: a.v + t * (b.v - a.v) })?;
                Some(Pixel { u: p.u + 0.3 * normal(random), v: p.v + 0.3 * normal(random) })
            })
            .collect();
        edges.push(edge(points, edges.len()));
    }
    edges
}

#[test]
fn lens_is_recovered_from_synthetic_edges() {
    let mut random = ChaCha8Rng::seed_from_u64(41);
    let size = [1920.0, 1080.0];
    let half_diagonal = 0.5 * f64::hypot(size[0], size[1]);
    let mut errors = Vec::new();
    for scene in 0..30 {
        // Corner displacement from 7 to 570 px.
        let displacement = 7.0 * (570.0_f64 / 7.0).powf(f64::from(scene) / 29.0);
        // In units of half the diagonal, the distorted corner is at 1 and its undistorted point at r. k2
        // keeps the map increasing.
        let r = 1.0 + displacement / half_diagonal;
        let bend = if scene % 2 == 0 { 0.15 * (r - 1.0) / 0.5 } else { 0.15 * ((r - 1.3) / 0.2).max(0.0) };
        let brown = BrownConrady {
            k1: (1.0 / r - 1.0 - bend) / r.powi(2),
            k2: bend / r.powi(4),
            ..BrownConrady::default()
        };
        let distortion = Distortion::BrownConrady(brown);
        let lens = Lens {
            principal_point: Pixel::new(960.0, 540.0),
            focal: half_diagonal,
            distortion,
            image_circle: None,
            pixel_aspect: 1.0,
        };
        let edges = drawn(&mut random, &lens, size);
        let options = LensOptions {
            principal_point: lens.principal_point,
            is_centre_fixed: true,
            pixel_aspect: 1.0,
            circle: None,
            size,
            fitted: None,
            focal: None,
            sigma: 0.3,
        };
        let fit = LensFit::new(&edges, &options).unwrap();
        let error = map_distance(&fit.lens, &lens, size);
        println!(
            "{scene}: displacement {displacement:.0} px, {} edges, {:?}, map error {error:.2} px, predicted {:?}, straight {:?}",
            edges.len(),
            fit.fitted,
            fit.map_error,
            fit.straightness
        );
        errors.push((error, fit.map_error[2]));
    }
    let mut sorted: Vec<f64> = errors.iter().map(|(error, _)| *error).collect();
    sorted.sort_by(f64::total_cmp);
    println!("median {:.2}, 90th percentile {:.2}, worst {:.2}", sorted[15], sorted[27], sorted[29]);
    assert!(sorted[15] <= 0.9 && sorted[27] <= 3.5, "{sorted:?}");
    assert!(errors.iter().all(|(error, predicted)| *error <= 10.0 || *predicted > 10.0), "{errors:?}");
}

/// Families of wide lenses, tested at several horizontal fields of view.
#[derive(Clone, Copy, Debug)]
enum Family {
    Brown2,
    Brown3,
    Division,
    Fisheye,
}

/// Returns a random wide lens of a family, valid in the whole image including the corners.
fn wide(random: &mut ChaCha8Rng, family: Family, hfov_deg: f64, [w, h]: [f64; 2]) -> Lens {
    let half: f64 = 0.5 * hfov_deg.to_radians();
    let edge = half.tan();
    loop {
        // The side of the image is at `edge` in the undistorted plane. The coefficients are scaled by powers of
        // `edge`.
        let a = random.random_range(0.15..0.6);
        let k1 = -a / edge.powi(2);
        let k2 = a * a * random.random_range(0.3..0.7) / edge.powi(4);
        let k3 = a.powi(3) * random.random_range(-0.1..0.1) / edge.powi(6);
        let brown = BrownConrady { k1, k2, ..BrownConrady::default() };
        let distortion = match family {
            Family::Brown2 => Distortion::BrownConrady(brown),
            Family::Brown3 => Distortion::BrownConrady(BrownConrady { k3, ..brown }),
            // x_distorted = s x at the side, therefore lambda = (s - 1) / (s edge)^2.
            Family::Division => Distortion::Division { lambda: -a / ((1.0 - a) * edge).powi(2) },
            Family::Fisheye => Distortion::KannalaBrandt {
                k: [0.03, 0.01, 0.005, 0.001].map(|most| random.random_range(-most..most)),
            },
        };
        let Some([side, _]) = distortion.distort([edge, 0.0]) else { continue };
        let lens = Lens {
            principal_point: Pixel::new(0.5 * w, 0.5 * h),
            focal: 0.5 * w / side,
            distortion,
            image_circle: None,
            pixel_aspect: 1.0,
        };
        if lens.undistort(Pixel::new(0.0, 0.0)).is_some() {
            return lens;
        }
    }
}

#[test]
fn wide_lenses_are_recovered_from_synthetic_edges() {
    const SCENES: usize = 50;
    let size = [1920.0, 1080.0];
    // Largest accepted median and 90th percentile, in pixels of the undistorted image. At 130 degrees its
    // scale towards the corners is several times that of the raw image.
    for (family, [median, high]) in [
        (Family::Brown2, [1.2, 6.0]),
        (Family::Brown3, [2.0, 9.0]),
        (Family::Division, [0.7, 2.2]),
        (Family::Fisheye, [1.2, 3.5]),
    ] {
        let mut random = ChaCha8Rng::seed_from_u64(90);
        let mut errors: Vec<(f64, f64)> = Vec::new();
        for scene in 0..SCENES {
            let hfov_deg = 90.0 + 10.0 * (scene % 5) as f64;
            let lens = wide(&mut random, family, hfov_deg, size);
            let fisheye = matches!(family, Family::Fisheye);
            let options = LensOptions {
                principal_point: lens.principal_point,
                is_centre_fixed: true,
                pixel_aspect: 1.0,
                circle: None,
                size,
                fitted: match family {
                    Family::Brown2 | Family::Brown3 => None,
                    Family::Division => Some(FittedCoefficients::first(DistortionModel::Division, 1)),
                    Family::Fisheye => Some(FittedCoefficients::first(DistortionModel::KannalaBrandt, 2)),
                },
                focal: fisheye.then_some(lens.focal),
                sigma: 0.3,
            };
            let fit = LensFit::new(&drawn(&mut random, &lens, size), &options).unwrap();
            errors.push((map_distance(&fit.lens, &lens, size), fit.map_error[2]));
        }
        errors.sort_by(|a, b| a.0.total_cmp(&b.0));
        let at = |share: usize| errors[(SCENES - 1) * share / 100].0;
        let warned = errors.iter().filter(|(_, predicted)| *predicted > 10.0).count();
        let found = format!(
            "{family:?}: median {:.2}, 90th percentile {:.2}, worst {:.2}; {warned} of {SCENES} have a warning",
            at(50),
            at(90),
            at(100)
        );
        println!("{found}");
        assert!(at(50) <= median && at(90) <= high, "{found}");
        let silent = errors.iter().find(|(error, predicted)| *error > 10.0 && *predicted <= 10.0);
        assert!(silent.is_none(), "{family:?}: no warning with {silent:?}");
    }
}

/// Draws eight short edges in the middle of the image and a long one along the upper border with a sagitta.
fn rim(lens: &Lens, sagitta: f64) -> Vec<Edge> {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut between = |a: [f64; 2], b: [f64; 2], sagitta: f64| {
        let (a, b) = (lens.undistort(a.into()).unwrap(), lens.undistort(b.into()).unwrap());
        let points = (0..10).map(|i| {
            let t = f64::from(i) / 9.0;
            let bend = sagitta * (2.0 * t - 1.0).powi(2);
            let straight = UndistortedPixel { u: a.u + t * (b.u - a.u), v: a.v + t * (b.v - a.v) + bend };
            let p = lens.distort(straight).unwrap();
            Pixel::new(p.u + 0.3 * normal(&mut random), p.v + 0.3 * normal(&mut random))
        });
        points.collect::<Vec<_>>()
    };
    let mut lines = vec![between([10.0, 60.0], [1910.0, 60.0], sagitta)];
    for i in 0..4 {
        let at = 300.0 * f64::from(i);
        lines.push(between([510.0 + at, 200.0], [520.0 + at, 900.0], 0.0));
        lines.push(between([500.0, 150.0 + at], [1300.0, 180.0 + at], 0.0));
    }
    lines.into_iter().enumerate().map(|(i, points)| edge(points, i)).collect()
}

/// Returns `count` raw pixels of an edge that is straight in the undistorted image, with `noise` pixels
/// of noise. `a` and `b` are its ends, in raw pixels.
fn seen(lens: &Lens, [a, b]: [[f64; 2]; 2], count: usize, noise: f64, random: &mut ChaCha8Rng) -> Vec<Pixel> {
    let (a, b) = (lens.undistort(a.into()).unwrap(), lens.undistort(b.into()).unwrap());
    let point = |i: usize| {
        let t = i as f64 / (count - 1) as f64;
        let straight = UndistortedPixel { u: a.u + t * (b.u - a.u), v: a.v + t * (b.v - a.v) };
        lens.distort(straight).unwrap()
    };
    (0..count)
        .map(point)
        .map(|p| Pixel::new(p.u + noise * normal(random), p.v + noise * normal(random)))
        .collect()
}

#[test]
fn one_long_edge_determines_the_lens() {
    let size = [1920.0, 1072.0];
    let brown = BrownConrady { k1: -0.37, k2: 0.14, ..BrownConrady::default() };
    let principal_point = Pixel::new(960.0, 536.0);
    let lens = Lens {
        principal_point,
        focal: 1453.0,
        distortion: Distortion::BrownConrady(brown),
        image_circle: None,
        pixel_aspect: 1.0,
    };
    let mut random = ChaCha8Rng::seed_from_u64(8);
    let options = LensOptions {
        principal_point,
        is_centre_fixed: true,
        pixel_aspect: 1.0,
        circle: None,
        size,
        fitted: None,
        focal: None,
        sigma: 1.0,
    };
    // Noise as assumed, and larger noise.
    for noise in [1.0, 2.5].repeat(20) {
        let mut lines = vec![seen(&lens, [[150.0, 160.0], [1600.0, 220.0]], 8, noise, &mut random)];
        for u in [930.0, 960.0, 1000.0] {
            lines.push(seen(&lens, [[u, 420.0], [u, 760.0]], 4, noise, &mut random));
        }
        let edges: Vec<Edge> = lines.into_iter().enumerate().map(|(i, points)| edge(points, i)).collect();
        let fit = LensFit::new(&edges, &options).unwrap();
        let apart = map_distance(&fit.lens, &lens, size);
        let untouched = map_distance(&Lens::pinhole(principal_point), &lens, size);
        assert!(apart < 0.5 * untouched, "{:?}: {apart} px, {untouched} without a lens", fit.fitted);
        assert!(apart < 3.0 * noise * fit.map_error[2], "{apart} px, \u{b1} {:?}", fit.map_error);
        let Distortion::BrownConrady(found) = fit.lens.distortion else { panic!("{:?}", fit.lens) };
        assert!(found.k1 < -0.1, "{found:?}");
    }
}

#[test]
fn undetermined_coefficients_follow_the_prior() {
    let size = [1920.0, 1080.0];
    let principal_point = Pixel::new(960.0, 540.0);
    let lens = Lens {
        principal_point,
        focal: 1200.0,
        pixel_aspect: 1.0,
        distortion: Distortion::None,
        image_circle: None,
    };
    let mut random = ChaCha8Rng::seed_from_u64(9);
    // Short edges in the middle of the image, with large noise.
    let fitted = Some(FittedCoefficients::first(DistortionModel::BrownConrady, 2));
    let options = LensOptions {
        principal_point,
        is_centre_fixed: true,
        pixel_aspect: 1.0,
        circle: None,
        size,
        fitted,
        focal: None,
        sigma: 1.0,
    };
    for _ in 0..20 {
        let lines = [
            [[700.0, 400.0], [1200.0, 420.0]],
            [[720.0, 380.0], [740.0, 700.0]],
            [[1180.0, 380.0], [1160.0, 690.0]],
        ];
        let lines = lines.map(|ends| seen(&lens, ends, 5, 1.0, &mut random));
        let edges: Vec<Edge> = lines.into_iter().enumerate().map(|(i, points)| edge(points, i)).collect();
        let fit = LensFit::new(&edges, &options).unwrap();
        let Distortion::BrownConrady(found) = fit.lens.distortion else { panic!("{:?}", fit.lens) };
        // In units of half the diagonal: three standard deviations of the prior on lenses.
        assert!(found.k1.abs() < 0.6 && found.k2.abs() < 0.6, "{found:?}");
        let corner = lens
            .undistort(Pixel::from(size))
            .unwrap()
            .distance(fit.lens.undistort(Pixel::from(size)).unwrap());
        assert!(corner < 3.0 * fit.map_error[2], "{corner} px off, \u{b1} {}", fit.map_error[2]);
    }
}

#[test]
fn only_edge_near_the_corners_is_used_if_the_others_agree() {
    let size = [1920.0, 1080.0];
    let brown = BrownConrady { k1: -0.35, k2: 0.12, ..BrownConrady::default() };
    let lens = Lens {
        principal_point: Pixel::new(960.0, 540.0),
        focal: 1450.0,
        distortion: Distortion::BrownConrady(brown),
        image_circle: None,
        pixel_aspect: 1.0,
    };
    let options = LensOptions {
        principal_point: lens.principal_point,
        is_centre_fixed: true,
        pixel_aspect: 1.0,
        circle: None,
        size,
        fitted: None,
        focal: None,
        sigma: 0.3,
    };
    let fit = LensFit::new(&rim(&lens, 0.0), &options).unwrap();
    let apart = map_distance(&fit.lens, &lens, size);
    assert!(apart < 2.0, "{:?}: {apart} px", fit.fitted);
    // The same curvature without distortion: a sagging gutter, which contradicts the other edges.
    let fit = LensFit::new(&rim(&Lens::pinhole(lens.principal_point), 25.0), &options).unwrap();
    assert_eq!(fit.fitted, None, "{:?}", fit.lens);
    assert!(fit.map_error[2] > 10.0, "the map error stays large: {:?}", fit.map_error);
}

/// Returns the radius up to which a model increases, found by stepping along it. This is independent of the
/// tested code.
fn growing_until(model: impl Fn(f64) -> f64, most: f64) -> f64 {
    const STEPS: u32 = 2_000_000;
    let at = |i: u32| most * f64::from(i) / f64::from(STEPS);
    (1..=STEPS).find(|&i| model(at(i)) <= model(at(i - 1))).map_or(f64::INFINITY, |i| at(i - 1))
}

/// Returns the largest valid distorted radius, divided by the focal length.
fn last_radius(distortion: &Distortion) -> f64 {
    match *distortion {
        Distortion::None => f64::INFINITY,
        Distortion::BrownConrady(BrownConrady { k1, k2, k3, .. }) => {
            let model = |r: f64| r * (1.0 + k1 * r.powi(2) + k2 * r.powi(4) + k3 * r.powi(6));
            let turn = growing_until(model, 20.0);
            if turn.is_finite() { model(turn) } else { f64::INFINITY }
        }
        Distortion::Division { lambda } => lambda.abs().sqrt().recip(),
        Distortion::KannalaBrandt { k } => {
            let right_angle = std::f64::consts::FRAC_PI_2;
            let model = |t: f64| {
                t * (1.0 + k[0] * t.powi(2) + k[1] * t.powi(4) + k[2] * t.powi(6) + k[3] * t.powi(8))
            };
            model(growing_until(model, right_angle).min(right_angle))
        }
        Distortion::Rational(Rational { radial: [k1, k2, k3, k4, k5, k6], .. }) => {
            let model = |r: f64| {
                let over = 1.0 + k1 * r.powi(2) + k2 * r.powi(4) + k3 * r.powi(6);
                r * over / (1.0 + k4 * r.powi(2) + k5 * r.powi(4) + k6 * r.powi(6))
            };
            let turn = growing_until(model, 20.0);
            if turn.is_finite() { model(turn) } else { f64::INFINITY }
        }
        Distortion::Unified(Unified { xi, .. }) => last_radius(&Distortion::DoubleSphere { xi, alpha: 0.0 }),
        Distortion::Eucm { alpha, beta } => {
            let right_angle = std::f64::consts::FRAC_PI_2;
            let model = |t: f64| {
                let d = (beta * t.sin().powi(2) + t.cos().powi(2)).sqrt();
                t.sin() / (alpha * d + (1.0 - alpha) * t.cos())
            };
            model(growing_until(model, right_angle).min(right_angle))
        }
        Distortion::DoubleSphere { xi, alpha } => {
            let right_angle = std::f64::consts::FRAC_PI_2;
            let model = |t: f64| {
                let along = xi + t.cos();
                (1.0 + xi) * t.sin() / (alpha * t.sin().hypot(along) + (1.0 - alpha) * along)
            };
            model(growing_until(model, right_angle).min(right_angle))
        }
    }
}

#[test]
fn round_trip_is_exact_within_the_valid_radius() {
    let size = [1920.0, 1080.0];
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut lenses = Vec::new();
    for hfov_deg in [40.0, 60.0, 90.0, 100.0, 110.0, 120.0, 130.0, 140.0] {
        for family in [Family::Brown2, Family::Brown3, Family::Division, Family::Fisheye] {
            lenses.push(wide(&mut random, family, hfov_deg, size));
        }
    }
    let at = |focal: f64, distortion: Distortion| Lens {
        principal_point: Pixel::new(950.0, 530.0),
        focal,
        distortion,
        image_circle: None,
        pixel_aspect: 1.0,
    };
    let brown = |k1, k2, k3| BrownConrady { k1, k2, k3, ..BrownConrady::default() };
    lenses.extend([
        // A fold inside the image; pincushion; a fold caused by the third coefficient.
        at(800.0, Distortion::BrownConrady(brown(-0.35, 0.0, 0.0))),
        at(1100.0, Distortion::BrownConrady(brown(0.3, 0.1, 0.0))),
        at(900.0, Distortion::BrownConrady(brown(-0.2, 0.1, -0.05))),
        at(700.0, Distortion::Division { lambda: 0.4 }),
        at(600.0, Distortion::unified(1.1)),
        at(600.0, Distortion::Eucm { alpha: 0.6, beta: 1.2 }),
        at(500.0, Distortion::DoubleSphere { xi: -0.2, alpha: 0.6 }),
        at(700.0, Distortion::Division { lambda: -0.6 }),
        // 160 and 200 degrees across, and one that folds before 90 degrees from the axis.
        at(960.0 / 80_f64.to_radians(), Distortion::KannalaBrandt { k: [-0.01, 0.005, -0.002, 0.0003] }),
        at(960.0 / 100_f64.to_radians(), Distortion::KannalaBrandt { k: [0.0; 4] }),
        at(700.0, Distortion::KannalaBrandt { k: [-0.25, 0.0, 0.0, 0.0] }),
    ]);
    for lens in &lenses {
        let last = last_radius(&lens.distortion) * lens.focal;
        let (mut inside, mut outside, mut worst) = (0, 0, 0.0_f64);
        for k in 0..400 * 300 {
            let raw = Pixel::new(-500.0 + 7.3 * f64::from(k % 400), -500.0 + 6.9 * f64::from(k / 400));
            let radius = raw.distance(lens.principal_point);
            match lens.undistort(raw) {
                Some(straight) => {
                    inside += 1;
                    assert!(radius < last + 1e-3, "{lens:?}: {raw:?} is {radius} px out, beyond {last}");
                    let back = lens.distort(straight);
                    let back = back.unwrap_or_else(|| panic!("{lens:?}: {raw:?} -> {straight:?} -> None"));
                    // Near a fold of the map, half of the digits are lost.
                    let exact = if radius < last - 1.0 { 1e-9 } else { 1e-7 };
                    worst = worst.max(back.distance(raw) / exact);
                }
                None => {
                    outside += 1;
                    assert!(radius > last - 1e-3, "{lens:?}: {raw:?} is {radius} px out, within {last}");
                }
            }
        }
        println!("{:?}: {inside} inside, {outside} outside, worst {worst:.4} of 1e-9 px", lens.distortion);
        assert!(worst < 1.0 && inside > 0, "{lens:?}: {inside} points inside, {worst} of 1e-9 px");
    }
}

#[test]
fn tangential_lenses_round_trip() {
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let size = [1920.0, 1080.0];
    for hfov_deg in [60.0, 90.0, 110.0, 130.0] {
        let mut lens = wide(&mut random, Family::Brown3, hfov_deg, size);
        if let Distortion::BrownConrady(brown) = &mut lens.distortion {
            (brown.p1, brown.p2) = (random.random_range(-2e-3..2e-3), random.random_range(-2e-3..2e-3));
        }
        let (mut lost, mut found, mut worst) = (0, 0, 0.0_f64);
        for k in 0..400 * 300 {
            let straight = UndistortedPixel {
                u: 960.0 + 20.0 * (f64::from(k % 400) - 200.0),
                v: 540.0 + 20.0 * (f64::from(k / 400) - 150.0),
            };
            let Some(raw) = lens.distort(straight) else { continue };
            match lens.undistort(raw).and_then(|again| lens.distort(again)) {
                Some(back) => {
                    found += 1;
                    worst = worst.max(back.distance(raw));
                }
                None => lost += 1,
            }
        }
        assert!(lost == 0 && found > 10_000 && worst < 1e-9, "{lens:?}: {found}, {lost} lost, {worst} px");
    }
}

#[test]
fn real_lens_agrees_with_its_board_calibration() {
    let Some(file) = shared("real/chessboard/left.json") else { return };
    let data: Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
    let edges: Vec<Edge> =
        polylines(&data).into_iter().enumerate().map(|(i, points)| edge(points, i)).collect();
    assert!(edges.len() > 100);
    let size = [640.0, 480.0];
    let reference = |key: &str| {
        let entry = &data["reference"][key];
        let k: Vec<f64> = serde_json::from_value(entry["dist_opencv_k1_k2_p1_p2_k3"].clone()).unwrap();
        let brown = BrownConrady { k1: k[0], k2: k[1], p1: k[2], p2: k[3], k3: k[4] };
        let principal_point: Pixel = serde_json::from_value(entry["principal_point"].clone()).unwrap();
        Lens {
            principal_point,
            focal: entry["focal_px"][0].as_f64().unwrap(),
            distortion: Distortion::BrownConrady(brown),
            image_circle: None,
            pixel_aspect: 1.0,
        }
    };
    let reference = reference("k1k2");
    let k1_k2 = FittedCoefficients::first(DistortionModel::BrownConrady, 2);
    for (fitted, most) in [
        (None, 0.10),
        (Some(k1_k2), 0.095),
        (Some(FittedCoefficients::first(DistortionModel::Division, 1)), 0.10),
    ] {
        let options = LensOptions {
            principal_point: reference.principal_point,
            is_centre_fixed: true,
            pixel_aspect: 1.0,
            circle: None,
            size,
            fitted,
            focal: None,
            sigma: 0.1,
        };
        let fit = LensFit::new(&edges, &options).unwrap();
        // The reference reports the mean over the polylines.
        let mean = fit.residuals.iter().map(|(_, px)| px).sum::<f64>() / fit.residuals.len() as f64;
        let apart = map_distance(&fit.lens, &reference, size);
        println!("{:?}: straightness {mean:.4} px, {apart:.3} px rms from the reference map", fit.fitted);
        assert!(mean <= most, "{mean}");
        // Another lens model differs in the corners, where the images have no chessboard.
        assert!(
            apart
                <= if fit.fitted == Some(FittedCoefficients::first(DistortionModel::Division, 1)) {
                    0.6
                } else {
                    0.5
                },
            "{apart} px"
        );
    }
}

fn polylines(data: &Value) -> Vec<Vec<Pixel>> {
    let mut found = Vec::new();
    for board in data["boards"].as_array().unwrap() {
        for line in board["polylines"].as_array().unwrap() {
            found.push(serde_json::from_value(line.clone()).unwrap());
        }
    }
    found
}

#[test]
fn lens_cache_changes_no_result_and_is_updated_after_an_edit() {
    let mut site = demo_site_with(KnownLens::Fitted).site;
    let everyone: Vec<usize> = (0..site.cameras.len()).collect();
    let whole = |site: &Site| {
        let report = site.calibrate(&Options { refine: false, ..Options::default() });
        (report.cameras, report.findings)
    };
    let family = |site: &Site, lenses: &LensCache| {
        let (report, lenses) = site.calibrate_family(&everyone, lenses);
        ((report.cameras, report.findings), lenses)
    };
    let (found, lenses) = family(&site, &LensCache::default());
    assert_eq!(found, whole(&site), "a family gives the same result as the site");
    let (again, _) = family(&site, &lenses);
    assert_eq!(again, found);
    let mut drawn = site.cameras.iter_mut().flat_map(|camera| &mut camera.annotations);
    let edge = drawn.find(|annotation| annotation.kind == Kind::Straight).unwrap();
    edge.points.as_mut().unwrap()[1].u += 2.0;
    let (moved, _) = family(&site, &lenses);
    assert_ne!(moved, found);
    assert_eq!(moved, whole(&site), "the lens is fitted again");
}

#[test]
fn uninformative_edge_is_reported() {
    let mut site = demo_site_with(KnownLens::Fitted).site;
    site.cameras.truncate(1);
    (site.links, site.distances, site.marks) = (Vec::new(), Vec::new(), Vec::new());
    let camera = &mut site.cameras[0];
    camera.annotations.retain(|annotation| annotation.kind != Kind::Straight);
    let mut radial = Annotation::new(Kind::Straight);
    radial.points = Some([1000.0, 1200.0, 1400.0].map(|u| Pixel::new(u, 540.0)).to_vec());
    camera.annotations.push(radial);
    let report = site.calibrate(&Options::default());
    let warnings = &report.cameras[0].1.as_ref().unwrap().warnings;
    assert!(warnings.iter().any(|warning| warning.code == Code::UninformativePolyline), "{warnings:?}");
}

/// Returns edges of a lens that displaces the corner by 60 px, annotated with 0.3 px of noise.
fn edges_of_a_lens(random: &mut ChaCha8Rng) -> (Vec<Edge>, LensOptions) {
    let size = [1920.0, 1080.0];
    let brown = BrownConrady { k1: -0.06, ..BrownConrady::default() };
    let lens = Lens {
        principal_point: Pixel::new(960.0, 540.0),
        focal: 0.5 * f64::hypot(size[0], size[1]),
        distortion: Distortion::BrownConrady(brown),
        image_circle: None,
        pixel_aspect: 1.0,
    };
    let options = LensOptions {
        principal_point: lens.principal_point,
        is_centre_fixed: true,
        pixel_aspect: 1.0,
        circle: None,
        size,
        fitted: None,
        focal: None,
        sigma: 0.3,
    };
    (drawn(random, &lens, size), options)
}

#[test]
fn repeated_edge_adds_no_information() {
    let mut random = ChaCha8Rng::seed_from_u64(43);
    for _ in 0..10 {
        let (edges, options) = edges_of_a_lens(&mut random);
        let once = LensFit::new(&edges, &options).unwrap();
        let copies: Vec<Edge> = (0..60).flat_map(|_| edges.clone()).collect();
        let again = LensFit::new(&copies, &options).unwrap();
        assert_eq!(once.fitted, again.fitted);
        assert_eq!(once.dof, again.dof);
        assert!((once.chi2 / again.chi2 - 1.0).abs() < 0.1, "{} and {}", once.chi2, again.chi2);
        for (once, again) in once.map_error.iter().zip(&again.map_error) {
            assert!((once / again - 1.0).abs() < 0.1, "{once} px drawn once, {again} px drawn sixty times");
        }
        assert!(map_distance(&once.lens, &again.lens, options.size) < 0.1);
    }
}

#[test]
fn repeated_curved_edge_does_not_cause_distortion() {
    let mut random = ChaCha8Rng::seed_from_u64(44);
    let size = [1920.0, 1080.0];
    let plain = Lens::pinhole(Pixel::new(960.0, 540.0));
    let mut edges = drawn(&mut random, &plain, size);
    let mut curved = || -> Vec<Pixel> {
        let at = |i: i32| {
            let t = f64::from(i) / 8.0;
            let bow = 16.0 * t * (1.0 - t);
            Pixel::new(
                200.0 + 1500.0 * t + 0.3 * normal(&mut random),
                140.0 + bow + 0.3 * normal(&mut random),
            )
        };
        (0..9).map(at).collect()
    };
    edges.extend((0..60).map(|k| edge(curved(), 20 + k)));
    let options = LensOptions {
        principal_point: plain.principal_point,
        is_centre_fixed: true,
        pixel_aspect: 1.0,
        circle: None,
        size,
        fitted: None,
        focal: None,
        sigma: 0.3,
    };
    let fit = LensFit::new(&edges, &options).unwrap();
    assert_eq!(fit.fitted, None, "a curved rail causes no distortion: {:?}", fit.lens);
}

/// Returns a site with parallels and verticals of twelve points each, seen through a lens, with 0.7 px of
/// noise. It has no straight edges.
fn room(lens: Lens, random: &mut ChaCha8Rng) -> (Site, Camera) {
    let size = [1920, 1080];
    let camera = Camera {
        position: WorldPoint::new(0.0, 0.0, 3.0),
        yaw: 0.4,
        pitch: 0.45,
        roll: 0.03,
        focal: 1100.0,
        lens: Lens { focal: 1100.0, ..lens },
        covariance: Covariance::EXACT,
    };
    let mut lines = |kind: Kind, way: [f64; 3], count: usize| {
        let mut segments = Vec::new();
        while segments.len() < count {
            let mut at = |most: f64| random.random_range(0.0..most);
            let pixel = Pixel::new(at(1920.0), at(1080.0));
            let Some(foot) = camera.pixel_to_floor(pixel, 0.0).filter(|foot| foot.x.hypot(foot.y) < 15.0)
            else {
                continue;
            };
            let points: Option<Vec<Pixel>> = (0..12)
                .map(|i| {
                    let t = 4.0 * f64::from(i) / 11.0;
                    let point = WorldPoint::new(foot.x + t * way[0], foot.y + t * way[1], 0.6 * t * way[2]);
                    let shown = camera.world_to_pixel(point)?;
                    let is_inside = (0.0..1920.0).contains(&shown.u) && (0.0..1080.0).contains(&shown.v);
                    is_inside
                        .then(|| Pixel::new(shown.u + 0.7 * normal(random), shown.v + 0.7 * normal(random)))
                })
                .collect();
            segments.extend(points.filter(|points| points[0].distance(points[11]) > 250.0));
        }
        Annotation::from_segments(kind, segments)
    };
    let along = Annotation { id: Some("a".into()), ..lines(Kind::Parallel, [0.6, 0.8, 0.0], 4) };
    let across = lines(Kind::Parallel, [-0.8, 0.6, 0.0], 4);
    let across = Annotation { at_right_angles_to: Some("a".into()), ..across };
    let annotations = vec![lines(Kind::Vertical, [0.0, 0.0, 1.0], 4), along, across];
    let entry = SiteCamera { annotations, ..SiteCamera::new("room", size) };
    (Site { cameras: vec![entry], scene: Some(SceneEntry::EXACT), ..Site::new() }, camera)
}

#[test]
fn distorted_lines_determine_the_lens_without_straight_edges() {
    let mut random = ChaCha8Rng::seed_from_u64(77);
    let centre = Pixel::new(960.0, 540.0);
    let brown = BrownConrady { k1: -0.3, k2: 0.08, ..BrownConrady::default() };
    let distorted = Lens { distortion: Distortion::BrownConrady(brown), ..Lens::pinhole(centre) };
    let (mut inside, mut fitted) = (0, 0);
    const TRIALS: usize = 40;
    for _ in 0..TRIALS {
        let (site, camera) = room(distorted, &mut random);
        let solved = site.calibrate(&Options::default()).write_into(&site);
        let found = solved.cameras[0].camera().unwrap();
        let sigma = found.covariance.sigma(Covariance::FOCAL);
        fitted += usize::from(found.lens.distortion != Distortion::None);
        inside += usize::from(sigma.is_some_and(|sigma| (found.focal - camera.focal).abs() < 1.96 * sigma));
    }
    assert!(fitted == TRIALS && inside >= 35, "{fitted} fitted, {inside} of {TRIALS} inside 95 %");
    for _ in 0..TRIALS {
        let (site, _) = room(Lens::pinhole(centre), &mut random);
        let solved = site.calibrate(&Options::default()).write_into(&site);
        let solution = solved.cameras[0].solution.as_ref().unwrap();
        let of_lens = [Code::UninformativePolyline, Code::UnusedAnnotation];
        assert!(
            solution.distortion.is_none() && !solution.warnings.iter().any(|w| of_lens.contains(&w.code)),
            "straight lines determine no distortion: {:?} {:?}",
            solution.distortion,
            solution.warnings
        );
    }
}

#[test]
fn curved_road_is_reported_and_causes_no_distortion() {
    let (mut site, _) = room(Lens::pinhole(Pixel::new(960.0, 540.0)), &mut ChaCha8Rng::seed_from_u64(78));
    for annotation in &mut site.cameras[0].annotations {
        let is_road = annotation.id.is_some();
        for segment in annotation.segments.iter_mut().flatten() {
            if is_road {
                let curved =
                    |(i, at): (usize, &Pixel)| Pixel::new(at.u + 0.5 * (i as f64 - 5.5).powi(2), at.v);
                *segment = segment.iter().enumerate().map(curved).collect();
            } else {
                *segment = vec![segment[0], segment[11]];
            }
        }
    }
    let solved = site.calibrate(&Options::default());
    let (_, result) = &solved.cameras[0];
    let said: Vec<String> = match result {
        Ok(solution) => {
            assert!(solution.distortion.is_none());
            solution.warnings.iter().map(|warning| warning.message.clone()).collect()
        }
        Err(failure) => panic!("{failure:?}"),
    };
    assert!(said.iter().any(|message| message.contains("a curved edge, or a misplaced point")), "{said:?}");
}
