//! The quality gate: what is no drawing of a scene does not pass it, and what is unknown is not taken for exact.

#![allow(clippy::unwrap_used, reason = "a test that fails may panic")]

use calib_core::{Annotation, Code, Kind, Known, Options, Pixel, Site, SiteCamera, Solution};
use calib_demo::random::{Drawn, RandomScene};
use calib_tests::Scratch;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

const SIZE: [u32; 2] = [1920, 1080];

fn any_pixel(random: &mut ChaCha8Rng) -> Pixel {
    Pixel::new(random.random_range(0.0..1920.0), random.random_range(0.0..1080.0))
}

fn any_segments(random: &mut ChaCha8Rng, count: usize) -> Vec<Vec<Pixel>> {
    (0..count).map(|_| vec![any_pixel(random), any_pixel(random)]).collect()
}

/// A camera on whose image lines are drawn wherever chance would have them, of every kind.
fn scribbled(random: &mut ChaCha8Rng, index: usize) -> SiteCamera {
    let mut camera = SiteCamera::new(format!("c{index}"), SIZE);
    let mut draw = |kind: Kind, groups: usize, least: usize, most: usize| {
        for _ in 0..groups {
            let count = random.random_range(least..=most);
            if count > 0 {
                camera.annotations.push(Annotation::of_segments(kind, any_segments(random, count)));
            }
        }
    };
    draw(Kind::Vertical, 1, 0, 5);
    draw(Kind::Parallel, 2, 0, 4);
    draw(Kind::Perpendicular, 1, 2, 3);
    draw(Kind::EqualLength, 1, 0, 4);
    if random.random_bool(0.2) {
        let [foot, head] = [(); 2].map(|()| any_pixel(random));
        let height_m = Some(Known::prior(1.75, 0.07));
        let upright =
            Annotation { foot: Some(foot), head: Some(head), height_m, ..Annotation::new(Kind::Upright) };
        camera.annotations.push(upright);
    }
    camera
}

#[test]
fn lines_at_random_do_not_pass() {
    let count: usize =
        std::env::var("CALIB_SCRIBBLES").ok().and_then(|count| count.parse().ok()).unwrap_or(300);
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut site = Site::new();
    site.cameras = (0..count).map(|index| scribbled(&mut random, index)).collect();
    let scratch = Scratch::new();
    scratch.write("site.json", site.to_json());
    let _ = scratch.calib(&["solve", "site.json", "-o", "solved.json", "--no-refine"]);
    let solved = scratch.read_json("solved.json");
    let verdicts = scratch.calib(&["check", "solved.json", "--format", "json"]).expect_code(4).json();
    let (mut solutions, mut passed, mut exact) = (0, 0, 0);
    for (camera, verdict) in
        solved["cameras"].as_array().unwrap().iter().zip(verdicts["cameras"].as_array().unwrap())
    {
        let solution = &camera["solution"];
        solutions += usize::from(solution.is_object());
        if verdict["ok"] == json!(true) {
            passed += 1;
            let rel = solution["sigma"]["floor_length_rel"].as_f64().unwrap();
            exact += usize::from(rel < 0.01);
            println!(
                "{} {rel} chi2 {} dof {} {}",
                camera["id"], solution["chi2"], solution["dof"], solution["warnings"]
            );
        }
    }
    println!("of {count} {solutions} have a solution, {passed} pass, {exact} of them under 1 %");
    assert!(solutions > count / 4, "most of them are solved: the gate is what keeps them out");
    assert!(passed * 100 <= count && exact == 0, "{passed} of {count} pass, {exact} of them under 1 %");
}

/// A scene whose camera is turned by `roll` degrees about its axis, on an image large enough for all of it.
fn rolled(scene: &RandomScene, roll: f64, random: &mut ChaCha8Rng) -> SiteCamera {
    const SIDE: u32 = 2400;
    let (sin, cos) = (-roll.to_radians()).sin_cos();
    let turn = |pixel: &mut Pixel| {
        let (x, y) = (pixel.u - 960.0, pixel.v - 540.0);
        let middle = 0.5 * f64::from(SIDE);
        *pixel = Pixel::new(middle + cos * x - sin * y, middle + sin * x + cos * y);
    };
    let mut camera = SiteCamera::new("a", [SIDE; 2]);
    camera.annotations = scene.noisy(random, 1.0);
    camera.annotations.iter_mut().flat_map(|a| a.segments.iter_mut().flatten().flatten()).for_each(turn);
    let mut efov = scene.efov.clone();
    efov.iter_mut().for_each(turn);
    camera.efov_px = Some(efov);
    camera
}

fn solved(camera: SiteCamera) -> Solution {
    let site = Site { cameras: vec![camera], ..Site::new() };
    site.calibrate(&Options::default()).cameras.remove(0).1.unwrap()
}

fn has(solution: &Solution, code: Code) -> bool {
    solution.warnings.iter().any(|warning| warning.code == code)
}

#[test]
fn a_camera_beyond_its_side_is_not_taken_for_one_that_looks_up() {
    const ROLL: f64 = -120.0;
    let mut random = ChaCha8Rng::seed_from_u64(3);
    for _ in 0..10 {
        let scene = RandomScene::new(&mut random, Drawn::Directions, Some(70.0), Some(30.0));
        let roll = scene.camera.roll.to_degrees() + ROLL;
        let near = |of_roll: f64, pitch: f64| (of_roll - roll).abs() < 4.0 && (pitch - 30.0).abs() < 4.0;
        let is_true = |solution: &Solution| near(solution.roll_deg.unwrap(), solution.pitch_deg.unwrap());
        let with_floor = rolled(&scene, ROLL, &mut random);
        // The field of view lies on the floor.
        let solution = solved(with_floor.clone());
        assert!(is_true(&solution), "{:?} {:?}", solution.roll_deg, solution.pitch_deg);
        // Without it, lines alone cannot tell: both are shown.
        let bare = SiteCamera { efov_px: None, ..with_floor };
        let solution = solved(bare.clone());
        let others = &solution.alternatives;
        assert!(is_true(&solution) || others.iter().any(|other| near(other.roll_deg, other.pitch_deg)));
        assert!(has(&solution, Code::TwoSolutions), "{:?}", solution.warnings);
        // A belief decides.
        let mut believed = bare;
        believed.lens.get_or_insert_default().pitch_deg = Some(Known::prior(30.0, 10.0));
        let solution = solved(believed);
        assert!(is_true(&solution), "{:?} {:?}", solution.roll_deg, solution.pitch_deg);
        assert!(!has(&solution, Code::TwoSolutions));
    }
}

#[test]
fn a_line_drawn_again_says_nothing_more() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    for _ in 0..10 {
        let scene = RandomScene::new(&mut random, Drawn::Directions, None, None);
        let mut once = SiteCamera::new("a", SIZE);
        (once.annotations, once.efov_px) = (scene.noisy(&mut random, 1.0), Some(scene.efov.clone()));
        let mut often = once.clone();
        for drawn in often.annotations.iter_mut().filter(|drawn| drawn.kind == Kind::Vertical) {
            let segments = drawn.segments.as_mut().unwrap();
            *segments = segments.iter().flat_map(|segment| vec![segment.clone(); 60]).collect();
        }
        let [once, often] = [once, often].map(solved);
        let sigma = |solution: &Solution| solution.sigma.as_ref().unwrap().pitch_deg.unwrap();
        assert!((sigma(&often) / sigma(&once) - 1.0).abs() < 1e-6, "{} {}", sigma(&often), sigma(&once));
        assert_eq!(often.dof, once.dof);
        let px = |solution: &Solution| solution.residuals[0].px;
        assert!(
            (px(&often) - px(&once)).abs() < 1e-6,
            "a residual is that of the drawing, not a share of it"
        );
    }
}

#[test]
fn lines_switched_off_leave_no_certain_camera_on_its_side() {
    let kinds = [Kind::Vertical, Kind::Parallel, Kind::Perpendicular, Kind::EqualLength, Kind::Upright];
    let site = calib_demo::demo_site().site;
    let mut tilted = 0;
    for which in 0..1 << kinds.len() {
        let is_off =
            |kind: Kind| kinds.iter().position(|&other| other == kind).is_some_and(|k| which >> k & 1 == 1);
        let mut less = site.clone();
        for drawn in less.cameras.iter_mut().flat_map(|camera| &mut camera.annotations) {
            drawn.off |= is_off(drawn.kind);
        }
        let report = less.calibrate(&Options { refine: false, ..Options::default() });
        for (index, result) in &report.cameras {
            let Ok(solution) = result else { continue };
            let Some(roll) = solution.roll_deg else { continue };
            let fails = solution.warnings.iter().any(|warning| warning.code.fails_check());
            let (id, sigma) = (&less.cameras[*index].id, solution.sigma.as_ref().and_then(|s| s.roll_deg));
            if roll.abs() > 10.0 {
                println!(
                    "{which:b} {id}: roll {roll} {sigma:?} {:?}",
                    solution.warnings.iter().map(|w| w.code).collect::<Vec<_>>()
                );
                tilted += 1;
            }
            assert!(roll.abs() < 10.0 || fails, "{id} without {which:b}: roll {roll} {sigma:?}");
        }
    }
    println!("{tilted} are tilted, and say so");
}

#[test]
fn a_camera_without_errors_in_its_file_has_unknown_ones() {
    let scratch = Scratch::new();
    let site = |sigma: &str| {
        format!(
            r#"{{"format": "calib-site", "version": 1, "cameras": [{{"id": "door", "size_px": [1920, 1080],
            "solution": {{"method": "given", "stage": "placed", "position_m": [0, 0, 3], "yaw_deg": 0, "pitch_deg": 30,
            "roll_deg": 0, "focal_px": 1400, "principal_point_px": [960, 540]{sigma}}}}}]}}"#
        )
    };
    let code = |run: &Value| run["cameras"][0]["failed"][0]["code"].clone();
    scratch.write("site.json", site(""));
    let refused =
        scratch.calib(&["check", "site.json", "--format", "json", "--explain"]).expect_code(4).json();
    assert_eq!(code(&refused), "uncertainty-unknown");
    scratch.calib(&["check", "site.json", "--allow", "uncertainty-unknown"]).expect_code(0);
    scratch.calib(&["check", "site.json", "--allow", "weak"]).expect_code(2);
    let pixel = Pixel::new(960.0, 800.0);
    let of = |text: &str| {
        Site::from_json(text).unwrap().cameras[0].camera().unwrap().floor_covariance(pixel, 1.0).unwrap()
    };
    assert!(of(&site("")).calibration.is_none() && of(&site("")).worst_sigma().is_none());
    let known = of(&site(r#", "sigma": {"z_m": 0.03, "pitch_deg": 0.2}"#));
    assert!(known.worst_sigma().is_some_and(|sigma| sigma > 0.01));
    scratch.write("known.json", site(r#", "sigma": {"z_m": 0.03, "pitch_deg": 0.2}"#));
    scratch.calib(&["check", "known.json"]).expect_code(0);
    // Below the floor, and toward the sky.
    scratch.write("below.json", site("").replace("[0, 0, 3]", "[0, 0, -3]"));
    scratch.write("sky.json", site("").replace(r#""pitch_deg": 30"#, r#""pitch_deg": -50"#));
    for (file, expected) in [("below.json", "below-floor"), ("sky.json", "no-floor")] {
        let run = scratch.calib(&["check", file, "--format", "json", "--explain"]).expect_code(4).json();
        assert_eq!(code(&run), expected);
    }
}

#[test]
fn cameras_that_were_solved_together_err_together() {
    let demo = calib_demo::demo_site_without_plan();
    let site = demo.site.calibrate(&Options::default()).write_into(&demo.site);
    let site = Site::from_json(&site.to_json()).unwrap();
    let pairs = &site.solution.as_ref().unwrap().cross_covariances;
    assert!(!pairs.is_empty());
    let camera = |id: &str| site.camera(id).unwrap().camera().unwrap();
    let own = |id: &str, at: Pixel| camera(id).floor_covariance(at, 1.0).unwrap().calibration.unwrap();
    let (mut apart, mut alone, mut count) = (0.0, 0.0, 0);
    for pair in pairs {
        let [a, b] = pair.cameras.each_ref().map(String::as_str);
        for pixel in [(500.0, 700.0), (960.0, 600.0), (1400.0, 800.0)].map(|(u, v)| Pixel::new(u, v)) {
            let Some(floor) = camera(a).pixel_to_floor(pixel, 0.0) else { continue };
            let Some(there) = camera(b).world_to_pixel(floor.at_height(0.0)) else { continue };
            let Some(between) = site.floor_covariance_between([(a, pixel), (b, there)]) else { continue };
            let turned = site.floor_covariance_between([(b, there), (a, pixel)]).unwrap();
            for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                assert!((between[i][j] - turned[j][i]).abs() < 1e-12 + 1e-9 * between[i][j].abs());
            }
            let (ours, theirs) = (own(a, pixel), own(b, there));
            let sum = ours[0][0] + ours[1][1] + theirs[0][0] + theirs[1][1];
            let difference = sum - 2.0 * (between[0][0] + between[1][1]);
            assert!(difference > -1e-9, "{a} {b}: {difference}");
            (apart, alone, count) = (apart + difference, alone + sum, count + 1);
        }
    }
    println!("{count} points: {} m apart, {} m as if independent", apart.sqrt(), alone.sqrt());
    assert!(count > 5 && apart < 0.8 * alone, "{count} points: {apart} and {alone}");
    let id = pairs[0].cameras[0].as_str();
    let pixel = Pixel::new(960.0, 900.0);
    let itself = site.floor_covariance_between([(id, pixel), (id, pixel)]).unwrap();
    assert!((itself[0][0] - own(id, pixel)[0][0]).abs() < 1e-12, "of one camera it is its own covariance");
}
