//! The contract of the bytes in shared memory: frames, the snapshot, documents, controls, commands
//! and the results of users' programs.
//!
//! `SPEC.md` beside this crate is the same contract as byte tables, for readers in other languages;
//! a test compares the two. Every type here is plain data that survives any bit pattern: codes are
//! integers with an accessor that returns an `Option`, and a reader checks a header before it
//! touches what follows. Nothing here knows how bytes are sent; that is `schema_bus`.
//!
//! ```
//! use schema_frames::{FrameHeader, Modality};
//!
//! let mut header = FrameHeader::new(Modality::Depth);
//! header.set_image(800, 600);
//! assert_eq!((header.row_stride, header.payload_bytes), (3200, 1_920_000));
//!
//! // A reader trusts nothing before this check; here the sample is shorter than the header says.
//! assert_eq!(header.check(1_920_000), Ok(Modality::Depth));
//! let error = header.check(1000).unwrap_err().to_string();
//! assert!(error.starts_with("frame claims 1920000 payload bytes, its sample holds 1000"));
//! ```

#![forbid(unsafe_code)]
#![warn(missing_docs)]

// What every frame begins with.
pub mod gpu_place;
pub mod gpu_socket;
pub mod header;
pub mod modality;
pub mod version;

// What frames hold, by sensor.
pub mod dvs;
pub mod events;
pub mod imu_gnss;
pub mod lidar;
pub mod radar;

// How much of everything there may be.
pub mod limits;

// What the world publishes.
pub mod calibration;
pub mod document;
pub mod scene;
pub mod sealed;
pub mod snapshot;

// What the world is asked.
pub mod attachment;
pub mod command;
pub mod control;
mod effect;
pub mod journal;
pub mod physics;
pub mod query;
pub mod scenery;
pub mod skeleton;

// What users' programs say about frames.
pub mod about;
pub mod result;
pub mod result_body;
pub mod result_records;
pub mod result_type;

// All layouts as data.
pub mod layout;

pub use about::{About, AboutError, BytesSchema, PointField};
pub use attachment::Attachment;
pub use calibration::Calibration;
pub use command::{Command, CommandBatch, CommandReply, MAX_HIDDEN, ReplyBatch};
pub use control::{AckRecord, CompleteRecord, VehicleControl, VehicleControlRecord, WalkerControl};
pub use document::{
    ActorInfo, ActorList, BatchCamera, BatchInfo, BodyBox, CameraInfo, Catalogue, CatalogueEntry,
    DocumentHeader, SpawnPoints, StepMode, WorldInfo,
};
pub use dvs::DvsEvent;
pub use events::{CollisionEvent, LaneCrossing, ObstacleEvent};
pub use gpu_place::{GPU_PLACE_BYTES, GPU_RESULT_BYTES, GpuPlace};
pub use gpu_socket::{GPU_MAGIC, GpuAnswer, GpuAsk};
pub use header::{FrameError, FrameHeader};
pub use imu_gnss::{GnssSample, ImuSample};
pub use journal::{JournalAct, JournalEntry, JournalFile, JournalHead};
pub use lidar::{LidarPoint, LidarReturn, SemanticLidarPoint};
pub use modality::{Modality, SensorKind};
pub use physics::{
    AckermannControl, AckermannGains, GearPhysics, PhysicsAction, PhysicsAnswer, VehiclePhysics,
    VehicleTelemetry, WheelPhysics, WheelTelemetry,
};
pub use query::{DebugDraw, DebugKind, DebugShape, PosedBox, RayHit, RaySegment};
pub use radar::RadarDetection;
pub use result::{InputRecord, RESULT_ATTRIBUTE, ResultError, ResultHeader};
pub use result_body::Body;
pub use result_records::{
    Box2d, Box3d, Keypoint, KeypointSet, MaskRecord, Odometry, PathPoint, PoseEstimate,
    ResultRecord, Scalar, Track,
};
pub use result_type::{ElementType, PixelFormat, ResultType, Space};
pub use scene::{RenderedRecord, SceneFiring, SceneHeader, SceneInstance, SceneStroke};
pub use sealed::{Seal, SealError, SealedError};
pub use skeleton::{BoneReading, HeldBone, SkeletonAction};
pub use snapshot::{
    ActorKind, ActorRecord, LightState, SnapshotHeader, TrafficLightPart, TrafficSignPart,
    VehiclePart, WalkerPart,
};
pub use version::{SCHEMA_ATTRIBUTE, SCHEMA_VERSION};
