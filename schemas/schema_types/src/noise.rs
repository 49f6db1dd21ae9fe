//! Random numbers as a pure function of (seed, stream, tick, sample).
//!
//! No generator is shared, so adding a sensor changes no other sensor's bytes and order of
//! evaluation does not matter. Mixing is SplitMix64's finaliser (Steele, Lea, Flood, *Fast
//! splittable pseudorandom number generators*, 2014), once per key word.

/// SplitMix64's output function: a bijection on `u64` with good avalanche.
pub const fn mix(mut z: u64) -> u64 {
    z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The key of one (seed, stream, tick): draw as many samples from it as needed, in any order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Noise(u64);

impl Noise {
    /// `stream` is a sensor id, an actor id or any constant that separates one user's numbers from
    /// another's.
    pub const fn new(seed: u64, stream: u64, tick: u64) -> Self {
        Noise(mix(mix(mix(seed) ^ stream) ^ tick))
    }

    /// The key as a number, for code that draws its samples elsewhere, such as a shader.
    pub const fn key(self) -> u64 {
        self.0
    }

    /// 64 uniform bits for sample number `sample`.
    pub const fn bits(self, sample: u64) -> u64 {
        mix(self.0 ^ mix(sample))
    }

    /// Uniform in [0, 1), 53 bits.
    pub fn uniform(self, sample: u64) -> f64 {
        (self.bits(sample) >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Standard normal deviate (Box–Muller); uses the sample numbers `2·sample` and `2·sample + 1`
    /// of a stream of its own.
    pub fn gaussian(self, sample: u64) -> f64 {
        let key = Noise(self.0 ^ 0x6a09_e667_f3bc_c908);
        let radius = (-2.0 * (1.0 - key.uniform(2 * sample)).ln()).sqrt();
        radius * (std::f64::consts::TAU * key.uniform(2 * sample + 1)).cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaussian_has_unit_variance_and_no_mean() {
        let noise = Noise::new(7, 1, 2);
        let n = 100_000;
        let (mut sum, mut squares) = (0.0, 0.0);
        for sample in 0..n {
            let x = noise.gaussian(sample);
            sum += x;
            squares += x * x;
        }
        // Standard errors: 1/√n = 0.0032 of the mean, √(2/n) = 0.0045 of the variance; five of
        // each.
        assert!((sum / n as f64).abs() < 0.016);
        assert!((squares / n as f64 - 1.0).abs() < 0.023);
    }

    #[test]
    fn neighbouring_keys_are_unrelated() {
        let a = Noise::new(1, 1, 1);
        let b = Noise::new(1, 1, 2);
        let same_bits: u32 = (0..1000)
            .map(|s| (!(a.bits(s) ^ b.bits(s))).count_ones())
            .sum();
        // Binomial(64 000, ½): σ = 126; six σ.
        assert!((31_240..32_760).contains(&same_bits), "{same_bits}");
    }
}
