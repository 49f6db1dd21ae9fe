//! Scenery, cut into squares of the map with a hierarchy each.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;
use sensor_core::{Mesh, SceneAssets, stream};

use super::placed::{Labels, Placed, is_finite};
use crate::bvh::TriangleTree;

/// Side of a square of scenery that shares one hierarchy: small enough that `f32` coordinates
/// resolve 0.06 mm.
const TILE_M: f64 = 1024.0;

/// Meshes, and the instances that stand still.
#[derive(Debug)]
pub(crate) struct Scenery {
    /// Meshes of the episode; what moves uses them too.
    pub meshes: Vec<Arc<Mesh>>,
    pub statics: Vec<Placed>,
    pub tiles: Vec<Tile>,
}

impl Scenery {
    pub fn new(assets: &SceneAssets, for_gpu: bool) -> Self {
        Scenery::with_kept(assets, for_gpu, Vec::new())
    }

    /// The scenery of `assets`, for which the tiles among `kept` that hold the same instances are
    /// used again. Instances and meshes must have the numbers that they have there.
    pub fn with_kept(assets: &SceneAssets, for_gpu: bool, kept: Vec<Tile>) -> Self {
        let statics = assets
            .statics
            .iter()
            .map(|instance| Placed::new(instance.mesh, &instance.world_from_mesh, instance.object))
            .collect();
        let mut kept: BTreeMap<(i64, i64), Tile> =
            kept.into_iter().map(|tile| (tile.square, tile)).collect();
        let squares: Vec<_> = squares(assets)
            .into_iter()
            .map(|(square, members)| {
                let same = kept.remove(&square).filter(|tile| tile.members == members);
                (square, members, same)
            })
            .collect();
        let tiles = squares
            .into_par_iter()
            .map(|(square, members, same)| {
                same.unwrap_or_else(|| tile(assets, square, members, for_gpu))
            })
            .collect();
        Scenery {
            meshes: assets.meshes.clone(),
            statics,
            tiles,
        }
    }

    /// Object and class of a tile's triangle.
    pub fn labels(&self, tile: &Tile, number: u32) -> Labels {
        let (instance, triangle) = tile.sources[number as usize];
        let placed = &self.statics[instance as usize];
        placed.labels(Labels::of(&self.meshes[placed.mesh_idx as usize], triangle))
    }
}

/// Scenery of one square of the map.
#[derive(Debug)]
pub(crate) struct Tile {
    square: (i64, i64),
    /// Instances in it.
    members: Vec<u32>,
    pub origin_m: Point3<f64>,
    pub tree: TriangleTree,
    /// By triangle number in the tree: the instance in [`Scenery::statics`] and the triangle of its
    /// mesh.
    pub sources: Vec<(u32, u32)>,
}

/// Static instances by the square of the map in which their mesh's centre lies.
fn squares(assets: &SceneAssets) -> BTreeMap<(i64, i64), Vec<u32>> {
    let mut squares = BTreeMap::<_, Vec<u32>>::new();
    let tile_m = tile_m(assets);
    for (i, instance) in assets.statics.iter().enumerate() {
        let is_there = !assets.mesh(instance.mesh).indices.is_empty();
        if is_there && is_finite(&instance.world_from_mesh) {
            let centre = instance.world_from_mesh
                * Point3::from(assets.mesh(instance.mesh).centre_m.map(f64::from));
            let square = (
                (centre.x / tile_m).round() as i64,
                (centre.y / tile_m).round() as i64,
            );
            squares.entry(square).or_default().push(i as u32);
        }
    }
    squares
}

/// Side of a square: scenery that is streamed comes and goes by its tiles.
fn tile_m(assets: &SceneAssets) -> f64 {
    if assets.streamed {
        stream::TILE_M
    } else {
        TILE_M
    }
}

/// The hierarchy of one square.
fn tile(assets: &SceneAssets, square: (i64, i64), members: Vec<u32>, for_gpu: bool) -> Tile {
    let tile_m = tile_m(assets);
    let origin_m = Point3::new(square.0 as f64 * tile_m, square.1 as f64 * tile_m, 0.0);
    let (mut corners, mut sources) = (Vec::new(), Vec::new());
    for instance_idx in &members {
        let instance = &assets.statics[*instance_idx as usize];
        for (i, (triangle, _)) in assets.mesh(instance.mesh).triangles().enumerate() {
            corners.push(corners_in(&origin_m, &instance.world_from_mesh, triangle));
            sources.push((*instance_idx, i as u32));
        }
    }
    Tile {
        square,
        members,
        origin_m,
        tree: TriangleTree::new(&corners, for_gpu),
        sources,
    }
}

/// Corners of a mesh's triangle relative to a tile's origin.
pub(crate) fn corners_in(
    origin_m: &Point3<f64>,
    world_from_mesh: &Isometry3<f64>,
    triangle: [[f32; 3]; 3],
) -> [[f32; 3]; 3] {
    triangle.map(|corner| {
        let at: Vector3<f64> = world_from_mesh * Point3::from(corner.map(f64::from)) - origin_m;
        at.cast::<f32>().into()
    })
}
