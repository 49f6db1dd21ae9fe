//! Slow errors of a sensor as functions of (seed, stream, time): a random walk and a Gauss-Markov
//! process. Any time can be asked for in any order, and nothing is remembered.
//!
//! Both are drawn at knots of whole powers of two of nanoseconds and halved from there: given its ends,
//! the middle of an interval is normal with a mean and a spread that are known (Lévy's construction;
//! the same holds for every Gaussian process that forgets all but where it is). Each knot's number is
//! keyed by its time, so it is the same whichever interval asks for it.

use schema_types::noise::Noise;

/// Separates the numbers of knots from those of ticks.
const KNOTS: u64 = 0x6b6e_6f74_735f_6f66;

/// Intervals are not halved below this, about a millisecond; in between the value is interpolated.
const FINEST_NANOS: u64 = 1 << 20;

/// Ends of intervals that are this many correlation times apart are independent: e⁻³² of one is left.
const INDEPENDENT: u64 = 32;

/// Intervals of a Gauss-Markov process are halved down to this share of its correlation time.
const SHARES: u64 = 256;

/// The moment of a sensor's life whose slow errors are asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Drift {
    /// Seed of the run.
    pub seed: u64,
    /// Stream of the sensor's noise.
    pub stream: u64,
    /// Time since the sensor was made.
    pub age_nanos: u64,
}

/// Two knots and what a process is there.
#[derive(Clone, Copy)]
struct Interval {
    begin: u64,
    end: u64,
    values: [f64; 2],
}

impl Interval {
    /// The half that holds a time; `middle` is the value between.
    fn half(self, at: u64, middle: f64) -> Interval {
        let between = self.begin + (self.end - self.begin) / 2;
        if at < between {
            Interval {
                end: between,
                values: [self.values[0], middle],
                ..self
            }
        } else {
            Interval {
                begin: between,
                values: [middle, self.values[1]],
                ..self
            }
        }
    }

    fn middle(&self) -> u64 {
        self.begin + self.n_nanos() / 2
    }

    fn n_nanos(&self) -> u64 {
        self.end - self.begin
    }

    fn at(&self, at: u64) -> f64 {
        let share = (at - self.begin) as f64 / self.n_nanos() as f64;
        self.values[0] + share * (self.values[1] - self.values[0])
    }
}

fn secs(nanos: u64) -> f64 {
    nanos as f64 * 1e-9
}

impl Drift {
    fn gaussian(&self, process: u64, knot: u64) -> f64 {
        Noise::new(self.seed, self.stream ^ KNOTS, knot).gaussian(process)
    }

    /// A random walk that began at 0 when the sensor was made, and whose variance grows by 1 a second.
    /// `process` tells walks of one sensor apart, and walks from other processes.
    pub fn walk(&self, process: u64) -> f64 {
        let step = |from: u64, to: u64| secs(to - from).sqrt() * self.gaussian(process, to);
        let mut interval = Interval {
            begin: 0,
            end: FINEST_NANOS,
            values: [0.0, step(0, FINEST_NANOS)],
        };
        while interval.end < self.age_nanos {
            let (begin, value) = (interval.end, interval.values[1]);
            let Some(end) = begin.checked_mul(2) else {
                return value;
            };
            interval = Interval {
                begin,
                end,
                values: [value, value + step(begin, end)],
            };
        }
        while interval.n_nanos() > FINEST_NANOS {
            let [begin, end] = interval.values;
            let spread = (0.25 * secs(interval.n_nanos())).sqrt();
            let middle = 0.5 * (begin + end) + spread * self.gaussian(process, interval.middle());
            interval = interval.half(self.age_nanos, middle);
        }
        interval.at(self.age_nanos)
    }

    /// A process of variance 1 that forgets where it was within `correlation_secs`.
    pub fn gauss_markov(&self, process: u64, correlation_secs: f64) -> f64 {
        let correlation_nanos = ((correlation_secs * 1e9) as u64).clamp(1, 1 << 56);
        let n_nanos = (INDEPENDENT * correlation_nanos).next_power_of_two();
        let begin = self.age_nanos / n_nanos * n_nanos;
        let end = begin.saturating_add(n_nanos);
        let mut interval = Interval {
            begin,
            end,
            values: [begin, end].map(|knot| self.gaussian(process, knot)),
        };
        let finest = (correlation_nanos / SHARES).max(1);
        while interval.n_nanos() > finest {
            // Of an Ornstein-Uhlenbeck process half an interval from both ends.
            let away = 0.5 * secs(interval.n_nanos()) / correlation_secs;
            let [begin, end] = interval.values;
            let mean = 0.5 * (begin + end) / away.cosh();
            let spread = away.tanh().sqrt();
            let middle = mean + spread * self.gaussian(process, interval.middle());
            interval = interval.half(self.age_nanos, middle);
        }
        interval.at(self.age_nanos)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drift(seed: u64, secs: f64) -> Drift {
        Drift {
            seed,
            stream: 7,
            age_nanos: (secs * 1e9) as u64,
        }
    }

    /// Mean products of a process at pairs of times, over many seeds.
    fn products<const N: usize>(at: impl Fn(u64) -> [f64; N], n: u64) -> [[f64; N]; N] {
        let mut sums = [[0.0; N]; N];
        for seed in 0..n {
            let values = at(seed);
            for (row, a) in sums.iter_mut().zip(values) {
                row.iter_mut()
                    .zip(values)
                    .for_each(|(sum, b)| *sum += a * b / n as f64);
            }
        }
        sums
    }

    #[test]
    fn a_walk_has_the_covariance_of_brownian_motion() {
        let times = [0.0123, 0.9, 1.0, 3.7, 1000.0];
        let n = 40_000;
        let found = products(|seed| times.map(|at| drift(seed, at).walk(3)), n);
        for (i, a) in times.iter().enumerate() {
            for (j, b) in times.iter().enumerate() {
                let wanted = a.min(*b);
                // The standard error of a mean product is at most √2 of the spreads; five of them.
                let tolerance = 5.0 * (2.0 * a * b / n as f64).sqrt();
                // A millisecond is interpolated.
                assert!(
                    (found[i][j] - wanted).abs() < tolerance + 1e-3,
                    "{a} {b} {}",
                    found[i][j]
                );
            }
        }
        assert_eq!(drift(1, 0.0).walk(3), 0.0);
    }

    #[test]
    fn a_gauss_markov_process_has_an_exponential_covariance() {
        let times = [100.0, 100.5, 102.0, 110.0, 200.0];
        let n = 40_000;
        let found = products(
            |seed| times.map(|at| drift(seed, at).gauss_markov(2, 5.0)),
            n,
        );
        for (i, a) in times.iter().enumerate() {
            for (j, b) in times.iter().enumerate() {
                let wanted = (-(a - b).abs() / 5.0).exp();
                assert!(
                    (found[i][j] - wanted).abs() < 5.0 * (2.0 / n as f64).sqrt(),
                    "{a} {b} {}",
                    found[i][j]
                );
            }
        }
    }

    #[test]
    fn processes_streams_and_seeds_are_unrelated() {
        let values = |seed: u64| {
            let now = drift(seed, 50.0);
            let other = Drift { stream: 8, ..now };
            [
                now.gauss_markov(0, 5.0),
                now.gauss_markov(1, 5.0),
                other.gauss_markov(0, 5.0),
                drift(seed + 1_000_000, 50.0).gauss_markov(0, 5.0),
            ]
        };
        let found = products(values, 20_000);
        for (i, row) in found.iter().enumerate() {
            for (j, product) in row.iter().enumerate() {
                let wanted = f64::from(u8::from(i == j));
                assert!((product - wanted).abs() < 0.05, "{i} {j} {product}");
            }
        }
    }

    #[test]
    fn any_time_can_be_asked_for_in_any_order() {
        let ages = [0, 1, FINEST_NANOS, 12_345_678_901, 1 << 62, u64::MAX];
        let ask = |age_nanos: u64| {
            let now = Drift {
                age_nanos,
                ..drift(4, 0.0)
            };
            [
                now.walk(1),
                now.gauss_markov(1, 1000.0),
                now.gauss_markov(1, 1e-3),
            ]
        };
        let forwards: Vec<_> = ages.into_iter().map(ask).collect();
        let mut backwards: Vec<_> = ages.into_iter().rev().map(ask).collect();
        backwards.reverse();
        assert_eq!(forwards, backwards);
        assert!(forwards.iter().flatten().all(|value| value.is_finite()));
    }
}
