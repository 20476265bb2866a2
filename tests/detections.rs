//! Tables of detections: no column is lost or changed silently, and every floor point has an uncertainty.

use std::collections::HashMap;
use std::process::Command;

use arrow_array::cast::AsArray as _;
use arrow_array::{Array as _, RecordBatch};
use arrow_schema::DataType;
use calib_core::{BrownConrady, Camera, Covariance, Distortion, Pixel, WorldPoint};
use calib_site::{CovarianceEntry, Georeference, Site, SiteCamera};
use calib_tests::{Scratch, entry, program};
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;

fn camera() -> Camera {
    let brown = BrownConrady { k1: -0.25, k2: 0.06, ..BrownConrady::default() };
    calib_tests::camera(Distortion::BrownConrady(brown))
}

fn scratch() -> Scratch {
    let scratch = Scratch::new();
    let site = Site { cameras: vec![entry("a", &camera())], ..Site::new() };
    scratch.write("site.json", site.to_json());
    scratch
}

const TO_FLOOR: [&str; 6] = ["project", "site.json", "--camera", "a", "--to", "floor"];

fn to_floor<'a>(more: &[&'a str]) -> Vec<&'a str> {
    TO_FLOOR.iter().chain(more).copied().collect()
}

/// Returns the cells of a table by column name.
fn rows(csv: &str) -> Vec<HashMap<&str, &str>> {
    let mut lines = csv.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    lines.map(|line| names.iter().copied().zip(line.split(',')).collect()).collect()
}

fn number(row: &HashMap<&str, &str>, name: &str) -> f64 {
    row[name].parse().unwrap_or_else(|_| panic!("{name} of {row:?}"))
}

fn read_parquet(scratch: &Scratch, name: &str) -> RecordBatch {
    let file = std::fs::File::open(scratch.path(name)).unwrap();
    let reader = ParquetRecordBatchReaderBuilder::try_new(file).unwrap().with_batch_size(1 << 20);
    let schema = reader.schema().clone();
    reader.build().unwrap().next().unwrap().unwrap().with_schema(schema).unwrap()
}

#[test]
fn existing_column_is_replaced_only_on_request() {
    let scratch = scratch();
    scratch.write("in.csv", "u,v,status\n900,700,mine\n");
    let run = scratch.calib(&to_floor(&["-i", "in.csv"])).expect_code(3);
    assert!(run.stdout.is_empty() && run.stderr.contains("in.csv: "), "{run:?}");
    assert!(
        run.stderr.contains("already has a column status") && run.stderr.contains("--replace"),
        "{run:?}"
    );
    let run = scratch.calib(&to_floor(&["-i", "in.csv", "--replace"])).expect_code(0);
    assert_eq!(rows(&run.stdout)[0]["status"], "ok");
}

#[test]
fn parquet_metadata_is_kept() {
    let scratch = scratch();
    scratch.write("in.csv", "u,v\n900,700\n");
    scratch.calib(&to_floor(&["-i", "in.csv", "-o", "first.parquet"])).expect_code(0);
    let batch = read_parquet(&scratch, "first.parquet").project(&[0, 1]).unwrap();
    let about = KeyValue::new("recorder".to_owned(), "gate 7".to_owned());
    let properties = WriterProperties::builder().set_key_value_metadata(Some(vec![about])).build();
    let file = std::fs::File::create(scratch.path("in.parquet")).unwrap();
    let mut writer = ArrowWriter::try_new(file, batch.schema(), Some(properties)).unwrap();
    writer.write(&batch).unwrap();
    writer.close().unwrap();
    scratch.calib(&to_floor(&["-i", "in.parquet", "-o", "out.parquet"])).expect_code(0);
    let out = read_parquet(&scratch, "out.parquet");
    let about = out.schema().metadata().clone();
    assert_eq!(about.get("recorder").map(String::as_str), Some("gate 7"), "{about:?}");
    assert!(about.contains_key("calib.site_sha256"), "{about:?}");
}

#[test]
fn csv_columns_get_types() {
    let scratch = scratch();
    let table: String =
        (0..70_000).map(|i| format!("{i},{}.5,700,00{i},{},walks\n", i % 1900, i % 2 == 0)).collect();
    scratch.write("in.csv", format!("frame,u,v,id,moves,note\n{table}"));
    scratch.calib(&to_floor(&["-i", "in.csv", "-o", "out.parquet"])).expect_code(0);
    let out = read_parquet(&scratch, "out.parquet");
    let kinds: Vec<DataType> = out.schema().fields().iter().map(|f| f.data_type().clone()).collect();
    use DataType::{Boolean, Float64, Int64, Utf8};
    assert_eq!(kinds, [Int64, Float64, Int64, Utf8, Boolean, Utf8, Float64, Float64, Utf8]);
    assert_eq!((out.num_rows(), out.column(3).as_string::<i32>().value(69_999)), (70_000, "0069999"));
    // In CSV, every cell is unchanged.
    let run = scratch.calib(&to_floor(&["-i", "in.csv"])).expect_code(0);
    assert!(run.stdout.contains("\n1,1.5,700,001,false,walks,"), "{}", &run.stdout[..200]);
    // A cell that contradicts the detected type stops the run; the message names the option that helps.
    scratch.write("late.csv", format!("frame,u,v,id,moves,note\n{table}x,1,2,3,true,late\n"));
    let run = scratch.calib(&to_floor(&["-i", "late.csv", "-o", "late.parquet"])).expect_code(3);
    assert!(run.stderr.contains("late.csv: line 70002, column frame: found \"x\""), "{run:?}");
    let args = ["-i", "late.csv", "-o", "late.parquet", "--as-text", "frame"];
    scratch.calib(&to_floor(&args)).expect_code(0);
    assert_eq!(read_parquet(&scratch, "late.parquet").column(0).data_type(), &Utf8);
    let run = scratch.calib(&to_floor(&["-i", "in.csv", "--as-text", "frames"])).expect_code(3);
    assert!(run.stderr.contains("frame,u,v"), "{run:?}");
}

#[test]
fn bad_cell_stops_the_run_or_gets_a_status() {
    let scratch = scratch();
    scratch.write("in.csv", "id,u,v\n1,900,700\n2,n/a,700\n3,,700\n4,901,700\n");
    let run = scratch.calib(&to_floor(&["-i", "in.csv"])).expect_code(3);
    assert!(run.stderr.contains("in.csv: line 3, column u: found \"n/a\""), "{run:?}");
    assert!(run.stderr.contains("--bad-rows status"), "{run:?}");
    for format in ["csv", "ndjson"] {
        let args = to_floor(&["-i", "in.csv", "--bad-rows", "status", "--format", format]);
        let run = scratch.calib(&args).expect_code(0);
        assert!(run.stderr.contains("1 cell is not a number or time"), "{run:?}");
        if format == "csv" {
            let status: Vec<&str> = rows(&run.stdout).iter().map(|row| row["status"]).collect();
            assert_eq!(status, ["ok", "missing", "missing", "ok"]);
            assert!(run.stdout.contains("\n2,n/a,700,,,missing\n"), "the cell is kept: {run:?}");
        }
    }
}

#[test]
fn incomplete_rows_stop_the_run_or_get_a_status() {
    let scratch = scratch();
    let mut table = b"id,u,v,note\n1,900,700,a\n2,900\n3,900,700,b,c\n4,900,700,\xff\n5,901,700,d\n".to_vec();
    scratch.write("in.csv", &table);
    let run = scratch.calib(&to_floor(&["-i", "in.csv"])).expect_code(3);
    assert!(run.stderr.contains("in.csv") && run.stderr.contains("--bad-rows status"), "{run:?}");
    let args = to_floor(&["-i", "in.csv", "--bad-rows", "status"]);
    let run = scratch.calib(&args).expect_code(0);
    assert!(run.stderr.contains("3 rows are incomplete"), "{run:?}");
    let status: Vec<&str> = rows(&run.stdout).iter().map(|row| row["status"]).collect();
    assert_eq!(status, ["ok", "missing", "missing", "missing", "ok"]);
    assert!(run.stdout.contains("\n2,900,,,,,missing\n"), "existing cells are kept: {run:?}");
    // With typed columns, the cells of a broken row may belong to other columns.
    scratch.calib(&[&args[..], &["-o", "out.parquet"]].concat()).expect_code(0);
    let back =
        scratch.calib(&to_floor(&["-i", "out.parquet", "--format", "csv", "--replace"])).expect_code(0);
    assert_eq!(rows(&back.stdout).len(), 5);
    table = b"{\"u\":900,\"v\":700}\n[1,2]\n{\"u\":900,\"v\":\n{\"u\":901,\"v\":700}\n".to_vec();
    scratch.write("in.ndjson", &table);
    let run = scratch.calib(&to_floor(&["-i", "in.ndjson"])).expect_code(3);
    assert!(run.stderr.contains("line 2") && run.stderr.contains("--bad-rows status"), "{run:?}");
    let run = scratch.calib(&to_floor(&["-i", "in.ndjson", "--bad-rows", "status"])).expect_code(0);
    let status: Vec<String> = run
        .stdout
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap()["status"].to_string())
        .collect();
    assert_eq!(status, ["\"ok\"", "\"missing\"", "\"missing\"", "\"ok\""]);
}

#[test]
fn unix_times_select_the_calibration() {
    let scratch = Scratch::new();
    let mut site = Site {
        cameras: vec![entry("a", &camera()), entry("a", &Camera { yaw: 0.7, ..camera() })],
        ..Site::new()
    };
    site.cameras[0].valid_to = Some("2026-06-01T00:00:00Z".into());
    site.cameras[1].valid_from = site.cameras[0].valid_to.clone();
    scratch.write("site.json", site.to_json());
    let mapped = |table: &str, more: &[&str]| {
        scratch.write("in.csv", table);
        scratch.calib(&to_floor(&[&["-i", "in.csv"], more].concat()))
    };
    let x = |csv: &str| rows(csv).iter().map(|row| number(row, "x_m")).collect::<Vec<f64>>();
    let text =
        mapped("t,u,v\n2026-05-31T23:59:59Z,900,700\n2026-06-01T00:00:00Z,900,700\n", &["--at-column", "t"]);
    let expected = x(&text.expect_code(0).stdout);
    assert!((expected[0] - expected[1]).abs() > 0.1);
    let seconds = "1780271999,900,700\n1780272000,900,700\n";
    let run = mapped(&format!("t,u,v\n{seconds}"), &["--at-column", "t", "--at-unit", "s"]);
    assert_eq!(x(&run.expect_code(0).stdout), expected);
    // The column name contains the unit.
    let run = mapped(&format!("t_s,u,v\n{seconds}"), &["--at-column", "t_s"]);
    assert_eq!(x(&run.expect_code(0).stdout), expected);
    let milliseconds = "1780271999999.5,900,700\n1780272000000,900,700\n";
    let run = mapped(&format!("t_ms,u,v\n{milliseconds}"), &["--at-column", "t_ms"]);
    assert_eq!(x(&run.expect_code(0).stdout), expected);
    let run = mapped(&format!("t,u,v\n{seconds}"), &["--at-column", "t"]).expect_code(3);
    assert!(run.stderr.contains("--at-unit"), "{run:?}");
    // The same with a typed column.
    scratch.write("in.csv", format!("t_s,u,v\n{seconds}"));
    let args = ["-i", "in.csv", "-o", "out.parquet", "--at-column", "t_s"];
    scratch.calib(&to_floor(&args)).expect_code(0);
    let run = scratch
        .calib(&to_floor(&["-i", "out.parquet", "--format", "csv", "--at-column", "t_s", "--replace"]))
        .expect_code(0);
    assert_eq!(x(&run.stdout), expected);
}

#[test]
fn stream_pixels_are_scaled_to_the_image() {
    let scratch = scratch();
    let run = |table: String, more: &[&str]| {
        scratch.write("in.csv", table);
        scratch.calib(&to_floor(&[&["-i", "in.csv"], more].concat()))
    };
    let (u, v) = (1203.0, 771.0);
    let still = run(format!("u,v\n{u},{v}\n"), &[]).expect_code(0);
    let still = ["x_m", "y_m"].map(|name| number(&rows(&still.stdout)[0], name));
    let same = |run: calib_tests::ProgramOutput| {
        let run = run.expect_code(0);
        let found = ["x_m", "y_m"].map(|name| number(&rows(&run.stdout)[0], name));
        let off = (found[0] - still[0]).hypot(found[1] - still[1]);
        assert!(off < 1e-9, "{off} m");
    };
    same(run(format!("u,v\n{},{}\n", u / 3.0, v / 3.0), &["--stream-size", "640x360"]));
    // Pixel coordinates with the origin at the centre of the first pixel of the stream.
    same(run(
        format!("u,v\n{},{}\n", u / 3.0 - 0.5, v / 3.0 - 0.5),
        &["--stream-size", "640x360", "--pixel-origin", "centre"],
    ));
    let letterbox = ["--stream-size", "640x640", "--stream-fit", "letterbox"];
    same(run(format!("u,v\n{},{}\n", u / 3.0, v / 3.0 + 140.0), &letterbox));
    // Boxes, with the middle of the lower edge as foot.
    same(run(format!("x,y,w,h\n{},{},10,20\n", u / 3.0 - 5.0, v / 3.0 + 120.0), &letterbox));
    let stretch = ["--stream-size", "640x640", "--stream-fit", "stretch"];
    same(run(format!("u,v\n{},{}\n", u / 3.0, v * 640.0 / 1080.0), &stretch));
    let refused = run(format!("u,v\n{u},{v}\n"), &["--stream-size", "640x640"]).expect_code(2);
    assert!(refused.stderr.contains("letterbox") && refused.stderr.contains("\"a\""), "{refused:?}");
    // The inverse mapping.
    scratch.write("floor.csv", format!("x_m,y_m\n{},{}\n", still[0], still[1]));
    let back = ["project", "site.json", "--camera", "a", "--to", "pixel", "-i", "floor.csv"];
    let back = scratch.calib(&[&back[..], &letterbox].concat()).expect_code(0);
    let row = &rows(&back.stdout)[0];
    let off = (number(row, "u") - u / 3.0).hypot(number(row, "v") - (v / 3.0 + 140.0));
    assert!(off < 1e-6, "{off} px");
}

#[test]
fn every_point_has_an_uncertainty() {
    let scratch = Scratch::new();
    let demo = calib_demo::demo_site();
    let solved = demo.site.calibrate(&calib_site::Options::default()).write_into(&demo.site);
    let entry = solved.cameras.iter().find(|entry| entry.camera().is_some()).unwrap();
    scratch.write(
        "site.json",
        Site {
            cameras: vec![SiteCamera { id: "a".into(), image: None, lens: None, ..entry.clone() }],
            ..Site::new()
        }
        .to_json(),
    );
    let [w, h] = entry.size();
    let (u, v) = (0.5 * w, 0.8 * h);
    scratch.write("in.csv", format!("u,v\n{u},{v}\n{u},-90000\n"));
    for (height, more) in [(0.0, &[][..]), (0.9, &["--height-m", "0.9"])] {
        let args = to_floor(&[&["-i", "in.csv", "--sigma-px", "2"], more].concat());
        let run = scratch.calib(&args).expect_code(0);
        let rows = rows(&run.stdout);
        let expected = entry.camera().unwrap().plane_covariance(Pixel::new(u, v), 2.0, height).unwrap();
        for (prefix, matrix) in [("", expected.pixel), ("calibration_", expected.calibration.unwrap())] {
            let [x, y] = [0, 1].map(|i: usize| matrix[i][i].sqrt());
            let near = |name: &str, value: f64| {
                let found = number(&rows[0], &format!("{prefix}{name}"));
                assert!(
                    (found - value).abs() < 1e-9 * value.abs().max(1e-3),
                    "{prefix}{name}: {found}, {value}"
                );
            };
            near("sigma_x_m", x);
            near("sigma_y_m", y);
            near("rho", matrix[0][1] / (x * y));
        }
        assert_eq!((rows[1]["status"], rows[1]["sigma_x_m"]), ("above-horizon", ""));
    }
    // One pixel of a stream of half the size is two pixels of the image.
    scratch.write("half.csv", format!("u,v\n{},{}\n", 0.5 * u, 0.5 * v));
    let half = format!("{}x{}", w / 2.0, h / 2.0);
    let args = to_floor(&["-i", "half.csv", "--sigma-px", "1", "--stream-size", &half]);
    let halved = scratch.calib(&args).expect_code(0);
    let whole = scratch.calib(&to_floor(&["-i", "in.csv", "--sigma-px", "2"])).expect_code(0);
    let [halved, whole] = [&halved, &whole].map(|run| number(&rows(&run.stdout)[0], "sigma_y_m"));
    assert!((halved / whole - 1.0).abs() < 1e-9, "{halved} {whole}");
}

#[test]
fn geographic_columns_agree_with_the_ellipsoid() {
    let scratch = scratch();
    scratch.write("in.csv", "u,v\n900,700\n900,-90000\n");
    let refused = scratch.calib(&to_floor(&["-i", "in.csv", "--geographic"])).expect_code(2);
    assert!(refused.stderr.contains("georeference"), "{}", refused.stderr);
    let mut site = Site { cameras: vec![entry("a", &camera())], ..Site::new() };
    // World +x points north, so +y points west.
    site.georeference =
        Some(Georeference { lat_deg: 52.0, lon_deg: 5.0, x_axis_azimuth_deg: 0.0, alt_m: None });
    scratch.write("site.json", site.to_json());
    let args = to_floor(&["-i", "in.csv", "--geographic", "--sigma-px", "1"]);
    let run = scratch.calib(&args).expect_code(0);
    let rows = rows(&run.stdout);
    let value = |name: &str| number(&rows[0], name);
    // At a latitude of 52 degrees, one degree of latitude is 111.267 km and one of longitude 68.678 km.
    let [north, east] = [(value("lat_deg") - 52.0) * 111_267.0, (value("lon_deg") - 5.0) * 68_678.0];
    assert!((north - value("x_m")).abs() < 1e-3 && (east + value("y_m")).abs() < 1e-3, "{north} {east}");
    assert!((value("sigma_north_m") - value("sigma_x_m")).abs() < 1e-12);
    assert!((value("sigma_east_m") - value("sigma_y_m")).abs() < 1e-12);
    assert_eq!((rows[1]["lat_deg"], rows[1]["sigma_east_m"]), ("", ""));
    assert_eq!(rows[0]["calibration_sigma_east_m"], "", "the uncertainty of the camera is unknown");
}

#[test]
fn unknown_calibration_uncertainty_is_empty() {
    let scratch = scratch();
    scratch.write("in.csv", "u,v\n900,700\n");
    let run = scratch.calib(&to_floor(&["-i", "in.csv", "--sigma-px", "1"])).expect_code(0);
    let row = &rows(&run.stdout)[0];
    assert!(number(row, "sigma_x_m") > 0.0, "{row:?}");
    assert_eq!(row["calibration_sigma_x_m"], "");
    for refused in [&["--to", "pixel", "--sigma-px", "1"][..], &["--to", "floor", "--sigma-px", "-1"]] {
        let args = [&["project", "site.json", "--camera", "a", "-i", "in.csv"][..], refused].concat();
        scratch.calib(&args).expect_code(2);
    }
}

#[test]
fn detections_of_the_demonstration_are_mapped() {
    let scratch = Scratch::new();
    scratch.calib(&["demo"]).expect_code(0);
    let project = ["project", "calib-demo/solved.json", "--to", "floor", "-i", "calib-demo/detections.csv"];
    for more in [&["--camera-column", "camera"][..], &["--camera-column", "camera", "--at-column", "at_s"]] {
        let run = scratch.calib(&[&project[..], more, &["--sigma-px", "1"]].concat()).expect_code(0);
        let rows = rows(&run.stdout);
        // Because of noise, a detection may be outside the image.
        let is_mapped = |status: &str| matches!(status, "ok" | "outside-efov" | "outside-image");
        let mapped = rows.iter().filter(|row| is_mapped(row["status"])).count();
        assert!(rows.len() > 100 && mapped == rows.len(), "{mapped} of {}: {}", rows.len(), run.stderr);
        assert!(run.stderr.is_empty(), "{}", run.stderr);
    }
}

#[cfg(unix)]
#[test]
fn closed_pipe_ends_the_run_quietly() {
    let scratch = scratch();
    let table: String = (0..200_000).map(|i| format!("{},700\n", i % 1900)).collect();
    scratch.write("in.csv", format!("u,v\n{table}"));
    for format in ["csv", "ndjson", "arrow", "arrow-file", "parquet"] {
        let shell = format!(
            "{{ {} {} -i in.csv --format {format}; echo ended $? >&2; }} | head -c 100 > /dev/null",
            program().display(),
            TO_FLOOR.join(" ")
        );
        let ended = Command::new("sh").args(["-c", &shell]).current_dir(scratch.path("")).output().unwrap();
        assert_eq!(String::from_utf8_lossy(&ended.stderr), "ended 0\n", "{format}");
    }
}

/// Returns a site with a platform 1 m high, a pit, and a ramp with a height known to 2 cm.
fn with_planes() -> (Site, Scratch) {
    let planes = serde_json::json!([
        {"id": "platform", "height_m": 1, "region": [[0, 4], [3, 4], [3, 7], [0, 7]]},
        {"id": "pit", "height_m": -1, "region": [[3, 4], [5, 4], [5, 7], [3, 7]]},
        {"id": "ramp", "height_m": {"value": 0.5, "sigma": 0.02},
            "tilt": {"toward_deg": 90, "fall_deg": 5}, "region": [[-6, 6], [-1, 6], [-1, 12], [-6, 12]]},
        {"id": "somewhere", "height_m": 3}
    ]);
    let scratch = scratch();
    let planes = serde_json::from_value(planes).unwrap();
    // A camera with a negligible but known uncertainty.
    let mut known = camera();
    known.covariance.0[Covariance::X][Covariance::X] = 1e-24;
    let mut entry = entry("a", &known);
    entry.solution.as_mut().unwrap().covariance = CovarianceEntry::from_camera(&known);
    let site = Site { cameras: vec![entry], planes, ..Site::new() };
    scratch.write("planes.json", site.to_json());
    (site, scratch)
}

const TO_PLANES: [&str; 6] = ["project", "planes.json", "--camera", "a", "--to", "floor"];

#[test]
fn pixel_is_mapped_to_the_first_plane_on_its_ray() {
    let (site, scratch) = with_planes();
    let surfaces = site.surfaces();
    let mut table = String::from("u,v\n");
    for v in (0..1080).step_by(40) {
        (0..1920).step_by(40).for_each(|u| table += &format!("{u},{v}\n"));
    }
    table += "0,\n";
    scratch.write("pixels.csv", &table);
    let args = [&TO_PLANES[..], &["-i", "pixels.csv", "--sigma-px", "0"]].concat();
    let run = scratch.calib(&args).expect_code(0);
    let header = run.stdout.lines().next().unwrap();
    assert!(header.starts_with("u,v,x_m,y_m,status,z_m,plane,sigma_x_m"), "{header}");
    let (known_badly, mut met) = (["ramp", "platform", "pit"], HashMap::new());
    for row in rows(&run.stdout).iter().filter(|row| row["status"] != "missing") {
        let pixel = Pixel::new(number(row, "u"), number(row, "v"));
        let shown = camera().pixel_to_surface(pixel, 0.0, &surfaces);
        let plane = shown.and_then(|shown| shown.surface).map_or("", |index| &site.planes[index].id);
        assert_eq!(row["plane"], plane, "{row:?}");
        *met.entry(if row["status"] == "on-wall" { "wall" } else { plane }).or_insert(0) += 1;
        let Some(shown) = shown else {
            assert!(["above-horizon", "on-wall", "outside-lens"].contains(&row["status"]), "{row:?}");
            assert!(row["x_m"].is_empty() && row["z_m"].is_empty());
            continue;
        };
        let found = WorldPoint::new(number(row, "x_m"), number(row, "y_m"), number(row, "z_m"));
        let range = shown.at.distance(camera().position);
        assert!(range > 1e3 || found.distance(shown.at) < 1e-6, "{row:?}");
        // The camera is exact, but planes are uncertain: the ramp in height, the others in tilt.
        let sigma = number(row, "calibration_sigma_x_m").hypot(number(row, "calibration_sigma_y_m"));
        assert_eq!(sigma > 1e-9, known_badly.contains(&plane), "{row:?}");
    }
    assert!(["", "platform", "pit", "ramp", "wall"].iter().all(|plane| met.contains_key(plane)), "{met:?}");
}

#[test]
fn plane_columns_exist_only_if_a_plane_has_a_region() {
    let (mut bare, scratch) = with_planes();
    bare.planes.iter_mut().for_each(|plane| plane.region.clear());
    scratch.write("bare.json", bare.to_json());
    scratch.write("pixels.csv", "u,v\n960,800\n100,900\n");
    let mapped = |site: &str| {
        let run = scratch.calib(&["project", site, "--camera", "a", "--to", "floor", "-i", "pixels.csv"]);
        run.expect_code(0).stdout
    };
    assert_eq!(mapped("bare.json"), mapped("site.json"), "as without planes, to the byte");
    assert!(mapped("planes.json").lines().next().unwrap().ends_with("status,z_m,plane"));
    // The same with typed columns in Parquet, and with a camera column.
    scratch.write("cameras.csv", "camera_id,u,v\na,960,800\nb,960,800\n");
    let args =
        ["project", "planes.json", "--camera-column", "camera_id", "--to", "floor", "-i", "cameras.csv"];
    scratch.calib(&[&args[..], &["-o", "mapped.parquet"]].concat()).expect_code(0);
    let batch = read_parquet(&scratch, "mapped.parquet");
    let schema = batch.schema();
    assert_eq!(schema.field_with_name("z_m").unwrap().data_type(), &DataType::Float64);
    assert_eq!(schema.field_with_name("plane").unwrap().data_type(), &DataType::Utf8);
    let heights = batch.column_by_name("z_m").unwrap();
    assert!(heights.is_valid(0) && heights.is_null(1), "camera b is unknown");
}
