//! Reading a topic of frames or of results.

use std::sync::Arc;
use std::time::Duration;

use consumer_kit::FollowedDocument;
use parking_lot::Mutex;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use schema_bus::{
    Bus, BusError, Frame, FrameReader, ReaderCounts, ResultReader, ResultSample, names,
};

use crate::errors;
use crate::fork::{self, Owned};
use crate::frame::Sample;
use crate::place::Place;
use crate::result::Outcome;
use crate::wait::{Failure, Timeout, Waker};

/// The reading end of a topic, for any number of threads: each sample goes to one of them.
#[pyclass(frozen, module = "gantry._native")]
pub struct Reader {
    // Ports go before their node.
    port: Mutex<Option<Owned<Port>>>,
    waker: Waker,
    place: Arc<Place>,
    topic: String,
}

/// What a topic carries.
enum Port {
    Frames(FrameReader),
    Results(ResultReader, FollowedDocument),
}

/// What was taken from it.
enum Found {
    Frame(Frame),
    Result(ResultSample),
}

/// What Python gets.
#[derive(IntoPyObject)]
pub enum Taken {
    Frame(Sample),
    Result(Outcome),
}

impl Port {
    fn open(bus: &Bus, topic: &str) -> Result<Port, BusError> {
        match bus.frame_reader(topic) {
            Ok(reader) => Ok(Port::Frames(reader)),
            // It exists, and carries something else.
            Err(error @ BusError::OtherKind { .. }) => match bus.result_reader(topic) {
                Ok(reader) => {
                    // Before the first result is taken: the writer sends the description to new
                    // readers before its next result.
                    let mut about = FollowedDocument::new(names::about(topic));
                    about.changed(bus)?;
                    Ok(Port::Results(reader, about))
                }
                Err(BusError::OtherKind { .. }) => Err(error),
                Err(other) => Err(other),
            },
            Err(other) => Err(other),
        }
    }

    fn take(&mut self, which: Which) -> Result<Option<Found>, BusError> {
        Ok(match (self, which) {
            (Port::Frames(reader), Which::Oldest) => reader.next()?.map(Found::Frame),
            (Port::Frames(reader), Which::Newest) => reader.latest()?.map(Found::Frame),
            (Port::Results(reader, _), Which::Oldest) => reader.next()?.map(Found::Result),
            (Port::Results(reader, _), Which::Newest) => reader.latest()?.map(Found::Result),
        })
    }

    fn counts(&self) -> ReaderCounts {
        match self {
            Port::Frames(reader) => reader.counts(),
            Port::Results(reader, _) => reader.counts(),
        }
    }

    fn has_writer(&self) -> bool {
        match self {
            Port::Frames(reader) => reader.has_writer(),
            Port::Results(reader, _) => reader.has_writer(),
        }
    }
}

/// Which sample to take if several wait.
#[derive(Clone, Copy)]
enum Which {
    Oldest,
    Newest,
}

impl Reader {
    fn look(&self, which: Which) -> Result<Option<Found>, Failure> {
        let mut port = self.port.lock();
        Ok(port.as_mut().ok_or(Failure::Closed)?.take(which)?)
    }

    fn finish(&self, found: Result<Option<Found>, Failure>) -> PyResult<Option<Taken>> {
        let place = &self.place;
        match found {
            Ok(found) => Ok(found.map(|found| match found {
                Found::Frame(frame) => Taken::Frame(Sample::shared(frame, place)),
                Found::Result(result) => Taken::Result(Outcome::shared(result, place)),
            })),
            Err(failure) => Err(failure.raise(&self.name())),
        }
    }

    fn name(&self) -> String {
        format!("topic \"{}/{}\"", self.place.bus().domain(), self.topic)
    }

    fn wait(
        &self,
        py: Python<'_>,
        which: Which,
        timeout: Option<f64>,
        busy_wait: f64,
    ) -> PyResult<Option<Taken>> {
        fork::check()?;
        let first = self.look(which);
        if !matches!(first, Ok(None)) {
            return self.finish(first);
        }
        let timeout = Timeout::new(timeout)?;
        let busy = Duration::try_from_secs_f64(busy_wait).map_err(|_| {
            PyValueError::new_err(format!(
                "busy_wait is {busy_wait}; it must be a number of seconds from 0 on"
            ))
        })?;
        let found = self.waker.until(py, timeout, busy, || self.look(which))?;
        self.finish(found)
    }
}

#[pymethods]
impl Reader {
    /// Opens a topic without the domain in front.
    #[new]
    fn open(py: Python<'_>, domain: &str, topic: &str) -> PyResult<Self> {
        let place = Place::of(domain)?;
        let bus = place.bus();
        let opened = py.detach(|| {
            // The event first, so that no frame comes between the two.
            let waker = Waker::new(bus.listener(topic)?);
            Ok((waker, Port::open(bus, topic)?))
        });
        let (waker, port) = opened.map_err(errors::bus)?;
        Ok(Reader {
            port: Mutex::new(Some(Owned::new(port))),
            waker,
            place,
            topic: topic.to_owned(),
        })
    }

    /// Takes the oldest frame that waits, if any.
    fn poll(&self) -> PyResult<Option<Taken>> {
        fork::check()?;
        self.finish(self.look(Which::Oldest))
    }

    /// Takes the next frame; waits up to `timeout` seconds for it.
    fn next(
        &self,
        py: Python<'_>,
        timeout: Option<f64>,
        busy_wait: f64,
    ) -> PyResult<Option<Taken>> {
        self.wait(py, Which::Oldest, timeout, busy_wait)
    }

    /// Takes the newest frame; waits up to `timeout` seconds if there is none.
    fn latest(
        &self,
        py: Python<'_>,
        timeout: Option<f64>,
        busy_wait: f64,
    ) -> PyResult<Option<Taken>> {
        self.wait(py, Which::Newest, timeout, busy_wait)
    }

    /// Type of the topic's results; `None` for a topic of frames, or if closed.
    #[getter]
    fn result(&self) -> Option<&'static str> {
        match &**self.port.lock().as_ref()? {
            Port::Frames(_) => None,
            Port::Results(reader, _) => Some(reader.kind().name()),
        }
    }

    /// The description of a topic of results as JSON; `None` if none has come.
    fn about(&self, py: Python<'_>) -> PyResult<Option<String>> {
        fork::check()?;
        py.detach(|| match self.port.lock().as_deref_mut() {
            Some(Port::Results(_, about)) => {
                about.changed(self.place.bus())?;
                Ok(about.newest().map(|document| document.text.clone()))
            }
            _ => Ok(None),
        })
        .map_err(errors::bus)
    }

    /// Samples taken, skipped, lost and refused, and restarts of the writer; `None` if closed.
    fn counts(&self) -> Option<(u64, u64, u64, u64, u64)> {
        let port = self.port.lock();
        let counts = port.as_ref()?.counts();
        Some((
            counts.taken,
            counts.skipped,
            counts.lost,
            counts.refused,
            counts.restarts,
        ))
    }

    /// Whether a process writes the topic now.
    fn has_writer(&self) -> bool {
        let port = self.port.lock();
        port.as_ref().is_some_and(|port| port.has_writer())
    }

    /// Descriptor that becomes readable when a frame was sent.
    fn fileno(&self, py: Python<'_>) -> PyResult<i32> {
        self.waker.fileno(py)
    }

    /// Closes the topic. Frames that are held stay.
    fn close(&self, py: Python<'_>) {
        if fork::check().is_ok() {
            let port = self.port.lock().take();
            py.detach(|| drop(port));
            self.waker.close(py);
        }
    }
}
