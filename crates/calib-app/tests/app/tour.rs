//! The tour, followed with the pointer only: press the named buttons and draw the named lines.

use calib_app::command::Command;
use calib_core::{Camera, Kind, Pixel, WorldPoint};
use calib_editor::{Pane, PlanHandle, plan_handles};
use egui::{Event, Key, Modifiers, Pos2};
use egui_kittest::kittest::Queryable as _;

use crate::desk::Desk;

/// A new user, who sees edges and tiles only in the image of the first camera.
struct Newcomer {
    desk: Desk,
    eye: Camera,
}

impl Newcomer {
    fn begin() -> Self {
        let mut desk = Desk::new(calib_site::Site::new());
        desk.tell(Command::Tour);
        Self { desk, eye: calib_demo::demo_site().truth[0].1 }
    }

    /// Clicks the first element that contains a label.
    fn press(&mut self, label: &str) {
        let at = self.desk.harness.get_all_by_label_contains(label).next().unwrap().rect().center();
        self.desk.drag_screen(&[at], Modifiers::NONE);
        self.desk.harness.run_steps(3);
    }

    fn says(&self, text: &str) -> bool {
        self.desk.words().iter().any(|word| word.contains(text))
    }

    fn sees(&self, [x, y, z]: [f64; 3]) -> Pixel {
        self.eye.world_to_pixel(WorldPoint::new(x, y, z)).unwrap()
    }

    fn line(&mut self, a: Pixel, b: Pixel) {
        self.desk.line(0, a, b);
        self.desk.harness.run_steps(3);
    }

    /// Returns the lines of every annotation of a kind in the first camera of the demonstration. The lines follow edges
    /// and tile joints that are visible in the image.
    fn visible(&self, kind: Kind) -> Vec<Vec<Vec<Pixel>>> {
        let demo = calib_demo::demo_site().site;
        let of_kind = demo.cameras[0].annotations.iter().filter(|drawn| drawn.kind == kind).cloned();
        of_kind.map(|drawn| drawn.polylines().collect()).collect()
    }

    fn drag_handle(&mut self, wanted: PlanHandle, to: impl Fn(&Self, [f64; 2]) -> [f64; 2]) {
        let handles = plan_handles(self.desk.app().editor.session(), 0);
        let from = handles.into_iter().find(|(handle, _)| *handle == wanted).unwrap().1;
        let to = to(self, from);
        let points: Vec<Pos2> = [from, to].iter().map(|&at| self.desk.screen(Pane::Plan, at)).collect();
        self.desk.drag_screen(&[points[0], points[0].lerp(points[1], 0.5), points[1]], Modifiers::NONE);
        self.desk.harness.run_steps(12);
    }
}

#[test]
fn tour_is_completed_only_by_its_instructions() {
    let mut newcomer = Newcomer::begin();
    plumb_lines(&mut newcomer);
    floor_lines(&mut newcomer);
    field_of_view(&mut newcomer);
    known_length(&mut newcomer);
    place(&mut newcomer);
    link(&mut newcomer);
    refine(&mut newcomer);
    check(&mut newcomer);
    export(&mut newcomer);
    assert!(newcomer.says("To calibrate your own cameras"), "{:?}", newcomer.desk.words());
    newcomer.press("Close");
    assert!(!newcomer.says("To calibrate your own cameras"));
}

fn plumb_lines(newcomer: &mut Newcomer) {
    assert!(newcomer.says("Step 1 of 9"));
    let plumb: Vec<Vec<Pixel>> = newcomer.visible(Kind::Vertical).into_iter().flatten().collect();
    newcomer.press("Vertical tool (V)");
    newcomer.line(plumb[0][0], plumb[0][1]);
    // A slanted line does not count.
    newcomer.line(Pixel::new(300.0, 900.0), Pixel::new(700.0, 500.0));
    assert!(newcomer.says("Step 1 of 9") && newcomer.says("is not vertical"));
    newcomer.press("Undo add");
    let far =
        plumb[1..].iter().max_by(|a, b| a[0].distance(plumb[0][0]).total_cmp(&b[0].distance(plumb[0][0])));
    let far = far.unwrap().clone();
    newcomer.line(far[0], far[1]);
}

fn floor_lines(newcomer: &mut Newcomer) {
    assert!(newcomer.says("Step 2 of 9"), "{:?}", newcomer.desk.words());
    newcomer.press("Parallel tool (P)");
    // Joints of the tiles on the free floor.
    let (along, across) = joints(newcomer);
    for line in &along {
        newcomer.line(line[0], line[1]);
    }
    newcomer.press("New direction (W)");
    for line in &across {
        newcomer.line(line[0], line[1]);
    }
}

/// Returns two floor lines of one direction, and two floor lines perpendicular to them, on the free floor.
fn joints(newcomer: &Newcomer) -> ([[Pixel; 2]; 2], [[Pixel; 2]; 2]) {
    let [a, b, c, d] = [[250.0, 800.0], [1300.0, 950.0], [1500.0, 500.0], [600.0, 450.0]]
        .map(|at| newcomer.eye.pixel_to_floor(at.into(), 0.0).unwrap());
    let (x0, x1) = (a.x.min(b.x).min(c.x).min(d.x), a.x.max(b.x).max(c.x).max(d.x));
    let (y0, y1) = (a.y.min(b.y).min(c.y).min(d.y), a.y.max(b.y).max(c.y).max(d.y));
    let inset = |low: f64, high: f64, share: f64| low + share * (high - low);
    let at = |s: f64, t: f64| newcomer.sees([inset(x0, x1, s), inset(y0, y1, t), 0.0]);
    let along = [[at(0.3, 0.35), at(0.7, 0.35)], [at(0.3, 0.65), at(0.7, 0.65)]];
    let across = [[at(0.35, 0.3), at(0.35, 0.7)], [at(0.65, 0.3), at(0.65, 0.7)]];
    (along, across)
}

fn field_of_view(newcomer: &mut Newcomer) {
    assert!(newcomer.says("Step 3 of 9"), "{:?}", newcomer.desk.words());
    newcomer.press("Field of view tool (F)");
    let corners = [[200.0, 1000.0], [1700.0, 1000.0], [1400.0, 420.0], [600.0, 450.0]];
    for at in corners.into_iter().chain([corners[0]]) {
        newcomer.desk.click(Pane::Image(0), at);
    }
    newcomer.desk.harness.run_steps(3);
    assert_eq!(newcomer.desk.app().editor.tool_row(), 0, "the tool is released");
}

fn known_length(newcomer: &mut Newcomer) {
    assert!(newcomer.says("Step 4 of 9"), "{:?}", newcomer.desk.words());
    newcomer.press("Known length tool (L)");
    let from = newcomer.eye.pixel_to_floor(Pixel::new(700.0, 800.0), 0.0).unwrap();
    let (a, b) = (newcomer.sees([from.x, from.y, 0.0]), newcomer.sees([from.x + 3.0, from.y, 0.0]));
    newcomer.line(a, b);
    assert!(newcomer.says("Type the length"), "{:?}", newcomer.desk.words());
    // The field of the length has the focus.
    newcomer.desk.harness.event(Event::Text("3".into()));
    newcomer.desk.key(Key::Enter);
    newcomer.desk.harness.run_steps(4);
}

/// Returns the pixels of a floor point in the first two views, and a wrong pixel in the second view.
fn shared_point(newcomer: &Newcomer) -> [Pixel; 3] {
    let other = calib_demo::demo_site().truth[1].1;
    // The tiles do not show the borders of the images.
    let is_seen = |px: Option<Pixel>| {
        px.is_some_and(|p| (500.0..1400.0).contains(&p.u) && (300.0..900.0).contains(&p.v))
    };
    let site = newcomer.desk.site();
    let id = [0, 1].map(|index| site.cameras[index].id.clone());
    // A click next to an existing link would join that link.
    let known: Vec<(String, Pixel)> = site
        .links
        .iter()
        .flat_map(|link| &link.seen)
        .filter_map(|seen| Some((seen.camera.clone(), seen.px?)))
        .collect();
    let is_free = |index: usize, px: Option<Pixel>| {
        let near = |(camera, own): &(String, Pixel)| {
            *camera == id[index] && px.is_some_and(|px| px.distance(*own) < 120.0)
        };
        is_seen(px) && !known.iter().any(near)
    };
    let grid = (0..2400).map(|i| [0.4 * f64::from(i % 60), 0.4 * f64::from(i / 60), 0.0]);
    let mut points = grid.map(|[x, y, z]| {
        let at = WorldPoint::new(x, y, z);
        let seen = other.world_to_pixel(at);
        [newcomer.eye.world_to_pixel(at), seen, seen.map(|px| Pixel::new(px.u, px.v + 200.0))]
    });
    let is_usable =
        |three: &[Option<Pixel>; 3]| is_free(0, three[0]) && is_free(1, three[1]) && is_free(1, three[2]);
    points.find(is_usable).unwrap().map(Option::unwrap)
}

fn link(newcomer: &mut Newcomer) {
    assert!(newcomer.says("Step 6 of 9"), "{:?}", newcomer.desk.words());
    let [a, b, wrong] = shared_point(newcomer);
    newcomer.press("All cameras (3)");
    newcomer.press("Link tool (K)");
    newcomer.desk.click(Pane::Image(0), a.into());
    assert!(newcomer.says("Now click the same point in another view."), "{:?}", newcomer.desk.words());
    newcomer.desk.click(Pane::Image(1), wrong.into());
    refine(newcomer);
    let is_stopped = newcomer.says(" is red.") || newcomer.says(" disagree by ");
    assert!(newcomer.says("Step 7 of 9") && is_stopped, "{:?}", newcomer.desk.words());
    newcomer.desk.undo();
    newcomer.desk.undo();
    newcomer.desk.click(Pane::Image(1), b.into());
    newcomer.desk.harness.run_steps(3);
}

fn refine(newcomer: &mut Newcomer) {
    assert!(newcomer.says("Step 7 of 9"), "{:?}", newcomer.desk.words());
    newcomer.press("Refine all (F9)");
    newcomer.desk.wait(|app| !app.is_working());
    newcomer.desk.harness.run_steps(4);
}

fn export(newcomer: &mut Newcomer) {
    assert!(newcomer.says("Step 9 of 9"), "{:?}", newcomer.desk.words());
    newcomer.press("Export for other programs\u{2026}");
    newcomer.desk.harness.run_steps(8);
    newcomer.desk.tell(Command::Cancel);
    newcomer.desk.harness.run_steps(3);
}

fn place(newcomer: &mut Newcomer) {
    assert!(newcomer.says("Step 5 of 9"), "{:?}", newcomer.desk.words());
    newcomer.press("Plan (2)");
    // The plan is loaded and fitted before the user acts.
    let plan = newcomer.desk.site().plan.as_ref().and_then(|plan| plan.image.clone()).unwrap();
    newcomer.desk.wait(|app| app.pictures.ready(&plan).is_some());
    newcomer.desk.harness.run_steps(3);
    let truth = newcomer.eye;
    let there: [f64; 2] = truth.position.on_floor().into();
    newcomer.drag_handle(PlanHandle::Foot, |_, from| [from[0] + 1.0, from[1] + 1.0]);
    assert!(newcomer.says("Step 5 of 9"), "it is not there yet");
    newcomer.drag_handle(PlanHandle::Foot, |_, _| there);
    newcomer.drag_handle(PlanHandle::Rotate, |own, from| {
        let far = (from[0] - there[0]).hypot(from[1] - there[1]);
        [there[0] - far * own.eye.yaw.sin(), there[1] + far * own.eye.yaw.cos()]
    });
}

fn check(newcomer: &mut Newcomer) {
    assert!(newcomer.says("Step 8 of 9"), "{:?}", newcomer.desk.words());
    newcomer.press("Select tool (Q)");
    assert!(newcomer.says("Step 8 of 9"), "a look alone is no check");
    let mark = newcomer.desk.site().marks[0].at_m;
    let shown = newcomer.desk.app().editor.session().solved.pose(1).unwrap().world_to_pixel(mark).unwrap();
    let points = [shown, Pixel::new(shown.u - 50.0, shown.v + 20.0)];
    let points = points.map(|pixel| newcomer.desk.screen(Pane::Image(1), pixel.into()));
    newcomer.desk.drag_screen(&points, Modifiers::NONE);
    newcomer.desk.harness.run_steps(3);
}

#[test]
fn tour_strip_covers_neither_image_nor_button() {
    let mut newcomer = Newcomer::begin();
    let strip = newcomer.desk.harness.get_by_label("End the tour").rect();
    let image = newcomer.desk.app().view.panes.rects.values().copied().next().unwrap();
    assert!(!strip.intersects(image), "{strip:?} over {image:?}");
}
