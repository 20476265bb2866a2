//! Real cameras: three surveillance views of one shelter with manually annotated lines and known control points.

use std::collections::BTreeMap;

use calib_core::{
    Annotation, BrownConrady, Camera, Distortion, DistortionModel, Kind, Lens, LensFit, LensOptions, Pixel,
    WorldPoint,
};

use calib_core::outcome::Source;

use calib_core::single::{Edge, Known, straightness_rms};

use calib_site::{
    ControlPointEntry, Distance, DistortionEntry, LensEntry, Link, LinkKind, LinkObservation, Options, Site,
    SiteCamera, Stage,
};
use calib_tests::{Scratch, map_distance, shared};
use serde_json::Value;

type Segments = Vec<Vec<Pixel>>;

/// Lines of G341, annotated on its frame for these tests: edges of the building and its canopy, posts and
/// kerbs.
const G341_VERTICAL: [[[f64; 2]; 2]; 9] = [
    [[89.84, 6.00], [101.89, 285.00]],
    [[416.84, 456.00], [418.39, 520.00]],
    [[500.75, 442.00], [502.48, 545.00]],
    [[736.99, 413.00], [737.14, 505.00]],
    [[948.09, 380.00], [947.32, 470.00]],
    [[1172.23, 350.00], [1168.08, 488.00]],
    [[1375.56, 408.02], [1371.68, 495.99]],
    [[1613.61, 248.06], [1603.83, 407.99]],
    [[1515.32, 6.00], [1506.40, 165.00]],
];
const G341_ALONG: [[[f64; 2]; 2]; 7] = [
    [[533.00, 438.02], [1150.00, 342.76]],
    [[545.00, 335.86], [1125.00, 260.66]],
    [[1179.00, 348.34], [1610.00, 281.52]],
    [[1215.00, 297.56], [1575.00, 246.43]],
    [[1176.17, 493.41], [1602.85, 411.20]],
    [[1177.97, 585.88], [1560.25, 499.59]],
    [[244.95, 264.53], [780.10, 209.43]],
];
const G341_ACROSS: [[[f64; 2]; 2]; 6] = [
    [[191.81, 344.69], [517.37, 433.86]],
    [[192.34, 264.52], [516.04, 340.81]],
    [[797.01, 197.95], [1119.94, 253.38]],
    [[1263.94, 191.39], [1585.10, 238.30]],
    [[1030.39, 469.30], [1160.17, 500.27]],
    [[337.28, 607.90], [462.35, 652.08]],
];

fn drawn(lines: &[[[f64; 2]; 2]]) -> Segments {
    lines.iter().map(|ends| ends.map(Pixel::from).to_vec()).collect()
}

fn read(lines: &Value) -> Segments {
    serde_json::from_value(lines.clone()).unwrap()
}

/// Reference calibration of a frame.
struct Truth {
    focal: f64,
    pitch: f64,
    roll: f64,
    centre: WorldPoint,
}

fn truth(camera: &Value) -> Truth {
    let truth = &camera["truth"];
    let number = |key: &str| truth[key].as_f64().unwrap();
    Truth {
        focal: number("focal_px"),
        pitch: number("pitch_down_deg"),
        roll: number("roll_deg"),
        centre: serde_json::from_value(truth["centre_m"].clone()).unwrap(),
    }
}

/// Returns the site of the shelter with fixed intrinsics. The focal length is fixed if `fix_focal` is set.
fn shelter(data: &Value, frames: &std::path::Path, fix_focal: bool) -> Site {
    let cameras = data["cameras"].as_object().unwrap().iter().map(|(id, camera)| {
        let truth = &camera["truth"];
        let number = |key: &str| truth[key].as_f64().unwrap();
        let distortion = DistortionEntry {
            k1: Some(number("k1")),
            k2: Some(number("k2")),
            focal_px: Some(number("focal_px")),
            ..DistortionEntry::new(DistortionModel::BrownConrady)
        };
        let lens = LensEntry {
            focal_px: fix_focal.then(|| Known::fixed(number("focal_px"))),
            principal_point_px: Some(serde_json::from_value(truth["principal_point"].clone()).unwrap()),
            distortion: (number("k1") != 0.0).then_some(distortion),
            ..LensEntry::default()
        };
        let lines = &camera["lines"];
        let [vertical, along, across] = if lines.is_null() {
            [drawn(&G341_VERTICAL), drawn(&G341_ALONG), drawn(&G341_ACROSS)]
        } else {
            ["vertical", "floor_parallel", "floor_perpendicular"].map(|key| read(&lines[key]))
        };
        let parallel = |id: &str, lines| Annotation {
            id: Some(id.into()),
            ..Annotation::from_segments(Kind::Parallel, lines)
        };
        let across = Annotation { at_right_angles_to: Some("along".into()), ..parallel("across", across) };
        let points = camera["control_points"].as_array().unwrap().iter().map(control_point);
        SiteCamera {
            image: Some(frames.join(camera["image"].as_str().unwrap()).to_string_lossy().into_owned()),
            lens: Some(lens),
            annotations: vec![
                Annotation::from_segments(Kind::Vertical, vertical),
                parallel("along", along),
                across,
            ],
            control_points: points.collect(),
            ..SiteCamera::new(id, serde_json::from_value(camera["size"].clone()).unwrap())
        }
    });
    Site { name: Some("Shelter".into()), cameras: cameras.collect(), ..Site::new() }
}

fn control_point(point: &Value) -> ControlPointEntry {
    ControlPointEntry {
        id: Some(point["id"].to_string()),
        world_m: serde_json::from_value(point["world_m"].clone()).unwrap(),
        ..ControlPointEntry::new(serde_json::from_value(point["px"].clone()).unwrap())
    }
}

fn data() -> Option<(Value, std::path::PathBuf)> {
    let file = shared("real/meva/meva.json")?;
    let data = serde_json::from_str(&std::fs::read_to_string(&file).unwrap()).unwrap();
    Some((data, file.parent().unwrap().to_owned()))
}

/// Returns options for stage 1 and placement of each camera, without joint refinement.
fn without_refinement() -> Options {
    Options { refine: false, ..Options::default() }
}

/// Solves the site and passes every camera with its reference to `check`.
fn solve(fix_focal: bool, options: &Options, check: impl Fn(&str, &SiteCamera, &Camera, &Truth)) {
    let Some((data, frames)) = data() else { return };
    let site = shelter(&data, &frames, fix_focal);
    let solved = site.calibrate(options).write_into(&site);
    for camera in &solved.cameras {
        let found = camera.camera().unwrap_or_else(|| panic!("{}: {:?}", camera.id, camera.error));
        check(&camera.id, camera, &found, &truth(&data["cameras"][&camera.id]));
    }
}

#[test]
fn lines_determine_the_cameras_with_unknown_focal() {
    solve(false, &without_refinement(), |id, entry, found, truth| {
        let focal = found.focal / truth.focal - 1.0;
        let pitch = found.pitch.to_degrees() - truth.pitch;
        let roll = found.roll.to_degrees() - truth.roll;
        let solution = entry.solution.as_ref().unwrap();
        let sigma = solution.sigma.as_ref().unwrap();
        println!(
            "{id}: focal {:+.2} % (sigma {:.2}), pitch {pitch:+.2} (sigma {:.2}), roll {roll:+.2} (sigma {:.2}), chi2 {:.1} on {}",
            100.0 * focal,
            100.0 * sigma.focal_px.unwrap() / found.focal,
            sigma.pitch_deg.unwrap(),
            sigma.roll_deg.unwrap(),
            solution.chi2.unwrap(),
            solution.dof.unwrap(),
        );
        let (focal_limit, pitch_limit, roll_limit) = match id {
            "G506" => (0.06, 1.0, 0.6),
            "G505" => (0.04, 1.2, 0.6),
            // Our own lines; the reference pitch and roll are accurate to 0.8 degrees.
            _ => (0.06, 1.2, 0.6),
        };
        assert!(focal.abs() < focal_limit && pitch.abs() < pitch_limit && roll.abs() < roll_limit, "{id}");
        // The reference pitch and roll are accurate to 0.8 degrees. The remaining error is within three
        // standard deviations.
        assert!(focal.abs() * found.focal < 3.0 * sigma.focal_px.unwrap(), "{id}: focal");
        assert!(pitch.abs() < (3.0 * sigma.pitch_deg.unwrap()).hypot(0.8), "{id}: pitch");
        assert!(roll.abs() < (3.0 * sigma.roll_deg.unwrap()).hypot(0.8), "{id}: roll");
    });
}

#[test]
fn lines_determine_pitch_and_roll_with_fixed_intrinsics() {
    solve(true, &without_refinement(), |id, _, found, truth| {
        let pitch = found.pitch.to_degrees() - truth.pitch;
        let roll = found.roll.to_degrees() - truth.roll;
        println!("{id}: pitch {pitch:+.2}, roll {roll:+.2}");
        assert_eq!(found.focal, truth.focal);
        assert!(pitch.abs() < 1.2 && roll.abs() < 0.7, "{id}: {pitch} {roll}");
    });
}

#[test]
fn paper_method_finds_the_cameras() {
    let options = Options { method: calib_site::Method::Paper, ..Options::default() };
    solve(false, &options, |id, _, found, truth| {
        let focal = found.focal / truth.focal - 1.0;
        let pitch = found.pitch.to_degrees() - truth.pitch;
        println!("{id}: focal {:+.2} %, pitch {pitch:+.2}", 100.0 * focal);
        assert!(focal.abs() < 0.06 && pitch.abs() < 1.2, "{id}: {focal} {pitch}");
    });
}

#[test]
fn control_points_place_the_cameras() {
    // Pitch is known to half a degree. That is 0.1 m at 10 m, and more than 0.5 m at 60 m. With refinement,
    // the control points determine the pitch, too.
    for (options, stage, [near, far]) in
        [(without_refinement(), Stage::Placed, [0.8, 2.5]), (Options::default(), Stage::Refined, [0.15, 1.0])]
    {
        solve(true, &options, |id, entry, found, truth| {
            let solution = entry.solution.as_ref().unwrap();
            assert_eq!(solution.stage, stage);
            let off = found.position.distance(truth.centre);
            let pitch = found.pitch.to_degrees() - truth.pitch;
            println!("{id} {stage:?}: {off:.2} m from the true centre, pitch {pitch:+.2} deg");
            assert!(off < if id == "G341" { far } else { near }, "{id}: {off} m");
        });
    }
}

/// Pixels of a control point by camera, and its world position.
type Shown = (Vec<(String, Pixel)>, WorldPoint);

/// Control points by id.
type Points = BTreeMap<u64, Shown>;

fn points(data: &Value) -> Points {
    let mut points = Points::new();
    for (id, camera) in data["cameras"].as_object().unwrap() {
        for point in camera["control_points"].as_array().unwrap() {
            let world = serde_json::from_value(point["world_m"].clone()).unwrap();
            let seen = &mut points.entry(point["id"].as_u64().unwrap()).or_insert((Vec::new(), world)).0;
            seen.push((id.clone(), serde_json::from_value(point["px"].clone()).unwrap()));
        }
    }
    points
}

/// Returns the rigid transformation of the floor plane that fits the pairs best.
fn rigid(pairs: &[(WorldPoint, WorldPoint)]) -> impl Fn(WorldPoint) -> WorldPoint + use<> {
    let count = pairs.len() as f64;
    let mean =
        |value: &dyn Fn(&(WorldPoint, WorldPoint)) -> f64| pairs.iter().map(value).sum::<f64>() / count;
    let from = [mean(&|p| p.0.x), mean(&|p| p.0.y)];
    let to = [mean(&|p| p.1.x), mean(&|p| p.1.y)];
    let (mut along, mut across) = (0.0, 0.0);
    for (a, b) in pairs {
        let (x, y, u, v) = (a.x - from[0], a.y - from[1], b.x - to[0], b.y - to[1]);
        along += x * u + y * v;
        across += x * v - y * u;
    }
    let (sin, cos) = across.atan2(along).sin_cos();
    move |p: WorldPoint| {
        let (x, y) = (p.x - from[0], p.y - from[1]);
        WorldPoint::new(to[0] + cos * x - sin * y, to[1] + sin * x + cos * y, p.z)
    }
}

#[test]
fn links_and_one_distance_recover_the_shelter() {
    let Some((data, frames)) = data() else { return };
    let mut site = shelter(&data, &frames, true);
    site.cameras.iter_mut().for_each(|camera| camera.control_points.clear());
    let all = points(&data);
    // Every third shared point is kept for validation.
    let shared: Vec<(&u64, &Shown)> = all.iter().filter(|(_, (seen, _))| seen.len() > 1).collect();
    let (held, used): (Vec<_>, Vec<_>) = shared.iter().enumerate().partition(|(i, _)| i % 3 == 2);
    site.links = used.iter().map(|(_, (id, (seen, at)))| link(**id, seen, at.z)).collect();
    let (a, b) = (&all[&35].1, &all[&37].1);
    site.distances.push(Distance {
        id: None,
        name: None,
        off: false,
        keep: false,
        between: ["35".into(), "37".into()],
        length_m: Known::prior(a.distance(*b), 0.02),
    });
    let report = site.calibrate(&Options::default());
    assert_eq!(report.site.components, [["G341", "G505", "G506"]]);
    let cameras: BTreeMap<&str, Camera> = report
        .cameras
        .iter()
        .map(|(index, solution)| {
            (site.cameras[*index].id.as_str(), solution.as_ref().unwrap().camera().unwrap())
        })
        .collect();
    let truths: BTreeMap<&str, Truth> = cameras.keys().map(|&id| (id, truth(&data["cameras"][id]))).collect();
    let [near, other] = ["G505", "G506"];
    let apart = cameras[near].position.distance(cameras[other].position);
    let truly = truths[near].centre.distance(truths[other].centre);
    println!("G505 to G506: {apart:.2} m, in truth {truly:.2} m; warnings {:?}", report.site.warnings);
    assert!((apart - truly).abs() < 0.25, "{apart} not {truly}");
    // The frame of the solution is arbitrary: the links align it with the true frame.
    let laid: Vec<(WorldPoint, WorldPoint)> = site
        .links
        .iter()
        .zip(&report.links)
        .map(|(link, found)| {
            (found.as_ref().unwrap().at_m, all[&link.id.as_ref().unwrap().parse().unwrap()].1)
        })
        .collect();
    let into_truth = rigid(&laid);
    for (id, camera) in &cameras {
        let off = into_truth(camera.position).distance(truths[id].centre);
        println!("{id}: {off:.2} m from the true centre");
        assert!(off < if *id == "G341" { 2.0 } else { 0.3 }, "{id}: {off} m");
    }
    let into_found = rigid(&laid.iter().map(|(a, b)| (*b, *a)).collect::<Vec<_>>());
    let mut errors: Vec<f64> = Vec::new();
    for (_, (_, (seen, at))) in &held {
        for (id, pixel) in seen {
            errors.push(cameras[id.as_str()].world_to_pixel(into_found(*at)).unwrap().distance(*pixel));
        }
    }
    let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
    println!("{} validation points: {rms:.1} px rms", errors.len());
    assert!(rms < 8.0, "{rms} px");
}

fn link(id: u64, seen: &[(String, Pixel)], height: f64) -> Link {
    let seen =
        seen.iter().map(|(camera, px)| LinkObservation { px: Some(*px), ..LinkObservation::new(camera) });
    let link = Link::new(Some(id.to_string()), LinkKind::Point, seen.collect());
    Link { height_m: Some(height), ..link }
}

#[test]
fn half_of_the_control_points_predict_the_other_half() {
    let Some((data, frames)) = data() else { return };
    let mut site = shelter(&data, &frames, true);
    for camera in &mut site.cameras {
        camera.control_points.iter_mut().enumerate().for_each(|(i, point)| point.off = i % 2 == 1);
    }
    let report = site.calibrate(&Options::default());
    for (index, solution) in &report.cameras {
        let (entry, solution) = (&site.cameras[*index], solution.as_ref().unwrap());
        let camera = solution.camera().unwrap();
        let mut errors: Vec<f64> = entry
            .control_points
            .iter()
            .filter(|point| point.off)
            .map(|point| camera.world_to_pixel(point.world_m.unwrap()).unwrap().distance(point.px))
            .collect();
        errors.sort_by(f64::total_cmp);
        let (median, worst) = (errors[errors.len() / 2], errors[errors.len() - 1]);
        println!("{}: validation points: median {median:.1} px, worst {worst:.1} px", entry.id);
        assert!(median < 4.0, "{}: {median} px", entry.id);
    }
}

/// Straight edges of the frames, annotated for these tests: the rim of the canopy, sides of columns, the slab
/// and its joints, courses of the wall.
///
/// Each was clicked roughly. A script then moved every point across its edge to the largest brightness
/// change, or to the smallest brightness in a joint.
const EDGES: &str = include_str!("shelter_edges.json");

fn edges(camera: &str) -> Vec<Edge> {
    let drawn: Value = serde_json::from_str(EDGES).unwrap();
    let lines = drawn[camera].as_object().unwrap().values().enumerate();
    lines
        .map(|(annotation, points)| Edge {
            points: serde_json::from_value(points.clone()).unwrap(),
            source: Source { annotation, segment: 0 },
        })
        .collect()
}

#[test]
fn edges_of_the_scene_determine_the_lenses() {
    let Some((data, _)) = data() else { return };
    // Largest root mean square distance from the reference map over the image, in pixels. The reference lens
    // of G341 has no distortion, and nearly all its edges are in the middle.
    for (id, most) in [("G505", 0.6), ("G506", 2.5), ("G341", 1.0)] {
        let camera = &data["cameras"][id];
        let number = |key: &str| camera["truth"][key].as_f64().unwrap();
        let brown = BrownConrady { k1: number("k1"), k2: number("k2"), ..BrownConrady::default() };
        let given = Lens {
            principal_point: serde_json::from_value(camera["truth"]["principal_point"].clone()).unwrap(),
            focal: number("focal_px"),
            distortion: Distortion::BrownConrady(brown),
            image_circle: None,
            pixel_aspect: 1.0,
        };
        let size: [f64; 2] = serde_json::from_value(camera["size"].clone()).unwrap();
        let options = LensOptions {
            principal_point: given.principal_point,
            is_centre_fixed: true,
            pixel_aspect: 1.0,
            circle: None,
            size,
            fitted: None,
            focal: None,
            // Columns and kerbs are straight to a few tenths of a pixel.
            sigma: 0.3,
        };
        let edges = edges(id);
        let fit = LensFit::new(&edges, &options).unwrap();
        let apart = map_distance(&fit.lens, &given, size);
        let [before, after] = fit.straightness;
        let square =
            |edge: &Edge| straightness_rms(&given, &edge.points).unwrap().powi(2) * edge.points.len() as f64;
        let points: usize = edges.iter().map(|edge| edge.points.len()).sum();
        let under_given = (edges.iter().map(square).sum::<f64>() / points as f64).sqrt();
        let found = format!(
            "{id}: {apart:.2} px rms from the given map, predicted {:.1?} px halfway, at the edge and in the corner; {} edges \
             {after:.2} px rms off straight, {under_given:.2} under the given lens, {before:.2} without one; {:?}",
            fit.map_error,
            edges.len(),
            fit.lens.at_focal(given.focal).unwrap().distortion,
        );
        println!("{found}");
        assert!(apart < most && apart < 3.0 * fit.map_error[1], "{found}");
        assert!(after < under_given + 0.01, "{found}");
    }
}

#[test]
fn command_line_solves_renders_and_checks_the_shelter() {
    let Some((data, frames)) = data() else { return };
    let scratch = Scratch::new();
    scratch.write("site.json", shelter(&data, &frames.canonicalize().unwrap(), false).to_json());
    scratch.calib(&["solve", "site.json", "-o", "solved.json"]).expect_code(0);
    for id in ["G505", "G506", "G341"] {
        let picture = format!("{id}.png");
        let render = ["render", "solved.json", "--camera", id, "-o", &picture];
        let run = scratch.calib(&render).expect_code(3);
        assert!(run.stderr.contains("--allow-outside"), "the images are outside the folder: {}", run.stderr);
        scratch.calib(&[&render[..], &["--allow-outside"]].concat()).expect_code(0);
        let drawn = image::open(scratch.path(&format!("{id}.png"))).unwrap().into_rgb8();
        let solved = scratch.read_json("solved.json");
        let size =
            solved["cameras"].as_array().unwrap().iter().find(|c| c["id"] == id).unwrap()["size_px"].clone();
        assert_eq!(serde_json::json!([drawn.width(), drawn.height()]), size);
    }
    scratch.calib(&["render", "solved.json", "--plan", "-o", "plan.png"]).expect_code(0);
    let undistort = ["undistort", "solved.json", "--camera", "G506", "-o", "straight.png", "--allow-outside"];
    scratch.calib(&undistort).expect_code(0);
    scratch.calib(&["report", "solved.json", "-o", "report.html", "--allow-outside"]).expect_code(0);
    let page = std::fs::read_to_string(scratch.path("report.html")).unwrap();
    assert!(page.contains("G341") && !page.contains("src=\"http"), "one self-contained page");
    scratch.calib(&["check", "solved.json", "--max-floor-error", "0.02", "--allow", "misfit"]).expect_code(0);
    scratch
        .calib(&["check", "solved.json", "--max-floor-error", "0.001", "--allow", "misfit"])
        .expect_code(4);
}
