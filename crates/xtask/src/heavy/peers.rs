//! `cargo xtask peers`: how many times as fast as `OpenCV` the maps are, with AVX2 and with all that the processor
//! has, and as `SciPy` and `COLMAP` the joint fit is; tables for the README.

use std::process::Command;

use anyhow::{Context as _, ensure};
use serde_json::{Map, Value};

use crate::heavy::bench;
use crate::tools;

/// Keys of the benchmarks, what the table calls them, and the peer.
const ROWS: [(&str, &str, &str); 6] = [
    ("pixel_to_floor_ns", "pixels to the floor", "`perspectiveTransform`"),
    ("distorted_pixel_to_floor_ns", "pixels of a bent lens to the floor", "`undistortPoints` alone"),
    ("world_to_pixel_ns", "points of space to pixels", "`projectPoints`, with its Jacobian"),
    ("distorted_world_to_pixel_ns", "the same, of a bent lens", "`projectPoints`, with its Jacobian"),
    ("undistort_1080p_ms", "an image without its bend", "`undistort`"),
    ("undistort_1080p_cached_ms", "the same, with a map that is kept", "`remap`"),
];

/// Measures the peers between our two runs, and prints the table.
pub(crate) fn run() -> anyhow::Result<()> {
    ensure!(tools::ready(&tools::PEERS, true), "{} could not be installed", tools::PEERS.name);
    let narrow = ours(Some("v3"))?;
    let peers = theirs("peers.py", &[])?;
    let wide = ours(None)?;
    println!("| one thread | OpenCV's | AVX2 | all there is |\n|---|---|---:|---:|");
    for (key, name, peer) in ROWS {
        let ratio = |ours: &Map<String, Value>| -> anyhow::Result<f64> {
            let of = |map: &Map<String, Value>| map.get(key).and_then(Value::as_f64).context(key);
            Ok(of(&peers)? / of(ours)?)
        };
        println!("| {name} | {peer} | {:.1} | {:.1} |", ratio(&narrow)?, ratio(&wide)?);
    }
    joint()
}

/// The joint fit beside those of the peers, which only fit: ours makes all of every camera by itself first, finds where
/// to start and says how sure it is.
fn joint() -> anyhow::Result<()> {
    println!("\n| one thread | SciPy's `least_squares` | COLMAP's bundle adjustment |\n|---|---:|---:|");
    for (name, key, sides, packages) in [
        ("a hundred cameras", "refine_100_cameras_ms", ["10", "10"], &["scipy", "colmap"][..]),
        ("a thousand cameras", "refine_1000_cameras_ms", ["40", "25"], &["colmap"]),
    ] {
        let ours = bench::measure("calib-site", "bundle_adjustment", key, None)?;
        let ours = ours.get(key).and_then(Value::as_f64).context(key)?;
        let mut arguments = sides.to_vec();
        arguments.extend(packages);
        let peers = theirs("joint_peers.py", &arguments)?;
        let ratio = |peer: &str| {
            let theirs = peers.get(&format!("{peer}_ms")).and_then(Value::as_f64);
            theirs.map_or("\u{2014}".to_owned(), |theirs| format!("{:.1}", theirs / ours))
        };
        println!("| {name} | {} | {} |", ratio("scipy"), ratio("colmap"));
    }
    Ok(())
}

/// What the benchmarks of the core measure, built for at most this level of vector instructions.
fn ours(level: Option<&str>) -> anyhow::Result<Map<String, Value>> {
    let mut all = Map::new();
    for program in ["floor_mapping", "undistortion"] {
        all.extend(bench::measure("calib-core", program, "", level)?);
    }
    Ok(all)
}

/// What a script of the peers prints on its last line.
fn theirs(script: &str, arguments: &[&str]) -> anyhow::Result<Map<String, Value>> {
    let python = crate::workspace::root().join("target/peers-venv/bin/python");
    let script = crate::workspace::root().join("crates/calib-core/benches").join(script);
    let mut peers = Command::new(python);
    peers.arg(script).args(arguments).env("OMP_NUM_THREADS", "1").env("OPENBLAS_NUM_THREADS", "1");
    let output = peers.output()?;
    // COLMAP says much of how it goes.
    let said = String::from_utf8_lossy(&output.stderr);
    said.lines().filter(|line| line.starts_with("SKIPPED")).for_each(|line| eprintln!("{line}"));
    ensure!(output.status.success(), "the peers could not be measured:\n{said}");
    let last = output.stdout.trim_ascii_end().rsplit(|&byte| byte == b'\n').next().unwrap_or_default();
    Ok(serde_json::from_slice(last)?)
}
