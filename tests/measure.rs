//! `calib measure`: intervals of simulated measurements, refused points, and units.

use calib_core::camera::{Camera, FloorPoint, Pixel, WorldPoint};
use calib_core::floor::Measured;
use calib_core::single::Known;
use calib_demo::random::{AnnotationSet, RandomScene, normal};
use calib_site::{
    Measurement, MeasurementKind, MeasurementPoint, Options, SceneEntry, Site, SiteCamera, Units,
};
use calib_tests::{Scratch, above, entry};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// Accepted share of 95 % intervals that contain the truth, in per cent.
const EXPECTED: std::ops::RangeInclusive<f64> = 93.0..=97.0;

/// Simulated camera: its truth, and a site with the camera solved from noisy lines and a noisy height.
struct Simulated {
    truth: Camera,
    site: Site,
}

impl Simulated {
    fn new(random: &mut ChaCha8Rng) -> Option<Self> {
        let scene = RandomScene::new(random, AnnotationSet::Directions, None, None);
        let truth = scene.camera;
        let height = truth.position.z + 0.05 * normal(random);
        let camera = SiteCamera {
            annotations: scene.noisy(random, 1.0),
            sigma_px: Some(1.0),
            height_m: Some(Known::prior(height, 0.05)),
            ..SiteCamera::new("a", [1920, 1080])
        };
        let site = Site { cameras: vec![camera], scene: Some(SceneEntry::EXACT), ..Site::new() };
        let solved = site.calibrate(&Options::default()).write_into(&site);
        let solution = solved.cameras[0].solution.as_ref()?;
        let is_usable = solution.sigma.as_ref()?.floor_length_rel? < 0.05;
        is_usable.then_some(Self { truth, site: solved })
    }

    /// Returns a floor point in the image with its noisy pixel.
    fn floor_point(&self, random: &mut ChaCha8Rng) -> (FloorPoint, Pixel) {
        loop {
            let pixel =
                Pixel { u: random.random_range(200.0..1720.0), v: random.random_range(300.0..1000.0) };
            let Some(at) = self.truth.pixel_to_floor(pixel, 0.0) else { continue };
            if at.distance(self.truth.position.on_floor()) < 4.0 * self.truth.position.z {
                return (at, noisy(random, pixel));
            }
        }
    }

    /// Measures one quantity between random points; returns the true value with the result.
    fn measure(&self, random: &mut ChaCha8Rng, kind: MeasurementKind) -> Option<(f64, Measured)> {
        let corners: Vec<(FloorPoint, Pixel)> = (0..3).map(|_| self.floor_point(random)).collect();
        let [(a, from), (b, to), (c, third)] = corners[..] else { return None };
        let cross = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
        let tall = random.random_range(0.5..2.0);
        let (truth, pixels) = match kind {
            MeasurementKind::Length => (a.distance(b), vec![from, to]),
            MeasurementKind::Speed => (a.distance(b) / 1.5, vec![from, to]),
            MeasurementKind::Area => (0.5 * cross.abs(), vec![from, to, third]),
            MeasurementKind::Height => {
                let head = self.truth.world_to_pixel(a.at_height(tall))?;
                (tall, vec![from, noisy(random, head)])
            }
        };
        // Tiny figures are skipped: the error of their length or area is not approximately normal.
        if truth < 0.5 {
            return None;
        }
        let times = ["2026-05-01T08:00:00Z", "2026-05-01T08:00:01.5Z"];
        let point = |(index, px): (usize, Pixel)| MeasurementPoint {
            at: Some(times[index.min(1)].into()),
            sigma_px: Some(1.0),
            ..MeasurementPoint::new("a".into(), px)
        };
        let points = pixels.into_iter().enumerate().map(point).collect();
        let measurement = Measurement::new(kind, points);
        Some((truth, self.site.measure(&measurement).ok()?))
    }
}

fn noisy(random: &mut ChaCha8Rng, Pixel { u, v }: Pixel) -> Pixel {
    Pixel { u: u + normal(random), v: v + normal(random) }
}

#[test]
fn intervals_contain_the_truth_as_often_as_they_state() {
    const EACH: usize = 1000;
    let mut random = ChaCha8Rng::seed_from_u64(4901);
    for kind in
        [MeasurementKind::Length, MeasurementKind::Height, MeasurementKind::Area, MeasurementKind::Speed]
    {
        let (mut inside, mut count) = (0, 0);
        while count < EACH {
            let Some(camera) = Simulated::new(&mut random) else { continue };
            let Some((truth, found)) = camera.measure(&mut random, kind) else { continue };
            let sigma = found.sigma.unwrap_or_else(|| panic!("{kind:?}: the uncertainty is unknown"));
            count += 1;
            inside += usize::from((found.value - truth).abs() < 1.96 * sigma);
        }
        let share = 100.0 * inside as f64 / count as f64;
        println!("{kind:?}: {share:.1} % of {count} intervals contain the truth");
        assert!(EXPECTED.contains(&share), "{kind:?}: {share:.1} %");
    }
}

#[test]
fn program_measures_and_refuses_points_without_floor() {
    let cameras = [above(0.0), above(3.0)];
    let site = Site { cameras: vec![entry("left", &cameras[0]), entry("right", &cameras[1])], ..Site::new() };
    let scratch = Scratch::new();
    scratch.write("site.json", site.to_json());
    let px = |camera: &Camera, x: f64, y: f64, z: f64| {
        let pixel = camera.world_to_pixel(WorldPoint::new(x, y, z)).unwrap();
        format!("{},{}", pixel.u, pixel.v)
    };
    let [from, to] = [px(&cameras[0], 0.0, 6.0, 0.0), px(&cameras[1], 3.0, 10.0, 0.0)];
    let measure = |more: &[&str]| {
        let base = ["measure", "site.json", "--camera", "left", "--from", &from, "--to", &to];
        scratch.calib(&[&base, more].concat())
    };
    let found = measure(&["--to-camera", "right", "--sigma-px", "0.5"]).expect_code(0).json();
    assert!((found["length_m"].as_f64().unwrap() - 5.0).abs() < 1e-6, "{found}");
    assert!(found["sigma_m"].is_null(), "the uncertainty of the file's cameras is unknown: {found}");
    let times = ["--from-at", "2026-05-01T08:00:00Z", "--to-at", "2026-05-01T08:00:02Z"];
    let found = measure(&[&["--to-camera", "right"], &times[..]].concat()).expect_code(0).json();
    assert!((found["speed_mps"].as_f64().unwrap() - 2.5).abs() < 1e-6, "{found}");
    let head = px(&cameras[0], 0.0, 6.0, 1.8);
    let base = ["measure", "site.json", "--camera", "left", "--from", &from, "--to", &head];
    let found = scratch.calib(&[&base, &["--kind", "height"][..]].concat()).expect_code(0).json();
    assert!((found["length_m"].as_f64().unwrap() - 1.8).abs() < 1e-6, "{found}");
    let sky = ["measure", "site.json", "--camera", "left", "--from", &from, "--to", "900,2"];
    let refused = scratch.calib(&sky).expect_code(3);
    assert!(
        refused.stderr.contains("field of view") || refused.stderr.contains("horizon"),
        "{}",
        refused.stderr
    );
    let far = ["measure", "site.json", "--camera", "left", "--from", "5000,9", "--to", "900,600"];
    assert!(scratch.calib(&far).expect_code(3).stderr.contains("outside the image"));
    scratch.calib(&["measure", "site.json"]).expect_code(2);
}

#[test]
fn lengths_of_a_site_in_feet_are_shown_in_feet() {
    let mut random = ChaCha8Rng::seed_from_u64(9);
    let site = std::iter::repeat_with(|| Simulated::new(&mut random)).flatten().next().unwrap().site;
    let scratch = Scratch::new();
    let points = ["--camera", "a", "--from", "800,900", "--to", "1200,900"];
    let shown = |units, format: &str| {
        let site = Site { units, ..site.clone() };
        scratch.write("site.json", site.to_json());
        let command = [&["measure", "site.json"][..], &points, &["--format", format]].concat();
        scratch.calib(&command).expect_code(0).stdout
    };
    let number = |text: &str| text.split(' ').next().unwrap().parse::<f64>().unwrap();
    let [metres, feet] = [Units::Metres, Units::Feet].map(|units| shown(units, "text"));
    assert!(feet.contains(" ft \u{b1} "), "{feet}");
    assert!((number(&feet) * 0.3048 / number(&metres) - 1.0).abs() < 0.01, "{feet} and {metres}");
    // Fields with SI units in their names stay in these units.
    assert_eq!(shown(Units::Feet, "json"), shown(Units::Metres, "json"));
}

#[test]
fn stored_measurements_are_listed_with_their_errors() {
    let camera = above(0.0);
    let px = |x: f64, y: f64| camera.world_to_pixel(WorldPoint::new(x, y, 0.0)).unwrap();
    let of = |id: &str, points: [Pixel; 2]| Measurement {
        id: Some(id.into()),
        ..Measurement::new(
            MeasurementKind::Length,
            points.map(|px| MeasurementPoint::new("left".into(), px)).to_vec(),
        )
    };
    let good = of("aisle", [px(-1.0, 6.0), px(1.0, 6.0)]);
    let bad = of("sky", [px(-1.0, 6.0), Pixel { u: 900.0, v: 1.0 }]);
    let site = Site { cameras: vec![entry("left", &camera)], measurements: vec![good, bad], ..Site::new() };
    let scratch = Scratch::new();
    scratch.write("site.json", site.to_json());
    let found = scratch.calib(&["measure", "site.json"]).expect_code(4).json();
    let list = found["measurements"].as_array().unwrap();
    assert!((list[0]["length_m"].as_f64().unwrap() - 2.0).abs() < 1e-6, "{found}");
    assert_eq!((list[1]["id"].as_str(), list[1]["error"].is_string()), (Some("sky"), true));
}
