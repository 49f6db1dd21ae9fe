//! A place in lockstep: ticks one by one, each acknowledged when the next is asked for.

use std::sync::Arc;
use std::time::{Duration, Instant};

use consumer_kit::{Lockstep as Participant, LockstepError, WorldAt};
use parking_lot::Mutex;
use pyo3::prelude::*;

use crate::errors;
use crate::fork::{self, Owned};
use crate::place::Place;
use crate::wait::{Failure, Timeout, Waker};
use crate::world::{SnapshotBytes, Snapshots, snapshot_bytes};

/// Between attempts to join a simulator that was restarted, and the time for each.
const JOIN_EVERY: Duration = Duration::from_secs(1);

/// A participant of lockstep: the simulator begins no tick before the last one is acknowledged.
#[pyclass(frozen, module = "gantry._native")]
pub struct Lockstep {
    // Ports go before their node.
    state: Mutex<Option<State>>,
    snapshots: Snapshots,
    /// The event after which a tick may be complete.
    complete: Waker,
    place: Arc<Place>,
    name: String,
}

struct State {
    /// `None` between the end of a simulator and joining the next.
    participant: Option<Owned<Participant>>,
    /// Epoch and tick that were given out last.
    last: (u64, u64),
    /// Whether the last tick still has to be acknowledged.
    owed: bool,
    next_join: Instant,
    restarts: u64,
}

impl State {
    fn acknowledge(&mut self) -> Result<(), Failure> {
        let owed = std::mem::take(&mut self.owed);
        match &self.participant {
            Some(participant) if owed && participant.epoch() == self.last.0 => {
                Ok(participant.ack(self.last.1)?)
            }
            _ => Ok(()),
        }
    }
}

impl Lockstep {
    fn with<T>(&self, act: impl FnOnce(&mut State) -> Result<T, Failure>) -> Result<T, Failure> {
        act(self.state.lock().as_mut().ok_or(Failure::Closed)?)
    }

    fn raise(&self, failure: Failure) -> PyErr {
        failure.raise(&format!("lockstep {:?}", self.name))
    }

    /// The newest snapshot if it is of a tick that waits for this participant and was not given out
    /// yet. Joins again if the simulator was restarted.
    fn look(&self) -> Result<Option<Arc<WorldAt>>, Failure> {
        let Some(world) = self.snapshots.look()? else {
            return Ok(None);
        };
        let now = (world.header.epoch, world.header.tick);
        self.with(|state| {
            let is_lost = |participant: &Owned<Participant>| participant.epoch() != now.0;
            if state.participant.as_ref().is_some_and(is_lost) {
                state.participant = None;
                state.restarts += 1;
            }
            if state.participant.is_none() {
                self.rejoin(state)?;
            }
            let Some(participant) = &state.participant else {
                return Ok(None);
            };
            let waits = participant.epoch() == now.0 && now.1 >= participant.first_tick();
            if !waits || now == state.last {
                return Ok(None);
            }
            (state.last, state.owed) = (now, true);
            Ok(Some(world))
        })
    }

    fn rejoin(&self, state: &mut State) -> Result<(), Failure> {
        if Instant::now() < state.next_join {
            return Ok(());
        }
        state.next_join = Instant::now() + JOIN_EVERY;
        match Participant::join(self.place.bus(), &self.name, JOIN_EVERY) {
            Ok(participant) => state.participant = Some(Owned::new(participant)),
            Err(LockstepError::Bus(error)) => return Err(error.into()),
            // The new simulator is not ready yet, or still counts the old place.
            Err(_) => {}
        }
        Ok(())
    }
}

#[pymethods]
impl Lockstep {
    /// Joins as `name`.
    #[new]
    fn join(py: Python<'_>, domain: &str, name: &str, timeout: f64) -> PyResult<Self> {
        let place = Place::of(domain)?;
        let wait = Timeout::new(Some(timeout))?.left().unwrap_or(Duration::MAX);
        // Snapshots first, so that the first tick is among them.
        let exists = py.detach(|| place.bus().exists(schema_bus::names::WORLD_SNAPSHOT));
        let snapshots = exists.then(|| Snapshots::follow(py, &place)).transpose()?;
        let participant = py
            .detach(|| Participant::join(place.bus(), name, wait))
            .map_err(errors::lockstep)?;
        let complete = py
            .detach(|| place.bus().listener(participant.event()))
            .map_err(errors::bus)?;
        let snapshots = match snapshots {
            Some(snapshots) => snapshots,
            None => Snapshots::follow(py, &place)?,
        };
        Ok(Lockstep {
            state: Mutex::new(Some(State {
                participant: Some(Owned::new(participant)),
                last: (0, 0),
                owed: false,
                next_join: Instant::now(),
                restarts: 0,
            })),
            snapshots,
            complete: Waker::new(complete),
            place,
            name: name.to_owned(),
        })
    }

    /// Acknowledges the last tick, and waits up to `timeout` seconds for the next: tick, epoch,
    /// header and records of its snapshot.
    fn next<'py>(
        &self,
        py: Python<'py>,
        timeout: Option<f64>,
    ) -> PyResult<Option<(u64, u64, SnapshotBytes<'py>)>> {
        fork::check()?;
        let timeout = Timeout::new(timeout)?;
        py.detach(|| self.with(State::acknowledge))
            .map_err(|failure| self.raise(failure))?;
        let waker = self.snapshots.waker();
        let found = waker.until(py, timeout, Duration::ZERO, || self.look())?;
        let world = found.map_err(|failure| self.raise(failure))?;
        Ok(world.map(|world| {
            let header = &world.header;
            (header.tick, header.epoch, snapshot_bytes(py, &world))
        }))
    }

    /// Waits up to `timeout` seconds until every frame of `tick` was sent; whether that is so.
    fn wait_complete(&self, py: Python<'_>, tick: u64, timeout: f64) -> PyResult<bool> {
        fork::check()?;
        let timeout = Timeout::new(Some(timeout))?;
        let found = (self.complete).until(py, timeout, Duration::ZERO, || {
            self.with(|state| {
                let Some(participant) = &mut state.participant else {
                    return Ok(None);
                };
                if participant.epoch() != state.last.0 {
                    // The simulator was restarted: no more frames of that tick will come.
                    return Ok(Some(()));
                }
                match participant.is_complete(tick) {
                    Ok(is_complete) => Ok(is_complete.then_some(())),
                    Err(LockstepError::Bus(error)) => Err(error.into()),
                    // The simulator is ending, or was restarted.
                    Err(_) => Ok(None),
                }
            })
        })?;
        let found = found.map_err(|failure| self.raise(failure))?;
        Ok(found.is_some())
    }

    /// Acknowledges the last tick now.
    fn acknowledge(&self, py: Python<'_>) -> PyResult<()> {
        fork::check()?;
        py.detach(|| self.with(State::acknowledge))
            .map_err(|failure| self.raise(failure))
    }

    /// First tick that waits for this participant; `None` while it has no place.
    #[getter]
    fn first_tick(&self) -> Option<u64> {
        let state = self.state.lock();
        let participant = state.as_ref()?.participant.as_ref()?;
        Some(participant.first_tick())
    }

    /// Number of times that the simulator was restarted and joined again.
    #[getter]
    fn restarts(&self) -> u64 {
        self.state.lock().as_ref().map_or(0, |state| state.restarts)
    }

    /// Descriptor that becomes readable when a tick may have ended.
    fn fileno(&self, py: Python<'_>) -> PyResult<i32> {
        self.snapshots.waker().fileno(py)
    }

    /// Leaves lockstep: the simulator waits no longer.
    fn close(&self, py: Python<'_>) {
        if fork::check().is_ok() {
            py.detach(|| drop(self.state.lock().take()));
            self.snapshots.waker().close(py);
            self.complete.close(py);
        }
    }
}
