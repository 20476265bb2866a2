//! Control points in latitude and longitude: solved sites, the georeference that follows, and refusals.

#![allow(clippy::unwrap_used, reason = "a test that fails may panic")]

use calib_core::WorldPoint;
use calib_core::floor::{Geographic, TangentPlane};
use calib_demo::random::normal;
use calib_site::{Options, Site};
use calib_tests::{Scratch, above};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

const SIZE: [u32; 2] = [1920, 1080];

fn origin() -> Geographic {
    Geographic { latitude: 48.137_154_f64.to_radians(), longitude: 11.576_124_f64.to_radians(), height: 0.0 }
}

/// Creates a site of one camera whose control points have geographic coordinates with this error, in metres.
/// World +x is east. With `both`, the points have exact world coordinates, too, which are rotated by 30 degrees.
fn site(random: &mut ChaCha8Rng, sigma: f64, both: bool) -> Value {
    let camera = above(8.0);
    let plane = TangentPlane::new(origin(), 90_f64.to_radians());
    let mut points = Vec::new();
    while points.len() < 8 {
        let at = WorldPoint {
            x: 8.0 + random.random_range(-9.0..9.0),
            y: random.random_range(2.0..30.0),
            z: random.random_range(0.0..2.0),
        };
        let Some(px) = camera.world_to_pixel(at).filter(|px| {
            (0.0..f64::from(SIZE[0])).contains(&px.u) && (0.0..f64::from(SIZE[1])).contains(&px.v)
        }) else {
            continue;
        };
        let noisy = WorldPoint { x: at.x + sigma * normal(random), y: at.y + sigma * normal(random), z: 0.0 };
        let Geographic { latitude, longitude, .. } = plane.to_geographic(noisy);
        let mut point = json!({"id": format!("p{}", points.len()), "sigma_m": sigma.max(0.01),
            "px": [px.u + 0.5 * normal(random), px.v + 0.5 * normal(random)],
            "lat_deg": latitude.to_degrees(), "lon_deg": longitude.to_degrees()});
        if both {
            let (sin, cos) = 30_f64.to_radians().sin_cos();
            point["world_m"] = json!([cos * at.x + sin * at.y, cos * at.y - sin * at.x, at.z]);
        } else {
            point["height_m"] = json!(at.z);
        }
        points.push(point);
    }
    json!({"format": "calib-site", "version": 1,
        "cameras": [{"id": "a", "size_px": SIZE, "control_points": points}]})
}

/// Returns the position of the only camera, in degrees of latitude and longitude, and its height.
fn camera_position(site: &Site) -> Geographic {
    let solved = site.calibrate(&Options::default()).write_into(site);
    let position = solved.cameras[0].solution.as_ref().unwrap().position_m.unwrap();
    solved.tangent_plane().unwrap().to_geographic(position)
}

#[test]
fn geographic_points_alone_solve_a_camera_on_the_map() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let document = site(&mut random, 0.0, false);
    let site = Site::from_json(&document.to_string()).unwrap();
    let found = camera_position(&site);
    let truth = TangentPlane::new(origin(), 90_f64.to_radians());
    let at = truth.to_world(found);
    let expected = above(8.0).position;
    assert!((at.x - expected.x).hypot(at.y - expected.y) < 0.2, "{at:?}, expected {expected:?}");
    let solved = site.calibrate(&Options::default()).write_into(&site);
    let georeference = solved.solution.unwrap().georeference.unwrap();
    let first = &document["cameras"][0]["control_points"][0];
    assert!((georeference.lat_deg - first["lat_deg"].as_f64().unwrap()).abs() < 1e-12);
    assert_eq!((georeference.x_axis_azimuth_deg, georeference.sigma.east_m), (90.0, 0.0));
}

#[test]
fn switching_a_point_off_keeps_the_coordinate_system() {
    let mut random = ChaCha8Rng::seed_from_u64(8);
    for both in [false, true] {
        let mut document = site(&mut random, 0.1, both);
        let before = Site::from_json(&document.to_string()).unwrap().georeference().unwrap();
        let count = document["cameras"][0]["control_points"].as_array().unwrap().len();
        for index in 0..count {
            document["cameras"][0]["control_points"][index]["off"] = json!(true);
            let site = Site::from_json(&document.to_string()).unwrap();
            let after = site.georeference().unwrap();
            let tolerance = if both { 1e-4 } else { 0.0 };
            assert!((after.lat_deg - before.lat_deg).abs() <= tolerance, "{index}: {after:?}");
        }
    }
}

#[test]
fn points_with_both_coordinates_determine_the_georeference() {
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let (mut outside, mut squares) = (0, [0.0; 3]);
    const TRIALS: u32 = 20;
    for _ in 0..TRIALS {
        let site = Site::from_json(&site(&mut random, 0.5, true).to_string()).unwrap();
        let solved = site.calibrate(&Options::default()).write_into(&site);
        let found = solved.solution.unwrap().georeference.unwrap();
        // World +x points 30 degrees to the left of east.
        let azimuth = found.x_axis_azimuth_deg - 60.0;
        let plane = TangentPlane::new(origin(), 90_f64.to_radians());
        let at = plane.to_world(Geographic {
            latitude: found.lat_deg.to_radians(),
            longitude: found.lon_deg.to_radians(),
            height: 0.0,
        });
        let errors =
            [at.x / found.sigma.east_m, at.y / found.sigma.north_m, azimuth / found.sigma.azimuth_deg];
        outside += errors.iter().filter(|error| error.abs() > 1.96).count();
        squares.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error * error / f64::from(TRIALS));
    }
    assert!(squares.iter().all(|square| (0.3..2.0).contains(square)), "{squares:?}");
    assert!(outside <= 8, "{outside} of {} outside the 95 % interval", 3 * TRIALS);
}

#[test]
fn stated_errors_of_positions_hold() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut squares = [0.0; 2];
    const TRIALS: u32 = 60;
    for _ in 0..TRIALS {
        let site = Site::from_json(&site(&mut random, 0.1, false).to_string()).unwrap();
        let solved = site.calibrate(&Options::default()).write_into(&site);
        let solution = solved.cameras[0].solution.clone().unwrap();
        let sigma = solution.sigma.unwrap();
        let at = TangentPlane::new(origin(), 90_f64.to_radians()).to_world(camera_position(&site));
        let expected = above(8.0).position;
        let errors = [(at.x - expected.x) / sigma.x_m.unwrap(), (at.y - expected.y) / sigma.y_m.unwrap()];
        squares.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error * error / f64::from(TRIALS));
    }
    assert!(squares.iter().all(|square| (0.5..1.6).contains(square)), "{squares:?}");
}

#[test]
fn wrong_coordinates_are_named() {
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let right = site(&mut random, 0.5, false);
    let scratch = Scratch::new();
    let refused = |change: &dyn Fn(&mut Value)| {
        let mut document = right.clone();
        change(&mut document["cameras"][0]["control_points"][3]);
        scratch.write("site.json", document.to_string());
        scratch.calib(&["solve", "site.json"]).expect_code(3).stderr
    };
    let message = refused(&|point| {
        (point["lat_deg"], point["lon_deg"]) = (point["lon_deg"].clone(), point["lat_deg"].clone());
    });
    assert!(message.contains("control_points/3") && message.contains("exchanged"), "{message}");
    let message = refused(&|point| point["lon_deg"] = json!(-point["lon_deg"].as_f64().unwrap()));
    assert!(message.contains("longitude") && message.contains("sign"), "{message}");
    let message = refused(&|point| {
        point.as_object_mut().unwrap().remove("sigma_m");
    });
    assert!(message.contains("sigma_m") && message.contains("RTK"), "{message}");
    let message = refused(&|point| {
        point.as_object_mut().unwrap().remove("lon_deg");
    });
    assert!(message.contains("both of them"), "{message}");
    let message = refused(&|point| {
        point.as_object_mut().unwrap().remove("height_m");
        point["alt_m"] = json!(519.0);
    });
    assert!(message.contains("altitude of the floor"), "{message}");
    // One point with world coordinates does not determine how the others lie.
    let message = refused(&|point| point["world_m"] = json!([1.0, 2.0, 0.0]));
    assert!(message.contains("height_m") || message.contains("georeference"), "{message}");
}

#[test]
fn the_command_line_maps_to_latitude_and_longitude() {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let document = site(&mut random, 0.0, false);
    let scratch = Scratch::new();
    scratch.write("site.json", document.to_string());
    scratch.calib(&["solve", "site.json", "-o", "solved.json"]).expect_code(0);
    scratch.write("pixels.csv", "u,v\n960,900\n");
    let run = scratch.calib(&[
        "project",
        "solved.json",
        "--camera",
        "a",
        "--to",
        "floor",
        "--geographic",
        "-i",
        "pixels.csv",
    ]);
    let out = run.expect_code(0).stdout;
    let row: Vec<&str> = out.lines().nth(1).unwrap().split(',').collect();
    let head: Vec<&str> = out.lines().next().unwrap().split(',').collect();
    let value = |name: &str| row[head.iter().position(|h| *h == name).unwrap()].parse::<f64>().unwrap();
    let at = Geographic {
        latitude: value("lat_deg").to_radians(),
        longitude: value("lon_deg").to_radians(),
        height: 0.0,
    };
    let found = TangentPlane::new(origin(), 90_f64.to_radians()).to_world(at);
    let expected = above(8.0).pixel_to_floor(calib_core::Pixel::new(960.0, 900.0), 0.0).unwrap();
    assert!((found.x - expected.x).hypot(found.y - expected.y) < 0.2, "{found:?}, expected {expected:?}");
}
