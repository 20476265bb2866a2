//! Builds for wasm32.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::ensure;

use crate::server::{debian_rustc, has_library_sources, rustc_print};
use crate::workspace::root;

const WASM: &str = "wasm32-unknown-unknown";

/// Whether builds for wasm32 also compile the standard library, which makes the program smaller.
pub(crate) fn builds_library() -> bool {
    has_library_sources() || debian_rustc().is_some()
}

/// Whether the compiler has a precompiled standard library for wasm32.
fn has_target() -> bool {
    rustc_print(&["target-libdir", "--target", WASM]).is_some_and(|libraries| Path::new(&libraries).exists())
}

/// Runs `cargo build` for wasm32 with these arguments, and returns the folder that contains one folder per
/// profile.
pub(crate) fn build(arguments: &[&str]) -> anyhow::Result<PathBuf> {
    // The target folder is separate from the native one. Two compilers in one folder would invalidate each
    // other's build results.
    let folder =
        std::env::var_os("CALIB_WEB_TARGET").map_or_else(|| root().join("target/web-build"), PathBuf::from);
    let mut command = match debian_rustc().filter(|_| !has_library_sources()) {
        Some(rustc) => {
            let mut command = Command::new("/usr/bin/cargo");
            command.env("RUSTC", rustc).env_remove("RUSTUP_TOOLCHAIN");
            command.env("CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_LINKER", "wasm-ld");
            command
        }
        None => {
            ensure!(
                has_library_sources() || has_target(),
                "no compiler for wasm32: run `rustup component add rust-src`, or on Debian \
                 `apt-get install rustc-web cargo-web rust-web-src lld`"
            );
            Command::new("cargo")
        }
    };
    // All browsers since 2023 support SIMD, and it makes the glyph rasteriser five times smaller. Without
    // reference types the program has only one table, as the splitter requires.
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
