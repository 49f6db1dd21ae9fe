//! What can go wrong, as sentences.

use schema_bus::{BusError, LoanError};

/// Why samples cannot be had or published on a GPU.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// The bus failed.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// No slot can be loaned.
    #[error(transparent)]
    Loan(#[from] LoanError),
    /// The device has too little memory.
    #[error(
        "no room on the GPU for {n_slots} results of {topic:?}, {need} MiB: {free} of {all} MiB are free; ask for fewer gpu_readers, buffered or borrowed results, or send smaller ones",
        need = mebibytes((*.n_slots as u64).saturating_mul(*.slot_bytes)),
        free = .free_bytes >> 20,
        all = .all_bytes >> 20
    )]
    Room {
        /// The topic.
        topic: String,
        /// Slots of it.
        n_slots: usize,
        /// Bytes of each.
        slot_bytes: u64,
        /// Bytes that are free.
        free_bytes: u64,
        /// All bytes that the device has.
        all_bytes: u64,
    },
    /// There is no CUDA on this machine.
    #[error(
        "CUDA cannot be used here: its driver{0}; leave the device out, or install NVIDIA's driver and give the container its GPU"
    )]
    NoCuda(NoCuda),
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

/// Why CUDA does not start, as the end of a clause about its driver.
#[derive(Clone, Copy, Debug, thiserror::Error)]
pub enum NoCuda {
    /// The library is not installed.
    #[error(", libcuda.so.1, is not found")]
    NotFound,
    /// The driver refuses.
    #[error(" says {0:?}")]
    Refused(cudarc::driver::sys::CUresult),
}

impl GpuError {
    /// Memory of `topic` that cannot be reached, for the reason in a clause.
    pub(crate) fn memory(topic: &str, fault: impl ToString) -> GpuError {
        GpuError::Memory {
            topic: topic.into(),
            fault: fault.to_string(),
        }
    }
}

/// `n` bytes as MiB, rounded up.
fn mebibytes(n: u64) -> u64 {
    n.div_ceil(1 << 20)
}
