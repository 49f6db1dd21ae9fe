//! Short forms for the GPU resources that sensors ask for.

use crate::device::Gpu;

impl Gpu {
    /// A buffer, contents undefined.
    pub fn buffer(&self, label: &str, n_bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
        // Vulkan has no empty buffers, and wgpu copies in units of 4.
        let size = n_bytes.next_multiple_of(4).max(4);
        self.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size,
            usage,
            mapped_at_creation: false,
        })
    }

    /// A buffer with these contents.
    pub fn buffer_with(
        &self,
        label: &str,
        contents: &[u8],
        usage: wgpu::BufferUsages,
    ) -> wgpu::Buffer {
        let buffer = self.buffer(
            label,
            contents.len() as u64,
            usage | wgpu::BufferUsages::COPY_DST,
        );
        let whole = contents.len() & !3;
        self.queue().write_buffer(&buffer, 0, &contents[..whole]);
        if whole < contents.len() {
            let mut last = [0; 4];
            last[..contents.len() - whole].copy_from_slice(&contents[whole..]);
            self.queue().write_buffer(&buffer, whole as u64, &last);
        }
        buffer
    }

    /// A two-dimensional texture with `n_mips` levels.
    pub fn texture(
        &self,
        label: &str,
        size_px: [u32; 2],
        n_mips: u32,
        format: wgpu::TextureFormat,
        usage: wgpu::TextureUsages,
    ) -> wgpu::Texture {
        self.texture_of(label, size_px, [1, n_mips], format, usage)
    }

    /// A two-dimensional texture with several layers, each of one level.
    pub fn texture_layers(
        &self,
        label: &str,
        size_px: [u32; 2],
        n_layers: u32,
        format: wgpu::TextureFormat,
        usage: wgpu::TextureUsages,
    ) -> wgpu::Texture {
        self.texture_of(label, size_px, [n_layers, 1], format, usage)
    }

    fn texture_of(
        &self,
        label: &str,
        [width, height]: [u32; 2],
        [n_layers, n_mips]: [u32; 2],
        format: wgpu::TextureFormat,
        usage: wgpu::TextureUsages,
    ) -> wgpu::Texture {
        self.device().create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: n_layers,
            },
            mip_level_count: n_mips,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        })
    }

    /// A shader from WGSL text.
    pub fn shader(&self, label: &str, wgsl: &str) -> wgpu::ShaderModule {
        self.device()
            .create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(label),
                source: wgpu::ShaderSource::Wgsl(wgsl.into()),
            })
    }

    /// A shader from trusted WGSL text, without runtime checks of indices and of loops that might
    /// not end.
    ///
    /// # Safety
    /// The shader stays inside its buffers and arrays, and its loops end.
    pub unsafe fn shader_unchecked(&self, label: &str, wgsl: &str) -> wgpu::ShaderModule {
        let descriptor = wgpu::ShaderModuleDescriptor {
            label: Some(label),
            source: wgpu::ShaderSource::Wgsl(wgsl.into()),
        };
        // SAFETY: the caller promises what the callee asks.
        unsafe {
            self.device()
                .create_shader_module_trusted(descriptor, wgpu::ShaderRuntimeChecks::unchecked())
        }
    }

    /// An encoder for one submission.
    pub fn encoder(&self, label: &str) -> wgpu::CommandEncoder {
        self.device()
            .create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(label) })
    }
}
