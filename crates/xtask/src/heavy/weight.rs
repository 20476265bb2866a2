//! What the programs weigh, and what the demonstration costs on a machine that has built nothing yet.

use std::fs;
use std::process::{Command, Stdio};

use anyhow::Context as _;

use crate::heavy::product::{build, done, program};
use crate::heavy::web;
use crate::workspace::root;

/// Millions of bytes of a program, built for release, without its symbols.
pub(crate) fn of_program(package: &str, name: &str) -> anyhow::Result<f64> {
    let built = program(&build(&["--package", package])?, name);
    let stripped = built.with_extension("stripped");
    done(Command::new("strip").arg("-o").arg(&stripped).arg(&built))?;
    let bytes = fs::metadata(&stripped)?.len();
    fs::remove_file(&stripped)?;
    Ok(bytes as f64 / 1e6)
}

/// Millions of bytes that a browser has to fetch for the program before the page can be worked with, gzipped.
pub(crate) fn of_page() -> anyhow::Result<f64> {
    Ok(web::weights()?[0] as f64 / 1e6)
}

/// Of those that it fetches then.
pub(crate) fn of_rest_of_page() -> anyhow::Result<f64> {
    Ok(web::weights()?[1] as f64 / 1e6)
}

/// Seconds of processor time of the README's first command with nothing built.
pub(crate) fn demo_from_nothing() -> anyhow::Result<f64> {
    let folder = root().join("target/cold");
    if folder.exists() {
        fs::remove_dir_all(&folder)?;
    }
    let before = of_children()?;
    let mut demo = Command::new("cargo");
    demo.arg("demo").arg(folder.join("demo")).stdout(Stdio::null()).current_dir(root());
    done(demo.env("CARGO_TARGET_DIR", folder.join("target")).env_remove("CARGO_INCREMENTAL"))?;
    let took = of_children()? - before;
    fs::remove_dir_all(&folder)?;
    Ok(took)
}

/// Seconds of processor time of all programs that this one has waited for, and of theirs.
fn of_children() -> anyhow::Result<f64> {
    /// As Linux counts for programs, on every processor.
    const TICKS_A_SECOND: f64 = 100.0;
    let stat = fs::read_to_string("/proc/self/stat").context("processor time is read as Linux has it")?;
    // The name, in parentheses, may have spaces; what children took are the 16th and 17th of all.
    let behind = stat.rsplit(')').next().unwrap_or_default();
    let fields: Vec<f64> =
        behind.split_whitespace().skip(13).take(2).filter_map(|field| field.parse().ok()).collect();
    Ok(fields.iter().sum::<f64>() / TICKS_A_SECOND)
}
