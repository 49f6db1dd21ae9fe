//! Render workers: processes that make the frames of cameras, each a share of them.
//!
//! A worker joins by asking, and gets its share once it has the scenery. Who had a camera before
//! closes its topics first: cameras that move belong to nobody until everybody has taken over the
//! list that says so. Nothing here waits; the tick loop asks whether the world may go on.

use schema_bus::{
    Bus, BusError, Life, Origin, RenderServer, RenderedReader, ScenePublisher, mono_now,
};
use schema_frames::{RenderedRecord, SceneFiring, SceneHeader};
use schema_types::ActorId;
use simd_frames::frames::TickView;
use simd_frames::sensor::Maker;
use simd_frames::share::{Scenery, SentScene};

/// Most workers.
pub const MAX_WORKERS: usize = 16;
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
    pub scenes: ScenePublisher,
    pub answers: RenderedReader,
    pub questions: RenderServer,
    pub epoch: u64,
    pub workers: Vec<Worker>,
    pub next_worker: u32,
    /// Number of the last message.
    pub number: u64,
    pub cameras_version: u64,
    pub scenery: Scenery,
    pub last: Option<LastScene>,
    /// Cameras as the newest lists have them.
    pub listed: Vec<Listed>,
    /// Whether shares may have to change.
    pub must_divide: bool,
    /// Message that all must have taken over before cameras move on, or the world.
    pub taken_over_by: u64,
    /// Firings whose worker ended before their frames were sent.
    pub unfinished: Vec<SceneFiring>,
    pub is_lack_said: bool,
    /// Frames sent and lost of workers that have gone.
    pub gone: RenderedRecord,
}

/// What a change of means that the lists are others.
pub type Listed = (ActorId, u32, Maker, Vec<ActorId>);

/// The last scene that was sent, and its firings with the numbers of their messages.
pub struct LastScene {
    pub scene: SentScene,
    pub firings: Vec<(u64, SceneFiring)>,
}

/// A worker.
pub struct Worker {
    pub number: u32,
    pub name: String,
    pub adapter: String,
    pub weight: f64,
    pub origin: Origin,
    /// `None` if its process cannot be looked at from here.
    pub life: Option<Life>,
    pub looked_nanos: u64,
    pub standing: Standing,
    /// Its last answer.
    pub answer: RenderedRecord,
    /// Since when the world waits for it.
    pub owes_since_nanos: Option<u64>,
    pub said_nanos: u64,
}

/// What a worker is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
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

    pub fn working(&self) -> impl Iterator<Item = &Worker> {
        self.workers
            .iter()
            .filter(|worker| worker.standing == Standing::Works)
    }

    /// Whether every camera has its place.
    pub fn is_settled(&self) -> bool {
        !self.must_divide && self.unfinished.is_empty() && self.all_took_over()
    }

    pub fn all_took_over(&self) -> bool {
        self.working()
            .all(|worker| worker.answer.number >= self.taken_over_by)
    }

    /// Whether all frames of messages up to `behind` before the last are sent.
    pub fn has_sent(&self, behind: u64) -> bool {
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

    pub fn send(
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
    pub fn take_answers(&mut self) -> Result<(), BusError> {
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
    pub fn bury(&mut self, bus: &Bus, tick: u64) {
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
    pub fn give_up(&mut self, worker: u32, sent_number: u64) {
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
    pub fn look_after(&mut self, look: &Look) {
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
    pub fn owes(&self, number: u64, behind: u64) -> bool {
        self.answer.sent_number.saturating_add(behind) < number
    }
}

/// How long a world waits for workers.
pub struct Look {
    pub tick: u64,
    /// Messages that they may be behind.
    pub behind: u64,
    pub timeout_nanos: Timeout,
}

pub enum Timeout {
    Never,
    After(u64),
    Usual,
}
