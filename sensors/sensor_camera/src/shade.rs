//! The shading pass: lights the surfaces that the geometry pass left, once per pixel.
//!
//! One compute dispatch serves views of equal size, because GPUs made for computing have many times
//! more arithmetic there than in fragment shaders. In low quality a software rasteriser draws
//! triangles over the image instead, and its depth test separates sky from surfaces.

use std::collections::BTreeMap;

use sensor_gpu::Gpu;

use crate::binding_layout::{texture_of, written_layers};
use crate::bindings::{Bindings, Together};
use crate::geometry::{SceneryLamps, ViewPass};
use crate::quality::Quality;
use crate::target::{Image, Surfaces, Target, TargetSet, image};

/// How views are shaded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shading {
    /// By triangles over the image.
    Drawn,
    /// By a dispatch.
    Computed,
}

impl Shading {
    /// What the shader reads of surfaces.
    pub fn surfaces(self) -> Surfaces {
        match self {
            Shading::Drawn => Surfaces::Slim,
            Shading::Computed => Surfaces::Wide,
        }
    }
}

/// Text of the shading shader.
pub(crate) fn shade_wgsl(shading: Shading) -> String {
    let drawn = shading == Shading::Drawn;
    let (surfaces, entries) = if drawn {
        (
            include_str!("shader/seen_slim.wgsl"),
            include_str!("shader/shade_raster.wgsl"),
        )
    } else {
        (
            include_str!("shader/seen_wide.wgsl"),
            include_str!("shader/shade_compute.wgsl"),
        )
    };
    let [uniforms, view] = if drawn {
        [
            include_str!("shader/carried.wgsl"),
            include_str!("shader/view_drawn.wgsl"),
        ]
    } else {
        [
            include_str!("shader/bound.wgsl"),
            include_str!("shader/view_computed.wgsl"),
        ]
    };
    [
        include_str!("shader/scene.wgsl"),
        uniforms,
        view,
        include_str!("shader/film.wgsl"),
        include_str!("shader/sky.wgsl"),
        include_str!("shader/wall.wgsl"),
        include_str!("shader/switched.wgsl"),
        surfaces,
        include_str!("shader/texture.wgsl"),
        include_str!("shader/lamps.wgsl"),
        include_str!("shader/light.wgsl"),
        include_str!("shader/shade.wgsl"),
        entries,
    ]
    .concat()
}

/// Text of the shader whose functions `sensor_shade` has for processors: uniforms as they are bound,
/// one view, and surfaces as a GPU keeps them.
pub(crate) fn lanes_wgsl() -> String {
    [
        include_str!("shader/scene.wgsl"),
        include_str!("shader/bound.wgsl"),
        include_str!("shader/view_drawn.wgsl"),
        include_str!("shader/film.wgsl"),
        include_str!("shader/sky.wgsl"),
        include_str!("shader/wall.wgsl"),
        include_str!("shader/switched.wgsl"),
        include_str!("shader/seen_wide.wgsl"),
        include_str!("shader/texture.wgsl"),
        include_str!("shader/lamps.wgsl"),
        include_str!("shader/light.wgsl"),
        include_str!("shader/shade.wgsl"),
        include_str!("shader/shade_lanes.wgsl"),
    ]
    .concat()
}

/// What the shading pass must do; each combination has a pipeline of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct ShadeKey {
    pub color: bool,
    pub luminance: bool,
    /// Written instead of colour if the camera does more than the film curve.
    pub radiance: bool,
    /// Whether anything but sun and sky shines.
    pub lamps: bool,
    pub fog: bool,
    pub wet: bool,
    /// Whether lamps of the scenery were switched.
    pub switched: bool,
}

/// Pixels that one workgroup shades, as `shade_compute.wgsl` has it.
const GROUP_PX: [u32; 2] = [16, 8];

/// Pipelines of the shading pass.
#[derive(Debug)]
pub(crate) struct ShadePass {
    quality: Quality,
    shading: Shading,
    shader: wgpu::ShaderModule,
    layout: wgpu::PipelineLayout,
    images_layout: wgpu::BindGroupLayout,
    /// An image of one pixel, bound where ids are not needed.
    no_ids: Image,
    pipelines: BTreeMap<ShadeKey, Pipelines>,
}

#[derive(Debug)]
enum Pipelines {
    Computed(wgpu::ComputePipeline),
    Drawn {
        surface: wgpu::RenderPipeline,
        sky: wgpu::RenderPipeline,
    },
}

impl ShadePass {
    pub fn new(gpu: &Gpu, bindings: &Bindings, quality: Quality, shading: Shading) -> Self {
        let drawn = shading == Shading::Drawn;
        let device = gpu.device();
        let read = |binding: u32, sample_type: wgpu::TextureSampleType| {
            let dimension = if drawn {
                wgpu::TextureViewDimension::D2
            } else {
                wgpu::TextureViewDimension::D2Array
            };
            texture_of(binding, sample_type, dimension)
        };
        let mut entries = vec![
            read(0, wgpu::TextureSampleType::Uint),
            read(
                1,
                if drawn {
                    wgpu::TextureSampleType::Depth
                } else {
                    wgpu::TextureSampleType::Float { filterable: false }
                },
            ),
            read(2, wgpu::TextureSampleType::Uint),
        ];
        if !drawn {
            entries
                .iter_mut()
                .for_each(|entry| entry.visibility = wgpu::ShaderStages::COMPUTE);
            entries.extend(
                [Target::Color, Target::Luminance, Target::Radiance]
                    .iter()
                    .zip(3..)
                    .map(|(t, i)| written_layers(i, t.format())),
            );
        }
        let images_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("shaded images"),
            entries: &entries,
        });
        let views = if drawn {
            &bindings.view_layout
        } else {
            &bindings.views_layout
        };
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("shade"),
            bind_group_layouts: &[
                Some(&bindings.scene_layout),
                Some(views),
                Some(&images_layout),
            ],
            immediate_size: 0,
        });
        let shader = gpu.shader("shade", &shade_wgsl(shading));
        let no_ids = image(
            gpu,
            "no ids",
            [1, 1],
            Target::Instance.format(),
            wgpu::TextureUsages::TEXTURE_BINDING,
        );
        ShadePass {
            quality,
            shading,
            shader,
            layout,
            images_layout,
            no_ids,
            pipelines: BTreeMap::new(),
        }
    }

    /// Makes the pipelines for `key`, once.
    pub fn prepare(&mut self, gpu: &Gpu, key: ShadeKey) {
        if !self.pipelines.contains_key(&key) {
            let pipelines = if self.is_drawn() {
                // Reversed z: the triangles lie at infinity, and the buffer has 0 where nothing was
                // drawn.
                let surface = self.drawn_over(gpu, key, "fs_surface", wgpu::CompareFunction::Less);
                Pipelines::Drawn {
                    surface,
                    sky: self.drawn_over(gpu, key, "fs_sky", wgpu::CompareFunction::Equal),
                }
            } else {
                Pipelines::Computed(self.computed(gpu, key))
            };
            self.pipelines.insert(key, pipelines);
        }
    }

    fn computed(&self, gpu: &Gpu, key: ShadeKey) -> wgpu::ComputePipeline {
        let constants = self.constants(key);
        gpu.device()
            .create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some("shade"),
                layout: Some(&self.layout),
                module: &self.shader,
                entry_point: Some("cs_main"),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: &constants,
                    ..Default::default()
                },
                cache: None,
            })
    }

    fn drawn_over(
        &self,
        gpu: &Gpu,
        key: ShadeKey,
        fragment: &str,
        depth_compare: wgpu::CompareFunction,
    ) -> wgpu::RenderPipeline {
        let constants = self.constants(key);
        let options = wgpu::PipelineCompilationOptions {
            constants: &constants,
            ..Default::default()
        };
        let state = |on: bool, target: Target| {
            on.then(|| wgpu::ColorTargetState {
                format: target.format(),
                blend: None,
                write_mask: wgpu::ColorWrites::ALL,
            })
        };
        gpu.device()
            .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(fragment),
                layout: Some(&self.layout),
                vertex: wgpu::VertexState {
                    module: &self.shader,
                    entry_point: Some("vs_main"),
                    compilation_options: options.clone(),
                    buffers: &[],
                },
                primitive: Default::default(),
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: wgpu::TextureFormat::Depth32Float,
                    depth_write_enabled: Some(false),
                    depth_compare: Some(depth_compare),
                    stencil: Default::default(),
                    bias: Default::default(),
                }),
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &self.shader,
                    entry_point: Some(fragment),
                    compilation_options: options,
                    targets: &[
                        state(key.color, Target::Color),
                        state(key.luminance, Target::Luminance),
                        state(key.radiance, Target::Radiance),
                    ],
                }),
                multiview_mask: None,
                cache: None,
            })
    }

    /// Which work the shader does for the scene and, if drawn, for the outputs that are read.
    fn constants(&self, key: ShadeKey) -> Vec<(&'static str, f64)> {
        let number = |on: bool| on as u32 as f64;
        let mut constants = vec![
            ("WITH_LAMPS", number(key.lamps)),
            ("WITH_FOG", number(key.fog)),
            ("WITH_WET", number(key.wet)),
            ("WITH_SWITCHED", number(key.switched)),
            ("SIMPLE", number(self.quality == Quality::Low)),
        ];
        if self.is_drawn() {
            constants.extend([
                ("WITH_COLOR", number(key.color)),
                ("WITH_LUMINANCE", number(key.luminance)),
                ("WITH_RADIANCE", number(key.radiance)),
            ]);
        }
        constants
    }

    /// Targets of a view that it reads. Slim surfaces come with the rasteriser's own depth, and ids
    /// are needed only for switched lamps.
    pub fn reads(&self, lamps: SceneryLamps) -> TargetSet {
        let surface = Target::Surface.bit();
        match (self.shading, lamps) {
            (Shading::Drawn, SceneryLamps::AsBuilt) => surface,
            (Shading::Drawn, SceneryLamps::Switched) => surface.union(Target::Instance.bit()),
            (Shading::Computed, _) => surface
                .union(Target::Instance.bit())
                .union(Target::Depth.bit()),
        }
    }

    pub fn shading(&self) -> Shading {
        self.shading
    }

    /// Whether views are shaded by [`ShadePass::draw`]; else by [`ShadePass::compute`].
    pub fn is_drawn(&self) -> bool {
        self.shading == Shading::Drawn
    }

    /// Records the shading of views whose geometry was recorded before.
    pub fn compute(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::ComputePass<'_>,
        [scene, bound]: [&wgpu::BindGroup; 2],
        views: &Together<'_>,
        key: ShadeKey,
    ) {
        let Pipelines::Computed(pipeline) = &self.pipelines[&key] else {
            return;
        };
        let [width, height] = views.targets.size_px(views.kept);
        let read = [Target::Surface, Target::Depth, Target::Instance]
            .map(|target| &views.targets.get(target).layers);
        let written = [Target::Color, Target::Luminance, Target::Radiance]
            .map(|target| views.targets.get_or_nowhere(target, views.kept));
        let images: Vec<&wgpu::TextureView> = read.into_iter().chain(written).collect();
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, scene, &[]);
        pass.set_bind_group(1, bound, &[Bindings::offset_of(views.first)]);
        let entries: Vec<_> = image_entries(&images).collect();
        let kept = &views.targets.groups;
        let images = kept.bind(gpu, "shaded images", &self.images_layout, &entries);
        pass.set_bind_group(2, &images, &[]);
        pass.dispatch_workgroups(
            width.div_ceil(GROUP_PX[0]),
            height.div_ceil(GROUP_PX[1]),
            views.n as u32,
        );
    }

    /// Records the shading of one view that the geometry pass has drawn.
    pub fn draw(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        [scene, bound]: [&wgpu::BindGroup; 2],
        view: &ViewPass<'_>,
        key: ShadeKey,
    ) {
        let Pipelines::Drawn { surface, sky } = &self.pipelines[&key] else {
            return;
        };
        let ids = if key.switched {
            view.targets.get(Target::Instance)
        } else {
            &self.no_ids
        };
        let images = [
            view.targets.get(Target::Surface),
            view.targets.z_buffer(),
            ids,
        ]
        .map(|image| &image.view);
        let images = self.bind_images(gpu, &images);
        let mut pass = self.begin_drawing(encoder, view, key);
        gpu.counters().add_pass();
        pass.set_bind_group(0, scene, &[]);
        pass.set_bind_group(1, bound, &[Bindings::offset_of(view.view_idx)]);
        pass.set_bind_group(2, &images, &[]);
        for pipeline in [surface, sky] {
            pass.set_pipeline(pipeline);
            pass.draw(0..3, 0..1);
        }
    }

    fn begin_drawing<'e>(
        &self,
        encoder: &'e mut wgpu::CommandEncoder,
        view: &ViewPass<'_>,
        key: ShadeKey,
    ) -> wgpu::RenderPass<'e> {
        let attachment = |on: bool, target: Target| {
            on.then(|| wgpu::RenderPassColorAttachment {
                view: &view.targets.get(target).view,
                depth_slice: None,
                resolve_target: None,
                // Not cleared: surfaces and sky together write every pixel.
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Load,
                    store: wgpu::StoreOp::Store,
                },
            })
        };
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("shade"),
            color_attachments: &[
                attachment(key.color, Target::Color),
                attachment(key.luminance, Target::Luminance),
                attachment(key.radiance, Target::Radiance),
            ],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &view.targets.z_buffer().view,
                depth_ops: None,
                stencil_ops: None,
            }),
            ..Default::default()
        })
    }

    fn bind_images(&self, gpu: &Gpu, images: &[&wgpu::TextureView]) -> wgpu::BindGroup {
        let entries: Vec<_> = image_entries(images).collect();
        gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("shaded images"),
            layout: &self.images_layout,
            entries: &entries,
        })
    }
}

/// Images from binding 0 on.
fn image_entries<'i>(
    images: &'i [&wgpu::TextureView],
) -> impl Iterator<Item = wgpu::BindGroupEntry<'i>> {
    let entry = |(binding, view): (u32, &&'i wgpu::TextureView)| wgpu::BindGroupEntry {
        binding,
        resource: wgpu::BindingResource::TextureView(view),
    };
    (0..).zip(images).map(entry)
}
