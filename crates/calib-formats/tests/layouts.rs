//! Layouts of other programs' files: every one gives the right lens and ids, or an error with the name of the key.

#![allow(clippy::unwrap_used, reason = "a test that fails may panic")]

use calib_core::camera::Rational;
use calib_core::{BrownConrady, Distortion};
use calib_formats::{ExportOptions, File, Imported, export, format, import};

const K: &str = "[[900, 0, 639.5], [0, 900, 359.5], [0, 0, 1]]";
const SIZE: &str = "\"image_size\": [1280, 720]";
const BROWN: BrownConrady = BrownConrady { k1: -0.3, k2: 0.1, k3: 0.01, p1: 0.001, p2: -0.002 };

fn read_files(kind: &str, files: &[(&str, &str)]) -> Result<Imported, String> {
    let file = |(name, text): &(&str, &str)| File { name: (*name).into(), bytes: text.as_bytes().to_vec() };
    let files: Vec<File> = files.iter().map(file).collect();
    import(format(kind).unwrap(), &files).map_err(|error| error.to_string())
}

fn read(kind: &str, name: &str, text: &str) -> Result<Imported, String> {
    read_files(kind, &[(name, text)])
}

/// Reads an OpenCV file with these keys in addition to the matrix and the size.
fn opencv(keys: &str) -> Result<Imported, String> {
    read("opencv", "a.json", &format!("{{\"K\": {K}, {SIZE}, {keys}}}"))
}

fn ids(imported: &Imported) -> Vec<&str> {
    imported.site.cameras.iter().map(|camera| camera.id.as_str()).collect()
}

fn distortion(imported: &Imported) -> Distortion {
    imported.site.cameras[0].lens().distortion
}

#[test]
fn every_form_of_a_fisheye_flag_is_read() {
    let fisheye = Distortion::KannalaBrandt { k: [0.02, -0.01, 0.004, -0.0006] };
    let terms = "\"D\": [0.02, -0.01, 0.004, -0.0006]";
    for flag in [
        "\"fisheye_model\": 1",
        "\"fisheye\": 1",
        "\"fisheye\": true",
        "\"is_fisheye\": \"true\"",
        "\"isFisheye\": \"Yes\"",
        "\"fisheye_model\": 1.0",
        "\"fisheye\": \"1\"",
        "\"camera_model\": \"fisheye\"",
        "\"lens_type\": \"FISHEYE\"",
        "\"distortion_model\": \"equidistant\"",
    ] {
        assert_eq!(distortion(&opencv(&format!("{flag}, {terms}")).unwrap()), fisheye, "{flag}");
        let below = format!("{{{flag}, \"cam\": {{\"K\": {K}, {terms}}}, {SIZE}}}");
        assert_eq!(distortion(&read("opencv", "a.json", &below).unwrap()), fisheye, "{below}");
    }
    let brown =
        Distortion::BrownConrady(BrownConrady { k1: 0.02, k2: -0.01, k3: 0.0, p1: 0.004, p2: -0.0006 });
    for flag in
        ["\"fisheye_model\": 0", "\"fisheye\": \"false\"", "\"is_fisheye\": \"no\"", "\"fisheye\": null"]
    {
        assert_eq!(distortion(&opencv(&format!("{flag}, {terms}")).unwrap()), brown, "{flag}");
    }
    for flag in ["\"fisheye\": 2", "\"fisheye\": \"perhaps\""] {
        let error = opencv(&format!("{flag}, {terms}")).unwrap_err();
        assert!(error.contains("/fisheye") && error.contains("true or false"), "{error}");
    }
    assert!(opencv("\"fisheye\": true").unwrap_err().contains("k1 to k4"));
    let sample = "%YAML:1.0\n---\nfisheye_model: 1\nimage_width: 1280\nimage_height: 720\nflags: 14\n\
         camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 900., 0., 639.5, 0., 900., 359.5, 0., 0., 1. ]\n\
         distortion_coefficients: !!opencv-matrix\n   rows: 4\n   cols: 1\n   dt: d\n   data: [ 0.02, -0.01, 0.004, -0.0006 ]\n";
    assert_eq!(distortion(&read("opencv", "a.yml", sample).unwrap()), fisheye);
    let table = "[cam_0]\nname = \"a\"\nsize = [1280, 720]\nmatrix = [[900.0, 0.0, 640.0], [0.0, 900.0, 360.0], [0.0, 0.0, 1.0]]\n\
         distortions = [0.02, -0.01, 0.004, -0.0006]\nfisheye = 1\n";
    assert_eq!(distortion(&read("caliscope", "a.toml", table).unwrap()), fisheye);
    let pose = "[[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 2], [0, 0, 0, 1]]";
    let frames = format!(
        "{{\"is_fisheye\": 1, \"w\": 1280, \"h\": 720, \"fl_x\": 900, \"k1\": 0.02, \"k2\": -0.01, \"k3\": 0.004, \"k4\": -0.0006, \
         \"frames\": [{{\"file_path\": \"a.png\", \"transform_matrix\": {pose}}}]}}"
    );
    assert_eq!(distortion(&read("nerfstudio", "transforms.json", &frames).unwrap()), fisheye);
}

#[test]
fn coefficients_with_names_of_their_own_are_read() {
    for prefix in ["dist_", "distortion_", "", "dist_coeff_", "lens_distortion_"] {
        let named = |name: &str, value: f64| format!("\"{prefix}{name}\": {value}");
        let keys =
            [named("k1", -0.3), named("k2", 0.1), named("p1", 0.001), named("p2", -0.002), named("k3", 0.01)];
        let imported = opencv(&keys.join(", ")).unwrap();
        assert_eq!(distortion(&imported), Distortion::BrownConrady(BROWN), "{prefix}");
        assert_eq!(imported.notes, Vec::<String>::new(), "{prefix}");
        let below = format!("{{\"front\": {{\"K\": {K}, {SIZE}, {}}}}}", keys.join(", "));
        assert_eq!(
            distortion(&read("opencv", "a.json", &below).unwrap()),
            Distortion::BrownConrady(BROWN),
            "{prefix}"
        );
    }
    let object = "\"distortion\": {\"k1\": -0.3, \"k2\": 0.1, \"p1\": 0.001, \"p2\": -0.002, \"k3\": 0.01}";
    assert_eq!(distortion(&opencv(object).unwrap()), Distortion::BrownConrady(BROWN));
    let rational = Distortion::Rational(Rational {
        radial: [-0.3, 0.0, 0.0, 0.1, 0.02, 0.003],
        tangential: [0.0; 2],
        prism: [0.0; 4],
    });
    let keys = "\"dist_k1\": -0.3, \"dist_k4\": 0.1, \"dist_k5\": 0.02, \"dist_k6\": 0.003";
    assert_eq!(distortion(&opencv(keys).unwrap()), rational);
    let fisheye = "\"fisheye\": true, \"dist_k1\": 0.02, \"dist_k2\": -0.01";
    assert_eq!(
        distortion(&opencv(fisheye).unwrap()),
        Distortion::KannalaBrandt { k: [0.02, -0.01, 0.0, 0.0] }
    );
}

#[test]
fn unknown_key_of_distortion_is_an_error_with_its_name() {
    for (key, value) in [
        ("dist_x", "0.1"),
        ("distortion", "-0.3"),
        ("dist_coeffs", "\"see other file\""),
        ("D", "0.2"),
        ("camera_distortion", "0.2"),
        ("distorted", "true"),
        ("dist_k1", "\"-0.3\""),
        ("distortion", "{\"k1\": -0.3, \"q\": 2}"),
    ] {
        let error = opencv(&format!("\"{key}\": {value}")).unwrap_err();
        assert!(error.contains(key), "{error}");
    }
    assert!(opencv("\"dist_k1\": 0.1, \"distortionK1\": 0.2").is_err());
    assert!(opencv("\"k1\": 0.1, \"k2\": 0, \"k3\": 0, \"k4\": 0.1").unwrap_err().contains("fisheye"));
    let lens = "image_width: 1280\nimage_height: 720\ncamera_matrix: {data: [900, 0, 639.5, 0, 900, 359.5, 0, 0, 1]}\n";
    let error = read("ros", "a.yaml", &format!("{lens}dist_coeffs: [-0.3, 0.1, 0, 0, 0]\n")).unwrap_err();
    assert!(error.contains("dist_coeffs") && error.contains("distortion_coefficients"), "{error}");
    let chain = "cam0:\n  camera_model: pinhole\n  intrinsics: [900, 900, 640, 360]\n  resolution: [1280, 720]\n  \
                 distortion_coeffs: [0.1, 0, 0, 0]\n";
    let error = read("kalibr", "camchain.yaml", chain).unwrap_err();
    assert!(error.contains("distortion_coeffs") && error.contains("radtan"), "{error}");
}

#[test]
fn stated_absence_of_distortion_is_a_lens_without_distortion() {
    for keys in [
        "\"dist_coeffs\": null",
        "\"distortion\": \"none\"",
        "\"distortion\": \"None\"",
        "\"distortion\": []",
        "\"D\": \"NONE\"",
        "\"D\": 0",
        "\"distortion_model\": \"plumb_bob\"",
        "\"distance_m\": 4.5",
        "\"distances\": [1, 2, 3, 4]",
        "\"undistorted\": true",
    ] {
        assert_eq!(distortion(&opencv(keys).unwrap()), Distortion::None, "{keys}");
    }
}

#[test]
fn equal_file_names_get_their_ids_from_the_folders() {
    let lens = format!("{{\"K\": {K}, {SIZE}}}");
    let read = |names: &[&str]| {
        let files: Vec<(&str, &str)> = names.iter().map(|name| (*name, &lens[..])).collect();
        read_files("opencv", &files)
    };
    for (names, expected) in [
        (["cams/front/intrinsics.json", "cams/back/intrinsics.json"], ["front", "back"]),
        (["front/a/intrinsics.json", "back/a/intrinsics.json"], ["front", "back"]),
        (["x/1/a.json", "y/1/a.json"], ["x", "y"]),
        (["a.json", "b/a.json"], ["a", "b"]),
        (["x/a.json", "y/b.json"], ["a", "b"]),
    ] {
        assert_eq!(ids(&read(&names).unwrap()), expected, "{names:?}");
    }
    assert!(read(&["a/a.json", "a/a.json"]).is_err());
    let pose = "[[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 2], [0, 0, 0, 1]]";
    let frames = |paths: &[&str]| {
        let frames: Vec<String> = paths
            .iter()
            .map(|path| format!("{{\"file_path\": \"{path}\", \"transform_matrix\": {pose}}}"))
            .collect();
        let text = format!("{{\"w\": 1280, \"h\": 720, \"fl_x\": 900, \"frames\": [{}]}}", frames.join(", "));
        read_files("nerfstudio", &[("transforms.json", &text[..])]).unwrap()
    };
    assert_eq!(ids(&frames(&["./cam0/000.png", "./cam1/000.png"])), ["cam0", "cam1"]);
    assert_eq!(
        ids(&frames(&["c/cam0/000.png", "c/cam0/001.png", "c/cam1/000.png", "c/cam1/001.png"])),
        ["cam0-000", "cam0-001", "cam1-000", "cam1-001"]
    );
    let cameras = "1 PINHOLE 1280 720 900 900 640 360\n";
    let images = "1 1 0 0 0 0 0 0 1 hall/0.png\n\n2 1 0 0 0 1 0 0 1 door/0.png\n\n";
    let imported = read_files("colmap", &[("cameras.txt", cameras), ("images.txt", images)]).unwrap();
    assert_eq!(ids(&imported), ["hall", "door"]);
}

/// Numbers of the lens as OpenCV's base64: nine doubles of type "1d", and five of type "d".
const K_BASE64: &str = "MWQgICAgICAgICAgICAgICAgICAgICAgAAAAAAAgjEAAAAAAAAAAAAAAAAAA/INAAAAAAAAAAAAAAAAAACCMQAAAAAAAeHZAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAPA/";
const D_BASE64: &str =
    "ZCAgICAgICAgICAgICAgICAgICAgICAgMzMzMzMz07+amZmZmZm5P/yp8dJNYlA//Knx0k1iYL97FK5H4XqEPw==";
const K_FLOATS: &str = "ZiAgICAgICAgICAgICAgICAgICAgICAgAABhRAAAAAAA4B9EAAAAAAAAYUQAwLNDAAAAAAAAAAAAAIA/";
const TWO_TYPES: &str =
    "MmkxZCAgICAgICAgICAgICAgICAgICAgMzMzMzMz07+amZmZmZm5P/yp8dJNYlA//Knx0k1iYL97FK5H4XqEPw==";

#[test]
fn base64_arrays_are_read() {
    let json = |k: &str, d: &str| {
        format!(
            "{{\"camera_matrix\": {{\"type_id\": \"opencv-matrix\", \"rows\": 3, \"cols\": 3, \"dt\": \"d\", \"data\": \
             \"$base64${k}\"}}, \"distortion_coefficients\": {{\"rows\": 1, \"cols\": 5, \"dt\": \"d\", \"data\": \
             \"$base64${d}\"}}, {SIZE}}}"
        )
    };
    let split = |text: &str, indent: &str| {
        let lines: Vec<&str> =
            text.as_bytes().chunks(76).map(|line| std::str::from_utf8(line).unwrap()).collect();
        format!("\n{indent}{}", lines.join(&format!("\n{indent}")))
    };
    let yaml = format!(
        "%YAML:1.0\n---\nimage_width: 1280\nimage_height: 720\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   \
         data: !!binary |{}\ndistortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: !!binary |{}\n",
        split(K_BASE64, "      "),
        split(D_BASE64, "      ")
    );
    let xml = format!(
        "<?xml version=\"1.0\"?>\n<opencv_storage>\n<image_width>1280</image_width><image_height>720</image_height>\n\
         <camera_matrix type_id=\"opencv-matrix\"><rows>3</rows><cols>3</cols><dt>d</dt><data type_id=\"binary\">{}</data>\
         </camera_matrix><distortion_coefficients><data type_id=\"binary\">{}</data></distortion_coefficients></opencv_storage>",
        split(K_BASE64, "  "),
        split(D_BASE64, "  ")
    );
    let plain = format!("{{\"K\": \"$base64${K_BASE64}\", \"D\": \"$base64${D_BASE64}\", {SIZE}}}");
    for (name, text) in [
        ("a.json", json(K_BASE64, D_BASE64)),
        ("a.json", json(K_FLOATS, D_BASE64)),
        ("a.yml", yaml),
        ("a.xml", xml),
        ("a.json", plain),
    ] {
        let imported = read("opencv", name, &text).unwrap_or_else(|error| panic!("{text}: {error}"));
        let lens = imported.site.cameras[0].lens();
        assert_eq!((lens.focal, lens.distortion), (900.0, Distortion::BrownConrady(BROWN)), "{text}");
        assert_eq!((lens.principal_point.u, lens.principal_point.v), (640.0, 360.0), "{text}");
    }
    for wrong in [TWO_TYPES, &K_BASE64[..20], &D_BASE64[..60], "?", ""] {
        let error = read("opencv", "a.json", &json(K_BASE64, wrong)).unwrap_err();
        assert!(error.contains("distortion_coefficients/data"), "{error}");
    }
}

#[test]
fn dropped_skew_is_reported_with_its_error() {
    let lens = |skew: f64| {
        let text = format!("{{\"K\": [[900, {skew}, 639.5], [0, 900, 359.5], [0, 0, 1]], {SIZE}}}");
        read("opencv", "a.json", &text)
    };
    // 0.8 px of skew times 360 px from the principal point, divided by the focal length of 900 px.
    let notes = lens(0.8).unwrap().notes;
    assert!(notes.iter().any(|note| note.contains("skew 0.8") && note.contains("0.320 px")), "{notes:?}");
    assert!(lens(1.0).unwrap_err().contains("skew"));
    assert_eq!(lens(0.0).unwrap().notes, Vec::<String>::new());
}

#[test]
fn several_messages_of_ros_are_several_cameras_or_repetitions() {
    let message = |id: &str, focal: f64, time: u32| {
        format!(
            "header:\n  stamp: {time}\n  frame_id: {id}\nheight: 720\nwidth: 1280\ndistortion_model: plumb_bob\n\
             d: [-0.3, 0.1, 0.001, -0.002, 0.01]\nk: [{focal}, 0, 639.5, 0, {focal}, 359.5, 0, 0, 1]\n---\n"
        )
    };
    let read = |messages: &[String]| read("ros", "a.yaml", &messages.concat());
    let two = read(&[message("front", 900.0, 1), message("back", 905.0, 1)]).unwrap();
    assert_eq!(ids(&two), ["front", "back"]);
    assert_eq!(two.site.cameras[1].lens().focal, 905.0);
    let same =
        read(&[message("front", 900.0, 1), message("front", 900.0, 2), message("front", 900.0, 3)]).unwrap();
    assert_eq!(ids(&same), ["front"]);
    assert!(same.notes.iter().any(|note| note.contains("2 repeated messages")), "{:?}", same.notes);
    let error = read(&[message("front", 900.0, 1), message("front", 905.0, 2)]).unwrap_err();
    assert!(error.contains("front") && error.contains("frame_id"), "{error}");
    assert_eq!(ids(&read(&[message("front", 900.0, 1)]).unwrap()), ["front"]);
    assert!(read(&["---\n---\n".to_owned()]).is_err());
}

#[test]
fn lenses_without_poses_are_exported_to_formats_of_lenses() {
    let lens = |d: &str| format!("{{\"K\": {K}, {SIZE}{d}}}");
    let (plain, brown) = (lens(""), lens(", \"D\": [-0.3, 0.1, 0.001, -0.002, 0]"));
    let site = read_files("opencv", &[("front.json", &plain[..]), ("back.json", &brown[..])]).unwrap().site;
    for name in ["opencv", "ros", "kalibr", "colmap"] {
        let written = export(format(name).unwrap(), &site, &ExportOptions::default()).unwrap();
        assert!(written.losses.is_empty() && written.unsolved.is_empty(), "{name}: {:?}", written.losses);
        assert!(!written.files.iter().any(|file| file.name == "images.txt"), "{name}");
        let back = import(format(name).unwrap(), &written.files).unwrap().site;
        assert_eq!(back.cameras.len(), 2, "{name}");
        for (camera, original) in back.cameras.iter().zip(&site.cameras) {
            assert!(camera.solution.is_none(), "{name}");
            let (found, expected) = (camera.lens(), original.lens());
            assert_eq!(found.distortion, expected.distortion, "{name}");
            assert!(found.principal_point.distance(expected.principal_point) < 1e-9, "{name}");
            assert_eq!(camera.lens.as_ref().unwrap().focal_px.unwrap().value, 900.0, "{name}");
        }
    }
    for name in ["nerfstudio", "blender", "wildtrack"] {
        assert!(export(format(name).unwrap(), &site, &ExportOptions::default()).is_err(), "{name}");
    }
    // A focal length that is only a prior is not a known lens.
    let mut unknown = site.clone();
    for camera in &mut unknown.cameras {
        camera.lens.as_mut().unwrap().focal_px.as_mut().unwrap().fixed = false;
    }
    assert!(export(format("opencv").unwrap(), &unknown, &ExportOptions::default()).is_err());
}

#[test]
fn old_deepstream_matrices_count_pixels_from_the_centre() {
    // 1000 px focal length, 10 m above the floor, straight down: x right, y up in the image.
    let rows = |cx: f64, cy: f64, unit: f64| {
        let z = 10.0 * unit;
        let text = [1000.0, 0.0, -cx, cx * z, 0.0, -1000.0, -cy, cy * z, 0.0, 0.0, -1.0, z]
            .map(|v| format!("- {v}\n"));
        text.concat()
    };
    let read = |rows: &str, unit: Option<f64>| {
        let file =
            File { name: "cam.yml".into(), bytes: format!("projectionMatrix_3x4:\n{rows}").into_bytes() };
        let options =
            calib_formats::ImportOptions { size: Some([1280, 720]), unit_m: unit, ..Default::default() };
        calib_formats::import_with(format("nvidia").unwrap(), &[file], &options)
    };
    let camera = |imported: &Imported| imported.site.cameras[0].camera().unwrap();
    let imported = read(&rows(0.0, 0.0, 1.0), None).unwrap();
    let found = camera(&imported);
    assert!((found.lens.principal_point.u - 640.0).abs() < 1e-9, "{found:?}");
    assert!((found.lens.principal_point.v - 360.0).abs() < 1e-9, "{found:?}");
    assert!((found.focal - 1000.0).abs() < 1e-9 && (found.position.z - 10.0).abs() < 1e-9, "{found:?}");
    let pixel = found.world_to_pixel(calib_core::WorldPoint::new(1.0, 0.0, 0.0)).unwrap();
    assert!((pixel.u - 740.0).abs() < 1e-6 && (pixel.v - 360.0).abs() < 1e-6, "{pixel:?}");
    // A file in centimetres is not taken for metres silently.
    let imported = read(&rows(0.0, 0.0, 100.0), None).unwrap();
    assert!(imported.notes.iter().any(|note| note.contains("--unit cm")), "{:?}", imported.notes);
    let imported = read(&rows(0.0, 0.0, 100.0), Some(0.01)).unwrap();
    assert!((camera(&imported).position.z - 10.0).abs() < 1e-9);
    let error =
        read_files("nvidia", &[("cam.yml", &format!("projectionMatrix_3x4:\n{}", rows(0.0, 0.0, 1.0)))]);
    let error = error.unwrap_err();
    assert!(error.contains("centre") && error.contains("--size"), "{error}");
}

/// Builds an fSpy project with a PNG header as its image.
fn fspy(state: &str, size: Option<[u32; 2]>) -> Vec<u8> {
    let image = size.map_or_else(Vec::new, |[w, h]| {
        let head = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR";
        [&head[..], &w.to_be_bytes(), &h.to_be_bytes(), &[8, 2, 0, 0, 0, 0, 0, 0, 0]].concat()
    });
    let length = |bytes: usize| (bytes as u32).to_le_bytes();
    let head = [&b"fspy"[..], &1_u32.to_le_bytes(), &length(state.len()), &length(image.len())].concat();
    [&head[..], state.as_bytes(), &image].concat()
}

#[test]
fn lines_of_an_fspy_project_without_a_camera_become_annotations() {
    let segment = |[a, b, c, d]: [f64; 4]| format!(r#"[{{"x": {a}, "y": {b}}}, {{"x": {c}, "y": {d}}}]"#);
    let lines = |first, second| format!(r#"{{"lineSegments": [{}, {}]}}"#, segment(first), segment(second));
    let state = |quad: bool, axis: &str| {
        format!(
            r#"{{"globalSettings": {{"calibrationMode": "TwoVanishingPoints"}},
                "calibrationSettingsBase": {{"firstVanishingPointAxis": "xPositive", "secondVanishingPointAxis": "{axis}"}},
                "calibrationSettings2VP": {{"quadModeEnabled": {quad}}},
                "controlPointsStateBase": {{"firstVanishingPoint": {}}},
                "controlPointsState2VP": {{"secondVanishingPoint": {}}}}}"#,
            lines([0.1, 0.2, 0.5, 0.25], [0.1, 0.8, 0.5, 0.75]),
            lines([0.2, 0.9, 0.3, 0.4], [0.8, 0.9, 0.7, 0.4]),
        )
    };
    let read = |bytes: Vec<u8>| {
        import(format("fspy").unwrap(), &[File { name: "yard.fspy".into(), bytes }])
            .map_err(|e| e.to_string())
    };
    let imported = read(fspy(&state(false, "yNegative"), Some([1000, 500]))).unwrap();
    let camera = &imported.site.cameras[0];
    assert_eq!((camera.id.as_str(), camera.size_px), ("yard", [1000, 500]));
    let [first, second] = &camera.annotations[..] else { panic!("{:?}", camera.annotations) };
    assert_eq!(second.at_right_angles_to, first.id);
    let pixels = |annotation: &calib_core::Annotation| {
        annotation.segments.as_ref().unwrap().iter().flatten().map(|p| [p.u, p.v]).collect::<Vec<_>>()
    };
    assert_eq!(pixels(first), [[100.0, 100.0], [500.0, 125.0], [100.0, 400.0], [500.0, 375.0]]);
    assert_eq!(pixels(second), [[200.0, 450.0], [300.0, 200.0], [800.0, 450.0], [700.0, 200.0]]);
    assert!(imported.notes.iter().any(|note| note.contains("annotations")), "{:?}", imported.notes);
    // The third axis is vertical, and a rectangle has two sides of each direction.
    let imported = read(fspy(&state(false, "zPositive"), Some([1000, 500]))).unwrap();
    assert_eq!(imported.site.cameras[0].annotations[1].kind, calib_core::Kind::Vertical);
    let imported = read(fspy(&state(true, "yPositive"), Some([1000, 500]))).unwrap();
    let sides = pixels(&imported.site.cameras[0].annotations[1]);
    assert_eq!(sides, [[100.0, 100.0], [100.0, 400.0], [500.0, 125.0], [500.0, 375.0]]);
    let error = read(fspy(&state(false, "yPositive"), None)).unwrap_err();
    assert!(error.contains("--size"), "{error}");
}
