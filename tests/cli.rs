//! The command line: data on stdout, messages on stderr, exit codes.

use calib_core::{
    Annotation, BrownConrady, Camera, Covariance, Distortion, Kind, Lens, Pixel, UndistortedPixel, WorldPoint,
};

use calib_demo::layout::Layout;
use calib_demo::random::{AnnotationSet, RandomScene};
use calib_site::{DistortionEntry, Method, Site, SiteCamera, Solution, Stage};
use calib_tests::Scratch;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

/// Returns a site with two solvable cameras and a grey image for the first.
fn site() -> (Scratch, Site) {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let cameras = ["door", "yard"].map(|id| {
        let scene = RandomScene::new(&mut random, AnnotationSet::Directions, Some(80.0), Some(35.0));
        SiteCamera {
            annotations: scene.noisy(&mut random, 0.7),
            sigma_px: Some(0.7),
            efov_px: Some(scene.efov),
            image: (id == "door").then(|| "door.png".into()),
            ..SiteCamera::new(id, [1920, 1080])
        }
    });
    let scratch = Scratch::new();
    image::RgbImage::from_pixel(1920, 1080, image::Rgb([90, 90, 90])).save(scratch.path("door.png")).unwrap();
    let site = Site { cameras: cameras.to_vec(), ..Site::new() };
    scratch.write("site.json", site.to_json());
    (scratch, site)
}

fn rewrite(scratch: &Scratch, site: &Site, change: impl FnOnce(&mut Value)) {
    let mut document: Value = serde_json::from_str(&site.to_json()).unwrap();
    change(&mut document);
    scratch.write("site.json", document.to_string());
}

#[test]
fn solving_reports_on_stdout_and_writes_the_solved_site() {
    let (scratch, site) = site();
    let text = scratch.calib(&["solve", "site.json"]).expect_code(0);
    assert!(text.stdout.contains("door") && text.stdout.contains("yard"), "{}", text.stdout);
    let json =
        scratch.calib(&["solve", "site.json", "--format", "json", "-o", "solved.json"]).expect_code(0).json();
    assert_eq!(json["door"]["method"], "maximum-likelihood");
    assert_eq!(json["door"]["stage"], "partial");
    let solved = scratch.read_json("solved.json");
    assert_eq!(solved["cameras"][0]["solution"], json["door"]);
    assert_eq!(
        solved["cameras"][0]["annotations"].as_array().unwrap().len(),
        site.cameras[0].annotations.len()
    );
    let one =
        scratch.calib(&["solve", "site.json", "--camera", "yard", "--format", "json"]).expect_code(0).json();
    assert!(one.get("door").is_none() && one.get("yard").is_some());
}

#[test]
fn a_solved_site_solves_to_the_same_numbers() {
    let (scratch, _) = site();
    let first =
        scratch.calib(&["solve", "site.json", "--format", "json", "-o", "solved.json"]).expect_code(0);
    let again = scratch.calib(&["solve", "solved.json", "--format", "json"]).expect_code(0);
    assert_eq!(first.stdout, again.stdout);
}

#[test]
fn dashes_are_stdin_and_stdout() {
    let (scratch, site) = site();
    let run = scratch.calib_with(&["solve", "-", "-o", "-"], &site.to_json()).expect_code(0);
    assert!(run.json()["cameras"][1]["solution"].is_object());
    assert!(run.stderr.contains("door"), "the report goes where messages go");
}

#[test]
fn an_existing_file_is_kept_unless_forced() {
    let (scratch, _) = site();
    scratch.write("solved.json", "mine");
    let refused = scratch.calib(&["solve", "site.json", "-o", "solved.json"]).expect_code(1);
    assert!(refused.stderr.contains("--force") && refused.stdout.is_empty());
    assert_eq!(std::fs::read_to_string(scratch.path("solved.json")).unwrap(), "mine");
    scratch.calib(&["solve", "site.json", "-o", "solved.json", "--force"]).expect_code(0);
    assert!(scratch.read_json("solved.json")["cameras"].is_array());
}

#[test]
fn wrong_arguments_exit_with_2() {
    let (scratch, _) = site();
    scratch.calib(&["solve"]).expect_code(2);
    scratch.calib(&["solve", "site.json", "--method", "guess"]).expect_code(2);
    let unknown = scratch.calib(&["solve", "site.json", "--camera", "roof"]).expect_code(2);
    assert!(unknown.stderr.contains("door, yard"), "{}", unknown.stderr);
    scratch.calib(&["render", "site.json", "-o", "x.png"]).expect_code(2);
}

#[test]
fn invalid_input_exits_with_3_and_names_file_and_pointer() {
    let (scratch, site) = site();
    rewrite(&scratch, &site, |document| document["cameras"][1]["colour"] = json!("red"));
    let run = scratch.calib(&["solve", "site.json"]).expect_code(3);
    assert!(run.stderr.contains("site.json") && run.stderr.contains("/cameras/1/colour"), "{}", run.stderr);
    scratch.write("site.json", "{ not json");
    scratch.calib(&["solve", "site.json"]).expect_code(3);
    scratch.write("site.json", [0xff, 0xfe, 0x00]);
    scratch.calib(&["solve", "site.json"]).expect_code(3);
    let missing = scratch.calib(&["solve", "nothing.json"]).expect_code(3);
    assert!(missing.stderr.contains("nothing.json"));
}

#[test]
fn wrong_image_size_is_refused_with_both_sizes() {
    let (scratch, site) = site();
    rewrite(&scratch, &site, |document| document["cameras"][0]["size_px"] = json!([1280, 720]));
    let run = scratch.calib(&["render", "site.json", "--camera", "door", "-o", "x.png"]).expect_code(3);
    assert!(run.stderr.contains("1920 x 1080") && run.stderr.contains("1280 x 720"), "{}", run.stderr);
    assert!(!scratch.path("x.png").exists());
    scratch.calib(&["solve", "site.json"]).expect_code(3);
}

#[test]
fn missing_image_is_reported_and_lines_are_solved() {
    let (scratch, _) = site();
    std::fs::remove_file(scratch.path("door.png")).unwrap();
    let run = scratch.calib(&["solve", "site.json"]).expect_code(0);
    assert!(run.stderr.contains("door.png"), "{}", run.stderr);
    scratch.calib(&["render", "site.json", "--camera", "door", "-o", "x.png"]).expect_code(3);
    scratch.calib(&["report", "site.json", "-o", "x.html"]).expect_code(0);
}

#[test]
fn straight_edges_alone_determine_the_lens() {
    let (scratch, mut site) = site();
    let lens = Lens {
        principal_point: Pixel::new(960.0, 540.0),
        focal: 1500.0,
        distortion: Distortion::Division { lambda: -0.2 },
        image_circle: None,
        pixel_aspect: 1.0,
    };
    let edge = |from: [f64; 2], to: [f64; 2]| {
        let points = (0..9).filter_map(|i| {
            let t = f64::from(i) / 8.0;
            let at = |k: usize| from[k] + t * (to[k] - from[k]);
            lens.distort(UndistortedPixel { u: at(0), v: at(1) })
        });
        Annotation { points: Some(points.collect()), ..Annotation::new(Kind::Straight) }
    };
    site.cameras.truncate(1);
    site.cameras[0].annotations = vec![
        edge([100.0, 60.0], [1800.0, 80.0]),
        edge([120.0, 1000.0], [1850.0, 980.0]),
        edge([60.0, 100.0], [90.0, 1000.0]),
        edge([1830.0, 90.0], [1800.0, 1010.0]),
        edge([300.0, 200.0], [1500.0, 1000.0]),
    ];
    let entry: DistortionEntry =
        serde_json::from_value(json!({"model": "division", "fit": ["lambda"]})).unwrap();
    site.cameras[0].lens =
        Some(serde_json::from_value(json!({"focal_px": {"value": 1500.0, "fixed": true}})).unwrap());
    site.cameras[0].lens.as_mut().unwrap().distortion = Some(entry);
    scratch.write("site.json", site.to_json());
    let json = scratch.calib(&["solve", "site.json", "--format", "json"]).expect_code(0).json();
    assert_eq!(json["door"]["stage"], "lens");
    assert!((json["door"]["distortion"]["lambda"].as_f64().unwrap() + 0.2).abs() < 1e-6, "{}", json["door"]);
    scratch.calib(&["undistort", "site.json", "--camera", "door", "-o", "x.jpg"]).expect_code(0);
    assert_eq!(
        std::fs::read(scratch.path("x.jpg")).unwrap()[..2],
        [0xff, 0xd8],
        "the extension selects JPEG"
    );
    scratch.calib(&["render", "site.json", "--camera", "door", "-o", "a.png"]).expect_code(0);
    scratch.calib(&["render", "site.json", "--camera", "door", "--lens-grid", "-o", "b.png"]).expect_code(0);
    let [plain, asked] = ["a.png", "b.png"].map(|name| std::fs::read(scratch.path(name)).unwrap());
    assert_eq!(plain, asked, "the grid of a fitted lens is always shown");
}

#[test]
fn the_grid_of_a_lens_is_straight_once_undistorted() {
    let (scratch, mut site) = site();
    site.cameras.truncate(1);
    site.cameras[0].annotations.clear();
    let lens = json!({"distortion": {"model": "division", "lambda": -0.2, "focal_px": 1500}});
    site.cameras[0].lens = Some(serde_json::from_value(lens).unwrap());
    let lens = site.cameras[0].lens();
    scratch.write("site.json", site.to_json());
    let drawn = |args: &[&str]| {
        let all = [&["render", "site.json", "--camera", "door", "--force", "-o", "x.png"], args].concat();
        scratch.calib(&all).expect_code(0);
        let picture = image::open(scratch.path("x.png")).unwrap().into_rgb8();
        move |x: f64, y: f64| picture.get_pixel(x as u32, y as u32).0 != [90, 90, 90]
    };
    let plain = drawn(&[]);
    assert!((200..900).all(|y| !plain(960.5, f64::from(y))), "the grid of a given lens is shown on request");
    let grid = drawn(&["--lens-grid"]);
    assert!((200..900).all(|y| grid(960.5, f64::from(y))), "the column through the principal point");
    // The first grid line to the right of x = 200 at mid-height, followed up and down.
    let x = (200..900).map(f64::from).find(|&x| grid(x, 580.0)).unwrap();
    let column = lens.undistort(Pixel::new(x + 1.0, 580.5)).unwrap();
    let followed: Vec<Pixel> = (-16..=16)
        .filter_map(|i| lens.distort(UndistortedPixel { v: 540.0 + 30.0 * f64::from(i), ..column }))
        .filter(|p| p.v > 60.0 && p.v < 1000.0)
        .collect();
    assert!(followed.iter().all(|p| grid(p.u, p.v)), "{followed:?}");
    assert!(followed.iter().any(|p| p.u > x + 8.0), "the column is curved: {followed:?}");
}

#[test]
fn broken_images_are_invalid_input() {
    let (scratch, _) = site();
    for contents in [&b"not an image"[..], b"\x89PNG\r\n\x1a\n", b""] {
        scratch.write("door.png", contents);
        let run = scratch.calib(&["render", "site.json", "--camera", "door", "-o", "x.png"]).expect_code(3);
        assert!(run.stderr.contains("door.png"), "{}", run.stderr);
    }
}

#[test]
fn unsolvable_camera_does_not_prevent_the_others() {
    let (scratch, mut site) = site();
    site.cameras[0].annotations.truncate(0);
    scratch.write("site.json", site.to_json());
    let run = scratch.calib(&["solve", "site.json", "--format", "json", "-o", "solved.json"]).expect_code(4);
    let json = run.json();
    assert!(json["door"]["error"]["advice"].as_str().unwrap().contains("Draw"));
    assert!(json["yard"]["focal_px"].is_number());
    assert!(scratch.read_json("solved.json")["cameras"][0]["error"]["code"].is_string());
    assert!(run.stderr.contains("door"), "{}", run.stderr);
}

#[test]
fn paper_method_is_available() {
    let (scratch, _) = site();
    let json =
        scratch.calib(&["solve", "site.json", "--method", "paper", "--format", "json"]).expect_code(0).json();
    assert_eq!(json["door"]["method"], "paper");
    assert!(json["door"].get("sigma").is_none(), "the paper's method has no sigmas");
}

#[test]
fn failed_gate_exits_with_4() {
    let (scratch, _) = site();
    scratch.calib(&["check", "site.json", "--max-floor-error", "0.5"]).expect_code(0);
    let run = scratch
        .calib(&["check", "site.json", "--max-floor-error", "0.00001", "--format", "json"])
        .expect_code(4);
    assert_eq!(run.json()["ok"], json!(false));
    scratch
        .calib(&["check", "site.json", "--max-rms-px", "0.0001", "--max-floor-error", "0.5"])
        .expect_code(4);
}

#[test]
fn images_have_the_full_size() {
    let (scratch, _) = site();
    for args in [
        vec!["render", "site.json", "--camera", "door", "-o", "a.png"],
        vec!["render", "site.json", "--camera", "door", "--sigma", "-o", "b.png"],
        vec!["undistort", "site.json", "--camera", "door", "-o", "c.png"],
    ] {
        scratch.calib(&args).expect_code(0);
        let drawn = image::open(scratch.path(args[args.len() - 1])).unwrap().into_rgb8();
        assert_eq!(drawn.dimensions(), (1920, 1080));
    }
    scratch.calib(&["render", "site.json", "--plan", "-o", "d.png"]).expect_code(0);
    assert!(image::open(scratch.path("d.png")).is_ok());
    scratch.calib(&["report", "site.json", "-o", "e.html"]).expect_code(0);
}

#[test]
fn data_uri_images_are_read() {
    use std::fmt::Write as _;
    let (scratch, mut site) = site();
    let mut tiny = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_pixel(2, 1, image::Rgb([1, 2, 3]))
        .write_to(&mut tiny, image::ImageFormat::Png)
        .unwrap();
    let mut encoded = String::new();
    for chunk in tiny.into_inner().chunks(3) {
        let bits =
            chunk.iter().fold(0_u32, |bits, &byte| bits << 8 | u32::from(byte)) << (8 * (3 - chunk.len()));
        const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
        for i in 0..4 {
            let letter =
                if i <= chunk.len() { LETTERS[(bits >> (18 - 6 * i) & 63) as usize] as char } else { '=' };
            write!(encoded, "{letter}").unwrap();
        }
    }
    site.cameras[0].image = Some(format!("data:image/png;base64,{encoded}"));
    site.cameras[0].size_px = [2, 1];
    site.cameras[0].annotations.clear();
    scratch.write("site.json", site.to_json());
    let undistort = ["undistort", "site.json", "--camera", "door", "-o", "x.png"];
    let unsolved = scratch.calib(&undistort).expect_code(4);
    assert!(unsolved.stderr.contains("the lens of camera \"door\" is unknown"), "{}", unsolved.stderr);
    let lens = json!({"distortion": {"model": "division", "lambda": -0.1, "focal_px": 2}});
    site.cameras[0].lens = Some(serde_json::from_value(lens).unwrap());
    scratch.write("site.json", site.to_json());
    scratch.calib(&undistort).expect_code(1);
    site.cameras[0].image = Some("data:image/png,plain".into());
    scratch.write("site.json", site.to_json());
    scratch.calib(&["undistort", "site.json", "--camera", "door", "-o", "x.png"]).expect_code(3);
}

#[test]
fn the_schema_and_completions_are_printed() {
    let scratch = Scratch::new();
    assert!(scratch.calib(&["schema"]).expect_code(0).json()["properties"]["cameras"].is_object());
    for shell in ["bash", "zsh", "fish", "powershell"] {
        assert!(scratch.calib(&["completions", shell]).expect_code(0).stdout.contains("calib"));
    }
}

/// Returns a site of cameras with given solutions. Half of them have all five Brown-Conrady coefficients.
fn site_with_solutions(count: usize) -> (Vec<Camera>, Site) {
    let mut random = ChaCha8Rng::seed_from_u64(9);
    let mut cameras = Vec::new();
    let mut site = Site::new();
    for index in 0..count {
        let mut between = |low: f64, high: f64| random.random_range(low..high);
        let focal = between(700.0, 2500.0);
        let pinhole = Lens::pinhole(Pixel::new(between(900.0, 1000.0), between(500.0, 580.0)));
        let brown = BrownConrady {
            k1: between(-0.3, 0.1),
            k2: between(-0.05, 0.1),
            k3: between(-0.01, 0.01),
            p1: between(-0.002, 0.002),
            p2: between(-0.002, 0.002),
        };
        let distorted = Lens { focal, distortion: Distortion::BrownConrady(brown), ..pinhole };
        let camera = Camera {
            position: WorldPoint::new(between(-50.0, 50.0), between(-50.0, 50.0), between(2.0, 8.0)),
            yaw: between(-3.1, 3.1),
            pitch: between(0.1, 1.4),
            roll: between(-0.5, 0.5),
            focal,
            lens: if index % 2 == 0 { distorted } else { pinhole },
            covariance: Covariance::EXACT,
        };
        let solution = Solution::from_camera(&camera, Method::Given, Stage::Placed);
        let id = format!("c{index}");
        site.cameras.push(SiteCamera { solution: Some(solution), ..SiteCamera::new(id, [1920, 1080]) });
        cameras.push(camera);
    }
    (cameras, site)
}

fn rows(csv: &str) -> Vec<Vec<String>> {
    csv.lines().map(|line| line.split(',').map(str::to_owned).collect()).collect()
}

#[test]
fn four_hundred_cameras_round_trip() {
    let (cameras, site) = site_with_solutions(400);
    let scratch = Scratch::new();
    scratch.write("site.json", site.to_json());
    let mut random = ChaCha8Rng::seed_from_u64(10);
    let mut compared = 0;
    for (index, camera) in cameras.iter().enumerate() {
        let id = format!("c{index}");
        let pixels: Vec<Pixel> = (0..5)
            .map(|_| Pixel::new(random.random_range(0.0..1920.0), random.random_range(0.0..1080.0)))
            .collect();
        let input: String = pixels.iter().map(|p| format!("x,{},{}\n", p.u, p.v)).collect();
        let args = ["project", "site.json", "--camera", &id, "--to", "floor"];
        let floor = scratch.calib_with(&args, &format!("tag,u,v\n{input}")).expect_code(0).stdout;
        let args = ["project", "site.json", "--camera", &id, "--to", "pixel"];
        let found: Vec<Vec<String>> =
            rows(&floor).into_iter().skip(1).filter(|row| !row[3].is_empty()).collect();
        let back: String = found.iter().map(|row| format!("{},{},0\n", row[3], row[4])).collect();
        let again = scratch.calib_with(&args, &format!("x_m,y_m,z_m\n{back}")).expect_code(0).stdout;
        for (row, there) in rows(&again).iter().skip(1).zip(&found) {
            let number = |text: &String| text.parse::<f64>().unwrap();
            let off = (number(&row[3]) - number(&there[1])).hypot(number(&row[4]) - number(&there[2]));
            assert!(off < 1e-6, "{id}: {off} px");
            let exact = camera.pixel_to_floor(Pixel::new(number(&there[1]), number(&there[2])), 0.0).unwrap();
            let range = exact.distance(camera.position.on_floor());
            let off = (exact.x - number(&there[3])).hypot(exact.y - number(&there[4]));
            assert!(off < 1e-6 * (1.0 + range * range / 100.0), "{id}: {off} m at {range} m");
            compared += 1;
        }
    }
    assert!(compared > 1000, "{compared} points");
}

#[test]
fn every_status_is_reported() {
    let (_, mut site) = site_with_solutions(2);
    let camera = &mut site.cameras[1];
    camera.solution.as_mut().unwrap().pitch_deg = Some(20.0);
    camera.solution.as_mut().unwrap().roll_deg = Some(0.0);
    camera.solution.as_mut().unwrap().focal_px = 1200.0;
    let efov = calib_core::default_efov(&camera.camera().unwrap(), camera.size()).polygon;
    camera.solution.as_mut().unwrap().efov_m = efov;
    let distorted = &mut site.cameras[0];
    distorted.solution.as_mut().unwrap().distortion = Some(DistortionEntry {
        k1: Some(-0.3),
        ..DistortionEntry::new(calib_core::DistortionModel::BrownConrady)
    });
    let scratch = Scratch::new();
    scratch.write("site.json", site.to_json());
    let status = |id: &str, to: &str, header: &str, row: &str| {
        let args = ["project", "site.json", "--camera", id, "--to", to];
        let out = scratch.calib_with(&args, &format!("{header}\n{row}\n")).expect_code(0).stdout;
        rows(&out)[1].last().unwrap().clone()
    };
    assert_eq!(status("c1", "floor", "u,v", "960,1000"), "ok");
    assert_eq!(status("c1", "floor", "u,v", "960,-2000"), "above-horizon");
    assert_eq!(status("c1", "floor", "u,v", "960,1200"), "outside-image");
    assert_eq!(status("c1", "floor", "u,v", "960,200"), "outside-efov");
    assert_eq!(status("c0", "floor", "u,v", "90000,540"), "outside-lens");
    let eye = site.cameras[1].camera().unwrap().position;
    let behind = site.cameras[1].camera().unwrap();
    let (sin, cos) = behind.yaw.sin_cos();
    let at = |ahead: f64| format!("{},{},0", eye.x - sin * ahead, eye.y + cos * ahead);
    assert_eq!(status("c1", "pixel", "x_m,y_m,z_m", &at(-5.0)), "behind-camera");
    assert_eq!(status("c1", "pixel", "x_m,y_m,z_m", &at(3.0 * eye.z)), "ok");
}

#[test]
fn invalid_tables_are_refused_with_their_line() {
    let (_, site) = site_with_solutions(1);
    let scratch = Scratch::new();
    scratch.write("site.json", site.to_json());
    let args = ["project", "site.json", "--camera", "c0", "--to", "floor"];
    let run = scratch.calib_with(&args, "a,b\n1,2\n").expect_code(3);
    assert!(run.stderr.contains("line 1") && run.stderr.contains("u,v"), "{}", run.stderr);
    let run = scratch.calib_with(&args, "u,v\n1,2\n3,many\n").expect_code(3);
    assert!(run.stderr.contains("line 3") && run.stderr.contains("many"), "{}", run.stderr);
    scratch.calib_with(&args, "u,v\n1,2,3\n").expect_code(3);
    let empty = scratch.calib_with(&args, "u,v\n").expect_code(0);
    assert_eq!(empty.stdout.trim(), "u,v,x_m,y_m,status");
}

#[test]
fn calibrations_are_chosen_by_time() {
    let (_, mut site) = site_with_solutions(2);
    site.cameras[1].id = "c0".into();
    site.cameras[0].valid_to = Some("2026-06-01T00:00:00Z".into());
    site.cameras[1].valid_from = Some("2026-06-01T00:00:00Z".into());
    let scratch = Scratch::new();
    scratch.write("site.json", site.to_json());
    let at = |time: &str| {
        let args = ["project", "site.json", "--camera", "c0", "--to", "floor", "--at", time];
        scratch.calib_with(&args, "u,v\n960,1079\n").expect_code(0).stdout
    };
    assert_ne!(at("2026-05-31T23:59:59Z"), at("2026-06-01T02:00:00+01:00"));
    let args = ["project", "site.json", "--camera", "c0", "--to", "floor"];
    scratch.calib_with(&args, "u,v\n960,1079\n").expect_code(2);
    scratch.calib(&["check", "site.json", "--at", "noon"]).expect_code(2);
}

#[test]
fn degenerate_annotations_do_not_crash() {
    let (scratch, mut site) = site();
    site.cameras[0].annotations.push(Annotation::from_segments(Kind::EqualLength, vec![]));
    // Degenerate segments: all points coincide.
    let dot = vec![Pixel::new(5.0, 5.0); 2];
    site.cameras[0]
        .annotations
        .push(Annotation::from_segments(Kind::Vertical, vec![dot.clone(), dot.clone()]));
    site.cameras[1].annotations = vec![Annotation::from_segments(Kind::EqualLength, vec![dot; 5])];
    scratch.write("site.json", site.to_json());
    let run = scratch.calib(&["solve", "site.json", "--format", "json"]);
    assert!(run.code == 0 || run.code == 4, "{run:?}");
    assert!(run.json()["door"].is_object());
}

/// Returns three jointly solved cameras with twelve shared points. One point is wrong in the second camera.
fn shared_site() -> (Scratch, Site) {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut layout = Layout::ring(&mut random, 3, 12, 1.0);
    layout.place_first();
    let wrong = layout.site.links[4].seen[1].px.as_mut().unwrap();
    (wrong.u, wrong.v) = (wrong.u + 60.0, wrong.v + 25.0);
    let at = |i: usize| {
        let seen = layout.site.links[i].seen[0].px.unwrap();
        layout.truth[0].pixel_to_floor(seen, 0.0).unwrap()
    };
    let mut site = layout.site.clone();
    let between = [0, 1].map(|i| site.links[i].id.clone().unwrap());
    let length_m = calib_core::single::Known::prior(at(0).distance(at(1)), 0.05);
    let (id, name) = (None, None);
    site.distances.push(calib_site::Distance { id, name, off: false, keep: false, between, length_m });
    site.cameras[1].image = Some("c1.png".into());
    let [w, h] = site.cameras[1].size_px;
    let scratch = Scratch::new();
    image::RgbImage::from_pixel(w, h, image::Rgb([90, 90, 90])).save(scratch.path("c1.png")).unwrap();
    scratch.write("site.json", site.to_json());
    (scratch, site)
}

#[test]
fn solving_reports_the_agreement_of_cameras() {
    let (scratch, _) = shared_site();
    let run = scratch.calib(&["solve", "site.json", "-o", "solved.json"]).expect_code(0);
    let (_, of_site) = run.stdout.split_once("\nsite\n").unwrap();
    assert!(of_site.contains("3 cameras are connected; scale known"), "{of_site}");
    // Every pair of cameras is listed with the value in the solved site.
    let solved = scratch.read_json("solved.json");
    for pair in solved["solution"]["overlaps"].as_array().unwrap() {
        let [a, b] = [0, 1].map(|i| pair["cameras"][i].as_str().unwrap());
        let row = of_site.lines().find(|line| line.contains(&format!("{a} \u{2013} {b}"))).unwrap();
        let centimetres = format!("{:.1}", 100.0 * pair["floor_rms_m"].as_f64().unwrap());
        assert!(row.contains(&centimetres), "{row}: {centimetres}");
    }
    let worst = &of_site[of_site.find("worst links").unwrap()..of_site.find("more views").unwrap()];
    assert!(!worst.contains("link p4 "), "rejected links are not listed: {worst}");
    assert!(of_site.contains("outlier: Link \"p4\""), "{of_site}");
    // The JSON contains only the solutions by id, because an id may be any name.
    let json = scratch.calib(&["solve", "site.json", "--format", "json"]).expect_code(0).json();
    assert_eq!(json.as_object().unwrap().keys().collect::<Vec<_>>(), ["c0", "c1", "c2"]);
}

#[test]
fn the_report_of_many_cameras_stays_short() {
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let mut layout = Layout::grid(&mut random, [6, 5], 6, 1.0);
    layout.place_first();
    let scratch = Scratch::new();
    scratch.write("site.json", layout.site.to_json());
    let run = scratch.calib(&["solve", "site.json"]).expect_code(0);
    let (_, of_site) = run.stdout.split_once("\nsite\n").unwrap();
    assert!(of_site.lines().count() < 40, "{of_site}");
    assert!(of_site.contains("more pairs, none worse") && of_site.contains("more views, none worse"));
    let px: Vec<f64> = of_site
        .lines()
        .filter(|line| line.trim_start().starts_with("link "))
        .map(|line| line.split_whitespace().rev().nth(1).unwrap().parse().unwrap())
        .collect();
    assert!(px.len() == 5 && px.is_sorted_by(|a, b| a >= b), "the worst first: {px:?}");
}

#[test]
fn gate_on_the_overlap_of_the_site() {
    let (scratch, mut site) = shared_site();
    scratch.calib(&["solve", "site.json", "-o", "solved.json"]).expect_code(0);
    let check = |gate: &[&str], code: i32| {
        scratch.calib(&[&["check", "solved.json", "--format", "json"], gate].concat()).expect_code(code)
    };
    assert!(check(&[], 0).json().get("site").is_none(), "the site is judged only on request");
    let overlaps = scratch.read_json("solved.json")["solution"]["overlaps"].clone();
    let apart = overlaps.as_array().unwrap().iter().map(|pair| pair["floor_rms_m"].as_f64().unwrap());
    let worst = apart.fold(0.0, f64::max);
    let passed = check(&["--max-overlap-m", &(1.01 * worst).to_string()], 0).json();
    assert_eq!(passed["site"], json!({"ok": true, "faults": []}));
    let failed = check(&["--max-overlap-m", &(0.99 * worst).to_string()], 4);
    assert!(failed.json()["ok"] == json!(false) && failed.stderr.contains("the site"), "{failed:?}");
    check(&["--max-overlap-m", "0"], 2);
    // A site without scale or connections cannot pass a gate in metres.
    site.distances.clear();
    scratch.write("solved.json", site.to_json());
    let unscaled = check(&["--max-overlap-m", "1"], 4).json();
    assert!(unscaled["site"]["faults"][0].as_str().unwrap().starts_with("scale-unknown"));
    check(&[], 0);
    site.links.iter_mut().for_each(|link| link.seen.retain(|seen| seen.camera != "c2"));
    scratch.write("solved.json", site.to_json());
    let apart = check(&["--max-overlap-m", "1"], 4).json();
    assert!(apart["site"]["faults"].to_string().contains("not-connected"), "{apart}");
    site.links.clear();
    scratch.write("solved.json", site.to_json());
    let untold = check(&["--max-overlap-m", "1"], 4).json();
    assert!(untold["site"]["faults"].to_string().contains("cannot be compared"), "{untold}");
}

#[test]
fn site_without_plan_is_rendered_with_its_outliers() {
    let (scratch, site) = shared_site();
    scratch.calib(&["solve", "site.json", "-o", "solved.json"]).expect_code(0);
    scratch.calib(&["render", "solved.json", "--plan", "-o", "plan.png"]).expect_code(0);
    let drawn = image::open(scratch.path("plan.png")).unwrap().into_rgb8();
    let is_drawn = |colour: [u8; 3]| drawn.pixels().any(|pixel| pixel.0 == colour);
    assert!(is_drawn([0xC4, 0x12, 0x3A]), "rejected links have the colour of outliers");
    // The same site without links has no legend and no outliers.
    let bare = Site { links: Vec::new(), distances: Vec::new(), ..site };
    scratch.write("bare.json", bare.to_json());
    scratch.calib(&["render", "bare.json", "--plan", "-o", "bare.png"]).expect_code(0);
    let bare = image::open(scratch.path("bare.png")).unwrap().into_rgb8();
    assert!(bare.pixels().all(|pixel| pixel.0 != [0xC4, 0x12, 0x3A]));
}

#[test]
fn report_contains_the_site_and_overlays_contain_links() {
    let (scratch, site) = shared_site();
    scratch.calib(&["solve", "site.json", "-o", "solved.json"]).expect_code(0);
    scratch.calib(&["report", "solved.json", "-o", "page.html"]).expect_code(0);
    let page = std::fs::read_to_string(scratch.path("page.html")).unwrap();
    let (_, section) = page.split_once("<h2>The site</h2>").unwrap();
    let (section, _) = section.split_once("</section>").unwrap();
    for link in &site.links {
        let name = format!("Link {}<", link.id.as_ref().unwrap());
        assert_eq!(section.matches(&name).count(), 1, "{name}");
    }
    assert_eq!(section.matches("rejected<").count(), 1);
    assert_eq!(section.matches("<tr>").count(), 2 + 3 + 3 * site.links.len(), "heads, pairs, every view");
    // Every observation has a ring, and outliers have their own colour.
    scratch.calib(&["render", "solved.json", "--camera", "c1", "-o", "c1-links.png"]).expect_code(0);
    let picture = image::open(scratch.path("c1-links.png")).unwrap().into_rgb8();
    let around = |index: usize| {
        let at = site.links[index].seen[1].px.unwrap();
        let near = |c: f64| (c as i64 - 12)..=(c as i64 + 12);
        near(at.v).flat_map(move |v| near(at.u).map(move |u| (u, v))).map(|(u, v)| (u as u32, v as u32))
    };
    let is_reddish = |(u, v): (u32, u32)| {
        let [r, g, b] = picture.get_pixel(u, v).0;
        r > 200 && g < 130 && b < 160
    };
    assert!(around(4).any(is_reddish) && !around(5).any(is_reddish));
}
