//! Whether the images of a view fit the GPU: how many bytes they take, and a try.

use std::sync::Arc;

use sensor_gpu::{Gpu, GpuError};

use crate::target::{Surfaces, Target, TargetSet, Targets};
use crate::view::View;

/// Bytes of a texel of the z-buffer.
const Z_BYTES: u64 = 4;

/// Images that were made to see whether they fit. They take their memory until they are dropped.
#[derive(Debug)]
pub struct HeldImages {
    _targets: Vec<Arc<Targets>>,
}

impl HeldImages {
    /// Holds those of another one, too.
    pub(super) fn add(&mut self, other: HeldImages) {
        self._targets.extend(other._targets);
    }
}

/// Bytes of the targets of `set` for a view, on a GPU that copies them `n_sets` at a time.
pub(super) fn target_bytes(view: &View, set: TargetSet, n_sets: u64) -> u64 {
    let texel_bytes = Target::ALL
        .into_iter()
        .filter(|target| set.contains(*target))
        .map(|target| target.element_bytes() as u64)
        .sum::<u64>();
    let n_texels = u64::from(view.drawn.width_px) * u64::from(view.drawn.height_px);
    n_texels * (texel_bytes + Z_BYTES) * n_sets
}

/// Makes the targets of a view.
pub(super) fn try_targets(
    gpu: &Gpu,
    view: &View,
    set: TargetSet,
    surfaces: Surfaces,
) -> Result<HeldImages, GpuError> {
    let size_px = [view.drawn.width_px, view.drawn.height_px];
    let make = || {
        let mut first = Targets::default();
        first.ensure(gpu, size_px, set, surfaces, &Targets::default());
        let mut targets = vec![first];
        if gpu.copies_beside() {
            let mut second = Targets::default();
            second.ensure(gpu, size_px, set, surfaces, &targets[0]);
            targets.push(second);
        }
        targets.into_iter().map(Arc::new).collect()
    };
    let _targets = gpu.try_to(&what(size_px), make)?;
    Ok(HeldImages { _targets })
}

/// What the targets are, for a sentence.
pub(super) fn what([width, height]: [u32; 2]) -> String {
    format!("the images of a camera of {width} x {height} pixels")
}
