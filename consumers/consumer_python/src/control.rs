//! Sending vehicle controls.

use std::sync::Arc;

use parking_lot::Mutex;
use pyo3::prelude::*;

use schema_bus::{ControlWriter, Notifier, names};
use schema_frames::VehicleControlRecord;

use crate::errors;
use crate::fork::{self, Owned};
use crate::place::Place;

/// A writer of `control/vehicles`.
#[pyclass(frozen, module = "gantry._native")]
pub struct Controls {
    // Ports go before their node.
    ports: Mutex<Owned<(ControlWriter, Notifier)>>,
    _place: Arc<Place>,
}

#[pymethods]
impl Controls {
    /// Opens the topic as the writer `name`.
    #[new]
    fn open(py: Python<'_>, domain: &str, name: &str) -> PyResult<Self> {
        let place = Place::of(domain)?;
        let bus = place.bus();
        let ports = py
            .detach(|| {
                Ok((
                    bus.control_writer(name)?,
                    bus.notifier(names::CONTROL_WAKE)?,
                ))
            })
            .map_err(errors::bus)?;
        Ok(Controls {
            ports: Mutex::new(Owned::new(ports)),
            _place: place,
        })
    }

    /// Sends records of 32 bytes that answer the snapshot of `tick`.
    fn send(&self, tick: u64, records: &[u8]) -> PyResult<()> {
        fork::check()?;
        let size = size_of::<VehicleControlRecord>();
        if !records.len().is_multiple_of(size) {
            return Err(errors::format(format!(
                "{} bytes are no list of vehicle controls, which have {size} each",
                records.len()
            )));
        }
        let records: Vec<VehicleControlRecord> = records
            .chunks_exact(size)
            .map(bytemuck::pod_read_unaligned)
            .collect();
        let mut ports = self.ports.lock();
        let (writer, wake) = &mut **ports;
        writer.send(tick, &records).map_err(errors::bus)?;
        wake.notify();
        Ok(())
    }
}
