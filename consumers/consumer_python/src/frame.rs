//! A frame in Python's hands: its header, and its payload as an array without a copy.

#![expect(unsafe_code, reason = "arrays over the memory of samples")]

use std::sync::Arc;

use numpy::PyArrayDescr;
use parking_lot::Mutex;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyBytes;

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
#[pyclass(frozen, module = "gantry._native")]
pub struct Sample {
    header: FrameHeader,
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
    /// A frame of the bus. Its port belongs to `place`.
    pub fn shared(frame: Frame, place: &Arc<Place>) -> Self {
        let payload: &[u8] = &frame;
        Sample {
            header: *frame.header(),
            modality: frame.modality(),
            payload: Memory {
                start: payload.as_ptr().cast_mut(),
                len: payload.len(),
            },
            keeper: Keeper::Shared(Mutex::new(Owned::new(frame)), place.clone()),
        }
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
    /// Tick that the frame shows.
    #[getter]
    fn tick(&self) -> u64 {
        self.header.tick
    }

    /// Number of the sensor's firing.
    #[getter]
    fn seq(&self) -> u64 {
        self.header.seq
    }

    /// Random number of the daemon's start.
    #[getter]
    fn epoch(&self) -> u64 {
        self.header.epoch
    }

    /// Simulated time, nanoseconds.
    #[getter]
    fn sim_nanos(&self) -> u64 {
        self.header.sim_nanos
    }

    /// `CLOCK_MONOTONIC` just before the frame was sent.
    #[getter]
    fn published_mono_nanos(&self) -> u64 {
        self.header.published_mono_nanos
    }

    /// Name of the modality.
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

    /// The payload as a read-only array that keeps this sample.
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
pub fn sample_from_bytes(bytes: Bound<'_, PyBytes>) -> PyResult<Sample> {
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
    Ok(Sample {
        header,
        modality,
        payload: Memory {
            start: data[HEADER..].as_ptr().cast_mut(),
            len: header.payload_bytes as usize,
        },
        keeper: Keeper::Bytes(bytes.unbind()),
    })
}
