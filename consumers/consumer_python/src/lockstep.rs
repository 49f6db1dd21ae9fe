//! A place in lockstep: ticks one by one, each acknowledged when the next is asked for.

use std::sync::Arc;
use std::time::Duration;

use consumer_kit::{LockstepError, Ready, Steps};
use parking_lot::Mutex;
use pyo3::prelude::*;

use schema_bus::names;

use crate::errors;
use crate::fork::{self, Owned};
use crate::place::Place;
use crate::wait::{Failure, Timeout, Waker};
use crate::world::{SnapshotBytes, snapshot_bytes};

/// A participant of lockstep: the simulator begins no tick before the last one is acknowledged.
#[pyclass(frozen, module = "gantry._native")]
pub struct Lockstep {
    // Ports go before their node.
    steps: Mutex<Option<Owned<Steps>>>,
    /// The event of every tick.
    begun: Waker,
    /// The event after which a tick may be complete, and its name.
    complete: Waker,
    event: Mutex<&'static str>,
    place: Arc<Place>,
    name: String,
}

/// What was found, if the simulator could be asked: one that is ending or was restarted cannot.
fn asked<T: Default>(found: Result<T, LockstepError>) -> Result<T, Failure> {
    match found {
        Err(LockstepError::Bus(error)) => Err(error.into()),
        found => Ok(found.unwrap_or_default()),
    }
}

impl Lockstep {
    fn with<T>(&self, act: impl FnOnce(&mut Steps) -> Result<T, Failure>) -> Result<T, Failure> {
        act(self.steps.lock().as_mut().ok_or(Failure::Closed)?)
    }

    fn raise(&self, failure: Failure) -> PyErr {
        failure.raise(&format!("lockstep {:?}", self.name))
    }

    fn waker(&self, ready: Ready) -> &Waker {
        match ready {
            Ready::Begun => &self.begun,
            Ready::Complete => &self.complete,
        }
    }

    /// A restarted simulator may tell of complete ticks by another event.
    fn listen_to(&self, event: Option<&'static str>) -> Result<(), Failure> {
        let mut heard = self.event.lock();
        if let Some(event) = event.filter(|event| *event != *heard) {
            self.complete.replace(self.place.bus().listener(event)?);
            *heard = event;
        }
        Ok(())
    }
}

/// What is waited for of a tick.
fn ready(is_whole: bool) -> Ready {
    match is_whole {
        true => Ready::Complete,
        false => Ready::Begun,
    }
}

#[pymethods]
impl Lockstep {
    /// Joins as `name`.
    #[new]
    fn join(py: Python<'_>, domain: &str, name: &str, timeout: f64) -> PyResult<Self> {
        let place = Place::of(domain)?;
        let wait = Timeout::new(Some(timeout))?.left().unwrap_or(Duration::MAX);
        let steps = py
            .detach(|| Steps::join_on(place.bus(), name, wait))
            .map_err(errors::lockstep)?;
        let event = steps.event().unwrap_or(names::WORLD_SNAPSHOT);
        let listener = |event: &str| {
            py.detach(|| place.bus().listener(event))
                .map_err(errors::bus)
        };
        Ok(Lockstep {
            begun: Waker::new(listener(names::WORLD_SNAPSHOT)?),
            complete: Waker::new(listener(event)?),
            event: Mutex::new(event),
            steps: Mutex::new(Some(Owned::new(steps))),
            place,
            name: name.to_owned(),
        })
    }

    /// Acknowledges the last tick, and waits up to `timeout` seconds for the next, with `is_whole`
    /// until every frame of it was sent: tick, epoch, header and records of its snapshot.
    fn next<'py>(
        &self,
        py: Python<'py>,
        timeout: Option<f64>,
        is_whole: bool,
    ) -> PyResult<Option<(u64, u64, SnapshotBytes<'py>)>> {
        fork::check()?;
        let timeout = Timeout::new(timeout)?;
        py.detach(|| self.with(|steps| Ok(steps.acknowledge()?)))
            .map_err(|failure| self.raise(failure))?;
        let ready = ready(is_whole);
        let found = (self.waker(ready)).until(py, timeout, Duration::ZERO, || {
            let (found, event) = self.with(|steps| {
                let found = asked(steps.look(self.place.bus(), ready))?;
                Ok((found, steps.event()))
            })?;
            self.listen_to(event)?;
            Ok(found)
        })?;
        let world = found.map_err(|failure| self.raise(failure))?;
        Ok(world.map(|world| {
            let header = &world.header;
            (header.tick, header.epoch, snapshot_bytes(py, &world))
        }))
    }

    /// Waits up to `timeout` seconds until every frame of the last tick was sent; whether that is so.
    fn wait_complete(&self, py: Python<'_>, timeout: f64) -> PyResult<bool> {
        fork::check()?;
        let timeout = Timeout::new(Some(timeout))?;
        let found = (self.complete).until(py, timeout, Duration::ZERO, || {
            self.with(|steps| Ok(asked(steps.is_complete())?.then_some(())))
        })?;
        let found = found.map_err(|failure| self.raise(failure))?;
        Ok(found.is_some())
    }

    /// Acknowledges the last tick now.
    fn acknowledge(&self, py: Python<'_>) -> PyResult<()> {
        fork::check()?;
        py.detach(|| self.with(|steps| Ok(steps.acknowledge()?)))
            .map_err(|failure| self.raise(failure))
    }

    /// First tick that waits for this participant; `None` while it has no place.
    #[getter]
    fn first_tick(&self) -> Option<u64> {
        self.steps.lock().as_ref()?.first_tick()
    }

    /// Number of times that the simulator was restarted.
    #[getter]
    fn restarts(&self) -> u64 {
        let steps = self.steps.lock();
        steps.as_ref().map_or(0, |steps| steps.restarts())
    }

    /// Descriptor that becomes readable when a tick may have begun, with `is_whole` when one may be
    /// complete.
    fn fileno(&self, py: Python<'_>, is_whole: bool) -> PyResult<i32> {
        self.waker(ready(is_whole)).fileno(py)
    }

    /// Leaves lockstep: the simulator waits no longer.
    fn close(&self, py: Python<'_>) {
        if fork::check().is_ok() {
            py.detach(|| drop(self.steps.lock().take()));
            self.begun.close(py);
            self.complete.close(py);
        }
    }
}
