//! The bytes in shared memory: one module per frame kind, the snapshot, the documents and the
//! commands.
//!
//! `SPEC.md` beside this crate is the same contract as byte tables for readers in other languages.
//! Every type here is plain data that survives any bit pattern: codes are integers with an accessor
//! that returns an `Option`.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod attachment;
pub mod command;
pub mod control;
pub mod document;
pub mod dvs;
pub mod events;
pub mod header;
pub mod layout;
pub mod lidar;
pub mod modality;
pub mod motion;
pub mod physics;
pub mod query;
pub mod radar;
pub mod scenery;
pub mod skeleton;
pub mod snapshot;

pub use attachment::Attachment;
pub use command::{Command, CommandBatch, CommandReply, ReplyBatch};
pub use control::{AckRecord, VehicleControl, VehicleControlRecord, WalkerControl};
pub use document::{
    ActorInfo, ActorList, BodyBox, Catalogue, CatalogueEntry, DocumentHeader, SpawnPoints,
    StepMode, WorldInfo,
};
pub use dvs::DvsEvent;
pub use events::{CollisionEvent, LaneCrossing, ObstacleEvent};
pub use header::{FrameError, FrameHeader};
pub use lidar::{LidarPoint, SemanticLidarPoint};
pub use modality::{Modality, SensorKind};
pub use motion::{GnssSample, ImuSample};
pub use physics::{
    AckermannControl, AckermannGains, GearPhysics, PhysicsAction, PhysicsAnswer, VehiclePhysics,
    VehicleTelemetry, WheelPhysics, WheelTelemetry,
};
pub use query::{DebugDraw, DebugShape, PosedBox, RayHit, RaySegment};
pub use radar::RadarDetection;
pub use skeleton::{BoneReading, HeldBone, SkeletonAction};
pub use snapshot::{
    ActorKind, ActorRecord, LightState, SnapshotHeader, TrafficLightPart, TrafficSignPart,
    VehiclePart, WalkerPart,
};

/// Version of every layout in this crate. A reader refuses any other.
pub const SCHEMA_VERSION: u16 = 1;

/// Service attribute that carries [`SCHEMA_VERSION`], so that a reader can refuse before it opens a
/// service.
pub const SCHEMA_ATTRIBUTE: &str = "gantry.schema";
