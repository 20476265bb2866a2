//! The estimators on random rooms: exact scenes, the Cramér-Rao bound, wrong lines, degenerate
//! configurations.

use calib_core::{
    Annotation, Camera, Code, Constraints, Fit, FitOptions, Kind, Lens, Pixel, Priors, SceneErrors,
    WorldPoint,
};

use calib_core::outcome::SuggestedAnnotation;

use calib_core::single::{FixedParameters, Known, paper_minimum};

use calib_demo::random::{AnnotationSet, RandomScene, SIZE, normal};
use calib_site::{LensEntry, Method, Options, PlacementEntry, SceneEntry, Site, SiteCamera, Solution};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

fn lens() -> Lens {
    Lens::pinhole(Pixel::new(0.5 * SIZE[0], 0.5 * SIZE[1]))
}

fn scenes(drawn: AnnotationSet, count: usize, seed: u64) -> Vec<RandomScene> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    (0..count).map(|_| RandomScene::new(&mut random, drawn, None, None)).collect()
}

fn fit(annotations: &[Annotation], scene: &RandomScene, sigma: Option<f64>) -> Fit {
    let evidence = Constraints::new(annotations, &lens(), SceneErrors::EXACT);
    let options = FitOptions {
        lens: lens(),
        size: SIZE,
        efov: &scene.efov,
        fixed: FixedParameters::default(),
        priors: Priors::default(),
        sigma,
        weak_prior: true,
        ..FitOptions::new(lens(), SIZE)
    };
    Fit::new(&evidence, &options).unwrap_or_else(|failure| panic!("{failure}"))
}

#[test]
fn paper_method_finds_exact_scenes() {
    for drawn in [AnnotationSet::Directions, AnnotationSet::Lengths] {
        for scene in scenes(drawn, 40, 21) {
            let evidence = Constraints::new(&scene.annotations, &lens(), SceneErrors::EXACT);
            let (at, _) = paper_minimum(&evidence, FixedParameters::default(), SIZE[0]).unwrap();
            assert!(
                (at.focal / scene.camera.focal - 1.0).abs() < 1e-3,
                "{drawn:?} {at:?} {:?}",
                scene.camera
            );
            assert!((at.pitch - scene.camera.pitch).to_degrees().abs() < 0.02);
            assert!((at.roll - scene.camera.roll).to_degrees().abs() < 1e-3);
        }
    }
}

#[test]
fn fit_finds_exact_scenes() {
    for drawn in [AnnotationSet::Directions, AnnotationSet::Lengths] {
        for scene in scenes(drawn, 100, 22) {
            let fit = fit(&scene.annotations, &scene, Some(1.0));
            let focal = (fit.camera.focal / scene.camera.focal - 1.0).abs();
            assert!(focal < 1e-6, "{drawn:?}: {focal:e}, {} alternatives", fit.alternatives.len());
            assert!((fit.camera.pitch - scene.camera.pitch).abs() < 1e-6);
            assert!((fit.camera.roll - scene.camera.roll).abs() < 1e-6);
            assert!(fit.outliers.is_empty() && !fit.is_misfit);
        }
    }
}

#[test]
fn fit_reaches_the_cramer_rao_bound_and_its_sigmas_are_correct() {
    const DRAWS: usize = 12;
    for (drawn, noise) in [
        (AnnotationSet::Directions, 0.5),
        (AnnotationSet::Directions, 2.0),
        (AnnotationSet::Lengths, 0.5),
        (AnnotationSet::Lengths, 2.0),
    ] {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut ratios: [Vec<f64>; 3] = Default::default();
        let (mut covered, mut trials) = ([0; 3], 0);
        for scene in scenes(drawn, 60, 23) {
            let errors = |fit: &Fit| {
                let (a, b) = (&fit.camera, &scene.camera);
                [a.roll - b.roll, a.pitch - b.pitch, (a.focal / b.focal).ln()]
            };
            let sigmas = |fit: &Fit| {
                let sigma = |i| fit.camera.covariance.sigma(i).unwrap();
                [sigma(5), sigma(4), sigma(6) / fit.camera.focal]
            };
            let bound = sigmas(&fit(&scene.annotations, &scene, Some(noise)));
            let mut squares = [0.0; 3];
            for _ in 0..DRAWS {
                let found = fit(&scene.noisy(&mut random, noise), &scene, Some(noise));
                let (error, sigma) = (errors(&found), sigmas(&found));
                trials += 1;
                for i in 0..3 {
                    squares[i] += error[i] * error[i];
                    covered[i] += usize::from(error[i].abs() < 1.96 * sigma[i]);
                }
            }
            for i in 0..3 {
                ratios[i].push((squares[i] / DRAWS as f64).sqrt() / bound[i]);
            }
        }
        for i in 0..3 {
            ratios[i].sort_by(f64::total_cmp);
            let median = ratios[i][ratios[i].len() / 2];
            let share = covered[i] as f64 / trials as f64;
            println!(
                "{drawn:?} {noise} px, unknown {i}: {median:.3} of the bound, {:.1} % covered",
                100.0 * share
            );
            assert!(median < 1.05, "{median} times the bound");
            // With 720 trials, the standard deviation of the fraction is 0.8 %.
            assert!(share > 0.925 && share < 0.975, "{share} covered");
        }
    }
}

#[test]
fn one_wrong_line_is_rejected_and_correct_ones_are_not() {
    let mut random = ChaCha8Rng::seed_from_u64(31);
    let (mut trials, mut named, mut wild, mut accused, mut good) = (0, 0, 0, 0, 0);
    for scene in scenes(AnnotationSet::Directions, 120, 32) {
        let clean = fit(&scene.annotations, &scene, Some(1.0));
        if clean.dof < 6 {
            continue;
        }
        let mut annotations = scene.noisy(&mut random, 1.0);
        // One end point of one line is moved 30 to 60 px across the line.
        let lines: Vec<(usize, usize)> = annotations
            .iter()
            .enumerate()
            .filter(|(_, a)| a.segments.as_ref().is_some_and(|s| s.len() > 2))
            .flat_map(|(i, a)| (0..a.segments.as_ref().map_or(0, Vec::len)).map(move |k| (i, k)))
            .collect();
        let (wrong, segment) = lines[random.random_range(0..lines.len())];
        let ends = &mut annotations[wrong].segments.as_mut().unwrap()[segment];
        let (du, dv) = (ends[1].u - ends[0].u, ends[1].v - ends[0].v);
        let off = random.random_range(30.0..60.0) / du.hypot(dv);
        ends[1] = Pixel { u: ends[1].u - off * dv, v: ends[1].v + off * du };
        let found = fit(&annotations, &scene, Some(1.0));
        trials += 1;
        let is_it =
            |source: &calib_core::outcome::Source| source.annotation == wrong && source.segment == segment;
        named += usize::from(found.outliers.iter().any(is_it));
        accused += found.outliers.iter().filter(|source| !is_it(source)).count();
        good += found.residuals.len() - 1;
        wild += usize::from((found.camera.focal / scene.camera.focal).ln().abs() > 0.2);
    }
    println!(
        "{named} of {trials} wrong lines rejected, {accused} of {good} correct lines rejected, {wild} results over 20 % off"
    );
    assert!(trials > 60);
    assert!(named as f64 >= 0.98 * trials as f64, "{named} of {trials}");
    assert!((accused as f64) < 0.02 * good as f64, "{accused} of {good}");
    assert_eq!(wild, 0);
}

/// Camera over a floor, for which the tests draw single lines.
struct Studio {
    camera: Camera,
    random: ChaCha8Rng,
    noise: f64,
}

impl Studio {
    fn new(pitch: f64, hfov: f64) -> Self {
        let camera = Camera {
            position: WorldPoint::new(0.0, 0.0, 3.5),
            yaw: 0.0,
            pitch: pitch.to_radians(),
            roll: 0.02,
            focal: 0.5 * SIZE[0] / (0.5 * f64::to_radians(hfov)).tan(),
            lens: lens(),
            covariance: calib_core::Covariance::EXACT,
        };
        Self { camera, random: ChaCha8Rng::seed_from_u64(7), noise: 0.7 }
    }

    fn pixel(&mut self, point: WorldPoint) -> Pixel {
        let shown = self.camera.world_to_pixel(point).unwrap();
        let (noise, random) = (self.noise, &mut self.random);
        Pixel { u: shown.u + noise * normal(random), v: shown.v + noise * normal(random) }
    }

    /// Draws a floor segment centred at (x, y) in metres, relative to the foot of the camera, with an azimuth
    /// from the image's right.
    fn floor(&mut self, x: f64, y: f64, azimuth: f64, length: f64) -> Vec<Pixel> {
        let (sin, cos) = azimuth.to_radians().sin_cos();
        let end = |s: f64| WorldPoint::new(x + 0.5 * s * length * cos, y + 0.5 * s * length * sin, 0.0);
        vec![self.pixel(end(-1.0)), self.pixel(end(1.0))]
    }

    fn vertical(&mut self, x: f64, y: f64) -> Vec<Pixel> {
        vec![self.pixel(WorldPoint::new(x, y, 0.1)), self.pixel(WorldPoint::new(x, y, 2.2))]
    }

    fn verticals(&mut self) -> Annotation {
        let lines = [(-2.5, 6.0), (-1.0, 8.0), (1.2, 7.0), (2.8, 6.5)].map(|(x, y)| self.vertical(x, y));
        Annotation::from_segments(Kind::Vertical, lines.to_vec())
    }

    /// Draws four parallel floor lines.
    fn parallels(&mut self, azimuth: f64) -> Annotation {
        let lines =
            [(-2.0, 6.5), (-0.5, 6.0), (0.8, 7.0), (2.2, 6.5)].map(|(x, y)| self.floor(x, y, azimuth, 3.0));
        Annotation::from_segments(Kind::Parallel, lines.to_vec())
    }

    fn right_angle(&mut self, azimuth: f64) -> Annotation {
        let lines = [self.floor(0.5, 6.0, azimuth, 2.5), self.floor(-0.5, 6.5, azimuth + 90.0, 2.5)];
        Annotation::from_segments(Kind::Perpendicular, lines.to_vec())
    }

    fn site(&self, annotations: Vec<Annotation>) -> SiteCamera {
        SiteCamera {
            sigma_px: Some(self.noise),
            // The studio has no scene errors.
            scene: Some(SceneEntry::EXACT),
            annotations,
            ..SiteCamera::new("A", [1920, 1080])
        }
    }
}

fn solve_with(camera: SiteCamera, options: &Options) -> Result<Solution, calib_site::FailureEntry> {
    let site = Site { cameras: vec![camera], ..Site::new() };
    site.check().unwrap();
    site.calibrate(options).cameras.remove(0).1
}

fn solve(camera: SiteCamera) -> Solution {
    solve_with(camera, &Options::default()).unwrap_or_else(|failure| panic!("{failure}"))
}

fn codes(solution: &Solution) -> Vec<Code> {
    solution.warnings.iter().map(|warning| warning.code).collect()
}

#[track_caller]
fn assert_warns(solution: &Solution, code: Code) {
    assert!(codes(solution).contains(&code), "{code} is not among {:#?}", solution.warnings);
    let warning = solution.warnings.iter().find(|warning| warning.code == code).unwrap();
    assert!(!warning.message.is_empty() && !warning.advice.is_empty());
}

#[track_caller]
fn assert_healthy(solution: &Solution, studio: &Studio) {
    assert_eq!(codes(solution), [Code::ScaleAssumed], "only the scale is unknown: {:#?}", solution.warnings);
    let sigma = solution.sigma.as_ref().unwrap();
    let off = (solution.focal_px - studio.camera.focal).abs();
    assert!(off < 4.0 * sigma.focal_px.unwrap(), "focal {} of {}", solution.focal_px, studio.camera.focal);
}

#[test]
fn verticals_alone_do_not_determine_the_focal() {
    let mut studio = Studio::new(30.0, 75.0);
    let verticals = studio.verticals();
    let solution = solve(studio.site(vec![verticals.clone()]));
    assert_warns(&solution, Code::FocalUnobservable);
    assert_warns(&solution, Code::PriorDominates);
    let advice = &solution.warnings.iter().find(|w| w.code == Code::FocalUnobservable).unwrap().advice;
    assert!(advice.contains("run away from the camera"), "{advice}");
    // With one more group of floor lines, the focal length is determined.
    let floor = studio.parallels(80.0);
    assert_healthy(&solve(studio.site(vec![verticals, floor])), &studio);
}

#[test]
fn floor_lines_parallel_to_the_image_do_not_determine_the_focal() {
    let mut studio = Studio::new(30.0, 75.0);
    studio.camera.roll = 0.0;
    let (verticals, across) = (studio.verticals(), studio.parallels(0.0));
    let solution = solve(studio.site(vec![verticals.clone(), across.clone()]));
    assert_warns(&solution, Code::FocalUnobservable);
    let angle = studio.right_angle(45.0);
    assert_healthy(&solve(studio.site(vec![verticals, across, angle])), &studio);
}

#[test]
fn right_angle_aligned_with_the_view_does_not_determine_the_focal() {
    let mut studio = Studio::new(30.0, 75.0);
    studio.camera.roll = 0.0;
    let verticals = studio.verticals();
    let lines = [studio.floor(0.0, 6.0, 0.0, 2.5), studio.floor(0.0, 6.5, 90.0, 2.5)];
    let aligned = Annotation::from_segments(Kind::Perpendicular, lines.to_vec());
    assert_warns(&solve(studio.site(vec![verticals, aligned])), Code::FocalUnobservable);
}

#[test]
fn one_right_angle_has_two_solutions_and_both_are_reported() {
    let mut found = 0;
    for azimuth in [20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0, 65.0, 70.0] {
        let mut studio = Studio::new(35.0, 70.0);
        studio.noise = 0.3;
        let (verticals, angle) = (studio.verticals(), studio.right_angle(azimuth));
        let solution = solve(studio.site(vec![verticals, angle]));
        let answers = solution.alternatives.iter().map(|other| other.focal_px).chain([solution.focal_px]);
        let nearest =
            answers.map(|focal| (focal / studio.camera.focal).ln().abs()).fold(f64::INFINITY, f64::min);
        assert!(nearest < 0.25, "{azimuth}: no solution is near the truth, {nearest}");
        if codes(&solution).contains(&Code::TwoSolutions) {
            found += 1;
            assert!(!solution.alternatives.is_empty());
        }
    }
    assert!(found >= 3, "two solutions in {found} of 11");
}

#[test]
fn prior_hides_no_minimum_of_the_lines() {
    let mut two = 0;
    for (index, azimuth) in (0..2000).map(|index| (index, 15.0 + f64::from(index % 13) * 5.0)) {
        let mut studio = Studio::new(20.0 + f64::from(index % 7) * 5.0, 40.0 + f64::from(index % 8) * 10.0);
        studio.noise = 1.0 + f64::from(index % 3);
        studio.random = ChaCha8Rng::seed_from_u64(index as u64);
        let drawn = vec![studio.verticals(), studio.right_angle(azimuth)];
        let camera = studio.site(drawn);
        let lines = solve_with(camera.clone(), &Options { prior: false, ..Options::default() });
        let (Ok(lines), Ok(solution)) = (lines, solve_with(camera, &Options::default())) else { continue };
        let focals = |solution: &Solution| -> Vec<f64> {
            solution.alternatives.iter().map(|other| other.focal_px).chain([solution.focal_px]).collect()
        };
        let sigma = lines.sigma.as_ref().and_then(|sigma| sigma.focal_px).map(|sigma| sigma / lines.focal_px);
        // Cases in which the prior is used although the lines determine the focal length.
        if !sigma.is_some_and(|sigma| (0.1..0.2).contains(&sigma)) || lines.alternatives.is_empty() {
            continue;
        }
        two += 1;
        for focal in focals(&lines) {
            let is_reported = focals(&solution).iter().any(|other| (other / focal).ln().abs() < 0.2);
            assert!(is_reported, "{azimuth}: {focal} is not among {:?}, sigma {sigma:?}", focals(&solution));
        }
        assert!(codes(&solution).contains(&Code::TwoSolutions), "{azimuth}: {:?}", codes(&solution));
    }
    assert!(two >= 5, "two solutions with a determined focal length: {two}");
}

#[test]
fn equal_segments_at_one_depth_and_direction_do_not_determine_the_focal() {
    let mut studio = Studio::new(30.0, 75.0);
    studio.camera.roll = 0.0;
    let verticals = studio.verticals();
    let side_by_side = [-2.0, -0.7, 0.7, 2.0].map(|x| studio.floor(x, 6.0, 0.0, 1.0)).to_vec();
    let equal = Annotation::from_segments(Kind::EqualLength, side_by_side.clone());
    assert_warns(&solve(studio.site(vec![verticals.clone(), equal])), Code::FocalUnobservable);
    let mut segments = side_by_side;
    segments.extend(
        [(-1.0, 4.5), (1.0, 8.0), (0.0, 5.0), (0.5, 7.0)].map(|(x, y)| studio.floor(x, y, 80.0, 1.0)),
    );
    let spread = Annotation::from_segments(Kind::EqualLength, segments);
    assert_healthy(&solve(studio.site(vec![verticals, spread])), &studio);
}

#[test]
fn level_camera_with_one_parallel_group_needs_a_right_angle() {
    let mut studio = Studio::new(0.5, 75.0);
    let lines =
        [(-2.0, 9.0), (-0.7, 9.0), (0.8, 9.0), (2.2, 9.0)].map(|(x, y)| studio.floor(x, y, 85.0, 4.0));
    let verticals = studio.verticals();
    let group = Annotation::from_segments(Kind::Parallel, lines.to_vec());
    assert_warns(&solve(studio.site(vec![verticals.clone(), group.clone()])), Code::FocalUnobservable);
    let angles = [studio.floor(0.5, 7.5, 40.0, 3.0), studio.floor(-0.5, 8.0, 130.0, 3.0)];
    let angle = Annotation::from_segments(Kind::Perpendicular, angles.to_vec());
    let solution = solve(studio.site(vec![verticals, group, angle]));
    assert!(!codes(&solution).contains(&Code::FocalUnobservable), "{:#?}", solution.warnings);
}

#[test]
fn looking_straight_down_determines_the_floor_but_not_the_focal() {
    let mut studio = Studio::new(89.9, 75.0);
    let floor = |studio: &mut Studio, azimuth: f64| {
        let lines = [(-1.5, -0.8), (0.0, 0.9), (1.4, 0.3)].map(|(x, y)| studio.floor(x, y, azimuth, 1.6));
        Annotation::from_segments(Kind::Parallel, lines.to_vec())
    };
    let verticals = [(-1.5, 0.9), (1.4, -0.8), (1.2, 0.9)].map(|(x, y)| studio.vertical_low(x, y));
    let verticals = Annotation::from_segments(Kind::Vertical, verticals.to_vec());
    let along = Annotation { id: Some("a".into()), ..floor(&mut studio, 20.0) };
    let across = Annotation { at_right_angles_to: Some("a".into()), ..floor(&mut studio, 110.0) };
    let solution = solve(studio.site(vec![verticals, along, across]));
    assert_warns(&solution, Code::FocalUnobservable);
    let rel = solution.sigma.as_ref().unwrap().floor_length_rel.unwrap();
    assert!(rel < 0.01, "floor {rel}");
    let truth = &studio.camera;
    let found = solution.camera().unwrap();
    // Ratio of floor lengths: the scale is unknown.
    let length = |camera: &Camera, a: [f64; 2], b: [f64; 2]| {
        let at = |p: [f64; 2]| camera.pixel_to_floor(p.into(), 0.0).unwrap();
        at(a).distance(at(b))
    };
    let ratio = |a, b| length(&found, a, b) / length(truth, a, b);
    let (one, other) = (ratio([200.0, 200.0], [1700.0, 300.0]), ratio([300.0, 1000.0], [1000.0, 100.0]));
    assert!((one / other - 1.0).abs() < 0.02, "{one} {other}");
}

impl Studio {
    /// Draws a short vertical near the floor, seen from above.
    fn vertical_low(&mut self, x: f64, y: f64) -> Vec<Pixel> {
        vec![self.pixel(WorldPoint::new(x, y, 0.0)), self.pixel(WorldPoint::new(x, y, 0.8))]
    }
}

#[test]
fn verticals_are_optional_if_floor_lines_suffice() {
    let mut studio = Studio::new(35.0, 75.0);
    let along = Annotation { id: Some("a".into()), ..studio.parallels(60.0) };
    let across = Annotation { at_right_angles_to: Some("a".into()), ..studio.parallels(150.0) };
    assert_healthy(&solve(studio.site(vec![along.clone(), across.clone()])), &studio);
    let one = Annotation::from_segments(Kind::Vertical, vec![studio.vertical(-2.0, 6.0)]);
    assert_healthy(&solve(studio.site(vec![one, along, across])), &studio);
}

#[test]
fn too_few_lines_are_refused_with_advice() {
    let mut studio = Studio::new(35.0, 75.0);
    let group = studio.parallels(60.0);
    for annotations in [vec![], vec![group]] {
        let failure = solve_with(studio.site(annotations), &Options::default()).unwrap_err();
        assert!(failure.advice.contains("Draw"), "{failure}");
    }
}

#[test]
fn weak_prior_does_not_change_a_determined_focal() {
    let mut studio = Studio::new(30.0, 75.0);
    let annotations = vec![studio.verticals(), studio.parallels(70.0), studio.right_angle(40.0)];
    let with = solve(studio.site(annotations.clone()));
    let without =
        solve_with(studio.site(annotations), &Options { prior: false, ..Options::default() }).unwrap();
    assert_eq!(with.focal_px, without.focal_px);
    assert_eq!(with.pitch_deg, without.pitch_deg);
}

#[test]
fn known_length_upright_and_height_determine_the_scale() {
    let mut studio = Studio::new(30.0, 75.0);
    let base = vec![studio.verticals(), studio.parallels(70.0), studio.right_angle(40.0)];
    let truth = studio.camera.position.z;
    let length = Annotation {
        length_m: Some(2.0),
        ..Annotation::from_segments(
            Kind::KnownLength,
            vec![studio.floor(0.0, 6.0, 30.0, 2.0), studio.floor(1.0, 5.0, 100.0, 2.0)],
        )
    };
    let upright = Annotation {
        foot: Some(studio.pixel(WorldPoint::new(0.5, 6.0, 0.0))),
        head: Some(studio.pixel(WorldPoint::new(0.5, 6.0, 1.8))),
        height_m: Some(Known::prior(1.8, 0.03)),
        ..Annotation::new(Kind::Upright)
    };
    for extra in [length, upright] {
        let annotations = base.iter().cloned().chain([extra]).collect();
        let solution = solve(studio.site(annotations));
        let (z, sigma) = (solution.position_m.unwrap().z, solution.sigma.as_ref().unwrap().z_m.unwrap());
        assert!((z - truth).abs() < 4.0 * sigma && sigma < 0.2, "{z} \u{b1} {sigma}");
    }
    let mut camera = studio.site(base.clone());
    camera.height_m = Some(Known::prior(3.4, 0.1));
    let solution = solve(camera);
    assert!((solution.position_m.unwrap().z - 3.4).abs() < 1e-6);
    assert!((solution.sigma.as_ref().unwrap().z_m.unwrap() - 0.1).abs() < 1e-6);
    let mut camera = studio.site(base);
    camera.height_m = Some(Known::fixed(3.5));
    assert_eq!(solve(camera).position_m.unwrap().z, 3.5);
}

#[test]
fn known_size_is_suggested_if_the_scale_is_the_limit_with_the_correct_gain() {
    let mut studio = Studio::new(30.0, 75.0);
    let base =
        vec![studio.verticals(), studio.parallels(70.0), studio.right_angle(40.0), studio.parallels(10.0)];
    let asked = |camera: SiteCamera| {
        let next = solve(camera).draw_next?;
        let all = [vec![next.clone()], next.otherwise].concat();
        all.into_iter().find(|next| next.drawing == Some(SuggestedAnnotation::KnownSize))
    };
    let with_height = |height: Known| SiteCamera { height_m: Some(height), ..studio.site(base.clone()) };
    let guessed = asked(studio.site(base.clone())).unwrap();
    let weak = asked(with_height(Known::prior(3.5, 0.5))).unwrap();
    assert!((weak.floor_length_rel / guessed.floor_length_rel - 1.0).abs() < 0.1, "{weak:?} {guessed:?}");
    assert!(asked(with_height(Known::prior(3.5, 0.01))).is_none());
    assert!(asked(with_height(Known::fixed(3.5))).is_none());
    let length = Annotation {
        length_m: Some(1.75),
        length_sigma_rel: Some(0.01),
        ..Annotation::from_segments(Kind::KnownLength, vec![studio.floor(0.0, 4.0, 0.0, 1.75)])
    };
    let measured = studio.site(base.iter().cloned().chain([length]).collect());
    let then = solve(measured.clone()).sigma.unwrap().floor_length_rel.unwrap();
    assert!((0.7..1.4).contains(&(then / guessed.floor_length_rel)), "{then} {}", guessed.floor_length_rel);
    assert!(asked(measured).is_none(), "the suggestion is not repeated");
}

#[test]
fn advice_is_to_measure_a_size_if_the_scale_is_the_limit() {
    let mut studio = Studio::new(30.0, 75.0);
    let base =
        vec![studio.verticals(), studio.parallels(70.0), studio.right_angle(40.0), studio.parallels(10.0)];
    let few = [studio.verticals()];
    let advice = |sigma: f64, annotations: &[Annotation]| {
        let mut camera = studio.site(annotations.to_vec());
        camera.height_m = Some(Known::prior(3.5, sigma));
        let solution = solve(camera);
        let doubts = [Code::Weak, Code::Unusable, Code::FocalUnobservable];
        let weak = solution.warnings.iter().find(|warning| doubts.contains(&warning.code));
        weak.map(|warning| warning.advice.clone())
    };
    assert_eq!(advice(0.02, &base), None);
    let limited = advice(0.2, &base).expect("six per cent are too much");
    assert!(limited.contains("Measure a length") && limited.contains("\u{b1} 5."), "{limited}");
    // If the camera's shape is undetermined, too, the advice is to draw lines.
    let open = advice(0.1, &few);
    assert!(open.as_ref().is_some_and(|advice| !advice.contains("Measure a length")), "{open:?}");
}

#[test]
fn fixed_focal_leaves_pitch_and_roll_at_their_bound() {
    let (mut square, mut bound, mut trials) = ([0.0; 2], [0.0; 2], 0.0);
    for seed in 0..200 {
        let mut studio = Studio::new(30.0, 75.0);
        studio.random = ChaCha8Rng::seed_from_u64(seed);
        let focal = studio.camera.focal;
        let annotations = vec![studio.verticals(), studio.parallels(70.0)];
        let mut camera = studio.site(annotations);
        let lens = LensEntry { focal_px: Some(Known::fixed(focal)), ..LensEntry::default() };
        camera.lens = Some(lens);
        let solution = solve(camera);
        assert_eq!(solution.focal_px, focal);
        let sigma = solution.sigma.as_ref().unwrap();
        assert_eq!(sigma.focal_px, None, "a fixed focal length has no sigma");
        let error = [solution.roll_deg.unwrap() - 0.02_f64.to_degrees(), solution.pitch_deg.unwrap() - 30.0];
        for (i, sigma) in [sigma.roll_deg.unwrap(), sigma.pitch_deg.unwrap()].into_iter().enumerate() {
            square[i] += error[i] * error[i];
            bound[i] += sigma * sigma;
        }
        trials += 1.0;
    }
    for i in 0..2 {
        let ratio = (square[i] / bound[i]).sqrt();
        println!("unknown {i}: {ratio:.3} of the bound over {trials} trials");
        assert!(ratio < 1.12 && ratio > 0.88, "{ratio}");
    }
}

#[test]
fn placement_moves_rotates_and_scales_the_camera() {
    let mut studio = Studio::new(30.0, 75.0);
    let annotations = vec![studio.verticals(), studio.parallels(70.0)];
    let mut camera = studio.site(annotations);
    camera.placement = Some(PlacementEntry {
        move_m: calib_core::FloorPoint::new(4.0, -2.0),
        turn_deg: 33.0,
        scale: Some(1.5),
        fixed: false,
        held: calib_site::FixedEntry::default(),
        estimated: false,
    });
    let solution = solve(camera);
    assert_eq!(solution.position_m, Some(WorldPoint::new(4.0, -2.0, 4.5)));
    assert!((solution.yaw_deg.unwrap() - 33.0).abs() < 1e-12);
}

#[test]
fn unused_annotations_are_reported() {
    let mut studio = Studio::new(30.0, 75.0);
    let points = (0..4).map(|i| studio.pixel(WorldPoint::new(-2.0, 5.0 + f64::from(i), 0.0))).collect();
    let straight = Annotation { points: Some(points), ..Annotation::new(Kind::Straight) };
    let lonely = Annotation::from_segments(Kind::Parallel, vec![studio.floor(0.0, 6.0, 20.0, 2.0)]);
    let known = Annotation {
        length_m: Some(2.0),
        ..Annotation::from_segments(Kind::KnownLength, vec![studio.floor(0.0, 6.0, 30.0, 2.0)])
    };
    let base = vec![studio.verticals(), studio.parallels(70.0)];
    let annotations: Vec<Annotation> = base.into_iter().chain([straight, lonely, known]).collect();
    let count =
        |solution: &Solution| codes(solution).iter().filter(|&&code| code == Code::UnusedAnnotation).count();
    // The default method uses the straight edge for the lens.
    assert_eq!(count(&solve(studio.site(annotations.clone()))), 1, "the lonely line");
    let paper = Options { method: Method::Paper, ..Options::default() };
    assert_eq!(count(&solve_with(studio.site(annotations), &paper).unwrap()), 2, "and the known length");
}
