//! Automatic calibration: one key detects the lines of an image, another accepts them. Strokes and clicks are
//! counted on the demonstration.

use calib_app::storage::demo;
use calib_core::{Annotation, Camera, Kind, Orientation};
use calib_editor::{Action, AutomaticResult, Hypothesis, Images, Pane, Period};
use calib_image::{AutomaticCalibration, Bars, Confidence, EdgeClass, EdgeImage, ImageEdges, LineSegment};
use calib_site::{Options, PrincipalPointEntry, Site, SiteCamera, Solution};
use egui::{Key, Modifiers};
use egui_kittest::kittest::Queryable as _;

use crate::desk::Desk;

/// Returns the demonstration site and its images without annotations, control points, links, marks, distances,
/// placements and lenses. Only the principal points are known.
fn blank() -> (Site, Images) {
    let (mut site, images) = demo::open();
    (site.links, site.marks, site.distances) = Default::default();
    for camera in &mut site.cameras {
        camera.annotations.clear();
        camera.control_points.clear();
        (camera.placement, camera.lens, camera.efov_px) = (None, None, None);
        know_principal_point(camera);
    }
    (site, images)
}

/// Enters the image centre as the principal point: the demonstration's cameras have it there.
fn know_principal_point(camera: &mut SiteCamera) {
    let centre = PrincipalPointEntry::known(camera.principal_point());
    camera.lens.get_or_insert_default().principal_point_px = Some(centre);
}

/// Returns the errors of a camera: log focal length, pitch and roll in degrees.
fn off(solution: &Solution, truth: &Camera) -> [f64; 3] {
    [
        (solution.focal_px / truth.focal).ln().abs(),
        (solution.pitch_deg.unwrap() - truth.pitch.to_degrees()).abs(),
        (solution.roll_deg.unwrap() - truth.roll.to_degrees()).abs(),
    ]
}

fn strokes(camera: &SiteCamera) -> usize {
    camera.annotations.iter().map(|drawn| drawn.polylines().count()).sum()
}

/// Returns the errors of a camera from hand-drawn lines only, and the number of strokes.
fn by_hand(camera: &SiteCamera, truth: &Camera) -> ([f64; 3], usize) {
    let mut alone =
        SiteCamera { control_points: Vec::new(), placement: None, solution: None, ..camera.clone() };
    know_principal_point(&mut alone);
    let site = Site { cameras: vec![alone], ..Site::new() };
    let solution = site.calibrate(&Options::default()).cameras.pop().unwrap().1.unwrap();
    (off(&solution, truth), strokes(camera))
}

#[test]
fn two_keys_calibrate_the_demonstration_or_abstain() {
    let demonstration = calib_demo::demo_site();
    let (site, images) = blank();
    let mut desk = Desk::with(site, images);
    let mut as_good = 0;
    for (camera, (id, truth)) in demonstration.truth.iter().enumerate() {
        desk.app().act(Action::SelectCamera(camera));
        desk.harness.run_steps(2);
        let began = std::time::Instant::now();
        desk.keys(Modifiers::SHIFT, Key::P);
        desk.wait(|app| !app.is_working());
        let seconds = began.elapsed().as_secs_f64();
        desk.harness.run_steps(2);
        let proposed = desk.app().editor.session().proposed().unwrap().clone();
        let before = desk.app().editor.session().history.depth() - 1;
        let mut gestures = 2;
        let rival = proposed.alternative.as_ref().map(|rival| rival.orientation);
        if let (Some(own), Some(rival), Confidence::None) = (proposed.orientation, rival, proposed.confidence)
        {
            // Two solutions explain the edges equally well; the operator selects the correct one.
            let near = |at: &Orientation| (at.focal / truth.focal).ln().abs();
            let seen = if near(&own) < near(&rival) { own } else { rival };
            desk.key(Key::Enter);
            let note = desk.app().editor.session().note.clone().unwrap();
            assert!(note.contains("Choose one"), "{note}");
            desk.harness
                .get_by_label(&Hypothesis::description(
                    &seen,
                    f64::from(demonstration.site.cameras[camera].size_px[0]),
                ))
                .click();
            desk.harness.run_steps(3);
            gestures += 1;
        }
        let verdict = desk.app().editor.session().proposed().unwrap().confidence;
        desk.key(Key::Enter);
        let session = desk.harness.state().editor.session();
        let (hand, by_hand) = by_hand(&demonstration.site.cameras[camera], truth);
        let drawn = strokes(&session.site.cameras[camera]);
        if verdict == Confidence::None {
            assert_eq!(drawn, 0, "{id}: a result without confidence is not accepted by one key");
            println!("{id}: abstains; by hand {by_hand} strokes, off {hand:.3?}");
            continue;
        }
        let own = off(session.solution().unwrap(), truth);
        println!(
            "{id}: {gestures} gestures, calibrated in {seconds:.1} s, {drawn} strokes, off {own:.3?}; by hand {by_hand} strokes, off {hand:.3?}"
        );
        // Smaller errors are negligible: log focal length, pitch and roll in degrees.
        let limits = [0.005, 0.1, 0.15];
        assert!((0..3).all(|i| own[i] <= hand[i].max(limits[i])), "{id}: {own:?}, by hand {hand:?}");
        assert!(gestures <= 3, "{id}");
        assert_eq!(session.history.depth() - before, gestures, "each gesture is a step that can be undone");
        as_good += 1;
    }
    assert!(as_good >= 5, "{as_good} of five flat cameras are as good as by hand");
}

/// Opens a window with an automatic calibration that waits for a decision. Its groups are the vertical and the
/// parallel annotations of the first camera of the demonstration.
fn proposed() -> Desk {
    let mut camera = SiteCamera::new("a", [1920, 1080]);
    camera.image = None;
    let mut desk = Desk::new(Site { cameras: vec![camera], ..Site::new() });
    let demonstration = calib_demo::demo_site().site.cameras.swap_remove(0);
    let drawn = demonstration.annotations.into_iter();
    let group = |annotation: Annotation| {
        let probabilities = vec![0.9; annotation.polylines().count()];
        let lies = vec![EdgeClass::Undetermined; probabilities.len()];
        calib_image::Group { annotation, probabilities, classes: lies }
    };
    let groups =
        drawn.filter(|drawn| matches!(drawn.kind, Kind::Vertical | Kind::Parallel)).map(group).collect();
    let nothing = AutomaticCalibration::new(&EdgeImage::new(Vec::new(), [1920, 1080]));
    let proposal =
        AutomaticCalibration { confidence: Confidence::Check, reasons: Vec::new(), groups, ..nothing };
    desk.app().act(Action::Automatic(AutomaticResult::Calibration(
        Period { camera: "a".into(), from: None },
        Box::new(proposal),
    )));
    desk.harness.run_steps(3);
    desk
}

fn left(desk: &Desk) -> usize {
    desk.harness.state().editor.session().proposed().map_or(0, |own| own.groups.len())
}

#[test]
fn every_group_has_a_row_with_working_buttons() {
    let mut desk = proposed();
    let groups = left(&desk);
    assert!(groups >= 2, "{:?}", desk.app().editor.session().proposed());
    assert!(desk.harness.query_by_label_contains("Check this result").is_some());
    assert_eq!(desk.harness.query_all_by_label("matters most").count(), 1);
    desk.harness.get_by_label("To floor lines: verticals").click();
    desk.harness.run_steps(3);
    assert!(desk.harness.query_by_label("Accept: verticals").is_none(), "they are floor lines now");
    desk.undo();
    desk.harness.get_by_label("Accept: verticals").click();
    desk.harness.run_steps(3);
    assert_eq!((left(&desk), strokes(&desk.site().cameras[0]) > 0), (groups - 1, true));
    desk.undo();
    desk.harness.get_by_label("Delete: verticals").click();
    desk.harness.run_steps(3);
    assert_eq!((left(&desk), strokes(&desk.site().cameras[0])), (groups - 1, 0));
    desk.harness.get_by_label_contains("Accept all").click();
    desk.harness.run_steps(3);
    assert!(left(&desk) == 0 && strokes(&desk.site().cameras[0]) > 0);
}

#[test]
fn escape_dismisses_and_undo_restores_and_click_selects_a_line() {
    let mut desk = proposed();
    let groups = left(&desk);
    desk.key(Key::Escape);
    assert_eq!(left(&desk), 0);
    desk.undo();
    assert_eq!(left(&desk), groups);
    let line = desk.app().editor.session().proposed().unwrap().groups[1].lines[0].clone();
    let at = [0.5 * (line[0].u + line[1].u), 0.5 * (line[0].v + line[1].v)];
    desk.click(Pane::Image(0), at);
    assert_eq!(desk.app().editor.session().picked_line().map(|(group, _)| group), Some(1));
    let count = desk.app().editor.session().proposed().unwrap().count();
    desk.key(Key::Delete);
    assert_eq!(desk.app().editor.session().proposed().unwrap().count(), count - 1, "it is left out");
    desk.key(Key::Num2);
    desk.key(Key::Escape);
    assert_eq!(left(&desk), groups, "in another view Escape means something else");
}

#[test]
fn camera_without_an_image_is_reported_and_work_can_be_cancelled() {
    let mut desk = proposed();
    desk.key(Key::Escape);
    desk.keys(Modifiers::SHIFT, Key::P);
    let note = desk.app().editor.session().note.clone().unwrap();
    assert!(note.contains("no image"), "{note}");
    let (site, images) = blank();
    let mut desk = Desk::with(site, images);
    desk.keys(Modifiers::SHIFT, Key::P);
    assert!(desk.app().is_working());
    desk.tell(calib_app::command::Command::StopWork);
    desk.wait(|app| !app.is_working());
    assert!(desk.app().editor.session().proposed().is_none());
}

/// Returns quantities that no similarity of the site changes: log ratios of the distances between three cameras, and
/// the bearing of each camera in the frame of every other, in radians. `at` contains x, y and yaw of each camera.
fn shape(at: [[f64; 3]; 3]) -> Vec<f64> {
    let to = |a: usize, b: usize| [at[b][0] - at[a][0], at[b][1] - at[a][1]];
    let length = |a: usize, b: usize| to(a, b)[0].hypot(to(a, b)[1]);
    let bearing = |(a, b): (usize, usize)| to(a, b)[1].atan2(to(a, b)[0]) - at[a][2];
    let pairs = [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)];
    let mut all = vec![(length(0, 1) / length(1, 2)).ln(), (length(0, 2) / length(1, 2)).ln()];
    all.extend(pairs.map(bearing));
    all
}

#[test]
fn one_key_calibrates_and_places_all_cameras() {
    let demonstration = calib_demo::demo_site();
    let (mut site, images) = blank();
    site.cameras.retain(|camera| camera.id.starts_with("shop") || camera.id == "barn");
    let before = site.clone();
    let mut desk = Desk::with(site, images);
    desk.keys(Modifiers::SHIFT, Key::A);
    assert!(desk.app().is_working());
    desk.wait(|app| !app.is_working());
    desk.harness.run_steps(3);
    let words = desk.words().join("\n");
    assert!(
        words.contains("placed by matching colours and using the plan: 3 of 4 cameras")
            && words.contains("not placed"),
        "{words}"
    );
    desk.app().act(Action::SelectCamera(0));
    desk.harness.run_steps(2);
    assert!(desk.words().join("\n").contains("placed automatically; check it"));
    let pose = |id: &str, found: &Desk| {
        let session = found.harness.state().editor.session();
        let index = session.site.cameras.iter().position(|camera| camera.id == id).unwrap();
        assert!(session.site.cameras[index].placement.as_ref().unwrap().estimated);
        let pose = session.solved.pose(index).unwrap();
        [pose.position.x, pose.position.y, pose.yaw]
    };
    let ids = ["shop-1", "shop-2", "shop-3"];
    let found = shape(ids.map(|id| pose(id, &desk)));
    let truth = |id: &str| demonstration.truth.iter().find(|(own, _)| own == id).unwrap().1;
    let truth = shape(ids.map(truth).map(|camera| [camera.position.x, camera.position.y, camera.yaw]));
    for (found, truth) in found.iter().zip(&truth) {
        let difference = (found - truth).sin().abs();
        assert!(difference < 0.06, "{found} instead of {truth}");
    }
    assert!(desk.site().cameras[3].placement.is_none(), "the barn is another building");
    // The placements are one step, the calibrations another.
    desk.undo();
    assert!(desk.site().cameras.iter().all(|camera| camera.placement.is_none()));
    assert!(desk.site().cameras.iter().all(|camera| !camera.annotations.is_empty()));
    desk.undo();
    assert!(desk.site().cameras == before.cameras);
    desk.harness.get_by_label("Close").click();
    desk.harness.run_steps(2);
    assert!(!desk.words().join("\n").contains("3 of 4 cameras"));
}

#[test]
fn calibration_of_all_cameras_ends_when_another_site_is_opened() {
    let (site, images) = blank();
    let mut desk = Desk::with(site.clone(), images);
    desk.keys(Modifiers::SHIFT, Key::A);
    while !desk.words().join("\n").contains("calibrating image 2 of 6") {
        desk.harness.run_steps(1);
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    desk.app().open_site(site.clone(), Images::default(), None);
    desk.harness.run_steps(3);
    assert!(desk.site().cameras == site.cameras);
    assert!(!desk.words().join("\n").contains("calibrating image"));
}

#[test]
fn calibration_of_all_cameras_can_be_cancelled_and_keeps_finished_ones() {
    let (site, images) = blank();
    let mut desk = Desk::with(site, images);
    desk.keys(Modifiers::SHIFT, Key::A);
    while !desk.words().join("\n").contains("calibrating image 2 of 6") {
        desk.harness.run_steps(1);
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    desk.tell(calib_app::command::Command::StopWork);
    desk.wait(|app| !app.is_working());
    desk.harness.run_steps(2);
    let note = desk.app().editor.session().note.clone().unwrap();
    assert!(note.contains("1 image was calibrated"), "{note}");
    let session = desk.harness.state().editor.session();
    let done = |camera: &&SiteCamera| !camera.annotations.is_empty();
    assert!(session.site.cameras.iter().filter(done).count() <= 1);
    assert!(session.site.cameras.iter().all(|camera| camera.placement.is_none()));
}

#[test]
fn automatic_calibration_survives_serialisation_to_a_worker() {
    let drawn = calib_demo::demo_site().site.cameras.swap_remove(0);
    let lines = drawn.annotations.iter().flat_map(|drawn| drawn.polylines().collect::<Vec<_>>());
    let segment = |line: Vec<calib_core::Pixel>| LineSegment::new([line[0], line[line.len() - 1]], 0.5);
    let edges: Vec<LineSegment> = lines.map(segment).collect();
    let measured = ImageEdges { segments: edges.clone(), bars: Bars::NONE };
    let sent = serde_json::to_vec(&(&drawn, &measured)).unwrap();
    let (camera, received): (SiteCamera, ImageEdges) = serde_json::from_slice(&sent).unwrap();
    assert!(camera == drawn && received == measured);
    let few = edges.iter().take(3).copied().collect();
    for edges in [edges, few, Vec::new()] {
        let proposal = AutomaticCalibration::new(&EdgeImage::new(edges, drawn.size_px));
        let text = serde_json::to_vec(&proposal).unwrap();
        assert_eq!(serde_json::from_slice::<AutomaticCalibration>(&text).unwrap(), proposal);
    }
}
