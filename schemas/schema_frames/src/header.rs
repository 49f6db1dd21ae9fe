//! The 256 bytes in front of every sensor frame.

use bytemuck::{Pod, Zeroable};
use schema_types::{Distortion, Lens, Pose};

use crate::modality::{Modality, SensorKind};
use crate::version::SCHEMA_VERSION;

/// "GFRM" read as a little-endian `u32`.
pub const FRAME_MAGIC: u32 = u32::from_le_bytes(*b"GFRM");

/// Bytes of the header that take part in hashes; the epoch and the clocks lie behind them.
pub const HASHED_HEADER_BYTES: usize = 192;

/// Header of one sensor frame: iceoryx2 user header `GantryFrameHeader`, 256 bytes, aligned to 64,
/// little-endian.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct FrameHeader {
    /// [`FRAME_MAGIC`].
    pub magic: u32,
    /// [`SCHEMA_VERSION`].
    pub schema_version: u16,
    /// 256.
    pub header_bytes: u16,
    /// Actor id of the sensor.
    pub sensor_id: u32,
    /// [`SensorKind`] number.
    pub kind: u16,
    /// [`Modality`] number.
    pub encoding: u16,
    /// Tick this frame shows.
    pub tick: u64,
    /// Simulated time this frame shows, nanoseconds since the daemon started.
    pub sim_nanos: u64,
    /// Number of the sensor's firing, from 1. Scheduled firings count whether anybody reads or not
    /// (of event-like sensors: ticks with events), so a gap is a loss.
    pub seq: u64,
    /// Count of map loads in this epoch, from 1.
    pub episode: u32,
    /// Bit 0 [`FrameHeader::FIRST`], bit 1 [`FrameHeader::REPLAYED`], bit 2
    /// [`FrameHeader::SEALED`].
    pub flags: u32,
    /// Payload bytes in use; the sample may be longer.
    pub payload_bytes: u64,
    /// Pixels per row, or elements of a list.
    pub width: u32,
    /// Rows, of a batch those of all its images; 1 for a list.
    pub height: u32,
    /// Bytes from one row to the next.
    pub row_stride: u32,
    /// Bytes of one pixel or list element.
    pub element_bytes: u32,
    /// Time this frame covers, ending at `sim_nanos`: of flow, DVS, lidar sweeps and events.
    pub window_nanos: u64,
    /// Pose of the sensor in the world (`sensor` axes: x forward, y left, z up).
    pub world_from_sensor: Pose,
    /// Focal length and principal point `[fx, fy, cx, cy]` of a pinhole, pixels; 0 where it has no
    /// meaning, as through a lens that `optics` names.
    pub intrinsics_px: [f64; 4],
    /// Farthest distance the sensor reports, metres; 0 if unbounded.
    pub range_limit_m: f32,
    /// Azimuth of a lidar's head at the end of the frame, radians, counter-clockwise from x.
    pub azimuth_rad: f32,
    /// Actor the sensor is mounted on; 0 if free.
    pub parent_id: u32,
    /// Channels of a lidar; 0 otherwise.
    pub n_channels: u32,
    /// Images of a batch, one below the other; 0 in a frame of a single sensor.
    pub n_images: u32,
    /// Bits 0 to 7: the lens's model, 0 without one: 1 `pinhole`, 2 `opencv`, 3 `unified`, 4
    /// `kannala_brandt`, 5 `ftheta`, 6 `equidistant`, 7 `equisolid`, 8 `stereographic`, 9
    /// `orthographic`, 10 `double_sphere`, 11 `table`. Bit 16: `depth` is the distance along the ray, not
    /// along the optical axis.
    pub optics: u32,
    /// Random number of the daemon's start. From here on nothing takes part in hashes.
    pub epoch: u64,
    /// `CLOCK_MONOTONIC` when the bytes were complete: the GPU's fence was signalled, or the CPU
    /// was done.
    pub rendered_mono_nanos: u64,
    /// `CLOCK_MONOTONIC` just before the sample was sent.
    pub published_mono_nanos: u64,
    /// Copies by the CPU on the way into this sample; 0 if the GPU wrote into it.
    pub cpu_copies: u32,
    /// Ticks that had begun after its own when this frame was sent; 0 outside free-running mode.
    pub ticks_in_flight: u32,
    /// 0: the payload is in this sample. 1: it is on the GPU, and the sample holds a
    /// `GpuPlace`.
    pub payload_place: u32,
    /// The lens's [`Distortion`] `[k, k_cubed, size x, size y]`: at p (−0.5 to 0.5) is what a pinhole
    /// has at p · (1 + k r² + k_cubed r³), r being the length of p · size. All 0 for a pinhole; NaN if
    /// `optics` names a model, which these four cannot say.
    pub lens: [f32; 4],
    /// Zero.
    pub reserved1: [u8; 8],
    /// If `optics` names a model: the CRC-32 (IEEE 802.3) of width, height, model, fx, fy, shears of x
    /// and y, cx, cy, the field's greatest angle in radians, and the model's own numbers in the order of
    /// its keys (those left out at the end are not counted), each an `f64`; else 0. `world/info` has
    /// these numbers.
    pub calibration_crc: u32,
}
const _: () = assert!(size_of::<FrameHeader>() == 256 && align_of::<FrameHeader>() == 64);
const _: () = assert!(std::mem::offset_of!(FrameHeader, world_from_sensor) == 80);
const _: () = assert!(std::mem::offset_of!(FrameHeader, epoch) == HASHED_HEADER_BYTES);

impl FrameHeader {
    /// Flag: first frame since the sensor's state began.
    pub const FIRST: u32 = 1;
    /// Flag: published by a replay.
    pub const REPLAYED: u32 = 2;
    /// Flag: published by a sealed world; `world_from_sensor` is the sensor's mount on its vehicle,
    /// and numbers and classes of objects are blank.
    pub const SEALED: u32 = 4;
    /// Bit of `optics`: `depth` is the distance along the ray, not along the optical axis.
    pub const DEPTH_ALONG_RAY: u32 = 1 << 16;
    /// `payload_place` of a frame whose payload is in its sample.
    pub const IN_SAMPLE: u32 = 0;
    /// `payload_place` of a frame whose payload is on the GPU.
    pub const ON_GPU: u32 = 1;

    /// A header with magic, version, kind, encoding and element size filled in and everything else
    /// zero.
    pub fn new(modality: Modality) -> Self {
        FrameHeader {
            magic: FRAME_MAGIC,
            schema_version: SCHEMA_VERSION,
            header_bytes: size_of::<FrameHeader>() as u16,
            kind: modality.sensor_kind() as u16,
            encoding: modality as u16,
            element_bytes: modality.element_bytes() as u32,
            world_from_sensor: Pose::IDENTITY,
            ..Zeroable::zeroed()
        }
    }

    /// Sets the shape of a tightly packed image and its payload size.
    pub fn set_image(&mut self, width_px: u32, height_px: u32) {
        self.width = width_px;
        self.height = height_px;
        self.row_stride = width_px * self.element_bytes;
        self.payload_bytes = self.row_stride as u64 * height_px as u64;
    }

    /// Sets the shape of `n_images` tightly packed images of one size, and their payload size.
    pub fn set_batch(&mut self, n_images: u32, width_px: u32, height_px: u32) {
        self.set_image(width_px, height_px * n_images);
        self.n_images = n_images;
    }

    /// Whether it holds the images of several cameras.
    pub fn is_batch(&self) -> bool {
        self.n_images > 0
    }

    /// Rows of one image.
    pub fn image_height(&self) -> u32 {
        self.height / self.n_images.max(1)
    }

    /// Where image `index` of the payload begins and how long it is, bytes, each image with the gaps
    /// between its rows; of a checked header, and an index below `n_images` (0 in a frame of a single
    /// sensor).
    pub fn image_range(&self, index: u32) -> std::ops::Range<usize> {
        let rows = self.image_height() as usize;
        let (stride, row_bytes) = (
            self.row_stride as usize,
            self.width as usize * self.element_bytes as usize,
        );
        let begin = index as usize * rows * stride;
        begin..begin + rows.saturating_sub(1) * stride + row_bytes * rows.min(1)
    }

    /// Sets the shape of a list of `n_elements` and its payload size.
    pub fn set_list(&mut self, n_elements: u32) {
        self.set_image(n_elements, 1);
    }

    /// Number of the lens's model; 0 without one, and then `intrinsics_px` and `lens` say what its
    /// pixels show.
    pub fn lens_model(&self) -> u8 {
        self.optics as u8
    }

    /// `calibration_crc` of a lens and the size of its images.
    pub fn crc_of(lens: &Lens, size_px: [u32; 2]) -> u32 {
        let plane = lens.plane();
        let mut crc = crc32fast::Hasher::new();
        let mut add = |number: f64| crc.update(&number.to_le_bytes());
        size_px.iter().for_each(|side| add(f64::from(*side)));
        add(f64::from(lens.model().number()));
        let of_plane = [plane.focal_px, plane.shear_px, plane.centre_px];
        of_plane.iter().flatten().for_each(|it| add(*it));
        add(lens.max_angle_rad());
        lens.model().numbers().iter().for_each(|it| add(*it));
        crc.finalize()
    }

    /// How the lens bends lines; `None` for a pinhole.
    pub fn distortion(&self) -> Option<Distortion> {
        Distortion::from_array(self.lens)
    }

    /// The modality; `None` for a number this version does not know.
    pub fn modality(&self) -> Option<Modality> {
        Modality::from_code(self.encoding)
    }

    /// The sensor kind; `None` for a number this version does not know.
    pub fn sensor_kind(&self) -> Option<SensorKind> {
        SensorKind::from_code(self.kind)
    }

    /// Checks what a reader relies on before it touches the payload of `sample_bytes` bytes.
    ///
    /// # Errors
    /// [`FrameError`] names the first rule the header breaks. Any bit pattern is safe to pass.
    pub fn check(&self, sample_bytes: usize) -> Result<Modality, FrameError> {
        let modality = self.check_kind()?;
        if self.payload_place != FrameHeader::IN_SAMPLE {
            return Err(FrameError::Place {
                found: self.payload_place,
                wanted: FrameHeader::IN_SAMPLE,
            });
        }
        if self.payload_bytes > sample_bytes as u64 {
            return Err(FrameError::Length {
                claimed: self.payload_bytes,
                sample: sample_bytes as u64,
            });
        }
        self.check_shape(modality)
    }

    /// The same for a frame whose payload is on the GPU; `GpuPlace::read` also checks its sample.
    ///
    /// # Errors
    /// As [`FrameHeader::check`].
    pub fn check_on_gpu(&self) -> Result<Modality, FrameError> {
        let modality = self.check_kind()?;
        if self.payload_place != FrameHeader::ON_GPU {
            return Err(FrameError::Place {
                found: self.payload_place,
                wanted: FrameHeader::ON_GPU,
            });
        }
        self.check_shape(modality)
    }

    fn check_kind(&self) -> Result<Modality, FrameError> {
        if self.magic != FRAME_MAGIC {
            return Err(FrameError::Magic { found: self.magic });
        }
        if self.schema_version != SCHEMA_VERSION
            || self.header_bytes as usize != size_of::<FrameHeader>()
        {
            return Err(FrameError::Version {
                found: self.schema_version,
            });
        }
        self.modality().ok_or(FrameError::Encoding {
            found: self.encoding,
        })
    }

    fn check_shape(&self, modality: Modality) -> Result<Modality, FrameError> {
        let row_bytes = self.width as u64 * self.element_bytes as u64;
        let last_row = (self.height as u64)
            .saturating_sub(1)
            .saturating_mul(self.row_stride as u64);
        let shape_bytes = if self.height == 0 {
            0
        } else {
            last_row.saturating_add(row_bytes)
        };
        if self.element_bytes as usize != modality.element_bytes()
            || (self.height > 1 && (self.row_stride as u64) < row_bytes)
            || shape_bytes > self.payload_bytes
        {
            return Err(FrameError::Shape {
                width: self.width,
                height: self.height,
                row_stride: self.row_stride,
                element_bytes: self.element_bytes,
                payload: self.payload_bytes,
            });
        }
        if self.n_images > 0 && (!modality.is_image() || !self.height.is_multiple_of(self.n_images))
        {
            return Err(FrameError::Images {
                n_images: self.n_images,
                height: self.height,
            });
        }
        Ok(modality)
    }

    /// The first [`HASHED_HEADER_BYTES`] bytes, which are the same in every run of the same
    /// simulation.
    pub fn hashed_bytes(&self) -> &[u8] {
        &bytemuck::bytes_of(self)[..HASHED_HEADER_BYTES]
    }
}

/// Why a frame cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// Not a Gantry frame.
    #[error(
        "frame starts with {found:#010x}, not with the magic \"GFRM\"; the publisher is not Gantry's"
    )]
    Magic {
        /// The value found.
        found: u32,
    },
    /// Another version of this contract.
    #[error(
        "frame carries schema {found}, this reader understands {SCHEMA_VERSION}; rebuild the reader or the publisher"
    )]
    Version {
        /// The frame's version.
        found: u16,
    },
    /// An encoding this version does not know.
    #[error("frame has encoding {found}, known are 1 to {}; rebuild the reader", Modality::ALL.len())]
    Encoding {
        /// The frame's encoding.
        found: u16,
    },
    /// The payload lies elsewhere than where this reader reads.
    #[error("frame says that its payload is in place {found} (0 in the sample, 1 on the GPU), this reader reads place {wanted}; {}", place_advice(*.found))]
    Place {
        /// The frame's place.
        found: u32,
        /// The reader's place.
        wanted: u32,
    },
    /// A place on the GPU that contradicts itself or the header.
    #[error("frame's place on the GPU is not usable: {rule}; the publisher is broken")]
    GpuPlace {
        /// The broken rule.
        rule: &'static str,
    },
    /// More payload claimed than the sample holds.
    #[error(
        "frame claims {claimed} payload bytes, its sample holds {sample}; the publisher is broken"
    )]
    Length {
        /// Claimed bytes.
        claimed: u64,
        /// Bytes of the sample.
        sample: u64,
    },
    /// Shape and payload contradict one another.
    #[error(
        "frame of {width} × {height} elements of {element_bytes} bytes, {row_stride} bytes a row, does not fit its {payload} payload bytes"
    )]
    Shape {
        /// Elements per row.
        width: u32,
        /// Rows.
        height: u32,
        /// Bytes per row.
        row_stride: u32,
        /// Bytes per element.
        element_bytes: u32,
        /// Payload bytes.
        payload: u64,
    },
    /// A batch that cannot be taken apart into its images.
    #[error(
        "frame says that its {height} rows are {n_images} images, but a batch has only images, each with as many rows; the publisher is broken"
    )]
    Images {
        /// Images claimed.
        n_images: u32,
        /// Rows.
        height: u32,
    },
}

/// What to do about a frame in another place.
fn place_advice(found: u32) -> &'static str {
    match found {
        FrameHeader::IN_SAMPLE => "read the topic without \"/gpu\" behind its name",
        FrameHeader::ON_GPU => {
            "read the topic without \"/gpu\" behind its name, or with device=\"cuda\""
        }
        _ => "rebuild the reader",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fresh_image_header_passes_its_own_check() {
        let mut header = FrameHeader::new(Modality::Rgb);
        header.set_image(800, 600);
        assert_eq!(header.check(800 * 600 * 4), Ok(Modality::Rgb));
        assert_eq!(
            header.check(800 * 600 * 4 - 1),
            Err(FrameError::Length {
                claimed: 1_920_000,
                sample: 1_919_999
            })
        );
    }

    #[test]
    fn a_batch_is_one_tall_image_whose_rows_divide_into_its_images() {
        let mut header = FrameHeader::new(Modality::Depth);
        header.set_batch(3, 10, 4);
        assert_eq!(
            (header.height, header.payload_bytes, header.is_batch()),
            (12, 480, true)
        );
        assert_eq!(header.check(480), Ok(Modality::Depth));
        assert_eq!(header.image_height(), 4);
        assert_eq!(
            [0, 1, 2].map(|index| header.image_range(index)),
            [0..160, 160..320, 320..480]
        );
        header.n_images = 5;
        let refused = header.check(480).unwrap_err().to_string();
        assert!(refused.contains("12 rows are 5 images"), "{refused}");
        let mut list = FrameHeader::new(Modality::Lidar);
        list.set_list(4);
        assert!(!list.is_batch() && list.check(1 << 10).is_ok());
        list.n_images = 1;
        assert!(matches!(
            list.check(1 << 10),
            Err(FrameError::Images { .. })
        ));
        let mut image = FrameHeader::new(Modality::Rgb);
        image.set_image(5, 3);
        assert_eq!((image.image_height(), image.image_range(0)), (3, 0..60));
    }

    #[test]
    fn a_frame_on_the_gpu_is_refused_by_readers_of_samples_and_the_other_way_round() {
        let mut header = FrameHeader::new(Modality::Rgb);
        header.set_image(8, 6);
        assert!(header.check_on_gpu().is_err());
        header.payload_place = FrameHeader::ON_GPU;
        assert_eq!(header.check_on_gpu(), Ok(Modality::Rgb));
        let refused = header.check(8 * 6 * 4).unwrap_err().to_string();
        assert!(refused.contains("device=\"cuda\""), "{refused}");
    }

    #[test]
    fn random_bytes_never_panic_and_are_refused() {
        let mut rng = fastrand::Rng::with_seed(1);
        for _ in 0..20_000 {
            let mut bytes = [0u8; 256];
            bytes.iter_mut().for_each(|b| *b = rng.u8(..));
            let mut header: FrameHeader = bytemuck::pod_read_unaligned(&bytes);
            assert!(header.check(1 << 20).is_err());
            header.magic = FRAME_MAGIC;
            header.schema_version = SCHEMA_VERSION;
            header.header_bytes = 256;
            header.encoding = rng.u16(0..20);
            let _ = header.check(rng.usize(0..1 << 30));
        }
    }

    #[test]
    fn a_padded_row_is_accepted_and_a_short_one_is_not() {
        let mut header = FrameHeader::new(Modality::Depth);
        header.set_image(10, 2);
        header.row_stride = 64;
        header.payload_bytes = 104;
        assert!(header.check(104).is_ok());
        header.row_stride = 39;
        assert!(matches!(header.check(104), Err(FrameError::Shape { .. })));
    }
}
