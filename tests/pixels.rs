//! Images whose pixels are not square: with the pixel aspect they calibrate like square ones, and without it the
//! image size is reported.

use calib_core::camera::{Camera, Covariance, Distortion, Lens, Pixel, WorldPoint};
use calib_core::outcome::Code;
use calib_core::single::{Annotation, Prior};
use calib_demo::random::{AnnotationSet, RandomScene, normal};
use calib_formats::{ExportOptions, export, format, import};
use calib_site::{
    ControlPointEntry, LensEntry, Method, Options, PixelAspectEntry, SceneEntry, Site, SiteCamera, Solution,
    Stage,
};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

/// Returns a site with these annotations on an image of 1920 x 1080 pixels, squeezed to another pixel aspect.
fn squeezed(annotations: &[Annotation], aspect: f64) -> Site {
    let mut annotations = annotations.to_vec();
    let pixels = annotations.iter_mut().flat_map(|drawn| drawn.segments.iter_mut().flatten().flatten());
    pixels.for_each(|pixel| pixel.v *= aspect);
    let camera = SiteCamera {
        annotations,
        sigma_px: Some(1.0),
        lens: Some(LensEntry { pixel_aspect: Some(PixelAspectEntry::Known(aspect)), ..LensEntry::default() }),
        ..SiteCamera::new("a", [1920, (1080.0 * aspect) as u32])
    };
    Site { cameras: vec![camera], scene: Some(SceneEntry::EXACT), ..Site::new() }
}

fn solve(site: &Site) -> Option<Solution> {
    site.calibrate(&Options::default()).cameras.remove(0).1.ok()
}

#[test]
fn a_known_aspect_gives_the_camera_of_square_pixels() {
    let mut random = ChaCha8Rng::seed_from_u64(61);
    for aspect in [0.5, 2.0] {
        for drawn in [AnnotationSet::Directions, AnnotationSet::Lengths] {
            let mut count = 0;
            for _ in 0..20 {
                let scene = RandomScene::new(&mut random, drawn, None, None);
                let (Some(one), Some(other)) = (
                    solve(&squeezed(&scene.annotations, 1.0)).and_then(|solution| solution.camera()),
                    solve(&squeezed(&scene.annotations, aspect)).and_then(|solution| solution.camera()),
                ) else {
                    continue;
                };
                let sigma = |camera: &Camera| camera.covariance.sigma(Covariance::FOCAL);
                // A prior on the focal length weighs differently against lines with other noise.
                if [one, other]
                    .iter()
                    .any(|camera| sigma(camera).is_none_or(|sigma| sigma > 0.1 * camera.focal))
                {
                    continue;
                }
                let near = |a: f64, b: f64| (a - b).abs() < 1e-5 * (1.0 + a.abs());
                let is_near = near(one.focal, other.focal) && near(one.pitch, other.pitch);
                assert!(is_near && near(one.roll, other.roll), "{one:?} {other:?}");
                assert_eq!(other.lens.pixel_aspect, aspect);
                let pixel = Pixel::new(700.0, 800.0);
                let floors = [(one, pixel), (other, Pixel::new(pixel.u, aspect * pixel.v))]
                    .map(|(camera, pixel)| camera.pixel_to_floor(pixel, 0.0));
                if let [Some(a), Some(b)] = floors {
                    assert!(
                        a.distance(b) < 1e-3 * (1.0 + a.distance(one.position.on_floor())),
                        "{a:?} {b:?}"
                    );
                }
                count += 1;
            }
            assert!(count > 10, "{count}");
        }
    }
}

#[test]
fn noise_of_squeezed_pixels_is_that_of_the_image() {
    let mut random = ChaCha8Rng::seed_from_u64(62);
    let (mut errors, mut count) = ([0.0; 2], 0.0);
    for _ in 0..120 {
        let scene = RandomScene::new(&mut random, AnnotationSet::Directions, None, None);
        let exact = squeezed(&scene.annotations, 2.0);
        let mut site = exact.clone();
        let moved = RandomScene { annotations: exact.cameras[0].annotations.clone(), ..scene.clone() };
        site.cameras[0].annotations = moved.noisy(&mut random, 1.0);
        let Some(camera) = solve(&site).and_then(|solution| solution.camera()) else { continue };
        let off = [camera.roll - scene.camera.roll, camera.pitch - scene.camera.pitch];
        let sigmas = [Covariance::ROLL, Covariance::PITCH].map(|index| camera.covariance.sigma(index));
        let [Some(roll), Some(pitch)] = sigmas else { continue };
        errors[0] += (off[0] / roll).powi(2);
        errors[1] += (off[1] / pitch).powi(2);
        count += 1.0;
    }
    let rms = errors.map(|sum: f64| (sum / count).sqrt());
    println!("{count} scenes, root mean square over sigma {rms:.2?}");
    assert!(count > 100.0 && rms.iter().all(|rms| (0.85..1.15).contains(rms)), "{rms:?}");
}

/// Returns the errors of focal length, pitch, roll and pixel aspect, divided by their standard deviations. `None`
/// if the lines do not determine the camera.
fn standardised(site: &Site, truth: &Camera, aspect: f64) -> Option<[f64; 4]> {
    const PARAMETERS: [usize; 4] =
        [Covariance::FOCAL, Covariance::PITCH, Covariance::ROLL, Covariance::ASPECT];
    let solution = solve(site)?;
    let camera = solution.camera()?;
    assert_eq!(solution.sigma.unwrap().pixel_aspect, camera.covariance.sigma(Covariance::ASPECT));
    let off = [
        camera.focal - truth.focal,
        camera.pitch - truth.pitch,
        camera.roll - truth.roll,
        camera.lens.pixel_aspect - aspect,
    ];
    let sigmas = PARAMETERS.map(|index| camera.covariance.sigma(index));
    sigmas[0].filter(|sigma| *sigma < 0.1 * camera.focal)?;
    sigmas[3].filter(|sigma| *sigma < 0.1 * aspect)?;
    let mut errors = [0.0; 4];
    for k in 0..4 {
        errors[k] = off[k] / sigmas[k]?;
    }
    Some(errors)
}

/// Asserts that standardised errors are normal: their root mean square, and the share inside of 95 % intervals.
fn assert_normal(errors: &[[f64; 4]], of: &str) {
    let share = |sum: f64| sum / errors.len() as f64;
    let rms: [f64; 4] =
        std::array::from_fn(|k| share(errors.iter().map(|of| of[k] * of[k]).sum::<f64>()).sqrt());
    let inside: [f64; 4] =
        std::array::from_fn(|k| share(errors.iter().filter(|of| of[k].abs() < 1.96).count() as f64));
    println!("{of}: {} scenes, rms {rms:.2?}, 95 % contain {inside:.3?}", errors.len());
    assert!(rms.iter().all(|rms| (0.85..1.15).contains(rms)), "{of}: {rms:?}");
    assert!(inside.iter().all(|inside| (0.91..=0.99).contains(inside)), "{of}: {inside:?}");
}

#[test]
fn intervals_include_an_uncertain_aspect() {
    /// Standard deviation of the simulated pixel aspect about 1, and of its prior.
    const SIGMA: f64 = 0.01;
    let mut random = ChaCha8Rng::seed_from_u64(64);
    let mut errors = Vec::new();
    for _ in 0..250 {
        let scene = RandomScene::new(&mut random, AnnotationSet::Directions, None, None);
        let aspect = 1.0 + SIGMA * normal(&mut random);
        let mut site = squeezed(&scene.noisy(&mut random, 1.0), aspect);
        let prior = PixelAspectEntry::Prior(Prior { value: 1.0, sigma: SIGMA });
        site.cameras[0].lens.get_or_insert_default().pixel_aspect = Some(prior);
        errors.extend(standardised(&site, &scene.camera, aspect));
    }
    assert!(errors.len() > 180, "{}", errors.len());
    assert_normal(&errors, "uncertain aspect");
}

#[test]
fn lines_in_three_directions_determine_the_aspect() {
    let mut random = ChaCha8Rng::seed_from_u64(65);
    let mut errors = Vec::new();
    for round in 0..200 {
        let aspect = [0.46, 0.9, 1.33, 2.0][round % 4];
        let scene = RandomScene::new(&mut random, AnnotationSet::Directions, None, None);
        let exact = squeezed(&scene.annotations, aspect);
        let mut site = exact.clone();
        let drawn = RandomScene { annotations: exact.cameras[0].annotations.clone(), ..scene.clone() };
        site.cameras[0].annotations = drawn.noisy(&mut random, 1.0);
        site.cameras[0].lens.get_or_insert_default().pixel_aspect = Some(PixelAspectEntry::Fit);
        errors.extend(standardised(&site, &scene.camera, aspect));
    }
    assert!(errors.len() > 100, "{}", errors.len());
    assert_normal(&errors, "fitted aspect");
}

#[test]
fn known_points_determine_the_aspect() {
    let mut random = ChaCha8Rng::seed_from_u64(66);
    let mut count = 0;
    for round in 0..40 {
        let aspect = [0.46, 2.0][round % 2];
        let scene = RandomScene::new(&mut random, AnnotationSet::Directions, None, None);
        let truth = scene.camera;
        let mut site = squeezed(&[], aspect);
        let entry = &mut site.cameras[0];
        entry.lens.get_or_insert_default().pixel_aspect = Some(PixelAspectEntry::Fit);
        for (u, v) in [(300.0, 1000.0), (1700.0, 980.0), (700.0, 700.0), (1300.0, 640.0), (950.0, 850.0)] {
            let Some(floor) = truth.pixel_to_floor(Pixel::new(u, v), 0.0) else { continue };
            let px = Pixel::new(u + normal(&mut random), aspect * v + normal(&mut random));
            let world_m = Some(WorldPoint::new(floor.x, floor.y, 0.0));
            entry.control_points.push(ControlPointEntry { world_m, ..ControlPointEntry::new(px) });
        }
        if entry.control_points.len() < 5 {
            continue;
        }
        let Some(camera) = solve(&site).and_then(|solution| solution.camera()) else { continue };
        let Some(sigma) = camera.covariance.sigma(Covariance::ASPECT).filter(|sigma| *sigma < 0.1 * aspect)
        else {
            continue;
        };
        let off = (camera.lens.pixel_aspect - aspect) / sigma;
        assert!(off.abs() < 4.5, "{off} {sigma} {}", camera.lens.pixel_aspect);
        count += 1;
    }
    assert!(count > 20, "{count}");
}

#[test]
fn a_coded_size_without_an_aspect_is_reported() {
    let mut random = ChaCha8Rng::seed_from_u64(63);
    let scene = RandomScene::new(&mut random, AnnotationSet::Directions, None, Some(30.0));
    let mut site = squeezed(&scene.annotations, 1.0);
    let has_doubt =
        |site: &Site| solve(site).is_some_and(|solution| solution.has_warning(Code::PixelsNotSquare));
    assert!(!has_doubt(&site), "1920 x 1080");
    site.cameras[0].size_px = [704, 576];
    site.cameras[0]
        .annotations
        .iter_mut()
        .flat_map(|drawn| drawn.segments.iter_mut().flatten().flatten())
        .for_each(|pixel| *pixel = Pixel::new(pixel.u * 704.0 / 1920.0, pixel.v * 576.0 / 1080.0));
    assert!(!has_doubt(&site), "the aspect is entered");
    site.cameras[0].lens = None;
    assert!(has_doubt(&site), "nothing is entered");
    assert!(Code::PixelsNotSquare.fails_check());
}

#[test]
fn formats_keep_both_focal_lengths() {
    let lens = Lens {
        focal: 700.0,
        pixel_aspect: 2.0,
        distortion: Distortion::BrownConrady(calib_core::BrownConrady { k1: -0.1, ..Default::default() }),
        ..Lens::pinhole(Pixel::new(470.0, 560.0))
    };
    let camera = Camera {
        position: WorldPoint::new(1.0, 2.0, 4.0),
        yaw: 0.3,
        pitch: 0.5,
        roll: 0.02,
        focal: 700.0,
        lens,
        covariance: Covariance::EXACT,
    };
    let solution = Solution::from_camera(&camera, Method::Given, Stage::Placed);
    let entry = SiteCamera { solution: Some(solution), ..SiteCamera::new("a", [960, 1080]) };
    let site = Site { cameras: vec![entry], ..Site::new() };
    for name in ["opencv", "ros", "kalibr", "colmap", "nvidia", "nerfstudio", "wildtrack"] {
        let format = format(name).unwrap_or_else(|| panic!("{name}"));
        let files = export(format, &site, &ExportOptions::default())
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        let back = import(format, &files.files).unwrap_or_else(|error| panic!("{name}: {error}")).site;
        let found = back.cameras[0].lens();
        assert!((found.pixel_aspect - 2.0).abs() < 1e-6, "{name}: {}", found.pixel_aspect);
        // These formats do not contain the distortion.
        if ["nvidia", "wildtrack"].contains(&name) {
            continue;
        }
        for pixel in [Pixel::new(100.0, 100.0), Pixel::new(900.0, 1000.0)] {
            let [a, b] = [lens, found].map(|lens| lens.undistort(pixel).unwrap_or_else(|| panic!("{name}")));
            assert!(a.distance(b) < 0.01, "{name}: {a:?} {b:?}");
        }
    }
}
