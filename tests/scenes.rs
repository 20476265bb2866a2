//! Scenes with errors: sloping floors, corners that are not square, directions that are not level. The
//! intervals cover the truth, and the errors reach the bound.

use calib_core::{
    Annotation, Camera, Constraints, Covariance, Fit, FitOptions, Kind, Lens, Pixel, SceneErrors, WorldPoint,
};

use calib_core::single::{Known, USUAL_SIZES};

use calib_demo::random::normal;
use calib_site::Site;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

const SIZE: [f64; 2] = [1920.0, 1080.0];

/// Camera over a floor with leaning verticals and two directions that are not exactly level or perpendicular.
struct Scene {
    camera: Camera,
    lean: [f64; 2],
    /// Azimuth (radians, from x toward y) and slope (rise per length) of both directions of floor
    /// lines.
    directions: [(f64, f64); 2],
    /// Lengths of marks along the first direction.
    marks: Vec<f64>,
}

impl Scene {
    /// Returns a scene without marks.
    fn random(random: &mut ChaCha8Rng, errors: SceneErrors) -> Self {
        Self::with_marks(random, errors, 0)
    }

    /// Returns a scene with marks of equal length, on a floor that slopes across the marks.
    fn with_marks(random: &mut ChaCha8Rng, errors: SceneErrors, marks: usize) -> Self {
        let hfov = random.random_range(50.0..100.0_f64).to_radians();
        let azimuth = random.random_range(0.0..1.5);
        let mut off = |sigma: f64| sigma * normal(random);
        let mut lean = [off(errors.floor_tilt), off(errors.floor_tilt)];
        let across = azimuth + std::f64::consts::FRAC_PI_2 + off(errors.angle);
        let directions = [(azimuth, off(errors.level())), (across, off(errors.level()))];
        let marks: Vec<f64> = (0..marks).map(|_| 3.0 * off(errors.length).exp()).collect();
        if !marks.is_empty() {
            let (fall, climb) = (off(errors.crossfall), off(0.25 * errors.crossfall));
            let (sin, cos) = azimuth.sin_cos();
            lean = [lean[0] - fall * sin + climb * cos, lean[1] + fall * cos + climb * sin];
        }
        let camera = Camera {
            position: WorldPoint::new(0.0, 0.0, random.random_range(2.5..6.0)),
            yaw: 0.0,
            pitch: random.random_range(15.0..60.0_f64).to_radians(),
            roll: random.random_range(-5.0..5.0_f64).to_radians(),
            focal: 0.5 * SIZE[0] / (0.5 * hfov).tan(),
            lens: Lens::pinhole(Pixel::new(0.5 * SIZE[0], 0.5 * SIZE[1])),
            covariance: Covariance::EXACT,
        };
        Self { camera, lean, directions, marks }
    }

    /// Draws a noisy segment from a random floor point, if it is long enough in the image.
    fn segment(&self, random: &mut ChaCha8Rng, way: [f64; 3]) -> Option<Vec<Pixel>> {
        let at = Pixel::new(random.random_range(0.0..SIZE[0]), random.random_range(0.0..SIZE[1]));
        let foot = self.camera.pixel_to_floor(at, 0.0).filter(|foot| foot.y < 25.0)?;
        let far = WorldPoint::new(foot.x + way[0], foot.y + way[1], way[2]);
        let ends = [foot.at_height(0.0), far].map(|point| self.camera.world_to_pixel(point));
        let (a, b) = (ends[0]?, ends[1]?);
        let is_shown = |p: &Pixel| (0.0..SIZE[0]).contains(&p.u) && (0.0..SIZE[1]).contains(&p.v);
        let is_long = (a.u - b.u).hypot(a.v - b.v) > 80.0;
        (is_shown(&a) && is_shown(&b) && is_long)
            .then(|| [a, b].map(|p| Pixel::new(p.u + normal(random), p.v + normal(random))).to_vec())
    }

    fn segments(
        &self,
        random: &mut ChaCha8Rng,
        count: usize,
        way: impl Fn(f64) -> [f64; 3],
    ) -> Option<Vec<Vec<Pixel>>> {
        let mut found = Vec::new();
        for _ in 0..5000 {
            let length = random.random_range(1.0..4.0);
            found.extend(self.segment(random, way(length)));
            if found.len() == count {
                return Some(found);
            }
        }
        None
    }

    /// Draws five verticals, three segments of each direction, and the marks.
    fn draw(&self, random: &mut ChaCha8Rng) -> Option<Vec<Annotation>> {
        let up = |length: f64| [self.lean[0] * length, self.lean[1] * length, length];
        let along = |(azimuth, slope): (f64, f64)| {
            move |length: f64| [length * azimuth.cos(), length * azimuth.sin(), length * slope]
        };
        let verticals = Annotation::from_segments(Kind::Vertical, self.segments(random, 5, up)?);
        let parallels = |random: &mut ChaCha8Rng, direction| {
            Some(Annotation::from_segments(Kind::Parallel, self.segments(random, 3, along(direction))?))
        };
        let first = Annotation { id: Some("a".into()), ..parallels(random, self.directions[0])? };
        let tied =
            Annotation { at_right_angles_to: Some("a".into()), ..parallels(random, self.directions[1])? };
        let mut drawn = vec![verticals, first, tied];
        if !self.marks.is_empty() {
            let mark = |&length: &f64| self.segments(random, 1, |_| along(self.directions[0])(length))?.pop();
            let marks = self.marks.iter().map(mark).collect::<Option<_>>()?;
            drawn.push(Annotation::from_segments(Kind::EqualLength, marks));
        }
        Some(drawn)
    }
}

/// Returns the root mean square of error over standard deviation, and the coverage of 95 % intervals. The
/// rows are roll, pitch and log focal length.
fn measure(truth: SceneErrors, assumed: SceneErrors, marks: usize, scenes: usize) -> [(f64, f64); 3] {
    let mut random = ChaCha8Rng::seed_from_u64(16);
    let (mut squares, mut covered, mut trials) = ([0.0; 3], [0; 3], 0);
    while trials < scenes {
        let scene = Scene::with_marks(&mut random, truth, marks);
        let Some(annotations) = scene.draw(&mut random) else { continue };
        let constraints = Constraints::new(&annotations, &scene.camera.lens, assumed);
        let options = FitOptions { sigma: Some(1.0), ..FitOptions::new(scene.camera.lens, SIZE) };
        let Ok(fit) = Fit::new(&constraints, &options) else { continue };
        // The uncertainty of a misfit is unknown.
        if fit.camera.covariance.sigma(Covariance::ROLL).is_none() {
            continue;
        }
        trials += 1;
        let sigma = |index| fit.camera.covariance.sigma(index).unwrap();
        let scores = [
            (fit.camera.roll - scene.camera.roll) / sigma(Covariance::ROLL),
            (fit.camera.pitch - scene.camera.pitch) / sigma(Covariance::PITCH),
            (fit.camera.focal / scene.camera.focal).ln() / fit.log_focal_sigma_with_prior(),
        ];
        for (i, score) in scores.into_iter().enumerate() {
            squares[i] += score * score;
            covered[i] += usize::from(score.abs() < 1.96);
        }
    }
    let count = trials as f64;
    std::array::from_fn(|i| ((squares[i] / count).sqrt(), 100.0 * covered[i] as f64 / count))
}

#[test]
fn intervals_are_correct_with_the_assumed_scene_errors() {
    let usual = SceneErrors::default();
    let outdoors = SceneErrors { floor_tilt: 2.0_f64.to_radians(), ..usual };
    for (name, errors, marks) in [
        ("usual", usual, 0),
        ("outdoors", outdoors, 0),
        ("marked ground", usual, 4),
        ("exact", SceneErrors::EXACT, 4),
    ] {
        let found = measure(errors, errors, marks, 1200);
        println!("{name}: error over bound and coverage of roll, pitch, focal: {found:.3?}");
        for (ratio, coverage) in found {
            assert!((0.92..1.08).contains(&ratio) && (93.0..97.3).contains(&coverage), "{name}: {found:?}");
        }
    }
}

#[test]
fn assuming_an_exact_scene_is_overconfident() {
    let usual = SceneErrors::default();
    for (_, coverage) in measure(usual, SceneErrors::EXACT, 0, 300) {
        assert!(coverage < 70.0, "{coverage} %");
    }
}

#[test]
fn assuming_level_marks_is_overconfident() {
    let usual = SceneErrors::default();
    let level = SceneErrors { crossfall: 0.0, ..usual };
    let [(_, roll), ..] = measure(usual, level, 4, 300);
    assert!(roll < 80.0, "{roll} %");
}

#[test]
fn exact_scene_is_found_exactly_with_any_assumed_errors() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let mut checked = 0;
    while checked < 50 {
        let scene = Scene::random(&mut random, SceneErrors::EXACT);
        let Some(mut annotations) = scene.draw(&mut random) else { continue };
        // Without noise: every segment exactly as projected.
        let straight = |annotation: &mut Annotation| -> Option<()> {
            for segment in annotation.segments.as_mut()? {
                let foot = scene.camera.pixel_to_floor(segment[0], 0.0)?.at_height(0.0);
                let way = match (annotation.kind, annotation.at_right_angles_to.is_some()) {
                    (Kind::Vertical, _) => [0.0, 0.0, 2.0],
                    (_, tied) => {
                        let azimuth = scene.directions[usize::from(tied)].0;
                        [2.0 * azimuth.cos(), 2.0 * azimuth.sin(), 0.0]
                    }
                };
                let far = WorldPoint::new(foot.x + way[0], foot.y + way[1], way[2]);
                segment[1] = scene.camera.world_to_pixel(far)?;
            }
            Some(())
        };
        if annotations.iter_mut().map(straight).any(|done| done.is_none()) {
            continue;
        }
        let constraints = Constraints::new(&annotations, &scene.camera.lens, SceneErrors::default());
        let options = FitOptions { weak_prior: false, ..FitOptions::new(scene.camera.lens, SIZE) };
        let Ok(fit) = Fit::new(&constraints, &options) else { continue };
        checked += 1;
        assert!(
            (fit.camera.focal / scene.camera.focal - 1.0).abs() < 1e-6 && fit.chi2 < 1e-9,
            "{} {}",
            fit.camera.focal,
            fit.chi2
        );
    }
}

#[test]
fn scene_errors_are_read_from_the_file() {
    let site = |scene: &str, annotation: &str| {
        format!(
            r#"{{"format":"calib-site","version":1,"scene":{scene},"cameras":[{{"id":"a","size_px":[1920,1080],
            "annotations":[{{"kind":"perpendicular","segments":[[[100,900],[400,800]],[[500,900],[700,1000]]]{annotation}}}]}}]}}"#
        )
    };
    let read = |scene, annotation| Site::from_json(&site(scene, annotation));
    let exact = read("\"exact\"", "").unwrap();
    assert_eq!(exact.scene_errors(&exact.cameras[0]), SceneErrors::EXACT);
    let outdoors = read(r#"{"floor_tilt_sigma_deg":2}"#, r#","angle_sigma_deg":3"#).unwrap();
    let errors = outdoors.scene_errors(&outdoors.cameras[0]);
    assert!(
        (errors.floor_tilt.to_degrees() - 2.0).abs() < 1e-12 && errors.angle == SceneErrors::default().angle
    );
    let lens = Lens::pinhole(Pixel::new(960.0, 540.0));
    let corner = Constraints::new(&outdoors.cameras[0].annotations, &lens, errors).deviations[1];
    assert!((corner.azimuth.to_degrees() - 3.0).abs() < 1e-12);
    let plumb = read(r#"{}"#, r#","exact":true"#).unwrap();
    assert!(Constraints::new(&plumb.cameras[0].annotations, &lens, errors).deviations.is_empty());
    for (scene, annotation, named) in [
        ("\"roughly\"", "", "exact"),
        (r#"{"floor_tilt_sigma_deg":-1}"#, "", "floor_tilt_sigma_deg"),
        ("{}", r#","length_sigma_rel":0.1"#, "length_sigma_rel"),
        ("{}", r#","like":"door""#, "like"),
    ] {
        let error = read(scene, annotation).unwrap_err().to_string();
        assert!(error.contains(named), "{error}");
    }
}

#[test]
fn object_of_usual_size_determines_the_scale_with_its_spread() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let scene = Scene::random(&mut random, SceneErrors::EXACT);
    let mut annotations = scene.draw(&mut random).unwrap();
    let foot = scene.camera.pixel_to_floor(Pixel::new(960.0, 900.0), 0.0).unwrap();
    let door = USUAL_SIZES.iter().find(|usual| usual.id == "door").unwrap();
    let Known { value, sigma, .. } = door.size;
    let head = scene.camera.world_to_pixel(foot.at_height(value)).unwrap();
    annotations.push(Annotation {
        foot: Some(Pixel::new(960.0, 900.0)),
        head: Some(head),
        like: Some("door".into()),
        ..Annotation::new(Kind::Upright)
    });
    let constraints = Constraints::new(&annotations, &scene.camera.lens, SceneErrors::EXACT);
    let fit = Fit::new(&constraints, &FitOptions::new(scene.camera.lens, SIZE)).unwrap();
    assert!(fit.is_height_known);
    let height = fit.camera.position.z;
    let relative = fit.camera.covariance.sigma(Covariance::Z).unwrap() / height;
    assert!((height / scene.camera.position.z - 1.0).abs() < 4.0 * relative, "{height} m");
    assert!(
        relative > sigma.unwrap() / value,
        "the scale must not be more certain than the door: {relative}"
    );
}
