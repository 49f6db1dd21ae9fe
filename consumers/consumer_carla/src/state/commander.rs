//! The one thread that sends to `control/world` and `control/vehicles`; connections queue their
//! commands with it.
//!
//! Commands that queue up while an answer is awaited are sent as one request, because in
//! free-running mode the simulator answers only once per tick. They are measured and checked on the
//! threads of their connections, so that a request of several clients is one that the simulator
//! reads: what is too large goes alone, and what cannot be read goes nowhere.

pub mod answer;
pub mod packing;
pub mod told;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TrySendError, bounded};
use launch_cli::accept::Seldom;
use launch_cli::logging::cut;
use schema_bus::{Bus, CommandClient, ControlWriter, Notifier, names};
use schema_frames::{Command, CommandBatch, CommandReply, VehicleControlRecord};

use crate::state::known_world::World;
use crate::wire::requests::Failure;
use answer::{Answer, CommandError};
use packing::{Ask, Backlog, measure, send_all};
use told::{OnItsWay, settled};

/// Jobs that may queue up before connections have to wait.
const QUEUE: usize = 4096;
/// Warnings in ten seconds about commands that failed and whose clients do not read the answer.
const WARNINGS: u64 = 8;
/// Longest wait for an answer; loading a map takes seconds.
const PATIENCE: Duration = Duration::from_secs(60);
const LOOK_AT_STOP: Duration = Duration::from_millis(100);
/// After this time without commands the command client is closed if nobody steps the world any
/// more.
const STEP_BACK: Duration = Duration::from_secs(1);
/// Ticks for which a control is sent again together with newer ones, so that a reader needs only
/// the newest sample.
const RESEND_TICKS: u64 = 2;

impl From<CommandError> for Failure {
    fn from(error: CommandError) -> Self {
        Failure::Refused(error.to_string())
    }
}

/// An answer that has not come yet.
#[derive(Debug)]
pub struct Pending(Result<Receiver<Result<Answer, CommandError>>, CommandError>);

impl Pending {
    /// Waits for the answer.
    ///
    /// # Errors
    /// As [`Commander::ask`].
    pub fn wait(self) -> Result<Answer, CommandError> {
        self.0?.recv().map_err(|_| CommandError::ShuttingDown)?
    }

    /// Waits for the answer for a while; `None` if it has not come by then.
    pub fn wait_for(&self, patience: Duration) -> Option<Result<Answer, CommandError>> {
        match &self.0 {
            Err(error) => Some(Err(error.clone())),
            Ok(answer) => match answer.recv_timeout(patience) {
                Ok(answer) => Some(answer),
                Err(RecvTimeoutError::Timeout) => None,
                Err(RecvTimeoutError::Disconnected) => Some(Err(CommandError::ShuttingDown)),
            },
        }
    }
}

enum Job {
    Ask(Ask),
    Control(Vec<VehicleControlRecord>, OnItsWay),
}

/// The handle that connections use.
#[derive(Clone, Debug)]
pub struct Commander {
    jobs: Sender<Job>,
    backlog: Arc<Backlog>,
    is_lost: Arc<AtomicBool>,
    has_ended: Arc<AtomicBool>,
}

/// The thread's side of the queue. When it is dropped, nobody waits for what was queued.
pub struct Work {
    jobs: Receiver<Job>,
    is_lost: Arc<AtomicBool>,
    has_ended: Arc<AtomicBool>,
}

impl Drop for Work {
    fn drop(&mut self) {
        // The queue keeps its jobs, and with them the ends of their answers, as long as anybody may
        // still send. Whoever sends behind the last look sees the flag.
        self.has_ended.store(true, Ordering::SeqCst);
        while self.jobs.try_recv().is_ok() {}
    }
}

#[cfg(test)]
impl Work {
    /// Jobs that nobody works on yet.
    pub fn n_waiting(&self) -> usize {
        self.jobs.len()
    }
}

/// A commander, and the queue that its thread works on.
pub fn commander() -> (Commander, Work) {
    let (sender, receiver) = bounded(QUEUE);
    let is_lost = Arc::new(AtomicBool::new(false));
    let has_ended = Arc::new(AtomicBool::new(false));
    (
        Commander {
            jobs: sender,
            backlog: Arc::default(),
            is_lost: is_lost.clone(),
            has_ended: has_ended.clone(),
        },
        Work {
            jobs: receiver,
            is_lost,
            has_ended,
        },
    )
}

impl Commander {
    /// Runs commands and waits for their answers.
    ///
    /// # Errors
    /// If there is no simulator or no answer; a refused command is a reply.
    pub fn ask(&self, commands: Vec<Command>) -> Result<Answer, CommandError> {
        let (reply, answer) = bounded(1);
        let ask = self.question(commands, Some(reply), true)?;
        self.jobs
            .send(Job::Ask(ask))
            .map_err(|_| CommandError::ShuttingDown)?;
        self.pending(answer).wait()
    }

    /// The answer to a job that was queued.
    fn pending(&self, answer: Receiver<Result<Answer, CommandError>>) -> Pending {
        match self.has_ended.load(Ordering::SeqCst) {
            true => Pending(Err(CommandError::ShuttingDown)),
            false => Pending(Ok(answer)),
        }
    }

    /// Commands with all that is to be known of them, and room for them in the queue.
    fn question(
        &self,
        commands: Vec<Command>,
        reply: Option<Sender<Result<Answer, CommandError>>>,
        wait: bool,
    ) -> Result<Ask, CommandError> {
        let sizes: Vec<_> = commands.iter().map(measure).collect();
        let n_bytes = sizes.iter().flatten().sum();
        let room = self.backlog.enter(n_bytes, wait);
        Ok(Ask {
            commands,
            sizes,
            _told: reply.is_none().then(OnItsWay::from_here),
            reply,
            _room: room.ok_or(CommandError::QueueFull)?,
        })
    }

    /// Queues commands behind those that were queued before, and waits for nothing, not even for
    /// room in the queue: without it they are not run.
    pub fn begin(&self, commands: Vec<Command>) -> Pending {
        let (reply, answer) = bounded(1);
        let queued = self.question(commands, Some(reply), false).and_then(|ask| {
            self.jobs
                .try_send(Job::Ask(ask))
                .map_err(|error| match error {
                    TrySendError::Full(_) => CommandError::QueueFull,
                    TrySendError::Disconnected(_) => CommandError::ShuttingDown,
                })
        });
        match queued {
            Ok(()) => self.pending(answer),
            Err(error) => Pending(Err(error)),
        }
    }

    /// Runs one command and waits; a refusal is an error.
    ///
    /// # Errors
    /// As [`Commander::ask`].
    pub fn ask_one(&self, command: Command) -> Result<(CommandReply, u64), CommandError> {
        let answer = self.ask(vec![command])?;
        match answer.replies.into_iter().next() {
            Some(CommandReply::Refused { error }) => Err(CommandError::Refused(error)),
            Some(reply) => Ok((reply, answer.tick)),
            None => Err(CommandError::OtherLength),
        }
    }

    /// Runs a command without waiting; a refusal is logged.
    pub fn tell(&self, command: Command) {
        // Sending fails only when the thread has ended, and then the program is about to end.
        if let Ok(ask) = self.question(vec![command], None, true) {
            let _ = self.jobs.send(Job::Ask(ask));
        }
    }

    /// Waits until all that the calling thread told has been run: what [`Commander::tell`] and
    /// [`Commander::control`] queued.
    ///
    /// # Errors
    /// If there is no simulator or no answer.
    pub fn settle(&self) -> Result<(), CommandError> {
        let until = Instant::now() + PATIENCE;
        while !settled(LOOK_AT_STOP) {
            if self.has_ended.load(Ordering::SeqCst) {
                return Err(CommandError::ShuttingDown);
            }
            if Instant::now() > until {
                let what = "earlier calls of this connection still wait for it";
                return Err(CommandError::NoAnswer(what.to_owned()));
            }
        }
        Ok(())
    }

    /// States whether the client that stepped the world has gone. If so, the command client is
    /// closed, so that the simulator sees that nobody steps any more.
    pub fn set_lost(&self, is_lost: bool) {
        self.is_lost.store(is_lost, Ordering::Release);
    }

    /// Controls vehicles from the next tick on.
    pub fn control(&self, records: Vec<VehicleControlRecord>) {
        let told = OnItsWay::from_here();
        let _ = self.jobs.send(Job::Control(records, told));
    }
}

/// Runs the thread until `stop`.
///
/// # Errors
/// When the bus cannot be joined.
pub fn run(domain: &str, world: &World, work: &Work, stop: &AtomicBool) -> anyhow::Result<()> {
    let bus = Bus::open(domain, "gantry-carla-commands")?;
    let name = format!("carla-{}", std::process::id());
    let mut thread = Thread {
        client: Some(bus.command_client(&name)?),
        writer: bus.control_writer(&name)?,
        daemon: bus.notifier(names::CONTROL_WAKE)?,
        held: BTreeMap::new(),
        last_asked: Instant::now(),
        warnings: Seldom::of(WARNINGS),
        world,
        name,
        bus,
    };
    while !stop.load(Ordering::Acquire) {
        match work.jobs.recv_timeout(LOOK_AT_STOP) {
            Ok(job) => thread.work(
                std::iter::once(job)
                    .chain(work.jobs.try_iter().take(QUEUE))
                    .collect(),
            ),
            Err(RecvTimeoutError::Timeout) => {
                thread.step_back(work.is_lost.load(Ordering::Acquire))
            }
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    Ok(())
}

struct Thread<'w> {
    // Fields are dropped in order: ports before their node.
    /// `None` while nobody steps the world, because the simulator counts its command clients.
    client: Option<CommandClient>,
    writer: ControlWriter,
    daemon: Notifier,
    /// Controls of the last ticks by actor, each with the last tick at which it may be sent.
    held: BTreeMap<u32, (u64, VehicleControlRecord)>,
    last_asked: Instant,
    warnings: Seldom,
    world: &'w World,
    name: String,
    bus: Bus,
}

impl Thread<'_> {
    /// Closes the command client if the stepping client has gone and nobody has asked for anything
    /// in a while.
    fn step_back(&mut self, is_lost: bool) {
        if is_lost && self.last_asked.elapsed() > STEP_BACK {
            self.client = None;
        }
    }

    fn request(&mut self, batch: Vec<Command>) -> Result<Answer, CommandError> {
        self.last_asked = Instant::now();
        let client = match &mut self.client {
            Some(client) => client,
            empty => empty.insert(
                self.bus
                    .command_client(&self.name)
                    .map_err(|error| CommandError::NoAnswer(error.to_string()))?,
            ),
        };
        let answer = client
            .request(&CommandBatch::new(batch), PATIENCE)
            .map_err(|error| CommandError::NoAnswer(error.to_string()))?;
        Ok(Answer {
            replies: answer.replies,
            tick: answer.tick,
        })
    }

    /// Works on jobs in order: controls that were queued before a request are sent before it.
    fn work(&mut self, jobs: Vec<Job>) {
        let mut asks: Vec<Ask> = Vec::new();
        // Controls that are not sent yet.
        let mut new_controls: Vec<OnItsWay> = Vec::new();
        for job in jobs {
            match job {
                Job::Control(records, told) => {
                    self.ask(std::mem::take(&mut asks));
                    let (tick, known) = (self.world.tick(), self.world.known());
                    // A control must not be repeated for vehicles whose controls hold for one tick
                    // only.
                    let until = |id: &u32| {
                        if known.is_sticky(*id) {
                            tick + RESEND_TICKS - 1
                        } else {
                            tick
                        }
                    };
                    self.held.extend(
                        records
                            .into_iter()
                            .map(|record| (record.actor_id, (until(&record.actor_id), record))),
                    );
                    new_controls.push(told);
                }
                Job::Ask(ask) => {
                    self.send_controls(std::mem::take(&mut new_controls));
                    asks.push(ask);
                }
            }
        }
        self.send_controls(new_controls);
        self.ask(asks);
    }

    /// Sends the controls that are held, if any are new.
    fn send_controls(&mut self, new: Vec<OnItsWay>) {
        if new.is_empty() {
            return;
        }
        let tick = self.world.tick();
        self.held
            .retain(|_, (until, _)| (tick..tick + RESEND_TICKS).contains(until));
        let records: Vec<VehicleControlRecord> =
            self.held.values().map(|(_, record)| *record).collect();
        if records.is_empty() {
            return;
        }
        match self.writer.send(tick, &records) {
            Ok(_) => drop(self.daemon.notify()),
            Err(error) => self.warn(&error.to_string(), "controls could not be sent"),
        }
    }

    /// Sends the commands of all asks, in order, and hands out the replies. A request that fails
    /// fails those whose commands it has.
    fn ask(&mut self, asks: Vec<Ask>) {
        for command in asks.iter().flat_map(|ask| &ask.commands) {
            if let Command::Destroy { actor_id } = command {
                self.held.remove(actor_id);
            }
        }
        let outcomes = send_all(&asks, |commands| self.request(commands));
        for (ask, outcome) in asks.into_iter().zip(outcomes) {
            match (ask.reply, outcome.answer(&ask.sizes)) {
                // If the connection has ended meanwhile, nobody waits for the answer.
                (Some(reply), answer) => drop(reply.send(answer)),
                (None, Ok(answer)) => answer.replies.iter().for_each(|reply| {
                    if let CommandReply::Refused { error } = reply {
                        self.warn(
                            error,
                            "the simulator refused a call whose answer the client does not read",
                        );
                    }
                }),
                (None, Err(error)) => self.warn(&error.to_string(), "a command was lost"),
            }
        }
    }

    fn warn(&self, error: &str, what: &str) {
        if let Some(n_unsaid) = self.warnings.is_due() {
            let error = cut(error);
            tracing::warn!(error = %error, n_unsaid, "{what}");
        }
    }
}
