//! The JSON Schema and the reader accept the same site files.

use calib_site::Site;
use serde_json::{Value, json};

/// Returns a site with most parts of the format.
fn complete_site() -> Value {
    let known = |value: f64, sigma: f64| json!({"value": value, "sigma": sigma});
    json!({
        "format": "calib-site", "version": 1, "name": "Shelter",
        "plan": {"image": "plan.png", "metres_per_px": 0.0212, "origin_px": [0, 734], "x_axis_deg": 0,
                 "georeference": {"lat_deg": 39.0, "lon_deg": -85.5, "x_axis_azimuth_deg": 90.0}},
        "cameras": [{
            "id": "G506", "name": "Door", "image": "frames/G506.png", "size_px": [1920, 1072],
            "lens": {"focal_px": known(1490.5, 15.0), "roll_deg": {"value": 1.0, "fixed": true}, "principal_point_px": [960, 536],
                     "distortion": {"model": "brown-conrady", "k1": -0.35, "k2": 0.12, "k3": 0, "p1": 0, "p2": 0, "focal_px": 1490.5}},
            "height_m": known(3.0, 0.1), "sigma_px": 1.0,
            "annotations": [
                {"kind": "vertical", "segments": [[[683.6, 329.5], [741.4, 748.0]]]},
                {"kind": "parallel", "id": "kerb", "segments": []},
                {"kind": "parallel", "at_right_angles_to": "kerb", "segments": []},
                {"kind": "perpendicular", "off": true, "segments": [[[0, 0], [1, 0]], [[0, 0], [0, 1]]]},
                {"kind": "equal_length", "segments": []},
                {"kind": "known_length", "keep": true, "segments": [], "length_m": 2.0},
                {"kind": "straight", "points": [[10.0, 20.0], [300.0, 24.0], [600.0, 21.0]]},
                {"kind": "upright", "foot": [700, 900], "head": [702, 640], "height_m": known(1.75, 0.07)}
            ],
            "efov_px": [[60, 1060], [1860, 1060], [1500, 400], [400, 400]],
            "placement": {"move_m": [0, 0], "turn_deg": 0, "scale": 1},
            "control_points": [{"id": "post 7", "px": [1345.39, 891.21], "world_m": [73.26, 115.36, 1.39], "sigma_px": 0.5},
                               {"px": [100.0, 200.0], "plan_px": [30, 40], "height_m": 1.0, "sigma_m": 0.02}],
            "valid_from": "2026-01-01T00:00:00Z", "valid_to": "2026-06-01T00:00:00+02:00"
        }, {
            "id": "G505", "size_px": [1920, 1072],
            "lens": {"distortion": {"model": "brown-conrady", "fit": ["k1", "k2"]}}
        }],
        "links": [{"id": "bench corner", "height_m": 0, "seen": [{"camera": "G505", "px": [900, 640], "sigma_px": 2.3}, {"camera": "G506", "px": [410, 700]}]},
                  {"kind": "post", "length_m": known(1.0, 0.01), "seen": [{"camera": "G505", "foot": [1, 2], "head": [3, 4]}]},
                  {"kind": "line", "seen": [{"camera": "G505", "segment": [[1, 2], [3, 4]]}]}],
        "marks": [{"id": "m1", "kind": "post", "at_m": [2.0, 5.5, 0], "turn_deg": 0, "size_m": [0.1, 0.1, 2.0],
                   "seen": [{"camera": "G506", "point": "top", "px": [5, 6]}], "fixed": true},
                  {"kind": "grid", "at_m": [0, 0, 0], "size_m": [1, 4, 4]}],
        "distances": [{"between": ["bench corner", "m1"], "length_m": known(4.2, 0.02)}]
    })
}

fn validator() -> jsonschema::Validator {
    jsonschema::validator_for(&Site::json_schema()).unwrap()
}

/// Returns the document with the value at a pointer replaced, or added as a new field.
fn with(pointer: &str, value: Value) -> Value {
    let mut document = complete_site();
    if let Some(place) = document.pointer_mut(pointer) {
        *place = value;
        return document;
    }
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    document.pointer_mut(parent).unwrap()[key] = value;
    document
}

#[test]
fn complete_site_is_read_and_written() {
    let site = Site::from_json(&complete_site().to_string()).unwrap();
    let errors: Vec<String> =
        validator().iter_errors(&complete_site()).map(|e| format!("{}: {e}", e.instance_path())).collect();
    assert!(errors.is_empty(), "{errors:?}");
    let written: Value = serde_json::from_str(&site.to_json()).unwrap();
    assert!(validator().is_valid(&written), "the written file matches the schema");
    assert_eq!(Site::from_json(&site.to_json()).unwrap(), site);
    // Entered values are kept; default values may be omitted or written.
    for pointer in [
        "/cameras/0/annotations/3/off",
        "/cameras/0/annotations/7/height_m/sigma",
        "/marks/0/seen/0/point",
        "/links/0/seen/0/sigma_px",
        "/cameras/1/lens/distortion/fit/1",
        "/distances/0/between/1",
        "/plan/georeference/lat_deg",
    ] {
        assert_eq!(written.pointer(pointer), complete_site().pointer(pointer), "{pointer}");
    }
}

#[test]
fn solved_site_matches_the_schema() {
    let site = Site::from_json(&complete_site().to_string()).unwrap();
    let solved = site.calibrate(&calib_site::Options::default()).write_into(&site);
    let written: Value = serde_json::from_str(&solved.to_json()).unwrap();
    let errors: Vec<String> =
        validator().iter_errors(&written).map(|e| format!("{}: {e}", e.instance_path())).collect();
    assert!(errors.is_empty(), "{errors:?}");
    assert_eq!(Site::from_json(&solved.to_json()).unwrap(), solved);
}

/// Pointer and value of a change, then the pointer and text that the message must contain.
type Wrong = (&'static str, Value, &'static str, &'static str);

#[expect(clippy::too_many_lines, reason = "it is a list")]
fn wrong() -> Vec<Wrong> {
    vec![
        ("/cameras/0/lenses", json!({}), "/cameras/0/lenses", "unknown field"),
        ("/cameras/0/annotations/0/colour", json!("red"), "/cameras/0/annotations/0/colour", "unknown field"),
        (
            "/cameras/0/annotations/0/kind",
            json!("slanted"),
            "/cameras/0/annotations/0/kind",
            "unknown variant",
        ),
        (
            "/cameras/0/annotations/0/segments/0/1",
            json!([1.0]),
            "/cameras/0/annotations/0/segments/0/1",
            "length 2",
        ),
        (
            "/cameras/0/annotations/0/segments/0/1/0",
            json!("wide"),
            "/cameras/0/annotations/0/segments/0/1/0",
            "expected a number",
        ),
        (
            "/cameras/0/annotations/0/segments/0/1/0",
            json!(1e12),
            "/cameras/0/annotations/0/segments/0/1/0",
            "1000000000000",
        ),
        (
            "/cameras/0/annotations/0/segments/0",
            json!([[1, 2]]),
            "/cameras/0/annotations/0/segments/0",
            "at least 2",
        ),
        (
            "/cameras/0/annotations/0/points",
            json!([[1, 2], [3, 4], [5, 6]]),
            "/cameras/0/annotations/0/points",
            "vertical",
        ),
        ("/cameras/0/annotations/5/length_m", json!(-2.0), "/cameras/0/annotations/5/length_m", "above 0"),
        (
            "/cameras/0/annotations/2/at_right_angles_to",
            json!("curb"),
            "/cameras/0/annotations/2/at_right_angles_to",
            "curb",
        ),
        (
            "/cameras/0/annotations/1/at_right_angles_to",
            json!("kerb"),
            "/cameras/0/annotations/1/at_right_angles_to",
            "cycle",
        ),
        (
            "/cameras/0/annotations/7/height_m",
            json!({"value": 1.7}),
            "/cameras/0/annotations/7/height_m",
            "sigma",
        ),
        ("/cameras/0/size_px", json!([0, 100]), "/cameras/0/size_px/0", "1 to"),
        ("/cameras/0/size_px", json!([1e9, 100]), "/cameras/0/size_px/0", "whole number"),
        ("/cameras/0/lens/distortion/lambda", json!(0.1), "/cameras/0/lens/distortion/lambda", "model"),
        ("/cameras/0/control_points/0/plan_px", json!([1, 2]), "/cameras/0/control_points/0", "one of them"),
        ("/cameras/0/valid_to", json!("yesterday"), "/cameras/0/valid_to", "yesterday"),
        ("/cameras/1/id", json!("G506"), "/cameras/1/id", "G506"),
        ("/cameras/1/lens/like", json!("G999"), "/cameras/1/lens/like", "G999"),
        ("/links/0/seen/0/camera", json!("G999"), "/links/0/seen/0/camera", "G999"),
        ("/links/1/seen/0/px", json!([1, 2]), "/links/1/seen/0", "foot and head"),
        ("/links/1/height_m", json!(0), "/links/1/height_m", "of kind \"point\""),
        ("/links/0/length_m", json!({"value": 1, "sigma": 0.1}), "/links/0/length_m", "of kind \"post\""),
        ("/marks/0/size_m", json!([1.0]), "/marks/0/size_m", "width, depth, height"),
        ("/marks/0/seen/0/point", json!("elbow"), "/marks/0/seen/0/point", "elbow"),
        ("/marks/0/id", json!("bench corner"), "/marks/0/id", "bench corner"),
        ("/distances/0/between", json!(["m1", "m2"]), "/distances/0/between/1", "m2"),
        ("/version", json!(2), "/version", "the only supported version"),
        ("/format", json!("other"), "/format", "calib-site"),
        ("/links/0/seen/0/sigma_px", json!(0), "/links/0/seen/0/sigma_px", "above 0"),
        ("/plan/metres_per_px", json!(0), "/plan/metres_per_px", "above 0"),
    ]
}

#[test]
fn errors_have_the_correct_pointer() {
    for (pointer, value, expected, says) in wrong() {
        let error = Site::from_json(&with(pointer, value).to_string()).expect_err(pointer);
        assert_eq!(error.pointer, expected, "{error}");
        assert!(!expected.starts_with("/cameras") || error.message().contains("camera \""), "{error}");
        assert!(error.message().contains(says), "\"{error}\" does not contain \"{says}\"");
    }
}

#[test]
fn infinite_and_nan_numbers_are_refused() {
    let text = complete_site().to_string().replace("683.6", "1e999");
    assert!(Site::from_json(&text).is_err());
    let text = complete_site().to_string().replace("683.6", "NaN");
    assert!(Site::from_json(&text).is_err());
}

#[test]
fn hostile_file_is_refused_before_it_fills_memory() {
    let lists =
        format!("{{\"format\":\"calib-site\",\"version\":1,\"cameras\":[{}]}}", "[],".repeat(5_000_000));
    let error = Site::from_json(&lists).unwrap_err();
    assert!(error.message().contains("values"), "{error}");
    let deep = "[".repeat(100_000);
    assert!(Site::from_json(&deep).is_err());
}

#[test]
fn schema_refuses_unknown_fields() {
    assert!(!validator().is_valid(&with("/cameras/0/lenses", json!({}))));
    assert!(!validator().is_valid(&with("/cameras/0/annotations/0/kind", json!("slanted"))));
    assert!(!validator().is_valid(&with("/cameras/0/annotations/0/segments/0/1", json!([1.0]))));
}

#[test]
fn site_of_the_readme_is_solved() {
    let readme = std::fs::read_to_string(calib_tests::root().join("README.md")).unwrap();
    let text = readme.split("```json\n").nth(1).unwrap().split("```").next().unwrap();
    let site = Site::from_json(text).unwrap_or_else(|error| panic!("{error}"));
    let report = site.calibrate(&calib_site::Options::default());
    let (_, result) = &report.cameras[0];
    let solution = result.as_ref().unwrap();
    assert_eq!(solution.warnings, [], "the example has no warnings");
}

#[test]
fn usual_sizes_are_listed_with_spread_and_source() {
    let schema = Site::json_schema();
    let rows = schema.pointer("/$defs/Annotation/properties/like/oneOf").unwrap().as_array().unwrap();
    assert_eq!(rows.len(), calib_core::single::USUAL_SIZES.len());
    let door = rows.iter().find(|row| row["const"] == "door").unwrap();
    assert_eq!(door["description"], "2.03 +- 0.04 m: 1.985 m (DIN 18101) to 2.134 m (7 ft)");
}
