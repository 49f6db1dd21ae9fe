//! Scenery of large maps in square tiles, of which sensors get those near them.
//!
//! A tile is chosen by the place of a sensor alone, never by when something was loaded, so that the
//! same run sees the same scenery.

use std::collections::BTreeSet;
use std::sync::Arc;

use nalgebra::Point3;

use crate::mesh::Mesh;
use crate::scene::{MeshId, SceneAssets, StaticInstance};

/// Side of a tile, metres: small enough that `f32` coordinates resolve 0.03 mm.
pub const TILE_M: f64 = 512.0;
/// Distance from a camera up to which tiles are drawn, metres.
pub const VIEW_REACH_M: f64 = 1500.0;
/// Distance from a sensor that casts rays up to which tiles are hit, metres.
pub const RAY_REACH_M: f64 = 400.0;
/// Meshes larger than this are no tile's: they are always there, metres.
pub const WIDE_M: f64 = 300.0;

/// Column and row of a tile.
pub type Tile = (i64, i64);

/// The tile in which a point lies.
pub fn tile_at(x_m: f64, y_m: f64) -> Tile {
    ((x_m / TILE_M).round() as i64, (y_m / TILE_M).round() as i64)
}

/// The tile of a mesh at its place: that of the middle of its box; `None` if it is too wide for one.
pub fn tile_of(mesh: &Mesh, instance: &StaticInstance) -> Option<Tile> {
    let centre = instance.world_from_mesh * Point3::from(mesh.centre_m.map(f64::from));
    (f64::from(mesh.radius_m) <= WIDE_M && centre.x.is_finite() && centre.y.is_finite())
        .then(|| tile_at(centre.x, centre.y))
}

/// Whether a tile is within `reach_m` of a place.
pub fn is_near(tile: Tile, x_m: f64, y_m: f64, reach_m: f64) -> bool {
    let away = |middle: i64, at: f64| ((at - middle as f64 * TILE_M).abs() - 0.5 * TILE_M).max(0.0);
    away(tile.0, x_m).hypot(away(tile.1, y_m)) <= reach_m
}

/// The tiles within `reach_m` of a place.
pub fn tiles_near(x_m: f64, y_m: f64, reach_m: f64) -> impl Iterator<Item = Tile> {
    let (low, high) = (
        tile_at(x_m - reach_m, y_m - reach_m),
        tile_at(x_m + reach_m, y_m + reach_m),
    );
    (low.0..=high.0)
        .flat_map(move |x| (low.1..=high.1).map(move |y| (x, y)))
        .filter(move |tile| is_near(*tile, x_m, y_m, reach_m))
}

/// Which tile every mesh and instance of an episode belongs to.
#[derive(Clone, Debug)]
pub struct Tiles {
    /// By instance of the whole scenery.
    of_mesh: Vec<Option<Tile>>,
    /// A mesh without triangles, in place of one that is not there.
    nothing: (MeshId, Arc<Mesh>),
    meshes: Vec<Arc<Mesh>>,
}

impl Tiles {
    /// Sorts the scenery of an episode into tiles, and adds a mesh without triangles to it. `None`
    /// if the scenery is not so large that it has to be streamed.
    pub fn of(assets: &mut SceneAssets) -> Option<Tiles> {
        if !assets.streamed {
            return None;
        }
        let nothing = Arc::new(Mesh::default());
        assets.meshes.push(nothing.clone());
        let id = MeshId(assets.meshes.len() as u32 - 1);
        // A mesh that stands in one place only comes and goes with its tile.
        let mut uses = vec![0u32; assets.meshes.len()];
        let mut of_mesh = vec![None; assets.meshes.len()];
        for instance in &assets.statics {
            let idx = instance.mesh.0 as usize;
            uses[idx] += 1;
            of_mesh[idx] = tile_of(&assets.meshes[idx], instance);
        }
        for (tile, n) in of_mesh.iter_mut().zip(&uses) {
            if *n != 1 {
                *tile = None;
            }
        }
        Some(Tiles {
            of_mesh,
            nothing: (id, nothing),
            meshes: assets.meshes.clone(),
        })
    }

    /// `assets` with what is in these tiles, and what is too wide for a tile. Instances keep their
    /// numbers; those that are not there have a mesh without triangles.
    pub fn shown(&self, assets: &SceneAssets, tiles: &BTreeSet<Tile>) -> SceneAssets {
        let mut shown = assets.clone();
        for instance in &mut shown.statics {
            let mesh = &self.meshes[instance.mesh.0 as usize];
            if tile_of(mesh, instance).is_some_and(|tile| !tiles.contains(&tile)) {
                instance.mesh = self.nothing.0;
            }
        }
        for (mesh, tile) in shown.meshes.iter_mut().zip(&self.of_mesh) {
            if tile.is_some_and(|tile| !tiles.contains(&tile)) {
                *mesh = self.nothing.1.clone();
            }
        }
        shown
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{MeshBuilder, Surface};
    use crate::{Material, SceneAssets};
    use nalgebra::Isometry3;
    use schema_types::{Class, ObjectId};

    #[test]
    fn tiles_near_a_place_are_those_that_reach_into_the_circle() {
        let near: BTreeSet<Tile> = tiles_near(100.0, -900.0, 700.0).collect();
        for x in -8..8 {
            for y in -8..8 {
                // The nearest point of the square by trying a fine grid of its points.
                let nearest = (0..=64)
                    .flat_map(|i| (0..=64).map(move |k| (i, k)))
                    .map(|(i, k)| {
                        let at = |n: i64, i: i32| (n as f64 - 0.5 + f64::from(i) / 64.0) * TILE_M;
                        (at(x, i) - 100.0).hypot(at(y, k) + 900.0)
                    })
                    .fold(f64::MAX, f64::min);
                if (nearest - 700.0).abs() > 8.0 {
                    assert_eq!(near.contains(&(x, y)), nearest < 700.0, "{x} {y} {nearest}");
                }
            }
        }
    }

    #[test]
    fn what_is_far_has_no_triangles_and_keeps_its_number() {
        let mut builder = MeshBuilder::new("post");
        let surface = Surface::new(Class::POLES, Material::Metal, [90; 3]);
        builder.cuboid(surface, [0.0; 3], [1.0; 3]);
        let post = builder.finish();
        let mut assets = SceneAssets {
            streamed: true,
            ..SceneAssets::default()
        };
        let (shared, own) = (assets.add_mesh(post.clone()), assets.add_mesh(post));
        for (mesh, x) in [(shared, 0.0), (shared, 5000.0), (own, 5000.0)] {
            assets.statics.push(StaticInstance {
                mesh,
                world_from_mesh: Isometry3::translation(x, 0.0, 0.0),
                object: ObjectId::BACKGROUND,
            });
        }
        let tiles = Tiles::of(&mut assets).unwrap();
        let n = |tile: Tile| {
            let shown = tiles.shown(&assets, &BTreeSet::from([tile]));
            assert_eq!(shown.statics.len(), 3);
            let triangles = |i: usize| shown.mesh(shown.statics[i].mesh).indices.len() / 3;
            [triangles(0), triangles(1), triangles(2)]
        };
        assert_eq!(n(tile_at(0.0, 0.0)), [12, 0, 0]);
        assert_eq!(n(tile_at(5000.0, 0.0)), [0, 12, 12]);
    }
}
