//! Native builds of the workspace, and the paths of the built programs.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, bail, ensure};

use crate::check::WORKSPACE_IS_BUILT;
use crate::workspace::root;

/// Runs `cargo build` with these arguments in the profile of this program, unless [`WORKSPACE_IS_BUILT`] is set.
/// Returns the folder of that profile.
pub(crate) fn build(arguments: &[&str]) -> anyhow::Result<PathBuf> {
    if std::env::var_os(WORKSPACE_IS_BUILT).is_none() {
        let mut cargo = Command::new("cargo");
        cargo.args(["build", "--quiet"]).args(arguments).current_dir(root());
        if !cfg!(debug_assertions) {
            cargo.arg("--release");
        }
        ensure!(cargo.status()?.success(), "cargo build {} failed", arguments.join(" "));
    }
    profile_folder()
}

/// Returns the folder of this program's build profile.
pub(crate) fn profile_folder() -> anyhow::Result<PathBuf> {
    Ok(std::env::current_exe()?.parent().context("the path of this program has no folder")?.to_path_buf())
}

/// Returns the path of a program in a folder.
pub(crate) fn program_path(folder: &Path, name: &str) -> PathBuf {
    folder.join(name).with_extension(std::env::consts::EXE_EXTENSION)
}

/// Builds the command line tool and returns its path.
pub(crate) fn calib() -> anyhow::Result<PathBuf> {
    Ok(program_path(&build(&["--package", "calib-cli"])?, "calib"))
}

/// Runs a command and waits for it; the error contains the command line.
pub(crate) fn run_command(command: &mut Command) -> anyhow::Result<()> {
    let program = command.get_program().to_string_lossy().into_owned();
    let status = command.status().with_context(|| program.clone())?;
    if !status.success() {
        let arguments: Vec<_> = command.get_args().map(|argument| argument.to_string_lossy()).collect();
        bail!("{program} {} failed", arguments.join(" "));
    }
    Ok(())
}
