//! Writing results that stay on a GPU: arrays of other libraries are copied within the device, and
//! loans are slots of its memory.

use std::sync::Arc;

use consumer_gpu::{Body, Device, GpuLoan as Slot, GpuPublisher as Port};
use numpy::PyReadonlyArray1;
use parking_lot::Mutex;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use schema_bus::{GpuPlaces, ResultDraft};
use schema_frames::ResultHeader;

use crate::dlpack::{Array, Foreign, Interface};
use crate::errors;
use crate::fork::{self, Owned};
use crate::place::Place;
use crate::publish::{Said, format_of, gone, spec_of, tensor_of};
use crate::result::Input;

type SharedPort = Arc<Owned<Port>>;

/// The writing end of a topic of results on a GPU.
#[pyclass(frozen, module = "gantry._native")]
pub struct GpuPublisher {
    // The port goes before its node.
    port: Mutex<Option<SharedPort>>,
    place: Arc<Place>,
    topic: String,
}

/// A result that is being made, with a slot on the GPU if it was loaned.
#[pyclass(frozen, module = "gantry._native")]
pub struct GpuLoan {
    made: Mutex<Option<Made>>,
    // After the slot, whose port it is.
    port: SharedPort,
    _place: Arc<Place>,
}

struct Made {
    draft: ResultDraft,
    slot: Option<Owned<Slot>>,
}

#[pymethods]
impl GpuPublisher {
    /// Opens a topic of results on a device. `about` is its description as JSON; capacities of 0
    /// are the usual ones. With `body_bytes` the memory is made at once.
    #[new]
    #[pyo3(signature = (domain, topic, kind, *, device, about, body_bytes, loans, readers, buffer, borrowed, gpu_readers))]
    #[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
    fn open(
        py: Python<'_>,
        domain: &str,
        topic: &str,
        kind: &str,
        device: &str,
        about: &str,
        body_bytes: usize,
        loans: usize,
        readers: usize,
        buffer: usize,
        borrowed: usize,
        gpu_readers: usize,
    ) -> PyResult<Self> {
        let place = Place::of(domain)?;
        let device = device_of(device)?;
        let mut spec = spec_of(kind, about)?;
        let or = |wish: usize, usual: usize| if wish == 0 { usual } else { wish };
        // Slots of shared memory grow when the first copy is made; there may never be one. A body that is copied needs a slot beside those that are loaned.
        spec.max_loans = or(loans, spec.max_loans) + 1;
        spec.qos.readers = or(readers, spec.qos.readers);
        let usual = GpuPlaces::default();
        let places = GpuPlaces {
            readers: or(gpu_readers, usual.readers),
            buffer: or(buffer, usual.buffer),
            borrowed: or(borrowed, usual.borrowed),
        };
        spec.qos.buffer = or(buffer, spec.qos.buffer);
        spec.qos.borrowed = or(borrowed, spec.qos.borrowed);
        let port = py
            .detach(|| Port::open(place.bus(), topic, &spec, places, body_bytes, device))
            .map_err(errors::gpu)?;
        Ok(GpuPublisher {
            port: Mutex::new(Some(Arc::new(Owned::new(port)))),
            place,
            topic: topic.to_owned(),
        })
    }

    /// A result whose body is given when it is sent.
    fn draft(&self) -> PyResult<GpuLoan> {
        let port = self.port()?;
        Ok(self.made(port.draft(), None, port))
    }

    /// Loans a slot for a body of up to `body_bytes`.
    fn loan(&self, py: Python<'_>, body_bytes: usize) -> PyResult<GpuLoan> {
        let port = self.port()?;
        let slot = py.detach(|| port.loan(body_bytes)).map_err(errors::gpu)?;
        Ok(self.made(port.draft(), Some(Owned::new(slot)), port))
    }

    /// Address of the stream on which bodies are copied.
    fn stream(&self) -> PyResult<u64> {
        Ok(self.port()?.stream())
    }

    /// Lets that stream wait for everything that this process has given the device so far.
    fn wait_for_work(&self, py: Python<'_>) -> PyResult<()> {
        let port = self.port()?;
        py.detach(|| port.wait_for_work()).map_err(errors::gpu)
    }

    /// Number of CUDA's device.
    fn device(&self) -> PyResult<i32> {
        Ok(self.port()?.device())
    }

    /// Memory of the device that the topic has for its slots now, bytes.
    fn device_bytes(&self) -> PyResult<u64> {
        Ok(self.port()?.n_device_bytes())
    }

    /// Number of readers now, on the GPU and in shared memory.
    fn n_readers(&self) -> PyResult<usize> {
        Ok(self.port()?.n_readers())
    }

    /// Closes the topic, once its last loan is gone.
    fn close(&self, py: Python<'_>) {
        if fork::check().is_ok() {
            let port = self.port.lock().take();
            py.detach(|| drop(port));
        }
    }
}

/// The device of this name.
fn device_of(name: &str) -> PyResult<Device> {
    let number = name.strip_prefix("cuda:").map(str::parse);
    match (name, number) {
        ("cuda", _) => Ok(Device::Cuda),
        (_, Some(Ok(number))) => Ok(Device::CudaNumber(number)),
        _ => Err(PyValueError::new_err(format!(
            "device is {name:?}; it must be \"cuda\" or \"cuda:N\""
        ))),
    }
}

impl GpuPublisher {
    fn port(&self) -> PyResult<SharedPort> {
        fork::check()?;
        self.port.lock().clone().ok_or_else(|| {
            errors::gantry(format!(
                "topic \"{}/{}\" is closed",
                self.place.bus().domain(),
                self.topic
            ))
        })
    }

    fn made(&self, draft: ResultDraft, slot: Option<Owned<Slot>>, port: SharedPort) -> GpuLoan {
        GpuLoan {
            made: Mutex::new(Some(Made { draft, slot })),
            port,
            _place: self.place.clone(),
        }
    }
}

impl GpuLoan {
    fn with<T>(&self, act: impl FnOnce(&mut Made) -> PyResult<T>) -> PyResult<T> {
        fork::check()?;
        self.made.lock().as_mut().map_or_else(|| Err(gone()), act)
    }

    fn header<T>(&self, act: impl FnOnce(&mut ResultHeader) -> PyResult<T>) -> PyResult<T> {
        self.with(|made| act(made.draft.header_mut()))
    }

    /// Its slot as an array of the shape that was set, and what keeps the memory.
    fn array(&self) -> PyResult<(Array, Owned<Arc<consumer_gpu::SlotMemory>>)> {
        self.with(|made| {
            let slot = made.slot.as_ref().ok_or_else(gone)?;
            let array = Array::of_loan(slot, made.draft.header());
            Ok((array, Owned::new(slot.memory())))
        })
    }

    fn take(&self) -> PyResult<Made> {
        fork::check()?;
        self.made.lock().take().ok_or_else(gone)
    }
}

#[pymethods]
impl GpuLoan {
    /// Says that the body is an image in the named format.
    fn set_image(&self, width_px: u32, height_px: u32, format: &str) -> PyResult<()> {
        let format = format_of(format)?;
        self.header(|header| {
            header.set_image(width_px, height_px, format);
            Ok(())
        })
    }

    /// Says that the body is a tensor of the named elements.
    fn set_tensor(&self, element: &str, sizes: Vec<usize>) -> PyResult<()> {
        let (element, sizes) = tensor_of(element, &sizes)?;
        self.header(|header| {
            let set = header.set_tensor(element, &sizes);
            set.map_err(|fault| PyValueError::new_err(fault.to_string()))
        })
    }

    /// Names a frame or a result that this result was computed from.
    fn answers(&self, input: Input<'_>) -> PyResult<()> {
        self.with(|made| input.answered(|of| made.draft.answers(of)))
    }

    /// Fills in what the inputs do not say; what is `None` stays.
    fn describe(&self, said: PyRef<'_, Said>) -> PyResult<()> {
        self.header(|header| {
            said.put(header);
            Ok(())
        })
    }

    /// A DLPack capsule of the slot, writeable.
    fn capsule<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (array, keeper) = self.array()?;
        array.capsule(py, keeper)
    }

    /// The slot as a tensor of torch, writeable.
    fn torch(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let (array, keeper) = self.array()?;
        array.torch(py, keeper)
    }

    /// Address, sizes, strides in bytes and numpy's type of the slot.
    fn interface(&self) -> PyResult<Option<Interface>> {
        Ok(self.array()?.0.interface())
    }

    /// DLPack's kind and number of the slot's device.
    fn device_number(&self) -> PyResult<(i32, i32)> {
        Ok(self.array()?.0.device())
    }

    /// Sends the slot, once the device has done what this process gave it. Returns the number of
    /// readers that received it.
    fn send(&self, py: Python<'_>) -> PyResult<usize> {
        let Made { draft, slot } = self.take()?;
        let slot = slot.ok_or_else(gone)?;
        py.detach(|| self.port.send_loan(slot.into_inner(), draft))
            .map_err(errors::gpu)
    }

    /// Sends a copy of an array on the device, which is complete at what the publisher's stream was
    /// told to wait for. Returns the number of readers that received it.
    fn send_array(&self, py: Python<'_>, array: PyRef<'_, Foreign>) -> PyResult<usize> {
        let draft = self.take()?.draft;
        let (found, wanted) = (array.n_bytes(), draft.header().body_bytes);
        if found != wanted || !array.is_on(self.port.device()) {
            return Err(PyValueError::new_err(format!(
                "an array of {found} bytes was given for a result of {wanted}, or it is on another device"
            )));
        }
        let (body, port) = (Body::Device(array.address()), &self.port);
        #[expect(unsafe_code, reason = "an address of the device")]
        // SAFETY: `array` keeps its memory, of which length and device were just compared, until
        // the call is over.
        let sent = py.detach(|| unsafe { port.send(draft, body) });
        sent.map_err(errors::gpu)
    }

    /// Sends bytes of this process. Returns the number of readers that received them.
    fn send_bytes(&self, py: Python<'_>, bytes: PyReadonlyArray1<'_, u8>) -> PyResult<usize> {
        let draft = self.take()?.draft;
        let bytes = bytes
            .as_slice()
            .map_err(|_| PyValueError::new_err("the bytes do not lie one behind the other"))?;
        let port = &self.port;
        #[expect(unsafe_code, reason = "the same call takes addresses of the device")]
        // SAFETY: the body is in this process's memory, which the array keeps.
        let sent = py.detach(|| unsafe { port.send(draft, Body::Host(bytes)) });
        sent.map_err(errors::gpu)
    }

    /// Gives the slot back unsent. Does nothing after `send`.
    fn give_back(&self, py: Python<'_>) {
        let made = self.made.lock().take();
        py.detach(|| drop(made));
    }

    /// Topic without the domain.
    #[getter]
    fn topic(&self) -> String {
        self.port.topic().to_owned()
    }
}
