//! A small seeded stream of random numbers on top of [`Noise`].

use schema_types::noise::Noise;

/// Draws in sequence; give each user its own stream so that adding one changes no other.
#[derive(Clone, Debug)]
pub struct Random {
    noise: Noise,
    drawn: u64,
}

impl Random {
    /// The stream `stream`, sub-stream `part`, of a town's seed.
    pub fn new(seed: u64, stream: u64, part: u64) -> Self {
        Random {
            noise: Noise::new(seed, stream, part),
            drawn: 0,
        }
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        self.drawn += 1;
        self.noise.uniform(self.drawn)
    }

    /// Uniform in [low, high).
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// True with this probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// Uniform in 0..n; `n` must not be 0.
    pub fn below(&mut self, n: usize) -> usize {
        ((self.unit() * n as f64) as usize).min(n - 1)
    }

    /// One of the items; there must be one.
    pub fn pick<T: Copy>(&mut self, items: &[T]) -> T {
        items[self.below(items.len())]
    }
}
