//! The 320 bytes in front of every result: what a user's program says about frames.

use bytemuck::{Pod, Zeroable};
use schema_types::Pose;

use crate::result_body::Body;
use crate::result_records::padded_text;
use crate::result_type::{ElementType, PixelFormat, ResultType, Space};
use crate::version::SCHEMA_VERSION;

/// "GRES" read as a little-endian `u32`.
pub const RESULT_MAGIC: u32 = u32::from_le_bytes(*b"GRES");

/// Attribute of a result topic's service with the name of its [`ResultType`].
pub const RESULT_ATTRIBUTE: &str = "gantry.result";

/// Most inputs that one result can name.
pub const MAX_INPUTS: usize = 8;

/// Most dimensions of a tensor.
pub const MAX_DIMENSIONS: usize = 8;

/// Most bytes of one point.
pub const MAX_POINT_BYTES: usize = 1024;

/// Bytes of the result header that a run repeats exactly; identities and clocks lie behind them.
pub const HASHED_RESULT_BYTES: usize = 216;

/// Header of one result: iceoryx2 user header `GantryResultHeader`, 320 bytes, aligned to 64,
/// little-endian.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ResultHeader {
    /// [`RESULT_MAGIC`].
    pub magic: u32,
    /// [`SCHEMA_VERSION`].
    pub schema_version: u16,
    /// 320.
    pub header_bytes: u16,
    /// [`ResultType`] number.
    pub result_type: u16,
    /// [`PixelFormat`] number of pixels, [`ElementType`] number of a tensor, otherwise 0.
    pub encoding: u16,
    /// Bit 0 [`ResultHeader::FIRST`], bit 1 [`ResultHeader::REPLAYED`].
    pub flags: u32,
    /// Tick that the result is about: of its newest input, if the writer says nothing else.
    pub tick: u64,
    /// Simulated time of that tick, nanoseconds since the daemon started.
    pub sim_nanos: u64,
    /// Number of the result, counted by its writer from 1; a gap is a loss.
    pub seq: u64,
    /// Episode of the newest input; 0 if not known.
    pub episode: u32,
    /// Number of [`InputRecord`]s behind the body, at most 8.
    pub n_inputs: u32,
    /// Payload bytes in use: the body, padding to a multiple of 8, the inputs.
    pub payload_bytes: u64,
    /// Bytes of the body, which begins the payload.
    pub body_bytes: u64,
    /// Pixels per row; of masks and key points the image's width.
    pub width: u32,
    /// Rows; of masks and key points the image's height.
    pub height: u32,
    /// Bytes from one row to the next.
    pub row_stride: u32,
    /// Bytes of one pixel, element, record or point; 1 of texts and bytes.
    pub element_bytes: u32,
    /// Records or points; elements of a tensor; bytes of a text.
    pub n_items: u32,
    /// Dimensions of a tensor, at most 8; otherwise 0.
    pub n_dims: u32,
    /// Sizes of a tensor's dimensions, slowest first.
    pub shape: [u32; 8],
    /// Pose of the result's space in the world: of the sensor for results in image or sensor space.
    pub world_from_space: Pose,
    /// `[fx, fy, cx, cy]` of the image that it answers, pixels; 0 where it has no meaning.
    pub intrinsics_px: [f64; 4],
    /// [`Space`] number.
    pub space: u32,
    /// Zero.
    pub reserved0: u32,
    /// Epoch of the simulator whose frames it answers; 0 without one. From here on nothing takes
    /// part in hashes.
    pub epoch: u64,
    /// Random number of the writer's start: another one than before means that it was restarted.
    pub writer_epoch: u64,
    /// `CLOCK_MONOTONIC` at which the oldest sensor frame behind this result was published, through
    /// all results between; 0 without one.
    pub origin_mono_nanos: u64,
    /// `CLOCK_MONOTONIC` at which the writer had its first input in hand; 0 without one.
    pub taken_mono_nanos: u64,
    /// `CLOCK_MONOTONIC` just before the result was sent.
    pub published_mono_nanos: u64,
    /// 0: the payload is in this sample. 1: the body is on the GPU, and the sample holds a
    /// [`crate::GpuPlace`] and the inputs.
    pub payload_place: u32,
    /// Zero.
    pub reserved1: [u8; 60],
}
const _: () = assert!(size_of::<ResultHeader>() == 320 && align_of::<ResultHeader>() == 64);
const _: () = assert!(std::mem::offset_of!(ResultHeader, epoch) == HASHED_RESULT_BYTES);

/// An input of a result: a frame or another result. 256 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct InputRecord {
    /// Its topic without the domain, UTF-8, padded with zeros.
    pub topic: [u8; 200],
    /// Its tick.
    pub tick: u64,
    /// Its number.
    pub seq: u64,
    /// Its simulated time, nanoseconds.
    pub sim_nanos: u64,
    /// Its epoch; of a result its `writer_epoch`.
    pub epoch: u64,
    /// `CLOCK_MONOTONIC` just before it was sent.
    pub published_mono_nanos: u64,
    /// `CLOCK_MONOTONIC` at which the writer of the result had it in hand.
    pub taken_mono_nanos: u64,
    /// Zero.
    pub reserved: u64,
}
const _: () = assert!(size_of::<InputRecord>() == 256);

impl InputRecord {
    /// A record for the input with this topic, of which the first 200 bytes count; the rest is 0.
    pub fn new(topic: &str) -> Self {
        let mut record: InputRecord = Zeroable::zeroed();
        let len = topic.len().min(record.topic.len());
        record.topic[..len].copy_from_slice(&topic.as_bytes()[..len]);
        record
    }

    /// The topic without the domain.
    pub fn topic(&self) -> String {
        padded_text(&self.topic)
    }
}

impl ResultHeader {
    /// Flag: first result since the writer's start.
    pub const FIRST: u32 = 1;
    /// Flag: published by a replay.
    pub const REPLAYED: u32 = 2;
    /// `payload_place` of a result whose payload is in its sample.
    pub const IN_SAMPLE: u32 = 0;
    /// `payload_place` of a result whose body is on the GPU.
    pub const ON_GPU: u32 = 1;

    /// A header with magic, version, type and usual space filled in and everything else zero.
    pub fn new(result_type: ResultType) -> Self {
        ResultHeader {
            magic: RESULT_MAGIC,
            schema_version: SCHEMA_VERSION,
            header_bytes: size_of::<ResultHeader>() as u16,
            result_type: result_type as u16,
            world_from_space: Pose::IDENTITY,
            space: result_type.usual_space() as u32,
            ..Zeroable::zeroed()
        }
    }

    /// Sets the shape of tightly packed pixels and the size of the body.
    pub fn set_image(&mut self, width_px: u32, height_px: u32, format: PixelFormat) {
        self.encoding = format as u16;
        self.element_bytes = format.element_bytes() as u32;
        (self.width, self.height) = (width_px, height_px);
        self.row_stride = width_px * self.element_bytes;
        self.body_bytes = self.row_stride as u64 * height_px as u64;
    }

    /// Sets the shape of a tensor and the size of the body.
    ///
    /// # Errors
    /// [`ResultError::Tensor`] for more than 8 dimensions or more than 2³² elements.
    pub fn set_tensor(&mut self, of: ElementType, shape: &[u32]) -> Result<(), ResultError> {
        let n_elements = product(shape).filter(|_| shape.len() <= MAX_DIMENSIONS);
        let n_elements = n_elements.ok_or_else(|| ResultError::Tensor {
            shape: shape.to_vec(),
            body: 0,
        })?;
        self.encoding = of as u16;
        self.element_bytes = of.element_bytes() as u32;
        self.n_items = n_elements;
        self.n_dims = shape.len() as u32;
        self.shape = [0; MAX_DIMENSIONS];
        self.shape[..shape.len()].copy_from_slice(shape);
        self.body_bytes = n_elements as u64 * self.element_bytes as u64;
        Ok(())
    }

    /// Sets a list of `n_items` records of `element_bytes` each, and behind them `tail_bytes` of
    /// runs or key points.
    pub fn set_list(&mut self, n_items: u32, element_bytes: u32, tail_bytes: u64) {
        (self.n_items, self.element_bytes) = (n_items, element_bytes);
        self.body_bytes = n_items as u64 * element_bytes as u64 + tail_bytes;
    }

    /// The type; `None` for a number this version does not know.
    pub fn kind(&self) -> Option<ResultType> {
        ResultType::from_code(self.result_type)
    }

    /// The pixel format; `None` if the result has no pixels.
    pub fn pixel_format(&self) -> Option<PixelFormat> {
        let pixels = self.kind()?.body() == Body::Pixels;
        PixelFormat::from_code(self.encoding).filter(|_| pixels)
    }

    /// The type of a tensor's elements; `None` if the result is none.
    pub fn element_type(&self) -> Option<ElementType> {
        let tensor = self.kind()? == ResultType::Tensor;
        ElementType::from_code(self.encoding).filter(|_| tensor)
    }

    /// The space; `None` for a number this version does not know.
    pub fn space(&self) -> Option<Space> {
        u16::try_from(self.space).ok().and_then(Space::from_code)
    }

    /// Sizes of a tensor's dimensions, slowest first.
    pub fn shape(&self) -> &[u32] {
        &self.shape[..(self.n_dims as usize).min(MAX_DIMENSIONS)]
    }

    /// Where the inputs begin in the payload, bytes.
    pub fn inputs_offset(&self) -> u64 {
        self.body_bytes.saturating_add(7) & !7
    }

    /// Bytes of the payload with this body and `n_inputs`.
    pub fn payload_for(body_bytes: u64, n_inputs: usize) -> u64 {
        let padded = body_bytes.saturating_add(7) & !7;
        padded.saturating_add((n_inputs * size_of::<InputRecord>()) as u64)
    }

    /// Checks what a reader relies on before it touches the payload of `sample_bytes` bytes.
    ///
    /// # Errors
    /// [`ResultError`] names the first rule the header breaks. Any bit pattern is safe to pass.
    pub fn check(&self, sample_bytes: usize) -> Result<ResultType, ResultError> {
        let kind = self.check_kind(ResultHeader::IN_SAMPLE)?;
        if self.payload_bytes > sample_bytes as u64 {
            return Err(ResultError::Length {
                claimed: self.payload_bytes,
                sample: sample_bytes as u64,
            });
        }
        self.check_lengths(kind)?;
        Ok(kind)
    }

    /// The same for a result whose body is on the GPU; `GpuPlace::of_result` also checks its sample.
    ///
    /// # Errors
    /// As [`ResultHeader::check`].
    pub fn check_on_gpu(&self) -> Result<ResultType, ResultError> {
        let kind = self.check_kind(ResultHeader::ON_GPU)?;
        self.check_lengths(kind)?;
        Ok(kind)
    }

    fn check_kind(&self, place: u32) -> Result<ResultType, ResultError> {
        if self.magic != RESULT_MAGIC {
            return Err(ResultError::Magic { found: self.magic });
        }
        if self.schema_version != SCHEMA_VERSION
            || self.header_bytes as usize != size_of::<ResultHeader>()
        {
            return Err(ResultError::Version {
                found: self.schema_version,
            });
        }
        let kind = self.kind().ok_or(ResultError::Type {
            found: self.result_type,
        })?;
        if self.payload_place != place {
            return Err(ResultError::Place {
                found: self.payload_place,
                wanted: place,
            });
        }
        Ok(kind)
    }

    fn check_lengths(&self, kind: ResultType) -> Result<(), ResultError> {
        if self.n_inputs as usize > MAX_INPUTS
            || Self::payload_for(self.body_bytes, self.n_inputs as usize) != self.payload_bytes
        {
            return Err(ResultError::Inputs {
                n_inputs: self.n_inputs,
                body: self.body_bytes,
                payload: self.payload_bytes,
            });
        }
        if self.space().is_none() {
            return Err(ResultError::Space { found: self.space });
        }
        self.check_body(kind)
    }

    fn check_body(&self, kind: ResultType) -> Result<(), ResultError> {
        let items_bytes = self.n_items as u64 * self.element_bytes as u64;
        let fits = match kind.body() {
            Body::Pixels => return self.check_pixels(kind),
            Body::Tensor => {
                let elements = product(self.shape());
                self.n_dims as usize <= MAX_DIMENSIONS
                    && elements == Some(self.n_items)
                    && self.element_type().map(ElementType::element_bytes)
                        == Some(self.element_bytes as usize)
                    && items_bytes == self.body_bytes
            }
            Body::Records(bytes) => {
                self.element_bytes as usize == bytes && items_bytes == self.body_bytes
            }
            Body::RecordsAndTail(bytes, tail) => {
                self.element_bytes as usize == bytes
                    && items_bytes <= self.body_bytes
                    && (self.body_bytes - items_bytes).is_multiple_of(tail as u64)
            }
            Body::Points => {
                (1..=MAX_POINT_BYTES).contains(&(self.element_bytes as usize))
                    && items_bytes == self.body_bytes
            }
            Body::Bytes => self.element_bytes == 1 && items_bytes == self.body_bytes,
        };
        match fits {
            true => Ok(()),
            false if kind == ResultType::Tensor => Err(ResultError::Tensor {
                shape: self.shape().to_vec(),
                body: self.body_bytes,
            }),
            false => Err(ResultError::Items {
                kind: kind.name(),
                n_items: self.n_items,
                element_bytes: self.element_bytes,
                body: self.body_bytes,
            }),
        }
    }

    fn check_pixels(&self, kind: ResultType) -> Result<(), ResultError> {
        let format = self.pixel_format();
        let allowed = match kind.pixel_format() {
            Some(only) => format == Some(only),
            None => format.is_some(),
        };
        if !allowed {
            return Err(ResultError::Pixels {
                kind: kind.name(),
                found: self.encoding,
            });
        }
        let row_bytes = self.width as u64 * self.element_bytes as u64;
        let last_row = (self.height as u64)
            .saturating_sub(1)
            .saturating_mul(self.row_stride as u64);
        let shape_bytes = match self.height {
            0 => 0,
            _ => last_row.saturating_add(row_bytes),
        };
        if format.map(PixelFormat::element_bytes) != Some(self.element_bytes as usize)
            || (self.height > 1 && (self.row_stride as u64) < row_bytes)
            || shape_bytes > self.body_bytes
        {
            return Err(ResultError::Shape {
                width: self.width,
                height: self.height,
                row_stride: self.row_stride,
                element_bytes: self.element_bytes,
                body: self.body_bytes,
            });
        }
        Ok(())
    }
}

/// The product of all sizes; 1 of none; `None` beyond 2³² − 1.
fn product(shape: &[u32]) -> Option<u32> {
    shape.iter().try_fold(1u32, |n, size| n.checked_mul(*size))
}

/// Why a result cannot be read, or a header cannot be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ResultError {
    /// Not a result.
    #[error(
        "result starts with {found:#010x}, not with the magic \"GRES\"; its writer is not one of Gantry's libraries"
    )]
    Magic {
        /// The value found.
        found: u32,
    },
    /// Another version of this contract.
    #[error(
        "result carries schema {found}, this reader understands {SCHEMA_VERSION}; rebuild the reader or the writer"
    )]
    Version {
        /// The result's version.
        found: u16,
    },
    /// A type this version does not know.
    #[error("result has type {found}, known are 1 to 20; rebuild the reader")]
    Type {
        /// The result's type.
        found: u16,
    },
    /// Another type than the topic declares.
    #[error("result is of type {found}, but its topic declares {declared}; the writer is broken")]
    OtherType {
        /// The result's type.
        found: &'static str,
        /// The topic's.
        declared: &'static str,
    },
    /// A space this version does not know.
    #[error("result has space {found}, known are 0 to 4; the writer is broken")]
    Space {
        /// The result's space.
        found: u32,
    },
    /// The body lies elsewhere than where this reader reads.
    #[error(
        "result says that its body is in place {found} (0 in the sample, 1 on the GPU), this reader reads place {wanted}; the writer is broken, or newer than the reader"
    )]
    Place {
        /// The result's place.
        found: u32,
        /// The reader's place.
        wanted: u32,
    },
    /// A place on the GPU that contradicts itself or the header.
    #[error("result's place on the GPU is not usable: {rule}; the writer is broken")]
    GpuPlace {
        /// The broken rule.
        rule: &'static str,
    },
    /// More payload claimed than the sample holds.
    #[error(
        "result claims {claimed} payload bytes, its sample holds {sample}; the writer is broken"
    )]
    Length {
        /// Claimed bytes.
        claimed: u64,
        /// Bytes of the sample.
        sample: u64,
    },
    /// Body, inputs and payload contradict one another.
    #[error(
        "result of {body} bytes with {n_inputs} inputs does not fill its {payload} payload bytes (at most 8 inputs of 256 bytes each); the writer is broken"
    )]
    Inputs {
        /// Number of inputs.
        n_inputs: u32,
        /// Body bytes.
        body: u64,
        /// Payload bytes.
        payload: u64,
    },
    /// Pixels that the type does not allow.
    #[error("{kind} has pixels of format {found}, which it cannot have; the writer is broken")]
    Pixels {
        /// Type of the result.
        kind: &'static str,
        /// Number of the format.
        found: u16,
    },
    /// Shape and body contradict one another.
    #[error(
        "result of {width} × {height} pixels of {element_bytes} bytes, {row_stride} bytes a row, does not fit its {body} bytes"
    )]
    Shape {
        /// Pixels per row.
        width: u32,
        /// Rows.
        height: u32,
        /// Bytes per row.
        row_stride: u32,
        /// Bytes per pixel.
        element_bytes: u32,
        /// Body bytes.
        body: u64,
    },
    /// A tensor's shape and body contradict one another.
    #[error(
        "tensor of shape {shape:?} does not fill its {body} bytes; it may have 8 dimensions and 4294967295 elements"
    )]
    Tensor {
        /// Sizes of the dimensions.
        shape: Vec<u32>,
        /// Body bytes.
        body: u64,
    },
    /// Records and body contradict one another.
    #[error("{kind} of {n_items} items of {element_bytes} bytes does not fill its {body} bytes")]
    Items {
        /// Type of the result.
        kind: &'static str,
        /// Number of items.
        n_items: u32,
        /// Bytes of each.
        element_bytes: u32,
        /// Body bytes.
        body: u64,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    fn boxes(n: u32) -> ResultHeader {
        let mut header = ResultHeader::new(ResultType::Boxes2d);
        header.set_list(n, 32, 0);
        header.payload_bytes = ResultHeader::payload_for(header.body_bytes, 0);
        header
    }

    #[test]
    fn a_list_passes_its_own_check_and_a_longer_claim_does_not() {
        let mut header = boxes(3);
        assert_eq!(header.check(96), Ok(ResultType::Boxes2d));
        assert_eq!(
            header.check(95),
            Err(ResultError::Length {
                claimed: 96,
                sample: 95
            })
        );
        header.n_items = 4;
        assert!(matches!(header.check(96), Err(ResultError::Items { .. })));
        header.n_items = u32::MAX;
        assert!(matches!(header.check(96), Err(ResultError::Items { .. })));
    }

    #[test]
    fn inputs_count_into_the_payload() {
        let mut header = boxes(1);
        header.n_inputs = 2;
        assert!(matches!(
            header.check(4096),
            Err(ResultError::Inputs { .. })
        ));
        header.payload_bytes = 32 + 2 * 256;
        assert_eq!(header.check(544), Ok(ResultType::Boxes2d));
        header.n_inputs = 9;
        header.payload_bytes = 32 + 9 * 256;
        assert!(matches!(
            header.check(4096),
            Err(ResultError::Inputs { .. })
        ));
    }

    #[test]
    fn a_tensor_has_at_most_eight_dimensions_and_counts_its_elements() {
        let mut header = ResultHeader::new(ResultType::Tensor);
        assert!(header.set_tensor(ElementType::F32, &[1; 9]).is_err());
        assert!(
            header
                .set_tensor(ElementType::F32, &[1 << 16, 1 << 16])
                .is_err()
        );
        header.set_tensor(ElementType::F16, &[2, 3, 4]).unwrap();
        header.payload_bytes = 48;
        assert_eq!(header.check(48), Ok(ResultType::Tensor));
        header.shape[1] = 4;
        assert!(matches!(header.check(64), Err(ResultError::Tensor { .. })));
        // No dimensions: one number.
        header.set_tensor(ElementType::F64, &[]).unwrap();
        header.payload_bytes = 8;
        assert_eq!(header.check(8), Ok(ResultType::Tensor));
    }

    #[test]
    fn depth_has_the_pixels_of_depth_only() {
        let mut header = ResultHeader::new(ResultType::Depth);
        header.set_image(4, 2, PixelFormat::Mono8);
        header.payload_bytes = header.body_bytes;
        assert!(matches!(header.check(64), Err(ResultError::Pixels { .. })));
        header.set_image(4, 2, PixelFormat::Depth);
        header.payload_bytes = header.body_bytes;
        assert_eq!(header.check(64), Ok(ResultType::Depth));
    }

    #[test]
    fn random_bytes_never_panic_and_are_refused() {
        let mut rng = fastrand::Rng::with_seed(1);
        for _ in 0..50_000 {
            let mut bytes = [0u8; 320];
            bytes.iter_mut().for_each(|b| *b = rng.u8(..));
            let mut header: ResultHeader = bytemuck::pod_read_unaligned(&bytes);
            assert!(header.check(1 << 20).is_err());
            header.magic = RESULT_MAGIC;
            header.schema_version = SCHEMA_VERSION;
            header.header_bytes = 320;
            header.result_type = rng.u16(0..24);
            header.space = rng.u32(0..6);
            header.n_inputs = rng.u32(0..10);
            if rng.bool() {
                header.payload_bytes =
                    ResultHeader::payload_for(header.body_bytes, header.n_inputs as usize);
            }
            let _ = header.check(rng.usize(0..1 << 30));
            let _ = (header.shape().len(), header.inputs_offset());
        }
    }

    #[test]
    fn a_topic_longer_than_its_place_is_cut() {
        assert_eq!(InputRecord::new("ego/front/rgb").topic(), "ego/front/rgb");
        assert_eq!(InputRecord::new(&"a".repeat(300)).topic().len(), 200);
    }
}
