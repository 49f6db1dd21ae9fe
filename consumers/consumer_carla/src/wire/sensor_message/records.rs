//! Sensors whose messages are msgpack: IMU and GNSS.

use nalgebra::Vector3;
use schema_frames::{FrameHeader, GnssSample, ImuSample};

use crate::list;
use crate::wire::axes;
use crate::wire::geolocation::locate_deg;
use crate::wire::msgpack::{self, Value};

/// Gravity that the simulator's IMUs measure, m/s².
pub const GRAVITY_MPS2: f64 = 9.81;

fn vector([x, y, z]: [f64; 3]) -> Value {
    list![x as f32, y as f32, z as f32]
}

/// Accelerometer, gyroscope, compass. A gravity other than the simulator's changes what the
/// accelerometer feels along the world's vertical.
pub fn imu(out: &mut Vec<u8>, sample: &ImuSample, header: &FrameHeader, gravity_mps2: f64) {
    let [x, y, z] = sample.angular_velocity_radps;
    let up = header.world_from_sensor.isometry().rotation.inverse() * Vector3::z();
    let force = Vector3::from(sample.specific_force_mps2) + up * (gravity_mps2 - GRAVITY_MPS2);
    msgpack::write(
        out,
        &list![
            vector(axes::mirror(force.into())),
            vector([-x, y, -z]),
            sample.compass_rad as f32
        ],
    );
}

/// Latitude, longitude and altitude, consistent with the client's own
/// `map.transform_to_geolocation`: CARLA 0.9.16 feeds its y, which points south, into a projection
/// whose y points north. The noise of the receiver is kept.
pub fn gnss(
    out: &mut Vec<u8>,
    sample: &GnssSample,
    header: &FrameHeader,
    geo_reference_deg: [f64; 2],
) {
    let [x, y, _] = header.world_from_sensor.translation_m;
    let (ours, theirs) = (
        locate_deg(x, y, geo_reference_deg),
        locate_deg(x, -y, geo_reference_deg),
    );
    let latitude = theirs[0] + (sample.latitude_deg - ours[0]);
    let longitude = theirs[1] + (sample.longitude_deg - ours[1]);
    msgpack::write(out, &list![latitude, longitude, sample.altitude_m]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable as _;
    use schema_frames::Modality;
    use schema_types::Pose;

    /// One degree along a meridian is a 360th of the sphere's circumference, scaled; y points
    /// south, but the latitude falls driving north.
    #[test]
    fn a_fix_is_the_clients_own() {
        let degree_m = 6_378_137.0 * 0.9996 * std::f64::consts::TAU / 360.0;
        let header = FrameHeader {
            world_from_sensor: Pose::from_xyz_yaw(0.0, degree_m, 7.0, 0.0),
            ..FrameHeader::new(Modality::Gnss)
        };
        let sample = GnssSample {
            latitude_deg: 43.0 + 0.125,
            longitude_deg: 2.0,
            altitude_m: 7.0,
            ..GnssSample::zeroed()
        };
        let mut out = Vec::new();
        gnss(&mut out, &sample, &header, [42.0, 2.0]);
        let Value::Array(read) =
            msgpack::read(&mut out.as_slice(), msgpack::Limits::default()).unwrap()
        else {
            panic!()
        };
        let [
            Value::F64(latitude),
            Value::F64(longitude),
            Value::F64(altitude),
        ] = read[..]
        else {
            panic!("{read:?}")
        };
        assert!(
            (latitude - 41.125).abs() < 1e-9 && (longitude - 2.0).abs() < 1e-9 && altitude == 7.0,
            "{read:?}"
        );
    }
}
