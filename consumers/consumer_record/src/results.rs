//! Converts results of users' programs into the messages that are recorded: always a lossless
//! `gantry.Result`, and beside it what other programs can show.
//!
//! `annotations` draws on images, `scene` in the world, `json` writes numbers.

mod annotations;
mod json;
mod scene;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use consumer_kit::items::{BadItems, Chains, ResultParts, legible};
use foxglove::messages as fox;
use schema_bus::names;
use schema_frames::{BytesSchema, Modality, PixelFormat, ResultType, SensorKind, Space};
use schema_types::{Pose, class::CLASSES, noise::mix};

use crate::frames::{DATA_FIELD, TopicName, timestamp};
use crate::messages::{Content, Entry, SchemaText, encoded};
use crate::snapshots::WORLD_FRAME;
use crate::wire::{put_bytes, put_fixed64};

/// Opacity of boxes and clouds of results.
const OPACITY: f64 = 0.5;

/// Converts results; remembers what they answer and what was said about them.
#[derive(Debug, Default)]
pub struct ResultConverter {
    chains: Chains,
    bad: BadItems,
    /// Topics of tracks that have been in space.
    in_space: BTreeSet<String>,
    /// Schemas of topics of bytes as they were decoded; `None` if one cannot be.
    schemas: BTreeMap<String, (BytesSchema, Option<Arc<SchemaText>>)>,
}

/// Where the body of a result is kept.
enum Body {
    /// In the lossless message.
    Here,
    /// In the topic's other message.
    Elsewhere,
}

impl ResultConverter {
    /// The messages of a result, filed under `sim_nanos`. `reuse` hands in buffers to write into.
    ///
    /// The header of `parts` must have passed its check.
    pub fn entries(
        &mut self,
        parts: &ResultParts<'_>,
        sim_nanos: u64,
        reuse: &mut dyn FnMut(usize) -> Vec<u8>,
    ) -> Vec<Entry> {
        let shot = Shot {
            parts,
            sim_nanos,
            channel: format!("/{}", parts.topic),
            frame: self.chains.frame_behind(parts).map(str::to_owned),
        };
        let (mut shown, body) = match parts.kind {
            ResultType::Boxes2d => (vec![self.boxes2d(&shot)], Body::Here),
            ResultType::Masks => (vec![self.masks(&shot)], Body::Here),
            ResultType::Keypoints => (vec![self.keypoints(&shot)], Body::Here),
            ResultType::Tracks => (self.tracks(&shot), Body::Here),
            ResultType::Boxes3d => (vec![self.boxes3d(&shot)], Body::Here),
            ResultType::Path => (vec![self.path(&shot)], Body::Here),
            ResultType::Pose => (vec![self.poses(&shot)], Body::Here),
            ResultType::Odometry => (self.odometry(&shot).into_iter().collect(), Body::Here),
            ResultType::Points => (
                self.points(&shot, reuse).into_iter().collect(),
                Body::Elsewhere,
            ),
            ResultType::Image
            | ResultType::Flow
            | ResultType::Depth
            | ResultType::Semantic
            | ResultType::Instance => shot.image(reuse),
            ResultType::Tensor => (vec![shot.tensor()], Body::Here),
            ResultType::Scalars => (vec![shot.scalars()], Body::Here),
            ResultType::Control => (vec![shot.controls()], Body::Here),
            ResultType::Text => (self.text(&shot).into_iter().collect(), Body::Here),
            ResultType::Json => (self.json(&shot).into_iter().collect(), Body::Elsewhere),
            ResultType::Bytes => (
                self.bytes(&shot, reuse).into_iter().collect(),
                Body::Elsewhere,
            ),
        };
        let elsewhere = matches!(body, Body::Elsewhere) && !shown.is_empty();
        let mut entries = vec![shot.lossless(elsewhere, reuse)];
        entries.append(&mut shown);
        entries
    }

    /// Items that other programs are not shown because they are broken, by topic. They are in the
    /// lossless messages.
    pub fn bad_items(&self) -> &BTreeMap<String, u64> {
        self.bad.by_topic()
    }

    fn text(&mut self, shot: &Shot<'_>) -> Option<Entry> {
        let Ok(message) = std::str::from_utf8(shot.parts.body) else {
            self.bad.note(shot.parts.topic, 1, "a text is not UTF-8");
            return None;
        };
        let log = fox::Log {
            timestamp: Some(timestamp(shot.sim_nanos)),
            level: fox::log::Level::Info as i32,
            message: message.to_string(),
            name: shot.parts.topic.to_string(),
            ..Default::default()
        };
        Some(shot.entry(Content::Log, &log))
    }

    fn json(&mut self, shot: &Shot<'_>) -> Option<Entry> {
        if serde_json::from_slice::<serde::de::IgnoredAny>(shot.parts.body).is_err() {
            self.bad.note(shot.parts.topic, 1, "a text is not JSON");
            return None;
        }
        Some(shot.raw(Content::Json, shot.parts.body.to_vec()))
    }

    /// A user's bytes as they are; `None` while their schema is not known.
    fn bytes(&mut self, shot: &Shot<'_>, reuse: &mut dyn FnMut(usize) -> Vec<u8>) -> Option<Entry> {
        let schema = shot.parts.about.schema.as_ref()?;
        let topic = shot.parts.topic;
        if self
            .schemas
            .get(topic)
            .is_none_or(|(known, _)| known != schema)
        {
            let text = decoded(schema).map(Arc::new);
            if text.is_none() {
                let why = "the schema in its description is not base64";
                self.bad.note(topic, 1, why);
            }
            let known = (schema.clone(), text);
            self.schemas.insert(topic.to_owned(), known);
        }
        let text = self.schemas.get(topic)?.1.clone()?;
        let mut bytes = reuse(shot.parts.body.len());
        bytes.extend_from_slice(shot.parts.body);
        Some(shot.raw(Content::Own(text), bytes))
    }
}

/// A user's schema as MCAP wants it; `None` if its base64 cannot be decoded.
fn decoded(schema: &BytesSchema) -> Option<SchemaText> {
    let data = match schema.base64.is_empty() {
        true => schema.text.clone().into_bytes(),
        false => BASE64.decode(&schema.base64).ok()?,
    };
    Some(SchemaText {
        name: schema.name.clone(),
        encoding: schema.schema_encoding.clone(),
        data,
        message_encoding: schema.message_encoding.clone(),
    })
}

/// One result on its way into the file.
struct Shot<'a> {
    parts: &'a ResultParts<'a>,
    sim_nanos: u64,
    /// `/<topic>`.
    channel: String,
    /// Topic of the frame that it answers.
    frame: Option<String>,
}

impl Shot<'_> {
    fn entry<M: foxglove::Encode>(&self, content: Content, message: &M) -> Entry {
        Entry::foxglove(self.channel.clone(), content, message)
    }

    fn raw(&self, content: Content, bytes: Vec<u8>) -> Entry {
        Entry {
            topic: self.channel.clone(),
            content,
            bytes,
        }
    }

    /// Header, inputs and, unless it is in the topic's other message, the body.
    fn lossless(&self, elsewhere: bool, reuse: &mut dyn FnMut(usize) -> Vec<u8>) -> Entry {
        let (header, body) = (self.parts.header, self.parts.body);
        let inputs: &[u8] = bytemuck::cast_slice(self.parts.inputs);
        let body_bytes = if elsewhere { 0 } else { body.len() };
        let mut bytes = reuse(body_bytes + inputs.len() + 512);
        put_fixed64(&mut bytes, 1, header.tick);
        put_fixed64(&mut bytes, 2, header.sim_nanos);
        put_fixed64(&mut bytes, 3, header.seq);
        put_bytes(&mut bytes, 4, bytemuck::bytes_of(header));
        match elsewhere {
            false => put_bytes(&mut bytes, 5, body),
            true => put_bytes(&mut bytes, 6, self.channel.as_bytes()),
        }
        put_bytes(&mut bytes, 7, inputs);
        Entry {
            topic: format!("{}/gantry", self.channel),
            content: Content::Result,
            bytes,
        }
    }

    /// Foxglove's axes for numbers of the result, and the pose of the result's space in them.
    fn axes(&self) -> (String, Pose) {
        let header = self.parts.header;
        match (header.space(), &self.frame) {
            (Some(Space::World), _) => (WORLD_FRAME.to_owned(), Pose::IDENTITY),
            (Some(Space::Vehicle), Some(frame)) => {
                (names::rig_of(frame).to_owned(), Pose::IDENTITY)
            }
            _ => (WORLD_FRAME.to_owned(), header.world_from_space),
        }
    }

    /// The message that shows pixels, and where the body is kept.
    fn image(&self, reuse: &mut dyn FnMut(usize) -> Vec<u8>) -> (Vec<Entry>, Body) {
        let (header, body) = (self.parts.header, self.parts.body);
        let (width, height) = (header.width, header.height);
        let encoding = match header.pixel_format() {
            Some(PixelFormat::Bgra8) => "bgra8",
            Some(PixelFormat::Bgr8) => "bgr8",
            Some(PixelFormat::Rgb8) => "rgb8",
            Some(PixelFormat::Rgba8) => "rgba8",
            Some(PixelFormat::Mono8 | PixelFormat::Class) => "mono8",
            Some(PixelFormat::Mono16 | PixelFormat::Id) => "mono16",
            Some(PixelFormat::Mono32f | PixelFormat::Depth) => "32FC1",
            Some(PixelFormat::Flow | PixelFormat::Normals) | None => {
                return (Vec::new(), Body::Here);
            }
        };
        if width == 0 || height == 0 {
            return (Vec::new(), Body::Here);
        }
        let row_bytes = width * header.element_bytes;
        let is_id = header.pixel_format() == Some(PixelFormat::Id);
        let step = match is_id {
            true => width * 2,
            false => header.row_stride.max(row_bytes),
        };
        let head = fox::RawImage {
            timestamp: Some(timestamp(self.sim_nanos)),
            frame_id: self.optical_frame_id(),
            width,
            height,
            encoding: encoding.to_string(),
            step,
            ..Default::default()
        };
        let mut bytes = encoded(&head, reuse(body.len() + 1024));
        if !is_id {
            put_bytes(&mut bytes, DATA_FIELD, body);
            return (vec![self.raw(Content::RawImage, bytes)], Body::Elsewhere);
        }
        // Ids for people: their low 16 bits.
        let rows = (0..height as usize).map(|row| &body[row * header.row_stride as usize..]);
        let low: Vec<u8> = rows
            .flat_map(|row| row[..row_bytes as usize].chunks_exact(4))
            .flat_map(|id| [id[0], id[1]])
            .collect();
        put_bytes(&mut bytes, DATA_FIELD, &low);
        (vec![self.raw(Content::RawImage, bytes)], Body::Here)
    }

    /// Axes of the image that it answers, or of its own.
    fn optical_frame_id(&self) -> String {
        let camera = self.frame.as_deref().and_then(|frame| {
            let (_, modality) = frame.rsplit_once('/')?;
            let kind = Modality::from_name(modality)?.sensor_kind();
            TopicName::new(frame).filter(|_| kind == SensorKind::Camera)
        });
        camera.map_or_else(
            || self.parts.topic.to_owned(),
            |name| name.optical_frame_id(),
        )
    }

    /// Colour of an object: of its number if it has one and `by_id`, else of its class.
    fn colour(&self, class: u32, id: u32, by_id: bool, opacity: f64) -> fox::Color {
        let [r, g, b] = if by_id && id != 0 {
            hue(id)
        } else if !self.parts.about.classes.is_empty() {
            hue(class.wrapping_add(1))
        } else {
            let known = CLASSES.get(class as usize);
            known.map_or_else(
                || hue(class),
                |info| legible(info.rgb).map(|c| c as f64 / 255.0),
            )
        };
        fox::Color {
            r,
            g,
            b,
            a: opacity,
        }
    }
}

/// A bright colour that differs between neighbouring numbers.
fn hue(number: u32) -> [f64; 3] {
    let turn = (mix(number as u64) & 0xffff) as f64 / 65_536.0 * 6.0;
    let channel = |shift: f64| {
        let k = (turn + shift) % 6.0;
        1.0 - 0.85 * k.min(4.0 - k).clamp(0.0, 1.0)
    };
    [channel(5.0), channel(3.0), channel(1.0)]
}
