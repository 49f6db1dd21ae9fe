//! Copies with tight rows into imported memory, as Vulkan commands: wgpu's own copies pad rows to
//! 256 bytes.

use ash::vk;

/// Copies of one submission. All copies from one source to one segment are one command.
#[derive(Debug, Default)]
pub(crate) struct RawCopies(pub Vec<RawCopy>);

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
        for copy in &self.0 {
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
    }
}
