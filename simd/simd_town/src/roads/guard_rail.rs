//! Guard rails along fast roads.

use schema_types::{Class, ObjectId};
use sensor_core::Material;
use sensor_core::mesh::Surface;

use crate::geometry::P2;
use crate::network::Road;
use crate::scenery::{Chunks, CollisionMesh, Key, Layer, Levels};

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
                // The rail is visible from the road and from behind.
                let front = post(pair[0], pair[1], RAIL_M.0, RAIL_M.1);
                let back = post(pair[1], pair[0], RAIL_M.0, RAIL_M.1);
                for face in [front, back] {
                    panel(chunks, steel, 0..=1, face);
                }
                let wall = post(pair[0], pair[1], 0.0, RAIL_M.1);
                solid.polygon(object, &wall);
                solid.polygon(object, &[wall[1], wall[0], wall[3], wall[2]]);
            }
            // From far away one chord spans two pieces.
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
