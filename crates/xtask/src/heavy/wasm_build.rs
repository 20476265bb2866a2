//! Builds for the browser.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::ensure;

use crate::serve::{debian_rustc, has_sources, printed};
use crate::workspace::root;

const WASM: &str = "wasm32-unknown-unknown";

/// Whether the standard library is built, too, so that it is one that is small to fetch.
pub(crate) fn builds_library() -> bool {
    has_sources() || debian_rustc().is_some()
}

/// Whether the compiler has the library for wasm32 as it was built by others.
fn has_target() -> bool {
    printed(&["target-libdir", "--target", WASM]).is_some_and(|libraries| Path::new(&libraries).exists())
}

/// Builds what the arguments say; returns the folder that holds a folder of each profile.
pub(crate) fn build(arguments: &[&str]) -> anyhow::Result<PathBuf> {
    // Beside what is built for this machine: two compilers in one folder would undo each other's work.
    let folder =
        std::env::var_os("CALIB_WEB_TARGET").map_or_else(|| root().join("target/web-build"), PathBuf::from);
    let mut command = match debian_rustc().filter(|_| !has_sources()) {
        Some(rustc) => {
            let mut command = Command::new("/usr/bin/cargo");
            command.env("RUSTC", rustc).env_remove("RUSTUP_TOOLCHAIN");
            command.env("CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_LINKER", "wasm-ld");
            command
        }
        None => {
            ensure!(
                has_sources() || has_target(),
                "no compiler for wasm32: run `rustup component add rust-src`, or on Debian \
                 `apt-get install rustc-web cargo-web rust-web-src lld`"
            );
            Command::new("cargo")
        }
    };
    // Every browser since 2023 has these instructions, and what draws glyphs is a fifth of the size with them. Without types
    // of references there is one table, as what splits the page wants.
    let features = "-Ctarget-feature=+simd128,-reference-types";
    command.env("CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_RUSTFLAGS", features);
    command.arg("build").args(arguments).args(["--target", WASM]).arg("--target-dir").arg(&folder);
    if builds_library() {
        command.env("RUSTC_BOOTSTRAP", "1");
        command.args(["-Z", "build-std=std,panic_abort", "-Z", "build-std-features=optimize_for_size"]);
    }
    ensure!(command.current_dir(root()).status()?.success(), "the build for wasm32 failed");
    Ok(folder.join(WASM))
}
