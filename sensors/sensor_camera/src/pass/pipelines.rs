//! Pipelines of the geometry pass: one for meshes with walls, one for those without, one for the
//! sky, per set of targets.

use sensor_gpu::Gpu;

use super::attributes::{ATTACHED_ATTRIBUTES, ATTACHED_BYTES, VERTEX_ATTRIBUTES, VERTEX_BYTES};
use super::{GeometryPass, Submit, storage, uniform};
use crate::targets::{Target, TargetSet};
use crate::uniform::LightData;

/// Text of the geometry shader: with instances that come as attributes or lie in a list; with slim
/// surfaces or wide ones, and where they
/// are slim, with or without a list of lamps and windows that somebody switched.
pub(crate) fn geometry_wgsl(attached: bool, slim: bool, switched: bool) -> String {
    let instances: &[&str] = if attached {
        &[include_str!("../shader/geometry_attached.wgsl")]
    } else {
        &[
            include_str!("../shader/instance_storage.wgsl"),
            include_str!("../shader/geometry_listed.wgsl"),
        ]
    };
    let switched = if switched {
        include_str!("../shader/switched.wgsl")
    } else {
        include_str!("../shader/unswitched.wgsl")
    };
    let surfaces: &[&str] = if slim {
        &[
            include_str!("../shader/wall.wgsl"),
            switched,
            include_str!("../shader/surface_slim.wgsl"),
        ]
    } else {
        &[include_str!("../shader/surface_wide.wgsl")]
    };
    let scene = [
        include_str!("../shader/scene.wgsl"),
        include_str!("../shader/bound.wgsl"),
        include_str!("../shader/view_drawn.wgsl"),
    ];
    let rest = [
        include_str!("../shader/surface.wgsl"),
        include_str!("../shader/geometry_sky.wgsl"),
    ];
    [&scene[..], surfaces, &rest, instances].concat().concat()
}

#[derive(Clone, Debug)]
pub(super) struct Pipelines {
    pub meshes: wgpu::RenderPipeline,
    /// For meshes without walls.
    pub plain: wgpu::RenderPipeline,
    pub sky: wgpu::RenderPipeline,
}

/// Shader and bindings of the pass, with or without a list of what somebody switched. What is
/// attached binds no list unless it must: as
/// soon as there is one that pixels can read, llvmpipe takes over 33 KB of state again with every
/// draw call.
#[derive(Debug)]
pub(super) struct Drawing {
    pub shader: wgpu::ShaderModule,
    pub layout: wgpu::PipelineLayout,
    /// Of the scene and of the view.
    pub groups: [wgpu::BindGroupLayout; 2],
}

impl Drawing {
    /// `groups`: those that all passes share, for what is not attached.
    pub fn new(
        gpu: &Gpu,
        attached: bool,
        slim: bool,
        switched: bool,
        groups: [&wgpu::BindGroupLayout; 2],
    ) -> Drawing {
        let layout_of = |label, entries: &[wgpu::BindGroupLayoutEntry]| {
            gpu.device()
                .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                    label: Some(label),
                    entries,
                })
        };
        let groups = if attached {
            let scene = [uniform(0, size_of::<LightData>() as u64, false), storage(6)];
            let n_bound = if switched { 2 } else { 1 };
            [
                layout_of("drawn scene", &scene[..n_bound]),
                layout_of("drawn view", &[uniform(0, super::VIEWS_BYTES, true)]),
            ]
        } else {
            groups.map(Clone::clone)
        };
        let layout = gpu
            .device()
            .create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("geometry"),
                bind_group_layouts: &[Some(&groups[0]), Some(&groups[1])],
                immediate_size: 0,
            });
        Drawing {
            shader: gpu.shader("geometry", &geometry_wgsl(attached, slim, switched)),
            layout,
            groups,
        }
    }
}

/// What pipelines differ in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct GeometryKey {
    pub set: TargetSet,
    /// Whether somebody switched lamps or windows of the scenery; matters to slim surfaces, whose
    /// walls have their windows.
    pub switched: bool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Meshes,
    /// Meshes without walls.
    Plain,
    Sky,
}

impl Kind {
    fn entry_points(self, flowing: bool) -> [&'static str; 2] {
        match self {
            Kind::Sky => ["vs_sky", "fs_sky"],
            _ if flowing => ["vs_flowing", "fs_flowing"],
            Kind::Meshes | Kind::Plain => ["vs_main", "fs_main"],
        }
    }
}

impl GeometryPass {
    pub(super) fn pipelines(&self, gpu: &Gpu, key: GeometryKey) -> Pipelines {
        let meshes = self.pipeline(gpu, key, Kind::Meshes);
        let plain = if self.has_plain(key) {
            self.pipeline(gpu, key, Kind::Plain)
        } else {
            meshes.clone()
        };
        Pipelines {
            meshes,
            plain,
            sky: self.pipeline(gpu, key, Kind::Sky),
        }
    }

    /// Whether meshes without walls have a pipeline of their own.
    pub(super) fn has_plain(&self, key: GeometryKey) -> bool {
        self.slim && self.submit != Submit::Indirect && key.set.contains(Target::Surface)
    }

    fn pipeline(&self, gpu: &Gpu, key: GeometryKey, kind: Kind) -> wgpu::RenderPipeline {
        let state = |target: Target| {
            key.set.contains(target).then(|| wgpu::ColorTargetState {
                format: target.format_if(self.slim),
                blend: None,
                write_mask: wgpu::ColorWrites::ALL,
            })
        };
        let targets = Target::DRAWN.map(state);
        let attached = self.submit == Submit::Attached;
        let flows = key.set.contains(Target::Flow);
        let constants = self.constants(key, kind);
        let drawing = &self.drawings[key.switched as usize];
        let options = wgpu::PipelineCompilationOptions {
            constants: &constants,
            ..Default::default()
        };
        let layout = |array_stride, step_mode, attributes| {
            Some(wgpu::VertexBufferLayout {
                array_stride,
                step_mode,
                attributes,
            })
        };
        let buffers = if attached {
            let [corners, instances] = ATTACHED_ATTRIBUTES;
            let instances = layout(ATTACHED_BYTES, wgpu::VertexStepMode::Instance, instances);
            vec![
                layout(VERTEX_BYTES, wgpu::VertexStepMode::Vertex, corners),
                instances,
            ]
        } else {
            vec![layout(
                VERTEX_BYTES,
                wgpu::VertexStepMode::Vertex,
                &VERTEX_ATTRIBUTES,
            )]
        };
        let [vertex, fragment] = kind.entry_points(attached && flows);
        gpu.device()
            .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(fragment),
                layout: Some(&drawing.layout),
                vertex: wgpu::VertexState {
                    module: &drawing.shader,
                    entry_point: Some(vertex),
                    compilation_options: options.clone(),
                    buffers: if kind == Kind::Sky { &[] } else { &buffers },
                },
                primitive: wgpu::PrimitiveState {
                    cull_mode: (kind != Kind::Sky).then_some(wgpu::Face::Back),
                    ..Default::default()
                },
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: wgpu::TextureFormat::Depth32Float,
                    depth_write_enabled: Some(kind != Kind::Sky),
                    // Reversed z: near is 1, infinity is 0. The sky lies at 0 and fills what
                    // nothing was drawn to. Of surfaces at equal depth
                    // the last one counts.
                    depth_compare: Some(wgpu::CompareFunction::GreaterEqual),
                    stencil: Default::default(),
                    bias: Default::default(),
                }),
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &drawing.shader,
                    entry_point: Some(fragment),
                    compilation_options: options,
                    targets: &targets,
                }),
                multiview_mask: None,
                cache: None,
            })
    }

    fn constants(&self, key: GeometryKey, kind: Kind) -> Vec<(&'static str, f64)> {
        let number = |on: bool| on as u32 as f64;
        let mut constants = vec![("WITH_FLOW", number(key.set.contains(Target::Flow)))];
        if self.submit == Submit::Attached {
            constants.push(("NEAR_M", crate::draw::NEAR_M));
        }
        if self.slim {
            let with_walls = kind == Kind::Meshes && key.set.contains(Target::Surface);
            constants.push(("WITH_WALLS", number(with_walls)));
            if key.switched {
                constants.push(("WITH_SWITCHED", 1.0));
            }
        }
        constants
    }
}
