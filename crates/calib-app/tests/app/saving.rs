//! Saving: a file changed by another program is not overwritten without asking.

use calib_app::choice::Purpose;
use calib_app::state::{PathField, Why};
use calib_app::storage::dialog::Dialog;
use calib_app::storage::files;
use calib_core::Pixel;
use calib_site::Site;
use calib_tests::Scratch;
use egui::{Key, Modifiers};
use egui_kittest::kittest::Queryable as _;

use crate::desk::{Desk, demo};

/// Opens a window with the site of a file.
fn window(scratch: &Scratch) -> Desk {
    let mut desk = Desk::new(Site::new());
    let path = scratch.path("site.json");
    desk.app().open_path(&path);
    desk.harness.run_steps(2);
    desk
}

fn lines(site: &Site) -> usize {
    site.cameras[0].annotations.iter().map(|a| a.polylines().count()).sum()
}

fn draw_and_save(desk: &mut Desk, u: f64) {
    desk.take("Vertical");
    desk.line(0, Pixel::new(u, 300.0), Pixel::new(u, 500.0));
    desk.keys(Modifiers::COMMAND, Key::S);
    desk.harness.run_steps(3);
}

fn saved(scratch: &Scratch) -> Site {
    files::open(&scratch.path("site.json")).unwrap().0
}

#[test]
fn second_window_to_save_is_asked_with_the_changes_of_the_first() {
    let scratch = Scratch::new();
    scratch.write("site.json", demo().to_json());
    let before = lines(&demo());
    let (mut first, mut second) = (window(&scratch), window(&scratch));
    draw_and_save(&mut first, 600.0);
    assert_eq!(lines(&saved(&scratch)), before + 1);
    draw_and_save(&mut second, 900.0);
    assert_eq!(lines(&saved(&scratch)), before + 1, "the file is not written before the decision");
    let words = second.words().join("\n");
    let change = format!("shop-1: lines {before} \u{2192} {}", before + 1);
    assert!(words.contains(&change), "{words}");
    second.harness.get_by_label("Overwrite").click();
    second.harness.run_steps(3);
    let left = saved(&scratch).cameras[0].annotations.clone();
    assert!(left == second.site().cameras[0].annotations, "the operator has decided");
    // From now on, the file has the state of the second window.
    draw_and_save(&mut second, 950.0);
    assert_eq!(second.harness.state().dialogs.conflict, None);
    // The first window reloads, and its own work is kept for later.
    draw_and_save(&mut first, 620.0);
    first.harness.get_by_label("Reload").click();
    first.harness.run_steps(3);
    assert_eq!(lines(first.site()), before + 2);
    assert!(first.harness.state().editor.session().is_saved());
}

#[test]
fn read_only_file_asks_for_another_path() {
    let scratch = Scratch::new();
    scratch.write("site.json", demo().to_json());
    let path = scratch.path("site.json");
    let mut closed = std::fs::metadata(&path).unwrap().permissions();
    closed.set_readonly(true);
    std::fs::set_permissions(&path, closed).unwrap();
    let mut desk = window(&scratch);
    draw_and_save(&mut desk, 600.0);
    assert_eq!(desk.harness.state().dialogs.conflict.as_ref().map(|c| c.why.clone()), Some(Why::ReadOnly));
    assert_eq!(lines(&saved(&scratch)), lines(&demo()));
    desk.key(Key::Escape);
    assert_eq!(desk.harness.state().dialogs.conflict, None);
}

#[test]
fn path_is_typed_without_a_file_chooser() {
    let scratch = Scratch::new();
    let mut desk = Desk::new(demo());
    // A file chooser that is closed at once means that the system has no file chooser.
    desk.app().dialogs.chooser = |purpose| Dialog::refused(purpose);
    desk.keys(Modifiers::COMMAND | Modifiers::SHIFT, Key::S);
    desk.harness.run_steps(3);
    assert_eq!(
        desk.harness.state().dialogs.path_field,
        Some(PathField { purpose: Purpose::SaveSite, text: String::new() })
    );
    desk.harness.get_by_label("Path to save the site to").focus();
    desk.harness.run_steps(2);
    let path = scratch.path("typed.json");
    desk.harness.event(egui::Event::Text(path.display().to_string()));
    desk.harness.run_steps(2);
    desk.key(Key::Enter);
    desk.harness.run_steps(2);
    assert_eq!(files::open(&path).unwrap().0.cameras.len(), demo().cameras.len());
}
