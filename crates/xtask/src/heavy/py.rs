//! `cargo xtask py`: the wheel for Python, and its tests.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, ensure};
use serde_json::{Map, Value};

use crate::heavy::golden;
use crate::heavy::product::{build, calib, done, program};
use crate::tools;
use crate::workspace::root;

/// Where its tools and what it is tried with are installed.
const VENV: &str = "target/python-venv";
const CRATE: &str = "crates/calib-py";

/// The profile that is quick to build.
pub(crate) const QUICK: &str = "quick";

fn tool(name: &str) -> Command {
    let mut command = Command::new(root().join(VENV).join("bin").join(name));
    command.current_dir(root().join(CRATE));
    command
}

/// Builds the wheel into `out`; where it is.
pub(crate) fn run(out: &Path, profile: &str) -> anyhow::Result<PathBuf> {
    ensure!(tools::ready(&tools::PYTHON, true), "{} could not be installed", tools::PYTHON.name);
    let wheels = out.join(profile);
    if wheels.exists() {
        fs::remove_dir_all(&wheels)?;
    }
    done(tool("maturin").args(["build", "--quiet", "--locked", "--profile", profile, "--out"]).arg(&wheels))?;
    let wheel = wheel_in(&wheels)?;
    eprintln!("{}", wheel.display());
    Ok(wheel)
}

fn wheel_in(folder: &Path) -> anyhow::Result<PathBuf> {
    Ok(fs::read_dir(folder)?.next().context("maturin made no wheel")??.path())
}

/// The test of the adapter with the real package, whose `PyTorch` is not among the other tools.
pub(crate) fn ultralytics(out: &Path, golden: &Path) -> anyhow::Result<()> {
    let python = || {
        let mut command = Command::new(root().join("target/ultralytics-venv/bin/python"));
        command.current_dir(root().join(CRATE)).arg("-m");
        command
    };
    let install = ["pip", "install", "--quiet", "--force-reinstall", "--no-deps"];
    done(python().args(install).arg(wheel_in(&out.join(QUICK))?))?;
    // Its warnings are its own.
    let test = ["pytest", "--quiet", "-W", "default", "tests/test_adapters.py", "-k", "ultralytics"];
    done(python().args(test).env("CALIB_GOLDEN", golden).env("CALIB_ULTRALYTICS", "1"))
}

/// Installs the wheel beside the tools, and checks it: its tests, its types, its metadata, what it links to.
pub(crate) fn test(wheel: &Path, golden: &Path) -> anyhow::Result<()> {
    golden::run(golden)?;
    demonstration(golden)?;
    done(
        tool("python").args(["-m", "pip", "install", "--quiet", "--force-reinstall", "--no-deps"]).arg(wheel),
    )?;
    let mut pytest = tool("python");
    done(pytest.args(["-m", "pytest", "--quiet"]).env("CALIB_GOLDEN", golden).env("CALIB", calib()?))?;
    done(tool("mypy").args([
        "--strict",
        "--no-error-summary",
        "python/calib",
        "examples",
        "tests/golden.py",
        "tests/test_adapters.py",
    ]))?;
    // Of names that only the types have.
    done(tool("stubtest").args(["calib", "--allowlist", "tests/stubtest.txt"]))?;
    done(tool("twine").args(["check", "--strict"]).arg(wheel))?;
    if cfg!(target_os = "linux") {
        let shown = tool("auditwheel").arg("show").arg(wheel).output()?;
        let shown = String::from_utf8_lossy(&shown.stdout).into_owned();
        ensure!(shown.contains("manylinux") || shown.contains("musllinux"), "for one system alone: {shown}");
    }
    Ok(())
}

/// The demonstration solved, its detections, and the tracks that the example in Rust makes of them.
fn demonstration(golden: &Path) -> anyhow::Result<()> {
    let demo = golden.join("demo");
    let calib = Command::new(calib()?).arg("demo").arg(&demo).output()?;
    ensure!(calib.status.success(), "{}", String::from_utf8_lossy(&calib.stderr));
    let examples = build(&["--package", "calib-site", "--example", "fuse_tracks"])?.join("examples");
    let mut tracker = Command::new(program(&examples, "fuse_tracks"));
    done(tracker.args(["solved.json", "detections.csv", "tracks.csv"].map(|name| demo.join(name))))
}

/// Builds the wheel as it is released, and installs it into the folder of packages that is returned.
pub(crate) fn installed() -> anyhow::Result<PathBuf> {
    ensure!(tools::ready(&tools::PYTHON, false), "{VENV} is absent; `cargo xtask test --install` makes it");
    let wheel = run(&root().join("target/python"), "release")?;
    let packages = root().join("target/python-bench");
    let mut install = tool("python");
    install.args(["-m", "pip", "install", "--quiet", "--upgrade", "--no-deps", "--target"]).arg(&packages);
    done(install.arg(wheel))?;
    Ok(packages)
}

/// One measurement of the wheel in these packages beside `OpenCV`: a JSON object.
pub(crate) fn measure(packages: &Path) -> anyhow::Result<Map<String, Value>> {
    let output = tool("python").arg("tests/bench.py").env("PYTHONPATH", packages).output()?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Ok(serde_json::from_slice(&output.stdout)?)
}
