//! Shadow maps: one square map of the sun's view per 32 m cell of the ground in which a lit camera stands.
//!
//! A map depends on the cell, the sun and the scene only, never on who else looks, so that readers change no one's bytes.
//! What stands still is drawn once per cell and sun; what moves is drawn every tick over a copy of it, of which only those parts are
//! made good again that were drawn over before. High quality has a second, coarser map of what stands still further away.

use nalgebra::{Isometry3, Matrix4, Point3, Vector3};
use sensor_core::{DynamicInstance, MeshId, Scene};
use sensor_gpu::Gpu;

use crate::assets::{GpuAssets, MeshDraw, Sphere};
use crate::pass::{VERTEX_ATTRIBUTES, VERTEX_BYTES, grow, storage, texture};
use crate::renderer::Quality;
use crate::targets::{Image, image};

pub(crate) const SHADOW_WGSL: &str = include_str!("shader/shadow.wgsl");

/// One cascade.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cascade {
    /// Side of a cell, metres.
    cell_m: f64,
    /// Half the side of what a map covers, metres: a camera in the corner of its cell sees shadows to this less 0.7 cells.
    half_side_m: f64,
    /// Half the depth of what a map covers, metres.
    half_depth_m: f64,
    /// Casters are drawn in the level of detail of this distance, or of that from the cell's middle if they are further away.
    caster_distance_m: f64,
    side_px: u32,
    /// Whether what moves throws shadows.
    moving: bool,
}

impl Cascade {
    /// The map around the camera.
    pub fn near(quality: Quality) -> Cascade {
        let side_px = match quality {
            Quality::Low => 2048,
            Quality::High => 4096,
        };
        Cascade { cell_m: 32.0, half_side_m: 82.0, half_depth_m: 250.0, caster_distance_m: 25.0, side_px, moving: true }
    }

    /// The map of what is further away.
    pub fn far() -> Cascade {
        Cascade { cell_m: 128.0, half_side_m: 400.0, half_depth_m: 500.0, caster_distance_m: 110.0, side_px: 4096, moving: false }
    }
}

/// A lit camera.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Eye {
    pub world_from_camera: Isometry3<f64>,
    pub focal_px: f64,
}

/// Focal length from which on a camera gets the largest map. One of half the length sees shadows half as sharp: half the side is enough.
const SHARP_FOCAL_PX: f64 = 300.0;
/// Smallest side of a map.
const MIN_SIDE_PX: u32 = 1024;

/// Maps kept; more only while more are needed at once.
const MAX_KEPT: usize = 4;

type Rows = [[f32; 4]; 3];

/// One map of what stands still.
#[derive(Debug)]
struct Map {
    cell: [i64; 3],
    side_px: u32,
    still: Image,
    /// `still` with what moves drawn over it; made when something first moves here.
    all: Option<Image>,
    /// Parts of `all` that are not as in `still`: x, y, width, height.
    dirty_px: Vec<[u32; 4]>,
    fresh: bool,
    used: u64,
}

impl Map {
    /// Another cell: nothing of what was drawn holds.
    fn take_over(&mut self, cell: [i64; 3], used: u64) {
        (self.cell, self.fresh, self.used) = (cell, false, used);
        self.forget();
    }

    /// All of `all` is to be made anew.
    fn forget(&mut self) {
        self.dirty_px = vec![[0, 0, self.side_px, self.side_px]];
    }
}

/// A draw call with its matrix.
#[derive(Clone, Copy, Debug)]
struct Caster {
    mesh: MeshDraw,
    matrix: Rows,
    /// Where it can leave a mark.
    rect_px: [u32; 4],
}

/// A pass over one map.
struct Pass {
    map_idx: usize,
    over_still: bool,
    casters: std::ops::Range<u32>,
}

/// All maps.
#[derive(Debug)]
pub(crate) struct Shadows {
    cascade: Cascade,
    pipeline: wgpu::RenderPipeline,
    restore: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    still_layout: wgpu::BindGroupLayout,
    matrices: wgpu::Buffer,
    maps: Vec<Map>,
    sun_towards: Vector3<f64>,
    n_uses: u64,
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
    pub fn new(gpu: &Gpu, cascade: Cascade) -> Self {
        let device = gpu.device();
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("shadow"), entries: &[storage(0)] });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("shadow"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let still_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("still shadows"),
            entries: &[texture(0, wgpu::TextureSampleType::Depth)],
        });
        let restore_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("still shadows"),
            bind_group_layouts: &[Some(&still_layout)],
            immediate_size: 0,
        });
        Shadows {
            cascade,
            pipeline: pipeline(gpu, &pipeline_layout, false),
            restore: pipeline(gpu, &restore_layout, true),
            layout,
            still_layout,
            matrices: gpu.buffer("shadow matrices", 64 * 1024, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST),
            maps: Vec::new(),
            sun_towards: Vector3::zeros(),
            n_uses: 0,
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
        eyes: &[Eye],
    ) -> Vec<ShadowLookup> {
        if self.sun_towards != sun_towards {
            self.maps.clear();
            self.sun_towards = sun_towards;
        }
        self.n_uses += 1;
        let moving = if self.cascade.moving { MovingCaster::all_of(assets, scene) } else { Vec::new() };
        let places: Vec<(Cascade, [i64; 3])> =
            eyes.iter().map(|eye| (self.cascade.seen_with(eye.focal_px), self.cascade.cell_of(&eye.world_from_camera))).collect();
        let mut drawn: Vec<((u32, [i64; 3]), wgpu::TextureView)> = Vec::new();
        let mut casters: Vec<Caster> = Vec::new();
        let mut passes: Vec<Pass> = Vec::new();
        for (cascade, cell) in &places {
            let key = (cascade.side_px, *cell);
            if drawn.iter().any(|(known, _)| *known == key) {
                continue;
            }
            let map_idx = self.map_of(gpu, *cell, cascade.side_px);
            let map = &mut self.maps[map_idx];
            if !map.fresh {
                let begin = casters.len() as u32;
                casters.extend(cascade.still_casters(assets, *cell, sun_towards));
                passes.push(Pass { map_idx, over_still: false, casters: begin..casters.len() as u32 });
                map.fresh = true;
            }
            let begin = casters.len() as u32;
            casters.extend(cascade.moving_casters(assets, &moving, *cell, sun_towards));
            if casters.len() as u32 > begin {
                let all = map.all.get_or_insert_with(|| shadow_image(gpu, cascade.side_px));
                passes.push(Pass { map_idx, over_still: true, casters: begin..casters.len() as u32 });
                drawn.push((key, all.view.clone()));
            } else {
                drawn.push((key, map.still.view.clone()));
            }
        }
        self.draw(gpu, encoder, assets, &casters, &passes);
        let lookup = |(eye, (cascade, cell)): (&Eye, &(Cascade, [i64; 3]))| {
            let (_, view) = drawn.iter().find(|(known, _)| *known == (cascade.side_px, *cell)).expect("every cell was drawn");
            let shadow_from_camera = cascade.shadow_from_world(*cell, sun_towards) * eye.world_from_camera.to_homogeneous();
            let texel_m = 2.0 * cascade.half_side_m / cascade.side_px as f64;
            ShadowLookup {
                view: view.clone(),
                shadow_from_camera: top_rows(&shadow_from_camera),
                texel_depth: (texel_m / (2.0 * cascade.half_depth_m)) as f32,
                on: true,
            }
        };
        eyes.iter().zip(&places).map(lookup).collect()
    }

    /// The map of a cell, made or taken over if there is none.
    fn map_of(&mut self, gpu: &Gpu, cell: [i64; 3], side_px: u32) -> usize {
        let used = self.n_uses;
        if let Some(idx) = self.maps.iter().position(|map| (map.cell, map.side_px) == (cell, side_px)) {
            self.maps[idx].used = used;
            return idx;
        }
        let oldest = (0..self.maps.len()).filter(|idx| self.maps[*idx].used < used).min_by_key(|idx| self.maps[*idx].used);
        match oldest {
            Some(idx) if self.maps.len() >= MAX_KEPT => {
                let map = &mut self.maps[idx];
                if map.side_px != side_px {
                    (map.side_px, map.still, map.all) = (side_px, shadow_image(gpu, side_px), None);
                }
                map.take_over(cell, used);
                idx
            }
            _ => {
                let still = shadow_image(gpu, side_px);
                let mut map = Map { cell, side_px, still, all: None, dirty_px: Vec::new(), fresh: false, used };
                map.forget();
                self.maps.push(map);
                self.maps.len() - 1
            }
        }
    }

    fn draw(&mut self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, assets: &GpuAssets, casters: &[Caster], passes: &[Pass]) {
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
        for Pass { map_idx, over_still, casters: range } in passes {
            let map = &mut self.maps[*map_idx];
            let drawn = &casters[range.start as usize..range.end as usize];
            let (view, load) = match &map.all {
                Some(all) if *over_still => (&all.view, wgpu::LoadOp::Load),
                _ => (&map.still.view, wgpu::LoadOp::Clear(1.0)),
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
            if *over_still {
                let still = gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
                    label: Some("still shadows"),
                    layout: &self.still_layout,
                    entries: &[wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(&map.still.view) }],
                });
                pass.set_pipeline(&self.restore);
                pass.set_bind_group(0, &still, &[]);
                for [x, y, width, height] in map.dirty_px.drain(..) {
                    pass.set_scissor_rect(x, y, width, height);
                    pass.draw(0..3, 0..1);
                }
                pass.set_scissor_rect(0, 0, map.side_px, map.side_px);
                drawn.iter().for_each(|caster| add_rect(&mut map.dirty_px, caster.rect_px));
            } else {
                // What was drawn over the old one is of no use any more.
                map.forget();
            }
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &bound, &[]);
            pass.set_vertex_buffer(0, assets.vertices.slice(..));
            pass.set_index_buffer(assets.indices.slice(..), wgpu::IndexFormat::Uint32);
            for (instance, Caster { mesh, .. }) in range.clone().zip(drawn) {
                pass.draw_indexed(mesh.first_idx..mesh.first_idx + mesh.n_indices, mesh.base_vertex, instance..instance + 1);
                gpu.counters().add_draw(mesh.n_indices as u64 / 3);
            }
        }
    }
}

/// Adds a rectangle unless another one holds it: wheels lie within their car.
fn add_rect(rects: &mut Vec<[u32; 4]>, new: [u32; 4]) {
    let holds =
        |[x, y, width, height]: &[u32; 4]| *x <= new[0] && *y <= new[1] && x + width >= new[0] + new[2] && y + height >= new[1] + new[3];
    if !rects.iter().any(holds) {
        rects.push(new);
    }
}

fn shadow_image(gpu: &Gpu, side_px: u32) -> Image {
    let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
    image(gpu, "shadow map", [side_px, side_px], wgpu::TextureFormat::Depth16Unorm, usage)
}

/// Draws casters, or (`restore`) the still map over what was drawn on it.
fn pipeline(gpu: &Gpu, layout: &wgpu::PipelineLayout, restore: bool) -> wgpu::RenderPipeline {
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
            entry_point: Some(if restore { "vs_full" } else { "vs_main" }),
            compilation_options: Default::default(),
            buffers: if restore { &[] } else { &buffers },
        },
        // Both sides cast: leaves and open shells have no back.
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: wgpu::TextureFormat::Depth16Unorm,
            depth_write_enabled: Some(true),
            depth_compare: Some(if restore { wgpu::CompareFunction::Always } else { wgpu::CompareFunction::Less }),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: restore.then(|| wgpu::FragmentState {
            module: &shader,
            entry_point: Some("fs_still"),
            compilation_options: Default::default(),
            targets: &[],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// Unit vectors to the right and down in the map, and along the light.
fn axes(sun_towards: Vector3<f64>) -> [Vector3<f64>; 3] {
    let along = -sun_towards;
    let right = if along.x.abs() + along.y.abs() > 1e-6 { along.cross(&Vector3::z()).normalize() } else { Vector3::x() };
    [right, along.cross(&right), along]
}

/// What moves, with its sphere.
struct MovingCaster<'s> {
    instance: &'s DynamicInstance,
    sphere: Sphere,
}

impl<'s> MovingCaster<'s> {
    fn all_of(assets: &GpuAssets, scene: &'s Scene) -> Vec<MovingCaster<'s>> {
        let sphere = |instance: &DynamicInstance| Sphere::of(assets.scene_assets.mesh(instance.mesh), &instance.world_from_mesh);
        scene.dynamics.iter().map(|instance| MovingCaster { instance, sphere: sphere(instance) }).collect()
    }
}

impl Cascade {
    /// The same for a camera of this focal length.
    fn seen_with(&self, focal_px: f64) -> Cascade {
        let mut side_px = self.side_px;
        let mut sharp_px = SHARP_FOCAL_PX;
        while focal_px < sharp_px && side_px / 2 >= MIN_SIDE_PX {
            (side_px, sharp_px) = (side_px / 2, sharp_px / 2.0);
        }
        Cascade { side_px, ..*self }
    }

    fn cell_of(&self, eye: &Isometry3<f64>) -> [i64; 3] {
        std::array::from_fn(|axis| (eye.translation.vector[axis] / self.cell_m).round() as i64)
    }

    fn centre_m(&self, cell: [i64; 3]) -> Vector3<f64> {
        Vector3::from(cell.map(|i| i as f64 * self.cell_m))
    }

    /// World to (u, v, depth), each 0..=1 inside the map.
    fn shadow_from_world(&self, cell: [i64; 3], sun_towards: Vector3<f64>) -> Matrix4<f64> {
        let centre = self.centre_m(cell);
        let scales = [0.5 / self.half_side_m, 0.5 / self.half_side_m, 0.5 / self.half_depth_m];
        let mut matrix = Matrix4::identity();
        for (row, (axis, scale)) in axes(sun_towards).into_iter().zip(scales).enumerate() {
            for column in 0..3 {
                matrix[(row, column)] = axis[column] * scale;
            }
            matrix[(row, 3)] = 0.5 - axis.dot(&centre) * scale;
        }
        matrix
    }

    fn touches(&self, sphere: &Sphere, cell: [i64; 3], axes: &[Vector3<f64>; 3]) -> bool {
        let offset = sphere.centre_m - Point3::from(self.centre_m(cell));
        let half = [self.half_side_m, self.half_side_m, self.half_depth_m];
        axes.iter().zip(half).all(|(axis, half)| axis.dot(&offset).abs() < half + sphere.radius_m)
    }

    fn still_casters(&self, assets: &GpuAssets, cell: [i64; 3], sun_towards: Vector3<f64>) -> Vec<Caster> {
        let (axes, matrix) = (axes(sun_towards), self.shadow_from_world(cell, sun_towards));
        let instances = assets.scene_assets.statics.iter().zip(&assets.spheres);
        instances
            .filter(|(instance, sphere)| assets.casts_shadow(instance.mesh) && self.touches(sphere, cell, &axes))
            .filter_map(|(instance, sphere)| self.caster(assets, instance.mesh, &instance.world_from_mesh, sphere, (cell, &matrix)))
            .collect()
    }

    fn moving_casters(&self, assets: &GpuAssets, moving: &[MovingCaster<'_>], cell: [i64; 3], sun_towards: Vector3<f64>) -> Vec<Caster> {
        let (axes, matrix) = (axes(sun_towards), self.shadow_from_world(cell, sun_towards));
        let near = moving.iter().filter(|moving| self.touches(&moving.sphere, cell, &axes));
        near.filter_map(|MovingCaster { instance, sphere }| {
            self.caster(assets, instance.mesh, &instance.world_from_mesh, sphere, (cell, &matrix))
        })
        .collect()
    }

    fn caster(
        &self,
        assets: &GpuAssets,
        mesh: MeshId,
        world_from_mesh: &Isometry3<f64>,
        sphere: &Sphere,
        (cell, shadow_from_world): ([i64; 3], &Matrix4<f64>),
    ) -> Option<Caster> {
        let away_m = (sphere.centre_m - Point3::from(self.centre_m(cell))).norm() - sphere.radius_m;
        let mesh = assets.level(mesh, away_m.max(self.caster_distance_m))?;
        let centre = shadow_from_world.transform_point(&sphere.centre_m);
        let (side_px, radius_px) = (self.side_px as f64, sphere.radius_m / (2.0 * self.half_side_m) * self.side_px as f64 + 1.0);
        let span = |middle: f64| {
            let low = (middle * side_px - radius_px).clamp(0.0, side_px - 1.0);
            let high = (middle * side_px + radius_px).clamp(low, side_px - 1.0);
            (low as u32, high as u32 - low as u32 + 1)
        };
        let ((x, width), (y, height)) = (span(centre.x), span(centre.y));
        let matrix = top_rows(&(shadow_from_world * world_from_mesh.to_homogeneous()));
        Some(Caster { mesh, matrix, rect_px: [x, y, width, height] })
    }
}

fn top_rows(m: &Matrix4<f64>) -> Rows {
    std::array::from_fn(|row| std::array::from_fn(|column| m[(row, column)] as f32))
}
