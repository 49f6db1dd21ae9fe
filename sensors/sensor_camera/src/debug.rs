//! Debug strokes, drawn over the finished colour image of a view and hidden by nearer surfaces, and
//! over them what the spectator alone sees. They appear in no other image.

use bytemuck::{Pod, Zeroable};
use nalgebra::{Isometry3, Point3, Vector3};
use sensor_core::scene::{DebugStroke, Overlay, Scene};
use sensor_gpu::Gpu;
use sensor_spec::Intrinsics;

use crate::camera_motion::NEAR_M;
use crate::overlay::{NEARER_RATIO, Pane, PixelQuad, in_front};
use crate::target::{Target, TargetLayer};
use crate::view::ViewSpec;

/// Distance at which the overlay lies: nearer than anything that is drawn.
const OVERLAY_M: f64 = 1e-3;

/// A corner of a triangle, as `shader/debug.wgsl` takes it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
struct Corner {
    clip: [f32; 4],
    bgra: u32,
}

/// A view to draw strokes over.
pub(crate) struct DebugView<'t> {
    pub lens: &'t Intrinsics,
    pub world_from_camera: &'t Isometry3<f64>,
    pub images: TargetLayer<'t>,
    /// Drawn on top, if the view shows it.
    pub overlay: Option<&'t Overlay>,
}

/// Whether a view of `spec` has something to draw over its colour image.
pub(crate) fn is_drawn(scene: &Scene, spec: &ViewSpec) -> bool {
    !scene.debug.is_empty() || (spec.shows_overlay && !scene.overlay.is_empty())
}

/// The pipeline.
#[derive(Debug)]
pub(crate) struct DebugPass {
    pipeline: wgpu::RenderPipeline,
}

impl DebugPass {
    pub fn new(gpu: &Gpu) -> Self {
        let shader = gpu.shader("debug", include_str!("shader/debug.wgsl"));
        let attribute = |format, offset, shader_location| wgpu::VertexAttribute {
            format,
            offset,
            shader_location,
        };
        let pipeline = gpu
            .device()
            .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some("debug"),
                layout: None,
                vertex: wgpu::VertexState {
                    module: &shader,
                    entry_point: Some("vs_main"),
                    compilation_options: Default::default(),
                    buffers: &[Some(wgpu::VertexBufferLayout {
                        array_stride: size_of::<Corner>() as u64,
                        step_mode: wgpu::VertexStepMode::Vertex,
                        attributes: &[
                            attribute(wgpu::VertexFormat::Float32x4, 0, 0),
                            attribute(wgpu::VertexFormat::Uint32, 16, 1),
                        ],
                    })],
                },
                primitive: Default::default(),
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: wgpu::TextureFormat::Depth32Float,
                    depth_write_enabled: Some(true),
                    // Reversed z.
                    depth_compare: Some(wgpu::CompareFunction::GreaterEqual),
                    stencil: Default::default(),
                    bias: Default::default(),
                }),
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &shader,
                    entry_point: Some("fs_main"),
                    compilation_options: Default::default(),
                    targets: &[Some(wgpu::ColorTargetState {
                        format: Target::Color.format(),
                        blend: None,
                        write_mask: wgpu::ColorWrites::ALL,
                    })],
                }),
                multiview_mask: None,
                cache: None,
            });
        DebugPass { pipeline }
    }

    /// Draws over the colour image of a view; its other passes must be recorded before.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        strokes: &[DebugStroke],
        view: &DebugView<'_>,
    ) {
        let DebugView {
            lens,
            world_from_camera,
            images,
            overlay,
        } = view;
        let mut corners: Vec<Corner> = strokes
            .iter()
            .flat_map(|stroke| corners(stroke, lens, world_from_camera))
            .flatten()
            .collect();
        if let Some(overlay) = overlay {
            let pane = Pane::new(lens, world_from_camera);
            corners.extend(
                pane.quads(overlay)
                    .iter()
                    .flat_map(|quad| on_screen(quad, lens)),
            );
        }
        if corners.is_empty() {
            return;
        }
        let [color, depth] = [Target::Color, Target::Depth].map(|target| images.view(target));
        let bound = gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("debug"),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::TextureView(&depth),
            }],
        });
        let buffer = gpu.buffer_with(
            "debug strokes",
            bytemuck::cast_slice(&corners),
            wgpu::BufferUsages::VERTEX,
        );
        let kept = wgpu::StoreOp::Store;
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("debug"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &color,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Load,
                    store: kept,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &images.targets.z_buffer().view,
                // For the order of strokes; the depth of the scene is read by the shader.
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Discard,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &bound, &[]);
        pass.set_vertex_buffer(0, buffer.slice(..));
        pass.draw(0..corners.len() as u32, 0..1);
    }
}

/// Two triangles that face the camera; `None` if the stroke lies behind it.
fn corners(
    stroke: &DebugStroke,
    lens: &Intrinsics,
    world_from_camera: &Isometry3<f64>,
) -> Option<[Corner; 6]> {
    let [from, to] = [stroke.from_m, stroke.to_m].map(|at| {
        world_from_camera
            .inverse_transform_point(&Point3::from(at))
            .coords
    });
    let (from, to) = in_front(from, to)?;
    // Never thinner than a pixel.
    let half_m = |at: &Vector3<f64>| (0.5 * stroke.width_m as f64).max(0.5 * at.z / lens.focal_px);
    let quad = match (to - from)
        .cross(&(from + to))
        .try_normalize(1e-9 * (from + to).norm_squared())
    {
        Some(aside) => {
            let (at_from, at_to) = (aside * half_m(&from), aside * half_m(&to));
            [from - at_from, from + at_from, to + at_to, to - at_to]
        }
        // A point, or a line seen end-on.
        None => {
            let near = if from.z < to.z { from } else { to };
            let half_m = half_m(&near);
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
                .map(|[x, y]| near + Vector3::new(x, y, 0.0) * half_m)
        }
    };
    let [r, g, b] = stroke.color_rgb;
    let bgra = u32::from_le_bytes([b, g, r, 255]);
    let corner = |at: Vector3<f64>| Corner {
        clip: clip_from_camera(&at, lens),
        bgra,
    };
    Some([0, 1, 2, 0, 2, 3].map(|i| corner(quad[i])))
}

/// The two triangles of a quadrangle of the image.
fn on_screen(quad: &PixelQuad, lens: &Intrinsics) -> [Corner; 6] {
    let [width, height] = [lens.width_px, lens.height_px].map(f64::from);
    let [r, g, b] = quad.color_rgb;
    let bgra = u32::from_le_bytes([b, g, r, 255]);
    let corner = |[x, y]: [f64; 2]| Corner {
        clip: [2.0 * x / width - 1.0, 1.0 - 2.0 * y / height, 1.0, 1.0]
            .map(|of_one| (of_one * OVERLAY_M) as f32),
        bgra,
    };
    [0, 1, 2, 0, 2, 3].map(|i| corner(quad.corners_px[i]))
}

/// Same projection as in `geometry_listed.wgsl`: reversed z with the far plane at infinity.
fn clip_from_camera(at: &Vector3<f64>, lens: &Intrinsics) -> [f32; 4] {
    let scale = |n_px: u32| 2.0 * lens.focal_px / n_px as f64;
    [
        at.x * scale(lens.width_px),
        -at.y * scale(lens.height_px),
        NEAR_M * NEARER_RATIO,
        at.z,
    ]
    .map(|x| x as f32)
}
