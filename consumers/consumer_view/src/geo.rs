//! Places on Earth for the map view: the projection that GNSS sensors use, a transverse Mercator on a
//! sphere (Snyder, *Map Projections: A Working Manual*, USGS 1395, 1987, equations 8-1 to 8-7).

/// Radius of the sphere, metres.
const EARTH_RADIUS_M: f64 = 6_378_137.0;
/// Scale on the central meridian.
const SCALE: f64 = 0.9996;

/// Latitude and longitude, degrees, of a point east and north of the `origin`.
pub(crate) fn locate(origin_deg: (f64, f64), [east_m, north_m]: [f64; 2]) -> [f64; 2] {
    let east = east_m / (EARTH_RADIUS_M * SCALE);
    let north = north_m / (EARTH_RADIUS_M * SCALE) + origin_deg.0.to_radians();
    let latitude = (north.sin() / east.cosh()).asin();
    let longitude = origin_deg.1.to_radians() + east.sinh().atan2(north.cos());
    [latitude.to_degrees(), longitude.to_degrees()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_minute_of_arc_is_a_nautical_mile() {
        let origin = (42.0, 2.0);
        let [latitude, longitude] = locate(origin, [0.0, 1852.0]);
        assert!(((latitude - 42.0) * 60.0 - 1.0).abs() < 0.003, "{latitude}");
        assert_eq!(longitude, 2.0);
        let [_, longitude] = locate(origin, [1852.0 * 42f64.to_radians().cos(), 0.0]);
        assert!(
            ((longitude - 2.0) * 60.0 - 1.0).abs() < 0.003,
            "{longitude}"
        );
    }
}
