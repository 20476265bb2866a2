//! Tables of any size: all formats and column types, selection by camera and time, and complete output or
//! none.

use std::collections::HashMap;
use std::fs::File;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;

use arrow_array::cast::AsArray as _;
use arrow_array::types::{Float64Type, Int8Type, Int32Type};
use arrow_array::{
    Array, ArrayRef, DictionaryArray, Float32Array, Float64Array, Int64Array, ListArray, RecordBatch,
    StringArray, TimestampMillisecondArray,
};
use arrow_ipc::CompressionType;
use arrow_ipc::reader::{FileReader, StreamReader};
use arrow_ipc::writer::{FileWriter, IpcWriteOptions, StreamWriter};
use arrow_schema::Schema;
use calib_core::{Camera, Pixel, WorldPoint};
use calib_site::Site;
use calib_tests::{LENSES, Scratch, entry, program};
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde_json::json;

fn camera(index: usize) -> Camera {
    let camera = calib_tests::camera(LENSES[index % 3]);
    let position = WorldPoint { x: 3.0 + index as f64, ..camera.position };
    Camera { position, yaw: 0.3 * index as f64, ..camera }
}

/// Returns a site with the cameras a, b and c, which have the lenses of `LENSES`.
fn site() -> Site {
    let cameras = ["a", "b", "c"].iter().enumerate().map(|(i, id)| entry(id, &camera(i))).collect();
    Site { cameras, ..Site::new() }
}

fn scratch(site: &Site) -> Scratch {
    let scratch = Scratch::new();
    scratch.write("site.json", site.to_json());
    scratch
}

fn pixels(count: usize) -> Vec<Pixel> {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    (0..count)
        .map(|_| Pixel::new(random.random_range(-200.0..2100.0), random.random_range(-300.0..1300.0)))
        .collect()
}

fn csv_of(pixels: &[Pixel]) -> String {
    let rows: String = pixels.iter().enumerate().map(|(i, p)| format!("{i},{},{}\n", p.u, p.v)).collect();
    format!("id,u,v\n{rows}")
}

fn write_parquet(path: &Path, batch: &RecordBatch) {
    let mut writer = ArrowWriter::try_new(File::create(path).unwrap(), batch.schema(), None).unwrap();
    writer.write(batch).unwrap();
    writer.close().unwrap();
}

fn read_parquet(path: &Path) -> (Arc<Schema>, RecordBatch) {
    let builder = ParquetRecordBatchReaderBuilder::try_new(File::open(path).unwrap()).unwrap();
    let schema = Arc::clone(builder.schema());
    let batches: Vec<RecordBatch> = builder.build().unwrap().map(Result::unwrap).collect();
    let batch = arrow_select::concat::concat_batches(&batches[0].schema(), &batches).unwrap();
    (schema, batch)
}

const PROJECT: [&str; 4] = ["project", "site.json", "--to", "floor"];

fn project<'a>(more: &[&'a str]) -> Vec<&'a str> {
    PROJECT.iter().chain(more).copied().collect()
}

#[test]
fn every_format_contains_the_same_rows() {
    let scratch = scratch(&site());
    let pixels = pixels(20_000);
    scratch.write("in.csv", csv_of(&pixels));
    let run = |more: &[&str]| scratch.calib(&project(more)).expect_code(0);
    let direct = run(&["--camera", "a", "--input", "in.csv"]).stdout;
    let mut from = "in.csv".to_owned();
    for name in
        ["t.parquet", "t.arrow", "t.arrows", "t.ndjson", "t2.parquet", "t3.ndjson", "t4.arrows", "t5.csv"]
    {
        run(&["--camera", "a", "--replace", "-i", &from, "-o", name]);
        from = name.to_owned();
    }
    assert_eq!(std::fs::read_to_string(scratch.path("t5.csv")).unwrap(), direct);
    let (camera, mut seen) = (camera(0), HashMap::new());
    for (line, pixel) in direct.lines().skip(1).zip(&pixels) {
        let cells: Vec<&str> = line.split(',').collect();
        *seen.entry(cells[5].to_owned()).or_insert(0) += 1;
        match camera.pixel_to_floor(*pixel, 0.0) {
            Some(floor) => {
                let off = (cells[3].parse::<f64>().unwrap() - floor.x)
                    .hypot(cells[4].parse::<f64>().unwrap() - floor.y);
                assert!(
                    off < 1e-9 * (1.0 + floor.distance(camera.position.on_floor()).powi(2)),
                    "{off} m: {line}"
                );
            }
            None => assert_eq!((cells[3], cells[4]), ("", ""), "{line}"),
        }
    }
    for status in ["ok", "above-horizon", "outside-efov", "outside-image"] {
        assert!(seen.get(status).is_some_and(|&count| count > 50), "{seen:?}");
    }
}

/// Returns a table with a column of every type.
fn mixed_table(rows: usize) -> RecordBatch {
    let pixels = pixels(rows);
    let whole = |i: usize| i64::try_from(i).unwrap();
    let list = ListArray::from_iter_primitive::<Int32Type, _, _>(
        (0..rows).map(|i| (i % 5 != 0).then(|| vec![Some(i as i32), None, Some(7)])),
    );
    let kinds: DictionaryArray<Int8Type> =
        (0..rows).map(|i| Some(["person", "cart", "dog"][i % 3])).collect();
    let seen =
        TimestampMillisecondArray::from_iter_values((0..rows).map(|i| 1_780_000_000_000 + 60_000 * whole(i)));
    let columns: Vec<(&str, ArrayRef)> = vec![
        ("frame", Arc::new(Int64Array::from_iter_values((0..rows).map(whole)))),
        (
            "camera_id",
            Arc::new((0..rows).map(|i| Some(["a", "b", "c", "nobody"][i % 4])).collect::<StringArray>()),
        ),
        (
            "u",
            Arc::new(pixels.iter().map(|p| (p.u > -180.0).then_some(p.u as f32)).collect::<Float32Array>()),
        ),
        ("v", Arc::new(Float64Array::from_iter_values(pixels.iter().map(|p| p.v)))),
        ("kind", Arc::new(kinds)),
        ("trail", Arc::new(list)),
        ("seen_at", Arc::new(seen.with_timezone("Europe/Berlin"))),
        ("score", Arc::new(Float64Array::from_iter((0..rows).map(|i| (i % 7 != 0).then(|| 1.0 / i as f64))))),
    ];
    RecordBatch::try_from_iter_with_nullable(columns.into_iter().map(|(name, column)| (name, column, true)))
        .unwrap()
}

#[test]
fn other_columns_keep_their_types_and_every_row_uses_its_camera() {
    let scratch = scratch(&site());
    let batch = mixed_table(30_000);
    write_parquet(&scratch.path("in.parquet"), &batch);
    let mut writer =
        FileWriter::try_new(File::create(scratch.path("in.arrow")).unwrap(), &batch.schema()).unwrap();
    writer.write(&batch).unwrap();
    writer.finish().unwrap();
    for (input, output) in
        [("in.parquet", "out.parquet"), ("in.arrow", "out.arrow"), ("in.arrow", "out.arrows")]
    {
        let run = scratch
            .calib(&project(&["--camera-column", "camera_id", "-i", input, "-o", output]))
            .expect_code(0);
        assert!(run.stderr.contains("7500 rows of camera \"nobody\""), "{}", run.stderr);
        let open = || File::open(scratch.path(output)).unwrap();
        let all = |batches: Vec<RecordBatch>| {
            arrow_select::concat::concat_batches(&batches[0].schema(), &batches).unwrap()
        };
        let (about, out) = match output {
            "out.parquet" => {
                let (schema, out) = read_parquet(&scratch.path(output));
                (schema.metadata().clone(), out)
            }
            "out.arrow" => {
                let reader = FileReader::try_new(open(), None).unwrap();
                (reader.schema().metadata().clone(), all(reader.map(Result::unwrap).collect()))
            }
            _ => {
                let reader = StreamReader::try_new(open(), None).unwrap();
                (reader.schema().metadata().clone(), all(reader.map(Result::unwrap).collect()))
            }
        };
        for (index, field) in batch.schema().fields().iter().enumerate() {
            assert_eq!(out.schema().field(index).data_type(), field.data_type(), "{output}");
            assert_eq!(out.column(index), batch.column(index), "{output}: {}", field.name());
        }
        assert_metadata(&scratch, &about);
        assert_mapped(&batch, &out, 1e-9);
    }
}

fn assert_metadata(scratch: &Scratch, about: &HashMap<String, String>) {
    let output = Command::new("sha256sum").arg(scratch.path("site.json")).output().unwrap();
    let sum = String::from_utf8(output.stdout).unwrap();
    assert_eq!(about["calib.site_sha256"], sum[..64]);
    let list: serde_json::Value = serde_json::from_str(&about["calib.calibrations"]).unwrap();
    assert_eq!(list[1], json!({"camera": "b", "valid_from": null, "valid_to": null}));
}

fn assert_mapped(batch: &RecordBatch, out: &RecordBatch, slack: f64) {
    let number = |name: &str, row: usize| {
        let column = out.column_by_name(name).unwrap().as_primitive::<Float64Type>();
        column.is_valid(row).then(|| column.value(row))
    };
    let status = out.column_by_name("status").unwrap().as_string::<i32>();
    let u = batch.column(2).as_any().downcast_ref::<Float32Array>().unwrap();
    let v = batch.column(3).as_primitive::<Float64Type>();
    let (mut missing, mut mapped) = (0, 0);
    for row in 0..batch.num_rows() {
        let found = number("x_m", row).zip(number("y_m", row));
        if row % 4 == 3 && u.is_valid(row) {
            assert_eq!((status.value(row), found), ("no-calibration", None));
        } else if row % 4 != 3 && u.is_null(row) {
            missing += 1;
            assert_eq!((status.value(row), found), ("missing", None));
        } else if row % 4 != 3 {
            let pixel = Pixel::new(f64::from(u.value(row)), v.value(row));
            let camera = camera(row % 4);
            let exact = camera.pixel_to_floor(pixel, 0.0);
            assert_eq!(exact.is_some(), found.is_some(), "{pixel:?}");
            if let (Some(exact), Some((x, y))) = (exact, found) {
                mapped += 1;
                let range = exact.distance(camera.position.on_floor());
                assert!((x - exact.x).hypot(y - exact.y) < slack * (1.0 + range * range));
            }
        }
    }
    assert!(missing > 100 && mapped > 5000, "{missing} missing, {mapped} mapped");
}

#[test]
fn boxes_of_every_form_have_the_same_feet() {
    let scratch = scratch(&site());
    let image = site().cameras.iter().find(|camera| camera.id == "b").unwrap().size();
    let boxes = [[900.0, 500.0, 40.0, 120.0], [100.0, 400.0, 60.0, 200.0]];
    let table = |header: &str, row: &dyn Fn([f64; 4]) -> [f64; 4]| {
        let rows = boxes.map(|one| row(one).map(|number| number.to_string()).join(","));
        format!("{header}\n{}\n", rows.join("\n"))
    };
    let floor = |text: &str, more: &[&str]| -> Vec<[f64; 2]> {
        let out = scratch.calib_with(&project(&[&["--camera", "b"], more].concat()), text).expect_code(0);
        let number = |row: &str, from_end: usize| row.split(',').nth_back(from_end).unwrap().parse().unwrap();
        out.stdout.lines().skip(1).map(|row| [number(row, 2), number(row, 1)]).collect()
    };
    let plain = floor(&table("x,y,w,h", &|one| one), &[]);
    let same = |found: Vec<[f64; 2]>| {
        for (a, b) in found.into_iter().flatten().zip(plain.iter().flatten()) {
            assert!((a - b).abs() < 1e-6, "{a} {b}");
        }
    };
    let corners = |[x, y, w, h]: [f64; 4]| [x, y, x + w, y + h];
    let centre = |[x, y, w, h]: [f64; 4]| [x + 0.5 * w, y + 0.5 * h, w, h];
    let fractions = |[a, b, c, d]: [f64; 4]| [a / image[0], b / image[1], c / image[0], d / image[1]];
    same(floor(&table("x1,y1,x2,y2", &corners), &[]));
    same(floor(&table("XMin,YMin,XMax,YMax", &corners), &[]));
    same(floor(&table("x,y,w,h", &corners), &["--box-form", "xyxy"]));
    same(floor(&table("left,top,width,height", &|one| one), &[]));
    same(floor(&table("cx,cy,w,h", &centre), &[]));
    same(floor(&table("x,y,w,h", &centre), &["--box-form", "cxcywh"]));
    same(floor(&table("x,y,w,h", &|one| fractions(centre(one))), &["--box-form", "yolo"]));
    let centres = ["--box-form", "yolo", "--pixel-origin", "centre"];
    same(floor(&table("x,y,w,h", &|one| fractions(centre(one))), &centres));
    let size = format!("{}x{}", image[0] / 2.0, image[1] / 2.0);
    same(floor(&table("x,y,w,h", &fractions), &["--box-form", "xywh", "--stream-size", &size]));
    let refused = |text: &str, advice: &str| {
        let out = scratch.calib_with(&project(&["--camera", "b"]), text).expect_code(3);
        assert!(out.stderr.contains(advice), "{}", out.stderr);
    };
    refused(&table("x,y,w,h", &fractions), "--box-form yolo");
    let right = |[x, y, w, h]: [f64; 4]| corners([0.5 * x, 0.5 * y, w + 1000.0, h + 500.0]);
    refused(&table("x,y,w,h", &right), "--box-form xyxy");
    refused("x,y\n1,2\n", "x1,y1,x2,y2");
}

#[test]
fn tables_of_spreadsheets_are_read() {
    let scratch = scratch(&site());
    let floor = |name: &str, bytes: &[u8]| {
        scratch.write(name, bytes);
        let out = scratch.calib(&project(&["--camera", "b", "-i", name])).expect_code(0);
        let rows: Vec<Vec<String>> =
            out.stdout.lines().skip(1).map(|row| row.split(',').map(str::to_owned).collect()).collect();
        (rows, out.stderr)
    };
    let (plain, quiet) = floor("plain.csv", b"u,v\n920.5,620\n130.25,900\n");
    assert!(quiet.is_empty(), "{quiet}");
    let (found, note) = floor("semicolon.csv", b"U;V\n920,5;620\n130,25;900\n");
    assert!(found == plain && note.contains("semicolons"), "{found:?} {note}");
    let (found, note) = floor("tab.csv", b"u\tv\n920.5\t620\n130.25\t900\n");
    assert!(found == plain && note.contains("tabs"), "{found:?} {note}");
    let text: Vec<u8> =
        "\u{feff}u\tv\n920,5\t620\n130,25\t900\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    let (found, note) = floor("unicode.csv", &text);
    assert!(found == plain && note.contains("UTF-16"), "{found:?} {note}");
}

#[test]
fn foot_is_the_middle_of_the_lower_edge_and_the_pixel_origin_is_respected() {
    let scratch = scratch(&site());
    let table = "x,y,w,h\n900,500,40,120\n100,700,60.5,200\n";
    scratch.write("boxes.csv", table);
    scratch.write("points.csv", "u,v\n920,620\n130.25,900\n");
    scratch.write("centres.csv", "u,v\n919.5,619.5\n129.75,899.5\n");
    let floor = |more: &[&str]| -> Vec<Vec<String>> {
        let out = scratch.calib(&project(&[&["--camera", "b"], more].concat())).expect_code(0).stdout;
        let rows = out.lines().skip(1);
        rows.map(|row| row.split(',').rev().take(3).map(str::to_owned).collect()).collect()
    };
    let points = floor(&["-i", "points.csv"]);
    assert!(!points[0][1].is_empty());
    assert_eq!(floor(&["-i", "boxes.csv"]), points);
    assert_eq!(floor(&["-i", "boxes.csv", "--columns", "boxes"]), points);
    assert_eq!(floor(&["-i", "centres.csv", "--pixel-origin", "centre"]), points);
    scratch.calib(&project(&["--camera", "b", "-i", "boxes.csv", "--columns", "points"])).expect_code(3);
    // If points and boxes are present, `auto` selects the points.
    scratch.write("both.csv", "x,y,w,h,u,v\n0,0,9,9,920,620\n0,0,9,9,130.25,900\n");
    assert_eq!(floor(&["-i", "both.csv"]), points);
    assert_ne!(floor(&["-i", "both.csv", "--columns", "boxes"]), points);
    let to_pixel = ["project", "site.json", "--camera", "b", "--to", "pixel"];
    let at = |origin: &str| {
        let args = [&to_pixel[..], &["--pixel-origin", origin]].concat();
        let out = scratch.calib_with(&args, "x_m,y_m,z_m\n1,3,0\n").expect_code(0).stdout;
        out.lines().nth(1).unwrap().split(',').nth(3).unwrap().parse::<f64>().unwrap()
    };
    assert!((at("corner") - at("centre") - 0.5).abs() < 1e-9);
    scratch.calib(&[&to_pixel[..], &["--columns", "boxes"]].concat()).expect_code(2);
}

/// Returns a site in which camera b was moved on 1 June and has no calibration after June.
fn site_with_periods() -> Site {
    let mut site = site();
    site.cameras.push(entry("b", &Camera { yaw: 0.7, ..camera(1) }));
    site.cameras[1].valid_to = Some("2026-06-01T00:00:00Z".into());
    site.cameras[3].valid_from = Some("2026-06-01T00:00:00Z".into());
    site.cameras[3].valid_to = Some("2026-07-01T02:00:00+02:00".into());
    site
}

#[test]
fn rows_use_the_calibration_valid_at_their_time() {
    let scratch = scratch(&site_with_periods());
    let times = [
        "2026-05-31T23:59:59.999Z",
        "2026-06-01T01:59:59+02:00",
        "2026-06-01T00:00:00Z",
        "2026-06-30 23:59:59",
        "2026-07-01T00:00:00Z",
        "",
    ];
    let expected = [Some(0.3), Some(0.3), Some(0.7), Some(0.7), None, None];
    let table: String = times.iter().map(|time| format!("{time},960,900\n")).collect();
    scratch.write("in.csv", format!("seen,u,v\n{table}"));
    let base = ["--camera", "b", "--at-column", "seen"];
    let typed: TimestampMillisecondArray = [
        Some(1_780_271_999_999),
        Some(1_780_271_999_000),
        Some(1_780_272_000_000),
        Some(1_782_863_999_000),
        Some(1_782_864_000_000),
        None,
    ]
    .into_iter()
    .collect();
    let column = |value: f64| Arc::new(Float64Array::from(vec![value; times.len()])) as ArrayRef;
    let columns: [(&str, ArrayRef); 3] =
        [("seen", Arc::new(typed)), ("u", column(960.0)), ("v", column(900.0))];
    write_parquet(&scratch.path("in.parquet"), &RecordBatch::try_from_iter(columns).unwrap());
    for input in ["in.csv", "in.parquet"] {
        let run =
            scratch.calib(&project(&[&base[..], &["-i", input, "--format", "csv"]].concat())).expect_code(0);
        assert!(run.stderr.contains("2 rows of camera \"b\""), "{}", run.stderr);
        for (line, yaw) in run.stdout.lines().skip(1).zip(expected) {
            let cells: Vec<&str> = line.split(',').collect();
            let Some(yaw) = yaw else {
                assert_eq!(cells[3..], ["", "", "no-calibration"]);
                continue;
            };
            let exact = Camera { yaw, ..camera(1) }.pixel_to_floor(Pixel::new(960.0, 900.0), 0.0).unwrap();
            let off = (cells[3].parse::<f64>().unwrap() - exact.x).abs();
            assert!(off < 1e-9, "{line}: {off}");
        }
    }
    scratch.calib(&project(&["--camera", "b", "-i", "in.csv"])).expect_code(2);
    scratch.calib(&project(&["--camera-column", "camera_id", "-i", "in.csv"])).expect_code(2);
    let run =
        scratch.calib(&project(&["--camera", "b", "--at-column", "u", "-i", "in.parquet"])).expect_code(3);
    assert!(run.stderr.contains("in.parquet") && run.stderr.contains("Float64"), "{}", run.stderr);
    scratch.write("late.csv", "seen,u,v\n2026-06-01T00:00:00Z,1,2\nnoon,1,2\n");
    let run = scratch.calib(&project(&[&base[..], &["-i", "late.csv"]].concat())).expect_code(3);
    assert!(run.stderr.contains("late.csv: line 3, column seen: found \"noon\""), "{}", run.stderr);
}

#[test]
fn other_ndjson_fields_are_unchanged() {
    let scratch = scratch(&site());
    let input = "{\"id\": 18446744073709551615, \"u\":9.60e2,\"v\":900, \"tags\":[1, {\"a\":null}]}\n\n\
                 {\"v\":900,\"u\":960,\"new\":null,\"mixed\":\"\\u00e9\"}\n{\"u\":960,\"v\":900,\"mixed\":1.50}\n{\"u\":null,\"v\":1}\n";
    let run = scratch.calib_with(&project(&["--camera", "b"]), input).expect_code(0);
    let lines: Vec<&str> = run.stdout.lines().collect();
    assert!(
        lines[0].starts_with(
            "{\"id\":18446744073709551615,\"u\":9.60e2,\"v\":900,\"tags\":[1, {\"a\":null}],\"x_m\":"
        ),
        "{}",
        lines[0]
    );
    assert!(lines[1].contains("\"new\":null,\"mixed\":\"\\u00e9\",\"x_m\":"), "{}", lines[1]);
    assert!(lines[2].contains("\"mixed\":1.50,") && !lines[2].contains("new"), "{}", lines[2]);
    assert_eq!(lines[3], "{\"u\":null,\"v\":1,\"status\":\"missing\"}");
    // A typed format needs one type per column: mixed values become JSON text.
    scratch.write("in.ndjson", input);
    scratch.calib(&project(&["--camera", "b", "-i", "in.ndjson", "-o", "out.parquet"])).expect_code(0);
    let (_, out) = read_parquet(&scratch.path("out.parquet"));
    assert_eq!(out.column_by_name("id").unwrap().as_string::<i32>().value(0), "18446744073709551615");
    assert_eq!(out.column_by_name("u").unwrap().as_primitive::<Float64Type>().value(0), 960.0);
    for (line, text) in [
        ("{\"u\":1,\"v\":2,\"u\":3}", "line 1: "),
        ("{\"u\":1,\"v\":2}\n[1]", "line 2: "),
        ("{\"u\":1,\"v\":\"x\"}", "line 1, column v"),
        ("{\"a\":1}", "u,v"),
    ] {
        let run = scratch.calib_with(&project(&["--camera", "b"]), line).expect_code(3);
        assert!(run.stderr.contains("stdin") && run.stderr.contains(text), "{}", run.stderr);
    }
}

#[test]
fn every_format_works_in_pipes() {
    let scratch = scratch(&site());
    let batch = mixed_table(20_000);
    write_parquet(&scratch.path("in.parquet"), &batch);
    for format in ["csv", "ndjson", "arrow", "arrow-file", "parquet"] {
        let shell = format!(
            "cat in.parquet | {0} project site.json --to floor --camera-column camera_id --format {format} | {0} project site.json --to floor --camera-column camera_id --replace --format parquet > {format}.parquet",
            program().display()
        );
        let ended = Command::new("sh").args(["-c", &shell]).current_dir(scratch.path("")).output().unwrap();
        assert!(ended.status.success(), "{format}: {}", String::from_utf8_lossy(&ended.stderr));
        let (_, out) = read_parquet(&scratch.path(&format!("{format}.parquet")));
        assert_eq!(out.num_rows(), 20_000, "{format}");
        // Single-precision numbers are written with their own digits and read as doubles.
        assert_mapped(&batch, &out, if matches!(format, "csv" | "ndjson") { 1e-4 } else { 1e-9 });
    }
}

#[test]
fn broken_tables_are_refused_without_output() {
    let scratch = scratch(&site());
    let batch = mixed_table(3000);
    write_parquet(&scratch.path("whole.parquet"), &batch);
    let mut random = ChaCha8Rng::seed_from_u64(8);
    for name in ["arrow", "arrows", "ndjson", "csv"] {
        let whole = format!("whole.{name}");
        scratch
            .calib(&project(&["--camera-column", "camera_id", "-i", "whole.parquet", "-o", &whole]))
            .expect_code(0);
    }
    for name in ["parquet", "arrow", "arrows", "ndjson", "csv"] {
        let whole = std::fs::read(scratch.path(&format!("whole.{name}"))).unwrap();
        let broken = format!("broken.{name}");
        for round in 0..40 {
            let mut bytes = whole.clone();
            if round % 2 == 0 {
                bytes.truncate(random.random_range(0..whole.len()));
            } else {
                for _ in 0..random.random_range(1..20) {
                    let at = random.random_range(0..bytes.len());
                    bytes[at] = random.random();
                }
            }
            scratch.write(&broken, &bytes);
            let run = scratch.calib(&project(&[
                "--camera-column",
                "camera_id",
                "-i",
                &broken,
                "-o",
                "out.parquet",
                "--force",
            ]));
            // A file with a changed value can be a valid table.
            assert!(run.code == 0 || run.code == 3, "{broken}, round {round}: {run:?}");
            if run.code == 3 {
                assert!(run.stderr.contains(&broken), "{}", run.stderr);
                assert!(!scratch.path("out.parquet").exists());
            } else {
                std::fs::remove_file(scratch.path("out.parquet")).unwrap();
            }
        }
        // A format with an end marker is incomplete without its last byte.
        if ["parquet", "arrow"].contains(&name) {
            scratch.write(&broken, &whole[..whole.len() - 1]);
            scratch.calib(&project(&["--camera", "a", "-i", &broken])).expect_code(3);
        }
    }
    let left: Vec<_> = std::fs::read_dir(scratch.path("")).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert!(left.iter().all(|name| !name.to_string_lossy().starts_with('.')), "{left:?}");
}

#[test]
fn wrong_unpacked_sizes_take_no_memory() {
    let scratch = scratch(&site());
    let batch = mixed_table(3000);
    for (name, packing) in [("zstd", CompressionType::ZSTD), ("lz4", CompressionType::LZ4_FRAME)] {
        let options = IpcWriteOptions::default().try_with_compression(Some(packing)).unwrap();
        let mut whole = Vec::new();
        let mut writer = StreamWriter::try_new_with_options(&mut whole, &batch.schema(), options).unwrap();
        writer.write(&batch).unwrap();
        writer.finish().unwrap();
        let run = |bytes: &[u8]| {
            scratch.write("packed.arrows", bytes);
            scratch.calib(&project(&[
                "--camera-column",
                "camera_id",
                "-i",
                "packed.arrows",
                "-o",
                "out.csv",
                "--force",
            ]))
        };
        run(&whole).expect_code(0);
        // Columns of 3000 numbers of eight bytes store this unpacked size before the packed data.
        let promise = 24_000_i64.to_le_bytes();
        let places: Vec<usize> =
            (0..whole.len() - 8).step_by(8).filter(|&at| whole[at..at + 8] == promise).collect();
        assert!(places.len() >= 3, "{name}: {places:?}");
        for at in places {
            for forged in [1_i64 << 40, i64::MAX, 24_008, -7] {
                let mut bytes = whole.clone();
                bytes[at..at + 8].copy_from_slice(&forged.to_le_bytes());
                let refused = run(&bytes).expect_code(3);
                assert!(refused.stderr.contains("packed.arrows"), "{}", refused.stderr);
            }
        }
    }
}

#[test]
fn killed_runs_leave_no_file() {
    let scratch = scratch(&site());
    let mut child = Command::new(program())
        .args(project(&["--camera", "a", "--from", "csv", "-o", "out.parquet"]))
        .current_dir(scratch.path(""))
        .stdin(Stdio::piped())
        .spawn()
        .unwrap();
    let mut pipe = child.stdin.take().unwrap();
    pipe.write_all(csv_of(&pixels(50_000)).as_bytes()).unwrap();
    pipe.flush().unwrap();
    child.kill().unwrap();
    child.wait().unwrap();
    let left: Vec<_> = std::fs::read_dir(scratch.path("")).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left, ["site.json"]);
}

#[test]
fn missing_and_conflicting_arguments_are_refused() {
    let scratch = scratch(&site());
    scratch.write("in.csv", "u,v\n1,2\n");
    scratch.calib(&project(&["-i", "in.csv"])).expect_code(2);
    scratch.calib(&project(&["--camera", "a", "--camera-column", "b", "-i", "in.csv"])).expect_code(2);
    scratch
        .calib(&project(&[
            "--camera",
            "a",
            "--at",
            "2026-01-01T00:00:00Z",
            "--at-column",
            "b",
            "-i",
            "in.csv",
        ]))
        .expect_code(2);
    scratch.calib(&project(&["--camera", "a", "-i", "none.parquet"])).expect_code(3);
    scratch.calib(&project(&["--camera", "a", "-i", "."])).expect_code(3);
    let run =
        scratch.calib(&project(&["--camera", "a", "--at-column", "when", "-i", "in.csv"])).expect_code(3);
    assert!(run.stderr.contains("when") && run.stderr.contains("u,v"), "{}", run.stderr);
    scratch.calib_with(&["project", "-", "--camera", "a", "--to", "floor"], &site().to_json()).expect_code(2);
    scratch.write("in.parquet", "u,v\n1,2\n");
    scratch.calib(&project(&["--camera", "a", "-i", "in.parquet"])).expect_code(3);
    scratch
        .calib(&project(&["--camera", "a", "-i", "in.parquet", "--from", "csv", "--format", "csv"]))
        .expect_code(0);
}
