//! numpy arrays over memory that another object owns.

#![expect(
    unsafe_code,
    reason = "numpy makes an array over foreign memory only through its C interface"
)]

use std::ffi::c_int;

use numpy::npyffi::{
    _PyArray_GET_ITEM_DATA, NPY_ARRAY_WRITEABLE, NpyTypes, PyArrayObject, get_type_object, npy_intp,
};
use numpy::{PY_ARRAY_API, PyArrayDescr, PyArrayDescrMethods as _};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Most dimensions of an array here: eight of a tensor, and one of its elements' parts.
const MAX_DIMENSIONS: usize = 10;

/// Sizes and strides of an array, slowest dimension first.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shape {
    sizes: [npy_intp; MAX_DIMENSIONS],
    strides: [npy_intp; MAX_DIMENSIONS],
    n: usize,
}

impl Shape {
    /// No dimension yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// With one more dimension of `size` elements, `stride_bytes` apart.
    ///
    /// # Panics
    /// Beyond ten dimensions.
    pub fn and(mut self, size: usize, stride_bytes: usize) -> Self {
        (self.sizes[self.n], self.strides[self.n]) = (size as npy_intp, stride_bytes as npy_intp);
        self.n += 1;
        self
    }

    /// With these sizes and strides in bytes, slowest dimension first.
    pub fn of(sizes: &[usize], strides: &[usize]) -> PyResult<Self> {
        // Products of what is allowed here stay far below an address.
        let fits = |n: &usize| *n <= isize::MAX as usize >> 16;
        if sizes.len() != strides.len()
            || sizes.len() > MAX_DIMENSIONS
            || !sizes.iter().chain(strides).all(fits)
        {
            return Err(PyValueError::new_err(format!(
                "an array of {sizes:?} elements, {strides:?} bytes apart, cannot be made"
            )));
        }
        let dimensions = sizes.iter().zip(strides);
        Ok(dimensions.fold(Shape::new(), |shape, (size, by)| shape.and(*size, *by)))
    }

    /// Bytes from the first element to the end of the last; 0 without elements.
    pub fn span(&self, element_bytes: usize) -> usize {
        let (sizes, strides) = (&self.sizes[..self.n], &self.strides[..self.n]);
        if sizes.contains(&0) {
            return 0;
        }
        let mut dimensions = sizes.iter().zip(strides);
        let last = dimensions.try_fold(element_bytes as npy_intp, |end, (n, by)| {
            end.checked_add((n - 1).checked_mul(*by)?)
        });
        last.map_or(usize::MAX, |end| end as usize)
    }
}

/// Whether numpy may write through an array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Reading only, because the mapping is read-only: a write would be a segmentation fault.
    Read,
    /// Reading and writing.
    Write,
}

/// Memory that `base` keeps in place as long as it lives.
#[derive(Clone, Copy, Debug)]
pub struct Memory {
    /// Address of the first byte.
    pub start: *mut u8,
    /// Number of bytes.
    pub len: usize,
}

impl Memory {
    /// The `len` bytes from `offset` on.
    pub fn part(&self, offset: usize, len: usize) -> PyResult<Memory> {
        match offset.checked_add(len) {
            Some(end) if end <= self.len => Ok(Memory {
                start: self.start.wrapping_add(offset),
                len,
            }),
            _ => Err(PyValueError::new_err(format!(
                "{len} bytes from byte {offset} on reach beyond the {} bytes that there are",
                self.len
            ))),
        }
    }
}

// SAFETY: an address and a number; who reads through it proves that it may.
unsafe impl Send for Memory {}
// SAFETY: as above.
unsafe impl Sync for Memory {}

/// Makes an array of `element`s at the start of `memory`, without a copy. The array keeps `base`.
///
/// # Safety
/// `memory` stays readable (and with [`Access::Write`] writeable) at its address as long as `base`
/// lives, and `element` holds no Python objects.
///
/// # Panics
/// If the array would reach beyond the memory.
pub unsafe fn array<'py>(
    element: &Bound<'py, PyArrayDescr>,
    mut shape: Shape,
    memory: Memory,
    access: Access,
    base: Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = element.py();
    assert!(
        shape.span(element.itemsize()) <= memory.len,
        "an array reaches beyond its memory"
    );
    let flags = match access {
        Access::Read => 0,
        Access::Write => NPY_ARRAY_WRITEABLE,
    };
    // SAFETY: type object and functions are numpy's own, which rust-numpy has checked for their
    // version. The descriptor's reference is given away, as the call wants it, sizes and strides
    // are read during the call only, and they stay within the memory by the check above. The result
    // is a new reference or null with an exception set. The second call takes over the reference to
    // the base also if it fails.
    unsafe {
        let array = PY_ARRAY_API.PyArray_NewFromDescr(
            py,
            get_type_object(py, NpyTypes::PyArray_Type),
            element.clone().into_dtype_ptr(),
            shape.n as c_int,
            shape.sizes.as_mut_ptr(),
            shape.strides.as_mut_ptr(),
            memory.start.cast(),
            flags,
            std::ptr::null_mut(),
        );
        let array = Bound::from_owned_ptr_or_err(py, array)?;
        let done = PY_ARRAY_API.PyArray_SetBaseObject(
            py,
            array.as_ptr().cast::<PyArrayObject>(),
            base.into_ptr(),
        );
        match done {
            0 => Ok(array),
            _ => Err(PyErr::fetch(py)),
        }
    }
}

/// Makes a read-only array of `element`s that shows no memory yet; see [`place`].
pub fn blank<'py>(
    element: &Bound<'py, PyArrayDescr>,
    shape: Shape,
    base: Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    // Aligned as payloads are, so that the array's flags hold later, too.
    const NOWHERE: Memory = Memory {
        start: std::ptr::without_provenance_mut(64),
        len: isize::MAX as usize,
    };
    // SAFETY: making and dropping an array touches none of its elements, and nobody is given the
    // array before it is placed.
    unsafe { array(element, shape, NOWHERE, Access::Read, base) }
}

/// Lets an array of [`blank`] show `memory`.
///
/// # Safety
/// The array was made by [`blank`], was given to nobody, and has `span` bytes from its first to its
/// last; `memory` stays readable at its address as long as the array's base lives.
///
/// # Panics
/// If the array would reach beyond the memory.
pub unsafe fn place(array: &Bound<'_, PyAny>, span: usize, memory: Memory) {
    let array = array.as_ptr().cast::<PyArrayObject>();
    assert!(span <= memory.len, "an array reaches beyond its memory");
    // SAFETY: it is an array, whose fields numpy's C interface makes public, and this is the only
    // reference to it.
    unsafe { (*_PyArray_GET_ITEM_DATA(array)).data = memory.start.cast() };
}
