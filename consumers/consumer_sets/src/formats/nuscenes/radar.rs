//! nuScenes' radar files: PCD of 18 fields.

use nalgebra::Vector3;
use schema_frames::RadarDetection;

use consumer_truth::ticks::{TickFrame, World};

/// Radial speed over ground from which a detection counts as moving, m/s.
const MOVING_MPS: f32 = 0.5;

/// A detection's place in the sensor's space, metres.
pub fn point_m(detection: &RadarDetection) -> [f32; 3] {
    let (sin_up, cos_up) = detection.altitude_rad.sin_cos();
    let (sin, cos) = detection.azimuth_rad.sin_cos();
    let depth = detection.depth_m;
    [depth * cos_up * cos, depth * cos_up * sin, depth * sin_up]
}

/// The file. `vx`, `vy` are the radial velocity as measured, `vx_comp`, `vy_comp` without the radar's
/// own motion; cross-section is 0, because it is not modelled. A cloud without detections is, as
/// nuScenes writes it, one point that is no number.
pub fn pcd(frame: &TickFrame, world: Option<&World>) -> Vec<u8> {
    let detections = frame.elements::<RadarDetection>();
    let sensor = world.and_then(|world| world.record(frame.header.sensor_id));
    let own = sensor.map_or(Vector3::zeros(), |sensor| {
        Vector3::from(sensor.velocity_in_world_mps)
    });
    let own_in_sensor = frame.header.world_from_sensor.isometry().rotation.inverse() * own;
    let n = detections.len().max(1);
    let mut bytes = format!(
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n\
         FIELDS x y z dyn_prop id rcs vx vy vx_comp vy_comp is_quality_valid ambig_state x_rms y_rms invalid_state pdh0 vx_rms vy_rms\n\
         SIZE 4 4 4 1 2 4 4 4 4 4 1 1 1 1 1 1 1 1\n\
         TYPE F F F I I F F F F F I I I I I I I I\n\
         COUNT 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1\n\
         WIDTH {n}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA binary\n"
    )
    .into_bytes();
    let mut point = |at: [f32; 3], moving: bool, number: i16, v: [f32; 4]| {
        at.iter()
            .for_each(|value| bytes.extend(value.to_le_bytes()));
        bytes.push(u8::from(!moving));
        bytes.extend(number.to_le_bytes());
        bytes.extend(0f32.to_le_bytes());
        v.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
        // Valid, unambiguous, exact, unlikely to be an artefact.
        bytes.extend([1u8, 3, 0, 0, 0, 1, 0, 0]);
    };
    if detections.is_empty() {
        point([f32::NAN; 3], false, 0, [f32::NAN; 4]);
    }
    for (number, detection) in detections.iter().enumerate() {
        let at = point_m(detection);
        let ray = Vector3::from(at.map(f64::from))
            .try_normalize(1e-9)
            .unwrap_or_else(Vector3::x);
        let over_ground = detection.velocity_mps + own_in_sensor.dot(&ray) as f32;
        let (sin, cos) = detection.azimuth_rad.sin_cos();
        let along = |speed: f32| [speed * cos, speed * sin];
        let ([vx, vy], [cx, cy]) = (along(detection.velocity_mps), along(over_ground));
        let moving = over_ground.abs() >= MOVING_MPS;
        point(at, moving, (number % 32768) as i16, [vx, vy, cx, cy]);
    }
    // The devkit wants a byte behind the last point.
    bytes.push(b'\n');
    bytes
}
