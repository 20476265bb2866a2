//! Benchmark of the app, without painting: frame times while a mark, the image, the plan or a camera is moved, and
//! solve times while a line is dragged. Prints a JSON object for `cargo xtask bench`.
#![allow(clippy::unwrap_used, reason = "a measurement that cannot be made fails")]

#[path = "../tests/app/desk/mod.rs"]
#[allow(dead_code, reason = "the benchmark uses a part of it")]
mod desk;

use std::io::Write as _;
use std::time::Instant;

use calib_app::command::Command;
use calib_app::storage::files::Images;
use calib_core::Kind;
use calib_editor::Pane;
use calib_editor::Part;
use calib_editor::Session;
use calib_site::{FixedEntry, PlacementEntry, Site};
use desk::{Desk, demo};
use egui::{Event, Key, Modifiers, PointerButton, Pos2};

/// Number of measured frames and solves.
const COUNT: usize = 1000;

/// Returns a site of sixteen cameras, which are copies of three cameras of the demonstration. Each has its own
/// image.
fn sixteen() -> (Site, Images) {
    let mut site = demo();
    let shop = site.cameras[..3].to_vec();
    let mut images = Images::default();
    site.cameras = (0..16)
        .map(|i| {
            let mut camera = shop[i % 3].clone();
            let [w, h] = camera.size_px;
            camera.image = Some(still(&mut images, [w, h], 10 * i as u8));
            camera.id = format!("{}-{i}", camera.id);
            camera
        })
        .collect();
    (site.links, site.distances) = (Vec::new(), Vec::new());
    (site, images)
}

/// Stores a uniform grey image and returns its id.
fn still(images: &mut Images, [w, h]: [u32; 2], grey: u8) -> String {
    let picture = image::RgbImage::from_pixel(w, h, image::Rgb([grey; 3]));
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    images.store(bytes.into_inner().into(), "image/png", None)
}

/// Opens the site in a test window (`Desk`), presses the key of a view, and waits until all images are decoded.
fn arrived(site: Site, images: Images, view: Key) -> Desk {
    let mut desk = Desk::with(site, images);
    desk.key(view);
    let patience = Instant::now();
    while desk.app().pictures.loading() > 0 {
        desk.harness.step();
        assert!(patience.elapsed().as_secs() < 120, "the stills do not arrive");
    }
    // Each frame uploads one texture tile, so 64 frames upload all of them.
    desk.harness.run_steps(64);
    desk
}

/// Measures the duration of every frame, in milliseconds, while a mark is dragged in the view of all cameras.
fn frames() -> Vec<f64> {
    let (site, images) = sixteen();
    let mut desk = arrived(site, images, Key::Num3);
    desk.take("Select");
    let foot = desk.site().marks[0].at_m;
    let from = desk.app().editor.session().solved.pose(0).unwrap().world_to_pixel(foot).unwrap();
    let at = desk.screen(Pane::Image(0), from.into());
    let took = dragged(&mut desk, at, PointerButton::Primary, [20.0, 10.0]);
    assert!(desk.site().marks[0].at_m != foot, "the mark was not dragged");
    took
}

/// Measures the duration of every frame, in milliseconds, while the pointer drags from `at` around an ellipse. `[a,
/// b]` are its semi-axes, in points.
fn dragged(desk: &mut Desk, at: Pos2, button: PointerButton, [a, b]: [f32; 2]) -> Vec<f64> {
    let modifiers = Modifiers::NONE;
    desk.harness.event(Event::PointerMoved(at));
    desk.harness.event(Event::PointerButton { pos: at, button, pressed: true, modifiers });
    desk.harness.step();
    let frame = |i: usize| {
        let angle = i as f32 * 0.05;
        desk.harness.event(Event::PointerMoved(Pos2::new(at.x + a * angle.cos(), at.y + b * angle.sin())));
        let start = Instant::now();
        desk.harness.step();
        1e3 * start.elapsed().as_secs_f64()
    };
    (0..COUNT).map(frame).collect()
}

/// Returns the milliseconds of every solve while a point of the camera's first annotation is dragged.
fn solves(camera: usize) -> Vec<f64> {
    let mut session = Session::new(demo(), Images::default(), None);
    let end = [Part::Vertex { annotation: 0, segment: 0, vertex: 1 }].into();
    let solve = |i: usize| {
        let angle = i as f64 * 0.05;
        calib_editor::edit::shift(&mut session.site, camera, &end, [angle.cos(), angle.sin()]);
        let start = Instant::now();
        assert!(session.solve(), "what was dragged is solved again");
        1e3 * start.elapsed().as_secs_f64()
    };
    (0..COUNT).map(solve).collect()
}

/// Returns the indices of the first and the last camera of the demonstration whose first annotation is a straight
/// edge. The last one is a fisheye.
fn with_edges() -> [usize; 2] {
    let site = demo();
    let has_edges = |camera: &usize| site.cameras[*camera].annotations[0].kind == Kind::Straight;
    let cameras: Vec<usize> = (0..site.cameras.len()).filter(has_edges).collect();
    [cameras[0], cameras[cameras.len() - 1]]
}

fn median(mut took: Vec<f64>) -> f64 {
    took.sort_by(f64::total_cmp);
    took[took.len() / 2]
}

/// Returns the milliseconds of every frame while a 12-megapixel image is panned at four times its fitted
/// zoom.
fn pans() -> Vec<f64> {
    let (mut site, mut images) = (demo(), Images::default());
    site.cameras.truncate(1);
    (site.links, site.distances) = (Vec::new(), Vec::new());
    site.cameras[0].size_px = [4000, 3000];
    site.cameras[0].image = Some(still(&mut images, [4000, 3000], 90));
    let mut desk = arrived(site, images, Key::Num1);
    for _ in 0..6 {
        desk.key(Key::Plus);
    }
    let at = desk.screen(Pane::Image(0), [2000.0, 1500.0]);
    let took = dragged(&mut desk, at, PointerButton::Middle, [200.0, 150.0]);
    assert!(desk.screen(Pane::Image(0), [2000.0, 1500.0]).distance(at) > 10.0, "the image was not panned");
    took
}

/// Returns the milliseconds of every frame while the wheel zooms a plan with forty cameras.
fn wheels() -> Vec<f64> {
    let mut site = demo();
    let all = site.cameras.clone();
    site.cameras = (0..40)
        .map(|i| calib_site::SiteCamera { id: format!("c{i}"), lens: None, ..all[i % all.len()].clone() })
        .collect();
    (site.links, site.marks, site.distances) = Default::default();
    let mut desk = Desk::new(site);
    desk.key(Key::Num2);
    let at = desk.screen(Pane::Plan, [10.0, 8.0]);
    desk.harness.event(Event::PointerMoved(at));
    desk.harness.run_steps(4);
    let tick = |i: usize| {
        let delta = egui::vec2(0.0, if i % 20 < 10 { 24.0 } else { -24.0 });
        let (unit, phase) = (egui::MouseWheelUnit::Point, egui::TouchPhase::Move);
        desk.harness.event(Event::MouseWheel {
            unit,
            delta,
            phase,
            source: egui::MouseWheelSource::Unknown,
            modifiers: Modifiers::NONE,
        });
        let start = Instant::now();
        desk.harness.step();
        1e3 * start.elapsed().as_secs_f64()
    };
    (0..200).map(tick).collect()
}

/// Measures the duration of every frame, in milliseconds, while a camera is dragged on the plan and the coverage is
/// recomputed.
fn coverage_drags() -> Vec<f64> {
    let mut site = demo();
    // A camera with control points cannot be dragged.
    site.cameras[0].control_points.clear();
    site.cameras[0].placement = Some(PlacementEntry {
        move_m: [18.0, 10.0].into(),
        turn_deg: 130.0,
        scale: Some(1.3),
        fixed: false,
        held: FixedEntry::default(),
        estimated: false,
    });
    site.links.clear();
    let mut desk = Desk::new(site);
    desk.key(Key::Num2);
    desk.tell(Command::Coverage);
    let foot = desk.app().editor.session().solved.pose(0).unwrap().position.on_floor();
    let at = desk.screen(Pane::Plan, foot.into());
    let took = dragged(&mut desk, at, PointerButton::Primary, [40.0, 30.0]);
    let now = desk.app().editor.session().solved.pose(0).unwrap().position.on_floor();
    assert!(now.distance(foot) > 0.1, "the camera was not dragged");
    took
}

fn main() {
    let coverage = median(coverage_drags());
    let wheel = median(wheels());
    let mut frames = frames();
    frames.sort_by(f64::total_cmp);
    let (middle, worst) = (frames[COUNT / 2], frames[COUNT - 1]);
    let [edge, fisheye] = with_edges().map(|camera| median(solves(camera)));
    let (solve, pan) = (median(solves(0)), median(pans()));
    let mut out = std::io::stdout().lock();
    writeln!(
        out,
        r#"{{"app_frame_16_cameras_ms":{middle:.3},"app_frame_16_cameras_worst_ms":{worst:.3},"app_drag_solve_ms":{solve:.4},"app_drag_edge_ms":{edge:.4},"app_drag_fisheye_edge_ms":{fisheye:.4},"app_pan_12_megapixels_ms":{pan:.3},"app_plan_wheel_40_cameras_ms":{wheel:.3},"app_drag_coverage_ms":{coverage:.3}}}"#
    )
    .unwrap();
}
