//! How much work colour gets.

use sensor_gpu::Gpu;

/// How much work colour gets. Everything else is the same in both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// For software adapters.
    Low,
    /// For GPUs.
    High,
}

impl Quality {
    /// `Low` on software adapters, else `High`.
    pub fn default_for(gpu: &Gpu) -> Self {
        if gpu.is_software() {
            Quality::Low
        } else {
            Quality::High
        }
    }
}
