//! Scenery collected into square cells, so that cameras can leave out what they do not see.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Vector3};
use schema_types::ObjectId;
use sensor_core::mesh::{Lod, Surface};
use sensor_core::{Mesh, MeshBuilder, MeshId, SceneAssets, StaticInstance};

use super::terrain::Terrain;
use crate::geometry::P2;

/// Side of a cell.
const CELL_M: f64 = 50.0;

/// Kinds of scenery; each has its own distances for levels of detail.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Layer {
    /// Road, pavement, grass, paint.
    Ground,
    /// Houses, bridges.
    Building,
    /// Fences, wires, sign bridges.
    Small,
    /// Distant woods.
    Wood,
}

impl Layer {
    fn until_m(self) -> [f32; 3] {
        match self {
            Layer::Ground => [90.0, 220.0, f32::INFINITY],
            Layer::Building => [40.0, 140.0, f32::INFINITY],
            Layer::Small => [28.0, 90.0, 260.0],
            Layer::Wood => [f32::INFINITY; 3],
        }
    }
}

/// A cell of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Key(Layer, i32, i32);

impl Key {
    /// The cell in which a point lies.
    pub fn at(layer: Layer, p: P2) -> Key {
        Key(
            layer,
            (p.x / CELL_M).floor() as i32,
            (p.y / CELL_M).floor() as i32,
        )
    }

    fn centre(self) -> [f64; 3] {
        [
            (self.1 as f64 + 0.5) * CELL_M,
            (self.2 as f64 + 0.5) * CELL_M,
            0.0,
        ]
    }
}

/// Range of levels of detail, both ends included.
pub type Levels = std::ops::RangeInclusive<usize>;

/// All levels.
pub const ALL: Levels = 0..=2;

/// Collects polygons by cell and level.
#[derive(Default)]
pub struct Chunks {
    /// By the levels that a polygon belongs to, so that its corners are kept once for all of them.
    cells: BTreeMap<Key, BTreeMap<(usize, usize), MeshBuilder>>,
    /// Height of the ground.
    pub terrain: Terrain,
}

impl Chunks {
    /// An empty collection on this ground.
    pub fn on(terrain: Terrain) -> Chunks {
        Chunks {
            terrain,
            ..Chunks::default()
        }
    }

    /// Adds a convex polygon, counter-clockwise from outside, in world coordinates.
    pub fn polygon(
        &mut self,
        key: Key,
        levels: Levels,
        surface: Surface,
        corners_m: &[[f64; 3]],
        uv_m: &[[f32; 2]],
    ) {
        let centre = key.centre();
        let local: Vec<[f32; 3]> = corners_m
            .iter()
            .map(|c| std::array::from_fn(|i| (c[i] - centre[i]) as f32))
            .collect();
        let of_levels = (*levels.start(), *levels.end());
        let builders = self.cells.entry(key).or_default();
        let builder = builders.entry(of_levels).or_default();
        builder.polygon(surface, &local, uv_m);
    }

    /// Adds a polygon that lies at given heights, counter-clockwise from above, to the cell of its
    /// middle; uv is the world position.
    pub fn sheet(
        &mut self,
        layer: Layer,
        levels: Levels,
        surface: Surface,
        corners_m: &[[f64; 3]],
    ) {
        let middle =
            corners_m.iter().map(|c| P2::new(c[0], c[1])).sum::<P2>() / corners_m.len() as f64;
        let uv: Vec<[f32; 2]> = corners_m
            .iter()
            .map(|c| [c[0] as f32, c[1] as f32])
            .collect();
        self.polygon(Key::at(layer, middle), levels, surface, corners_m, &uv);
    }

    /// Adds an upright wall from `a` to `b`, seen from the right of that direction; u starts at
    /// `u0`, v at 0.
    pub fn wall(
        &mut self,
        key: Key,
        levels: Levels,
        surface: Surface,
        (a, b): (P2, P2),
        (low_m, high_m): (f64, f64),
        u0: f64,
    ) {
        let (u, v) = (
            (u0 as f32, (u0 + (b - a).norm()) as f32),
            (high_m - low_m) as f32,
        );
        let corners = [
            [a.x, a.y, low_m],
            [b.x, b.y, low_m],
            [b.x, b.y, high_m],
            [a.x, a.y, high_m],
        ];
        self.polygon(
            key,
            levels,
            surface,
            &corners,
            &[[u.0, 0.0], [u.1, 0.0], [u.1, v], [u.0, v]],
        );
    }

    /// Adds an upright prism over a convex footprint (counter-clockwise); with a lid, without a
    /// floor.
    pub fn prism(
        &mut self,
        key: Key,
        levels: Levels,
        surface: Surface,
        footprint_m: &[P2],
        span_m: (f64, f64),
    ) {
        for i in 0..footprint_m.len() {
            self.wall(
                key,
                levels.clone(),
                surface,
                (footprint_m[i], footprint_m[(i + 1) % footprint_m.len()]),
                span_m,
                0.0,
            );
        }
        let lid: Vec<[f64; 3]> = footprint_m.iter().map(|p| [p.x, p.y, span_m.1]).collect();
        let uv: Vec<[f32; 2]> = footprint_m
            .iter()
            .map(|p| [p.x as f32, p.y as f32])
            .collect();
        self.polygon(key, levels, surface, &lid, &uv);
    }

    /// Turns every cell into a mesh and places it.
    pub fn finish(self, assets: &mut SceneAssets) {
        for (key, builders) in self.cells {
            let mut whole = Mesh {
                name: format!("{:?} {} {}", key.0, key.1, key.2).to_lowercase(),
                ..Mesh::default()
            };
            let mut parts = Vec::new();
            for (levels, builder) in builders {
                let part = builder.finish();
                let base = whole.vertices.len() as u32;
                whole.vertices.extend(part.vertices);
                let indices: Vec<u32> = part.indices.iter().map(|i| i + base).collect();
                parts.push((levels, indices));
            }
            for (level, until_m) in key.0.until_m().into_iter().enumerate() {
                let first_idx = whole.indices.len() as u32;
                for ((from, to), indices) in &parts {
                    if (*from..=*to).contains(&level) {
                        whole.indices.extend(indices);
                    }
                }
                whole.lods.push(Lod {
                    first_idx,
                    n_indices: whole.indices.len() as u32 - first_idx,
                    until_m,
                });
            }
            bound(&mut whole);
            let mesh = assets.add_mesh(whole);
            let [x, y, z] = key.centre();
            place(
                assets,
                mesh,
                Isometry3::translation(x, y, z),
                ObjectId::BACKGROUND,
            );
        }
    }
}

/// Adds an instance of a mesh to the static scenery.
pub fn place(
    assets: &mut SceneAssets,
    mesh: MeshId,
    world_from_mesh: Isometry3<f64>,
    object: ObjectId,
) {
    assets.statics.push(StaticInstance {
        mesh,
        world_from_mesh,
        object,
    });
}

/// Computes the bounding sphere about the middle of the box.
pub fn bound(mesh: &mut Mesh) {
    let (mut low, mut high) = (
        Vector3::repeat(f32::INFINITY),
        Vector3::repeat(f32::NEG_INFINITY),
    );
    for vertex in &mesh.vertices {
        let p = Vector3::from(vertex.position_m);
        (low, high) = (low.inf(&p), high.sup(&p));
    }
    if mesh.vertices.is_empty() {
        return;
    }
    let centre = 0.5 * (low + high);
    mesh.centre_m = centre.into();
    mesh.radius_m = mesh
        .vertices
        .iter()
        .map(|v| (Vector3::from(v.position_m) - centre).norm())
        .fold(0.0, f32::max);
}
