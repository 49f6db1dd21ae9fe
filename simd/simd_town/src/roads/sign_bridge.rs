//! Sign bridges over motorways.

use schema_types::Class;
use sensor_core::Material;
use sensor_core::mesh::Surface;

use crate::geometry::{P2, area, left, unit};
use crate::network::Road;
use crate::scenery::{ALL, Builder, Key, Layer};

/// Clear height under the beam.
const CLEAR_M: f64 = 5.8;
/// Shortest stretch of motorway that gets one.
const MIN_M: f64 = 130.0;

/// Puts a sign bridge over a long stretch of motorway, 62 m behind its start.
pub fn build(builder: &mut Builder<'_>, road: &Road) {
    if road.path.length_m() < MIN_M {
        return;
    }
    let s = 62.0;
    if road.is_on_bridge(s) || builder.network.is_near_bridge(road.path.at(s).0, 14.0) {
        return;
    }
    let object = builder.object(Class::TRAFFIC_SIGNS, "sign_bridge");
    let (p, heading) = road.path.at(s);
    let (u, v) = (unit(heading), left(unit(heading)));
    let z = road.elevation.at(s);
    let reach = road.profile.kerb_m() + 0.9;
    let key = Key::at(Layer::Small, p);
    let steel = Surface::new(Class::POLES, Material::Metal, [112, 116, 120]).of(object);
    let bar = |t0: f64, t1: f64, half: f64| {
        [
            p + v * t0 - u * half,
            p + v * t0 + u * half,
            p + v * t1 + u * half,
            p + v * t1 - u * half,
        ]
    };
    let upright = |t: f64| bar(t + 0.16, t - 0.16, 0.16).map(|q: P2| q);
    for t in [reach, -reach] {
        let mut post = upright(t);
        post.reverse();
        builder
            .chunks
            .prism(key, ALL, steel, &ccw(post), (z - 0.3, z + CLEAR_M + 1.4));
        builder
            .solid
            .prism(object, &ccw(post), (z - 0.3, z + CLEAR_M + 1.4));
    }
    for (low, high) in [(0.0, 0.16), (1.24, 1.4)] {
        let beam = ccw(bar(-reach, reach, 0.13));
        builder.chunks.prism(
            key,
            ALL,
            steel,
            &beam,
            (z + CLEAR_M + low, z + CLEAR_M + high),
        );
    }
    let panel = Surface::new(Class::TRAFFIC_SIGNS, Material::Matte, [18, 72, 148]).of(object);
    let white = Surface::new(Class::TRAFFIC_SIGNS, Material::Matte, [236, 238, 238]).of(object);
    for lane in 0..road.profile.n_lanes {
        let middle = -(road.profile.lane_left_m(lane) + 0.5 * road.profile.lane_m);
        let half = 0.43 * road.profile.lane_m;
        let (low, high) = (z + CLEAR_M - 0.2, z + CLEAR_M + 2.3);
        // The panel faces the traffic.
        let face = |t0: f64, t1: f64, back: f64| (p - u * back + v * t0, p - u * back + v * t1);
        builder.chunks.wall(
            key,
            ALL,
            panel,
            face(middle + half, middle - half, 0.2),
            (low, high),
            0.0,
        );
        let (a, c) = face(middle + half, middle - half, 0.17);
        builder
            .chunks
            .wall(key, ALL, steel, (c, a), (low, high), 0.0);
        let stripe = |builder: &mut Builder<'_>, t0: f64, t1: f64, z0: f64, z1: f64| {
            builder.chunks.wall(
                key,
                0..=1,
                white,
                face(middle + t0, middle + t1, 0.215),
                (z0, z1),
                0.0,
            );
        };
        // A border, two lines of text as bars, an arrow down to the lane.
        stripe(builder, half - 0.06, 0.06 - half, high - 0.12, high - 0.07);
        stripe(builder, half - 0.06, 0.06 - half, low + 0.07, low + 0.12);
        stripe(builder, half - 0.06, half - 0.11, low + 0.07, high - 0.07);
        stripe(builder, 0.11 - half, 0.06 - half, low + 0.07, high - 0.07);
        for (row, width) in [(0.42, 0.9), (0.85, 0.62)] {
            let letters = 7;
            for k in 0..letters {
                let t = half * width * (1.0 - 2.0 * (k as f64 + 0.15) / letters as f64);
                let wide = half * width * 1.3 / letters as f64;
                stripe(builder, t, t - wide, high - row - 0.26, high - row);
            }
        }
        stripe(builder, 0.06, -0.06, low + 0.45, low + 0.95);
        let (tip, base) = (
            face(middle, middle, 0.215).0,
            face(middle + 0.24, middle - 0.24, 0.215),
        );
        let at = |q: P2, z: f64| [q.x, q.y, z];
        builder.chunks.polygon(
            key,
            0..=1,
            white,
            &[
                at(tip, low + 0.2),
                at(base.1, low + 0.52),
                at(base.0, low + 0.52),
            ],
            &[[0.0; 2]; 3],
        );
    }
}

/// The corners counter-clockwise from above.
fn ccw(mut corners: [P2; 4]) -> [P2; 4] {
    if area(&corners) < 0.0 {
        corners.reverse();
    }
    corners
}
