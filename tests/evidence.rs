//! Lines that determine only lengths on the floor, a length in feet entered as metres, and a site in feet.

use calib_core::{Camera, Lens, Pixel, WorldPoint};
use calib_tests::Scratch;
use serde_json::{Value, json};

/// Returns a camera at a height of 4 m, with this pitch in radians.
fn camera(pitch: f64) -> Camera {
    Camera {
        position: WorldPoint { x: 0.0, y: 0.0, z: 4.0 },
        yaw: 0.0,
        pitch,
        roll: 0.01,
        focal: 1000.0,
        lens: Lens::pinhole(Pixel::new(640.0, 360.0)),
        covariance: calib_core::Covariance::EXACT,
    }
}

/// Returns the pixels of world points, with a fixed small disturbance.
fn pixels(camera: &Camera, points: &[[f64; 3]]) -> Value {
    let pixel = |(index, &[x, y, z]): (usize, &[f64; 3])| {
        let pixel = camera.world_to_pixel(WorldPoint { x, y, z }).unwrap();
        let noise = 0.3 * ((index * 7 % 5) as f64 - 2.0);
        json!([pixel.u + noise, pixel.v - noise])
    };
    points.iter().enumerate().map(pixel).collect()
}

fn site(annotations: Value) -> String {
    json!({"format": "calib-site", "version": 1, "cameras": [
        {"id": "a", "size_px": [1280, 720], "annotations": annotations}
    ]})
    .to_string()
}

#[test]
fn a_camera_that_looks_down_passes_for_the_floor() {
    let down = camera(std::f64::consts::FRAC_PI_2);
    let (x, y) = ([-1.8, -0.6, 0.6, 1.8], [-1.1, 0.0, 1.1]);
    let along: Vec<Value> = y.map(|y| pixels(&down, &[[-2.0, y, 0.0], [2.0, y, 0.0]])).to_vec();
    let across: Vec<Value> = x.map(|x| pixels(&down, &[[x, -1.2, 0.0], [x, 1.2, 0.0]])).to_vec();
    let lengths: Vec<Value> = x.map(|x| pixels(&down, &[[x, -1.0, 0.0], [x, 1.0, 0.0]])).to_vec();
    let scratch = Scratch::new();
    scratch.write(
        "site.json",
        site(json!([
            {"kind": "parallel", "id": "along", "segments": along},
            {"kind": "parallel", "segments": across, "at_right_angles_to": "along"},
            {"kind": "known_length", "length_m": 2.0, "segments": lengths}
        ])),
    );
    scratch.calib(&["solve", "site.json", "-o", "solved.json"]).expect_code(0);
    let solution = scratch.read_json("solved.json")["cameras"][0]["solution"].clone();
    assert_eq!(solution["heights_known"], json!(false), "{}", solution["warnings"]);
    assert!(solution["sigma"]["floor_length_rel"].as_f64().unwrap() < 0.02);
    let passed = scratch.calib(&["check", "solved.json"]).expect_code(0);
    assert!(passed.stdout.contains("heights unknown"), "{}", passed.stdout);
    let failed = scratch.calib(&["check", "solved.json", "--heights"]).expect_code(4);
    assert!(failed.stdout.contains("focal-unobservable"), "{}", failed.stdout);
}

#[test]
fn a_length_in_feet_is_recognised_by_its_ratio() {
    let view = camera(0.5);
    let upright = |x: f64, y: f64| {
        let ends = pixels(&view, &[[x, y, 0.0], [x, y, 1.75]]);
        json!({"kind": "upright", "foot": ends[0], "head": ends[1], "height_m": {"value": 1.75, "sigma": 0.02}})
    };
    let line = |a: [f64; 3], b: [f64; 3]| pixels(&view, &[a, b]);
    let mut annotations = vec![
        json!({"kind": "vertical", "segments": [
            line([-2.5, 8.0, 0.0], [-2.5, 8.0, 2.5]),
            line([2.5, 8.0, 0.0], [2.5, 8.0, 2.5]),
            line([0.2, 9.0, 0.0], [0.2, 9.0, 2.5])
        ]}),
        json!({"kind": "parallel", "id": "along", "segments": [
            line([-1.5, 4.5, 0.0], [-1.5, 11.0, 0.0]),
            line([1.5, 4.5, 0.0], [1.5, 11.0, 0.0])
        ]}),
        json!({"kind": "parallel", "at_right_angles_to": "along", "segments": [
            line([-1.5, 5.0, 0.0], [1.5, 5.0, 0.0]),
            line([-2.0, 8.0, 0.0], [2.0, 8.0, 0.0])
        ]}),
    ];
    annotations.extend([upright(-1.0, 6.0), upright(1.0, 7.0), upright(0.0, 9.0)]);
    let floor = line([-1.0, 6.0, 0.0], [1.0, 6.0, 0.0]);
    let message = |length_m: f64| {
        let mut annotations = annotations.clone();
        annotations.push(json!({"kind": "known_length", "length_m": length_m, "segments": [floor]}));
        let scratch = Scratch::new();
        scratch.write("site.json", site(annotations.into()));
        let _ = scratch.calib(&["solve", "site.json", "-o", "solved.json"]);
        let solution = scratch.read_json("solved.json")["cameras"][0]["solution"].clone();
        solution["warnings"]
            .as_array()
            .map(|warnings| warnings.iter().map(|one| one["message"].to_string()).collect::<String>())
            .unwrap_or_default()
    };
    assert_eq!(message(2.0), "");
    let feet = message(2.0 / 0.3048);
    assert!(feet.contains("6.56 m as entered") && feet.contains("The ratio is 3.28"), "{feet}");
    let other = message(5.0);
    assert!(other.contains("5.00 m as entered") && !other.contains("3.28"), "{other}");
}

#[test]
fn a_site_in_feet_shows_feet_and_stores_metres() {
    let view = camera(0.5);
    let line = |a: [f64; 3], b: [f64; 3]| pixels(&view, &[a, b]);
    let along = [-1.5, 0.0, 1.5].map(|x| line([x, 4.5, 0.0], [x, 11.0, 0.0])).to_vec();
    let across = [6.0, 9.0].map(|y| line([-2.0, y, 0.0], [2.0, y, 0.0])).to_vec();
    let verticals =
        [[-2.5, 8.0], [2.5, 8.0], [0.2, 9.0]].map(|[x, y]| line([x, y, 0.0], [x, y, 2.5])).to_vec();
    let scratch = Scratch::new();
    let text = site(json!([
        {"kind": "vertical", "segments": verticals},
        {"kind": "parallel", "id": "along", "segments": along},
        {"kind": "parallel", "segments": across, "at_right_angles_to": "along"},
        {"kind": "known_length", "length_m": 6.5, "segments": [line([0.5, 4.5, 0.0], [0.5, 11.0, 0.0])]}
    ]));
    let mut in_feet: Value = serde_json::from_str(&text).unwrap();
    in_feet["units"] = json!("feet");
    scratch.write("metres.json", &text);
    scratch.write("feet.json", in_feet.to_string());
    let shown = |file: &str| scratch.calib(&["solve", file]).expect_code(0).stdout;
    let [metres, feet] = [shown("metres.json"), shown("feet.json")];
    assert!(metres.contains("height m") && feet.contains("height ft"), "{metres}{feet}");
    assert!(metres.contains(" 4.0") && feet.contains(" 13.1"), "4 m are 13.1 ft: {metres}{feet}");
    let json = |file: &str| scratch.calib(&["solve", file, "--format", "json"]).expect_code(0).stdout;
    assert_eq!(json("metres.json"), json("feet.json"), "files are in metres");
    in_feet["units"] = json!("yards");
    scratch.write("yards.json", in_feet.to_string());
    let refused = scratch.calib(&["solve", "yards.json"]).expect_code(3);
    assert!(refused.stderr.contains("/units"), "{}", refused.stderr);
}
