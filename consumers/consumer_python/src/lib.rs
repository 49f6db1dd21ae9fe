//! The native half of the Python package `gantry`: the ports of `schema_bus` and the lockstep and
//! snapshots of `consumer_kit` as Python objects, and numpy arrays in shared memory.
//!
//! It holds no rules of its own: what is checked, counted and waited for is what every Rust
//! consumer does. The public interface, names and defaults are in `python/gantry`, whose
//! `_native.pyi` lists what is here.
//!
//! Three rules keep threads and processes apart. A lock that is taken with Python's global lock held
//! is never kept while that is awaited. A call that waits has let go of the global lock. A forked
//! child uses nothing and drops nothing of its parent's.
//!
//! Modules in reading order: `fork`, `errors`, `place` (a domain), `wait`, `view` (arrays),
//! `elements`, `dlpack`, `tensor`, `calibration`, `frame`, `topic`, `world`, `lockstep`, `control`, `result`, `publish`,
//! `publish_gpu`, `recording`, `result_file`, and `worlds`, which needs no bus.

#![warn(missing_docs)]

mod calibration;
mod control;
mod dlpack;
mod elements;
mod errors;
mod fork;
mod frame;
mod lockstep;
mod place;
mod publish;
mod publish_gpu;
mod recording;
mod result;
mod result_file;
mod tensor;
mod topic;
mod view;
mod wait;
mod world;
mod worlds;

use pyo3::prelude::*;

/// Native half of the package `gantry`; use the package.
#[pymodule(gil_used = false)]
mod _native {
    #[pymodule_export]
    use crate::calibration::Calibration;
    #[pymodule_export]
    use crate::control::Controls;
    #[pymodule_export]
    use crate::dlpack::{Foreign, take_capsule, take_interface};
    #[pymodule_export]
    use crate::elements::set_elements;
    #[pymodule_export]
    use crate::frame::{Sample, sample_from_bytes, set_frame_class};
    #[pymodule_export]
    use crate::lockstep::Lockstep;
    #[pymodule_export]
    use crate::place::{
        clean, close_all, command, default_domain, leave, publisher_alive, set_private,
        set_program, topics,
    };
    #[pymodule_export]
    use crate::publish::{Loan, Publisher, Said};
    #[pymodule_export]
    use crate::publish_gpu::{GpuLoan, GpuPublisher};
    #[pymodule_export]
    use crate::recording::{Cursor, Recording};
    #[pymodule_export]
    use crate::result::{About, Outcome, outcome_from_bytes, set_result_class};
    #[pymodule_export]
    use crate::result_file::{FileDraft, ResultFile};
    #[pymodule_export]
    use crate::topic::Reader;
    #[pymodule_export]
    use crate::world::{Snapshots, document, snapshot};
    #[pymodule_export]
    use crate::worlds::{Worlds, columns, tasks};

    /// Number of this interface, which the Python half compares with its own.
    #[pymodule_export]
    const INTERFACE: u32 = 13;
    /// Version of the layouts that this module reads and writes.
    #[pymodule_export]
    const SCHEMA_VERSION: u16 = schema_frames::SCHEMA_VERSION;

    use super::*;

    #[pymodule_init]
    fn init(_module: &Bound<'_, PyModule>) -> PyResult<()> {
        crate::fork::watch();
        Ok(())
    }
}
