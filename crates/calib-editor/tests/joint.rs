//! Tests of the results of the joint solve: they are kept until an input changes, then recomputed or marked as out
//! of date.
#![allow(clippy::unwrap_used, reason = "a failed step fails the test")]

use calib_core::Pixel;

use calib_editor::command::{Cameras, Gesture};
use calib_editor::{Action, Editor, Images, NewImage, Opened, parse, refined};
use calib_site::{Mark, Site, Stage};

/// Expected stage of each camera of the demonstration after the joint solve. The fourth camera stays `Placed`,
/// because it has no landmark in common with the others.
const TOGETHER: [Stage; 6] =
    [Stage::Refined, Stage::Refined, Stage::Refined, Stage::Placed, Stage::Refined, Stage::Refined];

/// Returns an editor with the demonstration site after a joint solve.
fn together() -> Editor {
    let mut editor = Editor::default();
    open(&mut editor, calib_demo::demo_site().site);
    let before = editor.site().clone();
    editor.apply(Action::Refined(Box::new((before.clone(), refined(before)))));
    assert!(editor.session().solved.is_joint_current());
    assert_eq!(stages(&editor), TOGETHER);
    editor
}

fn open(editor: &mut Editor, site: Site) {
    let opened = Opened { site, images: Images::default(), path: None, is_unsaved: false };
    editor.apply(Action::Open(Box::new(opened)));
}

fn stages(editor: &Editor) -> Vec<Stage> {
    let session = editor.session();
    (0..6).filter_map(|camera| Some(session.solved.solution(camera)?.stage)).collect()
}

fn change(editor: &mut Editor, change: impl FnOnce(&mut Site)) {
    let mut site = editor.site().clone();
    change(&mut site);
    editor.apply(Action::Change { site: Box::new(site), name: "change".into() });
}

fn nudged(pixel: &mut Pixel) {
    pixel.u += 3.0;
}

fn move_a_line(site: &mut Site) {
    nudged(&mut site.cameras[0].annotations[0].segments.as_mut().unwrap()[0][0]);
}

#[test]
fn unrelated_changes_keep_the_joint_result_current() {
    let mut editor = together();
    let poses =
        |editor: &Editor| (0..5).map(|i| *editor.session().solved.pose(i).unwrap()).collect::<Vec<_>>();
    let before = poses(&editor);
    let still = NewImage {
        image: "yard.png".into(),
        title: "yard".into(),
        size: [640, 480],
        image_circle: None,
        pixel_aspect: None,
    };
    editor.apply(Action::AddCamera { image: still, joins_last: false });
    let free = Mark { id: Some("free".into()), seen: Vec::new(), ..editor.site().marks[0].clone() };
    change(&mut editor, |site| site.marks.push(free));
    change(&mut editor, |site| site.marks.last_mut().unwrap().at_m.x += 1.0);
    change(&mut editor, |site| site.cameras.swap(0, 4));
    change(&mut editor, |site| site.cameras.swap(0, 4));
    change(&mut editor, |site| site.name = Some("Shop".into()));
    assert!(editor.session().solved.is_joint_current());
    assert_eq!(stages(&editor), TOGETHER);
    assert_eq!(poses(&editor), before);
}

#[test]
fn joint_result_survives_a_reload_of_the_autosave() {
    let editor = together();
    let (site, _) = parse(&editor.session().site_with_joint_results().to_json(), None).unwrap();
    let mut again = Editor::default();
    open(&mut again, site);
    assert_eq!(stages(&again), TOGETHER);
    assert!(again.session().solved.is_joint_current());
    assert_eq!(again.session().solved.pose(1), editor.session().solved.pose(1));
}

#[test]
fn changed_line_is_solved_jointly_within_its_gesture() {
    let mut editor = together();
    let before = *editor.session().solved.pose(0).unwrap();
    editor.apply(Action::SetMaxJointSolveMs(f64::INFINITY));
    let depth = editor.session().history.depth();
    change(&mut editor, move_a_line);
    assert!(editor.session().solved.is_joint_current());
    assert_eq!(stages(&editor), TOGETHER);
    assert_ne!(*editor.session().solved.pose(0).unwrap(), before, "the line changes the pose");
    assert_eq!(editor.session().history.depth(), depth + 1);
    editor.apply(Action::Gesture(Gesture::Undo));
    assert!(editor.session().solved.is_joint_current());
    assert_eq!(*editor.session().solved.pose(0).unwrap(), before, "undo restores the result");
}

#[test]
fn slow_joint_result_is_out_of_date_also_in_files() {
    let mut editor = together();
    editor.apply(Action::SetMaxJointSolveMs(-1.0));
    change(&mut editor, move_a_line);
    let solved = &editor.session().solved;
    assert!(solved.is_joint_out_of_date());
    assert_eq!(solved.solution(0).unwrap().stage, Stage::Placed, "its lines have changed");
    assert_eq!(solved.solution(1).unwrap().stage, Stage::Refined, "its inputs are unchanged");
    let (site, _) = parse(&solved.write_into(editor.site()).to_json(), None).unwrap();
    let mut again = Editor::default();
    open(&mut again, site);
    assert!(again.session().solved.is_joint_out_of_date());
    let now = again.site().clone();
    again.apply(Action::Refined(Box::new((now.clone(), refined(now)))));
    assert!(again.session().solved.is_joint_current());
}

#[test]
fn placement_by_hand_is_not_overwritten() {
    let mut editor = together();
    editor.apply(Action::SetMaxJointSolveMs(f64::INFINITY));
    let camera = editor.site().cameras.iter().position(|camera| camera.control_points.is_empty()).unwrap();
    let mut placement = editor.session().placement(camera).unwrap();
    placement.by.x += 1.0;
    editor.apply(Action::Place { camera, placement, name: "move".into() });
    assert!(editor.session().solved.is_joint_out_of_date());
    let at = editor.session().solved.pose(camera).unwrap().position;
    assert!((at.x - placement.by.x).abs() < 1e-5, "the placement by hand is kept");
}

#[test]
fn joint_result_is_out_of_date_after_removing_a_camera() {
    let mut editor = together();
    editor.apply(Action::SetMaxJointSolveMs(-1.0));
    editor.apply(Action::SelectCamera(2));
    editor.apply(Action::Cameras(Cameras::RemoveCamera));
    assert!(editor.session().solved.is_joint_out_of_date());
}

#[test]
fn undo_of_refining_leaves_no_result_out_of_date() {
    let mut editor = Editor::default();
    let mut site = calib_demo::demo_site().site;
    // Camera 1 has a fixed placement, so its stage must not mark a result as out of date.
    site.cameras[1].placement.as_mut().unwrap().fixed = true;
    open(&mut editor, site);
    let (before, alone) = (editor.site().clone(), stages(&editor));
    let (saved, _) = parse(&editor.session().solved.write_into(&before).to_json(), None).unwrap();
    let mut again = Editor::default();
    open(&mut again, saved);
    assert!(!again.session().solved.is_joint_out_of_date(), "the site was never refined");
    editor.apply(Action::Refined(Box::new((before.clone(), refined(before)))));
    assert!(editor.session().solved.is_joint_current());
    editor.apply(Action::Gesture(Gesture::Undo));
    let solved = &editor.session().solved;
    assert!(!solved.is_joint_out_of_date() && !solved.is_joint_current());
    assert_eq!(stages(&editor), alone);
    editor.apply(Action::Gesture(Gesture::Redo));
    assert!(editor.session().solved.is_joint_current());
    // Undo restores the state of the result: out of date after one step, current after two.
    editor.apply(Action::SetMaxJointSolveMs(-1.0));
    change(&mut editor, move_a_line);
    change(&mut editor, |site| site.name = Some("Shop".into()));
    editor.apply(Action::Gesture(Gesture::Undo));
    assert!(editor.session().solved.is_joint_out_of_date());
    editor.apply(Action::Gesture(Gesture::Undo));
    assert!(editor.session().solved.is_joint_current());
}

/// The scale of a placement that a joint solve wrote is a start value. A measured length that is added later
/// determines the height as if the camera had never been refined.
#[test]
fn placement_of_a_joint_solve_is_no_evidence_of_the_height() {
    let alone = |editor: &Editor| editor.session().solved.pose(1).unwrap().position.z;
    let mut editor = together();
    assert!(editor.site().cameras[1].placement.as_ref().unwrap().estimated);
    let measured = calib_core::single::Known::prior(5.0, 0.2);
    change(&mut editor, |site| {
        site.links.clear();
        site.marks.clear();
        site.distances.clear();
        site.cameras[1].height_m = Some(measured);
    });
    let mut fresh = Editor::default();
    let mut site = editor.site().clone();
    site.cameras[1].placement = None;
    open(&mut fresh, site);
    let [after, expected] = [alone(&editor), alone(&fresh)];
    assert!((after - expected).abs() < 1e-6, "{after} m and {expected} m");
    assert!((expected - 5.0).abs() < 0.5, "the entered height applies: {expected} m");
}

#[test]
fn unit_of_lengths_is_stored_and_undoable_and_changes_no_result() {
    let mut editor = together();
    let before = editor.session().solved.pose(1).copied();
    editor.apply(Action::ToggleUnits);
    assert_eq!(editor.site().units, calib_site::Units::Feet);
    assert!(editor.site().to_json().contains("\"units\": \"feet\""));
    let mut another = Editor::default();
    open(&mut another, editor.site().clone());
    assert_eq!(another.site().units, calib_site::Units::Feet, "opening keeps the unit of the file");
    assert!(editor.session().solved.is_joint_current());
    assert_eq!(editor.session().solved.pose(1).copied(), before);
    editor.apply(Action::Gesture(Gesture::Undo));
    assert_eq!(editor.site().units, calib_site::Units::Metres);
}
