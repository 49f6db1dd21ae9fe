//! Pipelines of the geometry pass: one for meshes with walls, one for those without, one for the
//! sky, per set of targets.

use sensor_gpu::Gpu;

use super::attributes::{ATTACHED_ATTRIBUTES, ATTACHED_BYTES};
use super::variant::{GeometryShader, Instances, SceneryLamps, Submit};
use crate::binding_layout::{storage, uniform, uniform_at_offset};
use crate::bindings::VIEWS_BYTES;
use crate::camera_motion::NEAR_M;
use crate::target::{Surfaces, Target, TargetSet};
use crate::uniform::LightData;
use crate::vertex::{VERTEX_ATTRIBUTES, VERTEX_BYTES};

#[derive(Clone, Debug)]
pub(super) struct Pipelines {
    pub meshes: wgpu::RenderPipeline,
    /// For meshes without walls.
    pub plain: wgpu::RenderPipeline,
    pub sky: wgpu::RenderPipeline,
}

/// Shader and bindings of the pass. With attached instances it binds no list unless it must: as
/// soon as fragment shaders can read one, llvmpipe copies over 33 KB of state with every draw call.
#[derive(Debug)]
pub(super) struct Drawing {
    variant: GeometryShader,
    shader: wgpu::ShaderModule,
    layout: wgpu::PipelineLayout,
    /// Layouts of the scene and of the view.
    pub groups: [wgpu::BindGroupLayout; 2],
}

impl Drawing {
    /// `groups` are the layouts that all passes share; they are used unless instances are attached.
    pub fn new(gpu: &Gpu, variant: GeometryShader, groups: [&wgpu::BindGroupLayout; 2]) -> Drawing {
        let layout_of = |label, entries: &[wgpu::BindGroupLayoutEntry]| {
            gpu.device()
                .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                    label: Some(label),
                    entries,
                })
        };
        let groups = if variant.instances == Instances::Attached {
            let scene = [uniform(0, size_of::<LightData>() as u64), storage(6)];
            [
                layout_of("drawn scene", &scene[..variant.lamps.n_bound()]),
                layout_of("drawn view", &[uniform_at_offset(0, VIEWS_BYTES)]),
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
            variant,
            shader: gpu.shader("geometry", &variant.wgsl()),
            layout,
            groups,
        }
    }
}

/// The properties in which pipelines differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct GeometryKey {
    pub set: TargetSet,
    pub lamps: SceneryLamps,
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

impl Pipelines {
    /// The pipelines for a set of targets.
    pub fn new(gpu: &Gpu, drawing: &Drawing, submit: Submit, key: GeometryKey) -> Pipelines {
        let meshes = drawing.pipeline(gpu, key, Kind::Meshes);
        let plain = if has_plain(drawing.variant.surfaces, submit, key.set) {
            drawing.pipeline(gpu, key, Kind::Plain)
        } else {
            meshes.clone()
        };
        Pipelines {
            meshes,
            plain,
            sky: drawing.pipeline(gpu, key, Kind::Sky),
        }
    }
}

/// Whether meshes without walls have a pipeline of their own.
pub(super) fn has_plain(surfaces: Surfaces, submit: Submit, set: TargetSet) -> bool {
    surfaces == Surfaces::Slim && submit != Submit::Indirect && set.contains(Target::Surface)
}

impl Drawing {
    fn pipeline(&self, gpu: &Gpu, key: GeometryKey, kind: Kind) -> wgpu::RenderPipeline {
        let state = |target: Target| {
            key.set.contains(target).then(|| wgpu::ColorTargetState {
                format: target.format_as(self.variant.surfaces),
                blend: None,
                write_mask: wgpu::ColorWrites::ALL,
            })
        };
        let targets = Target::DRAWN.map(state);
        let attached = self.variant.instances == Instances::Attached;
        let flows = key.set.contains(Target::Flow);
        let constants = self.constants(key, kind);
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
                layout: Some(&self.layout),
                vertex: wgpu::VertexState {
                    module: &self.shader,
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
                    // Reversed z: near is 1, infinity is 0. The sky lies at 0 and fills the pixels
                    // where nothing was drawn. Of surfaces at equal depth the last one wins.
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

    fn constants(&self, key: GeometryKey, kind: Kind) -> Vec<(&'static str, f64)> {
        let number = |on: bool| on as u32 as f64;
        let mut constants = vec![("WITH_FLOW", number(key.set.contains(Target::Flow)))];
        if self.variant.instances == Instances::Attached {
            constants.push(("NEAR_M", NEAR_M));
        }
        if self.variant.surfaces == Surfaces::Slim {
            let with_walls = kind == Kind::Meshes && key.set.contains(Target::Surface);
            constants.push(("WITH_WALLS", number(with_walls)));
            if key.lamps == SceneryLamps::Switched {
                constants.push(("WITH_SWITCHED", 1.0));
            }
        }
        constants
    }
}
