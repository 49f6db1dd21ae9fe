//! `test_fuzz::targets::browsers` under cargo-fuzz.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| test_fuzz::targets::browsers(data));
