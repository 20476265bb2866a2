//! Benchmarks: one JSON object on stdout. Times are of one thread; quote ratios to the peers of one
//! run, never absolute times.

use std::process::{Command, Stdio};

use anyhow::{Context as _, bail};
use serde_json::{Map, Value, json};

use crate::heavy::{archives, py, weight};

/// Benchmarks that stand beside the code: package, program, and the keys of its JSON object. They are not
/// linked here, so that every other command of this one is built without a window.
const PROGRAMS: [(&str, &str, &[&str]); 5] = [
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
    ("calib-core", "single_fit", &["solve_option1_us", "solve_option2_us"]),
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
        ],
    ),
];

/// What `archives` measures in one run: ratios.
const ARCHIVES: [&str; 3] =
    ["project_time_over_duckdb", "project_processor_over_duckdb", "projection_share_of_project"];

/// What the wheel for Python measures beside `OpenCV` in one run: nanoseconds a point, microseconds a call, and
/// ratios.
const PYTHON: [&str; 11] = [
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

/// Builds something and measures it.
type Weigh = fn() -> anyhow::Result<f64>;

/// What programs weigh, in millions of bytes, and seconds of processor time from nothing.
const WEIGHTS: [(&str, Weigh); 5] = [
    ("calib_mb", || weight::of_program("calib-cli", "calib")),
    ("app_mb", || weight::of_program("calib-app", "calib-app")),
    ("page_mb_gz", weight::of_page),
    ("page_rest_mb_gz", weight::of_rest_of_page),
    ("demo_cold_cpu_s", weight::demo_from_nothing),
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
    if ARCHIVES.iter().any(|key| key.contains(filter)) {
        match archives::measure() {
            Ok(ratios) => {
                let values = [ratios.time, ratios.processor, ratios.projection];
                results.extend(ARCHIVES.map(str::to_owned).into_iter().zip(values.map(|value| json!(value))));
            }
            Err(error) => eprintln!("SKIPPED {}: {error:#}", ARCHIVES.join(", ")),
        }
    }
    if PYTHON.iter().any(|key| key.contains(filter)) {
        match python() {
            Ok(measured) => results.extend(measured.into_iter().filter(|(key, _)| key.contains(filter))),
            Err(error) => eprintln!("SKIPPED {}: {error:#}", PYTHON.join(", ")),
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

/// The wheel, and its times over those of the library without Python: the least of several rounds in which both
/// are measured one after the other, for other work on the machine only adds to a time.
fn python() -> anyhow::Result<Map<String, Value>> {
    const ROUNDS: usize = 5;
    let mut measured = Map::new();
    let packages = py::installed()?;
    for _ in 0..ROUNDS {
        least_of(&mut measured, py::measure(&packages)?);
        least_of(&mut measured, measure("calib-core", "floor_mapping", "pixel_to_floor_ns", None)?);
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
    measured.retain(|key, _| PYTHON.contains(&key.as_str()));
    Ok(measured)
}

/// Keeps the lesser of what was measured before and now.
fn least_of(before: &mut Map<String, Value>, now: Map<String, Value>) {
    for (key, value) in now {
        let is_less = |old: &Value| value.as_f64() < old.as_f64();
        if before.get(&key).is_none_or(is_less) {
            before.insert(key, value);
        }
    }
}

/// Runs one program, built for at most this level of vector instructions; what it prints is a JSON object.
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
        .with_context(|| format!("what {program} measured is no JSON object"))
}
