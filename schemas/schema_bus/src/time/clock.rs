//! The clock of a frame's stamps.

use schema_types::MonoTime;

/// `CLOCK_MONOTONIC` now, the clock of a frame's stamps.
pub fn mono_now() -> MonoTime {
    let now = nix::time::clock_gettime(nix::time::ClockId::CLOCK_MONOTONIC)
        .expect("Linux has a monotonic clock");
    MonoTime(now.tv_sec() as u64 * 1_000_000_000 + now.tv_nsec() as u64)
}
