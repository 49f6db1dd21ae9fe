//! Meshes at their places in the world.

use nalgebra::{Isometry3, Point3, Vector3};
use schema_types::{Class, ObjectId};
use sensor_core::{Mesh, MeshId};

use crate::bvh::Bounds;

/// Boxes of moving instances are widened by this: more than the rounding error of `f32` anywhere in
/// a town.
const BOX_MARGIN_M: f64 = 2e-3;

/// Farther from the origin than this nothing is seen: the square of a larger distance does not fit
/// an `f32`.
const MAX_M: f64 = 1e18;

/// [`Placed::first_leg`] of what stands still.
pub(crate) const NO_LEG: u32 = u32::MAX;

/// A mesh at a place in the world.
#[derive(Debug)]
pub(crate) struct Placed {
    pub mesh_idx: u32,
    pub world_from_mesh: Isometry3<f64>,
    pub mesh_from_world: Isometry3<f64>,
    pub object: ObjectId,
    pub velocity_in_world_mps: Vector3<f64>,
    /// First leg of its way through the ticks before; [`NO_LEG`] if it stands still.
    pub first_leg: u32,
}

impl Placed {
    /// A mesh that stands still.
    #[inline]
    pub fn new(mesh: MeshId, world_from_mesh: &Isometry3<f64>, object: ObjectId) -> Self {
        Placed {
            mesh_idx: mesh.0,
            world_from_mesh: *world_from_mesh,
            mesh_from_world: world_from_mesh.inverse(),
            object,
            velocity_in_world_mps: Vector3::zeros(),
            first_leg: NO_LEG,
        }
    }

    /// The object that a triangle of this instance shows: its own, if it has one.
    #[inline(always)]
    pub fn object_of(&self, own: ObjectId) -> ObjectId {
        if own == ObjectId::BACKGROUND {
            self.object
        } else {
            own
        }
    }

    /// Labels of a triangle as this instance shows them.
    #[inline]
    pub fn labels(&self, of_mesh: Labels) -> Labels {
        Labels {
            object: self.object_of(of_mesh.object),
            ..of_mesh
        }
    }
}

/// Object and class of a triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Labels {
    /// In a mesh: `BACKGROUND` where the triangle takes the object of its instance.
    pub object: ObjectId,
    pub class: Class,
}

impl Labels {
    /// Labels of a mesh's triangle.
    #[inline]
    pub fn of(mesh: &Mesh, triangle: u32) -> Labels {
        let [first, ..] = mesh.triangle(triangle as usize);
        Labels {
            object: ObjectId(first.object_id),
            class: Class(first.class),
        }
    }
}

/// Box about an instance, relative to `origin_m`.
#[inline]
pub(crate) fn box_about(
    origin_m: &Point3<f64>,
    world_from_mesh: &Isometry3<f64>,
    (low, high): Bounds,
) -> Bounds {
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

/// Whether all numbers of a pose are finite and small enough for the hierarchies' `f32`.
#[inline]
pub(crate) fn is_finite(pose: &Isometry3<f64>) -> bool {
    pose.translation
        .vector
        .iter()
        .chain(pose.rotation.coords.iter())
        .all(|x| x.abs() < MAX_M)
}
