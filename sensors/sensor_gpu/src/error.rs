//! What can go wrong with a GPU.

/// Why no device was opened, or why a submission did not come back.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// The Vulkan loader found nothing.
    #[error(
        "no Vulkan adapter found; install a driver (Debian: mesa-vulkan-drivers has the software adapter lavapipe)"
    )]
    NoAdapter,
    /// No adapter has the requested number, UUID or name, or two have that beginning of a UUID.
    #[error(
        "no Vulkan adapter is {asked:?} by its number, its whole UUID or a part of its name; there are: {}",
        found.join(", ")
    )]
    UnknownAdapter {
        /// What was asked for.
        asked: String,
        /// Numbers, names and UUIDs of all adapters.
        found: Vec<String>,
    },
    /// The driver refused to open the device.
    #[error("cannot open Vulkan adapter {name:?}: {reason}")]
    Open {
        /// Adapter.
        name: String,
        /// The driver's message.
        reason: String,
    },
    /// The device was lost or reported an error while a submission ran.
    #[error("GPU {name:?} failed while working on a frame: {reason}; restart the daemon")]
    Lost {
        /// Adapter.
        name: String,
        /// The driver's message.
        reason: String,
    },
    /// A submission did not end.
    #[error(
        "GPU {name:?} hangs: it did not finish a frame within {limit_secs} s; restart the daemon, and look at the driver's log if it happens again"
    )]
    Hung {
        /// Adapter.
        name: String,
        /// The longest wait, seconds.
        limit_secs: u64,
    },
    /// There is no memory on the device for what was asked.
    #[error(
        "GPU {name:?} has no memory for {what}; ask for smaller or fewer images, or end what else uses the GPU"
    )]
    OutOfMemory {
        /// Adapter.
        name: String,
        /// What was to be made.
        what: String,
    },
}
