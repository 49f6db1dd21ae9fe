//! The clear sky against the model's authors: values that their own program (ArHosekSkyModel,
//! version 1.4a of 22 February 2013, double precision) gives for the suns, turbidities and the
//! ground that weathers lead to.

use nalgebra::Vector3;

use super::{ClearSky, SkyLook, SkyMap, cloud_cover, direction_of, luminance};

struct Row {
    sun_altitude_deg: f32,
    /// Turbidity is 2.5 + 3 times this; the ground's albedo is 0.2.
    clouds_ratio: f32,
    zenith_deg: f32,
    /// From the sun.
    azimuth_deg: f32,
    /// Radiance by the tables for R, G and B.
    rgb: [f32; 3],
    /// Luminance by the tables for X, Y and Z, which the authors fitted on their own.
    luminance: f32,
}

const fn row(
    [sun_altitude_deg, clouds_ratio, zenith_deg, azimuth_deg]: [f32; 4],
    rgb: [f32; 3],
    luminance: f32,
) -> Row {
    Row {
        sun_altitude_deg,
        clouds_ratio,
        zenith_deg,
        azimuth_deg,
        rgb,
        luminance,
    }
}

#[rustfmt::skip]
const PUBLISHED: [Row; 30] = [
    row([1.0, 0.00, 0.0, 0.0], [0.50692, 0.67394, 0.74419], 0.67227),
    row([1.0, 0.00, 30.0, 50.0], [0.76820, 0.94951, 1.0003], 0.93198),
    row([1.0, 0.00, 60.0, 180.0], [1.9157, 1.9417, 1.6684], 1.9059),
    row([1.0, 0.00, 80.0, 120.0], [3.4631, 2.9328, 1.6499], 2.9855),
    row([1.0, 0.00, 89.0, 75.0], [3.9296, 2.0368, 0.57701], 2.3914),
    row([8.0, 1.00, 0.0, 50.0], [1.1127, 1.8463, 2.8009], 1.7867),
    row([8.0, 1.00, 30.0, 180.0], [1.5110, 2.4035, 3.4281], 2.2913),
    row([8.0, 1.00, 60.0, 120.0], [3.1429, 4.4392, 5.4100], 4.1955),
    row([8.0, 1.00, 80.0, 75.0], [6.7037, 7.5776, 6.9178], 7.3966),
    row([8.0, 1.00, 89.0, 0.0], [136.27, 81.874, 23.879], 89.915),
    row([20.0, 0.80, 0.0, 180.0], [1.8569, 3.0718, 5.1404], 2.9803),
    row([20.0, 0.80, 30.0, 120.0], [2.0662, 3.4712, 5.7204], 3.3514),
    row([20.0, 0.80, 60.0, 75.0], [4.4394, 6.5145, 9.1996], 6.2814),
    row([20.0, 0.80, 80.0, 0.0], [104.05, 88.860, 56.781], 90.224),
    row([20.0, 0.80, 89.0, 50.0], [20.268, 18.380, 13.630], 18.412),
    row([35.0, 0.00, 0.0, 120.0], [1.7725, 3.3757, 7.0094], 3.3183),
    row([35.0, 0.00, 30.0, 75.0], [2.2784, 4.2099, 8.2808], 4.1068),
    row([35.0, 0.00, 60.0, 0.0], [17.703, 21.109, 24.301], 20.757),
    row([35.0, 0.00, 80.0, 50.0], [10.722, 16.228, 22.633], 15.511),
    row([35.0, 0.00, 89.0, 180.0], [17.615, 23.078, 23.742], 22.007),
    row([55.0, 0.25, 0.0, 75.0], [3.4928, 5.3359, 10.219], 5.2832),
    row([55.0, 0.25, 30.0, 0.0], [16.665, 18.822, 22.625], 18.878),
    row([55.0, 0.25, 60.0, 50.0], [6.4744, 10.019, 17.267], 9.7142),
    row([55.0, 0.25, 80.0, 180.0], [9.1348, 14.598, 23.247], 13.997),
    row([55.0, 0.25, 89.0, 120.0], [14.118, 17.827, 20.346], 17.305),
    row([80.0, 0.50, 0.0, 0.0], [18.345, 20.110, 22.977], 20.082),
    row([80.0, 0.50, 30.0, 50.0], [9.4985, 12.056, 16.700], 12.183),
    row([80.0, 0.50, 60.0, 180.0], [4.8300, 8.1345, 14.669], 7.8421),
    row([80.0, 0.50, 80.0, 120.0], [9.8971, 14.706, 22.546], 14.259),
    row([80.0, 0.50, 89.0, 75.0], [14.310, 17.984, 20.305], 17.435),
];

/// At zenith angle and azimuth from the sun, which stands over the x axis.
fn towards(zenith_deg: f32, azimuth_deg: f32) -> Vector3<f32> {
    let (zenith, azimuth) = (zenith_deg.to_radians(), azimuth_deg.to_radians());
    Vector3::new(
        zenith.sin() * azimuth.cos(),
        zenith.sin() * azimuth.sin(),
        zenith.cos(),
    )
}

fn look(row: &Row) -> SkyLook {
    SkyLook {
        sun_towards: towards(90.0 - row.sun_altitude_deg, 0.0),
        clouds_ratio: row.clouds_ratio,
        clear_klx: 10.0,
        sun_klx: [0.0; 3],
        night_klx: [0.0; 3],
        rayleigh_ratio: 1.0,
        mie_ratio: 1.0,
    }
}

#[test]
fn a_clear_sky_is_that_of_the_published_program() {
    for row in &PUBLISHED {
        let look = look(row);
        let sky = ClearSky::new(&look);
        let ours = sky
            .radiance(look.sun_towards, towards(row.zenith_deg, row.azimuth_deg))
            .map(|x| x / sky.scale);
        for (ours, theirs) in ours.into_iter().zip(row.rgb) {
            assert!(
                (ours / theirs - 1.0).abs() < 1e-4,
                "{ours} instead of {theirs}: sun {}°, {}°",
                row.sun_altitude_deg,
                row.zenith_deg
            );
        }
        let ratio = luminance(ours) / row.luminance;
        assert!(
            (ratio - 1.0).abs() < 0.06,
            "luminance is {ratio} of the published: sun {}°, {}°",
            row.sun_altitude_deg,
            row.zenith_deg
        );
    }
}

/// Painted without clouds, the map's texels lie where the published sky says: between those at the
/// row's place, by direction alone.
#[test]
fn texels_of_a_painted_sky_have_their_direction_s_radiance() {
    const SIDE_PX: usize = 256;
    for row in PUBLISHED
        .iter()
        .filter(|row| row.clouds_ratio == 0.0 && row.zenith_deg < 85.0)
    {
        let look = look(row);
        let (sky, map) = (ClearSky::new(&look), SkyMap::paint(&look, SIDE_PX));
        let asked = towards(row.zenith_deg, row.azimuth_deg);
        assert_eq!(
            cloud_cover(asked, 0.0),
            0.0,
            "a wisp of cloud hides what is compared"
        );
        let at = |i: usize| {
            direction_of(
                ((i % SIDE_PX) as f32 + 0.5) / SIDE_PX as f32,
                ((i / SIDE_PX) as f32 + 0.5) / SIDE_PX as f32,
            )
        };
        let nearest = (0..SIDE_PX * SIDE_PX)
            .min_by(|a, b| at(*a).angle(&asked).total_cmp(&at(*b).angle(&asked)))
            .expect("a map has texels");
        for (texel, theirs) in map.rgb[nearest].into_iter().zip(row.rgb) {
            let ratio = texel / sky.scale / theirs;
            assert!(
                (ratio - 1.0).abs() < 0.05,
                "{ratio} of the published: sun {}°, zenith {}°",
                row.sun_altitude_deg,
                row.zenith_deg
            );
        }
    }
}
