//! What the workspace builds for this machine, and where it lies.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, bail, ensure};

use crate::check::IS_BUILT;
use crate::workspace::root;

/// Builds what the arguments say in the profile of this program; the folder of that profile.
pub(crate) fn build(arguments: &[&str]) -> anyhow::Result<PathBuf> {
    if std::env::var_os(IS_BUILT).is_none() {
        let mut cargo = Command::new("cargo");
        cargo.args(["build", "--quiet"]).args(arguments).current_dir(root());
        if !cfg!(debug_assertions) {
            cargo.arg("--release");
        }
        ensure!(cargo.status()?.success(), "{} does not build", arguments.join(" "));
    }
    profile()
}

/// The folder that this program was built into.
pub(crate) fn profile() -> anyhow::Result<PathBuf> {
    Ok(std::env::current_exe()?.parent().context("a program in no folder")?.to_path_buf())
}

/// A program by its name in a folder.
pub(crate) fn program(folder: &Path, name: &str) -> PathBuf {
    folder.join(name).with_extension(std::env::consts::EXE_EXTENSION)
}

/// The command line tool.
pub(crate) fn calib() -> anyhow::Result<PathBuf> {
    Ok(program(&build(&["--package", "calib-cli"])?, "calib"))
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
