//! Labels of cameras with a lens: the processor casts a ray through each pixel.

use schema_bus::mono_now;
use schema_frames::{FrameHeader, Modality};
use sensor_gpu::Gpu;
use sensor_ray::LabelImages;

use super::rays::TickRays;
use super::shot::Shot;
use crate::sensor::{Model, Sensor};
use crate::stages;

/// Casts the images that are read and sends them, unless `may_send` says that they are not this
/// process's to send any more; returns whether any was sent.
pub(super) fn cast(
    shot: &Shot<'_>,
    sensor: &mut Sensor,
    rays: &mut TickRays<'_>,
    gpu: Option<&Gpu>,
    may_send: &mut dyn FnMut() -> bool,
) -> anyhow::Result<bool> {
    let Model::Lens(camera) = &mut sensor.model else {
        return Ok(false);
    };
    let audience = shot.audience;
    let mut loans = Vec::new();
    for (topic_idx, topic) in sensor.topics.iter_mut().enumerate() {
        // Its view makes these.
        if topic.modality == Modality::Rgb {
            continue;
        }
        if let Some(loan) = topic.loan_if_read(audience) {
            loans.push((topic_idx, topic.modality, loan));
        }
    }
    if loans.is_empty() {
        return Ok(false);
    }
    let _span = stages::LENS.span();
    let mut images = LabelImages::default();
    for (_, modality, loan) in &mut loans {
        let image = match modality {
            Modality::Depth => &mut images.depth,
            Modality::Semantic => &mut images.class,
            Modality::Instance => &mut images.instance,
            Modality::Normals => &mut images.normals,
            _ => continue,
        };
        *image = Some(loan.payload_mut());
    }
    let place = &shot.world_from_sensor;
    if let Some(cast) = &camera.rays {
        cast.cast(rays.current(), place, &camera.hidden, images);
    }
    let rendered_mono_nanos = mono_now().0;
    if !may_send() {
        return Ok(false);
    }
    for (topic_idx, modality, loan) in loans {
        let mut header = FrameHeader {
            rendered_mono_nanos,
            ..shot.header(sensor.actor, modality)
        };
        camera.tell(&mut header);
        sensor.topics[topic_idx].send_list(gpu, loan, header, audience)?;
    }
    Ok(true)
}
