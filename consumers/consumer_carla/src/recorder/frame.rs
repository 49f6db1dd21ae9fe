//! What a recording holds, whichever format its file has: a head, then one [`Frame`] per recorded
//! tick. Axes are CARLA's; units are metres, degrees and seconds.

use std::collections::BTreeMap;

use crate::recorder::changes::Changes;
use crate::recorder::extra::Extra;
use crate::wire::axes::Transform;
use crate::wire::description::Description;

/// Whose format a file has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// Gantry's, written by [`crate::recorder::writer`].
    Gantry,
    /// CARLA's.
    Carla,
}

/// The head of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Head {
    /// Whose format the file has.
    pub origin: Origin,
    /// Version of the format.
    pub version: u32,
    /// Name of the map, as the file has it.
    pub map: String,
    /// When the recording was started, UTC.
    pub date: String,
}

/// An actor that appears.
#[derive(Clone, Debug, PartialEq)]
pub struct Born {
    /// Its id in the recorded run.
    pub id: u32,
    /// The actor that it was attached to; 0 if none.
    pub parent: u32,
    /// CARLA's number of its family: 1 vehicle, 2 walker, 3 traffic light, anything else other.
    pub family: u8,
    /// Type and attributes.
    pub description: Description,
    /// Its pose.
    pub at: Transform,
    /// Whether its pose is that in its parent's axes, as CARLA records it, instead of the world's.
    pub on_parent: bool,
}

/// CARLA's number of the family of a type.
pub fn family(type_id: &str) -> u8 {
    match type_id {
        "traffic.traffic_light" => 3,
        _ if type_id.starts_with("vehicle.") => 1,
        _ if type_id.starts_with("walker.") => 2,
        _ => 0,
    }
}

/// A vehicle's control as CARLA writes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pedals {
    /// Steering, −1 to 1, positive to the right.
    pub steer: f32,
    /// Throttle, 0 to 1.
    pub throttle: f32,
    /// Brake, 0 to 1.
    pub brake: f32,
    /// Whether the hand brake is on.
    pub hand_brake: bool,
    /// Gear; negative backwards.
    pub gear: i32,
}

/// What a traffic light shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// CARLA's number of the state.
    pub state: u8,
    /// Whether the light is frozen.
    pub frozen: bool,
    /// Seconds since the light changed to this state.
    pub elapsed_secs: f32,
}

/// Two actors that touch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Collision {
    /// Number of the collision in its recording.
    pub number: u32,
    /// The two actors. Scenery is 0 in Gantry's files and 4294967295 in CARLA's.
    pub actors: (u32, u32),
}

/// Velocity (m/s) and angular velocity (degrees per second).
pub type Motion = [[f64; 3]; 2];

/// One recorded tick.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Number that CARLA's texts give to the frame, from 1.
    pub number: u64,
    /// Number of the tick; 0 in CARLA's files, which do not have it.
    pub tick: u64,
    /// Seconds since the recording began.
    pub elapsed_secs: f64,
    /// Length of the tick, seconds; CARLA writes −1 for the last.
    pub delta_secs: f64,
    /// Actors that appeared.
    pub born: Vec<Born>,
    /// Actors that disappeared.
    pub gone: Vec<u32>,
    /// Actors of earlier frames and the actors that they were attached to.
    pub attached: Vec<(u32, u32)>,
    /// Poses of all actors that can move.
    pub poses: BTreeMap<u32, Transform>,
    /// Controls of vehicles.
    pub pedals: BTreeMap<u32, Pedals>,
    /// States of traffic lights.
    pub lights: BTreeMap<u32, Light>,
    /// Pairs of actors that touched. Gantry's files have them in the frame in which they began to.
    pub collisions: Vec<Collision>,
    /// Walking speeds that the gaits of walkers show, m/s.
    pub gaits: BTreeMap<u32, f32>,
    /// Lamps of vehicles, as CARLA's bits.
    pub lamps: BTreeMap<u32, u32>,
    /// Velocities, if the recording has additional data.
    pub motions: BTreeMap<u32, Motion>,
    /// Boxes and times, if the recording has additional data.
    pub extra: Extra,
    /// What is recorded on change only.
    pub changes: Changes,
}

impl Frame {
    /// The pose of an actor in this frame; that of its appearance if it has no other.
    pub fn place(&self, id: u32) -> Option<&Transform> {
        let born = || {
            self.born
                .iter()
                .find(|born| born.id == id && !born.on_parent)
        };
        self.poses.get(&id).or_else(|| born().map(|born| &born.at))
    }
}
