//! What a channel of a recording can carry: Foxglove's messages, our own lossless ones and those of
//! users, with their schemas.
//!
//! `docs/how-to/recording.md` describes the same for readers of files.

use foxglove::Encode;
use foxglove::messages as fox;

use crate::wire::{FieldType, descriptor_set};

/// Message type of a channel.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Content {
    /// `foxglove.RawImage`.
    RawImage,
    /// `foxglove.CompressedImage`.
    CompressedImage,
    /// `foxglove.CompressedVideo`.
    CompressedVideo,
    /// `foxglove.PointCloud`.
    PointCloud,
    /// `foxglove.LocationFix`.
    LocationFix,
    /// `foxglove.Odometry`.
    Odometry,
    /// `foxglove.FrameTransforms`.
    FrameTransforms,
    /// `foxglove.SceneUpdate`.
    SceneUpdate,
    /// `foxglove.CameraCalibration`.
    CameraCalibration,
    /// `gantry.Frame`: the 256 header bytes, and the payload unless the topic's Foxglove message
    /// holds it; with a codec the payload is what [`crate::codec::decode`] makes of these bytes.
    Frame,
    /// `gantry.Imu`.
    Imu,
    /// `gantry.Snapshot`: header bytes and actor records.
    Snapshot,
    /// `gantry.Document`: header bytes and text.
    Document,
    /// `gantry.Result`: the 320 header bytes, the inputs, and the body unless the topic's other
    /// message holds it.
    Result,
    /// `foxglove.ImageAnnotations`.
    ImageAnnotations,
    /// `foxglove.PosesInFrame`.
    PosesInFrame,
    /// `foxglove.Log`.
    Log,
    /// `gantry.Tensor`, JSON: shape, figures and, of small ones, the numbers.
    Tensor,
    /// `gantry.Scalars`, JSON: a number per name.
    Scalars,
    /// `gantry.Control`, JSON: pedals and steering per vehicle.
    Control,
    /// `gantry.Journal`, JSON: [`crate::journal::Piece`].
    Journal,
    /// `gantry.Json`: a user's JSON as it came.
    Json,
    /// A user's bytes as they came, by a schema of the user's own.
    Own(std::sync::Arc<SchemaText>),
}

/// A schema and the encoding of its messages as MCAP wants them.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SchemaText {
    /// Full name of the message, e.g. `foxglove.RawImage`.
    pub name: String,
    /// Encoding of `data`, e.g. [`PROTOBUF`].
    pub encoding: String,
    /// The schema; of protobuf a serialised `FileDescriptorSet`.
    pub data: Vec<u8>,
    /// Encoding of the messages, e.g. [`PROTOBUF`].
    pub message_encoding: String,
}

/// Encoding of the schemas and messages of a recording that are neither JSON nor a user's own.
pub const PROTOBUF: &str = "protobuf";

impl Content {
    /// The schema.
    pub fn schema(&self) -> SchemaText {
        use FieldType::{Bytes, Double, Fixed64, String};
        match self {
            Content::RawImage => foxglove_schema::<fox::RawImage>(),
            Content::CompressedImage => foxglove_schema::<fox::CompressedImage>(),
            Content::CompressedVideo => foxglove_schema::<fox::CompressedVideo>(),
            Content::PointCloud => foxglove_schema::<fox::PointCloud>(),
            Content::LocationFix => foxglove_schema::<fox::LocationFix>(),
            Content::Odometry => foxglove_schema::<fox::Odometry>(),
            Content::FrameTransforms => foxglove_schema::<fox::FrameTransforms>(),
            Content::SceneUpdate => foxglove_schema::<fox::SceneUpdate>(),
            Content::CameraCalibration => foxglove_schema::<fox::CameraCalibration>(),
            Content::Frame => own_schema(
                "Frame",
                &[
                    ("tick", Fixed64),
                    ("sim_nanos", Fixed64),
                    ("seq", Fixed64),
                    ("header", Bytes),
                    ("payload", Bytes),
                    ("payload_topic", String),
                    ("codec", String),
                ],
            ),
            Content::Imu => own_schema(
                "Imu",
                &[
                    ("sim_nanos", Fixed64),
                    ("frame_id", String),
                    ("specific_force_x_mps2", Double),
                    ("specific_force_y_mps2", Double),
                    ("specific_force_z_mps2", Double),
                    ("angular_velocity_x_radps", Double),
                    ("angular_velocity_y_radps", Double),
                    ("angular_velocity_z_radps", Double),
                    ("compass_rad", Double),
                ],
            ),
            Content::Snapshot => own_schema(
                "Snapshot",
                &[
                    ("tick", Fixed64),
                    ("sim_nanos", Fixed64),
                    ("header", Bytes),
                    ("records", Bytes),
                ],
            ),
            Content::Document => own_schema(
                "Document",
                &[
                    ("revision", Fixed64),
                    ("tick", Fixed64),
                    ("header", Bytes),
                    ("text", String),
                ],
            ),
            Content::Result => own_schema(
                "Result",
                &[
                    ("tick", Fixed64),
                    ("sim_nanos", Fixed64),
                    ("seq", Fixed64),
                    ("header", Bytes),
                    ("body", Bytes),
                    ("body_topic", String),
                    ("inputs", Bytes),
                ],
            ),
            Content::ImageAnnotations => foxglove_schema::<fox::ImageAnnotations>(),
            Content::PosesInFrame => foxglove_schema::<fox::PosesInFrame>(),
            Content::Log => foxglove_schema::<fox::Log>(),
            Content::Tensor => json_schema("Tensor", TENSOR),
            Content::Scalars => json_schema("Scalars", SCALARS),
            Content::Control => json_schema("Control", CONTROL),
            Content::Journal => json_schema("Journal", crate::journal::SCHEMA),
            Content::Json => json_schema("Json", "{}"),
            Content::Own(schema) => (**schema).clone(),
        }
    }
}

fn foxglove_schema<M: Encode>() -> SchemaText {
    let schema = M::get_schema().expect("every message type of the foxglove crate has a schema");
    SchemaText {
        name: schema.name,
        encoding: PROTOBUF.to_string(),
        data: schema.data.into_owned(),
        message_encoding: PROTOBUF.to_string(),
    }
}

fn own_schema(name: &str, fields: &[crate::wire::Field]) -> SchemaText {
    SchemaText {
        name: format!("gantry.{name}"),
        encoding: PROTOBUF.to_string(),
        data: descriptor_set(name, fields),
        message_encoding: PROTOBUF.to_string(),
    }
}

fn json_schema(name: &str, schema: &str) -> SchemaText {
    SchemaText {
        name: format!("gantry.{name}"),
        encoding: "jsonschema".to_string(),
        data: schema.as_bytes().to_vec(),
        message_encoding: "json".to_string(),
    }
}

const TENSOR: &str = r#"{"type":"object","properties":{
"dtype":{"type":"string"},"shape":{"type":"array","items":{"type":"integer"}},
"n":{"type":"integer"},"n_finite":{"type":"integer"},
"min":{"type":"number"},"max":{"type":"number"},"mean":{"type":"number"},
"histogram":{"type":"array","items":{"type":"integer"}},
"numbers":{"type":"array","items":{"type":["number","null"]}}}}"#;

const SCALARS: &str = r#"{"type":"object","properties":{
"sim_secs":{"type":"number"},
"values":{"type":"object","additionalProperties":{"type":["number","null"]}}}}"#;

const CONTROL: &str = r#"{"type":"object","properties":{
"sim_secs":{"type":"number"},
"vehicles":{"type":"array","items":{"type":"object","properties":{
"actor_id":{"type":"integer"},"throttle_ratio":{"type":"number"},"steer_ratio":{"type":"number"},
"brake_ratio":{"type":"number"},"hand_brake":{"type":"boolean"},"reverse":{"type":"boolean"},
"manual_gear_shift":{"type":"boolean"},"gear":{"type":"integer"}}}}}}"#;

/// One message, encoded.
#[derive(Debug)]
pub struct Entry {
    /// Channel's topic, e.g. `/ego/front/rgb`.
    pub topic: String,
    /// Its message type.
    pub content: Content,
    /// The encoded message.
    pub bytes: Vec<u8>,
}

impl Entry {
    /// Encodes a Foxglove message.
    pub fn foxglove<M: Encode>(topic: String, content: Content, message: &M) -> Entry {
        Entry {
            topic,
            content,
            bytes: encoded(message, Vec::new()),
        }
    }
}

/// Appends `message` to `bytes`.
pub fn encoded<M: Encode>(message: &M, mut bytes: Vec<u8>) -> Vec<u8> {
    message
        .encode(&mut bytes)
        .expect("a Vec grows, so encoding into it cannot run out of room");
    bytes
}

/// All messages of one frame, snapshot or document; they are kept or dropped together.
#[derive(Debug)]
pub struct Batch {
    /// Where it came from, for counting: `ego/front/rgb`, `world/snapshot`.
    pub source: std::sync::Arc<str>,
    /// Sequence number of every message in it.
    pub sequence: u32,
    /// Simulated time, nanoseconds since the daemon started.
    pub log_nanos: u64,
    /// Publisher's clock, nanoseconds since 1970.
    pub publish_nanos: u64,
    /// The messages.
    pub entries: Vec<Entry>,
}

impl Batch {
    /// Bytes that it occupies in the queue.
    pub fn queued_bytes(&self) -> usize {
        self.entries
            .iter()
            .map(|entry| entry.bytes.len())
            .fold(64, usize::saturating_add)
    }
}
