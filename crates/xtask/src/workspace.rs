//! The workspace, and this program in it.

use std::path::Path;
use std::process::Command;

use anyhow::bail;

/// The folder of the workspace.
pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().and_then(Path::parent).unwrap_or(Path::new("."))
}

/// Runs what this program was asked for, built with all that it can do.
pub(crate) fn rerun(profile: &[&str]) -> anyhow::Result<()> {
    let command: Vec<String> = std::env::args().skip(1).collect();
    let mut cargo = Command::new("cargo");
    cargo.args(["run", "--quiet", "--package", "xtask", "--features", "all"]).args(profile);
    if !cargo.arg("--").args(&command).current_dir(root()).status()?.success() {
        bail!("{} failed", command.join(" "));
    }
    Ok(())
}
