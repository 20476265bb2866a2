//! Fuzz target: reading, writing and solving any text must not panic.
#![no_main]

use calib_site::{Method, Options, Site};
use libfuzzer_sys::fuzz_target;
use rlimit::{Resource, setrlimit};

/// Limit of allocated memory, in bytes. A file must not cause large allocations by its declared sizes.
const MEMORY: u64 = 2 << 30;

fuzz_target!(init: setrlimit(Resource::AS, MEMORY, MEMORY).expect("the memory limit can be set"), |text: &str| {
    let Ok(site) = Site::from_json(text) else { return };
    let again = Site::from_json(&site.to_json()).expect("a written site must be valid");
    assert_eq!(again, site, "writing and reading must not change the site");
    // The solving time grows with the number of annotations. A few lines of every kind cover the code.
    if site.cameras.len() > 3 || site.cameras.iter().any(|camera| camera.annotations.len() > 12) {
        return;
    }
    for method in [Method::MaximumLikelihood, Method::Paper] {
        let solved = site.calibrate(&Options { method, ..Options::default() }).write_into(&site);
        if let Err(error) = Site::from_json(&solved.to_json()) {
            panic!("the solved site cannot be read: {error}");
        }
    }
});
