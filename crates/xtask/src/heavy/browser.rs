//! `cargo xtask browser`: tests of the web app in Chromium, both as served files and as one self-contained
//! page.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, ensure};

use crate::heavy::product::calib;
use crate::heavy::web;
use crate::server;
use crate::workspace::root;

// The page test and the benchmarks compute their medians with the same code.
#[path = "../../../calib-core/benches/measure/median.rs"]
mod median;

/// Folder of the installed npm packages that control the browser.
const NPM_FOLDER: &str = "target/browser";
/// Folder of the test scripts.
const SCRIPTS_FOLDER: &str = "crates/calib-app/tests/browser";

/// Returns the path of an installed Chromium or Chrome.
pub(crate) fn chromium() -> anyhow::Result<PathBuf> {
    ["/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"]
        .into_iter()
        .map(PathBuf::from)
        .find(|path| path.exists())
        .context("no Chromium: apt-get install chromium")
}

/// Builds the page into `out` unless `as_is` is set, serves the page, and runs a test script in the browser.
/// The script may save screenshots to the folder `pictures`.
pub(crate) fn run(out: &Path, script: &str, pictures: Option<&Path>, as_is: bool) -> anyhow::Result<()> {
    let mut node = script_command(out, script, pictures, as_is)?;
    eprintln!("building calib, which the tests compare with the page");
    node.env("CALIB", calib()?);
    if !cfg!(debug_assertions) {
        node.env("CALIB_NATIVE_MS", native_solve_ms().to_string());
    } else if let Some(list) = std::env::var_os("CALIB_SKIPPED_LIST") {
        let mut list = std::fs::OpenOptions::new().append(true).open(list)?;
        writeln!(list, "SKIPPED solve time in the browser: requires an optimised build")?;
    }
    ensure!(node.status()?.success(), "{script} failed");
    Ok(())
}

/// Runs a script that takes pictures of the page. The folder `demo` contains the images and the site of the
/// demonstration.
pub(crate) fn take_pictures(
    out: &Path,
    script: &str,
    pictures: &Path,
    demo: &Path,
    as_is: bool,
) -> anyhow::Result<()> {
    let mut node = script_command(out, script, Some(pictures), as_is)?;
    ensure!(node.env("CALIB_DEMO", demo).status()?.success(), "{script} failed");
    Ok(())
}

/// Builds the page into `out` unless `as_is` is set, serves it, and returns the command of a script that opens
/// it.
fn script_command(out: &Path, script: &str, pictures: Option<&Path>, as_is: bool) -> anyhow::Result<Command> {
    if !as_is {
        web::run(out, None)?;
    }
    let browser = chromium()?;
    let modules = root().join(NPM_FOLDER).join("node_modules");
    ensure!(
        modules.is_dir(),
        "no npm packages for the browser tests: mkdir -p {NPM_FOLDER} && cp {SCRIPTS_FOLDER}/package*.json {NPM_FOLDER} \
         && npm ci --prefix {NPM_FOLDER}"
    );
    let site = server::FolderServer::new(out, 0)?;
    let address = format!("http://{}/", site.address()?);
    std::thread::spawn(move || site.serve());
    let mut node = Command::new("node");
    node.arg(root().join(SCRIPTS_FOLDER).join(script)).arg(&address).arg(out.join("calib.html"));
    node.current_dir(root()).env("CALIB_CHROMIUM", browser).env("CALIB_NODE_MODULES", modules);
    if let Some(pictures) = pictures {
        std::fs::create_dir_all(pictures)?;
        node.env("CALIB_PICTURES", pictures);
    }
    Ok(node)
}

/// Measures the native solve time of the demonstration's first camera, in milliseconds. The test compares the solve
/// time in the browser with this time.
fn native_solve_ms() -> f64 {
    /// Number of measured solves.
    const RUNS: usize = 200;
    let site = calib_demo::demo_site().site;
    let cameras = site.cameras.first().map(|camera| vec![camera.id.clone()]);
    let options = calib_site::Options { refine: false, cameras, ..calib_site::Options::default() };
    1e3 * median::median(RUNS, || {
        std::hint::black_box(std::hint::black_box(&site).calibrate(&options));
    })
}
