//! Guard rails along fast roads.

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

fn corners(chunks: &Chunks, (a, b): (P2, P2), (low_m, high_m): (f64, f64)) -> [[f64; 3]; 4] {
    let (za, zb) = (chunks.terrain.at(a), chunks.terrain.at(b));
    [[a.x, a.y, za + low_m], [b.x, b.y, zb + low_m], [b.x, b.y, zb + high_m], [a.x, a.y, za + high_m]]
}

fn panel(chunks: &mut Chunks, surface: Surface, levels: Levels, (a, b): (P2, P2), span_m: (f64, f64)) {
    let corners = corners(chunks, (a, b), span_m);
    let (u, v) = ((b - a).norm() as f32, (span_m.1 - span_m.0) as f32);
    chunks.polygon(Key::at(Layer::Ground, 0.5 * (a + b)), levels, surface, &corners, &[[0.0, 0.0], [u, 0.0], [u, v], [0.0, v]]);
}
