//! The geometry pass: pipelines per set of targets, bind groups, recording.

use std::collections::BTreeMap;

use sensor_gpu::Gpu;

use crate::assets::GpuAssets;
use crate::draw::{DrawCall, Drawn};
use crate::lamps::LampLists;
use crate::material;
use crate::targets::{Image, Target, TargetSet, Targets, image};
use crate::uniform::{InstanceData, LampData, LightData, MAX_TOGETHER, ViewData};

/// Text of the geometry shader: with instances that come with the draw call or lie in a list; with slim surfaces or wide ones.
pub(crate) fn geometry_wgsl(immediate: bool, slim: bool) -> String {
    let instances = if immediate { include_str!("shader/instance_immediate.wgsl") } else { include_str!("shader/instance_storage.wgsl") };
    let surfaces = if slim {
        [include_str!("shader/wall.wgsl"), include_str!("shader/surface_slim.wgsl")]
    } else {
        ["", include_str!("shader/surface_wide.wgsl")]
    };
    let scene = [include_str!("shader/scene.wgsl"), include_str!("shader/bound.wgsl"), include_str!("shader/view_drawn.wgsl")].concat();
    let parts = [&scene, instances, surfaces[0], surfaces[1], include_str!("shader/surface.wgsl")];
    parts.concat() + include_str!("shader/geometry.wgsl")
}

/// Attributes of [`sensor_core::Vertex`].
pub(crate) const VERTEX_ATTRIBUTES: [wgpu::VertexAttribute; 6] = [
    attribute(0, 0, wgpu::VertexFormat::Float32x3),
    attribute(1, 12, wgpu::VertexFormat::Snorm8x4),
    attribute(2, 16, wgpu::VertexFormat::Unorm8x4),
    attribute(3, 20, wgpu::VertexFormat::Uint8x4),
    attribute(4, 24, wgpu::VertexFormat::Uint32),
    attribute(5, 28, wgpu::VertexFormat::Float32x2),
];

const fn attribute(shader_location: u32, offset: u64, format: wgpu::VertexFormat) -> wgpu::VertexAttribute {
    wgpu::VertexAttribute { format, offset, shader_location }
}

pub(crate) const VERTEX_BYTES: u64 = size_of::<sensor_core::Vertex>() as u64;

/// Pipelines and layouts of the geometry pass.
#[derive(Debug)]
pub(crate) struct GeometryPass {
    shader: wgpu::ShaderModule,
    submit: Submit,
    /// Whether surfaces are slim: what draws in low quality shades them by drawing too.
    slim: bool,
    /// What [`GeometryPass::hand_over`] draws nothing into.
    interlude: Image,
    layout: wgpu::PipelineLayout,
    pub scene_layout: wgpu::BindGroupLayout,
    /// Of one view that is drawn.
    pub view_layout: wgpu::BindGroupLayout,
    /// Of views that are computed.
    pub views_layout: wgpu::BindGroupLayout,
    sky_sampler: wgpu::Sampler,
    noise: wgpu::TextureView,
    noise_sampler: wgpu::Sampler,
    shadow_sampler: wgpu::Sampler,
    pipelines: BTreeMap<u16, Pipelines>,
    light: wgpu::Buffer,
    views: wgpu::Buffer,
    /// Instances of all views, where they do not come with draw calls.
    pub instances: wgpu::Buffer,
    lamps: wgpu::Buffer,
    lamp_tiles: wgpu::Buffer,
    calls: wgpu::Buffer,
}

/// How draw calls reach the GPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Submit {
    /// Each with its instance: for software adapters.
    Immediate,
    /// One by one, instances in a list.
    Single,
    /// All of a view at once, instances in a list.
    Indirect,
}

#[derive(Clone, Debug)]
struct Pipelines {
    meshes: wgpu::RenderPipeline,
    /// For meshes without walls.
    plain: wgpu::RenderPipeline,
    sky: wgpu::RenderPipeline,
}

/// Triangles after which a software rasteriser is to begin with them.
const HANDED_OVER_TRIANGLES: u32 = 3000;

/// Distance between two views' uniforms; Vulkan's largest required alignment is 256.
const VIEW_BYTES: u64 = size_of::<ViewData>() as u64;
const _: () = assert!(VIEW_BYTES.is_multiple_of(256));
/// What one binding holds.
const VIEWS_BYTES: u64 = VIEW_BYTES * MAX_TOGETHER as u64;

/// One view to draw.
pub(crate) struct ViewPass<'p> {
    pub targets: &'p Targets,
    pub set: TargetSet,
    pub drawn: &'p Drawn,
    /// Number of the first of its draw calls among those of all views.
    pub first_call: usize,
    pub view_idx: usize,
}

/// Views one after the other whose targets are layers of the same textures: compute shaders do them together.
pub(crate) struct Together<'t> {
    pub targets: &'t Targets,
    /// What the targets have, wanted or not.
    pub kept: TargetSet,
    pub first: usize,
    pub n: usize,
}

impl GeometryPass {
    pub fn new(gpu: &Gpu, slim: bool) -> Self {
        let device = gpu.device();
        let scene_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("scene"),
            entries: &[
                uniform(0, size_of::<LightData>() as u64, false),
                storage(1),
                texture(2, wgpu::TextureSampleType::Float { filterable: true }),
                sampler(3, wgpu::SamplerBindingType::Filtering),
                texture(4, wgpu::TextureSampleType::Float { filterable: true }),
                sampler(5, wgpu::SamplerBindingType::Filtering),
                storage(6),
            ],
        });
        let layout_of_views = |view_dimension| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("view"),
                entries: &[
                    uniform(0, VIEWS_BYTES, true),
                    texture_of(1, wgpu::TextureSampleType::Depth, view_dimension),
                    sampler(2, wgpu::SamplerBindingType::Comparison),
                    storage(3),
                    storage(4),
                    texture_of(5, wgpu::TextureSampleType::Depth, view_dimension),
                ],
            })
        };
        let [view_layout, views_layout] = [wgpu::TextureViewDimension::D2, wgpu::TextureViewDimension::D2Array].map(layout_of_views);
        let submit = match (gpu.is_software() && gpu.has_immediates(INSTANCE_BYTES as u32), gpu.has_indirect_instances()) {
            (true, _) => Submit::Immediate,
            (false, true) => Submit::Indirect,
            (false, false) => Submit::Single,
        };
        let immediate = submit == Submit::Immediate;
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("geometry"),
            bind_group_layouts: &[Some(&scene_layout), Some(&view_layout)],
            immediate_size: if immediate { INSTANCE_BYTES as u32 } else { 0 },
        });
        let linear = wgpu::SamplerDescriptor {
            label: Some("sky"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Nearest,
            ..Default::default()
        };
        let compare = wgpu::SamplerDescriptor {
            label: Some("shadow"),
            compare: Some(wgpu::CompareFunction::LessEqual),
            mipmap_filter: wgpu::MipmapFilterMode::Nearest,
            ..linear.clone()
        };
        let repeat = wgpu::SamplerDescriptor {
            label: Some("noise"),
            address_mode_u: wgpu::AddressMode::Repeat,
            address_mode_v: wgpu::AddressMode::Repeat,
            ..linear.clone()
        };
        GeometryPass {
            shader: gpu.shader("geometry", &geometry_wgsl(immediate, slim)),
            submit,
            slim,
            interlude: image(gpu, "interlude", [1, 1], wgpu::TextureFormat::R8Unorm, wgpu::TextureUsages::RENDER_ATTACHMENT),
            sky_sampler: device.create_sampler(&linear),
            noise: material::noise_texture(gpu),
            noise_sampler: device.create_sampler(&repeat),
            shadow_sampler: device.create_sampler(&compare),
            layout,
            scene_layout,
            view_layout,
            views_layout,
            pipelines: BTreeMap::new(),
            light: gpu.buffer("light", size_of::<LightData>() as u64, wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST),
            views: gpu.buffer("views", VIEWS_BYTES, wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST),
            instances: gpu.buffer("instances", INSTANCE_BYTES, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST),
            lamps: gpu.buffer("lamps", LAMP_BYTES, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST),
            lamp_tiles: gpu.buffer("lamp tiles", 8, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST),
            calls: gpu.buffer("draw calls", CALL_BYTES, wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::COPY_DST),
        }
    }

    /// Makes the pipelines for a set of targets, once.
    pub fn prepare(&mut self, gpu: &Gpu, set: TargetSet) {
        let set = set.drawn();
        if !self.pipelines.contains_key(&set.0) {
            let meshes = self.pipeline(gpu, set, Kind::Meshes);
            let has_plain = self.slim && self.submit != Submit::Indirect;
            let plain = if has_plain { self.pipeline(gpu, set, Kind::Plain) } else { meshes.clone() };
            self.pipelines.insert(set.0, Pipelines { meshes, plain, sky: self.pipeline(gpu, set, Kind::Sky) });
        }
    }

    fn pipeline(&self, gpu: &Gpu, set: TargetSet, kind: Kind) -> wgpu::RenderPipeline {
        let state = |target: Target| {
            set.contains(target).then(|| wgpu::ColorTargetState {
                format: target.format_if(self.slim),
                blend: None,
                write_mask: wgpu::ColorWrites::ALL,
            })
        };
        let targets = Target::DRAWN.map(state);
        let mut constants = vec![("WITH_FLOW", set.contains(Target::Flow) as u32 as f64)];
        if self.slim {
            let with_walls = kind == Kind::Meshes && set.contains(Target::Surface);
            constants.extend([("WITH_WALLS", with_walls as u32 as f64), ("WITH_SWITCHED", 1.0)]);
        }
        let options = wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
        let buffers = [Some(wgpu::VertexBufferLayout {
            array_stride: VERTEX_BYTES,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: &VERTEX_ATTRIBUTES,
        })];
        let (vertex, fragment) = kind.entry_points();
        gpu.device().create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(fragment),
            layout: Some(&self.layout),
            vertex: wgpu::VertexState {
                module: &self.shader,
                entry_point: Some(vertex),
                compilation_options: options.clone(),
                buffers: if kind == Kind::Sky { &[] } else { &buffers },
            },
            primitive: wgpu::PrimitiveState { cull_mode: (kind != Kind::Sky).then_some(wgpu::Face::Back), ..Default::default() },
            depth_stencil: Some(wgpu::DepthStencilState {
                format: wgpu::TextureFormat::Depth32Float,
                depth_write_enabled: Some(kind != Kind::Sky),
                // Reversed z: near is 1, infinity is 0. The sky lies at 0 and fills what nothing was drawn to. Of surfaces at equal depth
                // the last one counts.
                depth_compare: Some(wgpu::CompareFunction::GreaterEqual),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &self.shader,
                entry_point: Some(fragment),
                compilation_options: options,
                targets: &targets,
            }),
            multiview_mask: None,
            cache: None,
        })
    }

    /// The list of instances, large enough for so many.
    pub fn room_for_instances(&mut self, gpu: &Gpu, n: usize) -> &wgpu::Buffer {
        grow(gpu, &mut self.instances, INSTANCE_BYTES * n as u64);
        &self.instances
    }

    /// Uploads what changes from tick to tick; `listed`: a compute shader draws, and has its own lists.
    pub fn upload(&mut self, gpu: &Gpu, light: &LightData, views: &[ViewData], drawn: &[&Drawn], lamps: &LampLists, listed: bool) {
        // The last view's binding reaches beyond it.
        grow(gpu, &mut self.views, VIEW_BYTES * views.len() as u64 + VIEWS_BYTES);
        gpu.queue().write_buffer(&self.light, 0, bytemuck::bytes_of(light));
        gpu.queue().write_buffer(&self.views, 0, bytemuck::cast_slice(views));
        grow(gpu, &mut self.lamps, LAMP_BYTES * lamps.lamps.len() as u64);
        grow(gpu, &mut self.lamp_tiles, 8 * lamps.tiles.len() as u64);
        gpu.queue().write_buffer(&self.lamps, 0, bytemuck::cast_slice(&lamps.lamps));
        gpu.queue().write_buffer(&self.lamp_tiles, 0, bytemuck::cast_slice(&lamps.tiles));
        if !listed && self.submit != Submit::Immediate {
            self.room_for_instances(gpu, drawn.iter().map(|drawn| drawn.instances.len()).sum());
            for drawn in drawn {
                let begin = INSTANCE_BYTES * drawn.first_instance as u64;
                gpu.queue().write_buffer(&self.instances, begin, bytemuck::cast_slice(&drawn.instances));
            }
        }
        if !listed && self.submit == Submit::Indirect {
            // Index count, instance count, first index, base vertex, first instance.
            let words = |drawn: &&Drawn| {
                let first = drawn.first_instance;
                let word = move |call: &DrawCall| {
                    let mesh = call.mesh;
                    [mesh.n_indices, 1, mesh.first_idx, mesh.base_vertex as u32, first + call.instance_idx]
                };
                drawn.calls.iter().map(word).collect::<Vec<[u32; 5]>>()
            };
            let words: Vec<[u32; 5]> = drawn.iter().flat_map(words).collect();
            grow(gpu, &mut self.calls, CALL_BYTES * words.len() as u64);
            gpu.queue().write_buffer(&self.calls, 0, bytemuck::cast_slice(&words));
        }
    }

    /// Bind group of what all views share.
    pub fn bind_scene(&self, gpu: &Gpu, sky: &wgpu::TextureView, switched: &wgpu::Buffer) -> wgpu::BindGroup {
        gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("scene"),
            layout: &self.scene_layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: self.light.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: self.instances.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 2, resource: wgpu::BindingResource::TextureView(sky) },
                wgpu::BindGroupEntry { binding: 3, resource: wgpu::BindingResource::Sampler(&self.sky_sampler) },
                wgpu::BindGroupEntry { binding: 4, resource: wgpu::BindingResource::TextureView(&self.noise) },
                wgpu::BindGroupEntry { binding: 5, resource: wgpu::BindingResource::Sampler(&self.noise_sampler) },
                wgpu::BindGroupEntry { binding: 6, resource: switched.as_entire_binding() },
            ],
        })
    }

    /// Bind group of a view that is drawn and the lamps of all.
    pub fn bind_view(&self, gpu: &Gpu, shadows: [&wgpu::TextureView; 2]) -> wgpu::BindGroup {
        self.bind(gpu, &self.view_layout, shadows)
    }

    /// Bind group of views that are computed, whose shadow maps are layers, and the lamps of all.
    pub fn bind_views(&self, gpu: &Gpu, shadows: [&wgpu::TextureView; 2]) -> wgpu::BindGroup {
        self.bind(gpu, &self.views_layout, shadows)
    }

    fn bind(&self, gpu: &Gpu, layout: &wgpu::BindGroupLayout, [near, far]: [&wgpu::TextureView; 2]) -> wgpu::BindGroup {
        let view = wgpu::BufferBinding { buffer: &self.views, offset: 0, size: std::num::NonZeroU64::new(VIEWS_BYTES) };
        gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("view"),
            layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::Buffer(view) },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(near) },
                wgpu::BindGroupEntry { binding: 2, resource: wgpu::BindingResource::Sampler(&self.shadow_sampler) },
                wgpu::BindGroupEntry { binding: 3, resource: self.lamps.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 4, resource: self.lamp_tiles.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 5, resource: wgpu::BindingResource::TextureView(far) },
            ],
        })
    }

    /// Where a view's uniform begins.
    pub fn offset_of(view_idx: usize) -> u32 {
        (view_idx as u64 * VIEW_BYTES) as u32
    }

    /// Records the drawing of one view.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        assets: &GpuAssets,
        [scene, bound]: [&wgpu::BindGroup; 2],
        view: &ViewPass<'_>,
    ) {
        let attachment = |target: Target| {
            view.set.drawn().contains(target).then(|| wgpu::RenderPassColorAttachment {
                view: &view.targets.get(target).view,
                depth_slice: None,
                resolve_target: None,
                // Not cleared: meshes and sky together write every pixel.
                ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
            })
        };
        let attachments = Target::DRAWN.map(attachment);
        let pipelines = &self.pipelines[&view.set.drawn().0];
        let begin = |encoder: &mut wgpu::CommandEncoder, load: wgpu::LoadOp<f32>| {
            let mut pass = encoder
                .begin_render_pass(&wgpu::RenderPassDescriptor {
                    label: Some("geometry"),
                    color_attachments: &attachments,
                    depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                        view: &view.targets.z_buffer().view,
                        depth_ops: Some(wgpu::Operations { load, store: wgpu::StoreOp::Store }),
                        stencil_ops: None,
                    }),
                    timestamp_writes: None,
                    occlusion_query_set: None,
                    multiview_mask: None,
                })
                .forget_lifetime();
            pass.set_bind_group(0, scene, &[]);
            pass.set_bind_group(1, bound, &[Self::offset_of(view.view_idx)]);
            pass.set_vertex_buffer(0, assets.vertices.slice(..));
            pass.set_index_buffer(assets.indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.set_pipeline(&pipelines.meshes);
            pass
        };
        let mut pass = begin(encoder, wgpu::LoadOp::Clear(0.0));
        gpu.counters().add_pass();
        let (mut is_plain, mut n_waiting) = (false, 0);
        let Drawn { calls, instances, first_instance, .. } = view.drawn;
        if self.submit == Submit::Indirect && !calls.is_empty() {
            pass.multi_draw_indexed_indirect(&self.calls, CALL_BYTES * view.first_call as u64, calls.len() as u32);
        }
        for DrawCall { mesh, instance_idx, .. } in calls {
            gpu.counters().add_draw(mesh.n_indices as u64 / 3);
            if self.submit == Submit::Indirect {
                continue;
            }
            if self.slim && is_plain == mesh.has_walls {
                is_plain = !is_plain;
                pass.set_pipeline(if is_plain { &pipelines.plain } else { &pipelines.meshes });
            }
            n_waiting += mesh.n_indices / 3;
            if self.submit == Submit::Immediate && n_waiting > HANDED_OVER_TRIANGLES {
                drop(pass);
                self.hand_over(encoder);
                pass = begin(encoder, wgpu::LoadOp::Load);
                if is_plain {
                    pass.set_pipeline(&pipelines.plain);
                }
                n_waiting = 0;
            }
            if self.submit == Submit::Immediate {
                pass.set_immediates(0, bytemuck::bytes_of(&instances[*instance_idx as usize]));
            }
            let first = if self.submit == Submit::Immediate { 0 } else { first_instance + instance_idx };
            pass.draw_indexed(mesh.first_idx..mesh.first_idx + mesh.n_indices, mesh.base_vertex, first..first + 1);
        }
        pass.set_pipeline(&pipelines.sky);
        pass.draw(0..3, 0..1);
        gpu.counters().add_draw(1);
    }

    /// Makes a software rasteriser begin with what it was given: it fills pixels when the attachments change, on other threads than the one
    /// that goes on with the next vertices.
    fn hand_over(&self, encoder: &mut wgpu::CommandEncoder) {
        let ops = wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store };
        let attachment = wgpu::RenderPassColorAttachment { view: &self.interlude.view, depth_slice: None, resolve_target: None, ops };
        let attachments = [Some(attachment)];
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("interlude"),
            color_attachments: &attachments,
            ..Default::default()
        });
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Meshes,
    /// Meshes without walls.
    Plain,
    Sky,
}

impl Kind {
    fn entry_points(self) -> (&'static str, &'static str) {
        match self {
            Kind::Meshes | Kind::Plain => ("vs_main", "fs_main"),
            Kind::Sky => ("vs_sky", "fs_sky"),
        }
    }
}

/// A draw call in a buffer, as Vulkan has it.
const CALL_BYTES: u64 = 20;

const LAMP_BYTES: u64 = size_of::<LampData>() as u64;

const INSTANCE_BYTES: u64 = size_of::<InstanceData>() as u64;

/// Replaces `buffer` by one of twice the need if it is too small.
pub(crate) fn grow(gpu: &Gpu, buffer: &mut wgpu::Buffer, n_bytes: u64) {
    if buffer.size() < n_bytes {
        *buffer = gpu.buffer("grown", 2 * n_bytes, buffer.usage());
    }
}

pub(crate) fn entry(binding: u32, ty: wgpu::BindingType) -> wgpu::BindGroupLayoutEntry {
    let visibility = wgpu::ShaderStages::VERTEX_FRAGMENT | wgpu::ShaderStages::COMPUTE;
    wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None }
}

pub(crate) fn uniform(binding: u32, n_bytes: u64, has_dynamic_offset: bool) -> wgpu::BindGroupLayoutEntry {
    let min_binding_size = std::num::NonZeroU64::new(n_bytes);
    entry(binding, wgpu::BindingType::Buffer { ty: wgpu::BufferBindingType::Uniform, has_dynamic_offset, min_binding_size })
}

pub(crate) fn storage(binding: u32) -> wgpu::BindGroupLayoutEntry {
    entry(
        binding,
        wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Storage { read_only: true },
            has_dynamic_offset: false,
            min_binding_size: None,
        },
    )
}

pub(crate) fn texture(binding: u32, sample_type: wgpu::TextureSampleType) -> wgpu::BindGroupLayoutEntry {
    texture_of(binding, sample_type, wgpu::TextureViewDimension::D2)
}

pub(crate) fn texture_of(
    binding: u32,
    sample_type: wgpu::TextureSampleType,
    view_dimension: wgpu::TextureViewDimension,
) -> wgpu::BindGroupLayoutEntry {
    entry(binding, wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: false })
}

/// Layers that a compute shader writes.
pub(crate) fn written_layers(binding: u32, format: wgpu::TextureFormat) -> wgpu::BindGroupLayoutEntry {
    let access = wgpu::StorageTextureAccess::WriteOnly;
    let ty = wgpu::BindingType::StorageTexture { access, format, view_dimension: wgpu::TextureViewDimension::D2Array };
    wgpu::BindGroupLayoutEntry { visibility: wgpu::ShaderStages::COMPUTE, ..entry(binding, ty) }
}

fn sampler(binding: u32, kind: wgpu::SamplerBindingType) -> wgpu::BindGroupLayoutEntry {
    entry(binding, wgpu::BindingType::Sampler(kind))
}
