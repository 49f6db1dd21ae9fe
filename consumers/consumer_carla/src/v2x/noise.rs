//! A station's random numbers, from its seed.

/// Draws of the normal distribution.
#[derive(Clone, Debug)]
pub struct Noise(fastrand::Rng);

impl Noise {
    /// A generator from the seed and the station's id, so that stations with equal seeds differ.
    pub fn new(seed: u64, station: u32) -> Noise {
        Noise(fastrand::Rng::with_seed(
            seed ^ u64::from(station).wrapping_mul(0x9e37_79b9_7f4a_7c15),
        ))
    }

    /// Standard normal, by Box and Muller.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.0.f64()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.0.f64()).cos()
    }

    /// Adds an error with this standard deviation and bias to a value.
    pub fn with(&mut self, value: f64, [stddev, bias]: [f64; 2]) -> f64 {
        value
            + bias
            + if stddev > 0.0 {
                stddev * self.normal()
            } else {
                0.0
            }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_have_mean_0_and_deviation_1() {
        let (mut noise, n) = (Noise::new(3, 7), 100_000);
        let draws: Vec<f64> = (0..n).map(|_| noise.normal()).collect();
        let mean = draws.iter().sum::<f64>() / f64::from(n);
        let deviation =
            (draws.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / f64::from(n)).sqrt();
        assert!(
            mean.abs() < 0.02 && (deviation - 1.0).abs() < 0.02,
            "{mean} {deviation}"
        );
    }
}
