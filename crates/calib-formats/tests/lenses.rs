//! Tests of wide-angle lenses in other programs' formats, against the formulas of these programs.

#![allow(clippy::unwrap_used, reason = "a test that fails may panic")]

use calib_core::camera::Unified;
use calib_core::{BrownConrady, Camera, Covariance, Distortion, Lens, Pixel, WorldPoint};

use calib_formats::{ExportOptions, FORMATS, File, Imported, export, format, import};
use calib_site::{Method, Site, SiteCamera, Solution, Stage};
use proptest::prelude::*;
use saphyr::{LoadableYamlNode as _, Yaml};
use serde_json::json;

const SIZE: [u32; 2] = [1280, 960];

fn camera(distortion: Distortion, focal: f64) -> Camera {
    let principal_point = Pixel::new(633.0, 489.5);
    Camera {
        position: WorldPoint::new(1.0, -2.0, 3.1),
        yaw: 0.4,
        pitch: 1.2,
        roll: 0.1,
        focal,
        lens: Lens { principal_point, focal, pixel_aspect: 1.0, distortion, image_circle: None },
        covariance: Covariance::EXACT,
    }
}

fn site(camera: &Camera) -> Site {
    let solution = Solution::from_camera(camera, Method::Given, Stage::Placed);
    let entry = SiteCamera { solution: Some(solution), ..SiteCamera::new("yard", SIZE) };
    Site { cameras: vec![entry], ..Site::new() }
}

fn any_wide_lens() -> impl Strategy<Value = Distortion> {
    let fisheye = [-0.05..0.05_f64, -0.02..0.02_f64, -0.01..0.01_f64, -0.001..0.001_f64]
        .prop_map(|k| Distortion::KannalaBrandt { k });
    let double = (-0.4..0.6_f64, 0.3..0.8_f64).prop_map(|(xi, alpha)| Distortion::DoubleSphere { xi, alpha });
    let mei = (0.0..2.0_f64, [-0.3..0.1_f64, 0.0..0.1_f64], [-0.002..0.002_f64, -0.002..0.002_f64])
        .prop_map(|(xi, radial, tangential)| Distortion::Unified(Unified { xi, radial, tangential }));
    let eucm = (0.3..0.8_f64, 0.5..2.0_f64).prop_map(|(alpha, beta)| Distortion::Eucm { alpha, beta });
    prop_oneof![fisheye, (0.5..2.0_f64).prop_map(Distortion::unified), mei, double, eucm]
}

fn read(name: &str, file: &str, text: &str) -> Result<Imported, String> {
    let file = File { name: file.into(), bytes: text.into() };
    import(format(name).unwrap(), &[file]).map_err(|error| error.to_string())
}

fn only_lens(imported: &Imported) -> Lens {
    imported.site.cameras[0].lens()
}

/// Whether two lenses show every ray at the same pixel, up to rounding.
fn are_equal(a: &Lens, b: &Lens) -> bool {
    let rays = (0..300).map(|i| (f64::from(i) * 0.37, f64::from(i) / 300.0 * 1.7));
    rays.map(|(turn, theta)| [theta.sin() * turn.cos(), theta.sin() * turn.sin(), theta.cos()]).all(
        |[x, y, z]| match (
            a.bearing_to_pixel([a.focal * x, a.focal * y, z]),
            b.bearing_to_pixel([b.focal * x, b.focal * y, z]),
        ) {
            (Some(a), Some(b)) => a.distance(b) < 1e-8,
            (a, b) => a.is_none() && b.is_none(),
        },
    )
}

fn yaml(files: &[File]) -> Yaml<'_> {
    Yaml::load_from_str(std::str::from_utf8(&files[0].bytes).unwrap()).unwrap().remove(0)
}

fn numbers(value: &Yaml) -> Vec<f64> {
    value.as_sequence().unwrap().iter().map(|value| value.as_floating_point().unwrap()).collect()
}

/// Projects a point (right, down, forward) with Kalibr's camera models and the numbers of a camchain.
fn kalibr_pixel(camera: &Yaml, [x, y, z]: [f64; 3]) -> [f64; 2] {
    let k = numbers(&camera["intrinsics"]);
    let length = (x * x + y * y + z * z).sqrt();
    let (a, b, f) = match camera["camera_model"].as_str().unwrap() {
        "omni" => {
            let (a, b) = (x / (z + k[0] * length), y / (z + k[0] * length));
            let [a, b] = match camera["distortion_model"].as_str().unwrap() {
                "radtan" => {
                    let (d, s) = (numbers(&camera["distortion_coeffs"]), a * a + b * b);
                    let scale = 1.0 + d[0] * s + d[1] * s * s;
                    [
                        a * scale + 2.0 * d[2] * a * b + d[3] * (s + 2.0 * a * a),
                        b * scale + d[2] * (s + 2.0 * b * b) + 2.0 * d[3] * a * b,
                    ]
                }
                _ => [a, b],
            };
            (a, b, &k[1..])
        }
        "eucm" => {
            let below = k[0] * (k[1] * (x * x + y * y) + z * z).sqrt() + (1.0 - k[0]) * z;
            (x / below, y / below, &k[2..])
        }
        "ds" => {
            let along = k[0] * length + z;
            let second = (x * x + y * y + along * along).sqrt();
            let below = k[1] * second + (1.0 - k[1]) * along;
            (x / below, y / below, &k[2..])
        }
        _ => {
            let d = numbers(&camera["distortion_coeffs"]);
            let theta = x.hypot(y).atan2(z);
            let s = theta * theta;
            let radius = theta * (1.0 + s * (d[0] + s * (d[1] + s * (d[2] + s * d[3]))));
            (x / x.hypot(y) * radius, y / x.hypot(y) * radius, &k[..])
        }
    };
    [f[0] * a + f[2], f[1] * b + f[3]]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn kalibr_projects_like_the_camera_and_its_import_restores_the_lens(
        distortion in any_wide_lens(), focal in 200.0..400.0_f64, x in -1.0..1.0_f64, y in -1.0..1.0_f64, z in 0.1..1.0_f64,
    ) {
        let camera = camera(distortion, focal);
        let files = export(format("kalibr").unwrap(), &site(&camera), &ExportOptions::default()).unwrap();
        prop_assert!(files.losses.is_empty(), "{:?}", files.losses);
        let back = import(format("kalibr").unwrap(), &files.files).unwrap();
        prop_assert!(are_equal(&only_lens(&back), &camera.lens), "{:?} {distortion:?}", only_lens(&back));
        let yaml = yaml(&files.files);
        let [u, v] = kalibr_pixel(&yaml["cam0"], [x, y, z]);
        let shown = camera.lens.bearing_to_pixel([focal * x, focal * y, z]);
        // The point may be outside the lens.
        let Some(Pixel { u: own_u, v: own_v }) = shown else { return Ok(()) };
        let off = (own_u - 0.5 - u).hypot(own_v - 0.5 - v);
        prop_assert!(off < 1e-8, "{off}");
    }

    #[test]
    fn an_unsupported_lens_model_is_reported_with_its_name_and_advice(distortion in any_wide_lens()) {
        let model = distortion.model().unwrap();
        let camera = camera(distortion, 300.0);
        // Formats of maps contain no lens, and this site is on no map.
        for format in FORMATS.iter().filter(|format| format.can_export() && !format.needs_georeference) {
            let losses = export(format, &site(&camera), &ExportOptions::default()).unwrap().losses;
            let has_no_lens = ["geojson", "svg", "frigate", "nvdsanalytics"].contains(&format.name);
            if format.lenses.contains(&model) || has_no_lens {
                prop_assert!(losses.is_empty(), "{}: {losses:?}", format.name);
                continue;
            }
            let is_reported = losses.iter().any(|loss| {
                loss.description.contains(model.row().name) && loss.description.contains("calib undistort --look")
            });
            prop_assert!(is_reported, "{}: {losses:?}", format.name);
        }
    }
}

#[test]
fn relative_poses_of_a_camera_chain_match_the_site() {
    let first = camera(Distortion::unified(1.1), 300.0);
    let second = Camera { position: WorldPoint::new(2.0, 1.0, 2.5), yaw: -0.8, ..first };
    let mut site = site(&first);
    let solution = Some(Solution::from_camera(&second, Method::Given, Stage::Placed));
    site.cameras.push(SiteCamera { solution, ..SiteCamera::new("gate", SIZE) });
    let files = export(format("kalibr").unwrap(), &site, &ExportOptions::default()).unwrap().files;
    let yaml = yaml(&files);
    let rows: Vec<Vec<f64>> = yaml["cam1"]["T_cn_cnm1"].as_sequence().unwrap().iter().map(numbers).collect();
    for point in [WorldPoint::new(0.0, 0.0, 0.0), WorldPoint::new(3.0, 2.0, 1.0)] {
        let (before, now) = (first.in_camera(point), second.in_camera(point));
        for i in 0..3 {
            let found = (0..3).map(|j| rows[i][j] * before[j]).sum::<f64>() + rows[i][3];
            assert!((found - now[i]).abs() < 1e-12, "{found} {now:?}");
        }
    }
}

#[test]
fn unsupported_kalibr_lenses_are_rejected_with_a_reason() {
    let chain = |model: &str, intrinsics: &str, distortion: &str, terms: &str| {
        format!(
            "cam0:\n  camera_model: {model}\n  intrinsics: [{intrinsics}]\n  distortion_model: {distortion}\n  \
             distortion_coeffs: [{terms}]\n  resolution: [1280, 960]\n"
        )
    };
    let rejected = [
        (chain("omni", "1.2, 660, 660, 640, 480", "radtan", "0.1, 0, 0, 0, 0.1"), "not supported"),
        (chain("ds", "-0.2, 0.5, 360, 360, 640, 480", "radtan", "0.1, 0, 0, 0"), "not supported"),
        (chain("omni", "-1.2, 660, 660, 640, 480", "none", ""), "above -1"),
        (chain("ds", "-0.2, 1.5, 360, 360, 640, 480", "none", ""), "between 0 and 1"),
        (chain("ds", "-0.2, 0.5, 360, 360, 640", "none", ""), "6"),
        (chain("eucm", "0.6, 0, 360, 360, 640, 480", "none", ""), "above 0"),
        (chain("fov", "0.6, 360, 360, 640, 480", "none", ""), "pinhole, omni, ds or eucm"),
    ];
    for (text, word) in rejected {
        let error = read("kalibr", "camchain.yaml", &text).unwrap_err();
        assert!(error.contains(word), "{error}");
    }
    let plain = chain("omni", "1.0, 660, 660, 639.5, 479.5", "radtan", "0, 0, 0, 0");
    let lens = only_lens(&read("kalibr", "camchain.yaml", &plain).unwrap());
    assert_eq!((lens.distortion, lens.focal), (Distortion::unified(1.0), 330.0));
    assert_eq!(lens.principal_point, Pixel::new(640.0, 480.0));
    let distorted =
        camera(Distortion::BrownConrady(BrownConrady { k3: 0.1, ..BrownConrady::default() }), 900.0);
    let losses =
        export(format("kalibr").unwrap(), &site(&distorted), &ExportOptions::default()).unwrap().losses;
    assert!(losses.iter().any(|loss| loss.description.contains("k3")), "{losses:?}");
}

/// Returns the text of a `calib_results.txt`.
fn ocam(terms: &[f64], [c, d, e]: [f64; 3]) -> String {
    let terms: Vec<String> = terms.iter().map(|term| format!("{term:e}")).collect();
    format!(
        "#polynomial coefficients for the DIRECT mapping function\n\n{} {} \n\n#inverse\n\n2 300.0 150.0 \n\n\
         #center: \"row\" and \"column\", starting from 0 (C convention)\n\n489.000000 632.500000\n\n\
         #affine parameters \"c\", \"d\", \"e\"\n\n{c} {d} {e}\n\n#image size: \"height\" and \"width\"\n\n960 1280\n\n",
        terms.len(),
        terms.join(" ")
    )
}

#[test]
fn the_stated_error_of_an_ocamcalib_polynomial_is_correct() {
    let terms = [-330.0, 0.0, 1.05e-3, -4.0e-7, 1.1e-9];
    for (affine, sign) in [([1.0, 0.0, 0.0], 1.0), ([1.0004, 0.0003, -0.0002], 1.0), ([1.0, 0.0, 0.0], -1.0)]
    {
        let text = ocam(&terms.map(|term| sign * term), affine);
        let imported = read("ocamcalib", "calib_results.txt", &text).unwrap();
        let lens = only_lens(&imported);
        let note = imported.notes.first().unwrap();
        let stated: f64 = note.split("most ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
        let [c, d, e] = affine;
        let mut most = 0.0_f64;
        for (i, j) in (0..=32).flat_map(|i| (0..=24).map(move |j| (i, j))) {
            let (row, column) = (40.0 * f64::from(j), 40.0 * f64::from(i));
            // As in OCamCalib's cam2world: x is down, y is right, and the camera looks along -z.
            let (a, b, inverse) = (row - 489.0, column - 632.5, 1.0 / (c - d * e));
            let (x, y) = (inverse * (a - d * b), inverse * (-e * a + c * b));
            let r = x.hypot(y);
            let z = terms.iter().rev().fold(0.0, |sum, term| sum * r + term);
            if r.atan2(-z) > 109_f64.to_radians() {
                continue;
            }
            let shown = lens.bearing_to_pixel([lens.focal * y, lens.focal * x, -z]).unwrap();
            most = most.max((shown.u - column - 0.5).hypot(shown.v - row - 0.5));
        }
        assert!(most <= stated && stated <= 1.0 && most > 0.2 * stated, "{most} px of {stated}: {lens:?}");
    }
}

#[test]
fn ocamcalib_lenses_without_an_accepted_fit_are_rejected_with_a_reason() {
    let good = [-330.0, 0.0, 1.05e-3, -4.0e-7, 1.1e-9];
    let rejected = [
        (ocam(&good, [1.0, 0.009, 0.008]), "affine parameters"),
        (ocam(&good, [4.0, 0.0, 0.0]), "c near 1"),
        (ocam(&[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]), "outward"),
        (ocam(&[-330.0, 0.0, -0.02, 1e-3], [1.0, 0.0, 0.0]), "Kannala-Brandt lens"),
        (ocam(&[-330.0, 2.0, 3.0], [1.0, 0.0, 0.0]), "outward"),
        (ocam(&[-330.0, 0.0, 2.2e-3, -1.2e-5, 3.0e-8, -3.1e-11, 1.2e-14], [1.0, 0.0, 0.0]), "px"),
        (ocam(&good, [1.0, 0.0, 0.0]).replace("5 -3.3e2", "7 -3.3e2"), "number of coefficients"),
        (ocam(&good, [1.0, 0.0, 0.0]).replace("960 1280", "960.5 1280"), "whole pixels"),
        ("1 2\n3\n".into(), "five"),
    ];
    for (text, word) in rejected {
        let error = read("ocamcalib", "calib_results.txt", &text).unwrap_err();
        assert!(error.contains(word), "expected {word} in: {error}");
    }
}

fn colmap(camera: &str) -> Result<Imported, String> {
    let cameras = File { name: "cameras.txt".into(), bytes: format!("1 {camera}\n").into() };
    let images = File { name: "images.txt".into(), bytes: b"1 1 0 0 0 1 2 3 1 a.png\n\n".to_vec() };
    import(format("colmap").unwrap(), &[cameras, images]).map_err(|error| error.to_string())
}

#[test]
fn colmap_fisheyes_are_imported() {
    let read = |camera: &str| only_lens(&colmap(camera).unwrap());
    let of = |k: [f64; 4]| {
        let lens = camera(Distortion::KannalaBrandt { k }, 300.0).lens;
        Lens { principal_point: Pixel::new(640.0, 480.0), ..lens }
    };
    let k = [0.02, -0.01, 0.004, -0.0006];
    for (text, expected) in [
        ("SIMPLE_RADIAL_FISHEYE 1280 960 300 640 480 0.02", [0.02, 0.0, 0.0, 0.0]),
        ("RADIAL_FISHEYE 1280 960 300 640 480 0.02 -0.01", [0.02, -0.01, 0.0, 0.0]),
        ("OPENCV_FISHEYE 1280 960 300 300 640 480 0.02 -0.01 0.004 -0.0006", k),
        ("THIN_PRISM_FISHEYE 1280 960 300 300 640 480 0.02 -0.01 0 0 0.004 -0.0006 0 0", k),
        ("RAD_TAN_THIN_PRISM_FISHEYE 1280 960 300 300 640 480 0.02 -0.01 0.004 -0.0006 0 0 0 0 0 0 0 0", k),
    ] {
        assert_eq!(read(text), of(expected), "{text}");
    }
}

#[test]
fn the_stated_error_of_four_radial_terms_is_correct_and_a_prism_is_rejected() {
    let terms = [-0.05, 0.1, -0.08, 0.03, -0.006, 0.0005];
    let line = |terms: &[f64], rest: &str| {
        let terms: Vec<String> = terms.iter().map(f64::to_string).collect();
        format!("RAD_TAN_THIN_PRISM_FISHEYE 1280 960 400 400 640 480 {} {rest}", terms.join(" "))
    };
    let imported = colmap(&line(&terms, "0 0 0 0 0 0")).unwrap();
    let lens = only_lens(&imported);
    let note = imported.notes.iter().find(|note| note.contains("six radial")).unwrap();
    let stated: f64 = note.split("most ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    let mut most = 0.0_f64;
    for step in 1..1000 {
        let theta = 1.9 * f64::from(step) / 1000.0;
        let powers = terms.iter().zip(1..).map(|(term, i)| term * theta.powi(2 * i));
        let radius = 400.0 * theta * (1.0 + powers.sum::<f64>());
        if radius > 800.0 {
            break;
        }
        let shown = lens.bearing_to_pixel([lens.focal * theta.sin(), 0.0, theta.cos()]).unwrap();
        most = most.max((shown.u - 640.0 - radius).abs());
    }
    assert!(most <= stated + 1e-3 && stated <= 1.0 && most > 0.0, "{most} of {stated}");
    let error = colmap(&line(&terms, "0.001 0 0 0 0 0")).unwrap_err();
    assert!(error.contains("thin-prism") && error.contains("OPENCV_FISHEYE"), "{error}");
    assert!(colmap(&line(&terms, "0 0 0.0005 0 0 0")).is_err());
    assert!(colmap(&line(&terms, "1e-6 0 0 0 0 0")).is_ok());
}

#[test]
fn the_stated_error_of_the_fov_model_is_correct() {
    for omega in [0.3_f64, 0.9, 1.2] {
        let imported = colmap(&format!("FOV 1280 960 700 700 640 480 {omega}")).unwrap();
        let lens = only_lens(&imported);
        let note = imported.notes.iter().find(|note| note.contains("FOV")).unwrap();
        let stated: f64 = note.split("most ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
        let mut most = 0.0_f64;
        for step in 1..1000 {
            // COLMAP maps the pinhole radius r to atan(2 r tan(omega / 2)) / omega.
            let theta = 1.5 * f64::from(step) / 1000.0;
            let radius = 700.0 * (2.0 * theta.tan() * (omega / 2.0).tan()).atan() / omega;
            if radius > 800.0 {
                break;
            }
            let shown = lens.bearing_to_pixel([lens.focal * theta.sin(), 0.0, theta.cos()]).unwrap();
            most = most.max((shown.u - 640.0 - radius).abs());
        }
        assert!(most <= stated + 1e-3 && stated <= 1.0 && most > 0.0, "{omega}: {most} of {stated}");
    }
    assert_eq!(only_lens(&colmap("FOV 1280 960 700 700 640 480 0").unwrap()).distortion, Distortion::None);
    let error = colmap("FOV 1280 960 700 700 640 480 3.2").unwrap_err();
    assert!(error.contains("omega"), "{error}");
}

#[test]
fn shared_keys_of_nerfstudio_apply_to_every_frame() {
    let pose = json!([[1, 0, 0, 1.5], [0, 0, -1, 2.5], [0, 1, 0, 3.5], [0, 0, 0, 1]]);
    let frame = |path: &str| json!({"file_path": path, "transform_matrix": pose});
    let shared = json!({
        "camera_model": "OPENCV_FISHEYE", "w": 1280, "h": 960, "fl_x": 300.0, "fl_y": 300.0, "cx": 640, "cy": 480,
        "k1": 0.02, "k2": -0.01, "ply_file_path": "points.ply",
        "frames": [frame("images/a.png"), frame("images/b.png")],
    });
    let imported = read("nerfstudio", "transforms.json", &shared.to_string()).unwrap();
    assert!(imported.notes.iter().any(|note| note.contains("ply_file_path")), "{:?}", imported.notes);
    for (entry, id) in imported.site.cameras.iter().zip(["a", "b"]) {
        let camera = entry.camera().unwrap();
        assert_eq!(entry.id, id);
        assert_eq!(camera.lens.distortion, Distortion::KannalaBrandt { k: [0.02, -0.01, 0.0, 0.0] });
        assert!(camera.position.distance(WorldPoint::new(1.5, 2.5, 3.5)) < 1e-12);
        // Right is +x, up +z, back -y: level, looking along +y.
        assert!(camera.pitch.abs() + camera.roll.abs() + camera.yaw.abs() < 1e-12, "{camera:?}");
    }
    for (key, value, word) in [
        ("camera_model", json!("EQUIRECTANGULAR"), "OPENCV_FISHEYE"),
        ("p1", json!(0.01), "p1 and p2"),
        ("fl_x", json!("far"), "number"),
        ("frames", json!([{"file_path": "a.png"}]), "transform_matrix"),
        ("frames", json!([{"file_path": "a.png", "transform_matrix": [1, 2]}]), "four numbers"),
    ] {
        let mut other = shared.clone();
        other[key] = value;
        let error = read("nerfstudio", "transforms.json", &other.to_string()).unwrap_err();
        assert!(error.contains(word), "{error}");
    }
}
