//! One scenario from a simulator that waits for cues to a whole recording.
//!
//! The simulator is stepped; who drives, the recorder and programs whose results are recorded take
//! part in lockstep, and the recorder joins between two ticks, when the traffic is under way. So
//! what is recorded follows from the scenario alone, however fast the machine is and whatever else
//! it does.

use std::path::Path;
use std::time::{Duration, Instant};

use launch_cli::programs::find;
use schema_bus::{Bus, CommandClient, names};
use schema_frames::WorldInfo;

use crate::error::RunError;
use crate::process::Ending;
use crate::run::Run;
use crate::steps;
use crate::watch::Watch;

/// The recorder's program and its process.
const RECORDER: &str = "gantry-record";
/// The recorder's name in lockstep.
const IN_LOCKSTEP: &str = "record";

/// What is recorded.
#[derive(Clone, Copy)]
pub struct Take<'a> {
    /// Name of this process on the bus, and as a client of the simulator.
    pub client: &'a str,
    /// Ticks before the recording.
    pub n_before: u64,
    /// Ticks in the recording.
    pub n_recorded: u64,
    /// Where the recording goes.
    pub recording: &'a Path,
    /// Words for `gantry-record` besides its own.
    pub record_words: &'a [String],
    /// Time in which the recorder makes its file whole.
    pub end_within: Duration,
    /// Longest time without a finished tick before the simulator counts as hanging.
    pub stall: Duration,
    /// Asked several times a second; it ends the take.
    pub stop: &'a dyn Fn() -> bool,
    /// Told the ticks that are done, those before the recording included.
    pub progress: &'a dyn Fn(u64),
}

/// Records ticks of the simulator that `run` has started.
///
/// # Errors
/// [`RunError::Stopped`], or which process failed and what it said.
pub fn take(run: &mut Run, take: &Take<'_>) -> Result<(), RunError> {
    // Ports go before the node that made them, and both before the processes.
    let bus = run.join(take.client)?;
    let mut client = bus.command_client(take.client)?;
    steps::await_simulator(&mut client, take.stall, &mut take.watch(run))?;
    if take.n_before > 0 {
        take.step(run, &mut client, take.n_before)?;
    }
    take.start_recorder(run, &bus)?;
    take.step(run, &mut client, take.n_recorded)?;
    drop(client);
    drop(bus);
    run.finish(RECORDER, &Ending::term(take.end_within))
}

impl Take<'_> {
    fn watch<'w>(&'w self, run: &'w mut Run) -> Watch<'w> {
        Watch {
            watched: run,
            stop: self.stop,
        }
    }

    fn step(&self, run: &mut Run, client: &mut CommandClient, n: u64) -> Result<(), RunError> {
        steps::step(client, n, self.stall, &mut self.watch(run), self.progress)
    }

    /// Starts the recorder, and waits until the simulator waits for it.
    fn start_recorder(&self, run: &mut Run, bus: &Bus) -> Result<(), RunError> {
        let file = find(RECORDER).map_err(RunError::NoProgram)?;
        let recorder = run
            .program(RECORDER, &file)
            .words([Path::new("--out"), self.recording])
            .words([format!("--lockstep={IN_LOCKSTEP}")])
            .words(self.record_words);
        run.start(recorder)?;
        let mut info = bus.document_reader(names::WORLD_INFO)?;
        let start = Instant::now();
        loop {
            if let Some(document) = info.latest()? {
                let info: WorldInfo = document.json()?;
                if info.lockstep.iter().any(|name| name == IN_LOCKSTEP) {
                    return Ok(());
                }
            }
            self.watch(run).rest(start, self.stall)?;
        }
    }
}
