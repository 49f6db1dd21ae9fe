//! Leaves: crowns are clumps covered with plates that stand out like shingles, each a spray of leaves, over a dark inside.
//!
//! Plates need no transparency: cameras, shadows and rays see the same triangles. Normals lean towards the clump's own, so that a crown is
//! lit as a round thing and still ragged.

use schema_types::Class;
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder};

use crate::random::Random;
use crate::vehicle::loft::ellipsoid;

/// An ellipsoid of leaves.
#[derive(Clone, Copy, Debug)]
pub struct Clump {
    /// Middle, metres.
    pub middle: [f32; 3],
    /// Half axes, metres.
    pub half: [f32; 3],
}

/// How much of a crown is plates.
#[derive(Clone, Copy, Debug)]
pub struct Cover {
    /// Some so many triangles.
    pub n_plates: usize,
    /// Their area over that of the clumps' free surface.
    pub area_ratio: f32,
    /// Size of the inside over the clump's, and its lightness.
    pub inside: (f32, f32),
}

/// From near by: sprays in front of a dark inside.
pub const fn near(n_plates: usize) -> Cover {
    Cover { n_plates, area_ratio: 1.7, inside: (0.76, 0.50) }
}

/// From afar: a round thing with a ragged rim.
pub const fn far(n_plates: usize) -> Cover {
    Cover { n_plates, area_ratio: 1.15, inside: (0.93, 0.74) }
}

type V = nalgebra::Vector3<f32>;

impl Clump {
    /// Square of the distance from the middle, 1 on the surface.
    fn depth(&self, p: V) -> f32 {
        (0..3).map(|i| ((p[i] - self.middle[i]) / self.half[i]).powi(2)).sum()
    }

    fn at(&self, d: V) -> V {
        V::from_fn(|i, _| self.middle[i] + d[i] * self.half[i])
    }

    fn normal(&self, p: V) -> V {
        V::from_fn(|i, _| (p[i] - self.middle[i]) / (self.half[i] * self.half[i])).try_normalize(1e-6).unwrap_or(V::z())
    }

    fn area_m2(&self) -> f32 {
        // Thomsen's formula with p = 1.6.
        let [a, b, c] = self.half.map(|x| x.powf(1.6));
        4.0 * std::f32::consts::PI * ((a * b + a * c + b * c) / 3.0).powf(1.0 / 1.6)
    }
}

/// Directions spread evenly over a sphere.
fn direction(i: usize, n: usize) -> V {
    let z = 1.0 - (2.0 * i as f32 + 1.0) / n as f32;
    let (around, r) = (i as f32 * 2.399_963, (1.0 - z * z).sqrt());
    V::new(r * around.cos(), r * around.sin(), z)
}

/// Foliage of this colour, lighter or darker.
pub fn foliage(rgb: [u8; 3], k: f32) -> Surface {
    Surface::new(Class::VEGETATION, Material::Foliage, rgb.map(|x| (f32::from(x) * k).clamp(0.0, 255.0) as u8))
}

/// Covers clumps with plates and puts an inside behind them.
pub fn crown(builder: &mut MeshBuilder, clumps: &[Clump], cover: Cover, rgb: [u8; 3], random: &mut Random) {
    let (size, light) = cover.inside;
    for clump in clumps {
        ellipsoid(builder, foliage(rgb, light), clump.middle, clump.half.map(|x| size * x), if size > 0.9 { 5 } else { 4 });
    }
    let area_m2: f32 = clumps.iter().map(Clump::area_m2).sum();
    // Where one clump lies in another there is nothing to be seen.
    let spots_of = |n_asked: f32| {
        let mut spots: Vec<(usize, V)> = Vec::new();
        for (k, clump) in clumps.iter().enumerate() {
            let n = (n_asked * clump.area_m2() / area_m2).round().max(1.0) as usize;
            let others = |p: V| clumps.iter().enumerate().all(|(l, other)| l == k || other.depth(p) > 0.80);
            spots.extend((0..n).map(|i| direction(i, n)).filter(|d| others(clump.at(*d))).map(|d| (k, d)));
        }
        spots
    };
    let free = spots_of(400.0).len().max(1) as f32 / 400.0;
    let spots = spots_of(cover.n_plates as f32 / free);
    // Equilateral triangles of this circumscribed radius have the area wanted.
    let radius_m = (cover.area_ratio * area_m2 * free / spots.len().max(1) as f32 / 1.299).sqrt();
    let (low, high) =
        clumps.iter().fold((f32::MAX, f32::MIN), |(low, high), c| (low.min(c.middle[2] - c.half[2]), high.max(c.middle[2] + c.half[2])));
    let middle = clumps.iter().map(|c| V::from(c.middle)).sum::<V>() / clumps.len() as f32 - V::z() * 0.15 * (high - low);
    for (k, d) in spots {
        let mut draw = |low: f32, high: f32| random.between(f64::from(low), f64::from(high)) as f32;
        let clump = &clumps[k];
        let out = clump.normal(clump.at(d));
        let lean = V::new(draw(-0.5, 0.5), draw(-0.5, 0.5), draw(-0.25, 0.65));
        let facing = (out + lean).try_normalize(1e-3).unwrap_or(out);
        let centre = clump.at(d * draw(0.86, 1.06));
        let u =
            facing.cross(&V::new(draw(-1.0, 1.0), draw(-1.0, 1.0), draw(-1.0, 1.0))).try_normalize(1e-3).unwrap_or(facing.cross(&V::x()));
        let v = facing.cross(&u);
        let corners: [V; 3] = std::array::from_fn(|i| {
            let (a, r) = (std::f32::consts::TAU * (i as f32 + draw(-0.16, 0.16)) / 3.0, radius_m * draw(0.75, 1.25));
            centre + u * (r * a.cos()) + v * (r * a.sin())
        });
        let normals = corners.map(|p| {
            let round = 0.6 * clump.normal(p) + 0.4 * (p - middle).try_normalize(1e-3).unwrap_or(out) + 0.25 * facing;
            // Light from behind the plate would be a lie.
            let short = (0.3 * round.norm() - round.dot(&facing)).max(0.0);
            (round + facing * (1.5 * short)).normalize()
        });
        // Darker below and deep inside, where little light comes; no two sprays alike.
        let up = ((centre.z - low) / (high - low)).clamp(0.0, 1.0);
        let k = (0.68 + 0.34 * up) * (1.0 + 0.16 * out.z.min(0.0)) * draw(0.84, 1.16);
        let warm = draw(-0.07, 0.09);
        let tint = [1.0 + warm, 1.0, 1.0 - 1.3 * warm];
        let rgb = std::array::from_fn(|i| (f32::from(rgb[i]) * tint[i]).clamp(0.0, 255.0) as u8);
        builder.polygon_with_normals(foliage(rgb, k), &corners.map(Into::into), &normals.map(Into::into), &[[0.0; 2]; 3]);
    }
}
