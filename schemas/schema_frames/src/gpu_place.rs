//! Where a frame or a result lies whose payload stays on the GPU.

use bytemuck::{Pod, Zeroable};

use crate::header::{FrameError, FrameHeader};
use crate::result::{InputRecord, MAX_INPUTS, ResultError, ResultHeader};
use crate::result_type::ResultType;

/// Bytes of every sample whose payload is on the GPU.
pub const GPU_PLACE_BYTES: usize = size_of::<GpuPlace>();

/// Bytes of the sample of a result whose body is on the GPU: its place, and room for all inputs.
pub const GPU_RESULT_BYTES: usize = GPU_PLACE_BYTES + MAX_INPUTS * size_of::<InputRecord>();

/// The place of a frame or of a result's body in memory of a GPU: what a sample holds instead of it.
/// 64 bytes, little-endian.
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
        let rule = place.check(header.payload_bytes);
        rule.map_err(|rule| FrameError::GpuPlace { rule })?;
        Ok(place)
    }

    /// Reads the place of a result's body, whose inputs lie behind it in the sample.
    ///
    /// # Errors
    /// As [`GpuPlace::read`].
    pub fn of_result(
        header: &ResultHeader,
        sample: &[u8],
    ) -> Result<(ResultType, GpuPlace), ResultError> {
        let kind = header.check_on_gpu()?;
        let inputs = header.n_inputs as usize * size_of::<InputRecord>();
        let claimed = GPU_PLACE_BYTES + inputs;
        if sample.len() < claimed {
            return Err(ResultError::Length {
                claimed: claimed as u64,
                sample: sample.len() as u64,
            });
        }
        let place: GpuPlace = bytemuck::pod_read_unaligned(&sample[..GPU_PLACE_BYTES]);
        let rule = place.check(header.body_bytes);
        rule.map_err(|rule| ResultError::GpuPlace { rule })?;
        Ok((kind, place))
    }

    /// The rule that it breaks for a payload of `n_bytes`.
    fn check(&self, n_bytes: u64) -> Result<(), &'static str> {
        if self.generation == 0 {
            return Err("it names no memory");
        }
        let end = self.offset_bytes.checked_add(self.capacity_bytes);
        if end.is_none_or(|end| end > self.memory_bytes) {
            return Err("it leaves its memory");
        }
        if n_bytes > self.capacity_bytes {
            return Err("its payload is longer than its slot");
        }
        Ok(())
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
    fn a_result_on_the_gpu_has_its_place_and_its_inputs_in_the_sample() {
        let (_, place) = frame();
        let mut header = ResultHeader::new(ResultType::Tensor);
        header
            .set_tensor(crate::ElementType::F32, &[4, 16])
            .unwrap();
        header.n_inputs = 2;
        header.payload_bytes = ResultHeader::payload_for(header.body_bytes, 2);
        assert!(header.check(4096).is_ok() && header.check_on_gpu().is_err());
        header.payload_place = ResultHeader::ON_GPU;
        assert!(
            header
                .check(4096)
                .unwrap_err()
                .to_string()
                .contains("place 1")
        );
        let mut sample = bytemuck::bytes_of(&place).to_vec();
        sample.resize(64 + 512, 0);
        let found = GpuPlace::of_result(&header, &sample);
        assert_eq!(found, Ok((ResultType::Tensor, place)));
        assert!(GpuPlace::of_result(&header, &sample[..575]).is_err());
        header
            .set_tensor(crate::ElementType::F32, &[5, 16])
            .unwrap();
        header.payload_bytes = ResultHeader::payload_for(header.body_bytes, 2);
        let broken = GpuPlace::of_result(&header, &sample).unwrap_err();
        assert!(broken.to_string().contains("longer than its slot"));
        assert_eq!(GPU_RESULT_BYTES, 64 + 8 * 256);
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
            let mut result: ResultHeader = Zeroable::zeroed();
            bytemuck::bytes_of_mut(&mut result)
                .iter_mut()
                .for_each(|byte| *byte = rng.u8(..));
            let _ = GpuPlace::of_result(&result, &bytes);
        }
    }
}
