//! Demonstration site document: the entered data, and the true cameras, which a calibration should recover.
//!
//! A variant of the site has no plan. Links and marks connect the cameras of the shop; the cameras of the store
//! and the barn are not connected to them.

use calib_core::camera::{Coefficient, RotationZoom};
use calib_core::floor::STAGE_1_HEIGHT;
use calib_core::single::Known;
use calib_core::{
    BrownConrady, Camera, Covariance, Distortion, FloorPoint, ImageCircle, Lens, MarkKind, Pixel, Placement,
    WorldPoint,
};
use calib_site::{
    Distance, DistortionEntry, Format, LensEntry, Mark, MarkObservation, PlacementEntry, Site, SiteCamera,
};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

use crate::edge::Edge;
use crate::element::{barn_landmarks, control_points, links, marks, shop_landmarks};
use crate::hand::annotation_plan;
use crate::hand::{Operator, TREMOR};
use crate::plan::plan_entry;
use crate::random::normal;
use crate::world::{is_shown, visible};

/// Returns id, true camera and image size in pixels of every camera.
pub(crate) fn cameras() -> Vec<(&'static str, Camera, [u32; 2])> {
    /// Size of the image of a rectangular sensor, in pixels.
    const HD: [u32; 2] = [1920, 1080];
    /// Size of the image of a fisheye camera, in pixels.
    const SQUARE: [u32; 2] = [1440, 1440];
    let barrel = BrownConrady { k1: -0.25, k2: 0.06, ..BrownConrady::default() };
    let mild = BrownConrady { k1: -0.09, k2: 0.015, ..BrownConrady::default() };
    vec![
        ("shop-1", camera([23.6, 14.0, 3.9], [129.0, 27.0, 1.6], 1180.0, None, HD), HD),
        ("shop-2", camera([0.4, 0.4, 4.2], [-50.0, 27.0, -0.8], 1165.0, Some(barrel), HD), HD),
        ("shop-3", camera([23.6, 0.4, 3.5], [46.0, 24.0, -2.4], 1270.0, None, HD), HD),
        ("store", camera([24.5, 8.1, 3.4], [-148.0, 29.0, 1.1], 780.0, None, [1280, 960]), [1280, 960]),
        ("barn", camera([0.6, -5.9, 3.6], [-91.5, 17.0, 0.9], 1420.0, Some(mild), HD), HD),
        ("checkouts", ceiling([8.1, 10.3, 4.45], [14.0, 86.5, 1.2], SQUARE), SQUARE),
    ]
}

/// Largest angle of a fisheye's rays from its axis, in degrees: the image circle has a field of view of 185°.
const HALF_FIELD: f64 = 92.5;

/// Returns a fisheye camera under the ceiling, with yaw, pitch and roll in degrees. Its image circle has a
/// small margin to the image border.
fn ceiling(at: [f64; 3], degrees: [f64; 3], size: [u32; 2]) -> Camera {
    let mut camera = camera(at, degrees, 454.0, None, size);
    let distortion = Distortion::KannalaBrandt { k: [-0.02, 0.001, 0.0, 0.0] };
    camera.lens = Lens { focal: camera.focal, distortion, ..camera.lens };
    let (sin, cos) = HALF_FIELD.to_radians().sin_cos();
    let Pixel { u, v } = camera.lens.principal_point;
    let rim = camera.lens.bearing_to_pixel([camera.focal * sin, 0.0, cos]);
    camera.lens.image_circle = rim.map(|rim| ImageCircle { u, v, radius: rim.u - u });
    camera
}

/// Whether the camera with this id shows the shop.
pub(crate) fn is_in_shop(id: &str) -> bool {
    id.starts_with("shop") || id == "checkouts"
}

/// Returns the ids of the cameras that changed within the month, with their rotation and zoom. One camera was
/// bumped, and one zoomed.
#[must_use]
pub fn changed_cameras() -> [(&'static str, RotationZoom); 2] {
    /// Rotation of the bumped camera, in degrees.
    const BUMP_DEG: f64 = 1.3;
    let bump = [0.6, 0.7483, -0.2828].map(|part| part * BUMP_DEG.to_radians());
    [
        ("shop-1", RotationZoom { vector: bump, zoom: 0.0 }),
        ("store", RotationZoom { vector: [0.0; 3], zoom: 1.03_f64.ln() }),
    ]
}

/// Returns a camera at a position in metres, with yaw, pitch and roll in degrees and the focal length in
/// pixels. The coefficients of `lens` refer to this focal length.
fn camera(at: [f64; 3], degrees: [f64; 3], focal: f64, lens: Option<BrownConrady>, size: [u32; 2]) -> Camera {
    let [yaw, pitch, roll] = degrees.map(f64::to_radians);
    let principal_point = Pixel::new(f64::from(size[0]) / 2.0, f64::from(size[1]) / 2.0);
    let lens = lens.map_or(Lens::pinhole(principal_point), |brown| Lens {
        principal_point,
        focal,
        distortion: Distortion::BrownConrady(brown),
        image_circle: None,
        pixel_aspect: 1.0,
    });
    Camera { position: WorldPoint::from(at), yaw, pitch, roll, focal, lens, covariance: Covariance::EXACT }
}

/// Returns the same camera for an image whose sides are multiplied by `factor`.
#[cfg(test)]
pub(crate) fn resized(camera: &Camera, factor: f64) -> Camera {
    let Pixel { u, v } = camera.lens.principal_point;
    let principal_point = Pixel::new(u * factor, v * factor);
    let circle = |circle: ImageCircle| <[f64; 3]>::from(circle).map(|side| factor * side).into();
    let image_circle = camera.lens.image_circle.map(circle);
    let lens = Lens { principal_point, focal: camera.lens.focal * factor, image_circle, ..camera.lens };
    Camera { focal: camera.focal * factor, lens, ..*camera }
}

/// Length of the last part of a line of sight to a point of a mark in which occlusion is ignored, in metres. The
/// mark's own object may hide the point.
const SLACK: f64 = 0.35;

/// Removes plan, control points and all placements except the first, and adds observations of the marks.
///
/// The first camera gets its exact placement, which is the gauge of the site. The poses of the marks get errors.
pub(crate) fn without_plan(mut site: Site) -> Site {
    site.plan = None;
    site.georeference = None;
    for (index, (camera, (_, truth, _))) in site.cameras.iter_mut().zip(cameras()).enumerate() {
        camera.control_points.clear();
        camera.placement = (index == 0).then(|| Placement::from_camera(&truth).into());
    }
    let mut hands: Vec<(&str, Operator)> = cameras()
        .into_iter()
        .enumerate()
        .filter(|(_, (id, ..))| is_in_shop(id))
        .map(|(i, (id, camera, size))| {
            let random = ChaCha8Rng::seed_from_u64(3000 + i as u64);
            (id, Operator { camera, size, tremor: TREMOR, random })
        })
        .collect();
    let mut random = ChaCha8Rng::seed_from_u64(4000);
    for mark in &mut site.marks {
        mark.seen = mark_observations(mark, &mut hands);
        // The mark is placed approximately, and the joint solution moves it.
        let WorldPoint { x, y, z } = mark.at_m;
        let mut off =
            |sigma: f64, value: f64| ((value + sigma * normal(&mut random)) * 100.0).round() / 100.0;
        mark.at_m = WorldPoint { x: off(0.15, x), y: off(0.15, y), z };
        mark.turn_deg = off(3.0, mark.turn_deg);
    }
    site
}

/// Returns the names of the points of a mark that an operator can annotate in images.
fn visible_point_names(kind: MarkKind) -> &'static [&'static str] {
    match kind {
        MarkKind::Cross => &["centre"],
        MarkKind::Post => &["base"],
        MarkKind::Box => &["b0", "b1", "b2", "b3", "t0", "t1", "t2", "t3"],
        MarkKind::Cylinder => &["top"],
        MarkKind::Circle => &["centre"],
        MarkKind::Person => &["foot", "head"],
        MarkKind::Grid => &["0,0", "6,0", "0,3", "6,3"],
        MarkKind::Rectangle => &["c0", "c1", "c2", "c3"],
    }
}

fn mark_observations(mark: &Mark, hands: &mut [(&str, Operator)]) -> Vec<MarkObservation> {
    let shape = mark.shape();
    let mut seen = Vec::new();
    for name in visible_point_names(mark.kind) {
        let Some(point) = shape.point(name) else { continue };
        for (id, hand) in hands.iter_mut() {
            // Points inside an object, such as its centre, are annotated although its surface hides them.
            let slack = if matches!(mark.kind, MarkKind::Box | MarkKind::Grid) { 0.03 } else { SLACK };
            if !visible(&hand.camera, hand.size, point, slack) {
                continue;
            }
            if let Some(px) = hand.annotate_point(point) {
                seen.push(MarkObservation { camera: (*id).into(), point: (*name).into(), px });
            }
        }
    }
    seen
}

/// Demonstration site with its truth.
#[derive(Clone, Debug)]
pub struct DemoSite {
    /// Entered data and annotations, without solutions.
    pub site: Site,
    /// Id and true camera, in the order of the site.
    pub truth: Vec<(String, Camera)>,
}

/// Distortion of the cameras with distorted lenses, as entered in the site.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum KnownLens {
    /// Known distortion: fixed coefficients, with the focal length that they refer to. The focal length of
    /// the camera is unknown.
    Given,
    /// Unknown distortion: k1 and k2 are fitted to the `straight` annotations.
    #[default]
    Fitted,
}

/// Creates the demonstration site, with distortion that the solve must fit.
#[must_use]
pub fn demo_site() -> DemoSite {
    demo_site_with(KnownLens::default())
}

/// Creates the demonstration site with known or unknown distortion.
#[must_use]
pub fn demo_site_with(lens: KnownLens) -> DemoSite {
    let truth = cameras().into_iter().map(|(id, camera, _)| (id.into(), camera)).collect();
    DemoSite { site: site(lens, TREMOR), truth }
}

/// Creates the demonstration site without a plan: only links and marks connect its cameras.
#[must_use]
pub fn demo_site_without_plan() -> DemoSite {
    let demo = demo_site();
    DemoSite { site: without_plan(demo.site), ..demo }
}

/// Creates the data that an operator with this tremor, in pixels, would enter.
pub(crate) fn site(lens: KnownLens, tremor: f64) -> Site {
    let cameras = cameras();
    let hand = |seed: usize, camera: &Camera, size: [u32; 2]| {
        // Each image has its own random numbers, so an additional line does not change other images.
        let random = ChaCha8Rng::seed_from_u64(1000 + seed as u64);
        Operator { camera: *camera, size, tremor, random }
    };
    let entries = cameras.iter().enumerate().map(|(i, (id, camera, size))| {
        let mut hand = hand(i, camera, *size);
        site_camera(id, &mut hand, lens)
    });
    let entries = entries.collect();
    let mut hands: Vec<(&str, Operator)> = cameras
        .iter()
        .enumerate()
        .filter(|(_, (id, ..))| is_in_shop(id))
        .map(|(i, (id, camera, size))| (*id, hand(100 + i, camera, *size)))
        .collect();
    let links = links(&mut hands, 8);
    Site {
        format: Format::CalibSite,
        version: 1,
        name: Some("Farm shop and barn".into()),
        units: calib_site::Units::Metres,
        plan: Some(plan_entry()),
        cameras: entries,
        distances: measured_distance(&links).into_iter().collect(),
        links,
        marks: marks(),
        georeference: None,
        crs: None,
        scene: None,
        planes: Vec::new(),
        walls: Vec::new(),
        areas: Vec::new(),
        level_px_per_m: None,
        measurements: Vec::new(),
        ground_points: Vec::new(),
        solution: None,
    }
}

fn site_camera(id: &str, hand: &mut Operator, lens: KnownLens) -> SiteCamera {
    let annotations = annotation_plan(id).annotate(hand);
    let control_points = match id {
        "shop-1" | "shop-3" => control_points(hand, &shop_landmarks(), 7),
        "barn" => control_points(hand, &barn_landmarks(), 6),
        _ => Vec::new(),
    };
    SiteCamera {
        name: Some(title(id).into()),
        image: Some(format!("{id}.png")),
        lens: lens_entry(&hand.camera, lens),
        sigma_px: Some(TREMOR),
        annotations,
        efov_px: Some(efov(id, hand)),
        placement: Some(placement_entry(hand)),
        control_points,
        ..SiteCamera::new(id, hand.size)
    }
}

fn title(id: &str) -> &'static str {
    match id {
        "shop-1" => "Shop, north-east corner",
        "shop-2" => "Shop, south-west corner",
        "shop-3" => "Shop, south-east corner",
        "store" => "Store room",
        "checkouts" => "Checkouts, ceiling",
        _ => "Barn, aisle",
    }
}

fn lens_entry(camera: &Camera, known: KnownLens) -> Option<LensEntry> {
    let model = camera.lens.distortion.model()?;
    let bare = DistortionEntry::new(model);
    let focal_px = Some(camera.lens.focal);
    let distortion = match (known, camera.lens.distortion) {
        (KnownLens::Given, Distortion::BrownConrady(BrownConrady { k1, k2, k3, p1, p2 })) => {
            DistortionEntry {
                k1: Some(k1),
                k2: Some(k2),
                k3: Some(k3),
                p1: Some(p1),
                p2: Some(p2),
                focal_px,
                ..bare
            }
        }
        (KnownLens::Given, Distortion::KannalaBrandt { k: [k1, k2, k3, k4] }) => {
            let [k1, k2, k3, k4] = [k1, k2, k3, k4].map(Some);
            DistortionEntry { k1, k2, k3, k4, focal_px, ..bare }
        }
        _ => DistortionEntry { fit: Some(vec![Coefficient::K1, Coefficient::K2]), ..bare },
    };
    let image_circle_px = camera.lens.image_circle;
    Some(LensEntry { distortion: Some(distortion), image_circle_px, ..LensEntry::default() })
}

/// Returns the corners of the floor area that a camera should cover, in metres.
fn covered_area(id: &str) -> &'static [[f64; 2]] {
    match id {
        "shop-1" => &[[20.4, 13.2], [21.9, 10.2], [21.6, 1.8], [13.8, 1.2], [9.6, 9.0], [9.6, 13.8]],
        "shop-2" => &[[3.0, 1.2], [3.3, 9.6], [9.6, 13.2], [20.4, 12.0], [20.4, 1.8], [6.0, 1.2]],
        "shop-3" => &[[20.4, 1.8], [12.6, 1.2], [9.0, 8.4], [12.6, 13.2], [21.0, 12.6], [22.8, 4.2]],
        "checkouts" => &[[3.2, 9.2], [3.2, 13.4], [12.0, 13.4], [12.6, 9.0], [10.8, 7.8], [5.4, 7.8]],
        "store" => &[[25.4, 6.2], [25.0, 2.4], [28.6, 1.6], [29.6, 2.4], [28.6, 6.0]],
        _ => &[[5.0, -7.7], [20.0, -7.7], [20.0, -4.8], [5.0, -4.8]],
    }
}

/// Returns the EFOV in pixels: the image of the floor area that a camera should cover. Corners outside the
/// image are moved toward the centre of the area.
fn efov(id: &str, hand: &Operator) -> Vec<Pixel> {
    /// Minimum distance of the EFOV from the image border, in pixels.
    const MARGIN: f64 = 24.0;
    /// Number of steps in which an invisible corner moves to the centre.
    const STEPS: u32 = 50;
    let corners = covered_area(id);
    let mean = |axis: usize| corners.iter().map(|corner| corner[axis]).sum::<f64>() / corners.len() as f64;
    let middle = WorldPoint { x: mean(0), y: mean(1), z: 0.0 };
    let shown = |&[x, y]: &[f64; 2]| {
        let inward = Edge { from: WorldPoint { x, y, z: 0.0 }, to: middle };
        let on_way = (0..=STEPS).filter_map(|i| hand.pixel(inward.at(f64::from(i) / f64::from(STEPS))));
        on_way
            .map(|Pixel { u, v }| Pixel { u: u.round(), v: v.round() })
            .find(|&p| is_shown(&hand.camera, hand.size, p, MARGIN))
    };
    corners.iter().filter_map(shown).collect()
}

/// Returns a placement with the errors of an operator who drags a polygon over a plan.
fn placement_entry(hand: &mut Operator) -> PlacementEntry {
    /// Standard deviation of each coordinate of the translation, in metres.
    const MOVE_SIGMA_M: f64 = 0.035;
    /// Standard deviation of the rotation, in degrees.
    const TURN_SIGMA_DEG: f64 = 0.2;
    /// Standard deviation of the scale.
    const SCALE_SIGMA: f64 = 0.003;
    let truth = Placement::from_camera(&hand.camera);
    let mut off = |sigma: f64, digits: f64, value: f64| {
        // An operator would notice an error of more than two standard deviations.
        let error = sigma * normal(&mut hand.random).clamp(-2.0, 2.0);
        ((value + error) * digits).round() / digits
    };
    PlacementEntry {
        move_m: FloorPoint { x: off(MOVE_SIGMA_M, 1e3, truth.by.x), y: off(MOVE_SIGMA_M, 1e3, truth.by.y) },
        turn_deg: off(TURN_SIGMA_DEG, 1e2, truth.turn.to_degrees()),
        scale: Some(off(SCALE_SIGMA, 1e4, hand.camera.position.z / STAGE_1_HEIGHT)),
        fixed: false,
        held: calib_site::FixedEntry::default(),
        estimated: false,
    }
}

/// Returns a distance across the shop, measured with a tape between the two most distant links.
fn measured_distance(links: &[calib_site::Link]) -> Option<Distance> {
    /// Standard deviation of the tape measurement, in metres.
    const TAPE_SIGMA_M: f64 = 0.01;
    let points = shop_landmarks();
    let known: Vec<&(String, WorldPoint)> =
        points.iter().filter(|(name, _)| links.iter().any(|link| link.id.as_ref() == Some(name))).collect();
    let pairs = known.iter().enumerate().flat_map(|(i, a)| known[..i].iter().map(move |b| (*a, *b)));
    let (a, b) = pairs.max_by(|p, q| p.0.1.distance(p.1.1).total_cmp(&q.0.1.distance(q.1.1)))?;
    let length = (a.1.distance(b.1) * 1e2).round() / 1e2;
    Some(Distance {
        id: None,
        name: Some("Tape".into()),
        off: false,
        keep: false,
        between: [a.0.clone(), b.0.clone()],
        length_m: Known::prior(length, TAPE_SIGMA_M),
    })
}
