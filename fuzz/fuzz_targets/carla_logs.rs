//! `test_fuzz::targets::carla_logs` under libFuzzer.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| test_fuzz::targets::carla_logs(data));
