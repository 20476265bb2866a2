//! The SQL view in `DuckDB` maps an archive like `calib project`.

use std::fs::File;
use std::process::Command;
use std::sync::Arc;

use arrow_array::{ArrayRef, Float64Array, Int64Array, RecordBatch, StringArray, TimestampMicrosecondArray};
use calib_site::{Georeference, Site};
use calib_tests::{LENSES, Scratch, camera, engines_python, entry, root};
use parquet::arrow::ArrowWriter;
use parquet::file::properties::WriterProperties;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

/// Returns a site with camera a with five distortion coefficients, b without distortion, and c with the division
/// model.
fn site() -> Site {
    let cameras = ["a", "b", "c"].iter().zip(LENSES).map(|(id, distortion)| entry(id, &camera(distortion)));
    Site { cameras: cameras.collect(), ..Site::new() }
}

/// Writes detections of all cameras in small row groups, which several threads share.
fn write_detections(scratch: &Scratch, groups: usize, rows: usize) {
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let mut writer: Option<ArrowWriter<File>> = None;
    for group in 0..groups {
        let first = i64::try_from(group * rows).unwrap();
        let ids = first..first + i64::try_from(rows).unwrap();
        let mut number =
            |most: f64| (0..rows).map(|_| Some(random.random_range(0.0..most))).collect::<Float64Array>();
        let columns: Vec<(&str, ArrayRef)> = vec![
            ("id", Arc::new(Int64Array::from_iter_values(ids.clone()))),
            ("u", Arc::new(number(1920.0))),
            ("v", Arc::new(number(1080.0))),
            (
                "camera_id",
                Arc::new(
                    ids.clone().map(|i| Some(["a", "b", "c"][(i % 3) as usize])).collect::<StringArray>(),
                ),
            ),
            (
                "seen_at",
                Arc::new(
                    TimestampMicrosecondArray::from_iter_values(
                        ids.map(|i| 1_780_000_000_000_000 + 40_000 * i),
                    )
                    .with_timezone("UTC"),
                ),
            ),
        ];
        let batch = RecordBatch::try_from_iter(columns).unwrap();
        let properties = WriterProperties::builder().set_max_row_group_row_count(Some(rows)).build();
        let writer = writer.get_or_insert_with(|| {
            let file = File::create(scratch.path("detections.parquet")).unwrap();
            ArrowWriter::try_new(file, batch.schema(), Some(properties)).unwrap()
        });
        writer.write(&batch).unwrap();
    }
    writer.unwrap().close().unwrap();
}

/// Writes the site, its SQL view and detections, and maps them with the program. Returns the messages of the
/// export.
fn prepare(site: &Site, more: &[&str], groups: usize, rows: usize) -> (Scratch, String) {
    let scratch = Scratch::new();
    scratch.write("site.json", site.to_json());
    let run =
        scratch.calib(&["export", "sql", "site.json", "-o", "floor.sql", "--allow-lossy"]).expect_code(0);
    write_detections(&scratch, groups, rows);
    let args = [
        "project",
        "site.json",
        "--to",
        "floor",
        "--camera-column",
        "camera_id",
        "-i",
        "detections.parquet",
        "-o",
        "single.parquet",
    ];
    scratch.calib(&[&args[..], more].concat()).expect_code(0);
    (scratch, run.stderr)
}

fn python(script: &str, arguments: &[&str]) -> Option<Value> {
    let python = engines_python()?;
    let output =
        Command::new(python).arg(root().join("tests").join(script)).args(arguments).output().unwrap();
    let log = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{script}: {log}");
    let text = String::from_utf8_lossy(&output.stdout);
    Some(
        serde_json::from_str(text.lines().last().unwrap_or_default())
            .unwrap_or_else(|_| panic!("{text}\n{log}")),
    )
}

/// Returns the two stated errors of a fitted lens: in pixels, and in metres within the EFOV.
fn stated_error(stderr: &str) -> [f64; 2] {
    let (_, stated) = stderr.split_once("an error of at most ").unwrap();
    let before = |unit: &str| stated.split(unit).next().unwrap().rsplit(' ').next().unwrap().parse().unwrap();
    [before(" px"), before(" m ")]
}

#[test]
fn view_in_duckdb_is_exact_or_within_its_stated_error() {
    let georeference = Georeference { lat_deg: 48.0, lon_deg: 11.0, x_axis_azimuth_deg: 30.0, alt_m: None };
    let site = Site { georeference: Some(georeference), ..site() };
    let (scratch, messages) = prepare(&site, &["--geographic"], 2, 100_000);
    let Some(found) = python("engines_duckdb.py", &[&scratch.path("").to_string_lossy()]) else { return };
    for camera in ["b", "c"] {
        let row = &found[camera];
        assert_eq!(row["one_sided"], 0, "{row}");
        assert!(row["mapped"].as_u64().unwrap() > 50_000, "{row}");
        assert!(row["relative"].as_f64().unwrap() < 1e-9, "{row}");
        assert!(row["on_map_m"].as_f64().unwrap() < 0.01, "{row}");
    }
    // Between the sample points of the export, the error may be slightly larger.
    let ([pixels, metres], row) = (stated_error(&messages), &found["a"]);
    assert!(pixels > 1.0 && pixels < 20.0 && metres < 0.5, "{messages}");
    let off = row["in_efov_m"].as_f64().unwrap();
    assert!(off < 1.2 * metres && off > 0.2 * metres, "{off} m, stated {metres} m");
}

#[test]
fn view_uses_the_calibration_valid_at_the_time() {
    let mut site = site();
    let mut after = site.cameras[1].clone();
    after.solution.as_mut().unwrap().yaw_deg = Some(70.0);
    site.cameras[1].valid_to = Some("2026-05-28T21:30:00+01:00".into());
    after.valid_from.clone_from(&site.cameras[1].valid_to);
    site.cameras.push(after);
    // 3000 seconds, starting at 20:26:40.
    let (scratch, _) = prepare(&site, &["--at-column", "seen_at"], 1, 75_000);
    let Some(found) = python("engines_duckdb.py", &[&scratch.path("").to_string_lossy()]) else { return };
    assert_eq!(found["b"]["rows"], 25_000);
    assert!(found["b"]["relative"].as_f64().unwrap() < 1e-9, "{found}");
}

#[test]
fn duckdb_reads_the_exported_parquet_table() {
    let scratch = Scratch::new();
    scratch.write("site.json", site().to_json());
    for name in ["cameras.json", "cameras.parquet"] {
        scratch.calib(&["export", "table", "site.json", "-o", name]).expect_code(0);
    }
    let path = scratch.path("cameras.parquet");
    let Some(found) = python("engines_table.py", &[&path.to_string_lossy()]) else { return };
    let text = std::fs::read_to_string(scratch.path("cameras.json")).unwrap();
    let exported: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(found, exported["cameras"]);
    assert_eq!(found[0]["floor_from_undistorted_px"].as_array().unwrap().len(), 9);
}
