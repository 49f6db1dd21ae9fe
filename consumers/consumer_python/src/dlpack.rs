//! Frames on a GPU in the hands of torch, cupy and jax: DLPack capsules over memory of the device.
//!
//! A capsule keeps its frame. Whoever takes it calls its deleter when the last tensor is gone, from
//! any thread; the frame then waits for what its device was given until that moment.

#![expect(
    unsafe_code,
    reason = "DLPack is an interface in C; each block carries its proof"
)]

use std::ffi::{CStr, c_void};
use std::sync::Arc;

use consumer_gpu::FrameOnGpu;
use pyo3::exceptions::PyBufferError;
use pyo3::ffi;
use pyo3::prelude::*;

use schema_frames::Modality;

use crate::fork::Owned;

/// DLPack's number of the processor's memory.
const CPU: i32 = 1;
/// DLPack's number of CUDA's memory.
const CUDA: i32 = 2;
const UNSIGNED: u8 = 1;
const FLOAT: u8 = 2;
const NAME: &CStr = c"dltensor";

#[repr(C)]
struct Device {
    kind: i32,
    number: i32,
}

#[repr(C)]
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

/// A capsule's own memory.
struct Context {
    _frame: Arc<Owned<FrameOnGpu>>,
    sizes: Vec<i64>,
    strides: Vec<i64>,
}

/// Element type and parts of an element.
fn element(modality: Modality) -> (DataType, usize) {
    let (code, bits, parts) = match modality {
        Modality::Rgb => (UNSIGNED, 8, 4),
        Modality::Depth => (FLOAT, 32, 0),
        Modality::Semantic => (UNSIGNED, 8, 0),
        Modality::Instance => (UNSIGNED, 32, 0),
        Modality::Flow => (FLOAT, 32, 2),
        Modality::Normals => (FLOAT, 16, 4),
        // Records have no type of their own in DLPack: their bytes.
        other => (UNSIGNED, 8, other.element_bytes()),
    };
    let data_type = DataType {
        code,
        bits,
        lanes: 1,
    };
    (data_type, parts)
}

/// Sizes and strides in elements, slowest dimension first.
pub fn shape(frame: &FrameOnGpu) -> (Vec<i64>, Vec<i64>) {
    let header = frame.header();
    let (data_type, parts) = element(frame.modality());
    let bytes = i64::from(data_type.bits / 8);
    let (mut sizes, mut strides) = (Vec::new(), Vec::new());
    let mut and = |size: i64, by_bytes: i64| {
        sizes.push(size);
        strides.push(by_bytes / bytes);
    };
    let is_image = frame.modality().is_image();
    let (rows, stride) = (
        i64::from(header.image_height()),
        i64::from(header.row_stride),
    );
    if header.is_batch() {
        and(i64::from(header.n_images), rows * stride);
    }
    if is_image {
        and(rows, stride);
    }
    let width = if header.height == 0 { 0 } else { header.width };
    and(i64::from(width), i64::from(header.element_bytes));
    if parts > 0 {
        and(parts as i64, bytes);
    }
    (sizes, strides)
}

/// Kind and number of the frame's device, as DLPack counts them.
pub fn device(frame: &FrameOnGpu) -> (i32, i32) {
    match frame.device() {
        Some(number) => (CUDA, number),
        None => (CPU, 0),
    }
}

unsafe extern "C" fn delete(managed: *mut Managed) {
    // SAFETY: DLPack's rule: called once, with what `capsule` made.
    unsafe {
        let managed = Box::from_raw(managed);
        drop(Box::from_raw(managed.context.cast::<Context>()));
    }
}

unsafe extern "C" fn drop_capsule(capsule: *mut ffi::PyObject) {
    // SAFETY: Python calls this with the capsule that is being dropped. One that was taken has
    // another name by DLPack's rule, and is its taker's.
    unsafe {
        if ffi::PyCapsule_IsValid(capsule, NAME.as_ptr()) == 1 {
            delete(ffi::PyCapsule_GetPointer(capsule, NAME.as_ptr()).cast());
        }
    }
}

/// The frame as a capsule for `stream`, a stream of CUDA as DLPack names it.
pub fn capsule<'py>(
    py: Python<'py>,
    frame: &Arc<Owned<FrameOnGpu>>,
    stream: Option<i64>,
) -> PyResult<Bound<'py, PyAny>> {
    if stream == Some(0) {
        return Err(PyBufferError::new_err(
            "stream 0 is ambiguous; give 1 for CUDA's legacy default stream, 2 for the one per thread, or -1",
        ));
    }
    // 1, 2 and -1 are no addresses: the legacy stream waits for them.
    frame.is_read_by(stream.filter(|stream| *stream > 2).unwrap_or(0) as u64);
    let (sizes, strides) = shape(frame);
    let (data_type, _) = element(frame.modality());
    let (kind, number) = device(frame);
    let mut context = Box::new(Context {
        _frame: frame.clone(),
        sizes,
        strides,
    });
    let managed = Box::new(Managed {
        tensor: Tensor {
            data: frame.address() as *mut c_void,
            device: Device { kind, number },
            n_dimensions: context.sizes.len() as i32,
            data_type,
            sizes: context.sizes.as_mut_ptr(),
            strides: context.strides.as_mut_ptr(),
            byte_offset: 0,
        },
        context: Box::into_raw(context).cast(),
        deleter: Some(delete),
    });
    let managed = Box::into_raw(managed);
    // SAFETY: the pointer is not null, and the name lives for ever; the result is a new reference
    // or null with an exception set.
    unsafe {
        let capsule = ffi::PyCapsule_New(managed.cast(), NAME.as_ptr(), Some(drop_capsule));
        Bound::from_owned_ptr_or_err(py, capsule).inspect_err(|_| delete(managed))
    }
}

/// What `__cuda_array_interface__` says of elements: numpy's name of their type.
pub fn type_text(modality: Modality) -> &'static str {
    match element(modality).0 {
        DataType {
            code: FLOAT,
            bits: 32,
            ..
        } => "<f4",
        DataType { code: FLOAT, .. } => "<f2",
        DataType { bits: 32, .. } => "<u4",
        _ => "|u1",
    }
}

/// Strides in bytes.
pub fn byte_strides(frame: &FrameOnGpu) -> Vec<i64> {
    let bytes = i64::from(element(frame.modality()).0.bits / 8);
    shape(frame).1.into_iter().map(|by| by * bytes).collect()
}
