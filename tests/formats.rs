//! Formats of other programs: an exported camera projects points as before, and its import restores the camera.

use calib_core::{BrownConrady, Camera, Covariance, Distortion, Extent, Lens, Pixel, WorldPoint};

use calib_formats::{Export, ExportOptions, FORMATS, File, Format, PlaneTreatment, export, format, import};
use calib_site::{Georeference, Method, Site, SiteCamera, Solution, Stage};
use calib_tests::{Scratch, peers_python};
use proptest::prelude::*;
use serde_json::{Value, json};

const SIZE: [u32; 2] = [1920, 1080];

fn any_camera() -> impl Strategy<Value = Camera> {
    let pose = (-50.0..50.0_f64, -50.0..50.0_f64, 2.0..8.0_f64, -3.1..3.1_f64, 0.2..1.4_f64, -0.6..0.6_f64);
    let centre = (900.0..1000.0_f64, 500.0..580.0_f64);
    (pose, 600.0..2500.0_f64, centre, any_distortion()).prop_map(
        |((x, y, z, yaw, pitch, roll), focal, (cu, cv), distortion)| {
            let lens = Lens {
                principal_point: Pixel::new(cu, cv),
                focal,
                pixel_aspect: 1.0,
                distortion,
                image_circle: None,
            };
            let position = WorldPoint { x, y, z };
            Camera { position, yaw, pitch, roll, focal, lens, covariance: Covariance::EXACT }
        },
    )
}

fn any_distortion() -> impl Strategy<Value = Distortion> {
    let brown = (-0.3..0.1_f64, -0.05..0.1_f64, -0.01..0.01_f64, -0.002..0.002_f64, -0.002..0.002_f64)
        .prop_map(|(k1, k2, k3, p1, p2)| Distortion::BrownConrady(BrownConrady { k1, k2, k3, p1, p2 }));
    let fisheye = [-0.05..0.05_f64, -0.02..0.02_f64, -0.01..0.01_f64, -0.001..0.001_f64]
        .prop_map(|k| Distortion::KannalaBrandt { k });
    prop_oneof![Just(Distortion::None), brown, fisheye]
}

/// Returns a solved site with one camera.
fn site(camera: &Camera) -> Site {
    let solution = Solution::from_camera(camera, Method::Given, Stage::Placed);
    let entry = SiteCamera { solution: Some(solution), ..SiteCamera::new("yard", SIZE) };
    Site { cameras: vec![entry], ..Site::new() }
}

/// Returns the site with a georeference if the format needs one.
fn placed(format: &Format, site: Site) -> Site {
    let georeference = Georeference { lat_deg: 50.0, lon_deg: 8.0, x_axis_azimuth_deg: 90.0, alt_m: None };
    Site { georeference: format.needs_georeference.then_some(georeference), ..site }
}

fn distorted() -> Camera {
    let brown = BrownConrady { k1: -0.25, k2: 0.06, k3: -0.004, p1: 0.001, p2: -0.0007 };
    Camera {
        position: WorldPoint::new(3.0, -4.0, 5.0),
        yaw: 0.3,
        pitch: 0.6,
        roll: 0.05,
        focal: 1250.0,
        lens: Lens {
            principal_point: Pixel::new(957.0, 548.0),
            focal: 1250.0,
            distortion: Distortion::BrownConrady(brown),
            image_circle: None,
            pixel_aspect: 1.0,
        },
        covariance: Covariance::EXACT,
    }
}

fn pinhole() -> Camera {
    let camera = distorted();
    Camera { lens: Lens::pinhole(camera.lens.principal_point), ..camera }
}

fn exported(name: &str, site: &Site, extension: &str) -> Export {
    let options = ExportOptions { extension: Some(extension.into()), ..ExportOptions::default() };
    export(format(name).unwrap(), site, &options).unwrap()
}

fn json_of(export: &Export, name: &str) -> Value {
    serde_json::from_slice(&export.files.iter().find(|file| file.name == name).unwrap().bytes).unwrap()
}

fn text_of<'a>(export: &'a Export, name: &str) -> &'a str {
    std::str::from_utf8(&export.files.iter().find(|file| file.name == name).unwrap().bytes).unwrap()
}

/// Returns the largest difference between the parameters of two lenses: coefficients, focal length, principal
/// point.
fn lens_difference(a: &Lens, a_focal: f64, b: &Lens, b_focal: f64) -> f64 {
    let coefficients = a.distortion.coefficients().into_iter().zip(b.distortion.coefficients());
    let most = coefficients.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    most.max((a_focal - b_focal).abs()).max(a.principal_point.distance(b.principal_point))
}

fn camera_difference(a: &Camera, b: &Camera) -> f64 {
    let rotations = a.rotation().concat().into_iter().zip(b.rotation().concat());
    rotations
        .map(|(a, b)| (a - b).abs())
        .fold(a.position.distance(b.position), f64::max)
        .max(lens_difference(&a.lens, a.focal, &b.lens, b.focal))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn import_of_an_export_returns_the_camera(camera in any_camera()) {
        let site = site(&camera);
        for (name, extension) in
            [("opencv", "json"), ("opencv", "yml"), ("opencv", "xml"), ("colmap", "txt"), ("ros", "yaml"),
             ("nerfstudio", "json"), ("nvidia", "json"), ("wildtrack", "xml")]
        {
            let export = exported(name, &site, extension);
            let plain = camera.lens.distortion == Distortion::None;
            let holds = plain || !matches!(name, "nvidia" | "wildtrack");
            prop_assert_eq!(export.losses.is_empty(), holds, "{}: {:?}", name, export.losses);
            let back = import(format(name).unwrap(), &export.files).unwrap().site;
            prop_assert_eq!(&back.cameras[0].id, "yard");
            prop_assert_eq!(back.cameras[0].size_px, SIZE);
            let mut expected = camera;
            if !holds {
                expected.lens = Lens::pinhole(camera.lens.principal_point);
            }
            if name == "ros" {
                let focal = back.cameras[0].lens.as_ref().unwrap().focal_px.unwrap();
                prop_assert!(focal.fixed);
                let off = lens_difference(&back.cameras[0].lens(), focal.value, &camera.lens, camera.focal);
                prop_assert!(off < 1e-9, "{name}: {off}");
            } else {
                let off = camera_difference(&back.cameras[0].camera().unwrap(), &expected);
                prop_assert!(off < 1e-9, "{name} {extension}: {off}");
            }
        }
    }

    #[test]
    fn projection_matrix_sign_does_not_matter(camera in any_camera(), sign in any::<bool>()) {
        let camera = Camera { lens: Lens::pinhole(camera.lens.principal_point), ..camera };
        let sign = if sign { 1.0 } else { -2.5 };
        let rows: String =
            camera.projection_matrix().concat().iter().map(|v| format!("- {}\n", v * sign)).collect();
        let file = File { name: "yard.yml".into(), bytes: format!("projectionMatrix_3x4_w2p:\n{rows}").into() };
        let back = import(format("nvidia").unwrap(), &[file]).unwrap().site.cameras[0].camera().unwrap();
        // The fourth column is the position times the focal length, so rounding costs more digits.
        prop_assert!(camera_difference(&back, &camera) < 1e-8);
    }

    #[test]
    fn lossless_lens_conversion_is_accurate(camera in any_camera(), lambda in -0.25..0.02_f64) {
        let lens = Lens { distortion: Distortion::Division { lambda }, ..camera.lens };
        let site = site(&Camera { lens, ..camera });
        let export = exported("opencv", &site, "json");
        let back = import(format("opencv").unwrap(), &export.files).unwrap().site;
        let fitted = back.cameras[0].lens.as_ref().unwrap().distortion.as_ref().unwrap().distortion().unwrap();
        let fitted = Lens { distortion: fitted, ..lens };
        if export.losses.is_empty() {
            for (u, v) in [(0.0, 0.0), (1920.0, 540.0), (960.0, 1080.0), (1500.0, 300.0), (1920.0, 1080.0)] {
                let Some(ray) = lens.undistort(Pixel::new(u, v)) else { continue };
                prop_assert!(fitted.distort(ray).unwrap().distance(Pixel::new(u, v)) < 0.06);
            }
        }
    }
}

/// Computes `x_camera = R X + t` from the rows of `[R | t]`.
fn in_camera(rt: &[[f64; 4]; 3], [x, y, z]: [f64; 3]) -> [f64; 3] {
    rt.map(|row| row[0] * x + row[1] * y + row[2] * z + row[3])
}

/// Distorts a point as documented for `cv2.projectPoints`.
fn opencv_distorted([x, y]: [f64; 2], d: &[f64]) -> [f64; 2] {
    let r2 = x * x + y * y;
    let radial = 1.0 + d[0] * r2 + d[1] * r2 * r2 + d[4] * r2 * r2 * r2;
    [
        x * radial + 2.0 * d[2] * x * y + d[3] * (r2 + 2.0 * x * x),
        y * radial + d[2] * (r2 + 2.0 * y * y) + 2.0 * d[3] * x * y,
    ]
}

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        other => vec![other.as_f64().unwrap_or_else(|| panic!("{other}"))],
    }
}

/// Returns points that the test cameras see.
fn scene(camera: &Camera) -> Vec<WorldPoint> {
    let pixels = [(300.0, 500.0), (960.0, 540.0), (1700.0, 900.0), (100.0, 1000.0), (1200.0, 700.0)];
    pixels
        .iter()
        .flat_map(|&(u, v)| {
            [0.0, 1.2].map(|h| camera.pixel_to_floor(Pixel { u, v }, h).map(|p| p.at_height(h)))
        })
        .flatten()
        .collect()
}

fn assert_near(found: [f64; 2], camera: &Camera, point: WorldPoint, shift: f64, who: &str) {
    let ours = camera.world_to_pixel(point).unwrap();
    let off = (found[0] - ours.u - shift).hypot(found[1] - ours.v - shift);
    assert!(off < 1e-6, "{who}: {off} px off at {point:?}");
}

/// Computes a rotation matrix by Rodrigues' formula.
fn rotation_of(v: &[f64]) -> [[f64; 3]; 3] {
    let angle = v.iter().map(|c| c * c).sum::<f64>().sqrt();
    let [x, y, z] = [v[0] / angle, v[1] / angle, v[2] / angle];
    let (s, c) = angle.sin_cos();
    let k = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
    let axis = [x, y, z];
    std::array::from_fn(|i| {
        std::array::from_fn(|j| f64::from(u8::from(i == j)) * c + s * k[i][j] + (1.0 - c) * axis[i] * axis[j])
    })
}

#[test]
fn opencv_projection_agrees_with_half_a_pixel_offset() {
    for camera in [distorted(), pinhole()] {
        let file = json_of(&exported("opencv", &site(&camera), "json"), "yard.json");
        let k = numbers(&file["camera_matrix"]["data"]);
        let d = numbers(&file["distortion_coefficients"]["data"]);
        let r = rotation_of(&numbers(&file["rvec"]["data"]));
        let t = numbers(&file["tvec"]["data"]);
        let rt = std::array::from_fn(|i| [r[i][0], r[i][1], r[i][2], t[i]]);
        for point in scene(&camera) {
            let [x, y, z] = in_camera(&rt, point.into());
            let [x, y] = opencv_distorted([x / z, y / z], &d);
            assert_near([k[0] * x + k[2], k[4] * y + k[5]], &camera, point, -0.5, "opencv");
        }
    }
}

#[test]
fn colmap_projection_agrees() {
    let camera = distorted();
    let export = exported("colmap", &site(&camera), "txt");
    let words = |name: &str| -> Vec<String> {
        let line = text_of(&export, name).lines().find(|line| !line.starts_with('#')).unwrap();
        line.split_whitespace().map(str::to_owned).collect()
    };
    let (lens, image) = (words("cameras.txt"), words("images.txt"));
    assert_eq!((lens[1].as_str(), image[9].as_str()), ("FULL_OPENCV", "yard.png"));
    let p: Vec<f64> = lens[4..].iter().map(|word| word.parse().unwrap()).collect();
    let q: Vec<f64> = image[1..8].iter().map(|word| word.parse().unwrap()).collect();
    for point in scene(&camera) {
        // v + 2 w (u x v) + 2 u x (u x v), with the quaternion (w, u).
        let v = <[f64; 3]>::from(point);
        let cross = |a: [f64; 3], b: [f64; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let u = [q[1], q[2], q[3]];
        let once = cross(u, v);
        let twice = cross(u, once);
        let [x, y, z]: [f64; 3] =
            std::array::from_fn(|i| v[i] + 2.0 * q[0] * once[i] + 2.0 * twice[i] + q[4 + i]);
        let d = [p[4], p[5], p[6], p[7], p[8]];
        let [x, y] = opencv_distorted([x / z, y / z], &d);
        assert_near([p[0] * x + p[2], p[1] * y + p[3]], &camera, point, 0.0, "colmap");
    }
}

#[test]
fn nerfstudio_and_blender_use_opengl_axes() {
    let camera = distorted();
    let frame = &json_of(&exported("nerfstudio", &site(&camera), "json"), "transforms.json")["frames"][0];
    let m = numbers(&frame["transform_matrix"]);
    let d: Vec<f64> = ["k1", "k2", "p1", "p2", "k3"].iter().map(|key| frame[key].as_f64().unwrap()).collect();
    let at = |key: &str| frame[key].as_f64().unwrap();
    for point in scene(&camera) {
        let from = [point.x - m[3], point.y - m[7], point.z - m[11]];
        let along = |j: usize| (0..3).map(|i| m[4 * i + j] * from[i]).sum::<f64>();
        let (right, up, back) = (along(0), along(1), along(2));
        assert!(back < 0.0, "visible points are in front");
        let [x, y] = opencv_distorted([right / -back, -up / -back], &d);
        assert_near(
            [at("fl_x") * x + at("cx"), at("fl_y") * y + at("cy")],
            &camera,
            point,
            0.0,
            "nerfstudio",
        );
    }
    let script = exported("blender", &site(&pinhole()), "py");
    assert!(text_of(&script, "cameras.py").contains("matrix_world"));
}

#[test]
fn scenescape_uses_camera_to_world_and_w_last() {
    let camera = distorted();
    let file = json_of(&exported("scenescape", &site(&camera), "json"), "cameras.json");
    let (q, c) = (numbers(&file[0]["rotation"]), numbers(&file[0]["translation"]));
    let (k, d) = (&file[0]["intrinsics"], &file[0]["distortion"]);
    let d: Vec<f64> = ["k1", "k2", "p1", "p2", "k3"].iter().map(|key| d[key].as_f64().unwrap()).collect();
    let [x, y, z, w] = [q[0], q[1], q[2], q[3]];
    let r = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ];
    for point in scene(&camera) {
        let from = [point.x - c[0], point.y - c[1], point.z - c[2]];
        let along = |j: usize| (0..3).map(|i| r[i][j] * from[i]).sum::<f64>();
        let [x, y] = opencv_distorted([along(0) / along(2), along(1) / along(2)], &d);
        let at = |key: &str| k[key].as_f64().unwrap();
        assert_near([at("fx") * x + at("cx"), at("fy") * y + at("cy")], &camera, point, -0.5, "scenescape");
    }
}

#[test]
fn exported_matrices_agree_with_the_camera() {
    let camera = pinhole();
    let bundle = json_of(&exported("nvidia", &site(&camera), "json"), "calibration.json");
    let row = json_of(&exported("table", &site(&camera), "json"), "cameras.json");
    let sensor = &bundle["sensors"][0];
    let matrices = [&sensor["cameraMatrix"], &row["cameras"][0]["undistorted_px_from_world"]];
    let homographies = [&sensor["homography"], &row["cameras"][0]["floor_from_undistorted_px"]];
    for point in scene(&camera) {
        let pixel = camera.world_to_pixel(point).unwrap();
        for p in matrices.map(numbers) {
            let w: Vec<f64> = (0..3)
                .map(|i| p[4 * i] * point.x + p[4 * i + 1] * point.y + p[4 * i + 2] * point.z + p[4 * i + 3])
                .collect();
            assert!(w[2] > 0.0, "positive in front");
            assert_near([w[0] / w[2], w[1] / w[2]], &camera, point, 0.0, "matrix");
        }
        if point.z == 0.0 {
            for h in homographies.map(numbers) {
                let w: Vec<f64> =
                    (0..3).map(|i| h[3 * i] * pixel.u + h[3 * i + 1] * pixel.v + h[3 * i + 2]).collect();
                assert!(w[2] > 0.0 && (w[0] / w[2] - point.x).hypot(w[1] / w[2] - point.y) < 1e-8);
            }
        }
    }
    assert!(sensor["imageCoordinates"].as_array().unwrap().len() >= 4);
    let attributes = sensor["attributes"].as_array().unwrap();
    assert!(attributes.iter().all(|attribute| attribute["value"].is_string()));
    assert!(attributes.iter().any(|a| a["value"].as_str().unwrap().starts_with("POLYGON((")));
}

/// Python script that prints the projected pixels of its points, one line per camera file.
const CV2: &str = "
import sys, json, cv2, numpy
points = numpy.array(json.loads(sys.argv[1]))
for name in sys.argv[2:]:
    file = cv2.FileStorage(name, cv2.FILE_STORAGE_READ)
    k, d, r, t = (file.getNode(key).mat() for key in ('camera_matrix', 'distortion_coefficients', 'rvec', 'tvec'))
    print(json.dumps(cv2.projectPoints(points, r, t, k, d)[0].reshape(-1, 2).tolist()))
";

#[test]
fn cv2_reads_every_file_storage_and_projects_equally() {
    let Some(python) = peers_python() else { return };
    let (scratch, camera) = (Scratch::new(), distorted());
    scratch.write("site.json", site(&camera).to_json());
    let names = ["yard.json", "yard.yml", "yard.xml"];
    for name in names {
        scratch.calib(&["export", "opencv", "site.json", "-o", name]).expect_code(0);
    }
    let points = scene(&camera);
    let mut command = std::process::Command::new(python);
    command.arg("-c").arg(CV2).arg(json!(points).to_string()).args(names.map(|name| scratch.path(name)));
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let lines: Vec<Vec<[f64; 2]>> = String::from_utf8_lossy(&output.stdout)
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert_eq!(lines.len(), names.len());
    for (point, pixel) in lines.iter().flat_map(|line| points.iter().zip(line)) {
        assert_near(*pixel, &camera, *point, -0.5, "cv2");
    }
}

/// Camera published with NVIDIA's calibration tool: intrinsics, extrinsics and projection matrix.
const GOLDEN_K: [[f64; 3]; 3] =
    [[1_269.005_115_844_92, 0.0, 960.0], [0.0, 1_269.005_115_844_919_4, 540.0], [0.0, 0.0, 1.0]];
const GOLDEN_RT: [[f64; 4]; 3] = [
    [0.999_994_149_974_386_3, 0.002_025_807_353_941_812_7, 0.002_756_106_233_319_78, 7.506_433_779_240_641],
    [0.003_291_497_863_828_7, -0.350_683_784_262_817_5, -0.936_488_147_013_576_3, 1.200_289_074_530_320_7],
    [-0.000_930_622_811_368_523_9, 0.936_491_740_251_709, -0.350_688_400_694_275_26, 11.111_379_874_347_342],
];
const GOLDEN_P: [f64; 12] = [
    1_268.104_294_233_574_6,
    901.602_830_537_508_9,
    -333.163_351_756_609_36,
    20_192.627_546_980_937,
    3.674_391_309_852_344,
    60.686_023_462_551_134,
    -1_377.779_985_863_266_7,
    7_523.318_108_219_307,
    -0.000_930_622_811_368_523_9,
    0.936_491_740_251_709,
    -0.350_688_400_694_275_26,
    11.111_379_874_347_342,
];

fn golden() -> File {
    let size = json!([{"name": "frameWidth", "value": "1920"}, {"name": "frameHeight", "value": "1080"}]);
    let sensor = json!({"type": "camera", "id": "Camera_01", "intrinsicMatrix": GOLDEN_K,
        "extrinsicMatrix": GOLDEN_RT, "attributes": size});
    let document = json!({"version": "1.0", "sensors": [sensor]});
    File { name: "calibration.json".into(), bytes: document.to_string().into_bytes() }
}

#[test]
fn published_nvidia_camera_is_read_and_written() {
    let site = import(format("nvidia").unwrap(), &[golden()]).unwrap().site;
    let camera = site.cameras[0].camera().unwrap();
    assert!(camera.position.distance(WorldPoint::new(-7.5, -10.0, 5.0)) < 1e-4, "{:?}", camera.position);
    let foot = WorldPoint::new(-7.822_655_677_795_41, 4.598_347_663_879_394_5, 0.0);
    assert!(camera.world_to_pixel(foot).unwrap().distance(Pixel::new(934.75, 503.96)) < 0.0075);
    let floor = camera.pixel_to_floor(Pixel::new(933.5, 507.0), 0.0).unwrap();
    assert!((floor.x + 7.835).hypot(floor.y - 4.485) < 1e-3, "{floor:?}");
    assert_eq!(camera.pixel_to_floor(Pixel::new(960.0, 10.0), 0.0), None, "above the horizon");
    let export = exported("nvidia", &site, "json");
    let text = text_of(&export, "camInfo/Camera_01.yml");
    let p: Vec<f64> =
        text.lines().skip(1).take(12).map(|l| l.trim_start_matches("- ").parse().unwrap()).collect();
    for (found, published) in p.iter().zip(GOLDEN_P) {
        // The published rotation has single precision. Making it orthogonal causes changes of this size.
        assert!((found - published).abs() < 1e-6 * (1.0 + published.abs()), "{found} {published}");
    }
    assert!(text.contains("modelInfo:\n  - classID: 0\n"));
}

#[test]
fn ros_sample_is_read() {
    let text = "image_width: 640\nimage_height: 480\ncamera_name: front\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [516.385667640757, 0, 339.167079537312, 0, 516.385667640757, 227.37993524141, 0, 0, 1]\ndistortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.331416226762003, 0.143584747015566, 0.00314558656668844, -0.00393597842852019, 0]\n";
    let file = File { name: "front.yaml".into(), bytes: text.into() };
    let site = import(format("ros").unwrap(), &[file]).unwrap().site;
    let lens = site.cameras[0].lens();
    assert!(lens.principal_point.distance(Pixel::new(339.667_079_537_312, 227.879_935_241_41)) < 1e-12);
    let brown = BrownConrady {
        k1: -0.331_416_226_762_003,
        k2: 0.143_584_747_015_566,
        k3: 0.0,
        p1: 0.003_145_586_566_688_44,
        p2: -0.003_935_978_428_520_19,
    };
    assert_eq!(lens.distortion, Distortion::BrownConrady(brown));
}

#[test]
fn headers_and_tags_of_all_opencv_versions_are_read() {
    let body = "camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 1100., 0., 960., 0., 1100., 540., 0., 0., 1. ]\ndist_coeffs: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   data: [ -0.31, 0.11, 4.0e-04, -2.0e-04, 0. ]\n";
    for head in ["%YAML:1.0\n---\n", "%YAML 1.2\n---\n", "%YAML:1.0\n", "---\n", ""] {
        for body in [body.to_owned(), body.replace(" !!opencv-matrix", "")] {
            let file = File { name: "lens.yml".into(), bytes: format!("{head}{body}").into_bytes() };
            let site = import(format("opencv").unwrap(), &[file])
                .unwrap_or_else(|error| panic!("{head:?}: {error}"))
                .site;
            assert_eq!(site.cameras[0].size_px, [1921, 1081], "twice the centre");
            assert_eq!(site.cameras[0].lens().principal_point, Pixel::new(960.5, 540.5));
        }
    }
}

#[test]
fn kalibr_and_caliscope_lenses_are_read() {
    let kalibr = "cam0:\n  camera_model: pinhole\n  intrinsics: [461.6, 461.6, 362.7, 248.1]\n  distortion_model: radtan\n  distortion_coeffs: [-0.28, 0.07, 0.0001, 1.7e-05]\n  resolution: [752, 480]\n  rostopic: /cam0/image_raw\n";
    let caliscope = "[cam_0]\nname = \"left\"\nsize = [1280, 720]\nmatrix = [[900.0, 0.0, 640.0], [0.0, 900.0, 360.0], [0.0, 0.0, 1.0]]\ndistortions = [-0.2, 0.05, 0.0, 0.0, 0.0]\nrotation = [0.1, 0.0, 0.0]\ntranslation = [0.0, 0.0, 0.0]\nfisheye = false\n\n[metadata]\nadjusted = false\nerror = 0.0\n";
    for (name, file, text, id) in
        [("kalibr", "camchain.yaml", kalibr, "cam0"), ("caliscope", "config.toml", caliscope, "left")]
    {
        let file = File { name: file.into(), bytes: text.into() };
        let site = import(format(name).unwrap(), &[file]).unwrap().site;
        assert_eq!(site.cameras[0].id, id);
        assert!(matches!(site.cameras[0].lens().distortion, Distortion::BrownConrady(b) if b.k1 < -0.1));
    }
}

#[test]
fn fspy_project_is_read() {
    let camera = Camera { lens: Lens::pinhole(Pixel::new(940.0, 560.0)), ..pinhole() };
    let [right, down, forward] = camera.rotation();
    let centre = <[f64; 3]>::from(camera.position);
    let row = |i: usize| [right[i], -down[i], -forward[i], centre[i]];
    let state = json!({"cameraParameters": {
        "principalPoint": {"x": (940.0 - 960.0) / 960.0, "y": (540.0 - 560.0) / 960.0},
        "horizontalFieldOfView": 2.0 * (960.0 / camera.focal).atan(),
        "cameraTransform": {"rows": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]},
        "imageWidth": 1920, "imageHeight": 1080,
    }});
    let state = state.to_string();
    let mut bytes = b"fspy\x01\x00\x00\x00".to_vec();
    bytes.extend((state.len() as u32).to_le_bytes());
    bytes.extend(3_u32.to_le_bytes());
    bytes.extend(state.as_bytes());
    bytes.extend(b"img");
    let file = File { name: "yard.fspy".into(), bytes };
    let site = import(format("fspy").unwrap(), &[file]).unwrap().site;
    let expected = Camera { lens: Lens { focal: camera.focal, ..camera.lens }, ..camera };
    assert!(camera_difference(&site.cameras[0].camera().unwrap(), &expected) < 1e-9);
    // The camera parameters as fSpy exports them, and its whole state.
    let whole: Value = serde_json::from_str(&state).unwrap();
    for (name, json) in [("parameters.json", &whole["cameraParameters"]), ("state.json", &whole)] {
        let file = File { name: name.into(), bytes: json.to_string().into_bytes() };
        let site = import(format("fspy").unwrap(), &[file]).unwrap().site;
        assert!(camera_difference(&site.cameras[0].camera().unwrap(), &expected) < 1e-9, "{name}");
    }
}

#[test]
fn rescaled_export_has_scaled_intrinsics() {
    let camera = pinhole();
    let options = ExportOptions { rescale: Some([960, 360]), ..ExportOptions::default() };
    let export = export(format("opencv").unwrap(), &site(&camera), &options).unwrap();
    let k = numbers(&json_of(&export, "yard.json")["camera_matrix"]["data"]);
    let ours = camera.lens.principal_point;
    assert!((k[0] - camera.focal / 2.0).abs() + (k[4] - camera.focal / 3.0).abs() < 1e-9);
    assert!((k[2] - (ours.u / 2.0 - 0.5)).abs() + (k[5] - (ours.v / 3.0 - 0.5)).abs() < 1e-12);
}

#[test]
fn rectified_export_contains_the_remap_table() {
    let camera = distorted();
    let options = ExportOptions { rectified: true, rescale: Some([480, 270]), ..ExportOptions::default() };
    let export = export(format("nvidia").unwrap(), &site(&camera), &options).unwrap();
    assert_eq!(export.losses, []);
    let map = export.files.iter().find(|file| file.name == "yard.remap.npy").unwrap();
    let length = usize::from(u16::from_le_bytes([map.bytes[8], map.bytes[9]])) + 10;
    assert_eq!((length % 64, map.bytes.len()), (0, length + 480 * 270 * 8));
    let p = numbers(&json_of(&export, "calibration.json")["sensors"][0]["cameraMatrix"]);
    for point in scene(&camera) {
        let row =
            |i: usize| p[4 * i] * point.x + p[4 * i + 1] * point.y + p[4 * i + 2] * point.z + p[4 * i + 3];
        // The nearest pixel of the rectified image, and the raw pixel in the map.
        let [x, y] = [row(0) / row(2), row(1) / row(2)].map(f64::floor);
        if !(0.0..480.0).contains(&x) || !(0.0..270.0).contains(&y) {
            continue;
        }
        let at = length + (y as usize * 480 + x as usize) * 8;
        let read = |at: usize| f64::from(f32::from_le_bytes(map.bytes[at..at + 4].try_into().unwrap()));
        let raw = camera.world_to_pixel(point).unwrap();
        let off = (read(at) + 0.5 - raw.u / 4.0).hypot(read(at + 4) + 0.5 - raw.v / 4.0);
        assert!(off < 1.5, "{off} px");
    }
}

#[test]
fn lossy_exports_are_refused_unless_allowed() {
    let scratch = Scratch::new();
    for format in FORMATS.iter().filter(|format| format.can_export()) {
        let site = placed(format, site(&distorted()));
        scratch.write("distorted.json", site.to_json());
        let export = exported(format.name, &site, format.extensions[0]);
        let folder = format!("out-{}", format.name);
        let ended = scratch.calib(&["export", format.name, "distorted.json", "-o", &folder]);
        if export.losses.is_empty() {
            ended.expect_code(0);
        } else {
            let ended = ended.expect_code(5);
            assert!(ended.stderr.contains("distortion") && ended.stderr.contains("yard"), "{}", ended.stderr);
            assert!(!scratch.path(&folder).exists(), "{}: a refused export writes no file", format.name);
            scratch
                .calib(&["export", format.name, "distorted.json", "-o", &folder, "--allow-lossy"])
                .expect_code(0);
        }
        for file in &export.files {
            assert!(scratch.path(&folder).join(&file.name).exists(), "{}", file.name);
        }
        let flat = format!("flat-{}", format.name);
        let rectified =
            ["export", format.name, "distorted.json", "-o", &flat, "--rectified", "--rescale", "480x270"];
        scratch.calib(&rectified).expect_code(0);
        assert!(scratch.path(&flat).join("yard.remap.npy").exists());
        scratch.calib(&rectified).expect_code(1);
    }
    for name in ["nvidia", "wildtrack", "sql", "blender"] {
        let export = exported(name, &site(&distorted()), format(name).unwrap().extensions[0]);
        assert!(!export.losses.is_empty(), "{name} does not support distortion");
    }
}

/// Writes a site file into a new scratch folder.
fn scratch_of(site: &Site) -> Scratch {
    let scratch = Scratch::new();
    scratch.write("site.json", site.to_json());
    scratch
}

/// Formats the registry as a Markdown table.
fn table() -> String {
    let mut text = String::from(
        "| format | export | import | pixel origin | units | axes | contains | does not contain | ignored by import |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    for format in FORMATS {
        let yes = |is: bool| if is { "yes" } else { "" };
        let cells = [
            &format!("`{}`", format.name),
            yes(format.can_export()),
            yes(format.can_import()),
            format.pixels,
            format.units,
            format.axes,
            format.contains,
            format.lacks,
            format.ignored_by_import,
        ];
        text += &format!("| {} |\n", cells.join(" | "));
    }
    text
}

#[test]
fn readme_table_matches_the_registry() {
    let readme = std::fs::read_to_string(calib_tests::root().join("crates/calib-formats/README.md")).unwrap();
    assert!(readme.contains(&table()), "the table should be\n{}", table());
}

#[test]
fn stretched_export_needs_permission() {
    let scratch = Scratch::new();
    for format in FORMATS.iter().filter(|format| format.can_export()) {
        scratch.write("site.json", placed(format, site(&pinhole())).to_json());
        let folder = format!("out-{}", format.name);
        let args = ["export", format.name, "site.json", "-o", &folder, "--rescale", "640x640"];
        let run = scratch.calib(&args).expect_code(5);
        assert!(run.stderr.contains("1920 x 1080") && run.stderr.contains("640 x 640"), "{}", run.stderr);
        scratch.calib(&[&args[..], &["--allow-lossy"]].concat()).expect_code(0);
        // After rounding to whole pixels, the aspect ratio counts as equal.
        let same = format!("same-{}", format.name);
        scratch
            .calib(&["export", format.name, "site.json", "-o", &same, "--rescale", "1000x562"])
            .expect_code(0);
    }
}

#[test]
fn sql_file_and_refusal_state_the_same_error() {
    let scratch = scratch_of(&site(&distorted()));
    let export = exported("sql", &site(&distorted()), "sql");
    let text = text_of(&export, "floor.sql");
    let said = text.lines().find_map(|line| line.split_once("at most ")).unwrap().1;
    let pixels: f64 = said.split(' ').next().unwrap().parse().unwrap();
    assert!(pixels > 0.0, "{said}");
    // The comment in the file and the refusal contain the same number.
    let run = scratch.calib(&["export", "sql", "site.json", "-o", "out"]);
    assert!(run.stderr.contains(&format!("at most {pixels:.3} px")), "{}", run.stderr);
}

/// Coefficients of `floor.sql`, evaluated like an SQL engine.
struct SqlView {
    numbers: Vec<f64>,
    /// Largest errors stated in the file: in pixels, and in metres within the EFOV.
    stated: [f64; 2],
}

impl SqlView {
    fn of(text: &str) -> Self {
        let row = text.lines().find_map(|line| line.trim().strip_prefix("('yard', ")).unwrap();
        let numbers =
            row.trim_end_matches(['(', ')']).split(", ").map(|cell| cell.parse().unwrap()).collect();
        let said = text.lines().find_map(|line| line.split_once("at most "));
        let stated = said.map_or([0.0; 2], |(_, said)| {
            let mut words = said.split(' ');
            [0, 2].map(|skip| words.nth(skip).unwrap().parse().unwrap())
        });
        Self { numbers, stated }
    }

    /// Maps a pixel to the undistorted image and to the floor.
    fn map(&self, pixel: Pixel) -> Option<([f64; 2], [f64; 2])> {
        let [cx, cy, fx, fy, d1, d2, d3] = self.numbers[..7].try_into().unwrap();
        let (a, b) = ((pixel.u - cx) / fx, (pixel.v - cy) / fy);
        let square: f64 = a * a + b * b;
        let q = 1.0 + square * (d1 + square * (d2 + square * d3));
        let row = |i: usize| {
            let g = &self.numbers[7 + 3 * i..];
            g[0] * a + g[1] * b + g[2] * q
        };
        let [x, y, w] = [row(0), row(1), row(2)];
        (q > 0.0 && w > 0.0).then_some(([cx + fx * a / q, cy + fy * b / q], [x / w, y / w]))
    }
}

/// Returns quasi-random pixels over the image, different from the sample points of the export.
fn quasi_random_pixels() -> impl Iterator<Item = Pixel> {
    const COUNT: u32 = 20_000;
    // Every second pixel is on the border, where a fit is worst.
    (0..COUNT).map(|i| {
        let [s, t] =
            [0.754_877_666_246_693, 0.569_840_290_998_053].map(|step| (0.31 + step * f64::from(i)).fract());
        let [s, t] = match i % 8 {
            0 => [s, 0.0],
            2 => [s, 1.0],
            4 => [0.0, t],
            6 => [1.0, t],
            _ => [s, t],
        };
        Pixel::new(s * f64::from(SIZE[0]), t * f64::from(SIZE[1]))
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn sql_error_is_within_the_stated_maximum(camera in any_camera()) {
        let site = site(&camera);
        let efov = site.efov_on_floor(&site.cameras[0]);
        let extent = Extent { size: SIZE.map(f64::from), efov: &efov };
        let view = SqlView::of(text_of(&exported("sql", &site, "sql"), "floor.sql"));
        let (mut most, mut within) = ([0.0_f64; 2], 0);
        for pixel in quasi_random_pixels() {
            let Some(straight) = camera.undistort(pixel) else { continue };
            let Some((undistorted, floor)) = view.map(pixel) else { continue };
            let pixels = (undistorted[0] - straight.u).hypot(undistorted[1] - straight.v);
            most[0] = most[0].max(pixels);
            let Some(exact) = camera.pixel_to_floor(pixel, 0.0).filter(|&at| extent.contains(at)) else { continue };
            most[1] = most[1].max((floor[0] - exact.x).hypot(floor[1] - exact.y));
            within += 1;
        }
        prop_assert!(within > 0 || efov.is_empty(), "no pixel is within the EFOV");
        // The view computes with doubles, so only rounding is added to the stated error.
        let stated = view.stated.map(|stated| stated + 1e-9);
        prop_assert!(most[0] <= stated[0] && most[1] <= stated[1], "{:?}, stated {:?}", most, view.stated);
    }
}

#[test]
fn nvidia_export_refuses_ids_that_are_not_file_names() {
    let mut site = site(&pinhole());
    site.cameras[0].id = "hall/2".into();
    let scratch = scratch_of(&site);
    let run = scratch.calib(&["export", "nvidia", "site.json", "-o", "out"]).expect_code(2);
    assert!(run.stderr.contains("hall/2") && !scratch.path("out").exists(), "{run:?}");
    site.cameras[0].id = "hall-2".into();
    scratch.write("site.json", site.to_json());
    scratch.calib(&["export", "nvidia", "site.json", "-o", "out"]).expect_code(0);
    assert!(scratch.path("out/camInfo/hall-2.yml").exists());
}

#[test]
fn svg_export_to_a_file_embeds_the_plan() {
    let mut site = site(&pinhole());
    site.plan = Some(calib_site::Plan {
        page: None,
        layers: None,
        image: Some("plan.png".into()),
        metres_per_px: 0.1,
        origin_px: Default::default(),
        x_axis_deg: 0.0,
        georeference: None,
    });
    let scratch = scratch_of(&site);
    image::RgbImage::new(40, 30).save(scratch.path("plan.png")).unwrap();
    scratch.calib(&["export", "svg", "site.json", "-o", "one.svg"]).expect_code(0);
    let drawing = std::fs::read_to_string(scratch.path("one.svg")).unwrap();
    assert!(drawing.contains("href=\"data:image/png;base64,") && !drawing.contains("plan.png"));
    scratch.calib(&["export", "svg", "site.json", "-o", "folder"]).expect_code(0);
    assert!(scratch.path("folder/plan.png").exists());
    let drawing = std::fs::read_to_string(scratch.path("folder/site.svg")).unwrap();
    assert!(drawing.contains("href=\"plan.png\""));
}

#[test]
fn geojson_describes_its_fields() {
    let mut site = site(&pinhole());
    let document = json_of(&exported("geojson", &site, "geojson"), "site.local.geojson");
    let said = document["fields"]["heading_deg"].as_str().unwrap();
    assert!(said.contains("counter-clockwise from +x"), "{said}");
    site.georeference =
        Some(Georeference { lat_deg: 50.0, lon_deg: 8.0, x_axis_azimuth_deg: 90.0, alt_m: None });
    let document = json_of(&exported("geojson", &site, "geojson"), "site.geojson");
    assert!(document["fields"]["azimuth_deg"].as_str().unwrap().contains("clockwise from north"));
}

#[test]
fn import_reports_ignored_keys_and_merges_into_a_site() {
    let scratch = scratch_of(&site(&pinhole()));
    scratch.calib(&["export", "nvidia", "site.json", "-o", "out"]).expect_code(0);
    let path = scratch.path("out/calibration.json");
    let mut document: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    document["sensors"][0]["tripwires"] = json!([{"id": "gate", "wire": [[1, 2], [3, 4]]}]);
    std::fs::write(&path, document.to_string()).unwrap();
    let run = scratch.calib(&["import", "nvidia", "out/calibration.json"]).expect_code(0);
    let said = run.stderr.lines().find(|line| line.contains("not imported")).unwrap();
    assert!(
        said.contains("calibration.json: not imported: ") && said.contains("sensors/*/tripwires"),
        "{said}"
    );
    assert!(
        !said.contains("intrinsicMatrix") && !said.contains("rois"),
        "imported and empty keys are not listed: {said}"
    );
    assert!(run.stderr.contains("--into"), "{}", run.stderr);
    // A site with annotations for this camera, and another camera.
    let mut drawn = site(&pinhole());
    drawn.cameras[0].solution = None;
    drawn.cameras[0].annotations =
        serde_json::from_value(json!([{"kind": "vertical", "segments": [[[1, 2], [1, 90]]]}])).unwrap();
    drawn.cameras.push(SiteCamera::new("gate", [640, 480]));
    scratch.write("drawn.json", drawn.to_json());
    let merge = ["import", "nvidia", "out/calibration.json", "--into", "drawn.json"];
    let run = scratch.calib(&merge).expect_code(3);
    assert!(
        run.stderr.contains("already has camera \"yard\"") && run.stderr.contains("--replace"),
        "{}",
        run.stderr
    );
    let run = scratch.calib(&[&merge[..], &["--replace"]].concat()).expect_code(0);
    let merged = Site::from_json(&run.stdout).unwrap();
    let ids: Vec<&str> = merged.cameras.iter().map(|camera| camera.id.as_str()).collect();
    assert_eq!(ids, ["yard", "gate"]);
    assert_eq!(merged.cameras[0].annotations.len(), 1, "annotations are kept");
    assert!(camera_difference(&merged.cameras[0].camera().unwrap(), &pinhole()) < 1e-6);
    // A new camera is added. An image of another size is refused, because the annotations would not fit.
    let gate = Site { cameras: vec![drawn.cameras[1].clone()], ..Site::new() };
    scratch.write("drawn.json", gate.to_json());
    let run = scratch.calib(&merge).expect_code(0);
    assert_eq!(Site::from_json(&run.stdout).unwrap().cameras.len(), 2);
    drawn.cameras[0].size_px = [640, 480];
    drawn.cameras[0].annotations.clear();
    scratch.write("drawn.json", drawn.to_json());
    let run = scratch.calib(&[&merge[..], &["--replace"]].concat()).expect_code(3);
    assert!(run.stderr.contains("640 x 480"), "{}", run.stderr);
    // A floor plan is merged, too.
    scratch.write("hall.pgw", "0.05\n0\n0\n-0.05\n0\n0\n");
    let run = scratch.calib(&["import", "worldfile", "hall.pgw", "--into", "site.json"]).expect_code(0);
    let merged = Site::from_json(&run.stdout).unwrap();
    assert_eq!((merged.cameras.len(), merged.plan.unwrap().metres_per_px), (1, 0.05));
}

#[test]
fn command_line_round_trip() {
    let scratch = Scratch::new();
    scratch.write("site.json", site(&distorted()).to_json());
    scratch.calib(&["export", "opencv", "site.json", "-o", "yard.yml"]).expect_code(0);
    let back = scratch.calib(&["import", "opencv", "yard.yml"]).expect_code(0).json();
    assert_eq!(back["cameras"][0]["solution"]["method"], "given");
    scratch.calib(&["export", "colmap", "site.json", "-o", "model"]).expect_code(0);
    scratch.calib(&["import", "colmap", "model", "-o", "back.json"]).expect_code(0);
    let back = Site::from_json(&scratch.read_json("back.json").to_string()).unwrap();
    assert!(camera_difference(&back.cameras[0].camera().unwrap(), &distorted()) < 1e-9);
    let pixel = scratch
        .calib_with(&["project", "back.json", "--camera", "yard", "--to", "pixel"], "x_m,y_m,z_m\n1,2,0\n")
        .expect_code(0);
    assert!(pixel.stdout.lines().nth(1).unwrap().starts_with("1,2,0,"), "{}", pixel.stdout);
    scratch.calib(&["export", "obj", "site.json", "-o", "x"]).expect_code(2);
    scratch.calib(&["export", "opencv", "site.json", "-o", "x", "--rescale", "9"]).expect_code(2);
    scratch.calib(&["export", "opencv", "site.json", "-o", "x", "--file-type", "png"]).expect_code(2);
    let broken = scratch.calib(&["import", "ros", "site.json"]).expect_code(3);
    assert!(broken.stderr.contains("camera_matrix"), "{}", broken.stderr);
}

#[test]
fn zones_contain_the_lengths_of_their_sides() {
    let mut site = site(&pinhole());
    let corners = [[300.0, 1000.0], [1700.0, 1000.0], [1400.0, 600.0], [500.0, 600.0]].map(Pixel::from);
    site.cameras[0].efov_px = Some(corners.to_vec());
    let text = exported("frigate", &site, "yml");
    let text = text_of(&text, "zones.yml");
    let list = |key: &str| -> Vec<f64> {
        let line = text.lines().find(|line| line.trim_start().starts_with(key)).unwrap();
        line.split_once(": ").unwrap().1.split(',').map(|n| n.parse().unwrap()).collect()
    };
    let floor = corners.map(|corner| pinhole().pixel_to_floor(corner, 0.0).unwrap());
    for (i, side) in list("distances").iter().enumerate() {
        assert!((side - floor[i].distance(floor[(i + 1) % 4])).abs() < 0.006);
    }
    assert_eq!(list("coordinates").len(), 8);
    let analytics = exported("nvdsanalytics", &site, "txt");
    let roi = "roi-floor=300;1000;1700;1000;1400;600;500;600";
    assert!(text_of(&analytics, "nvdsanalytics.txt").contains(roi));
}

#[test]
fn georeferenced_coordinates_are_correct() {
    let mut site = site(&pinhole());
    let name = |site: &Site| exported("geojson", site, "geojson").files[0].name.clone();
    assert_eq!(name(&site), "site.local.geojson");
    // World +x points east: the camera is 3 m east and 4 m south of the origin.
    site.georeference = Some(
        serde_json::from_value(json!({"lat_deg": 52.0, "lon_deg": 5.0, "x_axis_azimuth_deg": 90.0})).unwrap(),
    );
    let document = json_of(&exported("geojson", &site, "geojson"), "site.geojson");
    let camera =
        document["features"].as_array().unwrap().iter().find(|f| f["properties"]["kind"] == "camera");
    let at = numbers(&camera.unwrap()["geometry"]["coordinates"]);
    // At a latitude of 52 degrees, one degree of latitude is 111.267 km and one of longitude 68.678 km.
    assert!(((at[0] - 5.0) * 68_678.0 - 3.0).abs() < 1e-3, "{at:?}");
    assert!(((at[1] - 52.0) * 111_267.0 + 4.0).abs() < 1e-3, "{at:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn corrupt_file_is_an_error_with_its_place(cut in 0.0..1.0_f64, byte in any::<u8>(), at in 0.0..1.0_f64) {
        for format in FORMATS.iter().filter(|format| format.can_export() && format.can_import()) {
            let site = placed(format, site(&distorted()));
            for extension in format.extensions {
                let files = exported(format.name, &site, extension).files;
                let share = |length: usize, share: f64| (length as f64 * share) as usize;
                let changed = |change: &dyn Fn(&mut Vec<u8>)| -> Vec<File> {
                    let mut files = files.clone();
                    files.iter_mut().for_each(|file| change(&mut file.bytes));
                    files
                };
                let short = changed(&|bytes| bytes.truncate(share(bytes.len(), cut)));
                let other = changed(&|bytes| { let i = share(bytes.len() - 1, at); bytes[i] = byte; });
                for files in [short, other] {
                    if let Err(error) = import(format, &files) {
                        prop_assert!(!error.place.is_empty() && !error.message().is_empty());
                        prop_assert!(error.to_string().len() < 1000, "{error}");
                    }
                }
            }
        }
    }
}

#[test]
fn hostile_files_are_errors() {
    let deep = "[".repeat(100_000);
    let bomb = (0..30).fold("a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n".to_owned(), |text, i| {
        let list = vec![format!("*a{i}"); 10].join(", ");
        format!("{text}a{}: &a{} [{list}]\n", i + 1, i + 1)
    });
    let entities =
        "<?xml version=\"1.0\"?><!DOCTYPE a [<!ENTITY b \"bbbbbbbb\"><!ENTITY c \"&b;&b;&b;\">]><a>&c;</a>";
    let huge = "1e999999 ".repeat(1000);
    let texts = [
        "",
        "{}",
        "[]",
        "null",
        "\u{0}",
        "cam0: {intrinsics: [.nan, .inf, 1, 1]}",
        "[cam]\nmatrix = 7\nsize = []\n",
        "{\"sensors\": [{\"id\": 7}]}",
        "{\"sensors\": {}}",
        "<a><b/></a>",
        "{\"camera_matrix\": {\"data\": [0,0,0,0,0,0,0,0,0]}}",
        "{\"camera_matrix\": {\"data\": [1e9,0,1e300,0,1e9,0,0,0,1]}}",
        "fspy\u{1}\u{0}\u{0}\u{0}\u{7f}\u{7f}\u{7f}\u{7f}0000{}",
        &deep,
        &bomb,
        entities,
        &huge,
        "1 PINHOLE 0 99999999999 nan inf 3\n",
    ];
    for format in FORMATS.iter().filter(|format| format.can_import()) {
        for text in texts {
            for name in ["cameras.txt", "intr_a.xml", "a.json", "a.yml"] {
                let file = |name: &str| File { name: name.into(), bytes: text.as_bytes().to_vec() };
                let files = [file(name), file("images.txt"), file("extr_a.xml")];
                let error = import(format, &files).unwrap_err();
                assert!(error.to_string().len() < 1000, "{}: {error}", format.name);
            }
        }
        assert!(import(format, &[]).is_err());
        let binary = File { name: "a.bin".into(), bytes: vec![0xFF; 100] };
        assert!(import(format, &[binary]).is_err());
    }
}

#[test]
fn unplaced_camera_is_reported_and_periods_are_separate() {
    let placed = site(&pinhole()).cameras.remove(0);
    let mut loose = SiteCamera { id: "loose".into(), ..placed.clone() };
    loose.solution.as_mut().unwrap().stage = Stage::Partial;
    let both = Site { cameras: vec![placed.clone(), loose.clone()], ..Site::new() };
    for name in ["nvidia", "opencv", "geojson", "table", "blender"] {
        let export = export(format(name).unwrap(), &both, &ExportOptions::default()).unwrap();
        let lost: Vec<&str> = export.losses.iter().filter_map(|loss| loss.camera.as_deref()).collect();
        assert_eq!(lost, ["loose"], "{name}");
    }
    let alone = Site { cameras: vec![loose], ..Site::new() };
    assert_eq!(export(format("opencv").unwrap(), &alone, &ExportOptions::default()).unwrap().losses, []);

    let before = SiteCamera { valid_to: Some("2026-05-01T00:00:00Z".into()), ..placed.clone() };
    let after = SiteCamera { valid_from: Some("2026-05-01T00:00:00Z".into()), ..placed };
    let periods = Site { cameras: vec![before, after], ..Site::new() };
    let error = export(format("frigate").unwrap(), &periods, &ExportOptions::default()).unwrap_err();
    assert!(error.to_string().contains("several periods"), "{error}");
    let rows = json_of(&exported("table", &periods, "json"), "cameras.json");
    assert_eq!(rows["cameras"].as_array().unwrap().len(), 2);
}

#[test]
fn regions_are_numbered_by_stream() {
    let placed = site(&pinhole()).cameras.remove(0);
    let dark = SiteCamera { id: "dark".into(), solution: None, ..placed.clone() };
    let both = Site { cameras: vec![dark, placed], ..Site::new() };
    let text = exported("nvdsanalytics", &both, "txt");
    assert!(text_of(&text, "nvdsanalytics.txt").contains("[roi-filtering-stream-1]"));
}

#[test]
fn pycolmap_and_pyyaml_read_exports() {
    let Some(python) = peers_python() else { return };
    let scratch = Scratch::new();
    let (distorted, straight) = (distorted(), pinhole());
    for (name, camera, extension) in [
        ("colmap", &distorted, "txt"),
        ("ros", &distorted, "yaml"),
        ("nvidia", &straight, "json"),
        ("frigate", &straight, "yml"),
    ] {
        for file in exported(name, &site(camera), extension).files {
            let path = scratch.path(&format!("{name}/{}", file.name));
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, file.bytes).unwrap();
        }
    }
    let points = scene(&distorted);
    let script = calib_tests::root().join("tests/formats_readers.py");
    let mut command = std::process::Command::new(python);
    command.arg(script).arg(scratch.path("")).arg(json!(points).to_string());
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    for (point, pixel) in points.iter().zip(found["colmap"].as_array().unwrap()) {
        let pixel: [f64; 2] = serde_json::from_value(pixel.clone()).unwrap();
        assert_near(pixel, &distorted, *point, 0.0, "pycolmap");
    }
    let binary = ["cameras.bin", "images.bin", "points3D.bin"].map(|name| File {
        name: name.into(),
        bytes: std::fs::read(scratch.path(&format!("binary/{name}"))).unwrap(),
    });
    let back = import(format("colmap").unwrap(), &binary).unwrap().site.cameras[0].camera().unwrap();
    for point in &points {
        let Pixel { u, v } = back.world_to_pixel(*point).unwrap();
        assert_near([u, v], &distorted, *point, 0.0, "binary model");
    }
    let k = numbers(&found["ros"]["camera_matrix"]["data"]);
    assert_eq!([k[0], k[2] + 0.5], [distorted.focal, distorted.lens.principal_point.u]);
    // k1, k2, p1, p2, k3 of `distorted`.
    assert_eq!(
        numbers(&found["ros"]["distortion_coefficients"]["data"]),
        [-0.25, 0.06, 0.001, -0.0007, -0.004]
    );
    let p = numbers(&found["nvidia"]["projectionMatrix_3x4_w2p"]);
    for point in scene(&straight) {
        let w: Vec<f64> = (0..3)
            .map(|i| p[4 * i] * point.x + p[4 * i + 1] * point.y + p[4 * i + 2] * point.z + p[4 * i + 3])
            .collect();
        assert_near([w[0] / w[2], w[1] / w[2]], &straight, point, 0.0, "nvidia");
    }
    let corners = found["frigate"]["cameras"]["yard"]["zones"]["floor"]["coordinates"].as_str().unwrap();
    let corners: Vec<f64> = corners.split(',').map(|number| number.parse().unwrap()).collect();
    assert!(corners.len() >= 6 && corners.iter().all(|share| (0.0..=1.0).contains(share)), "{corners:?}");
}

/// Returns a site with a pinhole camera, a ramp with a region, and a plane without a region.
fn with_planes() -> Site {
    let planes = json!([
        {"id": "ramp", "height_m": 0.5, "tilt": {"toward_deg": 30, "fall_deg": 4},
            "region": [[0, 2], [4, 2], [4, 6], [0, 6]]},
        {"id": "shelf", "height_m": 2}
    ]);
    Site { planes: serde_json::from_value(planes).unwrap(), ..site(&pinhole()) }
}

#[test]
fn planes_are_exported_or_reported_as_lost() {
    let planes = with_planes();
    for format in FORMATS.iter().filter(|format| format.can_export()) {
        let export = exported(format.name, &placed(format, planes.clone()), format.extensions[0]);
        let losses: Vec<String> = export.losses.iter().map(ToString::to_string).collect();
        let reported = losses.iter().chain(&export.notes).filter(|what| what.contains("\"ramp\"")).count();
        let is_written = export.files.iter().any(|file| file.bytes.windows(4).any(|bytes| bytes == b"ramp"));
        assert_eq!(reported == 0, is_written, "{}: {losses:?} {:?}", format.name, export.notes);
        assert_eq!(is_written, format.planes == PlaneTreatment::Written, "{}", format.name);
        let misleads = losses.iter().any(|what| what.contains("\"ramp\""));
        assert_eq!(misleads, format.planes == PlaneTreatment::Misleading, "{}", format.name);
        assert!(
            !losses.iter().chain(&export.notes).any(|what| what.contains("shelf")),
            "planes without a region are not reported"
        );
    }
}

#[test]
fn geojson_contains_plane_regions_with_height_and_fall() {
    let mut site = with_planes();
    let document = json_of(&exported("geojson", &site, "geojson"), "site.local.geojson");
    let region = |document: &Value| {
        let features = document["features"].as_array().unwrap().clone();
        features.into_iter().find(|feature| feature["properties"]["kind"] == "plane").unwrap()
    };
    let found = region(&document);
    let number = |value: &Value, key: &str| value["properties"][key].as_f64().unwrap();
    assert_eq!(found["properties"]["plane_id"], "ramp");
    assert!(
        (number(&found, "fall_deg") - 4.0).abs() < 1e-9 && (number(&found, "toward_deg") - 30.0).abs() < 1e-9
    );
    assert_eq!(found["geometry"]["coordinates"][0].as_array().unwrap().len(), 5, "the ring is closed");
    assert!(document["fields"]["toward_deg"].as_str().unwrap().contains("counter-clockwise"));
    // World +x points east: 30 degrees counter-clockwise from it is an azimuth of 60 degrees.
    site.georeference =
        Some(Georeference { lat_deg: 50.0, lon_deg: 8.0, x_axis_azimuth_deg: 90.0, alt_m: None });
    let document = json_of(&exported("geojson", &site, "geojson"), "site.geojson");
    assert!((number(&region(&document), "toward_azimuth_deg") - 60.0).abs() < 1e-9);
}

#[test]
fn table_row_maps_pixels_to_its_plane() {
    let (site, camera) = (with_planes(), pinhole());
    let document = json_of(&exported("table", &site, "json"), "cameras.json");
    let row = &document["planes"][0];
    let numbers = |key: &str| -> Vec<f64> {
        row[key].as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect()
    };
    let (h, slope) = (numbers("plane_from_undistorted_px"), numbers("plane_slope"));
    let at = camera.pixel_to_plane(Pixel::new(900.0, 900.0), &site.plane_or_floor(Some("ramp"))).unwrap();
    let [x, y, w] = [0, 3, 6].map(|i| h[i] * 900.0 + h[i + 1] * 900.0 + h[i + 2]);
    assert!((x / w - at.x).abs() < 1e-9 && (y / w - at.y).abs() < 1e-9 && w > 0.0);
    let z = row["plane_z_m"].as_f64().unwrap() + slope[0] * at.x + slope[1] * at.y;
    assert!((z - at.z).abs() < 1e-9);
    let csv = exported("table", &site, "csv");
    assert_eq!(
        csv.files.iter().map(|file| file.name.as_str()).collect::<Vec<_>>(),
        ["cameras.csv", "planes.csv"]
    );
    assert!(
        json_of(&exported("table", &self::site(&pinhole()), "json"), "cameras.json").get("planes").is_none()
    );
}

#[test]
fn planes_are_kept_when_cameras_are_merged() {
    let scratch = scratch_of(&with_planes());
    scratch.write("bare.json", site(&pinhole()).to_json());
    scratch.calib(&["export", "opencv", "bare.json", "-o", "out"]).expect_code(0);
    let run = scratch.calib(&["import", "opencv", "out", "--into", "site.json", "--replace"]).expect_code(0);
    assert_eq!(Site::from_json(&run.stdout).unwrap().planes, with_planes().planes);
}
