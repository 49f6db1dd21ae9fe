//! How often something came, and how much of it is taken at a time.

/// Results of one topic that are taken before the others have their turn.
pub(super) const MAX_A_TURN: usize = 256;

/// Rate of `n` events of which the first and the last are `secs` apart, Hz; 0 of fewer than two.
pub(super) fn per_sec(n: u64, secs: f64) -> f64 {
    if n > 1 && secs > 0.0 {
        (n - 1) as f64 / secs
    } else {
        0.0
    }
}
