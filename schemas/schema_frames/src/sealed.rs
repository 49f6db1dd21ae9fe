//! Sealed worlds: what a simulator or a replay shows of itself where programs are scored against its
//! truth. Programs see what sensors measure, and nothing that says how the world is.

use std::mem::{offset_of, size_of};
use std::ops::Range;

use schema_types::Pose;
use serde::{Deserialize, Serialize};

use crate::{
    CollisionEvent, Command, DvsEvent, FrameHeader, LaneCrossing, LidarReturn, Modality,
    ObstacleEvent, RadarDetection, SemanticLidarPoint, SnapshotHeader, WorldInfo,
};

/// What a sealed world shows, and to whom it listens. Programs that seal a world hand it over as
/// JSON.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Seal {
    /// Process whose commands are carried out: the one that sealed the world.
    pub owner_pid: u32,
    /// Names under which other processes may take part in lockstep.
    #[serde(default)]
    pub participants: Vec<String>,
    /// Topics of frames that are published; the others stay silent.
    pub topics: Vec<String>,
    /// Topics whose points and events keep the numbers and classes of objects, because they are an
    /// input on purpose.
    #[serde(default)]
    pub exact_topics: Vec<String>,
}

/// Why a seal cannot be used.
#[derive(Debug, thiserror::Error)]
#[error(
    "{text:?} is no seal: {source}; it is JSON with owner_pid, topics, participants and exact_topics"
)]
pub struct SealError {
    text: String,
    source: serde_json::Error,
}

/// Why a sealed world does not do what a command asks for.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "this world is sealed: it answers ping, and join_lockstep and leave_lockstep of those that it waits for; only the process that sealed it may ask for more"
)]
pub struct SealedError;

impl Seal {
    /// Reads what [`Seal::to_json`] writes.
    ///
    /// # Errors
    /// [`SealError`].
    pub fn from_json(text: &str) -> Result<Seal, SealError> {
        serde_json::from_str(text).map_err(|source| SealError {
            text: text.to_owned(),
            source,
        })
    }

    /// As JSON.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("texts and numbers are JSON")
    }

    /// Whether frames of a topic are published.
    pub fn shows(&self, topic: &str) -> bool {
        self.topics.iter().any(|shown| shown == topic)
    }

    /// Whether points and events of a topic keep the numbers and classes of objects.
    pub fn is_exact(&self, topic: &str) -> bool {
        self.exact_topics.iter().any(|exact| exact == topic)
    }

    /// Whether a process may give a command. `name_of` is the name of a participant of the lockstep.
    ///
    /// # Errors
    /// [`SealedError`] if it may not.
    pub fn admit(
        &self,
        command: &Command,
        asker_pid: Option<u32>,
        name_of: impl FnOnce(u32) -> Option<String>,
    ) -> Result<(), SealedError> {
        let is_participant = |name: &String| self.participants.contains(name);
        let is_admitted = asker_pid == Some(self.owner_pid)
            || match command {
                Command::Ping => true,
                Command::JoinLockstep { name } => is_participant(name),
                Command::LeaveLockstep { participant } => {
                    name_of(*participant).is_some_and(|name| is_participant(&name))
                }
                _ => false,
            };
        is_admitted.then_some(()).ok_or(SealedError)
    }
}

/// Steps of a mount in a metre, and in 1 of its quaternion. Both are far above what rounding leaves
/// of a pose in the world, so that nothing of that is left in a mount.
const STEPS_PER_M: f64 = 1e6;
const STEPS_PER_XYZW: f64 = 1e9;

/// The mount that a sealed header has in place of a pose in the world.
pub fn mount(vehicle_from_sensor: &Pose) -> Pose {
    // Adding 0 makes the zero of a small negative number the usual one.
    let stepped = |value: f64, per_unit: f64| (value * per_unit).round() / per_unit + 0.0;
    let [x, y, z, w] = vehicle_from_sensor.rotation_xyzw;
    // q and −q are one rotation; the first number that is not 0 decides, from w on.
    let first = [w, z, y, x]
        .into_iter()
        .find(|value| value.abs() > 1.0 / STEPS_PER_XYZW);
    let sign = if first.is_some_and(|value| value < 0.0) {
        -1.0
    } else {
        1.0
    };
    Pose {
        translation_m: vehicle_from_sensor
            .translation_m
            .map(|value| stepped(value, STEPS_PER_M)),
        rotation_xyzw: [x, y, z, w].map(|value| stepped(sign * value, STEPS_PER_XYZW)),
    }
}

/// The mount of a sensor that is somewhere in the world, on a vehicle that is there, too.
pub fn mount_between(world_from_vehicle: &Pose, world_from_sensor: &Pose) -> Pose {
    let vehicle = world_from_vehicle.isometry();
    mount(&vehicle.inv_mul(&world_from_sensor.isometry()).into())
}

impl FrameHeader {
    /// Replaces the pose in the world by the mount, and says so in the flags.
    pub fn seal(&mut self, vehicle_from_sensor: Pose) {
        self.flags |= FrameHeader::SEALED;
        self.world_from_sensor = vehicle_from_sensor;
    }
}

impl SnapshotHeader {
    /// The header of a snapshot without actors: which tick it is and when.
    pub fn sealed(&self) -> SnapshotHeader {
        SnapshotHeader {
            n_actors: 0,
            actors_revision: 0,
            flags: self.flags & SnapshotHeader::RESTORED,
            ..*self
        }
    }
}

impl WorldInfo {
    /// What a sealed world says about itself: neither where it is nor what makes it.
    pub fn sealed(self) -> WorldInfo {
        WorldInfo {
            map: String::new(),
            seed: 0,
            weather: crate::document::Weather::default(),
            adapter: String::new(),
            batches: Vec::new(),
            ..self
        }
    }
}

/// Bytes of a field.
macro_rules! bytes_of {
    ($record:ty, $field:ident: $kind:ty) => {{
        let at = offset_of!($record, $field);
        Range {
            start: at,
            end: at + size_of::<$kind>(),
        }
    }};
}

impl Modality {
    /// Bytes of each element that a sealed world blanks: numbers and classes of objects, places in
    /// the world, and numbers of the map.
    pub fn sealed_bytes(self) -> &'static [Range<usize>] {
        match self {
            Modality::Dvs => {
                const {
                    &[
                        bytes_of!(DvsEvent, object_id: u32),
                        bytes_of!(DvsEvent, class: u8),
                    ]
                }
            }
            Modality::SemanticLidar => {
                const {
                    &[
                        bytes_of!(SemanticLidarPoint, object_id: u32),
                        bytes_of!(SemanticLidarPoint, class: u8),
                    ]
                }
            }
            Modality::LidarReturns => {
                const {
                    &[
                        bytes_of!(LidarReturn, object_id: u32),
                        bytes_of!(LidarReturn, class: u8),
                    ]
                }
            }
            Modality::Radar => {
                const {
                    &[
                        bytes_of!(RadarDetection, object_id: u32),
                        bytes_of!(RadarDetection, class: u8),
                    ]
                }
            }
            Modality::Collision => {
                const {
                    &[
                        bytes_of!(CollisionEvent, other_id: u32),
                        bytes_of!(CollisionEvent, class: u8),
                        bytes_of!(CollisionEvent, impulse_in_world_ns: [f64; 3]),
                        bytes_of!(CollisionEvent, point_in_world_m: [f64; 3]),
                    ]
                }
            }
            Modality::LaneInvasion => {
                const {
                    &[
                        bytes_of!(LaneCrossing, lane: i8),
                        bytes_of!(LaneCrossing, road: u32),
                        bytes_of!(LaneCrossing, crossing_in_world_m: [f32; 3]),
                    ]
                }
            }
            Modality::Obstacle => {
                const {
                    &[
                        bytes_of!(ObstacleEvent, object_id: u32),
                        bytes_of!(ObstacleEvent, class: u8),
                    ]
                }
            }
            Modality::Rgb
            | Modality::Depth
            | Modality::Semantic
            | Modality::Instance
            | Modality::Flow
            | Modality::Normals
            | Modality::Lidar
            | Modality::Imu
            | Modality::Gnss => &[],
        }
    }

    /// Blanks a payload in place, for a sealed world.
    pub fn blank(self, payload: &mut [u8]) {
        let ranges = self.sealed_bytes();
        if ranges.is_empty() {
            return;
        }
        for element in payload.chunks_exact_mut(self.element_bytes()) {
            for range in ranges {
                element[range.clone()].fill(0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable as _;

    #[test]
    fn a_sealed_world_obeys_its_owner_and_lets_participants_in() {
        let seal = Seal {
            owner_pid: 7,
            participants: vec!["mine".into()],
            topics: vec!["ego/front/rgb".into()],
            exact_topics: Vec::new(),
        };
        let join = |name: &str| Command::JoinLockstep { name: name.into() };
        let named = |number| (number == 3).then(|| "mine".to_owned());
        let leave = |participant| Command::LeaveLockstep { participant };
        for (command, pid, is_admitted) in [
            (Command::SetSpeed { ratio: 0.1 }, 7, true),
            (Command::SetSpeed { ratio: 0.1 }, 8, false),
            (Command::Counters, 8, false),
            (Command::Ping, 8, true),
            (join("mine"), 8, true),
            (join("other"), 8, false),
            (join("other"), 7, true),
            (leave(3), 8, true),
            (leave(4), 8, false),
        ] {
            let found = seal.admit(&command, Some(pid), named);
            assert_eq!(found.is_ok(), is_admitted, "{command:?} of {pid}");
        }
        assert!(seal.admit(&Command::Counters, None, named).is_err());
        assert_eq!(Seal::from_json(&seal.to_json()).unwrap(), seal);
        let error = Seal::from_json("{}").unwrap_err().to_string();
        assert!(error.contains("owner_pid"), "{error}");
    }

    #[test]
    fn a_mount_has_nothing_left_of_the_place_in_the_world() {
        let on_vehicle = Pose::from_xyz_yaw(0.6, -0.25, 1.6, 0.5);
        for (x_m, y_m, yaw_rad) in [(0.0, 0.0, 0.0), (1234.567, -89.01, 2.5), (-7e3, 5e3, -3.1)] {
            let world_from_vehicle = Pose::from_xyz_yaw(x_m, y_m, 0.3, yaw_rad);
            let sensor = world_from_vehicle.isometry() * on_vehicle.isometry();
            let found = mount_between(&world_from_vehicle, &sensor.into());
            assert_eq!(found, mount(&on_vehicle), "at {x_m}, {y_m}");
        }
        // As the suite says it, to the last digit.
        assert_eq!(mount(&on_vehicle).translation_m, [0.6, -0.25, 1.6]);
        let turned = Pose {
            rotation_xyzw: on_vehicle.rotation_xyzw.map(|value| -value),
            ..on_vehicle
        };
        assert_eq!(mount(&turned), mount(&on_vehicle));
    }

    #[test]
    fn numbers_and_classes_are_blanked_and_what_is_measured_stays() {
        let event = DvsEvent {
            nanos_in_window: 1,
            x_px: 2,
            y_px: 3,
            object_id: 4,
            polarity: 1,
            class: 5,
            reserved: 0,
        };
        let mut events = [event; 2];
        Modality::Dvs.blank(bytemuck::cast_slice_mut(&mut events));
        let blank = DvsEvent {
            object_id: 0,
            class: 0,
            ..event
        };
        assert_eq!(events, [blank; 2]);
        let hit = CollisionEvent {
            other_id: 9,
            class: 3,
            impulse_in_world_ns: [1.0; 3],
            point_in_world_m: [2.0; 3],
            ..CollisionEvent::zeroed()
        };
        let mut hits = [hit];
        Modality::Collision.blank(bytemuck::cast_slice_mut(&mut hits));
        assert_eq!(hits, [CollisionEvent::zeroed()]);
        let crossing = LaneCrossing {
            mark: 2,
            colour: 1,
            lane_change: 3,
            lane: -2,
            width_m: 0.12,
            road: 17,
            nanos_in_window: 5,
            crossing_in_world_m: [4.0; 3],
            reserved: 0,
        };
        let mut crossings = [crossing];
        Modality::LaneInvasion.blank(bytemuck::cast_slice_mut(&mut crossings));
        let blank = LaneCrossing {
            lane: 0,
            road: 0,
            crossing_in_world_m: [0.0; 3],
            ..crossing
        };
        assert_eq!(crossings, [blank]);
        for modality in Modality::ALL {
            let mut element = vec![0xff; modality.element_bytes()];
            modality.blank(&mut element);
            let n_blank = element.iter().filter(|byte| **byte == 0).count();
            let n_sealed: usize = modality.sealed_bytes().iter().map(Range::len).sum();
            assert_eq!(n_blank, n_sealed, "{modality:?}");
        }
    }
}
