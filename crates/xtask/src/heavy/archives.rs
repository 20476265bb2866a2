//! Speed of `calib project` relative to `DuckDB`, on the same archive with the same codec and one thread
//! each.

use std::hint::black_box;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::{Context as _, ensure};
use calib_core::{Camera, Covariance, Distortion, Extent, FloorProjector, Lens, Pixel, Status, WorldPoint};
use calib_site::{Method, Site, SiteCamera, Solution, Stage};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

use crate::heavy::product::calib;
use crate::workspace::root;

/// Path of the Python interpreter with `DuckDB`, relative to the workspace.
const PYTHON: &str = "target/engines-venv/bin/python";
/// Number of rows of the archive.
const ROWS: usize = 5_000_000;

/// Ratios of times measured in one run.
pub(crate) struct Ratios {
    /// Elapsed time of calib, divided by the elapsed time of `DuckDB`.
    pub(crate) time: f64,
    /// Processor time of calib, divided by the processor time of `DuckDB`.
    pub(crate) processor: f64,
    /// Processor time of the projection alone, divided by the total processor time of calib.
    pub(crate) projection: f64,
}

/// Runs calib and `DuckDB` and returns the ratios; the error names a missing tool.
pub(crate) fn measure() -> anyhow::Result<Ratios> {
    let python = root().join(PYTHON);
    ensure!(python.exists(), "{PYTHON} is missing; create it with `cargo xtask test --install`");
    let calib = calib()?;
    let folder = root().join("target/bench-archives");
    std::fs::create_dir_all(&folder)?;
    let entries: Vec<(Camera, SiteCamera)> = (0..3).map(entry).collect();
    let cameras = entries.iter().map(|(_, entry)| entry.clone()).collect();
    std::fs::write(folder.join("site.json"), Site { cameras, ..Site::new() }.to_json())?;
    let export = ["export", "sql", "site.json", "-o", "floor.sql", "--force"];
    let export = Command::new(&calib).args(export).current_dir(&folder).stderr(Stdio::null()).status()?;
    ensure!(export.success(), "calib export sql failed");
    let found = compare(&python, &calib, &folder)?;
    let seconds = |key: &str| found[key].as_f64().with_context(|| key.to_owned());
    Ok(Ratios {
        time: seconds("calib_s")? / seconds("duckdb_s")?,
        processor: seconds("calib_cpu_s")? / seconds("duckdb_cpu_s")?,
        projection: project(&entries) / seconds("calib_cpu_s")?,
    })
}

fn compare(python: &Path, calib: &Path, folder: &Path) -> anyhow::Result<Value> {
    let script = root().join("crates/xtask/project_peer.py");
    let output = Command::new(python).arg(script).arg(calib).arg(folder).arg(ROWS.to_string()).output()?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Ok(serde_json::from_slice(&output.stdout)?)
}

/// Creates a camera that SQL maps exactly: number 0 without distortion, the others with the division model.
fn entry(index: u32) -> (Camera, SiteCamera) {
    let distortion =
        if index == 0 { Distortion::None } else { Distortion::Division { lambda: -0.06 * f64::from(index) } };
    let focal = 1250.0;
    let camera = Camera {
        position: WorldPoint::new(3.0 * f64::from(index), -4.0, 5.0),
        yaw: 0.3,
        pitch: 0.5,
        roll: 0.05,
        focal,
        lens: Lens {
            principal_point: Pixel::new(957.0, 548.0),
            focal,
            pixel_aspect: 1.0,
            distortion,
            image_circle: None,
        },
        covariance: Covariance::EXACT,
    };
    let solution = Solution::from_camera(&camera, Method::Given, Stage::Placed);
    let entry =
        SiteCamera { solution: Some(solution), ..SiteCamera::new(format!("camera {index}"), [1920, 1080]) };
    (camera, entry)
}

/// Returns the time for projecting `ROWS` pixels with their status, batch by batch, in seconds.
fn project(entries: &[(Camera, SiteCamera)]) -> f64 {
    /// Number of pixels of a batch.
    const BATCH: usize = 8192;
    let mut random = ChaCha8Rng::seed_from_u64(0);
    let mut pixels = |most: f64| -> Vec<f64> { (0..BATCH).map(|_| random.random_range(0.0..most)).collect() };
    let (u, v) = (pixels(1920.0), pixels(1080.0));
    let (mut x, mut y, mut status) = (vec![0.0; BATCH], vec![0.0; BATCH], vec![Status::Ok; BATCH]);
    let start = Instant::now();
    for (camera, entry) in entries {
        let efov = entry.floor_polygon();
        let extent = Extent { size: entry.size(), efov: &efov };
        let projector = FloorProjector::new(camera, 0.0);
        for _ in 0..ROWS / BATCH / entries.len() {
            let pixels = [black_box(&u[..]), black_box(&v[..])];
            projector.pixels_to_floor_within(&extent, pixels, [&mut x, &mut y], &mut status);
            black_box((&x, &y, &status));
        }
    }
    start.elapsed().as_secs_f64()
}
