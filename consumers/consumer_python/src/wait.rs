//! Waiting for an event with Python's global lock released, in any number of threads.
//!
//! The order is always: take pending notifications, look for samples, sleep until the next
//! notification. A sample sent after the look notifies again, so none is slept through. Pending
//! notifications are taken before the next sleep instead of after it, so that a woken reader has its
//! sample two system calls earlier.

use std::os::fd::{AsFd as _, AsRawFd as _};
use std::time::{Duration, Instant};

use parking_lot::Mutex;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use consumer_gpu::GpuError;
use schema_bus::{BusError, Listener};

use crate::fork::Owned;
use crate::{errors, fork};

/// Longest single sleep, so that Ctrl-C takes effect soon.
const SLICE: Duration = Duration::from_millis(100);

/// Until when a call may wait.
#[derive(Clone, Copy, Debug)]
pub struct Timeout(Option<Instant>);

impl Timeout {
    /// `secs` from now on; `None` and infinity have no limit, and less than 0 is 0.
    pub fn new(secs: Option<f64>) -> PyResult<Self> {
        let Some(secs) = secs else {
            return Ok(Timeout(None));
        };
        if secs.is_nan() {
            return Err(PyValueError::new_err(
                "timeout is NaN; give seconds, or None for no limit",
            ));
        }
        let wait = Duration::try_from_secs_f64(secs.max(0.0)).ok();
        Ok(Timeout(
            wait.and_then(|wait| Instant::now().checked_add(wait)),
        ))
    }

    /// Time that is left; `None` without a limit.
    pub fn left(&self) -> Option<Duration> {
        self.0
            .map(|end| end.saturating_duration_since(Instant::now()))
    }

    fn slice(&self) -> Duration {
        self.left().map_or(SLICE, |left| left.min(SLICE))
    }
}

/// Raises `KeyboardInterrupt` after Ctrl-C, and whatever other signal handlers raise.
pub fn signals() -> PyResult<()> {
    Python::attach(|py| py.check_signals())
}

/// Why looking for a sample failed.
#[derive(Debug)]
pub enum Failure {
    /// The port was closed, by this or another thread.
    Closed,
    /// The bus failed.
    Bus(BusError),
    /// A GPU cannot be used.
    Gpu(GpuError),
}

impl From<GpuError> for Failure {
    fn from(error: GpuError) -> Self {
        match error {
            GpuError::Bus(error) => Failure::Bus(error),
            error => Failure::Gpu(error),
        }
    }
}

impl From<BusError> for Failure {
    fn from(error: BusError) -> Self {
        Failure::Bus(error)
    }
}

impl Failure {
    /// As an exception about `name`.
    pub fn raise(self, name: &str) -> PyErr {
        match self {
            Failure::Closed => errors::gantry(format!("{name} is closed")),
            Failure::Bus(error) => errors::bus(error),
            Failure::Gpu(error) => errors::gpu(error),
        }
    }
}

/// The event that wakes a reader.
#[derive(Debug)]
pub struct Waker {
    listener: Mutex<Option<Owned<Listener>>>,
    /// The event to wait for from the next sleep on, if it is another.
    next: Mutex<Option<Owned<Listener>>>,
}

impl Waker {
    /// A waker on an open event.
    pub fn new(listener: Listener) -> Self {
        Waker {
            listener: Mutex::new(Some(Owned::new(listener))),
            next: Mutex::new(None),
        }
    }

    /// Waits for another event from the next sleep on. A thread may sleep meanwhile.
    pub fn replace(&self, listener: Listener) {
        *self.next.lock() = Some(Owned::new(listener));
    }

    fn take_over_next(&self, listener: &mut Option<Owned<Listener>>) {
        if let (Some(listener), Some(next)) = (listener, self.next.lock().take()) {
            *listener = next;
        }
    }

    /// Leaves the event, at the latest after the sleep of another thread.
    pub fn close(&self, py: Python<'_>) {
        py.detach(|| {
            drop(self.listener.lock().take());
            drop(self.next.lock().take());
        });
    }

    /// Descriptor that is readable while notifications are pending, for event loops.
    pub fn fileno(&self, py: Python<'_>) -> PyResult<i32> {
        fork::check()?;
        py.detach(|| {
            let mut listener = self.listener.lock();
            self.take_over_next(&mut listener);
            listener.as_ref().map(|it| it.as_fd().as_raw_fd())
        })
        .ok_or_else(|| errors::gantry("there is nothing to wait for: it is closed"))
    }

    /// Calls `look` until it finds something or the time is over; sleeps in between. For the first
    /// `busy` it looks again and again instead.
    ///
    /// `look` is called without Python's global lock and must not want it.
    pub fn until<T: Send>(
        &self,
        py: Python<'_>,
        timeout: Timeout,
        busy: Duration,
        mut look: impl FnMut() -> Result<Option<T>, Failure> + Send,
    ) -> PyResult<Result<Option<T>, Failure>> {
        if !busy.is_zero() {
            let busy = timeout.left().map_or(busy, |left| left.min(busy));
            let found = py.detach(|| poll(busy, &mut look));
            if !matches!(found, Ok(None)) {
                return Ok(found);
            }
        }
        loop {
            let found = py.detach(|| self.turn(timeout, &mut look));
            if !matches!(found, Ok(None)) || timeout.left().is_some_and(|left| left.is_zero()) {
                return Ok(found);
            }
            py.check_signals()?;
        }
    }

    /// Looks, sleeps once, and looks again. One thread sleeps, the others wait for it; so each of
    /// them looks between its own taking of notifications and its own sleep.
    fn turn<T>(
        &self,
        timeout: Timeout,
        look: &mut impl FnMut() -> Result<Option<T>, Failure>,
    ) -> Result<Option<T>, Failure> {
        let Some(mut listener) = self.listener.try_lock_for(timeout.slice()) else {
            return look();
        };
        self.take_over_next(&mut listener);
        let listener = listener.as_ref().ok_or(Failure::Closed)?;
        listener.drain()?;
        let found = look()?;
        if found.is_some() {
            return Ok(found);
        }
        listener.wait_pending(timeout.slice());
        look()
    }
}

fn poll<T>(
    busy: Duration,
    look: &mut impl FnMut() -> Result<Option<T>, Failure>,
) -> Result<Option<T>, Failure> {
    let end = Instant::now() + busy;
    loop {
        let found = look()?;
        if found.is_some() || Instant::now() >= end {
            return Ok(found);
        }
        std::thread::yield_now();
    }
}
