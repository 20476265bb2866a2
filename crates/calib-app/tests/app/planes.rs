//! Planes other than the floor in the app: add, rename, set the height, draw a region, assign lines.

use calib_core::Kind;

use calib_editor::planes::PlaneAction;
use calib_editor::{Action, Pane, Part};
use calib_site::PlaneNumber;
use egui::Key;
use egui_kittest::kittest::Queryable as _;

use crate::desk::{Desk, demo};

/// Clicks a label through accessibility, because it may be below the visible part of the window.
fn click(desk: &mut Desk, label: &str) {
    desk.harness.get_by_label(label).click_accesskit();
    desk.harness.run_steps(3);
}

/// Opens the combo box of a label.
fn open(desk: &mut Desk, label: &str) {
    desk.harness.get_all_by_label(label).last().unwrap().scroll_to_me();
    desk.harness.run_steps(3);
    desk.harness.get_all_by_label(label).last().unwrap().click_accesskit();
    desk.harness.run_steps(3);
}

/// Selects a floor line in the image of the first camera.
fn select_parallel(desk: &mut Desk) -> usize {
    let annotations = &desk.site().cameras[0].annotations;
    let index = annotations.iter().position(|drawn| drawn.kind == Kind::Parallel).unwrap();
    desk.app().act(Action::Select(Part::Line { annotation: index, segment: 0 }));
    desk.harness.run_steps(2);
    index
}

#[test]
fn adding_a_plane_and_assigning_a_line_are_undone() {
    let mut desk = Desk::new(demo());
    let before = desk.site().clone();
    desk.key(Key::Num2);
    click(&mut desk, "Add a plane");
    assert_eq!(desk.site().planes.len(), 1);
    desk.app().act(Action::Planes(PlaneAction::Rename(0, "ramp".into())));
    desk.key(Key::Num1);
    let line = select_parallel(&mut desk);
    open(&mut desk, "On plane");
    click(&mut desk, "ramp");
    assert_eq!(desk.site().cameras[0].annotations[line].plane.as_deref(), Some("ramp"));
    assert_eq!(desk.app().editor.session().history.depth(), 3);
    desk.undo();
    assert_eq!(desk.site().cameras[0].annotations[line].plane, None);
    desk.undo();
    desk.undo();
    assert!(*desk.site() == before, "the site differs");
}

#[test]
fn removing_a_plane_moves_its_lines_to_the_floor() {
    let mut desk = Desk::new(demo());
    desk.key(Key::Num2);
    click(&mut desk, "Add a plane");
    desk.key(Key::Num1);
    let line = select_parallel(&mut desk);
    let id = desk.site().planes[0].id.clone();
    desk.app().act(Action::Planes(PlaneAction::Assign(Some(id.clone()))));
    let laid = desk.site().clone();
    desk.key(Key::Num2);
    click(&mut desk, &format!("Remove plane {id}"));
    assert!(desk.site().planes.is_empty());
    assert_eq!(desk.site().cameras[0].annotations[line].plane, None);
    desk.undo();
    assert!(*desk.site() == laid, "one undo restores the plane and its lines");
}

#[test]
fn region_is_drawn_and_height_is_entered() {
    let mut desk = Desk::new(demo());
    desk.key(Key::Num2);
    click(&mut desk, "Add a plane");
    click(&mut desk, "Draw");
    for at in [[10.0, 5.0], [14.0, 5.0], [14.0, 9.0]] {
        desk.click(Pane::Plan, at);
    }
    desk.key(Key::Enter);
    let region = &desk.site().planes[0].region;
    assert_eq!((region.len(), desk.site().planes.len()), (3, 1), "the region of the selected plane");
    assert!(region[1].distance([14.0, 5.0].into()) < 0.05);
    let id = desk.site().planes[0].id.clone();
    assert!(desk.words().iter().any(|word| word.contains("Region with 3 corners")));
    // The height of the plane is set to "known" in its combo box.
    open(&mut desk, "Height above the floor");
    click(&mut desk, "known");
    assert_eq!(desk.site().planes[0].height_m, Some(PlaneNumber::Exact(0.0)));
    let undo = format!("change the height of {id}");
    assert_eq!(desk.app().editor.session().history.undo_name(), Some(undo.as_str()));
}
