//! What builds for the browser: a compiler with the sources of its standard library, rustup's or Debian's own, so that the
//! library is built as small as the page wants it.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::workspace::root;

/// Whether there is a compiler for wasm32 that builds its library, too.
pub(crate) fn is_there() -> bool {
    has_sources() || debian_rustc().is_some()
}

/// Whether rustup's compiler has the sources of the standard library.
pub(crate) fn has_sources() -> bool {
    // Debian's own, which wants its own linker, has them, too.
    let of_rustup = printed(&["sysroot"]).filter(|root| root != "/usr");
    of_rustup.is_some_and(|root| Path::new(&root).join("lib/rustlib/src/rust/library").exists())
}

/// What the compiler answers where it is asked to print.
pub(crate) fn printed(what: &[&str]) -> Option<String> {
    let output = Command::new("rustc").arg("--print").args(what).current_dir(root()).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
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
