//! A view that has something to draw in this tick.

use std::sync::Arc;

use crate::camera_motion::CameraMotion;
use crate::lamps::{LampInView, LampRange};
use crate::shadow::Eye;
use crate::target::{TargetSet, Targets};
use crate::view::ViewJob;
use crate::visible::Drawn;

/// A job with something to draw.
pub(super) struct Active {
    pub job_idx: usize,
    pub set: TargetSet,
    pub motion: CameraMotion,
    pub drawn: Drawn,
    /// Index of its lookup in shadow maps, if it has one.
    pub eye: Option<usize>,
    pub lamps_in_view: Vec<LampInView>,
    pub lamps: LampRange,
    pub targets: Arc<Targets>,
    /// Its layer in these targets.
    pub layer: u32,
}

/// The eyes of all lit views; each view gets the index of its eye.
pub(super) fn eyes_of(active: &mut [Active], jobs: &[ViewJob<'_, '_>]) -> Vec<Eye> {
    let mut eyes = Vec::new();
    for active in active.iter_mut().filter(|active| active.set.is_lit()) {
        active.eye = Some(eyes.len());
        let focal_px = jobs[active.job_idx].view.spec.intrinsics.focal_px;
        eyes.push(Eye {
            world_from_camera: active.motion.world_from_camera,
            focal_px,
        });
    }
    eyes
}

/// Sets where each view's instances begin in the list of all views that are recorded together: first
/// those with their matrices, then those whose matrices a shader makes.
pub(super) fn number_instances(active: &mut [Active]) {
    let mut first = 0;
    for Active { drawn, .. } in &mut *active {
        drawn.first_instance = first;
        first += drawn.instances.len() as u32;
    }
    for Active { drawn, .. } in active {
        drawn.first_still = first;
        first += drawn.still.len() as u32;
    }
}
