//! The program without a window: its help, and the message that a display is required.

use std::process::{Command, Output};

/// Runs the program in a session without a display.
fn without_display(args: &[&str]) -> Output {
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_calib-app"));
    for name in ["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"] {
        command.env_remove(name);
    }
    command.env("HOME", folder.path()).env("XDG_DATA_HOME", folder.path()).args(args).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn help_and_version_need_no_display() {
    for (option, said) in [("--help", "Usage: calib-app [FILE]..."), ("-V", env!("CARGO_PKG_VERSION"))] {
        let ended = without_display(&[option]);
        assert!(ended.status.success() && text(&ended.stdout).contains(said), "{option}: {ended:?}");
        assert!(ended.stderr.is_empty(), "{option}: {ended:?}");
    }
    let ended = without_display(&["--nonsense"]);
    assert_eq!(ended.status.code(), Some(2));
    assert!(text(&ended.stdout).contains("Unknown option --nonsense"), "{ended:?}");
}

/// On other systems, a window needs no variable.
#[cfg(target_os = "linux")]
#[test]
fn window_without_a_display_is_refused_with_a_message() {
    let ended = without_display(&[]);
    let said = text(&ended.stderr);
    assert_eq!(ended.status.code(), Some(1), "{ended:?}");
    assert!(said.contains("no display was found") && said.contains("calib solve"), "{said}");
    assert!(!said.contains("panicked"), "{said}");
}
