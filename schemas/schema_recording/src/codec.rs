//! Lossless coding of payloads: a recorder stores fewer bytes, a reader gets back exactly those that
//! were on the bus.
//!
//! A coded payload is a name and bytes. The name says how the bytes are decoded:
//!
//! | name | decoded bytes | of |
//! |---|---|---|
//! | [`PNG`] | a PNG file: BGRA pixels without or with alpha, or one index a pixel | rgb, semantic |
//! | [`ZSTD`] | as they are | everything else |
//! | [`PLANES16`], [`PLANES32`] | words of an image, each less what its neighbours let expect | depth, normals |
//! | [`FLOW`] | as `planes32`, of the place that a pixel came from | flow |
//! | [`RECORDS`] | words of a list, each less the line through the two before | lidar |
//! | [`EVENTS`] | events pixel by pixel | dvs |
//!
//! All but PNG begin with the CRC-32 of what follows, which is one zstd frame. `docs/how-to/recording.md`
//! gives the layouts, and decoders in Python.
//!
//! Modules: `planes` (images of words), `records` (lists), `events` (event camera), `picture` (PNG)
//! and `deflate` below it,
//! `bytes` and `error` (what they share).

mod bytes;
mod deflate;
mod error;
mod events;
mod picture;
mod planes;
mod records;

pub use error::CodecError;
use schema_frames::{FrameHeader, Modality};
use zstd::zstd_safe::CParameter;

/// The payload, compressed by zstd.
pub const ZSTD: &str = "zstd";
/// A PNG file that holds every byte of the payload.
pub const PNG: &str = "png";
/// Images of 16-bit words, by planes.
pub const PLANES16: &str = "planes16";
/// Images of 32-bit words, by planes.
pub const PLANES32: &str = "planes32";
/// Optical flow as the places that pixels came from, by planes.
pub const FLOW: &str = "flow";
/// Lists of elements of 32-bit words, by planes.
pub const RECORDS: &str = "records32";
/// Events of an event camera, pixel by pixel.
pub const EVENTS: &str = "events";
/// Every codec that [`decode`] knows.
pub const CODECS: [&str; 7] = [ZSTD, PNG, PLANES16, PLANES32, FLOW, RECORDS, EVENTS];

/// Largest payload that is decoded; a header may claim any size.
pub const MAX_PAYLOAD_BYTES: u64 = 1 << 30;

/// Level of zstd. Filters leave little that a higher one would find.
const LEVEL: i32 = 1;
/// What else zstd is told: of filtered planes either long runs come again or nothing does, so a table
/// that stays in the fastest cache, and only long matches, find the same in seven eighths of the time.
const PARAMETERS: [CParameter; 2] = [CParameter::HashLog(12), CParameter::MinMatch(7)];

/// Encodes payloads one after another; keeps its memory for the next.
pub struct Encoder {
    zstd: zstd::bulk::Compressor<'static>,
    /// What the filters leave.
    filtered: Vec<u8>,
    /// Checksum and zstd frame, or PNG file.
    coded: Vec<u8>,
    planes: planes::Rows,
    events: events::Sorter,
    pictures: picture::Rows,
}

impl std::fmt::Debug for Encoder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Encoder").finish_non_exhaustive()
    }
}

impl Encoder {
    /// An encoder at the level that recordings use.
    ///
    /// # Errors
    /// If zstd refuses to make one.
    pub fn new() -> std::io::Result<Encoder> {
        let mut encoder = Encoder::with_level(LEVEL)?;
        for parameter in PARAMETERS {
            encoder.zstd.set_parameter(parameter)?;
        }
        Ok(encoder)
    }

    /// An encoder at another level of zstd.
    ///
    /// # Errors
    /// If zstd does not know the level.
    pub fn with_level(level: i32) -> std::io::Result<Encoder> {
        Ok(Encoder {
            zstd: zstd::bulk::Compressor::new(level)?,
            filtered: Vec::new(),
            coded: Vec::new(),
            planes: planes::Rows::default(),
            events: events::Sorter::default(),
            pictures: picture::Rows::default(),
        })
    }

    /// Encodes a payload; `None` if its bytes are best left as they are. `header` must have passed
    /// [`FrameHeader::check`].
    pub fn encode(
        &mut self,
        header: &FrameHeader,
        payload: &[u8],
    ) -> Option<(&'static str, &[u8])> {
        if payload.len() < MIN_BYTES || payload.len() as u64 > MAX_PAYLOAD_BYTES {
            return None;
        }
        let modality = header.modality()?;
        if matches!(modality, Modality::Rgb | Modality::Semantic)
            && picture::encode(
                header,
                modality,
                payload,
                &mut self.pictures,
                &mut self.coded,
            )
        {
            // Even if noise makes it larger: other programs see every image of a topic as a file.
            return Some((PNG, self.coded.as_slice()));
        }
        let out = &mut self.filtered;
        let codec = match modality {
            Modality::Flow if self.planes.flow(header, payload, out) => FLOW,
            Modality::Flow | Modality::Depth if self.planes.words32(header, payload, out) => {
                PLANES32
            }
            Modality::Normals if self.planes.words16(header, payload, out) => PLANES16,
            Modality::Dvs if self.events.encode(payload, out) => EVENTS,
            Modality::Dvs | Modality::Lidar | Modality::SemanticLidar | Modality::LidarReturns
                if records::encode(header, payload, out) =>
            {
                RECORDS
            }
            _ => ZSTD,
        };
        let source = if codec == ZSTD { payload } else { out };
        bytes::pack(&mut self.zstd, source, &mut self.coded).ok()?;
        self.smaller(codec, payload)
    }

    fn smaller(&self, codec: &'static str, payload: &[u8]) -> Option<(&'static str, &[u8])> {
        (self.coded.len() < payload.len()).then_some((codec, self.coded.as_slice()))
    }
}

/// Payloads below this size stay as they are.
const MIN_BYTES: usize = 256;

/// Decodes `bytes` into `out`, which is as long as the payload was (`header.payload_bytes`). An
/// empty codec copies.
///
/// # Errors
/// A sentence if the codec is not known, or the bytes are no payload of that length. Any bytes and
/// any header are safe to pass; memory stays within a few times `out.len()`.
pub fn decode(
    codec: &str,
    header: &FrameHeader,
    bytes: &[u8],
    out: &mut [u8],
) -> Result<(), CodecError> {
    match codec {
        "" if bytes.len() == out.len() => {
            out.copy_from_slice(bytes);
            Ok(())
        }
        "" => Err(CodecError(format!(
            "the payload has {} bytes, its header says {}",
            bytes.len(),
            out.len()
        ))),
        PNG => picture::decode(header, bytes, out),
        ZSTD => bytes::unpack_into(bytes, out),
        PLANES16 => planes::decode16(header, bytes, out),
        PLANES32 => planes::decode32(header, bytes, out),
        FLOW => planes::decode_flow(header, bytes, out),
        RECORDS => records::decode(header, bytes, out),
        EVENTS => events::decode(bytes, out),
        "jpeg" | "h264" => Err(CodecError(
            "only a picture for people was kept of it (--jpeg or --video), not the frame"
                .to_owned(),
        )),
        other => Err(CodecError(format!(
            "the codec {other:?} is not known to this version, which knows {}",
            CODECS.join(", ")
        ))),
    }
}
