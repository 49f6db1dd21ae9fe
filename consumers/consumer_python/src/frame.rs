//! A frame in Python's hands: its header, and its payload as an array without a copy.
//!
//! Python's class `Frame` is derived from the one here and adds what is rarely asked for. Nothing of
//! Python runs between a frame's arrival and its array: a process that has just been woken finds its
//! memory cold, and there every function of Python's costs several microseconds.

#![expect(unsafe_code, reason = "arrays over the memory of samples")]

use std::cell::Cell;
use std::sync::Arc;

use numpy::PyArrayDescr;
use parking_lot::Mutex;
use pyo3::exceptions::{PyRuntimeError, PyTypeError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyBytes, PyString, PyType};

use schema_bus::{Answerable, Frame};
use schema_frames::{FrameHeader, Modality};

use crate::errors;
use crate::fork::Owned;
use crate::place::Place;
use crate::view::{self, Access, Memory, Shape};

/// Who keeps a payload in place.
enum Keeper {
    /// A sample in shared memory; its port's node must outlive it.
    Shared(Mutex<Owned<Frame>>, Arc<Place>),
    /// Bytes, for example of a recording.
    Bytes(Py<PyBytes>),
}

/// A frame: header and payload. Arrays keep it.
#[pyclass(frozen, subclass, module = "gantry._native")]
pub struct Sample {
    topic: Py<PyString>,
    header: FrameHeader,
    taken: u64,
    modality: Modality,
    payload: Memory,
    keeper: Keeper,
}

/// Element of a modality as numpy has it.
struct Element {
    dtype: Py<PyArrayDescr>,
    bytes: usize,
    /// Parts of an element, as a last dimension; 0 stands for an element that is one number or
    /// struct.
    parts: usize,
}

/// The class derived from [`Sample`].
static CLASS: PyOnceLock<Py<PyType>> = PyOnceLock::new();

thread_local! {
    /// What the next object of the class holds.
    static NEXT: Cell<Option<Sample>> = const { Cell::new(None) };
}

/// Tells the class of all frames, which is derived from `Sample` and takes no arguments.
#[pyfunction]
pub fn set_frame_class(py: Python<'_>, frame_class: Py<PyType>) {
    // A second import finds the same class.
    let _ = CLASS.set(py, frame_class);
}

/// By encoding, which counts from 1.
static ELEMENTS: PyOnceLock<Vec<Element>> = PyOnceLock::new();

/// Tells the types of all modalities' elements: per modality its name, numpy type and number of
/// parts.
#[pyfunction]
pub fn set_elements(
    py: Python<'_>,
    elements: Vec<(String, Bound<'_, PyArrayDescr>, usize)>,
) -> PyResult<()> {
    use numpy::PyArrayDescrMethods as _;

    let mut found = Vec::new();
    for modality in Modality::ALL {
        let element = elements.iter().find(|(name, ..)| name == modality.name());
        let (_, dtype, parts) = element.ok_or_else(|| {
            PyRuntimeError::new_err(format!("no type is given for {}", modality.name()))
        })?;
        let bytes = dtype.itemsize();
        if bytes * (*parts).max(1) != modality.element_bytes() {
            return Err(PyRuntimeError::new_err(format!(
                "elements of {} have {} bytes",
                modality.name(),
                modality.element_bytes()
            )));
        }
        found.push(Element {
            dtype: dtype.clone().unbind(),
            bytes,
            parts: *parts,
        });
    }
    // A second import finds the same types.
    let _ = ELEMENTS.set(py, found);
    Ok(())
}

impl Sample {
    /// A frame of the bus as an object. Its port belongs to `place`.
    pub fn shared(
        py: Python<'_>,
        frame: Frame,
        topic: &Py<PyString>,
        place: &Arc<Place>,
    ) -> PyResult<Py<PyAny>> {
        let payload: &[u8] = &frame;
        let sample = Sample {
            topic: topic.clone_ref(py),
            header: *frame.header(),
            taken: frame.taken().0,
            modality: frame.modality(),
            payload: Memory {
                start: payload.as_ptr().cast_mut(),
                len: payload.len(),
            },
            keeper: Keeper::Shared(Mutex::new(Owned::new(frame)), place.clone()),
        };
        sample.into_object(py)
    }

    fn into_object(self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let class = CLASS
            .get(py)
            .ok_or_else(|| PyRuntimeError::new_err("import gantry, not gantry._native"))?;
        NEXT.set(Some(self));
        let made = class.bind(py).call0();
        NEXT.set(None);
        Ok(made?.unbind())
    }

    /// Shows the frame as something that can be answered; `false` if it comes from bytes.
    pub fn answered(&self, act: impl FnOnce(&dyn Answerable)) -> bool {
        match &self.keeper {
            Keeper::Shared(frame, _place) => {
                act(&**frame.lock());
                true
            }
            Keeper::Bytes(_bytes) => false,
        }
    }

    fn shape(&self, element: &Element) -> Shape {
        let header = &self.header;
        let (width, height) = (header.width as usize, header.height as usize);
        let by = header.element_bytes as usize;
        let shape = match self.modality.is_image() {
            true => Shape::new()
                .and(height, header.row_stride as usize)
                .and(width, by),
            // A list of height 0 has no elements, whatever its width says.
            false => Shape::new().and(if height == 0 { 0 } else { width }, by),
        };
        match element.parts {
            0 => shape,
            parts => shape.and(parts, element.bytes),
        }
    }
}

#[pymethods]
impl Sample {
    #[new]
    fn new() -> PyResult<Self> {
        NEXT.take().ok_or_else(|| {
            PyTypeError::new_err("frames come from gantry.open and gantry.frame_from_bytes")
        })
    }

    /// Topic without the domain; empty for a frame from bytes.
    #[getter]
    fn topic(&self, py: Python<'_>) -> Py<PyString> {
        self.topic.clone_ref(py)
    }

    /// Tick that the frame shows.
    #[getter]
    fn tick(&self) -> u64 {
        self.header.tick
    }

    /// Number of the sensor's firing, from 1; a gap is a loss.
    #[getter]
    fn seq(&self) -> u64 {
        self.header.seq
    }

    /// Random number of the simulator's start: another one means that it was restarted.
    #[getter]
    fn epoch(&self) -> u64 {
        self.header.epoch
    }

    /// Simulated time, seconds since the daemon started.
    #[getter]
    fn sim_time(&self) -> f64 {
        self.header.sim_nanos as f64 * 1e-9
    }

    /// `CLOCK_MONOTONIC` just before the frame was sent, nanoseconds: compare `time.monotonic_ns()`.
    #[getter]
    fn published_mono_nanos(&self) -> u64 {
        self.header.published_mono_nanos
    }

    /// `CLOCK_MONOTONIC` when this reader took the frame, nanoseconds; 0 for a frame from bytes.
    #[getter]
    fn taken_mono_nanos(&self) -> u64 {
        self.taken
    }

    /// Name of the modality: `rgb`, `depth`, …
    #[getter]
    fn modality(&self) -> &'static str {
        self.modality.name()
    }

    /// Whether the payload is an image, otherwise a list.
    #[getter]
    fn is_image(&self) -> bool {
        self.modality.is_image()
    }

    /// Width and height: pixels, or elements and 1.
    #[getter]
    fn size(&self) -> (u32, u32) {
        (self.header.width, self.header.height)
    }

    /// A copy of the header's 256 bytes.
    fn header_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, bytemuck::bytes_of(&self.header))
    }

    /// The payload as a read-only view, which keeps the frame's memory borrowed.
    ///
    /// Images by modality: `rgb` (h, w, 4) uint8 in the order B G R A; `depth` (h, w) float32, metres
    /// along the optical axis, +inf where nothing was hit; `semantic` (h, w) uint8 class numbers;
    /// `instance` (h, w) uint32 object ids; `flow` (h, w, 2) float32 pixels, x right and y down;
    /// `normals` (h, w, 4) float16, unit normal in world space and a zero. All others: a structured
    /// array (n,) with the fields of SPEC.md §4.
    #[getter]
    fn array<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        let (py, this) = (slf.py(), slf.get());
        let element = ELEMENTS
            .get(py)
            .and_then(|elements| elements.get(this.modality as usize - 1))
            .ok_or_else(|| PyRuntimeError::new_err("import gantry, not gantry._native"))?;
        // SAFETY: the keeper in this sample, which becomes the array's base, keeps the payload
        // mapped at its address: a borrowed sample is not reused, and bytes do not move. Numbers
        // and structs of numbers are all that `gantry` gives as elements.
        unsafe {
            view::array(
                element.dtype.bind(py),
                this.shape(element),
                this.payload,
                Access::Read,
                slf.clone().into_any(),
            )
        }
    }
}

/// A frame from the bytes of its header and its payload, which are checked.
#[pyfunction]
pub fn sample_from_bytes(
    bytes: Bound<'_, PyBytes>,
    topic: Bound<'_, PyString>,
) -> PyResult<Py<PyAny>> {
    let py = bytes.py();
    const HEADER: usize = size_of::<FrameHeader>();
    let data = bytes.as_bytes();
    if data.len() < HEADER {
        return Err(errors::format(format!(
            "{} bytes are no frame; its header alone has {HEADER}",
            data.len()
        )));
    }
    let header: FrameHeader = bytemuck::pod_read_unaligned(&data[..HEADER]);
    let modality = header
        .check(data.len() - HEADER)
        .map_err(|fault| errors::frame(&fault, ""))?;
    let sample = Sample {
        topic: topic.unbind(),
        header,
        taken: 0,
        modality,
        payload: Memory {
            start: data[HEADER..].as_ptr().cast_mut(),
            len: header.payload_bytes as usize,
        },
        keeper: Keeper::Bytes(bytes.unbind()),
    };
    sample.into_object(py)
}
