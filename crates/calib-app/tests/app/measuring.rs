//! Measurements in the images: lengths, heights, areas and speeds.

use std::path::{Path, PathBuf};

use calib_app::state::Showing;
use calib_core::{Camera, FloorPoint, Kind, Pixel};
use calib_editor::{Action, Pane, RulerSettings};
use calib_image::CameraChange;
use calib_site::{MeasurementKind, Site, SiteCamera};
use calib_tests::Scratch;
use egui::{Key, Modifiers};
use egui_kittest::kittest::Queryable as _;
use image::ImageEncoder as _;

use crate::desk::{Desk, demo};

/// Canvas of the first camera.
const IMAGE: Pane = Pane::Image(0);

/// Selects the Measure tool for the quantity `kind` and for points at `height`, in metres above the floor.
fn measure(desk: &mut Desk, kind: MeasurementKind, height: f64) {
    desk.take("Measure");
    desk.app().act(Action::Ruler(RulerSettings { kind, height }));
    desk.harness.run_steps(2);
}

fn pose(desk: &Desk) -> Camera {
    *desk.harness.state().editor.session().solved.pose(0).unwrap()
}

/// Asserts that a text on screen begins with a number near `expected`, followed by `unit`.
fn assert_shown(desk: &Desk, expected: f64, unit: &str) {
    let number = |word: &String| word.split_once(unit)?.0.trim().parse::<f64>().ok();
    let words = desk.words();
    let shown: Vec<f64> = words.iter().filter_map(number).collect();
    assert!(shown.iter().any(|shown| (shown - expected).abs() < 0.02 * expected), "{expected}: {words:?}");
}

#[test]
fn lengths_and_heights_are_measured_in_the_images() {
    let mut desk = Desk::new(demo());
    let image = IMAGE;
    let solution = desk.app().editor.session().solved.solution(0).cloned();
    let pose = *desk.app().editor.session().solved.pose(0).unwrap();
    let (a, b) = ([700.0, 800.0], [1100.0, 860.0]);
    let [from, to] = [a, b].map(|at| pose.pixel_to_floor(at.into(), 0.0).unwrap());
    desk.take("Measure");
    desk.click(image, a);
    desk.click(image, b);
    let measured = desk.site().measurements.clone();
    assert_eq!((measured.len(), measured[0].points.len()), (1, 2));
    assert_eq!(
        desk.app().editor.session().solved.solution(0).cloned(),
        solution,
        "measuring changes nothing"
    );
    let words = desk.words();
    let value = words.iter().find(|word| word.ends_with(" m") && word.contains(" m \u{b1} ")).unwrap();
    let shown: f64 = value.split(' ').next().unwrap().parse().unwrap();
    assert!((shown - from.distance(to)).abs() < 0.05, "{value}, expected {}", from.distance(to));
    // A person of 1.8 m at the first point.
    let head = pose.world_to_pixel(from.at_height(1.8)).unwrap();
    let ends = [a, head.into()].map(|at| desk.screen(image, at));
    desk.drag_screen(&ends, Modifiers::SHIFT);
    desk.harness.run_steps(2);
    assert_eq!(desk.site().measurements[1].kind, MeasurementKind::Height);
    assert!(desk.words().iter().any(|word| word.starts_with("1.8") && word.contains(" m \u{b1} ")));
    // A length becomes an annotation, which is not used until its length is entered.
    desk.harness.get_by_label("Use length 1 as a known length").click_accesskit();
    desk.harness.run_steps(3);
    let last = desk.site().cameras[0].annotations.last().unwrap().clone();
    assert!(last.kind == Kind::KnownLength && last.off, "{last:?}");
    desk.harness.get_by_label("Remove length 1").click_accesskit();
    desk.harness.run_steps(3);
    assert_eq!(desk.site().measurements.len(), 1);
    for _ in 0..4 {
        desk.undo();
    }
    assert!(desk.site().measurements.is_empty());
}

#[test]
fn areas_are_measured_corner_by_corner() {
    let mut desk = Desk::new(demo());
    let corners = [[700.0, 800.0], [1100.0, 800.0], [1150.0, 950.0], [650.0, 950.0]];
    let floor = corners.map(|at| pose(&desk).pixel_to_floor(at.into(), 0.0).unwrap());
    let edges = floor.iter().zip(floor.iter().cycle().skip(1));
    let expected = 0.5 * edges.map(|(a, b)| a.x * b.y - b.x * a.y).sum::<f64>().abs();
    measure(&mut desk, MeasurementKind::Area, 0.0);
    desk.click(IMAGE, corners[0]);
    desk.click(IMAGE, corners[1]);
    desk.key(Key::Enter);
    assert!(desk.site().measurements.is_empty());
    assert_eq!(desk.app().editor.session().note.as_deref(), Some("Click at least three corners."));
    desk.click(IMAGE, [1500.0, 900.0]);
    desk.key(Key::Backspace);
    desk.click(IMAGE, corners[2]);
    desk.click(IMAGE, corners[3]);
    desk.click(IMAGE, corners[0]);
    let [area] = &desk.site().measurements[..] else { panic!("{:?}", desk.site().measurements) };
    assert_eq!((area.kind, area.points.len()), (MeasurementKind::Area, 4));
    assert_shown(&desk, expected, " m\u{b2} \u{b1}");
    desk.click(IMAGE, corners[0]);
    desk.key(Key::Escape);
    desk.take("Measure");
    for corner in [corners[1], corners[2], corners[0]] {
        desk.click(IMAGE, corner);
    }
    desk.key(Key::Escape);
    assert_eq!(desk.site().measurements.len(), 1, "the corner before Escape is forgotten");
}

#[test]
fn points_above_the_floor_are_measured_at_their_height() {
    let mut desk = Desk::new(demo());
    let pose = pose(&desk);
    let ends = [[700.0, 800.0], [1100.0, 860.0]].map(|at| pose.pixel_to_floor(at.into(), 0.8).unwrap());
    let [a, b] = ends.map(|at: FloorPoint| pose.world_to_pixel(at.at_height(0.8)).unwrap());
    measure(&mut desk, MeasurementKind::Length, 0.8);
    assert!(desk.words().iter().any(|word| word.contains("0.8 m above the floor")), "{:?}", desk.words());
    desk.click(IMAGE, a.into());
    desk.click(IMAGE, b.into());
    assert!(desk.site().measurements[0].points.iter().all(|point| point.height_m == Some(0.8)));
    assert_shown(&desk, ends[0].distance(ends[1]), " m \u{b1}");
    assert!(desk.words().iter().any(|word| word.ends_with("m, 0.8 m above the floor")), "{:?}", desk.words());
}

#[test]
fn speed_needs_the_time_between_its_points() {
    let mut desk = Desk::new(demo());
    let ends = [[700.0, 800.0], [1100.0, 860.0]];
    let [from, to] = ends.map(|at| pose(&desk).pixel_to_floor(at.into(), 0.0).unwrap());
    measure(&mut desk, MeasurementKind::Speed, 0.0);
    ends.into_iter().for_each(|at| desk.click(IMAGE, at));
    assert!(desk.words().iter().any(|word| word.contains("needs the time between")), "{:?}", desk.words());
    let type_seconds = |desk: &mut Desk, text: &str| {
        desk.harness.get_by_label("Seconds between the points").focus();
        desk.harness.run_steps(2);
        desk.harness.get_by_label("Seconds between the points").type_text(text);
        desk.harness.run_steps(2);
        desk.key(Key::Enter);
        desk.harness.run_steps(2);
    };
    type_seconds(&mut desk, "soon");
    assert_eq!(desk.site().measurements[0].duration_s, None);
    type_seconds(&mut desk, "0,48");
    assert_eq!(desk.site().measurements[0].duration_s, Some(0.48));
    assert_shown(&desk, from.distance(to) / 0.48, " m/s \u{b1}");
    desk.undo();
    assert_eq!(desk.site().measurements[0].duration_s, None);
}

/// Opens a window with a camera of the demonstration, and compares its image with a newer one.
fn compared(scratch: &Scratch, change: impl Fn(&Camera) -> Camera) -> Desk {
    let names = ["store 20260501_080000.png", "store 20260501_080004.png"];
    compared_files(scratch, names, change, |image, path, _| image.save(path).unwrap())
}

/// Works as [`compared`], with image files of the names `old` and `new`. `save` writes an image; its number is 0 for
/// the old image and 1 for the newer one.
fn compared_files(
    scratch: &Scratch,
    [old, new]: [&str; 2],
    change: impl Fn(&Camera) -> Camera,
    save: impl Fn(&image::RgbImage, &Path, usize),
) -> Desk {
    let demo = calib_demo::demo_site();
    let index = demo.site.cameras.iter().position(|camera| camera.id == "store").unwrap();
    let (entry, truth) = (demo.site.cameras[index].clone(), demo.truth[index].1);
    let path = |name: &str| -> PathBuf { scratch.path(name) };
    save(&calib_demo::render(&truth, entry.size_px), &path(old), 0);
    save(&calib_demo::render_later(&change(&truth), entry.size_px), &path(new), 1);
    let image = Some(path(old).to_string_lossy().into_owned());
    let mut desk = Desk::new(Site { cameras: vec![SiteCamera { image, ..entry }], ..Site::new() });
    desk.answer(Some(path(new)));
    desk.keys(Modifiers::SHIFT, Key::C);
    desk.harness.run_steps(2);
    desk.wait(|app| !app.is_comparing());
    desk.harness.run_steps(2);
    desk
}

fn show(desk: &mut Desk, showing: Showing) {
    desk.app().view.glance.showing = showing;
    desk.harness.run_steps(3);
}

#[test]
fn speed_between_two_images_has_the_times_of_their_names() {
    let scratch = Scratch::new();
    let mut desk = compared(&scratch, |camera| *camera);
    let change = desk.harness.state().editor.selected_newer().unwrap().comparison.change;
    assert_eq!(change, CameraChange::Unchanged);
    let [w, h] = desk.site().cameras[0].size();
    let ends: [Pixel; 2] = [[0.4 * w, 0.7 * h].into(), [0.6 * w, 0.75 * h].into()];
    let [from, to] = ends.map(|at| pose(&desk).pixel_to_floor(at, 0.0).unwrap());
    measure(&mut desk, MeasurementKind::Speed, 0.0);
    // The later image first: the points are stored in the order of time.
    show(&mut desk, Showing::New);
    desk.click(IMAGE, ends[1].into());
    show(&mut desk, Showing::Old);
    desk.click(IMAGE, ends[0].into());
    let [speed] = &desk.site().measurements[..] else { panic!("{:?}", desk.words()) };
    let times: Vec<&str> = speed.points.iter().filter_map(|point| point.at.as_deref()).collect();
    assert_eq!(times, ["2026-05-01T08:00:00Z", "2026-05-01T08:00:04Z"]);
    let expected = from.distance(to) / 4.0;
    let found = desk.harness.state().editor.session();
    let solved = found.solved.write_into(&found.site);
    assert!((solved.measure(speed).unwrap().value - expected).abs() < 0.02 * expected);
    assert!(desk.words().iter().any(|word| word.starts_with("The times are in whole seconds")));
}

/// Writes a JPEG file with a capture time in its EXIF data.
fn save_with_time(image: &image::RgbImage, path: &Path, time: &str) {
    /// TIFF tag of the time, with 20 characters at byte 26.
    const DATE_TIME: [u8; 12] = [0x32, 0x01, 2, 0, 20, 0, 0, 0, 26, 0, 0, 0];
    let exif = [&b"II*\0\x08\0\0\0\x01\0"[..], &DATE_TIME, &[0; 4], time.as_bytes(), b"\0"].concat();
    let mut encoder =
        image::codecs::jpeg::JpegEncoder::new_with_quality(std::fs::File::create(path).unwrap(), 95);
    encoder.set_exif_metadata(exif).unwrap();
    image.write_with_encoder(encoder).unwrap();
}

#[test]
fn speed_between_two_photographs_has_their_exif_times() {
    let scratch = Scratch::new();
    let times = ["2026:05:01 08:00:00", "2026:05:01 08:00:03"];
    let names = ["store.jpg", "store today.jpg"];
    let mut desk = compared_files(
        &scratch,
        names,
        |camera| *camera,
        |image, path, index| {
            save_with_time(image, path, times[index]);
        },
    );
    let [w, h] = desk.site().cameras[0].size();
    measure(&mut desk, MeasurementKind::Speed, 0.0);
    show(&mut desk, Showing::Old);
    desk.click(IMAGE, [0.4 * w, 0.7 * h]);
    show(&mut desk, Showing::New);
    desk.click(IMAGE, [0.6 * w, 0.75 * h]);
    let points = &desk.site().measurements[0].points;
    let found: Vec<&str> = points.iter().filter_map(|point| point.at.as_deref()).collect();
    assert_eq!(found, ["2026-05-01T08:00:00Z", "2026-05-01T08:00:03Z"]);
}

#[test]
fn blinking_does_not_split_a_click() {
    let scratch = Scratch::new();
    let mut desk = compared(&scratch, |camera| *camera);
    let [w, h] = desk.site().cameras[0].size();
    measure(&mut desk, MeasurementKind::Length, 0.0);
    show(&mut desk, Showing::Old);
    let at = desk.screen(IMAGE, [0.4 * w, 0.7 * h]);
    let button = |desk: &mut Desk, pressed: bool| {
        let (button, modifiers) = (egui::PointerButton::Primary, Modifiers::NONE);
        desk.harness.event(egui::Event::PointerButton { pos: at, button, pressed, modifiers });
        desk.harness.run_steps(2);
    };
    desk.harness.event(egui::Event::PointerMoved(at));
    button(&mut desk, true);
    show(&mut desk, Showing::New);
    button(&mut desk, false);
    assert!(desk.site().measurements.is_empty(), "{:?}", desk.site().measurements);
    desk.click(IMAGE, [0.6 * w, 0.7 * h]);
    assert_eq!(desk.site().measurements.len(), 1);
}

#[test]
fn newer_image_of_a_moved_camera_is_not_measured() {
    let scratch = Scratch::new();
    let turn = calib_demo::changed_cameras()[1].1;
    let mut desk = compared(&scratch, |camera| turn.apply_to(camera));
    let [w, h] = desk.site().cameras[0].size();
    measure(&mut desk, MeasurementKind::Length, 0.0);
    show(&mut desk, Showing::New);
    desk.click(IMAGE, [0.4 * w, 0.7 * h]);
    desk.click(IMAGE, [0.6 * w, 0.7 * h]);
    assert!(desk.site().measurements.is_empty());
    let note = desk.app().editor.session().note.clone().unwrap_or_default();
    assert!(note.contains("has moved since its calibration"), "{note}");
}
