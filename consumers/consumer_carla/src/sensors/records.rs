//! Sensors whose messages are msgpack: IMU and GNSS.

use schema_frames::{FrameHeader, GnssSample, ImuSample};

use crate::axes;
use crate::list;
use crate::msgpack::{self, Value};

fn vector([x, y, z]: [f64; 3]) -> Value {
    list![x as f32, y as f32, z as f32]
}

/// Accelerometer, gyroscope, compass.
pub fn imu(out: &mut Vec<u8>, sample: &ImuSample) {
    let [x, y, z] = sample.angular_velocity_radps;
    msgpack::write(
        out,
        &list![
            vector(axes::mirror(sample.specific_force_mps2)),
            vector([-x, y, -z]),
            sample.compass_rad as f32
        ],
    );
}

/// Latitude, longitude, altitude, as the client's own `map.transform_to_geolocation` computes them:
/// CARLA 0.9.16 feeds its y, which points
/// south, into a projection whose y points north. The receiver's noise is kept.
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

/// Latitude and longitude of a point east and north of the map's origin: a transverse Mercator
/// projection of a sphere
/// (Snyder, *Map Projections*, USGS 1395, equations 8-6 and 8-7).
pub fn locate_deg(east_m: f64, north_m: f64, [latitude_deg, longitude_deg]: [f64; 2]) -> [f64; 2] {
    const SCALED_RADIUS_M: f64 = 6_378_137.0 * 0.9996;
    let (x, d) = (
        east_m / SCALED_RADIUS_M,
        north_m / SCALED_RADIUS_M + latitude_deg.to_radians(),
    );
    let longitude = longitude_deg + x.sinh().atan2(d.cos()).to_degrees();
    [(d.sin() / x.cosh()).asin().to_degrees(), longitude]
}

/// Latitude and longitude in a map's `geoReference`; CARLA's default where it has none.
pub fn geo_reference_deg(map: &str) -> [f64; 2] {
    let default_deg = schema_roads::DEFAULT_GEO_REFERENCE.into();
    let Some((_, after)) = map.split_once("<geoReference>") else {
        return default_deg;
    };
    let text = after.split("</geoReference>").next().unwrap_or_default();
    let value = |key: &str| {
        let (_, after) = text.split_once(key)?;
        after
            .split(|c: char| c.is_whitespace() || c == ']')
            .next()?
            .parse::<f64>()
            .ok()
            .filter(|degrees| degrees.is_finite())
    };
    match (value("+lat_0="), value("+lon_0=")) {
        (Some(latitude), Some(longitude)) => [latitude, longitude],
        _ => default_deg,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable as _;
    use schema_frames::Modality;
    use schema_types::Pose;

    #[test]
    fn the_reference_is_read_and_has_a_default() {
        assert_eq!(
            geo_reference_deg(
                "<geoReference><![CDATA[+proj=tmerc +lat_0=49.5 +lon_0=-8 +k=1]]></geoReference>"
            ),
            [49.5, -8.0]
        );
        assert_eq!(geo_reference_deg("<OpenDRIVE/>"), [42.0, 2.0]);
        assert_eq!(
            geo_reference_deg("<geoReference>+lat_0=49.5]</geoReference>"),
            [42.0, 2.0]
        );
    }

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
