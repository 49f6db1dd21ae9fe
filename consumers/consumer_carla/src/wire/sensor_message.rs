//! Messages of sensors: a header that all have, and a body. Colour images are sent as they lie in
//! shared memory; every other body is written into a buffer that is kept from message to message.

pub mod image;
pub mod points;
pub mod records;

use schema_bus::Frame;
use schema_frames::{FrameHeader, Modality};

use crate::wire::axes;
use crate::wire::sensor_kinds::{self, Kind};

/// What a message depends on besides its frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Context {
    /// Simulated time at which the episode began.
    pub episode_start_nanos: u64,
    /// Latitude and longitude of the map's origin, degrees.
    pub geo_reference_deg: [f64; 2],
    /// Gravity that IMUs measure, m/s².
    pub imu_gravity_mps2: f64,
}

/// Writes the messages of one sensor and reuses its buffers.
#[derive(Debug)]
pub struct Encoder {
    kind: &'static Kind,
    /// Horizontal field of view of a lidar.
    fov_rad: f32,
    head: Vec<u8>,
    body: Vec<u8>,
}

/// A message in two pieces, so that a body in shared memory is sent without a copy.
#[derive(Debug, PartialEq, Eq)]
pub struct Message<'m> {
    /// The headers.
    pub head: &'m [u8],
    /// The body.
    pub body: &'m [u8],
}

impl Encoder {
    /// For sensors of `kind`; `fov_rad` is a lidar's horizontal field of view.
    pub fn new(kind: &'static Kind, fov_rad: f32) -> Self {
        Encoder {
            kind,
            fov_rad,
            head: Vec::new(),
            body: Vec::new(),
        }
    }

    /// The message of one event, whose body was written before.
    pub fn event<'m>(
        &'m mut self,
        header: &FrameHeader,
        body: &'m [u8],
        context: &Context,
    ) -> Message<'m> {
        self.head.clear();
        push_header(&mut self.head, self.kind.number, header, context);
        Message {
            head: &self.head,
            body,
        }
    }

    /// The message of the frames of one tick, in the order of the kind's modalities. `None` where
    /// CARLA sends nothing.
    pub fn encode<'m>(&'m mut self, frames: &'m [Frame], context: &Context) -> Option<Message<'m>> {
        let frame = frames.first()?;
        let header = frame.header();
        self.head.clear();
        self.body.clear();
        push_header(&mut self.head, self.kind.number, header, context);
        if frame.modality().is_image() || frame.modality() == Modality::Dvs {
            image::push_header(&mut self.head, header, self.kind.number);
        }
        let (head, body) = (&mut self.head, &mut self.body);
        match frame.modality() {
            Modality::Rgb if header.row_stride == header.width * header.element_bytes => {
                return Some(Message {
                    head,
                    body: &frame[..],
                });
            }
            Modality::Rgb => image::rgb(body, frame),
            Modality::Depth => image::depth(body, frame),
            Modality::Semantic if self.kind.number == sensor_kinds::COSMOS => {
                image::palette(body, frame)
            }
            Modality::Semantic => image::semantic(body, frame),
            Modality::Instance => image::instance(body, frame, frames.get(1)?),
            Modality::Normals => image::normals(body, frame),
            Modality::Flow => image::flow(body, frame),
            Modality::Dvs => {
                let window_start_nanos = header
                    .sim_nanos
                    .saturating_sub(header.window_nanos + context.episode_start_nanos);
                points::dvs(body, frame.elements()?, window_start_nanos);
                if body.is_empty() {
                    return None;
                }
            }
            Modality::Lidar => points::lidar(head, body, header, self.fov_rad, frame.elements()?),
            Modality::SemanticLidar => {
                points::semantic_lidar(head, body, header, self.fov_rad, frame.elements()?)
            }
            Modality::Radar => points::radar(body, frame.elements()?),
            Modality::Imu => records::imu(
                body,
                frame.elements()?.first()?,
                header,
                context.imu_gravity_mps2,
            ),
            Modality::Gnss => records::gnss(
                body,
                frame.elements()?.first()?,
                header,
                context.geo_reference_deg,
            ),
            _ => return None,
        }
        Some(Message { head, body })
    }
}

/// The 48 bytes in front of every message.
pub fn push_header(out: &mut Vec<u8>, number: u64, header: &FrameHeader, context: &Context) {
    let nanos = header.sim_nanos.saturating_sub(context.episode_start_nanos);
    push_prefix(
        out,
        number,
        header.tick,
        nanos,
        &axes::transform(&header.world_from_sensor),
    );
}

/// The same for a message that is not made of a frame; `nanos` counts from the begin of the
/// episode.
pub fn push_prefix(
    out: &mut Vec<u8>,
    number: u64,
    tick: u64,
    nanos: u64,
    transform: &axes::Transform,
) {
    out.extend(number.to_le_bytes());
    out.extend(tick.to_le_bytes());
    out.extend((nanos as f64 * 1e-9).to_le_bytes());
    for x in transform
        .location_m
        .into_iter()
        .chain(transform.rotation_deg)
    {
        out.extend((x as f32).to_le_bytes());
    }
}
