//! Tests of the registration with rendered scenes: coloured boxes on a grey floor.

use calib_core::{Camera, Covariance, FloorPoint, Lens, Pixel, WorldPoint};
use image::{Rgb, RgbImage};

use crate::registration::floor_scan::FloorScan;
use crate::registration::plan_obstacles::PlanObstacles;
use crate::registration::plan_search::{PlanPose, ScannedCamera, locate};
use crate::registration::relative_pose::wrapped;
use crate::registration::site_colours::small_image;
use crate::{PairDecision, PairRegistration, SiteColours, View, join, register, register_pair};

const SIZE: [u32; 2] = [480, 270];

/// Box on the floor: the corners with the smallest and the largest x and y, and the height, in metres; and the colour.
struct Block {
    low: [f64; 2],
    high: [f64; 2],
    height: f64,
    colour: [u8; 3],
}

/// Returns boxes at pseudo-random positions in a room of 14 by 14 metres.
fn scene(seed: u64) -> Vec<Block> {
    let mut state = seed;
    let mut uniform = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let block = |_| {
        let [x, y, w, h, height] = [(); 5].map(|()| uniform());
        let low = [14.0 * x - 7.0, 14.0 * y - 7.0];
        let high = [low[0] + 0.3 + 0.9 * w, low[1] + 0.3 + 0.9 * h];
        let colour = [(); 3].map(|()| (250.0 * uniform()) as u8);
        Block { low, high, height: 0.1 + 1.2 * height, colour }
    };
    (0..45).map(block).collect()
}

fn camera(position: [f64; 3], yaw: f64) -> Camera {
    let lens = Lens::pinhole(Pixel::new(240.0, 135.0));
    let [x, y, z] = position;
    let position = WorldPoint { x, y, z };
    Camera { position, yaw, pitch: 0.5, roll: 0.02, focal: 300.0, lens, covariance: Covariance::EXACT }
}

/// Returns two cameras at the sides of a room, which both look at its centre.
fn cameras() -> [Camera; 2] {
    [camera([0.5, -8.0, 4.0], 0.1), camera([-8.0, 1.0, 3.6], -1.5)]
}

/// Renders a scene by ray casting.
fn render(camera: &Camera, blocks: &[Block]) -> RgbImage {
    RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| {
        let ray = camera.pixel_to_ray(Pixel::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).unwrap();
        let from = <[f64; 3]>::from(ray.origin);
        let hit = |block: &Block| {
            let (mut near, mut far, mut side) = (0.0, f64::INFINITY, 0);
            let (low, high) =
                ([block.low[0], block.low[1], 0.0], [block.high[0], block.high[1], block.height]);
            for axis in 0..3 {
                let at = [low[axis], high[axis]].map(|c| (c - from[axis]) / ray.direction[axis]);
                if at[0].min(at[1]) > near {
                    (near, side) = (at[0].min(at[1]), axis);
                }
                far = f64::min(far, at[0].max(at[1]));
            }
            let shade = [0.8, 0.9, 1.0][side];
            (near < far).then(|| (near, block.colour.map(|level| (f64::from(level) * shade) as u8)))
        };
        let nearest = blocks.iter().filter_map(hit).min_by(|a, b| a.0.total_cmp(&b.0));
        let background = if ray.direction[2] < -0.02 { [150, 150, 145] } else { [200, 205, 210] };
        Rgb(nearest.map_or(background, |(_, colour)| colour))
    })
}

fn view<'a>((camera, image): (&'a Camera, &'a RgbImage)) -> View<'a> {
    View { camera, size_px: image.dimensions().into(), image, is_height_known: false }
}

fn views<'a>(cameras: &'a [Camera], images: &'a [RgbImage]) -> Vec<View<'a>> {
    cameras.iter().zip(images).map(view).collect()
}

fn pair(cameras: &[Camera], images: &[RgbImage]) -> (SiteColours, PairRegistration) {
    let site = SiteColours::new(&views(cameras, images));
    let pair = register_pair(&site, [0, 1]);
    (site, pair)
}

/// Returns the given cameras with other positions, yaws and wrong heights.
fn unplaced(cameras: &[Camera; 2]) -> [Camera; 2] {
    let [first, second] = *cameras;
    let moved = |camera: Camera, factor: f64| Camera {
        position: WorldPoint::new(50.0, 60.0, camera.position.z * factor),
        yaw: 1.2,
        ..camera
    };
    [moved(first, 1.04), moved(second, 0.97)]
}

#[test]
fn two_views_of_a_scene_are_registered() {
    let truth = cameras();
    let blocks = scene(7);
    let images = truth.map(|camera| render(&camera, &blocks));
    let given = unplaced(&truth);
    let (site, pair) = pair(&given, &images);
    assert_eq!(pair.decision, PairDecision::Found, "{pair:?}");
    let turn = pair.yaw - (truth[0].yaw - truth[1].yaw);
    assert!(turn.abs() < 0.04, "{turn}");

    let result = join(&site, &[pair], &mut |_| true).unwrap();
    assert_eq!(result.groups, [vec![0, 1]]);
    let [first, second] = [0, 1].map(|index| result.cameras[index].unwrap());
    assert_eq!((first.position.x, first.position.y, first.yaw), (0.0, 0.0, given[0].yaw));
    // Position of the second camera relative to the first, rotated so that the first has its true yaw.
    let turn = truth[0].yaw - given[0].yaw;
    let (sin, cos) = turn.sin_cos();
    let at = [
        cos * second.position.x - sin * second.position.y,
        sin * second.position.x + cos * second.position.y,
    ];
    let expected = [truth[1].position.x - truth[0].position.x, truth[1].position.y - truth[0].position.y];
    let error = (at[0] - expected[0]).hypot(at[1] - expected[1]);
    assert!(error < 0.05 * expected[0].hypot(expected[1]), "{at:?} {expected:?}");
    assert!((second.yaw + turn - truth[1].yaw).abs() < 0.04);
    let ratio = |cameras: [&Camera; 2]| cameras[0].position.z / cameras[1].position.z;
    assert!((ratio([&first, &second]) / ratio([&truth[0], &truth[1]]) - 1.0).abs() < 0.05);
    assert!(result.agreement.len() == 1 && result.agreement[0].agrees);
}

#[test]
fn smaller_images_give_the_same_pose() {
    let truth = cameras().map(|camera| Camera {
        focal: 2.0 * camera.focal,
        lens: Lens::pinhole(Pixel::new(480.0, 270.0)),
        ..camera
    });
    let images = cameras().map(|camera| render(&camera, &scene(7)));
    let whole = images.each_ref().map(|image| {
        image::imageops::resize(image, 2 * SIZE[0], 2 * SIZE[1], image::imageops::FilterType::Nearest)
    });
    let (_, expected) = pair(&truth, &whole);
    let mut small = views(&truth, &images);
    small.iter_mut().for_each(|view| view.size_px = SIZE.map(|side| 2 * side));
    let found = register_pair(&SiteColours::new(&small), [0, 1]);
    assert!((found.yaw - expected.yaw).abs() < 1e-6 && (found.score - expected.score).abs() < 1.0);
}

#[test]
fn three_views_of_a_scene_are_registered_together() {
    let [first, second] = cameras();
    let truth = [first, second, camera([7.8, 2.0, 3.8], 1.4)];
    let blocks = scene(7);
    let images = truth.map(|camera| render(&camera, &blocks));
    let result = register(&views(&truth, &images), &mut |_| true).unwrap();
    assert_eq!(result.groups, [vec![0, 1, 2]]);
    for index in [1, 2] {
        let (found, expected) = (result.cameras[index].unwrap(), truth[index]);
        let [x, y] = [expected.position.x - first.position.x, expected.position.y - first.position.y];
        let error = (found.position.x - x).hypot(found.position.y - y);
        assert!(error < 0.04 * x.hypot(y), "{found:?} {expected:?}");
        assert!((found.yaw - expected.yaw).abs() < 0.02, "{found:?} {expected:?}");
    }
}

#[test]
fn two_scenes_are_not_registered() {
    let truth = cameras();
    let images = [render(&truth[0], &scene(7)), render(&truth[1], &scene(99))];
    let (site, pair) = pair(&unplaced(&truth), &images);
    assert_ne!(pair.decision, PairDecision::Found, "{pair:?}");
    let result = join(&site, &[pair], &mut |_| true).unwrap();
    assert!(result.groups.is_empty() && result.cameras == [None, None]);
}

#[test]
fn the_same_images_have_the_same_result() {
    let truth = cameras();
    let images = truth.map(|camera| render(&camera, &scene(7)));
    let run = || {
        let (site, pair) = pair(&truth, &images);
        let cameras = join(&site, std::slice::from_ref(&pair), &mut |_| true).unwrap().cameras;
        (pair.score, pair.ratio, pair.baseline, cameras)
    };
    assert_eq!(run(), run());
}

#[test]
fn unusable_images_and_cameras_are_not_shown() {
    let truth = cameras();
    let picture = render(&truth[0], &scene(7));
    let black = RgbImage::new(SIZE[0], SIZE[1]);
    let grey = RgbImage::from_pixel(SIZE[0], SIZE[1], Rgb([90; 3]));
    let below = Camera { position: WorldPoint::new(0.0, 0.0, -3.0), ..truth[0] };
    let broken = Camera { focal: f64::NAN, pitch: f64::INFINITY, ..truth[0] };
    let upward = Camera { pitch: -1.2, ..truth[0] };
    let cameras = [truth[0], truth[1], truth[1], truth[0], truth[1], below, broken, upward];
    let images = [
        picture.clone(),
        RgbImage::new(0, 0),
        RgbImage::from_pixel(3, 2000, Rgb([200, 20, 20])),
        black.clone(),
        grey,
        picture.clone(),
        picture.clone(),
        picture,
    ];
    let site = SiteColours::new(&views(&cameras, &images));
    let wide = (0..cameras.len()).map(|index| register_pair(&site, [0, index]));
    let pairs: Vec<PairRegistration> = wide.collect();
    for pair in &pairs {
        assert_eq!(pair.decision, PairDecision::NotShown, "{pair:?}");
    }
    assert_eq!(register_pair(&site, [3, 99]).decision, PairDecision::NotShown);
    assert!(join(&site, &pairs, &mut |_| true).unwrap().groups.is_empty());
    let black = [black.clone(), black];
    let result = register(&views(&truth, &black), &mut |_| true).unwrap();
    assert!(result.groups.is_empty() && result.pairs[0].decision == PairDecision::NotShown);
    assert!(register(&[], &mut |_| true).unwrap().pairs.is_empty());
}

#[test]
fn registration_can_be_cancelled() {
    let truth = cameras();
    let images = truth.map(|camera| render(&camera, &scene(7)));
    let mut last = -1.0;
    let mut progress = |done: f64| {
        assert!(done >= last);
        last = done;
        done < 0.5
    };
    assert!(register(&views(&truth, &images), &mut progress).is_none());
}

/// Draws the plan of a scene: the footprints of its boxes, 20 by 20 m at 0.025 m per pixel, with the origin in the middle.
fn plan(blocks: &[Block]) -> PlanObstacles {
    let image = RgbImage::from_fn(800, 800, |x, y| {
        let at = [f64::from(x) + 0.5 - 400.0, 400.0 - f64::from(y) - 0.5].map(|pixels| 0.025 * pixels);
        let is_in = |block: &Block| (0..2).all(|i| (block.low[i]..block.high[i]).contains(&at[i]));
        Rgb([if blocks.iter().any(is_in) { 60 } else { 250 }; 3])
    });
    PlanObstacles::new(&image, 0.025).unwrap()
}

#[test]
fn cameras_of_rendered_scenes_are_found_on_the_plan_or_abstain() {
    let mut counts = [0; 3];
    for seed in 1..=6 {
        let blocks = scene(0x1234_5678_9abc_def1 * seed);
        let plan = plan(&blocks);
        for truth in cameras() {
            let image = render(&truth, &blocks);
            // The place is unknown, and the height is assumed to be 3.5 m.
            let given = Camera { position: WorldPoint::new(0.0, 0.0, 3.5), yaw: 0.0, ..truth };
            let (small, local) = small_image(&view((&given, &image))).unwrap();
            let scan = FloorScan::new(&view((&given, &image)), &local, &small);
            let camera = ScannedCamera { camera: &given, scan: &scan };
            let found = locate(&plan, &[camera], 0.15, &mut |_| true).unwrap();
            let PlanPose::Found(found) = found else {
                counts[2] += 1;
                continue;
            };
            // The plan has its origin at the upper left corner.
            let expected = FloorPoint::new(truth.position.x + 10.0, truth.position.y - 10.0);
            let turn = wrapped(found[0].yaw - truth.yaw).abs();
            let is_right = found[0].position.on_floor().distance(expected) < 0.5 && turn < 0.05;
            counts[usize::from(!is_right)] += 1;
        }
    }
    println!("right, wrong, not found: {counts:?}");
    assert!(counts[0] >= 6 && counts[1] == 0, "right, wrong, not found: {counts:?}");
}
