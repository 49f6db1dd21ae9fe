//! The geometry pass: pipelines per set of targets, bind groups, recording.

mod attributes;
mod bindings;
mod pipelines;

use std::collections::BTreeMap;

use sensor_gpu::Gpu;

use attributes::InstanceAttributes;
pub(crate) use attributes::{VERTEX_ATTRIBUTES, VERTEX_BYTES};
pub(crate) use bindings::{
    entry, grow, sampler, storage, texture, texture_of, uniform, written_layers,
};
pub(crate) use pipelines::geometry_wgsl;
use pipelines::{Drawing, GeometryKey, Pipelines};

use crate::assets::GpuAssets;
use crate::draw::{DrawCall, Drawn};
use crate::lamps::LampLists;
use crate::material;
use crate::targets::{Image, Target, TargetSet, Targets, image};
use crate::uniform::{InstanceData, LampData, LightData, MAX_TOGETHER, ViewData};

/// Pipelines and layouts of the geometry pass.
#[derive(Debug)]
pub(crate) struct GeometryPass {
    /// Without a list of what somebody switched, and with it.
    drawings: [Drawing; 2],
    submit: Submit,
    /// Whether surfaces are slim: what draws in low quality shades them by drawing too.
    slim: bool,
    /// What [`GeometryPass::hand_over`] draws nothing into.
    interlude: Image,
    pub scene_layout: wgpu::BindGroupLayout,
    /// Of one view that is drawn.
    pub view_layout: wgpu::BindGroupLayout,
    /// Of views that are computed.
    pub views_layout: wgpu::BindGroupLayout,
    sky_sampler: wgpu::Sampler,
    noise: wgpu::TextureView,
    noise_sampler: wgpu::Sampler,
    shadow_sampler: wgpu::Sampler,
    pipelines: BTreeMap<GeometryKey, Pipelines>,
    light: wgpu::Buffer,
    views: wgpu::Buffer,
    /// Instances of all views in a list, where they do not come as attributes.
    pub instances: wgpu::Buffer,
    /// Where they do.
    attributes: wgpu::Buffer,
    lamps: wgpu::Buffer,
    lamp_tiles: wgpu::Buffer,
    calls: wgpu::Buffer,
}

/// How draw calls reach the GPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Submit {
    /// One by one, each with its instance as attributes: for software adapters.
    Attached,
    /// One by one, instances in a list.
    Single,
    /// All of a view at once, instances in a list.
    Indirect,
}

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

/// Views one after the other whose targets are layers of the same textures: compute shaders do them
/// together.
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
        let [view_layout, views_layout] = [
            wgpu::TextureViewDimension::D2,
            wgpu::TextureViewDimension::D2Array,
        ]
        .map(layout_of_views);
        let submit = match (gpu.is_software(), gpu.has_indirect_instances()) {
            (true, _) => Submit::Attached,
            (false, true) => Submit::Indirect,
            (false, false) => Submit::Single,
        };
        let drawings = [false, true].map(|switched| {
            Drawing::new(
                gpu,
                submit == Submit::Attached,
                slim,
                switched,
                [&scene_layout, &view_layout],
            )
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
            drawings,
            submit,
            slim,
            interlude: image(
                gpu,
                "interlude",
                [1, 1],
                wgpu::TextureFormat::R8Unorm,
                wgpu::TextureUsages::RENDER_ATTACHMENT,
            ),
            sky_sampler: device.create_sampler(&linear),
            noise: material::noise_texture(gpu),
            noise_sampler: device.create_sampler(&repeat),
            shadow_sampler: device.create_sampler(&compare),
            scene_layout,
            view_layout,
            views_layout,
            pipelines: BTreeMap::new(),
            light: gpu.buffer(
                "light",
                size_of::<LightData>() as u64,
                wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            ),
            views: gpu.buffer(
                "views",
                VIEWS_BYTES,
                wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            ),
            instances: gpu.buffer(
                "instances",
                INSTANCE_BYTES,
                wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            ),
            attributes: gpu.buffer(
                "instance attributes",
                INSTANCE_BYTES,
                wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
            ),
            lamps: gpu.buffer(
                "lamps",
                LAMP_BYTES,
                wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            ),
            lamp_tiles: gpu.buffer(
                "lamp tiles",
                8,
                wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            ),
            calls: gpu.buffer(
                "draw calls",
                CALL_BYTES,
                wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::COPY_DST,
            ),
        }
    }

    fn key(&self, set: TargetSet, switched: bool) -> GeometryKey {
        GeometryKey {
            set: set.drawn(),
            switched: switched && self.slim && set.contains(Target::Surface),
        }
    }

    /// Makes the pipelines for a set of targets, once; `switched`: somebody switched lamps or
    /// windows of the scenery.
    pub fn prepare(&mut self, gpu: &Gpu, set: TargetSet, switched: bool) {
        let key = self.key(set, switched);
        if !self.pipelines.contains_key(&key) {
            let pipelines = self.pipelines(gpu, key);
            self.pipelines.insert(key, pipelines);
        }
    }

    /// The list of instances, large enough for so many.
    pub fn room_for_instances(&mut self, gpu: &Gpu, n: usize) -> &wgpu::Buffer {
        grow(gpu, &mut self.instances, INSTANCE_BYTES * n as u64);
        &self.instances
    }

    /// Uploads what changes from tick to tick; `listed`: a compute shader draws, and has its own
    /// lists.
    pub fn upload(
        &mut self,
        gpu: &Gpu,
        light: &LightData,
        views: &[ViewData],
        drawn: &[&Drawn],
        lamps: &LampLists,
        listed: bool,
    ) {
        // The last view's binding reaches beyond it.
        grow(
            gpu,
            &mut self.views,
            VIEW_BYTES * views.len() as u64 + VIEWS_BYTES,
        );
        gpu.queue()
            .write_buffer(&self.light, 0, bytemuck::bytes_of(light));
        gpu.queue()
            .write_buffer(&self.views, 0, bytemuck::cast_slice(views));
        grow(gpu, &mut self.lamps, LAMP_BYTES * lamps.lamps.len() as u64);
        grow(gpu, &mut self.lamp_tiles, 8 * lamps.tiles.len() as u64);
        gpu.queue()
            .write_buffer(&self.lamps, 0, bytemuck::cast_slice(&lamps.lamps));
        gpu.queue()
            .write_buffer(&self.lamp_tiles, 0, bytemuck::cast_slice(&lamps.tiles));
        if !listed && self.submit == Submit::Attached {
            let attributes = InstanceAttributes::of_all(views, drawn);
            let bytes: &[u8] = bytemuck::cast_slice(&attributes);
            grow(gpu, &mut self.attributes, bytes.len() as u64);
            gpu.queue().write_buffer(&self.attributes, 0, bytes);
        } else if !listed {
            self.room_for_instances(gpu, drawn.iter().map(|drawn| drawn.instances.len()).sum());
            for drawn in drawn {
                let begin = INSTANCE_BYTES * drawn.first_instance as u64;
                gpu.queue().write_buffer(
                    &self.instances,
                    begin,
                    bytemuck::cast_slice(&drawn.instances),
                );
            }
        }
        if !listed && self.submit == Submit::Indirect {
            // Index count, instance count, first index, base vertex, first instance.
            let words = |drawn: &&Drawn| {
                let first = drawn.first_instance;
                let word = move |call: &DrawCall| {
                    let mesh = call.mesh;
                    [
                        mesh.n_indices,
                        1,
                        mesh.first_idx,
                        mesh.base_vertex as u32,
                        first + call.instance_idx,
                    ]
                };
                drawn.calls.iter().map(word).collect::<Vec<[u32; 5]>>()
            };
            let words: Vec<[u32; 5]> = drawn.iter().flat_map(words).collect();
            grow(gpu, &mut self.calls, CALL_BYTES * words.len() as u64);
            gpu.queue()
                .write_buffer(&self.calls, 0, bytemuck::cast_slice(&words));
        }
    }

    /// Bind group of what all views share.
    pub fn bind_scene(
        &self,
        gpu: &Gpu,
        sky: &wgpu::TextureView,
        switched: &wgpu::Buffer,
    ) -> wgpu::BindGroup {
        gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("scene"),
            layout: &self.scene_layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: self.light.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: self.instances.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 2,
                    resource: wgpu::BindingResource::TextureView(sky),
                },
                wgpu::BindGroupEntry {
                    binding: 3,
                    resource: wgpu::BindingResource::Sampler(&self.sky_sampler),
                },
                wgpu::BindGroupEntry {
                    binding: 4,
                    resource: wgpu::BindingResource::TextureView(&self.noise),
                },
                wgpu::BindGroupEntry {
                    binding: 5,
                    resource: wgpu::BindingResource::Sampler(&self.noise_sampler),
                },
                wgpu::BindGroupEntry {
                    binding: 6,
                    resource: switched.as_entire_binding(),
                },
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

    fn bind(
        &self,
        gpu: &Gpu,
        layout: &wgpu::BindGroupLayout,
        [near, far]: [&wgpu::TextureView; 2],
    ) -> wgpu::BindGroup {
        let view = wgpu::BufferBinding {
            buffer: &self.views,
            offset: 0,
            size: std::num::NonZeroU64::new(VIEWS_BYTES),
        };
        gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("view"),
            layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::Buffer(view),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::TextureView(near),
                },
                wgpu::BindGroupEntry {
                    binding: 2,
                    resource: wgpu::BindingResource::Sampler(&self.shadow_sampler),
                },
                wgpu::BindGroupEntry {
                    binding: 3,
                    resource: self.lamps.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 4,
                    resource: self.lamp_tiles.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 5,
                    resource: wgpu::BindingResource::TextureView(far),
                },
            ],
        })
    }

    /// Bind groups of what is attached: scene and views.
    fn bind_attached(
        &self,
        gpu: &Gpu,
        key: GeometryKey,
        switched: &wgpu::Buffer,
    ) -> [wgpu::BindGroup; 2] {
        let [scene, view] = &self.drawings[key.switched as usize].groups;
        let bind = |layout, entries: &[wgpu::BindGroupEntry<'_>]| {
            gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("drawn"),
                layout,
                entries,
            })
        };
        let views = wgpu::BufferBinding {
            buffer: &self.views,
            offset: 0,
            size: std::num::NonZeroU64::new(VIEWS_BYTES),
        };
        let scene_entries =
            [(0, &self.light), (6, switched)].map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding,
                resource: buffer.as_entire_binding(),
            });
        let n_bound = if key.switched { 2 } else { 1 };
        let views = wgpu::BindGroupEntry {
            binding: 0,
            resource: wgpu::BindingResource::Buffer(views),
        };
        [bind(scene, &scene_entries[..n_bound]), bind(view, &[views])]
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
        shared: [&wgpu::BindGroup; 2],
        view: &ViewPass<'_>,
    ) {
        let attachment = |target: Target| {
            view.set
                .drawn()
                .contains(target)
                .then(|| wgpu::RenderPassColorAttachment {
                    view: &view.targets.get(target).view,
                    depth_slice: None,
                    resolve_target: None,
                    // Not cleared: meshes and sky together write every pixel.
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Load,
                        store: wgpu::StoreOp::Store,
                    },
                })
        };
        let attachments = Target::DRAWN.map(attachment);
        let key = self.key(view.set, assets.is_switched());
        let pipelines = &self.pipelines[&key];
        let own = (self.submit == Submit::Attached)
            .then(|| self.bind_attached(gpu, key, &assets.switched));
        let [scene, bound] = own.as_ref().map_or(shared, |own| own.each_ref());
        let begin = |encoder: &mut wgpu::CommandEncoder, load: wgpu::LoadOp<f32>| {
            gpu.counters().add_pass();
            let mut pass = encoder
                .begin_render_pass(&wgpu::RenderPassDescriptor {
                    label: Some("geometry"),
                    color_attachments: &attachments,
                    depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                        view: &view.targets.z_buffer().view,
                        depth_ops: Some(wgpu::Operations {
                            load,
                            store: wgpu::StoreOp::Store,
                        }),
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
            if self.submit == Submit::Attached {
                pass.set_vertex_buffer(1, self.attributes.slice(..));
            }
            pass.set_index_buffer(assets.indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.set_pipeline(&pipelines.meshes);
            pass
        };
        let mut pass = begin(encoder, wgpu::LoadOp::Clear(0.0));
        // The pipeline that is set is one of these.
        let mut is_plain = false;
        let Drawn {
            calls,
            runs,
            first_instance,
            ..
        } = view.drawn;
        if self.submit == Submit::Indirect && !calls.is_empty() {
            pass.multi_draw_indexed_indirect(
                &self.calls,
                CALL_BYTES * view.first_call as u64,
                calls.len() as u32,
            );
        }
        for (
            i,
            DrawCall {
                mesh, instance_idx, ..
            },
        ) in calls.iter().enumerate()
        {
            gpu.counters().add_draw(mesh.n_indices as u64 / 3);
            if self.submit == Submit::Indirect {
                continue;
            }
            if self.submit == Submit::Attached && i > 0 && runs.binary_search(&i).is_ok() {
                drop(pass);
                self.hand_over(gpu, encoder);
                pass = begin(encoder, wgpu::LoadOp::Load);
                is_plain = false;
            }
            if self.has_plain(key) && is_plain == mesh.has_walls {
                is_plain = !is_plain;
                pass.set_pipeline(if is_plain {
                    &pipelines.plain
                } else {
                    &pipelines.meshes
                });
            }
            let first = first_instance + instance_idx;
            pass.draw_indexed(
                mesh.first_idx..mesh.first_idx + mesh.n_indices,
                mesh.base_vertex,
                first..first + 1,
            );
        }
        pass.set_pipeline(&pipelines.sky);
        pass.draw(0..3, 0..1);
        gpu.counters().add_draw(1);
    }

    /// Makes a software rasteriser begin with the run that it was given: it fills pixels when the
    /// attachments change, on other threads than the one
    /// that goes on with the next vertices.
    fn hand_over(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder) {
        gpu.counters().add_pass();
        let ops = wgpu::Operations {
            load: wgpu::LoadOp::Load,
            store: wgpu::StoreOp::Store,
        };
        let attachment = wgpu::RenderPassColorAttachment {
            view: &self.interlude.view,
            depth_slice: None,
            resolve_target: None,
            ops,
        };
        let attachments = [Some(attachment)];
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("interlude"),
            color_attachments: &attachments,
            ..Default::default()
        });
    }
}

/// A draw call in a buffer, as Vulkan has it.
const CALL_BYTES: u64 = 20;

const LAMP_BYTES: u64 = size_of::<LampData>() as u64;

const INSTANCE_BYTES: u64 = size_of::<InstanceData>() as u64;
