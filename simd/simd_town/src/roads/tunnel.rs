//! Tunnels: walls, a ceiling with lamps, grass over it.

use schema_types::{Class, ObjectId};
use sensor_core::Material;
use sensor_core::mesh::Surface;

use crate::geometry::P2;
use crate::network::Road;
use crate::scenery::{ALL, Builder, Chunks, CollisionMesh, Key, LampGroup, Layer, SceneryLamp};

/// Clear height of a tunnel, and thickness of what lies over it.
const TUNNEL_M: (f64, f64) = (5.6, 1.6);

/// Distance between a tunnel's lamps.
const LAMP_PITCH_M: f64 = 8.0;

/// Builds a tunnel over the middle of a road: walls behind the pavements, a ceiling, grass on top
/// and at the sides. Returns the corners of its lamps, counter-clockwise from below.
fn walls(
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

/// Builds the tunnel of a road with its lamps.
pub fn build(builder: &mut Builder<'_>, road: &Road) {
    let object = builder.object(Class::BUILDINGS, "tunnel");
    for corners in walls(&mut builder.chunks, &mut builder.solid, road, object) {
        lamp(builder, &corners);
    }
}

/// A lamp below a tunnel's ceiling.
fn lamp(builder: &mut Builder<'_>, corners_m: &[[f64; 3]; 4]) {
    let object = builder.object(Class::BUILDINGS, "tunnel_lamp");
    let rgb = [255, 232, 190];
    let key = Key::at(Layer::Building, P2::new(corners_m[0][0], corners_m[0][1]));
    builder.chunks.polygon(
        key,
        ALL,
        Surface::lamp(Class::BUILDINGS, rgb, 0).of(object),
        corners_m,
        &[[0.0; 2]; 4],
    );
    let position_m =
        std::array::from_fn(|i| 0.25 * corners_m.iter().map(|corner| corner[i]).sum::<f64>());
    builder.lamps.push(SceneryLamp {
        object,
        position_m,
        rgb,
        intensity_lm: 3000.0,
        group: LampGroup::Other,
    });
}
