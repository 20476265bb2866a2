//! What builds for the browser: the installed target, or Debian's own compiler with the library's sources.

use std::path::{Path, PathBuf};
use std::process::Command;

pub(crate) const WASM: &str = "wasm32-unknown-unknown";

/// Whether there is a compiler for wasm32.
pub(crate) fn is_there() -> bool {
    has_target() || debian_rustc().is_some()
}

pub(crate) fn has_target() -> bool {
    let libraries = Command::new("rustc").args(["--print", "target-libdir", "--target", WASM]).output();
    libraries.is_ok_and(|output| {
        let path = String::from_utf8_lossy(&output.stdout);
        output.status.success() && Path::new(path.trim()).exists()
    })
}

/// Debian's own compiler, which comes with the sources of the standard library.
pub(crate) fn debian_rustc() -> Option<PathBuf> {
    let candidate = PathBuf::from("/usr/bin/rustc");
    let sources = Path::new("/usr/lib/rustlib/src").exists()
        || Path::new("/usr/src")
            .read_dir()
            .ok()?
            .flatten()
            .any(|e| e.file_name().to_string_lossy().starts_with("rustc-"));
    (candidate.exists() && sources).then_some(candidate)
}
