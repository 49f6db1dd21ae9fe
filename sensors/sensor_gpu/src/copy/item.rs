//! One copy of a batch: where it comes from and where it goes.

use std::sync::Arc;

use super::place::{Place, ShmPlace};
use crate::queue::Reads;

/// Where a copy comes from.
#[derive(Clone, Debug)]
pub(crate) enum Source {
    Texture {
        texture: wgpu::Texture,
        layer: u32,
        row_bytes: usize,
        n_rows: usize,
    },
    Buffer {
        buffer: wgpu::Buffer,
        offset_bytes: u64,
        n_bytes: usize,
    },
}

impl Source {
    pub fn of_texture(texture: &wgpu::Texture, layer: u32, element_bytes: usize) -> Source {
        assert!(
            layer < texture.depth_or_array_layers(),
            "layer {layer} of a texture that has {}",
            texture.depth_or_array_layers()
        );
        let (row_bytes, n_rows) = (
            texture.width() as usize * element_bytes,
            texture.height() as usize,
        );
        Source::Texture {
            texture: texture.clone(),
            layer,
            row_bytes,
            n_rows,
        }
    }

    /// Bytes without padding.
    pub fn n_bytes(&self) -> usize {
        match self {
            Source::Texture {
                row_bytes, n_rows, ..
            } => row_bytes * n_rows,
            Source::Buffer { n_bytes, .. } => *n_bytes,
        }
    }

    /// Row length and distance between rows in a staging buffer.
    pub fn staged_rows(&self) -> (usize, usize) {
        match self {
            Source::Texture { row_bytes, .. } => (
                *row_bytes,
                row_bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize),
            ),
            Source::Buffer { n_bytes, .. } => (*n_bytes, n_bytes.next_multiple_of(4)),
        }
    }
}

#[derive(Debug)]
pub(crate) enum Sink<'a> {
    Place(Place<'a>),
    /// Left mapped for the CPU to read.
    Mapped,
}

#[derive(Debug)]
pub(crate) struct Item<'a> {
    pub source: Source,
    pub sink: Sink<'a>,
    pub staging: Option<wgpu::Buffer>,
    /// The source's group, if the copy queue may read it.
    pub shared: Option<Arc<Reads>>,
}

impl Item<'_> {
    /// The imported target; `None` for what goes through staging.
    pub fn imported(&self) -> Option<&wgpu::Buffer> {
        match &self.sink {
            Sink::Place(Place::Shm(place)) => place.target().imported(),
            _ => None,
        }
    }

    /// The place, if it is in memory of the device that other processes import.
    pub fn exported(&self) -> Option<&ShmPlace> {
        match &self.sink {
            Sink::Place(Place::Shm(place)) if place.target().is_exported() => Some(place),
            _ => None,
        }
    }

    /// Where the target begins in its segment.
    pub fn target_offset(&self) -> Option<u64> {
        match &self.sink {
            Sink::Place(Place::Shm(place)) => Some(place.offset_bytes() as u64),
            _ => None,
        }
    }
}
