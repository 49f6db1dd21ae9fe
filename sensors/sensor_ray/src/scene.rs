//! The world as rays see it: scenery and moving instances, and what a ray hits.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;
use schema_types::{ActorId, Class, ObjectId};
use sensor_core::lanes::in_lanes;
use sensor_core::{DynamicInstance, Mesh, SceneAssets};

use crate::bundle::{Bundle, GROUP, Hits, NOWHERE};
use crate::cast::{Caster, OneBundle, Stacks};
use crate::tree::{BoxTree, TriangleTree};

/// Side of the squares in which scenery is put into one hierarchy: keeps `f32` coordinates fine to 0.06 mm.
const TILE_M: f64 = 1024.0;

/// Boxes of moving instances are widened by this, more than `f32` loses over a town.
const BOX_MARGIN_M: f64 = 2e-3;

/// What a ray hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray, metres.
    pub distance_m: f64,
    /// Unit normal of the triangle, turned towards the ray's origin.
    pub normal_in_world: Vector3<f64>,
    /// Semantic class.
    pub class: Class,
    /// Object: the triangle's own, else its instance's.
    pub object: ObjectId,
    /// [`sensor_core::Material`] number.
    pub material: u8,
    /// Velocity of what was hit (of its mesh's origin), m/s; zero for scenery.
    pub velocity_in_world_mps: Vector3<f64>,
}

impl Hit {
    /// Cosine between the incoming ray and the normal: 1 is head-on, never negative.
    pub fn cos_incidence(&self, direction: &Vector3<f64>) -> f64 {
        -direction.dot(&self.normal_in_world)
    }
}

/// The distance to the plane of what was hit, unless it is a sliver, which has no plane worth the name: its `f32` distance is as good as any.
#[inline(always)]
fn exact(plane_m: f64, found_m: f64) -> f64 {
    if (plane_m - found_m).abs() <= 0.01 + 0.01 * found_m { plane_m.max(0.0) } else { found_m }
}

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
    pub mesh_from_world: Isometry3<f64>,
    pub object: ObjectId,
    pub velocity_in_world_mps: Vector3<f64>,
}

/// Everything rays can hit in one tick.
///
/// [`RayScene::load`] once per episode, [`RayScene::update`] once per tick, then any number of casts from any thread.
#[derive(Debug)]
pub struct RayScene {
    episode: u32,
    /// Whether hierarchies are packed for the GPU too.
    for_gpu: bool,
    pub(crate) meshes: Vec<Arc<Mesh>>,
    /// By mesh; built at load for meshes that are no scenery, else when first seen moving.
    pub(crate) mesh_trees: Vec<Option<TriangleTree>>,
    pub(crate) statics: Vec<Placed>,
    pub(crate) tiles: Vec<Tile>,
    pub(crate) dynamics: Vec<Placed>,
    pub(crate) dynamics_origin_m: Point3<f64>,
    pub(crate) dynamics_tree: BoxTree,
}

impl RayScene {
    /// Builds the hierarchies of an episode: about a microsecond per triangle and core. Level of detail 0 only.
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
                mesh_from_world: instance.world_from_mesh.inverse(),
                object: instance.object,
                velocity_in_world_mps: Vector3::zeros(),
            })
            .collect();
        let squares: Vec<_> = squares(assets).into_iter().collect();
        let tiles = squares.par_iter().map(|(square, members)| tile(assets, *square, members, for_gpu)).collect();
        let build = |(mesh, is_scenery): (&Arc<Mesh>, &bool)| if *is_scenery { None } else { Some(mesh_tree(mesh, for_gpu)) };
        let mesh_trees = assets.meshes.par_iter().zip(&is_scenery).map(build).collect();
        RayScene {
            episode: assets.episode,
            for_gpu,
            meshes: assets.meshes.clone(),
            mesh_trees,
            statics,
            tiles,
            dynamics: Vec::new(),
            dynamics_origin_m: Point3::origin(),
            dynamics_tree: BoxTree::default(),
        }
    }

    /// Episode of the assets this was loaded from.
    pub fn episode(&self) -> u32 {
        self.episode
    }

    /// Triangles of the scenery.
    pub fn n_static_triangles(&self) -> usize {
        self.tiles.iter().map(|tile| tile.sources.len()).sum()
    }

    /// Puts the moving instances of a tick in place of those before. Instances whose pose is not finite are left out.
    pub fn update(&mut self, dynamics: &[DynamicInstance]) {
        let boxes = self.place(dynamics);
        self.dynamics_tree = BoxTree::new(&boxes);
    }

    /// The same for [`crate::GpuRays`] alone, which has a hierarchy of its own: rays that the processor casts meet nothing that moves until
    /// the next [`RayScene::update`].
    pub fn update_for_gpu(&mut self, dynamics: &[DynamicInstance]) {
        self.place(dynamics);
        self.dynamics_tree = BoxTree::default();
    }

    /// Takes over the instances and gives their boxes.
    fn place(&mut self, dynamics: &[DynamicInstance]) -> Vec<([f32; 3], [f32; 3])> {
        let mut boxes = Vec::with_capacity(dynamics.len());
        self.dynamics.clear();
        let first = dynamics.iter().find(|instance| is_finite(&instance.world_from_mesh));
        self.dynamics_origin_m = first.map_or(Point3::origin(), |i| i.world_from_mesh.translation.vector.into());
        for instance in dynamics {
            let mesh_idx = instance.mesh.0 as usize;
            let Some(mesh) = self.meshes.get(mesh_idx) else { continue };
            let tree = self.mesh_trees[mesh_idx].get_or_insert_with(|| mesh_tree(mesh, self.for_gpu));
            let (Some(bounds), true) = (tree.bounds(), is_finite(&instance.world_from_mesh)) else { continue };
            boxes.push(box_about(&self.dynamics_origin_m, &instance.world_from_mesh, bounds));
            self.dynamics.push(Placed {
                mesh_idx: instance.mesh.0,
                mesh_from_world: instance.world_from_mesh.inverse(),
                object: instance.actor.into(),
                velocity_in_world_mps: instance.velocity_in_world_mps,
            });
        }
        boxes
    }

    /// The nearest hit from `origin_m` along the unit vector `direction` within `max_m`. Both sides of triangles count.
    pub fn cast(&self, origin_m: &Point3<f64>, direction: &Vector3<f64>, max_m: f64) -> Option<Hit> {
        self.cast_ignoring(origin_m, direction, max_m, None)
    }

    /// As [`RayScene::cast`], through the parts of one actor.
    pub fn cast_ignoring(&self, origin_m: &Point3<f64>, direction: &Vector3<f64>, max_m: f64, ignored: Option<ActorId>) -> Option<Hit> {
        let mut caster = Caster { scene: self, ignored, stacks: Stacks::default() };
        let bundle = Bundle::new(&[Some(*direction)])?;
        let mut hits = Hits::new(&bundle, max_m);
        in_lanes(OneBundle { caster: &mut caster, origin_m, bundle: &bundle, hits: &mut hits });
        self.surface(&hits, &bundle, 0, origin_m, direction).filter(|hit| hit.distance_m <= max_m)
    }

    /// What a ray of a bundle has hit; `direction` is its unit vector in the world.
    #[inline(always)]
    pub(crate) fn surface(
        &self,
        hits: &Hits,
        bundle: &Bundle,
        ray: usize,
        origin_m: &Point3<f64>,
        direction: &Vector3<f64>,
    ) -> Option<Hit> {
        let (place, slot, found_m) = found(hits, bundle, ray)?;
        Some(self.resolve(place, slot, found_m, origin_m, direction))
    }

    /// How far away the hits of a group are; NaN without one. `directions` are unit vectors in the world, an axis at a time.
    #[inline(always)]
    pub(crate) fn distances_m(
        &self,
        hits: &Hits,
        bundle: &Bundle,
        group: usize,
        origin_m: &Point3<f64>,
        directions: &[[f64; GROUP]; 3],
    ) -> [f64; GROUP] {
        let mut corners = [[[0.0f64; GROUP]; 3]; 3];
        let mut found_m = [f64::NAN; GROUP];
        let mut moving = 0u32;
        for lane in 0..GROUP {
            let (place, slot) = (hits.place[group][lane], hits.slot[group][lane]);
            if place == NOWHERE {
                continue;
            }
            found_m[lane] = (hits.depth[group][lane] / bundle.depth[group][lane]) as f64;
            let Some(tile) = self.tiles.get(place as usize) else {
                moving |= 1 << lane;
                continue;
            };
            let (block, of_block) = (&tile.tree.blocks[slot as usize / GROUP], slot as usize % GROUP);
            for axis in 0..3 {
                let from = origin_m[axis] - tile.origin_m[axis];
                for (corner, of_all) in corners.iter_mut().zip(&block.corner) {
                    corner[axis][lane] = of_all[axis][of_block] as f64 - from;
                }
            }
        }
        let mut distances_m = plane_distances(&corners, directions);
        for lane in 0..GROUP {
            distances_m[lane] = exact(distances_m[lane], found_m[lane]);
            if moving >> lane & 1 != 0 {
                let direction = Vector3::new(directions[0][lane], directions[1][lane], directions[2][lane]);
                let (place, slot) = (hits.place[group][lane], hits.slot[group][lane]);
                distances_m[lane] = self.resolve(place, slot, found_m[lane], origin_m, &direction).distance_m;
            }
        }
        distances_m
    }

    /// Own object id (0: its instance's) and class of a mesh's triangle.
    pub(crate) fn labels(&self, mesh_idx: u32, triangle: u32) -> (u32, u8) {
        let mesh = &self.meshes[mesh_idx as usize];
        let vertex = &mesh.vertices[mesh.indices[mesh.lods[0].first_idx as usize + 3 * triangle as usize] as usize];
        (vertex.object_id, vertex.class)
    }

    /// What stands at a hit, its distance made exact: the plane of the mesh's own triangle, in the mesh's space, in `f64`.
    fn resolve(&self, place: u32, slot: u32, found_m: f64, origin_m: &Point3<f64>, direction: &Vector3<f64>) -> Hit {
        let (placed, triangle) = match self.tiles.get(place as usize) {
            Some(tile) => {
                let (instance, triangle) = tile.sources[tile.tree.number(slot) as usize];
                (&self.statics[instance as usize], triangle)
            }
            None => {
                let placed = &self.dynamics[place as usize - self.tiles.len()];
                let tree = self.mesh_trees[placed.mesh_idx as usize].as_ref().expect("what was hit has a hierarchy");
                (placed, tree.number(slot))
            }
        };
        let mesh = &self.meshes[placed.mesh_idx as usize];
        let first = mesh.lods[0].first_idx as usize + 3 * triangle as usize;
        let vertex = |i: usize| &mesh.vertices[mesh.indices[first + i] as usize];
        let corner = |i: usize| Point3::from(vertex(i).position_m.map(f64::from));
        let (v0, v1, v2) = (corner(0), corner(1), corner(2));
        let normal = (v1 - v0).cross(&(v2 - v0));
        let (origin, forward) = (placed.mesh_from_world * origin_m, placed.mesh_from_world.rotation * direction);
        let slope = normal.dot(&forward);
        let plane_m = normal.dot(&(v0 - origin)) / slope;
        let outwards = if slope > 0.0 { -normal } else { normal };
        let own = ObjectId(vertex(0).object_id);
        Hit {
            distance_m: exact(plane_m, found_m),
            normal_in_world: placed.mesh_from_world.rotation.inverse_transform_vector(&outwards).try_normalize(0.0).unwrap_or(-direction),
            class: Class(vertex(0).class),
            object: if own == ObjectId::BACKGROUND { placed.object } else { own },
            material: vertex(0).material,
            velocity_in_world_mps: placed.velocity_in_world_mps,
        }
    }
}

/// Place, slot and rough distance of what a ray has hit.
#[inline(always)]
fn found(hits: &Hits, bundle: &Bundle, ray: usize) -> Option<(u32, u32, f64)> {
    let (group, lane) = (ray / GROUP, ray % GROUP);
    let place = hits.place[group][lane];
    (place != NOWHERE).then(|| (place, hits.slot[group][lane], (hits.depth[group][lane] / bundle.depth[group][lane]) as f64))
}

/// Distances at which rays from the origin meet the planes of a triangle each.
#[inline(always)]
fn plane_distances(corners: &[[[f64; GROUP]; 3]; 3], directions: &[[f64; GROUP]; 3]) -> [f64; GROUP] {
    let [a, b, c] = corners;
    let mut distances = [0.0; GROUP];
    for lane in 0..GROUP {
        let (x1, y1, z1) = (b[0][lane] - a[0][lane], b[1][lane] - a[1][lane], b[2][lane] - a[2][lane]);
        let (x2, y2, z2) = (c[0][lane] - a[0][lane], c[1][lane] - a[1][lane], c[2][lane] - a[2][lane]);
        let (x, y, z) = (y1 * z2 - z1 * y2, z1 * x2 - x1 * z2, x1 * y2 - y1 * x2);
        let above = x * a[0][lane] + y * a[1][lane] + z * a[2][lane];
        distances[lane] = above / (x * directions[0][lane] + y * directions[1][lane] + z * directions[2][lane]);
    }
    distances
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
            let centre = instance.world_from_mesh * Point3::from(assets.mesh(instance.mesh).centre_m.map(f64::from));
            let square = ((centre.x / TILE_M).round() as i64, (centre.y / TILE_M).round() as i64);
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
            corners.push(triangle.map(|corner| {
                let at: Vector3<f64> = instance.world_from_mesh * Point3::from(corner.map(f64::from)) - origin_m;
                at.cast::<f32>().into()
            }));
            sources.push((*instance_idx, i as u32));
        }
    }
    Tile { origin_m, tree: TriangleTree::new(&corners, for_gpu), sources }
}

/// Box about an instance, relative to `origin_m`.
pub(crate) fn box_about(
    origin_m: &Point3<f64>,
    world_from_mesh: &Isometry3<f64>,
    (low, high): ([f32; 3], [f32; 3]),
) -> ([f32; 3], [f32; 3]) {
    let (low, high) = (Vector3::from(low.map(f64::from)), Vector3::from(high.map(f64::from)));
    let centre = world_from_mesh * Point3::from(0.5 * (low + high)) - origin_m;
    let half = world_from_mesh.rotation.to_rotation_matrix().matrix().abs() * (0.5 * (high - low)) + Vector3::repeat(BOX_MARGIN_M);
    ((centre - half).cast::<f32>().into(), (centre + half).cast::<f32>().into())
}

fn is_finite(pose: &Isometry3<f64>) -> bool {
    pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|x| x.is_finite())
}
