//! Render workers: processes that make the frames of cameras, each a share of them.
//!
//! A worker joins by asking, and gets its share once it has the scenery. Who had a camera before
//! closes its topics first: cameras that move belong to nobody until everybody has taken over the
//! list that says so. Nothing here waits; the tick loop asks whether the world may go on.

mod questions;
mod shares;

use schema_bus::{
    Bus, BusError, Life, Origin, RenderServer, RenderedReader, ScenePublisher, mono_now,
};
use schema_frames::{RenderedRecord, SceneFiring, SceneHeader, StepMode};
use schema_types::ActorId;
use simd_frames::frames::TickView;
use simd_frames::sensor::{Maker, Role};
use simd_frames::share::{Scenery, SentScene, scene_of};

use crate::daemon::Daemon;

/// Most workers.
const MAX_WORKERS: usize = 16;
/// How often a worker is looked for whose process cannot be seen from here.
const LOOK_NANOS: u64 = 100_000_000;
/// How long a world that runs freely waits for a worker whose process is stopped.
const STOPPED_NANOS: u64 = 1_000_000_000;
/// How long it waits for one that goes on: longer than any wait for a GPU.
const SLOW_NANOS: u64 = 90_000_000_000;
/// How long it waits for one that takes scenery over.
const LOADING_NANOS: u64 = 300_000_000_000;
/// How long lockstep waits for a worker until that is said, the first time and each further time.
const SAY_NANOS: u64 = 5_000_000_000;

/// The workers, and what they were told last.
pub struct Workers {
    scenes: ScenePublisher,
    answers: RenderedReader,
    questions: RenderServer,
    epoch: u64,
    workers: Vec<Worker>,
    next_worker: u32,
    /// Number of the last message.
    number: u64,
    cameras_version: u64,
    scenery: Scenery,
    last: Option<LastScene>,
    /// Cameras as the newest lists have them.
    listed: Vec<Listed>,
    /// Whether shares may have to change.
    must_divide: bool,
    /// Message that all must have taken over before cameras move on, or the world.
    taken_over_by: u64,
    /// Firings whose worker ended before their frames were sent.
    unfinished: Vec<SceneFiring>,
    is_lack_said: bool,
    /// Frames sent and lost of workers that have gone.
    gone: RenderedRecord,
}

/// What a change of means that the lists are others.
type Listed = (ActorId, u32, Maker, Vec<ActorId>);

/// The last scene that was sent, and its firings with the numbers of their messages.
struct LastScene {
    scene: SentScene,
    firings: Vec<(u64, SceneFiring)>,
}

/// A worker.
struct Worker {
    number: u32,
    name: String,
    adapter: String,
    weight: f64,
    origin: Origin,
    /// `None` if its process cannot be looked at from here.
    life: Option<Life>,
    looked_nanos: u64,
    standing: Standing,
    /// Its last answer.
    answer: RenderedRecord,
    /// Since when the world waits for it.
    owes_since_nanos: Option<u64>,
    said_nanos: u64,
}

/// What a worker is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Standing {
    /// It has no scenery yet.
    Joins,
    /// It has a share.
    Works,
    /// It did not answer for long, and has no share until it does.
    Absent,
}

impl Workers {
    /// Opens the services.
    pub fn open(bus: &Bus, epoch: u64) -> anyhow::Result<Workers> {
        Ok(Workers {
            scenes: bus.scene_publisher()?,
            answers: bus.rendered_reader()?,
            questions: bus.render_server()?,
            epoch,
            workers: Vec::new(),
            next_worker: 1,
            number: 0,
            cameras_version: 0,
            scenery: Scenery::default(),
            last: None,
            listed: Vec::new(),
            must_divide: true,
            taken_over_by: 0,
            unfinished: Vec::new(),
            is_lack_said: false,
            gone: bytemuck::Zeroable::zeroed(),
        })
    }

    /// Whether any worker is there, so that cameras which are made now are not this process's.
    pub fn has_any(&self) -> bool {
        self.working().next().is_some()
    }

    /// Number of workers that have a share.
    pub fn n_working(&self) -> usize {
        self.working().count()
    }

    fn working(&self) -> impl Iterator<Item = &Worker> {
        self.workers
            .iter()
            .filter(|worker| worker.standing == Standing::Works)
    }

    /// Whether every camera has its place.
    pub fn is_settled(&self) -> bool {
        !self.must_divide && self.unfinished.is_empty() && self.all_took_over()
    }

    fn all_took_over(&self) -> bool {
        self.working()
            .all(|worker| worker.answer.number >= self.taken_over_by)
    }

    /// Whether all frames of messages up to `behind` before the last are sent.
    fn has_sent(&self, behind: u64) -> bool {
        self.working()
            .all(|worker| !worker.owes(self.number, behind))
    }

    /// What all workers together have sent, lost and drawn.
    pub fn totals(&self) -> RenderedRecord {
        let answers = self.workers.iter().map(|worker| &worker.answer);
        answers.fold(self.gone, |sum, answer| RenderedRecord {
            n_sent: sum.n_sent + answer.n_sent,
            n_dropped: sum.n_dropped + answer.n_dropped,
            n_passes: sum.n_passes + answer.n_passes,
            ..sum
        })
    }

    /// Sends the scene of a tick to those who render firings of it.
    pub fn send_scene(
        &mut self,
        tick: &TickView<'_>,
        firings: Vec<SceneFiring>,
    ) -> Result<(), BusError> {
        if firings.is_empty() || !self.has_any() {
            return Ok(());
        }
        let scene = SentScene::of(tick.scene);
        let scenery_version = self.scenery.version_of(&tick.scene.assets);
        let header = SceneHeader {
            scenery_version,
            ..scene.header
        };
        self.send(header, &firings, &scene.rest)?;
        let number = self.number;
        let firings = firings.into_iter().map(|firing| (number, firing));
        self.last = Some(LastScene {
            scene: SentScene { header, ..scene },
            firings: firings.collect(),
        });
        Ok(())
    }

    fn send(
        &mut self,
        header: SceneHeader,
        firings: &[SceneFiring],
        rest: &[u8],
    ) -> Result<(), BusError> {
        let header = SceneHeader {
            number: self.number + 1,
            epoch: self.epoch,
            cameras_version: self.cameras_version,
            n_firings: firings.len() as u32,
            ..header
        };
        self.scenes
            .send(header, &[bytemuck::cast_slice(firings), rest])?;
        self.number += 1;
        Ok(())
    }

    /// Takes note of the answers that wait.
    fn take_answers(&mut self) -> Result<(), BusError> {
        for answer in self.answers.drain()? {
            let record = answer.record;
            let of_worker = |worker: &&mut Worker| {
                worker.number == record.worker && worker.origin.pid == answer.origin.pid
            };
            let Some(worker) = self.workers.iter_mut().find(of_worker) else {
                continue;
            };
            if record.epoch != self.epoch || record.number > self.number {
                continue;
            }
            worker.answer = record;
            let is_there = match worker.standing {
                Standing::Joins => {
                    record.state == RenderedRecord::WORKS && record.scenery_version > 0
                }
                Standing::Absent => record.number == self.number,
                Standing::Works => false,
            };
            if !is_there {
                continue;
            }
            let (name, adapter) = (&worker.name, &worker.adapter);
            match worker.standing {
                Standing::Absent => tracing::info!(name, "a render worker answers again"),
                _ => {
                    tracing::info!(name, adapter, process = %worker.origin, "a render worker joined")
                }
            }
            // What was said before it had a share is nothing that it has to take over.
            worker.standing = Standing::Works;
            worker.answer.number = self.number;
            worker.answer.sent_number = self.number;
            self.must_divide = true;
        }
        Ok(())
    }

    /// Removes workers whose process has ended.
    fn bury(&mut self, bus: &Bus, tick: u64) {
        let now_nanos = mono_now().0;
        let answers = &self.answers;
        let has_ended = |worker: &mut Worker| match worker.life {
            Some(life) => !life.goes_on(),
            None if now_nanos.saturating_sub(worker.looked_nanos) < LOOK_NANOS => false,
            None => {
                worker.looked_nanos = now_nanos;
                bus.clean_dead_nodes();
                let writers = answers.writers();
                !writers.iter().any(|writer| writer.port == worker.name)
            }
        };
        let mut ended = Vec::new();
        self.workers.retain_mut(|worker| {
            let is_gone = has_ended(worker);
            if is_gone {
                ended.push((
                    worker.number,
                    worker.name.clone(),
                    worker.origin.pid,
                    worker.answer,
                ));
            }
            !is_gone
        });
        if ended.is_empty() {
            return;
        }
        bus.clean_dead_nodes();
        for (number, name, pid, answer) in ended {
            tracing::warn!(
                name,
                pid,
                tick,
                "a render worker is gone; its cameras move to others"
            );
            self.gone = RenderedRecord {
                n_sent: self.gone.n_sent + answer.n_sent,
                n_dropped: self.gone.n_dropped + answer.n_dropped,
                n_passes: self.gone.n_passes + answer.n_passes,
                ..self.gone
            };
            self.give_up(number, answer.sent_number);
        }
    }

    /// Lets others finish what a worker has not sent.
    fn give_up(&mut self, worker: u32, sent_number: u64) {
        self.must_divide = true;
        let Some(last) = &mut self.last else {
            return;
        };
        let is_owed = |(number, firing): &mut (u64, SceneFiring)| {
            firing.worker == worker && *number > sent_number
        };
        let owed = last.firings.extract_if(.., is_owed);
        self.unfinished.extend(owed.map(|(_, firing)| firing));
    }

    /// Looks after workers for which the world waits: says so, and goes on without those for which
    /// it has waited too long.
    fn look_after(&mut self, look: &Look) {
        let (now_nanos, number) = (mono_now().0, self.number);
        let mut given_up = Vec::new();
        for worker in &mut self.workers {
            let is_owed = worker.standing == Standing::Works
                && (worker.owes(number, look.behind) || worker.answer.number < self.taken_over_by);
            if !is_owed {
                (worker.owes_since_nanos, worker.said_nanos) = (None, 0);
                continue;
            }
            let since_nanos = *worker.owes_since_nanos.get_or_insert(now_nanos);
            let waited_nanos = now_nanos.saturating_sub(since_nanos);
            let is_stopped = waited_nanos >= STOPPED_NANOS && worker.origin.is_stopped();
            let patience_nanos = match look.timeout_nanos {
                Timeout::After(nanos) => nanos,
                Timeout::Never => u64::MAX,
                Timeout::Usual if is_stopped => STOPPED_NANOS,
                Timeout::Usual if worker.answer.state == RenderedRecord::LOADS => LOADING_NANOS,
                Timeout::Usual => SLOW_NANOS,
            };
            let (name, process) = (&worker.name, &worker.origin);
            let state = if is_stopped { ", which is stopped" } else { "" };
            if waited_nanos >= patience_nanos {
                tracing::warn!(
                    name,
                    tick = look.tick,
                    "render worker {name:?}, {process}{state}, has not answered for {} s; its cameras move to others until it does",
                    waited_nanos / 1_000_000_000
                );
                worker.standing = Standing::Absent;
                given_up.push((worker.number, worker.answer.sent_number));
            } else if waited_nanos >= worker.said_nanos + SAY_NANOS {
                worker.said_nanos = waited_nanos;
                tracing::warn!(
                    name,
                    tick = look.tick,
                    "the world waits for render worker {name:?}, {process}{state}, for {} s; let it go on, end it, or set scenario.lockstep_timeout_s (--lockstep-timeout)",
                    waited_nanos / 1_000_000_000
                );
            }
        }
        for (worker, sent_number) in given_up {
            self.give_up(worker, sent_number);
        }
    }
}

impl Worker {
    fn owes(&self, number: u64, behind: u64) -> bool {
        self.answer.sent_number.saturating_add(behind) < number
    }
}

/// How long a world waits for workers.
struct Look {
    tick: u64,
    /// Messages that they may be behind.
    behind: u64,
    timeout_nanos: Timeout,
}

enum Timeout {
    Never,
    After(u64),
    Usual,
}

/// Hears the workers, and gives cameras their places. Called in every turn of the tick loop.
pub fn attend(daemon: &mut Daemon) -> anyhow::Result<()> {
    daemon.workers.scenes.greet();
    if let Err(error) = daemon.workers.take_answers() {
        daemon.faults.unreadable(&error);
    }
    let tick = daemon.tick.0;
    // A worker that was started again asks under its old name.
    daemon.workers.bury(&daemon.bus, tick);
    questions::answer(daemon);
    shares::divide(daemon)?;
    finish(daemon)
}

/// Looks after workers for which the world waits.
pub fn look_after(daemon: &mut Daemon) {
    let look = Look {
        tick: daemon.tick.0,
        behind: behind(daemon),
        timeout_nanos: match daemon.settings.run.lockstep_timeout_nanos {
            _ if !is_strict(daemon) => Timeout::Usual,
            Some(nanos) => Timeout::After(nanos),
            None => Timeout::Never,
        },
    };
    daemon.workers.look_after(&look);
}

/// Whether the next tick may start as far as workers are concerned.
pub fn let_go_on(daemon: &Daemon) -> bool {
    let workers = &daemon.workers;
    is_complete(daemon)
        && workers.is_settled()
        && shares::are_listed(daemon)
        && workers.has_sent(behind(daemon))
}

/// Whether all workers are there that the first tick waits for.
fn is_complete(daemon: &Daemon) -> bool {
    daemon.tick.0 > 0 || daemon.workers.n_working() >= daemon.settings.run.n_awaited_workers
}

/// Whether all frames of all ticks are sent.
pub fn have_sent_all(daemon: &Daemon) -> bool {
    daemon.workers.unfinished.is_empty() && daemon.workers.has_sent(0)
}

/// Whether commands may be answered: where all frames of a tick are sent before the next begins, they
/// are sent before an answer, too, unless a worker takes very long.
pub fn let_answer(daemon: &Daemon) -> bool {
    let is_slow = |worker: &Worker| worker.said_nanos > 0;
    !is_strict(daemon) || have_sent_all(daemon) || daemon.workers.working().any(is_slow)
}

/// Whether workers are expected to answer soon.
pub fn are_busy(daemon: &Daemon) -> bool {
    !have_sent_all(daemon) || !daemon.workers.is_settled()
}

/// Messages that workers may be behind when a tick starts: none where all frames of a tick are sent
/// before the next begins.
fn behind(daemon: &Daemon) -> u64 {
    match is_strict(daemon) {
        true => 0,
        false => u64::from(daemon.settings.frames_in_flight),
    }
}

fn is_strict(daemon: &Daemon) -> bool {
    daemon.gate.mode() == StepMode::Stepped || !daemon.gate.participants().is_empty()
}

/// Has the frames made that a worker left undone, once its cameras have their new places.
fn finish(daemon: &mut Daemon) -> anyhow::Result<()> {
    let workers = &mut daemon.workers;
    if workers.unfinished.is_empty() || workers.must_divide || !workers.all_took_over() {
        return Ok(());
    }
    let unfinished = std::mem::take(&mut workers.unfinished);
    let Some(last) = &mut workers.last else {
        return Ok(());
    };
    let (mut here, mut away) = (Vec::new(), Vec::new());
    for firing in unfinished {
        let of_firing = |sensor: &&simd_frames::sensor::Sensor| sensor.actor.0 == firing.sensor_id;
        match daemon
            .sensors
            .sensors
            .iter()
            .find(of_firing)
            .map(|sensor| sensor.maker)
        {
            Some(Maker::Here) => here.push(firing),
            Some(Maker::Worker(worker)) => away.push(SceneFiring { worker, ..firing }),
            Some(Maker::Nobody) | None => {}
        }
    }
    let header = SceneHeader {
        n_firings: 0,
        ..last.scene.header
    };
    if !here.is_empty() {
        let (scene, _) = scene_of(&header, &last.scene.rest, &daemon.episode.assets)?;
        let tick = TickView {
            scene: &scene,
            stamp: &daemon.episode.stamp,
            collisions: &[],
            roads: None,
        };
        daemon
            .sensors
            .settle_topics(&daemon.bus, header.period_nanos)?;
        daemon.sensors.fire_given(&tick, &here)?;
    }
    if !away.is_empty() {
        let rest = std::mem::take(&mut last.scene.rest);
        let sent = workers.send(header, &away, &rest);
        let number = workers.number;
        if let Some(last) = &mut workers.last {
            last.scene.rest = rest;
            last.firings
                .extend(away.iter().map(|firing| (number, *firing)));
        }
        if let Err(error) = sent {
            daemon.faults.unsent("a scene for render workers", &error);
        }
    }
    Ok(())
}

/// Sends a message without firings, which says that the lists are others.
fn say_that_lists_changed(daemon: &mut Daemon) {
    let workers = &mut daemon.workers;
    workers.cameras_version += 1;
    if workers.workers.is_empty() {
        return;
    }
    let header = SceneHeader {
        tick: daemon.tick.0,
        sim_nanos: daemon.clock.time_of(daemon.tick).0,
        period_nanos: daemon.clock.period_nanos(),
        episode: daemon.episode.stamp.episode,
        scenery_version: workers.scenery.version_of(&daemon.episode.assets),
        ..bytemuck::Zeroable::zeroed()
    };
    match workers.send(header, &[], &[]) {
        Ok(()) => workers.taken_over_by = workers.number,
        Err(error) => daemon.faults.unsent("a scene for render workers", &error),
    }
}

/// Whether a sensor is one that workers can render.
fn is_camera(sensor: &simd_frames::sensor::Sensor) -> bool {
    matches!(sensor.model, simd_frames::sensor::Model::View(_))
}

/// Whether the spectator's image is made here, where there is a GPU for it.
fn stays_here(sensor: &simd_frames::sensor::Sensor, has_gpu: bool) -> bool {
    sensor.role == Role::Spectator && has_gpu
}
