//! Random scenes, and a loop over every triangle in `f64`.

#![allow(dead_code, reason = "each test file uses its part")]

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use schema_types::{ActorId, Class, ObjectId};
use sensor_core::mesh::Surface;
use sensor_core::{DynamicInstance, Material, Mesh, MeshBuilder};

pub fn surface(class: Class) -> Surface {
    Surface::new(class, Material::Matte, [128; 3])
}

pub fn cuboid(class: Class, half_m: [f32; 3]) -> Mesh {
    let mut builder = MeshBuilder::new("box");
    builder.cuboid(surface(class), [0.0; 3], half_m);
    builder.finish()
}

pub fn moving(
    mesh: sensor_core::MeshId,
    actor: u32,
    world_from_mesh: Isometry3<f64>,
) -> DynamicInstance {
    DynamicInstance {
        actor: ActorId(actor),
        part: 0,
        mesh,
        world_from_mesh,
        tint_rgb: [0; 3],
        lamps: 0,
        velocity_in_world_mps: Vector3::new(actor as f64, 0.0, 0.0),
    }
}

pub fn random_pose(rng: &mut fastrand::Rng, centre: [f64; 3], spread_m: f64) -> Isometry3<f64> {
    let mut side = || (rng.f64() - 0.5) * 2.0;
    let at = Translation3::new(
        centre[0] + side() * spread_m,
        centre[1] + side() * spread_m,
        centre[2] + side() * spread_m,
    );
    Isometry3::from_parts(
        at,
        UnitQuaternion::from_euler_angles(side() * 3.0, side() * 1.5, side() * 3.0),
    )
}

pub fn random_direction(rng: &mut fastrand::Rng) -> Vector3<f64> {
    loop {
        let v = Vector3::new(rng.f64() - 0.5, rng.f64() - 0.5, rng.f64() - 0.5);
        if v.norm() > 0.05 {
            return v.normalize();
        }
    }
}

/// A mesh of loose triangles, each its own object and class.
pub fn loose_triangles(rng: &mut fastrand::Rng, n: u32, first_object: u32) -> Mesh {
    let mut builder = MeshBuilder::new("loose");
    for i in 0..n {
        let mut side = |scale: f32| (rng.f32() - 0.5) * scale;
        let centre = [side(24.0), side(24.0), side(24.0)];
        let corners = std::array::from_fn(|_| {
            [
                centre[0] + side(6.0),
                centre[1] + side(6.0),
                centre[2] + side(6.0),
            ]
        });
        builder.triangle(
            surface(Class((i % 29) as u8)).of(ObjectId::scenery(first_object + i)),
            corners,
        );
    }
    builder.finish()
}

/// Nearest (distance, object, class) by testing every triangle in the world in `f64`.
pub fn brute_force(
    world: &[(Isometry3<f64>, &Mesh, ObjectId)],
    origin: &Point3<f64>,
    direction: &Vector3<f64>,
    max_m: f64,
) -> Option<(f64, ObjectId, Class)> {
    let mut best: Option<(f64, ObjectId, Class)> = None;
    for (world_from_mesh, mesh, own) in world {
        for (corners, vertex) in mesh.triangles() {
            let [a, b, c] = corners.map(|p| world_from_mesh * Point3::from(p.map(f64::from)));
            let (e1, e2) = (b - a, c - a);
            let p = direction.cross(&e2);
            let determinant = e1.dot(&p);
            let s = origin - a;
            let u = s.dot(&p) / determinant;
            let q = s.cross(&e1);
            let v = direction.dot(&q) / determinant;
            let t = e2.dot(&q) / determinant;
            if u >= 0.0
                && v >= 0.0
                && u + v <= 1.0
                && t >= 0.0
                && t <= best.map_or(max_m, |(d, ..)| d)
            {
                let object = if vertex.object_id == 0 {
                    *own
                } else {
                    ObjectId(vertex.object_id)
                };
                best = Some((t, object, Class(vertex.class)));
            }
        }
    }
    best
}
