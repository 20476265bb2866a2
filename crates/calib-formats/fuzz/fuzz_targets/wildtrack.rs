#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| calib_formats_fuzz::read("wildtrack", &["intrinsic_zero/intr_a.xml", "extrinsic/extr_a.xml"], true, bytes));
