//! Point formats: how a hit becomes a point, and which returns are lost.
//!
//! Losses are CARLA's, in CARLA's order: general drop-off, range noise, intensity exp(−a·d),
//! drop-off by intensity.

use nalgebra::{Point3, Vector3};
use schema_frames::{LidarPoint, LidarReturn, SemanticLidarPoint};
use schema_types::noise::Noise;
use sensor_spec::LidarSpec;

use crate::ray_scene::{Moment, RayScene};
use crate::rays::{Bundle, GROUP, Hits, WorldRay, distances_m, surface};

/// Channel number of a ray without a return; real ones are below 256.
const LOST: u16 = u16::MAX;

/// The hits of one group of a bundle, to be turned into points.
pub(crate) struct Returns<'a> {
    pub scene: &'a RayScene,
    pub spec: &'a LidarSpec,
    pub noise: Noise,
    pub bundle: &'a Bundle,
    pub hits: &'a Hits,
    pub group: usize,
    pub origin_m: Point3<f64>,
    /// From the head's axis to the origin, x and y in the sensor's space, metres.
    pub lever_m: [f64; 2],
    /// Unit vectors, an axis at a time.
    pub directions_in_world: [[f64; GROUP]; 3],
    pub directions_in_sensor: [[f64; GROUP]; 3],
    /// Numbers of the rays in the frame, which key the noise.
    pub rays: [u64; GROUP],
    pub channels: [u16; GROUP],
    /// When the rays are fired, nanoseconds from the turn's last firing.
    pub fired_nanos: [i32; GROUP],
    /// The same as moments of what moves; `None` sees it as it is at the tick.
    pub moments: [Option<Moment>; GROUP],
}

impl Returns<'_> {
    /// The point at `distance_m` along a ray, in the sensor's space.
    #[inline(always)]
    fn at(&self, lane: usize, distance_m: f64) -> [f32; 3] {
        let [x, y, z] = &self.directions_in_sensor;
        [
            (self.lever_m[0] + x[lane] * distance_m) as f32,
            (self.lever_m[1] + y[lane] * distance_m) as f32,
            (z[lane] * distance_m) as f32,
        ]
    }

    /// A distance as the sensor measures it, with noise and in its steps. Steps count from the axis.
    #[inline(always)]
    fn measured(&self, lane: usize, mut distance_m: f64) -> f64 {
        let (noise_m, step_m) = (self.spec.noise_range_stddev_m, self.spec.range_resolution_m);
        if noise_m > 0.0 {
            distance_m = (distance_m + noise_m * self.noise.gaussian(self.rays[lane])).max(0.0);
        }
        if step_m > 0.0 {
            let axis_m = self.spec.origin_offset_m;
            distance_m = ((distance_m + axis_m) / step_m).round() * step_m - axis_m;
        }
        distance_m
    }

    /// Whether something at this distance gives a return; not if it is NaN.
    #[inline(always)]
    fn is_in_range(&self, distance_m: f64) -> bool {
        distance_m <= self.spec.range_m && distance_m >= self.spec.min_range_m
    }

    /// Whether a return of this intensity is kept.
    #[inline(always)]
    fn is_kept(&self, lane: usize, intensity: f64) -> bool {
        intensity >= keep_limit(self.spec)
            || self.noise.uniform(2 * self.rays[lane] + 1) < keep_ratio(self.spec, intensity)
    }
}

/// A point format.
pub(crate) trait Point: Copy + Send + Sync {
    /// A ray without a return.
    fn lost() -> Self;
    fn is_lost(&self) -> bool;
    /// Whether any ray of this lidar can be lost before it is cast.
    fn can_misfire(spec: &LidarSpec) -> bool;
    /// Whether a ray is lost before it is cast.
    fn misfires(spec: &LidarSpec, noise: Noise, ray: u64) -> bool;
    /// Writes the points of a group, lost ones included.
    fn write(returns: &Returns, points: &mut [Self]);
}

impl Point for LidarPoint {
    #[inline(always)]
    fn lost() -> Self {
        LidarPoint {
            hit_in_sensor_m: [0.0; 3],
            intensity: 0,
            channel: LOST,
        }
    }

    #[inline(always)]
    fn is_lost(&self) -> bool {
        self.channel == LOST
    }

    #[inline(always)]
    fn can_misfire(spec: &LidarSpec) -> bool {
        spec.dropoff_general_ratio > 0.0
    }

    #[inline(always)]
    fn misfires(spec: &LidarSpec, noise: Noise, ray: u64) -> bool {
        noise.uniform(2 * ray) < spec.dropoff_general_ratio
    }

    #[inline(always)]
    fn write(returns: &Returns, points: &mut [Self]) {
        let Returns {
            scene,
            spec,
            bundle,
            hits,
            group,
            origin_m,
            ..
        } = returns;
        let mut distances_m = distances_m(
            scene,
            hits,
            bundle,
            *group,
            origin_m,
            &returns.directions_in_world,
            &returns.moments,
        );
        let is_return = distances_m.map(|distance_m| returns.is_in_range(distance_m));
        if spec.noise_range_stddev_m > 0.0 || spec.range_resolution_m > 0.0 {
            for (lane, distance_m) in distances_m.iter_mut().enumerate() {
                *distance_m = returns.measured(lane, *distance_m);
            }
        }
        let attenuation_per_m = spec.attenuation_per_m;
        for (lane, point) in points.iter_mut().enumerate().take(GROUP) {
            let intensity = (-attenuation_per_m * distances_m[lane]).exp();
            let kept = returns.is_kept(lane, intensity);
            *point = LidarPoint {
                hit_in_sensor_m: returns.at(lane, distances_m[lane]),
                intensity: (intensity * 65535.0 + 0.5) as u16,
                channel: if is_return[lane] && kept {
                    returns.channels[lane]
                } else {
                    LOST
                },
            };
        }
    }
}

/// Intensity from which on every return is kept.
pub(crate) fn keep_limit(spec: &LidarSpec) -> f64 {
    if spec.dropoff_zero_intensity_ratio > 0.0 {
        spec.dropoff_intensity_limit
    } else {
        0.0
    }
}

/// Share of returns kept at an intensity below the limit: from 1 − zero at 0 up to 1 at the limit.
fn keep_ratio(spec: &LidarSpec, intensity: f64) -> f64 {
    1.0 - spec.dropoff_zero_intensity_ratio * (1.0 - intensity / spec.dropoff_intensity_limit)
}

impl Point for SemanticLidarPoint {
    #[inline(always)]
    fn lost() -> Self {
        SemanticLidarPoint {
            channel: LOST,
            ..bytemuck::Zeroable::zeroed()
        }
    }

    #[inline(always)]
    fn is_lost(&self) -> bool {
        self.channel == LOST
    }

    #[inline(always)]
    fn can_misfire(_: &LidarSpec) -> bool {
        false
    }

    #[inline(always)]
    fn misfires(_: &LidarSpec, _: Noise, _: u64) -> bool {
        false
    }

    #[inline(always)]
    fn write(returns: &Returns, points: &mut [Self]) {
        let Returns {
            scene,
            bundle,
            hits,
            group,
            origin_m,
            directions_in_world: [x, y, z],
            ..
        } = returns;
        for (lane, point) in points.iter_mut().enumerate().take(GROUP) {
            let forward = Vector3::new(x[lane], y[lane], z[lane]);
            let ray = WorldRay {
                origin_m,
                direction: &forward,
                moment: returns.moments[lane],
            };
            let hit = surface(scene, hits, bundle, group * GROUP + lane, &ray);
            *point = match hit.filter(|hit| returns.is_in_range(hit.distance_m)) {
                Some(hit) => SemanticLidarPoint {
                    hit_in_sensor_m: returns.at(lane, hit.distance_m),
                    cos_incidence: hit.cos_incidence(&forward) as f32,
                    object_id: hit.object.0,
                    class: hit.class.0,
                    reserved: 0,
                    channel: returns.channels[lane],
                },
                None => Self::lost(),
            };
        }
    }
}

impl Point for LidarReturn {
    #[inline(always)]
    fn lost() -> Self {
        LidarReturn {
            ring: LOST,
            ..bytemuck::Zeroable::zeroed()
        }
    }

    #[inline(always)]
    fn is_lost(&self) -> bool {
        self.ring == LOST
    }

    #[inline(always)]
    fn can_misfire(spec: &LidarSpec) -> bool {
        LidarPoint::can_misfire(spec)
    }

    #[inline(always)]
    fn misfires(spec: &LidarSpec, noise: Noise, ray: u64) -> bool {
        LidarPoint::misfires(spec, noise, ray)
    }

    #[inline(always)]
    fn write(returns: &Returns, points: &mut [Self]) {
        let Returns {
            scene,
            spec,
            bundle,
            hits,
            group,
            origin_m,
            directions_in_world: [x, y, z],
            ..
        } = returns;
        for (lane, point) in points.iter_mut().enumerate().take(GROUP) {
            *point = Self::lost();
            let forward = Vector3::new(x[lane], y[lane], z[lane]);
            let ray = WorldRay {
                origin_m,
                direction: &forward,
                moment: returns.moments[lane],
            };
            let hit = surface(scene, hits, bundle, group * GROUP + lane, &ray);
            let Some(hit) = hit.filter(|hit| returns.is_in_range(hit.distance_m)) else {
                continue;
            };
            let distance_m = returns.measured(lane, hit.distance_m);
            let intensity = (-spec.attenuation_per_m * distance_m).exp();
            if !returns.is_kept(lane, intensity) {
                continue;
            }
            let channel = u32::from(returns.channels[lane]);
            let range_mm = ((distance_m + spec.origin_offset_m) * 1000.0).round() as u64;
            *point = LidarReturn {
                hit_in_sensor_m: returns.at(lane, distance_m),
                time_ns: returns.fired_nanos[lane],
                object_id: hit.object.0,
                intensity: (intensity * 65535.0 + 0.5) as u16,
                ring: spec.ring(channel),
                reflectivity: 0,
                returns: LidarReturn::ONLY,
                class: hit.class.0,
                flags: 0,
                ambient: 0,
                range_mm_lsb: range_mm as u16,
            };
        }
    }
}
