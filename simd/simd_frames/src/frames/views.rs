//! Frames of cameras: all views of a tick in one submission, sent when the GPU has finished them.

use std::time::Duration;

use anyhow::{Context as _, bail};
use schema_bus::mono_now;
use schema_frames::{FrameHeader, Modality};
use sensor_camera::{CameraRenderer, Output, Submission, ViewJob};
use sensor_gpu::{Gpu, GpuError};

use super::batches::{self, BatchFrame, Batching, Done, Moment};
use super::shot::{Due, Shot, TickView};
use crate::batch::Batch;
use crate::rig::Waking;
use crate::sensor::{Model, Sensor};
use crate::stages;
use crate::topic::{Audience, GpuLoan, Lent, Loans};

/// A camera whose images found no memory on the GPU is left out for this long, nanoseconds.
const REFUSED_NANOS: u64 = 10_000_000_000;

/// Views of a tick that the GPU has not finished.
pub(super) struct PendingViews {
    submission: Lent<Submission<'static>>,
    frames: Vec<PendingFrame>,
    /// Those of batches; their loans come after those of the others.
    batch_frames: Vec<BatchFrame>,
}

struct PendingFrame {
    sensor_idx: usize,
    topic_idx: usize,
    view_idx: usize,
    /// Its first output: that in shared memory, if it has one.
    output_idx: usize,
    /// Whether it has a loan of shared memory, in the order of the submission's.
    is_in_memory: bool,
    /// Its slot on the GPU, if it has one; dropped after the submission.
    on_gpu: Option<GpuLoan>,
    header: FrameHeader,
}

impl PendingViews {
    /// Sensors that its frames belong to; one with several modalities comes several times.
    pub fn sensor_idxs(&self) -> impl Iterator<Item = usize> {
        self.frames.iter().map(|frame| frame.sensor_idx)
    }

    /// Whether the GPU has drawn them, after waiting for `most` at most.
    pub fn are_drawn_within(&self, most: Duration) -> bool {
        self.submission.is_drawn_within(most)
    }

    /// If there are events to be made, waits for the GPU and lets other threads make them.
    pub fn begin_events(&mut self) -> bool {
        let has_events = self.submission.has_events();
        if has_events {
            let _span = stages::READBACK.span();
            self.submission.begin_events();
        }
        has_events
    }
}

/// The sensors and batches that images are made for.
pub(super) struct Sources<'a> {
    pub sensors: &'a mut [Sensor],
    pub batches: &'a mut [Batch],
}

/// What images are made with.
pub(super) struct Drawing<'a> {
    pub gpu: &'a Gpu,
    pub renderer: &'a mut CameraRenderer,
}

/// Renders the views of the sensors that are due; `None` if no frame comes of it. `due` is in the
/// order of the sensors.
pub(super) fn submit(
    sources: Sources<'_>,
    drawing: Drawing<'_>,
    tick: &TickView<'_>,
    due: &[Due],
    audience: Audience,
) -> anyhow::Result<Option<PendingViews>> {
    let _span = stages::RECORD.span();
    let Sources { sensors, batches } = sources;
    let Drawing { gpu, renderer } = drawing;
    let now_nanos = mono_now().0;
    let mut jobs = Vec::new();
    let (mut frames, mut loans) = (Vec::new(), Vec::new());
    let moment = Moment {
        tick,
        due,
        now_nanos,
    };
    let mut batching = Batching::begin(batches, sensors, &moment);
    let mut due = due.iter().peekable();
    for (sensor_idx, sensor) in sensors.iter_mut().enumerate() {
        let Some(due) = due.next_if(|due| due.sensor_idx == sensor_idx) else {
            continue;
        };
        if now_nanos < sensor.refused_until_nanos {
            continue;
        }
        let audience = sensor.audience(audience);
        let shot = Shot::new(tick, due, sensor, audience);
        let Some(view) = sensor.model.view() else {
            continue;
        };
        let lens = (
            view.intrinsics(),
            view.lens().map_or([0.0; 4], |lens| lens.as_array()),
        );
        let model = &sensor.model;
        let mut outputs = Vec::new();
        for (topic_idx, topic) in sensor.topics.iter_mut().enumerate() {
            if !model.renders(topic.modality) {
                continue;
            }
            let slots = match topic.modality.is_image() {
                true => topic.loans_if_read(audience),
                false => Loans {
                    host: topic.loan_if_read(audience),
                    gpu: None,
                },
            };
            let Loans { host, gpu } = slots;
            let output_idx = outputs.len();
            let is_in_memory = host.is_some();
            let host = host.map(|loan| {
                let (loan, place) = topic.lend(loan);
                loans.push(loan);
                place
            });
            let (on_gpu, place_on_gpu) = gpu.unzip();
            let modality = topic.modality;
            let places = host.into_iter().chain(place_on_gpu);
            outputs.extend(places.map(|place| Output { modality, place }));
            if output_idx == outputs.len() {
                continue;
            }
            let mut header = shot.header(sensor.actor, topic.modality);
            match model {
                Model::Lens(camera) => camera.tell(&mut header),
                _ => {
                    let (intrinsics, bend) = lens;
                    header.intrinsics_px = intrinsics.as_array();
                    header.lens = bend;
                    header.set_image(intrinsics.width_px, intrinsics.height_px);
                }
            }
            frames.push(PendingFrame {
                sensor_idx,
                topic_idx,
                view_idx: jobs.len(),
                output_idx,
                is_in_memory,
                on_gpu,
                header,
            });
        }
        batching.add_to(sensor_idx, sensor, jobs.len(), &mut outputs);
        let Some(view) = sensor.model.view_mut() else {
            continue;
        };
        jobs.push(ViewJob {
            view,
            world_from_sensor: shot.world_from_sensor,
            outputs,
        });
    }
    if jobs.is_empty() {
        return Ok(None);
    }
    let (batch_frames, of_batches) = batching.end();
    loans.extend(of_batches);
    let rendered = gpu.try_to("the images of a tick", || renderer.render(tick.scene, jobs));
    let submission = match rendered {
        Ok(submission) => submission.context("cannot render")?,
        Err(error @ GpuError::OutOfMemory { .. }) => {
            for frame in frames {
                sensors[frame.sensor_idx].topics[frame.topic_idx]
                    .counts
                    .n_dropped += 1;
            }
            batches::drop_all(batches, batch_frames);
            refuse_what_does_not_fit(sensors, batches, renderer, &error)?;
            return Ok(None);
        }
        Err(error) => return Err(error).context("cannot render"),
    };
    let submission = Lent::new(submission, loans);
    let is_empty = frames.is_empty() && batch_frames.is_empty();
    Ok((!is_empty).then_some(PendingViews {
        submission,
        frames,
        batch_frames,
    }))
}

/// After a tick whose images found no memory: gives back what the cameras have on the GPU, makes the
/// images of one after the other, and leaves out those that do not fit for a while.
fn refuse_what_does_not_fit(
    sensors: &mut [Sensor],
    batches: &[Batch],
    renderer: &mut CameraRenderer,
    error: &GpuError,
) -> anyhow::Result<()> {
    renderer.recover();
    for sensor in sensors.iter_mut() {
        if let Some(view) = sensor.model.view_mut() {
            view.release();
        }
    }
    let now_nanos = mono_now().0;
    let mut held = Vec::new();
    for sensor in sensors.iter_mut() {
        let mut of_sensor = batches.iter().filter(|batch| batch.has_camera(sensor));
        let is_read = sensor.topics.iter().any(|topic| topic.n_readers() > 0)
            || of_sensor.any(Batch::is_read);
        let modalities = sensor.rendered();
        let Some(view) = sensor.model.view() else {
            continue;
        };
        if !is_read || now_nanos < sensor.refused_until_nanos {
            continue;
        }
        match renderer.admit(view, &modalities, 0) {
            Ok(images) => held.push(images),
            Err(GpuError::Lost { .. } | GpuError::Hung { .. }) => bail!("{error}"),
            Err(error) => {
                sensor.refused_until_nanos = now_nanos.saturating_add(REFUSED_NANOS);
                tracing::warn!(
                    sensor = format!("{}/{}", sensor.rig.name, sensor.name),
                    %error,
                    "a camera makes no images for 10 s"
                );
            }
        }
    }
    if held.is_empty() {
        tracing::warn!(%error, "no camera's images fit the GPU");
    }
    Ok(())
}

/// Waits for views and sends them, `ticks_in_flight` ticks late, unless `may_send` says that they are
/// not this process's to send any more.
pub(super) fn finish(
    sources: Sources<'_>,
    gpu: Option<&Gpu>,
    pending: PendingViews,
    ticks_in_flight: u32,
    audience: Audience,
    may_send: &mut dyn FnMut() -> bool,
) -> anyhow::Result<()> {
    let Sources { sensors, batches } = sources;
    let readback = stages::READBACK.span();
    let (results, mut loans) = pending
        .submission
        .wait(Submission::wait)
        .context("the GPU did not finish its frames")?;
    drop(readback);
    if !may_send() {
        return Ok(());
    }
    let _span = stages::PUBLISH.span();
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
        if let Some(on_gpu) = frame.on_gpu {
            let on_gpu_header = FrameHeader {
                cpu_copies: 0,
                ..header
            };
            topic.send_on_gpu(on_gpu, &on_gpu_header, !frame.is_in_memory);
        }
        if frame.is_in_memory
            && let Some(loan) = loans.next()
        {
            match topic.modality.is_image() {
                true => topic.send(loan, header, audience),
                false => topic.send_list(gpu, loan, header, audience)?,
            }
        }
        waking.add(&sensor.rig);
    }
    let done = Done {
        rendered_mono_nanos,
        ticks_in_flight,
    };
    batches::send(
        batches,
        pending.batch_frames,
        &results,
        loans,
        done,
        &mut waking,
    );
    waking.wake();
    Ok(())
}
