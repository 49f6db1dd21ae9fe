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

/// Rails on both sides of a road.
pub fn rails(chunks: &mut Chunks, solid: &mut CollisionMesh, road: &Road, object: ObjectId) {
    let steel = Surface::new(Class::GUARD_RAIL, Material::Metal, [150, 154, 158]).of(object);
    let length = road.path.length_m();
    let mut stations: Vec<f64> = road.stations().into_iter().filter(|&s| s > GAP_M + 0.5 && s < length - GAP_M - 0.5).collect();
    stations.insert(0, GAP_M);
    stations.push(length - GAP_M);
    for side in [1.0, -1.0] {
        let t = side * (road.profile.kerb_m() + BEHIND_KERB_M);
        for pair in stations.windows(2) {
            let (a, b) = (road.path.beside(pair[0], t), road.path.beside(pair[1], t));
            // Seen from the road and from behind.
            panel(chunks, steel, 0..=2, (a, b), RAIL_M);
            panel(chunks, steel, 0..=2, (b, a), RAIL_M);
            let face = corners(chunks, if side > 0.0 { (b, a) } else { (a, b) }, (0.0, RAIL_M.1));
            solid.polygon(&face);
            solid.polygon(&[face[1], face[0], face[3], face[2]]);
        }
        let mut s = GAP_M + 0.3;
        while s < length - GAP_M {
            let (a, b) = (road.path.beside(s, t), road.path.beside(s + 0.12, t));
            panel(chunks, steel, 0..=0, (a, b), (0.0, RAIL_M.0));
            panel(chunks, steel, 0..=0, (b, a), (0.0, RAIL_M.0));
            s += 4.0;
        }
    }
}

/// Clear height of a tunnel, and thickness of what lies over it.
const TUNNEL_M: (f64, f64) = (5.6, 1.6);

/// A tunnel over the middle of a road: walls behind the pavements, a ceiling with lamps, grass on top and at the sides.
pub fn tunnel(chunks: &mut Chunks, solid: &mut CollisionMesh, road: &Road, object: ObjectId) {
    let concrete = Surface::new(Class::BUILDINGS, Material::Concrete, [142, 140, 134]).of(object);
    let grass = Surface::new(Class::TERRAIN, Material::Grass, [100, 124, 66]).of(object);
    let lamp = Surface::lamp(Class::BUILDINGS, [255, 232, 190], 0).of(object);
    let (from, to) = (26.0, road.path.length_m() - 26.0);
    let mut stations: Vec<f64> = road.stations().into_iter().filter(|&s| s > from + 0.5 && s < to - 0.5).collect();
    stations.insert(0, from);
    stations.push(to);
    let (inner, outer, foot) = (road.profile.back_m() - 0.3, road.profile.back_m() + 0.5, road.profile.back_m() + 4.5);
    let at = |s: f64, t: f64, z: f64| {
        let p = road.path.beside(s, t);
        [p.x, p.y, road.elevation.at(s) + z]
    };
    let (ceiling, top) = (TUNNEL_M.0, TUNNEL_M.0 + TUNNEL_M.1);
    let mut face = |surface: Surface, corners: [[f64; 3]; 4], hard: bool| {
        let key = Key::at(Layer::Building, P2::new(corners[0][0], corners[0][1]));
        let size = |a: [f64; 3], b: [f64; 3]| ((0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()) as f32;
        let (u, v) = (size(corners[0], corners[1]), size(corners[0], corners[3]));
        chunks.polygon(key, 0..=2, surface, &corners, &[[0.0, 0.0], [u, 0.0], [u, v], [0.0, v]]);
        if hard {
            solid.polygon(&corners);
        }
    };
    for (k, pair) in stations.windows(2).enumerate() {
        let (a, b) = (pair[0], pair[1]);
        face(concrete, [at(a, inner, -0.1), at(b, inner, -0.1), at(b, inner, ceiling), at(a, inner, ceiling)], true);
        face(concrete, [at(b, -inner, -0.1), at(a, -inner, -0.1), at(a, -inner, ceiling), at(b, -inner, ceiling)], true);
        face(concrete, [at(a, inner, ceiling), at(b, inner, ceiling), at(b, -inner, ceiling), at(a, -inner, ceiling)], true);
        face(grass, [at(a, -outer, top), at(b, -outer, top), at(b, outer, top), at(a, outer, top)], true);
        face(grass, [at(b, foot, -0.8), at(a, foot, -0.8), at(a, outer, top), at(b, outer, top)], true);
        face(grass, [at(a, -foot, -0.8), at(b, -foot, -0.8), at(b, -outer, top), at(a, -outer, top)], true);
        if k % 2 == 0 {
            let z = ceiling - 0.06;
            face(lamp, [at(a, 0.3, z), at(b, 0.3, z), at(b, -0.3, z), at(a, -0.3, z)], false);
        }
    }
    // The portals: over the opening and beside it.
    for (s, outward) in [(from, false), (to, true)] {
        let mut portal = |low: (f64, f64, f64), high: (f64, f64, f64)| {
            let mut corners = [at(s, low.0, low.2), at(s, low.1, low.2), at(s, high.1, high.2), at(s, high.0, high.2)];
            if outward {
                corners = [corners[1], corners[0], corners[3], corners[2]];
            }
            face(concrete, corners, true);
        };
        portal((outer, -outer, ceiling), (outer, -outer, top + 0.6));
        portal((foot, inner, -0.8), (outer, inner, top));
        portal((-inner, -foot, -0.8), (-inner, -outer, top));
    }
}

fn corners(chunks: &Chunks, (a, b): (P2, P2), (low_m, high_m): (f64, f64)) -> [[f64; 3]; 4] {
    let (za, zb) = (chunks.terrain.at(a), chunks.terrain.at(b));
    [[a.x, a.y, za + low_m], [b.x, b.y, zb + low_m], [b.x, b.y, zb + high_m], [a.x, a.y, za + high_m]]
}

fn panel(chunks: &mut Chunks, surface: Surface, levels: Levels, (a, b): (P2, P2), span_m: (f64, f64)) {
    let corners = corners(chunks, (a, b), span_m);
    let (u, v) = ((b - a).norm() as f32, (span_m.1 - span_m.0) as f32);
    chunks.polygon(Key::at(Layer::Ground, 0.5 * (a + b)), levels, surface, &corners, &[[0.0, 0.0], [u, 0.0], [u, v], [0.0, v]]);
}
