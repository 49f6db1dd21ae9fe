//! Calibrations of cameras: pixels of many directions, and directions of many pixels.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use schema_frames::FrameHeader;
use schema_types::Distortion;
use schema_types::lens::{Lens, LensModel, Plane};

/// What a camera's pixels show.
#[pyclass(frozen, module = "gantry._native")]
pub struct Calibration {
    own: schema_frames::Calibration,
}

#[pymethods]
impl Calibration {
    /// The lens of this model with these numbers, in the order of the model's keys; a pinhole's image
    /// may be bent by CARLA's `distortion`.
    #[new]
    #[pyo3(signature = (size_px, model, numbers, *, focal_px, shear_px, centre_px, max_angle_rad, distortion))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn new(
        size_px: [u32; 2],
        model: &str,
        numbers: Vec<f64>,
        focal_px: [f64; 2],
        shear_px: [f64; 2],
        centre_px: [f64; 2],
        max_angle_rad: f64,
        distortion: [f32; 4],
    ) -> PyResult<Self> {
        let refused = |what: String| PyValueError::new_err(format!("this is no lens: {what}"));
        if let Some(distortion) = Distortion::from_array(distortion) {
            let [[fx, fy], [cx, cy]] = [focal_px, centre_px];
            let own =
                schema_frames::Calibration::pinhole([fx, fy, cx, cy], Some(distortion), size_px);
            let own = own.ok_or_else(|| refused(format!("focal_px is {focal_px:?}")))?;
            return Ok(Calibration { own });
        }
        let known = LensModel::of(model, &numbers);
        let known = known
            .ok_or_else(|| refused(format!("model is {model:?} with {} numbers", numbers.len())))?;
        let plane = Plane {
            focal_px,
            shear_px,
            centre_px,
        };
        let lens = Lens::new(known, plane, Some(max_angle_rad))
            .map_err(|error| refused(error.to_string()))?;
        let own = schema_frames::Calibration::of_lens(lens, size_px);
        Ok(Calibration { own })
    }

    /// The calibration that a frame's header alone says; `None` if it names a lens's model, or is no
    /// camera's.
    #[staticmethod]
    fn of_header(header: &Bound<'_, PyBytes>) -> PyResult<Option<Self>> {
        let header: &[u8; size_of::<FrameHeader>()] = header
            .as_bytes()
            .try_into()
            .map_err(|_| PyValueError::new_err("a header has 256 bytes"))?;
        let header: FrameHeader = bytemuck::pod_read_unaligned(header);
        Ok(schema_frames::Calibration::of(&header).map(|own| Calibration { own }))
    }

    /// `calibration_crc` of these numbers.
    #[getter]
    fn crc(&self) -> u32 {
        self.own.crc()
    }

    /// All of it as JSON, as `world/info` has it.
    fn text(&self) -> PyResult<String> {
        let text = serde_json::to_string(&self.own);
        text.map_err(|error| PyValueError::new_err(error.to_string()))
    }

    /// Pixels (x, y) of directions (x, y, z), one after the other; NaN where none shows one.
    fn project<'py>(
        &self,
        py: Python<'py>,
        directions: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let directions = directions.as_slice()?;
        let pixels = py.detach(|| {
            let (each, _) = directions.as_chunks::<3>();
            let found = each.iter().map(|it| self.own.project(*it));
            found.flat_map(|it| it.unwrap_or([f64::NAN; 2])).collect()
        });
        Ok(PyArray1::from_vec(py, pixels))
    }

    /// Directions (x, y, z) of length 1 of pixels (x, y), one after the other; NaN where there is none.
    fn unproject<'py>(
        &self,
        py: Python<'py>,
        pixels: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let pixels = pixels.as_slice()?;
        let directions = py.detach(|| {
            let (each, _) = pixels.as_chunks::<2>();
            let found = each.iter().map(|it| self.own.unproject(*it));
            found.flat_map(|it| it.unwrap_or([f64::NAN; 3])).collect()
        });
        Ok(PyArray1::from_vec(py, directions))
    }
}
