//! Draws shadow maps: pipelines, and one pass per layer with work.

use bytemuck::{Pod, Zeroable};
use sensor_gpu::{Gpu, Uploads};

use super::caster::{Caster, MatrixRows};
use crate::assets::GpuAssets;
use crate::binding_layout::{grow, storage, texture};
use crate::vertex::{VERTEX_ATTRIBUTES, VERTEX_BYTES};

/// Text of the shader.
pub(crate) const SHADOW_WGSL: &str = include_str!("../shader/shadow.wgsl");

/// Work on one map.
#[derive(Debug)]
pub(crate) struct MapWork {
    /// Where the map begins in its layer.
    pub origin_px: [u32; 2],
    pub side_px: u32,
    /// Parts to be restored before casters are drawn: x, y, width, height, in the map.
    pub wiped_px: Vec<[u32; 4]>,
    pub casters: Vec<Caster>,
}

/// Work on one layer.
pub(crate) struct LayerWork<'w> {
    pub view: &'w wgpu::TextureView,
    pub page_px: u32,
    /// Source of restored parts; without it they get the largest depth.
    pub from: Option<&'w wgpu::TextureView>,
    pub maps: Vec<&'w MapWork>,
}

/// A part of a layer in clip space: left, top, right, bottom.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Part([f32; 4]);

/// An indirect draw call in Vulkan's layout: index count, instance count, first index, base vertex,
/// first instance.
type Call = [u32; 5];

/// Pipelines and lists.
#[derive(Debug)]
pub(crate) struct ShadowDraw {
    casters: wgpu::RenderPipeline,
    restore: wgpu::RenderPipeline,
    wipe: wgpu::RenderPipeline,
    casters_layout: wgpu::BindGroupLayout,
    restore_layout: wgpu::BindGroupLayout,
    wipe_layout: wgpu::BindGroupLayout,
    matrices: wgpu::Buffer,
    parts: wgpu::Buffer,
    calls: wgpu::Buffer,
    /// Whether draw calls are indirect.
    indirect: bool,
}

impl ShadowDraw {
    pub fn new(gpu: &Gpu) -> Self {
        let device = gpu.device();
        let layout = |label, entries: &[wgpu::BindGroupLayoutEntry]| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some(label),
                entries,
            })
        };
        // Not visible to fragment shaders: `Drawing` in geometry/pipelines.rs tells why.
        let list = |binding| wgpu::BindGroupLayoutEntry {
            visibility: wgpu::ShaderStages::VERTEX,
            ..storage(binding)
        };
        let casters_layout = layout("shadow casters", &[list(0)]);
        let restore_layout = layout(
            "still shadows",
            &[texture(0, wgpu::TextureSampleType::Depth), list(1)],
        );
        let wipe_layout = layout("no shadows", &[list(1)]);
        let buffer =
            |label, usage| gpu.buffer(label, 64 * 1024, usage | wgpu::BufferUsages::COPY_DST);
        ShadowDraw {
            casters: pipeline(gpu, &casters_layout, "vs_main", None),
            restore: pipeline(gpu, &restore_layout, "vs_part", Some("fs_still")),
            wipe: pipeline(gpu, &wipe_layout, "vs_part", None),
            casters_layout,
            restore_layout,
            wipe_layout,
            matrices: buffer("shadow matrices", wgpu::BufferUsages::STORAGE),
            parts: buffer("shadow parts", wgpu::BufferUsages::STORAGE),
            calls: buffer("shadow calls", wgpu::BufferUsages::INDIRECT),
            indirect: !gpu.is_software() && gpu.has_indirect_instances(),
        }
    }

    /// Records one pass per layer, in order.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        (uploads, encoder): (&mut Uploads, &mut wgpu::CommandEncoder),
        assets: &GpuAssets,
        layers: &[LayerWork<'_>],
    ) {
        if layers.is_empty() {
            return;
        }
        self.upload(gpu, uploads, encoder, layers);
        let bind = |layout, entries: &[wgpu::BindGroupEntry<'_>]| {
            gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("shadow"),
                layout,
                entries,
            })
        };
        let matrices = bind(&self.casters_layout, &[entry_of(0, &self.matrices)]);
        let (mut first_part, mut first_call) = (0, 0);
        for LayerWork {
            view,
            from,
            maps,
            page_px,
        } in layers
        {
            let n_parts: u32 = maps.iter().map(|map| map.wiped_px.len() as u32).sum();
            // The layer is a single map, which is wiped completely.
            let cleared = from.is_none() && maps.iter().any(|map| map.side_px == *page_px);
            let load = if cleared {
                wgpu::LoadOp::Clear(1.0)
            } else {
                wgpu::LoadOp::Load
            };
            let wiping = match from {
                Some(still) => {
                    let still = wgpu::BindGroupEntry {
                        binding: 0,
                        resource: wgpu::BindingResource::TextureView(still),
                    };
                    Some((
                        &self.restore,
                        bind(&self.restore_layout, &[still, entry_of(1, &self.parts)]),
                    ))
                }
                None if cleared => None,
                None => Some((
                    &self.wipe,
                    bind(&self.wipe_layout, &[entry_of(1, &self.parts)]),
                )),
            };
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("shadow"),
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view,
                    depth_ops: Some(wgpu::Operations {
                        load,
                        store: wgpu::StoreOp::Store,
                    }),
                    stencil_ops: None,
                }),
                ..Default::default()
            });
            gpu.counters().add_pass();
            if let Some((pipeline, bound)) = wiping.as_ref().filter(|_| n_parts > 0) {
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, bound, &[]);
                pass.draw(0..4, first_part..first_part + n_parts);
            }
            first_part += n_parts;
            pass.set_pipeline(&self.casters);
            pass.set_bind_group(0, &matrices, &[]);
            pass.set_vertex_buffer(0, assets.vertices.slice(..));
            pass.set_index_buffer(assets.indices.slice(..), wgpu::IndexFormat::Uint32);
            for map in maps.iter().filter(|map| !map.casters.is_empty()) {
                let [x, y] = map.origin_px;
                pass.set_viewport(
                    x as f32,
                    y as f32,
                    map.side_px as f32,
                    map.side_px as f32,
                    0.0,
                    1.0,
                );
                pass.set_scissor_rect(x, y, map.side_px, map.side_px);
                self.draw_casters(gpu, &mut pass, &map.casters, first_call);
                first_call += map.casters.len() as u32;
            }
        }
    }

    fn draw_casters(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::RenderPass<'_>,
        casters: &[Caster],
        first: u32,
    ) {
        if self.indirect {
            pass.multi_draw_indexed_indirect(
                &self.calls,
                size_of::<Call>() as u64 * first as u64,
                casters.len() as u32,
            );
        }
        for (instance, Caster { mesh, .. }) in (first..).zip(casters) {
            if !self.indirect {
                pass.draw_indexed(
                    mesh.first_idx..mesh.first_idx + mesh.n_indices,
                    mesh.base_vertex,
                    instance..instance + 1,
                );
            }
            gpu.counters().add_draw(mesh.n_indices as u64 / 3);
        }
    }

    fn upload(
        &mut self,
        gpu: &Gpu,
        uploads: &mut Uploads,
        encoder: &mut wgpu::CommandEncoder,
        layers: &[LayerWork<'_>],
    ) {
        let maps = || {
            layers
                .iter()
                .flat_map(|layer| layer.maps.iter().map(|map| (*map, layer.page_px)))
        };
        let casters = || maps().flat_map(|(map, _)| &map.casters);
        let matrices: Vec<MatrixRows> = casters().map(|caster| caster.matrix).collect();
        let parts: Vec<Part> = maps()
            .flat_map(|(map, page_px)| {
                map.wiped_px
                    .iter()
                    .map(move |part| in_clip(map, part, page_px))
            })
            .collect();
        let call = |(instance, Caster { mesh, .. }): (u32, &Caster)| -> Call {
            [
                mesh.n_indices,
                1,
                mesh.first_idx,
                mesh.base_vertex as u32,
                instance,
            ]
        };
        let calls: Vec<Call> = if self.indirect {
            (0..).zip(casters()).map(call).collect()
        } else {
            Vec::new()
        };
        let lists: [(&mut wgpu::Buffer, &[u8]); 3] = [
            (&mut self.matrices, bytemuck::cast_slice(&matrices)),
            (&mut self.parts, bytemuck::cast_slice(&parts)),
            (&mut self.calls, bytemuck::cast_slice(&calls)),
        ];
        for (buffer, bytes) in lists.into_iter().filter(|(_, bytes)| !bytes.is_empty()) {
            grow(gpu, buffer, bytes.len() as u64);
            uploads.write(encoder, buffer, 0, bytes);
        }
    }
}

fn entry_of(binding: u32, buffer: &wgpu::Buffer) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry {
        binding,
        resource: buffer.as_entire_binding(),
    }
}

fn in_clip(map: &MapWork, [x, y, width, height]: &[u32; 4], page_px: u32) -> Part {
    let at = |px: u32| px as f32 / page_px as f32 * 2.0 - 1.0;
    let [left, top] = [map.origin_px[0] + x, map.origin_px[1] + y];
    Part([at(left), -at(top), at(left + width), -at(top + height)])
}

/// A pipeline that draws casters or, with `vs_part`, restores parts to the largest depth or to the
/// depth that the fragment shader reads.
fn pipeline(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    vertex: &str,
    fragment: Option<&str>,
) -> wgpu::RenderPipeline {
    let device = gpu.device();
    let shader = gpu.shader("shadow", SHADOW_WGSL);
    let is_part = vertex == "vs_part";
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("shadow"),
        bind_group_layouts: &[Some(layout)],
        immediate_size: 0,
    });
    let buffers = [Some(wgpu::VertexBufferLayout {
        array_stride: VERTEX_BYTES,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &VERTEX_ATTRIBUTES[..1],
    })];
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("shadow"),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &shader,
            entry_point: Some(vertex),
            compilation_options: Default::default(),
            buffers: if is_part { &[] } else { &buffers },
        },
        // Both sides cast shadows, because leaves and open shells have no back faces.
        primitive: wgpu::PrimitiveState {
            topology: if is_part {
                wgpu::PrimitiveTopology::TriangleStrip
            } else {
                wgpu::PrimitiveTopology::TriangleList
            },
            ..Default::default()
        },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: wgpu::TextureFormat::Depth16Unorm,
            depth_write_enabled: Some(true),
            depth_compare: Some(if is_part {
                wgpu::CompareFunction::Always
            } else {
                wgpu::CompareFunction::Less
            }),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: fragment.map(|entry_point| wgpu::FragmentState {
            module: &shader,
            entry_point: Some(entry_point),
            compilation_options: Default::default(),
            targets: &[],
        }),
        multiview_mask: None,
        cache: None,
    })
}
