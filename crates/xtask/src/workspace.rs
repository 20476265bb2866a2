//! The workspace, and this program in it.

use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, bail};

/// The folder of the workspace.
pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().and_then(Path::parent).unwrap_or(Path::new("."))
}

/// Runs a command to its end; an error names it.
pub(crate) fn done(command: &mut Command) -> anyhow::Result<()> {
    let program = command.get_program().to_string_lossy().into_owned();
    let status = command.status().with_context(|| program.clone())?;
    if !status.success() {
        let arguments: Vec<_> = command.get_args().map(|argument| argument.to_string_lossy()).collect();
        bail!("{program} {} failed", arguments.join(" "));
    }
    Ok(())
}

/// Runs a command of this program built in another way.
pub(crate) fn rerun(build: &[&str], command: &[String]) -> anyhow::Result<()> {
    let mut cargo = Command::new("cargo");
    cargo.args(["run", "--quiet", "--package", "xtask"]).args(build).arg("--").args(command);
    if !cargo.current_dir(root()).status()?.success() {
        bail!("{} failed", command.join(" "));
    }
    Ok(())
}
