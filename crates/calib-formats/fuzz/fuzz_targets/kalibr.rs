#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| calib_formats_fuzz::read("kalibr", &["camchain.yaml"], false, bytes));
