//! A scan of a room by a lidar of a profile.

use nalgebra::{Isometry3, Translation3};
use schema_types::noise::Noise;
use schema_types::{Class, ObjectId};
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder, SceneAssets, StaticInstance};
use sensor_ray::{Lidar, RayScene, SensorPath};
use sensor_spec::LidarSpec;

/// A room of 13 m × 11 m × 5 m about the origin with a pillar. Velodyne's packets have angles in
/// hundredths of a degree, which is 1 mm here.
fn room() -> RayScene {
    let mut room = MeshBuilder::new("room");
    let surface = Surface::new(Class::WALLS, Material::Concrete, [128; 3]);
    for (centre, half) in [
        ([7.0, 0.0, 0.0], [0.5, 7.0, 3.0]),
        ([-7.0, 0.0, 0.0], [0.5, 7.0, 3.0]),
        ([0.0, 6.0, 0.0], [8.0, 0.5, 3.0]),
        ([0.0, -6.0, 0.0], [8.0, 0.5, 3.0]),
        ([0.0, 0.0, 3.0], [8.0, 7.0, 0.5]),
        ([0.0, 0.0, -3.0], [8.0, 7.0, 0.5]),
        ([3.0, 2.0, 0.0], [0.4, 0.3, 3.0]),
    ] {
        room.cuboid(surface, centre, half);
    }
    let mut assets = SceneAssets::default();
    let mesh = assets.add_mesh(room.finish());
    assets.statics.push(StaticInstance {
        mesh,
        world_from_mesh: Isometry3::identity(),
        object: ObjectId::scenery(1),
    });
    RayScene::load(&assets)
}

/// The returns of one turn in the room, without noise and losses, and their number.
pub fn returns_in_a_room(spec: &LidarSpec) -> (Vec<u8>, u32) {
    let mut lidar = Lidar::new(LidarSpec {
        returns: true,
        semantic: false,
        motion_distortion: false,
        noise_range_stddev_m: 0.0,
        dropoff_general_ratio: 0.0,
        dropoff_zero_intensity_ratio: 0.0,
        ..spec.clone()
    });
    let pose = Isometry3::from_parts(Translation3::new(0.3, -0.2, 0.1), Default::default());
    let path = SensorPath::still(pose);
    let n_points = lidar.scan(&room(), &path, Noise::new(1, 1, 1), None);
    let mut bytes = vec![0; lidar.payload_bytes()];
    lidar.write(&mut bytes);
    (bytes, n_points)
}

#[cfg(test)]
mod tests {
    use schema_frames::LidarReturn;

    use super::*;
    use crate::sensor::profile::read;

    fn scan(name: &str) -> (LidarSpec, Vec<LidarReturn>) {
        let (_, spec) = read(name).unwrap();
        let sensor_spec::SensorSpec::Lidar(spec) = spec else {
            panic!("{name} is no lidar")
        };
        let (bytes, _) = returns_in_a_room(&spec);
        (spec, bytemuck::pod_collect_to_vec(&bytes))
    }

    #[test]
    fn a_vlp_16_has_the_angles_and_times_of_its_manual() {
        let (spec, points) = scan("velodyne/vlp-16");
        assert_eq!(points.len(), 16 * 1800);
        // Elevation by laser in the order of firing: −15, 1, −13, 3, …, −1, 15 degrees.
        let elevations: Vec<i32> = (0..8).flat_map(|k| [2 * k - 15, 2 * k + 1]).collect();
        let turn_nanos = 1800.0 * 55_296.0;
        for point in &points {
            let elevation_deg = 2 * i32::from(point.ring) - 15;
            let laser = elevations.iter().position(|it| *it == elevation_deg);
            let fired_ns = laser.unwrap() as f64 * 2304.0;
            // From the first firing on, whole firings and then 2.304 µs a laser.
            let since = f64::from(point.time_ns) + turn_nanos - (55_296.0 - 15.0 * 2304.0);
            let column = (since - fired_ns) / 55_296.0;
            assert!((column - column.round()).abs() < 1e-4, "{column}");
            // The head turns evenly, clockwise; its beams begin beside its axis.
            let head_deg = 180.0 - 0.2 * (column.round() + 1.0);
            let (sin, cos) = head_deg.to_radians().sin_cos();
            let [x, y, z] = point.hit_in_sensor_m.map(f64::from);
            let [x, y] = [x - 0.041_91 * cos, y - 0.041_91 * sin];
            let seen_deg = z.atan2(x.hypot(y)).to_degrees();
            assert!((seen_deg - f64::from(elevation_deg)).abs() < 1e-4);
            let azimuth_deg = head_deg - 0.2 * fired_ns / 55_296.0;
            let error = (y.atan2(x).to_degrees() - azimuth_deg).rem_euclid(360.0);
            assert!(error.min(360.0 - error) < 1e-4, "{error}");
            let range_mm = ((x * x + y * y + z * z).sqrt() + 0.041_91) * 1000.0;
            assert!((range_mm - f64::from(point.range_mm_lsb)).abs() < 0.01);
            assert_eq!(point.range_mm_lsb % 2, 0, "steps of 2 mm");
            assert_eq!((point.returns, point.class), (16, Class::WALLS.0));
        }
        assert_eq!(points.iter().map(|it| it.time_ns).max(), Some(0));
        assert_eq!(spec.channels, 16);
    }

    #[test]
    fn beams_of_an_os1_begin_at_its_lever_arm() {
        let (spec, points) = scan("ouster/os1-128");
        assert_eq!(points.len(), 128 * 1024);
        for point in points.iter().step_by(7) {
            let column = 1023.0 + f64::from(point.time_ns) / 97_656.25;
            let azimuth = (180.0 - 360.0 * (column.round() + 1.0) / 1024.0).to_radians();
            let [x, y, z] = point.hit_in_sensor_m.map(f64::from);
            let from_beam = [
                x - 0.015_806 * azimuth.cos(),
                y - 0.015_806 * azimuth.sin(),
                z,
            ];
            let distance = from_beam.iter().map(|it| it * it).sum::<f64>().sqrt();
            let elevation_deg = (z / distance).asin().to_degrees();
            let wanted_deg = 22.5 - 45.0 * f64::from(point.ring) / 127.0;
            assert!((elevation_deg - wanted_deg).abs() < 1e-4);
            let range_mm = (distance + 0.015_806) * 1000.0;
            assert!((range_mm - f64::from(point.range_mm_lsb)).abs() < 0.01);
        }
        assert_eq!(spec.origin_offset_m, 0.015_806);
    }
}
