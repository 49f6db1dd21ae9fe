//! Arrays in memory of a device, in the hands of torch, cupy and jax: DLPack capsules, given and
//! taken.
//!
//! A capsule that is given keeps what its memory belongs to. Whoever takes it calls its deleter when
//! the last tensor is gone, from any thread; a sample then waits for what its device was given until
//! that moment.

#![expect(
    unsafe_code,
    reason = "DLPack is an interface in C; each block carries its proof"
)]

use std::ffi::{CStr, c_void};

use consumer_gpu::{FrameOnGpu, GpuLoan, ResultOnGpu};
use pyo3::exceptions::{PyBufferError, PyValueError};
use pyo3::ffi;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

use schema_frames::{ElementType, Modality, PixelFormat, ResultHeader};

/// DLPack's number of the processor's memory.
const CPU: i32 = 1;
/// DLPack's number of CUDA's memory.
const CUDA: i32 = 2;
/// DLPack's number of memory that CUDA moves where it is used.
const CUDA_MANAGED: i32 = 13;
const SIGNED: u8 = 0;
const UNSIGNED: u8 = 1;
const FLOAT: u8 = 2;
const BRAIN_FLOAT: u8 = 4;
const COMPLEX: u8 = 5;
const BOOL: u8 = 6;
const NAME: &CStr = c"dltensor";
/// What a capsule is called that somebody has taken.
const TAKEN: &CStr = c"used_dltensor";

/// Most dimensions: eight of a tensor, and one of its elements' parts.
const MAX_DIMENSIONS: usize = 9;

#[repr(C)]
#[derive(Clone, Copy)]
struct Device {
    kind: i32,
    number: i32,
}

#[repr(C)]
#[derive(Clone, Copy, PartialEq)]
struct DataType {
    code: u8,
    bits: u8,
    lanes: u16,
}

#[repr(C)]
struct Tensor {
    data: *mut c_void,
    device: Device,
    n_dimensions: i32,
    data_type: DataType,
    sizes: *mut i64,
    strides: *mut i64,
    byte_offset: u64,
}

/// `DLManagedTensor`, as all versions of DLPack understand it.
#[repr(C)]
struct Managed {
    tensor: Tensor,
    context: *mut c_void,
    deleter: Option<unsafe extern "C" fn(*mut Managed)>,
}

/// A capsule's own memory; its first part is what others know of it.
#[repr(C)]
struct Own<K> {
    managed: Managed,
    sizes: [i64; MAX_DIMENSIONS],
    strides: [i64; MAX_DIMENSIONS],
    _keeper: K,
}

const fn of(code: u8, bits: u8) -> DataType {
    DataType {
        code,
        bits,
        lanes: 1,
    }
}

/// Element type of a modality, and parts of an element.
fn element(modality: Modality) -> (DataType, usize) {
    match modality {
        Modality::Rgb => (of(UNSIGNED, 8), 4),
        Modality::Depth => (of(FLOAT, 32), 0),
        Modality::Semantic => (of(UNSIGNED, 8), 0),
        Modality::Instance => (of(UNSIGNED, 32), 0),
        Modality::Flow => (of(FLOAT, 32), 2),
        Modality::Normals => (of(FLOAT, 16), 4),
        // Records have no type of their own in DLPack: their bytes.
        other => (of(UNSIGNED, 8), other.element_bytes()),
    }
}

fn of_pixels(format: PixelFormat) -> (DataType, usize) {
    match format {
        PixelFormat::Bgra8 | PixelFormat::Rgba8 => (of(UNSIGNED, 8), 4),
        PixelFormat::Bgr8 | PixelFormat::Rgb8 => (of(UNSIGNED, 8), 3),
        PixelFormat::Class | PixelFormat::Mono8 => (of(UNSIGNED, 8), 0),
        PixelFormat::Mono16 => (of(UNSIGNED, 16), 0),
        PixelFormat::Id => (of(UNSIGNED, 32), 0),
        PixelFormat::Depth | PixelFormat::Mono32f => (of(FLOAT, 32), 0),
        PixelFormat::Flow => (of(FLOAT, 32), 2),
        PixelFormat::Normals => (of(FLOAT, 16), 4),
    }
}

fn of_elements(of_type: ElementType) -> DataType {
    let code = match of_type {
        ElementType::U8 | ElementType::U16 | ElementType::U32 | ElementType::U64 => UNSIGNED,
        ElementType::I8 | ElementType::I16 | ElementType::I32 | ElementType::I64 => SIGNED,
        ElementType::F16 | ElementType::F32 | ElementType::F64 => FLOAT,
        ElementType::Bool => BOOL,
    };
    of(code, 8 * of_type.element_bytes() as u8)
}

/// What `__cuda_array_interface__` says: address, sizes, strides in bytes and numpy's type.
pub type Interface = (u64, Vec<i64>, Vec<i64>, String);

/// An array in memory of a device.
#[derive(Clone, Copy)]
pub struct Array {
    address: u64,
    device: Device,
    data_type: DataType,
    n_dimensions: usize,
    sizes: [i64; MAX_DIMENSIONS],
    /// In elements.
    strides: [i64; MAX_DIMENSIONS],
}

impl Array {
    fn new(address: u64, cuda: Option<i32>, data_type: DataType) -> Array {
        Array {
            address,
            device: match cuda {
                Some(number) => Device { kind: CUDA, number },
                None => Device {
                    kind: CPU,
                    number: 0,
                },
            },
            data_type,
            n_dimensions: 0,
            sizes: [0; MAX_DIMENSIONS],
            strides: [0; MAX_DIMENSIONS],
        }
    }

    fn bytes(&self) -> i64 {
        i64::from(self.data_type.bits / 8)
    }

    /// With one more dimension, whose elements are so many bytes apart.
    fn and(mut self, size: i64, by_bytes: i64) -> Array {
        self.sizes[self.n_dimensions] = size;
        self.strides[self.n_dimensions] = by_bytes / self.bytes();
        self.n_dimensions += 1;
        self
    }

    /// The payload of a frame.
    pub fn of_frame(frame: &FrameOnGpu) -> Array {
        let (header, modality) = (frame.header(), frame.modality());
        let (data_type, parts) = element(modality);
        let mut array = Array::new(frame.address(), frame.device(), data_type);
        let rows = i64::from(header.image_height());
        let stride = i64::from(header.row_stride);
        if header.is_batch() {
            array = array.and(i64::from(header.n_images), rows * stride);
        }
        if modality.is_image() {
            array = array.and(rows, stride);
        }
        let width = if header.height == 0 { 0 } else { header.width };
        array = array.and(i64::from(width), i64::from(header.element_bytes));
        match parts {
            0 => array,
            parts => array.and(parts as i64, array.bytes()),
        }
    }

    /// The body of a result.
    pub fn of_result(result: &ResultOnGpu) -> Array {
        Array::of_body(result.header(), result.address(), result.device())
    }

    /// The slot of a loan, for a result with this header.
    pub fn of_loan(loan: &GpuLoan, header: &ResultHeader) -> Array {
        Array::of_body(header, loan.address(), Some(loan.device()))
    }

    fn of_body(header: &ResultHeader, address: u64, cuda: Option<i32>) -> Array {
        if let Some(format) = header.pixel_format() {
            let (data_type, parts) = of_pixels(format);
            let array = Array::new(address, cuda, data_type)
                .and(i64::from(header.height), i64::from(header.row_stride))
                .and(i64::from(header.width), i64::from(header.element_bytes));
            return match parts {
                0 => array,
                parts => array.and(parts as i64, array.bytes()),
            };
        }
        let data_type = header.element_type().map_or(of(UNSIGNED, 8), of_elements);
        let mut array = Array::new(address, cuda, data_type);
        let mut strides = [0; MAX_DIMENSIONS];
        let mut by = array.bytes();
        for (i, size) in header.shape().iter().enumerate().rev() {
            strides[i] = by;
            by = by.saturating_mul(i64::from(*size));
        }
        for (size, by) in header.shape().iter().zip(strides) {
            array = array.and(i64::from(*size), by);
        }
        array
    }

    /// Sizes, slowest dimension first.
    pub fn sizes(&self) -> &[i64] {
        &self.sizes[..self.n_dimensions]
    }

    /// Kind and number of the device, as DLPack counts them.
    pub fn device(&self) -> (i32, i32) {
        (self.device.kind, self.device.number)
    }

    /// Address, sizes, strides in bytes and numpy's type, for `__cuda_array_interface__`; `None`
    /// if it is not on a device of CUDA.
    pub fn interface(&self) -> Option<Interface> {
        let strides = &self.strides[..self.n_dimensions];
        let strides = strides.iter().map(|by| by * self.bytes()).collect();
        let is_there = self.device.kind == CUDA;
        is_there.then(|| {
            (
                self.address,
                self.sizes().to_vec(),
                strides,
                self.type_text(),
            )
        })
    }

    /// numpy's name of the elements' type.
    fn type_text(&self) -> String {
        let letter = match self.data_type.code {
            SIGNED => 'i',
            UNSIGNED => 'u',
            FLOAT => 'f',
            COMPLEX => 'c',
            BOOL => 'b',
            _ => 'V',
        };
        let order = if self.data_type.bits == 8 { '|' } else { '<' };
        format!("{order}{letter}{}", self.data_type.bits / 8)
    }

    /// A capsule, which keeps `keeper`.
    pub fn capsule<'py, K: Send + Sync + 'static>(
        &self,
        py: Python<'py>,
        keeper: K,
    ) -> PyResult<Bound<'py, PyAny>> {
        let own = Box::into_raw(Box::new(Own {
            managed: Managed {
                tensor: Tensor {
                    data: self.address as *mut c_void,
                    device: self.device,
                    n_dimensions: self.n_dimensions as i32,
                    data_type: self.data_type,
                    sizes: std::ptr::null_mut(),
                    strides: std::ptr::null_mut(),
                    byte_offset: 0,
                },
                context: std::ptr::null_mut(),
                deleter: Some(delete::<K>),
            },
            sizes: self.sizes,
            strides: self.strides,
            _keeper: keeper,
        }));
        // SAFETY: the box was just made and is nobody else's yet; its parts stay where they are
        // until it is deleted. The capsule's pointer is not null, and the name lives for ever; the
        // result is a new reference or null with an exception set.
        unsafe {
            (*own).managed.tensor.sizes = (&raw mut (*own).sizes).cast();
            (*own).managed.tensor.strides = (&raw mut (*own).strides).cast();
            let capsule = ffi::PyCapsule_New(own.cast(), NAME.as_ptr(), Some(drop_capsule));
            Bound::from_owned_ptr_or_err(py, capsule).inspect_err(|_| drop(Box::from_raw(own)))
        }
    }

    /// A tensor of torch. Samples are sent once their bytes are complete, so torch is given the
    /// capsule itself and need not look for streams to wait for.
    pub fn torch<K: Send + Sync + 'static>(
        &self,
        py: Python<'_>,
        keeper: K,
    ) -> PyResult<Py<PyAny>> {
        static FROM_CAPSULE: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
        let from_capsule = FROM_CAPSULE.get_or_try_init(py, || {
            let module = py.import("torch.utils.dlpack")?;
            PyResult::Ok(module.getattr("from_dlpack")?.unbind())
        })?;
        from_capsule.call1(py, (self.capsule(py, keeper)?,))
    }
}

unsafe extern "C" fn delete<K>(managed: *mut Managed) {
    // SAFETY: DLPack's rule: called once, with what `capsule` made for a keeper of this type, of
    // which it is the first part.
    drop(unsafe { Box::from_raw(managed.cast::<Own<K>>()) });
}

unsafe extern "C" fn drop_capsule(capsule: *mut ffi::PyObject) {
    // SAFETY: Python calls this with the capsule that is being dropped. One that was taken has
    // another name by DLPack's rule, and is its taker's.
    unsafe {
        if ffi::PyCapsule_IsValid(capsule, NAME.as_ptr()) == 1 {
            let managed: *mut Managed = ffi::PyCapsule_GetPointer(capsule, NAME.as_ptr()).cast();
            if let Some(deleter) = (*managed).deleter {
                deleter(managed);
            }
        }
    }
}

/// Refuses a stream that means two things; `None` for CUDA's own numbers, which are no addresses.
pub fn stream_address(stream: Option<i64>) -> PyResult<u64> {
    if stream == Some(0) {
        return Err(PyBufferError::new_err(
            "stream 0 is ambiguous; give 1 for CUDA's legacy default stream, 2 for the one per thread, or -1",
        ));
    }
    // 1, 2 and -1 are no addresses: the legacy stream waits for them.
    Ok(stream.filter(|stream| *stream > 2).unwrap_or(0) as u64)
}

/// `torch.from_dlpack`, which looks for streams.
pub fn torch_from(py: Python<'_>, sample: &Bound<'_, PyAny>) -> PyResult<Py<PyAny>> {
    let from_dlpack = py.import("torch")?.getattr("from_dlpack")?;
    Ok(from_dlpack.call1((sample,))?.unbind())
}

/// An array of another library, taken from it for as long as this lives.
#[pyclass(frozen, module = "gantry._native")]
pub struct Foreign {
    array: Array,
    _owner: Owner,
}

/// Who keeps the memory.
enum Owner {
    /// A capsule that was taken; its deleter gives it back.
    Capsule(*mut Managed),
    /// An object that showed `__cuda_array_interface__`.
    Object(#[expect(dead_code, reason = "kept alive, never looked at")] Py<PyAny>),
}

// SAFETY: DLPack's deleters may be called from any thread.
unsafe impl Send for Owner {}
// SAFETY: nothing is read through it.
unsafe impl Sync for Owner {}

impl Drop for Owner {
    fn drop(&mut self) {
        if let Owner::Capsule(managed) = self {
            // SAFETY: taken from its capsule by `take_capsule`, which nobody else did, and not
            // deleted yet.
            unsafe {
                if let Some(deleter) = (**managed).deleter {
                    deleter(*managed);
                }
            }
        }
    }
}

impl Foreign {
    /// Address of its first byte.
    pub fn address(&self) -> u64 {
        self.array.address
    }

    /// Whether it is on this device of CUDA.
    pub fn is_on(&self, number: i32) -> bool {
        matches!(self.array.device.kind, CUDA | CUDA_MANAGED) && self.array.device.number == number
    }

    /// Number of its bytes.
    pub fn n_bytes(&self) -> u64 {
        let sizes = self.array.sizes().iter();
        let n = sizes.fold(1i64, |n, size| n.saturating_mul(*size));
        n.saturating_mul(self.array.bytes()).max(0) as u64
    }

    fn checked(array: Array, owner: Owner) -> PyResult<Foreign> {
        let of = array.data_type;
        if of.lanes != 1 || !matches!(of.bits, 8 | 16 | 32 | 64 | 128) || of.code > BOOL {
            return Err(PyValueError::new_err(format!(
                "an array of DLPack's type {} with {} bits and {} lanes cannot be sent",
                of.code, of.bits, of.lanes
            )));
        }
        if of.code == BRAIN_FLOAT {
            return Err(PyValueError::new_err(
                "a tensor of bfloat16 cannot be sent, because numpy has no such type; send tensor.half(), tensor.float(), or the bits: tensor.view(torch.uint16)",
            ));
        }
        Ok(Foreign {
            array,
            _owner: owner,
        })
    }
}

#[pymethods]
impl Foreign {
    /// Sizes, slowest dimension first.
    #[getter]
    fn sizes(&self) -> Vec<i64> {
        self.array.sizes().to_vec()
    }

    /// Number of its device.
    #[getter]
    fn device(&self) -> i32 {
        self.array.device.number
    }

    /// numpy's name of the elements' type.
    #[getter]
    fn dtype(&self) -> String {
        self.array.type_text()
    }

    /// Whether its elements lie one behind the other.
    #[getter]
    fn is_contiguous(&self) -> bool {
        let array = &self.array;
        if array.sizes().contains(&0) {
            return true;
        }
        let mut by = 1i64;
        (0..array.n_dimensions).rev().all(|i| {
            let fits = array.sizes[i] == 1 || array.strides[i] == by;
            by = by.saturating_mul(array.sizes[i]);
            fits
        })
    }
}

fn too_many(n: usize) -> PyErr {
    PyValueError::new_err(format!(
        "an array of {n} dimensions cannot be sent; up to 8 can"
    ))
}

/// Takes an array out of a DLPack capsule.
#[pyfunction]
pub fn take_capsule(capsule: &Bound<'_, PyAny>) -> PyResult<Foreign> {
    let py = capsule.py();
    let pointer = capsule.as_ptr();
    // SAFETY: both calls only look at the object, and say if it is no capsule of this name.
    let managed: *mut Managed = unsafe {
        if ffi::PyCapsule_IsValid(pointer, NAME.as_ptr()) != 1 {
            return Err(PyValueError::new_err(
                "__dlpack__ gave no capsule of a tensor, or one that was taken before",
            ));
        }
        ffi::PyCapsule_GetPointer(pointer, NAME.as_ptr()).cast()
    };
    // SAFETY: a capsule of this name holds a `DLManagedTensor` by DLPack's rule, and renaming it
    // makes it this call's.
    let tensor = unsafe {
        if ffi::PyCapsule_SetName(pointer, TAKEN.as_ptr()) != 0 {
            return Err(PyErr::fetch(py));
        }
        &(*managed).tensor
    };
    let owner = Owner::Capsule(managed);
    let n = tensor.n_dimensions.max(0) as usize;
    if n > MAX_DIMENSIONS {
        return Err(too_many(n));
    }
    let mut array = Array {
        address: tensor.data as u64 + tensor.byte_offset,
        device: tensor.device,
        data_type: tensor.data_type,
        n_dimensions: n,
        sizes: [0; MAX_DIMENSIONS],
        strides: [0; MAX_DIMENSIONS],
    };
    let mut by = 1i64;
    for i in (0..n).rev() {
        // SAFETY: DLPack's rule: as many sizes as dimensions, and as many strides or none, which
        // means that elements lie one behind the other.
        unsafe {
            array.sizes[i] = *tensor.sizes.add(i);
            array.strides[i] = match tensor.strides.is_null() {
                true => by,
                false => *tensor.strides.add(i),
            };
        }
        by = by.saturating_mul(array.sizes[i]);
    }
    Foreign::checked(array, owner)
}

/// Takes an array that shows `__cuda_array_interface__`: its address, sizes, strides in bytes or
/// None, and numpy's name of its type. `owner` keeps its memory.
#[pyfunction]
pub fn take_interface(
    owner: Py<PyAny>,
    address: u64,
    sizes: Vec<i64>,
    strides: Option<Vec<i64>>,
    typestr: &str,
) -> PyResult<Foreign> {
    if sizes.len() > MAX_DIMENSIONS {
        return Err(too_many(sizes.len()));
    }
    let wrong = || {
        PyValueError::new_err(format!(
            "an array of type {typestr:?} cannot be sent; bool, int, uint and float of 8 to 64 bits can"
        ))
    };
    let (order, rest) = typestr.split_at_checked(1).ok_or_else(wrong)?;
    let (letter, bytes) = rest.split_at_checked(1).ok_or_else(wrong)?;
    let code = match (order, letter) {
        (">", _) => return Err(wrong()),
        (_, "i") => SIGNED,
        (_, "u") => UNSIGNED,
        (_, "f") => FLOAT,
        (_, "c") => COMPLEX,
        (_, "b") => BOOL,
        _ => return Err(wrong()),
    };
    let bytes: u8 = bytes.parse().map_err(|_| wrong())?;
    let bits = bytes.checked_mul(8).ok_or_else(wrong)?;
    let number = consumer_gpu::device_of(address).map_err(crate::errors::gpu)?;
    let mut array = Array::new(address, Some(number), of(code, bits));
    let mut by = array.bytes().max(1);
    let mut tight = vec![0; sizes.len()];
    for (i, size) in sizes.iter().enumerate().rev() {
        tight[i] = by;
        by = by.saturating_mul(*size);
    }
    let strides = strides.unwrap_or(tight);
    if strides.len() != sizes.len() || bytes == 0 {
        return Err(wrong());
    }
    for (size, by) in sizes.iter().zip(&strides) {
        array = array.and(*size, *by);
    }
    Foreign::checked(array, Owner::Object(owner))
}
