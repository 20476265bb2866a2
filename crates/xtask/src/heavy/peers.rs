//! `cargo xtask peers`: how many times as fast as `OpenCV` the maps are, with AVX2 and with all that the processor
//! has; a table for the README.

use std::process::{Command, Stdio};

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
    ensure!(tools::ready(&tools::PYTHON, true), "{} could not be installed", tools::PYTHON.name);
    let narrow = ours(Some("v3"))?;
    let peers = theirs()?;
    let wide = ours(None)?;
    println!("| one thread | OpenCV's | AVX2 | all there is |\n|---|---|---:|---:|");
    for (key, name, peer) in ROWS {
        let ratio = |ours: &Map<String, Value>| -> anyhow::Result<f64> {
            let of = |map: &Map<String, Value>| map.get(key).and_then(Value::as_f64).context(key);
            Ok(of(&peers)? / of(ours)?)
        };
        println!("| {name} | {peer} | {:.1} | {:.1} |", ratio(&narrow)?, ratio(&wide)?);
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

fn theirs() -> anyhow::Result<Map<String, Value>> {
    let python = crate::workspace::root().join("target/python-venv/bin/python");
    let script = crate::workspace::root().join("crates/calib-core/benches/peers.py");
    let output = Command::new(python).arg(script).stderr(Stdio::inherit()).output()?;
    ensure!(output.status.success(), "the peers could not be measured");
    Ok(serde_json::from_slice(&output.stdout)?)
}
