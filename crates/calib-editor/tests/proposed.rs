//! Automatic calibrations are decided group by group; every decision is an undo step.

#![allow(clippy::unwrap_used, reason = "a failed step fails the test")]

use calib_core::{Kind, Orientation, Pixel};

use calib_editor::{
    Action, AutomaticResult, CalibrationDecision, Editor, Images, NewImage, Opened, Pane, Period, Phase,
    Pointer, command,
};
use calib_image::{Alternative, AutomaticCalibration, Confidence, EdgeClass, EdgeImage, Group, Reason};
use calib_site::{LensEntry, PrincipalPointEntry, Site, SiteCamera};

/// Returns a site with two cameras of the demonstration; the first one has no annotations.
fn blank() -> Site {
    let mut site = calib_demo::demo_site().site;
    site.cameras.truncate(2);
    (site.links, site.marks, site.distances) = Default::default();
    let camera = &mut site.cameras[0];
    camera.annotations.clear();
    camera.control_points.clear();
    (camera.placement, camera.lens) = (None, None);
    site
}

fn opened(site: Site) -> Editor {
    let mut editor = Editor::default();
    let images = Images::default();
    editor.apply(Action::Open(Box::new(Opened { site, images, path: None, is_unsaved: false })));
    editor
}

/// Returns the automatic calibration of an ideal detector for the first camera: its verticals and floor
/// lines, with floor directions at right angles.
fn proposal() -> AutomaticCalibration {
    let drawn = calib_demo::demo_site().site.cameras.swap_remove(0);
    let lines = |kind: Kind| -> Vec<Vec<Pixel>> {
        let of_kind = drawn.annotations.iter().filter(|drawn| drawn.kind == kind);
        of_kind
            .flat_map(calib_core::Annotation::polylines)
            .map(|line| vec![line[0], line[line.len() - 1]])
            .collect()
    };
    let parallels: Vec<calib_core::Annotation> =
        drawn.annotations.iter().filter(|drawn| drawn.kind == Kind::Parallel).cloned().collect();
    let group = |annotation: calib_core::Annotation| {
        let count = annotation.polylines().count();
        Group { annotation, probabilities: vec![0.9; count], classes: vec![EdgeClass::Undetermined; count] }
    };
    let mut groups =
        vec![group(calib_core::Annotation::from_segments(Kind::Vertical, lines(Kind::Vertical)))];
    for (index, annotation) in parallels.into_iter().enumerate() {
        let id = Some(format!("floor {}", index + 1));
        let tie = (index == 1).then(|| "floor 1".to_owned());
        groups.push(group(calib_core::Annotation { id, at_right_angles_to: tie, name: None, ..annotation }));
    }
    let nothing = AutomaticCalibration::new(&EdgeImage::new(Vec::new(), [1920, 1080]));
    let camera = Some(SiteCamera::new("still", [1920, 1080]));
    AutomaticCalibration { confidence: Confidence::Check, reasons: Vec::new(), groups, camera, ..nothing }
}

fn proposed() -> Editor {
    let mut editor = opened(blank());
    let camera = editor.site().cameras[0].id.clone();
    editor.apply(Action::Automatic(AutomaticResult::Calibration(
        Period { camera, from: None },
        Box::new(proposal()),
    )));
    editor
}

fn kinds(editor: &Editor) -> Vec<Kind> {
    editor
        .session()
        .proposed()
        .map(|own| own.groups.iter().map(|group| group.kind).collect())
        .unwrap_or_default()
}

fn do_it(editor: &mut Editor, action: CalibrationDecision) {
    editor.apply(Action::DecideCalibration(action));
}

fn undo(editor: &mut Editor) {
    editor.apply(Action::Gesture(command::Gesture::Undo));
}

fn redo(editor: &mut Editor) {
    editor.apply(Action::Gesture(command::Gesture::Redo));
}

#[test]
fn accepted_lines_keep_their_standard_deviation_and_principal_point() {
    let mut editor = opened(blank());
    let of = Period { camera: editor.site().cameras[0].id.clone(), from: None };
    let mut own = proposal();
    own.groups.iter_mut().for_each(|group| group.annotation.sigma_px = Some(2.5));
    let assumed = PrincipalPointEntry { value: Pixel::new(900.0, 540.0), sigma: Some(20.0) };
    own.camera.as_mut().unwrap().lens =
        Some(LensEntry { principal_point_px: Some(assumed), ..LensEntry::default() });
    editor.apply(Action::Automatic(AutomaticResult::Calibration(of, Box::new(own))));
    do_it(&mut editor, CalibrationDecision::AcceptAll);
    let entry = &editor.site().cameras[0];
    assert!(!entry.annotations.is_empty());
    assert!(entry.annotations.iter().all(|drawn| drawn.sigma_px == Some(2.5)), "{:?}", entry.annotations);
    assert_eq!(entry.lens.as_ref().unwrap().principal_point_px, Some(assumed));
    undo(&mut editor);
    assert!(editor.site().cameras[0].annotations.is_empty());
}

#[test]
fn operator_chooses_between_two_equally_good_cameras() {
    for other in [false, true] {
        let mut editor = opened(blank());
        let of = Period { camera: editor.site().cameras[0].id.clone(), from: None };
        let own = proposal();
        let rival = Alternative {
            orientation: Orientation { roll: 0.0, pitch: 1.0, focal: 8000.0 },
            groups: own.groups[..2].to_vec(),
        };
        let reasons = vec![Reason::TwoHypotheses { focals: [1200.0, 8000.0] }];
        let groups = [own.groups.len(), rival.groups.len()];
        let own =
            AutomaticCalibration { confidence: Confidence::None, reasons, alternative: Some(rival), ..own };
        editor.apply(Action::Automatic(AutomaticResult::Calibration(of, Box::new(own))));
        do_it(&mut editor, CalibrationDecision::AcceptAll);
        let note = editor.session().note.clone().unwrap();
        assert!(note.contains("Choose one") && editor.site().cameras[0].annotations.is_empty(), "{note}");
        do_it(&mut editor, CalibrationDecision::Decide { other });
        let decided = editor.session().proposed().unwrap();
        assert_eq!((decided.confidence, decided.reasons.len()), (Confidence::Check, 0));
        assert_eq!(decided.groups.len(), groups[usize::from(other)]);
        assert!(decided.alternative.is_none());
        undo(&mut editor);
        assert!(editor.session().proposed().unwrap().alternative.is_some(), "undecided again");
        redo(&mut editor);
        do_it(&mut editor, CalibrationDecision::AcceptAll);
        assert!(!editor.site().cameras[0].annotations.is_empty());
    }
}

#[test]
fn automatic_calibration_does_not_change_the_site_until_accepted() {
    let editor = proposed();
    assert!(kinds(&editor).len() >= 2, "{:?}", editor.session().proposed());
    assert_eq!(*editor.site(), *opened(blank()).site());
    assert!(editor.session().is_saved(), "there are no changes to save");
    assert!(editor.session().solution().is_none());
}

#[test]
fn accepting_all_groups_is_one_undo_step() {
    let mut editor = proposed();
    let (before, count) = (kinds(&editor), editor.session().proposed().unwrap().count());
    do_it(&mut editor, CalibrationDecision::AcceptAll);
    let drawn =
        editor.site().cameras[0].annotations.iter().flat_map(calib_core::Annotation::polylines).count();
    assert_eq!(drawn, count);
    assert!(editor.session().proposed().is_none() && editor.session().solution().is_some());
    undo(&mut editor);
    assert!(editor.site().cameras[0].annotations.is_empty());
    assert_eq!(kinds(&editor), before, "undecided again");
    redo(&mut editor);
    assert!(editor.session().proposed().is_none() && !editor.site().cameras[0].annotations.is_empty());
    undo(&mut editor);
    undo(&mut editor);
    assert!(editor.session().proposed().is_none(), "before the automatic calibration");
    redo(&mut editor);
    assert_eq!(kinds(&editor), before);
}

#[test]
fn each_decision_about_a_group_is_an_undo_step() {
    let mut editor = proposed();
    let states = |editor: &Editor| (editor.site().clone(), editor.session().proposed().cloned());
    let mut seen = vec![states(&editor)];
    for action in [
        CalibrationDecision::RejectLine(0, 0),
        CalibrationDecision::Flip(0),
        CalibrationDecision::Flip(0),
        CalibrationDecision::Accept(0),
        CalibrationDecision::Delete(0),
    ] {
        do_it(&mut editor, action);
        seen.push(states(&editor));
    }
    assert!(seen.windows(2).all(|pair| pair[0] != pair[1]), "each decision changes something");
    for state in seen.iter().rev().skip(1) {
        undo(&mut editor);
        assert!(states(&editor) == *state);
    }
    for state in &seen[1..] {
        redo(&mut editor);
        assert!(states(&editor) == *state);
    }
}

#[test]
fn flipped_verticals_are_a_new_floor_direction() {
    let mut editor = proposed();
    let verticals = kinds(&editor).iter().position(|kind| *kind == Kind::Vertical).unwrap();
    do_it(&mut editor, CalibrationDecision::Flip(verticals));
    let own = editor.session().proposed().unwrap().groups[verticals].clone();
    assert_eq!(own.kind, Kind::Parallel);
    let others = &editor.session().proposed().unwrap().groups;
    assert_eq!(others.iter().filter(|group| group.direction == own.direction).count(), 1);
    do_it(&mut editor, CalibrationDecision::Accept(verticals));
    let drawn = editor.site().cameras[0].annotations.last().unwrap();
    assert_eq!((drawn.kind, drawn.id.as_ref()), (Kind::Parallel, Some(&own.direction)));
}

#[test]
fn groups_of_one_direction_are_merged_and_right_angles_linked_in_any_order() {
    let mut editor = proposed();
    let level: Vec<usize> =
        (0..kinds(&editor).len()).filter(|&group| kinds(&editor)[group] == Kind::Parallel).collect();
    let [.., first, second] = level[..] else {
        panic!("two floor directions are expected: {:?}", kinds(&editor))
    };
    let tied =
        editor.clone_site_after(&[CalibrationDecision::Accept(second), CalibrationDecision::Accept(first)]);
    assert_eq!(
        tied.cameras[0].annotations.iter().filter(|drawn| drawn.at_right_angles_to.is_some()).count(),
        1
    );
    let direction = editor.session().proposed().unwrap().groups[first].direction.clone();
    let joined = editor.clone_site_after(&[
        CalibrationDecision::SetDirection(second, direction),
        CalibrationDecision::AcceptAll,
    ]);
    let parallels = joined.cameras[0].annotations.iter().filter(|drawn| drawn.kind == Kind::Parallel).count();
    assert_eq!(parallels, level.len() - 1);
}

trait After {
    fn clone_site_after(&mut self, actions: &[CalibrationDecision]) -> Site;
}

impl After for Editor {
    /// Returns the site after some decisions, and undoes them.
    fn clone_site_after(&mut self, actions: &[CalibrationDecision]) -> Site {
        for action in actions {
            do_it(self, action.clone());
        }
        let site = self.site().clone();
        actions.iter().for_each(|_| undo(self));
        site
    }
}

#[test]
fn annotated_lines_are_not_detected_again() {
    let mut editor = proposed();
    let count = editor.session().proposed().unwrap().count();
    do_it(&mut editor, CalibrationDecision::Accept(0));
    let camera = editor.site().cameras[0].id.clone();
    editor.apply(Action::Automatic(AutomaticResult::Calibration(
        Period { camera, from: None },
        Box::new(proposal()),
    )));
    let drawn =
        editor.site().cameras[0].annotations.iter().flat_map(calib_core::Annotation::polylines).count();
    assert!(drawn > 0);
    assert_eq!(editor.session().proposed().unwrap().count(), count - drawn);
}

#[test]
fn automatic_calibration_is_removed_with_its_camera_or_image() {
    let mut editor = proposed();
    editor.apply(Action::Rename("renamed".into()));
    assert!(editor.session().proposed().is_some(), "the camera was only renamed");
    editor.apply(Action::SelectCamera(1));
    assert!(editor.session().proposed().is_none(), "another camera is selected");
    editor.apply(Action::SelectCamera(0));
    let still = NewImage {
        image: "other.png".into(),
        title: "other".into(),
        size: [1920, 1080],
        image_circle: None,
        pixel_aspect: None,
    };
    editor.apply(Action::ReplaceImage(Period { camera: "renamed".into(), from: None }, still));
    assert!(editor.session().proposed().is_none(), "the image was replaced");
    undo(&mut editor);
    assert!(editor.session().proposed().is_some(), "with the old image");
}

#[test]
fn uncertain_result_can_only_be_accepted_by_group() {
    let mut editor = opened(blank());
    let camera = editor.site().cameras[0].id.clone();
    let unsure = AutomaticCalibration { confidence: Confidence::None, ..proposal() };
    editor.apply(Action::Automatic(AutomaticResult::Calibration(
        Period { camera, from: None },
        Box::new(unsure),
    )));
    let groups = kinds(&editor).len();
    do_it(&mut editor, CalibrationDecision::AcceptAll);
    assert!(editor.site().cameras[0].annotations.is_empty() && kinds(&editor).len() == groups);
    do_it(&mut editor, CalibrationDecision::Accept(0));
    assert!(!editor.site().cameras[0].annotations.is_empty() && kinds(&editor).len() == groups - 1);
}

#[test]
fn first_group_minimises_the_floor_error_and_the_preview_matches_the_result() {
    let mut editor = proposed();
    let mut known = f64::INFINITY;
    let foreseen = editor.find_preview().unwrap().solution.clone().unwrap();
    while let Some(next) = editor.find_preview().and_then(|preview| preview.next) {
        let rel = |editor: &Editor| editor.session().solution()?.sigma.as_ref()?.floor_length_rel;
        let others: Vec<f64> = (0..kinds(&editor).len())
            .filter_map(|group| {
                do_it(&mut editor, CalibrationDecision::Accept(group));
                let rel = rel(&editor);
                undo(&mut editor);
                rel
            })
            .collect();
        do_it(&mut editor, CalibrationDecision::Accept(next));
        let now = rel(&editor).unwrap();
        assert!(others.iter().all(|other| now <= 1.02 * other), "{now}, others {others:?}");
        assert!(now <= 1.1 * known, "{now} after {known}");
        known = now;
    }
    let focal = editor.session().solution().unwrap().focal_px;
    assert!((focal / foreseen.focal_px - 1.0).abs() < 1e-3, "{focal} was predicted as {}", foreseen.focal_px);
}

#[test]
fn click_selects_a_detected_line_and_delete_rejects_it() {
    let mut editor = proposed();
    let line = editor.session().proposed().unwrap().groups[0].lines[1].clone();
    let at = [0.5 * (line[0].u + line[1].u), 0.5 * (line[0].v + line[1].v)];
    let pointer = |at: [f64; 2], phase| {
        Action::Pointer(Pointer {
            pane: Pane::Image(0),
            at,
            phase,
            modifiers: calib_editor::Modifiers::NONE,
            radius: 8.0,
            point_size: 0.5,
            moved: false,
            double: false,
            edge: None,
            captured: None,
            newer: None,
            image: None,
        })
    };
    editor.apply(pointer(at, Phase::Press));
    editor.apply(pointer(at, Phase::Release));
    assert_eq!(editor.session().picked_line(), Some((0, 1)));
    assert!(editor.is_enabled(calib_editor::Command::Delete, false));
    let before = editor.session().proposed().unwrap().count();
    editor.apply(Action::Selection(command::Selection::Delete, None));
    assert_eq!(editor.session().proposed().unwrap().count(), before - 1);
    assert!(!editor.session().proposed().unwrap().groups[0].lines.contains(&line));
    assert!(editor.session().picked_line().is_none());
}
