//! Sends what is asked for on pages to the simulator, on a thread of its own: a step may take long.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use schema_bus::{Bus, BusError, CommandClient, CommandError};

/// Longest wait for an answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(10);
/// Longest wait of a page: batches before its own may each take their time.
const PAGE_TIMEOUT: Duration = Duration::from_secs(30);
/// How often the end is looked for.
const TURN: Duration = Duration::from_millis(100);

/// Why a batch has no answer.
#[derive(Debug, thiserror::Error)]
pub enum AskError {
    /// This program ends.
    #[error("gantry-desk is ending")]
    Ending,
    /// No answer came in time.
    #[error("the simulator does not answer; a step may be running")]
    Silence,
    /// There is no way to the simulator.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// The simulator took no commands.
    #[error(transparent)]
    Command(#[from] CommandError),
}

/// A batch of commands as JSON, and where its answer goes.
pub struct Job {
    batch: Vec<u8>,
    answer: Sender<Result<Vec<u8>, AskError>>,
    /// When the page has said that there was no answer, and it must not be done any more.
    until: Instant,
}

/// Where pages put batches.
#[derive(Clone)]
pub struct Commands(Sender<Job>);

/// A queue of batches and its other end.
pub fn queue() -> (Commands, Receiver<Job>) {
    let (sender, receiver) = channel();
    (Commands(sender), receiver)
}

impl Commands {
    /// Sends a batch and waits for its answer, as JSON.
    ///
    /// # Errors
    /// If nobody answers, or not in time.
    pub fn ask(&self, batch: Vec<u8>) -> Result<Vec<u8>, AskError> {
        let (answer, answered) = channel();
        let until = Instant::now() + PAGE_TIMEOUT;
        self.0
            .send(Job {
                batch,
                answer,
                until,
            })
            .map_err(|_| AskError::Ending)?;
        answered
            .recv_timeout(PAGE_TIMEOUT)
            .map_err(|_| AskError::Silence)?
    }
}

/// Sends batches until `ends`.
///
/// # Errors
/// If the bus cannot be joined.
pub fn serve(domain: &str, jobs: &Receiver<Job>, ends: &AtomicBool) -> anyhow::Result<()> {
    let name = format!("gantry-desk-{}", std::process::id());
    let bus = Bus::open_with(domain, &format!("{name}-commands"), &Default::default())?;
    let mut client: Option<CommandClient> = None;
    while !ends.load(Ordering::Acquire) {
        let Ok(job) = jobs.recv_timeout(TURN) else {
            continue;
        };
        if Instant::now() >= job.until {
            continue;
        }
        let mut go_on = || !ends.load(Ordering::Acquire);
        let asked = match &mut client {
            Some(client) => client.request_text(&job.batch, ANSWER_TIMEOUT, &mut go_on),
            None => match bus.command_client(&name) {
                Ok(fresh) => {
                    let client = client.insert(fresh);
                    client.request_text(&job.batch, ANSWER_TIMEOUT, &mut go_on)
                }
                Err(error) => {
                    // The page may have been closed meanwhile.
                    let _ = job.answer.send(Err(error.into()));
                    continue;
                }
            },
        };
        if asked.is_err() {
            // A simulator that was started anew has another server.
            client = None;
        }
        let _ = job.answer.send(asked.map_err(AskError::from));
    }
    Ok(())
}
