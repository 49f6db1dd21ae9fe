//! Copies with tight rows into imported memory, as Vulkan commands: wgpu's own copies pad rows to
//! 256 bytes.

use ash::vk;

/// Copies of one submission. All copies from one source to one segment are one command.
#[derive(Debug, Default)]
pub(crate) struct RawCopies {
    pub copies: Vec<RawCopy>,
    /// What other processes read.
    pub released: Vec<Release>,
}

/// A range of exported memory that is handed over to other processes. It is not taken back: the
/// next frame there overwrites all that is used of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Release {
    pub buffer: vk::Buffer,
    pub offset_bytes: u64,
    pub n_bytes: u64,
    /// The family that gives it away; [`vk::QUEUE_FAMILY_IGNORED`] if several share it.
    pub family: u32,
}

#[derive(Debug)]
pub(crate) enum RawCopy {
    Texture {
        from: vk::Image,
        to: vk::Buffer,
        regions: Vec<vk::BufferImageCopy>,
    },
    Buffer {
        from: vk::Buffer,
        to: vk::Buffer,
        regions: Vec<vk::BufferCopy>,
    },
}

impl RawCopies {
    /// Records them.
    ///
    /// # Safety
    /// The command buffer is of this device and being recorded. When it runs, textures have the
    /// layout for copies, and sources and targets are accessible to transfers. Until it has run,
    /// the items live and nobody else writes to sources or targets.
    pub unsafe fn record(&self, device: &ash::Device, commands: vk::CommandBuffer) {
        for copy in &self.copies {
            match copy {
                // SAFETY: the regions lie inside both (checked when the items were made), row
                // length 0 means tight rows, and offsets are multiples of 4 and of the texel size.
                // The rest is the caller's promise.
                RawCopy::Texture { from, to, regions } => unsafe {
                    device.cmd_copy_image_to_buffer(
                        commands,
                        *from,
                        vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
                        *to,
                        regions,
                    );
                },
                // SAFETY: all ranges lie inside their buffers (checked for the target, promised for
                // the source when the items were made).
                RawCopy::Buffer { from, to, regions } => unsafe {
                    device.cmd_copy_buffer(commands, *from, *to, regions)
                },
            }
        }
        if self.released.is_empty() {
            return;
        }
        let barriers: Vec<_> = self
            .released
            .iter()
            .map(|range| {
                vk::BufferMemoryBarrier::default()
                    .src_access_mask(vk::AccessFlags::TRANSFER_WRITE)
                    .dst_access_mask(vk::AccessFlags::empty())
                    .src_queue_family_index(range.family)
                    .dst_queue_family_index(vk::QUEUE_FAMILY_EXTERNAL)
                    .buffer(range.buffer)
                    .offset(range.offset_bytes)
                    .size(range.n_bytes)
            })
            .collect();
        // SAFETY: the ranges lie inside their buffers, and the command buffer is being recorded
        // outside of a render pass (caller).
        unsafe {
            device.cmd_pipeline_barrier(
                commands,
                vk::PipelineStageFlags::TRANSFER,
                vk::PipelineStageFlags::BOTTOM_OF_PIPE,
                vk::DependencyFlags::empty(),
                &[],
                &barriers,
                &[],
            );
        }
    }
}
