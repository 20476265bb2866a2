//! Every tool draws, edits, deletes, undoes and redoes; every command runs.

use calib_app::command::{self, Command};
use calib_app::state::Mode;
use calib_core::single::Shape;
use calib_core::{Kind, Pixel};
use calib_editor::{Action, Pane, Part, TOOLS};
use calib_site::Site;
use egui::{Key, Modifiers};
use egui_kittest::kittest::Queryable as _;

use crate::desk::{Desk, demo};

/// Draws with a tool as an operator would.
fn draw(desk: &mut Desk, tool: usize) {
    let row = &TOOLS[tool];
    let image = Pane::Image(0);
    desk.take_tool(tool);
    let many = row.title == "Field of view" || row.kind.is_some_and(|k| k.row().shape == Shape::Polyline);
    match row.title {
        "Select" => {
            let from = desk.site().cameras[0].annotations[0].polylines().next().unwrap()[0];
            desk.drag(image, from.into(), [from.u + 40.0, from.v + 25.0]);
        }
        "Control point" => {
            desk.key(Key::Num2);
            desk.click(image, [900.0, 700.0]);
            desk.click(Pane::Plan, [14.0, 8.0]);
        }
        "Measure" => {
            desk.key(Key::Num2);
            desk.click(Pane::Plan, [10.0, 5.0]);
            desk.click(Pane::Plan, [14.0, 5.0]);
            assert!(desk.app().editor.session().tool.measured.is_some(), "two clicks measure");
            let label = desk.harness.get_by_label_contains("px are").rect();
            assert!(label.width() > 0.0);
            // The length is typed in the panel.
            let field = desk.harness.get_all_by_label("160 px are").last().expect("the length field").rect();
            desk.drag_screen(&[field.center()], Modifiers::NONE);
            desk.harness.run_steps(2);
            desk.keys(Modifiers::COMMAND, Key::A);
            desk.harness.event(egui::Event::Text("5".into()));
            desk.harness.run_steps(2);
            desk.key(Key::Enter);
        }
        "Region of a plane" => {
            desk.key(Key::Num2);
            for at in [[10.0, 5.0], [14.0, 5.0], [14.0, 9.0], [10.0, 9.0]] {
                desk.click(Pane::Plan, at);
            }
            desk.key(Key::Enter);
        }
        "Area of interest" | "Wall" => {
            desk.key(Key::Num2);
            for at in [[10.0, 5.0], [14.0, 5.0], [14.0, 9.0]] {
                desk.click(Pane::Plan, at);
            }
            desk.key(Key::Enter);
        }
        "Link" | "Mark" => desk.click(image, [900.0, 800.0]),
        _ if many => {
            for at in [[300.0, 900.0], [1500.0, 950.0], [1300.0, 600.0], [500.0, 600.0]] {
                desk.click(image, at);
            }
            desk.key(Key::Enter);
        }
        _ => desk.line(0, Pixel::new(420.0, 880.0), Pixel::new(620.0, 500.0)),
    }
    desk.harness.run_steps(2);
}

#[test]
fn every_tool_draws_undoes_and_redoes() {
    for tool in 0..TOOLS.len() {
        let mut desk = Desk::new(demo());
        let before = desk.site().clone();
        draw(&mut desk, tool);
        let after = desk.site().clone();
        assert!(after != before, "{} draws nothing", TOOLS[tool].title);
        assert_eq!(desk.app().editor.session().history.depth(), 1, "{} is one gesture", TOOLS[tool].title);
        desk.undo();
        assert!(*desk.site() == before, "{} is not undone", TOOLS[tool].title);
        desk.redo();
        assert!(*desk.site() == after, "{} is not done again", TOOLS[tool].title);
    }
}

#[test]
fn annotations_are_edited_and_deleted() {
    for (tool, row) in TOOLS.iter().enumerate().filter(|(_, row)| {
        !["Select", "Measure", "Region of a plane", "Area of interest", "Wall"].contains(&row.title)
    }) {
        let mut desk = Desk::new(demo());
        let before = desk.site().clone();
        draw(&mut desk, tool);
        let drawn = desk.site().clone();
        desk.key(Key::Num1);
        desk.take("Select");
        if desk.app().editor.session().selection.is_empty() {
            let link = desk.site().links.len() - 1;
            desk.app().act(Action::Select(Part::Link { link, seen: 0, point: 0 }));
        }
        desk.keys(Modifiers::SHIFT, Key::ArrowRight);
        assert!(*desk.site() != drawn, "{} is not nudged", row.title);
        desk.key(Key::Delete);
        let is_field = row.title == "Field of view";
        let left = desk.site();
        let count = |site: &Site| {
            let lines = site.cameras[0].annotations.iter().map(|a| a.polylines().count()).sum::<usize>();
            lines + site.links.len() + site.marks.len() + site.cameras[0].control_points.len()
        };
        assert_eq!(count(left), count(&before), "{} is not deleted", row.title);
        assert_eq!(left.cameras[0].efov_px.is_none(), is_field);
        while desk.app().editor.session().history.depth() > 0 {
            desk.undo();
        }
        assert!(*desk.site() == before, "the site differs");
    }
}

#[test]
fn a_line_is_drawn_by_two_clicks_as_by_a_drag() {
    let (a, b) = ([420.0, 880.0], [620.0, 500.0]);
    let mut clicks = Desk::new(demo());
    clicks.take("Vertical");
    clicks.click(Pane::Image(0), a);
    clicks.click(Pane::Image(0), b);
    let mut drag = Desk::new(demo());
    drag.take("Vertical");
    drag.drag(Pane::Image(0), a, b);
    assert!(clicks.site() == drag.site(), "the sites differ");
    assert_eq!(drag.app().editor.session().history.undo_name(), Some("add V7"));
}

#[test]
fn a_drawn_pixel_is_the_pixel_under_the_cursor() {
    for zoom in [0, 5] {
        let mut desk = Desk::new(demo());
        for _ in 0..zoom {
            desk.key(Key::Plus);
        }
        desk.take("Vertical");
        let (a, b) = (Pixel::new(940.3, 560.2), Pixel::new(975.9, 690.7));
        desk.line(0, a, b);
        let drawn = desk.site().cameras[0].annotations.iter().find(|a| a.kind == Kind::Vertical).unwrap();
        let line = drawn.segments.as_ref().unwrap().last().unwrap();
        assert!(line[0].distance(a) < 1e-3 && line[1].distance(b) < 1e-3, "zoom {zoom}: {line:?}");
    }
}

#[test]
fn escape_cancels_a_drag() {
    let mut desk = Desk::new(demo());
    let before = desk.site().clone();
    desk.take("Vertical");
    desk.click(Pane::Image(0), [420.0, 880.0]);
    let over = desk.screen(Pane::Image(0), [620.0, 500.0]);
    desk.harness.hover_at(over);
    desk.harness.run_steps(2);
    assert!(*desk.site() != before, "the solution includes the dragged line");
    desk.key(Key::Escape);
    assert!(*desk.site() == before, "the site differs");
}

#[test]
fn every_command_runs_and_is_undone() {
    for row in command::all().filter(|row| !matches!(row.command, Command::Demo | Command::Tour)) {
        let mut desk = Desk::new(demo());
        let before = desk.site().clone();
        desk.app().act(Action::Select(Part::Line { annotation: 0, segment: 0 }));
        let ctx = desk.harness.ctx.clone();
        command::run(desk.app(), &ctx, row.command, Modifiers::NONE);
        desk.harness.run_steps(3);
        if row.command == Command::NewSite {
            assert!(desk.site().cameras.is_empty());
            continue;
        }
        while desk.app().editor.session().history.depth() > 0 {
            desk.undo();
        }
        assert!(*desk.site() == before, "{}", row.text);
    }
}

#[test]
fn every_key_runs_its_own_command() {
    let rows: Vec<_> = command::all().filter(|row| row.keys.is_some()).collect();
    for (i, row) in rows.iter().enumerate() {
        for other in &rows[..i] {
            assert_ne!(row.keys, other.keys, "{} and {}", row.text, other.text);
        }
    }
    let mut desk = Desk::new(demo());
    for (key, mode) in
        [(Key::Num2, Mode::Plan), (Key::Num3, Mode::All), (Key::Num4, Mode::Scene), (Key::Num1, Mode::Image)]
    {
        desk.key(key);
        assert_eq!(desk.app().view.mode, mode);
    }
}

#[test]
fn palette_finds_and_runs_a_command() {
    let mut desk = Desk::new(demo());
    desk.keys(Modifiers::COMMAND, Key::K);
    desk.harness.event(egui::Event::Text("view: plan".into()));
    desk.harness.run_steps(3);
    desk.key(Key::Enter);
    assert_eq!(desk.app().view.mode, Mode::Plan);
}

#[test]
fn handles_have_names_for_screen_readers() {
    let desk = Desk::new(demo());
    for name in [
        "V1 point 1",
        "corner 1 of the field of view",
        "Vertical tool",
        "Camera shop-1",
        "Fix the focal length",
        "Line V1",
    ] {
        assert!(desk.harness.query_by_label(name).is_some(), "{name}");
    }
}
