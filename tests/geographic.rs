//! Control points in latitude and longitude or in a grid: solved sites, the georeference that follows, maps as
//! plans, agreement with PROJ, and refusals.

use calib_core::floor::{Geographic, TangentPlane};
use calib_core::outcome::{Code, Finding};
use calib_core::{Camera, WorldPoint};
use calib_demo::random::normal;
use calib_site::{CoordinateSystem, Options, Site, SiteCamera};
use calib_tests::{Scratch, above, peers_python, root};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

const SIZE: [u32; 2] = [1920, 1080];

fn origin() -> Geographic {
    Geographic { latitude: 48.137_154_f64.to_radians(), longitude: 11.576_124_f64.to_radians(), height: 0.0 }
}

/// Creates a site of one camera whose control points have geographic coordinates with errors of `sigma` metres. World
/// +x is east. With `both`, the points have exact world coordinates, too, which are rotated by 30 degrees.
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

/// Returns the geographic position of the only camera.
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

/// Adds crosses whose map coordinates have errors of `sigma` metres, and their clicks in the camera.
fn add_marks(random: &mut ChaCha8Rng, document: &mut Value, sigma: f64) {
    let (camera, plane) = (above(8.0), TangentPlane::new(origin(), 90_f64.to_radians()));
    let mut marks = Vec::new();
    for (index, [x, y]) in [[4.0, 9.0], [12.0, 9.0], [3.0, 22.0], [13.0, 20.0]].into_iter().enumerate() {
        let mut error = || sigma * normal(random);
        let at = WorldPoint { x: x + error(), y: y + error(), z: 0.0 };
        let Geographic { latitude, longitude, .. } = plane.to_geographic(at);
        let seen = ["centre", "x", "y"].iter().zip([[0.0, 0.0], [0.6, 0.0], [0.0, 0.6]]);
        let seen = seen.map(|(point, [dx, dy])| {
            let px = camera.world_to_pixel(WorldPoint { x: x + dx, y: y + dy, z: 0.0 }).unwrap();
            json!({"camera": "a", "point": point, "px": [px.u, px.v]})
        });
        marks.push(json!({"id": format!("m{index}"), "kind": "cross", "size_m": [0.6], "sigma_m": sigma.max(0.01),
            "lat_deg": latitude.to_degrees(), "lon_deg": longitude.to_degrees(), "seen": seen.collect::<Vec<_>>()}));
    }
    document["marks"] = json!(marks);
}

#[test]
fn marks_with_map_coordinates_are_measurements() {
    let mut random = ChaCha8Rng::seed_from_u64(12);
    let x_sigma = |site: &Site| {
        let solved = site.calibrate(&Options::default()).write_into(site);
        let sigma = solved.cameras[0].solution.as_ref().unwrap().sigma.clone().unwrap();
        (solved, sigma.x_m.unwrap())
    };
    let mut document = site(&mut random, 0.5, false);
    let (_, without) = x_sigma(&Site::from_json(&document.to_string()).unwrap());
    add_marks(&mut random, &mut document, 0.02);
    let site = Site::from_json(&document.to_string()).unwrap();
    // The position of a mark in the site follows from its coordinates on the map.
    for mark in &site.marks {
        let at = site.tangent_plane().unwrap().to_geographic(mark.at_m);
        assert!((at.latitude.to_degrees() - mark.lat_deg.unwrap()).abs() < 1e-8, "{at:?}");
        assert!((at.longitude.to_degrees() - mark.lon_deg.unwrap()).abs() < 1e-8, "{at:?}");
    }
    // The marks are more accurate than the control points, so the position of the camera is better determined.
    let (solved, with) = x_sigma(&site);
    assert!(with < 0.5 * without, "{with} with marks, {without} without");
    let at = TangentPlane::new(origin(), 90_f64.to_radians()).to_world(
        solved
            .tangent_plane()
            .unwrap()
            .to_geographic(solved.cameras[0].solution.as_ref().unwrap().position_m.unwrap()),
    );
    let expected = above(8.0).position;
    assert!((at.x - expected.x).abs() < 4.0 * with, "{at:?} is not {expected:?} within {with}");
    // A mark is near its measured position, and a wrong one is rejected.
    let moved = |solved: &Site, index: usize| {
        let mark = &solved.marks[index];
        mark.solution.as_ref().unwrap().at_m.distance(mark.at_m)
    };
    assert!((0..4).all(|index| moved(&solved, index) < 0.1));
    document["marks"][1]["lon_deg"] = json!(document["marks"][1]["lon_deg"].as_f64().unwrap() + 4e-5);
    let (wrong, _) = x_sigma(&Site::from_json(&document.to_string()).unwrap());
    let residuals = &wrong.marks[1].solution.as_ref().unwrap().residuals;
    assert!(residuals.iter().any(|residual| residual.outlier), "{residuals:?}");
    // Marks alone define the coordinate system, too; a plan without a map position does not.
    document["cameras"][0]["control_points"] = json!([]);
    assert!(Site::from_json(&document.to_string()).unwrap().georeference().is_some());
    document["plan"] = json!({"metres_per_px": 0.05});
    let refused = Site::from_json(&document.to_string()).unwrap_err().to_string();
    assert!(refused.contains("marks") && refused.contains("georeference"), "{refused}");
    document["marks"][0]["sigma_m"] = json!(-5.0);
    let refused = Site::from_json(&document.to_string()).unwrap_err().to_string();
    assert!(refused.contains("sigma_m"), "{refused}");
    document["marks"] = json!([{"id": "m", "kind": "cross", "size_m": [0.6]}]);
    let refused = Site::from_json(&document.to_string()).unwrap_err().to_string();
    assert!(refused.contains("no position") && refused.contains("at_m"), "{refused}");
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
    assert!(message.contains("control_points/3") && message.contains("swapped"), "{message}");
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
    // One point with world coordinates does not determine the positions of the others.
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

/// Replaces latitude and longitude by coordinates of a grid.
fn in_grid(mut document: Value, crs: &str) -> Value {
    let system = CoordinateSystem::new(crs).unwrap();
    document["crs"] = json!(crs);
    for point in document["cameras"][0]["control_points"].as_array_mut().unwrap() {
        let degrees = |name: &str| point[name].as_f64().unwrap().to_radians();
        let at = Geographic { latitude: degrees("lat_deg"), longitude: degrees("lon_deg"), height: 0.0 };
        point["crs_m"] = json!(system.from_geographic(at).unwrap());
        let fields = point.as_object_mut().unwrap();
        fields.remove("lat_deg");
        fields.remove("lon_deg");
    }
    document
}

#[test]
fn grid_coordinates_solve_as_degrees_do() {
    let mut random = ChaCha8Rng::seed_from_u64(9);
    let document = site(&mut random, 0.1, false);
    let expected = camera_position(&Site::from_json(&document.to_string()).unwrap());
    for crs in ["EPSG:25832", "EPSG:31468", "EPSG:3857"] {
        let grid = in_grid(document.clone(), crs);
        let found = camera_position(&Site::from_json(&grid.to_string()).unwrap());
        let at = TangentPlane::new(expected, 0.0).to_world(found);
        assert!(at.x.hypot(at.y).hypot(at.z) < 1e-3, "{crs}: {at:?}");
    }
}

#[test]
fn wrong_grids_are_named() {
    let mut random = ChaCha8Rng::seed_from_u64(10);
    let right = in_grid(site(&mut random, 0.1, false), "EPSG:25832");
    let scratch = Scratch::new();
    let refused = |change: &dyn Fn(&mut Value)| {
        let mut document = right.clone();
        change(&mut document);
        scratch.write("site.json", document.to_string());
        scratch.calib(&["solve", "site.json"]).expect_code(3).stderr
    };
    let message = refused(&|site| {
        site.as_object_mut().unwrap().remove("crs");
    });
    assert!(message.contains("EPSG:25832"), "{message}");
    let message = refused(&|site| site["crs"] = json!("EPSG:4326"));
    assert!(message.contains("lat_deg"), "{message}");
    let message = refused(&|site| site["crs"] = json!("utm 32"));
    assert!(message.contains("EPSG"), "{message}");
    let message = refused(&|site| {
        let point = &mut site["cameras"][0]["control_points"][2]["crs_m"];
        *point = json!([point[1], point[0]]);
    });
    assert!(message.contains("control_points/2"), "{message}");
}

/// Creates a site with a located camera, and geographic points on the floor without world coordinates. World +x
/// points 30 degrees to the left of east.
fn located_site(random: &mut ChaCha8Rng, sigma: f64) -> Value {
    let mut document = site(random, 0.01, true);
    let plane = TangentPlane::new(origin(), 60_f64.to_radians());
    let camera = &mut document["cameras"][0];
    let points = camera["control_points"].as_array_mut().unwrap();
    for point in points.iter_mut() {
        let fields = point.as_object_mut().unwrap();
        for name in ["lat_deg", "lon_deg", "sigma_m"] {
            fields.remove(name);
        }
        fields.insert("sigma_m".into(), json!(0.05));
        for k in 0..3 {
            let exact = fields["world_m"][k].as_f64().unwrap();
            fields["world_m"][k] = json!(exact + 0.05 * normal(random));
        }
    }
    let (sin, cos) = 30_f64.to_radians().sin_cos();
    for (index, at) in [[2.0, 8.0], [14.0, 9.0], [4.0, 25.0], [12.0, 22.0]].into_iter().enumerate() {
        let px = above(8.0).world_to_pixel(WorldPoint::new(at[0], at[1], 0.0)).unwrap();
        let world = WorldPoint {
            x: cos * at[0] + sin * at[1] + sigma * normal(random),
            y: cos * at[1] - sin * at[0] + sigma * normal(random),
            z: 0.0,
        };
        let Geographic { latitude, longitude, .. } = plane.to_geographic(world);
        points.push(json!({"id": format!("g{index}"), "sigma_m": sigma,
            "px": [px.u + 0.5 * normal(random), px.v + 0.5 * normal(random)],
            "lat_deg": latitude.to_degrees(), "lon_deg": longitude.to_degrees()}));
    }
    document
}

#[test]
fn a_camera_far_from_the_origin_of_the_map_is_reported() {
    let finding = |distance: f64| {
        let mut document = site(&mut ChaCha8Rng::seed_from_u64(6), 0.01, true);
        document["georeference"] = json!({"lat_deg": 48.0, "lon_deg": 11.0, "x_axis_azimuth_deg": 90.0});
        for point in document["cameras"][0]["control_points"].as_array_mut().unwrap() {
            ["lat_deg", "lon_deg"].iter().for_each(|name| drop(point.as_object_mut().unwrap().remove(*name)));
            point["world_m"][0] = json!(point["world_m"][0].as_f64().unwrap() + distance);
        }
        let site = Site::from_json(&document.to_string()).unwrap();
        let report = site.calibrate(&Options::default());
        let is_large = |finding: &&Finding| finding.code() == Code::LargeSite;
        report.site_findings.iter().find(is_large).cloned()
    };
    assert_eq!(finding(4_950.0), None);
    let Some(Finding::LargeSite { camera: 0, distance, drop, is_compact: true }) = finding(7_200.0) else {
        panic!("no finding at 7.2 km")
    };
    assert!((distance - 7_200.0).abs() < 50.0, "{distance} m");
    // The plane is d^2 / 2R above the ground; the radius of curvature of the ellipsoid is 6,357 to 6,400 km.
    let expected = distance * distance / (2.0 * 6.38e6);
    assert!((drop / expected - 1.0).abs() < 0.005, "{drop} m instead of {expected} m");
}

#[test]
fn solved_cameras_determine_the_georeference() {
    const TRIALS: u32 = 60;
    for sigma in [4.0, 0.3, 0.02] {
        let mut random = ChaCha8Rng::seed_from_u64(11);
        let (mut squares, mut outside) = ([0.0; 3], 0);
        for _ in 0..TRIALS {
            let site = Site::from_json(&located_site(&mut random, sigma).to_string()).unwrap();
            let solved = site.calibrate(&Options::default()).write_into(&site);
            let found = solved.solution.as_ref().unwrap().georeference.clone().unwrap();
            let at = TangentPlane::new(origin(), 90_f64.to_radians()).to_world(Geographic {
                latitude: found.lat_deg.to_radians(),
                longitude: found.lon_deg.to_radians(),
                height: 0.0,
            });
            let errors = [
                at.x / found.sigma.east_m,
                at.y / found.sigma.north_m,
                (found.x_axis_azimuth_deg - 60.0) / found.sigma.azimuth_deg,
            ];
            outside += errors.iter().filter(|error| error.abs() > 1.96).count();
            squares.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error * error / f64::from(TRIALS));
            // The georeference is a result and no evidence: solving again gives the same georeference.
            let again = solved.calibrate(&Options::default()).write_into(&solved);
            assert_eq!(again.solution.unwrap().georeference, Some(found));
        }
        // Bounds of the mean of 60 squares of normal variables, at four standard deviations.
        assert!(squares.iter().all(|square| (0.27..1.73).contains(square)), "{sigma} m: {squares:?}");
        assert!(outside <= 20, "{sigma} m: {outside} of 180 outside the 95 % interval");
    }
}

#[test]
fn a_point_far_from_its_place_on_the_map_is_named() {
    let mut random = ChaCha8Rng::seed_from_u64(21);
    let mut document = located_site(&mut random, 0.3);
    let codes = |document: &Value| {
        let site = Site::from_json(&document.to_string()).unwrap();
        site.calibrate(&Options::default()).site.warnings
    };
    assert!(codes(&document).is_empty(), "{:?}", codes(&document));
    let points = document["cameras"][0]["control_points"].as_array_mut().unwrap();
    let wrong = points.iter_mut().find(|point| point["id"] == "g2").unwrap();
    wrong["lat_deg"] = json!(wrong["lat_deg"].as_f64().unwrap() + 2e-4);
    let found = codes(&document);
    let far = found.iter().find(|warning| warning.code == Code::Misfit).unwrap();
    assert!(far.message.contains("g2") && far.message.contains("22."), "{}", far.message);
    // A single point does not determine the position on the map.
    let points = document["cameras"][0]["control_points"].as_array_mut().unwrap();
    points.retain(|point| point["id"].as_str().is_none_or(|id| !id.starts_with('g') || id == "g0"));
    let found = codes(&document);
    let unused = found.iter().find(|warning| warning.code == Code::UnusedAnnotation).unwrap();
    assert!(unused.message.contains("g0") && unused.advice.contains("second point"), "{unused:?}");
}

/// Agreement with PROJ on random points of ten grids.
#[test]
fn grids_agree_with_proj() {
    let Some(python) = peers_python() else { return };
    // Code, and a region of the grid: latitudes and longitudes.
    const GRIDS: [(&str, [f64; 4]); 10] = [
        ("EPSG:25832", [47.0, 55.0, 6.0, 12.0]),
        ("EPSG:32633", [0.5, 70.0, 12.0, 18.0]),
        ("EPSG:32756", [-40.0, -20.0, 150.0, 156.0]),
        ("EPSG:3857", [-60.0, 60.0, -170.0, 170.0]),
        ("EPSG:2154", [42.0, 51.0, -4.0, 8.0]),
        ("EPSG:2056", [45.9, 47.7, 6.0, 10.4]),
        ("EPSG:3006", [55.5, 68.0, 11.5, 23.5]),
        ("EPSG:2180", [49.2, 54.7, 14.3, 24.0]),
        ("EPSG:2193", [-46.0, -35.0, 167.0, 178.0]),
        ("EPSG:2263", [40.5, 41.2, -74.2, -72.0]),
    ];
    let mut random = ChaCha8Rng::seed_from_u64(12);
    let mut cases = Vec::new();
    for (crs, [south, north, west, east]) in GRIDS {
        for _ in 0..100 {
            let [lat, lon] = [random.random_range(south..north), random.random_range(west..east)];
            cases.push((crs, lat, lon));
        }
    }
    let output = std::process::Command::new(python)
        .arg(root().join("tests/geographic_peers.py"))
        .arg(json!(cases).to_string())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let theirs: Vec<[f64; 2]> = serde_json::from_slice(&output.stdout).unwrap();
    for ((crs, lat, lon), [east, north]) in cases.into_iter().zip(theirs) {
        let system = CoordinateSystem::new(crs).unwrap();
        let at = Geographic { latitude: lat.to_radians(), longitude: lon.to_radians(), height: 0.0 };
        let ours = system.from_geographic(at).unwrap();
        let error = (ours[0] - east).hypot(ours[1] - north) * system.metres_per_unit();
        assert!(error < 1e-3, "{crs} at {lat}, {lon}: {error} m");
    }
}

/// Ground overlay of an image of 400 x 200 pixels.
const OVERLAY: &str = "<kml><GroundOverlay><Icon><href>ortho.png</href></Icon><LatLonBox><north>48.0005</north>\
                       <south>48.0</south><east>11.0014944</east><west>11.0</west></LatLonBox></GroundOverlay></kml>";

#[test]
fn images_with_a_world_file_become_plans_on_the_map() {
    let scratch = Scratch::new();
    let image = image::RgbImage::from_pixel(400, 200, image::Rgb([90, 120, 150]));
    let mut png = std::io::Cursor::new(Vec::new());
    image.write_to(&mut png, image::ImageFormat::Png).unwrap();
    scratch.write("ortho.png", png.into_inner());
    // North is up, and a pixel is 0.25 m. The numbers refer to pixel centres.
    scratch.write("ortho.pgw", "0.25\n0\n0\n-0.25\n691000.125\n5334999.875\n");
    scratch.write("site.json", r#"{"format": "calib-site", "version": 1}"#);
    let without = scratch.calib(&["plan", "ortho.png"]).expect_code(0);
    assert!(without.stderr.contains("--crs"), "{}", without.stderr);
    let plan = ["plan", "ortho.png", "--site", "site.json", "-o", "mapped.json", "--force"];
    scratch.calib(&[&plan[..], &["--crs", "EPSG:25832"]].concat()).expect_code(0);
    scratch.write("ortho.prj", r#"PROJCS["x",GEOGCS["y"],AUTHORITY["EPSG","25832"]]"#);
    scratch.calib(&plan).expect_code(0);
    let site = Site::from_json(&scratch.read_json("mapped.json").to_string()).unwrap();
    let plan = site.plan.clone().unwrap();
    assert_eq!(plan.image.as_deref(), Some("ortho.png"));
    // The scale factor of UTM is 1.000049 at this position.
    let factor = 0.25 / plan.metres_per_px;
    assert!((factor - 1.000_049).abs() < 2e-6, "{factor}");
    let floor = plan.scale().floor_from_plan(calib_core::PlanPixel::new(300.0, 40.0));
    let at = site.tangent_plane().unwrap().to_geographic(floor.at_height(0.0));
    let [east, north] = CoordinateSystem::new("EPSG:25832").unwrap().from_geographic(at).unwrap();
    assert!((east - 691_075.0).abs() < 0.01 && (north - 5_334_990.0).abs() < 0.01, "{east} {north}");
    // An overlay must not read files of other folders.
    scratch.write("other.kml", OVERLAY.replace("ortho.png", "../ortho.png"));
    assert!(scratch.calib(&["plan", "other.kml"]).expect_code(3).stderr.contains("outside the folder"));
    // A ground overlay of the same image.
    scratch.write("yard.kml", OVERLAY);
    let found: Value =
        serde_json::from_str(&scratch.calib(&["plan", "yard.kml", "--format", "json"]).expect_code(0).stdout)
            .unwrap();
    let scale = found["plan"]["metres_per_px"].as_f64().unwrap();
    assert!((scale / 0.278 - 1.0).abs() < 0.01, "{scale}");
}

#[test]
fn points_of_maps_are_imported_and_cameras_exported() {
    let mut random = ChaCha8Rng::seed_from_u64(13);
    let scratch = Scratch::new();
    scratch.write("site.json", site(&mut random, 0.05, false).to_string());
    scratch.calib(&["solve", "site.json", "-o", "solved.json"]).expect_code(0);
    for (format, file) in [("kml", "site.kml"), ("gpx", "cameras.gpx"), ("geojson", "site.geojson")] {
        scratch.calib(&["export", format, "solved.json", "-o", "out"]).expect_code(0);
        let out = format!("{format}.json");
        scratch.calib(&["import", format, &format!("out/{file}"), "-o", &out]).expect_code(0);
        let imported = Site::from_json(&scratch.read_json(&out).to_string()).unwrap();
        let point = &imported.ground_points[0];
        let solved = Site::from_json(&scratch.read_json("solved.json").to_string()).unwrap();
        let at = Geographic {
            latitude: point.lat_deg.unwrap().to_radians(),
            longitude: point.lon_deg.unwrap().to_radians(),
            height: 0.0,
        };
        let position = solved.cameras[0].solution.as_ref().unwrap().position_m.unwrap();
        let found = solved.tangent_plane().unwrap().to_world(at);
        let error = (found.x - position.x).hypot(found.y - position.y);
        assert!(error < 1e-3, "{format}: {error} m");
    }
    scratch.write("survey.csv", "Name;East;North;Sigma\nA;691608,25;5334760,5;0,02\n");
    let table = ["import", "points", "survey.csv", "--into", "site.json", "-o", "more.json"];
    scratch.calib(&table).expect_code(3);
    scratch.calib(&[&table[..], &["--crs", "epsg:25832"]].concat()).expect_code(0);
    let merged = Site::from_json(&scratch.read_json("more.json").to_string()).unwrap();
    assert_eq!(merged.crs.as_deref(), Some("EPSG:25832"));
    assert_eq!(merged.ground_points[0].crs_m, Some([691_608.25, 5_334_760.5]));
}

#[test]
fn tables_have_grid_coordinates() {
    let mut random = ChaCha8Rng::seed_from_u64(14);
    let scratch = Scratch::new();
    scratch.write("site.json", located_site(&mut random, 0.5).to_string());
    scratch.calib(&["solve", "site.json", "-o", "solved.json"]).expect_code(0);
    scratch.write("pixels.csv", "u,v\n960,900\n");
    let project =
        ["project", "solved.json", "--camera", "a", "--to", "floor", "--sigma-px", "1", "-i", "pixels.csv"];
    let run = scratch.calib(&[&project[..], &["--geographic", "--crs", "EPSG:25832"]].concat());
    let out = run.expect_code(0).stdout;
    let lines: Vec<Vec<&str>> = out.lines().map(|line| line.split(',').collect()).collect();
    let value = |name: &str| {
        let column =
            lines[0].iter().position(|head| *head == name).unwrap_or_else(|| panic!("{name} in {out}"));
        lines[1][column].parse::<f64>().unwrap()
    };
    let at = Geographic {
        latitude: value("lat_deg").to_radians(),
        longitude: value("lon_deg").to_radians(),
        height: 0.0,
    };
    let [east, north] = CoordinateSystem::new("EPSG:25832").unwrap().from_geographic(at).unwrap();
    assert!((east - value("easting")).abs() < 1e-6 && (north - value("northing")).abs() < 1e-6);
    // The errors of the georeference, from four points of 0.5 m, are in the part of the calibration.
    let sigma = value("calibration_sigma_east_m");
    assert!((0.15..1.0).contains(&sigma), "{sigma}");
    let refused = scratch.calib(&[&project[..], &["--crs", "EPSG:4326"]].concat());
    assert!(refused.expect_code(2).stderr.contains("latitude"), "a system without a grid");
}

/// Returns the six cameras of a street of 300 m. World +x is east.
fn street_cameras() -> Vec<Camera> {
    let camera = |index: u32| {
        let side = if index.is_multiple_of(2) { 1.0 } else { -1.0 };
        Camera {
            position: WorldPoint::new(60.0 * f64::from(index), side * 6.0, 6.0),
            // Along the street, toward the middle of it.
            yaw: (-90.0 + side * -12.0_f64).to_radians(),
            pitch: 0.16,
            ..above(0.0)
        }
    };
    (0..6).map(camera).collect()
}

/// Returns the pixel of a point, with noise of half a pixel; `None` outside the image or beyond 110 m.
fn click(random: &mut ChaCha8Rng, camera: &Camera, at: WorldPoint) -> Option<[f64; 2]> {
    let px = camera.world_to_pixel(at)?;
    let is_inside = (0.0..f64::from(SIZE[0])).contains(&px.u) && (0.0..f64::from(SIZE[1])).contains(&px.v);
    let noisy = [px.u + 0.5 * normal(random), px.v + 0.5 * normal(random)];
    (is_inside && camera.position.distance(at) < 110.0).then_some(noisy)
}

/// Returns the verticals and the parallel edges that are annotated in the image of a camera.
fn lines(random: &mut ChaCha8Rng, camera: &Camera) -> Vec<Value> {
    let mut line = |ends: [[f64; 3]; 2]| {
        let ends = ends.map(|[dx, y, z]| WorldPoint::new(camera.position.x + dx, y, z));
        ends.map(|at| click(random, camera, at).unwrap())
    };
    let mut lines: Vec<Value> = [[14.0, 4.0], [16.0, -4.0], [30.0, 6.0], [28.0, -6.0], [22.0, 1.0]]
        .map(|[dx, y]| json!({"kind": "vertical", "segments": [line([[dx, y, 0.0], [dx, y, 2.5]])]}))
        .into();
    let edges = [-3.0, 0.0, 3.0].map(|y| line([[16.0, y, 0.0], [60.0, y, 0.0]]));
    lines.push(json!({"kind": "parallel", "segments": edges}));
    lines
}

/// Creates the site of a street of six cameras, with links between neighbours and eight surveyed points.
fn street(random: &mut ChaCha8Rng, sigma: f64) -> Value {
    let cameras = street_cameras();
    let mut links = Vec::new();
    for k in 0..120 {
        let at = WorldPoint::new(8.0 + 3.0 * f64::from(k), f64::from(k * 7 % 13) - 6.0, 0.0);
        let seen: Vec<Value> = (0..cameras.len())
            .filter_map(|index| {
                let px = click(random, &cameras[index], at)?;
                Some(json!({"camera": format!("c{index}"), "px": px}))
            })
            .collect();
        if seen.len() > 1 {
            links.push(json!({"kind": "point", "seen": seen}));
        }
    }
    let plane = TangentPlane::new(origin(), 90_f64.to_radians());
    let mut points: Vec<Vec<Value>> = vec![Vec::new(); cameras.len()];
    for k in 0..8_u32 {
        let at =
            WorldPoint::new(25.0 + 44.0 * f64::from(k), if k.is_multiple_of(2) { 5.0 } else { -5.0 }, 0.0);
        let found = (0..cameras.len()).find_map(|index| Some((index, click(random, &cameras[index], at)?)));
        let (index, px) = found.unwrap();
        let noisy = WorldPoint { x: at.x + sigma * normal(random), y: at.y + sigma * normal(random), z: 0.0 };
        let Geographic { latitude, longitude, .. } = plane.to_geographic(noisy);
        points[index].push(json!({"id": format!("p{k}"), "px": px, "sigma_m": sigma,
            "lat_deg": latitude.to_degrees(), "lon_deg": longitude.to_degrees()}));
    }
    let entry = |(index, (camera, points)): (usize, (&Camera, Vec<Value>))| {
        json!({"id": format!("c{index}"), "size_px": SIZE, "sigma_px": 0.5, "annotations": lines(random, camera),
            "control_points": points, "lens": {"principal_point_px": [960, 540]}})
    };
    let entries: Vec<Value> = cameras.iter().zip(points).enumerate().map(entry).collect();
    json!({"format": "calib-site", "version": 1, "scene": "exact", "cameras": entries, "links": links})
}

/// Simulates a street, and returns the errors of its cameras as [`map_errors`] does.
fn street_errors(random: &mut ChaCha8Rng, sigma: f64) -> Option<Vec<[f64; 4]>> {
    let site = Site::from_json(&street(random, sigma).to_string()).unwrap();
    map_errors(&site.calibrate(&Options::default()).write_into(&site))
}

/// Returns the errors of the solved cameras of a street on the map, in standard deviations: east, north, height and
/// azimuth. `None` if a camera has no position or no standard deviation.
fn map_errors(solved: &Site) -> Option<Vec<[f64; 4]>> {
    let plane = solved.tangent_plane()?;
    let map = TangentPlane::new(origin(), 90_f64.to_radians());
    let errors = |(entry, exact): (&SiteCamera, &Camera)| {
        let solution = entry.solution.as_ref()?;
        let sigma = solution.sigma.as_ref()?;
        let at = map.to_world(plane.to_geographic(solution.position_m?));
        let yaw = solution.yaw_deg? - exact.yaw.to_degrees();
        Some([
            (at.x - exact.position.x) / sigma.x_m?,
            (at.y - exact.position.y) / sigma.y_m?,
            (at.z - exact.position.z) / sigma.z_m?,
            ((yaw + 180.0).rem_euclid(360.0) - 180.0) / sigma.yaw_deg?,
        ])
    };
    solved.cameras.iter().zip(&street_cameras()).map(errors).collect()
}

/// Simulates `trials` sites of six cameras, with `sigma` metres of noise on the surveyed points. Returns two values
/// for east, north, height and azimuth: the root mean square error divided by the standard deviation, and the share
/// of errors within 1.96 standard deviations.
fn street_table(sigma: f64, trials: u64) -> [[f64; 2]; 4] {
    let mut sums = [[0.0; 2]; 4];
    let mut count = 0.0;
    for trial in 0..trials {
        let mut random = ChaCha8Rng::seed_from_u64(1000 + trial);
        for errors in street_errors(&mut random, sigma).expect("every street is solved") {
            count += 1.0;
            for (sum, error) in sums.iter_mut().zip(errors) {
                sum[0] += error * error;
                sum[1] += f64::from(u8::from(error.abs() < 1.96));
            }
        }
    }
    sums.map(|[square, inside]| [(square / count).sqrt(), inside / count])
}

/// Replaces the surveyed points of a street by surveyed crosses, which are rotated by 40 degrees.
fn with_crosses(random: &mut ChaCha8Rng, mut document: Value, sigma: f64) -> Value {
    const ARM_M: f64 = 0.8;
    let (sin, cos) = 40_f64.to_radians().sin_cos();
    let plane = TangentPlane::new(origin(), 90_f64.to_radians());
    let mut marks = Vec::new();
    for k in 0..20_u32 {
        let side = if k.is_multiple_of(2) { 4.0 } else { -4.0 };
        let at = WorldPoint::new(20.0 + 20.0 * f64::from(k), side, 0.0);
        let points =
            [("centre", [0.0, 0.0]), ("x", [ARM_M * cos, ARM_M * sin]), ("y", [-ARM_M * sin, ARM_M * cos])];
        let mut seen = Vec::new();
        for (index, camera) in street_cameras().iter().enumerate() {
            for (point, [dx, dy]) in points {
                let px = click(random, camera, WorldPoint { x: at.x + dx, y: at.y + dy, z: 0.0 });
                seen.extend(px.map(|px| json!({"camera": format!("c{index}"), "point": point, "px": px})));
            }
        }
        let noisy = WorldPoint { x: at.x + sigma * normal(random), y: at.y + sigma * normal(random), z: 0.0 };
        let Geographic { latitude, longitude, .. } = plane.to_geographic(noisy);
        marks.push(json!({"id": format!("m{k}"), "kind": "cross", "size_m": [ARM_M], "sigma_m": sigma,
            "lat_deg": latitude.to_degrees(), "lon_deg": longitude.to_degrees(), "seen": seen}));
    }
    document["marks"] = json!(marks);
    for camera in document["cameras"].as_array_mut().unwrap() {
        camera["control_points"] = json!([]);
    }
    document
}

#[test]
fn marks_with_map_coordinates_place_cameras() {
    let (mut square, mut count) = (0.0, 0.0);
    for seed in 0..6 {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let document = street(&mut random, 0.05);
        let mut document = with_crosses(&mut random, document, 0.05);
        // Every second site has no links, and the marks alone connect its cameras.
        if seed % 2 == 1 {
            document["links"] = json!([]);
        }
        let site = Site::from_json(&document.to_string()).unwrap();
        let solved = site.calibrate(&Options::default()).write_into(&site);
        for errors in map_errors(&solved).expect("every camera is placed") {
            assert!(errors.iter().all(|error| error.abs() < 5.0), "{seed}: {errors:?}");
            square += errors.iter().map(|error| error * error).sum::<f64>();
            count += errors.len() as f64;
        }
        let residuals =
            solved.marks.iter().filter_map(|mark| mark.solution.as_ref()).flat_map(|found| &found.residuals);
        assert!(
            residuals.clone().count() > 20 && residuals.into_iter().all(|residual| !residual.outlier),
            "{seed}"
        );
    }
    let ratio = (square / count).sqrt();
    assert!((0.8..1.25).contains(&ratio), "root mean square error over the standard deviation: {ratio}");
}

#[test]
fn marks_with_map_coordinates_place_one_camera() {
    let mut random = ChaCha8Rng::seed_from_u64(21);
    let document = street(&mut random, 0.05);
    let mut document = with_crosses(&mut random, document, 0.05);
    document["cameras"].as_array_mut().unwrap().truncate(1);
    document["links"] = json!([]);
    for mark in document["marks"].as_array_mut().unwrap() {
        mark["seen"].as_array_mut().unwrap().retain(|seen| seen["camera"] == "c0");
    }
    let site = Site::from_json(&document.to_string()).unwrap();
    let solved = site.calibrate(&Options::default()).write_into(&site);
    let errors = map_errors(&solved).expect("the camera is placed");
    assert!(errors[0].iter().all(|error| error.abs() < 4.0), "{errors:?}");
}

#[test]
fn streets_are_on_the_map_within_their_errors() {
    for sigma in [4.0, 0.5, 0.02] {
        for [rms, inside] in street_table(sigma, 25) {
            // All cameras of a street share errors, so that 25 streets are about 25 independent errors.
            assert!((0.6..1.45).contains(&rms) && inside > 0.8, "{sigma} m: {rms}, {inside}");
        }
    }
}

#[test]
#[ignore = "takes minutes; the table of the guide"]
fn table_of_streets() {
    println!("| accuracy of the points | | east | north | height | azimuth |\n|---|---|---:|---:|---:|---:|");
    for sigma in [4.0, 0.5, 0.02] {
        let table = street_table(sigma, 400);
        for (k, what) in ["RMSE over σ", "in the 95 % interval"].into_iter().enumerate() {
            let [east, north, height, azimuth] = table.map(|values| values[k]);
            println!("| {sigma} m | {what} | {east:.3} | {north:.3} | {height:.3} | {azimuth:.3} |");
        }
    }
}
