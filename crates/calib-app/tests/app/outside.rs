//! Images outside the site's folder are read only after the operator allows it.

use calib_app::App;
use calib_app::command::Command;
use calib_app::storage::files;
use calib_app::theme;
use calib_core::Pixel;
use calib_editor::Pane;
use calib_site::{Plan, Site, SiteCamera};
use calib_tests::Scratch;
use egui::{Context, Key};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;

use crate::desk::{self, Desk, still};

const SIZE: [u32; 2] = [320, 180];
const OUTSIDE: [&str; 3] = ["private.png", "linked.png", "plan.png"];

/// Writes a site with one image in its folder. Outside of the folder are one image by path, one by link, and
/// the plan.
fn site(scratch: &Scratch) -> std::path::PathBuf {
    std::fs::create_dir_all(scratch.path("site")).unwrap();
    for name in OUTSIDE.into_iter().chain(["site/own.png"]) {
        still(scratch, name, SIZE);
    }
    #[cfg(unix)]
    std::os::unix::fs::symlink(scratch.path("linked.png"), scratch.path("site/link.png")).unwrap();
    let camera = |id: &str, image: String| SiteCamera { image: Some(image), ..SiteCamera::new(id, SIZE) };
    let private = scratch.path("private.png").to_string_lossy().into_owned();
    let cameras =
        vec![camera("own", "own.png".into()), camera("path", private), camera("link", "link.png".into())];
    let plan = desk::demo().plan.map(|plan| Plan { image: Some("../plan.png".into()), ..plan });
    let site = Site { cameras, plan, ..Site::new() };
    scratch.write("site/site.json", site.to_json());
    scratch.path("site/site.json")
}

/// Opens a file in a window and waits until all permitted images are read.
fn opened(path: &std::path::Path) -> Desk {
    let mut desk = Desk::new(Site::new());
    desk.app().open_path(path);
    read(&mut desk);
    desk
}

/// Requests all images and the plan, and waits until each is read or refused.
fn read(desk: &mut Desk) {
    for view in [Key::Num2, Key::Num3] {
        desk.key(view);
        desk.harness.run_steps(3);
        desk.wait(|app| app.pictures.loading() == 0);
    }
}

fn is_read(desk: &mut Desk, name: &str) -> bool {
    desk.app().pictures.ready(name).is_some()
}

/// Returns the names of the site's images, outside images last.
fn names(desk: &Desk) -> Vec<String> {
    calib_editor::image_names(desk.site())
}

fn report(desk: &mut Desk, scratch: &Scratch) -> usize {
    let path = scratch.path("report.html");
    desk.answer(Some(path.clone()));
    desk.tell(Command::Report);
    std::fs::read_to_string(path).unwrap().matches("data:image/").count()
}

fn press(desk: &mut Desk, label: &str) {
    desk.harness.get_by_label(label).click();
    desk.harness.run_steps(3);
}

#[test]
fn outside_images_are_read_only_with_permission_and_skipping_loses_nothing() {
    let scratch = Scratch::new();
    let path = site(&scratch);
    let mut desk = opened(&path);
    let words = desk.words().join("\n");
    assert!(words.contains("refers to 3 images outside its folder"), "{words}");
    for name in OUTSIDE {
        let file = scratch.path(name).canonicalize().unwrap().display().to_string();
        assert!(words.contains(&file), "{file}: {words}");
    }
    let (before, all) = (desk.site().clone(), names(&desk));
    let elsewhere = &all[1..];
    for round in ["before it is decided", "after it is left out"] {
        assert!(is_read(&mut desk, "own.png"), "{round}");
        for name in elsewhere {
            let error = desk.app().pictures.error(name).unwrap_or_default();
            assert!(error.contains("outside the site"), "{round}, {name}: {error:?}");
        }
        assert_eq!(report(&mut desk, &scratch), 1, "{round}: the report holds the own one alone");
        if desk.harness.query_by_label("Skip").is_some() {
            press(&mut desk, "Skip");
        }
    }
    assert!(desk.harness.state().dialogs.outside.asked.is_empty());
    // A finished gesture does not ask again, and the file keeps every name.
    desk.key(Key::Num1);
    desk.take("Vertical");
    desk.line(0, Pixel::new(100.0, 30.0), Pixel::new(101.0, 150.0));
    desk.undo();
    assert!(desk.harness.state().dialogs.outside.asked.is_empty() && *desk.site() == before);
    desk.redo();
    desk.app().save();
    let files_of = |names: Vec<String>| -> Vec<_> {
        names.iter().map(|name| path.with_file_name(name).canonicalize().unwrap()).collect()
    };
    let saved = calib_editor::image_names(&files::open(&path).unwrap().0);
    assert_eq!(files_of(saved), files_of(all.clone()));
    // Skipped images can be read later.
    desk.tell(Command::ReadAgain);
    press(&mut desk, "Read now");
    read(&mut desk);
    for name in &all {
        assert!(is_read(&mut desk, name), "{name}: {:?}", desk.app().pictures.error(name));
    }
    assert_eq!(report(&mut desk, &scratch), 3, "of every camera");
    // The permission is valid once: opening the site again asks again.
    assert_eq!(opened(&path).harness.state().dialogs.outside.asked.len(), 3);
}

#[test]
fn escape_skips_outside_images() {
    let scratch = Scratch::new();
    let mut desk = opened(&site(&scratch));
    desk.key(Key::Escape);
    desk.harness.run_steps(2);
    assert!(desk.harness.query_by_label("Skip").is_none());
    assert!(!is_read(&mut desk, "link.png"));
}

#[test]
fn chosen_files_are_read_without_asking() {
    let scratch = Scratch::new();
    let path = site(&scratch);
    let mut desk = opened(&path);
    press(&mut desk, "Read now");
    still(&scratch, "chosen.png", SIZE);
    desk.answer(Some(scratch.path("chosen.png")));
    desk.tell(Command::AddImages);
    desk.wait(|app| app.editor.site().cameras.len() == 4);
    read(&mut desk);
    assert!(desk.harness.state().dialogs.outside.asked.is_empty());
    std::fs::create_dir_all(scratch.path("other/place")).unwrap();
    desk.answer(Some(scratch.path("other/place/site.json")));
    desk.tell(Command::SaveAs);
    read(&mut desk);
    assert!(
        desk.harness.state().dialogs.outside.asked.is_empty(),
        "{:?}",
        desk.harness.state().dialogs.outside.asked
    );
    for name in names(&desk) {
        assert!(is_read(&mut desk, &name), "{name}: {:?}", desk.app().pictures.error(&name));
    }
}

/// Opens a window without a site; the window keeps its autosaves in `folder`.
fn window_of(folder: &std::path::Path) -> Desk {
    let app = App::new(&Context::default(), Some(folder.to_path_buf()));
    let harness = Harness::builder()
        .with_size([1440.0, 900.0])
        .with_context_setup(theme::install)
        .build_ui_state(|ui, app: &mut App| app.show_ui(ui), app);
    Desk { harness }
}

#[test]
fn start_page_shows_no_outside_image() {
    let scratch = Scratch::new();
    let (path, folder) = (site(&scratch), scratch.path("kept"));
    let mut first = files::open(&path).unwrap().0;
    first.cameras.remove(0);
    scratch.write("site/site.json", first.to_json());
    let mut desk = window_of(&folder);
    desk.app().open_path(&path);
    desk.harness.run_steps(3);
    press(&mut desk, "Read now");
    drop(desk);
    let mut desk = window_of(&folder);
    desk.harness.run_steps(3);
    desk.wait(|app| app.pictures.loading() == 0);
    let shown = desk.app().storage.recent[0].image.clone().unwrap().to_string_lossy().into_owned();
    let error = desk.app().pictures.error(&shown).unwrap_or_default();
    assert!(error.contains("outside the site"), "{shown}: {error:?}");
}

#[test]
fn crashed_window_continues_with_the_same_permission() {
    let scratch = Scratch::new();
    let (path, folder) = (site(&scratch), scratch.path("kept"));
    let window = || window_of(&folder);
    for (answer, asked) in [("Read now", 0), ("Skip", 3)] {
        let mut desk = window();
        desk.app().open_path(&path);
        desk.harness.run_steps(3);
        press(&mut desk, answer);
        desk.take("Vertical");
        desk.harness.run_steps(2);
        let [from, to] = [[100.0, 30.0], [101.0, 150.0]].map(|at| desk.screen(Pane::Image(0), at));
        desk.drag_screen(&[from, to], egui::Modifiers::NONE);
        desk.harness.run_steps(3);
        drop(desk);
        let mut again = window();
        again.harness.run_steps(2);
        assert_eq!(again.harness.state().storage.found.len(), 1, "{answer}");
        again.app().recover(0);
        again.harness.run_steps(2);
        assert_eq!(again.harness.state().dialogs.outside.asked.len(), asked, "{answer}");
        again.app().editor.apply(calib_editor::Action::Gesture(calib_editor::command::Gesture::Cancel));
        drop(again);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
