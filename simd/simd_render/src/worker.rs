//! A worker's work for one simulator: from joining to that simulator's end.

use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

use launch_cli::Shutdown;
use schema_bus::{Bus, GpuServer, RenderedWriter, SceneMessage};
use schema_frames::{RenderedRecord, SceneFiring, SceneHeader};
use schema_types::Tick;
use sensor_camera::{CameraRenderer, Quality};
use sensor_core::gnss::GeoReference;
use sensor_gpu::Gpu;
use simd_frames::frames::{Sensors, Stamp, TickView};
use simd_frames::share::{Joined, Question, SceneryCopy, scene_of};
use simd_frames::topic::{Audience, FrameOptions, Transfer, Writer, gpu_server};

use crate::cameras::{self, Surroundings};
use crate::inbox::Inbox;
use crate::source::{NoAnswer, Source};

/// Longest time without a look at shutdown and at the simulator.
const LOOK_AROUND: Duration = Duration::from_millis(100);

/// Longest wait for the GPU without a look at messages.
const LOOK_FOR_MESSAGES: Duration = Duration::from_millis(1);

/// What this worker renders with, for every simulator that it follows.
pub struct Drawing {
    pub gpu: Gpu,
    pub quality: Quality,
    pub transfer: Transfer,
    pub name: String,
    pub weight: f64,
}

/// Why a worker stopped following a simulator.
pub enum Ended {
    /// The simulator is gone, or is another one.
    Simulator,
    /// This program is asked to end.
    Asked,
}

/// Waits for a simulator, and renders for it until it ends.
pub fn follow(domain: &str, drawing: &Drawing, shutdown: &Shutdown) -> anyhow::Result<Ended> {
    let bus = Bus::open(domain, "gantry-render")?;
    let server = gpu_server(&bus, Some(&drawing.gpu));
    let mut is_said = false;
    loop {
        // Messages are heard from before joining on, and anew of every simulator.
        let inbox = Inbox::open(&bus)?;
        let mut source = Source::open(&bus, &inbox, shutdown)?;
        let asked = Question::Join {
            name: drawing.name.clone(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            adapter: drawing.gpu.name().to_owned(),
            weight: drawing.weight,
        };
        let answers = bus.rendered_writer(&drawing.name)?;
        if let Some(joined) = source.join(&asked)? {
            let mut worker = Worker::new(drawing, &joined, answers, &inbox);
            worker.server = server.clone();
            let ended = worker.work(&mut source);
            let closed = worker.sensors.close();
            return match ended {
                Err(error) if error.is::<NoAnswer>() && shutdown.requested() => Ok(Ended::Asked),
                Err(error) if error.is::<NoAnswer>() => Ok(Ended::Simulator),
                ended => closed.and(ended),
            };
        }
        if !std::mem::replace(&mut is_said, true) {
            tracing::info!(domain, "waiting for a simulator");
        }
        if shutdown.wait(2 * LOOK_AROUND) {
            return Ok(Ended::Asked);
        }
        drawing.gpu.check()?;
    }
}

struct Worker<'a> {
    drawing: &'a Drawing,
    joined: Joined,
    sensors: Sensors,
    /// Where readers ask for frames that stay on this worker's GPU.
    server: Option<Arc<GpuServer>>,
    scenery: SceneryCopy,
    cameras_version: u64,
    answers: RenderedWriter,
    /// Messages whose frames may be in flight, with their ticks.
    begun: VecDeque<(u64, u64)>,
    /// The last message that was taken over, and the last whose frames are sent.
    number: u64,
    sent_number: u64,
    n_passes_before: u64,
    stamp: Stamp,
}

impl<'a> Worker<'a> {
    fn new(
        drawing: &'a Drawing,
        joined: &Joined,
        answers: RenderedWriter,
        inbox: &Rc<Inbox>,
    ) -> Worker<'a> {
        let options = FrameOptions {
            frames_in_flight: joined.frames_in_flight,
            transfer: drawing.transfer,
            lidars_on: Writer::Cpu,
            audience: Audience::Readers,
            // Sealed worlds have no workers.
            seal: None,
        };
        let renderer = CameraRenderer::new(&drawing.gpu, drawing.quality);
        let mut sensors = Sensors::new(Some((drawing.gpu.clone(), renderer)), Vec::new(), options);
        inbox.expect_at_most(u64::from(joined.frames_in_flight));
        let counted_on = inbox.clone();
        sensors.send_while(Box::new(move || counted_on.is_counted_on()));
        Worker {
            sensors,
            server: None,
            answers,
            scenery: SceneryCopy::default(),
            cameras_version: 0,
            begun: VecDeque::new(),
            number: 0,
            sent_number: 0,
            n_passes_before: drawing.gpu.counters().counts().passes,
            stamp: Stamp {
                epoch: joined.epoch,
                episode: 0,
                seed: joined.seed,
                geo_reference: GeoReference {
                    latitude_deg: 0.0,
                    longitude_deg: 0.0,
                },
            },
            joined: joined.clone(),
            drawing,
        }
    }

    fn work(&mut self, source: &mut Source<'_>) -> anyhow::Result<Ended> {
        self.load(source)?;
        self.answer(RenderedRecord::WORKS)?;
        tracing::info!(name = self.drawing.name, "joined");
        loop {
            if source.shutdown.requested() {
                return Ok(Ended::Asked);
            }
            if let Some(message) = source.inbox.next()? {
                if message.header().epoch != self.joined.epoch {
                    return Ok(Ended::Simulator);
                }
                self.take(source, &message)?;
                continue;
            }
            if self.sent_number < self.number {
                // The next message is begun in time, also while this one is still drawn.
                self.sensors.finish_oldest_within(LOOK_FOR_MESSAGES)?;
                if self.note_sent() {
                    self.answer(RenderedRecord::WORKS)?;
                }
                continue;
            }
            self.drawing.gpu.check()?;
            if !source.inbox.wait(LOOK_AROUND)? && !source.inbox.has_source(source.bus) {
                return Ok(Ended::Simulator);
            }
        }
    }

    /// Takes a message over and begins its firings.
    fn take(&mut self, source: &mut Source<'_>, message: &SceneMessage) -> anyhow::Result<()> {
        let header = *message.header();
        schema_stages::post(header.tick);
        if header.scenery_version > self.scenery.version() {
            self.answer(RenderedRecord::LOADS)?;
            self.load(source)?;
        }
        if header.cameras_version > self.cameras_version {
            let list = source.cameras(self.joined.worker)?;
            let around = Surroundings {
                bus: source.bus,
                gpu: &self.drawing.gpu,
                server: self.server.as_ref(),
                scenery: &self.scenery,
                seed: self.joined.seed,
                period_nanos: header.period_nanos,
            };
            cameras::take_over(&mut self.sensors, &list, &around)?;
            self.cameras_version = list.version;
        }
        self.sensors.start_tick(Tick(header.tick));
        self.sensors
            .settle_topics(source.bus, header.period_nanos)?;
        self.fire(&header, message)?;
        self.number = header.number;
        self.begun.push_back((header.number, header.tick));
        self.note_sent();
        self.answer(RenderedRecord::WORKS)
    }

    /// Takes note of the last message all frames of which are sent; returns whether it is another.
    fn note_sent(&mut self) -> bool {
        let before = self.sent_number;
        let oldest = self.sensors.oldest_in_flight();
        while let Some((number, tick)) = self.begun.front().copied()
            && oldest.is_none_or(|oldest| tick < oldest)
        {
            self.sent_number = number;
            self.begun.pop_front();
        }
        self.sent_number != before
    }

    fn fire(&mut self, header: &SceneHeader, message: &SceneMessage) -> anyhow::Result<()> {
        // A list of cameras, or of a map that is gone.
        if header.n_firings == 0 || header.episode != self.scenery.assets().episode {
            return Ok(());
        }
        let (scene, mut firings) = scene_of(header, message.payload(), self.scenery.assets())?;
        firings.retain(|firing: &SceneFiring| firing.worker == self.joined.worker);
        self.stamp.episode = header.episode;
        let tick = TickView {
            scene: &scene,
            stamp: &self.stamp,
            collisions: &[],
            roads: None,
        };
        self.sensors.fire_given(&tick, &firings)
    }

    /// Brings the scenery up to date.
    fn load(&mut self, source: &mut Source<'_>) -> anyhow::Result<()> {
        if source.scenery(&mut self.scenery)? {
            let assets = self.scenery.assets();
            let n_shown = assets.meshes.iter().filter(|mesh| !mesh.indices.is_empty());
            tracing::debug!(meshes = n_shown.count(), "other scenery");
            self.sensors.load(assets)?;
        }
        Ok(())
    }

    fn answer(&self, state: u32) -> anyhow::Result<()> {
        let counts = self.sensors.counts();
        let n_passes = self.drawing.gpu.counters().counts().passes;
        self.answers.send(RenderedRecord {
            worker: self.joined.worker,
            state,
            epoch: self.joined.epoch,
            number: self.number,
            sent_number: self.sent_number,
            n_sent: counts.n_sent,
            n_dropped: counts.n_dropped,
            n_passes: n_passes - self.n_passes_before,
            scenery_version: self.scenery.version(),
        })?;
        Ok(())
    }
}
