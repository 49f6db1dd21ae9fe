//! What a command does to a world, and what came of it: what a journal notes.

use crate::command::{Command, CommandReply};
use crate::physics::PhysicsAction;
use crate::skeleton::SkeletonAction;

/// Longest outcome that is kept as it is.
const MAX_OUTCOME_BYTES: usize = 300;

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
            | Command::ClearDebug { .. }
            | Command::ShowTelemetry { .. }
            | Command::HideActors { .. }
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
            // A new run has to know what topics to wait for.
            spawned @ CommandReply::Spawned { .. } => {
                serde_json::to_string(spawned).unwrap_or_default()
            }
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
        let all_of_a_camera = CommandReply::Spawned {
            actor_id: 31,
            topics: (0..20)
                .map(|n| format!("actor_12345/s12346/m{n}"))
                .collect(),
        };
        assert!(all_of_a_camera.outcome().contains("actor_12345/s12346/m19"));
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
}
