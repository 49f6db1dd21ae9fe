//! Shadow maps of the near cascade on processors: the maps of [`CascadeMaps`], drawn in tiles.
//!
//! A map of static casters is drawn once per cell and sun. Where moving casters were or are, tiles are
//! drawn anew over a copy of it. Depths have 16 bits, as on GPUs.
//!
//! [`CascadeMaps`]: super::cascade_maps::CascadeMaps

use nalgebra::Vector3;
use rayon::prelude::*;
use sensor_core::vector_lanes::{LaneWork, Lanes, WordLanes, in_lanes};
use sensor_core::{Scene, Vertex};
use sensor_shade::images::DepthImage;

use super::cascade::{Cascade, MovingCaster};
use super::cascade_maps::Eye;
use super::caster::{Caster, MatrixRows};
use crate::assets::Meshes;
use crate::quality::Quality;
use crate::raster::{TILE_PX, Tile, TileLists};

/// Maps that are kept: cameras often return to a cell.
const MOST_MAPS: usize = 4;

/// The maps, the last one used at the end.
#[derive(Debug)]
pub(crate) struct TileMaps {
    cascade: Cascade,
    sun_towards: Vector3<f64>,
    maps: Vec<TileMap>,
    lists: TileLists,
}

#[derive(Debug)]
struct TileMap {
    cell: [i64; 3],
    side_px: u32,
    /// Bits of the depths of static casters.
    still: Vec<u32>,
    all: DepthImage,
    /// Moving casters that were drawn over it, and which tiles they covered.
    over: Vec<Caster>,
    covered: Vec<bool>,
}

/// What a view needs to look up its map.
pub(crate) struct TileLookup<'m> {
    pub depths: &'m DepthImage,
    pub shadow_from_camera: MatrixRows,
    /// One texel in units of the map's depth.
    pub texel_depth: f32,
}

/// What casters are drawn from: meshes, and their corners.
#[derive(Clone, Copy)]
pub(crate) struct CasterInput<'i> {
    pub meshes: &'i Meshes,
    pub vertices: &'i [Vertex],
    pub indices: &'i [u32],
}

impl TileMaps {
    /// No maps yet.
    pub fn new(quality: Quality) -> TileMaps {
        TileMaps {
            cascade: Cascade::near(quality),
            sun_towards: Vector3::zeros(),
            maps: Vec::new(),
            lists: TileLists::default(),
        }
    }

    /// Forgets everything: other meshes are shown.
    pub fn clear(&mut self) {
        self.maps.clear();
    }

    /// The map of this eye in this scene.
    pub fn draw(
        &mut self,
        input: &CasterInput<'_>,
        scene: &Scene,
        sun_towards: Vector3<f64>,
        eye: &Eye,
    ) -> TileLookup<'_> {
        if self.sun_towards != sun_towards {
            self.clear();
            self.sun_towards = sun_towards;
        }
        let cascade = self.cascade.seen_with(eye.focal_px);
        let cell = cascade.cell_of(&eye.world_from_camera);
        let is_its = |map: &TileMap| (map.cell, map.side_px) == (cell, cascade.side_px);
        let mut map = match self.maps.iter().position(is_its) {
            Some(known) => self.maps.remove(known),
            None => {
                if self.maps.len() == MOST_MAPS {
                    self.maps.remove(0);
                }
                let casters = cascade.still_casters(input.meshes, cell, sun_towards);
                TileMap::new(&mut self.lists, input, &cascade, cell, &casters)
            }
        };
        let moving = MovingCaster::all_of(input.meshes, scene);
        let casters = cascade.moving_casters(input.meshes, &moving, cell, sun_towards);
        map.draw_over(&mut self.lists, input, casters);
        self.maps.push(map);
        TileLookup {
            depths: &self.maps[self.maps.len() - 1].all,
            shadow_from_camera: cascade.shadow_from_camera(
                cell,
                sun_towards,
                &eye.world_from_camera,
            ),
            texel_depth: cascade.texel_depth(),
        }
    }
}

/// Sorts casters into tiles of a map.
fn sort(lists: &mut TileLists, input: &CasterInput<'_>, side_px: u32, casters: &[Caster]) {
    lists.begin([side_px as usize; 2]);
    let side = side_px as f32;
    for Caster { mesh, matrix, .. } in casters {
        let first = mesh.first_idx as usize;
        let indices = &input.indices[first..first + mesh.n_indices as usize];
        let vertices = &input.vertices[mesh.base_vertex as usize..];
        for triangle in indices.as_chunks::<3>().0 {
            lists.add_to_map(triangle.map(|i| {
                let [x, y, z] = vertices[i as usize].position_m;
                let [u, v, depth] = matrix.map(|row| row[0] * x + row[1] * y + row[2] * z + row[3]);
                [u * side, v * side, 1.0 - depth]
            }));
        }
    }
}

/// Puts the nearer of a tile's depths and those that are there into rows of a map.
struct Nearer<'n> {
    tile: &'n Tile,
    left: usize,
    side: usize,
    rows: &'n mut [u32],
}

impl LaneWork for Nearer<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let steps = L::splat(u16::MAX as f32);
        let rows = self.rows.chunks_exact_mut(self.side);
        for (row, heights) in rows.zip(self.tile.inverse_depth.iter()) {
            let row = &mut row[self.left..self.left + TILE_PX];
            let eights = row.as_chunks_mut::<8>().0.iter_mut();
            for (depths, heights) in eights.zip(heights.as_chunks::<8>().0) {
                let depth = L::splat(1.0).sub(L::load(heights));
                let step = depth.mul(steps).add(L::splat(0.5)).floor().div(steps);
                let before = <L::Words>::load(depths).to_numbers();
                *depths = step.min(before).to_words().store();
            }
        }
    }
}

/// Draws all tiles over the depths that are there.
fn fill(lists: &TileLists, side_px: u32, depths: &mut [u32]) {
    let side = side_px as usize;
    let across = side / TILE_PX;
    let bands = depths.par_chunks_exact_mut(TILE_PX * side).enumerate();
    bands.for_each_init(Tile::default, |tile, (band, rows)| {
        for column in 0..across {
            let number = band * across + column;
            if !lists.is_empty(number) {
                lists.fill(number, tile);
                in_lanes(Nearer {
                    tile,
                    left: column * TILE_PX,
                    side,
                    rows: &mut *rows,
                });
            }
        }
    });
}

impl TileMap {
    fn new(
        lists: &mut TileLists,
        input: &CasterInput<'_>,
        cascade: &Cascade,
        cell: [i64; 3],
        casters: &[Caster],
    ) -> TileMap {
        let side_px = cascade.side_px;
        let mut all = DepthImage::far(side_px);
        sort(lists, input, side_px, casters);
        fill(lists, side_px, all.bits_mut());
        TileMap {
            cell,
            side_px,
            still: all.bits_mut().to_vec(),
            all,
            over: Vec::new(),
            covered: vec![false; (side_px as usize / TILE_PX).pow(2)],
        }
    }

    /// Draws moving casters over the static ones.
    fn draw_over(&mut self, lists: &mut TileLists, input: &CasterInput<'_>, casters: Vec<Caster>) {
        if self.over == casters {
            return;
        }
        let side = self.side_px as usize;
        sort(lists, input, self.side_px, &casters);
        let across = side / TILE_PX;
        let depths = self.all.bits_mut();
        for (number, covered) in self.covered.iter_mut().enumerate() {
            if std::mem::replace(covered, !lists.is_empty(number)) {
                let [left, top] = [number % across, number / across].map(|at| at * TILE_PX);
                for row in top..top + TILE_PX {
                    let at = row * side + left..row * side + left + TILE_PX;
                    depths[at.clone()].copy_from_slice(&self.still[at]);
                }
            }
        }
        fill(lists, self.side_px, depths);
        self.over = casters;
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use nalgebra::{Isometry3, UnitQuaternion};
    use schema_types::{ActorId, Class, ObjectId, SimTime, Tick};
    use sensor_core::mesh::Surface;
    use sensor_core::{DynamicInstance, Material, MeshBuilder, SceneAssets, StaticInstance};
    use sensor_gpu::{Gpu, GpuOptions, Uploads};

    use super::super::cascade_maps::{CascadeMaps, MapLayout, ShadowLookup};
    use super::*;
    use crate::assets::GpuAssets;

    const SIDE_PX: u32 = 1024;

    /// Boxes all around, a tower that is higher and deeper than the map, and a mesh that moves.
    fn assets(rng: &mut fastrand::Rng) -> SceneAssets {
        let mut assets = SceneAssets {
            episode: 1,
            ..Default::default()
        };
        let surface = Surface::new(Class::BUILDINGS, Material::Matte, [128; 3]);
        for i in 0..60 {
            let mut builder = MeshBuilder::new("box");
            let half = match i {
                0 => [4.0, 9.0, 400.0],
                1 => [160.0, 0.1, 1.0],
                _ => [0; 3].map(|_| 0.3 + 6.0 * rng.f32()),
            };
            builder.cuboid(surface, [0.0; 3], half);
            let mesh = assets.add_mesh(builder.finish());
            let mut place = |reach: f64| (rng.f64() * 2.0 - 1.0) * reach;
            let at = [place(90.0), place(90.0), 3.0 + place(3.0)];
            let turn = [place(3.0), place(0.2), place(0.2)];
            assets.statics.push(StaticInstance {
                mesh,
                world_from_mesh: Isometry3::new(at.into(), turn.into()),
                object: ObjectId::scenery(mesh.0),
            });
        }
        assets
    }

    fn scene(assets: &Arc<SceneAssets>, x_m: f64) -> Scene {
        let mesh = assets.statics[5].mesh;
        let car = DynamicInstance {
            actor: ActorId(9),
            part: 0,
            mesh,
            world_from_mesh: Isometry3::translation(x_m, 4.0, 25.0),
            tint_rgb: [0; 3],
            lamps: 0,
            velocity_in_world_mps: Vector3::zeros(),
        };
        Scene {
            tick: Tick(1),
            sim_time: SimTime(50_000_000),
            period_nanos: 50_000_000,
            assets: assets.clone(),
            // In the last scene nothing moves any more.
            dynamics: if x_m < 40.0 { vec![car] } else { Vec::new() },
            past: Default::default(),
            weather: Default::default(),
            lidar_extinction_per_m: 0.0,
            debug: Vec::new(),
            overlay: Default::default(),
        }
    }

    /// Depths of a GPU's map, in steps of 16 bits.
    fn depths_of(gpu: &Gpu, mut encoder: wgpu::CommandEncoder, lookup: &ShadowLookup) -> Vec<u16> {
        let n_bytes = 2 * u64::from(SIDE_PX * SIDE_PX);
        let buffer = gpu.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some("map"),
            size: n_bytes,
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let size = wgpu::Extent3d {
            width: SIDE_PX,
            height: SIDE_PX,
            depth_or_array_layers: 1,
        };
        encoder.copy_texture_to_buffer(
            wgpu::TexelCopyTextureInfo {
                texture: lookup.view.texture(),
                mip_level: 0,
                origin: wgpu::Origin3d {
                    x: 0,
                    y: 0,
                    z: lookup.layer,
                },
                aspect: wgpu::TextureAspect::All,
            },
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(2 * SIDE_PX),
                    rows_per_image: None,
                },
            },
            size,
        );
        gpu.submit([encoder.finish()]);
        buffer.map_async(wgpu::MapMode::Read, .., |_| {});
        gpu.wait_idle();
        let bytes = buffer.get_mapped_range(..).expect("it is mapped");
        bytemuck::pod_collect_to_vec(&bytes)
    }

    /// Oracle: the maps of the adapter, through a drive in which the caster moves and goes.
    #[test]
    fn maps_are_those_of_the_adapter() {
        let gpu = Gpu::open(&GpuOptions::default()).unwrap_or_else(|error| panic!("{error}"));
        let assets = Arc::new(assets(&mut fastrand::Rng::with_seed(4)));
        let on_gpu = GpuAssets::upload(&gpu, &assets);
        let (meshes, (vertices, indices)) = Meshes::of(&assets);
        let input = CasterInput {
            meshes: &meshes,
            vertices: &vertices,
            indices: &indices,
        };
        let cascade = Cascade::near(Quality::Low);
        let mut expected = CascadeMaps::new(&gpu, cascade, MapLayout::BySize, 1 << 30);
        let mut maps = TileMaps::new(Quality::Low);
        let turn = UnitQuaternion::from_euler_angles(0.3, -0.2, 1.0);
        let eye = Eye {
            world_from_camera: Isometry3::from_parts([3.0, -2.0, 1.6].into(), turn),
            focal_px: 100.0,
        };
        let (mut uploads, mut drawn) = (Uploads::new(&gpu), Vec::new());
        for (sun, x_m) in [(0, -12.0), (0, -5.0), (0, 30.0), (0, 50.0), (1, 0.0)] {
            let sun = [[0.5, -0.4, 0.7], [0.0, 0.0, 1.0]][sun];
            let sun_towards = Vector3::from(sun).normalize();
            let scene = scene(&assets, x_m);
            let plan = expected.plan(&on_gpu.meshes, &scene, sun_towards, &[eye]);
            let mut encoder = gpu.encoder("map");
            let to = (&mut uploads, &mut encoder);
            let lookups = expected.record(&gpu, to, &on_gpu, &plan);
            uploads.close(&encoder);
            let expected = depths_of(&gpu, encoder, &lookups[0]);
            let lookup = maps.draw(&input, &scene, sun_towards, &eye);
            assert_eq!(lookup.shadow_from_camera, lookups[0].shadow_from_camera);
            assert_eq!(lookup.texel_depth, lookups[0].texel_depth);
            let found = maps.maps.last_mut().expect("it was drawn").all.bits_mut();
            let steps = found
                .iter()
                .map(|bits| (f32::from_bits(*bits) * u16::MAX as f32).round() as u16);
            let found: Vec<u16> = steps.collect();
            let apart = found.iter().zip(&expected).map(|(a, b)| a.abs_diff(*b));
            let (mut n_near, mut n_far) = (0, 0);
            apart.for_each(|step| {
                n_near += usize::from(step == 1);
                n_far += usize::from(step > 1);
            });
            let n_casters = found.iter().filter(|depth| **depth < u16::MAX).count();
            println!("{n_casters} texels of casters, {n_near} a step apart, {n_far} further");
            assert!(n_casters > 20_000, "{n_casters} texels show a caster");
            // Corners are rounded to 256ths of a texel after sums in another order.
            assert!(n_far < n_casters / 500, "{n_far} texels differ");
            assert!(n_near < n_casters / 50, "{n_near} texels are a step apart");
            drawn.push(found);
        }
        assert!(drawn.windows(2).all(|two| two[0] != two[1]));
    }
}
