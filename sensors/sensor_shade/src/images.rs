//! Square images with levels, and what shaders read of them: the linear filter of the nearest level,
//! and the filtered comparison of shadow maps.

use sensor_core::vector_lanes::{Lanes, WordLanes};

use crate::memory::words_at;
use crate::packing::{number_of, word};

/// Which texels lie beyond the sides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Beyond {
    /// Those of the opposite side.
    Repeat,
    /// The nearest ones.
    Clamp,
}

/// Sides and places of levels, each half as wide as the one before.
#[derive(Clone, Debug)]
struct Levels {
    side: u32,
    n: u32,
    /// Texels before each level.
    begin: Vec<u32>,
    beyond: Beyond,
}

/// The four texels around a place in each lane, and where it is between them.
struct Around<L: Lanes> {
    /// Numbers of the texels: above left and right, below left and right.
    texels: [L::Words; 4],
    share: [L; 2],
}

impl Levels {
    /// # Panics
    /// Unless the side is a power of two up to 8192 and every level has its texels.
    fn new(sizes: &[usize], beyond: Beyond) -> Levels {
        let n_texels = *sizes.first().expect("an image has a level");
        let side = n_texels.isqrt();
        assert!(
            side * side == n_texels && side.is_power_of_two() && side <= 8192,
            "{n_texels} texels are no square whose side is a power of two up to 8192"
        );
        let mut begin = Vec::new();
        let mut before = 0;
        for (level, size) in sizes.iter().enumerate() {
            let expected = (side >> level) * (side >> level);
            assert!(
                expected > 0 && *size == expected,
                "level {level} has {size} texels, not {expected}"
            );
            begin.push(before);
            before += expected as u32;
        }
        Levels {
            side: side as u32,
            n: sizes.len() as u32,
            begin,
            beyond,
        }
    }

    /// Of one axis the two texels, and bits of the place between them.
    #[inline(always)]
    fn axis<L: Lanes>(&self, at: L, scale: L, last: L::Words) -> [L::Words; 3] {
        let place = at.mul(scale).sub(L::splat(0.5));
        let whole = place.floor();
        let first = whole.to_signed();
        let next = first.add(word::<L>(1));
        let share = place.sub(whole).to_words();
        [
            self.within::<L>(first, last),
            self.within::<L>(next, last),
            share,
        ]
    }

    #[inline(always)]
    fn within<L: Lanes>(&self, x: L::Words, last: L::Words) -> L::Words {
        match self.beyond {
            Beyond::Repeat => x.and(last),
            Beyond::Clamp => x.max_signed(word::<L>(0)).min_signed(last),
        }
    }

    #[inline(always)]
    fn around<L: Lanes>(&self, at: [L; 2], level: Option<L>) -> Around<L> {
        let (side, begin) = match level {
            Some(level) if self.n > 1 => {
                let last = L::splat((self.n - 1) as f32);
                let nearest = level.add(L::splat(0.5)).floor();
                let level = nearest.max(L::splat(0.0)).min(last).to_signed();
                let side = word::<L>(self.side).shr(level);
                (side, words_at::<L>(&self.begin, level, 0))
            }
            _ => (word::<L>(self.side), word::<L>(0)),
        };
        let scale = side.from_signed();
        let last = side.sub(word::<L>(1));
        let [left, right, across] = self.axis(at[0], scale, last);
        let [above, below, down] = self.axis(at[1], scale, last);
        let above = begin.add(above.mul(side));
        let below = begin.add(below.mul(side));
        Around {
            texels: [
                above.add(left),
                above.add(right),
                below.add(left),
                below.add(right),
            ],
            share: [across.to_numbers(), down.to_numbers()],
        }
    }
}

// No closures here: one that the compiler does not inline holds every vector instruction as a call.
impl<L: Lanes> Around<L> {
    /// A word of each texel.
    #[inline(always)]
    fn words(&self, list: &[u32]) -> [L::Words; 4] {
        let [a, b, c, d] = self.texels;
        [
            words_at::<L>(list, a, 0),
            words_at::<L>(list, b, 0),
            words_at::<L>(list, c, 0),
            words_at::<L>(list, d, 0),
        ]
    }

    /// The value between those of the four texels.
    #[inline(always)]
    fn between(&self, [a, b, c, d]: [L; 4]) -> L {
        let [across, down] = self.share;
        let above = a.add(b.sub(a).mul(across));
        let below = c.add(d.sub(c).mul(across));
        above.add(below.sub(above).mul(down))
    }
}

/// Four bytes a texel, which mean 0 to 1.
#[derive(Clone, Debug)]
pub struct ByteImage {
    levels: Levels,
    texels: Vec<u32>,
}

impl ByteImage {
    /// From its levels, each row by row.
    ///
    /// # Panics
    /// Unless the side is a power of two up to 8192 and each level is half as wide as the one before.
    pub fn new(levels: &[&[[u8; 4]]], beyond: Beyond) -> ByteImage {
        let sizes: Vec<usize> = levels.iter().map(|texels| texels.len()).collect();
        let texels = levels.iter().copied().flatten();
        ByteImage {
            levels: Levels::new(&sizes, beyond),
            texels: texels.map(|texel| u32::from_le_bytes(*texel)).collect(),
        }
    }

    /// The linear filter at places from 0 to 1 of the level nearest to `level`.
    #[inline(always)]
    pub fn sampled<L: Lanes>(&self, at: [L; 2], level: L) -> [L; 4] {
        let around = self.levels.around(at, Some(level));
        let words = around.words(&self.texels);
        [
            Self::channel(&around, words, 0),
            Self::channel(&around, words, 8),
            Self::channel(&around, words, 16),
            Self::channel(&around, words, 24),
        ]
    }

    /// The byte so many bits up.
    #[inline(always)]
    fn channel<L: Lanes>(around: &Around<L>, words: [L::Words; 4], bits: u32) -> L {
        let [a, b, c, d] = words;
        let bytes = [
            Self::byte(a, bits),
            Self::byte(b, bits),
            Self::byte(c, bits),
            Self::byte(d, bits),
        ];
        around.between(bytes).mul(L::splat(1.0 / 255.0))
    }

    #[inline(always)]
    fn byte<L: Lanes>(texel: L::Words, bits: u32) -> L {
        let byte = texel.shr(word::<L>(bits)).and(word::<L>(255));
        byte.from_signed()
    }
}

/// Four numbers a texel.
#[derive(Clone, Debug)]
pub struct NumberImage {
    levels: Levels,
    /// Their bits.
    numbers: Vec<u32>,
}

impl NumberImage {
    /// From its levels, each row by row.
    ///
    /// # Panics
    /// Unless the side is a power of two up to 8192 and each level is half as wide as the one before.
    pub fn new(levels: &[&[[f32; 4]]], beyond: Beyond) -> NumberImage {
        let sizes: Vec<usize> = levels.iter().map(|texels| texels.len()).collect();
        let numbers = levels.iter().copied().flatten().flatten();
        NumberImage {
            levels: Levels::new(&sizes, beyond),
            numbers: numbers.map(|x| x.to_bits()).collect(),
        }
    }

    /// The linear filter at places from 0 to 1 of the level nearest to `level`.
    #[inline(always)]
    pub fn sampled<L: Lanes>(&self, at: [L; 2], level: L) -> [L; 4] {
        let around = self.levels.around(at, Some(level));
        let two = word::<L>(2);
        let [a, b, c, d] = around.texels;
        let first = Around {
            texels: [a.shl(two), b.shl(two), c.shl(two), d.shl(two)],
            share: around.share,
        };
        [
            self.channel(&first, 0),
            self.channel(&first, 1),
            self.channel(&first, 2),
            self.channel(&first, 3),
        ]
    }

    /// Of texels whose first numbers are `first`.
    #[inline(always)]
    fn channel<L: Lanes>(&self, first: &Around<L>, channel: u32) -> L {
        let [a, b, c, d] = first.texels;
        let numbers = [
            words_at::<L>(&self.numbers, a, channel).to_numbers(),
            words_at::<L>(&self.numbers, b, channel).to_numbers(),
            words_at::<L>(&self.numbers, c, channel).to_numbers(),
            words_at::<L>(&self.numbers, d, channel).to_numbers(),
        ];
        first.between(numbers)
    }
}

/// Depths of a shadow map.
#[derive(Clone, Debug)]
pub struct DepthImage {
    levels: Levels,
    /// Their bits.
    depths: Vec<u32>,
}

impl DepthImage {
    /// From its depths, row by row.
    ///
    /// # Panics
    /// Unless the side is a power of two up to 8192.
    pub fn new(depths: &[f32]) -> DepthImage {
        DepthImage {
            levels: Levels::new(&[depths.len()], Beyond::Clamp),
            depths: depths.iter().map(|depth| depth.to_bits()).collect(),
        }
    }

    /// With this side and nothing on it: the largest depth, 1, everywhere.
    ///
    /// # Panics
    /// Unless the side is a power of two up to 8192.
    pub fn far(side: u32) -> DepthImage {
        let n_texels = (side as usize).pow(2);
        DepthImage {
            levels: Levels::new(&[n_texels], Beyond::Clamp),
            depths: vec![1f32.to_bits(); n_texels],
        }
    }

    /// Bits of its depths, row by row, for whoever draws them.
    pub fn bits_mut(&mut self) -> &mut [u32] {
        &mut self.depths
    }

    /// The share of the four texels around a place from 0 to 1 that are as deep as this or deeper,
    /// each weighed by how near it is.
    #[inline(always)]
    pub fn compared<L: Lanes>(&self, at: [L; 2], depth: L) -> L {
        let around = self.levels.around(at, None);
        let [a, b, c, d] = around.words(&self.depths);
        around.between([
            number_of(depth.le(a.to_numbers())),
            number_of(depth.le(b.to_numbers())),
            number_of(depth.le(c.to_numbers())),
            number_of(depth.le(d.to_numbers())),
        ])
    }
}

#[cfg(test)]
mod tests {
    use sensor_core::vector_lanes::{LaneWork, in_arrays, in_lanes};

    use super::*;

    const SIDE: usize = 16;

    struct Read<'a> {
        bytes: &'a ByteImage,
        numbers: &'a NumberImage,
        depths: &'a DepthImage,
        at: [[f32; 8]; 2],
        level: [f32; 8],
    }

    impl LaneWork for Read<'_> {
        type Out = [[f32; 8]; 9];

        #[inline(always)]
        fn run<L: Lanes>(self) -> Self::Out {
            let at = self.at.map(|x| L::load(&x));
            let level = L::load(&self.level);
            let [a, b, c, d] = self.bytes.sampled(at, level);
            let [e, f, g, h] = self.numbers.sampled(at, level);
            let share = self.depths.compared(at, L::splat(0.5));
            [a, b, c, d, e, f, g, h, share].map(L::store)
        }
    }

    /// Oracle: the filter in f64, texel by texel.
    fn filtered(texel: impl Fn(i64, i64) -> f64, at: [f64; 2], side: usize) -> f64 {
        let place = at.map(|at| at * side as f64 - 0.5);
        let mut sum = 0.0;
        for y in 0..2 {
            for x in 0..2 {
                let texel_at = [place[0].floor() + x as f64, place[1].floor() + y as f64];
                let weight: f64 = (0..2)
                    .map(|axis| 1.0 - (place[axis] - texel_at[axis]).abs())
                    .product();
                sum += weight * texel(texel_at[0] as i64, texel_at[1] as i64);
            }
        }
        sum
    }

    #[test]
    fn images_are_filtered_as_in_f64() {
        let mut rng = fastrand::Rng::with_seed(8);
        let bytes: Vec<Vec<[u8; 4]>> = (0..3)
            .map(|level| {
                let n = (SIDE >> level) * (SIDE >> level);
                (0..n)
                    .map(|_| std::array::from_fn(|_| rng.u8(..)))
                    .collect()
            })
            .collect();
        let level_numbers = |texels: &Vec<[u8; 4]>| -> Vec<[f32; 4]> {
            let of = |texel: &[u8; 4]| texel.map(|byte| byte as f32 * 3.0 - 100.0);
            texels.iter().map(of).collect()
        };
        let numbers: Vec<Vec<[f32; 4]>> = bytes.iter().map(level_numbers).collect();
        let depths: Vec<f32> = bytes[0]
            .iter()
            .map(|texel| texel[0] as f32 / 255.0)
            .collect();
        let byte_levels: Vec<&[[u8; 4]]> = bytes.iter().map(Vec::as_slice).collect();
        let number_levels: Vec<&[[f32; 4]]> = numbers.iter().map(Vec::as_slice).collect();
        let byte_image = ByteImage::new(&byte_levels, Beyond::Repeat);
        let number_image = NumberImage::new(&number_levels, Beyond::Clamp);
        let depth_image = DepthImage::new(&depths);
        for _ in 0..2000 {
            let mut eight = |low: f32, high: f32| -> [f32; 8] {
                std::array::from_fn(|_| low + rng.f32() * (high - low))
            };
            let at = [eight(-2.0, 3.0), eight(-2.0, 3.0)];
            let level = eight(-1.0, 4.0);
            let read = || Read {
                bytes: &byte_image,
                numbers: &number_image,
                depths: &depth_image,
                at,
                level,
            };
            let found = in_lanes(read());
            assert_eq!(found, in_arrays(read()));
            for lane in 0..8 {
                let fraction = (level[lane] + 0.5).fract();
                if fraction.abs() < 1e-3 || fraction.abs() > 0.999 {
                    continue;
                }
                let nearest = level[lane].round().clamp(0.0, 2.0) as usize;
                let side = SIDE >> nearest;
                let place = at.map(|at| at[lane] as f64);
                let repeated = |x: i64, y: i64| {
                    let [x, y] = [x, y].map(|i| i.rem_euclid(side as i64) as usize);
                    y * side + x
                };
                let clamped = |x: i64, y: i64, side: usize| {
                    let [x, y] = [x, y].map(|i| i.clamp(0, side as i64 - 1) as usize);
                    y * side + x
                };
                for channel in 0..4 {
                    let byte = |x, y| bytes[nearest][repeated(x, y)][channel] as f64 / 255.0;
                    let expected = filtered(byte, place, side);
                    assert!((found[channel][lane] as f64 - expected).abs() < 2e-5);
                    let number = |x, y| numbers[nearest][clamped(x, y, side)][channel] as f64;
                    let expected = filtered(number, place, side);
                    assert!((found[4 + channel][lane] as f64 - expected).abs() < 2e-2);
                }
                let passes = |x, y| (depths[clamped(x, y, SIDE)] >= 0.5) as u32 as f64;
                let expected = filtered(passes, place, SIDE);
                assert!((found[8][lane] as f64 - expected).abs() < 5e-5);
            }
        }
    }

    #[test]
    fn places_that_are_no_numbers_are_survived() {
        let image = ByteImage::new(&[&[[255; 4]; 16]], Beyond::Repeat);
        let numbers = NumberImage::new(&[&[[1.0; 4]; 16]], Beyond::Clamp);
        let depths = DepthImage::new(&[1.0; 16]);
        let wild = [
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            1e30,
            -1e30,
            0.0,
            -0.0,
            f32::MAX,
        ];
        in_lanes(Read {
            bytes: &image,
            numbers: &numbers,
            depths: &depths,
            at: [wild; 2],
            level: wild,
        });
    }

    #[test]
    #[should_panic(expected = "level 1 has 5 texels, not 4")]
    fn levels_of_a_wrong_size_are_refused() {
        ByteImage::new(&[&[[0; 4]; 16], &[[0; 4]; 5]], Beyond::Repeat);
    }
}
