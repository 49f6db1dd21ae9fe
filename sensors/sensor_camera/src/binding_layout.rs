//! Entries of bind group layouts, and buffers that grow.

use sensor_gpu::Gpu;

/// Replaces `buffer` by one of twice the needed size, or the largest that can be bound, if it is too
/// small.
pub(crate) fn grow(gpu: &Gpu, buffer: &mut wgpu::Buffer, n_bytes: u64) {
    if buffer.size() < n_bytes {
        let most = gpu.device().limits().max_storage_buffer_binding_size & !3;
        let size = (2 * n_bytes).min(most.max(n_bytes));
        *buffer = gpu.buffer("grown", size, buffer.usage());
    }
}

/// A compute pipeline with one bind group, and the group's layout.
pub(crate) fn compute_pass(
    gpu: &Gpu,
    label: &'static str,
    wgsl: &str,
    entry_point: &'static str,
    entries: &[wgpu::BindGroupLayoutEntry],
) -> (wgpu::BindGroupLayout, wgpu::ComputePipeline) {
    let device = gpu.device();
    let in_compute = |entry: &wgpu::BindGroupLayoutEntry| wgpu::BindGroupLayoutEntry {
        visibility: wgpu::ShaderStages::COMPUTE,
        ..*entry
    };
    let entries: Vec<_> = entries.iter().map(in_compute).collect();
    let group = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some(label),
        entries: &entries,
    });
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(label),
        bind_group_layouts: &[Some(&group)],
        immediate_size: 0,
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(label),
        layout: Some(&layout),
        module: &gpu.shader(label, wgsl),
        entry_point: Some(entry_point),
        compilation_options: Default::default(),
        cache: None,
    });
    (group, pipeline)
}

pub(crate) fn entry(binding: u32, ty: wgpu::BindingType) -> wgpu::BindGroupLayoutEntry {
    let visibility = wgpu::ShaderStages::VERTEX_FRAGMENT | wgpu::ShaderStages::COMPUTE;
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility,
        ty,
        count: None,
    }
}

/// A uniform of `n_bytes`.
pub(crate) fn uniform(binding: u32, n_bytes: u64) -> wgpu::BindGroupLayoutEntry {
    uniform_buffer(binding, n_bytes, false)
}

/// A uniform of `n_bytes` whose offset is given when the group is set.
pub(crate) fn uniform_at_offset(binding: u32, n_bytes: u64) -> wgpu::BindGroupLayoutEntry {
    uniform_buffer(binding, n_bytes, true)
}

fn uniform_buffer(
    binding: u32,
    n_bytes: u64,
    has_dynamic_offset: bool,
) -> wgpu::BindGroupLayoutEntry {
    let min_binding_size = std::num::NonZeroU64::new(n_bytes);
    entry(
        binding,
        wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset,
            min_binding_size,
        },
    )
}

/// A list that shaders read.
pub(crate) fn storage(binding: u32) -> wgpu::BindGroupLayoutEntry {
    storage_buffer(
        binding,
        wgpu::BufferBindingType::Storage { read_only: true },
    )
}

/// A list that shaders read and write.
pub(crate) fn written_storage(binding: u32) -> wgpu::BindGroupLayoutEntry {
    storage_buffer(
        binding,
        wgpu::BufferBindingType::Storage { read_only: false },
    )
}

fn storage_buffer(binding: u32, ty: wgpu::BufferBindingType) -> wgpu::BindGroupLayoutEntry {
    entry(
        binding,
        wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset: false,
            min_binding_size: None,
        },
    )
}

pub(crate) fn texture(
    binding: u32,
    sample_type: wgpu::TextureSampleType,
) -> wgpu::BindGroupLayoutEntry {
    texture_of(binding, sample_type, wgpu::TextureViewDimension::D2)
}

pub(crate) fn texture_of(
    binding: u32,
    sample_type: wgpu::TextureSampleType,
    view_dimension: wgpu::TextureViewDimension,
) -> wgpu::BindGroupLayoutEntry {
    entry(
        binding,
        wgpu::BindingType::Texture {
            sample_type,
            view_dimension,
            multisampled: false,
        },
    )
}

/// Layers that a compute shader writes.
pub(crate) fn written_layers(
    binding: u32,
    format: wgpu::TextureFormat,
) -> wgpu::BindGroupLayoutEntry {
    let access = wgpu::StorageTextureAccess::WriteOnly;
    let ty = wgpu::BindingType::StorageTexture {
        access,
        format,
        view_dimension: wgpu::TextureViewDimension::D2Array,
    };
    wgpu::BindGroupLayoutEntry {
        visibility: wgpu::ShaderStages::COMPUTE,
        ..entry(binding, ty)
    }
}

pub(crate) fn sampler(binding: u32, kind: wgpu::SamplerBindingType) -> wgpu::BindGroupLayoutEntry {
    entry(binding, wgpu::BindingType::Sampler(kind))
}
