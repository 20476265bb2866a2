//! Whatever the text: no panic, and what is read is written back and solved without one.
#![no_main]

use calib_site::{Method, Options, Site};
use libfuzzer_sys::fuzz_target;
use rlimit::{Resource, setrlimit};

/// Bytes of memory that may be asked for, whether they are used or not: what a file promises is no reason to.
const MEMORY: u64 = 2 << 30;

fuzz_target!(init: setrlimit(Resource::AS, MEMORY, MEMORY).expect("a limit of memory"), |text: &str| {
    let Ok(site) = Site::from_json(text) else { return };
    let again = Site::from_json(&site.to_json()).expect("what is written is valid");
    assert_eq!(again, site, "writing and reading change nothing");
    // Solving grows with what is drawn; a few lines of every kind reach all of it.
    if site.cameras.len() > 3 || site.cameras.iter().any(|camera| camera.annotations.len() > 12) {
        return;
    }
    for method in [Method::MaximumLikelihood, Method::Paper] {
        let solved = site.calibrate(&Options { method, ..Options::default() }).write_into(&site);
        if let Err(error) = Site::from_json(&solved.to_json()) {
            panic!("what was solved cannot be read: {error}");
        }
    }
});
