//! Commands on `control/world`: JSON both ways, so that any language can ask without a code
//! generator.
//!
//! A request is `{"v":1,"commands":[…]}`, its answer `{"v":1,"epoch":"…","tick":…,"replies":[…]}`
//! with one reply per command, in order. Commands run between ticks, in the order given. A refused
//! command changes nothing and does not stop those after it.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

use crate::Attachment;
use crate::control::{VehicleControl, WalkerControl};
use crate::document::{PoseText, StepMode, Weather};
use crate::journal::{JournalEntry, JournalHead};
use crate::physics::{PhysicsAction, PhysicsAnswer};
use crate::query::{DebugKind, DebugShape, PosedBox, RayHit, RaySegment};
use crate::skeleton::{BoneReading, SkeletonAction};

/// Version of the command codec.
pub const COMMAND_VERSION: u32 = 1;

/// Most actors that a camera can leave out.
pub const MAX_HIDDEN: usize = 1000;

/// Least and greatest ratio of `set_speed`.
pub const SPEED_RATIO: (f64, f64) = (0.01, 100.0);

/// User header of a request on `control/world`: type name `GantryRequestHeader`, 64 bytes.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct RequestHeader {
    /// [`REQUEST_MAGIC`].
    pub magic: u32,
    /// [`COMMAND_VERSION`].
    pub codec_version: u32,
    /// Client's own count, from 1.
    pub seq: u64,
    /// Bytes of JSON.
    pub payload_bytes: u64,
    /// Client's name, UTF-8, padded with zeros; requests that meet at one tick edge run by (name,
    /// seq).
    pub client: [u8; 40],
}
const _: () = assert!(size_of::<RequestHeader>() == 64);

/// "GREQ" read as a little-endian `u32`.
pub const REQUEST_MAGIC: u32 = u32::from_le_bytes(*b"GREQ");

/// One command.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub enum Command {
    /// Answers with `pong`; changes nothing.
    Ping,
    /// Cues `n` ticks in stepped mode. Cues that were not worked off yet add up.
    Step {
        /// Number of ticks, 1 or more.
        n: u64,
    },
    /// Changes mode, tick length or physics; a value that is absent stays.
    Configure {
        /// New mode.
        #[serde(default)]
        mode: Option<StepMode>,
        /// New tick length, 100 µs to 10 s.
        #[serde(default)]
        period_nanos: Option<u64>,
        /// Longest physics sub-step, 100 µs to 10 ms: a tick is divided into equal sub-steps no
        /// longer than this.
        #[serde(default)]
        longest_substep_nanos: Option<u64>,
    },
    /// Sets how fast free-running ticks follow one another; a simulator that was started without
    /// pacing refuses it.
    SetSpeed {
        /// Simulated seconds per second, within [`SPEED_RATIO`].
        ratio: f64,
    },
    /// Goes to a time of a recording that is replayed; a simulator refuses it. Going back begins a
    /// new epoch.
    Seek {
        /// The next tick is the first at this simulated time or later, nanoseconds.
        sim_nanos: u64,
    },
    /// Spawns an actor.
    Spawn {
        /// Catalogue id.
        type_id: String,
        /// Pose in the world, or on the parent if there is one.
        pose: PoseText,
        /// Actor to attach to.
        #[serde(default)]
        parent_id: Option<u32>,
        /// Role, e.g. `ego_vehicle`; empty for none.
        #[serde(default)]
        role: String,
        /// Attributes to set; unknown names are refused.
        #[serde(default)]
        attributes: BTreeMap<String, String>,
    },
    /// Spawns a sensor. Its topics are `actor_<parent id>/s<id>/<modality>`, or `free/s<id>/…`
    /// without a parent.
    SpawnSensor {
        /// Catalogue id, e.g. `sensor.camera.rgb`.
        type_id: String,
        /// Pose in the world, or on the parent if there is one.
        pose: PoseText,
        /// Actor to attach to.
        #[serde(default)]
        parent_id: Option<u32>,
        /// How it follows its parent; a sensor without one must be `rigid`.
        #[serde(default)]
        attachment: Attachment,
        /// Time between two firings; 0 fires at every tick. It takes the place of `rate_hz` in
        /// `spec`.
        #[serde(default)]
        interval_nanos: u64,
        /// What it measures: the keys of a launch file's `[sensor.NAME]`, `kind` included, without
        /// `mount`.
        spec: serde_json::Map<String, serde_json::Value>,
        /// Attributes that `world/actors` shows; they have no effect on the sensor.
        #[serde(default)]
        attributes: BTreeMap<String, String>,
    },
    /// Removes an actor, and what is attached to it.
    Destroy {
        /// The actor.
        actor_id: u32,
    },
    /// Moves an actor to a pose; its velocity stays.
    SetPose {
        /// The actor.
        actor_id: u32,
        /// World pose.
        pose: PoseText,
    },
    /// Sets a vehicle's velocity.
    SetVelocity {
        /// The actor.
        actor_id: u32,
        /// Velocity, world, m/s.
        velocity_in_world_mps: [f64; 3],
    },
    /// Holds a vehicle's control until it is replaced.
    ControlVehicle {
        /// The actor.
        actor_id: u32,
        /// Pedals and wheel.
        control: VehicleControl,
    },
    /// Holds a walker's control until it is replaced.
    ControlWalker {
        /// The actor.
        actor_id: u32,
        /// Direction and speed.
        control: WalkerControl,
    },
    /// Puts a walker's feet on the ground nearest to a point, within 1 m above and 1.5 m below it.
    /// A client that leads a walker sends this for every tick.
    LeadWalker {
        /// The actor.
        actor_id: u32,
        /// World, metres.
        ground_point_m: [f64; 3],
        /// Heading, radians counter-clockwise from world x.
        yaw_rad: f64,
        /// Speed that its limbs show, m/s.
        speed_mps: f64,
    },
    /// Sets or reads the bones of a walker.
    Skeleton {
        /// The actor.
        actor_id: u32,
        /// The action.
        action: SkeletonAction,
    },
    /// Acts on an actor's body, or asks about a vehicle's.
    Physics {
        /// The actor.
        actor_id: u32,
        /// The action.
        action: PhysicsAction,
    },
    /// Sets a vehicle's lamps.
    SetLamps {
        /// The actor.
        actor_id: u32,
        /// Bits as in `VehiclePart::lamps`.
        lamps: u32,
    },
    /// Opens or shuts doors of a vehicle whose attribute `has_dynamic_doors` is `true`; a door
    /// takes 0.8 s.
    SetDoors {
        /// The actor.
        actor_id: u32,
        /// Sum of 1 front left, 2 front right, 4 rear left, 8 rear right.
        doors: u8,
        /// Whether to open or to shut them.
        open: bool,
    },
    /// Sets the state of a traffic light; its timers run on.
    SetTrafficLight {
        /// The actor.
        actor_id: u32,
        /// `red`, `yellow`, `green`, `off` or `unknown`.
        state: String,
    },
    /// Stops or starts the timers of all traffic lights.
    FreezeTrafficLights {
        /// Whether they stand still.
        frozen: bool,
    },
    /// Sets for how long the controller of a traffic light shows a state.
    SetTrafficLightTime {
        /// Any light of the controller.
        actor_id: u32,
        /// `green`, `yellow` or `red`; the last is the time in which all lights of the junction are
        /// red.
        state: String,
        /// Length, 0.01 to 100 000 s.
        secs: f64,
    },
    /// Restarts groups of traffic lights: the first controller is green, and the time spent in its
    /// state is 0.
    ResetTrafficLights {
        /// Any light of the group; without it, all groups restart.
        #[serde(default)]
        actor_id: Option<u32>,
    },
    /// Answers with the boxes of a traffic light's lamp heads.
    LightBoxes {
        /// The light.
        actor_id: u32,
    },
    /// Changes the weather.
    SetWeather {
        /// The complete weather; keys that are left out take their defaults.
        weather: Weather,
    },
    /// Sets whether weather acts on tyres and lidar, which by default it does not.
    SetWeatherEffects {
        /// Whether it does.
        on: bool,
    },
    /// Saves the world.
    SaveCheckpoint {
        /// Where: in memory under a name, or in a file.
        to: CheckpointPlace,
    },
    /// Returns to a saved world. The counts of ticks and ids go on; sensors stay.
    RestoreCheckpoint {
        /// Where it was saved.
        from: CheckpointPlace,
    },
    /// Returns to the start of the episode.
    Reset,
    /// Answers with what rays meet among the triangles that sensors see, those of moving actors
    /// included.
    CastRays {
        /// Rays.
        rays: Vec<RaySegment>,
        /// Whether to answer with all surfaces along each ray instead of the first.
        #[serde(default)]
        all: bool,
    },
    /// Draws shapes into colour images, or into the spectator's alone.
    DrawDebug {
        /// Shapes to add to those that are drawn already.
        shapes: Vec<DebugShape>,
    },
    /// Removes debug shapes.
    ClearDebug {
        /// Which.
        #[serde(default)]
        what: DebugKind,
    },
    /// Shows a vehicle's telemetry in the spectator's image, or hides it. Of several vehicles the
    /// one that was asked for last is shown.
    ShowTelemetry {
        /// The vehicle.
        actor_id: u32,
        /// Whether to show or to hide it.
        shown: bool,
    },
    /// Answers with the names of all maps that can be loaded.
    ListMaps,
    /// Stores an OpenDRIVE text, which `load_map` then finds under its name until the daemon ends.
    StoreMap(StoredMap),
    /// Loads a map. A new episode begins without the old one's actors; the ego, vehicles and rigs
    /// of the launch file are spawned again.
    LoadMap {
        /// Name of a town, of a file in the map folder or of a stored map, or the path of an
        /// `.xodr` file.
        map: String,
    },
    /// Leaves actors out of what a camera shows, in all its images; an empty list shows all again.
    HideActors {
        /// The camera.
        sensor_id: u32,
        /// The actors, at most [`MAX_HIDDEN`]; unknown ones are kept for when they come.
        actor_ids: Vec<u32>,
    },
    /// Joins the lockstep gate.
    JoinLockstep {
        /// Name of the participant, for messages.
        name: String,
    },
    /// Leaves the lockstep gate.
    LeaveLockstep {
        /// Number from the reply to `join_lockstep`.
        participant: u32,
    },
    /// Answers with every object and lamp of the scenery.
    Scenery,
    /// Shows or hides objects of the scenery, for all sensors and for collisions.
    ShowObjects {
        /// Ids; unknown ones are refused.
        object_ids: Vec<u32>,
        /// Whether to show or to hide them.
        shown: bool,
    },
    /// Shows or hides all objects of these layers.
    ShowLayers {
        /// Bits as in [`crate::scenery::SceneryObjectInfo::layer`].
        layers: u16,
        /// Whether to show or to hide them.
        shown: bool,
    },
    /// Switches lamps of the scenery, or changes their colour, strength or group.
    SetSceneryLamps {
        /// Changes in order.
        changes: Vec<crate::scenery::LampChange>,
    },
    /// Sets whether lamps that nobody switched shine in the dark, which by default they do.
    SetLampCycle {
        /// Whether they shine.
        on: bool,
    },
    /// Answers with counters of the daemon.
    Counters,
    /// Answers with what acted on the world so far, entry by entry ([`crate::journal`]).
    Journal {
        /// Number of the last entry that is known already; 0 asks from the beginning, and for the
        /// head.
        after: u64,
    },
}

/// Where a checkpoint is kept.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum CheckpointPlace {
    /// In the daemon's memory under this name, until the daemon ends or the next map is loaded.
    Name(String),
    /// In this file of the folder `checkpoints` in the data folder; the name contains no folders.
    File(String),
}

/// An OpenDRIVE text and how to build a world from it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StoredMap {
    /// Name for `load_map`: letters, digits, `-`, `_` and `.`.
    pub name: String,
    /// The text.
    pub open_drive: String,
    /// Longest distance between two rows of the road surface, metres.
    #[serde(default = "default_vertex_distance_m")]
    pub vertex_distance_m: f64,
    /// Height of walls along the outer edges of roads, metres; 0 for none.
    #[serde(default)]
    pub wall_height_m: f64,
    /// Metres by which lanes in junctions are wider.
    #[serde(default)]
    pub junction_extra_m: f64,
    /// Whether its roads and walls are visible.
    #[serde(default = "yes")]
    pub visible: bool,
    /// Whether houses, trees and lamps are placed beside the roads.
    #[serde(default = "yes")]
    pub roadside: bool,
}

impl Default for StoredMap {
    fn default() -> Self {
        StoredMap {
            name: String::new(),
            open_drive: String::new(),
            vertex_distance_m: default_vertex_distance_m(),
            wall_height_m: 0.0,
            junction_extra_m: 0.0,
            visible: true,
            roadside: true,
        }
    }
}

fn default_vertex_distance_m() -> f64 {
    6.0
}

fn yes() -> bool {
    true
}

/// A request.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandBatch {
    /// [`COMMAND_VERSION`].
    pub v: u32,
    /// The commands, in the order in which they run.
    pub commands: Vec<Command>,
}

impl CommandBatch {
    /// A request in the current version.
    pub fn new(commands: Vec<Command>) -> Self {
        CommandBatch {
            v: COMMAND_VERSION,
            commands,
        }
    }
}

/// Answer to one command.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "is", rename_all = "snake_case")]
pub enum CommandReply {
    /// The command is done and has nothing to answer.
    Done,
    /// Answer to `ping`.
    Pong {
        /// Version of the daemon.
        version: String,
    },
    /// Answer to `step`.
    Stepping {
        /// The last tick that the cues given so far will start.
        last_tick: u64,
    },
    /// Answer to `spawn`.
    Spawned {
        /// The new actor.
        actor_id: u32,
        /// Topics, if it is a sensor.
        topics: Vec<String>,
    },
    /// Answer to the actions of `physics` that ask for something.
    Physics {
        /// The answer under its name: `vehicle_physics`, `ackermann_gains` or `telemetry`.
        answer: PhysicsAnswer,
    },
    /// Answer to `join_lockstep`.
    Joined {
        /// Number to acknowledge with.
        participant: u32,
        /// First tick to acknowledge.
        first_tick: u64,
    },
    /// Answer to `list_maps`.
    Maps {
        /// Towns, then files of the map folder, then stored maps.
        names: Vec<String>,
    },
    /// Answer to `counters`.
    Counters {
        /// Values by name.
        counters: BTreeMap<String, u64>,
    },
    /// Answer to `journal`: about [`JOURNAL_ANSWER_BYTES`](crate::journal::JOURNAL_ANSWER_BYTES) of
    /// JSON at most.
    Journal {
        /// What the run began with; only in the answer to `after` 0.
        head: Option<Box<JournalHead>>,
        /// Number of the oldest entry that the daemon still has. If it is beyond what was asked
        /// for, the entries before it are gone.
        first: u64,
        /// Entries in order.
        entries: Vec<JournalEntry>,
        /// What to ask for next.
        next: u64,
        /// Whether there are more entries already.
        more: bool,
    },
    /// Answer to `save_checkpoint`.
    Saved {
        /// The file's full path; empty if it is kept in memory.
        path: String,
    },
    /// Answer to `restore_checkpoint` and `reset`.
    Restored {
        /// Sensors that were removed because their parent does not exist in the restored world.
        gone: Vec<u32>,
    },
    /// Answer to `light_boxes`.
    Boxes {
        /// Boxes in the world.
        boxes: Vec<PosedBox>,
    },
    /// Answer to `skeleton` with `read`.
    Bones {
        /// The bones, parents before children.
        bones: Vec<BoneReading>,
    },
    /// Answer to `cast_rays`.
    Hits {
        /// For each ray what it meets, nearest first; empty if it meets nothing.
        rays: Vec<Vec<RayHit>>,
    },
    /// Answer to `scenery`.
    Scenery {
        /// Objects by rising id.
        objects: Vec<crate::scenery::SceneryObjectInfo>,
        /// Lamps by number.
        lamps: Vec<crate::scenery::SceneryLampInfo>,
    },
    /// The command was not done.
    Refused {
        /// Why, in a sentence.
        error: String,
    },
}

/// Answer to a request.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReplyBatch {
    /// [`COMMAND_VERSION`].
    pub v: u32,
    /// The daemon's epoch, decimal text.
    pub epoch: String,
    /// Last finished tick.
    pub tick: u64,
    /// One reply per command, in order.
    pub replies: Vec<CommandReply>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_reads_as_documented() {
        let text = r#"{"v":1,"commands":[{"do":"step","n":3},{"do":"spawn","type_id":"vehicle.tesla.model3",
            "pose":{"translation_m":[1,2,3],"rotation_xyzw":[0,0,0,1]}}]}"#;
        let batch: CommandBatch = serde_json::from_str(text).unwrap();
        assert_eq!(batch.commands[0], Command::Step { n: 3 });
        let again: CommandBatch =
            serde_json::from_str(&serde_json::to_string(&batch).unwrap()).unwrap();
        assert_eq!(batch, again);
    }

    #[test]
    fn unknown_keys_are_refused_by_name() {
        let error = serde_json::from_str::<CommandBatch>(
            r#"{"v":1,"commands":[{"do":"step","n":1,"m":2}]}"#,
        )
        .unwrap_err();
        assert!(error.to_string().contains('m'), "{error}");
    }
}
