//! Cameras registered to each other by the colours of their images, on the demonstration.

use calib_core::{Camera, WorldPoint};
use calib_image::{PairDecision, SiteColours, SiteRegistration, View, join, register_pair};
use image::RgbImage;
use nalgebra::{Complex, ComplexField as _};

/// Returns true cameras of the demonstration with their images.
fn demonstration(names: &[&str]) -> Vec<(Camera, RgbImage)> {
    let demo = calib_demo::demo_site();
    let camera = |name: &&str| {
        let index = demo.site.cameras.iter().position(|camera| camera.id == **name).unwrap();
        let (truth, size) = (demo.truth[index].1, demo.site.cameras[index].size_px);
        (truth, calib_demo::render(&truth, size))
    };
    names.iter().map(camera).collect()
}

/// Returns a camera as an automatic calibration would estimate it: with errors of the focal length, the angles and
/// the height, without position and yaw.
fn estimated(truth: &Camera, sign: f64) -> Camera {
    let focal = truth.focal * (1.0 + 0.02 * sign);
    let lens = calib_core::Lens { focal: truth.lens.focal * focal / truth.focal, ..truth.lens };
    Camera {
        position: WorldPoint::new(0.0, 0.0, truth.position.z * (1.0 - 0.06 * sign)),
        yaw: 0.0,
        pitch: truth.pitch + 0.005 * sign,
        roll: truth.roll - 0.004 * sign,
        focal,
        lens,
        ..*truth
    }
}

fn register(cameras: &[Camera], images: &[RgbImage]) -> SiteRegistration {
    let views: Vec<View> = cameras
        .iter()
        .zip(images)
        .map(|(camera, image)| View {
            camera,
            size_px: image.dimensions().into(),
            image,
            is_height_known: false,
        })
        .collect();
    let colours = SiteColours::new(&views);
    let pairs: Vec<_> = colours.pairs().into_iter().map(|pair| register_pair(&colours, pair)).collect();
    join(&colours, &pairs, &mut |_| true).unwrap()
}

/// Returns the position errors (metres) and the yaw errors (radians) of the placed cameras, after the best rotation,
/// scale and shift of the floor.
fn errors(truth: &[Camera], placed: &[Camera]) -> Vec<[f64; 2]> {
    let at = |camera: &Camera| Complex::new(camera.position.x, camera.position.y);
    let count = truth.len() as f64;
    let mean = |all: &[Camera]| all.iter().map(at).sum::<Complex<f64>>() / count;
    let (middle, to) = (mean(placed), mean(truth));
    let product: Complex<f64> =
        truth.iter().zip(placed).map(|(a, b)| (at(a) - to) * (at(b) - middle).conj()).sum();
    let square: f64 = placed.iter().map(|camera| (at(camera) - middle).norm_sqr()).sum();
    let similarity = product / square;
    let wrapped = |angle: f64| angle.sin().atan2(angle.cos());
    truth
        .iter()
        .zip(placed)
        .map(|(truth, placed)| {
            let moved = to + similarity * (at(placed) - middle);
            [(moved - at(truth)).modulus(), wrapped(placed.yaw + similarity.argument() - truth.yaw).abs()]
        })
        .collect()
}

#[test]
fn cameras_of_one_room_are_placed_and_another_building_is_not() {
    let all = demonstration(&["shop-1", "shop-2", "shop-3", "barn"]);
    let (truth, images): (Vec<Camera>, Vec<RgbImage>) = all.into_iter().unzip();
    let signs = [1.0, -1.0, 1.0, -1.0];
    let cameras: Vec<Camera> =
        truth.iter().zip(signs).map(|(camera, sign)| estimated(camera, sign)).collect();
    let found = register(&cameras, &images);
    for pair in &found.pairs {
        println!("{:?}: {:?}, score {:.0}, ratio {:.2}", pair.views, pair.decision, pair.score, pair.ratio);
        let is_shop = !pair.views.contains(&3);
        assert_eq!(pair.decision == PairDecision::Found, is_shop, "{:?}", pair.views);
    }
    assert_eq!(found.groups, [vec![0, 1, 2]]);
    assert!(found.cameras[3].is_none() && found.agreement.iter().all(|pair| pair.agrees));
    let placed: Vec<Camera> = found.cameras[..3].iter().map(|camera| camera.unwrap()).collect();
    for [distance, turn] in errors(&truth[..3], &placed) {
        println!("{distance:.2} m, {:.2} degrees", turn.to_degrees());
        assert!(distance < 0.6 && turn.to_degrees() < 2.0, "{distance} m, {turn}");
    }
}

#[test]
fn images_that_show_nothing_are_not_placed() {
    let (camera, image) = demonstration(&["shop-1"]).remove(0);
    let black = RgbImage::new(image.width(), image.height());
    let found = register(&[camera; 3], &[image, black, RgbImage::new(10, 10)]);
    assert!(found.groups.is_empty() && found.cameras.iter().all(Option::is_none));
    assert!(found.pairs.iter().all(|pair| pair.decision == PairDecision::NotShown));
}
