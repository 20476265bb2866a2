//! Root folder of the workspace, and the restart of this program with all features.

use std::path::Path;
use std::process::Command;

use anyhow::bail;

/// Returns the root folder of the workspace.
pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().and_then(Path::parent).unwrap_or(Path::new("."))
}

/// Runs the same command again in a build of this program with all features.
pub(crate) fn rerun(profile: &[&str]) -> anyhow::Result<()> {
    let command: Vec<String> = std::env::args().skip(1).collect();
    let mut cargo = Command::new("cargo");
    cargo.args(["run", "--quiet", "--package", "xtask", "--features", "all"]).args(profile);
    if !cargo.arg("--").args(&command).current_dir(root()).status()?.success() {
        bail!("{} failed", command.join(" "));
    }
    Ok(())
}
