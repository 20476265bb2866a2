//! No work is lost: a gesture in progress, a replaced site with unsaved work, and results while solving is paused.

use calib_app::command::Command;
use calib_editor::{Action, Pane};
use calib_tests::Scratch;
use egui::{Event, Key, Modifiers, PointerButton};
use egui_kittest::kittest::Queryable as _;

use crate::desk::{self, Desk, demo, still};

#[test]
fn new_sites_wait_until_the_gesture_ends() {
    let scratch = Scratch::new();
    still(&scratch, "new.png", [64, 48]);
    let mut desk = Desk::new(demo());
    let count = desk.site().cameras.len();
    let lines = desk.site().cameras[0].annotations.clone();
    desk.take("Vertical");
    let [from, to] = [[900.0, 300.0], [905.0, 500.0]].map(|at| desk.screen(Pane::Image(0), at));
    desk.harness.event(Event::PointerMoved(from));
    desk.press(from, Modifiers::NONE);
    desk.harness.event(Event::PointerMoved(to));
    desk.harness.step();
    let ctx = desk.harness.ctx.clone();
    desk.app().open_paths(&ctx, [scratch.path("new.png")]);
    for _ in 0..40 {
        desk.harness.step();
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    assert_eq!(desk.site().cameras.len(), count, "a line is under way");
    desk.release(to, Modifiers::NONE);
    desk.wait(|app| app.editor.session().site.cameras.len() > count);
    assert_eq!(desk.harness.state().editor.session().history.depth(), 2, "the line, and the camera");
    desk.undo();
    desk.undo();
    assert_eq!(desk.site().cameras[0].annotations, lines);
}

#[test]
fn invalid_edit_is_reverted() {
    let mut desk = Desk::new(demo());
    let before = desk.site().clone();
    let known = Some(calib_core::single::Known::fixed(0.0));
    desk.app().act(Action::Height { known, name: "fix a height of zero".into() });
    assert_eq!(*desk.site(), before);
    assert!(desk.harness.state().editor.session().note.as_ref().unwrap().starts_with("Change reverted"));
    assert_eq!(desk.harness.state().editor.session().history.depth(), 0);
}

#[test]
fn unsaved_work_is_kept_when_another_site_is_opened() {
    let folder = tempfile::tempdir().unwrap();
    let mut app = calib_app::App::new(&egui::Context::default(), Some(folder.path().to_path_buf()));
    app.open_site(demo(), calib_app::storage::files::Images::default(), None);
    let mut harness = egui_kittest::Harness::builder()
        .with_context_setup(calib_app::theme::install)
        .build_ui_state(|ui, app: &mut calib_app::App| app.show_ui(ui), app);
    harness.run_steps(2);
    desk::change(harness.state_mut(), "name the site", |site| site.name = Some("Mine".into()));
    harness.run_steps(2);
    harness.state_mut().open_site(
        calib_site::Site::new(),
        calib_app::storage::files::Images::default(),
        None,
    );
    desk::change(harness.state_mut(), "name the site", |site| site.name = Some("Another".into()));
    harness.run_steps(2);
    assert_eq!(harness.state().storage.found.len(), 1, "it is offered");
    harness.state_mut().recover(0);
    assert_eq!(harness.state().editor.session().site.name.as_deref(), Some("Mine"));
    drop(harness);
    let app = calib_app::App::new(&egui::Context::default(), Some(folder.path().to_path_buf()));
    let mut names: Vec<_> =
        app.storage.found.iter().map(|(_, found)| found.site.name.clone().unwrap()).collect();
    names.sort();
    assert_eq!(names, ["Another", "Mine"], "and both outlive the program");
}

#[test]
fn results_stay_with_their_cameras_while_solving_is_paused() {
    let mut desk = Desk::new(demo());
    let poses: Vec<_> = (0..3).map(|i| desk.app().editor.session().solved.pose(i).copied()).collect();
    desk.tell(Command::Pause);
    desk.tell(Command::RemoveCamera);
    assert_eq!(desk.app().editor.session().solved.pose(0).copied(), poses[1]);
    assert_eq!(desk.app().editor.session().solved.pose(1).copied(), poses[2]);
    desk.undo();
    assert_eq!(desk.app().editor.session().solved.pose(1).copied(), poses[1]);
}

#[test]
fn escape_in_a_field_only_leaves_the_field() {
    let mut desk = Desk::new(demo());
    desk.take("Select");
    desk.app().act(Action::SelectOn(0, calib_editor::Part::Line { annotation: 0, segment: 0 }));
    desk.harness.run_steps(2);
    let id = desk.site().cameras[0].id.clone();
    desk.harness.get_by_label("ID").focus();
    desk.harness.run_steps(2);
    desk.harness.event(Event::Text("x".into()));
    desk.harness.run_steps(2);
    desk.key(Key::Escape);
    assert_eq!(desk.site().cameras[0].id, id, "the typed text is discarded");
    assert!(!desk.app().editor.session().selection.is_empty(), "the selection is not the field's");
    desk.key(Key::Escape);
    assert!(desk.app().editor.session().selection.is_empty());
}

#[test]
fn camera_is_rotated_and_scaled_on_the_plan_by_keys() {
    let mut desk = Desk::new(demo());
    let free = desk.site().cameras.iter().position(|camera| camera.control_points.is_empty()).unwrap();
    desk.app().act(Action::SelectCamera(free));
    desk.key(Key::Num2);
    let before = desk.app().editor.session().placement(free).unwrap();
    desk.keys(Modifiers::COMMAND, Key::ArrowLeft);
    let turned = desk.app().editor.session().placement(free).unwrap();
    assert!(((turned.turn - before.turn).to_degrees() - 0.1).abs() < 1e-5, "{turned:?}");
    desk.keys(Modifiers::COMMAND | Modifiers::SHIFT, Key::ArrowUp);
    let grown = desk.app().editor.session().placement(free).unwrap();
    assert!((grown.scale / turned.scale - 1.01).abs() < 1e-6, "{grown:?}");
    desk.keys(Modifiers::COMMAND, Key::ArrowRight);
    desk.keys(Modifiers::COMMAND | Modifiers::SHIFT, Key::ArrowDown);
    let back = desk.app().editor.session().placement(free).unwrap();
    assert!((back.turn - before.turn).abs() < 1e-6 && (back.scale - before.scale).abs() < 1e-6);
}

#[test]
fn right_click_offers_the_commands_of_the_item() {
    let mut desk = Desk::new(demo());
    let before = desk.site().clone();
    let line = &before.cameras[0].annotations[0].segments.as_ref().unwrap()[0];
    let (a, b) = (line[0], line[1]);
    let at = desk.screen(Pane::Image(0), [0.5 * (a.u + b.u), 0.5 * (a.v + b.v)]);
    let button = PointerButton::Secondary;
    for pressed in [true, false] {
        desk.harness.event(Event::PointerMoved(at));
        desk.harness.event(Event::PointerButton { pos: at, button, pressed, modifiers: Modifiers::NONE });
        desk.harness.step();
    }
    desk.harness.run_steps(2);
    desk.harness.get_by_label_contains("Delete the selection").click();
    desk.harness.run_steps(2);
    assert!(desk.site().cameras[0].annotations != before.cameras[0].annotations, "it is deleted");
    desk.undo();
    assert_eq!(desk.site().cameras[0].annotations, before.cameras[0].annotations);
}
