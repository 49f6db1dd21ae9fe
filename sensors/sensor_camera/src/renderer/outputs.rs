//! The start of a job's firing, and the way of its outputs to their readers.

use std::sync::Arc;

use parking_lot::Mutex;
use schema_frames::Modality;
use sensor_core::Scene;
use sensor_gpu::{CopyBatch, Gpu};
use sensor_spec::ExposureMode;

use super::modality::image_of;
use crate::dvs::{EventCamera, EventList};
use crate::post;
use crate::target::{Target, TargetLayer};
use crate::view::{DvsMaps, Output, Plan, View, ViewJob, ViewSpec};

/// Time since the view's previous firing.
pub(super) fn window_nanos(view: &View, scene: &Scene) -> u64 {
    view.previous.as_ref().map_or(0, |firing| {
        scene.sim_time.0.saturating_sub(firing.sim_time.0)
    })
}

/// Drops state that must not outlive an episode or the last reader.
pub(super) fn begin_firing(gpu: &Gpu, job: &mut ViewJob<'_, '_>, scene: &Scene) {
    let view: &mut View = job.view;
    if view
        .previous
        .as_ref()
        .is_some_and(|firing| firing.episode != scene.assets.episode)
    {
        view.reset();
    }
    if !job
        .outputs
        .iter()
        .any(|output| output.modality == Modality::Dvs)
    {
        view.dvs = None;
        view.gpu_events = None;
    }
    let has_meter =
        view.spec.optics.exposure.mode == ExposureMode::Histogram && view.spec.optics.postprocess;
    if has_meter
        && job
            .outputs
            .iter()
            .any(|output| output.modality == Modality::Rgb)
    {
        view.meter_begins = view.meter.is_none();
        view.meter.get_or_insert_with(|| post::meter(gpu));
    } else {
        view.meter = None;
        view.meter_begins = false;
    }
}

/// Records the copies of a job, and returns what to do for each output once the GPU is done.
pub(super) fn plan_outputs<'a>(
    job: &mut ViewJob<'_, 'a>,
    TargetLayer { targets, layer }: TargetLayer<'_>,
    scene: &Scene,
    batch: &mut CopyBatch<'a>,
    mut list: Option<EventList>,
) -> Vec<Plan<'a>> {
    let view: &mut View = job.view;
    let window_nanos = window_nanos(view, scene);
    let mut plans = Vec::with_capacity(job.outputs.len());
    for Output { modality, place } in job.outputs.drain(..) {
        let texture = |target: Target| &targets.get(target).texture;
        match image_of(modality) {
            Some(target) => {
                let is_flow = modality == Modality::Flow;
                let first = is_flow && view.previous.is_none()
                    || modality == Modality::Rgb && view.meter_begins;
                let (image, n_bytes) = (targets.get(target), target.element_bytes());
                let copy = match image.is_shared {
                    true => {
                        batch.shared_layer(&image.texture, layer, n_bytes, place, &targets.reads)
                    }
                    false => batch.texture_layer(&image.texture, layer, n_bytes, place),
                };
                plans.push(Plan::Copied {
                    modality,
                    copy,
                    first,
                    window_nanos: if is_flow { window_nanos } else { 0 },
                });
            }
            None => {
                if let Some(list) = list.take() {
                    plans.push(Plan::EventList {
                        place,
                        list,
                        window_nanos,
                    });
                    continue;
                }
                let mut map = |target: Target| {
                    batch.map_texture(texture(target), layer, target.element_bytes())
                };
                let maps = DvsMaps {
                    luminance: map(Target::Luminance),
                    flow: map(Target::Flow),
                    depth: map(Target::Depth),
                    instance: map(Target::Instance),
                    class: map(Target::Class),
                };
                let state = view
                    .dvs
                    .get_or_insert_with(|| Arc::new(Mutex::new(event_camera(&view.spec))))
                    .clone();
                plans.push(Plan::Events {
                    place,
                    maps,
                    state,
                    window_nanos,
                });
            }
        }
    }
    plans
}

fn event_camera(spec: &ViewSpec) -> EventCamera {
    let size_px = [spec.intrinsics.width_px, spec.intrinsics.height_px];
    EventCamera::new(spec.dvs.clone(), size_px, spec.seed, spec.sensor_id as u64)
}
