//! What becomes of commands: answers of the simulator, or why there is none.

use schema_bus::qos;
use schema_frames::CommandReply;

/// Most bytes of one command: what a request may have, without what is around the command.
pub const COMMAND_BYTES: usize = qos::MAX_COMMAND_BYTES - 1024;

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
    /// A command is so long that the simulator would not read it.
    #[error("a command has {n_bytes} bytes, but may have {COMMAND_BYTES}; send less at a time")]
    TooLong {
        /// Its length.
        n_bytes: usize,
    },
    /// A command would not be understood.
    #[error("a command cannot be written for the simulator ({cause})")]
    Unwritable {
        /// What serde says.
        cause: String,
    },
    /// Too much waits for the simulator already.
    #[error("too many commands wait for the simulator")]
    QueueFull,
    /// The commander's thread has ended.
    #[error("the gateway is shutting down")]
    ShuttingDown,
}

/// Answers to a list of commands.
#[derive(Clone, Debug)]
pub struct Answer {
    /// One reply per command.
    pub replies: Vec<CommandReply>,
    /// The last finished tick.
    pub tick: u64,
}
