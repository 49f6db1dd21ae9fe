//! Front doors: a leaf with a window over it in a stone surround, a step, and for some a canopy.

use schema_types::{Class, ObjectId};
use sensor_core::Material;
use sensor_core::mesh::Surface;

use super::lot::Lot;
use crate::geometry::P2;
use crate::network::KERB_HEIGHT_M;
use crate::random::Random;
use crate::scenery::{Chunks, Key, Layer};

/// Stream of random numbers.
const DOORS: u64 = 0x7b;
/// Half widths of the stone surround and of the leaf.
const HALF_M: (f64, f64) = (0.74, 0.50);

/// Place of a house's door along its street side, for houses without a garden path.
pub fn place_m(lot: &Lot, object: ObjectId) -> f64 {
    let width = (lot.footprint_m[1] - lot.footprint_m[0]).norm();
    width * Random::new(0, DOORS, u64::from(object.0)).between(0.3, 0.7)
}

/// Adds the door of a house, its middle `at_m` along the street side.
pub fn build(chunks: &mut Chunks, lot: &Lot, at_m: f64, object: ObjectId) {
    let mut random = Random::new(1, DOORS, u64::from(object.0));
    let f = lot.footprint_m;
    let (along, out) = ((f[1] - f[0]).normalize(), (f[0] - f[3]).normalize());
    let base = KERB_HEIGHT_M + chunks.terrain.at(f[0]).max(chunks.terrain.at(f[1]));
    let key = Key::at(Layer::Building, f.iter().sum::<P2>() / 4.0);
    let surface = |material, rgb| Surface::new(Class::BUILDINGS, material, rgb).of(object);
    let at = |u: f64, deep: f64| f[0] + along * (at_m + u) + out * deep;
    // A box before the wall: its front, its sides and its lid.
    let mut block =
        |surface: Surface, half: f64, deep: f64, (low, high): (f64, f64), has_floor: bool| {
            let (a, b, c, d) = (
                at(-half, deep),
                at(half, deep),
                at(half, 0.0),
                at(-half, 0.0),
            );
            for side in [(d, a), (a, b), (b, c)] {
                chunks.wall(key, 0..=0, surface, side, (base + low, base + high), 0.0);
            }
            let level = |corners: [P2; 4], z: f64| corners.map(|p| [p.x, p.y, base + z]);
            chunks.polygon(
                key,
                0..=0,
                surface,
                &level([a, b, c, d], high),
                &[[0.0; 2]; 4],
            );
            if has_floor {
                chunks.polygon(
                    key,
                    0..=0,
                    surface,
                    &level([d, c, b, a], low),
                    &[[0.0; 2]; 4],
                );
            }
        };
    let stone = surface(
        Material::Concrete,
        random.pick(&[[196, 190, 178], [150, 144, 136], [216, 212, 204]]),
    );
    block(stone, HALF_M.0, 0.10, (-0.3, 2.72), false);
    block(
        surface(Material::Concrete, [140, 136, 130]),
        HALF_M.0 + 0.1,
        0.42,
        (-0.3, 0.09),
        false,
    );
    if random.chance(0.4) {
        block(stone, HALF_M.0 + 0.25, 0.85, (2.72, 2.84), true);
    }
    let mut pane = |surface: Surface, half: f64, (low, high): (f64, f64)| {
        let (a, b) = (at(-half, 0.105), at(half, 0.105));
        chunks.wall(key, 0..=0, surface, (a, b), (base + low, base + high), 0.0);
    };
    let leaf = random.pick(&[
        [96, 34, 30],
        [34, 62, 48],
        [40, 52, 84],
        [112, 78, 48],
        [62, 58, 54],
        [176, 172, 164],
    ]);
    pane(surface(Material::Matte, leaf), HALF_M.1, (0.09, 2.12));
    pane(
        surface(Material::Glass, [40, 46, 52]),
        HALF_M.1,
        (2.2, 2.55),
    );
}
