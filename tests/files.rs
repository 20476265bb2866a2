//! Hostile and damaged files: refusals take little memory and time, and existing files are kept.

#![cfg(unix)]

use std::io::{Read as _, Write as _};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use arrow_array::builder::{Int32Builder, ListBuilder};
use arrow_array::{ArrayRef, Float64Array, RecordBatch, StringArray};
use arrow_schema::{DataType, Field, Schema};
use calib_core::{Camera, Covariance, Lens, Pixel, WorldPoint};
use calib_site::{Method, Plan, Site, SiteCamera, Solution, Stage};
use calib_tests::{ProgramOutput, Scratch, program};
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::{ArrowReaderMetadata, ArrowReaderOptions};
use parquet::basic::{Compression, ZstdLevel};
use parquet::file::metadata::{ColumnChunkMetaData, ParquetMetaDataBuilder, ParquetMetaDataWriter};
use parquet::file::properties::WriterProperties;

/// Largest address space of a refused run, in KiB, including mapped files.
const MEMORY_KIB: u32 = 512 << 10;
/// Largest duration of a refused run, in seconds.
const SECONDS: u64 = 5;

/// Runs `calib` with limited memory and checks its duration.
fn within_limits(scratch: &Scratch, args: &[&str]) -> ProgramOutput {
    let program = program();
    let started = Instant::now();
    let output = Command::new("sh")
        .args(["-c", &format!("ulimit -v {MEMORY_KIB}; exec timeout 60 \"$0\" \"$@\"")])
        .arg(program)
        .args(args)
        .current_dir(scratch.path(""))
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
    let code = output.status.code().unwrap_or(-1);
    let ended = ProgramOutput { code, stdout: text(output.stdout), stderr: text(output.stderr) };
    assert!(started.elapsed() < Duration::from_secs(SECONDS), "{args:?}: {:?}, {ended:?}", started.elapsed());
    ended
}

/// Returns a calibrated camera with an image name and size.
fn entry(id: &str, image: &str, size: [u32; 2]) -> SiteCamera {
    let camera = Camera {
        position: WorldPoint { x: 1.2, y: -0.4, z: 4.5 },
        yaw: 0.2,
        pitch: 0.54,
        roll: -0.026,
        focal: 1486.2,
        lens: Lens::pinhole(Pixel { u: 960.0, v: 536.0 }),
        covariance: Covariance::EXACT,
    };
    let solution = Some(Solution::from_camera(&camera, Method::Given, Stage::Placed));
    SiteCamera { solution, image: Some(image.into()), ..SiteCamera::new(id, size) }
}

fn write_site(scratch: &Scratch, cameras: Vec<SiteCamera>) {
    scratch.write("site.json", Site { cameras, ..Site::new() }.to_json());
}

/// Returns a JPEG of 16 x 16 grey pixels whose header declares the width and height `size`.
fn jpeg(size: [u16; 2]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let image = image::RgbImage::from_pixel(16, 16, image::Rgb([90, 90, 90]));
    image.write_with_encoder(image::codecs::jpeg::JpegEncoder::new(&mut bytes)).unwrap();
    let frame = bytes.windows(2).position(|pair| pair == [0xFF, 0xC0]).unwrap();
    bytes[frame + 5..frame + 7].copy_from_slice(&size[1].to_be_bytes());
    bytes[frame + 7..frame + 9].copy_from_slice(&size[0].to_be_bytes());
    bytes
}

/// Returns a PNG without image data whose header declares the width and height `side`.
fn png(side: u32) -> Vec<u8> {
    let chunk = |kind: &[u8; 4], data: &[u8]| {
        let mut crc = u32::MAX;
        for byte in kind.iter().chain(data) {
            crc ^= u32::from(*byte);
            (0..8).for_each(|_| crc = if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 });
        }
        [&(data.len() as u32).to_be_bytes()[..], kind, data, &(!crc).to_be_bytes()].concat()
    };
    let head = [&side.to_be_bytes()[..], &side.to_be_bytes(), &[8, 2, 0, 0, 0]].concat();
    [b"\x89PNG\r\n\x1a\n", &chunk(b"IHDR", &head)[..], &chunk(b"IDAT", &[0; 40]), &chunk(b"IEND", &[])]
        .concat()
}

const DRAWING: [&[&str]; 4] = [
    &["render", "site.json", "--camera", "a", "-o", "out.png"],
    &["undistort", "site.json", "--camera", "a", "-o", "out.png"],
    &["report", "site.json", "-o", "out.html"],
    &["solve", "site.json"],
];

#[test]
fn truncated_images_with_large_sizes_take_no_memory() {
    for (name, bytes, side) in
        [("a.jpg", jpeg([65_500; 2]), 65_500), ("a.png", png(65_535), 65_535), ("b.png", png(16_000), 16_000)]
    {
        let scratch = Scratch::new();
        scratch.write(name, &bytes);
        write_site(&scratch, vec![entry("a", name, [side; 2])]);
        for args in DRAWING {
            let run = within_limits(&scratch, args);
            // A report omits an unreadable image and is written.
            assert_eq!(run.code, if args[0] == "report" { 0 } else { 3 }, "{name} {args:?} {run:?}");
            assert!(run.stderr.contains("truncated") && run.stderr.contains(name), "{args:?} {run:?}");
        }
        let (image, origin_px) = (Some(name.into()), Default::default());
        let plan = Plan {
            image,
            page: None,
            layers: None,
            metres_per_px: 0.1,
            origin_px,
            x_axis_deg: 0.0,
            georeference: None,
        };
        let site = Site { plan: Some(plan), cameras: vec![entry("a", name, [side; 2])], ..Site::new() };
        scratch.write("plan.json", site.to_json());
        for args in [
            &["render", "plan.json", "--plan", "-o", "out2.png"][..],
            &["export", "svg", "plan.json", "-o", "."],
        ] {
            let run = within_limits(&scratch, args);
            assert_eq!(run.code, 3, "{args:?} {run:?}");
            assert!(run.stderr.contains("the plan"), "{run:?}");
        }
    }
}

#[test]
fn image_size_is_checked_before_decoding() {
    let scratch = Scratch::new();
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::GrayImage::new(16_000, 12_000).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    scratch.write("a.png", bytes.into_inner());
    write_site(&scratch, vec![entry("a", "a.png", [1920, 1080])]);
    for args in &DRAWING[..2] {
        let run = within_limits(&scratch, args).expect_code(3);
        assert!(run.stderr.contains("16000 x 12000") && run.stderr.contains("1920 x 1080"), "{}", run.stderr);
    }
}

#[test]
fn image_larger_than_memory_is_an_error() {
    let scratch = Scratch::new();
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::GrayImage::new(14_000, 12_000).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    scratch.write("a.png", bytes.into_inner());
    write_site(&scratch, vec![entry("a", "a.png", [14_000, 12_000])]);
    let run = within_limits(&scratch, DRAWING[0]).expect_code(3);
    assert!(run.stderr.contains("memory"), "{}", run.stderr);
}

#[test]
fn truncated_jpeg_is_reported() {
    let scratch = Scratch::new();
    let mut bytes = Vec::new();
    let image = image::RgbImage::from_fn(640, 480, |x, y| image::Rgb([x as u8, y as u8, (x ^ y) as u8]));
    image.write_with_encoder(image::codecs::jpeg::JpegEncoder::new(&mut bytes)).unwrap();
    scratch.write("a.jpg", &bytes[..bytes.len() * 9 / 10]);
    write_site(&scratch, vec![entry("a", "a.jpg", [640, 480])]);
    for args in DRAWING {
        let run = within_limits(&scratch, args);
        assert!(run.stderr.contains("truncated") && run.stderr.contains("\"a\""), "{run:?}");
    }
    scratch.write("a.jpg", &bytes);
    within_limits(&scratch, DRAWING[0]).expect_code(0);
}

#[test]
fn pipes_and_devices_are_refused() {
    let scratch = Scratch::new();
    assert!(Command::new("mkfifo").arg(scratch.path("pipe")).status().unwrap().success());
    for path in ["pipe", "/dev/zero"] {
        let what = if path == "pipe" { "a pipe" } else { "a device" };
        for args in [&["solve", path][..], &["check", path], &["import", "fspy", path]] {
            let run = within_limits(&scratch, args).expect_code(3);
            assert!(run.stderr.contains(what) && run.stderr.contains(path), "{run:?}");
        }
        write_site(&scratch, vec![entry("a", path, [640, 480])]);
        for args in &DRAWING[..2] {
            let run = within_limits(&scratch, &[*args, &["--allow-outside"]].concat()).expect_code(3);
            assert!(run.stderr.contains(what), "{run:?}");
        }
    }
    let project = ["project", "site.json", "--camera", "a", "--to", "floor", "-i", "/dev/zero"];
    let run = within_limits(&scratch, &project).expect_code(3);
    assert!(run.stderr.contains("a device"), "{run:?}");
}

#[test]
fn images_outside_the_folder_are_read_on_request() {
    let scratch = Scratch::new();
    std::fs::create_dir(scratch.path("site")).unwrap();
    image::RgbImage::new(640, 480).save(scratch.path("private.png")).unwrap();
    std::os::unix::fs::symlink("../private.png", scratch.path("site/link.png")).unwrap();
    let absolute = scratch.path("private.png").to_string_lossy().into_owned();
    for image in ["../private.png", "link.png", &absolute] {
        let site = Site { cameras: vec![entry("a", image, [640, 480])], ..Site::new() };
        scratch.write("site/site.json", site.to_json());
        let render = ["render", "site/site.json", "--camera", "a", "-o", "out.png", "--force"];
        let run = scratch.calib(&render).expect_code(3);
        assert!(run.stderr.contains("--allow-outside") && run.stderr.contains(image), "{run:?}");
        let report = ["report", "site/site.json", "-o", "out.html", "--force"];
        let run = scratch.calib(&report).expect_code(0);
        assert!(run.stderr.contains("--allow-outside"), "{run:?}");
        let size = |scratch: &Scratch| std::fs::metadata(scratch.path("out.html")).unwrap().len();
        let without = size(&scratch);
        scratch.calib(&[&render[..], &["--allow-outside"]].concat()).expect_code(0);
        scratch.calib(&[&report[..], &["--allow-outside"]].concat()).expect_code(0);
        assert!(size(&scratch) > without);
        // Solving ignores an unreadable image, like a missing one.
        let run = scratch.calib(&["solve", "site/site.json", "--format", "json"]).expect_code(0);
        assert!(run.stderr.contains("--allow-outside"), "{run:?}");
    }
}

#[test]
fn site_with_endless_lists_takes_little_memory() {
    let scratch = Scratch::new();
    let site = |inner: &str| format!("{{\"format\":\"calib-site\",\"version\":1,{inner}}}");
    let list = |item: &str, count: usize| vec![item; count].join(",");
    let camera = |inner: &str| site(&format!("\"cameras\":[{{\"id\":\"a\",\"size_px\":[10,10],{inner}}}]"));
    let vertical = "{\"kind\":\"vertical\",\"segments\":[]}";
    for (name, text, pointer) in [
        ("links", site(&format!("\"links\":[{}]", list("{\"seen\":[]}", 1_200_000))), "/links"),
        (
            "annotations",
            camera(&format!("\"annotations\":[{}]", list(vertical, 900_000))),
            "/cameras/0/annotations",
        ),
        (
            "points",
            camera(&format!(
                "\"annotations\":[{{\"kind\":\"straight\",\"points\":[{}]}}]",
                list("[1,2]", 1_300_000)
            )),
            "/cameras/0/annotations/0/points",
        ),
        (
            "cameras",
            site(&format!("\"cameras\":[{}]", list("{\"id\":\"a\",\"size_px\":[1,1]}", 700_000))),
            "/cameras",
        ),
        ("nothing", " ".repeat(700 << 20), "memory"),
    ] {
        scratch.write("site.json", text);
        let run = within_limits(&scratch, &["solve", "site.json"]).expect_code(3);
        assert!(run.stderr.contains(pointer) && run.stderr.len() < 500, "{name}: {run:?}");
    }
}

#[test]
fn too_many_annotations_are_refused() {
    let scratch = Scratch::new();
    let segments = vec!["[[10,20],[10,300]]"; 200_000].join(",");
    scratch.write(
        "site.json",
        format!(
            "{{\"format\":\"calib-site\",\"version\":1,\"cameras\":[{{\"id\":\"a\",\"size_px\":[640,480],\
             \"annotations\":[{{\"kind\":\"vertical\",\"segments\":[{segments}]}}]}}]}}"
        ),
    );
    let run = within_limits(&scratch, &["solve", "site.json"]).expect_code(3);
    assert!(run.stderr.contains("200000 segments") && run.stderr.contains("at most 20000"), "{run:?}");
}

#[test]
fn too_many_lines_in_a_site_are_refused() {
    let scratch = Scratch::new();
    let segments = vec!["[[10,20],[10,300]]"; 20_000].join(",");
    let camera = |index: usize| {
        format!(
            "{{\"id\":\"c{index}\",\"size_px\":[640,480],\
             \"annotations\":[{{\"kind\":\"vertical\",\"segments\":[{segments}]}}]}}"
        )
    };
    let cameras: Vec<String> = (0..6).map(camera).collect();
    let site = format!("{{\"format\":\"calib-site\",\"version\":1,\"cameras\":[{}]}}", cameras.join(","));
    scratch.write("site.json", site);
    let run = within_limits(&scratch, &["solve", "site.json"]).expect_code(3);
    assert!(run.stderr.contains("120000 segments") && run.stderr.contains("at most 100000"), "{run:?}");
}

fn points() -> RecordBatch {
    let numbers = |at: f64| Arc::new(Float64Array::from_iter_values((0..3000).map(|_| at))) as _;
    let schema = Schema::new(vec![
        Field::new("u", DataType::Float64, true),
        Field::new("v", DataType::Float64, true),
        Field::new("note", DataType::Utf8, true),
    ]);
    let notes = Arc::new(StringArray::from_iter_values((0..3000).map(|_| "walks"))) as _;
    RecordBatch::try_new(Arc::new(schema), vec![numbers(900.0), numbers(700.0), notes]).unwrap()
}

fn parquet(codec: Compression) -> Vec<u8> {
    let mut bytes = Vec::new();
    let properties = WriterProperties::builder().set_compression(codec).set_dictionary_enabled(false).build();
    let mut writer = ArrowWriter::try_new(&mut bytes, points().schema(), Some(properties)).unwrap();
    writer.write(&points()).unwrap();
    writer.close().unwrap();
    bytes
}

const TABLE: [&str; 6] = ["project", "site.json", "--camera", "a", "--to", "floor"];

/// Returns the Parquet file with changed metadata of its first column.
fn with_changed_metadata(
    bytes: &[u8],
    change: impl Fn(ColumnChunkMetaData) -> ColumnChunkMetaData,
) -> Vec<u8> {
    let whole = bytes::Bytes::copy_from_slice(bytes);
    let about =
        ArrowReaderMetadata::load(&whole, ArrowReaderOptions::new()).unwrap().metadata().as_ref().clone();
    let mut groups = about.row_groups().to_vec();
    let mut columns = groups[0].columns().to_vec();
    columns[0] = change(columns[0].clone());
    groups[0] = groups[0].clone().into_builder().set_column_metadata(columns).build().unwrap();
    let about = ParquetMetaDataBuilder::new_from_metadata(about).set_row_groups(groups).build();
    let length = u32::from_le_bytes(*bytes[..bytes.len() - 4].last_chunk().unwrap()) as usize;
    let mut out = bytes[..bytes.len() - 8 - length].to_vec();
    ParquetMetaDataWriter::new(&mut out, &about).finish().unwrap();
    out
}

/// Encodes a number as a Thrift zigzag varint. A run of equal Parquet levels encodes its length in the same
/// way.
fn varint(number: usize) -> Vec<u8> {
    let mut number = number << 1;
    let mut bytes = Vec::new();
    while number > 0x7F {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
    bytes
}

/// Returns the Parquet file with a new page of its first column. The page contains `packed`, and declares `promised`
/// unpacked bytes and `values` values.
fn with_page(whole: &[u8], promised: usize, values: usize, packed: &[u8]) -> Vec<u8> {
    // A data page: its unpacked and its packed size, then its number of values and encodings (plain, RLE,
    // RLE).
    let sizes = [&[0x15, 0x00, 0x15][..], &varint(promised), &[0x15], &varint(packed.len())].concat();
    let values =
        [&[0x2C, 0x15][..], &varint(values), &[0x15, 0x00, 0x15, 0x06, 0x15, 0x06, 0x00, 0x00]].concat();
    let page = [&sizes, &values, packed].concat();
    let length = u32::from_le_bytes(*whole[..whole.len() - 4].last_chunk().unwrap()) as usize;
    let (pages, end) = whole.split_at(whole.len() - 8 - length);
    with_changed_metadata(&[pages, &page[..], end].concat(), |column| {
        let builder = column.into_builder().set_data_page_offset(pages.len() as i64);
        builder.set_total_compressed_size(page.len() as i64).build().unwrap()
    })
}

#[test]
fn page_with_a_large_declared_size_takes_no_memory() {
    let scratch = Scratch::new();
    write_site(&scratch, vec![entry("a", "a.png", [1920, 1080])]);
    for codec in [
        Compression::SNAPPY,
        Compression::LZ4_RAW,
        Compression::GZIP(Default::default()),
        Compression::ZSTD(ZstdLevel::default()),
    ] {
        let whole = parquet(codec);
        let run = |bytes: &[u8]| {
            scratch.write("in.parquet", bytes);
            within_limits(&scratch, &[&TABLE[..], &["-i", "in.parquet"]].concat())
        };
        run(&whole).expect_code(0);
        let refused = run(&with_page(&whole, i32::MAX as usize, 3000, &[7; 100])).expect_code(3);
        let is_reported = refused.stderr.contains("a page decompresses to 2147483647 bytes");
        assert!(is_reported && refused.stderr.contains("in.parquet"), "{codec}: {refused:?}");
        // An invalid page is refused by the library.
        run(&with_page(&whole, 24_000, 3000, &[7; 100])).expect_code(3);
    }
}

#[test]
fn page_larger_than_its_declared_size_takes_no_memory() {
    let scratch = Scratch::new();
    write_site(&scratch, vec![entry("a", "a.png", [1920, 1080])]);
    // Blocks of 128 KiB of zeros, four bytes each.
    let block = |last: u32| [&(last | 1 << 1 | (128 << 10) << 3).to_le_bytes()[..3], &[0]].concat();
    let mut bomb = vec![0x28, 0xB5, 0x2F, 0xFD, 0, 0x58];
    (0..20_000).for_each(|_| bomb.extend(block(0)));
    bomb.extend(block(1));
    let whole = parquet(Compression::ZSTD(ZstdLevel::default()));
    scratch.write("in.parquet", with_page(&whole, 24_000, 3000, &bomb));
    let run = within_limits(&scratch, &[&TABLE[..], &["-i", "in.parquet"]].concat()).expect_code(3);
    assert!(run.stderr.contains("a page decompresses to 26"), "{}", run.stderr);
}

#[test]
fn list_of_millions_of_nulls_takes_no_memory() {
    let scratch = Scratch::new();
    write_site(&scratch, vec![entry("a", "a.png", [1920, 1080])]);
    let mut lists = ListBuilder::new(Int32Builder::new());
    lists.append_value([None]);
    let at = || Arc::new(Float64Array::from(vec![960.0])) as ArrayRef;
    let row = RecordBatch::try_from_iter([
        ("list", Arc::new(lists.finish()) as ArrayRef),
        ("u", at()),
        ("v", at()),
    ]);
    let mut whole = Vec::new();
    let plain = WriterProperties::builder().set_dictionary_enabled(false).build();
    let mut writer = ArrowWriter::try_new(&mut whole, row.as_ref().unwrap().schema(), Some(plain)).unwrap();
    writer.write(&row.unwrap()).unwrap();
    writer.close().unwrap();
    for (values, said) in
        [(3000, None), (50_000_000, Some("a column of lists")), (400_000_000, Some("67108864"))]
    {
        // Repetition levels: one value starts the row, the others continue it. Definition levels: every value
        // is null, in a list.
        let begins = [&[2, 0][..], &varint(values - 1), &[1]].concat();
        let are = [&varint(values)[..], &[1]].concat();
        let page: Vec<u8> = [begins, are]
            .iter()
            .flat_map(|runs| [&(runs.len() as u32).to_le_bytes(), &runs[..]].concat())
            .collect();
        scratch.write("in.parquet", with_page(&whole, page.len(), values, &page));
        let run = within_limits(&scratch, &[&TABLE[..], &["-i", "in.parquet"]].concat());
        match said {
            None => drop(run.expect_code(0)),
            Some(said) => assert!(run.code == 3 && run.stderr.contains(said), "{values}: {run:?}"),
        }
    }
}

#[test]
fn brotli_is_refused_by_name() {
    let scratch = Scratch::new();
    write_site(&scratch, vec![entry("a", "a.png", [1920, 1080])]);
    let bytes = with_changed_metadata(&parquet(Compression::UNCOMPRESSED), |column| {
        column.into_builder().set_compression(Compression::BROTLI(Default::default())).build().unwrap()
    });
    scratch.write("in.parquet", bytes);
    let run = within_limits(&scratch, &[&TABLE[..], &["-i", "in.parquet"]].concat()).expect_code(3);
    assert!(run.stderr.contains("Brotli") && run.stderr.contains("\"u\""), "{}", run.stderr);
}

#[test]
fn compressed_text_is_read_and_written() {
    let scratch = Scratch::new();
    write_site(&scratch, vec![entry("a", "a.png", [1920, 1080])]);
    let table: String = (0..20_000).map(|i| format!("{},{}\n", i % 1900, 600 + i % 400)).collect();
    scratch.write("in.csv", format!("u,v\n{table}"));
    let plain = scratch.calib(&[&TABLE[..], &["-i", "in.csv"]].concat()).expect_code(0);
    for name in ["out.csv.gz", "out.csv.zst"] {
        scratch.calib(&[&TABLE[..], &["-i", "in.csv", "-o", name]].concat()).expect_code(0);
        let length = std::fs::metadata(scratch.path(name)).unwrap().len();
        assert!(length < plain.stdout.len() as u64 / 2, "{name}: {length}");
        let mapped = ["project", "site.json", "--camera", "a", "--to", "floor", "--replace", "-i", name];
        // The compression is detected from the name, or from the first bytes.
        let again = scratch.calib(&[&mapped[..], &["--format", "csv"]].concat()).expect_code(0);
        assert_eq!(again.stdout, plain.stdout, "{name}");
        std::fs::rename(scratch.path(name), scratch.path("unnamed")).unwrap();
        let again = scratch
            .calib(&["project", "site.json", "--camera", "a", "--to", "floor", "--replace", "-i", "unnamed"])
            .expect_code(0);
        assert_eq!(again.stdout, plain.stdout, "{name}");
    }
    let run = scratch.calib(&[&TABLE[..], &["-i", "in.csv", "-o", "out.parquet.gz"]].concat()).expect_code(2);
    assert!(run.stderr.contains("out.parquet"), "{}", run.stderr);
    // A truncated file is refused.
    let whole = std::fs::read(scratch.path("unnamed")).unwrap();
    scratch.write("unnamed", &whole[..whole.len() / 2]);
    scratch.calib(&[&TABLE[..], &["-i", "unnamed"]].concat()).expect_code(3);
}

#[test]
fn only_one_of_several_runs_writes_the_file() {
    let scratch = Scratch::new();
    write_site(&scratch, vec![entry("a", "a.png", [1920, 1080])]);
    scratch.write("in.csv", "u,v\n900,700\n");
    let start = || {
        Command::new(program())
            .args([&TABLE[..], &["-o", "out.csv"]].concat())
            .current_dir(scratch.path(""))
            .stdin(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    };
    let mut runs: Vec<_> = (0..6).map(|_| start()).collect();
    for run in &mut runs {
        run.stdin.as_mut().unwrap().write_all(b"u,v\n900,700\n").unwrap();
    }
    // All runs check that the file does not exist before one of them creates it.
    std::thread::sleep(Duration::from_millis(300));
    runs.iter_mut().for_each(|run| drop(run.stdin.take()));
    let ended: Vec<_> = runs.into_iter().map(|run| run.wait_with_output().unwrap()).collect();
    let codes: Vec<_> = ended.iter().map(|run| run.status.code().unwrap()).collect();
    assert_eq!(codes.iter().filter(|&&code| code == 0).count(), 1, "{codes:?}");
    for run in ended.iter().filter(|run| !run.status.success()) {
        assert!(String::from_utf8_lossy(&run.stderr).contains("out.csv already exists"), "{run:?}");
    }
}

#[test]
fn replaced_files_keep_their_mode_and_symbolic_links() {
    let scratch = Scratch::new();
    write_site(&scratch, vec![entry("a", "a.png", [1920, 1080])]);
    let write = |name: &str, more: &[&str]| {
        let args = [&["export", "table", "site.json", "-o", name][..], more].concat();
        scratch.calib(&args)
    };
    scratch.write("private.json", "mine");
    std::fs::set_permissions(scratch.path("private.json"), std::fs::Permissions::from_mode(0o600)).unwrap();
    std::os::unix::fs::symlink("private.json", scratch.path("link.json")).unwrap();
    std::os::unix::fs::symlink("nowhere.json", scratch.path("dangling.json")).unwrap();
    write("link.json", &["--force"]).expect_code(0);
    assert!(scratch.path("link.json").symlink_metadata().unwrap().is_symlink());
    assert!(scratch.read_json("private.json")["cameras"].is_array());
    let mode = std::fs::metadata(scratch.path("private.json")).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o600);
    for more in [&[][..], &["--force"]] {
        let run = write("dangling.json", more).expect_code(1);
        assert!(run.stderr.contains("missing file"), "{run:?}");
    }
    assert!(!scratch.path("nowhere.json").exists());
}

#[test]
fn names_are_escaped_in_terminal_page_and_spreadsheet() {
    let scratch = Scratch::new();
    let mut camera = entry("a", "a.png", [640, 480]);
    camera.name = Some("a\u{1b}[2J<script>\u{202e}".into());
    let mut site = Site { name: Some("yard\u{1b}]0;x\u{7}".into()), cameras: vec![camera], ..Site::new() };
    scratch.write("site.json", site.to_json());
    let run = scratch.calib(&["solve", "site.json"]);
    assert!(run.stdout.contains("yard\\u{1b}") && !run.stdout.contains('\u{1b}'), "{run:?}");
    scratch.calib(&["report", "site.json", "-o", "page.html"]).expect_code(0);
    let page = std::fs::read_to_string(scratch.path("page.html")).unwrap();
    assert!(page.contains("Content-Security-Policy") && page.contains("default-src 'none'"));
    assert!(!page.contains("<script"));
    site.cameras[0].id = "a\u{1b}[2J".into();
    scratch.write("site.json", site.to_json());
    let run = scratch.calib(&["solve", "site.json"]).expect_code(3);
    assert!(run.stderr.contains("control character") && run.stderr.contains("/cameras/0/id"), "{run:?}");
    site.cameras[0].id = "=1+1".into();
    scratch.write("site.json", site.to_json());
    scratch.calib(&["export", "table", "site.json", "-o", "table.csv"]).expect_code(0);
    let table = std::fs::read_to_string(scratch.path("table.csv")).unwrap();
    assert!(table.contains("\n\"'=1+1\","), "{table}");
    scratch.write("in.csv", "id,u,v\n=1+1,900,700\n-3,900,700\n");
    let project = ["project", "site.json", "--camera", "=1+1", "--to", "floor", "-i", "in.csv"];
    let run = scratch.calib(&project).expect_code(0);
    assert!(run.stdout.contains("\n'=1+1,") && run.stdout.contains("\n-3,"), "{run:?}");
    assert!(run.stderr.contains("1 cell that") && run.stderr.contains("--verbatim"), "{run:?}");
    let run = scratch.calib(&[&project[..], &["--verbatim"]].concat()).expect_code(0);
    assert!(run.stdout.contains("\n=1+1,"), "{run:?}");
}

#[test]
fn progress_in_a_log_is_one_line_every_ten_seconds() {
    let scratch = Scratch::new();
    write_site(&scratch, vec![entry("a", "a.png", [1920, 1080])]);
    let mut run = Command::new(program())
        .args([&TABLE[..], &["-o", "out.csv"]].concat())
        .current_dir(scratch.path(""))
        .stdin(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut pipe = run.stdin.take().unwrap();
    let rows = "900,700\n".repeat(20_000);
    pipe.write_all(format!("u,v\n{rows}").as_bytes()).unwrap();
    std::thread::sleep(Duration::from_millis(10_200));
    pipe.write_all(rows.as_bytes()).unwrap();
    drop(pipe);
    let mut messages = String::new();
    run.stderr.take().unwrap().read_to_string(&mut messages).unwrap();
    assert!(run.wait().unwrap().success());
    assert_eq!(messages.lines().filter(|line| line.contains(" rows")).count(), 1, "{messages}");
}

#[test]
fn full_disk_error_names_the_file() {
    let full = Path::new("/dev/full");
    if !full.exists() {
        return;
    }
    let scratch = Scratch::new();
    write_site(&scratch, vec![entry("a", "a.png", [1920, 1080])]);
    let run = scratch.calib(&["export", "table", "site.json", "-o", "/dev/full/table.json"]).expect_code(1);
    assert!(run.stderr.contains("/dev/full"), "{}", run.stderr);
    scratch.write("in.csv", "u,v\n900,700\n");
    let run = scratch.calib(&[&TABLE[..], &["-i", "in.csv", "-o", "/dev/full"]].concat()).expect_code(1);
    assert!(run.stderr.contains("/dev/full"), "{}", run.stderr);
}
