//! The pass that makes a picture of its faces.

use std::collections::BTreeMap;

use sensor_gpu::Gpu;

use super::plan::FacePlan;
use crate::target::{Target, TargetLayer, Targets};

/// Text of the shader.
pub(crate) const FACES_WGSL: &str = include_str!("../shader/faces.wgsl");

/// Where the pixels of a picture lie in its faces, on the GPU.
#[derive(Clone, Debug)]
pub(crate) struct FaceTable(wgpu::TextureView);

impl FaceTable {
    pub fn upload(gpu: &Gpu, plan: &FacePlan) -> FaceTable {
        let [width, height] = plan.size_px;
        let texture = gpu.texture_layers(
            "table of faces",
            plan.size_px,
            1,
            wgpu::TextureFormat::Rg32Uint,
            wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        );
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(8 * width),
            rows_per_image: Some(height),
        };
        gpu.queue().write_texture(
            texture.as_image_copy(),
            bytemuck::cast_slice(&plan.table),
            layout,
            texture.size(),
        );
        FaceTable(texture.create_view(&Default::default()))
    }
}

/// The pipelines, made when they are first needed.
#[derive(Debug, Default)]
pub(crate) struct FacePass {
    pipelines: BTreeMap<u8, wgpu::RenderPipeline>,
}

impl FacePass {
    /// Takes a picture's colour or radiance from its faces, which are in the plan's order. What the
    /// lens does not see is black.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        (plan, table): (&FacePlan, &FaceTable),
        faces: &[TargetLayer<'_>],
        to: &Targets,
        target: Target,
    ) {
        let pipeline = self
            .pipelines
            .entry(target as u8)
            .or_insert_with(|| pipeline(gpu, target));
        gpu.counters().add_pass();
        let nothing = match target {
            // A word: B, G, R are 0, A is 255.
            Target::Color => wgpu::Color {
                r: f64::from(0xff00_0000_u32),
                ..wgpu::Color::TRANSPARENT
            },
            _ => wgpu::Color::TRANSPARENT,
        };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("faces"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &to.get(target).view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(nothing),
                    store: wgpu::StoreOp::Store,
                },
            })],
            ..Default::default()
        });
        pass.set_pipeline(pipeline);
        for (number, (face, from)) in (0..).zip(plan.faces.iter().zip(faces)) {
            let source = from.view(target);
            let bound = gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("face"),
                layout: &pipeline.get_bind_group_layout(0),
                entries: &[
                    wgpu::BindGroupEntry {
                        binding: 0,
                        resource: wgpu::BindingResource::TextureView(&table.0),
                    },
                    wgpu::BindGroupEntry {
                        binding: if target == Target::Color { 2 } else { 1 },
                        resource: wgpu::BindingResource::TextureView(&source),
                    },
                ],
            });
            let [x, y, width, height] = face.shown_px;
            pass.set_scissor_rect(x, y, width, height);
            pass.set_bind_group(0, &bound, &[]);
            pass.draw(0..3, number..number + 1);
        }
        drop(pass);
        gpu.mark(encoder, "faces");
    }
}

fn pipeline(gpu: &Gpu, target: Target) -> wgpu::RenderPipeline {
    let shader = gpu.shader("faces", FACES_WGSL);
    let entry_point = match target {
        Target::Color => "fs_color",
        _ => "fs_radiance",
    };
    gpu.device()
        .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("faces"),
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
