//! The bytes in shared memory: one module per frame kind, the snapshot, the documents and the
//! commands.
//!
//! `SPEC.md` beside this crate is the same contract as byte tables for readers in other languages.
//! Every type here is plain data that survives any bit pattern: codes are integers with an accessor
//! that returns an `Option`.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

// What every frame begins with.
pub mod header;
pub mod modality;
pub mod version;

// What frames hold, by sensor.
pub mod dvs;
pub mod events;
pub mod imu_gnss;
pub mod lidar;
pub mod radar;

// What the world publishes.
pub mod document;
pub mod snapshot;

// What the world is asked.
pub mod attachment;
pub mod command;
pub mod control;
pub mod physics;
pub mod query;
pub mod scenery;
pub mod skeleton;

// All layouts as data.
pub mod layout;

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
pub use imu_gnss::{GnssSample, ImuSample};
pub use lidar::{LidarPoint, SemanticLidarPoint};
pub use modality::{Modality, SensorKind};
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
pub use version::{SCHEMA_ATTRIBUTE, SCHEMA_VERSION};
