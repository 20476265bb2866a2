#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| calib_formats_fuzz::read("nvidia", &["calibration.json", "camInfo/a.yml", "transforms.yml"], false, bytes));
