//! What culling needs of an episode's meshes and instances, and where the meshes lie in one list of
//! vertices and one of indices.

use std::sync::Arc;

use bytemuck::Zeroable as _;
use schema_types::Class;
use sensor_core::{Lod, Material, Mesh, MeshId, SceneAssets, StaticInstance, Vertex};

use super::emitter::{Emitter, emitters_of};
use super::free_ranges::FreeRanges;
use super::mesh_draw::{MeshDraw, Sphere, Still};
use super::switched::{self, StillLamp};
use crate::occlusion::{Occluder, occluders_of};

/// Where a mesh lies in the lists.
#[derive(Clone, Copy, Debug)]
pub(super) struct MeshRange {
    pub base_vertex: i32,
    n_vertices: u32,
    pub first_idx: u32,
    /// Capacity for indices.
    pub n_places: u32,
    casts_shadow: bool,
    has_walls: bool,
}

/// A level of detail.
#[derive(Clone, Copy, Debug)]
struct Level {
    until_m: f64,
    draw: MeshDraw,
}

/// The meshes of one episode.
#[derive(Debug)]
pub(crate) struct Meshes {
    pub scene_assets: Arc<SceneAssets>,
    /// Bounding spheres, one per static instance.
    pub spheres: Vec<Sphere>,
    /// The same instances in the layout that culling uses.
    pub still: Still,
    /// Lamps of the scenery in the world, except those that are switched off.
    pub still_lamps: Vec<StillLamp>,
    /// Lamps per mesh.
    emitters: Vec<Vec<Emitter>>,
    pub(super) ranges: Vec<MeshRange>,
    /// For each mesh the number of its first level of detail, and the levels of all meshes in one
    /// list, because culling looks up many.
    levels: (Vec<u32>, Vec<Level>),
    /// Whether things of each mesh stand on the ground and may move.
    stands: Vec<bool>,
    /// Box of each mesh: least and greatest corner, mesh space, metres.
    boxes_m: Vec<[[f32; 3]; 2]>,
    /// Large polygons of each mesh's levels of detail.
    occluders: Vec<Vec<Vec<Occluder>>>,
    /// Room in both lists that no mesh has.
    room: Room,
}

/// Vertices and indices of all meshes.
pub(crate) type Corners = (Vec<Vertex>, Vec<u32>);

/// Free ranges of both lists.
#[derive(Debug)]
struct Room {
    vertices: FreeRanges,
    indices: FreeRanges,
}

/// Flatter meshes (roads, ground) receive shadows but cast none.
const MIN_CASTER_HEIGHT_M: f32 = 0.3;

/// Room for streamed meshes beside half as much again as what is there, vertices and indices.
const SPARE_VERTICES: usize = 200_000;
const SPARE_INDICES: usize = 400_000;

/// Materials with windows.
const WALLS: [u8; 2] = [Material::Facade as u8, Material::ShopFront as u8];

impl Meshes {
    /// Of these assets, and the lists.
    pub fn of(scene_assets: &Arc<SceneAssets>) -> (Meshes, Corners) {
        let n_vertices: usize = scene_assets
            .meshes
            .iter()
            .map(|mesh| mesh.vertices.len())
            .sum();
        let n_indices: usize = scene_assets
            .meshes
            .iter()
            .map(|mesh| mesh.indices.len())
            .sum();
        let (mut vertices, mut indices) = (
            Vec::with_capacity(n_vertices),
            Vec::with_capacity(n_indices),
        );
        let mut ranges = Vec::with_capacity(scene_assets.meshes.len());
        for mesh in &scene_assets.meshes {
            ranges.push(MeshRange {
                base_vertex: vertices.len() as i32,
                n_vertices: mesh.vertices.len() as u32,
                first_idx: indices.len() as u32,
                n_places: mesh.indices.len() as u32,
                casts_shadow: height_m(mesh) >= MIN_CASTER_HEIGHT_M,
                has_walls: has_walls(mesh),
            });
            vertices.extend_from_slice(&mesh.vertices);
            indices.extend_from_slice(&mesh.indices);
        }
        let used = (vertices.len(), indices.len());
        if scene_assets.streamed {
            // Room for the scenery of other places, which comes while this one is still there.
            vertices.resize(used.0 + used.0 / 2 + SPARE_VERTICES, Vertex::zeroed());
            indices.resize(used.1 + used.1 / 2 + SPARE_INDICES, 0);
        }
        let room = Room {
            vertices: FreeRanges::of(used.0 as u32, vertices.len() as u32),
            indices: FreeRanges::of(used.1 as u32, indices.len() as u32),
        };
        let spheres = spheres_of(scene_assets);
        let emitters: Vec<Vec<Emitter>> = scene_assets
            .meshes
            .iter()
            .map(|mesh| emitters_of(mesh))
            .collect();
        let meshes = Meshes {
            scene_assets: scene_assets.clone(),
            still: Still::of(scene_assets, &spheres),
            spheres,
            still_lamps: switched::still_lamps(scene_assets, &emitters),
            emitters,
            levels: levels_of(scene_assets, &ranges),
            stands: stands_of(scene_assets),
            boxes_m: scene_assets
                .meshes
                .iter()
                .map(|mesh| box_of(mesh))
                .collect(),
            occluders: scene_assets
                .meshes
                .iter()
                .map(|mesh| occluders_of_levels(mesh))
                .collect(),
            ranges,
            room,
        };
        (meshes, (vertices, indices))
    }

    /// Whether other assets have the same meshes in the same places, so that they differ at most in
    /// how lamps are switched.
    pub fn shows_the_same(&self, other: &SceneAssets) -> bool {
        let known = &self.scene_assets;
        let same_meshes = known.meshes.len() == other.meshes.len()
            && known
                .meshes
                .iter()
                .zip(&other.meshes)
                .all(|(a, b)| Arc::ptr_eq(a, b));
        let is_same = |(a, b): (&StaticInstance, &StaticInstance)| {
            (a.mesh, a.object, a.world_from_mesh) == (b.mesh, b.object, b.world_from_mesh)
        };
        known.episode == other.episode
            && same_meshes
            && known.statics.len() == other.statics.len()
            && known.statics.iter().zip(&other.statics).all(is_same)
    }

    /// Takes over where the instances of `other`, whose meshes are in the lists, stand.
    pub fn shows(&mut self, other: &Arc<SceneAssets>) {
        self.spheres = spheres_of(other);
        self.still = Still::of(other, &self.spheres);
        self.levels = levels_of(other, &self.ranges);
        self.stands = stands_of(other);
        self.switch_lamps(other);
    }

    /// Takes over how the lamps of `other`, which shows the same meshes, are switched.
    pub fn switch_lamps(&mut self, other: &Arc<SceneAssets>) {
        self.still_lamps = switched::still_lamps(other, &self.emitters);
        self.scene_assets = other.clone();
    }

    /// Takes over a mesh that shows more or fewer triangles than the one before.
    pub(super) fn replace(&mut self, i: usize, mesh: &Mesh) {
        self.emitters[i] = emitters_of(mesh);
        self.occluders[i] = occluders_of_levels(mesh);
    }

    /// Gives the places of a streamed mesh back.
    pub(super) fn give_back(&mut self, i: usize) {
        let range = &mut self.ranges[i];
        self.room
            .vertices
            .give(range.base_vertex as u32, range.n_vertices);
        self.room.indices.give(range.first_idx, range.n_places);
        (range.n_vertices, range.n_places) = (0, 0);
    }

    /// Finds places for a streamed mesh; `None` if there is no room.
    pub(super) fn place(&mut self, i: usize, mesh: &Mesh) -> Option<MeshRange> {
        let (n_vertices, n_places) = (mesh.vertices.len() as u32, mesh.indices.len() as u32);
        let base_vertex = self.room.vertices.take(n_vertices)?;
        let first_idx = self.room.indices.take(n_places)?;
        self.ranges[i] = MeshRange {
            base_vertex: base_vertex as i32,
            n_vertices,
            first_idx,
            n_places,
            casts_shadow: height_m(mesh) >= MIN_CASTER_HEIGHT_M,
            has_walls: has_walls(mesh),
        };
        self.boxes_m[i] = box_of(mesh);
        self.replace(i, mesh);
        Some(self.ranges[i])
    }

    /// Whether any lamp of the scenery was switched.
    pub fn is_switched(&self) -> bool {
        !self.scene_assets.switched.is_empty()
    }

    /// The level of `mesh` to draw at this distance from its bounding sphere; `None` beyond the
    /// last.
    pub fn level(&self, mesh: MeshId, distance_m: f64) -> Option<MeshDraw> {
        let (firsts, levels) = &self.levels;
        let of_mesh = firsts[mesh.0 as usize] as usize..firsts[mesh.0 as usize + 1] as usize;
        levels[of_mesh]
            .iter()
            .find(|level| distance_m < level.until_m)
            .map(|level| level.draw)
    }

    /// Large polygons of the level that is drawn at this distance.
    pub fn occluders(&self, mesh: MeshId, distance_m: f64) -> &[Occluder] {
        let (firsts, levels) = &self.levels;
        let first = firsts[mesh.0 as usize] as usize;
        let of_mesh = &levels[first..firsts[mesh.0 as usize + 1] as usize];
        of_mesh
            .iter()
            .position(|level| distance_m < level.until_m)
            .map_or(&[], |level| &self.occluders[mesh.0 as usize][level])
    }

    /// Box of a mesh: least and greatest corner, mesh space, metres.
    pub fn box_m(&self, mesh: MeshId) -> [[f32; 3]; 2] {
        self.boxes_m[mesh.0 as usize]
    }

    /// Whether things of this mesh stand on the ground and may move.
    pub fn stands(&self, mesh: MeshId) -> bool {
        self.stands[mesh.0 as usize]
    }

    /// Lamps of a mesh.
    pub fn emitters(&self, mesh: MeshId) -> &[Emitter] {
        &self.emitters[mesh.0 as usize]
    }

    pub fn casts_shadow(&self, mesh: MeshId) -> bool {
        self.ranges[mesh.0 as usize].casts_shadow
    }
}

/// For each mesh the number of its first level, then the number of all levels; and the levels.
fn levels_of(assets: &SceneAssets, ranges: &[MeshRange]) -> (Vec<u32>, Vec<Level>) {
    let (mut firsts, mut levels) = (vec![0], Vec::new());
    for (mesh, range) in assets.meshes.iter().zip(ranges) {
        let level = |lod: &Lod| Level {
            until_m: lod.until_m as f64,
            draw: MeshDraw {
                first_idx: range.first_idx + lod.first_idx,
                n_indices: lod.n_indices,
                base_vertex: range.base_vertex,
                has_walls: range.has_walls,
            },
        };
        levels.extend(mesh.lods.iter().filter(|lod| lod.n_indices > 0).map(level));
        firsts.push(levels.len() as u32);
    }
    (firsts, levels)
}

/// Large polygons of the levels that are drawn.
fn occluders_of_levels(mesh: &Mesh) -> Vec<Vec<Occluder>> {
    let drawn = mesh.lods.iter().filter(|lod| lod.n_indices > 0);
    drawn.map(|lod| occluders_of(mesh, lod)).collect()
}

fn box_of(mesh: &Mesh) -> [[f32; 3]; 2] {
    let none = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    mesh.vertices.iter().fold(none, |[low, high], vertex| {
        let at = vertex.position_m;
        [
            [0, 1, 2].map(|axis| low[axis].min(at[axis])),
            [0, 1, 2].map(|axis| high[axis].max(at[axis])),
        ]
    })
}

fn stands_of(assets: &SceneAssets) -> Vec<bool> {
    let stands = |mesh: &Mesh| {
        let first = mesh.vertices.first();
        first.is_some_and(|vertex| {
            (Class::PEDESTRIANS.0..=Class::BICYCLE.0).contains(&vertex.class)
                || vertex.class == Class::DYNAMIC.0
        })
    };
    assets.meshes.iter().map(|mesh| stands(mesh)).collect()
}

fn spheres_of(assets: &SceneAssets) -> Vec<Sphere> {
    assets
        .statics
        .iter()
        .map(|instance| Sphere::of(assets.mesh(instance.mesh), &instance.world_from_mesh))
        .collect()
}

fn has_walls(mesh: &Mesh) -> bool {
    mesh.vertices
        .iter()
        .any(|vertex| WALLS.contains(&vertex.material))
}

fn height_m(mesh: &Mesh) -> f32 {
    let heights = mesh.vertices.iter().map(|vertex| vertex.position_m[2]);
    let (low, high) = heights.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), z| {
        (low.min(z), high.max(z))
    });
    high - low
}
