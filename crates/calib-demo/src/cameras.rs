//! The cameras as they truly are: what calibration should find.

use calib_core::{BrownConrady, Camera, Covariance, Distortion, ImageCircle, Lens, Pixel, WorldPoint};

use calib_core::camera::Turn;

/// Id, camera and image size in pixels of every camera.
pub(crate) fn cameras() -> Vec<(&'static str, Camera, [u32; 2])> {
    const HD: [u32; 2] = [1920, 1080];
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

/// How far from its axis the fisheye sees, in degrees: 185 across its image circle.
const HALF_FIELD: f64 = 92.5;

/// A fisheye under the ceiling, with yaw, pitch and roll in degrees; its image circle has a little room to the border.
fn ceiling(at: [f64; 3], degrees: [f64; 3], size: [u32; 2]) -> Camera {
    let mut camera = camera(at, degrees, 454.0, None, size);
    let distortion = Distortion::KannalaBrandt { k: [-0.02, 0.001, 0.0, 0.0] };
    camera.lens = Lens { focal: camera.focal, distortion, ..camera.lens };
    let (sin, cos) = HALF_FIELD.to_radians().sin_cos();
    let Pixel { u, v } = camera.lens.principal_point;
    let rim = camera.lens.shown([camera.focal * sin, 0.0, cos]);
    camera.lens.image_circle = rim.map(|rim| ImageCircle { u, v, radius: rim.u - u });
    camera
}

/// Whether a camera with this id looks into the shop.
pub(crate) fn is_in_shop(id: &str) -> bool {
    id.starts_with("shop") || id == "checkouts"
}

/// Id and turn of the cameras that are not a month later what they were: one was bumped, one zoomed.
#[must_use]
pub fn moved() -> [(&'static str, Turn); 2] {
    /// In degrees.
    const BUMP: f64 = 1.3;
    let bump = [0.6, 0.7483, -0.2828].map(|part| part * BUMP.to_radians());
    [("shop-1", Turn { vector: bump, zoom: 0.0 }), ("store", Turn { vector: [0.0; 3], zoom: 1.03_f64.ln() })]
}

/// A camera at a place, with yaw, pitch and roll in degrees; `lens` refers to its focal.
fn camera(at: [f64; 3], degrees: [f64; 3], focal: f64, lens: Option<BrownConrady>, size: [u32; 2]) -> Camera {
    let [yaw, pitch, roll] = degrees.map(f64::to_radians);
    let principal_point = Pixel::new(f64::from(size[0]) / 2.0, f64::from(size[1]) / 2.0);
    let lens = lens.map_or(Lens::pinhole(principal_point), |brown| Lens {
        principal_point,
        focal,
        distortion: Distortion::BrownConrady(brown),
        image_circle: None,
    });
    Camera { position: WorldPoint::from(at), yaw, pitch, roll, focal, lens, covariance: Covariance::EXACT }
}

/// The same camera with an image `factor` times as large.
#[cfg(test)]
pub(crate) fn resized(camera: &Camera, factor: f64) -> Camera {
    let Pixel { u, v } = camera.lens.principal_point;
    let principal_point = Pixel::new(u * factor, v * factor);
    let circle = |circle: ImageCircle| <[f64; 3]>::from(circle).map(|side| factor * side).into();
    let image_circle = camera.lens.image_circle.map(circle);
    let lens = Lens { principal_point, focal: camera.lens.focal * factor, image_circle, ..camera.lens };
    Camera { focal: camera.focal * factor, lens, ..*camera }
}
