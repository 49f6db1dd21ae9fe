//! Elements of every modality as numpy has them, and the shape of a frame's array.

use numpy::{PyArrayDescr, PyArrayDescrMethods as _};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

use schema_frames::{FrameHeader, Modality};

use crate::view::Shape;

/// Element of a modality as numpy has it.
pub struct Element {
    /// Its type, or that of its parts.
    pub dtype: Py<PyArrayDescr>,
    /// Bytes of the element, or of one part.
    pub bytes: usize,
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

/// The element of a modality.
pub fn element(py: Python<'_>, modality: Modality) -> PyResult<&Element> {
    ELEMENTS
        .get(py)
        .and_then(|elements| elements.get(modality as usize - 1))
        .ok_or_else(|| PyRuntimeError::new_err("import gantry, not gantry._native"))
}

impl Element {
    /// Shape of the array of a frame with this header, which was checked.
    pub fn shape(&self, header: &FrameHeader, modality: Modality) -> Shape {
        let (width, height) = (header.width as usize, header.height as usize);
        let by = header.element_bytes as usize;
        let stride = header.row_stride as usize;
        let shape = match modality.is_image() {
            true if header.is_batch() => {
                let rows = header.image_height() as usize;
                Shape::new()
                    .and(header.n_images as usize, rows * stride)
                    .and(rows, stride)
                    .and(width, by)
            }
            true => Shape::new().and(height, stride).and(width, by),
            // A list of height 0 has no elements, whatever its width says.
            false => Shape::new().and(if height == 0 { 0 } else { width }, by),
        };
        match self.parts {
            0 => shape,
            parts => shape.and(parts, self.bytes),
        }
    }
}
