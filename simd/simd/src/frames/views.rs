//! Frames of cameras: all views of a tick in one submission, sent when the GPU is done.

use anyhow::Context as _;
use schema_bus::{FrameLoan, mono_now};
use schema_frames::{FrameHeader, Modality};
use sensor_camera::{Output, Place, Submission, ViewJob};
use sensor_core::scene::Scene;
use sensor_core::schedule::Firing;

use super::{Carrier, Sensors, Stamp, base_header, remember, wake};
use crate::rig::Model;

/// Views of a tick on their way.
pub(super) struct PendingViews {
    submission: Submission<'static>,
    pub frames: Vec<PendingFrame>,
}

pub(super) struct PendingFrame {
    pub sensor_idx: usize,
    topic_idx: usize,
    view_idx: usize,
    output_idx: usize,
    loan: FrameLoan,
    header: FrameHeader,
}

impl Sensors {
    pub(super) fn submit_views(
        &mut self,
        scene: &Scene,
        stamp: &Stamp,
        due: &[(usize, Firing, Carrier)],
    ) -> anyhow::Result<Option<PendingViews>> {
        let mut jobs = Vec::new();
        let mut frames = Vec::new();
        let mut due = due.iter().peekable();
        for (sensor_idx, sensor) in self.sensors.iter_mut().enumerate() {
            let Some((_, firing, carrier)) = due.next_if(|(idx, ..)| *idx == sensor_idx) else {
                continue;
            };
            let Model::View(view) = &mut sensor.model else {
                continue;
            };
            let mut outputs = Vec::new();
            for (topic_idx, topic) in sensor.topics.iter_mut().enumerate() {
                let Some(loan) = topic.loan_if_read(self.read_everything) else {
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
                    capacity_bytes: topic.max_payload_bytes,
                };
                let mut header =
                    base_header(topic.modality, scene, stamp, sensor.actor, firing, carrier);
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
                world_from_sensor: carrier.world_from_sensor.isometry(),
                outputs,
            });
        }
        if jobs.is_empty() {
            return Ok(None);
        }
        let submission = self.renderer.render(scene, jobs).context("cannot render")?;
        Ok((!frames.is_empty()).then_some(PendingViews { submission, frames }))
    }

    /// Waits for views and sends them, so many ticks late.
    pub(super) fn finish_views(
        &mut self,
        pending: PendingViews,
        ticks_in_flight: u32,
    ) -> anyhow::Result<()> {
        let results = pending
            .submission
            .wait()
            .context("the GPU did not finish its frames")?;
        let rendered_mono_nanos = mono_now().0;
        let mut waking = Vec::new();
        for frame in pending.frames {
            let sensor = &mut self.sensors[frame.sensor_idx];
            let topic = &mut sensor.topics[frame.topic_idx];
            let result = &results[frame.view_idx].outputs[frame.output_idx];
            let mut header = frame.header;
            if topic.modality == Modality::Dvs {
                header.set_list((result.n_bytes / topic.modality.element_bytes()) as u32);
                topic.n_overflowed += result.n_dropped;
            }
            if result.first {
                header.flags |= FrameHeader::FIRST;
            }
            if matches!(topic.modality, Modality::Dvs | Modality::Flow) && result.window_nanos != 0
            {
                header.window_nanos = result.window_nanos;
            }
            header.cpu_copies = result.cpu_copies;
            header.rendered_mono_nanos = rendered_mono_nanos;
            header.ticks_in_flight = ticks_in_flight;
            topic.send(frame.loan, header, self.read_everything);
            remember(&mut waking, &sensor.rig);
        }
        wake(&waking);
        Ok(())
    }
}
