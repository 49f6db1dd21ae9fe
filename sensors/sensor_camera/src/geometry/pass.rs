//! Records the geometry pass.

use std::collections::BTreeMap;

use sensor_gpu::{Gpu, Uploads};

use super::attributes::InstanceAttributes;
use super::pipelines::{Drawing, GeometryKey, Pipelines, has_plain};
use super::variant::{GeometryShader, SceneryLamps, Submit};
use crate::assets::GpuAssets;
use crate::binding_layout::grow;
use crate::bindings::{Bindings, INSTANCE_BYTES, VIEWS_BYTES};
use crate::target::{Image, Surfaces, Target, TargetSet, Targets, image};
use crate::uniform::ViewData;
use crate::visible::{DrawCall, Drawn};

/// Pipelines and lists of the geometry pass.
#[derive(Debug)]
pub(crate) struct GeometryPass {
    as_built: Drawing,
    switched: Drawing,
    submit: Submit,
    surfaces: Surfaces,
    /// Target of the empty pass of [`GeometryPass::hand_over`].
    interlude: Image,
    pipelines: BTreeMap<GeometryKey, Pipelines>,
    /// Instances of all views, if they come as attributes.
    attributes: wgpu::Buffer,
    calls: wgpu::Buffer,
}

/// One view to draw.
pub(crate) struct ViewPass<'p> {
    pub targets: &'p Targets,
    pub set: TargetSet,
    pub drawn: &'p Drawn,
    /// Index of its first draw call among those of all views.
    pub first_call: usize,
    pub view_idx: usize,
}

impl GeometryPass {
    pub fn new(gpu: &Gpu, bindings: &Bindings, surfaces: Surfaces) -> Self {
        let submit = match (gpu.is_software(), gpu.has_indirect_instances()) {
            (true, _) => Submit::Attached,
            (false, true) => Submit::Indirect,
            (false, false) => Submit::Single,
        };
        let drawing = |lamps| {
            let shader = GeometryShader {
                instances: submit.instances(),
                surfaces,
                lamps,
            };
            Drawing::new(gpu, shader, [&bindings.scene_layout, &bindings.view_layout])
        };
        GeometryPass {
            as_built: drawing(SceneryLamps::AsBuilt),
            switched: drawing(SceneryLamps::Switched),
            submit,
            surfaces,
            interlude: image(
                gpu,
                "interlude",
                [1, 1],
                wgpu::TextureFormat::R8Unorm,
                wgpu::TextureUsages::RENDER_ATTACHMENT,
            ),
            pipelines: BTreeMap::new(),
            attributes: gpu.buffer(
                "instance attributes",
                INSTANCE_BYTES,
                wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
            ),
            calls: gpu.buffer(
                "draw calls",
                CALL_BYTES,
                wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::COPY_DST,
            ),
        }
    }

    fn drawing(&self, lamps: SceneryLamps) -> &Drawing {
        match lamps {
            SceneryLamps::AsBuilt => &self.as_built,
            SceneryLamps::Switched => &self.switched,
        }
    }

    fn key(&self, set: TargetSet, lamps: SceneryLamps) -> GeometryKey {
        let has_walls = self.surfaces == Surfaces::Slim && set.contains(Target::Surface);
        GeometryKey {
            set: set.drawn(),
            lamps: if has_walls {
                lamps
            } else {
                SceneryLamps::AsBuilt
            },
        }
    }

    /// Makes the pipelines for a set of targets, once.
    pub fn prepare(&mut self, gpu: &Gpu, set: TargetSet, lamps: SceneryLamps) {
        let key = self.key(set, lamps);
        if !self.pipelines.contains_key(&key) {
            let pipelines = Pipelines::new(gpu, self.drawing(key.lamps), self.submit, key);
            self.pipelines.insert(key, pipelines);
        }
    }

    /// Uploads the instances and draw calls of views that are drawn.
    pub fn upload(
        &mut self,
        gpu: &Gpu,
        (uploads, encoder): (&mut Uploads, &mut wgpu::CommandEncoder),
        bindings: &mut Bindings,
        views: &[ViewData],
        drawn: &[&Drawn],
    ) {
        if self.submit == Submit::Attached {
            let attributes = InstanceAttributes::of_all(views, drawn);
            let bytes: &[u8] = bytemuck::cast_slice(&attributes);
            grow(gpu, &mut self.attributes, bytes.len() as u64);
            uploads.write(encoder, &self.attributes, 0, bytes);
        } else {
            bindings.room_for_instances(gpu, drawn.iter().map(|drawn| drawn.instances.len()).sum());
            for drawn in drawn {
                let begin = INSTANCE_BYTES * drawn.first_instance as u64;
                let bytes = bytemuck::cast_slice(&drawn.instances);
                uploads.write(encoder, &bindings.instances, begin, bytes);
            }
        }
        if self.submit == Submit::Indirect {
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
            uploads.write(encoder, &self.calls, 0, bytemuck::cast_slice(&words));
        }
    }

    /// Bind groups of scene and views for attached instances.
    fn bind_attached(
        &self,
        gpu: &Gpu,
        bindings: &Bindings,
        lamps: SceneryLamps,
        switched: &wgpu::Buffer,
    ) -> [wgpu::BindGroup; 2] {
        let [scene, view] = &self.drawing(lamps).groups;
        let bind = |layout, entries: &[wgpu::BindGroupEntry<'_>]| {
            gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("drawn"),
                layout,
                entries,
            })
        };
        let views = wgpu::BufferBinding {
            buffer: &bindings.views,
            offset: 0,
            size: std::num::NonZeroU64::new(VIEWS_BYTES),
        };
        let scene_entries =
            [(0, &bindings.light), (6, switched)].map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding,
                resource: buffer.as_entire_binding(),
            });
        let n_bound = lamps.n_bound();
        let views = wgpu::BindGroupEntry {
            binding: 0,
            resource: wgpu::BindingResource::Buffer(views),
        };
        [bind(scene, &scene_entries[..n_bound]), bind(view, &[views])]
    }

    /// Records the drawing of one view.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        bindings: &Bindings,
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
        let key = self.key(view.set, SceneryLamps::of(&assets.meshes));
        let pipelines = &self.pipelines[&key];
        let own = (self.submit == Submit::Attached)
            .then(|| self.bind_attached(gpu, bindings, key.lamps, &assets.switched));
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
            pass.set_bind_group(1, bound, &[Bindings::offset_of(view.view_idx)]);
            pass.set_vertex_buffer(0, assets.vertices.slice(..));
            if self.submit == Submit::Attached {
                pass.set_vertex_buffer(1, self.attributes.slice(..));
            }
            pass.set_index_buffer(assets.indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.set_pipeline(&pipelines.meshes);
            pass
        };
        let has_plain = has_plain(self.surfaces, self.submit, key.set);
        let mut pass = begin(encoder, wgpu::LoadOp::Clear(0.0));
        // Whether the current pipeline is the one for meshes without walls.
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
            if has_plain && is_plain == mesh.has_walls {
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

    /// Makes a software rasteriser start on the recorded run: it begins to fill pixels when
    /// attachments change, on other threads, while this one continues with the next vertices.
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

/// Size of an indirect draw call in Vulkan's layout.
const CALL_BYTES: u64 = 20;
