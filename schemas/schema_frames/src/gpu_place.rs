//! Where a frame lies whose payload stays on the GPU.

use bytemuck::{Pod, Zeroable};

use crate::header::{FrameError, FrameHeader};

/// Bytes of every sample whose payload is on the GPU.
pub const GPU_PLACE_BYTES: usize = size_of::<GpuPlace>();

/// A frame's place in memory of a GPU: what a sample holds instead of the payload. 64 bytes,
/// little-endian.
#[repr(C, align(8))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct GpuPlace {
    /// Number of the process that wrote it: its socket is `gantry-gpu/<domain>-<16 hex digits>`.
    pub producer: u64,
    /// Random number of the memory, by which its descriptor is asked for; never 0.
    pub generation: u64,
    /// Where the payload begins, bytes from the memory's beginning.
    pub offset_bytes: u64,
    /// Length of the memory, bytes; what comes with the descriptor must say the same.
    pub memory_bytes: u64,
    /// Bytes from the payload's beginning that belong to the frame.
    pub capacity_bytes: u64,
    /// Process id of the writer, for people.
    pub pid: u32,
    /// Number of the slot, the same as that of the sample in its segment.
    pub slot: u32,
    /// Zero.
    pub reserved: [u8; 16],
}
const _: () = assert!(size_of::<GpuPlace>() == 64 && align_of::<GpuPlace>() == 8);

impl GpuPlace {
    /// Reads the place from a sample whose header says that there is one.
    ///
    /// # Errors
    /// [`FrameError`] names the first rule that header or place break. Any bit pattern is safe to
    /// pass.
    pub fn read(header: &FrameHeader, sample: &[u8]) -> Result<GpuPlace, FrameError> {
        header.check_on_gpu()?;
        if sample.len() < GPU_PLACE_BYTES {
            return Err(FrameError::Length {
                claimed: GPU_PLACE_BYTES as u64,
                sample: sample.len() as u64,
            });
        }
        let place: GpuPlace = bytemuck::pod_read_unaligned(&sample[..GPU_PLACE_BYTES]);
        let broken = |rule| Err(FrameError::GpuPlace { rule });
        if place.generation == 0 {
            return broken("it names no memory");
        }
        let end = place.offset_bytes.checked_add(place.capacity_bytes);
        if end.is_none_or(|end| end > place.memory_bytes) {
            return broken("it leaves its memory");
        }
        if header.payload_bytes > place.capacity_bytes {
            return broken("its payload is longer than its slot");
        }
        Ok(place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Modality;

    fn frame() -> (FrameHeader, GpuPlace) {
        let mut header = FrameHeader::new(Modality::Rgb);
        header.payload_place = FrameHeader::ON_GPU;
        header.set_image(8, 4);
        let place = GpuPlace {
            producer: 1,
            generation: 2,
            offset_bytes: 256,
            memory_bytes: 1024,
            capacity_bytes: 256,
            ..Zeroable::zeroed()
        };
        (header, place)
    }

    #[test]
    fn a_place_on_the_gpu_is_read_back_and_each_broken_rule_is_named() {
        let (header, place) = frame();
        let read = |header: &FrameHeader, place: GpuPlace| {
            GpuPlace::read(header, bytemuck::bytes_of(&place))
        };
        assert_eq!(read(&header, place), Ok(place));
        let broken = |change: fn(&mut FrameHeader, &mut GpuPlace)| {
            let (mut header, mut place) = frame();
            change(&mut header, &mut place);
            read(&header, place).unwrap_err().to_string()
        };
        assert!(broken(|_, place| place.generation = 0).contains("no memory"));
        assert!(broken(|_, place| place.offset_bytes = u64::MAX).contains("leaves"));
        assert!(broken(|_, place| place.capacity_bytes = 64).contains("longer"));
        assert!(broken(|header, _| header.payload_place = 0).contains("place 0"));
        assert!(GpuPlace::read(&header, &[0; 63]).is_err());
    }

    #[test]
    fn random_places_never_panic() {
        let mut rng = fastrand::Rng::with_seed(3);
        let (header, place) = frame();
        for _ in 0..20_000 {
            let mut bytes = bytemuck::bytes_of(&place).to_vec();
            for _ in 0..rng.usize(1..6) {
                let at = rng.usize(..bytes.len());
                bytes[at] = rng.u8(..);
            }
            if let Ok(place) = GpuPlace::read(&header, &bytes) {
                assert!(place.offset_bytes + header.payload_bytes <= place.memory_bytes);
            }
        }
    }
}
