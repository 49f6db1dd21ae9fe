//! Frames of cameras: all views of a tick in one submission, sent when the GPU has finished them.

use anyhow::Context as _;
use schema_bus::{FrameLoan, mono_now};
use schema_frames::{FrameHeader, Modality};
use sensor_camera::{CameraRenderer, Output, Place, Submission, ViewJob};

use super::shot::{Due, Shot, TickView};
use crate::rig::Waking;
use crate::sensor::{Model, Sensor};
use crate::topic::Audience;

/// Views of a tick that the GPU has not finished.
pub(super) struct PendingViews {
    submission: Submission<'static>,
    frames: Vec<PendingFrame>,
}

struct PendingFrame {
    sensor_idx: usize,
    topic_idx: usize,
    view_idx: usize,
    output_idx: usize,
    loan: FrameLoan,
    header: FrameHeader,
}

impl PendingViews {
    /// Sensors that its frames belong to; one with several modalities comes several times.
    pub fn sensor_idxs(&self) -> impl Iterator<Item = usize> {
        self.frames.iter().map(|frame| frame.sensor_idx)
    }
}

/// Renders the views of the sensors that are due; `None` if no frame comes of it. `due` is in the
/// order of `sensors`.
pub(super) fn submit(
    sensors: &mut [Sensor],
    renderer: &mut CameraRenderer,
    tick: &TickView<'_>,
    due: &[Due],
    audience: Audience,
) -> anyhow::Result<Option<PendingViews>> {
    let mut jobs = Vec::new();
    let mut frames = Vec::new();
    let mut due = due.iter().peekable();
    for (sensor_idx, sensor) in sensors.iter_mut().enumerate() {
        let Some(due) = due.next_if(|due| due.sensor_idx == sensor_idx) else {
            continue;
        };
        let audience = sensor.audience(audience);
        let shot = Shot::new(tick, due, sensor, audience);
        let Model::View(view) = &mut sensor.model else {
            continue;
        };
        let mut outputs = Vec::new();
        for (topic_idx, topic) in sensor.topics.iter_mut().enumerate() {
            let Some(loan) = topic.loan_if_read(audience) else {
                continue;
            };
            let target = topic
                .target()
                .cloned()
                .expect("topics of views have a target while they have memory");
            let place = Place::Shm {
                target,
                offset_bytes: loan
                    .offset_in_segment()
                    .expect("the segment was asked for when the topic was opened"),
                capacity_bytes: topic.max_payload_bytes(),
            };
            let mut header = shot.header(sensor.actor, topic.modality);
            header.intrinsics_px = view.intrinsics().as_array();
            header.set_image(view.intrinsics().width_px, view.intrinsics().height_px);
            frames.push(PendingFrame {
                sensor_idx,
                topic_idx,
                view_idx: jobs.len(),
                output_idx: outputs.len(),
                loan,
                header,
            });
            outputs.push(Output {
                modality: topic.modality,
                place,
            });
        }
        jobs.push(ViewJob {
            view,
            world_from_sensor: shot.world_from_sensor,
            outputs,
        });
    }
    if jobs.is_empty() {
        return Ok(None);
    }
    let submission = renderer.render(tick.scene, jobs).context("cannot render")?;
    Ok((!frames.is_empty()).then_some(PendingViews { submission, frames }))
}

/// Waits for views and sends them, `ticks_in_flight` ticks late.
pub(super) fn finish(
    sensors: &mut [Sensor],
    pending: PendingViews,
    ticks_in_flight: u32,
    audience: Audience,
) -> anyhow::Result<()> {
    let results = pending
        .submission
        .wait()
        .context("the GPU did not finish its frames")?;
    let rendered_mono_nanos = mono_now().0;
    let mut waking = Waking::default();
    for frame in pending.frames {
        let sensor = &mut sensors[frame.sensor_idx];
        let audience = sensor.audience(audience);
        let topic = &mut sensor.topics[frame.topic_idx];
        let result = &results[frame.view_idx].outputs[frame.output_idx];
        let mut header = frame.header;
        if topic.modality == Modality::Dvs {
            header.set_list((result.n_bytes / topic.modality.element_bytes()) as u32);
            topic.counts.n_overflowed += result.n_dropped;
        }
        if result.first {
            header.flags |= FrameHeader::FIRST;
        }
        if matches!(topic.modality, Modality::Dvs | Modality::Flow) && result.window_nanos != 0 {
            header.window_nanos = result.window_nanos;
        }
        header.cpu_copies = result.cpu_copies;
        header.rendered_mono_nanos = rendered_mono_nanos;
        header.ticks_in_flight = ticks_in_flight;
        topic.send(frame.loan, header, audience);
        waking.add(&sensor.rig);
    }
    waking.wake();
    Ok(())
}
