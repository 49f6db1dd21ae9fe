//! `test_fuzz::targets::checkpoints` under libFuzzer.
#![no_main]

use std::sync::Once;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    // The engine panics on numbers that do not fit together, and who reads a checkpoint catches that.
    // libFuzzer's hook would end the process before; what nobody catches still ends it.
    static QUIET: Once = Once::new();
    QUIET.call_once(|| std::panic::set_hook(Box::new(|_| {})));
    test_fuzz::targets::checkpoints(data);
});
