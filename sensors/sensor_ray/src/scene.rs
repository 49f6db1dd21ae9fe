//! The world as rays see it: scenery and moving instances, and what a ray hits.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;
use schema_types::{ActorId, ObjectId};
use sensor_core::lanes::in_lanes;
use sensor_core::{DynamicInstance, Mesh, SceneAssets};

use crate::bundle::{Bundle, Hits};
use crate::cast::{Caster, OneBundle, Stacks};
use crate::hidden::Hiding;
use crate::hit::Hit;
use crate::moving::{Bounds, moving_tree};
use crate::tree::{Tree, TriangleTree};

/// Scenes that were built, so that a GPU knows whose triangles it has.
static N_BUILT: AtomicU64 = AtomicU64::new(0);

/// Side of the squares in which scenery is put into one hierarchy: keeps `f32` coordinates fine to
/// 0.06 mm.
const TILE_M: f64 = 1024.0;

/// Boxes of moving instances are widened by this, more than `f32` loses over a town.
const BOX_MARGIN_M: f64 = 2e-3;

/// Nothing is seen that is as far from the origin as this: the square of a distance beyond is no
/// `f32` any more.
const MAX_M: f64 = 1e18;

/// Scenery of one square of the map.
#[derive(Debug)]
pub(crate) struct Tile {
    pub origin_m: Point3<f64>,
    pub tree: TriangleTree,
    /// Instance in `RayScene::statics` and triangle of its mesh, by triangle number in the tree.
    pub sources: Vec<(u32, u32)>,
}

/// A mesh at a place.
#[derive(Debug)]
pub(crate) struct Placed {
    pub mesh_idx: u32,
    pub world_from_mesh: Isometry3<f64>,
    pub mesh_from_world: Isometry3<f64>,
    pub object: ObjectId,
    pub velocity_in_world_mps: Vector3<f64>,
}

/// Everything rays can hit in one tick.
///
/// [`RayScene::load`] once per episode, [`RayScene::update`] once per tick, then any number of
/// casts from any thread.
#[derive(Debug)]
pub struct RayScene {
    episode: u32,
    /// Number of this scene among all that were built.
    pub(crate) serial: u64,
    /// Whether hierarchies are packed for the GPU too.
    for_gpu: bool,
    pub(crate) meshes: Vec<Arc<Mesh>>,
    /// By mesh; built at load for meshes that are no scenery, else when first seen moving.
    pub(crate) mesh_trees: Vec<Option<TriangleTree>>,
    pub(crate) statics: Vec<Placed>,
    pub(crate) tiles: Vec<Tile>,
    /// What is hidden of the scenery.
    pub(crate) hiding: Hiding,
    pub(crate) dynamics: Vec<Placed>,
    /// Number of the first of `dynamics` behind each actor's.
    pub(crate) actor_ends: Vec<u32>,
    pub(crate) dynamics_origin_m: Point3<f64>,
    pub(crate) dynamics_tree: Tree,
}

impl RayScene {
    /// Builds the hierarchies of an episode: about a microsecond per triangle and core. Level of
    /// detail 0 only.
    pub fn load(assets: &SceneAssets) -> Self {
        Self::build(assets, false)
    }

    /// As [`RayScene::load`], with what [`crate::GpuRays`] needs.
    pub fn load_for_gpu(assets: &SceneAssets) -> Self {
        Self::build(assets, true)
    }

    fn build(assets: &SceneAssets, for_gpu: bool) -> Self {
        let mut is_scenery = vec![false; assets.meshes.len()];
        for instance in &assets.statics {
            is_scenery[instance.mesh.0 as usize] = true;
        }
        let statics: Vec<Placed> = assets
            .statics
            .iter()
            .map(|instance| Placed {
                mesh_idx: instance.mesh.0,
                world_from_mesh: instance.world_from_mesh,
                mesh_from_world: instance.world_from_mesh.inverse(),
                object: instance.object,
                velocity_in_world_mps: Vector3::zeros(),
            })
            .collect();
        let squares: Vec<_> = squares(assets).into_iter().collect();
        let tiles = squares
            .par_iter()
            .map(|(square, members)| tile(assets, *square, members, for_gpu))
            .collect();
        let build = |(mesh, is_scenery): (&Arc<Mesh>, &bool)| {
            if *is_scenery {
                None
            } else {
                Some(mesh_tree(mesh, for_gpu))
            }
        };
        let mesh_trees = assets
            .meshes
            .par_iter()
            .zip(&is_scenery)
            .map(build)
            .collect();
        RayScene {
            episode: assets.episode,
            serial: N_BUILT.fetch_add(1, Ordering::Relaxed),
            for_gpu,
            meshes: assets.meshes.clone(),
            mesh_trees,
            statics,
            tiles,
            hiding: Hiding::new(&assets.hidden),
            dynamics: Vec::new(),
            actor_ends: Vec::new(),
            dynamics_origin_m: Point3::origin(),
            dynamics_tree: Tree::default(),
        }
    }

    /// Hides what `assets` leave out of the scenery and shows the rest, for the price of what
    /// changed. False if that takes new hierarchies: for
    /// another episode, or if something is to be shown that was hidden when this was loaded.
    #[must_use]
    pub fn hide(&mut self, assets: &SceneAssets) -> bool {
        let fits = assets.episode == self.episode
            && assets.meshes.len() == self.meshes.len()
            && self.hiding.can_hide(&assets.hidden);
        if fits {
            self.set_hidden(&assets.hidden);
        }
        fits
    }

    /// Episode of the assets this was loaded from.
    pub fn episode(&self) -> u32 {
        self.episode
    }

    /// Triangles of the scenery.
    pub fn n_static_triangles(&self) -> usize {
        self.tiles.iter().map(|tile| tile.sources.len()).sum()
    }

    /// Puts the moving instances of a tick in place of those before; those of an actor are
    /// neighbours. Instances whose pose is not finite, or
    /// 10¹⁸ m away, are left out.
    pub fn update(&mut self, dynamics: &[DynamicInstance]) {
        self.place(dynamics);
        let boxes: Vec<Bounds> = self
            .dynamics
            .iter()
            .map(|placed| self.bounds_of(placed, &self.dynamics_origin_m))
            .collect();
        self.dynamics_tree = moving_tree(&boxes, &self.actor_ends);
    }

    /// The same for [`crate::GpuRays`] alone, which has a hierarchy of its own: rays that the
    /// processor casts meet nothing that moves until
    /// the next [`RayScene::update`].
    pub fn update_for_gpu(&mut self, dynamics: &[DynamicInstance]) {
        self.place(dynamics);
        self.dynamics_tree = Tree::default();
    }

    /// Takes over the instances.
    fn place(&mut self, dynamics: &[DynamicInstance]) {
        self.dynamics.clear();
        self.actor_ends.clear();
        let is_here = |instance: &&DynamicInstance| is_finite(&instance.world_from_mesh);
        self.dynamics_origin_m = dynamics.iter().find(is_here).map_or(Point3::origin(), |i| {
            i.world_from_mesh.translation.vector.into()
        });
        for instance in dynamics.iter().filter(is_here) {
            let mesh_idx = instance.mesh.0 as usize;
            let Some(mesh) = self.meshes.get(mesh_idx) else {
                continue;
            };
            let tree =
                self.mesh_trees[mesh_idx].get_or_insert_with(|| mesh_tree(mesh, self.for_gpu));
            if tree.bounds().is_none() {
                continue;
            }
            let object = instance.actor.into();
            if self
                .dynamics
                .last()
                .is_none_or(|before| before.object != object)
            {
                self.actor_ends.push(self.dynamics.len() as u32);
            }
            self.dynamics.push(Placed {
                mesh_idx: instance.mesh.0,
                world_from_mesh: instance.world_from_mesh,
                mesh_from_world: instance.world_from_mesh.inverse(),
                object,
                velocity_in_world_mps: instance.velocity_in_world_mps,
            });
            *self.actor_ends.last_mut().expect("the actor has an end") = self.dynamics.len() as u32;
        }
    }

    /// Box about a moving instance, relative to `origin_m`.
    pub(crate) fn bounds_of(&self, placed: &Placed, origin_m: &Point3<f64>) -> Bounds {
        let tree = self.mesh_trees[placed.mesh_idx as usize].as_ref();
        let bounds = tree
            .and_then(TriangleTree::bounds)
            .expect("what moves has triangles");
        box_about(origin_m, &placed.world_from_mesh, bounds)
    }

    /// The nearest hit from `origin_m` along the unit vector `direction` within `max_m`. Both sides
    /// of triangles count.
    pub fn cast(
        &self,
        origin_m: &Point3<f64>,
        direction: &Vector3<f64>,
        max_m: f64,
    ) -> Option<Hit> {
        self.cast_ignoring(origin_m, direction, max_m, None)
    }

    /// As [`RayScene::cast`], through the parts of one actor.
    pub fn cast_ignoring(
        &self,
        origin_m: &Point3<f64>,
        direction: &Vector3<f64>,
        max_m: f64,
        ignored: Option<ActorId>,
    ) -> Option<Hit> {
        let mut caster = Caster {
            scene: self,
            ignored,
            stacks: Stacks::default(),
        };
        let bundle = Bundle::new(&[Some(*direction)])?;
        let mut hits = Hits::new(&bundle, max_m);
        in_lanes(OneBundle {
            caster: &mut caster,
            origin_m,
            bundle: &bundle,
            hits: &mut hits,
        });
        self.surface(&hits, &bundle, 0, origin_m, direction)
            .filter(|hit| hit.distance_m <= max_m)
    }
}

fn mesh_tree(mesh: &Arc<Mesh>, for_gpu: bool) -> TriangleTree {
    let corners: Vec<_> = mesh.triangles().map(|(corners, _)| corners).collect();
    TriangleTree::new(&corners, for_gpu)
}

/// Static instances by the square of the map in which their mesh's centre lies.
fn squares(assets: &SceneAssets) -> BTreeMap<(i64, i64), Vec<u32>> {
    let mut squares = BTreeMap::<_, Vec<u32>>::new();
    for (i, instance) in assets.statics.iter().enumerate() {
        if is_finite(&instance.world_from_mesh) {
            let centre = instance.world_from_mesh
                * Point3::from(assets.mesh(instance.mesh).centre_m.map(f64::from));
            let square = (
                (centre.x / TILE_M).round() as i64,
                (centre.y / TILE_M).round() as i64,
            );
            squares.entry(square).or_default().push(i as u32);
        }
    }
    squares
}

/// The hierarchy of one square.
fn tile(assets: &SceneAssets, square: (i64, i64), members: &[u32], for_gpu: bool) -> Tile {
    let origin_m = Point3::new(square.0 as f64 * TILE_M, square.1 as f64 * TILE_M, 0.0);
    let (mut corners, mut sources) = (Vec::new(), Vec::new());
    for instance_idx in members {
        let instance = &assets.statics[*instance_idx as usize];
        for (i, (triangle, _)) in assets.mesh(instance.mesh).triangles().enumerate() {
            corners.push(corners_in(&origin_m, &instance.world_from_mesh, triangle));
            sources.push((*instance_idx, i as u32));
        }
    }
    Tile {
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

/// Box about an instance, relative to `origin_m`.
pub(crate) fn box_about(
    origin_m: &Point3<f64>,
    world_from_mesh: &Isometry3<f64>,
    (low, high): ([f32; 3], [f32; 3]),
) -> ([f32; 3], [f32; 3]) {
    let (low, high) = (
        Vector3::from(low.map(f64::from)),
        Vector3::from(high.map(f64::from)),
    );
    let centre = world_from_mesh * Point3::from(0.5 * (low + high)) - origin_m;
    let half = world_from_mesh.rotation.to_rotation_matrix().matrix().abs() * (0.5 * (high - low))
        + Vector3::repeat(BOX_MARGIN_M);
    (
        (centre - half).cast::<f32>().into(),
        (centre + half).cast::<f32>().into(),
    )
}

/// Whether a pose is one, and near enough for the hierarchies' `f32`.
fn is_finite(pose: &Isometry3<f64>) -> bool {
    pose.translation
        .vector
        .iter()
        .chain(pose.rotation.coords.iter())
        .all(|x| x.abs() < MAX_M)
}
