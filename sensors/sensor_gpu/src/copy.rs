//! Copies out of textures and buffers: one batch per submission, two ways to the reader, one interface.
//!
//! Imported targets get a raw `vkCmdCopyImageToBuffer` with tight rows, because wgpu's own copy pads rows to 256 bytes.
//! The order is: the caller's passes and the transitions to COPY_SRC/COPY_DST (first encoder), the raw copies (second; wgpu does not
//! allow raw and ordinary calls in one encoder), the transition that makes the bytes visible to the host (third), all in one submit.

use std::sync::Arc;

use ash::vk;
use wgpu::hal::api::Vulkan;
use wgpu::wgt;

use crate::device::{Gpu, GpuError};
use crate::direct::AWAKE;
use crate::target::ShmTarget;
use crate::timing::Pending;

/// Where bytes go.
#[derive(Debug)]
pub enum Place<'a> {
    /// A range of a target that begins at this offset; the caller holds it alone (see [`ShmTarget::import`]).
    Shm {
        /// The segment.
        target: Arc<ShmTarget>,
        /// Where the payload begins, bytes from the segment's base; a multiple of 4 and of the element size.
        offset_bytes: usize,
        /// Length of the payload's memory.
        capacity_bytes: usize,
    },
    /// Ordinary memory.
    Memory(&'a mut [u8]),
}

impl Place<'_> {
    /// Room there, bytes.
    pub fn capacity_bytes(&self) -> usize {
        match self {
            Place::Shm { capacity_bytes, .. } => *capacity_bytes,
            Place::Memory(memory) => memory.len(),
        }
    }

    /// Copies by the CPU if a texture or buffer is copied there: 0 imported, 1 otherwise.
    pub fn cpu_copies(&self) -> u32 {
        match self {
            Place::Shm { target, .. } => target.cpu_copies(),
            Place::Memory(_) => 1,
        }
    }

    /// The memory itself, for what the CPU makes in place.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        match self {
            // SAFETY: the constructors of `ShmTarget` make the caller promise that the range of a place is nobody else's; `&mut self`
            // keeps the slice single.
            Place::Shm { target, offset_bytes, capacity_bytes } => unsafe { target.range_mut(*offset_bytes, *capacity_bytes) },
            Place::Memory(memory) => memory,
        }
    }
}

/// Where a copy comes from.
#[derive(Clone, Debug)]
enum Source {
    Texture { texture: wgpu::Texture, layer: u32, row_bytes: usize, n_rows: usize },
    Buffer { buffer: wgpu::Buffer, offset_bytes: u64, n_bytes: usize },
}

impl Source {
    /// Bytes without padding.
    fn n_bytes(&self) -> usize {
        match self {
            Source::Texture { row_bytes, n_rows, .. } => row_bytes * n_rows,
            Source::Buffer { n_bytes, .. } => *n_bytes,
        }
    }

    /// Row length and distance between rows in a staging buffer.
    fn staged_rows(&self) -> (usize, usize) {
        match self {
            Source::Texture { row_bytes, .. } => (*row_bytes, row_bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize)),
            Source::Buffer { n_bytes, .. } => (*n_bytes, n_bytes.next_multiple_of(4)),
        }
    }
}

#[derive(Debug)]
enum Sink<'a> {
    Place(Place<'a>),
    /// Left mapped for the CPU to look at.
    Mapped,
}

#[derive(Debug)]
struct Item<'a> {
    source: Source,
    sink: Sink<'a>,
    staging: Option<wgpu::Buffer>,
}

/// Copies that go out with one submission. The number a method returns names the copy afterwards.
#[derive(Debug, Default)]
pub struct CopyBatch<'a> {
    items: Vec<Item<'a>>,
}

impl<'a> CopyBatch<'a> {
    /// No copies.
    pub fn new() -> Self {
        CopyBatch { items: Vec::new() }
    }

    /// Copies a whole colour texture, rows tight. Its usage must contain `COPY_SRC`; `element_bytes` is the size of a texel.
    pub fn texture(&mut self, texture: &wgpu::Texture, element_bytes: usize, place: Place<'a>) -> usize {
        self.texture_layer(texture, 0, element_bytes, place)
    }

    /// The same for one layer of a texture.
    pub fn texture_layer(&mut self, texture: &wgpu::Texture, layer: u32, element_bytes: usize, place: Place<'a>) -> usize {
        self.push(texture_source(texture, layer, element_bytes), place)
    }

    /// Copies part of a buffer; `offset_bytes` and `n_bytes` are multiples of 4 and its usage contains `COPY_SRC`.
    pub fn buffer(&mut self, buffer: &wgpu::Buffer, offset_bytes: u64, n_bytes: usize, place: Place<'a>) -> usize {
        self.push(Source::Buffer { buffer: buffer.clone(), offset_bytes, n_bytes }, place)
    }

    /// Copies a layer of a colour texture to where [`InFlight::wait`] leaves it mapped for the CPU.
    pub fn map_texture(&mut self, texture: &wgpu::Texture, layer: u32, element_bytes: usize) -> usize {
        self.items.push(Item { source: texture_source(texture, layer, element_bytes), sink: Sink::Mapped, staging: None });
        self.items.len() - 1
    }

    /// Copies part of a buffer to where [`InFlight::wait`] leaves it mapped for the CPU; conditions as for [`CopyBatch::buffer`].
    pub fn map_buffer(&mut self, buffer: &wgpu::Buffer, offset_bytes: u64, n_bytes: usize) -> usize {
        let source = Source::Buffer { buffer: buffer.clone(), offset_bytes, n_bytes };
        self.items.push(Item { source, sink: Sink::Mapped, staging: None });
        self.items.len() - 1
    }

    fn push(&mut self, source: Source, place: Place<'a>) -> usize {
        let (needed, room) = (source.n_bytes(), place.capacity_bytes());
        assert!(needed <= room, "a copy of {needed} bytes does not fit {room} bytes");
        if let Place::Shm { target, offset_bytes, capacity_bytes } = &place {
            assert!(offset_bytes.is_multiple_of(4), "offset {offset_bytes} is not a multiple of 4");
            assert!(offset_bytes + capacity_bytes <= target.n_bytes(), "the place leaves its segment");
        }
        self.items.push(Item { source, sink: Sink::Place(place), staging: None });
        self.items.len() - 1
    }

    /// Whether there is nothing to copy.
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// Submits `encoder` with these copies behind it.
    pub fn submit(mut self, gpu: &Gpu, mut encoder: wgpu::CommandEncoder) -> InFlight<'a> {
        let direct: Vec<usize> = (0..self.items.len()).filter(|i| direct_target(&self.items[*i]).is_some()).collect();
        for item in &mut self.items {
            if direct_target(item).is_none() {
                item.staging = Some(record_staged(gpu, &mut encoder, &item.source));
            }
        }
        let pending;
        let submission = if direct.is_empty() {
            gpu.mark(&mut encoder, "copies");
            pending = gpu.close_marks(&mut encoder);
            gpu.time("submit", || gpu.submit([encoder.finish()]))
        } else {
            let direct: Vec<&Item<'_>> = direct.iter().map(|i| &self.items[*i]).collect();
            record_transitions(&mut encoder, &direct);
            let raw = record_direct(gpu, &direct);
            let mut visible = gpu.encoder("visible to the host");
            let host = |item: &&Item<'_>| wgt::BufferTransition { buffer: imported(item).clone(), state: wgt::BufferUses::MAP_READ };
            let transitions: Vec<_> = unique_buffers(&direct).iter().map(host).collect();
            visible.transition_resources(
                transitions.iter().map(|t| wgt::BufferTransition { buffer: &t.buffer, state: t.state }),
                std::iter::empty::<wgt::TextureTransition<&wgpu::Texture>>(),
            );
            gpu.mark(&mut visible, "copies");
            pending = gpu.close_marks(&mut visible);
            gpu.time("submit", || gpu.submit([encoder.finish(), raw, visible.finish()]))
        };
        if let Some(pending) = &pending {
            pending.map();
        }
        gpu.counters().add_submission(self.items.len() as u64);
        for staging in self.items.iter().filter_map(|item| item.staging.as_ref()) {
            staging.map_async(wgpu::MapMode::Read, .., |_| {});
        }
        InFlight { gpu: gpu.clone(), items: self.items, submission: Some(submission), pending }
    }
}

fn texture_source(texture: &wgpu::Texture, layer: u32, element_bytes: usize) -> Source {
    assert!(layer < texture.depth_or_array_layers(), "layer {layer} of a texture that has {}", texture.depth_or_array_layers());
    let (row_bytes, n_rows) = (texture.width() as usize * element_bytes, texture.height() as usize);
    Source::Texture { texture: texture.clone(), layer, row_bytes, n_rows }
}

fn direct_target<'i>(item: &'i Item<'_>) -> Option<&'i wgpu::Buffer> {
    match &item.sink {
        Sink::Place(Place::Shm { target, .. }) => target.imported(),
        _ => None,
    }
}

fn imported<'i>(item: &'i Item<'_>) -> &'i wgpu::Buffer {
    direct_target(item).expect("only items with an imported target are recorded directly")
}

/// One item per imported buffer: several frames may go to one segment, and a barrier names a buffer once.
fn unique_buffers<'i, 'a>(direct: &[&'i Item<'a>]) -> Vec<&'i Item<'a>> {
    let mut unique: Vec<&Item<'_>> = Vec::with_capacity(direct.len());
    for item in direct {
        if !unique.iter().any(|known| imported(known) == imported(item)) {
            unique.push(item);
        }
    }
    unique
}

/// Padded copy into a mappable buffer from the pool.
fn record_staged(gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, source: &Source) -> wgpu::Buffer {
    let (_, stride) = source.staged_rows();
    match source {
        Source::Texture { texture, layer, n_rows, .. } => {
            let staging = gpu.take_staging((stride * n_rows) as u64);
            let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(stride as u32), rows_per_image: None };
            let origin = wgpu::Origin3d { x: 0, y: 0, z: *layer };
            let from = wgpu::TexelCopyTextureInfo { origin, ..texture.as_image_copy() };
            let size = wgpu::Extent3d { depth_or_array_layers: 1, ..texture.size() };
            encoder.copy_texture_to_buffer(from, wgpu::TexelCopyBufferInfo { buffer: &staging, layout }, size);
            staging
        }
        Source::Buffer { buffer, offset_bytes, .. } => {
            let staging = gpu.take_staging(stride as u64);
            encoder.copy_buffer_to_buffer(buffer, *offset_bytes, &staging, 0, stride as u64);
            staging
        }
    }
}

/// Puts sources and imported buffers into the states the raw copies expect.
fn record_transitions(encoder: &mut wgpu::CommandEncoder, direct: &[&Item<'_>]) {
    let mut buffers: Vec<wgt::BufferTransition<&wgpu::Buffer>> = unique_buffers(direct)
        .iter()
        .map(|item| wgt::BufferTransition { buffer: imported(item), state: wgt::BufferUses::COPY_DST })
        .collect();
    let mut textures: Vec<wgt::TextureTransition<&wgpu::Texture>> = Vec::new();
    for item in direct {
        match &item.source {
            Source::Texture { texture, .. } if !textures.iter().any(|t| t.texture == texture) => {
                textures.push(wgt::TextureTransition { texture, selector: None, state: wgt::TextureUses::COPY_SRC });
            }
            Source::Buffer { buffer, .. } if !buffers.iter().any(|b| b.buffer == buffer) => {
                buffers.push(wgt::BufferTransition { buffer, state: wgt::BufferUses::COPY_SRC });
            }
            _ => {}
        }
    }
    encoder.transition_resources(buffers.into_iter(), textures.into_iter());
}

/// Raw copies with tight rows into imported buffers.
fn record_direct(gpu: &Gpu, direct: &[&Item<'_>]) -> wgpu::CommandBuffer {
    let mut encoder = gpu.encoder("copies to shared memory");
    // SAFETY: the guard only lends the device for recording.
    let device = unsafe { gpu.device().as_hal::<Vulkan>() }.expect("the device was opened as Vulkan").raw_device().clone();
    // Copies between one texture and one segment are one command.
    let mut groups: Vec<Vec<&Item<'_>>> = Vec::new();
    for item in direct {
        match groups.iter_mut().find(|group| is_alike(group[0], item)) {
            Some(group) => group.push(item),
            None => groups.push(vec![item]),
        }
    }
    for alike in &groups {
        let first = alike[0];
        // SAFETY: the handles are used while their wgpu objects live: the items own them until the submission is done.
        let to = unsafe { imported(first).as_hal::<Vulkan>().expect("made by Vulkan").raw_handle() };
        match &first.source {
            Source::Texture { texture, .. } => {
                // SAFETY: as for `to`.
                let from = unsafe { texture.as_hal::<Vulkan>().expect("made by Vulkan").raw_handle() };
                let regions: Vec<vk::BufferImageCopy> = alike.iter().filter_map(|item| image_region(item)).collect();
                let layout = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
                // SAFETY: the first encoder left the image in this layout and the buffer writable for transfers; the regions lie inside
                // both (checked in `push` and `texture_source`), row length 0 means tight rows, and the offsets are multiples of 4 and of
                // the texel size.
                unsafe {
                    encoder.as_hal_mut::<Vulkan, _, _>(|hal| {
                        let commands = hal.expect("made by Vulkan").raw_handle();
                        device.cmd_copy_image_to_buffer(commands, from, layout, to, &regions);
                    });
                }
            }
            Source::Buffer { buffer, .. } => {
                // SAFETY: as for `to`.
                let from = unsafe { buffer.as_hal::<Vulkan>().expect("made by Vulkan").raw_handle() };
                let regions: Vec<vk::BufferCopy> = alike.iter().filter_map(|item| buffer_region(item)).collect();
                // SAFETY: all ranges lie inside their buffers (checked in `push` for the target, by the caller's contract for the
                // source), and the first encoder made them readable and writable for transfers.
                unsafe {
                    encoder.as_hal_mut::<Vulkan, _, _>(|hal| {
                        let commands = hal.expect("made by Vulkan").raw_handle();
                        device.cmd_copy_buffer(commands, from, to, &regions);
                    });
                }
            }
        }
    }
    encoder.finish()
}

/// Whether two copies read one texture or buffer and write one segment.
fn is_alike(a: &Item<'_>, b: &Item<'_>) -> bool {
    let same_source = match (&a.source, &b.source) {
        (Source::Texture { texture: a, .. }, Source::Texture { texture: b, .. }) => a == b,
        (Source::Buffer { buffer: a, .. }, Source::Buffer { buffer: b, .. }) => a == b,
        _ => false,
    };
    same_source && imported(a) == imported(b)
}

/// Where the target of a direct copy begins in its segment.
fn target_offset(item: &Item<'_>) -> Option<u64> {
    match &item.sink {
        Sink::Place(Place::Shm { offset_bytes, .. }) => Some(*offset_bytes as u64),
        _ => None,
    }
}

fn image_region(item: &Item<'_>) -> Option<vk::BufferImageCopy> {
    let Source::Texture { texture, layer, .. } = &item.source else { return None };
    let layers =
        vk::ImageSubresourceLayers { aspect_mask: vk::ImageAspectFlags::COLOR, mip_level: 0, base_array_layer: *layer, layer_count: 1 };
    let extent = vk::Extent3D { width: texture.width(), height: texture.height(), depth: 1 };
    Some(vk::BufferImageCopy::default().buffer_offset(target_offset(item)?).image_subresource(layers).image_extent(extent))
}

fn buffer_region(item: &Item<'_>) -> Option<vk::BufferCopy> {
    let Source::Buffer { offset_bytes, n_bytes, .. } = &item.source else { return None };
    Some(vk::BufferCopy { src_offset: *offset_bytes, dst_offset: target_offset(item)?, size: *n_bytes as u64 })
}

/// A submission on its way. Dropping it waits too, so that nothing is written to memory that the caller takes back.
#[derive(Debug)]
#[must_use = "the copies are done only after wait()"]
pub struct InFlight<'a> {
    gpu: Gpu,
    items: Vec<Item<'a>>,
    submission: Option<wgpu::SubmissionIndex>,
    pending: Option<Pending>,
}

/// Bytes left mapped for the CPU.
#[derive(Debug)]
pub struct Mapped {
    view: Option<wgpu::BufferView>,
    buffer: wgpu::Buffer,
    gpu: Gpu,
    row_bytes: usize,
    stride_bytes: usize,
}

impl Mapped {
    /// Row `y` without padding.
    pub fn row(&self, y: usize) -> &[u8] {
        let begin = y * self.stride_bytes;
        &self.view.as_ref().expect("the view lives as long as self")[begin..begin + self.row_bytes]
    }

    /// All bytes, the bytes of a row in use, and the bytes from one row to the next.
    pub fn padded(&self) -> (&[u8], usize, usize) {
        (self.view.as_ref().expect("the view lives as long as self"), self.row_bytes, self.stride_bytes)
    }
}

impl Drop for Mapped {
    fn drop(&mut self) {
        self.view = None;
        self.buffer.unmap();
        self.gpu.give_staging(self.buffer.clone());
    }
}

/// What became of one copy.
#[derive(Debug)]
pub struct CopyOutcome {
    /// Bytes written; 0 for a mapped one.
    pub n_bytes: usize,
    /// Copies by the CPU: 0 or 1.
    pub cpu_copies: u32,
    /// The bytes, if they were asked to be left mapped.
    pub mapped: Option<Mapped>,
}

impl InFlight<'_> {
    /// Waits until the bytes are where they belong; one outcome per copy, in order of recording.
    ///
    /// # Errors
    /// The device was lost.
    pub fn wait(mut self) -> Result<Vec<CopyOutcome>, GpuError> {
        self.wait_for_gpu()?;
        if let Some(pending) = self.pending.take() {
            self.gpu.read_marks(&pending);
        }
        std::mem::take(&mut self.items).into_iter().map(|item| finish(&self.gpu, item)).collect()
    }

    /// As [`InFlight::wait`], but awake for the first half millisecond: short work on a GPU of its own is over before a thread wakes up.
    ///
    /// # Errors
    /// The device was lost.
    pub fn wait_awake(self) -> Result<Vec<CopyOutcome>, GpuError> {
        if !self.gpu.is_software() {
            let begin = std::time::Instant::now();
            let now = wgpu::PollType::Wait { submission_index: self.submission.clone(), timeout: Some(std::time::Duration::ZERO) };
            while begin.elapsed() < AWAKE && matches!(self.gpu.device().poll(now.clone()), Err(wgpu::PollError::Timeout)) {
                std::hint::spin_loop();
            }
        }
        self.wait()
    }

    fn wait_for_gpu(&mut self) -> Result<(), GpuError> {
        let Some(submission) = self.submission.take() else { return Ok(()) };
        let wait = wgpu::PollType::Wait { submission_index: Some(submission), timeout: None };
        self.gpu.time("wait", || self.gpu.device().poll(wait)).map(|_| ()).map_err(|error| self.gpu.lost(error))
    }
}

impl Drop for InFlight<'_> {
    fn drop(&mut self) {
        if let Err(error) = self.wait_for_gpu() {
            tracing::error!(%error, "a submission was given up");
        }
    }
}

fn finish(gpu: &Gpu, item: Item<'_>) -> Result<CopyOutcome, GpuError> {
    let n_bytes = item.source.n_bytes();
    let Some(buffer) = item.staging else {
        return Ok(CopyOutcome { n_bytes, cpu_copies: 0, mapped: None });
    };
    let (row_bytes, stride_bytes) = item.source.staged_rows();
    let view = buffer.get_mapped_range(..).map_err(|error| gpu.lost(error))?;
    let mapped = Mapped { view: Some(view), buffer, gpu: gpu.clone(), row_bytes, stride_bytes };
    let Sink::Place(mut place) = item.sink else {
        return Ok(CopyOutcome { n_bytes: 0, cpu_copies: 0, mapped: Some(mapped) });
    };
    for (y, row) in place.bytes_mut()[..n_bytes].chunks_exact_mut(row_bytes).enumerate() {
        row.copy_from_slice(mapped.row(y));
    }
    Ok(CopyOutcome { n_bytes, cpu_copies: 1, mapped: None })
}
