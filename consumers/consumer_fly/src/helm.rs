//! Sends poses to the simulator on a thread of its own, so that a slow tick does not hold up keys
//! and image. Of poses that wait, the newest is sent.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::Context as _;
use parking_lot::{Condvar, Mutex};
use schema_bus::{Bus, BusOptions, CommandClient};
use schema_frames::{Command, CommandBatch, CommandReply, ReplyBatch};
use schema_types::Pose;

/// Longest wait for an answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(10);
/// Pause after a failure, so that it is not repeated in a rush.
const PAUSE: Duration = Duration::from_millis(200);

/// Where to fly.
#[derive(Clone, Debug)]
pub struct Options {
    /// First segment of the service names.
    pub domain: String,
    /// Where iceoryx2 keeps its files.
    pub bus: BusOptions,
}

#[derive(Debug, Default)]
struct State {
    wish: Option<(u32, Pose)>,
    trouble: Option<String>,
    ends: bool,
}

#[derive(Debug, Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

/// Moves the spectator. Dropping it ends its thread.
#[derive(Debug)]
pub struct Helm {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Helm {
    /// Starts the thread.
    ///
    /// # Errors
    /// If it cannot be started.
    pub fn start(options: &Options) -> anyhow::Result<Helm> {
        let shared = Arc::new(Shared::default());
        let (theirs, options) = (shared.clone(), options.clone());
        let thread = std::thread::Builder::new()
            .name("helm".into())
            .spawn(move || serve(&theirs, &options))
            .context("cannot start the thread that moves the spectator")?;
        Ok(Helm {
            shared,
            thread: Some(thread),
        })
    }

    /// Moves the spectator to a pose; one that was not sent yet is forgotten.
    pub fn steer(&self, spectator: u32, pose: Pose) {
        self.shared.state.lock().wish = Some((spectator, pose));
        self.shared.changed.notify_all();
    }

    /// Why the last pose was not taken, if it was not.
    pub fn trouble(&self) -> Option<String> {
        self.shared.state.lock().trouble.clone()
    }
}

impl Drop for Helm {
    fn drop(&mut self) {
        self.shared.state.lock().ends = true;
        self.shared.changed.notify_all();
        if let Some(thread) = self.thread.take() {
            // What went wrong there was said by `trouble`.
            let _ = thread.join();
        }
    }
}

fn serve(shared: &Shared, options: &Options) {
    let mut port = None;
    while let Some((spectator, pose)) = next(shared) {
        let done = send(&mut port, shared, options, spectator, pose);
        let failed = done.is_err();
        if failed {
            port = None;
        }
        let mut state = shared.state.lock();
        state.trouble = done.unwrap_or_else(|error| Some(format!("{error:#}")));
        if failed && !state.ends {
            shared.changed.wait_for(&mut state, PAUSE);
        }
    }
}

/// Waits for a pose; `None` at the end.
fn next(shared: &Shared) -> Option<(u32, Pose)> {
    let mut state = shared.state.lock();
    loop {
        if state.ends {
            return None;
        }
        if let Some(wish) = state.wish.take() {
            return Some(wish);
        }
        shared.changed.wait(&mut state);
    }
}

/// The thread's own place on the bus, whose ports cannot move between threads.
struct Port {
    // Dropped before the node that made it.
    client: CommandClient,
    _bus: Bus,
}

/// Sends a pose; returns why it was refused.
fn send(
    port: &mut Option<Port>,
    shared: &Shared,
    options: &Options,
    spectator: u32,
    pose: Pose,
) -> anyhow::Result<Option<String>> {
    let port = match port {
        Some(port) => port,
        None => {
            let name = format!("gantry-view-helm-{}", std::process::id());
            let bus = Bus::open_with(&options.domain, &name, &options.bus)?;
            let client = bus.command_client(&name)?;
            port.insert(Port { client, _bus: bus })
        }
    };
    let batch = CommandBatch::new(vec![Command::SetPose {
        actor_id: spectator,
        pose: pose.into(),
    }]);
    let text = serde_json::to_vec(&batch)?;
    let mut go_on = || !shared.state.lock().ends;
    let answer = port
        .client
        .request_text(&text, ANSWER_TIMEOUT, &mut go_on)?;
    let answer: ReplyBatch = serde_json::from_slice(&answer)?;
    Ok(answer.replies.into_iter().find_map(|reply| match reply {
        CommandReply::Refused { error } => Some(error),
        _ => None,
    }))
}
