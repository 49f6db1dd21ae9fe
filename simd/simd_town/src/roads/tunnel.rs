//! Guard rails along fast roads, and tunnels.

use schema_types::{Class, ObjectId};
use sensor_core::Material;
use sensor_core::mesh::Surface;

use crate::chunk::{Chunks, Key, Layer, Levels};
use crate::geometry::P2;
use crate::network::Road;
use crate::town::CollisionMesh;

/// Distance of the rail from the kerb.
const BEHIND_KERB_M: f64 = 0.28;
/// Lower and upper edge over the road.
const RAIL_M: (f64, f64) = (0.5, 0.82);
/// Room left at junctions.
const GAP_M: f64 = 7.0;

/// Rails on both sides of a road, where it lies on the ground.
pub fn rails(chunks: &mut Chunks, solid: &mut CollisionMesh, road: &Road, object: ObjectId) {
    let steel = Surface::new(Class::GUARD_RAIL, Material::Metal, [150, 154, 158]).of(object);
    let length = road.path.length_m();
    for (from, to) in road.on_ground() {
        let (from, to) = (from.max(GAP_M), to.min(length - GAP_M));
        if to - from < 8.0 {
            continue;
        }
        let stations = road.stations_between(from, to);
        for side in [1.0, -1.0] {
            let t = side * (road.profile.kerb_m() + BEHIND_KERB_M);
            let post = |a: f64, b: f64, low: f64, high: f64| {
                [
                    road.point(a, t, low),
                    road.point(b, t, low),
                    road.point(b, t, high),
                    road.point(a, t, high),
                ]
            };
            for pair in stations.windows(2) {
                // Seen from the road and from behind.
                let front = post(pair[0], pair[1], RAIL_M.0, RAIL_M.1);
                let back = post(pair[1], pair[0], RAIL_M.0, RAIL_M.1);
                for face in [front, back] {
                    panel(chunks, steel, 0..=1, face);
                }
                let wall = post(pair[0], pair[1], 0.0, RAIL_M.1);
                solid.polygon(object, &wall);
                solid.polygon(object, &[wall[1], wall[0], wall[3], wall[2]]);
            }
            // From far away chords over two pieces do.
            for k in (0..stations.len() - 1).step_by(2) {
                let (a, b) = (stations[k], stations[(k + 2).min(stations.len() - 1)]);
                panel(chunks, steel, 2..=2, post(a, b, RAIL_M.0, RAIL_M.1));
                panel(chunks, steel, 2..=2, post(b, a, RAIL_M.0, RAIL_M.1));
            }
            let mut s = from + 0.3;
            while s < to - 0.2 {
                panel(chunks, steel, 0..=0, post(s, s + 0.12, 0.0, RAIL_M.0));
                panel(chunks, steel, 0..=0, post(s + 0.12, s, 0.0, RAIL_M.0));
                s += 4.0;
            }
        }
    }
}

/// Clear height of a tunnel, and thickness of what lies over it.
const TUNNEL_M: (f64, f64) = (5.6, 1.6);

/// Distance between a tunnel's lamps.
const LAMP_PITCH_M: f64 = 8.0;

/// A tunnel over the middle of a road: walls behind the pavements, a ceiling, grass on top and at
/// the sides. Returns where lamps belong,
/// counter-clockwise from below.
pub fn tunnel(
    chunks: &mut Chunks,
    solid: &mut CollisionMesh,
    road: &Road,
    object: ObjectId,
) -> Vec<[[f64; 3]; 4]> {
    let concrete = Surface::new(Class::BUILDINGS, Material::Concrete, [142, 140, 134]).of(object);
    let grass = Surface::new(Class::TERRAIN, Material::Grass, [100, 124, 66]).of(object);
    let (from, to) = (26.0, road.path.length_m() - 26.0);
    let mut stations: Vec<f64> = road
        .stations
        .iter()
        .copied()
        .filter(|&s| s > from + 0.5 && s < to - 0.5)
        .collect();
    stations.insert(0, from);
    stations.push(to);
    let (inner, outer, foot) = (
        road.profile.back_m() - 0.3,
        road.profile.back_m() + 0.5,
        road.profile.back_m() + 4.5,
    );
    let at = |s: f64, t: f64, z: f64| {
        let p = road.path.beside(s, t);
        [p.x, p.y, road.elevation.at(s) + z]
    };
    let (ceiling, top) = (TUNNEL_M.0, TUNNEL_M.0 + TUNNEL_M.1);
    let mut face = |surface: Surface, corners: [[f64; 3]; 4]| {
        let key = Key::at(Layer::Building, P2::new(corners[0][0], corners[0][1]));
        let size = |a: [f64; 3], b: [f64; 3]| {
            ((0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()) as f32
        };
        let (u, v) = (size(corners[0], corners[1]), size(corners[0], corners[3]));
        chunks.polygon(
            key,
            0..=2,
            surface,
            &corners,
            &[[0.0, 0.0], [u, 0.0], [u, v], [0.0, v]],
        );
        solid.polygon(object, &corners);
    };
    for pair in stations.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        face(
            concrete,
            [
                at(a, inner, -0.1),
                at(b, inner, -0.1),
                at(b, inner, ceiling),
                at(a, inner, ceiling),
            ],
        );
        face(
            concrete,
            [
                at(b, -inner, -0.1),
                at(a, -inner, -0.1),
                at(a, -inner, ceiling),
                at(b, -inner, ceiling),
            ],
        );
        face(
            concrete,
            [
                at(a, inner, ceiling),
                at(b, inner, ceiling),
                at(b, -inner, ceiling),
                at(a, -inner, ceiling),
            ],
        );
        face(
            grass,
            [
                at(a, -outer, top),
                at(b, -outer, top),
                at(b, outer, top),
                at(a, outer, top),
            ],
        );
        face(
            grass,
            [
                at(b, foot, -0.8),
                at(a, foot, -0.8),
                at(a, outer, top),
                at(b, outer, top),
            ],
        );
        face(
            grass,
            [
                at(a, -foot, -0.8),
                at(b, -foot, -0.8),
                at(b, -outer, top),
                at(a, -outer, top),
            ],
        );
    }
    // The portals: over the opening and beside it.
    for (s, outward) in [(from, false), (to, true)] {
        let mut portal = |low: (f64, f64, f64), high: (f64, f64, f64)| {
            let mut corners = [
                at(s, low.0, low.2),
                at(s, low.1, low.2),
                at(s, high.1, high.2),
                at(s, high.0, high.2),
            ];
            if outward {
                corners = [corners[1], corners[0], corners[3], corners[2]];
            }
            face(concrete, corners);
        };
        portal((outer, -outer, ceiling), (outer, -outer, top + 0.6));
        portal((foot, inner, -0.8), (outer, inner, top));
        portal((-inner, -foot, -0.8), (-inner, -outer, top));
    }
    let n_lamps = ((to - from) / LAMP_PITCH_M) as usize;
    let lamp = |k: usize| {
        let (s, z) = (from + (k as f64 + 0.5) * LAMP_PITCH_M, ceiling - 0.06);
        [
            at(s, 0.2, z),
            at(s + 0.8, 0.2, z),
            at(s + 0.8, -0.2, z),
            at(s, -0.2, z),
        ]
    };
    (0..n_lamps).map(lamp).collect()
}

fn panel(chunks: &mut Chunks, surface: Surface, levels: Levels, corners: [[f64; 3]; 4]) {
    let size = |a: [f64; 3], b: [f64; 3]| {
        ((0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()) as f32
    };
    let (u, v) = (size(corners[0], corners[1]), size(corners[0], corners[3]));
    let key = Key::at(Layer::Ground, P2::new(corners[0][0], corners[0][1]));
    chunks.polygon(
        key,
        levels,
        surface,
        &corners,
        &[[0.0, 0.0], [u, 0.0], [u, v], [0.0, v]],
    );
}
