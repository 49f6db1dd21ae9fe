//! The way of a view's images through a lens that bends.

use std::sync::Arc;

use sensor_gpu::Gpu;

use super::active::Active;
use crate::lens::{LensData, LensPass, bent_of};
use crate::target::{Surfaces, TargetLayer, Targets};
use crate::view::View;

/// Bends the finished images of a view, and returns them; `None` if its lens does not bend.
pub(super) fn bend(
    gpu: &Gpu,
    pass: &mut LensPass,
    view: &mut View,
    active: &Active,
    encoder: &mut wgpu::CommandEncoder,
) -> Option<Arc<Targets>> {
    let distortion = view.spec.optics.distortion()?;
    let picture = view.spec.intrinsics;
    if gpu.copies_beside() {
        view.bent.swap(0, 1);
    }
    let [bent, twin] = &mut view.bent;
    let kept = bent_of(view.kept);
    let size_px = [picture.width_px, picture.height_px];
    Arc::make_mut(bent).ensure(gpu, size_px, kept, Surfaces::Slim, twin);
    let from = TargetLayer {
        targets: &active.targets,
        layer: active.layer,
    };
    let data = LensData::new(&distortion, &view.drawn, &picture);
    pass.record(gpu, encoder, from, bent, bent_of(active.set), data);
    Some(view.bent[0].clone())
}
