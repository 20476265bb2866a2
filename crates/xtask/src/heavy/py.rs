//! `cargo xtask py`: the Python wheel and its tests.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, ensure};
use serde_json::{Map, Value};

use crate::heavy::golden;
use crate::heavy::product::{build, calib, program_path, run_command};
use crate::tools;
use crate::workspace::root;

/// Virtual environment with the build tools and the packages for the tests.
const VENV: &str = "target/python-venv";
const CRATE: &str = "crates/calib-py";

/// Build profile with the shortest build time.
pub(crate) const QUICK: &str = "quick";

fn tool(name: &str) -> Command {
    let mut command = Command::new(root().join(VENV).join("bin").join(name));
    command.current_dir(root().join(CRATE));
    command
}

/// Builds the Python wheel with a build profile into a subfolder of `out`, and returns its path.
pub(crate) fn run(out: &Path, profile: &str) -> anyhow::Result<PathBuf> {
    ensure!(tools::is_ready(&tools::PYTHON, true), "{} could not be installed", tools::PYTHON.name);
    let wheels = out.join(profile);
    if wheels.exists() {
        fs::remove_dir_all(&wheels)?;
    }
    run_command(
        tool("maturin").args(["build", "--quiet", "--locked", "--profile", profile, "--out"]).arg(&wheels),
    )?;
    let wheel = wheel_in(&wheels)?;
    eprintln!("{}", wheel.display());
    Ok(wheel)
}

fn wheel_in(folder: &Path) -> anyhow::Result<PathBuf> {
    Ok(fs::read_dir(folder)?.next().context("maturin wrote no wheel")??.path())
}

/// Tests the adapter with the real Ultralytics package, which has its own virtual environment for `PyTorch`.
pub(crate) fn ultralytics(out: &Path, golden: &Path) -> anyhow::Result<()> {
    let python = || {
        let mut command = Command::new(root().join("target/ultralytics-venv/bin/python"));
        command.current_dir(root().join(CRATE)).arg("-m");
        command
    };
    let install = ["pip", "install", "--quiet", "--force-reinstall", "--no-deps"];
    run_command(python().args(install).arg(wheel_in(&out.join(QUICK))?))?;
    // Warnings of Ultralytics are not errors in this test.
    let test = ["pytest", "--quiet", "-W", "default", "tests/test_adapters.py", "-k", "ultralytics"];
    run_command(python().args(test).env("CALIB_GOLDEN", golden).env("CALIB_ULTRALYTICS", "1"))
}

/// Installs the wheel into the virtual environment, and checks its tests, types, metadata and linked
/// libraries.
pub(crate) fn test(wheel: &Path, golden: &Path) -> anyhow::Result<()> {
    golden::run(golden)?;
    demonstration(golden)?;
    run_command(
        tool("python").args(["-m", "pip", "install", "--quiet", "--force-reinstall", "--no-deps"]).arg(wheel),
    )?;
    let mut pytest = tool("python");
    run_command(pytest.args(["-m", "pytest", "--quiet"]).env("CALIB_GOLDEN", golden).env("CALIB", calib()?))?;
    run_command(tool("mypy").args([
        "--strict",
        "--no-error-summary",
        "python/calib",
        "examples",
        "tests/golden.py",
        "tests/test_adapters.py",
    ]))?;
    // The allow list contains names that exist only in the type stubs.
    run_command(tool("stubtest").args(["calib", "--allowlist", "tests/stubtest.txt"]))?;
    run_command(tool("twine").args(["check", "--strict"]).arg(wheel))?;
    if cfg!(target_os = "linux") {
        let shown = tool("auditwheel").arg("show").arg(wheel).output()?;
        let shown = String::from_utf8_lossy(&shown.stdout).into_owned();
        ensure!(
            shown.contains("manylinux") || shown.contains("musllinux"),
            "the wheel is not portable across Linux systems: {shown}"
        );
    }
    Ok(())
}

/// Creates the solved demonstration with its detections, and the tracks that the Rust example computes from
/// them.
fn demonstration(golden: &Path) -> anyhow::Result<()> {
    let demo = golden.join("demo");
    let calib = Command::new(calib()?).arg("demo").arg(&demo).output()?;
    ensure!(calib.status.success(), "{}", String::from_utf8_lossy(&calib.stderr));
    let examples = build(&["--package", "calib-site", "--example", "fuse_tracks"])?.join("examples");
    let mut tracker = Command::new(program_path(&examples, "fuse_tracks"));
    run_command(tracker.args(["solved.json", "detections.csv", "tracks.csv"].map(|name| demo.join(name))))
}

/// Builds the wheel with the release profile, installs it into its own folder, and returns that folder.
pub(crate) fn install_release() -> anyhow::Result<PathBuf> {
    ensure!(
        tools::is_ready(&tools::PYTHON, false),
        "{VENV} is missing; create it with `cargo xtask test --install`"
    );
    let wheel = run(&root().join("target/python"), "release")?;
    let packages = root().join("target/python-bench");
    let mut install = tool("python");
    install.args(["-m", "pip", "install", "--quiet", "--upgrade", "--no-deps", "--target"]).arg(&packages);
    run_command(install.arg(wheel))?;
    Ok(packages)
}

/// Measures the run times of the installed wheel and of `OpenCV` once, and returns them as a JSON
/// object.
pub(crate) fn measure(packages: &Path) -> anyhow::Result<Map<String, Value>> {
    let output = tool("python").arg("tests/bench.py").env("PYTHONPATH", packages).output()?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Ok(serde_json::from_slice(&output.stdout)?)
}
