//! Planes other than the floor: annotations on them, links on them, and their estimated height and tilt.

use calib_core::{Annotation, Camera, Covariance, FloorPoint, Kind, Lens, Pixel, Plane, WorldPoint};

use calib_core::single::Known;

use calib_demo::random::normal;
use calib_site::{
    Link, LinkKind, LinkObservation, Options, PlacementEntry, PlaneEntry, PlaneNumber, SceneEntry, Site,
    SiteCamera, TiltEntry,
};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

const SIZE: [u32; 2] = [1920, 1080];

fn camera(position: [f64; 3], yaw: f64) -> Camera {
    Camera {
        position: position.into(),
        yaw,
        pitch: 0.55,
        roll: 0.02,
        focal: 1200.0,
        lens: Lens::pinhole(Pixel::new(960.0, 540.0)),
        covariance: Covariance::EXACT,
    }
}

/// Simulated operator who annotates points and lines in the image of a camera, with noise.
struct Hand<'a> {
    camera: &'a Camera,
    random: ChaCha8Rng,
    noise: f64,
}

impl<'a> Hand<'a> {
    fn exact(camera: &'a Camera) -> Self {
        Self { camera, random: ChaCha8Rng::seed_from_u64(1), noise: 0.0 }
    }

    fn pixel(&mut self, at: WorldPoint) -> Pixel {
        let Pixel { u, v } = self.camera.world_to_pixel(at).unwrap();
        Pixel { u: u + self.noise * normal(&mut self.random), v: v + self.noise * normal(&mut self.random) }
    }

    fn line(&mut self, a: WorldPoint, b: WorldPoint) -> Vec<Pixel> {
        vec![self.pixel(a), self.pixel(b)]
    }

    /// Draws a segment on a plane. The start and the direction are in floor coordinates.
    fn on(&mut self, plane: &Plane, [x, y]: [f64; 2], [dx, dy]: [f64; 2]) -> Vec<Pixel> {
        self.line(lifted(plane, x, y), lifted(plane, x + dx, y + dy))
    }

    fn verticals(&mut self) -> Annotation {
        let feet = [[-1.5, 6.0], [0.2, 7.0], [1.8, 5.5]];
        let posts = feet.map(|[x, y]| self.line(WorldPoint::new(x, y, 0.0), WorldPoint::new(x, y, 1.8)));
        Annotation::from_segments(Kind::Vertical, posts.to_vec())
    }

    /// Draws floor lines in two perpendicular directions.
    fn floor(&mut self) -> Vec<Annotation> {
        let along = [[-1.0, 4.5], [0.5, 5.0], [1.5, 6.0]].map(|at| self.on(&Plane::FLOOR, at, [0.7, 2.4]));
        let across = [[-1.0, 5.0], [0.0, 7.0]].map(|at| self.on(&Plane::FLOOR, at, [1.2, -0.35]));
        vec![
            Annotation { id: Some("p".into()), ..Annotation::from_segments(Kind::Parallel, along.to_vec()) },
            Annotation {
                at_right_angles_to: Some("p".into()),
                ..Annotation::from_segments(Kind::Parallel, across.to_vec())
            },
        ]
    }
}

fn lifted(plane: &Plane, x: f64, y: f64) -> WorldPoint {
    WorldPoint::new(x, y, plane.height_at(FloorPoint { x, y }))
}

fn on_plane(annotation: Annotation) -> Annotation {
    Annotation { plane: Some("stage".into()), ..annotation }
}

fn region(x: f64, y: f64) -> Vec<FloorPoint> {
    [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
        .map(|[dx, dy]| FloorPoint { x: x + dx, y: y + dy })
        .to_vec()
}

fn exact(value: f64) -> Option<PlaneNumber> {
    Some(PlaneNumber::Exact(value))
}

fn site(plane: PlaneEntry, cameras: Vec<SiteCamera>) -> Site {
    Site { planes: vec![plane], cameras, scene: Some(SceneEntry::EXACT), ..Site::new() }
}

fn solved(site: &Site) -> Site {
    site.check().unwrap();
    site.calibrate(&Options { refine: true, ..Options::default() }).write_into(site)
}

/// Returns an annotated camera with verticals, floor lines and more annotations.
fn entry(id: &str, hand: &mut Hand, more: Vec<Annotation>) -> SiteCamera {
    let mut annotations = vec![hand.verticals()];
    annotations.extend(hand.floor());
    annotations.extend(more);
    SiteCamera { annotations, ..SiteCamera::new(id, SIZE) }
}

#[test]
fn length_on_a_platform_determines_its_height() {
    let truth = camera([0.0, 0.0, 4.0], 0.0);
    let stage = Plane::level(0.6);
    let mut hand = Hand::exact(&truth);
    let measured = Annotation {
        length_m: Some(2.0),
        ..Annotation::from_segments(Kind::KnownLength, vec![hand.on(&stage, [-0.5, 6.0], [2.0, 0.0])])
    };
    let height = |annotation| {
        let plane = PlaneEntry { height_m: exact(0.6), tilt: Some(level()), ..PlaneEntry::new("stage") };
        let site = site(plane, vec![entry("a", &mut Hand::exact(&truth), vec![annotation])]);
        solved(&site).cameras[0].solution.as_ref().unwrap().position_m.unwrap().z
    };
    assert!((height(on_plane(measured.clone())) - 4.0).abs() < 1e-6);
    assert!((height(measured) - 3.4).abs() < 1e-6, "taken for a length on the floor");
}

fn level() -> TiltEntry {
    TiltEntry { toward_deg: exact(0.0), fall_deg: exact(0.0) }
}

fn placed(entry: SiteCamera, camera: &Camera, fixed: bool) -> SiteCamera {
    let placement = PlacementEntry {
        move_m: camera.position.on_floor(),
        turn_deg: camera.yaw.to_degrees(),
        scale: Some(camera.position.z / 3.0),
        fixed,
        held: calib_site::FixedEntry::default(),
        estimated: false,
    };
    SiteCamera { placement: Some(placement), ..entry }
}

/// Returns a site with two placed cameras; the first is fixed. The cameras have shared points on the floor and on a
/// plane, and lines on the plane.
fn pair(plane: &Plane, noise: f64, seed: u64) -> Site {
    let cameras = [camera([0.0, 0.0, 4.0], 0.0), camera([3.0, 1.0, 3.5], 0.5)];
    let mut hands: Vec<Hand> = (0..2)
        .map(|i| Hand { camera: &cameras[i], random: ChaCha8Rng::seed_from_u64(2 * seed + i as u64), noise })
        .collect();
    let on_stage = |hand: &mut Hand| {
        let along = [[-0.6, 5.2], [0.3, 5.4]].map(|at| hand.on(plane, at, [0.3, 1.6]));
        vec![on_plane(Annotation::from_segments(Kind::Parallel, along.to_vec()))]
    };
    let ids = ["a", "b"];
    let entries = (0..2)
        .map(|i| {
            let more = on_stage(&mut hands[i]);
            let drawn = SiteCamera { sigma_px: Some(1.0), ..entry(ids[i], &mut hands[i], more) };
            placed(drawn, &cameras[i], i == 0)
        })
        .collect();
    let mut link = |at: WorldPoint, plane: Option<String>| {
        let seen =
            (0..2).map(|i| LinkObservation { px: Some(hands[i].pixel(at)), ..LinkObservation::new(ids[i]) });
        Link { plane, ..Link::new(None, LinkKind::Point, seen.collect()) }
    };
    let floor = [[-1.0, 7.0], [1.0, 7.5], [0.0, 8.5], [1.5, 5.0]];
    let stage = [[-0.7, 5.2], [0.6, 5.1], [0.8, 6.7], [-0.5, 6.8], [0.1, 6.0]];
    let mut links: Vec<Link> = floor.map(|[x, y]| link(WorldPoint::new(x, y, 0.0), None)).to_vec();
    links.extend(stage.map(|[x, y]| link(lifted(plane, x, y), Some("stage".into()))));
    Site { links, ..site(PlaneEntry { region: region(0.0, 6.0), ..PlaneEntry::new("stage") }, entries) }
}

#[test]
fn shared_points_determine_the_height_of_a_platform() {
    let site = pair(&Plane { anchor: FloorPoint { x: 0.0, y: 6.0 }, ..Plane::level(0.6) }, 0.0, 0);
    let plane = PlaneEntry { tilt: Some(level()), ..site.planes[0].clone() };
    let solved = solved(&Site { planes: vec![plane], ..site });
    let found = solved.planes[0].solution.unwrap();
    assert!((found.height_m - 0.6).abs() < 1e-4, "{found:?}");
    assert!(found.covariance[0].sqrt() < 0.1, "{found:?}");
    let second = solved.cameras[1].solution.as_ref().unwrap().camera().unwrap();
    assert!(second.position.distance(WorldPoint::new(3.0, 1.0, 3.5)) < 1e-3, "{:?}", second.position);
}

#[test]
fn ramp_with_weak_priors_is_found() {
    let truth = Plane::falling(0.5, 0.3, 5.0_f64.to_radians(), FloorPoint { x: 0.0, y: 6.0 });
    let site = pair(&truth, 0.0, 0);
    let about = |value, sigma| Some(PlaneNumber::Known(Known::prior(value, sigma)));
    let tilt = TiltEntry { toward_deg: about(0.0, 60.0), fall_deg: about(4.0, 3.0) };
    let plane = PlaneEntry { tilt: Some(tilt), ..site.planes[0].clone() };
    let solved = solved(&Site { planes: vec![plane], ..site });
    let found = solved.planes[0].solution.unwrap();
    assert!((found.height_m - 0.5).abs() < 0.005, "{found:?}");
    let off = (found.slope[0] - truth.slope[0]).hypot(found.slope[1] - truth.slope[1]);
    assert!(off < 0.003, "{found:?}, {:?}", truth.slope);
    for link in &solved.links {
        let residuals = &link.solution.as_ref().unwrap().residuals;
        assert!(residuals.iter().all(|seen| seen.px < 0.2), "{residuals:?}");
    }
    // Pixels are mapped to the estimated plane.
    let [surface] = &solved.surfaces()[..] else { panic!("one surface") };
    let at = lifted(&truth, 0.2, 6.3);
    let first = solved.cameras[0].solution.as_ref().unwrap().camera().unwrap();
    let pixel = first.world_to_pixel(at).unwrap();
    let shown = first.pixel_to_surface(pixel, 0.0, std::slice::from_ref(surface)).unwrap();
    assert_eq!(shown.surface, Some(0));
    assert!(shown.at.distance(at) < 0.01, "{shown:?}");
}

/// Checks the error of the height, in standard deviations, over many draws of the noise.
#[test]
fn height_errors_match_their_sigma() {
    const DRAWS: u64 = 150;
    let truth = Plane { anchor: FloorPoint { x: 0.0, y: 6.0 }, ..Plane::level(0.6) };
    let errors: Vec<f64> = (1..=DRAWS)
        .filter_map(|seed| {
            let site = pair(&truth, 1.0, seed);
            let plane = PlaneEntry { tilt: Some(level()), ..site.planes[0].clone() };
            let found = solved(&Site { planes: vec![plane], ..site }).planes[0].solution?;
            Some((found.height_m - 0.6) / found.covariance[0].sqrt())
        })
        .collect();
    assert!(errors.len() as u64 > DRAWS - 5, "{}", errors.len());
    let inside = errors.iter().filter(|z| z.abs() < 1.96).count() as f64 / errors.len() as f64;
    let spread = (errors.iter().map(|z| z * z).sum::<f64>() / errors.len() as f64).sqrt();
    println!("inside 95 %: {:.1} %, error over sigma {spread:.2}", 100.0 * inside);
    assert!((0.90..=0.99).contains(&inside) && (0.85..1.15).contains(&spread), "{inside} {spread}");
}

#[test]
fn invalid_planes_are_refused() {
    let says = |planes: &str, camera: &str, part: &str| {
        let text = format!(
            r#"{{"format":"calib-site","version":1,"planes":{planes},"cameras":[{{"id":"door","size_px":[640,480]{camera}}}]}}"#
        );
        let error = Site::from_json(&text).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    };
    let line = r#","annotations":[{"kind":"parallel","plane":"ramp","segments":[[[1,2],[3,4]]]}]"#;
    says("[]", line, "\"ramp\"");
    says(r#"[{"id":"ramp","region":[[0,0],[1,0]]}]"#, "", "at least 3");
    says(r#"[{"id":"ramp","height_m":{"value":1}}]"#, "", "\"fixed\": true");
    says(r#"[{"id":"ramp","height_m":"high"}]"#, "", "expected a number");
    says(r#"[{"id":"ramp"},{"id":"ramp"}]"#, "", "an id that no other plane has");
    says(r#"[{"id":"ramp","tilt":{"fall_deg":80}}]"#, "", "between 0 and 45");
    let vertical = r#","annotations":[{"kind":"vertical","plane":"ramp","segments":[[[1,2],[3,4]]]}]"#;
    says(r#"[{"id":"ramp"}]"#, vertical, "\"plane\"");
    says(r#"[{"id":"ramp"}]"#, r#","efov_plane":"roof""#, "\"roof\"");
}
