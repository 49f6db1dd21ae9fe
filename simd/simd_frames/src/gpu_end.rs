//! How a program ends whose GPU is gone.

use launch_cli::GpuLost;
use sensor_gpu::GpuError;

/// An error of a GPU that is gone ends the program with a code of its own.
pub fn of_gpu(error: anyhow::Error) -> anyhow::Error {
    let gone = error.chain().find_map(|cause| match cause.downcast_ref() {
        Some(gone @ (GpuError::Lost { .. } | GpuError::Hung { .. })) => Some(gone.to_string()),
        _ => None,
    });
    gone.map_or(error, |sentence| anyhow::Error::new(GpuLost(sentence)))
}
