//! Radar: rays into a cone, denser towards its middle, and the closing speed of what they hit.
//!
//! CARLA's model: of the rays of a tick each ends at (R, R·tan(h/2)·r·cos θ, R·tan(v/2)·r·sin θ) in
//! the sensor's space with r uniform in 0..1 and θ uniform over the turn. No noise, cross sections
//! or echoes. Rays pass through the radar's own carrier.

use nalgebra::{Isometry3, Vector3};
use schema_frames::RadarDetection;
use schema_types::ActorId;
use schema_types::noise::Noise;
use sensor_spec::RadarSpec;

use crate::ray_scene::RayScene;

/// Where a radar is and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadarPose {
    /// Pose at the tick.
    pub world_from_sensor: Isometry3<f64>,
    /// Velocity of the sensor's own point, m/s.
    pub velocity_in_world_mps: Vector3<f64>,
}

/// Casts `n_rays` rays and appends a detection for each one that hits. `noise` is the key (seed,
/// sensor, tick).
pub fn scan(
    spec: &RadarSpec,
    scene: &RayScene,
    pose: &RadarPose,
    n_rays: u32,
    noise: Noise,
    ignored: Option<ActorId>,
    out: &mut Vec<RadarDetection>,
) {
    let origin_m = pose.world_from_sensor.translation.vector.into();
    for ray in 0..n_rays {
        let end = ray_end(spec, noise, ray as u64);
        let direction = end.normalize();
        let forward = pose.world_from_sensor.rotation * direction;
        let Some(hit) = scene.cast_ignoring(&origin_m, &forward, end.norm(), ignored) else {
            continue;
        };
        out.push(RadarDetection {
            velocity_mps: (hit.velocity_in_world_mps - pose.velocity_in_world_mps).dot(&forward)
                as f32,
            azimuth_rad: direction.y.atan2(direction.x) as f32,
            altitude_rad: direction.z.asin() as f32,
            depth_m: hit.distance_m as f32,
            cos_incidence: hit.cos_incidence(&forward) as f32,
            object_id: hit.object.0,
            class: hit.class.0,
            reserved: [0; 7],
        });
    }
}

/// End of a ray in the sensor's space. Takes the noise samples 2·ray and 2·ray + 1.
fn ray_end(spec: &RadarSpec, noise: Noise, ray: u64) -> Vector3<f64> {
    end_point(
        spec,
        noise.uniform(2 * ray),
        std::f64::consts::TAU * noise.uniform(2 * ray + 1),
    )
}

fn end_point(spec: &RadarSpec, share: f64, angle: f64) -> Vector3<f64> {
    let (half_width, half_height) = (
        (0.5 * spec.horizontal_fov_deg).to_radians().tan(),
        (0.5 * spec.vertical_fov_deg).to_radians().tan(),
    );
    spec.range_m
        * Vector3::new(
            1.0,
            half_width * share * angle.cos(),
            half_height * share * angle.sin(),
        )
}
