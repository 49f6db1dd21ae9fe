//! Converts results of users' programs into the messages that are recorded: always a lossless
//! `gantry.Result`, and beside it what other programs can show.
//!
//! `state` is what the converter remembers, `shot` one result on its way into the file;
//! `annotations` draws on images, `scene` in the world, `json` writes numbers.

mod annotations;
mod json;
mod scene;
mod shot;
mod state;

use std::collections::BTreeMap;
use std::sync::Arc;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use consumer_kit::items::ResultParts;
use foxglove::messages as fox;
use schema_frames::{BytesSchema, ResultType};

use super::frames::timestamp;
use schema_recording::messages::{Content, Entry, SchemaText};
use shot::{Body, Shot};
pub use state::ResultConverter;

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
