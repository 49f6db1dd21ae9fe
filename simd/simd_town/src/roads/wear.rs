//! Wear of roads: gutters and gullies along the kerbs, repaired patches, cut trenches, sealed
//! cracks.
//!
//! Everything here has the road's class and id and lies a few millimetres over the asphalt, under
//! the paint.

use schema_types::{Class, ObjectId};
use sensor_core::Material;
use sensor_core::mesh::Surface;

use crate::geometry::P2;
use crate::network::Road;
use crate::random::Random;
use crate::scenery::{Chunks, Key, Layer, Levels};

/// Stream of random numbers.
const WEAR: u64 = 0x7a;
/// Heights over the asphalt of sealed cracks, filled patches and gutters. Paint is higher.
const TAR_M: f64 = 0.0015;
const PATCH_M: f64 = 0.003;
const GUTTER_M: f64 = 0.002;
/// Width of the gutter's stones; distance of a gully's middle from the kerb, and between gullies.
const GUTTER_WIDTH_M: f64 = 0.30;
const GULLY_M: (f64, f64) = (0.17, 24.0);
/// Length left free at both ends of a road, where stop lines and zebra crossings are.
const END_M: f64 = 9.0;

/// Draws on one road.
struct Brush<'a> {
    chunks: &'a mut Chunks,
    road: &'a Road,
    object: ObjectId,
}

/// Adds the wear of a road.
pub fn road(chunks: &mut Chunks, seed: u64, road: &Road) {
    if road.tunnel {
        return;
    }
    let mut random = Random::new(seed, WEAR, u64::from(road.id));
    let mut brush = Brush {
        chunks,
        road,
        object: ObjectId::scenery(road.id),
    };
    if !road.profile.verge {
        brush.gutters();
        brush.gullies();
    }
    brush.patches(&mut random);
    brush.cracks(&mut random);
}

impl Brush<'_> {
    fn surface(&self, material: Material, rgb: [u8; 3]) -> Surface {
        Surface::new(Class::ROADS, material, rgb).of(self.object)
    }

    fn tar(&self) -> Surface {
        self.surface(Material::Asphalt, [46, 46, 48])
    }

    /// A four-sided piece; corners are (station, aside), counter-clockwise from above.
    fn quad(
        &mut self,
        layer: Layer,
        levels: Levels,
        surface: Surface,
        corners: [[f64; 2]; 4],
        up_m: f64,
    ) {
        let corners = corners.map(|[s, t]| self.road.point(s, t, up_m));
        let uv = corners.map(|c| [c[0] as f32, c[1] as f32]);
        let middle = corners.iter().map(|c| P2::new(c[0], c[1])).sum::<P2>() / 4.0;
        self.chunks
            .polygon(Key::at(layer, middle), levels, surface, &corners, &uv);
    }

    /// A strip along the road from `from_m` to `to_m`, between two distances from the middle.
    fn strip(
        &mut self,
        layer: Layer,
        levels: Levels,
        surface: Surface,
        (from_m, to_m): (f64, f64),
        [low, high]: [f64; 2],
        up_m: f64,
    ) {
        for pair in self.road.stations_between(from_m, to_m).windows(2) {
            let (a, b) = (pair[0], pair[1]);
            self.quad(
                layer,
                levels.clone(),
                surface,
                [[a, low], [b, low], [b, high], [a, high]],
                up_m,
            );
        }
    }

    /// Rows of stones along the kerbs, paler than the asphalt.
    fn gutters(&mut self) {
        let (kerb, length) = (self.road.profile.kerb_m(), self.road.path.length_m());
        let stones = self.surface(Material::Concrete, [112, 110, 106]);
        for [low, high] in [
            [-kerb, GUTTER_WIDTH_M - kerb],
            [kerb - GUTTER_WIDTH_M, kerb],
        ] {
            self.strip(
                Layer::Ground,
                0..=0,
                stones,
                (0.0, length),
                [low, high],
                GUTTER_M,
            );
        }
    }

    /// Gratings in the gutters, through which rain runs off.
    fn gullies(&mut self) {
        let length = self.road.path.length_m();
        let n = ((length - 2.0 * END_M) / GULLY_M.1) as usize;
        let (iron, hole) = (
            self.surface(Material::Matte, [54, 53, 52]),
            self.surface(Material::Matte, [14, 14, 14]),
        );
        for k in 0..=n {
            let s = 0.5 * (length - n as f64 * GULLY_M.1) + k as f64 * GULLY_M.1;
            for side in [1.0, -1.0] {
                let t = side * (self.road.profile.kerb_m() - GULLY_M.0);
                let block = |s: f64, half_s: f64, half_t: f64| {
                    [
                        [s - half_s, t - half_t],
                        [s + half_s, t - half_t],
                        [s + half_s, t + half_t],
                        [s - half_s, t + half_t],
                    ]
                };
                self.quad(Layer::Small, 0..=1, iron, block(s, 0.25, 0.165), PATCH_M);
                for slot in 0..4 {
                    self.quad(
                        Layer::Small,
                        0..=0,
                        hole,
                        block(s - 0.165 + 0.11 * f64::from(slot), 0.032, 0.125),
                        PATCH_M + 0.001,
                    );
                }
            }
        }
    }

    /// Patches of newer or older asphalt: pieces along a lane and trenches across it, with rims
    /// sealed with tar.
    fn patches(&mut self, random: &mut Random) {
        let length = self.road.path.length_m();
        let rgbs = [[58, 58, 61], [64, 64, 66], [84, 84, 85], [90, 89, 88]];
        let (driving, kerb) = (self.road.profile.driving_m(), self.road.profile.kerb_m());
        let reach = kerb - GUTTER_WIDTH_M - 0.1;
        let mut s = random.between(END_M, 30.0);
        while s < length - END_M - 8.0 {
            let filled = self.surface(Material::Asphalt, random.pick(&rgbs));
            let (long, [low, high]) = if random.chance(0.25) && !self.road.profile.motorway {
                let middle = random.between(-0.5, 0.5) * reach;
                let sides = [[-reach, middle], [middle, reach], [-reach, reach]];
                (random.between(0.45, 0.8), random.pick(&sides))
            } else {
                let (wide, middle) = (
                    random.between(0.7, 2.3),
                    random.between(-1.0, 1.0) * (driving - 0.4),
                );
                (
                    random.between(1.1, 7.5),
                    [
                        (middle - 0.5 * wide).max(-reach),
                        (middle + 0.5 * wide).min(reach),
                    ],
                )
            };
            if high - low > 0.4 {
                let (tar, rim) = (self.tar(), 0.045);
                self.strip(
                    Layer::Small,
                    0..=0,
                    tar,
                    (s - rim, s + long + rim),
                    [low - rim, high + rim],
                    TAR_M,
                );
                self.strip(
                    Layer::Small,
                    0..=1,
                    filled,
                    (s, s + long),
                    [low, high],
                    PATCH_M,
                );
            }
            s += long + random.between(9.0, 46.0);
        }
    }

    /// Cracks along and across the road, filled with tar.
    fn cracks(&mut self, random: &mut Random) {
        let length = self.road.path.length_m();
        let reach = self.road.profile.kerb_m() - GUTTER_WIDTH_M - 0.1;
        let mut s = random.between(END_M, 22.0);
        while s < length - END_M {
            let is_across = random.chance(0.45);
            let n = 4 + random.below(6);
            let mut at = [
                s,
                random.between(-1.0, 1.0) * if is_across { reach } else { 0.8 * reach },
            ];
            let way = if at[1] > 0.0 { -1.0 } else { 1.0 };
            for _ in 0..n {
                let (ahead, aside) = if is_across {
                    (random.between(-0.35, 0.35), way * random.between(0.4, 1.0))
                } else {
                    (random.between(0.6, 1.3), random.between(-0.22, 0.22))
                };
                let next = [at[0] + ahead, at[1] + aside];
                if next[1].abs() > reach || next[0] > length - END_M {
                    break;
                }
                self.line(at, next, random.between(0.02, 0.035));
                at = next;
            }
            s += random.between(9.0, 38.0);
        }
    }

    /// A line of tar; its pieces overlap a little.
    fn line(&mut self, from: [f64; 2], to: [f64; 2], half_m: f64) {
        let d = P2::new(to[0] - from[0], to[1] - from[1]).normalize();
        let at = |p: [f64; 2], along: f64, aside: f64| {
            [
                p[0] + d.x * along - d.y * aside,
                p[1] + d.y * along + d.x * aside,
            ]
        };
        let corners = [
            at(from, -half_m, -half_m),
            at(to, half_m, -half_m),
            at(to, half_m, half_m),
            at(from, -half_m, half_m),
        ];
        let tar = self.tar();
        self.quad(Layer::Small, 0..=0, tar, corners, TAR_M);
    }
}
