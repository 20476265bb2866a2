//! `cargo xtask docs`: the guide, the API documentation, the schema and the web app, as one folder.

use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, bail, ensure};

use crate::tools;
use crate::workspace::root;

const MDBOOK: tools::Tool = tools::Tool {
    name: "mdBook",
    is_installed: || tools::runs("target/tools/bin/mdbook", &["--version"]),
    install: &[&["cargo", "install", "--quiet", "--locked", "--root", "target/tools", "mdbook@0.5.4"]],
};

/// Writes the documentation into `out`.
pub(crate) fn run(out: &Path) -> anyhow::Result<()> {
    if !tools::is_ready(&MDBOOK, true) {
        bail!("mdBook could not be installed");
    }
    run_command(
        Command::new(root().join("target/tools/bin/mdbook")).args(["build", "docs", "--dest-dir"]).arg(out),
    )?;
    let api = ["doc", "--workspace", "--exclude", "xtask", "--exclude", "calib-tests", "--no-deps", "--lib"];
    run_command(Command::new("cargo").args(api))?;
    copy_folder(&root().join("target/doc"), &out.join("api"))?;
    let schema = ["run", "--quiet", "--package", "calib-cli", "--no-default-features", "--", "schema"];
    let written = Command::new("cargo").args(schema).current_dir(root()).output()?;
    ensure!(written.status.success(), "{}", String::from_utf8_lossy(&written.stderr));
    std::fs::write(out.join("site.schema.json"), written.stdout)?;
    let page = root().join("target/web");
    if page.join("index.html").exists() {
        copy_folder(&page, &out.join("app"))?;
    } else {
        println!("the page is missing: run cargo xtask web first to include it");
    }
    println!("wrote {}: index.html, api/calib_core/index.html, site.schema.json", out.display());
    Ok(())
}

/// Runs a command in the workspace.
fn run_command(command: &mut Command) -> anyhow::Result<()> {
    let name = format!("{command:?}");
    let status = command.current_dir(root()).status().with_context(|| name.clone())?;
    ensure!(status.success(), "{name} failed");
    Ok(())
}

/// Copies a folder with its subfolders, and replaces files of the same name.
fn copy_folder(from: &Path, to: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(to)?;
    for entry in std::fs::read_dir(from)? {
        let entry = entry?;
        let copy = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            copy_folder(&entry.path(), &copy)?;
        } else {
            std::fs::copy(entry.path(), copy)?;
        }
    }
    Ok(())
}
