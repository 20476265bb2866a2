//! Joint refinement and the status of each camera in the window.

use calib_app::App;
use calib_app::storage::files::Images;
use calib_core::{Kind, Pixel};
use calib_editor::{Action, Pane, PlanHandle, TOOLS, plan_handles};
use calib_site::{Site, Stage};
use egui::{Context, Event, Key, Modifiers, PointerButton, Vec2};
use egui_kittest::kittest::Queryable as _;

use crate::desk::{Desk, demo};

fn stage(desk: &Desk, camera: usize) -> Stage {
    desk.harness.state().editor.session().solved.solution(camera).unwrap().stage
}

#[test]
fn camera_with_a_rejected_link_is_not_done() {
    let mut site = demo();
    let is_point = |link: &&mut calib_site::Link| link.seen.len() > 2 && link.seen[0].px.is_some();
    let link = site.links.iter_mut().find(is_point).unwrap();
    let camera = link.seen[0].camera.clone();
    let at = link.seen[0].px.unwrap();
    link.seen[0].px = Some(Pixel::new(at.u + 150.0, at.v - 60.0));
    let mut desk = Desk::new(site);
    desk.refine();
    let session = desk.harness.state().editor.session();
    let index = session.site.cameras.iter().position(|entry| entry.id == camera).unwrap();
    let status = calib_editor::camera_status(session, index);
    assert_eq!(status.text, "check 1 rejected link");
    assert_eq!(status.level, calib_editor::StatusLevel::Contradictory);
    assert!(!calib_editor::steps::is_finished(session, index));
}

#[test]
fn out_of_date_solution_is_shown_and_updated_by_one_button() {
    let mut desk = Desk::new(demo());
    desk.refine();
    assert_eq!(stage(&desk, 0), Stage::Refined);
    // A time limit below zero prevents joint refinement meanwhile.
    desk.app().act(Action::SetMaxJointSolveMs(-1.0));
    desk.take("Vertical");
    let plumb = desk.site().cameras[0].annotations[0].polylines().next().unwrap();
    desk.line(0, Pixel::new(plumb[0].u + 0.4, plumb[0].v), plumb[1]);
    desk.harness.run_steps(3);
    for key in [Key::Num1, Key::Num2, Key::Num3] {
        desk.key(key);
        let words = desk.words().join("\n");
        assert!(words.contains("changed since the cameras were refined"), "{words}");
    }
    desk.key(Key::Num1);
    desk.harness.get_by_label("Refine all again").click();
    desk.harness.run_steps(2);
    desk.wait(|app| !app.is_working());
    desk.harness.run_steps(3);
    assert!(desk.harness.state().editor.session().solved.is_joint_current());
    assert!(desk.harness.query_by_label("Refine all again").is_none());
}

#[test]
fn joint_solution_survives_a_restart() {
    let folder = tempfile::tempdir().unwrap();
    let mut app = App::new(&Context::default(), Some(folder.path().to_path_buf()));
    let before = demo();
    app.open_site(before.clone(), Images::default(), None);
    let mut harness = egui_kittest::Harness::builder()
        .with_context_setup(calib_app::theme::install)
        .build_ui_state(|ui, app: &mut App| app.show_ui(ui), app);
    let refined = calib_editor::refined(before.clone());
    harness.state_mut().act(Action::Refined(Box::new((before, refined))));
    harness.run_steps(3);
    let pose = |app: &App| *app.editor.session().solved.pose(1).unwrap();
    let (kept, focal) = (pose(harness.state()), pose(harness.state()).focal);
    drop(harness);
    let mut app = App::new(&Context::default(), Some(folder.path().to_path_buf()));
    app.recover(0);
    assert_eq!(app.editor.session().solved.solution(1).unwrap().stage, Stage::Refined);
    assert_eq!((pose(&app), pose(&app).focal), (kept, focal));
}

/// Returns the demonstration with contradictory verticals in the first camera. Some of the verticals become outliers.
fn contradictory() -> Site {
    let mut site = demo();
    site.cameras.truncate(1);
    (site.links, site.marks, site.distances) = (Vec::new(), Vec::new(), Vec::new());
    let camera = &mut site.cameras[0];
    (camera.control_points, camera.placement) = (Vec::new(), None);
    for drawn in camera.annotations.iter_mut().filter(|drawn| drawn.kind == Kind::Vertical) {
        drawn.keep = true;
        for (index, line) in drawn.segments.iter_mut().flatten().enumerate() {
            line[0].u += if index % 2 == 0 { 30.0 } else { -30.0 };
        }
    }
    camera.efov_px = Some([[100.0, 1000.0], [1800.0, 1000.0], [960.0, 20.0]].map(Pixel::from).to_vec());
    site
}

#[test]
fn misfit_camera_is_marked_and_its_worst_warning_is_open() {
    let mut desk = Desk::new(contradictory());
    desk.harness.run_steps(2);
    let warnings = desk.app().editor.session().solution().unwrap().warnings.clone();
    assert!(warnings.len() > 1, "{warnings:?}");
    let more = format!("Show {} more", warnings.len() - 1);
    let advice = |desk: &Desk| {
        let words = desk.words().join("\n");
        warnings.iter().filter(|warning| words.contains(&warning.advice)).count()
    };
    assert_eq!(advice(&desk), 1, "one is open");
    desk.harness.get_by_label(&more).click();
    desk.harness.run_steps(3);
    assert_eq!(advice(&desk), warnings.len(), "no line is truncated");
    assert_eq!(desk.harness.query_all_by_label("Show").count(), warnings.len(), "each can be shown");
    let status = calib_editor::camera_status(desk.app().editor.session(), 0);
    assert_eq!(status.level, calib_editor::StatusLevel::Contradictory, "{status:?}");
}

#[test]
fn camera_is_moved_on_the_plan_with_any_tool() {
    for tool in TOOLS.iter().filter(|tool| !tool.acts_on_plan()) {
        let mut site = demo();
        site.cameras.iter_mut().for_each(|camera| camera.control_points.clear());
        let mut desk = Desk::new(site);
        desk.key(Key::Num2);
        desk.take(tool.title);
        let before = desk.site().cameras[0].annotations.clone();
        let foot = plan_handles(desk.app().editor.session(), 0)[0];
        assert_eq!(foot.0, PlanHandle::Foot);
        let from = desk.screen(Pane::Plan, foot.1);
        let place = desk.site().cameras[0].placement.clone();
        desk.drag_screen(
            &[from, from + Vec2::new(30.0, 10.0), from + Vec2::new(40.0, 20.0)],
            Modifiers::NONE,
        );
        assert_ne!(desk.site().cameras[0].placement, place, "{}", tool.title);
        assert!(desk.site().cameras[0].annotations == before, "{} drew something", tool.title);
        desk.undo();
        assert_eq!(desk.site().cameras[0].placement, place, "{}", tool.title);
    }
}

#[test]
fn many_strokes_in_one_frame_are_all_drawn() {
    const STROKES: u16 = 60;
    let mut desk = Desk::new(demo());
    desk.take("Vertical");
    let depth = desk.app().editor.session().history.depth();
    let ends: Vec<_> = (0..STROKES)
        .map(|i| {
            let u = 300.0 + 20.0 * f64::from(i);
            [[u, 400.0], [u, 560.0]].map(|at| desk.screen(Pane::Image(0), at))
        })
        .collect();
    let button = |pos, pressed| Event::PointerButton {
        pos,
        button: PointerButton::Primary,
        pressed,
        modifiers: Modifiers::NONE,
    };
    // All strokes arrive between two frames, as in a window that was busy.
    let input = desk.harness.input_mut();
    for [from, to] in ends {
        let middle = from.lerp(to, 0.5);
        input.events.extend([
            Event::PointerMoved(from),
            button(from, true),
            Event::PointerMoved(middle),
            Event::PointerMoved(to),
            button(to, false),
        ]);
    }
    let start = std::time::Instant::now();
    desk.harness.step();
    let took = start.elapsed();
    desk.harness.step();
    assert_eq!(desk.app().editor.session().history.depth(), depth + usize::from(STROKES));
    println!("{STROKES} strokes in {took:?}");
}
