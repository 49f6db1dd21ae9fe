//! Latitude and longitude of points of the map.

/// Latitude and longitude of a point east and north of the map's origin: a transverse Mercator
/// projection of a sphere (Snyder, *Map Projections*, USGS 1395, equations 8-6 and 8-7).
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
}
