//! Lens distortion: bends every finished image of a view alike, so that labels, depth, flow and
//! colour fit each other.
//!
//! The view is drawn as a pinhole camera with margins ([`sensor_spec::drawn_by`]); afterwards each
//! image is sampled where the lens looks. Views without distortion skip this pass.

use std::collections::BTreeMap;

use bytemuck::{Pod, Zeroable};
use schema_types::Distortion;
use sensor_gpu::Gpu;
use sensor_spec::Intrinsics;

use crate::target::{Target, TargetLayer, TargetSet, Targets};

/// Text of the shader.
pub(crate) const LENS_WGSL: &str = include_str!("shader/lens.wgsl");

/// Mirror of `Lens` in `shader/lens.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct LensData {
    /// Width and height of the picture.
    pub out_px: [f32; 2],
    /// Columns and rows of the pinhole's image before the picture's first.
    pub margin_px: [f32; 2],
    /// Scale of the radius in x and y.
    pub distortion_size: [f32; 2],
    /// Quadratic coefficient.
    pub distortion_k: f32,
    /// Cubic coefficient.
    pub distortion_k_cubed: f32,
}

impl LensData {
    /// The bend from the image of `drawn` to a picture.
    pub(crate) fn new(bend: &Distortion, drawn: &Intrinsics, picture: &Intrinsics) -> LensData {
        let half = |all: u32, part: u32| 0.5 * (all - part) as f32;
        LensData {
            out_px: [picture.width_px as f32, picture.height_px as f32],
            margin_px: [
                half(drawn.width_px, picture.width_px),
                half(drawn.height_px, picture.height_px),
            ],
            distortion_size: bend.size,
            distortion_k: bend.k,
            distortion_k_cubed: bend.k_cubed,
        }
    }
}

/// The images that a lens bends, and how each is sampled.
const BENT: [(Target, &str); 7] = [
    (Target::Depth, "fs_float"),
    (Target::Class, "fs_code"),
    (Target::Instance, "fs_code"),
    (Target::Flow, "fs_flow"),
    (Target::Normals, "fs_normal"),
    (Target::Color, "fs_color"),
    (Target::Luminance, "fs_luminance"),
];

/// Those of a set that a lens bends.
pub(crate) fn bent_of(set: TargetSet) -> TargetSet {
    BENT.iter()
        .filter(|(target, _)| set.contains(*target))
        .fold(TargetSet::default(), |bent, (target, _)| {
            bent.union(target.bit())
        })
}

/// The pipelines, made when they are first needed.
#[derive(Debug, Default)]
pub(crate) struct LensPass {
    pipelines: BTreeMap<u8, wgpu::RenderPipeline>,
}

impl LensPass {
    /// Bends the images of `set` from one layer of a view's targets into others of the picture's
    /// size.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        from: TargetLayer<'_>,
        to: &Targets,
        set: TargetSet,
        data: LensData,
    ) {
        let data = gpu.buffer_with(
            "lens",
            bytemuck::bytes_of(&data),
            wgpu::BufferUsages::UNIFORM,
        );
        for (target, entry_point) in BENT.into_iter().filter(|(t, _)| set.contains(*t)) {
            let pipeline = self
                .pipelines
                .entry(target as u8)
                .or_insert_with(|| pipeline(gpu, target, entry_point));
            let source = from.view(target);
            let is_code = matches!(target, Target::Class | Target::Instance | Target::Color);
            let bound = gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("lens"),
                layout: &pipeline.get_bind_group_layout(0),
                entries: &[
                    wgpu::BindGroupEntry {
                        binding: 0,
                        resource: data.as_entire_binding(),
                    },
                    wgpu::BindGroupEntry {
                        binding: if is_code { 2 } else { 1 },
                        resource: wgpu::BindingResource::TextureView(&source),
                    },
                ],
            });
            gpu.counters().add_pass();
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("lens"),
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: &to.get(target).view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                        store: wgpu::StoreOp::Store,
                    },
                })],
                ..Default::default()
            });
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &bound, &[]);
            pass.draw(0..3, 0..1);
        }
        gpu.mark(encoder, "lens");
    }
}

fn pipeline(gpu: &Gpu, target: Target, entry_point: &str) -> wgpu::RenderPipeline {
    let shader = gpu.shader("lens", LENS_WGSL);
    gpu.device()
        .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("lens"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &shader,
                entry_point: Some("vs_main"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &shader,
                entry_point: Some(entry_point),
                compilation_options: Default::default(),
                targets: &[Some(wgpu::ColorTargetState {
                    format: target.format(),
                    blend: None,
                    write_mask: wgpu::ColorWrites::ALL,
                })],
            }),
            multiview_mask: None,
            cache: None,
        })
}
