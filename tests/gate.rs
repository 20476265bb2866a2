//! The quality gate: random lines do not pass it, and unknown uncertainties are not treated as zero.

use calib_core::{Annotation, Code, Kind, Pixel};

use calib_core::single::Known;

use calib_demo::random::{AnnotationSet, RandomScene};
use calib_site::{FixedEntry, Options, PlacementEntry, SceneEntry, Site, SiteCamera, Solution};
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

/// Returns a camera with random lines of several kinds.
fn scribbled(random: &mut ChaCha8Rng, index: usize) -> SiteCamera {
    let mut camera = SiteCamera::new(format!("c{index}"), SIZE);
    let mut draw = |kind: Kind, groups: usize, least: usize, most: usize| {
        for _ in 0..groups {
            let count = random.random_range(least..=most);
            if count > 0 {
                camera.annotations.push(Annotation::from_segments(kind, any_segments(random, count)));
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
fn random_lines_do_not_pass() {
    let count: usize =
        std::env::var("CALIB_SCRIBBLES").ok().and_then(|count| count.parse().ok()).unwrap_or(250);
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
    println!("{solutions} of {count} cameras are solved, {passed} pass, {exact} of them with less than 1 %");
    assert!(solutions > count / 4, "too few cameras are solved for this test");
    assert!(
        passed * 100 <= count && exact == 0,
        "{passed} of {count} pass, {exact} of them with less than 1 %"
    );
}

/// Returns the annotations of a scene with the camera rotated by `roll` degrees about its axis, in a
/// sufficiently large image.
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
fn camera_rolled_beyond_90_degrees_is_found_or_ambiguous() {
    const ROLL: f64 = -120.0;
    let mut random = ChaCha8Rng::seed_from_u64(3);
    for _ in 0..10 {
        let scene = RandomScene::new(&mut random, AnnotationSet::Directions, Some(70.0), Some(30.0));
        let roll = scene.camera.roll.to_degrees() + ROLL;
        let near = |of_roll: f64, pitch: f64| (of_roll - roll).abs() < 4.0 && (pitch - 30.0).abs() < 4.0;
        let is_true = |solution: &Solution| near(solution.roll_deg.unwrap(), solution.pitch_deg.unwrap());
        let with_floor = rolled(&scene, ROLL, &mut random);
        // The field of view is on the floor, therefore the solution is unique.
        let solution = solved(with_floor.clone());
        assert!(is_true(&solution), "{:?} {:?}", solution.roll_deg, solution.pitch_deg);
        // Without the field of view, the lines have two solutions, and both are reported.
        let bare = SiteCamera { efov_px: None, ..with_floor };
        let solution = solved(bare.clone());
        let others = &solution.alternatives;
        assert!(is_true(&solution) || others.iter().any(|other| near(other.roll_deg, other.pitch_deg)));
        assert!(has(&solution, Code::TwoSolutions), "{:?}", solution.warnings);
        // A prior on the pitch selects one.
        let mut believed = bare;
        believed.lens.get_or_insert_default().pitch_deg = Some(Known::prior(30.0, 10.0));
        let solution = solved(believed);
        assert!(is_true(&solution), "{:?} {:?}", solution.roll_deg, solution.pitch_deg);
        assert!(!has(&solution, Code::TwoSolutions));
    }
}

#[test]
fn repeated_line_adds_no_information() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    for _ in 0..10 {
        let scene = RandomScene::new(&mut random, AnnotationSet::Directions, None, None);
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
        assert!((px(&often) - px(&once)).abs() < 1e-6, "a repeated line keeps its residual");
    }
}

/// Whether repeating an annotation did not reduce a standard deviation noticeably. A repeated annotation adds an
/// unknown, so its copies have the information of one annotation only to within a fifteenth.
fn adds_no_information(often: f64, once: f64) -> bool {
    often > 0.93 * once
}

/// Returns the camera with an annotation repeated `times` times. The copies have no id, so that no annotation refers
/// to them.
fn redrawn(camera: &SiteCamera, index: usize, times: usize) -> SiteCamera {
    let mut often = camera.clone();
    let copy = Annotation { id: None, ..camera.annotations[index].clone() };
    often.annotations.extend(vec![copy; times - 1]);
    often
}

/// Returns all standard deviations in a solution.
fn sigmas(solution: &Solution) -> Vec<f64> {
    let sigma = solution.sigma.as_ref().unwrap();
    let all = [
        sigma.x_m,
        sigma.y_m,
        sigma.z_m,
        sigma.yaw_deg,
        sigma.pitch_deg,
        sigma.roll_deg,
        sigma.focal_px,
        sigma.floor_length_rel,
    ];
    all.into_iter().flatten().collect()
}

#[test]
fn repeated_annotation_of_any_kind_adds_no_information() {
    let alone = |mut camera: SiteCamera| {
        camera.control_points.clear();
        camera.placement = None;
        camera.lens.iter_mut().for_each(|lens| lens.like = None);
        camera
    };
    let mut kinds = std::collections::BTreeSet::new();
    for camera in calib_demo::demo_site().site.cameras.into_iter().map(alone) {
        let once = solved(camera.clone());
        for (index, drawn) in camera.annotations.iter().enumerate() {
            let often = solved(redrawn(&camera, index, 31));
            let what = format!("{} {index} {:?}", camera.id, drawn.kind);
            for (often, once) in sigmas(&often).into_iter().zip(sigmas(&once)) {
                assert!(adds_no_information(often, once), "{what}: {often} of {once}");
            }
            // With more straight edges, the fit may select another number of coefficients.
            let is_lens = drawn.kind == Kind::Straight;
            assert!(often.dof <= once.dof || is_lens, "{what}: {:?} of {:?}", often.dof, once.dof);
            assert_eq!(has(&often, Code::Unchecked), has(&once, Code::Unchecked), "{what}");
            kinds.insert(format!("{:?}", drawn.kind));
        }
    }
    assert_eq!(kinds.len(), 7, "{kinds:?}");
}

#[test]
fn repeated_known_length_does_not_pass() {
    let has_length =
        |camera: &SiteCamera| camera.annotations.iter().any(|drawn| drawn.kind == Kind::KnownLength);
    let mut camera = calib_demo::demo_site().site.cameras.into_iter().find(has_length).unwrap();
    (camera.control_points, camera.placement, camera.height_m) = (Vec::new(), None, None);
    camera.annotations.retain(|drawn| drawn.kind != Kind::Upright);
    let index = camera.annotations.iter().position(|drawn| drawn.kind == Kind::KnownLength).unwrap();
    camera.annotations[index].length_sigma_rel = Some(0.05);
    let scratch = Scratch::new();
    for times in [1, 31] {
        let site = Site { cameras: vec![redrawn(&camera, index, times)], ..Site::new() };
        scratch.write("site.json", site.to_json());
        let result = scratch.calib(&["check", "site.json", "--format", "json"]).expect_code(4).json();
        assert!(result["cameras"][0]["faults"][0].as_str().unwrap().contains("floor lengths"), "{result}");
    }
}

#[test]
fn repeated_shared_landmarks_add_no_information() {
    const TIMES: usize = 20;
    fn again<T: Clone>(list: &mut Vec<T>, unnamed: impl Fn(&mut T)) {
        let copies: Vec<T> = list.iter().flat_map(|item| vec![item.clone(); TIMES - 1]).collect();
        let first = list.len();
        list.extend(copies);
        list[first..].iter_mut().for_each(unnamed);
    }
    let solve = |site: &Site| site.calibrate(&Options::default()).cameras;
    let compare = |what: &str, once: &Site, often: &Site| {
        for ((index, once), (_, often)) in solve(once).into_iter().zip(solve(often)) {
            let (once, often) = (once.unwrap(), often.unwrap());
            println!(
                "{what} {index}: {:?} {:?} dof {:?} {:?}",
                sigmas(&once),
                sigmas(&often),
                once.dof,
                often.dof
            );
            for (often, once) in sigmas(&often).into_iter().zip(sigmas(&once)) {
                assert!(adds_no_information(often, once), "{what} of camera {index}: {often} of {once}");
            }
            assert!(often.dof <= once.dof, "{what} of camera {index}: {:?} of {:?}", often.dof, once.dof);
        }
    };
    let site = calib_demo::demo_site_without_plan().site;
    let mut often = site.clone();
    again(&mut often.links, |link| link.id = None);
    compare("links", &site, &often);
    let mut often = site.clone();
    again(&mut often.distances, |distance| distance.id = None);
    compare("distances", &site, &often);
    let mut often = site.clone();
    again(&mut often.marks, |mark| mark.id = None);
    compare("marks", &site, &often);
    let site = calib_demo::demo_site().site;
    let mut often = site.clone();
    for camera in &mut often.cameras {
        again(&mut camera.control_points, |point| point.id = None);
    }
    compare("control points", &site, &often);
}

#[test]
fn disabled_lines_leave_no_certain_tilted_camera() {
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
    println!("{tilted} cameras are tilted and fail the check");
}

#[test]
fn six_or_seven_random_lines_are_reported_as_unchecked() {
    let mut random = ChaCha8Rng::seed_from_u64(17);
    let (mut certain, mut solutions) = (0, 0);
    for _ in 0..400 {
        let mut camera = SiteCamera::new("a", SIZE);
        let verticals: usize = random.random_range(0..=3);
        let parallels: usize = random.random_range(6..=7) - verticals;
        let groups = [
            (Kind::Vertical, verticals),
            (Kind::Parallel, parallels / 2),
            (Kind::Parallel, parallels.div_ceil(2)),
        ];
        for (kind, count) in groups.into_iter().filter(|(_, count)| *count > 0) {
            camera.annotations.push(Annotation::from_segments(kind, any_segments(&mut random, count)));
        }
        let site = Site { cameras: vec![camera], ..Site::new() };
        let Ok(solution) = site.calibrate(&Options::default()).cameras.remove(0).1 else { continue };
        solutions += 1;
        let sigma = solution.sigma.as_ref().and_then(|sigma| sigma.roll_deg);
        if sigma.is_some_and(|sigma| sigma < 0.5) {
            certain += 1;
            let codes: Vec<Code> = solution.warnings.iter().map(|warning| warning.code).collect();
            assert!(
                has(&solution, Code::Unchecked) || has(&solution, Code::Misfit),
                "roll {sigma:?} dof {:?} chi2 {:?} {codes:?}",
                solution.dof,
                solution.chi2
            );
        }
    }
    println!("{solutions} solutions, {certain} of them certain and unchecked");
    assert!(solutions > 100);
}

#[test]
fn misfit_leaves_the_uncertainty_unknown() {
    let mut random = ChaCha8Rng::seed_from_u64(19);
    let (mut beyond, mut within) = (0, 0);
    for round in 0..60 {
        let scene = RandomScene::new(&mut random, AnnotationSet::Directions, None, None);
        let mut camera = SiteCamera::new("a", SIZE);
        let noise = [1.0, 40.0, 80.0][round % 3];
        (camera.annotations, camera.efov_px) = (scene.noisy(&mut random, noise), Some(scene.efov.clone()));
        let site = Site { cameras: vec![camera], ..Site::new() };
        let Ok(solution) = site.calibrate(&Options::default()).cameras.remove(0).1 else { continue };
        let (chi2, dof) = (solution.chi2.unwrap(), solution.dof.unwrap_or(0) as f64);
        // Residuals more than five times the assumed noise.
        if dof >= 1.0 && chi2 > 25.0 * dof {
            beyond += 1;
            assert!(solution.sigma.is_none() && solution.covariance.is_none(), "chi2 {chi2} of {dof}");
            assert!(has(&solution, Code::UncertaintyUnknown));
        } else {
            within += 1;
            assert!(solution.sigma.is_some(), "chi2 {chi2} of {dof}");
        }
    }
    println!("{beyond} misfits, {within} others");
    assert!(beyond >= 10 && within >= 10);
}

#[test]
fn few_residuals_widen_intervals_by_students_factor() {
    // 97.5 % quantiles of Student's t distribution for 1 to 7 degrees of freedom (any table).
    const QUANTILES: [f64; 7] = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365];
    let mut random = ChaCha8Rng::seed_from_u64(23);
    let mut compared = 0;
    for _ in 0..300 {
        let scene = RandomScene::new(&mut random, AnnotationSet::Directions, None, None);
        let mut camera = SiteCamera::new("a", SIZE);
        (camera.annotations, camera.efov_px) = (scene.noisy(&mut random, 4.0), Some(scene.efov.clone()));
        camera.scene = Some(SceneEntry::EXACT);
        camera.annotations.iter_mut().for_each(|drawn| drawn.keep = true);
        let estimated = solved(camera.clone());
        let of_lines_alone = |solution: &Solution| {
            !has(solution, Code::FocalUnobservable) && !has(solution, Code::UncertaintyUnknown)
        };
        if !has(&estimated, Code::FewResiduals) || !of_lines_alone(&estimated) {
            continue;
        }
        let given = solved(SiteCamera { sigma_px: estimated.sigma_px, ..camera });
        let focal = |solution: &Solution| solution.focal_px;
        // Skip other minima and cases in which the prior contributes.
        if !of_lines_alone(&given) || (focal(&given) / focal(&estimated) - 1.0).abs() > 1e-4 {
            continue;
        }
        let pitch = |solution: &Solution| solution.sigma.as_ref().unwrap().pitch_deg.unwrap();
        let factor = QUANTILES[estimated.dof.unwrap().max(1) - 1] / 1.96;
        let wider = pitch(&estimated) / pitch(&given);
        assert!((wider / factor - 1.0).abs() < 0.01, "dof {:?}: {wider}, not {factor}", estimated.dof);
        compared += 1;
    }
    println!("{compared} compared");
    assert!(compared >= 10, "{compared}");
}

#[test]
fn solution_of_other_lines_does_not_pass() {
    let scratch = Scratch::new();
    let site = calib_demo::demo_site().site;
    let solved = site.calibrate(&Options::default()).write_into(&site);
    assert!(solved.out_of_date().is_empty(), "{:?}", solved.out_of_date());
    scratch.write("solved.json", solved.to_json());
    let codes = |file: &str, code: i32| -> Vec<String> {
        let result =
            scratch.calib(&["check", file, "--format", "json", "--explain"]).expect_code(code).json();
        let cameras = result["cameras"].as_array().unwrap().iter();
        let codes = cameras.flat_map(|camera| camera["failed"].as_array().unwrap().clone());
        codes.filter_map(|fault| fault["code"].as_str().map(Into::into)).collect()
    };
    assert!(codes("solved.json", 0).is_empty());
    // Numbers rounded by another program.
    let mut rounded = scratch.read_json("solved.json");
    round(&mut rounded);
    scratch.write("rounded.json", rounded.to_string());
    assert!(codes("rounded.json", 0).is_empty());

    let mut random = ChaCha8Rng::seed_from_u64(29);
    let mut other = solved.clone();
    let drawn = other.cameras.iter_mut().flat_map(|camera| &mut camera.annotations);
    for pixel in drawn.flat_map(|drawn| drawn.segments.iter_mut().flatten().flatten()) {
        *pixel = any_pixel(&mut random);
    }
    scratch.write("other.json", other.to_json());
    assert_eq!(codes("other.json", 4), vec!["out-of-date"; other.cameras.len()]);
    let exported =
        scratch.calib(&["export", "opencv", "other.json", "-o", "out", "--allow-lossy"]).expect_code(0);
    let reported = exported.stderr.lines().filter(|line| line.contains("out of date")).count();
    assert_eq!(reported, other.cameras.len(), "{}", exported.stderr);
    let _ = scratch.calib(&["report", "other.json", "-o", "other.html"]);
    assert!(std::fs::read_to_string(scratch.path("other.html")).unwrap().contains("out of date"));
    scratch.calib(&["check", "other.json", "--allow", "out-of-date"]).expect_code(0);
}

/// Rounds every number to three decimals, as other programs write them. Distortion and uncertainties are
/// kept: rounding would move the corners of the image, or make errors zero.
fn round(value: &mut Value) {
    match value {
        Value::Number(number) if number.is_f64() => {
            *value = json!((number.as_f64().unwrap() * 1e3).round() / 1e3);
        }
        Value::Array(list) => list.iter_mut().for_each(round),
        Value::Object(map) => {
            const KEPT: [&str; 4] = ["covariance", "cross_covariances", "distortion", "sigma"];
            map.iter_mut()
                .filter(|(key, _)| !KEPT.contains(&key.as_str()))
                .for_each(|(_, value)| round(value));
        }
        _ => {}
    }
}

#[test]
fn changed_line_makes_a_solution_out_of_date() {
    let site = calib_demo::demo_site().site;
    let solved = site.calibrate(&Options::default()).write_into(&site);
    let of = |changed: &Site| -> Vec<usize> {
        changed.out_of_date().into_iter().map(|(camera, _)| camera).collect()
    };
    for camera in 0..solved.cameras.len() {
        let verticals = |site: &Site| {
            site.cameras[camera].annotations.iter().position(|drawn| drawn.kind == Kind::Vertical).unwrap()
        };
        let changed = |change: &dyn Fn(&mut Vec<Vec<Pixel>>)| {
            let mut changed = solved.clone();
            let index = verticals(&changed);
            change(changed.cameras[camera].annotations[index].segments.as_mut().unwrap());
            of(&changed)
        };
        assert_eq!(changed(&|lines| lines[0][0].u += 40.0), [camera], "moved");
        assert_eq!(
            changed(&|lines| lines.push(vec![Pixel::new(300.0, 300.0), Pixel::new(330.0, 900.0)])),
            [camera],
            "added"
        );
        assert_eq!(changed(&|lines| drop(lines.pop())), [camera], "removed");
    }
    let mut moved = solved.clone();
    let camera = moved.cameras.iter().position(|camera| !camera.control_points.is_empty()).unwrap();
    moved.cameras[camera].control_points[0].px.u += 20.0;
    assert_eq!(of(&moved), [camera]);
    let link =
        solved.links.iter().position(|link| link.solution.is_some() && link.seen[0].px.is_some()).unwrap();
    let mut moved = solved.clone();
    moved.links[link].seen[0].px.as_mut().unwrap().v += 20.0;
    let shown_by = solved.cameras.iter().position(|camera| camera.id == solved.links[link].seen[0].camera);
    assert_eq!(of(&moved), [shown_by.unwrap()]);
    // A solution from another program has no residuals, so it cannot be checked for being out of date.
    let mut bare = solved;
    for camera in &mut bare.cameras {
        camera.solution.as_mut().unwrap().residuals.clear();
        camera.annotations.clear();
    }
    assert!(of(&bare).is_empty());
}

#[test]
fn camera_without_sigmas_has_unknown_uncertainty() {
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
    // A camera below the floor, and a camera that looks at the sky.
    scratch.write("below.json", site("").replace("[0, 0, 3]", "[0, 0, -3]"));
    scratch.write("sky.json", site("").replace(r#""pitch_deg": 30"#, r#""pitch_deg": -50"#));
    for (file, expected) in [("below.json", "below-floor"), ("sky.json", "no-floor")] {
        let run = scratch.calib(&["check", file, "--format", "json", "--explain"]).expect_code(4).json();
        assert_eq!(code(&run), expected);
    }
}

#[test]
fn jointly_solved_cameras_have_correlated_errors() {
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
    let groups = &site.solution.as_ref().unwrap().components;
    let tied: usize = groups.iter().map(|group| group.len() * (group.len() - 1) / 2).sum();
    assert!(pairs.len() >= tied, "{} of {tied} connected pairs", pairs.len());
    let id = pairs[0].cameras[0].as_str();
    let pixel = Pixel::new(960.0, 900.0);
    let itself = site.floor_covariance_between([(id, pixel), (id, pixel)]).unwrap();
    assert!((itself[0][0] - own(id, pixel)[0][0]).abs() < 1e-12, "for one camera it is its own covariance");
}

#[test]
fn placement_by_hand_has_no_uncertainty_until_fixed() {
    let mut site = calib_demo::demo_site().site;
    (site.links, site.marks) = (Vec::new(), Vec::new());
    let solved = site.calibrate(&Options::default()).write_into(&site);
    for entry in &mut site.cameras {
        entry.control_points.clear();
        let camera = solved.camera(&entry.id).unwrap().camera().unwrap();
        let scale = Some(camera.position.z / 3.0);
        let (move_m, turn_deg) = (camera.position.on_floor(), camera.yaw.to_degrees());
        let (fixed, held) = (false, FixedEntry::default());
        entry.placement = Some(PlacementEntry { move_m, turn_deg, scale, fixed, held, estimated: false });
    }
    let claims = |site: &Site| {
        let solved = site.calibrate(&Options::default()).write_into(site);
        let of = |entry: &SiteCamera| {
            let solution = entry.solution.as_ref().unwrap();
            let is_said = solution.warnings.iter().any(|warning| warning.code == Code::PlacedByHand);
            let pixel = Pixel::new(960.0, 900.0);
            let itself = solved.floor_covariance_between([(&entry.id, pixel), (&entry.id, pixel)]);
            (is_said, itself.is_some())
        };
        solved.cameras.iter().map(of).collect::<Vec<_>>()
    };
    assert!(claims(&site).iter().all(|said| *said == (true, false)), "{:?}", claims(&site));
    for entry in &mut site.cameras {
        let placement = entry.placement.as_mut().unwrap();
        placement.held = FixedEntry { x: true, y: true, turn: true };
        entry.height_m.get_or_insert(Known::fixed(placement.scale.unwrap() * 3.0));
    }
    assert!(claims(&site).iter().all(|said| *said == (false, true)), "{:?}", claims(&site));
}
