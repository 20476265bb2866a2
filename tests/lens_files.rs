//! Layouts in which programs write the same lens: every one is read as the same camera, or refused.

use calib_core::{Distortion, UndistortedPixel};
use calib_formats::{File, ImportOptions, Imported, format, import, import_with};
use calib_site::SiteCamera;

/// Intrinsics and distortion of all files: OpenCV's fx = fy, cx, cy, and k1, k2, p1, p2, k3.
const F: f64 = 900.0;
const CX: f64 = 639.5;
const CY: f64 = 359.5;
const TERMS: [f64; 5] = [-0.3, 0.1, 0.001, -0.002, 0.01];
const K: &str = "[[900, 0, 639.5], [0, 900, 359.5], [0, 0, 1]]";
const D: &str = "[-0.3, 0.1, 0.001, -0.002, 0.01]";

fn read(kind: &str, name: &str, text: &str) -> Result<Imported, String> {
    let file = File { name: name.into(), bytes: text.as_bytes().to_vec() };
    import(format(kind).unwrap(), &[file]).map_err(|error| error.to_string())
}

/// Returns OpenCV's pixel of a point in camera axes, by the formula in OpenCV's documentation.
fn opencv_pixel([x, y, z]: [f64; 3]) -> [f64; 2] {
    let (x, y, [k1, k2, p1, p2, k3]) = (x / z, y / z, TERMS);
    let r = x * x + y * y;
    let radial = 1.0 + r * (k1 + r * (k2 + r * k3));
    let u = x * radial + 2.0 * p1 * x * y + p2 * (r + 2.0 * x * x);
    let v = y * radial + p1 * (r + 2.0 * y * y) + 2.0 * p2 * x * y;
    [F * u + CX, F * v + CY]
}

/// Checks that a camera maps points in camera axes like OpenCV, whose pixel coordinates are smaller by 0.5.
fn assert_is_the_lens(camera: &SiteCamera, what: &str) {
    assert_eq!(camera.size_px, [1280, 720], "{what}");
    let lens = camera.lens();
    for [x, y, z] in [[0.1, 0.2, 1.0], [-0.6, 0.3, 1.0], [0.6, -0.35, 1.0], [0.5, 0.3, 1.2]] {
        let (cu, cv) = (lens.principal_point.u, lens.principal_point.v);
        let straight = UndistortedPixel { u: cu + F * x / z, v: cv + F * y / z };
        let found = lens.distort(straight).unwrap();
        let [u, v] = opencv_pixel([x, y, z]);
        assert!((found.u - u - 0.5).hypot(found.v - v - 0.5) < 1e-6, "{what}: {found:?}, OpenCV {u} {v}");
    }
}

#[test]
fn layouts_of_opencv_give_the_same_lens() {
    let size = "\"image_size\": [1280, 720]";
    let mut layouts = Vec::new();
    for k in [
        "camera_matrix",
        "cameraMatrix",
        "Camera_Matrix",
        "K",
        "M",
        "mtx",
        "intrinsic_matrix",
        "Camera Matrix",
    ] {
        layouts.push(("a.json", format!("{{\"{k}\": {K}, \"dist_coeffs\": {D}, {size}}}")));
    }
    for d in [
        "distortion",
        "distortion_coefficients",
        "dist_coefs",
        "distCoef",
        "distortionCoefficients",
        "camera_distortion",
        "distortion_vec",
        "distortion_coeffs",
        "Distortion_Coefficients",
        "D",
        "dist",
    ] {
        layouts.push(("a.json", format!("{{\"K\": {K}, \"{d}\": {D}, {size}}}")));
        layouts.push(("a.json", format!("{{\"K\": {K}, \"{d}\": [{D}], {size}}}")));
    }
    layouts.push(("a.yml", format!("{{K: {K}, D: {D}, image_size: [1280, 720]}}")));
    layouts.push((
        "a.yaml",
        format!(
            "%YAML:1.0\n---\ncamera_matrix: {K}\ndist_coeff: {D}\nimage_width: 1280\nimage_height: 720\n"
        ),
    ));
    layouts.push(("all.json", format!("{{\"front\": {{\"K\": {K}, \"dist\": {D}, {size}}}}}")));
    for (name, text) in layouts {
        let imported = read("opencv", name, &text).unwrap_or_else(|error| panic!("{text}: {error}"));
        assert_is_the_lens(&imported.site.cameras[0], &text);
        assert_eq!(imported.notes, Vec::<String>::new(), "{text}");
    }
}

#[test]
fn stereo_files_give_two_lenses() {
    let other = "[[905, 0, 640], [0, 905, 360], [0, 0, 1]]";
    for [k1, d1, k2, d2, a, b] in [
        ["K1", "D1", "K2", "D2", "1", "2"],
        ["M1", "D1", "M2", "D2", "1", "2"],
        ["cameraMatrix1", "distCoeffs1", "cameraMatrix2", "distCoeffs2", "1", "2"],
        ["left_camera_matrix", "left_distortion", "right_camera_matrix", "right_distortion", "left", "right"],
    ] {
        let text = format!(
            "{{\"{k1}\": {K}, \"{d1}\": {D}, \"{k2}\": {other}, \"{d2}\": [0, 0, 0, 0, 0], \"image_size\": [1280, 720]}}"
        );
        let cameras = read("opencv", "stereo.json", &text).unwrap().site.cameras;
        let ids: Vec<&str> = cameras.iter().map(|camera| camera.id.as_str()).collect();
        assert_eq!(ids, [a, b], "{text}");
        assert_is_the_lens(&cameras[0], &text);
        assert_eq!(cameras[1].lens().distortion, Distortion::None);
    }
}

#[test]
fn distortion_that_cannot_be_read_is_refused() {
    for text in [
        format!("{{\"K\": {K}, \"distortion\": {{\"radial\": [-0.3, 0.1]}}, \"image_size\": [1280, 720]}}"),
        format!("{{\"K\": {K}, \"dist_coeffs\": [-0.3], \"image_size\": [1280, 720]}}"),
        format!("{{\"K1\": {K}, \"D2\": {D}, \"image_size\": [1280, 720]}}"),
    ] {
        assert!(read("opencv", "a.json", &text).is_err(), "{text}");
    }
}

#[test]
fn forms_of_ros_give_the_same_lens() {
    let flat = "[900.0, 0.0, 639.5, 0.0, 900.0, 359.5, 0.0, 0.0, 1.0]";
    let printed = format!(
        "header:\n  frame_id: front\nheight: 720\nwidth: 1280\ndistortion_model: plumb_bob\nD: {D}\nK: {flat}\nR: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n---\n"
    );
    let ros_2 = printed.replace("\nD:", "\nd:").replace("\nK:", "\nk:").replace("\nR:", "\nr:");
    let ost = "# oST version 5.0 parameters\n\n\n[image]\n\nwidth\n1280\n\nheight\n720\n\n[front]\n\ncamera matrix\n\
               900.0 0.0 639.5\n0.0 900.0 359.5\n0.0 0.0 1.0\n\ndistortion\n-0.3 0.1 0.001 -0.002 0.01\n\n\
               rectification\n1.0 0.0 0.0\n0.0 1.0 0.0\n0.0 0.0 1.0\n";
    for (name, text) in [("a.yaml", &printed[..]), ("a.yaml", &ros_2), ("ost.txt", ost)] {
        let imported = read("ros", name, text).unwrap_or_else(|error| panic!("{text}: {error}"));
        assert_eq!(imported.site.cameras[0].id, "front", "{text}");
        assert_is_the_lens(&imported.site.cameras[0], text);
    }
    for (from, to) in
        [("1280", "wide"), ("900.0 0.0 639.5", "900.0 0.0"), ("distortion\n-0.3", "distortion\n-0.3 1 1")]
    {
        assert!(read("ros", "ost.txt", &ost.replacen(from, to, 1)).is_err(), "{from}");
    }
}

#[test]
fn tables_of_caliscope_and_lenses_of_colmap_are_read() {
    let table = format!("[cameras.0]\nsize = [1280, 720]\nmatrix = {K}\ndistortions = {D}\n")
        .replace("900,", "900.0,")
        .replace(" 0,", " 0.0,");
    let cameras = read("caliscope", "camera_array.toml", &table).unwrap().site.cameras;
    assert_is_the_lens(&cameras[0], &table);
    // COLMAP's pixels count from the corner.
    let imported =
        read("colmap", "cameras.txt", "# cameras\n1 OPENCV 1280 720 900 900 640 360 -0.3 0.1 0.001 -0.002\n")
            .unwrap();
    assert_eq!(
        (imported.site.cameras[0].id.as_str(), imported.site.cameras[0].solution.is_none()),
        ("1", true)
    );
    assert!(imported.notes.iter().any(|note| note.contains("no poses")), "{:?}", imported.notes);
}

#[test]
fn missing_values_are_named() {
    let frame = r#"{"file_path": "a.png", "transform_matrix": [[1, 0, 0, 0], [0, 0, -1, -3], [0, 1, 0, 2], [0, 0, 0, 1]]}"#;
    let without_size = format!("{{\"camera_angle_x\": 0.7, \"frames\": [{frame}]}}");
    let error = read("nerfstudio", "transforms.json", &without_size).unwrap_err();
    assert!(error.contains("no w and h"), "{error}");
    let file = File { name: "transforms.json".into(), bytes: without_size.into_bytes() };
    let size = ImportOptions { size: Some([800, 600]), ..ImportOptions::default() };
    let site = import_with(format("nerfstudio").unwrap(), &[file], &size).unwrap().site;
    assert_eq!(site.cameras[0].size_px, [800, 600]);
    let focal = site.cameras[0].lens.as_ref().unwrap().focal_px.unwrap().value;
    assert!((focal - 400.0 / 0.35_f64.tan()).abs() < 1e-9, "{focal}");
    let state = "{\"controlPointsStateBase\": {}}";
    let mut project = b"fspy".to_vec();
    for number in [1_u32, state.len() as u32, 0] {
        project.extend(number.to_le_bytes());
    }
    project.extend(state.as_bytes());
    let file = File { name: "old.fspy".into(), bytes: project };
    let error = import(format("fspy").unwrap(), &[file]).unwrap_err().to_string();
    assert!(error.contains("has no camera"), "{error}");
}

/// Returns the files of a WILDTRACK camera at (6, -4, 2.8) m that looks along y, 0.5 rad below the horizon, in
/// units of `unit_m`. If `is_left_handed`, the world of the files has a mirrored y axis.
fn wildtrack(unit_m: f64, is_left_handed: bool) -> [File; 2] {
    const PITCH: f64 = 0.5;
    let (sin, cos) = PITCH.sin_cos();
    // Right, down and forward in the world: a rotation about x by 90 degrees and the pitch.
    let rows = [[1.0, 0.0, 0.0], [0.0, -sin, -cos], [0.0, cos, -sin]];
    let centre = [6.0, -4.0, 2.8];
    let side = if is_left_handed { 1.0 } else { -1.0 };
    let tvec = rows.map(|row: [f64; 3]| side * (0..3).map(|i| row[i] * centre[i]).sum::<f64>() / unit_m);
    // The rotation -R M with the mirror M is half a turn about a diagonal of y and z.
    let half =
        [0.0, (0.5 * (1.0 - sin)).sqrt(), (0.5 * (1.0 + sin)).sqrt()].map(|n| n * std::f64::consts::PI);
    let rvec = if is_left_handed { half } else { [std::f64::consts::FRAC_PI_2 + PITCH, 0.0, 0.0] };
    let [rvec, tvec] = [rvec, tvec].map(|v| v.map(|value| format!("{value:?}")).join(" "));
    let file = |name: &str, content: String| File {
        name: name.into(),
        bytes: format!("<?xml version=\"1.0\"?><opencv_storage>{content}</opencv_storage>").into_bytes(),
    };
    let matrix = "<camera_matrix type_id=\"opencv-matrix\"><rows>3</rows><cols>3</cols><dt>d</dt>\
                  <data>900 0 639.5 0 900 359.5 0 0 1</data></camera_matrix>";
    [
        file("intr_C1.xml", matrix.into()),
        file("extr_C1.xml", format!("<rvec>{rvec}</rvec><tvec>{tvec}</tvec>")),
    ]
}

#[test]
fn unit_and_handedness_of_poses_can_be_stated() {
    for (unit_m, is_left_handed) in [(0.01, false), (1.0, false), (0.3048, false), (1.0, true)] {
        let options = ImportOptions { unit_m: Some(unit_m), is_left_handed, ..ImportOptions::default() };
        let files = wildtrack(unit_m, is_left_handed);
        let imported = import_with(format("wildtrack").unwrap(), &files, &options).unwrap();
        let camera = imported.site.cameras[0].camera().unwrap();
        let right = [6.0, -4.0, 2.8];
        let found = <[f64; 3]>::from(camera.position);
        assert!((0..3).all(|i| (found[i] - right[i]).abs() < 1e-9), "{found:?}");
        assert!((camera.pitch - 0.5).abs() < 1e-9 && camera.roll.abs() < 1e-9, "{camera:?}");
    }
    let plain = wildtrack(1.0, false);
    let notes = import(format("wildtrack").unwrap(), &plain).unwrap().notes;
    assert!(notes.iter().any(|note| note.contains("--unit m")), "{notes:?}");
    let notes = import(format("wildtrack").unwrap(), &wildtrack(0.01, true)).unwrap().notes;
    assert!(notes.iter().any(|note| note.contains("--left-handed")), "{notes:?}");
    let unit = ImportOptions { unit_m: Some(1.0), ..ImportOptions::default() };
    let file = File { name: "a.kml".into(), bytes: b"<kml/>".to_vec() };
    let error = import_with(format("kml").unwrap(), &[file], &unit).unwrap_err().to_string();
    assert!(error.contains("no poses"), "{error}");
}

#[test]
fn size_can_be_stated() {
    let text = format!("{{\"camera_matrix\": {K}, \"dist_coeffs\": {D}, \"image_size\": [640, 360]}}");
    let file = File { name: "a.json".into(), bytes: text.into_bytes() };
    let error = import(format("opencv").unwrap(), std::slice::from_ref(&file)).unwrap_err().to_string();
    assert!(error.contains("--size"), "{error}");
    let size = ImportOptions { size: Some([1280, 720]), ..ImportOptions::default() };
    let imported = import_with(format("opencv").unwrap(), &[file], &size).unwrap();
    assert_is_the_lens(&imported.site.cameras[0], "stated size");
}

/// Returns `OpenCV`'s pixel of a point in camera axes with all terms, by the formula in `OpenCV`'s documentation.
fn pixel_with_all_terms([x, y, z]: [f64; 3], [fx, fy]: [f64; 2], terms: [f64; 12]) -> [f64; 2] {
    let [k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4] = terms;
    let (x, y) = (x / z, y / z);
    let r = x * x + y * y;
    let radial = (1.0 + r * (k1 + r * (k2 + r * k3))) / (1.0 + r * (k4 + r * (k5 + r * k6)));
    let u = x * radial + 2.0 * p1 * x * y + p2 * (r + 2.0 * x * x) + s1 * r + s2 * r * r;
    let v = y * radial + p1 * (r + 2.0 * y * y) + 2.0 * p2 * x * y + s3 * r + s4 * r * r;
    [fx * u + CX, fy * v + CY]
}

#[test]
fn rational_and_thin_prism_terms_and_both_focal_lengths_are_read_and_written() {
    let wide = [0.5, 0.15, 0.0002, -0.0001, 0.01, 0.83, 0.3, 0.05];
    let steep = [0.42, -2.57, 0.0007, -0.0004, 1.57, 0.3, -2.39, 1.49];
    let prism = [-0.2, 0.05, 0.001, -0.001, 0.0, 0.02, 0.01, 0.0, 0.002, -0.001, -0.003, 0.0005];
    let cases = [(&wide[..], 900.0), (&steep, 905.0), (&prism, 880.0)];
    for (terms, fy) in cases {
        let mut all = [0.0; 12];
        all[..terms.len()].copy_from_slice(terms);
        let flat = format!("[{F:?}, 0.0, {CX}, 0.0, {fy:?}, {CY}, 0.0, 0.0, 1.0]");
        let ros = format!(
            "image_width: 1280\nimage_height: 720\ncamera_name: a\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: {flat}\n\
             distortion_model: rational_polynomial\ndistortion_coefficients:\n  rows: 1\n  cols: {}\n  data: {terms:?}\n",
            terms.len()
        );
        let opencv = format!(
            "{{\"K\": [[{F}, 0, {CX}], [0, {fy}, {CY}], [0, 0, 1]], \"D\": {terms:?}, \"image_size\": [1280, 720]}}"
        );
        for (kind, name, text) in [("ros", "a.yaml", ros), ("opencv", "a.json", opencv)] {
            let site = read(kind, name, &text).unwrap().site;
            let lens = site.cameras[0].lens();
            for [x, y, z] in [[0.1, 0.2, 1.0], [-0.6, 0.3, 1.0], [0.6, -0.35, 1.0], [0.5, 0.3, 1.2]] {
                let (cu, cv) = (lens.principal_point.u, lens.principal_point.v);
                let straight = UndistortedPixel { u: cu + F * x / z, v: cv + F * y / z };
                let found = lens.distort(straight).unwrap();
                let [u, v] = pixel_with_all_terms([x, y, z], [F, fy], all);
                assert!(
                    (found.u - u - 0.5).hypot(found.v - v - 0.5) < 1e-6,
                    "{kind} {terms:?}: {found:?}, {u} {v}"
                );
                let back = lens.undistort(found).unwrap();
                assert!(back.distance(straight) < 1e-7, "{kind} {terms:?}: {back:?}");
            }
        }
    }
    let tilted = "[0.1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0.01, 0.02]";
    let text = format!("{{\"K\": {K}, \"dist_coeffs\": {tilted}, \"image_size\": [1280, 720]}}");
    let refused = read("opencv", "a.json", &text).unwrap_err();
    assert!(refused.contains("tilted"), "{refused}");
}

#[test]
fn lenses_of_other_programs_are_the_same_lens() {
    let radtan = "\"k1\": -0.3, \"k2\": 0.1, \"p1\": 0.001, \"p2\": -0.002, \"k3\": 0.01";
    let files = [
        (
            "opencv",
            "a.json",
            format!("{{\"fx\": 900, \"fy\": 900, \"cx\": 639.5, \"cy\": 359.5, \"width\": 1280, \"height\": 720, {radtan}}}"),
        ),
        (
            "opencv",
            "b.json",
            format!("{{\"color\": {{\"fx\": 900, \"fy\": 900, \"ppx\": 639.5, \"ppy\": 359.5, \"width\": 1280, \"height\": 720, \"coeffs\": {D}}}}}"),
        ),
        (
            "camodocal",
            "c.yaml",
            "%YAML:1.0\n---\nmodel_type: PINHOLE_FULL\ncamera_name: camera\nimage_width: 1280\nimage_height: 720\n\
             distortion_parameters:\n   k1: -0.3\n   k2: 0.1\n   p1: 0.001\n   p2: -0.002\n   k3: 0.01\n\
             projection_parameters:\n   fx: 900.\n   fy: 900.\n   cx: 639.5\n   cy: 359.5\n"
                .into(),
        ),
        // OpenSfM's coordinates are relative to the image centre, in units of the longer side.
        (
            "opensfm",
            "camera_models.json",
            format!("{{\"cam\": {{\"projection_type\": \"brown\", \"width\": 1280, \"height\": 720, \"focal_x\": 0.703125, \"focal_y\": 0.703125, \"c_x\": 0.0, \"c_y\": 0.0, {radtan}}}}}"),
        ),
        // Metashape's P1 and P2 are OpenCV's p2 and p1.
        (
            "metashape",
            "m.xml",
            "<calibration><projection>frame</projection><width>1280</width><height>720</height><f>900</f><k1>-0.3</k1>\
             <k2>0.1</k2><k3>0.01</k3><p1>-0.002</p1><p2>0.001</p2></calibration>"
                .into(),
        ),
        // MATLAB's matrix is transposed, and its pixels count from 1.
        (
            "matlab",
            "params.json",
            "{\"RadialDistortion\": [-0.3, 0.1, 0.01], \"TangentialDistortion\": [0.001, -0.002], \"ImageSize\": [720, 1280], \
             \"IntrinsicMatrix\": [[900, 0, 0], [0, 900, 0], [640.5, 360.5, 1]]}"
                .into(),
        ),
        (
            "basalt",
            "calibration.json",
            format!("{{\"value0\": {{\"intrinsics\": [{{\"camera_type\": \"pinhole-radtan8\", \"intrinsics\": {{\"fx\": 900, \"fy\": 900, \"cx\": 639.5, \"cy\": 359.5, {radtan}, \"k4\": 0, \"k5\": 0, \"k6\": 0}}}}], \"resolution\": [[1280, 720]]}}}}"),
        ),
    ];
    for (kind, name, text) in files {
        let imported = read(kind, name, &text).unwrap_or_else(|error| panic!("{kind} {name}: {error}"));
        assert_eq!(imported.site.cameras.len(), 1, "{kind} {name}");
        assert_is_the_lens(&imported.site.cameras[0], &format!("{kind} {name}"));
    }
}

/// Checks the pixel of points in camera axes; `pixel` is the formula of the other program, with pixels from the corner.
fn assert_maps_like(camera: &SiteCamera, pixel: impl Fn([f64; 3]) -> [f64; 2], what: &str) {
    let lens = camera.lens();
    for [x, y, z] in [[0.1, 0.2, 1.0], [-0.6, 0.3, 1.0], [0.9, -0.7, 1.0], [1.5, 0.4, 1.0]] {
        let (cu, cv) = (lens.principal_point.u, lens.principal_point.v);
        let straight = UndistortedPixel { u: cu + lens.focal * x / z, v: cv + lens.focal * y / z };
        let (found, [u, v]) = (lens.distort(straight).unwrap(), pixel([x, y, z]));
        assert!((found.u - u).hypot(found.v - v) < 1e-6, "{what}: {found:?}, expected {u} {v}");
    }
}

#[test]
fn wide_lenses_of_other_programs_map_by_their_formulas() {
    let basalt = "{\"value0\": {\"intrinsics\": [{\"camera_type\": \"ds\", \"intrinsics\": {\"fx\": 350, \"fy\": 350, \"cx\": 511.5, \
                  \"cy\": 383.5, \"xi\": -0.2, \"alpha\": 0.57}}, {\"camera_type\": \"ucm\", \"intrinsics\": {\"fx\": 350, \"fy\": 350, \
                  \"cx\": 511.5, \"cy\": 383.5, \"alpha\": 0.6}}], \"resolution\": [[1024, 768], [1024, 768]]}}";
    let cameras = read("basalt", "calibration.json", basalt).unwrap().site.cameras;
    assert_eq!(cameras.iter().map(|camera| camera.id.as_str()).collect::<Vec<_>>(), ["cam0", "cam1"]);
    let (xi, alpha) = (-0.2, 0.57);
    let double_sphere = |[x, y, z]: [f64; 3]| {
        let first = (x * x + y * y + z * z).sqrt();
        let shifted = xi * first + z;
        let depth = alpha * (x * x + y * y + shifted * shifted).sqrt() + (1.0 - alpha) * shifted;
        [350.0 * x / depth + 512.0, 350.0 * y / depth + 384.0]
    };
    assert_maps_like(&cameras[0], double_sphere, "double sphere");
    let unified = |[x, y, z]: [f64; 3]| {
        let depth = 0.6 * (x * x + y * y + z * z).sqrt() + 0.4 * z;
        [350.0 * x / depth + 512.0, 350.0 * y / depth + 384.0]
    };
    assert_maps_like(&cameras[1], unified, "unified");
    let mei = "%YAML:1.0\n---\nmodel_type: MEI\nimage_width: 752\nimage_height: 480\nmirror_parameters:\n   xi: 1.2\n\
               distortion_parameters:\n   k1: -0.1\n   k2: 0.02\n   p1: 0.001\n   p2: -0.002\nprojection_parameters:\n   \
               gamma1: 990.0\n   gamma2: 990.0\n   u0: 375.5\n   v0: 239.5\n";
    let camera = read("camodocal", "left.yaml", mei).unwrap().site.cameras.remove(0);
    assert_eq!(camera.id, "left");
    let mirror = |[x, y, z]: [f64; 3]| {
        let depth = z + 1.2 * (x * x + y * y + z * z).sqrt();
        let (x, y) = (x / depth, y / depth);
        let r = x * x + y * y;
        let radial = 1.0 + r * (-0.1 + r * 0.02);
        let u = x * radial + 2.0 * 0.001 * x * y - 0.002 * (r + 2.0 * x * x);
        let v = y * radial + 0.001 * (r + 2.0 * y * y) - 2.0 * 0.002 * x * y;
        [990.0 * u + 376.0, 990.0 * v + 240.0]
    };
    assert_maps_like(&camera, mirror, "MEI");
    let fisheye = "{\"c\": {\"projection_type\": \"fisheye\", \"width\": 1000, \"height\": 800, \"focal\": 0.4, \"k1\": -0.02, \"k2\": 0.003}}";
    let camera = read("opensfm", "camera_models.json", fisheye).unwrap().site.cameras.remove(0);
    let equidistant = |[x, y, z]: [f64; 3]| {
        let r = x.hypot(y);
        let angle = r.atan2(z);
        let scale = angle * (1.0 + angle * angle * (-0.02 + 0.003 * angle * angle)) / r;
        [400.0 * scale * x + 500.0, 400.0 * scale * y + 400.0]
    };
    assert_maps_like(&camera, equidistant, "OpenSfM fisheye");
}

#[test]
fn unsupported_lenses_of_other_programs_are_refused_with_advice() {
    let error = |kind: &str, name: &str, text: &str| read(kind, name, text).unwrap_err();
    let scaramuzza =
        "model_type: SCARAMUZZA\nimage_width: 752\nimage_height: 480\nprojection_parameters:\n   u0: 1.0\n";
    assert!(error("camodocal", "a.yaml", scaramuzza).contains("ocamcalib"));
    let spherical = "{\"c\": {\"projection_type\": \"spherical\", \"width\": 4096, \"height\": 2048}}";
    assert!(error("opensfm", "a.json", spherical).contains("fisheye_opencv"));
    let k4 = "<calibration><width>100</width><height>80</height><f>90</f><k4>0.1</k4></calibration>";
    assert!(error("metashape", "a.xml", k4).contains("without this term"));
    let bare = "<calibration><width>100</width><height>80</height></calibration>";
    assert!(error("metashape", "a.xml", bare).contains("calibration/f"));
    assert!(error("matlab", "a.json", "{\"ImageSize\": [720, 1280]}").contains("IntrinsicMatrix"));
    let kb8 = "{\"value0\": {\"intrinsics\": [{\"camera_type\": \"fov\", \"intrinsics\": {\"fx\": 1}}], \"resolution\": [[10, 10]]}}";
    assert!(error("basalt", "a.json", kb8).contains("kb4"));
}
