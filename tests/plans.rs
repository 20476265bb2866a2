//! Floor plans that are drawings, on the command line.

use calib_tests::Scratch;
use serde_json::{Value, json};

/// Returns a DXF in millimetres with the outline of a hall of 20 m x 12 m, and a line on the layer FURNITURE.
fn hall() -> String {
    let line = |layer: &str, [a, b, c, d]: [i32; 4]| {
        format!("0\nLINE\n8\n{layer}\n10\n{a}\n20\n{b}\n11\n{c}\n21\n{d}\n")
    };
    let lines = line("WALLS", [0, 0, 20_000, 0])
        + &line("WALLS", [20_000, 0, 20_000, 12_000])
        + &line("WALLS", [20_000, 12_000, 0, 12_000])
        + &line("WALLS", [0, 12_000, 0, 0])
        + &line("FURNITURE", [5000, 5000, 9000, 5000]);
    format!(
        "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n{lines}0\nENDSEC\n0\nEOF\n"
    )
}

/// Returns a site with a plan, and a camera with a control point at plan pixel (100, 500).
fn site(plan: &Value) -> String {
    json!({"format": "calib-site", "version": 1, "plan": plan, "cameras": [
        {"id": "a", "size_px": [1280, 720], "control_points": [{"id": "p", "px": [600, 400], "plan_px": [100, 500]}]}
    ]})
    .to_string()
}

#[test]
fn drawing_states_its_scale_and_layers() {
    let scratch = Scratch::new();
    scratch.write("hall.dxf", hall());
    let plan = scratch.calib(&["plan", "hall.dxf", "--format", "json"]).expect_code(0).json();
    assert_eq!((&plan["kind"], &plan["metres_per_px"]), (&json!("dxf"), &json!(0.005)));
    assert_eq!(plan["plan"]["origin_px"], json!([24.0, 2424.0]), "the origin of the drawing is world (0, 0)");
    let layers: Vec<&Value> = plan["layers"].as_array().unwrap().iter().map(|layer| &layer["name"]).collect();
    assert_eq!(layers, [&json!("FURNITURE"), &json!("WALLS")]);
    scratch.calib(&["plan", "hall.dxf", "--layer", "WALLS", "-o", "walls.png"]).expect_code(0);
    let image = image::open(scratch.path("walls.png")).unwrap().to_rgb8();
    assert_eq!(json!([image.width(), image.height()]), plan["size_px"]);
    let at = |x: f64, y: f64| image.get_pixel((24.0 + x / 0.005) as u32, (2424.0 - y / 0.005) as u32).0[0];
    assert!(at(10.0, 0.0) < 128 && at(7.0, 5.0) == 255, "walls, and no furniture");
    let unknown = scratch.calib(&["plan", "hall.dxf", "--layer", "DOORS"]).expect_code(2);
    assert!(
        unknown.stderr.contains("--layer DOORS") && unknown.stderr.contains("WALLS"),
        "{}",
        unknown.stderr
    );
    let scale = scratch.calib(&["plan", "hall.dxf", "--scale", "1:100"]).expect_code(2);
    assert!(scale.stderr.contains("is not a PDF"), "{}", scale.stderr);
}

#[test]
fn site_with_a_drawing_needs_no_scale() {
    let scratch = Scratch::new();
    scratch.write("hall.dxf", hall());
    scratch.write("site.json", site(&json!({"image": "hall.dxf", "layers": ["WALLS"]})));
    scratch.calib(&["render", "site.json", "--plan", "-o", "plan.png"]).expect_code(0);
    assert_eq!(image::image_dimensions(scratch.path("plan.png")).unwrap(), (4048, 2448));
    scratch.write("missing.json", site(&json!({"image": "other.dxf"})));
    let missing = scratch.calib(&["solve", "missing.json"]).expect_code(3);
    assert!(missing.stderr.contains("other.dxf"), "{}", missing.stderr);
    scratch.write("none.json", site(&json!({"origin_px": [0, 0]})));
    let none = scratch.calib(&["solve", "none.json"]).expect_code(3);
    assert!(none.stderr.contains("/plan/metres_per_px"), "{}", none.stderr);
}

#[test]
fn newer_plan_keeps_positions() {
    let scratch = Scratch::new();
    scratch.write("hall.dxf", hall());
    let old = json!({"metres_per_px": 0.02, "origin_px": [0, 600], "x_axis_deg": 90,
        "georeference": {"lat_deg": 48.0, "lon_deg": 11.0, "x_axis_azimuth_deg": 0.0}});
    scratch.write("site.json", site(&old));
    scratch.calib(&["plan", "hall.dxf", "--site", "site.json", "-o", "new.json"]).expect_code(0);
    let new = scratch.read_json("new.json");
    assert_eq!(new["plan"]["georeference"], old["georeference"]);
    // The point was 2 m to the right of the old origin and 2 m above it. Up is +x: world (2, -2).
    let pixel = &new["cameras"][0]["control_points"][0]["plan_px"];
    let [u, v] = [0, 1].map(|index| pixel[index].as_f64().unwrap());
    assert!((u - (24.0 + 400.0)).abs() < 1e-6 && (v - (2424.0 + 400.0)).abs() < 1e-6, "{pixel}");
}

#[test]
fn picture_is_not_written_under_the_name_of_another_format() {
    let scratch = Scratch::new();
    scratch.write("hall.dxf", hall());
    for name in ["plan.json", "plan.webp"] {
        let refused = scratch.calib(&["plan", "hall.dxf", "-o", name]).expect_code(2);
        assert!(refused.stderr.contains(name) && refused.stderr.contains("--site"), "{}", refused.stderr);
        assert!(!scratch.path(name).exists(), "{name}");
    }
}

#[test]
fn lines_of_a_layer_become_walls() {
    let scratch = Scratch::new();
    scratch.write("hall.dxf", hall());
    scratch
        .write("site.json", site(&json!({"metres_per_px": 0.02, "origin_px": [0, 600], "x_axis_deg": 90})));
    let plan = |from: &str, to: &str, more: &[&str]| {
        scratch.calib(&[&["plan", "hall.dxf", "--site", from, "-o", to][..], more].concat())
    };
    let told =
        plan("site.json", "walls.json", &["--walls", "walls", "--wall-height-m", "3.5"]).expect_code(0);
    assert!(told.stderr.contains("4 walls"), "{}", told.stderr);
    let walls = scratch.read_json("walls.json")["walls"].clone();
    let first = &walls[0];
    assert_eq!((&first["from_m"], &first["to_m"]), (&json!([0.0, 0.0]), &json!([20.0, 0.0])));
    let number = |value: &Value| value.as_f64().unwrap();
    let length = |wall: &Value| {
        let [dx, dy] = [0, 1].map(|k| number(&wall["to_m"][k]) - number(&wall["from_m"][k]));
        dx.hypot(dy)
    };
    assert!((length(first) - 20.0).abs() < 1e-6 && first["height_m"] == 3.5, "{first}");
    assert!((length(&walls[1]) - 12.0).abs() < 1e-6, "{walls}");
    // The same walls are not added again; another layer is.
    let again =
        plan("walls.json", "again.json", &["--walls", "WALLS", "--walls", "FURNITURE"]).expect_code(0);
    assert!(again.stderr.contains("1 wall added"), "{}", again.stderr);
    assert_eq!(scratch.read_json("again.json")["walls"].as_array().unwrap().len(), 5);
    let unknown = plan("site.json", "x.json", &["--walls", "DOORS"]).expect_code(2);
    assert!(
        unknown.stderr.contains("--walls DOORS") && unknown.stderr.contains("FURNITURE"),
        "{}",
        unknown.stderr
    );
    scratch.calib(&["plan", "hall.dxf", "--walls", "WALLS"]).expect_code(2);
}
