//! Kerbs and pavements round the blocks, and what lies inside them: yards, lawns, ponds.

use schema_types::{Class, ObjectId};
use sensor_core::Material;
use sensor_core::mesh::Surface;

use super::fill::Pond;
use super::ring::Ring;
use crate::geometry::{P2, unit};
use crate::network::KERB_HEIGHT_M;
use crate::scenery::{ALL, Chunks, Floor, Key, Layer};

/// Width of the kerb stone's top.
const STONE_M: f64 = 0.16;

/// Kerb and pavement round a block.
pub fn pavement(chunks: &mut Chunks, floor: &mut Floor, ring: &Ring, object: ObjectId) {
    let slabs = Surface::new(Class::SIDEWALKS, Material::Concrete, [104, 103, 102]).of(object);
    let stone = Surface::new(Class::SIDEWALKS, Material::Concrete, [126, 125, 124]).of(object);
    let n = ring.kerb_m.len();
    let pavement = (slabs, stone);
    let grass = Surface::new(Class::TERRAIN, Material::Grass, [95, 111, 66]).of(object);
    for i in (0..n).filter(|&i| !ring.seam[i]) {
        let (slabs, stone) = if ring.verge[i] && ring.verge[(i + 1) % n] {
            (grass, grass)
        } else {
            pavement
        };
        let k = (i + 1) % n;
        let (a, b) = (ring.kerb_m[i], ring.kerb_m[k]);
        if (a - b).norm() < 1e-6 && (ring.back_m[i] - ring.back_m[k]).norm() < 1e-6 {
            continue;
        }
        let lift = |p: P2, i: usize, up: f64| [p.x, p.y, ring.height_m[i] + up];
        let kerb = |i: usize| lift(ring.kerb_m[i], i, ring.rise_m[i]);
        let back = |i: usize| lift(ring.back_m[i], i, KERB_HEIGHT_M);
        // The stone lies along the slope from kerb to back.
        let inner = |i: usize| {
            let across = ring.back_m[i] - ring.kerb_m[i];
            let share = (STONE_M / across.norm()).min(0.5);
            lift(
                ring.kerb_m[i] + across * share,
                i,
                ring.rise_m[i] + (KERB_HEIGHT_M - ring.rise_m[i]) * share,
            )
        };
        let whole = [kerb(i), kerb(k), back(k), back(i)];
        chunks.sheet(
            Layer::Ground,
            0..=0,
            stone,
            &[kerb(i), kerb(k), inner(k), inner(i)],
        );
        chunks.sheet(
            Layer::Ground,
            0..=0,
            slabs,
            &[inner(i), inner(k), back(k), back(i)],
        );
        chunks.sheet(Layer::Ground, 1..=2, slabs, &whole);
        floor.raised.polygon(object, &whole);
        if (a - b).norm() > 1e-6 {
            let key = Key::at(Layer::Ground, 0.5 * (a + b));
            let face = [lift(a, i, -0.08), lift(b, k, -0.08), kerb(k), kerb(i)];
            let (length, height) = ((b - a).norm() as f32, KERB_HEIGHT_M as f32 + 0.08);
            chunks.polygon(
                key,
                0..=1,
                stone,
                &face,
                &[[0.0, 0.0], [length, 0.0], [length, height], [0.0, height]],
            );
            floor.raised.polygon(object, &face);
        }
    }
}

/// Yard, lawn or open country behind the pavements.
pub fn block(chunks: &mut Chunks, floor: &mut Floor, ring: &Ring, green: bool, object: ObjectId) {
    let surface = if green {
        Surface::new(
            Class::TERRAIN,
            Material::Grass,
            if ring.outside {
                [100, 114, 70]
            } else {
                [92, 113, 63]
            },
        )
    } else {
        Surface::new(Class::GROUND, Material::Concrete, [128, 124, 116])
    };
    let ground = &ring.ground;
    for triangle in &ground.triangles {
        let corners = triangle.map(|i| {
            [
                ground.points_m[i].x,
                ground.points_m[i].y,
                ground.heights_m[i] + KERB_HEIGHT_M,
            ]
        });
        chunks.sheet(Layer::Ground, ALL, surface.of(object), &corners);
        floor.raised.polygon(object, &corners);
    }
}

/// The surface of a pond, a little wider than its shore.
pub fn pond(chunks: &mut Chunks, pond: &Pond, object: ObjectId) {
    let water = Surface::new(Class::WATER, Material::Water, [38, 62, 66]).of(object);
    let at = |k: usize| {
        let p =
            pond.middle_m + unit(std::f64::consts::TAU * k as f64 / 24.0) * (pond.radius_m + 8.0);
        [p.x, p.y, pond.level_m + KERB_HEIGHT_M]
    };
    let middle = [
        pond.middle_m.x,
        pond.middle_m.y,
        pond.level_m + KERB_HEIGHT_M,
    ];
    for k in 0..24 {
        chunks.sheet(
            Layer::Ground,
            ALL,
            water,
            &[middle, at(k), at((k + 1) % 24)],
        );
    }
}
