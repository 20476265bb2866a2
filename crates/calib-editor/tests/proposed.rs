//! What a still proposes is decided group by group, every decision a step that can be taken back.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use calib_core::{Kind, Orientation, Pixel};

use calib_editor::{
    Action, Editor, Images, NewStill, OnProposed, Opened, Pane, Period, Phase, Pointer, command,
};
use calib_image::{Alternative, Group, Lies, Proposal, Reason, Still, Verdict};
use calib_site::{Site, SiteCamera};

/// The first camera of the demonstration with nothing drawn, beside another.
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

/// What an ideal detector would propose for the first camera: its verticals and floor lines, as the demonstration has
/// them, floor directions at right angles.
fn proposal() -> Proposal {
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
        Group { annotation, probabilities: vec![0.9; count], lies: vec![Lies::Open; count] }
    };
    let mut groups = vec![group(calib_core::Annotation::of_segments(Kind::Vertical, lines(Kind::Vertical)))];
    for (index, annotation) in parallels.into_iter().enumerate() {
        let id = Some(format!("floor {}", index + 1));
        let tie = (index == 1).then(|| "floor 1".to_owned());
        groups.push(group(calib_core::Annotation { id, at_right_angles_to: tie, name: None, ..annotation }));
    }
    let nothing = Proposal::new(&Still::new(Vec::new(), [1920, 1080]));
    let camera = Some(SiteCamera::new("still", [1920, 1080]));
    Proposal { verdict: Verdict::Check, reasons: Vec::new(), groups, camera, ..nothing }
}

fn proposed() -> Editor {
    let mut editor = opened(blank());
    let camera = editor.site().cameras[0].id.clone();
    editor.apply(Action::Propose(Period { camera, from: None }, Box::new(proposal())));
    editor
}

fn kinds(editor: &Editor) -> Vec<Kind> {
    editor
        .session()
        .proposed()
        .map(|own| own.groups.iter().map(|group| group.kind).collect())
        .unwrap_or_default()
}

fn do_it(editor: &mut Editor, action: OnProposed) {
    editor.apply(Action::OnProposed(action));
}

fn undo(editor: &mut Editor) {
    editor.apply(Action::Gesture(command::Gesture::Undo));
}

fn redo(editor: &mut Editor) {
    editor.apply(Action::Gesture(command::Gesture::Redo));
}

#[test]
fn of_two_cameras_that_explain_the_edges_alike_the_operator_says_which_it_is() {
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
        let own = Proposal { verdict: Verdict::None, reasons, alternative: Some(rival), ..own };
        editor.apply(Action::Propose(of, Box::new(own)));
        do_it(&mut editor, OnProposed::AcceptAll);
        let note = editor.session().note.clone().unwrap();
        assert!(
            note.contains("say which it is") && editor.site().cameras[0].annotations.is_empty(),
            "{note}"
        );
        do_it(&mut editor, OnProposed::Decide { other });
        let decided = editor.session().proposed().unwrap();
        assert_eq!((decided.verdict, decided.reasons.len()), (Verdict::Check, 0));
        assert_eq!(decided.groups.len(), groups[usize::from(other)]);
        assert!(decided.alternative.is_none());
        undo(&mut editor);
        assert!(editor.session().proposed().unwrap().alternative.is_some(), "it is open again");
        redo(&mut editor);
        do_it(&mut editor, OnProposed::AcceptAll);
        assert!(!editor.site().cameras[0].annotations.is_empty());
    }
}

#[test]
fn nothing_of_a_proposal_is_in_the_site_until_it_is_accepted() {
    let editor = proposed();
    assert!(kinds(&editor).len() >= 2, "{:?}", editor.session().proposed());
    assert_eq!(*editor.site(), *opened(blank()).site());
    assert!(editor.session().is_saved(), "nothing is there to be saved");
    assert!(editor.session().solution().is_none());
}

#[test]
fn all_of_it_is_one_step_that_undo_takes_back_and_redo_does_again() {
    let mut editor = proposed();
    let (before, count) = (kinds(&editor), editor.session().proposed().unwrap().count());
    do_it(&mut editor, OnProposed::AcceptAll);
    let drawn =
        editor.site().cameras[0].annotations.iter().flat_map(calib_core::Annotation::polylines).count();
    assert_eq!(drawn, count);
    assert!(editor.session().proposed().is_none() && editor.session().solution().is_some());
    undo(&mut editor);
    assert!(editor.site().cameras[0].annotations.is_empty());
    assert_eq!(kinds(&editor), before, "it is proposed again");
    redo(&mut editor);
    assert!(editor.session().proposed().is_none() && !editor.site().cameras[0].annotations.is_empty());
    undo(&mut editor);
    undo(&mut editor);
    assert!(editor.session().proposed().is_none(), "before it was proposed");
    redo(&mut editor);
    assert_eq!(kinds(&editor), before);
}

#[test]
fn groups_are_decided_one_by_one_and_each_decision_is_a_step() {
    let mut editor = proposed();
    let states = |editor: &Editor| (editor.site().clone(), editor.session().proposed().cloned());
    let mut seen = vec![states(&editor)];
    for action in [
        OnProposed::LeaveOut(0, 0),
        OnProposed::Flip(0),
        OnProposed::Flip(0),
        OnProposed::Accept(0),
        OnProposed::Delete(0),
    ] {
        do_it(&mut editor, action);
        seen.push(states(&editor));
    }
    assert!(seen.windows(2).all(|pair| pair[0] != pair[1]), "each does something");
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
fn flipped_verticals_are_a_floor_direction_of_their_own() {
    let mut editor = proposed();
    let verticals = kinds(&editor).iter().position(|kind| *kind == Kind::Vertical).unwrap();
    do_it(&mut editor, OnProposed::Flip(verticals));
    let own = editor.session().proposed().unwrap().groups[verticals].clone();
    assert_eq!(own.kind, Kind::Parallel);
    let others = &editor.session().proposed().unwrap().groups;
    assert_eq!(others.iter().filter(|group| group.direction == own.direction).count(), 1);
    do_it(&mut editor, OnProposed::Accept(verticals));
    let drawn = editor.site().cameras[0].annotations.last().unwrap();
    assert_eq!((drawn.kind, drawn.id.as_ref()), (Kind::Parallel, Some(&own.direction)));
}

#[test]
fn groups_of_one_direction_become_one_annotation_and_right_angles_are_tied_in_any_order() {
    let mut editor = proposed();
    let level: Vec<usize> =
        (0..kinds(&editor).len()).filter(|&group| kinds(&editor)[group] == Kind::Parallel).collect();
    let [.., first, second] = level[..] else {
        panic!("two floor directions are proposed: {:?}", kinds(&editor))
    };
    let tied = editor.clone_site_after(&[OnProposed::Accept(second), OnProposed::Accept(first)]);
    assert_eq!(
        tied.cameras[0].annotations.iter().filter(|drawn| drawn.at_right_angles_to.is_some()).count(),
        1
    );
    let direction = editor.session().proposed().unwrap().groups[first].direction.clone();
    let joined = editor.clone_site_after(&[OnProposed::Turn(second, direction), OnProposed::AcceptAll]);
    let parallels = joined.cameras[0].annotations.iter().filter(|drawn| drawn.kind == Kind::Parallel).count();
    assert_eq!(parallels, level.len() - 1);
}

trait After {
    fn clone_site_after(&mut self, actions: &[OnProposed]) -> Site;
}

impl After for Editor {
    /// The site after some decisions, which are then taken back.
    fn clone_site_after(&mut self, actions: &[OnProposed]) -> Site {
        for action in actions {
            do_it(self, action.clone());
        }
        let site = self.site().clone();
        actions.iter().for_each(|_| undo(self));
        site
    }
}

#[test]
fn what_is_drawn_already_is_not_proposed() {
    let mut editor = proposed();
    let count = editor.session().proposed().unwrap().count();
    do_it(&mut editor, OnProposed::Accept(0));
    let camera = editor.site().cameras[0].id.clone();
    editor.apply(Action::Propose(Period { camera, from: None }, Box::new(proposal())));
    let drawn =
        editor.site().cameras[0].annotations.iter().flat_map(calib_core::Annotation::polylines).count();
    assert!(drawn > 0);
    assert_eq!(editor.session().proposed().unwrap().count(), count - drawn);
}

#[test]
fn a_proposal_goes_with_its_camera_and_its_still() {
    let mut editor = proposed();
    editor.apply(Action::Rename("renamed".into()));
    assert!(editor.session().proposed().is_some(), "another id, the same camera");
    editor.apply(Action::Choose(1));
    assert!(editor.session().proposed().is_none(), "it is the other camera's");
    editor.apply(Action::Choose(0));
    let still =
        NewStill { image: "other.png".into(), title: "other".into(), size: [1920, 1080], image_circle: None };
    editor.apply(Action::ReplaceStill(Period { camera: "renamed".into(), from: None }, still));
    assert!(editor.session().proposed().is_none(), "another still proposes something else");
    undo(&mut editor);
    assert!(editor.session().proposed().is_some(), "with the old still");
}

#[test]
fn what_is_not_believed_is_accepted_by_groups_alone() {
    let mut editor = opened(blank());
    let camera = editor.site().cameras[0].id.clone();
    let unsure = Proposal { verdict: Verdict::None, ..proposal() };
    editor.apply(Action::Propose(Period { camera, from: None }, Box::new(unsure)));
    let groups = kinds(&editor).len();
    do_it(&mut editor, OnProposed::AcceptAll);
    assert!(editor.site().cameras[0].annotations.is_empty() && kinds(&editor).len() == groups);
    do_it(&mut editor, OnProposed::Accept(0));
    assert!(!editor.site().cameras[0].annotations.is_empty() && kinds(&editor).len() == groups - 1);
}

#[test]
fn the_group_that_tells_most_is_asked_about_and_the_preview_is_what_accepting_gives() {
    let mut editor = proposed();
    let mut known = f64::INFINITY;
    let foreseen = editor.find_preview().unwrap().solution.clone().unwrap();
    while let Some(next) = editor.find_preview().and_then(|preview| preview.next) {
        let rel = |editor: &Editor| editor.session().solution()?.sigma.as_ref()?.floor_length_rel;
        let others: Vec<f64> = (0..kinds(&editor).len())
            .filter_map(|group| {
                do_it(&mut editor, OnProposed::Accept(group));
                let rel = rel(&editor);
                undo(&mut editor);
                rel
            })
            .collect();
        do_it(&mut editor, OnProposed::Accept(next));
        let now = rel(&editor).unwrap();
        assert!(others.iter().all(|other| now <= 1.02 * other), "{now} beside {others:?}");
        assert!(now <= 1.1 * known, "{now} after {known}");
        known = now;
    }
    let focal = editor.session().solution().unwrap().focal_px;
    assert!((focal / foreseen.focal_px - 1.0).abs() < 1e-3, "{focal} was foreseen as {}", foreseen.focal_px);
}

#[test]
fn a_click_on_a_line_chooses_it_and_delete_leaves_it_out() {
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
            grain: 0.5,
            moved: false,
            double: false,
            offer: None,
            still: None,
        })
    };
    editor.apply(pointer(at, Phase::Press));
    editor.apply(pointer(at, Phase::Release));
    assert_eq!(editor.session().picked(), Some((0, 1)));
    assert!(editor.is_enabled(calib_editor::Command::Delete, false));
    let before = editor.session().proposed().unwrap().count();
    editor.apply(Action::Selection(command::Selection::Delete, None));
    assert_eq!(editor.session().proposed().unwrap().count(), before - 1);
    assert!(!editor.session().proposed().unwrap().groups[0].lines.contains(&line));
    assert!(editor.session().picked().is_none());
}
