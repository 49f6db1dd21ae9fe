//! The one thread that sends to `control/world` and `control/vehicles`; connections queue their
//! commands with it.
//!
//! Commands that queue up while an answer is awaited are sent as one request, because in
//! free-running mode the simulator answers only once per tick.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TrySendError, bounded};
use schema_bus::{Bus, CommandClient, ControlWriter, Notifier, names};
use schema_frames::{Command, CommandBatch, CommandReply, VehicleControlRecord};

use crate::state::known_world::World;
use crate::wire::requests::Failure;

/// Jobs that may queue up before connections have to wait.
const QUEUE: usize = 4096;
/// Most commands in one request to the simulator.
const BATCH: usize = 512;
/// Longest wait for an answer; loading a map takes seconds.
const PATIENCE: Duration = Duration::from_secs(60);
const LOOK_AT_STOP: Duration = Duration::from_millis(100);
/// After this time without commands the command client is closed if nobody steps the world any
/// more.
const STEP_BACK: Duration = Duration::from_secs(1);
/// Ticks for which a control is sent again together with newer ones, so that a reader needs only
/// the newest sample.
const RESEND_TICKS: u64 = 2;

/// Why commands were not run.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CommandError {
    /// The simulator refused the command, with this sentence.
    #[error("{0}")]
    Refused(String),
    /// The simulator did not answer, for this reason.
    #[error("{0}")]
    NoAnswer(String),
    /// The simulator answered another number of commands than it was asked.
    #[error("the simulator's answer has another length than the question")]
    OtherLength,
    /// The commander's thread has ended.
    #[error("the gateway is shutting down")]
    ShuttingDown,
}

impl From<CommandError> for Failure {
    fn from(error: CommandError) -> Self {
        Failure::Refused(error.to_string())
    }
}

/// Answers to a list of commands.
#[derive(Clone, Debug)]
pub struct Answer {
    /// One reply per command.
    pub replies: Vec<CommandReply>,
    /// The last finished tick.
    pub tick: u64,
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

fn question(commands: Vec<Command>) -> (Ask, Pending) {
    let (reply, answer) = bounded(1);
    let ask = Ask {
        commands,
        reply: Some(reply),
    };
    (ask, Pending(Ok(answer)))
}

struct Ask {
    commands: Vec<Command>,
    reply: Option<Sender<Result<Answer, CommandError>>>,
}

enum Job {
    Ask(Ask),
    Control(Vec<VehicleControlRecord>),
}

/// The handle that connections use.
#[derive(Clone, Debug)]
pub struct Commander {
    jobs: Sender<Job>,
    is_lost: Arc<AtomicBool>,
}

/// The thread's side of the queue.
pub struct Work {
    jobs: Receiver<Job>,
    is_lost: Arc<AtomicBool>,
}

/// A commander, and the queue that its thread works on.
pub fn commander() -> (Commander, Work) {
    let (sender, receiver) = bounded(QUEUE);
    let is_lost = Arc::new(AtomicBool::new(false));
    (
        Commander {
            jobs: sender,
            is_lost: is_lost.clone(),
        },
        Work {
            jobs: receiver,
            is_lost,
        },
    )
}

impl Commander {
    /// Runs commands and waits for their answers.
    ///
    /// # Errors
    /// If there is no simulator or no answer; a refused command is a reply.
    pub fn ask(&self, commands: Vec<Command>) -> Result<Answer, CommandError> {
        let (ask, answer) = question(commands);
        self.jobs
            .send(Job::Ask(ask))
            .map_err(|_| CommandError::ShuttingDown)?;
        answer.wait()
    }

    /// Queues commands behind those that were queued before, and waits for nothing, not even for
    /// room in the queue: without it they are not run.
    pub fn begin(&self, commands: Vec<Command>) -> Pending {
        let (ask, answer) = question(commands);
        match self.jobs.try_send(Job::Ask(ask)) {
            Ok(()) => answer,
            Err(TrySendError::Full(_)) => Pending(Err(CommandError::NoAnswer(
                "too many commands wait for the simulator".to_owned(),
            ))),
            Err(TrySendError::Disconnected(_)) => Pending(Err(CommandError::ShuttingDown)),
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
        let _ = self.jobs.send(Job::Ask(Ask {
            commands: vec![command],
            reply: None,
        }));
    }

    /// States whether the client that stepped the world has gone. If so, the command client is
    /// closed, so that the simulator sees that nobody steps any more.
    pub fn set_lost(&self, is_lost: bool) {
        self.is_lost.store(is_lost, Ordering::Release);
    }

    /// Controls vehicles from the next tick on.
    pub fn control(&self, records: Vec<VehicleControlRecord>) {
        let _ = self.jobs.send(Job::Control(records));
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
        let mut new_controls = false;
        for job in jobs {
            match job {
                Job::Control(records) => {
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
                    new_controls = true;
                }
                Job::Ask(ask) => {
                    if std::mem::take(&mut new_controls) {
                        self.send_controls();
                    }
                    asks.push(ask);
                }
            }
        }
        if new_controls {
            self.send_controls();
        }
        self.ask(asks);
    }

    fn send_controls(&mut self) {
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
            Err(error) => tracing::warn!(%error, "controls could not be sent"),
        }
    }

    fn ask(&mut self, asks: Vec<Ask>) {
        if asks.is_empty() {
            return;
        }
        let commands: Vec<Command> = asks
            .iter()
            .flat_map(|ask| ask.commands.iter().cloned())
            .collect();
        for command in &commands {
            if let Command::Destroy { actor_id } = command {
                self.held.remove(actor_id);
            }
        }
        let mut result = Ok(Answer {
            replies: Vec::with_capacity(commands.len()),
            tick: 0,
        });
        for batch in commands.chunks(BATCH) {
            match (self.request(batch.to_vec()), &mut result) {
                (Ok(part), Ok(answer)) if part.replies.len() == batch.len() => {
                    answer.replies.extend(part.replies);
                    answer.tick = part.tick;
                }
                (Ok(_), _) => result = Err(CommandError::OtherLength),
                (Err(error), _) => result = Err(error),
            }
            if result.is_err() {
                break;
            }
        }
        let mut replies = result
            .as_ref()
            .map_or(Vec::new(), |answer| answer.replies.clone())
            .into_iter();
        for ask in asks {
            let part = result.clone().map(|answer| Answer {
                replies: replies.by_ref().take(ask.commands.len()).collect(),
                tick: answer.tick,
            });
            match (ask.reply, part) {
                // If the connection has ended meanwhile, nobody waits for the answer.
                (Some(reply), part) => drop(reply.send(part)),
                (None, Ok(answer)) => answer.replies.iter().for_each(log_refusal),
                (None, Err(error)) => tracing::warn!(%error, "a command was lost"),
            }
        }
    }
}

fn log_refusal(reply: &CommandReply) {
    if let CommandReply::Refused { error } = reply {
        tracing::warn!(
            error,
            "the simulator refused a call whose answer the client does not read"
        );
    }
}
