//! GNSS: latitude, longitude and altitude of a point of the world.
//!
//! Our world is OpenDRIVE's: **x east, y left of x and thus north**, z up. So y = −(CARLA's y), and
//! driving towards +y raises the latitude. (CARLA 0.9.16 feeds its own y, which points south, into
//! the same formula, so that driving north lowers its latitude. A gateway that must agree with it
//! mirrors y before it asks.)
//!
//! The projection is a transverse Mercator on a sphere of 6378137 m, scale 0.9996, its origin at
//! the map's reference point: Snyder, *Map Projections: A Working Manual* (USGS 1395, 1987),
//! equations 8-1 to 8-7. Exact inverse included.
//!
//! A receiver on WGS 84 takes the world as the plane that touches the ellipsoid at the reference.

use nalgebra::{Point3, Vector3};
use schema_frames::GnssSample;
use schema_types::noise::Noise;
use sensor_spec::{Datum, GnssSpec};

/// Radius of the sphere, metres (WGS 84's equator).
const EARTH_RADIUS_M: f64 = 6_378_137.0;
/// Flattening of WGS 84's ellipsoid.
const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// Scale on the central meridian.
const SCALE: f64 = 0.9996;

/// The geographic place of the world's origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeoReference {
    /// Latitude of the origin, degrees.
    pub latitude_deg: f64,
    /// Longitude of the origin, degrees.
    pub longitude_deg: f64,
}

/// A place on Earth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeoPoint {
    /// Latitude, degrees, north positive.
    pub latitude_deg: f64,
    /// Longitude, degrees, east positive, in (−180, 180].
    pub longitude_deg: f64,
    /// Altitude above the world's z = 0, metres.
    pub altitude_m: f64,
}

impl GeoReference {
    /// Where a point of the world (x east, y north, z up, metres) lies on Earth.
    pub fn locate(&self, point_in_world_m: &Point3<f64>) -> GeoPoint {
        let east = point_in_world_m.x / (EARTH_RADIUS_M * SCALE);
        let north = point_in_world_m.y / (EARTH_RADIUS_M * SCALE) + self.latitude_deg.to_radians();
        let latitude = (north.sin() / east.cosh()).asin();
        let longitude = self.longitude_deg.to_radians() + east.sinh().atan2(north.cos());
        GeoPoint {
            latitude_deg: latitude.to_degrees(),
            longitude_deg: wrap_deg(longitude.to_degrees()),
            altitude_m: point_in_world_m.z,
        }
    }

    /// Where a point of the world lies on WGS 84's ellipsoid, if the world is the plane that touches it
    /// at the reference; the altitude is above the ellipsoid.
    pub fn locate_on_wgs84(&self, point_in_world_m: &Point3<f64>) -> GeoPoint {
        let squared = FLATTENING * (2.0 - FLATTENING);
        let (sin, cos) = self.latitude_deg.to_radians().sin_cos();
        let normal_m = EARTH_RADIUS_M / (1.0 - squared * sin * sin).sqrt();
        let [east, north, up] = point_in_world_m.coords.into();
        // Earth-centred axes, turned about Earth's axis so that x lies in the reference's meridian.
        let outwards = (normal_m + up) * cos - north * sin;
        let [x, y] = [outwards, east];
        let z = (normal_m * (1.0 - squared) + up) * sin + north * cos;
        let across = x.hypot(y);
        // Bowring's formula, and two steps of the fixed point: exact to a nanometre near the ground.
        let reduced = z.atan2(across * (1.0 - FLATTENING));
        let second = squared / (1.0 - squared);
        let mut latitude =
            (z + second * EARTH_RADIUS_M * (1.0 - FLATTENING) * reduced.sin().powi(3))
                .atan2(across - squared * EARTH_RADIUS_M * reduced.cos().powi(3));
        let normal_at = |sin: f64| EARTH_RADIUS_M / (1.0 - squared * sin * sin).sqrt();
        for _ in 0..2 {
            let sin = latitude.sin();
            latitude = (z + squared * normal_at(sin) * sin).atan2(across);
        }
        let (sin, cos) = latitude.sin_cos();
        let altitude_m = across * cos + z * sin - normal_at(sin) * (1.0 - squared * sin * sin);
        GeoPoint {
            latitude_deg: latitude.to_degrees(),
            longitude_deg: wrap_deg(self.longitude_deg + y.atan2(x).to_degrees()),
            altitude_m,
        }
    }

    /// The point of the world at a place on Earth: the inverse of [`GeoReference::locate`].
    pub fn point(&self, place: &GeoPoint) -> Point3<f64> {
        let latitude = place.latitude_deg.to_radians();
        let from_meridian = (place.longitude_deg - self.longitude_deg).to_radians();
        let east = (latitude.cos() * from_meridian.sin()).atanh();
        // atan2 of sine and cosine rather than of the tangent, so that the poles need no care.
        let north = latitude.sin().atan2(latitude.cos() * from_meridian.cos())
            - self.latitude_deg.to_radians();
        Point3::from(
            Vector3::new(east, north, 0.0) * (EARTH_RADIUS_M * SCALE)
                + Vector3::z() * place.altitude_m,
        )
    }
}

/// Degrees into (−180, 180].
fn wrap_deg(angle_deg: f64) -> f64 {
    180.0 - (180.0 - angle_deg).rem_euclid(360.0)
}

/// One fix of a receiver at `point_in_world_m`. Noise samples 0, 1, 2 go to latitude, longitude and
/// altitude, 3 and 4 to metres towards east and north.
pub fn sample(
    spec: &GnssSpec,
    reference: &GeoReference,
    point_in_world_m: &Point3<f64>,
    noise: Noise,
) -> GnssSample {
    let gaussian = |stddev: f64, number: u64| {
        if stddev > 0.0 {
            stddev * noise.gaussian(number)
        } else {
            0.0
        }
    };
    let [east, north] = [0, 1].map(|i| gaussian(spec.noise_position_stddev_m[i], 3 + i as u64));
    let measured_m = point_in_world_m + Vector3::new(east, north, 0.0);
    let place = match spec.datum {
        Datum::Carla => reference.locate(&measured_m),
        Datum::Wgs84 => reference.locate_on_wgs84(&measured_m),
    };
    GnssSample {
        latitude_deg: place.latitude_deg
            + spec.bias_position_deg[0]
            + gaussian(spec.noise_position_stddev_deg[0], 0),
        longitude_deg: place.longitude_deg
            + spec.bias_position_deg[1]
            + gaussian(spec.noise_position_stddev_deg[1], 1),
        altitude_m: place.altitude_m
            + spec.bias_altitude_m
            + gaussian(spec.noise_altitude_stddev_m, 2),
        reserved: [0; 2],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ORIGIN: GeoReference = GeoReference {
        latitude_deg: 42.0,
        longitude_deg: 2.0,
    };

    #[test]
    fn the_origin_is_the_reference() {
        let place = ORIGIN.locate(&Point3::new(0.0, 0.0, 7.5));
        assert!(
            (place.latitude_deg - 42.0).abs() < 1e-12 && (place.longitude_deg - 2.0).abs() < 1e-12
        );
        assert_eq!(place.altitude_m, 7.5);
    }

    #[test]
    fn plus_y_is_north_and_plus_x_is_east_at_the_right_scale() {
        let reference = GeoReference {
            latitude_deg: 60.0,
            longitude_deg: 10.0,
        };
        // One degree of arc on the sphere is R·π/180; the map is 0.9996 of it. Circles of latitude
        // shrink with cos 60° = ½.
        let degree_m = EARTH_RADIUS_M * SCALE * 1f64.to_radians();
        let north = reference.locate(&Point3::new(0.0, degree_m, 0.0));
        assert!(
            (north.latitude_deg - 61.0).abs() < 1e-9 && (north.longitude_deg - 10.0).abs() < 1e-9
        );
        let east = reference.locate(&Point3::new(0.001 * degree_m, 0.0, 0.0));
        assert!(
            (east.longitude_deg - 10.002).abs() < 1e-8 && (east.latitude_deg - 60.0).abs() < 1e-6,
            "{east:?}"
        );
    }

    #[test]
    fn the_inverse_returns_to_the_millimetre() {
        let mut rng = fastrand::Rng::with_seed(11);
        for _ in 0..10_000 {
            let reference = GeoReference {
                latitude_deg: rng.f64() * 170.0 - 85.0,
                longitude_deg: rng.f64() * 360.0 - 180.0,
            };
            let point = Point3::new(
                rng.f64() * 2e4 - 1e4,
                rng.f64() * 2e4 - 1e4,
                rng.f64() * 100.0,
            );
            let found = reference.point(&reference.locate(&point));
            assert!(
                (found - point).norm() < 1e-6,
                "{reference:?} {point} {found}"
            );
        }
    }

    #[test]
    fn longitude_stays_within_half_a_turn() {
        assert_eq!(
            [
                wrap_deg(190.0),
                wrap_deg(-190.0),
                wrap_deg(180.0),
                wrap_deg(-180.0),
                wrap_deg(0.0)
            ],
            [-170.0, 170.0, 180.0, 180.0, 0.0]
        );
    }

    #[test]
    fn noise_has_the_asked_spread_per_component() {
        let spec = GnssSpec {
            noise_position_stddev_deg: [1e-5, 2e-5],
            noise_altitude_stddev_m: 3.0,
            ..Default::default()
        };
        let (reference, point) = (ORIGIN, Point3::new(100.0, 200.0, 3.0));
        let exact = reference.locate(&point);
        let n = 20_000;
        let mut squares = [0.0; 3];
        for tick in 0..n {
            let found = sample(&spec, &reference, &point, Noise::new(1, 4, tick));
            squares[0] += (found.latitude_deg - exact.latitude_deg).powi(2);
            squares[1] += (found.longitude_deg - exact.longitude_deg).powi(2);
            squares[2] += (found.altitude_m - exact.altitude_m).powi(2);
        }
        for (sum, expected) in squares.into_iter().zip([1e-5, 2e-5, 3.0]) {
            // Relative standard error of a standard deviation is 1/√(2n) = 0.5 %; five of them.
            assert!(((sum / n as f64).sqrt() / expected - 1.0).abs() < 0.025);
        }
        let biased = GnssSpec {
            bias_position_deg: [0.5, -0.25],
            bias_altitude_m: 8.0,
            ..Default::default()
        };
        let found = sample(&biased, &reference, &point, Noise::new(1, 4, 1));
        assert!(
            (found.latitude_deg - exact.latitude_deg - 0.5).abs() < 1e-12
                && (found.altitude_m - exact.altitude_m - 8.0).abs() < 1e-12
        );
        assert!((found.longitude_deg - exact.longitude_deg + 0.25).abs() < 1e-12);
        let quiet = sample(
            &GnssSpec::default(),
            &reference,
            &point,
            Noise::new(1, 4, 1),
        );
        assert_eq!(
            (quiet.latitude_deg, quiet.longitude_deg, quiet.altitude_m),
            (exact.latitude_deg, exact.longitude_deg, exact.altitude_m)
        );
    }

    /// Against `pymap3d.enu2geodetic` 3.2.0 with its WGS 84.
    #[test]
    fn places_on_wgs84_are_those_of_another_program() {
        for (reference, point, wanted) in [
            (
                (42.0, 2.0),
                (1000.0, 2000.0, 30.0),
                (
                    42.018_005_381_409_17,
                    2.012_073_241_859_587_5,
                    30.392_539_208_462_654,
                ),
            ),
            (
                (60.0, 10.0),
                (-15000.0, 8000.0, 120.0),
                (
                    60.071_529_285_912,
                    9.730_606_056_691_506,
                    142.606_457_822_422_16,
                ),
            ),
            (
                (-33.9, 151.2),
                (1000.0, 2000.0, 30.0),
                (
                    -33.881_968_666_297_29,
                    151.210_809_314_178_33,
                    30.393_008_548_176_816,
                ),
            ),
            (
                (0.0, 179.9999),
                (1000.0, 2000.0, 30.0),
                (
                    0.018_087_303_062_112_613,
                    -179.991_116_889_485_08,
                    30.394_075_420_826_8,
                ),
            ),
            (
                (89.0, 0.0),
                (-15000.0, 8000.0, 120.0),
                (
                    89.061_961_262_174,
                    -8.231_299_627_625_36,
                    142.579_125_882_393_9,
                ),
            ),
        ] {
            let reference = GeoReference {
                latitude_deg: reference.0,
                longitude_deg: reference.1,
            };
            let found = reference.locate_on_wgs84(&Point3::new(point.0, point.1, point.2));
            // 1e-9 degrees are 0.1 mm.
            assert!((found.latitude_deg - wanted.0).abs() < 1e-9, "{found:?}");
            let shrinks = wanted.0.to_radians().cos();
            assert!(
                (found.longitude_deg - wanted.1).abs() * shrinks < 1e-9,
                "{found:?}"
            );
            assert!((found.altitude_m - wanted.2).abs() < 1e-4, "{found:?}");
            let at_reference = reference.locate_on_wgs84(&Point3::origin());
            assert!((at_reference.latitude_deg - reference.latitude_deg).abs() < 1e-12);
            assert!(at_reference.altitude_m.abs() < 1e-6, "{at_reference:?}");
        }
    }

    #[test]
    fn noise_in_metres_moves_the_place_on_either_earth() {
        for datum in [Datum::Carla, Datum::Wgs84] {
            let spec = GnssSpec {
                datum,
                noise_position_stddev_m: [1.0, 3.0],
                ..GnssSpec::default()
            };
            let point = Point3::new(100.0, 200.0, 3.0);
            let exact = sample(
                &GnssSpec {
                    datum,
                    ..GnssSpec::default()
                },
                &ORIGIN,
                &point,
                Noise::new(1, 4, 1),
            );
            let n = 20_000;
            let mut squares = [0.0; 2];
            for tick in 0..n {
                let found = sample(&spec, &ORIGIN, &point, Noise::new(1, 4, tick));
                let degree_m = EARTH_RADIUS_M * 1f64.to_radians();
                squares[0] += ((found.longitude_deg - exact.longitude_deg)
                    * degree_m
                    * 42f64.to_radians().cos())
                .powi(2);
                squares[1] += ((found.latitude_deg - exact.latitude_deg) * degree_m).powi(2);
            }
            // Five standard errors of 0.5 %, and up to 0.7 % for the ellipsoid's radii.
            for (sum, wanted) in squares.into_iter().zip([1.0, 3.0]) {
                assert!(
                    ((sum / n as f64).sqrt() / wanted - 1.0).abs() < 0.035,
                    "{datum:?}"
                );
            }
        }
    }
}
