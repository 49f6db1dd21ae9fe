//! Applies the recorded changes in a replay: weather, street lights, doors, physics control, bones.

use std::collections::BTreeSet;

use schema_frames::scenery::LampChange;
use schema_frames::{Command, HeldBone, PhysicsAction, SkeletonAction};

use crate::recorder::changes::{Bones, Changes, StreetLight};
use crate::state::commander::Commander;
use crate::wire::axes::{self, Transform};
use crate::wire::vehicle_physics::fit_wheels;

/// Applies the changes of a recorded tick. `now_of` maps a recorded id to the id in this run;
/// `None` if that actor takes no part. `two_wheelers` are recorded ids.
pub fn bring_about(
    changes: &Changes,
    now_of: impl Fn(u32) -> Option<u32>,
    two_wheelers: &BTreeSet<u32>,
    commander: &Commander,
) {
    if let Some(weather) = changes.weather {
        commander.tell(Command::SetWeather { weather });
    }
    if !changes.street_lights.is_empty() {
        let change = |(id, light): (&u32, &StreetLight)| LampChange {
            lamp: *id,
            on: Some(light.on),
            rgb: Some(light.rgb),
            intensity_lm: Some(light.intensity_lm),
            group: None,
        };
        commander.tell(Command::SetSceneryLamps {
            changes: changes.street_lights.iter().map(change).collect(),
        });
    }
    for (id, doors) in &changes.doors {
        let Some(actor_id) = now_of(*id) else {
            continue;
        };
        for (doors, open) in [(*doors, true), (!doors & 15, false)] {
            if doors != 0 {
                commander.tell(Command::SetDoors {
                    actor_id,
                    doors,
                    open,
                });
            }
        }
    }
    for (id, physics) in &changes.physics {
        let Some(actor_id) = now_of(*id) else {
            continue;
        };
        let mut action = PhysicsAction::SetVehiclePhysics {
            physics: Box::new(physics.clone()),
        };
        fit_wheels(&mut action, two_wheelers.contains(id).then_some(2));
        commander.tell(Command::Physics { actor_id, action });
    }
}

/// Shows a walker with these bones instead of its gait until [`let_go`] is called.
pub fn hold(actor_id: u32, bones: &Bones, commander: &Commander) {
    let held = |(name, at): &(String, Transform)| HeldBone {
        name: name.clone(),
        bone_in_parent: axes::pose(at).into(),
    };
    let bones = bones.iter().map(held).collect();
    commander.tell(Command::Skeleton {
        actor_id,
        action: SkeletonAction::Hold { bones },
    });
    commander.tell(Command::Skeleton {
        actor_id,
        action: SkeletonAction::Blend { ratio: 1.0 },
    });
}

/// Lets a walker show its gait again.
pub fn let_go(actor_id: u32, commander: &Commander) {
    commander.tell(Command::Skeleton {
        actor_id,
        action: SkeletonAction::Blend { ratio: 0.0 },
    });
}
