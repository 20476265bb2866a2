//! The notices of the programs name all linked crates.

use std::collections::BTreeSet;
use std::process::Command;

use calib_tests::{Scratch, root};

/// Returns name and version of the third-party crates linked into a program on a target, or on any target ("all").
fn linked(package: &str, target: &str) -> BTreeSet<String> {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--locked", "--package", package, "--target", target])
        .args(["--edges", "normal,no-proc-macro", "--prefix", "none", "--no-dedupe", "--format", "{p}"])
        .current_dir(root())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    // Crates of this workspace have a folder in the output.
    let others = text.lines().filter(|line| !line.is_empty() && !line.contains("(/"));
    others.map(|line| line.replacen(" v", " ", 1).trim_end_matches(" (*)").to_owned()).collect()
}

fn missing(package: &str, target: &str, notices: &str) -> Vec<String> {
    let named: BTreeSet<&str> = notices.lines().filter_map(|line| line.strip_prefix("  ")).collect();
    let linked = linked(package, target);
    assert!(linked.len() > 20, "{package}: {} crates", linked.len());
    linked.into_iter().filter(|crate_| !named.contains(crate_.as_str())).collect()
}

#[test]
fn notices_name_all_linked_crates() {
    for (package, target, path) in [
        ("calib-cli", "all", "crates/calib-cli/THIRD-PARTY.txt"),
        ("calib-app", "all", "crates/calib-app/assets/THIRD-PARTY.txt"),
        ("calib-app", "wasm32-unknown-unknown", "crates/calib-app/assets/THIRD-PARTY-PAGE.txt"),
        ("calib-js", "all", "crates/calib-js/THIRD-PARTY.txt"),
        ("calib-py", "all", "crates/calib-py/THIRD-PARTY.txt"),
        ("calib-c", "all", "crates/calib-c/THIRD-PARTY.txt"),
    ] {
        let notices = std::fs::read_to_string(root().join(path)).unwrap();
        let missing = missing(package, target, &notices);
        assert!(missing.is_empty(), "`cargo xtask notices` adds to {path}: {}", missing.join(", "));
        assert!(!self::missing(package, target, &notices.replace("\n  serde ", "\n  gone ")).is_empty());
    }
}

#[test]
fn licenses_command_prints_the_notices() {
    let notices = Scratch::new().calib(&["licenses"]).expect_code(0).stdout;
    assert!(notices.contains("MIT or Apache-2.0") && notices.contains("\n  resvg "), "{}", &notices[..200]);
}

#[test]
fn wheel_contains_the_licences_of_the_project() {
    for licence in ["LICENSE-MIT", "LICENSE-APACHE"] {
        let [own, wheels] = ["", "crates/calib-py/"]
            .map(|folder| std::fs::read_to_string(root().join(folder).join(licence)).unwrap());
        assert_eq!(own, wheels, "{licence}");
    }
}
