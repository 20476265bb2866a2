//! A newer image of a camera: compared, inspected, and used to recover the camera with one key.

use std::path::PathBuf;

use calib_app::choice::Chosen;
use calib_app::command::Command;
use calib_app::state::Showing;
use calib_core::{Camera, Covariance};
use calib_editor::{Action, Images, NewerAction, Pane};
use calib_image::CameraChange;
use calib_site::{Method, Options, Site, SiteCamera};
use calib_tests::Scratch;
use egui::{Context, Key, Modifiers};
use egui_kittest::kittest::Queryable as _;

use crate::desk::{self, Desk};

/// Returns an annotated camera of the demonstration and its true parameters.
fn store() -> (SiteCamera, Camera) {
    let demo = calib_demo::demo_site();
    let index = demo.site.cameras.iter().position(|camera| camera.id == "store").unwrap();
    (demo.site.cameras[index].clone(), demo.truth[index].1)
}

/// Opens a window with only the camera of [`store`]; `old` is the file name of its image.
fn desk(scratch: &Scratch, old: &str) -> Desk {
    let entry = SiteCamera { image: Some(path(scratch, old)), ..store().0 };
    Desk::new(Site { cameras: vec![entry], ..Site::new() })
}

fn path(scratch: &Scratch, name: &str) -> String {
    scratch.path(name).to_string_lossy().into_owned()
}

/// Requests a newer image, chooses it and waits for the comparison.
fn compare(desk: &mut Desk, file: PathBuf) {
    desk.answer(Some(file));
    desk.keys(Modifiers::SHIFT, Key::C);
    desk.harness.run_steps(2);
    desk.wait(|app| !app.is_comparing());
    desk.harness.run_steps(2);
}

fn change(desk: &Desk) -> Option<CameraChange> {
    Some(desk.harness.state().editor.selected_newer()?.comparison.change)
}

fn since(desk: &mut Desk, time: &str) {
    desk.app().act(Action::Newer(NewerAction::SetSince(time.into())));
}

#[test]
fn zoomed_camera_is_recovered_by_one_key_and_undone_by_another() {
    let scratch = Scratch::new();
    let (entry, truth) = store();
    let turn = calib_demo::changed_cameras()[1].1;
    calib_demo::render(&truth, entry.size_px).save(scratch.path("store.png")).unwrap();
    let later = calib_demo::render_later(&turn.apply_to(&truth), entry.size_px);
    later.save(scratch.path("today.png")).unwrap();
    let mut desk = desk(&scratch, "store.png");
    compare(&mut desk, scratch.path("today.png"));
    assert_eq!(change(&desk), Some(CameraChange::Moved));
    assert!(desk.harness.query_by_label("Moved").is_some(), "{:?}", desk.words());
    assert!(desk.words().iter().any(|word| word.starts_with("zoom 1.03")), "{:?}", desk.words());
    for (_, word) in Showing::ALL {
        desk.harness.get_by_label(word).click();
        desk.harness.run_steps(2);
    }
    let before = desk.site().clone();
    assert_wipe_follows(&mut desk);
    assert_eq!(*desk.site(), before);
    desk.keys(Modifiers::SHIFT, Key::R);
    assert_eq!(*desk.site(), before, "without a time in the file name, the time of the change is requested");
    assert!(!desk.app().is_comparing());
    since(&mut desk, "2026-06-01T09:00:00Z");
    desk.keys(Modifiers::SHIFT, Key::R);
    assert!(desk.app().is_comparing());
    desk.tell(Command::DismissNewer);
    assert_eq!(change(&desk), Some(CameraChange::Moved), "the comparison is kept during recovery");
    desk.wait(|app| !app.is_comparing());
    desk.harness.run_steps(3);
    let [new, old] = &desk.site().cameras[..] else { panic!("two periods: {:?}", desk.app().editor.error()) };
    assert_eq!(new.valid_from.as_deref(), Some("2026-06-01T09:00:00Z"));
    assert_eq!((&old.valid_to, &old.annotations), (&new.valid_from, &before.cameras[0].annotations));
    assert!(new.image.as_ref().unwrap().ends_with("today.png"), "{:?}", new.image);
    assert_eq!(old.solution.as_ref().map(|found| found.method), Some(Method::Kept));
    let solved = &desk.harness.state().editor.session().solved;
    let (now, then) = (solved.pose(0).unwrap(), solved.pose(1).unwrap());
    let expected = turn.apply_to(&truth);
    for (index, off) in
        [(Covariance::PITCH, now.pitch - expected.pitch), (Covariance::FOCAL, now.focal - expected.focal)]
    {
        let sigma = now.covariance.sigma(index).unwrap();
        assert!(off.abs() < 3.5 * sigma, "{off} off, sigma {sigma}");
    }
    assert!((now.focal / then.focal - 1.03).abs() < 0.01, "{} and {}", now.focal, then.focal);
    assert_eq!(change(&desk), None, "the newer image is the camera's image now");
    desk.app().act(Action::SelectCamera(1));
    assert_eq!(change(&desk), None, "the old period ended when the newer image was taken");
    let after = desk.site().clone();
    desk.undo();
    assert_eq!((desk.site(), change(&desk)), (&before, Some(CameraChange::Moved)));
    desk.redo();
    assert_eq!(*desk.site(), after);
    assert_kept_until_edited(&mut desk);
}

/// Asserts that the wipe line between the images follows the drag.
fn assert_wipe_follows(desk: &mut Desk) {
    desk.harness.get_by_label("Wipe").click();
    desk.harness.run_steps(2);
    let [w, h] = desk.site().cameras[0].size();
    let from = w * f64::from(desk.app().view.glance.share);
    let [from, to] = [from, 0.25 * w].map(|u| desk.screen(Pane::Image(0), [u, 0.4 * h]));
    desk.drag_screen(&[from, from.lerp(to, 0.5), to], Modifiers::NONE);
    assert!((desk.app().view.glance.share - 0.25).abs() < 0.01, "{:?}", desk.app().view.glance);
}

/// Asserts that the old period keeps its solution until its annotations change.
fn assert_kept_until_edited(desk: &mut Desk) {
    let session = desk.harness.state().editor.session();
    let saved = session.solved.write_into(&session.site);
    let again = saved.calibrate(&Options::default()).write_into(&saved);
    let pose = |site: &Site| site.cameras[1].camera().unwrap();
    assert_eq!(pose(&again).focal, pose(&saved).focal);
    desk::change(desk.app(), "draw on the old", |site| drop(site.cameras[1].annotations.pop()));
    assert!(desk.site().cameras[1].solution.is_none(), "it is no longer kept");
}

/// Writes an image of one colour, which has no edges and is compared at once.
fn grey(scratch: &Scratch, name: &str, [w, h]: [u32; 2]) {
    image::RgbImage::from_pixel(w, h, image::Rgb([90; 3])).save(scratch.path(name)).unwrap();
}

#[test]
fn dropped_file_named_by_camera_and_time_is_its_newer_image() {
    let scratch = Scratch::new();
    let size = store().0.size_px;
    for name in ["store.png", "store_20260601_0900.png", "door.png"] {
        grey(&scratch, name, size);
    }
    let mut desk = desk(&scratch, "store.png");
    let ctx: Context = desk.harness.ctx.clone();
    desk.app().open_paths(&ctx, [scratch.path("store_20260601_0900.png")]);
    desk.wait(|app| app.editor.newer(0).is_some());
    let newer = desk.app().editor.newer(0).unwrap().clone();
    assert_eq!(
        (newer.ids.first().unwrap().as_str(), newer.since.as_str()),
        ("store", "2026-06-01T09:00:00Z")
    );
    assert_eq!((newer.comparison.change, desk.site().cameras.len()), (CameraChange::TooFewEdges, 1));
    let bytes = std::fs::read(scratch.path("store_20260601_0900.png")).unwrap();
    let file = Chosen { name: "store_20260602_0900.png".into(), path: None, bytes: Some(bytes) };
    desk.app().open_files(&ctx, vec![file]);
    desk.wait(|app| app.editor.newer(0).is_some_and(|newer| newer.since.starts_with("2026-06-02")));
    desk.app().open_paths(&ctx, [scratch.path("door.png")]);
    desk.wait(|app| app.editor.site().cameras.len() == 2);
    assert!(desk.app().editor.newer(1).is_none());
}

#[test]
fn comparison_survives_the_first_save_of_the_site() {
    let scratch = Scratch::new();
    let (entry, truth) = store();
    for name in ["store.png", "store_20260601_0900.png"] {
        calib_demo::render(&truth, entry.size_px).save(scratch.path(name)).unwrap();
    }
    let mut desk = desk(&scratch, "store.png");
    let ctx: Context = desk.harness.ctx.clone();
    desk.app().open_paths(&ctx, [scratch.path("store_20260601_0900.png")]);
    // Both images are read, and the search for edges runs.
    for _ in 0..20 {
        desk.harness.run_steps(1);
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    desk.answer(Some(scratch.path("site.json")));
    desk.keys(Modifiers::COMMAND, Key::S);
    while desk.site().cameras[0].image.as_deref() != Some("store.png") {
        desk.harness.run_steps(1);
    }
    assert!(desk.app().is_comparing(), "it was saved too late to be tested");
    desk.wait(|app| !app.is_comparing());
    let change = desk.app().editor.newer(0).map(|newer| newer.comparison.change);
    assert_eq!(change, Some(CameraChange::Unchanged), "{:?}", desk.app().editor.session().note);
}

#[test]
fn image_of_another_size_is_refused_and_work_can_be_cancelled() {
    let scratch = Scratch::new();
    let size = store().0.size_px;
    grey(&scratch, "store.png", size);
    grey(&scratch, "small.png", size.map(|side| side / 2));
    let mut desk = desk(&scratch, "store.png");
    compare(&mut desk, scratch.path("small.png"));
    let error = desk.app().editor.error().unwrap().to_owned();
    assert!(
        error.contains("of store was not compared") && error.contains("take an image of 1280 x 960 pixels"),
        "{error}"
    );
    desk.app().act(Action::CloseError);
    desk.answer(Some(scratch.path("store.png")));
    desk.tell(Command::CompareStill);
    desk.tell(Command::StopWork);
    assert!(!desk.app().is_comparing() && change(&desk).is_none());
}

#[test]
fn cameras_are_listed_with_the_age_of_calibration_and_newest_image() {
    let scratch = Scratch::new();
    let mut site = desk::demo();
    grey(&scratch, "old_20260501_0900.png", site.cameras[0].size_px);
    grey(&scratch, "new.png", site.cameras[0].size_px);
    site.cameras[0].image = Some(path(&scratch, "old_20260501_0900.png"));
    site.cameras[1].valid_from = Some("2026-05-29T09:00:00Z".into());
    let mut desk = Desk::with(site, Images::default());
    // 1 June 2026, 09:00.
    desk.app().clock = || 1_780_304_400;
    compare(&mut desk, scratch.path("new.png"));
    desk.key(Key::Num3);
    let words = desk.words();
    for expected in [
        "Calibrations",
        "from 31 days ago",
        "from 3 days ago",
        "age unknown",
        "Unclear: too few edges",
        "no newer image",
    ] {
        assert!(words.iter().any(|word| word == expected), "{expected}: {words:?}");
    }
}
