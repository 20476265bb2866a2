//! Tests of the autosave: after the program is killed or closed, every finished gesture can be recovered.
#![cfg(unix)]

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use calib_app::App;
use calib_app::storage::files::Images;
use calib_core::Pixel;
use calib_editor::{Action, Part};
use egui::{Context, Key, Modifiers};

use crate::desk;

const FOLDER: &str = "CALIB_CRASH_FOLDER";

/// Returns the horizontal displacement, in pixels, of the first point of the first line from its position in the
/// demonstration site. Each step of the child process moves the point by one pixel.
fn progress(site: &calib_site::Site) -> f64 {
    let start = desk::demo().cameras[0].annotations[0].polylines().next().unwrap()[0];
    let now: Pixel = site.cameras[0].annotations[0].polylines().next().unwrap()[0];
    now.u - start.u
}

/// Runs in the child process that the test kills: moves a point and saves in a loop, and prints each finished step.
fn work(folder: &Path) {
    let mut app = App::new(&Context::default(), Some(folder.to_path_buf()));
    app.open_site(desk::demo(), Images::default(), Some(folder.join("site.json")));
    app.act(Action::Select(Part::Vertex { annotation: 0, segment: 0, vertex: 0 }));
    let mut harness = egui_kittest::Harness::builder()
        .with_size([1000.0, 700.0])
        .with_context_setup(calib_app::theme::install)
        .build_ui_state(|ui, app: &mut App| app.show_ui(ui), app);
    for step in 1.. {
        harness.key_press_modifiers(Modifiers::SHIFT, Key::ArrowRight);
        harness.run_steps(2);
        if step % 7 == 0 {
            harness.key_press_modifiers(Modifiers::COMMAND, Key::S);
            harness.run_steps(2);
        }
        let mut out = std::io::stdout().lock();
        writeln!(out, "done {}", progress(&harness.state().editor.session().site)).unwrap();
        out.flush().unwrap();
    }
}

#[test]
fn kill_loses_nothing_older_than_the_last_finished_gesture() {
    if let Some(folder) = std::env::var_os(FOLDER) {
        work(Path::new(&folder));
        return;
    }
    let kills = std::env::var("CALIB_KILLS").ok().and_then(|kills| kills.parse().ok()).unwrap_or(20_u64);
    for kill in 0..kills {
        let folder = tempfile::tempdir().unwrap();
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args([
                "--exact",
                "crash::kill_loses_nothing_older_than_the_last_finished_gesture",
                "--nocapture",
            ])
            .env(FOLDER, folder.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let out = child.stdout.take().unwrap();
        let (begun, is_at_work) = std::sync::mpsc::channel();
        let reader = std::thread::spawn(move || {
            let done = |line: String| line.strip_prefix("done ").and_then(|n| n.parse::<f64>().ok());
            let steps = BufReader::new(out).lines().map_while(Result::ok).filter_map(done);
            // Sending fails once the main thread no longer receives; this is ignored.
            steps.inspect(|_| begun.send(()).unwrap_or_default()).last()
        });
        is_at_work.recv().unwrap();
        std::thread::sleep(Duration::from_millis((kill * 7919) % 500));
        child.kill().unwrap();
        child.wait().unwrap();
        let last = reader.join().unwrap().unwrap_or(0.0);
        let saved =
            calib_app::storage::files::open(&folder.path().join("site.json")).ok().map(|(site, _)| site);
        let again = App::new(&Context::default(), Some(folder.path().to_path_buf()));
        let kept = again.storage.found.first().map(|(_, found)| found.site.clone());
        let found = saved.iter().chain(&kept).map(progress).fold(0.0, f64::max);
        assert!(found + 1e-6 >= last, "kill {kill}: {found} of {last} gestures are kept");
        assert!(kill > 0 || last > 0.0, "the program finished no gesture");
    }
}

#[test]
fn two_windows_keep_their_work_separate() {
    let folder = tempfile::tempdir().unwrap();
    let open = || {
        let mut app = App::new(&Context::default(), Some(folder.path().to_path_buf()));
        app.open_site(desk::demo(), Images::default(), None);
        egui_kittest::Harness::builder()
            .with_context_setup(calib_app::theme::install)
            .build_ui_state(|ui, app: &mut App| app.show_ui(ui), app)
    };
    let mut windows = [open(), open()];
    for (window, name) in windows.iter_mut().zip(["left", "right"]) {
        desk::change(window.state_mut(), "name the site", |site| site.name = Some(name.into()));
        window.run_steps(2);
    }
    let third = App::new(&Context::default(), Some(folder.path().to_path_buf()));
    assert!(third.storage.found.is_empty(), "work of windows that live is not offered");
    drop((windows, third));
    let later = App::new(&Context::default(), Some(folder.path().to_path_buf()));
    let mut names: Vec<_> =
        later.storage.found.iter().map(|(_, found)| found.site.name.clone().unwrap()).collect();
    names.sort();
    assert_eq!(names, ["left", "right"]);
}

#[test]
fn unsaved_work_is_offered_until_a_decision() {
    let folder = tempfile::tempdir().unwrap();
    let start = || App::new(&Context::default(), Some(folder.path().to_path_buf()));
    let edit = |mut app: App, name: &str| {
        app.open_site(desk::demo(), Images::default(), None);
        let mut harness = egui_kittest::Harness::builder()
            .with_context_setup(calib_app::theme::install)
            .build_ui_state(|ui, app: &mut App| app.show_ui(ui), app);
        desk::change(harness.state_mut(), "name the site", |site| site.name = Some(name.into()));
        harness.run_steps(2);
    };
    edit(start(), "first");
    // The next session opens another site while the first autosave is still undecided, and also ends without
    // saving.
    edit(start(), "second");
    let mut app = start();
    let names: Vec<_> = app.storage.found.iter().map(|(_, found)| found.site.name.clone().unwrap()).collect();
    assert_eq!(names, ["first", "second"]);
    app.recover(0);
    assert_eq!(app.editor.session().site.name.as_deref(), Some("first"));
    app.discard_found(0);
    drop(app);
    assert_eq!(start().storage.found.len(), 1, "continued work is kept until it is saved");
}
