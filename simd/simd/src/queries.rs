//! Rays that commands cast through the world as sensors see it now.

use anyhow::{bail, ensure};
use nalgebra::{Point3, Vector3};
use schema_frames::query::{MAX_HITS, MAX_RAYS};
use schema_frames::{CommandReply, RayHit, RaySegment};
use sensor_ray::{Hit, RayScene};

use crate::daemon::Daemon;

/// Longest ray, metres.
const MAX_LENGTH_M: f64 = 10_000.0;

impl Daemon {
    /// What each ray meets: the first surface, or all of them.
    pub(crate) fn cast_rays(
        &mut self,
        rays: &[RaySegment],
        all: bool,
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
        let scene = self.scene(self.clock.time_of(self.tick));
        let world = self.sensors.rays(&scene);
        let max_hits = if all { MAX_HITS } else { 1 };
        let rays = aimed
            .iter()
            .map(|ray| {
                ray.as_ref()
                    .map_or(Vec::new(), |ray| cast(world, ray, max_hits))
            })
            .collect();
        Ok(CommandReply::Hits { rays })
    }
}

/// Start, unit direction, length.
type Aimed = (Point3<f64>, Vector3<f64>, f64);

/// `None` for a ray without length.
fn aim(ray: &RaySegment) -> anyhow::Result<Option<Aimed>> {
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
    Ok((length_m > 0.0).then(|| (from, along / length_m, length_m)))
}

fn cast(world: &RayScene, (from, direction, length_m): &Aimed, max_hits: usize) -> Vec<RayHit> {
    let hit = |hit: Hit| RayHit {
        point_m: (from + direction * hit.distance_m).coords.into(),
        distance_m: hit.distance_m,
        normal: hit.normal_in_world.into(),
        class: hit.class.0,
        object_id: hit.object.0,
    };
    world
        .cast_through(from, direction, *length_m, max_hits)
        .into_iter()
        .map(hit)
        .collect()
}
