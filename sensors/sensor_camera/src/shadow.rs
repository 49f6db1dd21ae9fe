//! Shadow maps: one square map of the sun's view per 32 m cell of the ground in which a lit camera stands.
//!
//! A map depends on the cell, the sun and the scene only, never on who else looks, so that readers change no one's bytes.
//! What stands still is drawn once per cell and sun; what moves is drawn every tick over a copy of it.

use nalgebra::{Isometry3, Matrix4, Point3, Vector3};
use sensor_core::{MeshId, Scene};
use sensor_gpu::Gpu;

use crate::assets::{GpuAssets, MeshDraw, Sphere};
use crate::pass::{VERTEX_ATTRIBUTES, VERTEX_BYTES, grow, storage};
use crate::renderer::Quality;
use crate::targets::{Image, image};

pub(crate) const SHADOW_WGSL: &str = include_str!("shader/shadow.wgsl");

/// Side of a cell, metres.
const CELL_M: f64 = 32.0;
/// Half the side of what a map covers, metres: a camera in the corner of its cell sees shadows to 64 m.
const HALF_SIDE_M: f64 = 82.0;
/// Half the depth of what a map covers, metres.
const HALF_DEPTH_M: f64 = 250.0;
/// Casters are drawn in the level of detail of this distance.
const CASTER_DISTANCE_M: f64 = 25.0;
/// Maps kept; more only while more are needed at once.
const MAX_KEPT: usize = 4;

type Rows = [[f32; 4]; 3];

/// One map of what stands still.
#[derive(Debug)]
struct Map {
    cell: [i64; 3],
    still: Image,
    fresh: bool,
    used: u64,
}

/// A draw call with its matrix.
#[derive(Clone, Copy, Debug)]
struct Caster {
    mesh: MeshDraw,
    matrix: Rows,
}

/// All maps.
#[derive(Debug)]
pub(crate) struct Shadows {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    matrices: wgpu::Buffer,
    maps: Vec<Map>,
    /// Copies of this tick's maps with what moves drawn over them: as many as cells are needed at once.
    overlays: Vec<Image>,
    sun_towards: Vector3<f64>,
    n_uses: u64,
    side_px: u32,
    none: Image,
}

/// What a view needs to look up its map.
#[derive(Clone, Debug)]
pub(crate) struct ShadowLookup {
    pub view: wgpu::TextureView,
    pub shadow_from_camera: Rows,
    /// One texel in units of the map's depth.
    pub texel_depth: f32,
    /// Whether there is a map at all.
    pub on: bool,
}

impl Shadows {
    pub fn new(gpu: &Gpu, quality: Quality) -> Self {
        let device = gpu.device();
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("shadow"), entries: &[storage(0)] });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("shadow"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let side_px = match quality {
            Quality::Low => 2048,
            Quality::High => 4096,
        };
        Shadows {
            pipeline: pipeline(gpu, &pipeline_layout),
            layout,
            matrices: gpu.buffer("shadow matrices", 64 * 1024, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST),
            maps: Vec::new(),
            overlays: Vec::new(),
            sun_towards: Vector3::zeros(),
            n_uses: 0,
            side_px,
            none: image(
                gpu,
                "no shadows",
                [1, 1],
                wgpu::TextureFormat::Depth16Unorm,
                wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::RENDER_ATTACHMENT,
            ),
        }
    }

    /// Forgets everything: another episode.
    pub fn clear(&mut self) {
        self.maps.clear();
    }

    /// A lookup that finds no shadow.
    pub fn none(&self) -> ShadowLookup {
        ShadowLookup { view: self.none.view.clone(), shadow_from_camera: [[0.0; 4]; 3], texel_depth: 0.0, on: false }
    }

    /// Draws the maps that these eyes need and returns a lookup for each.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        assets: &GpuAssets,
        scene: &Scene,
        sun_towards: Vector3<f64>,
        eyes: &[Isometry3<f64>],
    ) -> Vec<ShadowLookup> {
        if self.sun_towards != sun_towards {
            self.maps.clear();
            self.sun_towards = sun_towards;
        }
        self.n_uses += 1;
        let cells: Vec<[i64; 3]> = eyes.iter().map(cell_of).collect();
        let mut drawn: Vec<([i64; 3], wgpu::TextureView)> = Vec::new();
        let mut casters: Vec<Caster> = Vec::new();
        let mut passes: Vec<(usize, Option<usize>, std::ops::Range<u32>)> = Vec::new();
        let mut n_overlays = 0;
        for cell in &cells {
            if drawn.iter().any(|(known, _)| known == cell) {
                continue;
            }
            let map_idx = self.map_of(gpu, *cell);
            let shadow_from_world = shadow_from_world(*cell, sun_towards);
            let map = &mut self.maps[map_idx];
            if !map.fresh {
                let begin = casters.len() as u32;
                casters.extend(still_casters(assets, *cell, sun_towards, &shadow_from_world));
                passes.push((map_idx, None, begin..casters.len() as u32));
                map.fresh = true;
            }
            let begin = casters.len() as u32;
            casters.extend(moving_casters(assets, scene, *cell, sun_towards, &shadow_from_world));
            if casters.len() as u32 > begin {
                if self.overlays.len() == n_overlays {
                    self.overlays.push(shadow_image(gpu, self.side_px));
                }
                passes.push((map_idx, Some(n_overlays), begin..casters.len() as u32));
                drawn.push((*cell, self.overlays[n_overlays].view.clone()));
                n_overlays += 1;
            } else {
                drawn.push((*cell, map.still.view.clone()));
            }
        }
        self.draw(gpu, encoder, assets, &casters, &passes);
        let lookup = |(eye, cell): (&Isometry3<f64>, &[i64; 3])| {
            let (_, view) = drawn.iter().find(|(known, _)| known == cell).expect("every cell was drawn");
            let shadow_from_camera = shadow_from_world(*cell, sun_towards) * eye.to_homogeneous();
            let texel_m = 2.0 * HALF_SIDE_M / self.side_px as f64;
            ShadowLookup {
                view: view.clone(),
                shadow_from_camera: top_rows(&shadow_from_camera),
                texel_depth: (texel_m / (2.0 * HALF_DEPTH_M)) as f32,
                on: true,
            }
        };
        eyes.iter().zip(&cells).map(lookup).collect()
    }

    /// The map of a cell, made or taken over if there is none.
    fn map_of(&mut self, gpu: &Gpu, cell: [i64; 3]) -> usize {
        let used = self.n_uses;
        if let Some(idx) = self.maps.iter().position(|map| map.cell == cell) {
            self.maps[idx].used = used;
            return idx;
        }
        let oldest = (0..self.maps.len()).filter(|idx| self.maps[*idx].used < used).min_by_key(|idx| self.maps[*idx].used);
        match oldest {
            Some(idx) if self.maps.len() >= MAX_KEPT => {
                let map = &mut self.maps[idx];
                (map.cell, map.fresh, map.used) = (cell, false, used);
                idx
            }
            _ => {
                self.maps.push(Map { cell, still: shadow_image(gpu, self.side_px), fresh: false, used });
                self.maps.len() - 1
            }
        }
    }

    fn draw(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        assets: &GpuAssets,
        casters: &[Caster],
        passes: &[(usize, Option<usize>, std::ops::Range<u32>)],
    ) {
        if passes.is_empty() {
            return;
        }
        let matrices: Vec<Rows> = casters.iter().map(|caster| caster.matrix).collect();
        grow(gpu, &mut self.matrices, size_of_val(matrices.as_slice()) as u64);
        gpu.queue().write_buffer(&self.matrices, 0, bytemuck::cast_slice(&matrices));
        let bound = gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("shadow"),
            layout: &self.layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: self.matrices.as_entire_binding() }],
        });
        for (map_idx, overlay_idx, range) in passes {
            let map = &self.maps[*map_idx];
            let (view, load) = match overlay_idx.map(|idx| &self.overlays[idx]) {
                Some(all) => {
                    encoder.copy_texture_to_texture(map.still.texture.as_image_copy(), all.texture.as_image_copy(), all.texture.size());
                    (&all.view, wgpu::LoadOp::Load)
                }
                None => (&map.still.view, wgpu::LoadOp::Clear(1.0)),
            };
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("shadow"),
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view,
                    depth_ops: Some(wgpu::Operations { load, store: wgpu::StoreOp::Store }),
                    stencil_ops: None,
                }),
                ..Default::default()
            });
            gpu.counters().add_pass();
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &bound, &[]);
            pass.set_vertex_buffer(0, assets.vertices.slice(..));
            pass.set_index_buffer(assets.indices.slice(..), wgpu::IndexFormat::Uint32);
            for instance in range.clone() {
                let mesh = casters[instance as usize].mesh;
                pass.draw_indexed(mesh.first_idx..mesh.first_idx + mesh.n_indices, mesh.base_vertex, instance..instance + 1);
                gpu.counters().add_draw(mesh.n_indices as u64 / 3);
            }
        }
    }
}

fn shadow_image(gpu: &Gpu, side_px: u32) -> Image {
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT
        | wgpu::TextureUsages::TEXTURE_BINDING
        | wgpu::TextureUsages::COPY_SRC
        | wgpu::TextureUsages::COPY_DST;
    image(gpu, "shadow map", [side_px, side_px], wgpu::TextureFormat::Depth16Unorm, usage)
}

fn pipeline(gpu: &Gpu, layout: &wgpu::PipelineLayout) -> wgpu::RenderPipeline {
    let shader = gpu.shader("shadow", SHADOW_WGSL);
    let buffers = [Some(wgpu::VertexBufferLayout {
        array_stride: VERTEX_BYTES,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &VERTEX_ATTRIBUTES[..1],
    })];
    gpu.device().create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("shadow"),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module: &shader,
            entry_point: Some("vs_main"),
            compilation_options: Default::default(),
            buffers: &buffers,
        },
        // Both sides cast: leaves and open shells have no back.
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: wgpu::TextureFormat::Depth16Unorm,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Less),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: None,
        multiview_mask: None,
        cache: None,
    })
}

fn cell_of(eye: &Isometry3<f64>) -> [i64; 3] {
    std::array::from_fn(|axis| (eye.translation.vector[axis] / CELL_M).round() as i64)
}

fn cell_centre_m(cell: [i64; 3]) -> Vector3<f64> {
    Vector3::from(cell.map(|i| i as f64 * CELL_M))
}

/// Unit vectors to the right and down in the map, and along the light.
fn axes(sun_towards: Vector3<f64>) -> [Vector3<f64>; 3] {
    let along = -sun_towards;
    let right = if along.x.abs() + along.y.abs() > 1e-6 { along.cross(&Vector3::z()).normalize() } else { Vector3::x() };
    [right, along.cross(&right), along]
}

/// World to (u, v, depth), each 0..=1 inside the map.
fn shadow_from_world(cell: [i64; 3], sun_towards: Vector3<f64>) -> Matrix4<f64> {
    let centre = cell_centre_m(cell);
    let scales = [0.5 / HALF_SIDE_M, 0.5 / HALF_SIDE_M, 0.5 / HALF_DEPTH_M];
    let mut matrix = Matrix4::identity();
    for (row, (axis, scale)) in axes(sun_towards).into_iter().zip(scales).enumerate() {
        for column in 0..3 {
            matrix[(row, column)] = axis[column] * scale;
        }
        matrix[(row, 3)] = 0.5 - axis.dot(&centre) * scale;
    }
    matrix
}

fn touches(sphere: &Sphere, cell: [i64; 3], axes: &[Vector3<f64>; 3]) -> bool {
    let offset = sphere.centre_m - Point3::from(cell_centre_m(cell));
    let half = [HALF_SIDE_M, HALF_SIDE_M, HALF_DEPTH_M];
    axes.iter().zip(half).all(|(axis, half)| axis.dot(&offset).abs() < half + sphere.radius_m)
}

fn still_casters(assets: &GpuAssets, cell: [i64; 3], sun_towards: Vector3<f64>, shadow_from_world: &Matrix4<f64>) -> Vec<Caster> {
    let axes = axes(sun_towards);
    let instances = assets.scene_assets.statics.iter().zip(&assets.spheres);
    instances
        .filter(|(instance, sphere)| assets.casts_shadow(instance.mesh) && touches(sphere, cell, &axes))
        .filter_map(|(instance, _)| caster(assets, instance.mesh, &instance.world_from_mesh, shadow_from_world))
        .collect()
}

fn moving_casters(
    assets: &GpuAssets,
    scene: &Scene,
    cell: [i64; 3],
    sun_towards: Vector3<f64>,
    shadow_from_world: &Matrix4<f64>,
) -> Vec<Caster> {
    let axes = axes(sun_towards);
    let seen = |mesh: MeshId, pose: &Isometry3<f64>| touches(&Sphere::of(assets.scene_assets.mesh(mesh), pose), cell, &axes);
    scene
        .dynamics
        .iter()
        .filter(|instance| seen(instance.mesh, &instance.world_from_mesh))
        .filter_map(|instance| caster(assets, instance.mesh, &instance.world_from_mesh, shadow_from_world))
        .collect()
}

fn caster(assets: &GpuAssets, mesh: MeshId, world_from_mesh: &Isometry3<f64>, shadow_from_world: &Matrix4<f64>) -> Option<Caster> {
    let mesh = assets.level(mesh, CASTER_DISTANCE_M)?;
    Some(Caster { mesh, matrix: top_rows(&(shadow_from_world * world_from_mesh.to_homogeneous())) })
}

fn top_rows(m: &Matrix4<f64>) -> Rows {
    std::array::from_fn(|row| std::array::from_fn(|column| m[(row, column)] as f32))
}
