//! Windows of every size: the image keeps its space, the next click is always described, and the focus is
//! visible.

use calib_app::state::Place;
use calib_editor::Pane;
use egui::accesskit::{Live, Toggled};
use egui::{Event, Key, Modifiers, PointerButton, TouchDeviceId, TouchId, TouchPhase, Vec2};
use egui_kittest::kittest::{NodeT as _, Queryable as _};

use crate::desk::{Desk, demo};

#[test]
fn panels_collapse_by_the_current_window_width() {
    let mut desk = Desk::new(demo());
    for (size, least) in [
        ([1440.0, 900.0], 850.0),
        ([1100.0, 700.0], 550.0),
        ([800.0, 600.0], 450.0),
        ([1440.0, 900.0], 850.0),
    ] {
        desk.harness.set_size(Vec2::from(size));
        desk.harness.run_steps(4);
        let rect = desk.app().view.panes.rects[&(Place::Main, Pane::Image(0))];
        assert!(rect.width() > least, "{} of {} points are the image's", rect.width(), size[0]);
        let hint = desk.harness.get_by_label_contains("Click a line or handle").rect();
        assert!(hint.width() > 150.0, "{hint:?} in a window of {size:?}");
    }
}

#[test]
fn camera_is_removed_from_its_own_menu() {
    let mut desk = Desk::new(demo());
    let row = desk.harness.get_by_label("Camera shop-2").rect().center();
    for pressed in [true, false] {
        let (button, modifiers) = (PointerButton::Secondary, Modifiers::NONE);
        desk.harness.input_mut().events.push(Event::PointerMoved(row));
        desk.harness.input_mut().events.push(Event::PointerButton { pos: row, button, pressed, modifiers });
        desk.harness.step();
    }
    desk.harness.run_steps(2);
    let is_camera = |label: Option<String>| label.is_some_and(|label| !label.contains("placement"));
    desk.harness
        .query_all_by_label_contains("Remove this camera")
        .find(|node| is_camera(node.accesskit_node().label()))
        .unwrap()
        .click();
    desk.harness.run_steps(3);
    assert!(desk.site().cameras.iter().all(|camera| camera.id != "shop-2"));
    assert!(desk.site().cameras.iter().any(|camera| camera.id == "shop-1"));
}

#[test]
fn two_fingers_draw_nothing() {
    let mut desk = Desk::new(demo());
    desk.take("Vertical");
    let before = desk.site().clone();
    let at = desk.app().view.panes.rects[&(Place::Main, Pane::Image(0))].center();
    let finger = |id: u64, phase: TouchPhase, pos: egui::Pos2| Event::Touch {
        device_id: TouchDeviceId(0),
        id: TouchId(id),
        phase,
        pos,
        force: None,
    };
    let button = |pos: egui::Pos2, pressed: bool| Event::PointerButton {
        pos,
        button: PointerButton::Primary,
        pressed,
        modifiers: Modifiers::NONE,
    };
    // The first finger acts as the pointer; the second begins the pinch.
    let events = [
        vec![finger(1, TouchPhase::Start, at), Event::PointerMoved(at), button(at, true)],
        vec![finger(2, TouchPhase::Start, at + Vec2::splat(40.0))],
        vec![
            finger(1, TouchPhase::Move, at + Vec2::splat(-90.0)),
            Event::PointerMoved(at + Vec2::splat(-90.0)),
        ],
        vec![
            finger(2, TouchPhase::End, at),
            finger(1, TouchPhase::End, at),
            button(at + Vec2::splat(-90.0), false),
            Event::PointerGone,
        ],
    ];
    for part in events {
        desk.harness.input_mut().events.extend(part);
        desk.harness.step();
    }
    desk.harness.run_steps(2);
    assert!(*desk.site() == before && desk.app().editor.tool().is_idle());
}

#[test]
fn note_is_replaced_by_the_description_of_the_next_click() {
    let mut desk = Desk::new(demo());
    desk.app().act(calib_editor::Action::Note("Something happened.".into()));
    desk.harness.run_steps(2);
    assert!(desk.harness.query_by_label_contains("Something happened").is_some());
    desk.harness.run_steps(60);
    assert!(desk.harness.query_by_label_contains("Something happened").is_none(), "it has expired");
    assert!(desk.harness.query_by_label_contains("Click a line or handle").is_some());
}

#[test]
fn sections_are_headings_and_undo_is_shown_once() {
    let mut desk = Desk::new(demo());
    desk.take("Vertical");
    desk.line(0, [600.0, 300.0].into(), [600.0, 500.0].into());
    desk.harness.run_steps(2);
    let steps = desk.harness.get_by_role_and_label(egui::Role::Heading, "Steps");
    assert!(steps.rect().width() > 0.0);
    let undo = desk.words().into_iter().filter(|word| word.starts_with("Undo add")).count();
    assert_eq!(undo, 1);
    desk.keys(Modifiers::SHIFT, Key::Questionmark);
    for title in ["Tools", "Files", "Selection", "View"] {
        let heading = desk.harness.query_by_role_and_label(egui::Role::Heading, title);
        assert!(heading.is_some(), "the key sheet has a group {title}");
    }
}

#[test]
fn tools_have_a_pressed_state_and_other_icon_buttons_have_none() {
    let mut desk = Desk::new(demo());
    desk.take("Vertical");
    let state = |label: &str| desk.harness.get_by_label(label).accesskit_node().toggled();
    assert_eq!(state("Vertical tool"), Some(Toggled::True));
    assert_eq!(state("Parallel tool"), Some(Toggled::False));
    assert_eq!(state("Pause solving"), Some(Toggled::False));
    assert_eq!(state("Menu"), None);
    let about = desk.harness.get_by_label("Camera shop-1").accesskit_node().description();
    assert!(about.is_some_and(|about| !about.is_empty()), "the status of a camera is read");
    assert_eq!(state("Add images"), None);
}

#[test]
fn changed_results_hints_and_errors_are_announced() {
    let mut desk = Desk::new(demo());
    let said = |desk: &Desk| {
        let live = desk.harness.query_all_by(|node| node.live() != Live::Off);
        let said = live.map(|node| node.accesskit_node().label().or(node.accesskit_node().value()));
        said.flatten().collect::<Vec<String>>().join("\n")
    };
    assert!(!said(&desk).contains("Result of"), "only changes are announced: {}", said(&desk));
    desk.take("Vertical");
    assert!(said(&desk).contains("Draw along a vertical edge"), "{}", said(&desk));
    desk.line(0, [600.0, 300.0].into(), [1000.0, 500.0].into());
    desk.harness.run_steps(4);
    assert!(said(&desk).contains("Result of shop-1: "), "{}", said(&desk));
    desk.app().act(calib_editor::Action::SetError("The file is damaged.".into()));
    desk.harness.run_steps(2);
    assert!(said(&desk).contains("The file is damaged."), "{}", said(&desk));
    desk.harness.run_steps(60);
    assert!(!said(&desk).contains("Result of"), "the result is announced once");
}

#[test]
fn key_hints_are_hidden_on_phones_and_after_a_touch() {
    let mut site = demo();
    site.cameras[0].annotations.clear();
    site.cameras[0].image = Some("missing.png".into());
    let mut desk = Desk::new(site);
    desk.take("Vertical");
    let has_keys = |desk: &Desk| desk.words().iter().any(|word| word.contains("Shift+P"));
    assert!(has_keys(&desk), "{:?}", desk.words());
    let at = egui::Pos2::new(700.0, 20.0);
    let finger =
        |phase| Event::Touch { device_id: TouchDeviceId(0), id: TouchId(1), phase, pos: at, force: None };
    desk.harness.input_mut().events.extend([finger(TouchPhase::Start)]);
    desk.harness.step();
    desk.harness.input_mut().events.extend([finger(TouchPhase::End)]);
    desk.harness.run_steps(2);
    assert!(!has_keys(&desk), "after a touch: {:?}", desk.words());
    desk.key(Key::P);
    assert!(has_keys(&desk), "after a key");
    desk.harness.set_size(Vec2::new(500.0, 900.0));
    desk.harness.run_steps(4);
    assert!(!has_keys(&desk), "on a phone: {:?}", desk.words());
}
