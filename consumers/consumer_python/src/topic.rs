//! Reading a topic of frames or of results.

use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyString;

use consumer_gpu::{Device, FrameOnGpu, GpuError, GpuResults, GpuTopic, ResultOnGpu};
use consumer_kit::{Sample, SampleReader, Take};
use schema_bus::{Bus, Frame, ReaderCounts};

use crate::errors;
use crate::fork::{self, Owned};
use crate::frame::{Blank, Like};
use crate::place::Place;
use crate::result::{About, Outcome};
use crate::wait::{Failure, Timeout, Waker};

/// The reading end of a topic, for any number of threads: each sample goes to one of them.
#[pyclass(frozen, subclass, module = "gantry._native")]
pub struct Reader {
    // Ports go before their node.
    port: Mutex<Option<Owned<Port>>>,
    waker: Waker,
    about: Option<Py<About>>,
    /// For the next frame, and what the last one was like.
    blank: Mutex<Option<Blank>>,
    like: Mutex<Option<Like>>,
    topic: Py<PyString>,
    full_name: String,
    /// Why samples are uploaded since the last look, which is to be said.
    new_fallback: Mutex<Option<String>>,
    are_frames_on_gpu: bool,
    place: Arc<Place>,
}

/// Where a topic is read.
enum Port {
    Here(SampleReader),
    OnGpu(Box<GpuTopic>),
    ResultsOnGpu(Box<GpuResults>),
}

/// What was taken from it.
enum Found {
    Here(Sample),
    OnGpu(FrameOnGpu),
    ResultOnGpu(ResultOnGpu),
}

impl Port {
    fn open_on_gpu(bus: &Bus, topic: &str, device: Device) -> Result<Port, GpuError> {
        Ok(match bus.result_kind(topic) {
            Some(_) => Port::ResultsOnGpu(Box::new(GpuResults::open(bus, topic, device)?)),
            None => Port::OnGpu(Box::new(GpuTopic::open(bus, topic, device)?)),
        })
    }

    /// Name of the event that announces its samples on a GPU, and why they do not stay there.
    fn on_gpu(&self) -> Option<(&str, Option<&str>)> {
        match self {
            Port::OnGpu(topic) => Some((topic.event(), topic.fallback())),
            Port::ResultsOnGpu(topic) => Some((topic.event(), topic.fallback())),
            _ => None,
        }
    }

    /// Whether that may have changed since the last call.
    fn has_moved(&mut self) -> bool {
        match self {
            Port::OnGpu(topic) => topic.has_moved(),
            Port::ResultsOnGpu(topic) => topic.has_moved(),
            Port::Here(_) => false,
        }
    }

    fn take(&mut self, bus: &Bus, take: Take) -> Result<Option<Found>, Failure> {
        Ok(match (self, take) {
            (Port::OnGpu(topic), Take::All) => topic.next(bus)?.map(Found::OnGpu),
            (Port::OnGpu(topic), Take::Newest) => topic.latest(bus)?.map(Found::OnGpu),
            (Port::ResultsOnGpu(topic), Take::All) => topic.next(bus)?.map(Found::ResultOnGpu),
            (Port::ResultsOnGpu(topic), Take::Newest) => topic.latest(bus)?.map(Found::ResultOnGpu),
            (Port::Here(reader), take) => reader.take(take)?.map(Found::Here),
        })
    }

    fn counts(&self) -> ReaderCounts {
        match self {
            Port::Here(reader) => reader.counts(),
            Port::OnGpu(topic) => topic.counts(),
            Port::ResultsOnGpu(topic) => topic.counts(),
        }
    }

    fn has_writer(&self) -> bool {
        match self {
            Port::Here(reader) => reader.has_writer(),
            Port::OnGpu(topic) => topic.has_writer(),
            Port::ResultsOnGpu(topic) => topic.has_writer(),
        }
    }
}

/// The device of this name.
fn device_of(name: &str) -> PyResult<Device> {
    let number = name.strip_prefix("cuda:").map(str::parse);
    match (name, number) {
        ("cuda", _) => Ok(Device::Cuda),
        ("mapped", _) => Ok(Device::Mapped),
        (_, Some(Ok(number))) => Ok(Device::CudaNumber(number)),
        _ => Err(PyValueError::new_err(format!(
            "device is {name:?}; it must be \"cuda\", \"cuda:N\", or, for memory of a software adapter, \"mapped\""
        ))),
    }
}

impl Reader {
    fn open_on_gpu(
        py: Python<'_>,
        domain: &str,
        topic: &str,
        device: Device,
        place: Arc<Place>,
    ) -> PyResult<Self> {
        let opened = py.detach(|| -> Result<_, GpuError> {
            let bus = place.bus();
            let port = Port::open_on_gpu(bus, topic, device)?;
            let (event, _) = port.on_gpu().unwrap_or((topic, None));
            let waker = Waker::new(bus.listener(event)?);
            let about = match &port {
                Port::ResultsOnGpu(_) => Some(About::follow(&place, topic)?),
                _ => None,
            };
            Ok((waker, port, about))
        });
        let (waker, port, about) = opened.map_err(|error| Failure::from(error).raise(topic))?;
        Ok(Reader {
            new_fallback: Mutex::new(None),
            are_frames_on_gpu: matches!(port, Port::OnGpu(_)),
            port: Mutex::new(Some(Owned::new(port))),
            waker,
            about: about.map(|about| Py::new(py, about)).transpose()?,
            blank: Mutex::new(None),
            like: Mutex::new(None),
            topic: PyString::new(py, topic).unbind(),
            full_name: format!("{domain}/{topic}"),
            place,
        })
    }

    fn look(&self, take: Take) -> Result<Option<Found>, Failure> {
        let mut port = self.port.lock();
        let port: &mut Port = port.as_mut().ok_or(Failure::Closed)?;
        let found = port.take(self.place.bus(), take);
        if port.has_moved()
            && let Some((event, fallback)) = port.on_gpu()
        {
            // Samples come another way, which another event announces.
            self.waker.replace(self.place.bus().listener(event)?);
            *self.new_fallback.lock() = fallback.map(str::to_owned);
        }
        found
    }

    /// Warns that samples are uploaded since another process writes them.
    fn warn_of_fallback(&self, py: Python<'_>) -> PyResult<()> {
        let Some(why) = self.new_fallback.lock().take() else {
            return Ok(());
        };
        py.import("gantry._topic")?
            .getattr("_say_fallback")?
            .call1((&self.topic, why, 1))?;
        Ok(())
    }

    fn finish(
        &self,
        py: Python<'_>,
        found: Result<Option<Found>, Failure>,
    ) -> PyResult<Option<Py<PyAny>>> {
        let object = match found {
            Ok(None) => return Ok(None),
            Ok(Some(Found::Here(Sample::Frame(frame)))) => self.show(py, frame),
            Ok(Some(Found::OnGpu(frame))) => {
                self.warn_of_fallback(py)?;
                let blank = self.blank.lock().take();
                let blank = blank.map_or_else(|| Blank::new(py, &self.topic, None), Ok)?;
                Ok(blank.fill_on_gpu(frame, &self.place))
            }
            Ok(Some(Found::ResultOnGpu(result))) => {
                self.warn_of_fallback(py)?;
                let about = self.about_of_results();
                Outcome::on_gpu(py, result, &self.topic, about, &self.place)
            }
            Ok(Some(Found::Here(Sample::Result(result)))) => {
                let about = self.about_of_results();
                Outcome::shared(py, result, &self.topic, about, &self.place)
            }
            Err(failure) => Err(failure.raise(&format!("topic {:?}", self.full_name))),
        };
        object.map(Some)
    }

    fn about_of_results(&self) -> &Py<About> {
        self.about
            .as_ref()
            .expect("a topic of results was opened with its description")
    }

    fn show(&self, py: Python<'_>, frame: Frame) -> PyResult<Py<PyAny>> {
        let blank = self.blank.lock().take();
        let blank = blank.map_or_else(|| Blank::new(py, &self.topic, None), Ok)?;
        let (object, like) = blank.fill(py, frame, &self.place)?;
        *self.like.lock() = Some(like);
        Ok(object)
    }

    /// Makes the objects of the next frame while there is time.
    fn prepare(&self, py: Python<'_>) -> PyResult<()> {
        let like = *self.like.lock();
        if (like.is_some() || self.are_frames_on_gpu) && self.blank.lock().is_none() {
            let blank = Blank::new(py, &self.topic, like)?;
            let before = self.blank.lock().replace(blank);
            drop(before);
        }
        Ok(())
    }

    fn wait(
        &self,
        py: Python<'_>,
        take: Take,
        timeout: Option<f64>,
        busy_wait: f64,
    ) -> PyResult<Option<Py<PyAny>>> {
        fork::check()?;
        let first = self.look(take);
        if !matches!(first, Ok(None)) {
            return self.finish(py, first);
        }
        let timeout = Timeout::new(timeout)?;
        let busy = Duration::try_from_secs_f64(busy_wait).map_err(|_| {
            PyValueError::new_err(format!(
                "busy_wait is {busy_wait}; it must be a number of seconds from 0 on"
            ))
        })?;
        self.prepare(py)?;
        let found = self.waker.until(py, timeout, busy, || self.look(take))?;
        self.finish(py, found)
    }
}

#[pymethods]
impl Reader {
    #[new]
    #[pyo3(signature = (domain, topic, device=None))]
    fn open(py: Python<'_>, domain: &str, topic: &str, device: Option<&str>) -> PyResult<Self> {
        let place = Place::of(domain)?;
        if let Some(device) = device {
            return Reader::open_on_gpu(py, domain, topic, device_of(device)?, place);
        }
        let opened = py.detach(|| {
            let bus = place.bus();
            // The event first, so that no sample comes between the two.
            let waker = Waker::new(bus.listener(topic)?);
            let port = SampleReader::open(bus, topic)?;
            let about = match &port {
                SampleReader::Results(_) => Some(About::follow(&place, topic)?),
                _ => None,
            };
            Ok((waker, port, about))
        });
        let (waker, port, about) = opened.map_err(errors::bus)?;
        Ok(Reader {
            port: Mutex::new(Some(Owned::new(Port::Here(port)))),
            waker,
            about: about.map(|about| Py::new(py, about)).transpose()?,
            blank: Mutex::new(None),
            like: Mutex::new(None),
            topic: PyString::new(py, topic).unbind(),
            full_name: format!("{domain}/{topic}"),
            new_fallback: Mutex::new(None),
            are_frames_on_gpu: false,
            place,
        })
    }

    /// Why frames are uploaded to the device although they were asked for on it; None if they stay
    /// on it, or were not. It changes when a process on another GPU writes them.
    #[getter]
    fn fallback(&self) -> Option<String> {
        let port = self.port.lock();
        let (_, fallback) = port.as_ref()?.on_gpu()?;
        fallback.map(str::to_owned)
    }

    /// Name without the domain.
    #[getter]
    fn name(&self, py: Python<'_>) -> Py<PyString> {
        self.topic.clone_ref(py)
    }

    /// Takes the oldest sample that waits, or returns None if none does.
    ///
    /// Raises `BorrowLimitError` if too many samples are held, `FrameFormatError` or
    /// `SchemaVersionError` for one that breaks the contract; the next call continues after it.
    fn poll(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        fork::check()?;
        self.finish(py, self.look(Take::All))
    }

    /// Takes the next sample; waits up to `timeout` seconds for it (None: without a limit).
    ///
    /// Returns None if none arrived in time. For the first `busy_wait` seconds the reader looks again
    /// and again instead of sleeping: it has the frame some 50 µs earlier, because it need not be
    /// woken, but keeps a processor busy. Other threads run meanwhile. Raises as `poll`.
    #[pyo3(signature = (timeout=None, busy_wait=0.0))]
    fn next(
        &self,
        py: Python<'_>,
        timeout: Option<f64>,
        busy_wait: f64,
    ) -> PyResult<Option<Py<PyAny>>> {
        self.wait(py, Take::All, timeout, busy_wait)
    }

    /// Takes the newest sample, and waits as `next` does if there is none.
    ///
    /// Older ones are dropped and counted in `counts.skipped`. Raises as `poll`.
    #[pyo3(signature = (timeout=None, busy_wait=0.0))]
    fn latest(
        &self,
        py: Python<'_>,
        timeout: Option<f64>,
        busy_wait: f64,
    ) -> PyResult<Option<Py<PyAny>>> {
        self.wait(py, Take::Newest, timeout, busy_wait)
    }

    /// Type of the topic's results; None for a topic of frames, or if closed.
    #[getter]
    fn result(&self) -> Option<&'static str> {
        match &**self.port.lock().as_ref()? {
            Port::Here(SampleReader::Frames(_)) | Port::OnGpu(_) => None,
            Port::Here(SampleReader::Results(reader)) => Some(reader.kind().name()),
            Port::ResultsOnGpu(topic) => Some(topic.kind().name()),
        }
    }

    /// Description of the topic's results; None for a topic of frames.
    #[getter]
    fn about(&self, py: Python<'_>) -> Option<Py<About>> {
        self.about.as_ref().map(|about| about.clone_ref(py))
    }

    /// Samples taken, skipped, lost and refused, and restarts of the writer; None if closed.
    fn numbers(&self) -> Option<(u64, u64, u64, u64, u64)> {
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
    #[getter]
    fn has_writer(&self) -> bool {
        let port = self.port.lock();
        port.as_ref().is_some_and(|port| port.has_writer())
    }

    /// Returns a descriptor that can be read when a sample may wait, for select and poll.
    ///
    /// `next(timeout=0)` takes the wake-ups. Raises `GantryError` if the topic is closed.
    fn fileno(&self, py: Python<'_>) -> PyResult<i32> {
        self.waker.fileno(py)
    }

    /// Closes the ports. Samples that are held stay.
    fn close_ports(&self, py: Python<'_>) {
        if fork::check().is_ok() {
            let port = self.port.lock().take();
            py.detach(|| drop(port));
            self.waker.close(py);
        }
    }
}
