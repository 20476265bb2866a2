//! `cargo xtask bench`: benchmarks, printed as one JSON object on stdout.
//!
//! All times are measured on one thread. Quote ratios to the peers within one run, never absolute times.

use std::process::{Command, Stdio};

use anyhow::{Context as _, bail};
use serde_json::{Map, Value, json};

use crate::heavy::{archives, py, weight};

/// Benchmark programs of other crates: package, program, and keys of the JSON object.
///
/// They are separate programs, so that the other commands of this crate build without a window system.
const PROGRAMS: [(&str, &str, &[&str]); 6] = [
    (
        "calib-core",
        "coverage",
        &["coverage_100_cameras_s", "coverage_100_distorted_cameras_s", "hand_overs_100_cameras_s"],
    ),
    (
        "calib-core",
        "floor_mapping",
        &[
            "pixel_to_floor_ns",
            "distorted_pixel_to_floor_ns",
            "world_to_pixel_ns",
            "distorted_world_to_pixel_ns",
            "floor_covariance_ns",
            "distorted_floor_covariance_ns",
        ],
    ),
    ("calib-core", "undistortion", &["undistort_1080p_ms", "undistort_1080p_cached_ms"]),
    (
        "calib-core",
        "single_fit",
        &["solve_option1_us", "solve_option2_us", "solve_4_points_us", "solve_20_points_us"],
    ),
    (
        "calib-site",
        "bundle_adjustment",
        &["refine_100_cameras_ms", "refine_1000_cameras_ms", "refine_10000_cameras_s"],
    ),
    (
        "calib-app",
        "frame",
        &[
            "app_frame_16_cameras_ms",
            "app_frame_16_cameras_worst_ms",
            "app_drag_solve_ms",
            "app_drag_edge_ms",
            "app_drag_fisheye_edge_ms",
            "app_pan_12_megapixels_ms",
            "app_plan_wheel_40_cameras_ms",
            "app_drag_coverage_ms",
        ],
    ),
];

/// JSON keys of the ratios that the module `archives` measures in one run.
const ARCHIVE_KEYS: [&str; 3] =
    ["project_time_over_duckdb", "project_processor_over_duckdb", "projection_share_of_project"];

/// JSON keys of the measurements of the Python wheel and `OpenCV` in one run: nanoseconds per point,
/// microseconds per call, and ratios.
const PYTHON_KEYS: [&str; 11] = [
    "python_to_floor_ns",
    "python_to_floor_with_status_ns",
    "python_to_floor_new_arrays_ns",
    "python_distorted_to_floor_ns",
    "python_undistort_ns",
    "perspective_transform_over_to_floor",
    "undistort_points_over_undistort",
    "python_single_us",
    "python_single_distorted_us",
    "python_over_rust",
    "python_over_rust_distorted",
];

/// Function that builds a program and returns its measured size or time.
type Measurement = fn() -> anyhow::Result<f64>;

/// JSON keys and functions of further measurements: program sizes in megabytes, and the processor time of a
/// clean build in seconds.
const WEIGHTS: [(&str, Measurement); 5] = [
    ("calib_mb", || weight::program_mb("calib-cli", "calib")),
    ("app_mb", || weight::program_mb("calib-app", "calib-app")),
    ("page_mb_gz", weight::page_mb),
    ("page_rest_mb_gz", weight::page_rest_mb),
    ("demo_cold_cpu_s", weight::cold_demo_cpu_s),
];

/// Runs all benchmarks whose key contains `filter`.
pub(crate) fn run(filter: &str) -> anyhow::Result<()> {
    let mut results = Map::new();
    for (package, program, keys) in PROGRAMS {
        if keys.iter().any(|key| key.contains(filter)) {
            let measured = measure(package, program, filter, None)?;
            results.extend(measured.into_iter().filter(|(key, _)| key.contains(filter)));
        }
    }
    if ARCHIVE_KEYS.iter().any(|key| key.contains(filter)) {
        match archives::measure() {
            Ok(ratios) => {
                let values = [ratios.time, ratios.processor, ratios.projection];
                results.extend(
                    ARCHIVE_KEYS.map(str::to_owned).into_iter().zip(values.map(|value| json!(value))),
                );
            }
            Err(error) => eprintln!("SKIPPED {}: {error:#}", ARCHIVE_KEYS.join(", ")),
        }
    }
    if PYTHON_KEYS.iter().any(|key| key.contains(filter)) {
        match python() {
            Ok(measured) => results.extend(measured.into_iter().filter(|(key, _)| key.contains(filter))),
            Err(error) => eprintln!("SKIPPED {}: {error:#}", PYTHON_KEYS.join(", ")),
        }
    }
    for (key, measure) in WEIGHTS.iter().filter(|(key, _)| key.contains(filter)) {
        match measure() {
            Ok(measured) => _ = results.insert((*key).to_owned(), json!(measured)),
            Err(error) => eprintln!("SKIPPED {key}: {error:#}"),
        }
    }
    println!("{}", Value::Object(results));
    Ok(())
}

/// Measures the Python wheel, and its times relative to the Rust library.
///
/// Each value is the minimum over several rounds, because other work on the machine only adds time. Every
/// round measures the wheel and the Rust library one after the other.
fn python() -> anyhow::Result<Map<String, Value>> {
    /// Number of rounds.
    const ROUNDS: usize = 5;
    let mut measured = Map::new();
    let packages = py::install_release()?;
    for _ in 0..ROUNDS {
        keep_minimum(&mut measured, py::measure(&packages)?);
        keep_minimum(&mut measured, measure("calib-core", "floor_mapping", "pixel_to_floor_ns", None)?);
    }
    for (ratio, over, under) in [
        ("python_over_rust", "python_to_floor_ns", "pixel_to_floor_ns"),
        ("python_over_rust_distorted", "python_distorted_to_floor_ns", "distorted_pixel_to_floor_ns"),
        ("perspective_transform_over_to_floor", "perspective_transform_ns", "python_to_floor_ns"),
        ("undistort_points_over_undistort", "undistort_points_ns", "python_undistort_ns"),
    ] {
        let [over, under] = [over, under].map(|key| measured[key].as_f64().unwrap_or(f64::NAN));
        measured.insert(ratio.to_owned(), json!(over / under));
    }
    measured.retain(|key, _| PYTHON_KEYS.contains(&key.as_str()));
    Ok(measured)
}

/// Merges `now` into `before` and keeps the smaller value of each key.
fn keep_minimum(before: &mut Map<String, Value>, now: Map<String, Value>) {
    for (key, value) in now {
        let is_less = |old: &Value| value.as_f64() < old.as_f64();
        if before.get(&key).is_none_or(is_less) {
            before.insert(key, value);
        }
    }
}

/// Runs one benchmark program and parses the JSON object that it prints.
///
/// `level` limits the vector instructions that the program uses.
pub(crate) fn measure(
    package: &str,
    program: &str,
    filter: &str,
    level: Option<&str>,
) -> anyhow::Result<Map<String, Value>> {
    let arguments = ["bench", "--quiet", "--package", package, "--bench", program, "--", filter];
    let mut cargo = Command::new("cargo");
    cargo.args(arguments).envs(level.map(|level| ("CALIB_SIMD", level)));
    let output = cargo.stderr(Stdio::inherit()).output()?;
    if !output.status.success() {
        bail!("cargo {} failed", arguments.join(" "));
    }
    serde_json::from_slice(&output.stdout)
        .with_context(|| format!("the output of {program} is not a JSON object"))
}
