//! Fuzz target that reads bytes as files of the format named by `CALIB_FORMAT`, and writes the resulting
//! site. `colmap-binary` is the binary variant of `colmap`. It must not panic, and the site must be valid.

#![no_main]

use std::sync::LazyLock;

use calib_site::Site;
use calib_formats::{File, import};
use libfuzzer_sys::fuzz_target;
use rlimit::{Resource, setrlimit};

/// Mapping of input bytes to files.
enum Names {
    /// One file; the first byte selects its name.
    OneOf(&'static [&'static str]),
    /// Several files, separated by [`SEPARATOR`].
    AllOf(&'static [&'static str]),
}

/// Separator between the files of one input.
const SEPARATOR: &[u8] = b"\n-- file --\n";

/// Importers and the names of their files.
const FORMATS: &[(&str, Names)] = &[
    ("opencv", Names::OneOf(&["a.json", "a.yml", "a.xml"])),
    ("ros", Names::OneOf(&["a.yaml"])),
    ("colmap", Names::AllOf(&["cameras.txt", "images.txt"])),
    ("colmap-binary", Names::AllOf(&["cameras.bin", "images.bin"])),
    ("nvidia", Names::OneOf(&["calibration.json", "camInfo/a.yml", "transforms.yml"])),
    ("wildtrack", Names::AllOf(&["intrinsic_zero/intr_a.xml", "extrinsic/extr_a.xml"])),
    ("nerfstudio", Names::OneOf(&["transforms.json"])),
    ("kalibr", Names::OneOf(&["camchain.yaml"])),
    ("ocamcalib", Names::OneOf(&["calib_results.txt"])),
    ("caliscope", Names::OneOf(&["a.toml"])),
    ("basalt", Names::OneOf(&["calibration.json"])),
    ("camodocal", Names::OneOf(&["a.yaml"])),
    ("opensfm", Names::OneOf(&["camera_models.json"])),
    ("metashape", Names::OneOf(&["a.xml"])),
    ("matlab", Names::OneOf(&["a.json"])),
    ("fspy", Names::OneOf(&["a.fspy"])),
    ("worldfile", Names::OneOf(&["a.pgw"])),
    ("gpx", Names::OneOf(&["a.gpx"])),
    ("kml", Names::OneOf(&["a.kml"])),
    ("geojson", Names::OneOf(&["a.geojson"])),
    ("points", Names::OneOf(&["a.csv"])),
];

static FORMAT: LazyLock<&(&str, Names)> = LazyLock::new(|| {
    let asked = std::env::var("CALIB_FORMAT").expect("CALIB_FORMAT must name the format");
    FORMATS.iter().find(|(name, _)| *name == asked).expect("CALIB_FORMAT must be a format of the list")
});

/// Largest address space, in bytes, whether used or not. A size stated in a file is no reason to exceed it.
const MEMORY: u64 = 2 << 30;

fuzz_target!(init: setrlimit(Resource::AS, MEMORY, MEMORY).expect("the memory limit cannot be set"), |bytes: &[u8]| {
    let (name, names) = &**FORMAT;
    let file = |name: &str, bytes: &[u8]| File { name: name.into(), bytes: bytes.into() };
    let files: Vec<File> = match names {
        Names::AllOf(names) => {
            names.iter().zip(parts(bytes)).map(|(name, bytes)| file(name, bytes)).collect()
        }
        Names::OneOf(names) => {
            let Some((&first, rest)) = bytes.split_first() else { return };
            vec![file(names[usize::from(first) % names.len()], rest)]
        }
    };
    let format =
        calib_formats::format(name.trim_end_matches("-binary")).expect("the format is missing in the registry");
    let Ok(imported) = import(format, &files) else { return };
    // Points in a grid are valid only in a site with a grid.
    if imported.site.ground_points.iter().any(|point| point.crs_m.is_some()) {
        return;
    }
    if let Err(error) = Site::from_json(&imported.site.to_json()) {
        panic!("the imported site is invalid: {error}");
    }
});

fn parts(mut bytes: &[u8]) -> Vec<&[u8]> {
    let mut parts = Vec::new();
    while let Some(at) = bytes.windows(SEPARATOR.len()).position(|window| window == SEPARATOR) {
        parts.push(&bytes[..at]);
        bytes = &bytes[at + SEPARATOR.len()..];
    }
    parts.push(bytes);
    parts
}
