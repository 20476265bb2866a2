//! Fuzz target: reading any drawing must not panic, and its picture has a limited size.
#![no_main]

use calib_plan::{Picture, View, read};
use libfuzzer_sys::fuzz_target;
use rlimit::{Resource, setrlimit};

/// Limit of allocated memory, in bytes. A file must not cause large allocations by its declared sizes.
const MEMORY: u64 = 2 << 30;

fuzz_target!(init: setrlimit(Resource::AS, MEMORY, MEMORY).expect("the memory limit can be set"), |bytes: &[u8]| {
    let Some(Ok(drawing)) = read(bytes, &View::default()) else { return };
    let [width, height] = drawing.facts.size;
    assert!(width.max(height) <= 4096, "{width} x {height}");
    assert!(drawing.facts.metres_per_px.is_none_or(|metres| metres > 0.0));
    assert!(matches!(drawing.picture, Picture::Svg(svg) if svg.ends_with("</svg>")));
});
