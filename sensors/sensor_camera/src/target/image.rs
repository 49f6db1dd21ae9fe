//! Textures with views of their layers.

use sensor_gpu::{Gpu, LayeredTexture};

/// A texture, its first layer, and all its layers.
#[derive(Clone, Debug)]
pub(crate) struct Image {
    pub texture: wgpu::Texture,
    pub view: wgpu::TextureView,
    pub layers: wgpu::TextureView,
    /// Whether the copy queue can read it while other targets are drawn.
    pub is_shared: bool,
}

impl Image {
    /// One layer as an image without layers.
    pub fn layer(&self, layer: u32) -> wgpu::TextureView {
        self.texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2),
            base_array_layer: layer,
            array_layer_count: Some(1),
            ..Default::default()
        })
    }

    /// One layer as an image with a single layer.
    pub fn single_layer(&self, layer: u32) -> wgpu::TextureView {
        self.texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            base_array_layer: layer,
            array_layer_count: Some(1),
            ..Default::default()
        })
    }
}

pub(crate) fn image(
    gpu: &Gpu,
    label: &str,
    size_px: [u32; 2],
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
) -> Image {
    layered_image(gpu, label, size_px, 1, format, usage)
}

pub(crate) fn layered_image(
    gpu: &Gpu,
    label: &str,
    size_px: [u32; 2],
    n_layers: u32,
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
) -> Image {
    view_image(LayeredTexture {
        texture: gpu.texture_layers(label, size_px, n_layers, format, usage),
        is_shared: false,
    })
}

pub(super) fn view_image(LayeredTexture { texture, is_shared }: LayeredTexture) -> Image {
    let n_layers = texture.depth_or_array_layers();
    let [view, layers] = [
        (wgpu::TextureViewDimension::D2, 1),
        (wgpu::TextureViewDimension::D2Array, n_layers),
    ]
    .map(|(dimension, n)| {
        texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(dimension),
            array_layer_count: Some(n),
            ..Default::default()
        })
    });
    Image {
        texture,
        view,
        layers,
        is_shared,
    }
}
