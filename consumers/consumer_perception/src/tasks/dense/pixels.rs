//! What tasks with an answer for every pixel have in common.

use bytemuck::AnyBitPattern;
use schema_frames::{ElementType, ResultType};

use crate::picture::pixels::Pixels;
use crate::tasks::Unreadable;
use crate::tasks::measure::Reading;

/// The pixels of a result that has some of `T`'s size, or the elements of a tensor with the shape
/// (height, width), with ones before or behind.
///
/// # Errors
/// A sentence if its body is shorter than its shape, or its elements are others.
pub fn read_pixels<T: AnyBitPattern>(reading: &Reading<'_>) -> Result<Pixels<T>, Unreadable> {
    let header = &reading.result.header;
    let bytes = size_of::<T>();
    if header.element_bytes as usize != bytes {
        return Err(format!(
            "has elements of {} bytes, but must have {bytes}",
            header.element_bytes
        )
        .into());
    }
    let (width, height, stride) = match header.kind() {
        Some(ResultType::Tensor) => {
            let sizes: Vec<u32> = header.shape().iter().copied().filter(|n| *n != 1).collect();
            let &[height, width] = &sizes[..] else {
                return Err(format!(
                    "is a tensor of shape {:?}, but must be (height, width)",
                    header.shape()
                )
                .into());
            };
            (width, height, width as usize * bytes)
        }
        _ => (header.width, header.height, header.row_stride as usize),
    };
    let row_bytes = width as usize * bytes;
    let mut values = Vec::with_capacity(width as usize * height as usize);
    for row in 0..height as usize {
        let at = row * stride;
        let row = reading.body.get(at..at + row_bytes);
        let row = row.ok_or("is shorter than its shape says")?;
        values.extend(
            row.chunks_exact(bytes)
                .map(bytemuck::pod_read_unaligned::<T>),
        );
    }
    Ok(Pixels {
        width,
        height,
        values,
    })
}

/// Whether a tensor's elements are of a type; true of results that are no tensors.
pub fn has_elements(reading: &Reading<'_>, element: ElementType) -> bool {
    let header = &reading.result.header;
    header.kind() != Some(ResultType::Tensor) || header.element_type() == Some(element)
}

/// Distances of strata of pixels, metres.
pub const DEPTHS_M: [(f32, f32, &str); 4] = [
    (0.0, 10.0, "0-10"),
    (10.0, 20.0, "10-20"),
    (20.0, 40.0, "20-40"),
    (40.0, f32::INFINITY, "40-"),
];

/// Strata by [`DEPTHS_M`].
pub fn depth_strata() -> Vec<(&'static str, &'static str)> {
    DEPTHS_M.map(|(_, _, part)| ("distance_m", part)).to_vec()
}

/// Pixels of a mask whose depth lies in a stratum.
pub fn in_depth(depth_m: &[f32], mask: &[bool], stratum: usize) -> Vec<bool> {
    let (low, high, _) = DEPTHS_M[stratum];
    let of = depth_m.iter().zip(mask);
    of.map(|(depth, counts)| *counts && (low..high).contains(depth))
        .collect()
}
