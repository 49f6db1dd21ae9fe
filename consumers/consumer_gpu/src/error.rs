//! What can go wrong, as sentences.

use schema_bus::BusError;

/// Why frames cannot be had on a GPU.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// The bus failed.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// There is no CUDA on this machine.
    #[error(
        "CUDA cannot be used here: {0}; read the topic without a device, or install NVIDIA's driver and give the container its GPU"
    )]
    NoCuda(String),
    /// A call of CUDA failed.
    #[error("CUDA's {call} failed: {code}")]
    Cuda {
        /// The function.
        call: &'static str,
        /// CUDA's name for the error.
        code: String,
    },
    /// Memory cannot be reached.
    #[error("memory of {topic:?} cannot be used: {fault}")]
    Memory {
        /// The topic.
        topic: String,
        /// Why, as a clause.
        fault: String,
    },
}
