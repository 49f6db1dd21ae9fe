//! The journal of a run: what its world began with, and everything that acted on it since, each at
//! its edge between two ticks and in order. A simulator of the same build that carries the entries
//! out again goes through the same states, bit by bit.
//!
//! Not in it is what acts on no world: questions, cues, the mode, lockstep.

use serde::{Deserialize, Serialize};

/// Version of the journal.
pub const JOURNAL_VERSION: u32 = 1;

/// About how many bytes of JSON an answer to `journal` has at most. An entry that is longer by
/// itself, because its request was, is answered alone.
pub const JOURNAL_ANSWER_BYTES: usize = 1 << 20;

/// First actor id of sensors that are added to an old run; no run counts so far, so that all other
/// ids are as they were without them.
pub const FIRST_ADDED_ID: u32 = 1 << 30;

/// What a run began with, and what else its bytes depend on.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct JournalHead {
    /// [`JOURNAL_VERSION`].
    pub v: u32,
    /// Version of the simulator.
    pub version: String,
    /// Name of the program's build: another one may compute other bytes.
    pub build: String,
    /// The simulator's epoch, decimal text.
    pub epoch: String,
    /// The launch file in force: all files and `--set` laid over one another, with every default.
    pub launch: String,
    /// Sensors of the launch file that were added to the run and have ids of a range of their own.
    #[serde(default)]
    pub added_sensors: Vec<String>,
    /// Seed of everything random.
    pub seed: u64,
    /// Name of the first map.
    pub map: String,
    /// Hash of that map, hexadecimal.
    pub map_hash: String,
    /// GPU that rendered.
    pub adapter: String,
    /// Quality of colour: `low` or `high`.
    pub quality: String,
    /// What cast lidars: `cpu` or `gpu`.
    pub lidars_on: String,
}

/// One thing that acted on the world.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct JournalEntry {
    /// Number, from 1.
    pub n: u64,
    /// The last tick that had begun; the entry acts before the next one.
    pub edge: u64,
    /// What acted.
    pub act: JournalAct,
}

/// What acted on the world.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum JournalAct {
    /// A request with commands of which at least one acts on the world.
    Commands {
        /// Name of the client.
        client: String,
        /// The client's count.
        seq: u64,
        /// The request as the client wrote it. It is not parsed and written again, because numbers
        /// would not survive that to the last bit.
        text: String,
        /// What was answered to each command that acts on the world, see
        /// [`crate::CommandReply::outcome`].
        outcomes: Vec<String>,
        /// Whether documents were published after it, which counts the revisions of `world/actors`.
        is_last_of_round: bool,
    },
    /// Records of one sample on `control/vehicles`.
    Controls {
        /// Name of the writer.
        writer: String,
        /// [`crate::VehicleControlRecord`]s in base64.
        records: String,
    },
    /// A topic of a sensor that remembers found or lost its readers: its frames are made, or no
    /// longer, from the next firing on.
    Audience {
        /// The topic, without the domain.
        topic: String,
        /// Whether its frames are made.
        is_made: bool,
    },
    /// A piece of a file that the next command reads.
    File {
        /// What it is.
        of: JournalFile,
        /// Name under which the command asks for it.
        name: String,
        /// Name that a map then has; empty for a checkpoint.
        title: String,
        /// Number of this piece, from 0.
        piece: u32,
        /// Number of pieces.
        n_pieces: u32,
        /// The bytes in base64.
        bytes: String,
    },
}

/// What a file in the journal is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JournalFile {
    /// OpenDRIVE text of a map.
    Map,
    /// A checkpoint.
    Checkpoint,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_entry_is_json_and_comes_back() {
        let entry = JournalEntry {
            n: 3,
            edge: 17,
            act: JournalAct::Controls {
                writer: "autopilot".into(),
                records: "AAAA".into(),
            },
        };
        let text = serde_json::to_string(&entry).unwrap();
        assert_eq!(
            text,
            r#"{"n":3,"edge":17,"act":{"kind":"controls","writer":"autopilot","records":"AAAA"}}"#
        );
        assert_eq!(serde_json::from_str::<JournalEntry>(&text).unwrap(), entry);
    }
}
