//! Writing results: loans of shared memory as writeable arrays.
//!
//! An array of a loan can live on after its loan was sent: Python's `with` statement keeps the name.
//! Its memory must then stay mapped. Nothing unmaps it but the end of the port, which every loan
//! keeps, and slots that grow. Before they do, a small loan of the old slots is given to every array
//! that is still there, and pins them.

#![expect(unsafe_code, reason = "arrays over the memory of loans")]

use std::sync::{Arc, Weak};

use numpy::{PyArrayDescr, PyArrayDescrMethods as _};
use parking_lot::Mutex;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use schema_bus::{ResultLoan, ResultPublisher, ResultTopic};
use schema_frames::{About, ElementType, PixelFormat, ResultHeader, ResultType, Space};
use schema_types::Pose;

use crate::errors;
use crate::fork::{self, Owned};
use crate::place::Place;
use crate::result::Input;
use crate::view::{self, Access, Memory, Shape};

/// Loans beyond those that the user may hold: one pins old slots while the next is filled.
const SPARE_LOANS: usize = 2;

type SharedPort = Arc<Owned<ResultPublisher>>;
type Pin = Arc<Mutex<Owned<ResultLoan>>>;

/// What keeps the memory of one loan's arrays mapped.
struct Hold {
    // The pins go before the port, and the port before its node.
    pins: Mutex<Vec<Pin>>,
    port: SharedPort,
    _place: Arc<Place>,
}

/// The writing end of a topic of results.
#[pyclass(frozen, module = "gantry._native")]
pub struct Publisher {
    port: Mutex<Option<SharedPort>>,
    slots: Mutex<Slots>,
    place: Arc<Place>,
    topic: String,
}

/// What was loaned so far.
struct Slots {
    /// Bytes of the longest body so far.
    longest: usize,
    /// Loans of the present slots whose arrays may still be there.
    held: Vec<Weak<Hold>>,
}

/// A slot of shared memory that is borrowed for writing.
#[pyclass(frozen, module = "gantry._native")]
pub struct Loan {
    // Before `hold`, which keeps its port.
    loan: Mutex<Option<Owned<ResultLoan>>>,
    memory: Memory,
    hold: Arc<Hold>,
}

#[pymethods]
impl Publisher {
    /// Opens a topic of results. `about` is its description as JSON; capacities of 0 are the usual
    /// ones of its type.
    #[new]
    #[pyo3(signature = (domain, topic, kind, *, about, body_bytes, loans, readers, buffer, borrowed))]
    #[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
    fn open(
        py: Python<'_>,
        domain: &str,
        topic: &str,
        kind: &str,
        about: &str,
        body_bytes: usize,
        loans: usize,
        readers: usize,
        buffer: usize,
        borrowed: usize,
    ) -> PyResult<Self> {
        let place = Place::of(domain)?;
        let mut spec = spec_of(kind, about)?;
        let or = |wish: usize, usual: usize| if wish == 0 { usual } else { wish };
        spec.body_bytes = or(body_bytes, spec.body_bytes);
        spec.max_loans = or(loans, spec.max_loans) + SPARE_LOANS;
        spec.qos.readers = or(readers, spec.qos.readers);
        spec.qos.buffer = or(buffer, spec.qos.buffer);
        spec.qos.borrowed = or(borrowed, spec.qos.borrowed);
        let port = py
            .detach(|| place.bus().result_publisher(topic, &spec))
            .map_err(errors::bus)?;
        Ok(Publisher {
            port: Mutex::new(Some(Arc::new(Owned::new(port)))),
            slots: Mutex::new(Slots {
                longest: spec.body_bytes,
                held: Vec::new(),
            }),
            place,
            topic: topic.to_owned(),
        })
    }

    /// Loans a slot for a body of up to `body_bytes`.
    fn loan(&self, body_bytes: usize) -> PyResult<Loan> {
        fork::check()?;
        let port = self.port()?;
        let mut slots = self.slots.lock();
        if body_bytes > slots.longest {
            slots.pin(&port)?;
            slots.longest = body_bytes;
        }
        let mut loan = port.loan(body_bytes).map_err(errors::loan)?;
        let hold = Arc::new(Hold {
            pins: Mutex::new(Vec::new()),
            port,
            _place: self.place.clone(),
        });
        slots.held.retain(|held| held.strong_count() > 0);
        slots.held.push(Arc::downgrade(&hold));
        Ok(Loan {
            memory: Memory {
                start: loan.body_ptr(),
                len: loan.room(),
            },
            loan: Mutex::new(Some(Owned::new(loan))),
            hold,
        })
    }

    /// Number of readers now.
    fn n_readers(&self) -> PyResult<usize> {
        fork::check()?;
        Ok(self.port()?.n_readers())
    }

    /// Closes the topic, once the last array of its loans is gone.
    fn close(&self, py: Python<'_>) {
        if fork::check().is_ok() {
            let port = self.port.lock().take();
            py.detach(|| drop(port));
        }
    }
}

impl Publisher {
    fn port(&self) -> PyResult<SharedPort> {
        let port = self.port.lock();
        port.clone().ok_or_else(|| {
            errors::gantry(format!(
                "topic \"{}/{}\" is closed",
                self.place.bus().domain(),
                self.topic
            ))
        })
    }
}

impl Slots {
    /// Keeps the present slots mapped for all arrays that are still there.
    fn pin(&mut self, port: &ResultPublisher) -> PyResult<()> {
        let held = std::mem::take(&mut self.held);
        let held: Vec<Arc<Hold>> = held.iter().filter_map(Weak::upgrade).collect();
        if !held.is_empty() {
            let pin = port.loan(1).map_err(errors::loan)?;
            let pin: Pin = Arc::new(Mutex::new(Owned::new(pin)));
            for hold in held {
                hold.pins.lock().push(pin.clone());
            }
        }
        Ok(())
    }
}

/// A topic of the named type with its usual capacities; `about` is its description as JSON.
pub fn spec_of(kind: &str, about: &str) -> PyResult<ResultTopic> {
    let kind = ResultType::from_name(kind).ok_or_else(|| {
        PyValueError::new_err(format!(
            "{kind:?} is no type of results; it must be one of {}",
            ResultType::names()
        ))
    })?;
    let about: About = serde_json::from_str(about)
        .map_err(|error| PyValueError::new_err(format!("the description is wrong: {error}")))?;
    Ok(ResultTopic {
        about,
        ..ResultTopic::new(kind)
    })
}

/// What a result says besides what its inputs do.
#[pyclass(frozen, module = "gantry._native")]
pub struct Said {
    tick: Option<u64>,
    sim_nanos: Option<u64>,
    size_px: Option<(u32, u32)>,
    space: Option<Space>,
    pose: Option<Pose>,
    intrinsics_px: Option<[f64; 4]>,
}

#[pymethods]
impl Said {
    #[new]
    #[pyo3(signature = (*, tick, sim_nanos, size_px, space, pose, intrinsics_px))]
    fn new(
        tick: Option<u64>,
        sim_nanos: Option<u64>,
        size_px: Option<(u32, u32)>,
        space: Option<&str>,
        pose: Option<([f64; 3], [f64; 4])>,
        intrinsics_px: Option<[f64; 4]>,
    ) -> PyResult<Self> {
        let names: Vec<&str> = Space::ALL.iter().map(|it| it.name()).collect();
        Ok(Said {
            tick,
            sim_nanos,
            size_px,
            space: space
                .map(|name| named("space", name, Space::from_name(name), &names))
                .transpose()?,
            pose: pose.map(|(translation_m, rotation_xyzw)| Pose {
                translation_m,
                rotation_xyzw,
            }),
            intrinsics_px,
        })
    }
}

impl Said {
    /// Writes it into a header; what is `None` stays.
    pub fn put(&self, header: &mut ResultHeader) {
        header.tick = self.tick.unwrap_or(header.tick);
        header.sim_nanos = self.sim_nanos.unwrap_or(header.sim_nanos);
        (header.width, header.height) = self.size_px.unwrap_or((header.width, header.height));
        header.space = self.space.map_or(header.space, |space| space as u32);
        header.intrinsics_px = self.intrinsics_px.unwrap_or(header.intrinsics_px);
        header.world_from_space = self.pose.unwrap_or(header.world_from_space);
    }
}

/// The pixel format of this name.
pub fn format_of(name: &str) -> PyResult<PixelFormat> {
    let names: Vec<&str> = PixelFormat::ALL.iter().map(|it| it.name()).collect();
    named("pixel format", name, PixelFormat::from_name(name), &names)
}

/// The type of elements of this name.
fn element_of(name: &str) -> PyResult<ElementType> {
    let names: Vec<&str> = ElementType::ALL.iter().map(|it| it.name()).collect();
    let found = ElementType::from_name(name);
    named("type of elements", name, found, &names)
}

impl Loan {
    fn with<T>(&self, act: impl FnOnce(&mut ResultLoan) -> PyResult<T>) -> PyResult<T> {
        fork::check()?;
        match &mut *self.loan.lock() {
            Some(loan) => act(loan),
            None => Err(gone()),
        }
    }
}

/// A loan is used that is no longer open.
pub fn gone() -> PyErr {
    errors::gantry("this loan was sent or dropped; loan again for the next result")
}

fn named<T>(what: &str, name: &str, found: Option<T>, all: &[&str]) -> PyResult<T> {
    found.ok_or_else(|| {
        PyValueError::new_err(format!(
            "{name:?} is no {what}; it must be one of {}",
            all.join(", ")
        ))
    })
}

/// Elements and sizes of a tensor as a header has them.
pub fn tensor_of(element: &str, sizes: &[usize]) -> PyResult<(ElementType, Vec<u32>)> {
    let sizes: PyResult<Vec<u32>> = sizes
        .iter()
        .map(|size| {
            u32::try_from(*size).map_err(|_| {
                PyValueError::new_err(format!("a size of {size} is more than 2^32 - 1"))
            })
        })
        .collect();
    Ok((element_of(element)?, sizes?))
}

#[pymethods]
impl Loan {
    /// Part of the body, from `offset` bytes on, as a writeable array that keeps this loan.
    fn array<'py>(
        slf: &Bound<'py, Self>,
        dtype: &Bound<'py, PyArrayDescr>,
        sizes: Vec<usize>,
        strides: Vec<usize>,
        offset: usize,
    ) -> PyResult<Bound<'py, PyAny>> {
        let this = slf.get();
        this.with(|_| Ok(()))?;
        let shape = Shape::of(&sizes, &strides)?;
        let memory = this.memory.part(offset, shape.span(dtype.itemsize()))?;
        // SAFETY: the loan's `Hold`, which lives as long as the loan and so as long as the array,
        // keeps the slot mapped: its port is not closed, and when slots grow, a pin keeps the old
        // ones. The part lies within the body. The mapping is writeable, and Rust holds no
        // reference to the body. Numbers and structs of numbers are all that `gantry` gives.
        unsafe { view::array(dtype, shape, memory, Access::Write, slf.clone().into_any()) }
    }

    /// Copies bytes into the body, from `offset` on.
    fn write(&self, offset: usize, bytes: &[u8]) -> PyResult<()> {
        self.with(|loan| {
            self.memory.part(offset, bytes.len())?;
            loan.body_mut()[offset..offset + bytes.len()].copy_from_slice(bytes);
            Ok(())
        })
    }

    /// Says that the body is a list of records, and behind them a tail.
    fn set_list(&self, n_items: u32, element_bytes: u32, tail_bytes: u64) -> PyResult<()> {
        self.with(|loan| {
            loan.set_list(n_items, element_bytes, tail_bytes)
                .map_err(errors::bus)
        })
    }

    /// Says that the body is an image in the named format.
    fn set_image(&self, width_px: u32, height_px: u32, format: &str) -> PyResult<()> {
        let format = format_of(format)?;
        self.with(|loan| {
            loan.set_image(width_px, height_px, format)
                .map_err(errors::bus)
        })
    }

    /// Says that the body is a tensor of the named elements.
    fn set_tensor(&self, element: &str, sizes: Vec<usize>) -> PyResult<()> {
        let (element, sizes) = tensor_of(element, &sizes)?;
        self.with(|loan| loan.set_tensor(element, &sizes).map_err(errors::bus))
    }

    /// Names a frame or a result that this result was computed from.
    fn answers(&self, input: Input<'_>) -> PyResult<()> {
        self.with(|loan| input.answered(|of| loan.answers(of)))
    }

    /// Fills in what the inputs do not say; what is `None` stays.
    fn describe(&self, said: PyRef<'_, Said>) -> PyResult<()> {
        self.with(|loan| {
            said.put(loan.header_mut());
            Ok(())
        })
    }

    /// Sends the result. Returns the number of readers that received it.
    fn send(&self) -> PyResult<usize> {
        fork::check()?;
        let loan = self.loan.lock().take();
        let loan = loan.ok_or_else(|| errors::gantry("this loan was sent or dropped before"))?;
        loan.into_inner().send().map_err(errors::bus)
    }

    /// Gives the slot back unsent. Does nothing after `send`.
    fn give_back(&self) {
        drop(self.loan.lock().take());
    }

    /// Topic without the domain.
    #[getter]
    fn topic(&self) -> String {
        self.hold.port.topic().to_owned()
    }
}
