//! `cargo xtask peers`: speed relative to other libraries, as tables for the guide.
//!
//! The mapping functions are compared with `OpenCV`, limited to AVX2 and with all instructions of the
//! processor. The joint refinement is compared with `SciPy` and `COLMAP`.

use std::process::Command;

use anyhow::{Context as _, ensure};
use serde_json::{Map, Value};

use crate::heavy::bench;
use crate::tools;

/// Table entries: key of our benchmark, label in the table, and function of the peer with which the benchmark is
/// compared.
const ROWS: [(&str, &str, &str); 6] = [
    ("pixel_to_floor_ns", "pixels to floor", "`perspectiveTransform`"),
    ("distorted_pixel_to_floor_ns", "distorted pixels to floor", "`undistortPoints` alone"),
    ("world_to_pixel_ns", "world points to pixels", "`projectPoints`, with its Jacobian"),
    ("distorted_world_to_pixel_ns", "world points to distorted pixels", "`projectPoints`, with its Jacobian"),
    ("undistort_1080p_ms", "undistorting an image", "`undistort`"),
    ("undistort_1080p_cached_ms", "undistorting an image with a cached map", "`remap`"),
];

/// Measures the other libraries between two runs of our own benchmarks, and prints the tables.
pub(crate) fn run() -> anyhow::Result<()> {
    ensure!(tools::is_ready(&tools::PEERS, true), "{} could not be installed", tools::PEERS.name);
    let narrow = our_results(Some("v3"))?;
    let peers = peer_results("peers.py", &[])?;
    let wide = our_results(None)?;
    println!("| one thread | OpenCV function | AVX2 | all instructions |\n|---|---|---:|---:|");
    for (key, name, peer) in ROWS {
        let ratio = |ours: &Map<String, Value>| -> anyhow::Result<f64> {
            let of = |map: &Map<String, Value>| map.get(key).and_then(Value::as_f64).context(key);
            Ok(of(&peers)? / of(ours)?)
        };
        println!("| {name} | {peer} | {:.1} | {:.1} |", ratio(&narrow)?, ratio(&wide)?);
    }
    joint()
}

/// Compares the time of the joint refinement with `SciPy` and `COLMAP`, and prints the table.
///
/// The other libraries only refine given start values. Our time also includes the solve of every single
/// camera, the initial poses and the covariances.
fn joint() -> anyhow::Result<()> {
    println!("\n| one thread | SciPy's `least_squares` | COLMAP's bundle adjustment |\n|---|---:|---:|");
    for (name, key, sides, packages) in [
        ("100 cameras", "refine_100_cameras_ms", ["10", "10"], &["scipy", "colmap"][..]),
        ("1000 cameras", "refine_1000_cameras_ms", ["40", "25"], &["colmap"]),
    ] {
        let ours = bench::measure("calib-site", "bundle_adjustment", key, None)?;
        let ours = ours.get(key).and_then(Value::as_f64).context(key)?;
        let mut arguments = sides.to_vec();
        arguments.extend(packages);
        let peers = peer_results("joint_peers.py", &arguments)?;
        let ratio = |peer: &str| {
            let theirs = peers.get(&format!("{peer}_ms")).and_then(Value::as_f64);
            theirs.map_or("\u{2014}".to_owned(), |theirs| format!("{:.1}", theirs / ours))
        };
        println!("| {name} | {} | {} |", ratio("scipy"), ratio("colmap"));
    }
    Ok(())
}

/// Runs the benchmarks of the core with vector instructions limited to `level`.
fn our_results(level: Option<&str>) -> anyhow::Result<Map<String, Value>> {
    let mut all = Map::new();
    for program in ["floor_mapping", "undistortion"] {
        all.extend(bench::measure("calib-core", program, "", level)?);
    }
    Ok(all)
}

/// Runs a benchmark script of the peers and parses the JSON object on its last line.
fn peer_results(script: &str, arguments: &[&str]) -> anyhow::Result<Map<String, Value>> {
    let python = crate::workspace::root().join("target/peers-venv/bin/python");
    let script = crate::workspace::root().join("crates/calib-core/benches").join(script);
    let mut peers = Command::new(python);
    peers.arg(script).args(arguments).env("OMP_NUM_THREADS", "1").env("OPENBLAS_NUM_THREADS", "1");
    let output = peers.output()?;
    // COLMAP logs its progress; only skipped peers are printed.
    let said = String::from_utf8_lossy(&output.stderr);
    said.lines().filter(|line| line.starts_with("SKIPPED")).for_each(|line| eprintln!("{line}"));
    ensure!(output.status.success(), "the peers could not be measured:\n{said}");
    let last = output.stdout.trim_ascii_end().rsplit(|&byte| byte == b'\n').next().unwrap_or_default();
    Ok(serde_json::from_slice(last)?)
}
