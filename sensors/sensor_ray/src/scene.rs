//! The world as rays see it: scenery and moving instances, and what a ray hits.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use rayon::prelude::*;
use schema_types::{ActorId, Class, ObjectId};
use sensor_core::{DynamicInstance, Mesh, SceneAssets};

use crate::bvh::{BoxTree, TriangleTree};
use crate::packet::{NOWHERE, Packet};

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

impl Hit {
    /// A hit of which only the distance is known.
    fn at(distance_m: f64) -> Hit {
        Hit {
            distance_m,
            normal_in_world: Vector3::zeros(),
            class: Class::UNLABELED,
            object: ObjectId::BACKGROUND,
            material: 0,
            velocity_in_world_mps: Vector3::zeros(),
        }
    }
}

/// The distance to the plane of what was hit, unless it is a sliver, which has no plane worth the name: its `f32` distance is as good as any.
#[inline(always)]
fn exact(plane_m: f64, found_m: f32) -> f64 {
    let found_m = found_m as f64;
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
    pub(crate) meshes: Vec<Arc<Mesh>>,
    /// By mesh; built at load for meshes that are no scenery, else when first seen moving.
    pub(crate) mesh_trees: Vec<Option<TriangleTree>>,
    pub(crate) statics: Vec<Placed>,
    pub(crate) tiles: Vec<Tile>,
    pub(crate) dynamics: Vec<Placed>,
    dynamics_origin_m: Point3<f64>,
    dynamics_tree: BoxTree,
}

impl RayScene {
    /// Builds the hierarchies of an episode: about a microsecond per triangle and core. Level of detail 0 only.
    pub fn load(assets: &SceneAssets) -> Self {
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
        let tiles = squares.par_iter().map(|(square, members)| tile(assets, *square, members)).collect();
        let build = |(mesh, is_scenery): (&Arc<Mesh>, &bool)| if *is_scenery { None } else { Some(mesh_tree(mesh)) };
        let mesh_trees = assets.meshes.par_iter().zip(&is_scenery).map(build).collect();
        RayScene {
            episode: assets.episode,
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
        let mut boxes = Vec::with_capacity(dynamics.len());
        self.dynamics.clear();
        self.dynamics_origin_m = dynamics.first().map_or(Point3::origin(), |i| i.world_from_mesh.translation.vector.into());
        for instance in dynamics {
            let mesh_idx = instance.mesh.0 as usize;
            let Some(mesh) = self.meshes.get(mesh_idx) else { continue };
            let tree = self.mesh_trees[mesh_idx].get_or_insert_with(|| mesh_tree(mesh));
            let (Some(bounds), true) = (tree.bounds(), is_finite(&instance.world_from_mesh)) else { continue };
            boxes.push(box_about(&self.dynamics_origin_m, &instance.world_from_mesh, bounds));
            self.dynamics.push(Placed {
                mesh_idx: instance.mesh.0,
                mesh_from_world: instance.world_from_mesh.inverse(),
                object: instance.actor.into(),
                velocity_in_world_mps: instance.velocity_in_world_mps,
            });
        }
        self.dynamics_tree = BoxTree::new(&boxes);
    }

    /// The nearest hit from `origin_m` along the unit vector `direction` within `max_m`. Both sides of triangles count.
    pub fn cast(&self, origin_m: &Point3<f64>, direction: &Vector3<f64>, max_m: f64) -> Option<Hit> {
        self.cast_ignoring(origin_m, direction, max_m, None)
    }

    /// As [`RayScene::cast`], through the parts of one actor.
    pub fn cast_ignoring(&self, origin_m: &Point3<f64>, direction: &Vector3<f64>, max_m: f64, ignored: Option<ActorId>) -> Option<Hit> {
        let rays = Rays::<1> { origins_m: [*origin_m], directions: [*direction], active: [true], max_m };
        let [hit] = self.cast_packet::<1, true>(&rays, ignored, &mut Stacks::default());
        hit
    }

    /// The nearest hits of neighbouring rays. Without `SURFACE` only their distances count; the rest of a hit is left blank.
    #[inline(always)]
    pub(crate) fn cast_packet<const N: usize, const SURFACE: bool>(
        &self,
        rays: &Rays<N>,
        ignored: Option<ActorId>,
        stacks: &mut Stacks,
    ) -> [Option<Hit>; N] {
        let mut packet = Packet::<N>::empty();
        for lane in 0..N {
            // A little beyond the limit: the exact distance decides below.
            packet.far[lane] = if rays.active[lane] { (rays.max_m * (1.0 + 1e-6) + 1e-3) as f32 } else { -1.0 };
        }
        for (place, tile) in self.tiles.iter().enumerate() {
            rays.aim_about(&tile.origin_m, &mut packet);
            tile.tree.intersect(&mut packet, place as u32, &mut stacks.triangles);
        }
        self.cast_dynamics(rays, ignored, &mut packet, stacks);
        std::array::from_fn(|lane| {
            let place = packet.place[lane];
            if place == NOWHERE {
                return None;
            }
            let (slot, found_m, origin_m, direction) =
                (packet.triangle[lane], packet.far[lane], &rays.origins_m[lane], &rays.directions[lane]);
            let hit = match (SURFACE, self.tiles.get(place as usize)) {
                (false, Some(tile)) => Hit::at(exact(tile.tree.plane_distance(slot, &(origin_m - tile.origin_m), direction), found_m)),
                _ => self.resolve(place, slot, found_m, origin_m, direction),
            };
            (hit.distance_m <= rays.max_m).then_some(hit)
        })
    }

    #[inline(always)]
    fn cast_dynamics<const N: usize>(&self, rays: &Rays<N>, ignored: Option<ActorId>, packet: &mut Packet<N>, stacks: &mut Stacks) {
        if self.dynamics.is_empty() {
            return;
        }
        let ignored = ignored.map(ObjectId::from);
        rays.aim_about(&self.dynamics_origin_m, packet);
        let Stacks { boxes, triangles } = stacks;
        self.dynamics_tree.visit(packet, boxes, |packet, idx| {
            let placed = &self.dynamics[idx as usize];
            if Some(placed.object) == ignored {
                return;
            }
            let Some(tree) = &self.mesh_trees[placed.mesh_idx as usize] else { return };
            let mut local = Packet::<N>::empty();
            rays.aim_in(&placed.mesh_from_world, &mut local);
            local.take_hits(packet);
            tree.intersect(&mut local, self.tiles.len() as u32 + idx, triangles);
            packet.take_hits(&local);
        });
    }

    /// What stands at a hit, its distance made exact: the plane of the mesh's own triangle, in the mesh's space, in `f64`.
    fn resolve(&self, place: u32, slot: u32, distance_m: f32, origin_m: &Point3<f64>, direction: &Vector3<f64>) -> Hit {
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
        let exact_m = normal.dot(&(v0 - origin)) / slope;
        let outwards = if slope > 0.0 { -normal } else { normal };
        let own = ObjectId(vertex(0).object_id);
        Hit {
            distance_m: exact(exact_m, distance_m),
            normal_in_world: placed.mesh_from_world.rotation.inverse_transform_vector(&outwards).try_normalize(0.0).unwrap_or(-direction),
            class: Class(vertex(0).class),
            object: if own == ObjectId::BACKGROUND { placed.object } else { own },
            material: vertex(0).material,
            velocity_in_world_mps: placed.velocity_in_world_mps,
        }
    }
}

/// Neighbouring rays of one packet, in the world.
pub(crate) struct Rays<const N: usize> {
    pub origins_m: [Point3<f64>; N],
    /// Unit vectors.
    pub directions: [Vector3<f64>; N],
    /// Lanes in use.
    pub active: [bool; N],
    pub max_m: f64,
}

impl<const N: usize> Rays<N> {
    /// Sets the packet's rays in world axes about a near origin.
    #[inline(always)]
    fn aim_about(&self, origin_m: &Point3<f64>, packet: &mut Packet<N>) {
        for lane in 0..N {
            let from: Vector3<f64> = self.origins_m[lane] - origin_m;
            packet.aim(lane, from.cast::<f32>().into(), self.directions[lane].cast::<f32>().into());
        }
    }

    /// Sets the packet's rays in a mesh's space.
    #[inline(always)]
    fn aim_in(&self, mesh_from_world: &Isometry3<f64>, packet: &mut Packet<N>) {
        let rotation: Matrix3<f64> = *mesh_from_world.rotation.to_rotation_matrix().matrix();
        for lane in 0..N {
            let origin = rotation * self.origins_m[lane].coords + mesh_from_world.translation.vector;
            packet.aim(lane, origin.cast::<f32>().into(), (rotation * self.directions[lane]).cast::<f32>().into());
        }
    }
}

/// Memory of a walk, reused from packet to packet.
#[derive(Debug, Default)]
pub(crate) struct Stacks {
    triangles: Vec<(u32, f32)>,
    boxes: Vec<(u32, f32)>,
}

fn mesh_tree(mesh: &Arc<Mesh>) -> TriangleTree {
    let corners: Vec<_> = mesh.triangles().map(|(corners, _)| corners).collect();
    TriangleTree::new(&corners)
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
fn tile(assets: &SceneAssets, square: (i64, i64), members: &[u32]) -> Tile {
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
    Tile { origin_m, tree: TriangleTree::new(&corners), sources }
}

/// Box about an instance, relative to `origin_m`.
fn box_about(origin_m: &Point3<f64>, world_from_mesh: &Isometry3<f64>, (low, high): ([f32; 3], [f32; 3])) -> ([f32; 3], [f32; 3]) {
    let (low, high) = (Vector3::from(low.map(f64::from)), Vector3::from(high.map(f64::from)));
    let centre = world_from_mesh * Point3::from(0.5 * (low + high)) - origin_m;
    let half = world_from_mesh.rotation.to_rotation_matrix().matrix().abs() * (0.5 * (high - low)) + Vector3::repeat(BOX_MARGIN_M);
    ((centre - half).cast::<f32>().into(), (centre + half).cast::<f32>().into())
}

fn is_finite(pose: &Isometry3<f64>) -> bool {
    pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|x| x.is_finite())
}
