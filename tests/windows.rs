//! Views from a fisheye image: images that a tracker can use like pinhole images.

use calib_core::{Camera, Pixel, WorldPoint};

use calib_site::{Options, Site};
use calib_tests::Scratch;
use serde_json::Value;

/// Returns the demonstration's solved fisheye with a grey image.
fn ceiling() -> (Scratch, Camera) {
    let demo = calib_demo::demo_site();
    let mut site = Site { cameras: vec![demo.site.cameras.last().unwrap().clone()], ..Site::new() };
    site.cameras[0].image = Some("ceiling.png".into());
    let site = site.calibrate(&Options::default()).write_into(&site);
    let camera = site.cameras[0].camera().unwrap();
    let scratch = Scratch::new();
    let [width, height] = site.cameras[0].size_px;
    image::RgbImage::from_pixel(width, height, image::Rgb([90; 3]))
        .save(scratch.path("ceiling.png"))
        .unwrap();
    scratch.write("solved.json", site.to_json());
    (scratch, camera)
}

const UNDISTORT: [&str; 4] = ["undistort", "solved.json", "--camera", "checkouts"];

fn numbers(of: &Value) -> Vec<f64> {
    of.as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect()
}

/// Projects a point with a 3 x 4 matrix, if it is in front of the camera.
fn shown(matrix: &[f64], point: WorldPoint) -> Option<Pixel> {
    let at = [point.x, point.y, point.z, 1.0];
    let [u, v, w] = [0, 1, 2].map(|row| (0..4).map(|i| matrix[4 * row + i] * at[i]).sum::<f64>());
    (w > 0.0).then(|| Pixel::new(u / w, v / w))
}

/// Returns the raw pixel at a pixel of the remap table.
fn mapped(npy: &[u8], width: usize, pixel: Pixel) -> Option<Pixel> {
    let start = 10 + usize::from(u16::from_le_bytes([npy[8], npy[9]]));
    let at = start + 8 * (pixel.v as usize * width + pixel.u as usize);
    let value = |k: usize| f64::from(f32::from_le_bytes(npy[at + 4 * k..at + 4 * k + 4].try_into().unwrap()));
    (value(0) >= 0.0).then(|| Pixel::new(value(0) + 0.5, value(1) + 0.5))
}

#[test]
fn view_parameters_match_its_pixels() {
    let (scratch, camera) = ceiling();
    let args = ["--quadrants", "--look=50,20,80", "--size", "640x400", "--remap", "-o", "w.png"];
    scratch.calib(&[&UNDISTORT[..], &args[..]].concat()).expect_code(0);
    let mut checked = 0;
    for name in ["w-look-1", "w-quadrant-1", "w-quadrant-2", "w-quadrant-3", "w-quadrant-4"] {
        let picture = image::open(scratch.path(&format!("{name}.png"))).unwrap();
        assert_eq!((picture.width(), picture.height()), (640, 400));
        let json = scratch.read_json(&format!("{name}.json"));
        assert_eq!((json["kind"].as_str(), json["camera_id"].as_str()), (Some("pinhole"), Some("checkouts")));
        let p = numbers(&json["undistorted_px_from_world"]);
        let h = numbers(&json["floor_from_undistorted_px"]);
        let npy = std::fs::read(scratch.path(&format!("{name}.remap.npy"))).unwrap();
        for i in 0..400 {
            let (x, y) = (
                camera.position.x - 8.0 + 0.8 * f64::from(i % 20),
                camera.position.y - 8.0 + 0.8 * f64::from(i / 20),
            );
            let point = WorldPoint { x, y, z: 0.0 };
            let Some(pixel) = shown(&p, point) else { continue };
            if !(1.0..639.0).contains(&pixel.u) || !(1.0..399.0).contains(&pixel.v) {
                continue;
            }
            let raw = camera.world_to_pixel(point).unwrap();
            let near = mapped(&npy, 640, pixel).unwrap();
            assert!(
                near.distance(raw) < 1.5,
                "{name}: {near:?} {raw:?}: less than a pixel of the window off"
            );
            let back = [0, 1, 2].map(|row| h[3 * row] * pixel.u + h[3 * row + 1] * pixel.v + h[3 * row + 2]);
            assert!((back[0] / back[2] - x).hypot(back[1] / back[2] - y) < 1e-6, "{name}: {back:?}");
            checked += 1;
        }
    }
    assert!(checked > 200, "{checked}");
}

#[test]
fn panorama_is_one_image_with_its_parameters() {
    let (scratch, _) = ceiling();
    scratch.calib(&[&UNDISTORT[..], &["--panorama", "-o", "round.jpg"]].concat()).expect_code(0);
    let picture = image::open(scratch.path("round.jpg")).unwrap().into_rgb8();
    assert_eq!(picture.dimensions(), (2400, 800));
    assert!(
        (0..2400).step_by(50).all(|u| picture.get_pixel(u, 700).0[0] > 60),
        "the panorama has no blank columns"
    );
    assert_eq!(scratch.read_json("round.json")["kind"], "cylinder");
}

#[test]
fn impossible_views_are_refused_before_writing() {
    let (scratch, _) = ceiling();
    let run = |args: &[&str]| scratch.calib(&[&UNDISTORT[..], args].concat());
    let nothing = run(&["--look=30,0,60", "--look=0,170,40", "-o", "a.png"]).expect_code(2);
    assert!(nothing.stderr.contains("a requested view is outside the image"), "{}", nothing.stderr);
    assert!(!scratch.path("a-look-1.png").exists(), "no view is written if one is impossible");
    for wrong in ["--look=1,2", "--look=0,0,180", "--look=a,b,c", "--look=nan,0,90"] {
        run(&[wrong, "-o", "a.png"]).expect_code(2);
    }
    run(&["--size", "64x64", "-o", "a.png"]).expect_code(2);
    run(&["--look=0,0,90", "--crop", "all-valid", "-o", "a.png"]).expect_code(2);
    let round = run(&["--crop", "all-valid", "-o", "a.png"]).expect_code(2);
    assert!(
        round.stderr.contains("a flat image cannot show") && round.stderr.contains("--look"),
        "{}",
        round.stderr
    );
    run(&["--quadrants", "-o", "-"]).expect_code(2);
    scratch.write("b.json", "mine");
    run(&["--look=30,0,60", "-o", "b.png"]).expect_code(1);
    assert!(!scratch.path("b.png").exists(), "a parameter file would be overwritten");
    run(&["--look=30,0,60", "-o", "b.png", "--force"]).expect_code(0);
}
