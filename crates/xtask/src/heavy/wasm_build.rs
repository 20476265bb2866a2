//! Builds for the browser.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context as _, ensure};

use crate::wasm::{WASM, debian_rustc, has_target};
use crate::workspace::root;

/// Builds what the arguments say; returns the folder that holds a folder of each profile.
pub(crate) fn build(arguments: &[&str]) -> anyhow::Result<PathBuf> {
    // Beside what is built for this machine: two compilers in one folder would undo each other's work.
    let folder =
        std::env::var_os("CALIB_WEB_TARGET").map_or_else(|| root().join("target/web-build"), PathBuf::from);
    let mut command = if has_target() {
        Command::new("cargo")
    } else {
        let rustc = debian_rustc().context(
            "no compiler for wasm32: run `rustup target add wasm32-unknown-unknown`, or on Debian \
             `apt-get install rustc-web cargo-web rust-web-src lld`",
        )?;
        let mut command = Command::new("/usr/bin/cargo");
        command.env("RUSTC", rustc).env("RUSTC_BOOTSTRAP", "1").env_remove("RUSTUP_TOOLCHAIN");
        command.env("CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_LINKER", "wasm-ld");
        command
    };
    // Every browser since 2023 has these instructions, and what draws glyphs is a fifth of the size with them. Without types
    // of references there is one table, as what splits the page wants.
    let features = "-Ctarget-feature=+simd128,-reference-types";
    command.env("CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_RUSTFLAGS", features);
    command.arg("build").args(arguments).args(["--target", WASM]).arg("--target-dir").arg(&folder);
    if !has_target() {
        // Its library is built here, so it can be one that is small to fetch.
        command.args(["-Z", "build-std=std,panic_abort", "-Z", "build-std-features=optimize_for_size"]);
    }
    ensure!(command.current_dir(root()).status()?.success(), "the build for wasm32 failed");
    Ok(folder.join(WASM))
}
