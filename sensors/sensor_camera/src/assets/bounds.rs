//! Bounding spheres in blocks of eight, which are tested at once.

use sensor_core::vector_lanes::{LaneWork, Lanes, in_lanes};

/// Spheres in single precision: those that may reach into an image are found first, and then tested
/// in double precision.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bounds {
    /// x, y, z and radius, metres. Places behind the last sphere have a radius that reaches nothing.
    blocks: Vec<[[f32; 8]; 4]>,
    /// Largest coordinate.
    most_m: f64,
}

/// Half spaces in which a camera sees: their boundaries in camera space as multiples of (|x|, z), of
/// (|y|, z), and the least z.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reach {
    pub sideways: [f64; 2],
    pub upright: [f64; 2],
    pub near_m: f64,
}

impl Bounds {
    /// Of spheres with these centres in the world and radii, metres.
    pub fn of(spheres: impl ExactSizeIterator<Item = ([f64; 3], f64)>) -> Bounds {
        const NOWHERE: [[f32; 8]; 4] = [[0.0; 8], [0.0; 8], [0.0; 8], [f32::NEG_INFINITY; 8]];
        let mut blocks = vec![NOWHERE; spheres.len().div_ceil(8)];
        let mut most_m = 0.0f64;
        for (i, (centre_m, radius_m)) in spheres.enumerate() {
            let block = &mut blocks[i / 8];
            for (lanes, at_m) in block.iter_mut().zip(centre_m) {
                lanes[i % 8] = at_m as f32;
                most_m = most_m.max(at_m.abs());
            }
            block[3][i % 8] = radius_m as f32;
        }
        Bounds { blocks, most_m }
    }

    /// Adds the indices of all spheres that reach into the half spaces to `found`, in rising order,
    /// and of some that do not quite.
    pub fn reaching(&self, reach: &Reach, camera_from_world: &[[f64; 4]; 3], found: &mut Vec<u32>) {
        let away_m = camera_from_world.iter().map(|row| row[3].abs());
        let away_m = away_m.fold(0.0, f64::max);
        // Numbers that are rounded to 24 bits, some ten times on the way, are off by less.
        let margin_m = 2e-6 * (2.0 * self.most_m + away_m) + 1e-4;
        let single = |numbers: [f64; 2]| numbers.map(|x| x as f32);
        in_lanes(Search {
            blocks: &self.blocks,
            rows: camera_from_world.map(|row| row.map(|x| x as f32)),
            sideways: single(reach.sideways),
            upright: single(reach.upright),
            near_m: reach.near_m as f32,
            margin_m: margin_m as f32,
            found,
        });
    }
}

struct Search<'s> {
    blocks: &'s [[[f32; 8]; 4]],
    rows: [[f32; 4]; 3],
    sideways: [f32; 2],
    upright: [f32; 2],
    near_m: f32,
    margin_m: f32,
    found: &'s mut Vec<u32>,
}

#[inline(always)]
fn along<L: Lanes>(row: [L; 4], [x, y, z]: [L; 3]) -> L {
    row[0]
        .mul(x)
        .add(row[1].mul(y))
        .add(row[2].mul(z))
        .add(row[3])
}

#[inline(always)]
fn splat<L: Lanes, const N: usize>(numbers: [f32; N]) -> [L; N] {
    let mut out = [L::splat(0.0); N];
    for (out, number) in out.iter_mut().zip(numbers) {
        *out = L::splat(number);
    }
    out
}

impl LaneWork for Search<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let right = splat::<L, 4>(self.rows[0]);
        let down = splat::<L, 4>(self.rows[1]);
        let ahead = splat::<L, 4>(self.rows[2]);
        let (sideways, upright) = (splat::<L, 2>(self.sideways), splat::<L, 2>(self.upright));
        let (near, margin) = (L::splat(self.near_m), L::splat(self.margin_m));
        for (block, [x, y, z, radius]) in self.blocks.iter().enumerate() {
            let centre = [L::load(x), L::load(y), L::load(z)];
            let radius = L::load(radius).add(margin);
            let (x, y, z) = (
                along(right, centre).abs(),
                along(down, centre).abs(),
                along(ahead, centre),
            );
            let beside = sideways[0].mul(x).sub(sideways[1].mul(z)).lt(radius);
            let above = upright[0].mul(y).sub(upright[1].mul(z)).lt(radius);
            let in_front = near.sub(radius).lt(z);
            let mut bits = L::bits(L::and(L::and(beside, above), in_front));
            while bits != 0 {
                self.found.push(8 * block as u32 + bits.trailing_zeros());
                bits &= bits - 1;
            }
        }
    }
}
