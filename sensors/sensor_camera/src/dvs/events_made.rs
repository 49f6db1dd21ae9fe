//! The result of a window.

/// Result of one window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EventsMade {
    /// Events written.
    pub n_events: usize,
    /// Events that did not fit.
    pub n_dropped: u64,
    /// Whether this was the first image, which makes no events.
    pub first: bool,
}
