//! Unknown, cropped and wrongly entered principal points: coverage of the intervals, and findings.

use calib_core::camera::{Camera, Covariance, Lens, Pixel, WorldPoint};
use calib_core::outcome::Code;
use calib_core::single::{Annotation, Kind, Known};
use calib_demo::random::{AnnotationSet, RandomScene, normal};
use calib_site::{
    LensEntry, Options, PrincipalPointEntry, SceneEntry, SceneSigmas, Site, SiteCamera, Solution,
};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

const SIZE: [u32; 2] = [1920, 1080];

/// Standard deviation of the principal point from the image centre in these scenes, in pixels.
const SPREAD_PX: f64 = 40.0;

/// Returns the site of a random scene whose principal point is off the image centre. Also returns the true values in
/// the order of `PARAMETERS`: focal length, pitch, roll and principal point.
fn off_centre(random: &mut ChaCha8Rng, drawn: AnnotationSet) -> (Site, [f64; 5]) {
    let scene = RandomScene::new(random, drawn, None, None);
    let [du, dv] = [0, 1].map(|_| SPREAD_PX * normal(random));
    let mut annotations = scene.noisy(random, 1.0);
    let pixels = annotations.iter_mut().flat_map(|drawn| drawn.segments.iter_mut().flatten().flatten());
    pixels.for_each(|pixel| *pixel = Pixel::new(pixel.u + du, pixel.v + dv));
    let efov = scene.efov.iter().map(|pixel| Pixel::new(pixel.u + du, pixel.v + dv)).collect();
    let camera = SiteCamera {
        annotations,
        efov_px: Some(efov),
        sigma_px: Some(1.0),
        lens: Some(LensEntry::default()),
        ..SiteCamera::new("a", SIZE)
    };
    let truth = [scene.camera.focal, scene.camera.pitch, scene.camera.roll, 960.0 + du, 540.0 + dv];
    (Site { cameras: vec![camera], scene: Some(SceneEntry::EXACT), ..Site::new() }, truth)
}

const PARAMETERS: [usize; 5] =
    [Covariance::FOCAL, Covariance::PITCH, Covariance::ROLL, Covariance::CENTRE, Covariance::CENTRE + 1];

/// Returns the errors of focal length, pitch, roll and principal point, divided by their standard deviations.
/// `None` if the lines do not determine the camera.
fn standardised(site: &Site, truth: [f64; 5]) -> Option<[f64; 5]> {
    let solution = site.calibrate(&Options::default()).cameras.remove(0).1.ok()?;
    let camera = solution.camera()?;
    let Pixel { u, v } = camera.lens.principal_point;
    let found = [camera.focal, camera.pitch, camera.roll, u, v];
    let sigmas = PARAMETERS.map(|index| camera.covariance.sigma(index));
    // If the standard deviation is more than a fifth of the focal length, the error is not normal.
    sigmas[0].filter(|sigma| *sigma < 0.2 * camera.focal)?;
    let mut errors = [0.0; 5];
    for (k, error) in errors.iter_mut().enumerate() {
        *error = (found[k] - truth[k]) / sigmas[k]?;
    }
    Some(errors)
}

#[test]
fn intervals_include_an_unknown_principal_point() {
    for drawn in [AnnotationSet::Directions, AnnotationSet::Lengths] {
        let mut random = ChaCha8Rng::seed_from_u64(23);
        let mut errors = Vec::new();
        for _ in 0..250 {
            let (mut site, truth) = off_centre(&mut random, drawn);
            let entry = PrincipalPointEntry { value: Pixel::new(960.0, 540.0), sigma: Some(SPREAD_PX) };
            site.cameras[0].lens.get_or_insert_default().principal_point_px = Some(entry);
            errors.extend(standardised(&site, truth));
        }
        let share = |of: f64| of / errors.len() as f64;
        let rms: [f64; 5] =
            std::array::from_fn(|k| share(errors.iter().map(|of| of[k] * of[k]).sum::<f64>()).sqrt());
        let inside: [f64; 5] =
            std::array::from_fn(|k| share(errors.iter().filter(|of| of[k].abs() < 1.96).count() as f64));
        println!("{drawn:?}: {} of 250, rms {rms:.2?}, 95 % contain {inside:.3?}", errors.len());
        assert!(errors.len() > 200);
        // With 250 scenes, a root mean square has a standard deviation of 4.5 %, a share one of 1.4 %. Equal
        // lengths are less linear over the spread of the principal point than directions.
        let least = if matches!(drawn, AnnotationSet::Directions) { 0.92 } else { 0.88 };
        assert!(rms.iter().all(|rms| (0.86..1.16).contains(rms)), "{rms:?}");
        assert!(inside.iter().all(|inside| (least..=0.99).contains(inside)), "{inside:?}");
    }
}

#[test]
fn correct_lines_are_not_rejected_because_of_the_principal_point() {
    let mut random = ChaCha8Rng::seed_from_u64(31);
    let mut with_outliers = 0;
    for _ in 0..200 {
        let (mut site, _) = off_centre(&mut random, AnnotationSet::Lengths);
        let entry = PrincipalPointEntry { value: Pixel::new(960.0, 540.0), sigma: Some(SPREAD_PX) };
        site.cameras[0].lens.get_or_insert_default().principal_point_px = Some(entry);
        let Ok(solution) = site.calibrate(&Options::default()).cameras.remove(0).1 else { continue };
        with_outliers += i32::from(solution.residuals.iter().any(|residual| residual.outlier));
    }
    // Each site has some ten lines, and a line is tested at 1 %. Lines that are rejected at a principal point far
    // off are accepted again.
    assert!(with_outliers <= 6, "{with_outliers} of 200");
}

#[test]
fn exact_scenes_have_the_principal_point_in_the_image_centre() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let (mut site, _) = off_centre(&mut random, AnnotationSet::Directions);
    let centre = |site: &Site| {
        let solution = site.calibrate(&Options::default()).cameras.remove(0).1.unwrap();
        (solution.principal_point_px, solution.sigma.unwrap().cx_px)
    };
    assert_eq!(centre(&site), (Pixel::new(960.0, 540.0), None));
    site.scene = None;
    let (estimated, sigma) = centre(&site);
    assert_ne!(estimated, Pixel::new(960.0, 540.0));
    assert!(sigma.is_some_and(|sigma| (1.0..43.0).contains(&sigma)), "{sigma:?}");
    let known = PrincipalPointEntry::known(Pixel::new(950.0, 550.0));
    site.cameras[0].lens.get_or_insert_default().principal_point_px = Some(known);
    assert_eq!(centre(&site), (Pixel::new(950.0, 550.0), None));
}

#[test]
fn entry_of_the_principal_point_survives_the_file() {
    let text = r#"{"format": "calib-site", "version": 1, "cameras": [
        {"id": "a", "size_px": [640, 480], "lens": {"principal_point_px": [321.5, 240]}},
        {"id": "b", "size_px": [640, 480], "lens": {"principal_point_px": {"value": [300, 250], "sigma": 12}}}]}"#;
    let site = Site::from_json(text).unwrap();
    assert_eq!(Site::from_json(&site.to_json()).unwrap(), site);
    for (wrong, part) in [
        ("[300]", "principal_point_px"),
        (r#"{"value": [300, 250]}"#, "sigma"),
        (r#"{"value": [300, 250], "sigma": -1}"#, "sigma"),
        ("\"centre\"", "two pixel coordinates"),
    ] {
        let error = Site::from_json(&text.replace("[321.5, 240]", wrong)).unwrap_err().to_string();
        assert!(error.contains(part), "{wrong}: {error}");
    }
}

/// Returns the site of a camera with this principal point. It sees six verticals and five floor lines in each of two
/// directions at right angles, annotated with half a pixel of noise.
fn hall(principal_point: Pixel, size: [u32; 2]) -> Site {
    let camera = Camera {
        position: WorldPoint::new(0.0, 0.0, 4.0),
        yaw: 0.0,
        pitch: 28_f64.to_radians(),
        roll: 1.5_f64.to_radians(),
        focal: 1100.0,
        lens: Lens::pinhole(principal_point),
        covariance: Covariance::EXACT,
    };
    let mut random = ChaCha8Rng::seed_from_u64(41);
    let mut line = |ends: [[f64; 3]; 2]| -> Vec<Pixel> {
        let seen = ends.map(|[x, y, z]| camera.world_to_pixel(WorldPoint::new(x, y, z)).unwrap_or_default());
        let noisy = seen.map(|at| [at.u, at.v].map(|c| c + 0.5 * normal(&mut random)));
        noisy.map(Pixel::from).to_vec()
    };
    let places = [-2.4, -1.2, 0.0, 1.2, 2.4];
    let verticals = [(-3.0, 9.0), (-1.0, 10.0), (1.0, 8.0), (3.0, 9.0), (-2.0, 6.0), (2.0, 6.0)]
        .map(|(x, y)| line([[x, y, 0.0], [x, y, 2.0]]));
    let along = places.map(|x| line([[x - 1.0, 5.0, 0.0], [x + 2.0, 10.0, 0.0]]));
    let across = places.map(|y| line([[-3.0, 8.5 + y, 0.0], [3.0, 4.9 + y, 0.0]]));
    let parallel = |id: &str, lines: [Vec<Pixel>; 5]| Annotation {
        id: Some(id.into()),
        ..Annotation::from_segments(Kind::Parallel, lines.to_vec())
    };
    let annotations = vec![
        Annotation::from_segments(Kind::Vertical, verticals.to_vec()),
        parallel("along", along),
        Annotation { at_right_angles_to: Some("along".into()), ..parallel("across", across) },
    ];
    Site { cameras: vec![SiteCamera { annotations, ..SiteCamera::new("hall", size) }], ..Site::new() }
}

fn solve(site: &Site) -> Solution {
    let solved = site.calibrate(&Options::default()).cameras.remove(0).1;
    solved.unwrap_or_else(|failure| panic!("{}", failure.message))
}

fn messages(solution: &Solution, code: Code) -> Vec<&str> {
    let of_code = solution.warnings.iter().filter(|warning| warning.code == code);
    of_code.map(|warning| warning.message.as_str()).collect()
}

#[test]
fn principal_point_of_a_cropped_image_is_found_and_reported() {
    for at in [Pixel::new(300.0, 700.0), Pixel::new(1500.0, 300.0), Pixel::new(960.0, 1100.0)] {
        let solution = solve(&hall(at, SIZE));
        let sigma = solution.sigma.as_ref().unwrap();
        let sigmas = [sigma.cx_px.unwrap(), sigma.cy_px.unwrap(), sigma.focal_px.unwrap()];
        let found = solution.principal_point_px;
        let off = [found.u - at.u, found.v - at.v, solution.focal_px - 1100.0];
        assert!((0..3).all(|k| off[k].abs() < 3.0 * sigmas[k]), "{at:?}: {off:?} {sigmas:?}");
        assert!(messages(&solution, Code::PrincipalPoint)[0].contains("cropped"), "{:?}", solution.warnings);
        assert!(
            messages(&solution, Code::Misfit).is_empty() && messages(&solution, Code::Outlier).is_empty()
        );
    }
    let centred = solve(&hall(Pixel::new(975.0, 530.0), SIZE));
    assert!(messages(&centred, Code::PrincipalPoint).is_empty(), "{:?}", centred.warnings);
}

#[test]
fn exchanged_coordinates_of_the_principal_point_are_named() {
    let truth = Pixel::new(1232.0, 1024.0);
    let mut site = hall(truth, [2464, 2048]);
    let mut solution_with = |u: f64, v: f64| {
        let lens = site.cameras[0].lens.get_or_insert_default();
        lens.principal_point_px = Some(PrincipalPointEntry::known(Pixel::new(u, v)));
        solve(&site)
    };
    let exchanged = solution_with(1024.0, 1232.0);
    assert!(!messages(&exchanged, Code::Misfit).is_empty(), "the entered value is used");
    assert!(messages(&exchanged, Code::PrincipalPoint)[0].contains("swapped"), "{:?}", exchanged.warnings);
    let halved = solution_with(616.0, 512.0);
    assert!(!messages(&halved, Code::PrincipalPoint)[0].contains("swapped"), "{:?}", halved.warnings);
    assert!(messages(&solution_with(1232.0, 1024.0), Code::PrincipalPoint).is_empty());
}

#[test]
fn lens_of_another_resolution_is_named_with_both_sizes() {
    let size = [1280, 960];
    let with_lens = |factor: f64| {
        let mut site = hall(Pixel::new(640.0, 480.0), size);
        let [u, v] = [640.0 * factor, 480.0 * factor];
        site.cameras[0].lens = Some(LensEntry {
            focal_px: Some(Known::fixed(900.0 * factor)),
            principal_point_px: Some(PrincipalPointEntry::known(Pixel::new(u, v))),
            ..LensEntry::default()
        });
        solve(&site)
    };
    for (factor, stated) in [(0.25, "320 x 240"), (2.5, "3200 x 2400")] {
        let solution = with_lens(factor);
        let found = messages(&solution, Code::TwoResolutions);
        assert!(
            found.len() == 1 && found[0].contains(stated) && found[0].contains("1280 x 960"),
            "{solution:?}"
        );
    }
    assert!(messages(&with_lens(1.0), Code::TwoResolutions).is_empty());
}

#[test]
fn unknown_slope_of_the_ground_is_asked_about() {
    let mut road = hall(Pixel::new(960.0, 540.0), SIZE);
    let height = Some(Known { value: 4.0, sigma: Some(0.05), fixed: false });
    road.cameras[0].height_m = height;
    let square = solve(&road);
    assert!(messages(&square, Code::FloorSlope).is_empty(), "two directions: {:?}", square.warnings);
    // The road scene has verticals and one floor direction.
    road.cameras[0].annotations.truncate(2);
    let open = solve(&road);
    assert!(messages(&open, Code::FloorSlope).len() == 1, "{:?} {:?}", open.warnings, open.sigma);
    assert!(Code::FloorSlope.fails_check());
    for tilt in [0.3, 3.4] {
        let stated = SceneSigmas { floor_tilt_sigma_deg: Some(tilt), ..SceneSigmas::default() };
        road.scene = Some(SceneEntry::Sigmas(stated));
        let solution = solve(&road);
        assert!(messages(&solution, Code::FloorSlope).is_empty(), "{:?}", solution.warnings);
    }
}
