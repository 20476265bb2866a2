//! Camera with two periods: annotations and comparisons of one period do not affect the other.

#![allow(clippy::unwrap_used, reason = "a failed step fails the test")]

use std::path::{Path, PathBuf};

use calib_core::Pixel;

use calib_editor::command::Gesture;
use calib_editor::{
    Action, Editor, Images, Modifiers, NewImage, NewerAction, NewerImage, Opened, Pane, Period, Phase,
    Pointer, TOOLS, inconsistent_links, pair_rms_distance,
};
use calib_image::{CameraChange, Comparison};
use calib_site::{LinkKind, Site, SiteCamera};

const BUMP: &str = "2026-06-01T09:00:00Z";

/// Index of the camera entry for the ended period.
const OLD: usize = 6;

/// Returns the demonstration; its first camera has an ended period, which is last in the list.
fn site() -> Site {
    let mut site = calib_demo::demo_site().site;
    for camera in &mut site.cameras {
        camera.image = Some(format!("{}.png", camera.id));
    }
    let old =
        SiteCamera { valid_to: Some(BUMP.into()), image: Some("old.png".into()), ..site.cameras[0].clone() };
    site.cameras[0].valid_from = Some(BUMP.into());
    site.cameras.push(old);
    site
}

fn opened(site: Site, folder: Option<&Path>) -> Editor {
    let mut editor = Editor::default();
    let images = Images::in_folder(folder.map(Path::to_path_buf), None);
    editor.apply(Action::Open(Box::new(Opened { site, images, path: None, is_unsaved: false })));
    editor
}

fn click(editor: &mut Editor, camera: usize, at: Pixel, alt: bool) {
    for phase in [Phase::Press, Phase::Release] {
        editor.apply(Action::Pointer(Pointer {
            pane: Pane::Image(camera),
            at: at.into(),
            phase,
            modifiers: Modifiers { alt, ..Modifiers::NONE },
            radius: 8.0,
            point_size: 0.5,
            moved: false,
            double: false,
            edge: None,
            captured: None,
            newer: None,
            image: None,
        }));
    }
}

fn take(editor: &mut Editor, title: &str) {
    let index = TOOLS.iter().position(|tool| tool.title == title).unwrap();
    editor.apply(Action::SelectTool(index));
}

#[test]
fn link_is_refused_in_an_ended_period_and_added_in_the_newest() {
    let mut editor = opened(site(), None);
    take(&mut editor, "Link");
    let before = editor.site().clone();
    click(&mut editor, OLD, Pixel::new(900.0, 700.0), false);
    assert_eq!(*editor.site(), before);
    let note = editor.session().note.clone().unwrap();
    assert!(note.contains(&before.cameras[0].id) && note.contains("newest image"), "{note}");
    click(&mut editor, 0, Pixel::new(900.0, 700.0), false);
    assert_eq!(editor.site().links.len(), before.links.len() + 1);
}

#[test]
fn mark_is_not_pinned_in_an_ended_period() {
    let mut editor = opened(site(), None);
    let pose = *editor.session().solved.pose(OLD).unwrap();
    let is_shown = |mark: &calib_site::Mark| {
        let px = pose.world_to_pixel(mark.at_m)?;
        let inside = (0.0..1920.0).contains(&px.u) && (0.0..1080.0).contains(&px.v);
        (inside && !mark.off).then_some(px)
    };
    let at = editor.site().marks.iter().find_map(is_shown).unwrap();
    take(&mut editor, "Select");
    let before = editor.site().marks.clone();
    click(&mut editor, OLD, at, true);
    assert_eq!(editor.site().marks, before);
    assert!(editor.session().note.as_ref().is_some_and(|note| note.contains("newest image")));
}

#[test]
fn links_of_the_newest_period_do_not_apply_to_an_ended_one() {
    let editor = opened(site(), None);
    let session = editor.session();
    let poses: Vec<_> = (0..=OLD).map(|index| session.solved.pose(index).copied()).collect();
    assert!(session.site.links.iter().any(|link| link.kind == LinkKind::Point));
    assert!(inconsistent_links(session, 0).1 > 0 && pair_rms_distance(session, &poses, [0, 1]).is_some());
    assert_eq!(inconsistent_links(session, OLD), (0, 0));
    assert_eq!(pair_rms_distance(session, &poses, [OLD, 1]), None);
}

#[test]
fn image_is_replaced_and_rescaled_in_its_own_period() {
    let mut editor = opened(site(), None);
    let before = editor.site().clone();
    let size = before.cameras[OLD].size_px.map(|side| side / 2);
    let still = NewImage {
        image: "small.png".into(),
        title: "small".into(),
        size,
        image_circle: None,
        pixel_aspect: None,
    };
    editor.apply(Action::ReplaceImage(Period::from_camera(&before.cameras[OLD]), still));
    editor.apply(Action::RescaleToImage);
    let after = editor.site();
    assert_eq!(after.cameras[..OLD], before.cameras[..OLD]);
    assert_eq!(
        (&after.links, &after.marks),
        (&before.links, &before.marks),
        "they are drawn on the newest image"
    );
    assert_eq!(after.cameras[OLD].image.as_deref(), Some("small.png"));
    let first = |site: &Site| site.cameras[OLD].annotations[0].polylines().next().unwrap()[0];
    assert_eq!(first(after), Pixel::new(0.5 * first(&before).u, 0.5 * first(&before).v));
}

/// Returns the comparison of a camera with a newer image.
fn newer(editor: &Editor, camera: usize, image: &str, since: &str) -> Box<NewerImage> {
    let entry = &editor.site().cameras[camera];
    let comparison = Comparison {
        change: CameraChange::Moved,
        rotation: calib_core::camera::RotationZoom::default(),
        covariance: [[0.0; 4]; 4],
        bound: [[0.0; 4]; 4],
        z_score: 9.0,
        shift: 3.0,
        visible_samples: 100,
        found_fraction: 0.9,
        window: None,
        chance_fraction: 0.05,
        samples: Vec::new(),
    };
    Box::new(NewerImage {
        ids: [entry.id.clone()].into(),
        period: [entry.valid_from.clone(), entry.valid_to.clone()],
        old: entry.image.clone(),
        image: image.into(),
        title: image.into(),
        since: since.into(),
        captured: [None, None],
        pose: *editor.session().solved.pose(camera).unwrap(),
        comparison,
    })
}

fn compared(editor: &mut Editor, camera: usize, image: &str, since: &str) {
    let newer = newer(editor, camera, image, since);
    editor.apply(Action::Newer(NewerAction::Compared(newer)));
}

fn shown(editor: &Editor, camera: usize) -> Option<&str> {
    editor.newer(camera).map(|newer| newer.image.as_str())
}

#[test]
fn latest_newer_image_is_kept_in_any_order_of_comparison() {
    let mut editor = opened(site(), None);
    compared(&mut editor, 0, "june.png", "2026-06-20T09:00:00Z");
    compared(&mut editor, 0, "earlier.png", "2026-06-10T09:00:00Z");
    assert_eq!(shown(&editor, 0), Some("june.png"));
    let note = editor.session().note.clone().unwrap();
    assert!(note.contains("earlier.png was ignored, because it is older than june.png"), "{note}");
    compared(&mut editor, 0, "july.png", "2026-07-01T09:00:00Z");
    assert_eq!(shown(&editor, 0), Some("july.png"));
    compared(&mut editor, 0, "undated.png", "");
    assert_eq!(shown(&editor, 0), Some("undated.png"), "with an unknown time the last comparison is kept");
    assert_eq!(shown(&editor, OLD), None, "each period has its own");
}

#[test]
fn renamed_camera_keeps_its_newer_image_also_after_undo() {
    let mut editor = opened(site(), None);
    compared(&mut editor, 0, "june.png", BUMP);
    editor.apply(Action::SelectCamera(0));
    editor.apply(Action::Rename("gate".into()));
    assert_eq!((editor.site().cameras[0].id.as_str(), shown(&editor, 0)), ("gate", Some("june.png")));
    editor.apply(Action::Gesture(Gesture::Undo));
    assert_ne!(editor.site().cameras[0].id, "gate");
    assert_eq!(shown(&editor, 0), Some("june.png"));
    editor.apply(Action::Gesture(Gesture::Redo));
    assert_eq!(shown(&editor, 0), Some("june.png"));
}

#[test]
fn site_saved_into_another_folder_keeps_its_newer_images() {
    let mut editor = opened(site(), Some(Path::new("/stills")));
    compared(&mut editor, 0, "june.png", BUMP);
    let folder = Some(PathBuf::from("/sites"));
    editor.apply(Action::Saved { path: PathBuf::from("/sites/site.json"), folder });
    let image = editor.site().cameras[0].image.clone().unwrap();
    assert!(image.starts_with("../stills/"), "{image}");
    assert_eq!(shown(&editor, 0), Some("../stills/june.png"));
}
