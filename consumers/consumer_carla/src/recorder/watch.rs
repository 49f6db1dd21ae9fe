//! Finds out what has to be recorded of a snapshot: what has changed, and what the simulator has to
//! be asked for.

use std::collections::BTreeMap;

use consumer_kit::WorldAt;
use schema_frames::document::Weather;
use schema_frames::{
    BoneReading, Command, CommandReply, PhysicsAction, PhysicsAnswer, SkeletonAction,
};

use crate::recorder::changes::Changes;
use crate::state::commander::{Commander, Pending};
use crate::wire::axes;

/// What a snapshot lacks and the simulator has to be asked for: physics control and bones.
#[derive(Debug, Default)]
pub struct Wanted {
    /// Vehicles whose physics control is to be recorded.
    pub vehicles: Vec<u32>,
    /// Walkers whose bones are to be recorded.
    pub walkers: Vec<u32>,
}

impl Wanted {
    /// Asks for everything in one request, which runs before whatever is asked later, and waits for
    /// nothing.
    pub fn ask(self, commander: &Commander) -> Asked {
        if self.vehicles.is_empty() && self.walkers.is_empty() {
            return Asked::default();
        }
        let physics = |actor_id: &u32| Command::Physics {
            actor_id: *actor_id,
            action: PhysicsAction::GetVehiclePhysics,
        };
        let bones = |actor_id: &u32| Command::Skeleton {
            actor_id: *actor_id,
            action: SkeletonAction::Read,
        };
        let commands = self
            .vehicles
            .iter()
            .map(physics)
            .chain(self.walkers.iter().map(bones))
            .collect();
        Asked {
            answer: Some(commander.begin(commands)),
            of: self,
        }
    }
}

/// What the simulator was asked for a snapshot.
#[derive(Debug, Default)]
pub struct Asked {
    of: Wanted,
    answer: Option<Pending>,
}

impl Asked {
    /// Waits for the answer. Actors that have just disappeared are left out.
    pub fn answer(self, changes: &mut Changes) {
        let Asked {
            of,
            answer: Some(answer),
        } = self
        else {
            return;
        };
        let replies = match answer.wait() {
            Ok(answer) => answer.replies,
            Err(error) => {
                return tracing::warn!(
                    %error,
                    "a tick is recorded without physics control and bones"
                );
            }
        };
        for (actor_id, reply) in of.vehicles.iter().chain(&of.walkers).zip(replies) {
            match reply {
                CommandReply::Physics {
                    answer: PhysicsAnswer::VehiclePhysics(physics),
                } => {
                    changes.physics.insert(*actor_id, *physics);
                }
                CommandReply::Bones { bones } => {
                    let bone = |bone: BoneReading| {
                        (bone.name, axes::transform(&bone.bone_in_parent.into()))
                    };
                    changes
                        .bones
                        .insert(*actor_id, bones.into_iter().map(bone).collect());
                }
                _ => {}
            }
        }
    }
}

/// Doors that are open or opening (one bit per door), from how far each was open before and is now
/// (four bits per door, as in snapshots). `was` is the previous result.
pub fn opened(before: u16, now: u16, was: u8) -> u8 {
    (0..4).fold(0, |doors, door| {
        let (before, now) = (before >> (4 * door) & 15, now >> (4 * door) & 15);
        let is_open = match now {
            0 => false,
            15 => true,
            _ if now == before => was >> door & 1 != 0,
            _ => now > before,
        };
        doors | u8::from(is_open) << door
    })
}

/// Remembers what was recorded last, so that only changes are recorded.
#[derive(Debug, Default)]
pub struct Watch {
    weather: Option<Weather>,
    doors: BTreeMap<u32, (u16, u8)>,
}

impl Watch {
    /// Notes what has changed with this snapshot.
    pub fn note(&mut self, snapshot: &WorldAt, weather: Option<Weather>, changes: &mut Changes) {
        if weather.is_some() && self.weather != weather {
            (self.weather, changes.weather) = (weather, weather);
        }
        self.doors.retain(|id, _| snapshot.actor(*id).is_some());
        for record in &snapshot.records {
            let Some(part) = record.vehicle() else {
                continue;
            };
            let now = (part.control_flags >> 16) as u16;
            let (before, was) = self.doors.get(&record.id).copied().unwrap_or_default();
            let doors = opened(before, now, was);
            if doors != was {
                changes.doors.insert(record.id, doors);
            }
            if now != 0 || before != 0 {
                self.doors.insert(record.id, (now, doors));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doors_are_open_from_the_moment_they_are_being_opened_until_they_are_being_shut() {
        // The front left door opens, stays open and shuts; the rear right door opens later.
        let angles = [
            0x0000u16, 0x0005, 0x000f, 0x000f, 0x300f, 0xf00a, 0xf00a, 0xf000,
        ];
        let (mut was, mut before, mut seen) = (0, 0, Vec::new());
        for now in angles {
            was = opened(before, now, was);
            before = now;
            seen.push(was);
        }
        assert_eq!(seen, [0, 1, 1, 1, 0b1001, 0b1000, 0b1000, 0b1000]);
    }
}
