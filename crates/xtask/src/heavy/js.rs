//! `cargo xtask js`: the JavaScript package, and its tests in Node and in Chromium.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, ensure};
use serde_json::json;
use wasm_bindgen_cli_support::Bindgen;

use crate::heavy::browser;
use crate::heavy::golden;
use crate::heavy::product::calib;
use crate::heavy::wasm_build;
use crate::workspace::root;

/// Writes the package into `out`.
pub(crate) fn run(out: &Path) -> anyhow::Result<()> {
    let folder = wasm_build::build(&["--package", "calib-js", "--lib", "--profile", "web"])?;
    if out.exists() {
        fs::remove_dir_all(out).with_context(|| out.display().to_string())?;
    }
    fs::create_dir_all(out)?;
    Bindgen::new()
        .input_path(folder.join("web/calib_js.wasm"))
        .out_name("calib")
        .web(true)?
        .typescript(true)
        // Without an argument, the initialiser fetches the WebAssembly file next to the script.
        .omit_default_module_path(false)
        .remove_name_section(true)
        .remove_producers_section(true)
        .generate(out)?;
    let package = json!({
        "name": "calib",
        "version": env!("CARGO_PKG_VERSION"),
        "description": "Camera calibration, and mapping between pixels and floor coordinates",
        "license": env!("CARGO_PKG_LICENSE"),
        "type": "module",
        "main": "calib.js",
        "types": "calib.d.ts",
        "sideEffects": false,
    });
    fs::write(out.join("package.json"), format!("{package:#}\n"))?;
    for name in
        ["LICENSE-MIT", "LICENSE-APACHE", "crates/calib-js/README.md", "crates/calib-js/THIRD-PARTY.txt"]
    {
        let from = root().join(name);
        let to = out.join(from.file_name().unwrap_or_default());
        fs::copy(&from, to).with_context(|| name.to_owned())?;
    }
    println!("{}", out.display());
    Ok(())
}

/// Checks the types of the tests and runs them. In Node the package is compared with the command line; in
/// Chromium its numbers are checked.
pub(crate) fn test(out: &Path, golden: &Path) -> anyhow::Result<()> {
    let tools = root().join("target/browser/node_modules");
    ensure!(tools.exists(), "target/browser is missing; create it with `cargo xtask test --install`");
    let mut compile = Command::new("node");
    compile.arg(tools.join("typescript/bin/tsc")).args(["--project", "crates/calib-js/tests"]);
    ensure!(
        compile.current_dir(root()).status()?.success(),
        "the types of the package do not match its tests"
    );
    golden::run(golden)?;
    let mut run = Command::new("node");
    run.arg("target/js-test/package.mjs").arg(out).arg(calib()?).arg(golden).current_dir(root());
    ensure!(run.status()?.success(), "the test of the package failed");
    let mut pack = Command::new("npm");
    ensure!(
        pack.args(["pack", "--dry-run", "--silent"]).current_dir(out).status()?.success(),
        "npm cannot pack the package"
    );
    let mut page = Command::new("node");
    page.arg("target/js-test/browser.mjs").arg(out).arg("target/js-test").arg(golden).current_dir(root());
    page.env("CALIB_CHROMIUM", browser::chromium()?).env("CALIB_NODE_MODULES", tools);
    ensure!(page.status()?.success(), "the test of the package in Chromium failed");
    Ok(())
}
