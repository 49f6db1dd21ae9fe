//! A simulator of its own with the test as a client of it, and what most tests of faults ask of the
//! two.

use std::time::Duration;

use schema_bus::{Bus, CommandClient};
use schema_frames::{Command, CommandBatch, CommandReply};
use test_kit::client::{ask, assert_nothing_left, counter, join_bus};
use test_kit::programs::start_daemon;
use test_kit::{Process, Sandbox, eventually};

/// A daemon that is ready, and this test as another client of it.
#[derive(Debug)]
pub struct Stage {
    // Fields drop in this order: ports before their bus, and the daemon before its folder.
    /// Asks the daemon.
    pub client: CommandClient,
    /// The test's place on the bus.
    pub bus: Bus,
    /// The daemon.
    pub daemon: Process,
    /// Where all run.
    pub sandbox: Sandbox,
}

impl Stage {
    /// Starts a daemon with a launch file and further arguments, and waits until it is ready.
    ///
    /// # Panics
    /// If it does not become ready.
    pub fn new(name: &str, launch: &str, extra: &[&str]) -> Stage {
        let sandbox = Sandbox::new(name);
        let daemon = start_daemon(&sandbox, launch, extra);
        let bus = join_bus(&sandbox, "bystander");
        let client = bus
            .command_client("bystander")
            .unwrap_or_else(|error| panic!("{error}"));
        Stage {
            client,
            bus,
            daemon,
            sandbox,
        }
    }

    /// Sends a batch and returns its answers.
    ///
    /// # Panics
    /// If it is not answered.
    pub fn ask_all(&mut self, commands: Vec<Command>) -> Vec<CommandReply> {
        let answer = self
            .client
            .request(&CommandBatch::new(commands), Duration::from_secs(600));
        answer.unwrap_or_else(|error| panic!("{error}")).replies
    }

    /// The sentence with which a command is refused.
    ///
    /// # Panics
    /// If it is not refused.
    pub fn refusal(&mut self, command: Command) -> String {
        match ask(&mut self.client, command) {
            CommandReply::Refused { error } => error,
            other => panic!("it was not refused: {other:?}"),
        }
    }

    /// Waits until the world is `n` ticks further.
    pub fn ticks_go_on(&mut self, n: u64) {
        let before = counter(&mut self.client, "ticks");
        eventually(&format!("{n} more ticks"), || {
            (counter(&mut self.client, "ticks") >= before + n).then_some(())
        });
    }

    /// Waits for a line of the daemon with all of `words`; asserts that it stays the only one of its
    /// kind while the world goes on.
    ///
    /// # Panics
    /// If it is said again.
    pub fn is_said_once(&mut self, words: &[&str]) {
        let lines_with = |daemon: &Process| {
            let has_all = |line: &&String| words.iter().all(|word| line.contains(word));
            daemon.lines().iter().filter(has_all).count()
        };
        eventually(&format!("the daemon says {words:?}"), || {
            (lines_with(&self.daemon) > 0).then_some(())
        });
        self.ticks_go_on(20);
        let lines = self.daemon.lines();
        assert_eq!(lines_with(&self.daemon), 1, "{words:?} in {lines:#?}");
    }

    /// Ends the daemon, and asserts that nothing is left.
    ///
    /// # Panics
    /// If it ends with an error or leaves something in shared memory.
    pub fn end(self) {
        let Stage {
            client,
            bus,
            daemon,
            sandbox,
        } = self;
        drop((client, bus));
        daemon.stop().expect_code(0);
        assert_nothing_left(&sandbox);
    }
}
