//! A result in Python's hands: its header, its inputs, and parts of its body as arrays.

#![expect(unsafe_code, reason = "arrays over the memory of samples")]

use std::sync::Arc;

use numpy::{PyArrayDescr, PyArrayDescrMethods as _};
use parking_lot::Mutex;
use pyo3::exceptions::{PyRuntimeError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyBytes, PyString, PyType};

use consumer_gpu::ResultOnGpu;
use consumer_kit::FollowedDocument;
use schema_bus::{Answerable, Answered, BusError, ResultSample, names};
use schema_frames::{InputRecord, ResultHeader, ResultType};
use schema_types::MonoTime;

use crate::dlpack::{Array, Interface, stream_address};
use crate::errors;
use crate::fork::{self, Owned};
use crate::frame::Sample;
use crate::place::Place;
use crate::view::{self, Access, Memory, Shape};

/// Who keeps a payload in place.
#[expect(
    clippy::large_enum_variant,
    reason = "nearly all are samples, and a box would be one more allocation after waking"
)]
enum Keeper {
    /// A sample in shared memory; its port's node must outlive it.
    Shared(Mutex<Owned<ResultSample>>, Arc<Place>),
    /// Bytes, for example of a recording.
    /// With their topic, which may be empty.
    Bytes(Py<PyBytes>, String),
    /// On a GPU; its port's node must outlive it.
    OnGpu(Arc<Owned<ResultOnGpu>>, Arc<Place>),
}

/// The description of a topic of results.
#[pyclass(frozen, module = "gantry._native")]
pub struct About {
    // Ports go before their node.
    document: Mutex<Owned<FollowedDocument>>,
    place: Arc<Place>,
}

impl About {
    /// Follows the description of `topic`. Before the first result is taken: the writer sends it to
    /// new readers before its next result.
    pub fn follow(place: &Arc<Place>, topic: &str) -> Result<Self, BusError> {
        let mut document = FollowedDocument::new(names::about(topic));
        document.changed(place.bus())?;
        Ok(About {
            document: Mutex::new(Owned::new(document)),
            place: place.clone(),
        })
    }
}

#[pymethods]
impl About {
    /// The description as JSON; `None` if none has come.
    fn text(&self, py: Python<'_>) -> PyResult<Option<String>> {
        fork::check()?;
        py.detach(|| {
            let mut document = self.document.lock();
            document.changed(self.place.bus())?;
            Ok(document.newest().map(|newest| newest.text.clone()))
        })
        .map_err(errors::bus)
    }
}

/// The class that shows results to users.
static CLASS: PyOnceLock<Py<PyType>> = PyOnceLock::new();

/// Tells the class that shows results; it takes an `Outcome`, the topic and its `About`.
#[pyfunction]
pub fn set_result_class(py: Python<'_>, result_class: Py<PyType>) {
    // A second import finds the same class.
    let _ = CLASS.set(py, result_class);
}

/// A result: header, body and inputs. Arrays keep it.
#[pyclass(frozen, module = "gantry._native")]
pub struct Outcome {
    header: ResultHeader,
    kind: ResultType,
    body: Memory,
    inputs: Vec<InputRecord>,
    keeper: Keeper,
}

impl Outcome {
    /// A result of the bus as an object. Its port belongs to `place`.
    pub fn shared(
        py: Python<'_>,
        sample: ResultSample,
        topic: &Py<PyString>,
        about: &Py<About>,
        place: &Arc<Place>,
    ) -> PyResult<Py<PyAny>> {
        let body: &[u8] = &sample;
        let outcome = Outcome {
            header: *sample.header(),
            kind: sample.kind(),
            body: Memory {
                start: body.as_ptr().cast_mut(),
                len: body.len(),
            },
            inputs: sample.inputs().to_vec(),
            keeper: Keeper::Shared(Mutex::new(Owned::new(sample)), place.clone()),
        };
        outcome.shown(py, topic, about)
    }

    /// The same for a result on a GPU.
    pub fn on_gpu(
        py: Python<'_>,
        result: ResultOnGpu,
        topic: &Py<PyString>,
        about: &Py<About>,
        place: &Arc<Place>,
    ) -> PyResult<Py<PyAny>> {
        let outcome = Outcome {
            header: *result.header(),
            kind: result.kind(),
            // No array shows it.
            body: Memory {
                start: std::ptr::null_mut(),
                len: 0,
            },
            inputs: result.inputs().to_vec(),
            keeper: Keeper::OnGpu(Arc::new(Owned::new(result)), place.clone()),
        };
        outcome.shown(py, topic, about)
    }

    fn shown(self, py: Python<'_>, topic: &Py<PyString>, about: &Py<About>) -> PyResult<Py<PyAny>> {
        let class = CLASS
            .get(py)
            .ok_or_else(|| PyRuntimeError::new_err("import gantry, not gantry._native"))?;
        let made = class.bind(py).call1((self, topic, about))?;
        Ok(made.unbind())
    }

    /// The result, if it is on a GPU.
    fn there(&self) -> Option<&Arc<Owned<ResultOnGpu>>> {
        match &self.keeper {
            Keeper::OnGpu(result, _place) => Some(result),
            _ => None,
        }
    }

    /// Shows the sample as something that can be answered; `false` if it comes from bytes without a
    /// topic. One of a recording counts as taken when it was sent.
    pub fn answered(&self, act: impl FnOnce(&dyn Answerable)) -> bool {
        match &self.keeper {
            Keeper::Shared(sample, _place) => {
                act(&**sample.lock());
                true
            }
            Keeper::OnGpu(result, _place) => {
                act(&***result);
                true
            }
            Keeper::Bytes(_bytes, topic) if topic.is_empty() => false,
            Keeper::Bytes(_bytes, topic) => {
                let sent = MonoTime(self.header.published_mono_nanos);
                act(&Answered::by_result(&self.header, topic, sent));
                true
            }
        }
    }
}

#[pymethods]
impl Outcome {
    /// Name of the result's type.
    #[getter]
    fn kind(&self) -> &'static str {
        self.kind.name()
    }

    /// Tick that it is about.
    #[getter]
    fn tick(&self) -> u64 {
        self.header.tick
    }

    /// Number of the result, counted by its writer.
    #[getter]
    fn seq(&self) -> u64 {
        self.header.seq
    }

    /// Epoch of the simulator whose frames it answers.
    #[getter]
    fn epoch(&self) -> u64 {
        self.header.epoch
    }

    /// Simulated time, nanoseconds.
    #[getter]
    fn sim_nanos(&self) -> u64 {
        self.header.sim_nanos
    }

    /// Bytes of the body.
    #[getter]
    fn body_bytes(&self) -> usize {
        self.header.body_bytes as usize
    }

    /// Device of the body: `cuda:0` and so on; None for shared memory and bytes.
    #[getter]
    fn device(&self) -> Option<String> {
        let number = self.there()?.device()?;
        Some(format!("cuda:{number}"))
    }

    /// Sizes of the array of a result on a GPU, slowest dimension first; None in shared memory.
    fn device_shape(&self) -> Option<Vec<i64>> {
        Some(Array::of_result(self.there()?).sizes().to_vec())
    }

    /// A DLPack capsule of a result on a GPU; None in shared memory.
    fn device_capsule<'py>(
        &self,
        py: Python<'py>,
        stream: Option<i64>,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Some(result) = self.there() else {
            return Ok(None);
        };
        result.is_read_by(stream_address(stream)?);
        Array::of_result(result)
            .capsule(py, result.clone())
            .map(Some)
    }

    /// DLPack's kind and number of the device; None in shared memory.
    fn device_number(&self) -> Option<(i32, i32)> {
        Some(Array::of_result(self.there()?).device())
    }

    /// Address, sizes, strides in bytes and numpy's type of a result on a device of CUDA.
    fn device_interface(&self) -> Option<Interface> {
        Array::of_result(self.there()?).interface()
    }

    /// A copy of the body of a result on a GPU; None in shared memory.
    fn device_bytes<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let Some(result) = self.there() else {
            return Ok(None);
        };
        let bytes = py.detach(|| result.to_bytes()).map_err(errors::gpu)?;
        Ok(Some(PyBytes::new(py, &bytes)))
    }

    /// The result on a GPU as a tensor of torch; None in shared memory, and where torch has to look
    /// for streams itself.
    fn device_torch(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        match self.there() {
            Some(result) if result.waits_for_all_streams() => {
                Array::of_result(result).torch(py, result.clone()).map(Some)
            }
            _ => Ok(None),
        }
    }

    /// A copy of the header's bytes.
    fn header_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, bytemuck::bytes_of(&self.header))
    }

    /// A copy of the records of all inputs.
    fn inputs_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, bytemuck::cast_slice(&self.inputs))
    }

    /// Part of the body, from `offset` bytes on, as a read-only array that keeps this result.
    fn array<'py>(
        slf: &Bound<'py, Self>,
        dtype: &Bound<'py, PyArrayDescr>,
        sizes: Vec<usize>,
        strides: Vec<usize>,
        offset: usize,
    ) -> PyResult<Bound<'py, PyAny>> {
        if slf.get().there().is_some() {
            return Err(PyTypeError::new_err(
                "this result is on the GPU: use result.torch(), cupy.from_dlpack(result) or jax.dlpack.from_dlpack(result), or result.copy() for numpy",
            ));
        }
        let shape = Shape::of(&sizes, &strides)?;
        let memory = slf.get().body.part(offset, shape.span(dtype.itemsize()))?;
        // SAFETY: the keeper in this result, which becomes the array's base, keeps the body mapped
        // at its address: a borrowed sample is not reused, and bytes do not move. The part lies
        // within the body. Numbers and structs of numbers are all that `gantry` gives as elements.
        unsafe { view::array(dtype, shape, memory, Access::Read, slf.clone().into_any()) }
    }
}

/// A result from the bytes of its header and its payload, which are checked.
#[pyfunction]
#[pyo3(signature = (bytes, topic=""))]
pub fn outcome_from_bytes(bytes: Bound<'_, PyBytes>, topic: &str) -> PyResult<Outcome> {
    const HEADER: usize = size_of::<ResultHeader>();
    let data = bytes.as_bytes();
    if data.len() < HEADER {
        return Err(errors::format(format!(
            "{} bytes are no result; its header alone has {HEADER}",
            data.len()
        )));
    }
    let (head, payload) = data.split_at(HEADER);
    let header: ResultHeader = bytemuck::pod_read_unaligned(head);
    let kind = header
        .check(payload.len())
        .map_err(|fault| errors::result(&fault, ""))?;
    let inputs = &payload[header.inputs_offset() as usize..header.payload_bytes as usize];
    Ok(Outcome {
        header,
        kind,
        body: Memory {
            start: payload.as_ptr().cast_mut(),
            len: header.body_bytes as usize,
        },
        inputs: inputs
            .chunks_exact(size_of::<InputRecord>())
            .map(bytemuck::pod_read_unaligned)
            .collect(),
        keeper: Keeper::Bytes(bytes.unbind(), topic.to_owned()),
    })
}

/// What a result answers, given as the native half of a frame or of a result.
#[derive(FromPyObject)]
pub enum Input<'py> {
    /// A frame.
    Frame(PyRef<'py, Sample>),
    /// A result.
    Result(PyRef<'py, Outcome>),
}

impl Input<'_> {
    /// Shows it as something that can be answered.
    pub fn answered(&self, act: impl FnOnce(&dyn Answerable)) -> PyResult<()> {
        let is_live = match self {
            Input::Frame(frame) => frame.answered(act),
            Input::Result(result) => result.answered(act),
        };
        match is_live {
            true => Ok(()),
            false => Err(PyValueError::new_err(
                "a result cannot answer a frame that was read from bytes, because it has no topic; answer it as it comes from the bus or from gantry.Recording, or give its topic to frame_from_bytes",
            )),
        }
    }
}
