//! Copies out of textures and buffers: one batch per submission, with three ways to the reader
//! behind one interface.
//!
//! Imported targets get a raw `vkCmdCopyImageToBuffer` with tight rows, because wgpu's own copy
//! pads rows to 256 bytes. Shared textures are copied by the copy queue while the next submission
//! is drawn. All other copies run after the drawing, in one submit: the caller's passes and the
//! transitions to COPY_SRC/COPY_DST (first encoder), the raw copies (second; wgpu does not allow
//! raw and ordinary calls in one encoder), and the transition that makes the bytes visible to the
//! host (third). Copies without an imported target go through staging buffers.

use std::sync::Arc;

use wgpu::hal::api::Vulkan;
use wgpu::wgt;

use super::in_flight::{Beside, InFlight};
use super::item::{Item, Sink, Source};
use super::place::Place;
use super::raw::raw_copies_of;
use crate::device::Gpu;
use crate::queue::{CopyMarks, CopyQueue, Moment, Reads};

/// The copies of one submission. Each method returns the number by which the copy's outcome is
/// found later.
#[derive(Debug, Default)]
pub struct CopyBatch<'a> {
    items: Vec<Item<'a>>,
    overwritten: Vec<Arc<Reads>>,
}

impl<'a> CopyBatch<'a> {
    /// No copies.
    pub fn new() -> Self {
        CopyBatch::default()
    }

    /// Copies a whole colour texture, rows tight. Its usage must contain `COPY_SRC`;
    /// `element_bytes` is the size of a texel.
    pub fn texture(
        &mut self,
        texture: &wgpu::Texture,
        element_bytes: usize,
        place: Place<'a>,
    ) -> usize {
        self.texture_layer(texture, 0, element_bytes, place)
    }

    /// The same for one layer of a texture.
    pub fn texture_layer(
        &mut self,
        texture: &wgpu::Texture,
        layer: u32,
        element_bytes: usize,
        place: Place<'a>,
    ) -> usize {
        self.push(
            Source::of_texture(texture, layer, element_bytes),
            place,
            None,
        )
    }

    /// The same for a shared texture from [`Gpu::shared_texture_layers`]: its copy may still run
    /// during later submissions. Each of those that writes to a texture of the group `reads` must
    /// declare it with [`CopyBatch::overwrites`] or [`Gpu::submit_overwriting`].
    pub fn shared_layer(
        &mut self,
        texture: &wgpu::Texture,
        layer: u32,
        element_bytes: usize,
        place: Place<'a>,
        reads: &Arc<Reads>,
    ) -> usize {
        self.push(
            Source::of_texture(texture, layer, element_bytes),
            place,
            Some(reads.clone()),
        )
    }

    /// Declares that the submission writes to textures of a group: it waits on the GPU for copies
    /// of earlier submissions that read them.
    pub fn overwrites(&mut self, reads: &Arc<Reads>) {
        if !self
            .overwritten
            .iter()
            .any(|known| Arc::ptr_eq(known, reads))
        {
            self.overwritten.push(reads.clone());
        }
    }

    /// Copies part of a buffer; `offset_bytes` and `n_bytes` are multiples of 4 and its usage
    /// contains `COPY_SRC`.
    pub fn buffer(
        &mut self,
        buffer: &wgpu::Buffer,
        offset_bytes: u64,
        n_bytes: usize,
        place: Place<'a>,
    ) -> usize {
        self.push(
            Source::Buffer {
                buffer: buffer.clone(),
                offset_bytes,
                n_bytes,
            },
            place,
            None,
        )
    }

    /// Copies a layer of a colour texture to where [`InFlight::wait`] leaves it mapped for the CPU.
    pub fn map_texture(
        &mut self,
        texture: &wgpu::Texture,
        layer: u32,
        element_bytes: usize,
    ) -> usize {
        self.map(Source::of_texture(texture, layer, element_bytes))
    }

    /// Copies part of a buffer to where [`InFlight::wait`] leaves it mapped for the CPU; conditions
    /// as for [`CopyBatch::buffer`].
    pub fn map_buffer(
        &mut self,
        buffer: &wgpu::Buffer,
        offset_bytes: u64,
        n_bytes: usize,
    ) -> usize {
        self.map(Source::Buffer {
            buffer: buffer.clone(),
            offset_bytes,
            n_bytes,
        })
    }

    fn map(&mut self, source: Source) -> usize {
        self.items.push(Item {
            source,
            sink: Sink::Mapped,
            staging: None,
            shared: None,
        });
        self.items.len() - 1
    }

    fn push(&mut self, source: Source, place: Place<'a>, shared: Option<Arc<Reads>>) -> usize {
        let (needed, room) = (source.n_bytes(), place.capacity_bytes());
        assert!(
            needed <= room,
            "a copy of {needed} bytes does not fit {room} bytes"
        );
        self.items.push(Item {
            source,
            sink: Sink::Place(place),
            staging: None,
            shared,
        });
        self.items.len() - 1
    }

    /// Whether there is nothing to copy.
    pub fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// Submits `encoder` and these copies, which run after it or on the copy queue.
    pub fn submit(mut self, gpu: &Gpu, mut encoder: wgpu::CommandEncoder) -> InFlight<'a> {
        for item in &mut self.items {
            if item.imported().is_none() {
                item.staging = Some(record_staged(gpu, &mut encoder, &item.source));
            }
        }
        let imported = self.items.iter().filter(|item| item.imported().is_some());
        let (beside, behind): (Vec<_>, Vec<_>) =
            imported.partition(|item| item.shared.is_some() && gpu.copy_queue().is_some());
        record_transitions(&mut encoder, &behind, &beside);
        let marks = gpu
            .copy_queue()
            .filter(|_| !beside.is_empty() && gpu.timing().is_on())
            .and_then(CopyQueue::new_marks);
        let mut commands = Vec::with_capacity(4);
        if let (Some(queue), Some(marks)) = (gpu.copy_queue(), &marks) {
            let mut reset = gpu.encoder("marks of copies");
            queue.reset_marks(&mut reset, marks);
            commands.push(reset.finish());
        }
        let has_copies = !behind.is_empty() || self.items.iter().any(|item| item.staging.is_some());
        let pending = if behind.is_empty() {
            if has_copies {
                gpu.mark(&mut encoder, "copies");
            }
            let pending = gpu.timing().close_marks(&mut encoder);
            commands.push(encoder.finish());
            pending
        } else {
            let mut visible = gpu.encoder("visible to the host");
            record_visible(&mut visible, &behind);
            gpu.mark(&mut visible, "copies");
            let pending = gpu.timing().close_marks(&mut visible);
            commands.extend([
                encoder.finish(),
                record_behind(gpu, &behind),
                visible.finish(),
            ]);
            pending
        };
        let (submission, beside) = gpu.time("submit", || {
            submit(gpu, commands, &beside, marks, &self.overwritten)
        });
        if let Some(pending) = &pending {
            pending.map();
        }
        gpu.counters().add_submission(self.items.len() as u64);
        for staging in self.items.iter().filter_map(|item| item.staging.as_ref()) {
            staging.map_async(wgpu::MapMode::Read, .., |_| {});
        }
        InFlight::new(gpu, self.items, submission, beside, pending)
    }
}

impl Gpu {
    /// Submits commands without copies that write to textures of these groups: they wait on the GPU
    /// for copies of earlier submissions that read them.
    pub fn submit_overwriting(
        &self,
        commands: Vec<wgpu::CommandBuffer>,
        overwritten: &[Arc<Reads>],
    ) {
        submit(self, commands, &[], None, overwritten);
        self.counters().add_submission(0);
    }
}

/// Gives commands to the drawing queue, and the copies `beside` them to the copy queue.
fn submit(
    gpu: &Gpu,
    commands: Vec<wgpu::CommandBuffer>,
    beside: &[&Item<'_>],
    marks: Option<CopyMarks>,
    overwritten: &[Arc<Reads>],
) -> (wgpu::SubmissionIndex, Option<Beside>) {
    let Some(queue) = gpu.copy_queue() else {
        return (gpu.submit(commands), None);
    };
    let copies = raw_copies_of(gpu, beside);
    let mut turn = queue.turn();
    let mut drawing = gpu.drawing().lock();
    let newest = overwritten
        .iter()
        .map(|reads| reads.newest())
        .max()
        .unwrap_or(0);
    let is_read = newest > 0 && queue.reached().is_ok_and(|reached| reached < newest);
    let wait = is_read.then_some(Moment {
        semaphore: queue.copied,
        value: newest,
    });
    if beside.is_empty() {
        return (drawing.submit(commands, wait, None), None);
    }
    let number = turn.next();
    let drawn = Moment {
        semaphore: queue.drawn,
        value: number,
    };
    let submission = drawing.submit(commands, wait, Some(drawn));
    // Copies behind a submission that the device did not take would wait for ever.
    if !gpu.has_taken(&submission) {
        return (submission, None);
    }
    // SAFETY: the submission was taken, so it signals the number, and it leaves textures in the
    // layout for copies; the items own textures and targets until the copies are done, and later
    // drawing into the textures waits for them. `drawing` is the lock on the drawing queue.
    let submitted = unsafe { queue.submit(&mut turn, number, &copies, marks.as_ref()) };
    if submitted.is_ok() {
        beside
            .iter()
            .filter_map(|item| item.shared.as_ref())
            .for_each(|reads| reads.add(number));
    }
    (
        submission,
        Some(Beside {
            number,
            submitted,
            marks,
        }),
    )
}

/// Each imported buffer once: several frames may go to one segment, and a barrier may name a buffer
/// only once.
fn unique_buffers<'i>(behind: &[&'i Item<'_>]) -> Vec<&'i wgpu::Buffer> {
    let mut unique: Vec<&wgpu::Buffer> = Vec::with_capacity(behind.len());
    for buffer in behind.iter().filter_map(|item| item.imported()) {
        if !unique.contains(&buffer) {
            unique.push(buffer);
        }
    }
    unique
}

/// Padded copy into a mappable buffer from the pool.
fn record_staged(gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, source: &Source) -> wgpu::Buffer {
    let (_, stride) = source.staged_rows();
    match source {
        Source::Texture {
            texture,
            layer,
            n_rows,
            ..
        } => {
            let staging = gpu.take_staging((stride * n_rows) as u64);
            let layout = wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(stride as u32),
                rows_per_image: None,
            };
            let origin = wgpu::Origin3d {
                x: 0,
                y: 0,
                z: *layer,
            };
            let from = wgpu::TexelCopyTextureInfo {
                origin,
                ..texture.as_image_copy()
            };
            let size = wgpu::Extent3d {
                depth_or_array_layers: 1,
                ..texture.size()
            };
            encoder.copy_texture_to_buffer(
                from,
                wgpu::TexelCopyBufferInfo {
                    buffer: &staging,
                    layout,
                },
                size,
            );
            staging
        }
        Source::Buffer {
            buffer,
            offset_bytes,
            ..
        } => {
            let staging = gpu.take_staging(stride as u64);
            encoder.copy_buffer_to_buffer(buffer, *offset_bytes, &staging, 0, stride as u64);
            staging
        }
    }
}

/// Puts all sources, and the imported buffers of copies after the drawing, into the states that raw
/// copies expect.
fn record_transitions(
    encoder: &mut wgpu::CommandEncoder,
    behind: &[&Item<'_>],
    beside: &[&Item<'_>],
) {
    if behind.is_empty() && beside.is_empty() {
        return;
    }
    let mut buffers: Vec<wgt::BufferTransition<&wgpu::Buffer>> = unique_buffers(behind)
        .into_iter()
        .map(|buffer| wgt::BufferTransition {
            buffer,
            state: wgt::BufferUses::COPY_DST,
        })
        .collect();
    let mut textures: Vec<wgt::TextureTransition<&wgpu::Texture>> = Vec::new();
    for item in behind.iter().chain(beside) {
        match &item.source {
            Source::Texture { texture, .. } if !textures.iter().any(|t| t.texture == texture) => {
                textures.push(wgt::TextureTransition {
                    texture,
                    selector: None,
                    state: wgt::TextureUses::COPY_SRC,
                });
            }
            Source::Buffer { buffer, .. } if !buffers.iter().any(|b| b.buffer == buffer) => {
                buffers.push(wgt::BufferTransition {
                    buffer,
                    state: wgt::BufferUses::COPY_SRC,
                });
            }
            _ => {}
        }
    }
    encoder.transition_resources(buffers.into_iter(), textures.into_iter());
}

/// Records raw copies into imported buffers for the drawing queue.
fn record_behind(gpu: &Gpu, behind: &[&Item<'_>]) -> wgpu::CommandBuffer {
    let mut encoder = gpu.encoder("copies to shared memory");
    // SAFETY: the guard only lends the device for recording.
    let device = unsafe { gpu.device().as_hal::<Vulkan>() }
        .expect("the device was opened as Vulkan")
        .raw_device()
        .clone();
    let copies = raw_copies_of(gpu, behind);
    // SAFETY: the encoder before left textures, buffers and targets in the states that the copies
    // expect, and the items live until the submission is done; nothing ordinary is recorded with
    // this encoder.
    unsafe {
        encoder.as_hal_mut::<Vulkan, _, _>(|hal| {
            // A lost device has no encoder.
            if let Some(hal) = hal {
                copies.record(&device, hal.raw_handle());
            }
        })
    };
    encoder.finish()
}

fn record_visible(encoder: &mut wgpu::CommandEncoder, behind: &[&Item<'_>]) {
    let mapped = behind.iter().filter(|item| item.exported().is_none());
    let mapped: Vec<&Item<'_>> = mapped.copied().collect();
    let buffers = unique_buffers(&mapped);
    encoder.transition_resources(
        buffers.iter().map(|buffer| wgt::BufferTransition {
            buffer: *buffer,
            state: wgt::BufferUses::MAP_READ,
        }),
        std::iter::empty::<wgt::TextureTransition<&wgpu::Texture>>(),
    );
}
