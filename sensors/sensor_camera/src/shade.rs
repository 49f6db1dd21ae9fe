//! The shading pass: one compute dispatch per lit view of high quality, after its geometry pass.
//!
//! Shading is arithmetic, and GPUs made for computing have many times more of it in compute shaders than in fragment shaders; it is also
//! done once per pixel here, however often a pixel was drawn over. A software rasteriser has no such difference and shades while it draws.

use std::collections::BTreeMap;

use sensor_gpu::Gpu;

use crate::pass::{GeometryPass, ViewPass, entry, texture};
use crate::targets::{Image, Target, TargetSet, image};

/// Text of the shading shader.
pub(crate) fn shade_wgsl() -> String {
    [include_str!("shader/scene.wgsl"), include_str!("shader/material.wgsl"), include_str!("shader/shade.wgsl")].concat()
}

/// Pixels that one workgroup shades, as `shade.wgsl` has it.
const GROUP_PX: [u32; 2] = [16, 8];

/// Pipelines of the shading pass.
#[derive(Debug)]
pub(crate) struct ShadePass {
    shader: wgpu::ShaderModule,
    layout: wgpu::PipelineLayout,
    images_layout: wgpu::BindGroupLayout,
    /// By what is written: color, luminance.
    pipelines: BTreeMap<(bool, bool), wgpu::ComputePipeline>,
    /// Bound in place of what nobody reads.
    nowhere: [Image; 2],
}

impl ShadePass {
    pub fn new(gpu: &Gpu, geometry: &GeometryPass) -> Self {
        let device = gpu.device();
        let written = |binding: u32, format: wgpu::TextureFormat| {
            let access = wgpu::StorageTextureAccess::WriteOnly;
            entry(binding, wgpu::BindingType::StorageTexture { access, format, view_dimension: wgpu::TextureViewDimension::D2 })
        };
        let mut entries = [
            texture(0, wgpu::TextureSampleType::Uint),
            texture(1, wgpu::TextureSampleType::Float { filterable: false }),
            texture(2, wgpu::TextureSampleType::Uint),
            written(3, Target::Color.format()),
            written(4, Target::Luminance.format()),
        ];
        entries.iter_mut().for_each(|entry| entry.visibility = wgpu::ShaderStages::COMPUTE);
        let images_layout =
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("shaded images"), entries: &entries });
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("shade"),
            bind_group_layouts: &[Some(&geometry.scene_layout), Some(&geometry.view_layout), Some(&images_layout)],
            immediate_size: 0,
        });
        let nowhere = [Target::Color, Target::Luminance]
            .map(|target| image(gpu, "nowhere", [1, 1], target.format(), wgpu::TextureUsages::STORAGE_BINDING));
        ShadePass { shader: gpu.shader("shade", &shade_wgsl()), layout, images_layout, pipelines: BTreeMap::new(), nowhere }
    }

    /// Makes the pipeline for what is lit in `set`, once.
    pub fn prepare(&mut self, gpu: &Gpu, set: TargetSet) {
        let (color, luminance) = lit(set);
        let (shader, layout) = (&self.shader, &self.layout);
        self.pipelines.entry((color, luminance)).or_insert_with(|| {
            let constants = [("WITH_COLOR", color as u32 as f64), ("WITH_LUMINANCE", luminance as u32 as f64)];
            gpu.device().create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some("shade"),
                layout: Some(layout),
                module: shader,
                entry_point: Some("cs_main"),
                compilation_options: wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() },
                cache: None,
            })
        });
    }

    /// Records the shading of one view that the geometry pass has drawn; `bound_view` is what that pass returned.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &wgpu::BindGroup,
        bound_view: &wgpu::BindGroup,
        view: &ViewPass<'_>,
        size_px: [u32; 2],
    ) {
        let images = self.bind_images(gpu, view);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("shade"), timestamp_writes: None });
        pass.set_pipeline(&self.pipelines[&lit(view.set)]);
        pass.set_bind_group(0, scene, &[]);
        pass.set_bind_group(1, bound_view, &[GeometryPass::offset_of(view.view_idx)]);
        pass.set_bind_group(2, &images, &[]);
        pass.dispatch_workgroups(size_px[0].div_ceil(GROUP_PX[0]), size_px[1].div_ceil(GROUP_PX[1]), 1);
    }

    fn bind_images(&self, gpu: &Gpu, view: &ViewPass<'_>) -> wgpu::BindGroup {
        let (color, luminance) = lit(view.set);
        let read = |target: Target| &view.targets.get(target).view;
        let images = [
            read(Target::Surface),
            read(Target::Depth),
            read(Target::Instance),
            if color { read(Target::Color) } else { &self.nowhere[0].view },
            if luminance { read(Target::Luminance) } else { &self.nowhere[1].view },
        ];
        let entries: Vec<wgpu::BindGroupEntry<'_>> = (0..)
            .zip(images)
            .map(|(binding, view)| wgpu::BindGroupEntry { binding, resource: wgpu::BindingResource::TextureView(view) })
            .collect();
        gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("shaded images"),
            layout: &self.images_layout,
            entries: &entries,
        })
    }
}

/// Whether color and luminance are written.
fn lit(set: TargetSet) -> (bool, bool) {
    (set.contains(Target::Color), set.contains(Target::Luminance))
}
