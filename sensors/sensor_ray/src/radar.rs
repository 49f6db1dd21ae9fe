//! Radar: rays into a cone, denser towards its middle, and how fast what they hit comes nearer.
//!
//! CARLA's model: of the rays of a tick each ends at (R, R·tan(h/2)·r·cos θ, R·tan(v/2)·r·sin θ) in the sensor's space with r uniform in
//! 0..1 and θ uniform over the turn. No noise, cross sections or echoes. Rays pass through the radar's own carrier.

use nalgebra::{Isometry3, Vector3};
use schema_frames::RadarDetection;
use schema_types::ActorId;
use schema_types::noise::Noise;
use sensor_spec::RadarSpec;

use crate::scene::{RayScene, Rays, Stacks};

const LANES: usize = 8;

/// Where a radar is and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadarPose {
    /// Pose at the tick.
    pub world_from_sensor: Isometry3<f64>,
    /// Velocity of the sensor's own point, m/s.
    pub velocity_in_world_mps: Vector3<f64>,
}

/// Casts `n_rays` rays and appends a detection for each that hits; `noise` is the key (seed, sensor, tick).
pub fn scan(
    spec: &RadarSpec,
    scene: &RayScene,
    pose: &RadarPose,
    n_rays: u32,
    noise: Noise,
    ignored: Option<ActorId>,
    out: &mut Vec<RadarDetection>,
) {
    let mut stacks = Stacks::default();
    let farthest_m = end_point(spec, 1.0, std::f64::consts::FRAC_PI_4).norm().max(end_point(spec, 1.0, 0.0).norm()) * 2.0;
    for first in (0..n_rays).step_by(LANES) {
        let ends: [Vector3<f64>; LANES] = std::array::from_fn(|lane| ray_end(spec, noise, (first as usize + lane) as u64));
        let directions = ends.map(|end| end.normalize());
        let rays = Rays::<LANES> {
            origins_m: [pose.world_from_sensor.translation.vector.into(); LANES],
            directions: directions.map(|direction| pose.world_from_sensor.rotation * direction),
            active: std::array::from_fn(|lane| first + (lane as u32) < n_rays),
            max_m: farthest_m,
        };
        for (lane, hit) in scene.cast_packet::<LANES, true>(&rays, ignored, &mut stacks).iter().enumerate() {
            let Some(hit) = hit.filter(|hit| hit.distance_m <= ends[lane].norm()) else { continue };
            let forward = &rays.directions[lane];
            out.push(RadarDetection {
                velocity_mps: (hit.velocity_in_world_mps - pose.velocity_in_world_mps).dot(forward) as f32,
                azimuth_rad: directions[lane].y.atan2(directions[lane].x) as f32,
                altitude_rad: directions[lane].z.asin() as f32,
                depth_m: hit.distance_m as f32,
                cos_incidence: hit.cos_incidence(forward) as f32,
                object_id: hit.object.0,
                class: hit.class.0,
                reserved: [0; 7],
            });
        }
    }
}

/// End of a ray of this tick in the sensor's space. Noise samples 2·ray and 2·ray + 1.
fn ray_end(spec: &RadarSpec, noise: Noise, ray: u64) -> Vector3<f64> {
    end_point(spec, noise.uniform(2 * ray), std::f64::consts::TAU * noise.uniform(2 * ray + 1))
}

fn end_point(spec: &RadarSpec, share: f64, angle: f64) -> Vector3<f64> {
    let (half_width, half_height) = ((0.5 * spec.horizontal_fov_deg).to_radians().tan(), (0.5 * spec.vertical_fov_deg).to_radians().tan());
    spec.range_m * Vector3::new(1.0, half_width * share * angle.cos(), half_height * share * angle.sin())
}
