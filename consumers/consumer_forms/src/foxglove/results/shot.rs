//! One result on its way into the file: its lossless message, its pixels, its axes and colours.

use consumer_kit::items::ResultParts;
use foxglove::messages as fox;
use schema_bus::names;
use schema_frames::{Modality, PixelFormat, SensorKind, Space};
use schema_types::Pose;

use crate::foxglove::frames::{DATA_FIELD, TopicName, timestamp};
use crate::foxglove::snapshots::WORLD_FRAME;
use crate::palette;
use schema_recording::messages::{Content, Entry, encoded};
use schema_recording::wire::{put_bytes, put_fixed64};

/// Opacity of boxes and clouds of results.
pub(super) const OPACITY: f64 = 0.5;

/// Where the body of a result is kept.
pub(super) enum Body {
    /// In the lossless message.
    Here,
    /// In the topic's other message.
    Elsewhere,
}

/// One result on its way into the file.
pub(super) struct Shot<'a> {
    pub(super) parts: &'a ResultParts<'a>,
    pub(super) sim_nanos: u64,
    /// `/<topic>`.
    pub(super) channel: String,
    /// Topic of the frame that it answers.
    pub(super) frame: Option<String>,
}

impl Shot<'_> {
    pub(super) fn entry<M: foxglove::Encode>(&self, content: Content, message: &M) -> Entry {
        Entry::foxglove(self.channel.clone(), content, message)
    }

    pub(super) fn raw(&self, content: Content, bytes: Vec<u8>) -> Entry {
        Entry {
            topic: self.channel.clone(),
            content,
            bytes,
        }
    }

    /// Header, inputs and, unless it is in the topic's other message, the body.
    pub(super) fn lossless(
        &self,
        elsewhere: bool,
        reuse: &mut dyn FnMut(usize) -> Vec<u8>,
    ) -> Entry {
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
    pub(super) fn axes(&self) -> (String, Pose) {
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
    pub(super) fn image(&self, reuse: &mut dyn FnMut(usize) -> Vec<u8>) -> (Vec<Entry>, Body) {
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
    pub(super) fn optical_frame_id(&self) -> String {
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
    pub(super) fn colour(&self, class: u32, id: u32, by_id: bool, opacity: f64) -> fox::Color {
        let rgb = match by_id && id != 0 {
            true => palette::object(id),
            false => palette::class_of(self.parts.about, class),
        };
        let [r, g, b] = rgb.map(|channel| f64::from(channel) / 255.0);
        fox::Color {
            r,
            g,
            b,
            a: opacity,
        }
    }
}
