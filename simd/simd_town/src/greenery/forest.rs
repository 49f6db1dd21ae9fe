//! Woods in the distance: upright bands of treetops beyond the town, so that the horizon is not
//! bare.

use schema_types::Class;
use sensor_core::Material;
use sensor_core::mesh::Surface;

use crate::geometry::{P2, contains, unit};
use crate::random::Random;
use crate::scenery::{ALL, Builder, Key, Layer, MapLayer};

/// Stream of random numbers.
const WOODS: u64 = 0x75;
/// Length of a band and of its pieces.
const BAND_M: (f64, f64) = (150.0, 12.5);

/// Plants the woods round the town's border.
pub fn build(builder: &mut Builder<'_>, border_m: &[P2]) {
    let mut random = Random::new(builder.seed, WOODS, 0);
    let reach = border_m.iter().map(|p| p.norm()).fold(0.0, f64::max);
    for row in 0..3 {
        let radius = reach + 90.0 + 130.0 * f64::from(row);
        let n = (std::f64::consts::TAU * radius / (BAND_M.0 * 1.12)) as usize;
        for k in 0..n {
            if !random.chance(0.72) {
                continue;
            }
            let angle = std::f64::consts::TAU * (k as f64 + random.between(0.0, 0.4)) / n as f64;
            let (away, height) = (
                radius + random.between(-30.0, 40.0),
                random.between(8.0, 13.0),
            );
            let turn = BAND_M.0 / away;
            let points: Vec<P2> = (0..=(BAND_M.0 / BAND_M.1) as usize)
                .map(|i| angle + turn * i as f64 * BAND_M.1 / BAND_M.0)
                .map(|a| unit(a) * (away + random.between(-7.0, 7.0)))
                .collect();
            if points.iter().all(|&p| !contains(border_m, p)) {
                band(builder, &points, height, &mut random);
            }
        }
    }
}

/// One band; seen from both sides.
fn band(builder: &mut Builder<'_>, points: &[P2], height_m: f64, random: &mut Random) {
    let object = builder.object_in(Some(MapLayer::Foliage), Class::VEGETATION, "wood");
    let rgb = random.pick(&[[62, 88, 44], [72, 96, 48], [54, 80, 46], [80, 100, 52]]);
    let leaves = Surface::new(Class::VEGETATION, Material::Foliage, rgb).of(object);
    let tops: Vec<f64> = points
        .iter()
        .enumerate()
        .map(|(i, _)| {
            if i == 0 || i + 1 == points.len() {
                2.0
            } else {
                height_m * random.between(0.7, 1.15)
            }
        })
        .collect();
    let ground: Vec<f64> = points
        .iter()
        .map(|&p| builder.chunks.terrain.at(p))
        .collect();
    for i in 0..points.len() - 1 {
        let (p, q) = (points[i], points[i + 1]);
        let middle = 0.5 * (p + q);
        // The peak lies over the line between both tops, so that the piece is convex.
        let flat = 0.5 * (ground[i] + tops[i] + ground[i + 1] + tops[i + 1]);
        let peak = (0.5 * (ground[i] + ground[i + 1]) + height_m * random.between(0.85, 1.3))
            .max(flat + 0.5);
        let at = |p: P2, z: f64| [p.x, p.y, z];
        let corners = [
            at(p, ground[i] - 1.0),
            at(q, ground[i + 1] - 1.0),
            at(q, ground[i + 1] + tops[i + 1]),
            at(middle, peak),
            at(p, ground[i] + tops[i]),
        ];
        let uv = [
            [0.0, 0.0],
            [12.0, 0.0],
            [12.0, 8.0],
            [6.0, 10.0],
            [0.0, 8.0],
        ];
        let key = Key::at(Layer::Wood, middle);
        builder.chunks.polygon(key, ALL, leaves, &corners, &uv);
        let mut back = corners;
        back.reverse();
        builder.chunks.polygon(key, ALL, leaves, &back, &uv);
    }
}
