//! Counts of what was given to the GPU. Tests use them to show that outputs without readers cost
//! nothing.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Running counts of one [`crate::Gpu`].
#[derive(Debug, Default)]
pub struct Counters {
    passes: AtomicU64,
    draws: AtomicU64,
    triangles: AtomicU64,
    copies: AtomicU64,
    submissions: AtomicU64,
}

/// Values of [`Counters`] at one moment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Render and compute passes.
    pub passes: u64,
    /// Draw calls.
    pub draws: u64,
    /// Triangles given to draw calls.
    pub triangles: u64,
    /// Copies out of textures and buffers.
    pub copies: u64,
    /// Queue submissions.
    pub submissions: u64,
}

impl Counters {
    /// One more pass.
    pub fn add_pass(&self) {
        self.passes.fetch_add(1, Relaxed);
    }

    /// One more draw call of so many triangles.
    pub fn add_draw(&self, n_triangles: u64) {
        self.draws.fetch_add(1, Relaxed);
        self.triangles.fetch_add(n_triangles, Relaxed);
    }

    /// More draw calls, of so many triangles together.
    pub fn add_draws(&self, n_draws: u64, n_triangles: u64) {
        self.draws.fetch_add(n_draws, Relaxed);
        self.triangles.fetch_add(n_triangles, Relaxed);
    }

    pub(crate) fn add_submission(&self, n_copies: u64) {
        self.copies.fetch_add(n_copies, Relaxed);
        self.submissions.fetch_add(1, Relaxed);
    }

    /// The current values.
    pub fn counts(&self) -> Counts {
        Counts {
            passes: self.passes.load(Relaxed),
            draws: self.draws.load(Relaxed),
            triangles: self.triangles.load(Relaxed),
            copies: self.copies.load(Relaxed),
            submissions: self.submissions.load(Relaxed),
        }
    }
}

impl Counts {
    /// What was added since `earlier`.
    pub fn since(self, earlier: Counts) -> Counts {
        Counts {
            passes: self.passes - earlier.passes,
            draws: self.draws - earlier.draws,
            triangles: self.triangles - earlier.triangles,
            copies: self.copies - earlier.copies,
            submissions: self.submissions - earlier.submissions,
        }
    }
}
