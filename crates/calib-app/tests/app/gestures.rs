//! Complete tasks by pointer and keys: calibration, placement, marks, and 1,000 random gestures.

use calib_app::state::Place;
use calib_core::single::Shape;
use calib_core::{FloorPoint, Kind, MarkKind, Pixel, WorldPoint};
use calib_editor::command::Gesture;
use calib_editor::{Action, Pane, Part, TOOLS, plan_scale};
use calib_site::{Mark, Options, Site, Stage};
use calib_tests::Scratch;
use egui::{Key, Modifiers, Pos2};
use egui_kittest::kittest::Queryable as _;

use crate::desk::{Desk, demo};

/// Returns the demonstration site without annotations.
fn blank() -> Site {
    let mut site = demo();
    for camera in &mut site.cameras {
        camera.annotations.clear();
        camera.control_points.clear();
        (camera.efov_px, camera.placement, camera.sigma_px) = (None, None, None);
    }
    (site.links, site.marks, site.distances) = (Vec::new(), Vec::new(), Vec::new());
    site
}

fn title(kind: Kind) -> &'static str {
    kind.row().title
}

/// Draws all annotations of a camera of the site `model`.
fn draw_camera(desk: &mut Desk, camera: usize, model: &Site) {
    let image = Pane::Image(camera);
    for annotation in &model.cameras[camera].annotations {
        desk.take(title(annotation.kind));
        for (i, line) in annotation.polylines().enumerate() {
            if i == 0 {
                desk.key(Key::W);
            }
            if annotation.kind.row().shape == Shape::Polyline {
                for point in line {
                    desk.click(image, point.into());
                }
                desk.key(Key::Enter);
            } else {
                desk.line(camera, line[0], line[line.len() - 1]);
            }
        }
    }
    desk.take("Field of view");
    for corner in model.cameras[camera].efov_px.iter().flatten() {
        desk.click(image, (*corner).into());
    }
    desk.key(Key::Enter);
}

/// Asserts that the panel shows a focal length, to the last printed digit.
fn assert_shown(desk: &mut Desk, id: &str, focal: f64) {
    let words = desk.words();
    let is_focal = |text: &&String| text.starts_with("Focal ") && text.ends_with(" px");
    let shown = words.iter().find(is_focal).expect("the focal on the panel");
    let number = shown.split_whitespace().nth(1).unwrap();
    let digits = number.split_once('.').map_or(0, |(_, digits)| digits.len());
    assert_eq!(number, format!("{focal:.digits$}"), "{id}: {shown}");
}

#[test]
fn calibration_by_pointer_gives_the_solution_of_the_file() {
    let model = demo();
    let mut desk = Desk::new(blank());
    for camera in 0..model.cameras.len() {
        if camera > 0 {
            desk.key(Key::CloseBracket);
        }
        draw_camera(&mut desk, camera, &model);
    }
    place_first(&mut desk, &model);
    let stage =
        |desk: &mut Desk, camera| desk.app().editor.session().solved.solution(camera).map(|s| s.stage);
    assert_eq!(stage(&mut desk, 0), Some(Stage::Placed), "{:?}", desk.site().cameras[0].control_points.len());
    // The other cameras are placed by dragging their feet on the plan.
    desk.take("Select");
    for camera in 1..model.cameras.len() {
        desk.key(Key::CloseBracket);
        let foot: [f64; 2] =
            desk.app().editor.session().solved.pose(camera).unwrap().position.on_floor().into();
        let to = model.cameras[camera].placement.as_ref().unwrap().move_m;
        let (from, to) = (desk.screen(Pane::Plan, foot), desk.screen(Pane::Plan, to.into()));
        let aside = from + egui::vec2(30.0, -20.0);
        desk.drag_screen(&[from, aside, to], Modifiers::NONE);
        assert_eq!(stage(&mut desk, camera), Some(Stage::Placed), "camera {camera}");
    }
    desk.refine();
    let scratch = Scratch::new();
    desk.answer(Some(scratch.path("site.json")));
    desk.keys(Modifiers::COMMAND, Key::S);
    let saved = scratch.read_json("site.json");
    let told = scratch.calib(&["solve", "site.json", "--format", "json"]).expect_code(0).json();
    to_first(&mut desk, &model);
    for (index, camera) in saved["cameras"].as_array().unwrap().iter().enumerate() {
        let id = camera["id"].as_str().unwrap();
        assert_eq!(camera["solution"], told[id], "{id}: the file and `calib solve` differ");
        assert!(!camera["solution"].is_null(), "{id}");
        // The panel shows the same focal length.
        if index > 0 {
            desk.key(Key::CloseBracket);
        }
        desk.key(Key::Num1);
        assert_shown(&mut desk, id, told[id]["focal_px"].as_f64().unwrap());
    }
}

/// Places shop-1 with control points, clicked on the image and then on the plan.
fn place_first(desk: &mut Desk, model: &Site) {
    to_first(desk, model);
    desk.key(Key::Num2);
    desk.take("Control point");
    let scale = plan_scale(model);
    desk.click(Pane::Plan, [0.0, 2.0]);
    for _ in 0..8 {
        desk.key(Key::Minus);
    }
    for point in &model.cameras[0].control_points {
        let world = point.control_point(model).unwrap().world;
        if world.z == 0.0 {
            desk.key(Key::Num1);
            desk.click(Pane::Image(0), point.px.into());
            desk.key(Key::Num2);
            let on_plan = scale.floor_from_plan(scale.plan_from_floor(world.on_floor()));
            desk.click(Pane::Plan, on_plan.into());
        }
    }
}

/// Selects the next camera until the first one is selected.
fn to_first(desk: &mut Desk, model: &Site) {
    for _ in 0..model.cameras.len() {
        if desk.app().editor.session().camera == 0 {
            return;
        }
        desk.key(Key::CloseBracket);
    }
}

#[test]
fn floor_area_keeps_its_position_when_stage_1_changes() {
    let mut site = demo();
    for camera in &mut site.cameras {
        camera.control_points.clear();
    }
    let mut desk = Desk::new(site);
    let corners = desk.site().cameras[0].efov_px.clone().unwrap();
    let places = |desk: &mut Desk| -> Vec<FloorPoint> {
        let pose = *desk.app().editor.session().solved.pose(0).unwrap();
        corners.iter().map(|&corner| pose.pixel_to_floor(corner, 0.0).unwrap()).collect()
    };
    let before = places(&mut desk);
    let kept = desk.site().cameras[0].placement.clone();
    desk.take("Select");
    let end = desk.site().cameras[0].annotations[0].polylines().next().unwrap()[1];
    desk.click(Pane::Image(0), end.into());
    desk.keys(Modifiers::SHIFT, Key::ArrowRight);
    assert_ne!(desk.site().cameras[0].placement, kept, "the placement follows");
    let size = before.iter().map(|p| p.distance(before[0])).fold(0.0, f64::max);
    for (a, b) in before.iter().zip(places(&mut desk)) {
        assert!(a.distance(b) < 0.03 * size, "{:.3} m of {size:.1} m", a.distance(b));
    }
    desk.undo();
    assert_eq!(desk.site().cameras[0].placement, kept, "undo brings the placement back with the line");
}

#[test]
fn two_pinned_marks_correct_a_misplaced_camera() {
    let mut site = demo();
    let truth = calib_demo::demo_site().truth;
    for camera in &mut site.cameras {
        camera.control_points.clear();
    }
    let placement = site.cameras[1].placement.as_mut().unwrap();
    placement.move_m.x += 0.8;
    placement.turn_deg += 6.0;
    let mut desk = Desk::new(site);
    desk.key(Key::CloseBracket);
    desk.take("Select");
    // Two points of marks are pinned: dragged with Alt from their projections to their positions in the
    // image.
    for (mark, point) in [(2, "b0"), (3, "b0")] {
        let there = desk.site().marks[mark].shape().point(point).unwrap();
        let shown = desk.app().editor.session().solved.pose(1).unwrap().world_to_pixel(there);
        let real = truth[1].1.world_to_pixel(there);
        let (Some(shown), Some(real)) = (shown, real) else { panic!("{point} of mark {mark} is not seen") };
        let points: Vec<Pos2> =
            [shown, real].iter().map(|&pixel| desk.screen(Pane::Image(1), pixel.into())).collect();
        desk.drag_screen(&points, Modifiers::ALT);
    }
    let pose = desk.app().editor.session().solved.pose(1).copied().unwrap();
    let off = pose.position.distance(truth[1].1.position);
    assert!(off < 0.25, "{off:.2} m off after two pins, {:?}", desk.site().marks[2].seen);
    assert_eq!(desk.site().marks[2].seen.len() + desk.site().marks[3].seen.len(), 2);
}

/// Returns the shop without its plan and its links, in the frame of its first camera. The other cameras are
/// displaced from their true poses.
fn without_plan() -> (Site, Vec<calib_site::Link>) {
    let mut site = demo();
    let truth = calib_demo::demo_site().truth;
    site.plan = None;
    site.cameras.truncate(3);
    let mut links = std::mem::take(&mut site.links);
    for link in &mut links {
        link.seen.retain(|seen| site.cameras.iter().any(|camera| camera.id == seen.camera));
    }
    (site.marks, site.distances) = (Vec::new(), Vec::new());
    for (index, camera) in site.cameras.iter_mut().enumerate() {
        camera.control_points.clear();
        let mut placement = calib_core::Placement::from_camera(&in_first(&truth, index));
        if index > 0 {
            placement.by.x += 0.6;
            placement.turn += 0.1;
            placement.scale *= 1.05;
        }
        camera.placement = Some(placement.into());
    }
    (site, links)
}

/// Returns a true camera in the frame of the first one, which is above (0, 0) and looks along y.
fn in_first(truth: &[(String, calib_core::Camera)], index: usize) -> calib_core::Camera {
    let (first, mut camera) = (truth[0].1, truth[index].1);
    let (sin, cos) = (-first.yaw).sin_cos();
    let (x, y) = (camera.position.x - first.position.x, camera.position.y - first.position.y);
    (camera.position.x, camera.position.y) = (cos * x - sin * y, sin * x + cos * y);
    camera.yaw -= first.yaw;
    camera
}

#[test]
fn pinned_marks_solve_cameras_without_a_plan() {
    let (site, links) = without_plan();
    let truth = calib_demo::demo_site().truth;
    let mut desk = Desk::new(site);
    let camera_of = |id: &str| truth.iter().position(|(known, _)| known == id).unwrap();
    for link in links.iter().filter(|link| link.kind == calib_site::LinkKind::Point) {
        for (i, seen) in link.seen.iter().enumerate() {
            let camera = camera_of(&seen.camera);
            desk.app().act(Action::SelectCamera(camera));
            desk.harness.run_steps(2);
            let px = seen.px.unwrap();
            if i == 0 {
                desk.app().act(Action::MarkKind(MarkKind::Cross));
                desk.take("Mark");
                desk.click(Pane::Image(camera), px.into());
                desk.take("Select");
            }
            let mark = desk.site().marks.last().unwrap().at_m;
            let shown =
                desk.app().editor.session().solved.pose(camera).unwrap().world_to_pixel(mark).unwrap();
            let points = [shown, px].map(|pixel| desk.screen(Pane::Image(camera), pixel.into()));
            desk.drag_screen(&points, Modifiers::ALT);
        }
    }
    let pins: usize = desk.site().marks.iter().map(|mark| mark.seen.len()).sum();
    assert!(pins >= 14, "{pins} pins");
    desk.refine();
    for mark in &desk.site().marks {
        let shape = mark.shape();
        for seen in &mark.seen {
            let pose = desk.harness.state().editor.session().solved.pose(camera_of(&seen.camera)).unwrap();
            let off = pose.world_to_pixel(shape.point(&seen.point).unwrap()).unwrap().distance(seen.px);
            assert!(off < 2.0, "{:?} is {off:.1} px off in {}", mark.id, seen.camera);
        }
    }
    for index in 1..3 {
        let solution = desk.harness.state().editor.session().solved.solution(index).unwrap();
        assert_eq!(solution.stage, Stage::Refined);
        let (sigma, at) = (solution.sigma.as_ref().unwrap(), solution.position_m.unwrap());
        let off = at.distance(in_first(&truth, index).position);
        let own = [sigma.x_m, sigma.y_m, sigma.z_m].iter().flatten().map(|s| s * s).sum::<f64>().sqrt();
        assert!(off < 3.0 * own, "{index}: {off:.3} m off, sigma {own:.3} m");
    }
}

#[test]
fn mark_dragged_in_one_view_moves_in_all() {
    let mut desk = Desk::new(demo());
    desk.key(Key::Num3);
    desk.take("Select");
    let before = desk.site().marks[0].at_m;
    let from = desk.app().editor.session().solved.pose(0).unwrap().world_to_pixel(before).unwrap();
    let points: Vec<Pos2> = [from, Pixel::new(from.u - 60.0, from.v + 20.0)]
        .iter()
        .map(|&pixel| desk.screen(Pane::Image(0), pixel.into()))
        .collect();
    desk.drag_screen(&points, Modifiers::NONE);
    let after = desk.site().marks[0].at_m;
    assert!(after.distance(before) > 0.1 && after.z == before.z, "{before:?} {after:?}");
    assert!(desk.app().view.panes.rects.contains_key(&(Place::Tile, Pane::Image(1))));
}

/// Opens all views of the demonstration without links, with the link tool. Returns a floor point seen by
/// several cameras.
fn linking() -> (Desk, WorldPoint) {
    let mut site = demo();
    site.links.clear();
    site.distances.clear();
    let mut desk = Desk::new(site);
    desk.key(Key::Num3);
    desk.take("Link");
    let there = desk.site().marks[2].at_m;
    (desk, there)
}

#[test]
fn both_redo_keys_work() {
    let mut desk = Desk::new(demo());
    let before = desk.site().clone();
    desk.app().act(Action::Name("Yard".into()));
    let after = desk.site().clone();
    assert_ne!(before, after);
    for (modifiers, key) in [(Modifiers::COMMAND, Key::Y), (Modifiers::COMMAND | Modifiers::SHIFT, Key::Z)] {
        desk.keys(Modifiers::COMMAND, Key::Z);
        assert_eq!(*desk.site(), before);
        desk.keys(modifiers, key);
        assert_eq!(*desk.site(), after);
    }
}

#[test]
fn links_are_continued_in_other_views() {
    let (mut desk, there) = linking();
    for camera in [0, 2] {
        let at = desk.app().editor.session().solved.pose(camera).unwrap().world_to_pixel(there).unwrap();
        desk.click(Pane::Image(camera), at.into());
    }
    let links = &desk.site().links;
    assert_eq!(links.len(), 1);
    assert_eq!(links[0].seen.len(), 2, "{links:?}");
    // A second link, one view at a time; the other camera is selected by key.
    let there = WorldPoint { x: there.x + 0.8, ..there };
    desk.key(Key::Enter);
    desk.app().act(Action::SelectCamera(0));
    desk.key(Key::Num1);
    for (camera, next) in [(0, true), (1, true), (2, false)] {
        let at = desk.app().editor.session().solved.pose(camera).unwrap().world_to_pixel(there);
        if let Some(at) = at.filter(|at| (0.0..1920.0).contains(&at.u) && (0.0..1080.0).contains(&at.v)) {
            desk.click(Pane::Image(camera), at.into());
        }
        if next {
            desk.key(Key::CloseBracket);
        }
    }
    let links = &desk.site().links;
    assert_eq!(links.len(), 2, "the link waits while the camera is chosen");
    assert!(links[1].seen.len() > 1, "{links:?}");
}

#[test]
fn posts_and_floor_lines_are_continued_in_other_views() {
    let (mut desk, there) = linking();
    let top = WorldPoint { z: there.z + 0.6, ..there };
    let shown = |desk: &mut Desk, camera: usize, at| {
        desk.app().editor.session().solved.pose(camera).unwrap().world_to_pixel(at).unwrap()
    };
    for camera in [0, 2] {
        let (foot, head) = (shown(&mut desk, camera, there), shown(&mut desk, camera, top));
        desk.line(camera, foot, head);
        desk.harness.run_steps(30);
        if camera == 0 {
            // A drag draws a floor line until the operator changes it to a post.
            assert_eq!(desk.site().links[0].kind, calib_site::LinkKind::Line);
            desk.app().act(Action::Select(Part::Link { link: 0, seen: 0, point: 0 }));
            desk.harness.run_steps(2);
            desk.harness.get_by_label("Change to a post").click();
            desk.harness.run_steps(2);
        }
    }
    let links = &desk.site().links;
    assert_eq!((links.len(), links[0].kind), (1, calib_site::LinkKind::Post));
    let heads: Vec<_> = links[0].seen.iter().map(|seen| (seen.foot.is_some(), seen.head.is_some())).collect();
    assert_eq!(heads, [(true, true); 2]);
    desk.undo();
    desk.undo();
    desk.undo();
    assert!(desk.site().links.is_empty());
}

#[test]
fn selected_link_is_continued_first() {
    let (mut desk, there) = linking();
    let at = |desk: &mut Desk, camera: usize| {
        desk.app().editor.session().solved.pose(camera).unwrap().world_to_pixel(there).unwrap()
    };
    let first = at(&mut desk, 0);
    desk.click(Pane::Image(0), first.into());
    desk.key(Key::Enter);
    desk.click(Pane::Image(0), [first.u - 40.0, first.v]);
    desk.app().act(Action::SelectOn(0, Part::Link { link: 0, seen: 0, point: 0 }));
    let second = at(&mut desk, 2);
    desk.click(Pane::Image(2), second.into());
    let views = |desk: &Desk| desk.site().links.iter().map(|link| link.seen.len()).collect::<Vec<_>>();
    assert_eq!(views(&desk), [2, 1]);
    // After undo, a removed link is no longer continued.
    desk.undo();
    desk.undo();
    desk.undo();
    desk.click(Pane::Image(0), first.into());
    assert_eq!(views(&desk), [1]);
}

/// Xorshift generator: small, fast, and equal on every machine (Marsaglia 2003).
struct Random(u64);

impl Random {
    fn next(&mut self, below: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as usize % below.max(1)
    }
}

fn random_gesture(desk: &mut Desk, random: &mut Random) {
    const KEYS: [Key; 26] = [
        Key::Delete,
        Key::Escape,
        Key::Enter,
        Key::Backspace,
        Key::D,
        Key::X,
        Key::W,
        Key::N,
        Key::J,
        Key::G,
        Key::ArrowLeft,
        Key::ArrowUp,
        Key::ArrowRight,
        Key::ArrowDown,
        Key::OpenBracket,
        Key::CloseBracket,
        Key::Num1,
        Key::Num2,
        Key::Num3,
        Key::Num4,
        Key::Home,
        Key::Plus,
        Key::Minus,
        Key::H,
        Key::B,
        Key::F8,
    ];
    const MODIFIERS: [Modifiers; 6] = [
        Modifiers::NONE,
        Modifiers::NONE,
        Modifiers::NONE,
        Modifiers::SHIFT,
        Modifiers::ALT,
        Modifiers::CTRL,
    ];
    match random.next(10) {
        0 => {
            let tool = random.next(TOOLS.len());
            desk.take_tool(tool);
        }
        1 | 2 => {
            let key = KEYS[random.next(KEYS.len())];
            let modifiers = if random.next(4) == 0 { Modifiers::SHIFT } else { Modifiers::NONE };
            desk.keys(modifiers, key);
        }
        3 => desk.undo(),
        4 => desk.redo(),
        5 => desk.keys(Modifiers::COMMAND, [Key::A, Key::C, Key::V][random.next(3)]),
        _ => {
            let mut point = || Pos2::new(random.next(1100) as f32 + 100.0, random.next(800) as f32 + 70.0);
            let points = [point(), point(), point()];
            let count = 1 + random.next(3);
            let modifiers = MODIFIERS[random.next(MODIFIERS.len())];
            desk.drag_screen(&points[..count], modifiers);
        }
    }
}

#[test]
fn thousand_random_gestures_are_undone_exactly() {
    let runs = std::env::var("CALIB_GESTURE_RUNS").ok().and_then(|runs| runs.parse().ok()).unwrap_or(1_u64);
    for run in 0..runs {
        let mut desk = Desk::new(demo());
        let before = desk.site().clone();
        let mut random = Random(0x9E37_79B9_7F4A_7C15 ^ (run + 1));
        for _ in 0..1000 {
            random_gesture(&mut desk, &mut random);
        }
        desk.key(Key::Escape);
        desk.key(Key::Escape);
        desk.key(Key::Escape);
        while desk.app().editor.session().history.depth() > 0 {
            desk.app().act(Action::Gesture(Gesture::Undo));
        }
        assert!(desk.site().to_json() == before.to_json(), "run {run}");
        assert!(*desk.site() == before, "run {run}");
    }
}

#[test]
fn corners_of_a_rectangle_calibrate_a_camera_without_lines() {
    let truth = demo().calibrate(&Options::default()).cameras.remove(0).1.unwrap();
    let camera = truth.camera().unwrap();
    let share = 1.0 / truth.efov_m.len() as f64;
    let centre = truth.efov_m.iter().fold([0.0; 2], |sum, at| [sum[0] + share * at.x, sum[1] + share * at.y]);
    // Clockwise seen from above; the first side is the width.
    let corners = [[-1.5, -1.0], [-1.5, 1.0], [1.5, 1.0], [1.5, -1.0]];
    let corners = corners
        .map(|[x, y]| camera.world_to_pixel(WorldPoint::new(centre[0] + x, centre[1] + y, 0.0)).unwrap());
    let mut site = blank();
    site.cameras.truncate(1);
    let mut desk = Desk::new(site);
    desk.take("Mark");
    // The panel of marks is next to the image while the tool is active.
    desk.harness.get_by_label("Mark kind rectangle").click();
    desk.harness.run_steps(2);
    assert_eq!(desk.app().editor.session().tool.mark_kind, MarkKind::Rectangle);
    let image = Pane::Image(0);
    for (index, corner) in corners.iter().enumerate() {
        let editor = &desk.app().editor;
        let hint = editor.tool().hint(editor.session());
        assert!(hint.contains("corner"), "{index}: {hint}");
        desk.click(image, (*corner).into());
    }
    assert_eq!(desk.site().marks[0].seen.len(), 4);
    let sized = Mark { size_m: vec![2.0, 3.0], ..desk.site().marks[0].clone() };
    desk.app().act(Action::SetMark { index: 0, mark: Box::new(sized), name: "change M1".into() });
    let session = desk.app().editor.session();
    let pose = *session.solved.pose(0).unwrap();
    let mark = &session.site.marks[0];
    for seen in &mark.seen {
        let shown = pose.world_to_pixel(mark.shape().point(&seen.point).unwrap()).unwrap();
        assert!(shown.distance(seen.px) < 3.0, "the drawn mark follows its corners: {shown:?} {seen:?}");
    }
    assert!((pose.focal / camera.focal - 1.0).abs() < 0.05, "{} for {}", pose.focal, camera.focal);
    assert!((pose.position.z / camera.position.z - 1.0).abs() < 0.05, "{:?}", pose.position);
    desk.undo();
    desk.undo();
    // Backspace removes a corner, and Esc cancels the rectangle.
    desk.take("Mark");
    desk.click(image, corners[0].into());
    desk.click(image, corners[1].into());
    desk.key(Key::Backspace);
    let editor = &desk.app().editor;
    assert!(editor.tool().hint(editor.session()).contains("corner 2"));
    desk.key(Key::Escape);
    assert!(desk.app().editor.tool().is_idle());
    assert!(desk.site().marks.is_empty() && desk.app().editor.session().solved.pose(0).is_none());
}
