//! Cameras calibrated without lines, by control points or by the points of a mark: accuracy, wrong points, and
//! findings.

use calib_core::camera::{BrownConrady, Camera, Covariance, Distortion, Lens, Pixel, WorldPoint};
use calib_core::outcome::{Code, FailureCode};
use calib_core::single::Known;
use calib_site::{ControlPointEntry, LensEntry, Options, SceneEntry, Site, SiteCamera, Solution, Stage};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

fn truth() -> Camera {
    Camera {
        position: WorldPoint::new(2.0, -9.0, 6.5),
        yaw: 0.2,
        pitch: 24_f64.to_radians(),
        roll: 1.5_f64.to_radians(),
        focal: 1250.0,
        lens: Lens::pinhole(Pixel::new(960.0, 540.0)),
        covariance: Covariance::EXACT,
    }
}

/// Returns the corners of a tennis court, and points inside it.
fn court(count: usize) -> Vec<WorldPoint> {
    let corners = [(-5.485, 0.0), (5.485, 0.0), (5.485, 23.77), (-5.485, 23.77)];
    let inside = [(0.0, 5.485), (-4.115, 5.485), (4.115, 18.285), (0.0, 18.285), (4.115, 5.485)];
    corners.into_iter().chain(inside).take(count).map(|(x, y)| WorldPoint::new(x, y, 0.0)).collect()
}

/// Returns a site with one camera that shows these points, with normal noise of `sigma` pixels.
fn site(points: &[WorldPoint], sigma: f64, random: &mut ChaCha8Rng) -> Site {
    let mut camera = SiteCamera::new("court", [1920, 1080]);
    let mut normal = || sigma * ((0..12).map(|_| random.random_range(0.0..1.0)).sum::<f64>() - 6.0);
    camera.control_points = points
        .iter()
        .enumerate()
        .map(|(index, &world)| {
            let shown = truth().world_to_pixel(world).unwrap();
            let pixel = Pixel::new(shown.u + normal(), shown.v + normal());
            ControlPointEntry {
                id: Some(format!("p{index}")),
                world_m: Some(world),
                ..ControlPointEntry::new(pixel)
            }
        })
        .collect();
    Site { cameras: vec![camera], ..Site::default() }
}

fn solve(site: &Site) -> Solution {
    let report = site.calibrate(&Options::default());
    report.cameras.into_iter().next().unwrap().1.unwrap_or_else(|failure| panic!("{failure:?}"))
}

fn codes(solution: &Solution) -> Vec<Code> {
    solution.warnings.iter().map(|warning| warning.code).collect()
}

#[test]
fn corners_of_a_court_calibrate_a_camera() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let solution = solve(&site(&court(4), 0.0, &mut random));
    assert_eq!(solution.stage, Stage::Refined);
    assert!((solution.focal_px / 1250.0 - 1.0).abs() < 1e-6, "{solution:?}");
    assert!(solution.position_m.unwrap().distance(truth().position) < 1e-5, "{solution:?}");
    // Eight coordinates for seven unknowns.
    assert_eq!((codes(&solution), solution.dof), (vec![Code::Unchecked], Some(1)));
}

#[test]
fn nine_points_are_as_accurate_as_stated() {
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let (mut square, mut with_findings, trials) = (0.0, 0, 150);
    for _ in 0..trials {
        // The principal point of the camera is exactly the image centre.
        let exact = Some(SceneEntry::EXACT);
        let solution = solve(&Site { scene: exact, ..site(&court(9), 1.0, &mut random) });
        with_findings += i32::from(!codes(&solution).is_empty());
        square += ((solution.focal_px - 1250.0) / solution.sigma.unwrap().focal_px.unwrap()).powi(2);
    }
    // One test in a hundred rejects a right point.
    assert!(with_findings <= 4, "{with_findings} of {trials}");
    let ratio = (square / f64::from(trials)).sqrt();
    assert!((0.87..1.13).contains(&ratio), "root mean square error over sigma: {ratio:.3}");
}

#[test]
fn two_exchanged_points_of_nine_are_set_aside_and_named() {
    for (a, b) in [(0, 7), (4, 5), (1, 2)] {
        let mut site = site(&court(9), 0.5, &mut ChaCha8Rng::seed_from_u64(3));
        let points = &mut site.cameras[0].control_points;
        (points[a].px, points[b].px) = (points[b].px, points[a].px);
        let solution = solve(&site);
        assert!((solution.focal_px / 1250.0 - 1.0).abs() < 0.02, "{}", solution.focal_px);
        let named = solution.warnings.iter().find(|w| w.code == Code::PointsExchanged).unwrap();
        assert!([a, b].iter().all(|i| named.message.contains(&format!("p{i}"))), "{}", named.message);
    }
}

#[test]
fn exchanged_corners_and_mirrored_coordinates_are_refused_by_name() {
    let right = site(&court(4), 0.3, &mut ChaCha8Rng::seed_from_u64(4));
    let failure = |site: &Site| site.calibrate(&Options::default()).cameras.remove(0).1.unwrap_err();
    let mut exchanged = right.clone();
    let points = &mut exchanged.cameras[0].control_points;
    (points[2].px, points[3].px) = (points[3].px, points[2].px);
    let found = failure(&exchanged);
    assert_eq!(found.code, FailureCode::PointsExchanged);
    assert!(found.message.contains("p2 and p3"), "{}", found.message);
    let mut mirrored = right;
    for point in &mut mirrored.cameras[0].control_points {
        point.world_m = point.world_m.map(|at| WorldPoint { x: -at.x, ..at });
    }
    assert_eq!(failure(&mirrored).code, FailureCode::Mirrored);
}

#[test]
fn three_points_are_enough_if_the_focal_length_is_known() {
    let mut three = site(&court(3), 0.0, &mut ChaCha8Rng::seed_from_u64(5));
    let refused = three.calibrate(&Options::default()).cameras.remove(0).1.unwrap_err();
    assert!(refused.message.contains("3 control points alone do not determine"), "{}", refused.message);
    three.cameras[0].lens = Some(LensEntry { focal_px: Some(Known::fixed(1250.0)), ..LensEntry::default() });
    let solution = solve(&three);
    let at = solution.position_m.unwrap();
    assert!(at.distance(truth().position) < 1e-4 || !solution.alternatives.is_empty(), "{solution:?}");
}

#[test]
fn no_exchanged_pair_gives_a_wrong_camera_without_a_finding() {
    let in_space = [
        (1.0, 1.0, 0.0),
        (-1.0, 4.0, 0.0),
        (3.0, 4.0, 0.0),
        (-2.0, 8.0, 0.0),
        (4.0, 8.0, 0.0),
        (0.0, 6.0, 2.0),
    ];
    let in_space = in_space.map(|(x, y, z)| WorldPoint::new(x, y + 4.0, z));
    for points in [&court(5)[..], &court(6), &court(7), &in_space[..5], &in_space] {
        let right = site(points, 0.3, &mut ChaCha8Rng::seed_from_u64(6));
        for (a, b) in (0..points.len()).flat_map(|a| (0..a).map(move |b| (a, b))) {
            let mut exchanged = right.clone();
            let drawn = &mut exchanged.cameras[0].control_points;
            (drawn[a].px, drawn[b].px) = (drawn[b].px, drawn[a].px);
            let Ok(solution) = exchanged.calibrate(&Options::default()).cameras.remove(0).1 else { continue };
            let is_right = (solution.focal_px / 1250.0 - 1.0).abs() < 0.1;
            let is_reported = codes(&solution).iter().any(|code| code.fails_check());
            assert!(is_right || is_reported, "{} points, {a} and {b}: {solution:?}", points.len());
        }
    }
}

#[test]
fn uncertainty_from_points_is_known_without_a_joint_solve() {
    let site = site(&court(9), 0.5, &mut ChaCha8Rng::seed_from_u64(7));
    let options = Options { refine: false, ..Options::default() };
    let solution = site.calibrate(&options).cameras.remove(0).1.unwrap();
    let joint = solve(&site).sigma.unwrap();
    assert_eq!(solution.stage, Stage::Placed);
    let sigma = solution.sigma.unwrap();
    // Both solutions include the uncertainty of the principal point.
    let ratio = |of: fn(&calib_site::Sigmas) -> Option<f64>| of(&sigma).unwrap() / of(&joint).unwrap();
    for ratio in [ratio(|s| s.focal_px), ratio(|s| s.pitch_deg), ratio(|s| s.z_m), ratio(|s| s.yaw_deg)] {
        assert!((0.999..1.001).contains(&ratio), "{sigma:?} and {joint:?}");
    }
    assert!(sigma.floor_length_rel.unwrap() < 0.05, "{sigma:?}");
    assert!(!solution.warnings.iter().any(|warning| warning.code.fails_check()), "{:?}", solution.warnings);
}

/// Returns a site with one camera that shows only the corners of a mark: a court of doubles tennis.
fn court_mark(is_fixed: bool) -> Site {
    use calib_core::floor::{COURTS, MarkKind, MarkShape};
    let size = COURTS[0].size.to_vec();
    let shape = MarkShape {
        kind: MarkKind::Rectangle,
        at: WorldPoint::new(1.0, 14.0, 0.0),
        turn: 0.4,
        size: size.clone(),
    };
    let seen = shape.point_names().map(|point| {
        let px = truth().world_to_pixel(shape.point(&point).unwrap()).unwrap();
        calib_site::MarkObservation { camera: "court".into(), point: point.into_owned(), px }
    });
    let entered = serde_json::json!({"id": "court", "kind": "rectangle", "at_m": [1.0, 14.0, 0.0], "size_m": size,
        "turn_deg": 0.4_f64.to_degrees(), "fixed": is_fixed});
    let mut mark: calib_site::Mark = serde_json::from_value(entered).unwrap();
    mark.seen = seen.collect();
    Site { cameras: vec![SiteCamera::new("court", [1920, 1080])], marks: vec![mark], ..Site::default() }
}

#[test]
fn corners_of_a_marked_court_calibrate_a_camera_without_lines() {
    // The principal point is unknown by default. The position of the mark is not fixed, and only one camera sees it.
    let partial = solve(&court_mark(false));
    assert!(partial.sigma.as_ref().unwrap().pitch_deg.unwrap() < 10.0, "{partial:?}");
    let exact = solve(&Site { scene: Some(SceneEntry::EXACT), ..court_mark(false) });
    let [wide, narrow] =
        [&partial, &exact].map(|solution| solution.sigma.as_ref().unwrap().focal_px.unwrap());
    assert!(wide > 2.0 * narrow, "{wide} with an unknown principal point, {narrow} with a known one");
    for is_fixed in [true, false] {
        let solution = solve(&Site { scene: Some(SceneEntry::EXACT), ..court_mark(is_fixed) });
        assert!((solution.focal_px / 1250.0 - 1.0).abs() < 1e-5, "{solution:?}");
        assert!((solution.position_m.unwrap().z - 6.5).abs() < 1e-4, "{solution:?}");
        assert!(codes(&solution).contains(&Code::Unchecked), "one redundant coordinate: {solution:?}");
        if is_fixed {
            assert!(solution.position_m.unwrap().distance(truth().position) < 1e-4, "{solution:?}");
        }
    }
}

#[test]
fn mark_determines_a_camera_with_too_few_control_points() {
    // Three control points do not determine the focal length.
    let mut random = ChaCha8Rng::seed_from_u64(8);
    let three = site(&court(3), 0.0, &mut random).cameras.remove(0).control_points;
    let mut site = Site { scene: Some(SceneEntry::EXACT), ..court_mark(false) };
    site.cameras[0].control_points = three;
    for refine in [false, true] {
        let options = Options { refine, ..Options::default() };
        let solution = site.calibrate(&options).cameras.remove(0).1.unwrap();
        assert!((solution.focal_px / 1250.0 - 1.0).abs() < 1e-4, "{refine}: {solution:?}");
        assert!(solution.position_m.unwrap().distance(truth().position) < 1e-2, "{refine}: {solution:?}");
    }
}

#[test]
fn placement_of_a_camera_from_a_mark_does_not_change_its_orientation() {
    let mut site = Site { scene: Some(SceneEntry::EXACT), ..court_mark(false) };
    let entered = serde_json::json!({"move_m": [5.0, 4.0], "turn_deg": 70.0, "scale": 1.0, "fixed": true});
    site.cameras[0].placement = Some(serde_json::from_value(entered).unwrap());
    let options = Options { refine: false, ..Options::default() };
    let report = site.calibrate(&options);
    assert!(report.site.warnings.is_empty(), "the mark is used: {:?}", report.site.warnings);
    let solution = report.cameras.into_iter().next().unwrap().1.unwrap();
    assert!((solution.focal_px / 1250.0 - 1.0).abs() < 1e-4, "{solution:?}");
    assert!((solution.pitch_deg.unwrap() - 24.0).abs() < 1e-3, "{solution:?}");
    assert!((solution.yaw_deg.unwrap() - 70.0).abs() < 1e-3, "{solution:?}");
}

/// Returns a camera with this lens above a yard, and `count` points in space that are spread over its image. The
/// coefficients apply to coordinates in units of half the image diagonal.
fn yard([k1, k2]: [f64; 2], count: usize, random: &mut ChaCha8Rng) -> (Camera, Vec<WorldPoint>) {
    let distortion = match [k1, k2] {
        [0.0, 0.0] => Distortion::None,
        _ => Distortion::BrownConrady(BrownConrady { k1, k2, ..BrownConrady::default() }),
    };
    let centre = Pixel::new(960.0, 540.0);
    let lens = Lens { distortion, focal: 960_f64.hypot(540.0), ..Lens::pinhole(centre) };
    let camera = Camera {
        position: WorldPoint::new(0.0, 0.0, random.random_range(3.0..8.0)),
        yaw: random.random_range(-3.0..3.0),
        pitch: random.random_range(0.4..0.8),
        roll: random.random_range(-0.1..0.1),
        focal: random.random_range(900.0..1500.0),
        lens,
        covariance: Covariance::EXACT,
    };
    let mut points = Vec::new();
    while points.len() < count {
        let quarter = [points.len() % 2, points.len() / 2 % 2].map(|side| side as f64);
        let at = |side: f64, share: f64| side * (0.04 + 0.46 * share);
        let [a, b] = [0, 1].map(|axis| 0.5 * quarter[axis] + at(1.0, random.random()));
        let pixel = Pixel::new(1920.0 * a, 1080.0 * b);
        let Some(foot) = camera.pixel_to_floor(pixel, 0.0) else { continue };
        let world = foot.at_height(random.random_range(0.0..2.0));
        let is_near = foot.distance(camera.position.on_floor()) < 8.0 * camera.position.z;
        if is_near && camera.world_to_pixel(world).is_some() {
            points.push(world);
        }
    }
    (camera, points)
}

/// Returns the solution of a camera from points with a noise of 0.5 px. The first `wrong` points have the pixels of
/// positions 1 to 4 m away.
fn solve_yard(
    (camera, points): &(Camera, Vec<WorldPoint>),
    wrong: usize,
    random: &mut ChaCha8Rng,
) -> Option<Solution> {
    let mut entry = SiteCamera::new("yard", [1920, 1080]);
    let mut normal = || 0.5 * ((0..12).map(|_| random.random_range(0.0..1.0)).sum::<f64>() - 6.0);
    for (index, &world) in points.iter().enumerate() {
        let away = if index < wrong { 1.0 + 3.0 * (index as f64 / wrong as f64) } else { 0.0 };
        let shown = camera.world_to_pixel(WorldPoint { x: world.x + away, ..world })?;
        let pixel = Pixel::new(shown.u + normal(), shown.v + normal());
        let id = Some(format!("p{index}"));
        entry.control_points.push(ControlPointEntry {
            id,
            world_m: Some(world),
            ..ControlPointEntry::new(pixel)
        });
    }
    entry.sigma_px = Some(0.5);
    let site = Site { cameras: vec![entry], scene: Some(SceneEntry::EXACT), ..Site::default() };
    let solution = site.calibrate(&Options::default()).cameras.remove(0).1.ok()?;
    (solution.stage == Stage::Refined).then_some(solution)
}

#[test]
fn curved_lens_is_found_from_points_with_honest_uncertainty() {
    let mut random = ChaCha8Rng::seed_from_u64(11);
    println!("points  wrong  solved  with lens  focal rms/sigma  intervals of 95 %");
    // A lens and a wrong point together need many points. With fewer, the camera is refused more often.
    for (count, wrong, least) in [(8, 0, 32), (12, 0, 32), (12, 1, 16), (20, 2, 16)] {
        let (mut solved, mut curved, mut square, mut covered, mut intervals) = (0, 0, 0.0, 0, 0);
        for _ in 0..40 {
            let k1: f64 = random.random_range(-0.3..-0.12);
            let scene = yard([k1, k1 * k1 + random.random_range(-0.05..0.05)], count, &mut random);
            let Some(solution) = solve_yard(&scene, wrong, &mut random) else { continue };
            let (truth, sigma) = (&scene.0, solution.sigma.as_ref().unwrap());
            let Some(of_focal) = sigma.focal_px else { continue };
            solved += 1;
            curved += usize::from(solution.distortion.is_some());
            let normalized = [
                (solution.focal_px - truth.focal) / of_focal,
                (solution.pitch_deg.unwrap() - truth.pitch.to_degrees()) / sigma.pitch_deg.unwrap(),
                (solution.position_m.unwrap().z - truth.position.z) / sigma.z_m.unwrap(),
            ];
            square += normalized[0] * normalized[0];
            covered += normalized.iter().filter(|error| error.abs() < 1.96).count();
            intervals += normalized.len();
        }
        let (rms, share) = ((square / solved as f64).sqrt(), covered as f64 / intervals as f64);
        println!("{count:6} {wrong:6} {solved:7} {curved:10} {rms:16.2} {:18.1} %", 100.0 * share);
        assert!(
            solved >= least && curved + 3 >= solved,
            "{count} points: {solved} solved, {curved} with lens"
        );
        assert!((0.6..1.4).contains(&rms) && share > 0.87, "{count} points: {rms} {share}");
    }
}

#[test]
fn wrong_points_are_not_explained_by_a_lens() {
    let mut random = ChaCha8Rng::seed_from_u64(12);
    for (count, wrong) in [(8, 1), (12, 2), (20, 6)] {
        let (mut solved, mut curved) = (0, 0);
        for _ in 0..40 {
            let scene = yard([0.0; 2], count, &mut random);
            let Some(solution) = solve_yard(&scene, wrong, &mut random) else { continue };
            solved += 1;
            curved += usize::from(solution.distortion.is_some());
        }
        println!("{count} points, {wrong} wrong: {solved} solved, {curved} with a lens");
        assert!(solved >= 34 && curved <= 3, "{count} points: {solved} solved, {curved} with a lens");
    }
}
