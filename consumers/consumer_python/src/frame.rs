//! A frame in Python's hands: its header, and its payload as an array without a copy.
//!
//! Python's class `Frame` is derived from the one here and adds what is rarely asked for. A process
//! that has just been woken finds caches and address translation cold, and there every page that is
//! touched costs about a microsecond. So nothing of Python runs between a frame's arrival and its
//! array, and the objects of the next frame are made before its reader goes to sleep.

#![expect(unsafe_code, reason = "arrays over the memory of samples")]

use std::cell::Cell;
use std::sync::{Arc, OnceLock};

use numpy::PyReadwriteArray1;
use parking_lot::Mutex;
use pyo3::exceptions::{PyRuntimeError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyBytes, PyString, PyType};

use consumer_gpu::FrameOnGpu;
use schema_bus::{Answerable, Answered, Frame};
use schema_frames::{FrameHeader, Modality};
use schema_types::MonoTime;

use crate::dlpack::{Array, Interface, stream_address, torch_from};
use crate::elements::element;
use crate::errors;
use crate::fork::Owned;
use crate::place::Place;
use crate::tensor::{Form, Images, Numbers};
use crate::view::{self, Access, Memory, Shape};

/// A frame: header and payload.
#[pyclass(frozen, subclass, module = "gantry._native")]
pub struct Sample {
    topic: Py<PyString>,
    keeper: Py<Keeper>,
    /// Set before the frame is handed out.
    facts: OnceLock<Facts>,
    array: PyOnceLock<Py<PyAny>>,
}

struct Facts {
    header: FrameHeader,
    taken: u64,
    modality: Modality,
    payload: Memory,
}

/// What keeps a payload in place: the base of its arrays. It is not the frame itself, because the
/// frame holds its array.
#[pyclass(frozen, module = "gantry._native")]
pub struct Keeper {
    held: OnceLock<Held>,
}

#[expect(
    clippy::large_enum_variant,
    reason = "nearly all are samples, and a box would be one more allocation after waking"
)]
enum Held {
    /// A sample in shared memory; its port's node must outlive it.
    Shared(Mutex<Owned<Frame>>, Arc<Place>),
    /// Bytes, for example of a recording.
    Bytes(Py<PyBytes>),
    /// On a GPU; its port's node must outlive it.
    OnGpu(Arc<Owned<FrameOnGpu>>, Arc<Place>),
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

/// Modality and shape of a frame's array.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Like {
    modality: Modality,
    shape: Shape,
    /// Bytes from the first to the last of the array.
    span: usize,
}

/// The objects of a frame that has not arrived yet.
pub struct Blank {
    frame: Py<Sample>,
    keeper: Py<Keeper>,
    /// An array that shows nothing yet, for a frame like this.
    array: Option<(Py<PyAny>, Like)>,
}

impl Blank {
    /// Makes the objects for a frame of `topic`; its array, too, if it is known what the frame will
    /// be like.
    pub fn new(py: Python<'_>, topic: &Py<PyString>, like: Option<Like>) -> PyResult<Self> {
        let class = CLASS
            .get(py)
            .ok_or_else(|| PyRuntimeError::new_err("import gantry, not gantry._native"))?;
        let keeper = Keeper {
            held: OnceLock::new(),
        };
        let keeper = Py::new(py, keeper)?;
        NEXT.set(Some(Sample {
            topic: topic.clone_ref(py),
            keeper: keeper.clone_ref(py),
            facts: OnceLock::new(),
            array: PyOnceLock::new(),
        }));
        let made = class.bind(py).call0();
        NEXT.set(None);
        let array = like.map(|like| {
            let dtype = element(py, like.modality)?.dtype.bind(py);
            let base = keeper.bind(py).clone().into_any();
            let array = view::blank(dtype, like.shape, base)?;
            PyResult::Ok((array.unbind(), like))
        });
        Ok(Blank {
            frame: made?.cast_into::<Sample>()?.unbind(),
            array: array.transpose()?,
            keeper,
        })
    }

    /// Makes it the frame that has arrived, whose port belongs to `place`. Also returns what the
    /// frame is like.
    pub fn fill(
        self,
        py: Python<'_>,
        frame: Frame,
        place: &Arc<Place>,
    ) -> PyResult<(Py<PyAny>, Like)> {
        let payload: &[u8] = &frame;
        let facts = Facts {
            header: *frame.header(),
            taken: frame.taken().0,
            modality: frame.modality(),
            payload: Memory {
                start: payload.as_ptr().cast_mut(),
                len: payload.len(),
            },
        };
        let held = Held::Shared(Mutex::new(Owned::new(frame)), place.clone());
        self.finish(py, facts, held)
    }

    /// Makes it a frame on a GPU.
    pub fn fill_on_gpu(self, frame: FrameOnGpu, place: &Arc<Place>) -> Py<PyAny> {
        let facts = Facts {
            header: *frame.header(),
            taken: frame.taken().0,
            modality: frame.modality(),
            // No array shows it.
            payload: Memory {
                start: std::ptr::null_mut(),
                len: 0,
            },
        };
        let held = Held::OnGpu(Arc::new(Owned::new(frame)), place.clone());
        let is_new =
            self.keeper.get().held.set(held).is_ok() && self.frame.get().facts.set(facts).is_ok();
        assert!(is_new, "a blank is filled once, because that consumes it");
        self.frame.into_any()
    }

    fn finish(self, py: Python<'_>, facts: Facts, held: Held) -> PyResult<(Py<PyAny>, Like)> {
        let element = element(py, facts.modality)?;
        let shape = element.shape(&facts.header, facts.modality);
        let like = Like {
            modality: facts.modality,
            shape,
            span: shape.span(element.bytes),
        };
        let (sample, payload) = (self.frame.get(), facts.payload);
        let is_new = self.keeper.get().held.set(held).is_ok() && sample.facts.set(facts).is_ok();
        assert!(is_new, "a blank is filled once, because that consumes it");
        if let Some((array, _)) = self.array.filter(|(_, made_for)| *made_for == like) {
            // SAFETY: the array was made for frames of this modality and shape and was shown to
            // nobody; its base, the keeper, has just got hold of the payload.
            unsafe { view::place(array.bind(py), like.span, payload) };
            let _ = sample.array.set(py, array);
        }
        Ok((self.frame.into_any(), like))
    }
}

impl Sample {
    fn facts(&self) -> &Facts {
        self.facts
            .get()
            .expect("a frame is filled before it is handed out")
    }

    /// The frame, if it is on a GPU.
    fn on_gpu(&self) -> Option<&Arc<Owned<FrameOnGpu>>> {
        match self.keeper.get().held.get() {
            Some(Held::OnGpu(frame, _place)) => Some(frame),
            _ => None,
        }
    }

    /// Shows the frame as something that can be answered; `false` if it comes from bytes without a
    /// topic. One of a recording counts as taken when it was sent: a file is read without a clock.
    pub fn answered(&self, act: impl FnOnce(&dyn Answerable)) -> bool {
        match self.keeper.get().held.get() {
            Some(Held::Shared(frame, _place)) => {
                act(&**frame.lock());
                true
            }
            Some(Held::OnGpu(frame, _place)) => {
                act(&***frame);
                true
            }
            Some(Held::Bytes(_bytes)) => {
                let topic = Python::attach(|py| self.topic.bind(py).to_string());
                let Some(facts) = self.facts.get().filter(|_| !topic.is_empty()) else {
                    return false;
                };
                let sent = MonoTime(facts.header.published_mono_nanos);
                act(&Answered::by_frame(&facts.header, &topic, sent));
                true
            }
            None => false,
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

    /// Domain that the frame was read in; None for a frame from bytes.
    #[getter]
    fn domain(&self) -> Option<&str> {
        match self.keeper.get().held.get() {
            Some(Held::Shared(_, place) | Held::OnGpu(_, place)) => Some(place.bus().domain()),
            _ => None,
        }
    }

    /// Tick that the frame shows.
    #[getter]
    fn tick(&self) -> u64 {
        self.facts().header.tick
    }

    /// Number of the sensor's firing, from 1; a gap is a loss.
    #[getter]
    fn seq(&self) -> u64 {
        self.facts().header.seq
    }

    /// Random number of the simulator's start: another one means that it was restarted.
    #[getter]
    fn epoch(&self) -> u64 {
        self.facts().header.epoch
    }

    /// Simulated time, seconds since the daemon started.
    #[getter]
    fn sim_time(&self) -> f64 {
        self.facts().header.sim_nanos as f64 * 1e-9
    }

    /// `CLOCK_MONOTONIC` just before the frame was sent, nanoseconds: compare `time.monotonic_ns()`.
    #[getter]
    fn published_mono_nanos(&self) -> u64 {
        self.facts().header.published_mono_nanos
    }

    /// `CLOCK_MONOTONIC` when this reader took the frame, nanoseconds; 0 for a frame from bytes.
    #[getter]
    fn taken_mono_nanos(&self) -> u64 {
        self.facts().taken
    }

    /// Name of the modality: `rgb`, `depth`, …
    #[getter]
    fn modality(&self) -> &'static str {
        self.facts().modality.name()
    }

    /// Whether the payload is an image, otherwise a list.
    #[getter]
    fn is_image(&self) -> bool {
        self.facts().modality.is_image()
    }

    /// Width and height of an image in pixels, of each if there are several; of a list, the number
    /// of its elements and 1.
    #[getter]
    fn size(&self) -> (u32, u32) {
        (
            self.facts().header.width,
            self.facts().header.image_height(),
        )
    }

    /// Number of images of a frame of a batch of cameras; 0 for a frame of a single sensor.
    #[getter]
    fn n_images(&self) -> u32 {
        self.facts().header.n_images
    }

    /// Device of the payload: `cuda:0` and so on, `mapped` for memory of a software adapter, and
    /// None for shared memory.
    #[getter]
    fn device(&self) -> Option<String> {
        let frame = self.on_gpu()?;
        Some(match frame.device() {
            Some(number) => format!("cuda:{number}"),
            None => "mapped".to_owned(),
        })
    }

    /// Sizes of the tensor of a frame on a GPU, slowest dimension first; None in shared memory.
    fn device_shape(&self) -> Option<Vec<i64>> {
        Some(Array::of_frame(self.on_gpu()?).sizes().to_vec())
    }

    /// A DLPack capsule of a frame on a GPU; None in shared memory.
    fn device_capsule<'py>(
        &self,
        py: Python<'py>,
        stream: Option<i64>,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Some(frame) = self.on_gpu() else {
            return Ok(None);
        };
        frame.is_read_by(stream_address(stream)?);
        Array::of_frame(frame).capsule(py, frame.clone()).map(Some)
    }

    /// DLPack's kind and number of the device; None in shared memory.
    fn device_number(&self) -> Option<(i32, i32)> {
        self.on_gpu().map(|frame| Array::of_frame(frame).device())
    }

    /// Address, sizes, strides in bytes and numpy's type of a frame on a device of CUDA.
    fn device_interface(&self) -> Option<Interface> {
        Array::of_frame(self.on_gpu()?).interface()
    }

    /// Returns the frame as a tensor of torch, without a copy.
    ///
    /// On a GPU it is in hand much sooner than by `torch.from_dlpack`: the bytes were complete
    /// before the frame was sent, so torch need not look for streams that it would have to wait for.
    /// Lists are bytes (n, element bytes). The tensor keeps the frame's memory; do not write to it.
    fn torch(slf: &Bound<'_, Self>) -> PyResult<Py<PyAny>> {
        match slf.get().on_gpu() {
            Some(frame) if frame.waits_for_all_streams() => {
                Array::of_frame(frame).torch(slf.py(), frame.clone())
            }
            _ => torch_from(slf.py(), slf),
        }
    }

    /// A copy of the bytes of a frame on a GPU; None in shared memory.
    fn device_bytes<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let Some(frame) = self.on_gpu() else {
            return Ok(None);
        };
        let bytes = py.detach(|| frame.to_bytes());
        let bytes = bytes.map_err(errors::gpu)?;
        Ok(Some(PyBytes::new(py, &bytes)))
    }

    /// Writes the images of an `rgb` frame into the bytes of a dense tensor of the named type:
    /// planes or pixels of the colours whose bytes in a pixel are `order`.
    #[pyo3(signature = (out, *, dtype, planar, order, scale))]
    fn fill_tensor(
        &self,
        py: Python<'_>,
        mut out: PyReadwriteArray1<'_, u8>,
        dtype: &str,
        planar: bool,
        order: Vec<usize>,
        scale: f32,
    ) -> PyResult<()> {
        let Facts {
            header,
            modality,
            payload,
            ..
        } = self.facts();
        if self.on_gpu().is_some() || *modality != Modality::Rgb {
            return Err(PyTypeError::new_err(
                "only a frame of rgb in shared memory becomes a tensor",
            ));
        }
        // SAFETY: the keeper, which this frame holds, keeps the payload mapped at its address, as for
        // the frame's array; it was checked when the frame was taken.
        let bytes = unsafe { std::slice::from_raw_parts(payload.start, payload.len) };
        let images = Images {
            bytes,
            width: header.width as usize,
            height: header.image_height() as usize,
            n: header.n_images.max(1) as usize,
            row_stride: header.row_stride as usize,
        };
        let n_numbers = images.n_numbers(order.len());
        let numbers = Numbers::of(dtype, out.as_slice_mut()?)
            .filter(|numbers| numbers.len() == n_numbers && order.iter().all(|byte| *byte < 4));
        let numbers = numbers.ok_or_else(|| {
            PyValueError::new_err(format!(
                "the memory does not hold {n_numbers} numbers of {dtype}"
            ))
        })?;
        let form = Form {
            is_planar: planar,
            order: &order,
            scale,
        };
        py.detach(|| images.write(form, numbers));
        Ok(())
    }

    /// A copy of the header's 256 bytes.
    fn header_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, bytemuck::bytes_of(&self.facts().header))
    }

    /// The payload as a read-only view, which keeps the frame's memory borrowed.
    ///
    /// Images by modality: `rgb` (h, w, 4) uint8 in the order B G R A; `depth` (h, w) float32, metres
    /// along the optical axis, +inf where nothing was hit; `semantic` (h, w) uint8 class numbers;
    /// `instance` (h, w) uint32 object ids; `flow` (h, w, 2) float32 pixels, x right and y down;
    /// `normals` (h, w, 4) float16, unit normal in world space and a zero. A frame of a batch of
    /// cameras has one dimension more in front, the images: `rgb` (n, h, w, 4). All others: a
    /// structured array (n,) with the fields of SPEC.md §4.
    #[getter]
    fn array(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        if self.on_gpu().is_some() {
            return Err(PyTypeError::new_err(
                "this frame is on the GPU: use frame.torch(), cupy.from_dlpack(frame) or jax.dlpack.from_dlpack(frame), or frame.copy() for numpy",
            ));
        }
        let array = self.array.get_or_try_init(py, || {
            let facts = self.facts();
            let element = element(py, facts.modality)?;
            // SAFETY: the keeper, which becomes the array's base, keeps the payload mapped at its
            // address: a borrowed sample is not reused, and bytes do not move. Numbers and structs
            // of numbers are all that `gantry` gives as elements.
            let array = unsafe {
                view::array(
                    element.dtype.bind(py),
                    element.shape(&facts.header, facts.modality),
                    facts.payload,
                    Access::Read,
                    self.keeper.bind(py).clone().into_any(),
                )
            };
            array.map(Bound::unbind)
        })?;
        Ok(array.clone_ref(py))
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
    let facts = Facts {
        header,
        taken: 0,
        modality,
        payload: Memory {
            start: data[HEADER..].as_ptr().cast_mut(),
            len: header.payload_bytes as usize,
        },
    };
    let blank = Blank::new(py, &topic.unbind(), None)?;
    let (frame, _) = blank.finish(py, facts, Held::Bytes(bytes.unbind()))?;
    Ok(frame)
}
