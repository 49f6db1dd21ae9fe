//! Frames of batches: the places of the images of a tick in their slots, and sending once all images
//! are there. A tick in which an image is missing has no frame: nobody is shown an older one.

use schema_bus::DeviceLoan;
use schema_frames::{FrameHeader, Modality, SceneFiring};
use sensor_camera::{Output, ViewResult};
use sensor_gpu::Place;

use super::shot::{Due, Shot, TickView};
use crate::batch::{self, Batch, GONE};
use crate::rig::Waking;
use crate::sensor::{Maker, Model, Sensor};
use crate::topic::{Audience, GpuLoan, Loans, Topic};

/// Frames of batches that the images of a tick belong into.
#[derive(Default)]
pub(super) struct Batching {
    frames: Vec<BatchFrame>,
    /// What is asked of sensors, by rising index.
    wanted: Vec<Wanted>,
}

/// An image of a sensor that belongs into a frame.
struct Wanted {
    sensor_idx: usize,
    frame_idx: usize,
    image_idx: usize,
    places: Vec<Place<'static>>,
}

/// A frame in the making.
pub(super) struct BatchFrame {
    batch_idx: usize,
    topic_idx: usize,
    modality: Modality,
    /// Its slot in shared memory until the submission has it.
    host: Option<DeviceLoan>,
    is_in_memory: bool,
    /// Its slot on the GPU; dropped after the submission.
    on_gpu: Option<GpuLoan>,
    /// Job and first output of each image.
    images: Vec<(usize, usize)>,
    header: FrameHeader,
}

/// When the images of batches are made.
pub(super) struct Moment<'a> {
    pub tick: &'a TickView<'a>,
    /// The sensors that fire, in the order of all.
    pub due: &'a [Due],
    pub now_nanos: u64,
}

impl Batching {
    /// Loans the slots of all frames of batches that somebody reads and whose cameras all make an
    /// image in this tick.
    pub fn begin(batches: &mut [Batch], sensors: &[Sensor], moment: &Moment<'_>) -> Batching {
        let mut batching = Batching::default();
        for (batch_idx, batch) in batches.iter_mut().enumerate() {
            if batch.is_read() {
                batching.begin_batch(batch_idx, batch, sensors, moment);
            }
        }
        batching.wanted.sort_by_key(|wanted| wanted.sensor_idx);
        batching
    }

    fn begin_batch(
        &mut self,
        batch_idx: usize,
        batch: &mut Batch,
        sensors: &[Sensor],
        moment: &Moment<'_>,
    ) {
        let Moment {
            tick,
            due,
            now_nanos,
        } = *moment;
        let due_of = |sensor_idx: &usize| {
            let at = due.binary_search_by_key(sensor_idx, |due| due.sensor_idx);
            at.ok().map(|at| &due[at])
        };
        let found = batch.find(sensors).to_vec();
        if found.iter().all(|idx| due_of(idx).is_none()) {
            return;
        }
        let is_missing = |idx: &usize| match sensors.get(*idx) {
            Some(sensor) => {
                due_of(idx).is_none()
                    || now_nanos < sensor.refused_until_nanos
                    || !matches!(sensor.model, Model::View(_))
            }
            None => true,
        };
        let missing = found.iter().position(is_missing);
        let missing = missing.map(|image_idx| batch.camera_name(image_idx));
        let first = found.first().and_then(|idx| Some((*idx, due_of(idx)?)));
        for (topic_idx, topic) in batch.topics.iter_mut().enumerate() {
            if !topic.is_read(Audience::Readers) {
                continue;
            }
            if let Some(camera) = &missing {
                topic.drop_frame(&format!("camera {camera:?} makes no image in this tick"));
                continue;
            }
            let Some((first_idx, due)) = first else {
                continue;
            };
            let modality = topic.modality;
            let may_make = |idx: &usize| {
                let topics = &sensors[*idx].topics;
                topics
                    .iter()
                    .any(|it| it.modality == modality && it.may_make())
            };
            let Model::View(view) = &sensors[first_idx].model else {
                continue;
            };
            let lens = view.intrinsics();
            if !found.iter().all(may_make) {
                continue;
            }
            let Loans { host, gpu } = topic.loans_if_read(Audience::Readers);
            let (host, place) = host.map(|loan| topic.lend(loan)).unzip();
            let (on_gpu, place_on_gpu) = gpu.unzip();
            if host.is_none() && on_gpu.is_none() {
                continue;
            }
            let shot = Shot::new(tick, due, &sensors[first_idx], Audience::Readers);
            let header = batch::header(
                &shot.header(sensors[first_idx].actor, modality),
                modality,
                found.len() as u32,
                [lens.width_px, lens.height_px],
            );
            let image_bytes = header.payload_bytes as usize / found.len();
            let mut places: Vec<Vec<Place<'static>>> = found.iter().map(|_| Vec::new()).collect();
            for whole in place.into_iter().chain(place_on_gpu) {
                let parts = whole.parts(found.len(), image_bytes);
                places
                    .iter_mut()
                    .zip(parts)
                    .for_each(|(of, part)| of.push(part));
            }
            let frame_idx = self.frames.len();
            let wanted = found.iter().zip(places).enumerate();
            self.wanted
                .extend(wanted.map(|(image_idx, (sensor_idx, places))| Wanted {
                    sensor_idx: *sensor_idx,
                    frame_idx,
                    image_idx,
                    places,
                }));
            self.frames.push(BatchFrame {
                batch_idx,
                topic_idx,
                modality,
                is_in_memory: host.is_some(),
                host,
                on_gpu,
                images: vec![(0, 0); found.len()],
                header,
            });
        }
    }

    /// Adds what batches want of a sensor to the outputs of its job, the `view_idx`-th.
    pub fn add_to(
        &mut self,
        sensor_idx: usize,
        sensor: &mut Sensor,
        view_idx: usize,
        outputs: &mut Vec<Output<'static>>,
    ) {
        let first = self.wanted.partition_point(|it| it.sensor_idx < sensor_idx);
        let of_sensor = self.wanted[first..].iter_mut();
        for wanted in of_sensor.take_while(|it| it.sensor_idx == sensor_idx) {
            let frame = &mut self.frames[wanted.frame_idx];
            let modality = frame.modality;
            frame.images[wanted.image_idx] = (view_idx, outputs.len());
            let places = std::mem::take(&mut wanted.places).into_iter();
            outputs.extend(places.map(|place| Output { modality, place }));
            let topic = sensor.topics.iter_mut().find(|it| it.modality == modality);
            topic.into_iter().for_each(|topic| topic.note_made());
        }
    }

    /// The frames, and their loans of shared memory in their order.
    pub fn end(self) -> (Vec<BatchFrame>, Vec<DeviceLoan>) {
        let mut frames = self.frames;
        let hosts = frames.iter_mut().filter_map(|frame| frame.host.take());
        let hosts = hosts.collect();
        (frames, hosts)
    }
}

/// Adds the frames of batches that somebody reads to the firings of the processes that make them.
/// `fired` are the sensors that fire elsewhere in this tick, by rising index.
pub(super) fn give_away(
    batches: &mut [Batch],
    sensors: &mut [Sensor],
    fired: &[usize],
    away: &mut Vec<SceneFiring>,
) {
    for batch in batches {
        let Maker::Worker(worker) = batch.maker else {
            continue;
        };
        if !batch.is_read() {
            continue;
        }
        let has_fired = |idx: &usize| fired.binary_search(idx).is_ok();
        let found = batch.find(sensors).to_vec();
        if !found.iter().any(has_fired) {
            continue;
        }
        // One that lacks an image is dropped and counted by the process that would make it.
        let is_whole = found.iter().all(has_fired);
        let mut outputs = 0;
        for topic in &batch.topics {
            let mut own = found.iter().filter(|idx| **idx != GONE).map(|idx| {
                let mut topics = sensors[*idx].topics.iter();
                topics.find(|it| it.modality == topic.modality)
            });
            let may_make = own.all(|own| own.is_some_and(Topic::may_make));
            if !may_make || !topic.is_read(Audience::Readers) {
                continue;
            }
            outputs |= SceneFiring::output(topic.modality);
            for idx in found.iter().filter(|_| is_whole) {
                let mut topics = sensors[*idx].topics.iter_mut();
                let own = topics.find(|it| it.modality == topic.modality);
                own.into_iter().for_each(Topic::note_made);
            }
        }
        if outputs != 0 {
            away.push(SceneFiring::of_batch(batch.plan.number, worker, outputs));
        }
    }
}

/// Takes over which frames of batches are made, as the process decides that owns the world.
pub(super) fn ask(batches: &mut [Batch], firings: &[SceneFiring]) {
    for batch in batches {
        let is_own = |firing: &&SceneFiring| firing.batch() == Some(batch.plan.number);
        let outputs = firings.iter().find(is_own).map_or(0, |it| it.outputs);
        for topic in &mut batch.topics {
            topic.ask(outputs & SceneFiring::output(topic.modality) != 0);
        }
    }
}

/// Counts frames that were not drawn.
pub(super) fn drop_all(batches: &mut [Batch], frames: Vec<BatchFrame>) {
    for frame in frames {
        batches[frame.batch_idx].topics[frame.topic_idx]
            .counts
            .n_dropped += 1;
    }
}

/// What all frames of a submission have in common.
#[derive(Clone, Copy)]
pub(super) struct Done {
    pub rendered_mono_nanos: u64,
    pub ticks_in_flight: u32,
}

/// Sends the frames of batches whose images are all there. `loans` are those of shared memory, in
/// the order of the frames.
pub(super) fn send(
    batches: &mut [Batch],
    frames: Vec<BatchFrame>,
    results: &[ViewResult],
    mut loans: impl Iterator<Item = schema_bus::FrameLoan>,
    done: Done,
    waking: &mut Waking,
) {
    for frame in frames {
        let batch = &mut batches[frame.batch_idx];
        let topic = &mut batch.topics[frame.topic_idx];
        let mut header = frame.header;
        let images = frame.images.iter();
        for (view_idx, output_idx) in images {
            let result = &results[*view_idx].outputs[*output_idx];
            if result.first {
                header.flags |= FrameHeader::FIRST;
            }
            if frame.modality == Modality::Flow && result.window_nanos != 0 {
                header.window_nanos = result.window_nanos;
            }
            header.cpu_copies = header.cpu_copies.max(result.cpu_copies);
        }
        header.rendered_mono_nanos = done.rendered_mono_nanos;
        header.ticks_in_flight = done.ticks_in_flight;
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
            topic.send(loan, header, Audience::Readers);
        }
        waking.add(&batch.rig);
    }
}
