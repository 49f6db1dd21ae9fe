//! How vertices of meshes reach the shaders.

/// Attributes of [`sensor_core::Vertex`].
pub(crate) const VERTEX_ATTRIBUTES: [wgpu::VertexAttribute; 6] =
    with_albedo(wgpu::VertexFormat::Unorm8x4);

pub(crate) const fn with_albedo(albedo: wgpu::VertexFormat) -> [wgpu::VertexAttribute; 6] {
    [
        attribute(0, 0, wgpu::VertexFormat::Float32x3),
        attribute(1, 12, wgpu::VertexFormat::Snorm8x4),
        attribute(2, 16, albedo),
        attribute(3, 20, wgpu::VertexFormat::Uint8x4),
        attribute(4, 24, wgpu::VertexFormat::Uint32),
        attribute(5, 28, wgpu::VertexFormat::Float32x2),
    ]
}

pub(crate) const fn attribute(
    shader_location: u32,
    offset: u64,
    format: wgpu::VertexFormat,
) -> wgpu::VertexAttribute {
    wgpu::VertexAttribute {
        format,
        offset,
        shader_location,
    }
}

pub(crate) const VERTEX_BYTES: u64 = size_of::<sensor_core::Vertex>() as u64;
