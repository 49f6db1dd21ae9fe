//! Reading the world: snapshots and documents.

use std::sync::Arc;
use std::time::Duration;

use consumer_kit::{SnapshotTrail, WorldAt};
use parking_lot::Mutex;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use schema_bus::{BusError, names};

use crate::errors;
use crate::fork::{self, Owned};
use crate::place::Place;
use crate::wait::{self, Failure, Timeout, Waker};

/// Wait between two looks for the first sample of a topic that has no event.
const LOOK_AGAIN: Duration = Duration::from_millis(1);

/// Header and records of a snapshot as bytes.
pub type SnapshotBytes<'py> = (Bound<'py, PyBytes>, Bound<'py, PyBytes>);

/// Copies a snapshot into Python's bytes.
pub fn snapshot_bytes<'py>(py: Python<'py>, world: &WorldAt) -> SnapshotBytes<'py> {
    (
        PyBytes::new(py, bytemuck::bytes_of(&world.header)),
        PyBytes::new(py, bytemuck::cast_slice(&world.records)),
    )
}

/// Looks until something is there, without Python's global lock in between.
fn first<T: Send>(
    py: Python<'_>,
    full: &str,
    timeout: Option<f64>,
    mut look: impl FnMut() -> Result<Option<T>, BusError> + Send,
) -> PyResult<T> {
    let until = Timeout::new(timeout)?;
    loop {
        if let Some(found) = py.detach(&mut look).map_err(errors::bus)? {
            return Ok(found);
        }
        if until.left().is_some_and(|left| left.is_zero()) {
            return Err(errors::timed_out(format!(
                "{full:?} sent nothing within {} s; is the simulator running?",
                timeout.unwrap_or(0.0)
            )));
        }
        py.detach(|| std::thread::sleep(LOOK_AGAIN));
        wait::signals()?;
    }
}

/// The newest text of a document: revision, tick, epoch and text.
#[pyfunction]
pub fn document(
    py: Python<'_>,
    domain: &str,
    name: &str,
    timeout: Option<f64>,
) -> PyResult<(u64, u64, u64, String)> {
    let place = Place::of(domain)?;
    let mut reader = py
        .detach(|| place.bus().document_reader(name))
        .map_err(errors::bus)?;
    let found = first(py, &format!("{domain}/{name}"), timeout, || reader.latest())?;
    let header = found.header;
    Ok((header.revision, header.tick, header.epoch, found.text))
}

/// The newest snapshot: header and records.
#[pyfunction]
pub fn snapshot<'py>(
    py: Python<'py>,
    domain: &str,
    timeout: Option<f64>,
) -> PyResult<SnapshotBytes<'py>> {
    let place = Place::of(domain)?;
    let mut reader = py
        .detach(|| place.bus().snapshot_reader())
        .map_err(errors::bus)?;
    let full = format!("{domain}/{}", names::WORLD_SNAPSHOT);
    let world = first(py, &full, timeout, || {
        Ok(reader.latest()?.map(|snapshot| WorldAt {
            header: *snapshot.header(),
            records: snapshot.records().to_vec(),
        }))
    })?;
    Ok(snapshot_bytes(py, &world))
}

/// The last 32 snapshots, read as they are needed.
#[pyclass(frozen, module = "gantry._native")]
pub struct Snapshots {
    // Ports go before their node.
    trail: Mutex<Option<Owned<SnapshotTrail>>>,
    waker: Waker,
    place: Arc<Place>,
}

/// What there is of the snapshot of a tick.
enum At {
    There(Arc<WorldAt>),
    /// It is no longer kept, or never came; the newest is of this tick.
    Gone(u64),
}

impl Snapshots {
    /// Follows `world/snapshot` from now on.
    fn follow(py: Python<'_>, place: Arc<Place>) -> PyResult<Self> {
        let bus = place.bus();
        let opened = py.detach(|| {
            if !bus.exists(names::WORLD_SNAPSHOT) {
                // Fails with the sentence that lists what there is instead.
                bus.snapshot_reader()?;
            }
            let waker = Waker::new(bus.listener(names::WORLD_SNAPSHOT)?);
            let mut trail = SnapshotTrail::new();
            trail.newest(bus)?;
            Ok((waker, trail))
        });
        let (waker, trail) = opened.map_err(errors::bus)?;
        Ok(Snapshots {
            trail: Mutex::new(Some(Owned::new(trail))),
            waker,
            place,
        })
    }

    /// The newest snapshot, if one has come.
    fn look(&self) -> Result<Option<Arc<WorldAt>>, Failure> {
        let mut trail = self.trail.lock();
        let trail = trail.as_mut().ok_or(Failure::Closed)?;
        Ok(trail.newest(self.place.bus())?)
    }

    fn look_at(&self, tick: u64, epoch: Option<u64>) -> Result<Option<At>, Failure> {
        let mut trail = self.trail.lock();
        let trail = trail.as_mut().ok_or(Failure::Closed)?;
        let bus = self.place.bus();
        let of_epoch = |world: &WorldAt| epoch.is_none_or(|epoch| world.header.epoch == epoch);
        if let Some(world) = trail.at(bus, tick)?.filter(|world| of_epoch(world)) {
            return Ok(Some(At::There(world)));
        }
        let newest = trail.newest(bus)?;
        Ok(newest
            .filter(|newest| newest.header.tick > tick || !of_epoch(newest))
            .map(|newest| At::Gone(newest.header.tick)))
    }
}

#[pymethods]
impl Snapshots {
    #[new]
    fn open(py: Python<'_>, domain: &str) -> PyResult<Self> {
        Self::follow(py, Place::of(domain)?)
    }

    /// The snapshot of exactly this tick; waits for it up to `timeout` seconds. `None` if it has
    /// not come by then. Without `epoch` the newest start of the simulator counts.
    fn at<'py>(
        &self,
        py: Python<'py>,
        tick: u64,
        epoch: Option<u64>,
        timeout: Option<f64>,
    ) -> PyResult<Option<SnapshotBytes<'py>>> {
        fork::check()?;
        let timeout = Timeout::new(timeout)?;
        let look = || self.look_at(tick, epoch);
        let found = self.waker.until(py, timeout, Duration::ZERO, look)?;
        match found.map_err(|failure| failure.raise("the reader of snapshots"))? {
            Some(At::There(world)) => Ok(Some(snapshot_bytes(py, &world))),
            Some(At::Gone(newest)) => Err(errors::gantry(format!(
                "the snapshot of tick {tick} is gone, the newest is of tick {newest}; the last {} since the first call are kept, so ask for it soon, or use sync(..., snapshots=True)",
                consumer_kit::KEPT_SNAPSHOTS
            ))),
            None => Ok(None),
        }
    }

    /// The newest snapshot, if one has come.
    fn newest<'py>(&self, py: Python<'py>) -> PyResult<Option<SnapshotBytes<'py>>> {
        fork::check()?;
        let found = py.detach(|| self.look());
        let world = found.map_err(|failure| failure.raise("the reader of snapshots"))?;
        Ok(world.map(|world| snapshot_bytes(py, &world)))
    }

    /// Descriptor that becomes readable when a snapshot was sent.
    fn fileno(&self, py: Python<'_>) -> PyResult<i32> {
        self.waker.fileno(py)
    }

    /// Stops reading.
    fn close(&self, py: Python<'_>) {
        if fork::check().is_ok() {
            let trail = self.trail.lock().take();
            py.detach(|| drop(trail));
            self.waker.close(py);
        }
    }
}
