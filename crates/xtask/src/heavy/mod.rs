//! Commands with large dependencies; they are compiled only with the feature `all`.
//!
//! - `product`, `wasm_build`: builds for this machine and for wasm32
//! - `accuracy`, `coverage`: accuracy tables on simulated and on real data
//! - `golden`: points that all language bindings must reproduce bit for bit
//! - `py`, `c`, `js`: packages for Python, C and JavaScript
//! - `demo_images`, `split`, `web`: the web app
//! - `archives`, `weight`, `bench`, `peers`: benchmarks
//! - `browser`: tests of the web app in Chromium
//! - `pictures`: pictures of the README and of the guide

// In dependency order: a module uses only modules listed above it.
mod product;
mod wasm_build;
mod accuracy;
mod coverage;
mod archives;
mod golden;
mod py;
mod c;
mod demo_images;
mod split;
mod web;
mod weight;
mod bench;
mod peers;
mod browser;
mod pictures;
mod js;

use std::path::PathBuf;

use crate::Heavy;
use crate::workspace::{rerun, root};

/// Returns the folder of the golden points, which the tests of the bindings read.
fn points() -> PathBuf {
    root().join("target/golden")
}

/// Runs a command of this module.
pub(crate) fn run(command: Heavy) -> anyhow::Result<()> {
    match command {
        // Timings of an unoptimised build are misleading.
        Heavy::Bench { .. } if cfg!(debug_assertions) => rerun(&["--release"]),
        Heavy::Bench { filter, .. } => bench::run(&filter),
        Heavy::Peers => peers::run(),
        Heavy::Web { out, built } => web::run(&root().join(out), built.as_deref()),
        Heavy::Browser { out, script, pictures, as_is } => {
            let pictures = pictures.map(|folder| root().join(folder));
            browser::run(&root().join(out), &script, pictures.as_deref(), as_is)
        }
        Heavy::Pictures { out, as_is } => pictures::run(&root().join(out), as_is),
        Heavy::Js { out, test } => {
            let out = root().join(out);
            js::run(&out)?;
            if test { js::test(&out, &points()) } else { Ok(()) }
        }
        Heavy::Py { out, ultralytics: true, .. } => py::ultralytics(&root().join(out), &points()),
        Heavy::Py { out, test, .. } => {
            let wheel = py::run(&root().join(out), if test { py::QUICK } else { "release" })?;
            if test { py::test(&wheel, &points()) } else { Ok(()) }
        }
        Heavy::C { test: true, .. } => c::test(&points()),
        Heavy::C { out, test: false } => c::run(&root().join(out)),
        Heavy::Golden { out } => golden::run(&root().join(out)),
        Heavy::Accuracy { real: true, .. } => coverage::run(),
        Heavy::Accuracy { proposals: true, .. } => accuracy::automatic_calibration(),
        Heavy::Accuracy { compare: true, .. } => accuracy::compare(),
        Heavy::Accuracy { watch: true, .. } => accuracy::watch(),
        Heavy::Accuracy { scenes, draws, .. } => {
            accuracy::run(&accuracy::Extent { scenes, draws });
            Ok(())
        }
    }
}
