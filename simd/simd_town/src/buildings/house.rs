//! Houses: walls, roofs, shops, ornaments.

use schema_types::{Class, ObjectId};
use sensor_core::Material;
use sensor_core::mesh::Surface;

use super::entrance;
use super::lot::Lot;
use crate::geometry::P2;
use crate::network::KERB_HEIGHT_M;
use crate::plan::Houses;
use crate::random::Random;
use crate::scenery::{ALL, Chunks, CollisionMesh, Key, Layer, Levels};

const WALLS: [[u8; 3]; 12] = [
    [150, 138, 120],
    [122, 78, 64],
    [170, 164, 154],
    [118, 98, 84],
    [178, 166, 142],
    [104, 108, 112],
    [144, 114, 92],
    [166, 150, 140],
    [124, 128, 124],
    [94, 72, 62],
    [188, 182, 172],
    [140, 126, 110],
];

struct House {
    key: Key,
    object: ObjectId,
    footprint: [P2; 4],
    wall: [u8; 3],
    shop_m: f64,
    eaves_m: f64,
    base_m: f64,
}

/// How high houses are.
struct Size {
    /// Least number of floors over the shop, and number of choices.
    floors: (usize, usize),
    /// Share with a shop in the ground floor.
    shops: f64,
    /// Share with a pitched roof.
    pitched: f64,
}

impl Size {
    fn of(houses: Houses, lot: &Lot) -> Size {
        match houses {
            Houses::Towers { within_m } if lot.footprint_m[0].norm() < within_m => Size {
                floors: (4, 8),
                shops: 0.85,
                pitched: 0.0,
            },
            Houses::Towers { .. } => Size {
                floors: (3, 4),
                shops: 0.45,
                pitched: 0.45,
            },
            Houses::Terraces => Size {
                floors: (2, 2),
                shops: 0.35,
                pitched: 0.85,
            },
            Houses::Cottages => Size {
                floors: (1, 2),
                shops: 0.0,
                pitched: 0.95,
            },
            Houses::Farms => Size {
                floors: (1, 2),
                shops: 0.0,
                pitched: 1.0,
            },
        }
    }
}

/// Builds a house on a lot. Returns its height over the pavement.
pub fn build(
    chunks: &mut Chunks,
    solid: &mut CollisionMesh,
    lot: &Lot,
    houses: Houses,
    object: ObjectId,
    random: &mut Random,
) -> f64 {
    let size = Size::of(houses, lot);
    let floors = size.floors.0 + random.below(size.floors.1);
    let shop_m = if random.chance(size.shops) { 3.9 } else { 0.0 };
    let eaves_m = shop_m + 3.1 * floors as f64 + 0.4;
    let middle = lot.footprint_m.iter().sum::<P2>() / 4.0;
    let heights = lot.footprint_m.map(|p| chunks.terrain.at(p));
    let base_m = KERB_HEIGHT_M + heights[0].max(heights[1]);
    let lowest_m = heights.into_iter().fold(f64::INFINITY, f64::min) - 0.1;
    let house = House {
        key: Key::at(Layer::Building, middle),
        object,
        footprint: lot.footprint_m,
        wall: random.pick(&WALLS),
        shop_m,
        eaves_m,
        base_m,
    };
    walls(chunks, &house);
    if lowest_m < base_m - 0.3 {
        chunks.prism(
            house.key,
            ALL,
            house.surface(Material::Concrete, house.darker(0.7)),
            &house.grown(0.03),
            (lowest_m, base_m - 0.05),
        );
    }
    let pitched = size.pitched > 0.0 && floors < 6 && random.chance(size.pitched);
    if pitched {
        pitched_roof(chunks, &house)
    } else {
        flat_roof(chunks, &house, random)
    }
    ornaments(chunks, &house, pitched, random);
    // Houses with gardens have their doors where the path leads.
    if shop_m == 0.0 && !matches!(houses, Houses::Cottages | Houses::Farms) {
        entrance::build(chunks, lot, entrance::place_m(lot, object), object);
    }
    solid.prism(object, &house.footprint, (lowest_m, base_m + eaves_m));
    eaves_m
}

impl House {
    fn surface(&self, material: Material, rgb: [u8; 3]) -> Surface {
        Surface::new(Class::BUILDINGS, material, rgb).of(self.object)
    }

    fn darker(&self, share: f64) -> [u8; 3] {
        self.wall.map(|c| (f64::from(c) * share) as u8)
    }

    /// The footprint moved outwards by this much (negative: inwards).
    fn grown(&self, by: f64) -> [P2; 4] {
        let f = &self.footprint;
        let along = (f[1] - f[0]).normalize() * by;
        let deep = (f[3] - f[0]).normalize() * by;
        [
            f[0] - along - deep,
            f[1] + along - deep,
            f[2] + along + deep,
            f[3] - along + deep,
        ]
    }
}

fn walls(chunks: &mut Chunks, house: &House) {
    let facade = house.surface(Material::Facade, house.wall);
    let shop = house.surface(Material::ShopFront, house.darker(0.62));
    let f = &house.footprint;
    for i in 0..4 {
        let edge = (f[i], f[(i + 1) % 4]);
        let at_street = i == 0;
        let low = if house.shop_m > 0.0 {
            house.base_m + house.shop_m
        } else {
            house.base_m
        };
        if house.shop_m > 0.0 {
            let ground = if at_street || i % 2 == 1 {
                shop
            } else {
                facade
            };
            chunks.wall(house.key, ALL, ground, edge, (house.base_m - 0.1, low), 0.0);
        }
        chunks.wall(
            house.key,
            ALL,
            facade,
            edge,
            (
                low - if house.shop_m > 0.0 { 0.0 } else { 0.1 },
                house.base_m + house.eaves_m,
            ),
            0.0,
        );
    }
}

fn flat_roof(chunks: &mut Chunks, house: &House, random: &mut Random) {
    let felt = house.surface(Material::Roof, [92, 90, 88]);
    let trim = house.surface(Material::Concrete, house.darker(0.86));
    let top = house.base_m + house.eaves_m;
    let parapet = 0.7;
    let inner = house.grown(-0.3);
    for i in 0..4 {
        let k = (i + 1) % 4;
        let f = &house.footprint;
        chunks.wall(
            house.key,
            0..=1,
            trim,
            (f[i], f[k]),
            (top, top + parapet),
            0.0,
        );
        chunks.wall(
            house.key,
            0..=1,
            trim,
            (inner[k], inner[i]),
            (top, top + parapet),
            0.0,
        );
        let rim = [f[i], f[k], inner[k], inner[i]].map(|p| [p.x, p.y, top + parapet]);
        chunks.polygon(house.key, 0..=1, trim, &rim, &[[0.0; 2]; 4]);
    }
    let lid = |p: &[P2; 4]| p.map(|p| [p.x, p.y, top]);
    chunks.polygon(
        house.key,
        ALL,
        felt,
        &lid(&house.footprint),
        &house.footprint.map(|p| [p.x as f32, p.y as f32]),
    );
    let f = &house.footprint;
    let place = |u: f64, v: f64| f[0] + (f[1] - f[0]) * u + (f[3] - f[0]) * v;
    if random.chance(0.75) {
        let (u, v) = (random.between(0.2, 0.6), random.between(0.4, 0.6));
        let hut = [
            place(u, v),
            place(u + 0.2, v),
            place(u + 0.2, v + 0.25),
            place(u, v + 0.25),
        ];
        chunks.prism(
            house.key,
            0..=1,
            trim,
            &hut,
            (top, top + random.between(1.8, 3.0)),
        );
    }
    for _ in 0..random.below(3) {
        let (u, v) = (random.between(0.1, 0.8), random.between(0.1, 0.3));
        let unit_ = [
            place(u, v),
            place(u + 0.08, v),
            place(u + 0.08, v + 0.1),
            place(u, v + 0.1),
        ];
        chunks.prism(
            house.key,
            0..=0,
            house.surface(Material::Metal, [150, 152, 154]),
            &unit_,
            (top, top + 1.1),
        );
    }
}

fn pitched_roof(chunks: &mut Chunks, house: &House) {
    let tiles = house.surface(
        Material::Roof,
        if house.object.0.is_multiple_of(3) {
            [112, 62, 48]
        } else {
            [86, 78, 76]
        },
    );
    let gable = house.surface(Material::Matte, house.wall);
    let f = house.grown(0.0);
    let top = house.base_m + house.eaves_m;
    let depth = (f[3] - f[0]).norm();
    let ridge_m = top + 0.42 * depth;
    let ridge = [0.5 * (f[0] + f[3]), 0.5 * (f[1] + f[2])];
    let up = |p: P2, z: f64| [p.x, p.y, z];
    let slope = (0.25 * depth * depth + (ridge_m - top).powi(2)).sqrt() as f32;
    let width = (f[1] - f[0]).norm() as f32;
    let uv = [[0.0, 0.0], [width, 0.0], [width, slope], [0.0, slope]];
    chunks.polygon(
        house.key,
        ALL,
        tiles,
        &[
            up(f[0], top),
            up(f[1], top),
            up(ridge[1], ridge_m),
            up(ridge[0], ridge_m),
        ],
        &uv,
    );
    chunks.polygon(
        house.key,
        ALL,
        tiles,
        &[
            up(f[2], top),
            up(f[3], top),
            up(ridge[0], ridge_m),
            up(ridge[1], ridge_m),
        ],
        &uv,
    );
    chunks.polygon(
        house.key,
        ALL,
        gable,
        &[up(f[1], top), up(f[2], top), up(ridge[1], ridge_m)],
        &[[0.0; 2]; 3],
    );
    chunks.polygon(
        house.key,
        ALL,
        gable,
        &[up(f[3], top), up(f[0], top), up(ridge[0], ridge_m)],
        &[[0.0; 2]; 3],
    );
    for share in [0.3, 0.72] {
        let p = f[0] + (f[1] - f[0]) * share + (f[3] - f[0]) * 0.62;
        let (u, v) = (
            (f[1] - f[0]).normalize() * 0.45,
            (f[3] - f[0]).normalize() * 0.3,
        );
        let stack = [p - u - v, p + u - v, p + u + v, p - u + v];
        chunks.prism(
            house.key,
            0..=1,
            house.surface(Material::Matte, [122, 74, 60]),
            &stack,
            (top, ridge_m + 0.7),
        );
    }
}

/// Bands, pilasters, balconies and awnings of the street side, seen from near.
fn ornaments(chunks: &mut Chunks, house: &House, pitched: bool, random: &mut Random) {
    let f = house.footprint;
    let along = (f[1] - f[0]).normalize();
    let out = -(f[3] - f[0]).normalize();
    let width = (f[1] - f[0]).norm();
    let stone = house.surface(Material::Concrete, house.darker(0.9));
    let slab = |from: f64, to: f64, depth: f64| {
        let p = |u: f64, d: f64| f[0] + along * u + out * d;
        [p(from, depth), p(to, depth), p(to, 0.0), p(from, 0.0)]
    };
    let mut band = |z: f64, depth: f64, height: f64, levels| {
        closed_prism(
            chunks,
            house.key,
            levels,
            stone,
            &slab(0.02, width - 0.02, depth),
            (z, z + height),
        );
    };
    let top = house.base_m + house.eaves_m;
    band(top - 0.35, if pitched { 0.4 } else { 0.28 }, 0.3, 0..=1);
    if house.shop_m > 0.0 {
        band(house.base_m + house.shop_m - 0.25, 0.18, 0.3, 0..=0);
    } else {
        band(house.base_m - 0.1, 0.06, 0.7, 0..=0);
    }
    for u in [0.02, width - 0.42] {
        closed_prism(
            chunks,
            house.key,
            0..=0,
            stone,
            &slab(u, u + 0.4, 0.1),
            (house.base_m - 0.1, top - 0.35),
        );
    }
    if house.shop_m > 0.0 && random.chance(0.6) {
        let awning = house.surface(
            Material::Cloth,
            random.pick(&[[150, 40, 36], [36, 84, 60], [40, 60, 110], [190, 150, 60]]),
        );
        let (u0, u1) = (0.15 * width, 0.85 * width);
        let p = |u: f64, d: f64, z: f64| {
            let q = f[0] + along * u + out * d;
            [q.x, q.y, house.base_m + z]
        };
        let (high, low) = (3.3, 2.75);
        chunks.polygon(
            house.key,
            0..=1,
            awning,
            &[
                p(u0, 1.2, low),
                p(u1, 1.2, low),
                p(u1, 0.02, high),
                p(u0, 0.02, high),
            ],
            &[[0.0; 2]; 4],
        );
        chunks.polygon(
            house.key,
            0..=1,
            awning,
            &[
                p(u0, 0.02, high),
                p(u1, 0.02, high),
                p(u1, 1.2, low),
                p(u0, 1.2, low),
            ],
            &[[0.0; 2]; 4],
        );
    }
    if random.chance(0.4) {
        let rail = house.surface(Material::Metal, [58, 60, 64]);
        let n_floors = ((house.eaves_m - house.shop_m) / 3.1) as usize;
        let columns = ((width - 3.0) / 4.5).max(1.0) as usize;
        for floor in 1..n_floors.min(6) {
            for c in 0..columns {
                let u = 1.5 + (width - 3.0) * (c as f64 + 0.5) / columns as f64;
                let z = house.base_m + house.shop_m + 3.1 * floor as f64;
                closed_prism(
                    chunks,
                    house.key,
                    0..=0,
                    stone,
                    &slab(u - 1.1, u + 1.1, 0.95),
                    (z - 0.12, z),
                );
                closed_prism(
                    chunks,
                    house.key,
                    0..=0,
                    rail,
                    &slab(u - 1.1, u + 1.1, 0.95),
                    (z, z + 0.06),
                );
                let front = slab(u - 1.1, u + 1.1, 0.95);
                chunks.wall(
                    house.key,
                    0..=0,
                    rail,
                    (front[0], front[1]),
                    (z + 0.06, z + 0.95),
                    0.0,
                );
            }
        }
    }
}

/// A prism with lid and floor.
fn closed_prism(
    chunks: &mut Chunks,
    key: Key,
    levels: Levels,
    surface: Surface,
    footprint: &[P2; 4],
    span: (f64, f64),
) {
    chunks.prism(key, levels.clone(), surface, footprint, span);
    let mut floor = footprint.map(|p| [p.x, p.y, span.0]);
    floor.reverse();
    chunks.polygon(key, levels, surface, &floor, &[[0.0; 2]; 4]);
}
