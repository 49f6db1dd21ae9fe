//! The journal of a run in a recording: messages on `/control/journal`.

use schema_frames::{JournalEntry, JournalHead};
use serde::{Deserialize, Serialize};

/// Channel of the journal.
pub const JOURNAL_CHANNEL: &str = "/control/journal";

/// One message (`gantry.Journal`, JSON): what acted on the world since the message before.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Piece {
    /// What the run began with; in the first message of a file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub head: Option<JournalHead>,
    /// The last finished tick when this was fetched: up to it the journal is complete.
    pub tick: u64,
    /// What acted, in order.
    pub entries: Vec<JournalEntry>,
}

/// The schema of the messages.
pub(crate) const SCHEMA: &str = r#"{"type":"object","properties":{
"head":{"type":"object"},"tick":{"type":"integer"},
"entries":{"type":"array","items":{"type":"object","properties":{
"n":{"type":"integer"},"edge":{"type":"integer"},"act":{"type":"object"}}}}}}"#;
