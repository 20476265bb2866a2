//! Sizes of the programs, and the processor time of the demonstration in a clean checkout.

use std::fs;
use std::process::{Command, Stdio};

use anyhow::Context as _;

use crate::heavy::product::{build, program_path, run_command};
use crate::heavy::web;
use crate::workspace::root;

/// Returns the size of a stripped release program, in megabytes.
pub(crate) fn program_mb(package: &str, name: &str) -> anyhow::Result<f64> {
    let built = program_path(&build(&["--package", package])?, name);
    let stripped = built.with_extension("stripped");
    run_command(Command::new("strip").arg("-o").arg(&stripped).arg(&built))?;
    let bytes = fs::metadata(&stripped)?.len();
    fs::remove_file(&stripped)?;
    Ok(bytes as f64 / 1e6)
}

/// Returns the gzipped size of the first part of the web program, in megabytes. The browser fetches it before
/// the page is usable.
pub(crate) fn page_mb() -> anyhow::Result<f64> {
    Ok(web::gzipped_sizes()?[0] as f64 / 1e6)
}

/// Returns the gzipped size of the second part of the web program, in megabytes. The browser fetches it
/// later.
pub(crate) fn page_rest_mb() -> anyhow::Result<f64> {
    Ok(web::gzipped_sizes()?[1] as f64 / 1e6)
}

/// Returns the processor time of `cargo demo` in a clean checkout, in seconds.
pub(crate) fn cold_demo_cpu_s() -> anyhow::Result<f64> {
    let folder = root().join("target/cold");
    if folder.exists() {
        fs::remove_dir_all(&folder)?;
    }
    let before = child_cpu_s()?;
    let mut demo = Command::new("cargo");
    demo.arg("demo").arg(folder.join("demo")).stdout(Stdio::null()).current_dir(root());
    run_command(demo.env("CARGO_TARGET_DIR", folder.join("target")).env_remove("CARGO_INCREMENTAL"))?;
    let took = child_cpu_s()? - before;
    fs::remove_dir_all(&folder)?;
    Ok(took)
}

/// Returns the processor time of all finished child processes and their descendants, in seconds.
fn child_cpu_s() -> anyhow::Result<f64> {
    /// Clock ticks per second in Linux's process statistics.
    const TICKS_PER_SECOND: f64 = 100.0;
    let stat = fs::read_to_string("/proc/self/stat").context("processor time is only available on Linux")?;
    // The name of the process, in parentheses, may contain spaces. The times of child processes are fields 16
    // and 17 of the whole line.
    let behind = stat.rsplit(')').next().unwrap_or_default();
    let fields: Vec<f64> =
        behind.split_whitespace().skip(13).take(2).filter_map(|field| field.parse().ok()).collect();
    Ok(fields.iter().sum::<f64>() / TICKS_PER_SECOND)
}
