//! Render workers: processes that make the frames of cameras, each a share of them.
//!
//! A worker joins by asking, and gets its share once it has the scenery. Who had a camera before
//! closes its topics first: cameras that move belong to nobody until everybody has taken over the
//! list that says so. Nothing here waits; the tick loop asks whether the world may go on.

use std::sync::Arc;

use schema_bus::{
    Bus, BusError, Life, Origin, RenderQuestion, RenderServer, RenderedReader, ScenePublisher,
    mono_now,
};
use schema_frames::{RenderedRecord, SceneFiring, SceneHeader};
use schema_types::{ActorId, Tick};
use sensor_core::scene::{Scene, SceneAssets};
use simd_frames::frames::TickView;
use simd_frames::sensor::Maker;
use simd_frames::share::{Scenery, SentScene, scene_of};

/// Most workers.
const MAX_WORKERS: usize = 16;
/// Longest name of a worker.
const MAX_NAME: usize = 64;
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
    /// Workers that the first tick waits for.
    n_awaited: usize,
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
    /// Whether shares change once the next tick may start.
    must_divide_later: bool,
    /// Whether readers are owed every frame of the last tick until the next begins.
    keeps_whole_ticks: bool,
    /// Message that all must have taken over before cameras move on, or the world.
    taken_over_by: u64,
    /// Firings whose worker ended before their frames were sent.
    unfinished: Vec<SceneFiring>,
    is_lack_said: bool,
    /// Frames sent and lost of workers that have gone.
    gone: RenderedRecord,
}

/// Whether a camera may leave a process that works.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parting {
    /// At once.
    Now,
    /// Once the next tick may start. Who writes a topic closes it with the move, and a reader that has
    /// not looked since it was opened would never get the frame of this tick.
    WithNextTick,
}

/// Moves of cameras that are left after shares have changed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rest {
    /// Whether cameras are on their way from one process to another.
    pub is_moving: bool,
    /// Whether cameras move once the next tick may start.
    pub is_to_move: bool,
}

/// A camera on the lists of workers. Where one of these changes, the lists are others.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listed {
    /// Its actor.
    pub actor: ActorId,
    /// How often it began anew.
    pub n_beginnings: u32,
    /// Which process makes its frames.
    pub maker: Maker,
    /// Actors that its images leave out.
    pub hidden: Vec<ActorId>,
}

/// A process that asks for a share.
#[derive(Debug)]
pub struct Newcomer<'a> {
    name: String,
    adapter: String,
    /// Size of its share beside the others'.
    weight: f64,
    origin: &'a Origin,
}

impl Newcomer<'_> {
    /// The process `origin`, under this name.
    ///
    /// # Errors
    /// [`JoinError`] if the name or the weight cannot be used.
    pub fn new(
        name: String,
        adapter: String,
        weight: f64,
        origin: &Origin,
    ) -> Result<Newcomer<'_>, JoinError> {
        if name.is_empty() || name.len() > MAX_NAME {
            return Err(JoinError::Name(name));
        }
        if !(weight.is_finite() && weight > 0.0) {
            return Err(JoinError::Weight(weight));
        }
        Ok(Newcomer {
            name,
            adapter,
            weight,
            origin,
        })
    }
}

/// Why a process cannot have a share.
#[derive(Debug, thiserror::Error)]
pub enum JoinError {
    /// The name is empty or too long.
    #[error("name is {0:?}, but must have 1 to {max} characters", max = MAX_NAME)]
    Name(String),
    /// The share would have no size.
    #[error("weight is {0}, but must be above 0")]
    Weight(f64),
    /// Another process has the name.
    #[error("name is {name:?}, but {owner} has joined under it; choose another with --name")]
    Taken {
        /// The name.
        name: String,
        /// The process that has joined under it.
        owner: Origin,
    },
    /// There are as many as there can be.
    #[error("there are {max} render workers already, which is the most", max = MAX_WORKERS)]
    Full,
}

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
    wait: Option<Wait>,
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
    /// Opens the services. The first tick waits for `n_awaited` workers.
    pub fn open(bus: &Bus, epoch: u64, n_awaited: usize) -> anyhow::Result<Workers> {
        Ok(Workers {
            scenes: bus.scene_publisher()?,
            answers: bus.rendered_reader()?,
            questions: bus.render_server()?,
            epoch,
            n_awaited,
            workers: Vec::new(),
            next_worker: 1,
            number: 0,
            cameras_version: 0,
            scenery: Scenery::default(),
            last: None,
            listed: Vec::new(),
            must_divide: true,
            must_divide_later: false,
            keeps_whole_ticks: false,
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

    /// Whether the worker of this number has a share.
    pub fn is_working(&self, number: u32) -> bool {
        self.working().any(|worker| worker.number == number)
    }

    /// Numbers of the workers that have a share, with its size.
    pub fn shares(&self) -> Vec<(u32, f64)> {
        self.working()
            .map(|worker| (worker.number, worker.weight))
            .collect()
    }

    /// Whether all workers are there that the first tick waits for.
    pub fn is_complete(&self, last_tick: Tick) -> bool {
        last_tick > Tick(0) || self.n_working() >= self.n_awaited
    }

    /// Whether every camera has a place, though it may be about to move once the next tick may start.
    pub fn is_settled(&self) -> bool {
        !self.must_divide && self.unfinished.is_empty() && self.all_took_over()
    }

    /// Whether cameras move before the next tick starts.
    pub fn are_to_move(&self) -> bool {
        self.must_divide_later
    }

    /// Says whether readers are owed every frame of the last tick until the next begins.
    pub fn keep_whole_ticks(&mut self, keeps_whole_ticks: bool) {
        self.keeps_whole_ticks = keeps_whole_ticks;
    }

    fn all_took_over(&self) -> bool {
        self.working()
            .all(|worker| worker.answer.number >= self.taken_over_by)
    }

    /// Whether all frames of messages up to `behind` before the last are sent.
    pub fn has_sent(&self, behind: u64) -> bool {
        self.working()
            .all(|worker| !worker.owes(self.number, behind))
    }

    /// Whether all frames of all messages are sent.
    pub fn has_sent_all(&self) -> bool {
        self.unfinished.is_empty() && self.has_sent(0)
    }

    /// Whether one has taken so long that it was said.
    pub fn any_is_slow(&self) -> bool {
        self.working().any(|worker| worker.said_nanos > 0)
    }

    /// Sends the latest message to workers that joined since the last call.
    pub fn greet(&self) {
        self.scenes.greet();
    }

    /// The next question that waits.
    ///
    /// # Errors
    /// [`BusError`] if the service cannot be read.
    pub fn next_question(&mut self) -> Result<Option<RenderQuestion>, BusError> {
        self.questions.take()
    }

    /// Answers a question.
    ///
    /// # Errors
    /// [`BusError`] if the answer cannot be sent.
    pub fn answer(&self, question: RenderQuestion, bytes: &[u8]) -> Result<(), BusError> {
        self.questions.answer(question, bytes)
    }

    /// Version of the lists of cameras.
    pub fn cameras_version(&self) -> u64 {
        self.cameras_version
    }

    /// The still scenery as workers ask for it.
    pub fn scenery(&mut self) -> &mut Scenery {
        &mut self.scenery
    }

    /// Lets a process have a share from now on, once it has this scenery; returns its number. A worker
    /// that asks again begins anew.
    ///
    /// # Errors
    /// [`JoinError`].
    pub fn join(
        &mut self,
        newcomer: Newcomer<'_>,
        assets: &Arc<SceneAssets>,
    ) -> Result<u32, JoinError> {
        self.check(&newcomer)?;
        let Newcomer {
            name,
            adapter,
            weight,
            origin,
        } = newcomer;
        let before = self
            .workers
            .iter()
            .position(|it| it.origin.pid == origin.pid);
        if let Some(idx) = before {
            let gone = self.workers.remove(idx);
            self.make_again(gone.number, gone.answer.sent_number);
        }
        let number = self.next_worker;
        self.next_worker += 1;
        self.workers.push(Worker {
            number,
            name,
            adapter,
            weight,
            origin: origin.clone(),
            life: origin.life(),
            looked_nanos: mono_now().0,
            standing: Standing::Joins,
            answer: bytemuck::Zeroable::zeroed(),
            wait: None,
            said_nanos: 0,
        });
        // The scenery that it is about to ask for.
        self.scenery.version_of(assets);
        Ok(number)
    }

    fn check(&self, newcomer: &Newcomer<'_>) -> Result<(), JoinError> {
        let others = || {
            let all = self.workers.iter();
            all.filter(|it| it.origin.pid != newcomer.origin.pid)
        };
        if let Some(other) = others().find(|it| it.name == newcomer.name) {
            return Err(JoinError::Taken {
                name: newcomer.name.clone(),
                owner: other.origin.clone(),
            });
        }
        match others().count() >= MAX_WORKERS {
            true => Err(JoinError::Full),
            false => Ok(()),
        }
    }

    /// Whether the newest lists are these.
    pub fn has_listed(&self, listed: &[Listed]) -> bool {
        self.listed == listed
    }

    /// Whether cameras may have to change their places, and can: `listed` are the cameras as they are,
    /// and `parting` says which of them may move.
    pub fn may_divide(&mut self, listed: &[Listed], parting: Parting) -> bool {
        if parting == Parting::Now && std::mem::take(&mut self.must_divide_later) {
            self.must_divide = true;
        }
        if !self.has_listed(listed) {
            self.must_divide = true;
        }
        self.must_divide && self.all_took_over()
    }

    /// The cameras have the places that they can have now.
    pub fn has_divided(&mut self, rest: Rest) {
        self.must_divide = rest.is_moving;
        self.must_divide_later = rest.is_to_move;
    }

    /// Says once that cameras have no frames, if `is_any_without` says so and no worker is about to
    /// help.
    pub fn say_lack(&mut self, is_any_without: bool, domain: &str) {
        let nobody_joins = self.workers.iter().all(|it| it.standing != Standing::Joins);
        if is_any_without && nobody_joins && !std::mem::replace(&mut self.is_lack_said, true) {
            tracing::warn!(
                "the cameras have no frames: this simulator renders nothing (--no-gpu), and no render worker is there; start one with: gantry-render --domain {domain}"
            );
        }
        if self.has_any() {
            self.is_lack_said = false;
        }
    }

    /// Takes these lists over, and sends a message without firings, which says that they are others.
    ///
    /// # Errors
    /// [`BusError`] if it cannot be sent.
    pub fn set_lists(
        &mut self,
        listed: Vec<Listed>,
        header: SceneHeader,
        assets: &Arc<SceneAssets>,
    ) -> Result<(), BusError> {
        self.listed = listed;
        self.cameras_version += 1;
        if self.workers.is_empty() {
            return Ok(());
        }
        let header = SceneHeader {
            scenery_version: self.scenery.version_of(assets),
            ..header
        };
        self.send(header, &[], &[])?;
        self.taken_over_by = self.number;
        Ok(())
    }

    /// The firings that workers left undone, once their cameras have new places. Those of an episode
    /// other than `episode` are given up: their scene is that of a map which is gone.
    pub fn take_unfinished(&mut self, episode: u32) -> Vec<SceneFiring> {
        if self.must_divide || !self.all_took_over() {
            return Vec::new();
        }
        let unfinished = std::mem::take(&mut self.unfinished);
        match &self.last {
            Some(last) if last.scene.header.episode == episode => unfinished,
            _ => Vec::new(),
        }
    }

    /// The last scene that was sent, with its header; `None` if none was.
    ///
    /// # Errors
    /// If it does not go with `assets`.
    pub fn last_scene(
        &self,
        assets: &Arc<SceneAssets>,
    ) -> anyhow::Result<Option<(SceneHeader, Scene)>> {
        let Some(last) = &self.last else {
            return Ok(None);
        };
        let header = SceneHeader {
            n_firings: 0,
            ..last.scene.header
        };
        let (scene, _) = scene_of(&header, &last.scene.rest, assets)?;
        Ok(Some((header, scene)))
    }

    /// Sends the last scene again, for firings that have other workers now.
    ///
    /// # Errors
    /// [`BusError`] if it cannot be sent.
    pub fn send_again(&mut self, firings: &[SceneFiring]) -> Result<(), BusError> {
        let Some(mut last) = self.last.take() else {
            return Ok(());
        };
        let header = SceneHeader {
            n_firings: 0,
            ..last.scene.header
        };
        let sent = self.send(header, firings, &last.scene.rest);
        let numbered = firings.iter().map(|firing| (self.number, *firing));
        last.firings.extend(numbered);
        self.last = Some(last);
        sent
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
            self.make_again(number, answer.sent_number);
        }
    }

    /// Lets others make the frames of a worker that has closed its topics. Where readers are owed the
    /// whole tick, these are also the frames that it sent: a reader that has not looked since the
    /// worker opened the topic cannot get them any more, and others pass over the second one.
    fn make_again(&mut self, worker: u32, sent_number: u64) {
        match self.keeps_whole_ticks {
            true => self.give_up(worker, 0),
            false => self.give_up(worker, sent_number),
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
    pub fn look_after(&mut self, look: &Look) {
        let (now_nanos, number) = (mono_now().0, self.number);
        let mut given_up = Vec::new();
        for worker in &mut self.workers {
            let is_owed = worker.standing == Standing::Works
                && (worker.owes(number, look.behind) || worker.answer.number < self.taken_over_by);
            if !is_owed {
                (worker.wait, worker.said_nanos) = (None, 0);
                continue;
            }
            let progress = (worker.answer.number, worker.answer.sent_number);
            let (wait, waited_nanos) = Wait::go_on(worker.wait, progress, now_nanos);
            if worker.wait.replace(wait) != Some(wait) {
                worker.said_nanos = 0;
            }
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

/// A wait of the world for a worker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Wait {
    /// What the worker had answered and sent when it began.
    progress: (u64, u64),
    since_nanos: u64,
}

impl Wait {
    /// The wait that goes on, and how long it has lasted. A worker that is kept busy owes something at
    /// every look, so each answer begins a new wait.
    fn go_on(before: Option<Wait>, progress: (u64, u64), now_nanos: u64) -> (Wait, u64) {
        let begun = Wait {
            progress,
            since_nanos: now_nanos,
        };
        let wait = before
            .filter(|wait| wait.progress == progress)
            .unwrap_or(begun);
        (wait, now_nanos.saturating_sub(wait.since_nanos))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_worker_that_sends_something_at_every_look_is_not_waited_for() {
        let mut wait = None;
        for n in 0..100 {
            let (next, waited_nanos) = Wait::go_on(wait, (n, n), n * 1_000_000_000);
            assert_eq!(waited_nanos, 0);
            wait = Some(next);
        }
        let (_, waited_nanos) = Wait::go_on(wait, (99, 99), 109_000_000_000);
        assert_eq!(waited_nanos, 10_000_000_000);
    }
}
