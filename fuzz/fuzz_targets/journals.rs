//! `test_fuzz::targets::journals` under libFuzzer.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| test_fuzz::targets::journals(data));
