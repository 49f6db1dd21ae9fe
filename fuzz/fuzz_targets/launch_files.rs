//! `test_fuzz::targets::launch_files` under libFuzzer.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| test_fuzz::targets::launch_files(data));
