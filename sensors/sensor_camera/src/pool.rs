//! Targets that views of equal size share, a layer for each, so that one dispatch serves them all.
//!
//! Who holds a layer changes from tick to tick; nothing in it outlives a submission. The textures live as long as a view that was last
//! drawn into them: the pool itself keeps none.

use std::sync::{Arc, Weak};

use sensor_gpu::Gpu;

use crate::targets::{Target, TargetSet, Targets};

/// Largest texture, bytes: drivers refuse allocations of a few gigabytes.
const MAX_TEXTURE_BYTES: u64 = 1 << 30;
/// Submissions after which targets that were never more than half in use are made anew.
const MAX_HALF_EMPTY: u32 = 256;

/// Whose targets lie in one texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct PoolKey {
    pub size_px: [u32; 2],
    pub set: TargetSet,
    /// Counts up where there are more views than one texture has layers.
    pub part: u32,
}

#[derive(Debug)]
struct Entry {
    key: PoolKey,
    targets: Weak<Targets>,
    n_half_empty: u32,
}

/// The targets in use.
#[derive(Debug, Default)]
pub(crate) struct TargetPool {
    entries: Vec<Entry>,
}

impl TargetPool {
    /// Views of this size whose targets go into one texture, at most.
    pub fn max_layers(gpu: &Gpu, [width, height]: [u32; 2]) -> u32 {
        let layer_bytes = width as u64 * height as u64 * Target::Surface.element_bytes() as u64;
        let fit = (MAX_TEXTURE_BYTES / layer_bytes).max(1) as u32;
        fit.min(gpu.device().limits().max_texture_array_layers)
    }

    /// Targets with at least `n_layers` layers.
    pub fn take(&mut self, gpu: &Gpu, key: PoolKey, n_layers: u32) -> Arc<Targets> {
        self.entries.retain(|entry| entry.targets.strong_count() > 0);
        let known = self.entries.iter().position(|entry| entry.key == key);
        if let Some(entry) = known.map(|i| &mut self.entries[i])
            && let Some(targets) = entry.targets.upgrade()
            && targets.n_layers() >= n_layers
        {
            entry.n_half_empty = if 2 * n_layers > targets.n_layers() { 0 } else { entry.n_half_empty + 1 };
            if entry.n_half_empty < MAX_HALF_EMPTY {
                return targets;
            }
        }
        let targets = Arc::new(Targets::layered(gpu, key.size_px, key.set, n_layers));
        let entry = Entry { key, targets: Arc::downgrade(&targets), n_half_empty: 0 };
        match known {
            Some(i) => self.entries[i] = entry,
            None => self.entries.push(entry),
        }
        targets
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sensor_gpu::GpuOptions;

    /// Views of equal size share textures while one of them lives; more of them get larger ones, and what nobody holds is gone.
    #[test]
    fn targets_live_as_long_as_a_view_that_was_drawn_into_them() {
        let gpu = Gpu::open(&GpuOptions::default()).unwrap_or_else(|error| panic!("{error}"));
        let mut pool = TargetPool::default();
        let key = |size_px| PoolKey { size_px, set: Target::Depth.bit(), part: 0 };
        let first = pool.take(&gpu, key([16, 16]), 3);
        assert_eq!(first.n_layers(), 3);
        assert!(Arc::ptr_eq(&first, &pool.take(&gpu, key([16, 16]), 2)));
        let second = pool.take(&gpu, key([16, 16]), 5);
        assert_eq!(second.n_layers(), 5);
        assert!(Arc::ptr_eq(&second, &pool.take(&gpu, key([16, 16]), 3)));
        drop((first, second));
        for side in 1..200 {
            drop(pool.take(&gpu, key([side, side]), 1));
            assert_eq!(pool.entries.len(), 1, "what nobody holds is kept");
        }
        // Ten places of which one is used shrink after a while.
        let mut held = pool.take(&gpu, key([16, 16]), 10);
        for _ in 0..MAX_HALF_EMPTY {
            held = pool.take(&gpu, key([16, 16]), 1);
        }
        assert_eq!(held.n_layers(), 1);
    }
}
