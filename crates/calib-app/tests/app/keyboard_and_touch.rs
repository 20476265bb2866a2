//! Keyboard focus, requested fields, and drags of line ends by pointer and touch.

use calib_app::state::Place;
use calib_core::{Kind, Pixel};
use calib_editor::Pane;
use egui::{Event, Key, Modifiers, PointerButton, Pos2, TouchDeviceId, TouchId, TouchPhase, Vec2};
use egui_kittest::kittest::Queryable as _;

use crate::desk::{self, Desk, demo, last_vertical, with_edge};

/// Returns the demonstration site with an empty list of annotations in its first camera.
fn without_lines() -> calib_site::Site {
    let mut site = demo();
    site.cameras[0].annotations.clear();
    site
}

/// Returns the rectangle of the widget that has the keyboard focus.
fn focused(desk: &Desk) -> egui::Rect {
    let nodes = desk.harness.query_all_by(|node| node.is_focused());
    let rects: Vec<egui::Rect> = nodes.map(|node| node.rect()).collect();
    assert_eq!(rects.len(), 1, "one widget has the focus");
    rects[0]
}

#[test]
fn focused_row_scrolls_into_view() {
    let mut desk = Desk::new(demo());
    desk.harness.set_size(Vec2::new(1300.0, 500.0));
    desk.harness.run_steps(4);
    let last = |desk: &Desk| {
        let rows =
            desk.harness.query_all_by(|node| node.label().is_some_and(|label| label.starts_with("Line ")));
        rows.map(|node| node.rect().center().y).fold(0.0, f32::max)
    };
    let below = last(&desk);
    assert!(below > 500.0, "the last row is outside the window: {below}");
    let rows = desk.harness.query_all_by(|node| node.label().is_some_and(|label| label.starts_with("Line ")));
    rows.max_by(|a, b| a.rect().center().y.total_cmp(&b.rect().center().y)).unwrap().focus();
    desk.harness.run_steps(6);
    let rect = focused(&desk);
    assert!(rect.top() > 40.0 && rect.bottom() < 472.0, "{rect:?} is visible");
}

#[test]
fn requested_height_has_the_focus_and_shortcuts_still_work() {
    let mut desk = Desk::new(without_lines());
    desk.harness.set_size(Vec2::new(1300.0, 500.0));
    desk.harness.run_steps(4);
    desk.take("Upright");
    desk.line(0, Pixel::new(600.0, 800.0), Pixel::new(600.0, 500.0));
    desk.harness.run_steps(6);
    let rect = focused(&desk);
    assert!(rect.top() > 40.0 && rect.bottom() < 472.0, "{rect:?} is visible");
    desk.harness.event(Event::Text("1.8".into()));
    desk.harness.run_steps(2);
    desk.key(Key::Enter);
    desk.harness.run_steps(3);
    let height = |desk: &Desk| {
        let drawn = &desk.site().cameras[0].annotations;
        drawn.iter().rfind(|drawn| drawn.kind == Kind::Upright).unwrap().height_m
    };
    assert!((height(&desk).unwrap().value - 1.8).abs() < 1e-9);

    // While the field is empty, the letter of a tool selects the tool.
    desk.take("Known length");
    desk.line(0, Pixel::new(700.0, 800.0), Pixel::new(900.0, 800.0));
    desk.harness.run_steps(6);
    focused(&desk);
    let letter = |pressed| Event::Key {
        key: Key::V,
        physical_key: None,
        pressed,
        repeat: false,
        modifiers: Modifiers::NONE,
    };
    let events = [letter(true), Event::Text("v".into()), letter(false)];
    desk.harness.input_mut().events.extend(events);
    desk.harness.run_steps(3);
    assert_eq!(desk.app().editor.tool_kind(), Some(Kind::Vertical));
    assert!(desk.harness.query_all_by(|node| node.is_focused()).next().is_none(), "the field is left");
    let count = desk.site().cameras[0].annotations.len();
    desk.undo();
    assert_eq!(desk.site().cameras[0].annotations.len(), count - 1, "undo removes the line");
}

#[test]
fn first_click_of_a_link_says_what_comes_next_and_why_a_view_has_no_line() {
    let mut site = demo();
    site.cameras[2].annotations.clear();
    site.cameras[2].control_points.clear();
    site.cameras[2].placement = None;
    let mut desk = Desk::new(site);
    desk.key(Key::Num3);
    desk.take("Link");
    desk.click(Pane::Image(0), [900.0, 800.0]);
    desk.harness.run_steps(4);
    assert!(desk.harness.query_by_label_contains("Now click the same point in another camera").is_some());
    let texts = texts(&desk);
    let missing = "is not calibrated.";
    assert!(texts.iter().any(|text| text.contains("No yellow line") && text.contains(missing)), "{texts:?}");
    assert!(texts.iter().any(|text| text.contains("is on this line")), "{texts:?}");
}

/// Returns all painted texts.
fn texts(desk: &Desk) -> Vec<String> {
    fn collect(shape: &egui::Shape, texts: &mut Vec<String>) {
        match shape {
            egui::Shape::Text(text) => texts.push(text.galley.text().to_owned()),
            egui::Shape::Vec(shapes) => shapes.iter().for_each(|shape| collect(shape, texts)),
            _ => {}
        }
    }
    let mut texts = Vec::new();
    for clipped in &desk.harness.output().shapes {
        collect(&clipped.shape, &mut texts);
    }
    texts
}

#[test]
fn empty_plan_has_a_button_that_draws_nothing() {
    let mut site = demo();
    site.plan = None;
    for camera in &mut site.cameras {
        camera.control_points.clear();
    }
    let mut desk = Desk::new(site);
    desk.key(Key::Num2);
    desk.harness.run_steps(4);
    let before = desk.site().clone();
    let canvas = desk.app().view.panes.rects[&(Place::Main, Pane::Plan)];
    // The panel on the right has a button with the same label.
    let button = {
        let nodes = desk.harness.get_all_by_label("Load a floor plan\u{2026}");
        let found = nodes.map(|node| node.rect()).find(|rect| canvas.contains_rect(*rect));
        found.expect("a button on the plan")
    };
    let scratch = calib_tests::Scratch::new();
    desk::still(&scratch, "plan.png", [400, 300]);
    desk.answer(Some(scratch.path("plan.png")));
    desk.drag_screen(&[button.center()], Modifiers::NONE);
    assert_eq!(desk.site().cameras, before.cameras, "the click does not move a camera");
    desk.wait(|app| app.editor.site().plan.is_some());
}

#[test]
fn drag_of_an_existing_end_moves_it_and_a_click_there_starts_a_line() {
    let mut desk = Desk::new(without_lines());
    desk.take("Vertical");
    desk.line(0, Pixel::new(600.0, 300.0), Pixel::new(600.0, 700.0));
    desk.harness.run_steps(30);
    let lines = |desk: &Desk| {
        let drawn = desk.site().cameras[0].annotations.iter();
        drawn.flat_map(|drawn| drawn.polylines().collect::<Vec<_>>()).collect::<Vec<Vec<Pixel>>>()
    };
    desk.line(0, Pixel::new(600.0, 700.0), Pixel::new(640.0, 760.0));
    desk.harness.run_steps(30);
    let moved = lines(&desk);
    assert_eq!(moved.len(), 1, "no second line");
    assert!(moved[0][1].distance(Pixel::new(640.0, 760.0)) < 2.0, "{moved:?}");
    desk.click(Pane::Image(0), [640.0, 760.0]);
    desk.click(Pane::Image(0), [900.0, 760.0]);
    assert_eq!(lines(&desk).len(), 2, "two clicks draw a line from the end");
    desk.undo();
    desk.undo();
    assert!(lines(&desk)[0][1].distance(Pixel::new(600.0, 700.0)) < 2.0, "the move is one step");
}

#[test]
fn alt_moves_only_the_end_at_the_pointer_onto_the_edge_under_it() {
    let edge = |v: f64| 700.3 + 0.02 * v;
    let mut site = demo();
    site.cameras[0].annotations.clear();
    let mut desk = with_edge(site, edge);
    desk.take("Vertical");
    let (from, to) = (Pixel::new(edge(300.0) + 30.0, 300.0), Pixel::new(edge(700.0) + 5.0, 700.0));
    let points = [from, to].map(|pixel| desk.screen(Pane::Image(0), pixel.into()));
    desk.drag_screen(&points, Modifiers::ALT);
    let line = last_vertical(&desk);
    assert!(line[0].distance(from) < 1e-2, "the start is far from the edge and stays: {line:?}");
    assert!((line[1].u - edge(line[1].v)).abs() < 0.5, "{} px off the edge", line[1].u - edge(line[1].v));

    // A drag of an existing end with Alt moves only this end.
    desk.harness.run_steps(30);
    let near = Pixel::new(edge(320.0) - 4.0, 320.0);
    let points = [line[0], near].map(|pixel| desk.screen(Pane::Image(0), pixel.into()));
    desk.drag_screen(&points, Modifiers::ALT);
    let moved = last_vertical(&desk);
    assert!(moved[1].distance(line[1]) < 1e-6, "the other end stays");
    assert!((moved[0].u - edge(moved[0].v)).abs() < 0.5, "{moved:?}");
}

fn finger(phase: TouchPhase, pos: Pos2) -> Event {
    Event::Touch { device_id: TouchDeviceId(0), id: TouchId(1), phase, pos, force: None }
}

fn button(pos: Pos2, pressed: bool) -> Event {
    Event::PointerButton { pos, button: PointerButton::Primary, pressed, modifiers: Modifiers::NONE }
}

/// Presses one finger, keeps it at each point for a number of frames, and lifts it at the last point.
fn touch(desk: &mut Desk, points: &[Pos2], frames: usize) {
    let first = points[0];
    let start = [finger(TouchPhase::Start, first), Event::PointerMoved(first), button(first, true)];
    desk.harness.input_mut().events.extend(start);
    desk.harness.run_steps(frames);
    for &at in &points[1..] {
        desk.harness.input_mut().events.extend([finger(TouchPhase::Move, at), Event::PointerMoved(at)]);
        desk.harness.run_steps(frames);
    }
    let last = points[points.len() - 1];
    let end = [finger(TouchPhase::End, last), button(last, false), Event::PointerGone];
    desk.harness.input_mut().events.extend(end);
    desk.harness.run_steps(3);
}

#[test]
fn resting_finger_draws_with_a_drawing_tool() {
    let mut desk = Desk::new(without_lines());
    desk.take("Vertical");
    let [from, to] = [[900.0, 300.0], [900.0, 700.0]].map(|at| desk.screen(Pane::Image(0), at));
    // 90 frames are longer than a long press.
    touch(&mut desk, &[from, to], 90);
    assert!(desk.harness.query_by_label_contains("Select all").is_none(), "no menu is open");
    let drawn = &desk.site().cameras[0].annotations;
    assert_eq!(drawn.len(), 1, "a line is drawn");
    touch(&mut desk, &[from + Vec2::new(120.0, 0.0)], 90);
    assert!(!desk.app().editor.tool().is_idle(), "a resting finger sets the first end");
}

#[test]
fn one_finger_pans_an_empty_image_with_the_selection_tool() {
    let mut desk = Desk::new(without_lines());
    desk.take("Select");
    let key = (Place::Main, Pane::Image(0));
    let before = (desk.site().clone(), desk.app().view.panes.views[&key].centre);
    let from = desk.screen(Pane::Image(0), [300.0, 300.0]);
    touch(&mut desk, &[from, from + Vec2::new(30.0, 10.0), from + Vec2::new(60.0, 20.0)], 2);
    let after = desk.app().view.panes.views[&key].centre;
    assert!(before.1[0] - after[0] > 20.0, "{:?} to {after:?}", before.1);
    assert!(*desk.site() == before.0 && desk.app().editor.session().selection.is_empty());
    assert!(desk.app().editor.tool().is_idle());
}

#[test]
fn one_finger_pans_an_empty_plan() {
    let mut desk = Desk::new(demo());
    desk.key(Key::Num2);
    desk.take("Select");
    let key = (Place::Main, Pane::Plan);
    let (site, before) = (desk.site().clone(), desk.app().view.panes.views[&key].centre);
    // A corner of the window is outside all fields of view.
    let from = desk.app().view.panes.rects[&key].left_bottom() + Vec2::new(30.0, -90.0);
    touch(&mut desk, &[from, from + Vec2::new(30.0, -10.0), from + Vec2::new(60.0, -20.0)], 2);
    let after = desk.app().view.panes.views[&key].centre;
    assert!((before[0] - after[0]).abs() > 0.1, "{before:?} to {after:?}");
    assert!(*desk.site() == site);
}

/// Moves the crosshair to a screen point with the arrow keys, and presses Enter.
fn point_by_keys(desk: &mut Desk, target: Pos2) {
    const COARSE: f32 = 24.0;
    let at = |desk: &Desk| desk.harness.ctx.plugin::<calib_app::crosshair::Crosshair>().lock().at;
    if at(desk).is_none() {
        desk.key(Key::ArrowLeft);
    }
    let from = at(desk).expect("the crosshair is shown");
    for (by, keys) in [
        (target.x - from.x, [Key::ArrowLeft, Key::ArrowRight]),
        (target.y - from.y, [Key::ArrowUp, Key::ArrowDown]),
    ] {
        let key = keys[usize::from(by > 0.0)];
        let coarse = (by.abs() / COARSE).floor();
        (0..coarse as usize).for_each(|_| desk.keys(Modifiers::SHIFT, key));
        (0..(by.abs() - COARSE * coarse).round() as usize).for_each(|_| desk.key(key));
    }
    desk.key(Key::Enter);
    // Otherwise the next click could be a double click.
    desk.harness.run_steps(30);
}

#[test]
fn a_camera_is_calibrated_by_keys_alone() {
    let truth = demo();
    let mut desk = Desk::new(without_lines());
    desk.key(Key::Num1);
    let drawn: Vec<(Kind, Vec<Vec<Pixel>>)> = truth.cameras[0]
        .annotations
        .iter()
        .filter(|drawn| matches!(drawn.kind, Kind::Parallel | Kind::Vertical))
        .map(|drawn| (drawn.kind, drawn.segments.clone().unwrap()))
        .collect();
    assert!(drawn.len() >= 2, "{drawn:?}");
    for (kind, segments) in &drawn {
        desk.key(if *kind == Kind::Vertical { Key::V } else { Key::P });
        for segment in segments {
            let ends = [segment[0], segment[segment.len() - 1]];
            for end in ends {
                let target = desk.screen(Pane::Image(0), end.into());
                point_by_keys(&mut desk, target);
            }
        }
        desk.key(Key::W);
    }
    // A line that is cancelled is not selected any more.
    let target = desk.screen(Pane::Image(0), [400.0, 500.0]);
    point_by_keys(&mut desk, target);
    assert!(!desk.app().editor.tool().is_idle());
    desk.key(Key::Escape);
    assert!(
        desk.harness
            .state()
            .editor
            .session()
            .selection
            .iter()
            .all(|part| !part_name(&desk, *part).is_empty())
    );
    let count: usize = drawn.iter().map(|(_, segments)| segments.len()).sum();
    let found = &desk.site().cameras[0].annotations;
    assert_eq!(found.iter().map(|drawn| drawn.segments.as_ref().map_or(0, Vec::len)).sum::<usize>(), count);
    // Half a point of the screen is about a pixel of the image.
    let pose = desk.app().editor.session().pose().copied().expect("the camera is calibrated");
    let expected = calib_demo::demo_site().truth[0].1.focal;
    assert!((pose.focal / expected - 1.0).abs() < 0.05, "{} of {expected}", pose.focal);
}

/// Returns the name of a part of the current camera; empty if it does not exist.
fn part_name(desk: &Desk, part: calib_editor::Part) -> String {
    desk.harness.state().editor.session().part_name(part)
}
