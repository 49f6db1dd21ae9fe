//! The journal of a run: what its world began with, and everything that acted on it since, each at
//! its edge between two ticks and in order. A simulator of the same build that carries the entries
//! out again goes through the same states, bit by bit.
//!
//! Not in it is what acts on no world: questions, cues, the mode, lockstep.

use serde::{Deserialize, Serialize};

use crate::command::{Command, CommandReply};
use crate::physics::PhysicsAction;
use crate::skeleton::SkeletonAction;

/// Version of the journal.
pub const JOURNAL_VERSION: u32 = 1;

/// About how many bytes of JSON an answer to `journal` has at most. An entry that is longer by
/// itself, because its request was, is answered alone.
pub const JOURNAL_ANSWER_BYTES: usize = 1 << 20;

/// First actor id of sensors that are added to an old run; no run counts so far, so that all other
/// ids are as they were without them.
pub const FIRST_ADDED_ID: u32 = 1 << 30;

/// Longest outcome that is kept as it is.
const MAX_OUTCOME_BYTES: usize = 300;

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

impl Command {
    /// Whether the command acts on the world or on what sensors see, so that a run which is made
    /// again needs it. `configure` does where it changes the length of ticks or of sub-steps.
    pub fn acts_on_world(&self) -> bool {
        match self {
            Command::Ping
            | Command::Step { .. }
            | Command::SetSpeed { .. }
            | Command::Seek { .. }
            | Command::JoinLockstep { .. }
            | Command::LeaveLockstep { .. }
            | Command::LightBoxes { .. }
            | Command::CastRays { .. }
            | Command::ListMaps
            | Command::Scenery
            | Command::Counters
            | Command::Journal { .. } => false,
            Command::Configure {
                period_nanos,
                longest_substep_nanos,
                ..
            } => period_nanos.is_some() || longest_substep_nanos.is_some(),
            Command::Skeleton { action, .. } => *action != SkeletonAction::Read,
            Command::Physics { action, .. } => !matches!(
                action,
                PhysicsAction::GetVehiclePhysics
                    | PhysicsAction::GetAckermannGains
                    | PhysicsAction::GetTelemetry
            ),
            Command::Spawn { .. }
            | Command::SpawnSensor { .. }
            | Command::Destroy { .. }
            | Command::SetPose { .. }
            | Command::SetVelocity { .. }
            | Command::ControlVehicle { .. }
            | Command::ControlWalker { .. }
            | Command::LeadWalker { .. }
            | Command::SetLamps { .. }
            | Command::SetDoors { .. }
            | Command::SetTrafficLight { .. }
            | Command::FreezeTrafficLights { .. }
            | Command::SetTrafficLightTime { .. }
            | Command::ResetTrafficLights { .. }
            | Command::SetWeather { .. }
            | Command::SetWeatherEffects { .. }
            | Command::SaveCheckpoint { .. }
            | Command::RestoreCheckpoint { .. }
            | Command::Reset
            | Command::DrawDebug { .. }
            | Command::ClearDebug
            | Command::StoreMap(_)
            | Command::LoadMap { .. }
            | Command::ShowObjects { .. }
            | Command::ShowLayers { .. }
            | Command::SetSceneryLamps { .. }
            | Command::SetLampCycle { .. } => true,
        }
    }
}

impl CommandReply {
    /// The answer in short, as a journal keeps it: two runs that differ here have gone apart.
    /// Sentences of refusals and paths of files are left out, since they may name other folders.
    pub fn outcome(&self) -> String {
        match self {
            CommandReply::Done => "done".into(),
            CommandReply::Saved { .. } => "saved".into(),
            CommandReply::Refused { .. } => "refused".into(),
            other => short(serde_json::to_string(other).unwrap_or_default()),
        }
    }
}

/// The text, or its length and FNV-1a hash if it is long.
fn short(text: String) -> String {
    if text.len() <= MAX_OUTCOME_BYTES {
        return text;
    }
    let hash = text.bytes().fold(0xcbf2_9ce4_8422_2325u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    });
    format!("{} bytes, {hash:016x}", text.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn questions_do_not_act_and_a_period_does() {
        let parse = |text: &str| serde_json::from_str::<Command>(text).unwrap();
        for question in [
            r#"{"do":"ping"}"#,
            r#"{"do":"step","n":3}"#,
            r#"{"do":"configure","mode":"stepped"}"#,
            r#"{"do":"physics","actor_id":1,"action":{"act":"get_telemetry"}}"#,
            r#"{"do":"skeleton","actor_id":1,"action":{"act":"read"}}"#,
            r#"{"do":"journal","after":0}"#,
        ] {
            assert!(!parse(question).acts_on_world(), "{question}");
        }
        for action in [
            r#"{"do":"configure","mode":"stepped","period_nanos":50000000}"#,
            r#"{"do":"physics","actor_id":1,"action":{"act":"set_gravity","enabled":false}}"#,
            r#"{"do":"skeleton","actor_id":1,"action":{"act":"capture"}}"#,
            r#"{"do":"reset"}"#,
        ] {
            assert!(parse(action).acts_on_world(), "{action}");
        }
    }

    #[test]
    fn an_outcome_tells_ids_and_keeps_folders_and_bulk_out() {
        let spawned = CommandReply::Spawned {
            actor_id: 31,
            topics: vec!["free/s31/rgb".into()],
        };
        assert!(spawned.outcome().contains("31"));
        let refused = |error: &str| CommandReply::Refused {
            error: error.into(),
        };
        assert_eq!(refused("no file a").outcome(), refused("b").outcome());
        let restored = |gone: u32| CommandReply::Restored {
            gone: (0..gone).collect(),
        };
        assert_ne!(restored(500).outcome(), restored(501).outcome());
        assert!(restored(500).outcome().len() < 40);
    }

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
