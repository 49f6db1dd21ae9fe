//! Assigns targets to the views of a tick.

use std::sync::Arc;

use sensor_gpu::Gpu;
use sensor_spec::Intrinsics;

use super::active::Active;
use crate::target::{PoolKey, Surfaces, TargetPool};
use crate::view::ViewJob;

/// Gives each drawn view targets of its own.
pub(super) fn assign_drawn(
    gpu: &Gpu,
    surfaces: Surfaces,
    jobs: &mut [ViewJob<'_, '_>],
    active: &mut [Active],
) {
    for active in active {
        let view = &mut *jobs[active.job_idx].view;
        let Intrinsics {
            width_px,
            height_px,
            ..
        } = view.drawn;
        if gpu.copies_beside() {
            view.targets.swap(0, 1);
        }
        let [targets, twin] = &mut view.targets;
        Arc::make_mut(targets).ensure(gpu, [width_px, height_px], view.kept, surfaces, twin);
        view.turns = None;
        active.targets = view.targets[0].clone();
    }
}

/// Gives computed views layers of shared textures. Sorts the views so that those which one dispatch
/// can handle stand next to each other.
pub(super) fn assign_computed(
    gpu: &Gpu,
    pool: &mut TargetPool,
    jobs: &mut [ViewJob<'_, '_>],
    active: &mut [Active],
) {
    let key = |active: &Active| {
        let view = &jobs[active.job_idx].view;
        (
            ([view.drawn.width_px, view.drawn.height_px], view.kept),
            active.set,
            active.lamps.n > 0,
        )
    };
    active.sort_by_key(key);
    let mut turns_of = Vec::with_capacity(active.len());
    for alike in active.chunk_by_mut(|a, b| key(a).0 == key(b).0) {
        let (size_px, set) = key(&alike[0]).0;
        let most = TargetPool::max_layers(gpu, size_px);
        for (part, alike) in (0..).zip(alike.chunks_mut(most as usize)) {
            let turns = pool.take(gpu, PoolKey { size_px, set, part }, alike.len() as u32);
            let targets = turns.next();
            for (layer, active) in (0..).zip(alike) {
                (active.targets, active.layer) = (targets.clone(), layer);
                turns_of.push(turns.clone());
            }
        }
    }
    for (active, turns) in active.iter().zip(turns_of) {
        let view = &mut *jobs[active.job_idx].view;
        if view.turns.replace(turns).is_none() {
            view.targets = Default::default();
        }
    }
}
