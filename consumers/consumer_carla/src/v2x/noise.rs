//! A station's random numbers: a function of what the station is, of the ticks since it was made
//! and of what they are for, so that neither its id nor other stations change them.

use schema_types::noise::{Noise as Key, mix};

use crate::wire::description::Description;

/// Draws of the normal distribution for one purpose at one tick.
#[derive(Clone, Copy, Debug)]
pub struct Noise {
    key: Key,
    n_drawn: u64,
}

/// What a station's noise follows from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stream {
    /// Hash of the station's attributes and of its carrier's type and role.
    likeness: u64,
    /// Number among the stations of one likeness.
    twin: u64,
    /// The tick at which the station was first seen.
    first_tick: u64,
}

impl Stream {
    /// The stream of a station that is seen first at `first_tick`, on a carrier of this type and
    /// role: stations alike draw different numbers, since each takes the smallest number that none
    /// of `living` has.
    pub fn new<'a>(
        description: &Description,
        carrier: [&str; 2],
        first_tick: u64,
        living: impl Iterator<Item = &'a Stream>,
    ) -> Stream {
        let mut attributes: Vec<[&str; 2]> = description
            .attributes
            .iter()
            .map(|attribute| [attribute.name.as_str(), attribute.value.as_str()])
            .collect();
        attributes.sort_unstable();
        let texts = [description.type_id.as_str()]
            .into_iter()
            .chain(carrier)
            .chain(attributes.into_iter().flatten());
        let likeness = texts.fold(0, |hash, text| {
            let bytes = text
                .bytes()
                .fold(hash, |hash, byte| mix(hash ^ u64::from(byte)));
            mix(bytes ^ text.len() as u64)
        });
        let taken: Vec<u64> = living
            .filter(|other| other.likeness == likeness)
            .map(|other| other.twin)
            .collect();
        Stream {
            likeness,
            twin: (0..)
                .find(|number| !taken.contains(number))
                .expect("there are fewer stations than numbers"),
            first_tick,
        }
    }

    /// Number of the stream.
    pub fn number(&self) -> u64 {
        mix(self.likeness ^ mix(self.twin))
    }

    /// The draws at a tick for a purpose: for a message that is received the number of its sender's
    /// stream, else 0.
    pub fn at(&self, tick: u64, purpose: u64) -> Noise {
        let n_ticks = tick.saturating_sub(self.first_tick);
        Noise {
            key: Key::new(self.number(), purpose, n_ticks),
            n_drawn: 0,
        }
    }
}

impl Noise {
    /// Standard normal.
    pub fn normal(&mut self) -> f64 {
        self.n_drawn += 1;
        self.key.gaussian(self.n_drawn)
    }

    /// Adds an error with this standard deviation and bias to a value.
    pub fn with(&mut self, value: f64, [stddev, bias]: [f64; 2]) -> f64 {
        let error = stddev * self.normal();
        value + bias + if stddev > 0.0 { error } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn station(seed: &str) -> Description {
        Description {
            type_id: "sensor.other.v2x".into(),
            attributes: vec![crate::wire::description::Attribute {
                name: "noise_seed".into(),
                value: seed.into(),
                kind: 0,
            }],
        }
    }

    #[test]
    fn draws_have_mean_0_and_deviation_1_over_ticks() {
        let stream = Stream::new(&station("3"), ["", ""], 7, [].iter());
        let n: u32 = 100_000;
        let draws: Vec<f64> = (0..n)
            .map(|i| stream.at(7 + u64::from(i), 0).normal())
            .collect();
        let mean = draws.iter().sum::<f64>() / f64::from(n);
        let deviation =
            (draws.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / f64::from(n)).sqrt();
        assert!(
            mean.abs() < 0.02 && (deviation - 1.0).abs() < 0.02,
            "{mean} {deviation}"
        );
    }

    #[test]
    fn equal_stations_of_two_runs_draw_the_same_and_twins_of_one_run_do_not() {
        let run = |first_tick: u64| {
            let mut living: Vec<Stream> = Vec::new();
            for (seed, carrier) in [("1", "a"), ("1", "a"), ("2", "a"), ("1", "b")] {
                let made =
                    Stream::new(&station(seed), [carrier, "hero"], first_tick, living.iter());
                living.push(made);
            }
            let draws: Vec<f64> = living
                .iter()
                .map(|of| of.at(first_tick + 5, 9).normal())
                .collect();
            draws
        };
        let (one, other) = (run(10), run(4711));
        assert_eq!(one, other);
        for i in 0..4 {
            for j in 0..i {
                assert_ne!(one[i], one[j], "{i} {j}");
            }
        }
    }
}
