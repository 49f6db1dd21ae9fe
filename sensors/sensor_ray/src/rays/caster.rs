//! Casts bundles of rays into a scene: first against its scenery, then against what moves.

use nalgebra::{Matrix3, Point3, Vector3};
use schema_types::{ActorId, ObjectId};
use sensor_core::vector_lanes::{LaneWork, Lanes};

use super::bundle::{Bundle, Hits};
use super::walk::{BundleAxes, Leaves, Stack, walk};
use crate::ray_scene::{Moment, RayScene};

/// Casts bundles of rays into a scene, one after the other.
#[derive(Debug)]
pub(crate) struct Caster<'s> {
    pub scene: &'s RayScene,
    /// Rays pass through the parts of this actor.
    pub ignored: Option<ActorId>,
    /// When the next rays are fired; `None` is at the tick.
    pub moment: Option<Moment>,
    pub stacks: Stacks,
}

/// Stacks of the walks, reused from bundle to bundle.
#[derive(Debug, Default)]
pub(crate) struct Stacks {
    triangles: Stack,
    boxes: Stack,
}

impl Caster<'_> {
    /// Finds the nearest hits of a bundle; `world_from_bundle` turns its space into the world's.
    #[inline(always)]
    pub fn cast<L: Lanes>(
        &mut self,
        origin_m: &Point3<f64>,
        world_from_bundle: &Matrix3<f64>,
        bundle: &Bundle,
        hits: &mut Hits,
    ) {
        let scene = self.scene;
        let basis = bundle.basis.map(|axis| world_from_bundle * axis);
        for (place, tile) in scene.scenery.tiles.iter().enumerate() {
            let axes = BundleAxes::new(&(origin_m - tile.origin_m), &basis);
            tile.tree.intersect::<L>(
                &axes,
                bundle,
                hits,
                place as u32,
                &mut self.stacks.triangles,
            );
        }
        if scene.dynamics.is_empty() {
            return;
        }
        let axes = BundleAxes::new(&(origin_m - scene.dynamics_origin_m), &basis);
        let ignored = self.ignored.map(ObjectId::from);
        let mut instances = Instances {
            scene,
            ignored,
            moment: self.moment,
            origin_m,
            basis: &basis,
            stack: &mut self.stacks.triangles,
        };
        let tree = match self.moment {
            Some(_) => &scene.swept_tree,
            None => &scene.dynamics_tree,
        };
        walk::<L>(
            tree,
            &axes,
            bundle,
            hits,
            &mut self.stacks.boxes,
            &mut instances,
        );
    }
}

/// Moving instances at the leaves.
struct Instances<'s> {
    scene: &'s RayScene,
    ignored: Option<ObjectId>,
    moment: Option<Moment>,
    origin_m: &'s Point3<f64>,
    basis: &'s [Vector3<f64>; 3],
    stack: &'s mut Stack,
}

impl Leaves for Instances<'_> {
    #[inline(always)]
    fn prefetch<L: Lanes>(&self, _: u32) {}

    #[inline(always)]
    fn visit<L: Lanes>(&mut self, bundle: &Bundle, hits: &mut Hits, leaf: u32) {
        let placed = &self.scene.dynamics[leaf as usize];
        if Some(placed.object) == self.ignored {
            return;
        }
        let Some(tree) = &self.scene.mesh_trees[placed.mesh_idx as usize] else {
            return;
        };
        let (rotation, origin): (Matrix3<f64>, _) = match self.scene.motion.leg(placed, self.moment)
        {
            Some((leg, share)) => {
                let (at_m, rotation) = leg.at(share);
                (rotation, rotation * (self.origin_m.coords - at_m))
            }
            None => {
                let mesh_from_world = &placed.mesh_from_world;
                let rotation = *mesh_from_world.rotation.to_rotation_matrix().matrix();
                let origin = rotation * self.origin_m.coords + mesh_from_world.translation.vector;
                (rotation, origin)
            }
        };
        let axes = BundleAxes::new(&origin, &self.basis.map(|axis| rotation * axis));
        tree.intersect::<L>(
            &axes,
            bundle,
            hits,
            self.scene.scenery.tiles.len() as u32 + leaf,
            self.stack,
        );
    }
}

/// A single bundle whose space has the axes of the world.
pub(crate) struct OneBundle<'c, 's> {
    pub caster: &'c mut Caster<'s>,
    pub origin_m: &'c Point3<f64>,
    pub bundle: &'c Bundle,
    pub hits: &'c mut Hits,
}

impl LaneWork for OneBundle<'_, '_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        self.hits.begin::<L>();
        self.caster
            .cast::<L>(self.origin_m, &Matrix3::identity(), self.bundle, self.hits);
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;
    use schema_types::Class;
    use sensor_core::mesh::Surface;
    use sensor_core::vector_lanes::{in_arrays, in_lanes};
    use sensor_core::{Material, MeshBuilder, SceneAssets, StaticInstance};

    use super::*;
    use crate::rays::bundle::RAYS;

    fn random(rng: &mut fastrand::Rng, scale: f64) -> Vector3<f64> {
        Vector3::new(rng.f64() - 0.5, rng.f64() - 0.5, rng.f64() - 0.5) * scale
    }

    #[test]
    fn vectors_and_arrays_hit_the_same_triangles_at_the_same_depths() {
        let mut rng = fastrand::Rng::with_seed(8);
        let mut builder = MeshBuilder::new("loose");
        let surface = Surface::new(Class::BUILDINGS, Material::Matte, [128; 3]);
        for _ in 0..2000 {
            let centre = random(&mut rng, 60.0);
            builder.triangle(
                surface,
                std::array::from_fn(|_| (centre + random(&mut rng, 5.0)).cast::<f32>().into()),
            );
        }
        let mut assets = SceneAssets::default();
        let mesh = assets.add_mesh(builder.finish());
        assets.statics.push(StaticInstance {
            mesh,
            world_from_mesh: Isometry3::identity(),
            object: ObjectId::scenery(1),
        });
        let scene = RayScene::load(&assets);
        let mut n_hits = 0;
        for _ in 0..300 {
            let (axis, width) = (random(&mut rng, 1.0).normalize(), rng.f64());
            let directions: Vec<_> = (0..RAYS)
                .map(|_| Some((axis + random(&mut rng, width)).normalize()))
                .collect();
            let Some(bundle) = Bundle::new(&directions) else {
                continue;
            };
            let origin_m = random(&mut rng, 40.0).into();
            let mut hits = [Hits::new(&bundle, 50.0), Hits::new(&bundle, 50.0)];
            for (i, hits) in hits.iter_mut().enumerate() {
                let mut caster = Caster {
                    scene: &scene,
                    ignored: None,
                    moment: None,
                    stacks: Stacks::default(),
                };
                let work = OneBundle {
                    caster: &mut caster,
                    origin_m: &origin_m,
                    bundle: &bundle,
                    hits,
                };
                if i == 0 {
                    in_lanes(work)
                } else {
                    in_arrays(work)
                }
            }
            let [a, b] = hits;
            assert_eq!(
                a.depth.map(|x| x.map(f32::to_bits)),
                b.depth.map(|x| x.map(f32::to_bits))
            );
            assert_eq!((a.slot, a.place), (b.slot, b.place));
            n_hits += a
                .place
                .iter()
                .flatten()
                .filter(|place| **place == 0)
                .count();
        }
        assert!(n_hits > 3000, "{n_hits} hits");
    }
}
