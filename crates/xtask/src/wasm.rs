//! Builds for the browser: with the installed target, or with Debian's own compiler and library sources.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, ensure};

use crate::workspace::root;

const WASM: &str = "wasm32-unknown-unknown";

/// Whether there is a compiler for wasm32.
pub(crate) fn is_there() -> bool {
    has_target() || debian_rustc().is_some()
}

fn has_target() -> bool {
    let libraries = Command::new("rustc").args(["--print", "target-libdir", "--target", WASM]).output();
    libraries.is_ok_and(|output| {
        let path = String::from_utf8_lossy(&output.stdout);
        output.status.success() && Path::new(path.trim()).exists()
    })
}

/// Debian's own compiler, which comes with the sources of the standard library.
fn debian_rustc() -> Option<PathBuf> {
    let candidate = PathBuf::from("/usr/bin/rustc");
    let sources = Path::new("/usr/lib/rustlib/src").exists()
        || Path::new("/usr/src")
            .read_dir()
            .ok()?
            .flatten()
            .any(|e| e.file_name().to_string_lossy().starts_with("rustc-"));
    (candidate.exists() && sources).then_some(candidate)
}

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
    command.arg("build").args(arguments).args(["--target", WASM]).arg("--target-dir").arg(&folder);
    if !has_target() {
        command.args(["-Z", "build-std=std,panic_abort"]);
    }
    ensure!(command.current_dir(root()).status()?.success(), "the build for wasm32 failed");
    Ok(folder.join(WASM))
}
