//! rerun's SDK under one name.
//!
//! The crate `rerun` has the same names, but also brings a client of its catalogue servers, a chunk
//! store, queries and telemetry, which a program that only logs never calls: fifty crates more to
//! build.

pub use re_sdk::{
    AsComponents, Component, ComponentBatch, ComponentDescriptor, EntityPath, RecordingStream,
    RecordingStreamBuilder, RecordingStreamError, RecordingStreamResult, SerializedComponentBatch,
    StoreId, StoreKind, TimePoint, Timeline, blueprint, build_info, external, log, sink, time,
};
pub use re_sdk_types::archetypes::*;
pub use re_sdk_types::components::{
    self, Color, FillMode, ImageFormat, LineStrip2D, LineStrip3D, MediaType, Position2D,
    Position3D, Radius, Text, TextLogLevel, Vector2D, Vector3D,
};
pub use re_sdk_types::datatypes::{
    self, Angle, AnnotationInfo, ChannelDatatype, ClassDescription, ColorModel, KeypointPair,
    Mat3x3, PixelFormat, Quaternion, Rgba32, RotationAxisAngle, TensorBuffer, TensorData, Vec2D,
    Vec3D,
};
pub use re_sdk_types::{self, AnyValues, DynamicArchetype};
