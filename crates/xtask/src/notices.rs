//! `cargo xtask notices`: the notices of everything that is linked into the programs, made by cargo-about
//! from the crates' own licence files. They are committed; a test compares them with Cargo.lock.

use std::process::Command;

use anyhow::bail;

use crate::tools;
use crate::workspace::root;

/// A program's crate, and where its notices are.
const PROGRAMS: [(&str, &str); 5] = [
    ("crates/calib-app/Cargo.toml", "crates/calib-app/assets/THIRD-PARTY.txt"),
    ("crates/calib-cli/Cargo.toml", "crates/calib-cli/THIRD-PARTY.txt"),
    ("crates/calib-js/Cargo.toml", "crates/calib-js/THIRD-PARTY.txt"),
    ("crates/calib-py/Cargo.toml", "crates/calib-py/THIRD-PARTY.txt"),
    ("crates/calib-c/Cargo.toml", "crates/calib-c/THIRD-PARTY.txt"),
];

const ABOUT: tools::Tool = tools::Tool {
    name: "cargo-about",
    is_there: || tools::runs("target/tools/bin/cargo-about", &["--version"]),
    install: &[&[
        "cargo",
        "install",
        "--quiet",
        "--locked",
        "--root",
        "target/tools",
        "cargo-about@0.9.3",
        "--features",
        "cli",
    ]],
};

/// Writes the notices of every program.
pub(crate) fn run() -> anyhow::Result<()> {
    if !tools::ready(&ABOUT, true) {
        bail!("cargo-about could not be installed");
    }
    for (manifest, notices) in PROGRAMS {
        let mut about = Command::new(root().join("target/tools/bin/cargo-about"));
        about.args(["generate", "--locked", "--config", "crates/xtask/notices.toml"]);
        about.args(["--manifest-path", manifest, "--output-file", notices, "crates/xtask/notices.hbs"]);
        if !about.current_dir(root()).status()?.success() {
            bail!("cargo-about failed for {manifest}");
        }
        println!("wrote {notices}");
    }
    Ok(())
}
