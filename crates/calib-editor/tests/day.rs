//! Working day of an operator without a window: add images, draw lines, place, link, refine and save.
#![allow(clippy::unwrap_used, reason = "a failed step fails the test")]

use std::path::PathBuf;

use calib_core::{Camera, FloorPoint, Kind, Pixel, Placement};

use calib_core::single::Known;

use calib_editor::command::{Cameras, Gesture, Group, Lines, Nudge, Selection};
use calib_editor::{
    Action, Command, Editor, Images, Modifiers, NewImage, Opened, Pane, Part, Phase, PlacementNumber,
    PlanHandle, Pointer, TOOLS, command, parse, plan_handles, refined, steps,
};
use calib_site::{FixedEntry, PlacementEntry, Site, Stage};

/// Operator who controls the editor with pointer and tools.
struct Operator(Editor);

impl Operator {
    fn site(&self) -> &Site {
        self.0.site()
    }

    fn take(&mut self, title: &str) {
        let index = TOOLS.iter().position(|tool| tool.title == title).unwrap();
        self.0.apply(Action::SelectTool(index));
    }

    fn pointer(&mut self, pane: Pane, at: [f64; 2], phase: Phase, moved: bool) {
        self.0.apply(Action::Pointer(Pointer {
            pane,
            at,
            phase,
            modifiers: Modifiers::NONE,
            radius: if pane == Pane::Plan { 0.1 } else { 8.0 },
            point_size: 0.5,
            moved,
            double: false,
            edge: None,
            captured: None,
            newer: None,
            image: None,
        }));
    }

    fn drag(&mut self, pane: Pane, from: [f64; 2], to: [f64; 2]) {
        self.pointer(pane, from, Phase::Press, false);
        let middle = [0.5 * (from[0] + to[0]), 0.5 * (from[1] + to[1])];
        self.pointer(pane, middle, Phase::Drag, true);
        self.pointer(pane, to, Phase::Drag, true);
        self.pointer(pane, to, Phase::Release, true);
    }

    fn click(&mut self, pane: Pane, at: [f64; 2]) {
        self.pointer(pane, at, Phase::Press, false);
        self.pointer(pane, at, Phase::Release, false);
    }

    fn undo(&mut self) {
        self.0.apply(Action::Gesture(Gesture::Undo));
    }

    fn redo(&mut self) {
        self.0.apply(Action::Gesture(Gesture::Redo));
    }

    fn depth(&self) -> usize {
        self.0.session().history.depth()
    }

    fn stage(&self, camera: usize) -> Option<Stage> {
        self.0.session().solved.solution(camera).map(|solution| solution.stage)
    }

    fn pose(&self, camera: usize) -> Camera {
        *self.0.session().solved.pose(camera).unwrap()
    }

    /// Draws all annotations of the demonstration on the image of a camera, with the tools.
    fn draw(&mut self, camera: usize, drawn: &Site) {
        let pane = Pane::Image(camera);
        for annotation in &drawn.cameras[camera].annotations {
            self.take(annotation.kind.row().title);
            for (index, line) in annotation.polylines().enumerate() {
                if index == 0 && annotation.kind == Kind::Parallel {
                    self.0.apply(Action::Lines(Lines::NewGroup));
                }
                match annotation.kind {
                    Kind::Straight => {
                        line.iter().for_each(|&point| self.click(pane, point.into()));
                        self.0.apply(Action::Gesture(Gesture::Accept));
                    }
                    _ => self.drag(pane, line[0].into(), line[line.len() - 1].into()),
                }
            }
        }
        self.take("Field of view");
        for &corner in drawn.cameras[camera].efov_px.iter().flatten() {
            self.click(pane, corner.into());
        }
        self.0.apply(Action::Gesture(Gesture::Accept));
    }

    /// Drags the foot, ring and square of a camera on the plan to their positions in the placement `to`.
    fn place(&mut self, camera: usize, to: Placement) {
        self.take("Select");
        self.0.apply(Action::SelectCamera(camera));
        let handle = |own: &Self, wanted: PlanHandle| {
            let handles = plan_handles(own.0.session(), camera);
            handles.into_iter().find(|(handle, _)| *handle == wanted).unwrap().1
        };
        let from = handle(self, PlanHandle::Foot);
        self.drag(Pane::Plan, from, to.by.into());
        for wanted in [PlanHandle::Rotate, PlanHandle::Scale] {
            let now = self.0.session().placement(camera).unwrap();
            let (from, foot) = (handle(self, wanted), [now.by.x, now.by.y]);
            let (turn, scale) = match wanted {
                PlanHandle::Rotate => (to.turn - now.turn, 1.0),
                _ => (0.0, to.scale / now.scale),
            };
            let (sin, cos) = turn.sin_cos();
            let [x, y] = [from[0] - foot[0], from[1] - foot[1]];
            let at = [foot[0] + scale * (cos * x - sin * y), foot[1] + scale * (sin * x + cos * y)];
            self.drag(Pane::Plan, from, at);
        }
    }
}

/// Returns the pixel of a floor point in a camera of the demonstration, if it is visible.
fn shown(camera: &Camera, at: FloorPoint) -> Option<Pixel> {
    let px = camera.world_to_pixel(at.at_height(0.0))?;
    ((50.0..1870.0).contains(&px.u) && (50.0..1030.0).contains(&px.v)).then_some(px)
}

/// Returns a site with two cameras of the demonstration that show a common part of the floor, and the true cameras.
fn two() -> (Site, [Camera; 2]) {
    let demo = calib_demo::demo_site();
    let mut site = demo.site;
    site.cameras.truncate(2);
    (site, [demo.truth[0].1, demo.truth[1].1])
}

/// Returns an operator who has added two images and drawn their lines. Checks that results are available at once.
fn drawn() -> Operator {
    let (demo, _) = two();
    let mut operator = Operator(Editor::default());
    for camera in &demo.cameras {
        let still = NewImage {
            image: format!("{}.png", camera.id),
            title: camera.id.clone(),
            size: camera.size_px,
            image_circle: None,
            pixel_aspect: None,
        };
        operator.0.apply(Action::AddCamera { image: still, joins_last: false });
    }
    assert_eq!(operator.site().cameras.len(), 2);
    assert_eq!(operator.stage(0), None, "no annotations");
    for camera in 0..2 {
        operator.draw(camera, &demo);
        assert_eq!(operator.stage(camera), Some(Stage::Partial), "lines give roll, pitch and focal");
        let own = &operator.site().cameras[camera];
        assert_eq!(own.efov_px, demo.cameras[camera].efov_px);
    }
    operator
}

#[test]
fn lines_are_solved_while_drawn_and_undone_one_by_one() {
    let mut operator = drawn();
    let (after, depth) = (operator.site().clone(), operator.depth());
    let pose = operator.pose(0);
    let fitted = |operator: &Operator| operator.0.session().solution().unwrap().residuals.len();
    operator.0.apply(Action::SelectCamera(0));
    let before = fitted(&operator);
    operator.take("Vertical");
    let pane = Pane::Image(0);
    operator.pointer(pane, [900.0, 200.0], Phase::Press, false);
    operator.pointer(pane, [1000.0, 700.0], Phase::Drag, true);
    assert_eq!(fitted(&operator), before + 1, "an unfinished line is included in the solve");
    operator.0.apply(Action::Gesture(Gesture::Cancel));
    assert!(*operator.site() == after && operator.pose(0) == pose, "Esc cancels the gesture");
    assert_eq!(operator.depth(), depth);
    while operator.depth() > 0 {
        operator.undo();
    }
    assert!(operator.site().cameras.is_empty(), "the site is empty again");
    for _ in 0..depth {
        operator.redo();
    }
    assert!(*operator.site() == after, "every gesture is redone");
}

#[test]
fn site_is_placed_linked_refined_saved_and_reopened() {
    let mut operator = drawn();
    let (_, truth) = two();
    for (camera, truth) in truth.iter().enumerate() {
        operator.place(camera, Placement::from_camera(truth));
        assert_eq!(operator.stage(camera), Some(Stage::Placed));
        let off = operator.pose(camera).position.on_floor().distance(truth.position.on_floor());
        assert!(off < 0.2, "camera {camera} is {off} m off");
    }
    // Floor points that both cameras show are clicked in both.
    operator.take("Link");
    let grid = (0..600).map(|i| FloorPoint::new(0.5 * f64::from(i % 30), 0.5 * f64::from(i / 30)));
    let common = grid.filter_map(|at| Some([shown(&truth[0], at)?, shown(&truth[1], at)?]));
    let common: Vec<[Pixel; 2]> = common.step_by(4).take(6).collect();
    assert!(common.len() > 3, "the two cameras share floor");
    for seen in &common {
        seen.iter().enumerate().for_each(|(camera, &px)| operator.click(Pane::Image(camera), px.into()));
        operator.0.apply(Action::Gesture(Gesture::Accept));
    }
    assert_eq!(
        operator.site().links.iter().map(|link| link.seen.len()).collect::<Vec<_>>(),
        vec![2; common.len()]
    );

    let before = operator.site().clone();
    operator.0.apply(Action::Refined(Box::new((before.clone(), refined(before.clone())))));
    for camera in 0..2 {
        assert_eq!(operator.stage(camera), Some(Stage::Refined));
    }
    let apart = |operator: &Operator| {
        let place = |camera: usize, px: Pixel| operator.pose(camera).pixel_to_floor(px, 0.0).unwrap();
        common.iter().map(|[a, b]| place(0, *a).distance(place(1, *b))).fold(0.0, f64::max)
    };
    let agreed = apart(&operator);
    operator.undo();
    assert!(*operator.site() == before && apart(&operator) >= agreed, "refining improves the agreement");
    operator.redo();

    exported(&operator);
    saved_and_opened(operator);
}

/// Checks that the site can be exported to another program.
fn exported(operator: &Operator) {
    let session = operator.0.session();
    let solved = session.solved.write_into(&session.site);
    let format = calib_formats::FORMATS.iter().find(|format| format.can_export()).unwrap();
    let export = calib_formats::export(format, &solved, &calib_formats::ExportOptions::default()).unwrap();
    assert!(export.unsolved.is_empty() && export.files.iter().all(|file| !file.bytes.is_empty()));
}

fn saved_and_opened(mut operator: Operator) {
    let session = operator.0.session();
    let solved = session.solved.write_into(&session.site);
    let text = session.images.embed_into(&solved, None).to_json();
    let path = PathBuf::from("site.json");
    assert!(!session.is_saved());
    operator.0.apply(Action::Saved { path: path.clone(), folder: None });
    assert!(operator.0.session().is_saved());

    let (site, images) = parse(&text, None).unwrap();
    let mut again = Editor::default();
    again.apply(Action::Open(Box::new(Opened { site, images, path: Some(path), is_unsaved: false })));
    for camera in 0..2 {
        assert_eq!(again.session().solved.pose(camera), Some(&operator.pose(camera)), "the same camera");
    }
    assert_eq!(again.session().history.depth(), 0);
}

#[test]
fn every_document_command_runs_in_any_state_and_removes_no_camera() {
    let drawn = drawn().site().clone();
    for row in command::all().filter(|row| row.command != Command::RemoveCamera) {
        let (mut editor, site) = (Editor::default(), drawn.clone());
        let opened = Opened { site, images: Images::default(), path: None, is_unsaved: false };
        editor.apply(Action::Open(Box::new(opened)));
        editor.apply(Action::Select(Part::Line { annotation: 0, segment: 0 }));
        let before = editor.site().cameras.len();
        let action = match row.command.group() {
            Group::Tool(index) => Action::SelectTool(index),
            Group::Gesture(Gesture::Undo) => continue,
            Group::Gesture(command) => Action::Gesture(command),
            Group::Selection(command) => Action::Selection(command, None),
            Group::Nudge(step) => Action::Nudge { step, coarse: false, pane: None },
            Group::Lines(command) => Action::Lines(command),
            Group::Proposing(command) => Action::Proposing(command),
            Group::Cameras(command) => Action::Cameras(command),
            Group::Files(_) | Group::Newer(_) | Group::View(_) | Group::Solving(_) | Group::Switch(_) => {
                continue;
            }
        };
        editor.apply(action);
        assert_eq!(editor.site().cameras.len(), before, "{}", row.text);
        assert!(editor.is_settled(), "{} leaves an unfinished gesture", row.text);
    }
}

#[test]
fn empty_site_accepts_every_command() {
    let commands = [
        Action::Selection(Selection::Delete, None),
        Action::Nudge { step: Nudge::NudgeLeft, coarse: true, pane: Some(Pane::Plan) },
        Action::Nudge { step: Nudge::Grow, coarse: false, pane: None },
        Action::Lines(Lines::PasteLines),
        Action::Cameras(Cameras::NextCamera),
        Action::Cameras(Cameras::PreviousUnfinished),
        Action::Cameras(Cameras::RemoveCamera),
        Action::TogglePlacementFixed,
        Action::RemovePlacement,
        Action::SelectCamera(7),
    ];
    let mut editor = Editor::default();
    for command in commands {
        editor.apply(command);
        assert_eq!(editor.session().history.depth(), 0);
    }
}

#[test]
fn clicked_link_is_continued_and_two_links_of_one_point_are_merged() {
    let mut operator = drawn();
    operator.take("Link");
    let there = [900.0, 800.0];
    let seen = |operator: &Operator| -> Vec<usize> {
        operator.site().links.iter().map(|link| link.seen.len()).collect()
    };
    operator.click(Pane::Image(1), there);
    operator.0.apply(Action::Gesture(Gesture::Accept));
    // A new link is merged with the earlier one by a click near the point of the earlier one.
    operator.click(Pane::Image(0), [300.0, 600.0]);
    operator.click(Pane::Image(1), [there[0] + 3.0, there[1]]);
    assert_eq!(seen(&operator), [2], "a click on a link does not add another");
    let link = &operator.site().links[0];
    assert_eq!(link.seen.iter().map(|seen| seen.px.unwrap().u).collect::<Vec<_>>(), [900.0, 300.0]);
    operator.undo();
    assert_eq!(seen(&operator), [1, 1]);
    // Two points in one camera are two different objects.
    operator.0.apply(Action::Gesture(Gesture::Accept));
    operator.click(Pane::Image(1), [100.0, 900.0]);
    operator.click(Pane::Image(1), there);
    assert_eq!(operator.site().links.len(), 3);
}

#[test]
fn click_has_the_accuracy_of_the_zoom() {
    let mut operator = drawn();
    let at = |at: [f64; 2], phase, moved, grain| {
        let modifiers = Modifiers::NONE;
        let (pane, radius) = (Pane::Image(0), 8.0 * grain);
        Action::Pointer(Pointer {
            pane,
            at,
            phase,
            modifiers,
            radius,
            point_size: grain,
            moved,
            double: false,
            edge: None,
            captured: None,
            newer: None,
            image: None,
        })
    };
    operator.take("Link");
    let from = [900.0, 800.0];
    operator.0.apply(at(from, Phase::Press, false, 2.3));
    operator.0.apply(at(from, Phase::Release, false, 2.3));
    assert_eq!(operator.site().links[0].seen[0].sigma_px, Some(2.3));
    assert!(operator.0.session().note.as_ref().is_some_and(|note| note.contains("\u{b1} 2.3 px")));
    // A point dragged at a large scale is as accurate as the other annotations.
    operator.take("Select");
    operator.0.apply(at(from, Phase::Press, false, 0.5));
    operator.0.apply(at([902.0, 801.0], Phase::Drag, true, 0.5));
    operator.0.apply(at([902.0, 801.0], Phase::Release, true, 0.5));
    let seen = &operator.site().links[0].seen[0];
    assert_eq!((seen.px, seen.sigma_px), (Some(Pixel::new(902.0, 801.0)), None));
    operator.undo();
    assert_eq!(operator.site().links[0].seen[0].sigma_px, Some(2.3));
    // One end of a line is dragged at a large scale. The less accurate other end determines the accuracy of the line.
    operator.take("Link");
    operator.0.apply(Action::Gesture(Gesture::Accept));
    let ends = [[200.0, 700.0], [400.0, 720.0]];
    operator.0.apply(at(ends[0], Phase::Press, false, 3.0));
    operator.0.apply(at(ends[1], Phase::Drag, true, 3.0));
    operator.0.apply(at(ends[1], Phase::Release, true, 3.0));
    operator.take("Select");
    operator.0.apply(at(ends[0], Phase::Press, false, 0.5));
    operator.0.apply(at([202.0, 701.0], Phase::Drag, true, 0.5));
    operator.0.apply(at([202.0, 701.0], Phase::Release, true, 0.5));
    let seen = &operator.site().links[1].seen[0];
    assert_eq!(seen.segment.as_ref().unwrap()[0], Pixel::new(202.0, 701.0));
    assert_eq!(seen.sigma_px, Some(3.0));
}

#[test]
fn measured_height_survives_fixing_and_unfixing_the_placement() {
    let measured = Known::prior(3.1, 0.1);
    for number in [PlacementNumber::X, PlacementNumber::Height] {
        let mut operator = drawn();
        let mut site = operator.site().clone();
        let held = FixedEntry::default();
        let placement = PlacementEntry {
            move_m: FloorPoint::new(1.0, 2.0),
            turn_deg: 3.0,
            scale: Some(1.0),
            fixed: true,
            held,
            estimated: false,
        };
        (site.cameras[0].placement, site.cameras[0].height_m) = (Some(placement), Some(measured));
        operator.0.apply(Action::Open(Box::new(Opened {
            site,
            images: Images::default(),
            path: None,
            is_unsaved: false,
        })));
        operator.0.apply(Action::ToggleNumberFixed(number));
        let entry = &operator.site().cameras[0];
        assert_eq!(entry.height_m, Some(measured));
        let released = entry.placement.as_ref().unwrap();
        assert!(!released.fixed && released.held.x == (number != PlacementNumber::X) && released.held.turn);
    }
}

#[test]
fn result_for_a_closed_site_is_discarded() {
    let mut operator = drawn();
    let before = operator.site().clone();
    let opened = Opened { site: Site::new(), images: Images::default(), path: None, is_unsaved: false };
    operator.0.apply(Action::Open(Box::new(opened)));
    operator.0.apply(Action::Refined(Box::new((before.clone(), before))));
    assert!(operator.site().cameras.is_empty(), "the result belongs to another site");
}

#[test]
fn steps_list_the_missing_work_of_a_camera() {
    let (demo, _) = two();
    let still = NewImage {
        image: "a.png".into(),
        title: "a".into(),
        size: demo.cameras[0].size_px,
        image_circle: None,
        pixel_aspect: None,
    };
    let mut operator = Operator(Editor::default());
    operator.0.apply(Action::AddCamera { image: still, joins_last: false });
    let missing = steps::missing_steps(operator.0.session(), 0);
    operator.draw(0, &demo);
    assert!(steps::missing_steps(operator.0.session(), 0) < missing);
    assert!(!steps::is_finished(operator.0.session(), 0), "the camera is not placed");
}

#[test]
fn all_strokes_of_a_frame_are_kept_and_solved_in_the_next() {
    let mut operator = drawn();
    operator.0.apply(Action::SelectCamera(0));
    operator.take("Vertical");
    let (before, depth) = (operator.site().cameras[0].annotations.clone(), operator.depth());
    let model = two().0.cameras[0].annotations.clone();
    let plumb: Vec<_> = model
        .iter()
        .filter(|a| a.kind == Kind::Vertical)
        .flat_map(|a| a.polylines().collect::<Vec<_>>())
        .collect();
    operator.0.begin_frame();
    for line in &plumb {
        operator.drag(Pane::Image(0), line[0].into(), line[1].into());
    }
    assert_eq!(operator.depth(), depth + plumb.len(), "every line is an undo step");
    operator.0.solve();
    let solved = operator.pose(0);
    // The same lines, solved one by one.
    for _ in &plumb {
        operator.undo();
    }
    assert!(operator.site().cameras[0].annotations == before);
    let mut slowly = drawn();
    slowly.0.apply(Action::SelectCamera(0));
    slowly.take("Vertical");
    for line in &plumb {
        slowly.drag(Pane::Image(0), line[0].into(), line[1].into());
    }
    let apart =
        (solved.pitch - slowly.pose(0).pitch).abs() + (solved.focal / slowly.pose(0).focal - 1.0).abs();
    assert!(apart < 1e-6, "{apart}");
}

/// Control points alone calibrate a camera, so its steps ask for no lines.
#[test]
fn camera_from_control_points_needs_no_lines() {
    let demo = calib_demo::demo_site();
    let truth = demo.truth[0].1;
    let mut site = demo.site.clone();
    site.cameras.truncate(1);
    (site.links, site.marks, site.distances) = (Vec::new(), Vec::new(), Vec::new());
    let camera = &mut site.cameras[0];
    camera.annotations.clear();
    camera.placement = None;
    camera.lens = None;
    assert!(camera.control_points.len() >= 5);
    for point in &mut camera.control_points {
        let world = point.control_point(&demo.site).unwrap().world;
        // The demonstration has a distorted lens, which points alone do not determine.
        let straight = Camera { lens: calib_core::Lens::pinhole(truth.lens.principal_point), ..truth };
        point.px = straight.world_to_pixel(world).unwrap();
    }
    let [points, mut none] = [site.clone(), site];
    none.cameras[0].control_points.clear();
    let listed = |site: Site| {
        let mut editor = Editor::default();
        let opened = Opened { site, images: Images::default(), path: None, is_unsaved: false };
        editor.apply(Action::Open(Box::new(opened)));
        (steps::is_finished(editor.session(), 0), steps::steps(editor.session(), 0))
    };
    let (is_finished, steps) = listed(points);
    assert!(steps.iter().all(|step| step.is_done || step.is_optional), "{steps:?}");
    assert!(is_finished, "{steps:?}");
    let (_, steps) = listed(none);
    assert_eq!(steps.last().unwrap().state, "click 4 points in the image and on the plan");
}
