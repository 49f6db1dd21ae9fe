//! Tracks until when copies read a group of textures.

use std::sync::atomic::{AtomicU64, Ordering};

/// Until when copies read a group of textures that submission after submission draws into.
///
/// Only for textures made by [`crate::Gpu::shared_texture_layers`].
#[derive(Debug, Default)]
pub struct Reads {
    /// Number of the newest copy; 0 is none.
    newest: AtomicU64,
}

impl Reads {
    pub(crate) fn newest(&self) -> u64 {
        self.newest.load(Ordering::Acquire)
    }

    pub(crate) fn add(&self, number: u64) {
        self.newest.fetch_max(number, Ordering::AcqRel);
    }
}
