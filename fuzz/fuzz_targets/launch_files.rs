//! `test_fuzz::targets::launch_files` under cargo-fuzz.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| test_fuzz::targets::launch_files(data));
