//! Targets that views of equal size share, one layer each, so that one dispatch serves them all.
//!
//! Layers are assigned anew in every tick; their contents do not outlive a submission and its
//! copies. Textures live as long as a view that was last drawn into them; the pool itself holds
//! none.

use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Weak};

use sensor_gpu::Gpu;

use super::kind::{Target, TargetSet};
use super::targets::Targets;

/// Largest texture, bytes: drivers refuse allocations of a few gigabytes.
const MAX_TEXTURE_BYTES: u64 = 1 << 30;
/// Submissions after which targets that were never more than half full are replaced by smaller
/// ones.
const MAX_HALF_EMPTY: u32 = 256;

/// Views with equal keys share textures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct PoolKey {
    pub size_px: [u32; 2],
    pub set: TargetSet,
    /// Counts up where there are more views than one texture has layers.
    pub part: u32,
}

/// Targets that submissions use in turn: two sets if one is copied while the next submission is
/// drawn, otherwise one.
///
/// Two are enough for any number of submissions in flight, because each queue does one submission
/// after the other.
#[derive(Debug)]
pub(crate) struct Turns {
    sets: Vec<Arc<Targets>>,
    n_taken: AtomicUsize,
}

impl Turns {
    fn new(gpu: &Gpu, key: PoolKey, n_layers: u32) -> Turns {
        let mut sets = vec![Arc::new(Targets::layered(
            gpu,
            key.size_px,
            key.set,
            n_layers,
            None,
        ))];
        if gpu.copies_beside() {
            sets.push(Arc::new(Targets::layered(
                gpu,
                key.size_px,
                key.set,
                n_layers,
                Some(&sets[0]),
            )));
        }
        Turns {
            sets,
            n_taken: AtomicUsize::new(0),
        }
    }

    /// The set for the next submission.
    pub fn next(&self) -> Arc<Targets> {
        self.sets[self.n_taken.fetch_add(1, Relaxed) % self.sets.len()].clone()
    }

    /// How many views a set has room for.
    fn n_layers(&self) -> u32 {
        self.sets[0].n_layers()
    }
}

#[derive(Debug)]
struct Entry {
    key: PoolKey,
    turns: Weak<Turns>,
    n_half_empty: u32,
}

/// The targets in use.
#[derive(Debug, Default)]
pub(crate) struct TargetPool {
    entries: Vec<Entry>,
}

impl TargetPool {
    /// Upper limit of views of this size whose targets fit into one texture.
    pub fn max_layers(gpu: &Gpu, [width, height]: [u32; 2]) -> u32 {
        let layer_bytes = width as u64 * height as u64 * Target::Surface.element_bytes() as u64;
        let fit = (MAX_TEXTURE_BYTES / layer_bytes).max(1) as u32;
        fit.min(gpu.device().limits().max_texture_array_layers)
    }

    /// Targets with at least `n_layers` layers.
    pub fn take(&mut self, gpu: &Gpu, key: PoolKey, n_layers: u32) -> Arc<Turns> {
        self.entries.retain(|entry| entry.turns.strong_count() > 0);
        let known = self.entries.iter().position(|entry| entry.key == key);
        if let Some(entry) = known.map(|i| &mut self.entries[i])
            && let Some(turns) = entry.turns.upgrade()
            && turns.n_layers() >= n_layers
        {
            entry.n_half_empty = if 2 * n_layers > turns.n_layers() {
                0
            } else {
                entry.n_half_empty + 1
            };
            if entry.n_half_empty < MAX_HALF_EMPTY {
                return turns;
            }
        }
        let turns = Arc::new(Turns::new(gpu, key, n_layers));
        let entry = Entry {
            key,
            turns: Arc::downgrade(&turns),
            n_half_empty: 0,
        };
        match known {
            Some(i) => self.entries[i] = entry,
            None => self.entries.push(entry),
        }
        turns
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sensor_gpu::{CopyPath, GpuOptions};

    /// With a copy queue, two consecutive submissions have separate textures for what readers get,
    /// and share all others. Without one, there is a single set.
    #[test]
    fn submissions_take_turns_where_copies_go_on_beside_them() {
        let set = Target::Depth.bit().union(Target::Surface.bit());
        for (copies, n_sets) in [(CopyPath::Behind, 1), (CopyPath::Apart, 2)] {
            let gpu = Gpu::open(&GpuOptions {
                copies,
                ..Default::default()
            })
            .unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(gpu.copies_beside(), n_sets == 2);
            let turns = TargetPool::default().take(
                &gpu,
                PoolKey {
                    size_px: [16, 16],
                    set,
                    part: 0,
                },
                3,
            );
            let taken: Vec<Arc<Targets>> = (0..4).map(|_| turns.next()).collect();
            for (i, j) in [(0, 1), (1, 2), (0, 2), (1, 3)] {
                let is_same =
                    |target: Target| taken[i].get(target).texture == taken[j].get(target).texture;
                assert_eq!(
                    is_same(Target::Depth),
                    (j - i) % n_sets == 0,
                    "{copies:?}: {i} and {j}"
                );
                assert!(is_same(Target::Surface), "{copies:?}: {i} and {j}");
            }
        }
    }

    /// Views of equal size share textures as long as one of them lives. More views get larger
    /// textures, and textures that nobody holds are freed.
    #[test]
    fn targets_live_as_long_as_a_view_that_was_drawn_into_them() {
        let gpu = Gpu::open(&GpuOptions::default()).unwrap_or_else(|error| panic!("{error}"));
        let mut pool = TargetPool::default();
        let key = |size_px| PoolKey {
            size_px,
            set: Target::Depth.bit(),
            part: 0,
        };
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
        // Ten layers of which one is used shrink to one after a while.
        let mut held = pool.take(&gpu, key([16, 16]), 10);
        for _ in 0..MAX_HALF_EMPTY {
            held = pool.take(&gpu, key([16, 16]), 1);
        }
        assert_eq!(held.n_layers(), 1);
    }
}
