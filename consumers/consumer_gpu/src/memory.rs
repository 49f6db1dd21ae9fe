//! Memory of writers as this process has it.

use std::sync::Arc;

use schema_bus::{Bus, BusError, GpuSample as _};
use schema_frames::GpuAnswer;

use crate::cuda::{Cuda, Imported};
use crate::error::GpuError;
use crate::kinds::{DeviceSample, Kind};
use crate::mapping::{MapError, Mapping};
use crate::shared::{self, SharedRange};

/// Memories of a writer that stay imported: the one in use, and that of the writer before it,
/// whose samples may still be held.
const MAX_KEPT: usize = 2;

/// Memory of a writer.
#[derive(Debug)]
pub enum Memory {
    Imported(Imported),
    Shared(SharedRange),
    Mapped(Mapping),
}

impl Memory {
    /// Address of its first byte.
    pub fn address(&self) -> u64 {
        match self {
            Memory::Imported(imported) => imported.address,
            Memory::Shared(range) => range.address,
            Memory::Mapped(mapping) => mapping.address(),
        }
    }
}

/// Where the memory of a sample is.
pub enum Found {
    Here(Arc<Memory>),
    /// On another GPU than the reader's.
    Elsewhere,
    /// Its writer has ended, so that the sample cannot be reached any more.
    Gone,
}

/// The memories that a topic's samples are in, by their numbers.
#[derive(Debug, Default)]
pub struct Memories(Vec<(u64, Arc<Memory>)>);

impl Memories {
    /// The memory that a sample is in, which is asked for when it is first met.
    ///
    /// # Errors
    /// [`GpuError::Memory`], [`GpuError::Cuda`].
    pub fn of<K: Kind>(
        &mut self,
        bus: &Bus,
        sample: &DeviceSample<K>,
        device: Option<&Arc<Cuda>>,
    ) -> Result<Found, GpuError> {
        let generation = sample.place().generation;
        if let Some((_, memory)) = self.0.iter().find(|(known, _)| *known == generation) {
            return Ok(Found::Here(memory.clone()));
        }
        let topic = sample.topic();
        let memory = match bus.gpu_memory(sample) {
            Ok(memory) => memory,
            Err(BusError::GpuMemory { topic, fault }) => {
                return Err(GpuError::Memory { topic, fault });
            }
            Err(error) => {
                tracing::debug!(topic, %error, "a sample's memory is gone");
                return Ok(Found::Gone);
            }
        };
        let is_here = match device {
            Some(cuda) => cuda.uuid == memory.device_uuid,
            None => memory.is_mappable,
        };
        if !is_here {
            return Ok(Found::Elsewhere);
        }
        let n_bytes = memory.n_bytes;
        let memory = match (device, memory.handle_kind) {
            (Some(cuda), GpuAnswer::VULKAN) => Memory::Imported(cuda.import(memory)?),
            (Some(cuda), GpuAnswer::CUDA) => Memory::Shared(shared::import(
                cuda,
                &memory.descriptor,
                usize::try_from(n_bytes).map_err(|_| GpuError::memory(topic, MapError::TooLong))?,
            )?),
            (Some(_), other) => {
                return Err(GpuError::memory(
                    topic,
                    format!(
                        "its descriptor is of kind {other}, and this program imports kinds {} (Vulkan's) and {} (CUDA's)",
                        GpuAnswer::VULKAN,
                        GpuAnswer::CUDA
                    ),
                ));
            }
            (None, _) => {
                let mapped = Mapping::new(&memory.descriptor, n_bytes);
                Memory::Mapped(mapped.map_err(|why| GpuError::memory(topic, why))?)
            }
        };
        let memory = Arc::new(memory);
        if self.0.len() >= MAX_KEPT {
            self.0.remove(0);
        }
        self.0.push((generation, memory.clone()));
        Ok(Found::Here(memory))
    }
}
