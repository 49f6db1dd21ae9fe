//! Casts rays for a command through the current scene.

use anyhow::{bail, ensure};
use nalgebra::{Point3, Vector3};
use schema_frames::query::MAX_RAYS;
use schema_frames::{CommandReply, RayHit, RaySegment};
use sensor_ray::{Hit, RayScene};

use crate::clock::Clock;
use crate::sensing::Sensing;
use crate::world::LiveWorld;

/// Longest ray, metres.
const MAX_LENGTH_M: f64 = 10_000.0;

/// The nearest surfaces that each ray meets, at most `max_hits`.
pub fn cast(
    world: &mut LiveWorld,
    sensing: &mut Sensing,
    clock: &Clock,
    rays: &[RaySegment],
    max_hits: usize,
) -> anyhow::Result<CommandReply> {
    ensure!(
        rays.len() <= MAX_RAYS,
        "{} rays are asked for, at most {MAX_RAYS} are cast at once",
        rays.len()
    );
    let mut aimed = Vec::with_capacity(rays.len());
    for ray in rays {
        aimed.push(aim(ray)?);
    }
    let asked: Vec<_> = aimed
        .iter()
        .flatten()
        .map(|ray| (ray.from_m, ray.direction, ray.length_m))
        .collect();
    world.stream_for_rays(sensing.sensors_mut(), &asked, clock);
    let scene = world.scene(clock);
    let scene = sensing.sensors_mut().rays(&scene);
    let rays = aimed
        .iter()
        .map(|ray| {
            ray.as_ref()
                .map_or(Vec::new(), |ray| hits(scene, ray, max_hits))
        })
        .collect();
    Ok(CommandReply::Hits { rays })
}

/// A ray with a length.
struct AimedRay {
    from_m: Point3<f64>,
    direction: Vector3<f64>,
    length_m: f64,
}

/// Checks a ray; `None` if it has no length.
fn aim(ray: &RaySegment) -> anyhow::Result<Option<AimedRay>> {
    let (from, to) = (Point3::from(ray.from_m), Point3::from(ray.to_m));
    let along = to - from;
    let length_m = along.norm();
    if !length_m.is_finite() || length_m > MAX_LENGTH_M || from.coords.amax() > 1e6 {
        bail!(
            "a ray from {:?} to {:?} cannot be cast: both ends must be finite and at most 10 km apart",
            ray.from_m,
            ray.to_m
        );
    }
    Ok((length_m > 0.0).then(|| AimedRay {
        from_m: from,
        direction: along / length_m,
        length_m,
    }))
}

fn hits(world: &RayScene, ray: &AimedRay, max_hits: usize) -> Vec<RayHit> {
    let hit = |hit: Hit| RayHit {
        point_m: (ray.from_m + ray.direction * hit.distance_m).coords.into(),
        distance_m: hit.distance_m,
        normal: hit.normal_in_world.into(),
        class: hit.class.0,
        object_id: hit.object.0,
    };
    world
        .cast_through(&ray.from_m, &ray.direction, ray.length_m, max_hits)
        .into_iter()
        .map(hit)
        .collect()
}
