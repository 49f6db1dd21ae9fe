//! A sample on a GPU, and how it goes back.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use schema_bus::{Answerable, Answered, GpuFrame, GpuResult, GpuSample as _};
use schema_frames::{FrameHeader, InputRecord, Modality, ResultHeader, ResultType};
use schema_types::MonoTime;

use crate::cuda::{Cuda, Staged};
use crate::error::GpuError;
use crate::kinds::{DeviceSample, Frames, Kind, Results};
use crate::memory::Memory;
use crate::release::Releases;
use crate::upload::Uploads;

/// A sample, and the memory that it is in.
#[derive(Debug)]
pub struct Slot<K: Kind> {
    pub sample: DeviceSample<K>,
    pub _memory: Arc<Memory>,
}

/// Memory of an upload, which goes back when this is dropped.
#[derive(Debug)]
pub struct GivesBack {
    pub staged: Option<Staged>,
    pub uploads: Arc<Uploads>,
}

impl Drop for GivesBack {
    fn drop(&mut self) {
        if let Some(staged) = self.staged.take() {
            self.uploads.give_back(staged);
        }
    }
}

/// A sample on a GPU. Its memory stays as it is until this is dropped and the GPU has done what it
/// was given until then.
#[derive(Debug)]
pub struct OnGpu<K: Kind> {
    address: u64,
    device: Option<Arc<Cuda>>,
    /// A stream that reads it, for drivers that cannot wait for all.
    stream: AtomicU64,
    pub(crate) held: Held<K>,
}

/// A frame on a GPU.
pub type FrameOnGpu = OnGpu<Frames>;
/// A result on a GPU.
pub type ResultOnGpu = OnGpu<Results>;

#[derive(Debug)]
pub enum Held<K: Kind> {
    Slot {
        slot: Option<Slot<K>>,
        releases: Arc<Releases<Slot<K>>>,
    },
    Upload {
        about: Box<K::About>,
        staged: Option<GivesBack>,
        releases: Arc<Releases<GivesBack>>,
    },
}

impl<K: Kind> OnGpu<K> {
    pub(crate) fn new(address: u64, device: Option<Arc<Cuda>>, held: Held<K>) -> OnGpu<K> {
        OnGpu {
            address,
            device,
            stream: AtomicU64::new(0),
            held,
        }
    }

    pub(crate) fn sample(&self) -> Result<&DeviceSample<K>, &K::About> {
        match &self.held {
            Held::Slot { slot, .. } => Ok(&slot.as_ref().expect("taken out by drop only").sample),
            Held::Upload { about, .. } => Err(about),
        }
    }

    /// Address of its first byte: on the device, or, if it is mapped, in this process.
    pub fn address(&self) -> u64 {
        self.address
    }

    /// Bytes of its payload.
    pub fn n_bytes(&self) -> usize {
        K::n_bytes(self.sample()) as usize
    }

    /// Number of CUDA's device; `None` if it is mapped.
    pub fn device(&self) -> Option<i32> {
        self.device.as_ref().map(|device| device.ordinal)
    }

    /// Says that a stream of CUDA, by its address, reads it. Needed for drivers before 12.5 only:
    /// later ones wait for all streams.
    pub fn is_read_by(&self, stream: u64) {
        self.stream.store(stream, Relaxed);
    }

    /// Whether giving it back waits for the work of all streams, so that nobody has to name his.
    pub fn waits_for_all_streams(&self) -> bool {
        self.device.as_ref().is_none_or(|it| it.sees_all_streams())
    }

    /// A copy of its bytes.
    ///
    /// # Errors
    /// [`GpuError::Cuda`].
    pub fn to_bytes(&self) -> Result<Vec<u8>, GpuError> {
        let mut bytes = vec![0; self.n_bytes()];
        match &self.device {
            // SAFETY: the payload, as long as the header says; this value keeps its memory.
            Some(cuda) => unsafe { cuda.read(self.address, &mut bytes)? },
            // SAFETY: mapped for reading, and kept by this value; the header was checked, and its
            // writer does not write to a slot that a reader holds.
            None => unsafe {
                std::ptr::copy_nonoverlapping(
                    self.address as *const u8,
                    bytes.as_mut_ptr(),
                    bytes.len(),
                );
            },
        }
        Ok(bytes)
    }
}

impl OnGpu<Frames> {
    /// The header, checked.
    pub fn header(&self) -> &FrameHeader {
        self.sample()
            .map_or_else(|about| &about.header, GpuFrame::header)
    }

    /// The modality of the payload.
    pub fn modality(&self) -> Modality {
        self.sample()
            .map_or_else(|about| about.modality, GpuFrame::modality)
    }

    /// Its topic without the domain.
    pub fn topic(&self) -> &str {
        self.sample()
            .map_or_else(|about| about.topic.as_str(), GpuFrame::topic)
    }

    /// When this reader took it.
    pub fn taken(&self) -> MonoTime {
        self.sample()
            .map_or_else(|about| about.taken, GpuFrame::taken)
    }
}

impl OnGpu<Results> {
    /// The header, checked.
    pub fn header(&self) -> &ResultHeader {
        self.sample()
            .map_or_else(|about| &about.header, GpuResult::header)
    }

    /// Type of the result.
    pub fn kind(&self) -> ResultType {
        self.sample()
            .map_or_else(|about| about.kind, GpuResult::kind)
    }

    /// The frames and results that it answers.
    pub fn inputs(&self) -> &[InputRecord] {
        self.sample()
            .map_or_else(|about| &about.inputs, GpuResult::inputs)
    }

    /// Its topic without the domain.
    pub fn topic(&self) -> &str {
        self.sample()
            .map_or_else(|about| about.topic.as_str(), |sample| sample.topic())
    }

    /// When this reader took it.
    pub fn taken(&self) -> MonoTime {
        self.sample()
            .map_or_else(|about| about.taken, GpuResult::taken)
    }
}

impl<K: Kind> Answerable for OnGpu<K> {
    fn answered(&self) -> Answered {
        self.sample().map_or_else(K::answered, Answerable::answered)
    }
}

impl<K: Kind> Drop for OnGpu<K> {
    fn drop(&mut self) {
        let Some(cuda) = &self.device else {
            return;
        };
        let stream = *self.stream.get_mut();
        let event = cuda.now(stream);
        match &mut self.held {
            Held::Slot { slot, releases } => {
                if let (Ok(event), Some(slot)) = (event, slot.take()) {
                    releases.push(event, slot);
                }
            }
            Held::Upload {
                staged, releases, ..
            } => {
                if let (Ok(event), Some(staged)) = (event, staged.take()) {
                    releases.push(event, staged);
                }
            }
        }
    }
}
