//! What rays can hit in one tick: the scenery of the episode and the instances that move.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use nalgebra::Point3;
use rayon::prelude::*;
use sensor_core::{DynamicInstance, Mesh, Past, SceneAssets};

use crate::bvh::{Bounds, Tree, TriangleTree, moving_tree};

mod hidden;
mod motion;
mod placed;
mod scenery;

pub(crate) use hidden::{CHUNK, Hiding};
pub(crate) use motion::{Leg, Moment, Motion};
pub(crate) use placed::{Labels, NO_LEG, Placed, box_about, is_finite};
pub(crate) use scenery::Scenery;

/// Number of scenes built so far: tells a GPU whether it holds the triangles of this scene.
static N_BUILT: AtomicU64 = AtomicU64::new(0);

/// Everything rays can hit in one tick.
///
/// [`RayScene::load`] once per episode, [`RayScene::update`] once per tick, then any number of
/// casts from any thread.
#[derive(Debug)]
pub struct RayScene {
    episode: u32,
    /// Serial number of this scene in the process.
    pub(crate) serial: u64,
    /// Whether hierarchies are also packed for the GPU.
    for_gpu: bool,
    pub(crate) scenery: Scenery,
    /// By mesh. Meshes that no scenery uses get their hierarchy at load, others when they are first
    /// seen moving.
    pub(crate) mesh_trees: Vec<Option<TriangleTree>>,
    /// Which objects of the scenery are hidden.
    pub(crate) hiding: Hiding,
    pub(crate) dynamics: Vec<Placed>,
    /// For each actor: the index into `dynamics` after its last part.
    pub(crate) actor_ends: Vec<u32>,
    pub(crate) dynamics_origin_m: Point3<f64>,
    /// Over the moving instances as they are at the tick.
    pub(crate) dynamics_tree: Tree,
    /// How they got there.
    pub(crate) motion: Motion,
    /// Over all places on their ways; empty if nothing moved.
    pub(crate) swept_tree: Tree,
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
            scenery: Scenery::new(assets, for_gpu),
            mesh_trees,
            hiding: Hiding::new(&assets.hidden),
            dynamics: Vec::new(),
            actor_ends: Vec::new(),
            dynamics_origin_m: Point3::origin(),
            dynamics_tree: Tree::default(),
            motion: Motion::default(),
            swept_tree: Tree::default(),
        }
    }

    /// Hides the objects that `assets` leave out of the scenery and shows the rest; the cost grows
    /// with what changed. False if that needs new hierarchies: for another episode, or if an object
    /// is to be shown that was hidden when this scene was loaded.
    #[must_use]
    pub fn hide(&mut self, assets: &SceneAssets) -> bool {
        let fits = assets.episode == self.episode
            && assets.meshes.len() == self.scenery.meshes.len()
            && self.hiding.can_hide(&assets.hidden);
        if fits {
            self.hiding.set(&assets.hidden, &mut self.scenery);
        }
        fits
    }

    /// Takes over streamed scenery of the same episode that holds other tiles; only those that came
    /// are built. False, with nothing changed, if the instances are others.
    #[must_use]
    pub fn stream(&mut self, assets: &SceneAssets) -> bool {
        let fits = assets.streamed
            && assets.episode == self.episode
            && assets.meshes.len() == self.scenery.meshes.len()
            && assets.statics.len() == self.scenery.statics.len()
            && self.hiding.is_hiding(&assets.hidden);
        if fits {
            let kept = std::mem::take(&mut self.scenery.tiles);
            self.scenery = Scenery::with_kept(assets, self.for_gpu, kept);
            self.hiding = Hiding::new(&assets.hidden);
            self.serial = N_BUILT.fetch_add(1, Ordering::Relaxed);
        }
        fits
    }

    /// Episode of the assets this was loaded from.
    pub fn episode(&self) -> u32 {
        self.episode
    }

    /// Triangles of the scenery.
    pub fn n_static_triangles(&self) -> usize {
        self.scenery
            .tiles
            .iter()
            .map(|tile| tile.sources.len())
            .sum()
    }

    /// Replaces the moving instances by those of a new tick; the parts of an actor follow one
    /// another. Instances whose pose is not finite, or farther than 10¹⁸ m away, are left out.
    pub fn update(&mut self, dynamics: &[DynamicInstance]) {
        self.update_moving(dynamics, &Past::default());
    }

    /// As [`RayScene::update`], for lidars whose rays are fired before the tick, too: they see the
    /// instances where they were then. What does so is a matter of the lidar
    /// ([`crate::Lidar::set_past`]); all other rays see them as they are at the tick.
    pub fn update_moving(&mut self, dynamics: &[DynamicInstance], past: &Past) {
        self.place(dynamics, past);
        let boxes: Vec<Bounds> = self
            .dynamics
            .iter()
            .map(|placed| self.bounds_of(placed, &self.dynamics_origin_m))
            .collect();
        self.dynamics_tree = moving_tree(&boxes, &self.actor_ends);
        self.swept_tree = match self.motion.legs.is_empty() {
            true => Tree::default(),
            false => moving_tree(
                &self.swept_boxes(&boxes, &self.dynamics_origin_m),
                &self.actor_ends,
            ),
        };
    }

    /// As [`RayScene::update_moving`], but only for [`crate::GpuRays`], which builds its own
    /// hierarchies over the instances. Rays cast on the CPU hit nothing that moves until the next
    /// update for them.
    pub fn update_for_gpu(&mut self, dynamics: &[DynamicInstance], past: &Past) {
        self.place(dynamics, past);
        (self.dynamics_tree, self.swept_tree) = Default::default();
    }

    /// Stores the instances of a tick, and their ways through the ticks before.
    fn place(&mut self, dynamics: &[DynamicInstance], past: &Past) {
        self.dynamics.clear();
        self.actor_ends.clear();
        self.motion.clear();
        let is_here = |instance: &&DynamicInstance| is_finite(&instance.world_from_mesh);
        self.dynamics_origin_m = dynamics.iter().find(is_here).map_or(Point3::origin(), |i| {
            i.world_from_mesh.translation.vector.into()
        });
        let n_ages = past.ages_nanos.len();
        let mut moved = past
            .moved
            .iter()
            .zip(past.poses.chunks_exact(n_ages.max(1)))
            .peekable();
        for (place, instance) in (0..).zip(dynamics) {
            let way = moved
                .next_if(|(moved, _)| **moved == place)
                .map(|(_, way)| way)
                .filter(|way| way.iter().all(is_finite));
            if !is_here(&instance) {
                continue;
            }
            let mesh_idx = instance.mesh.0 as usize;
            let Some(mesh) = self.scenery.meshes.get(mesh_idx) else {
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
            let first_leg = way.map_or(NO_LEG, |way| {
                self.motion.add(&instance.world_from_mesh, way)
            });
            self.dynamics.push(Placed {
                velocity_in_world_mps: instance.velocity_in_world_mps,
                first_leg,
                ..Placed::new(instance.mesh, &instance.world_from_mesh, object)
            });
            *self.actor_ends.last_mut().expect("the actor has an end") = self.dynamics.len() as u32;
        }
        if !self.motion.legs.is_empty() {
            self.motion.ages_nanos.extend_from_slice(&past.ages_nanos);
        }
    }

    /// The boxes of all moving instances, widened by all places on their ways.
    pub(crate) fn swept_boxes(&self, boxes: &[Bounds], origin_m: &Point3<f64>) -> Vec<Bounds> {
        let widen = |(placed, bounds): (&Placed, &Bounds)| {
            self.motion
                .sweep(placed, origin_m, self.mesh_bounds(placed), *bounds)
        };
        self.dynamics.iter().zip(boxes).map(widen).collect()
    }

    fn mesh_bounds(&self, placed: &Placed) -> Bounds {
        let tree = self.mesh_trees[placed.mesh_idx as usize].as_ref();
        tree.and_then(TriangleTree::bounds)
            .expect("what moves has triangles")
    }

    /// Box about a moving instance, relative to `origin_m`.
    pub(crate) fn bounds_of(&self, placed: &Placed, origin_m: &Point3<f64>) -> Bounds {
        box_about(origin_m, &placed.world_from_mesh, self.mesh_bounds(placed))
    }
}

fn mesh_tree(mesh: &Arc<Mesh>, for_gpu: bool) -> TriangleTree {
    let corners: Vec<_> = mesh.triangles().map(|(corners, _)| corners).collect();
    TriangleTree::new(&corners, for_gpu)
}
