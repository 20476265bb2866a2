//! `cargo xtask py`: the wheel for Python, and its tests.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, ensure};

use crate::golden;
use crate::workspace::{done, root};

/// Where its tools and what it is tried with are installed.
const VENV: &str = "target/python-venv";
const CRATE: &str = "crates/calib-py";

fn tool(name: &str) -> Command {
    let mut command = Command::new(root().join(VENV).join("bin").join(name));
    command.current_dir(root().join(CRATE)).env("PYTHONWARNDEFAULTENCODING", "0");
    command
}

/// Builds the wheel into `out`; where it is.
pub(crate) fn run(out: &Path, profile: &str) -> anyhow::Result<PathBuf> {
    let wheels = out.join(profile);
    if wheels.exists() {
        fs::remove_dir_all(&wheels)?;
    }
    done(tool("maturin").args(["build", "--quiet", "--locked", "--profile", profile, "--out"]).arg(&wheels))?;
    let wheel = fs::read_dir(&wheels)?.next().context("maturin made no wheel")??.path();
    println!("{}", wheel.display());
    Ok(wheel)
}

/// Installs the wheel beside the tools, and checks it: its tests, its types, its metadata, what it links to.
pub(crate) fn test(wheel: &Path, golden: &Path) -> anyhow::Result<()> {
    golden::run(golden)?;
    demonstration(golden)?;
    done(
        tool("python").args(["-m", "pip", "install", "--quiet", "--force-reinstall", "--no-deps"]).arg(wheel),
    )?;
    done(tool("python").args(["-m", "pytest", "--quiet"]).env("CALIB_GOLDEN", golden))?;
    done(tool("mypy").args([
        "--strict",
        "--no-error-summary",
        "python/calib",
        "examples",
        "tests/golden.py",
    ]))?;
    // Of names that only the types have.
    done(tool("stubtest").args(["calib", "--allowlist", "tests/stubtest.txt"]))?;
    done(tool("twine").args(["check", "--strict"]).arg(wheel))?;
    if cfg!(target_os = "linux") {
        done(tool("auditwheel").arg("show").arg(wheel))?;
    }
    Ok(())
}

/// The demonstration solved, its detections, and the tracks that the example in Rust makes of them.
fn demonstration(golden: &Path) -> anyhow::Result<()> {
    let demo = golden.join("demo");
    let cargo = |arguments: &[&str]| {
        let mut cargo = Command::new("cargo");
        cargo.args(["run", "--quiet"]).args(arguments).current_dir(root());
        cargo
    };
    let calib = cargo(&["--package", "calib-cli", "--", "demo"]).arg(&demo).output()?;
    ensure!(calib.status.success(), "{}", String::from_utf8_lossy(&calib.stderr));
    let mut tracker = cargo(&["--package", "calib-core", "--example", "fuse_tracks", "--"]);
    done(tracker.args(["solved.json", "detections.csv", "tracks.csv"].map(|name| demo.join(name))))
}
