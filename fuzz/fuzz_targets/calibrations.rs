//! `test_fuzz::targets::calibrations` under libFuzzer.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| test_fuzz::targets::calibrations(data));
