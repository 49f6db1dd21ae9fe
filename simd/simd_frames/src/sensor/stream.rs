//! Which stream of random numbers a sensor draws from.
//!
//! It follows from what was asked for and from what carries the sensor, never from actor ids or
//! from how long the daemon has run, so that a script which begins an episode anew, or runs twice
//! in one daemon, sees the same noise again.

use schema_types::ActorId;
use schema_types::noise::mix;

use crate::hash::BytesHash;

/// The stream of one sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoiseStream {
    /// Hash of what is known of the sensor and of its carrier's kind.
    likeness: u64,
    carrier: Option<ActorId>,
    /// Number among the carriers of sensors of one likeness.
    twin: u64,
}

impl NoiseStream {
    /// The stream of a sensor that its launch file names.
    pub fn named(rig: &str, name: &str) -> Self {
        NoiseStream {
            likeness: hash(&[rig.as_bytes(), name.as_bytes()]),
            carrier: None,
            twin: 0,
        }
    }

    /// The stream of a sensor that a command makes, told apart by `parts`. Sensors alike on several
    /// carriers draw different numbers: each carrier takes the smallest number that none of
    /// `living` has.
    pub fn made<'a>(
        parts: &[&[u8]],
        carrier: Option<ActorId>,
        living: impl Iterator<Item = &'a NoiseStream>,
    ) -> Self {
        let likeness = hash(parts);
        let alike: Vec<&NoiseStream> = living.filter(|of| of.likeness == likeness).collect();
        let twin = match alike.iter().find(|of| of.carrier == carrier) {
            Some(beside) => beside.twin,
            None => (0..)
                .find(|number| alike.iter().all(|of| of.twin != *number))
                .expect("there are fewer sensors than numbers"),
        };
        NoiseStream {
            likeness,
            carrier,
            twin,
        }
    }

    /// The stream of a number.
    pub fn of_number(number: u64) -> Self {
        NoiseStream {
            likeness: number,
            carrier: None,
            twin: 0,
        }
    }

    /// Number of the stream.
    pub fn number(&self) -> u64 {
        match self.twin {
            0 => self.likeness,
            twin => mix(self.likeness ^ mix(twin)),
        }
    }
}

fn hash(parts: &[&[u8]]) -> u64 {
    parts
        .iter()
        .fold(BytesHash::new(), |hash, part| hash.chunk(part))
        .finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_follow_from_likeness_and_the_order_of_twins_not_from_ids() {
        let fleet = |first_id: u32| {
            let mut living: Vec<NoiseStream> = Vec::new();
            for (print, id) in [("a", 0), ("a", 7), ("b", 7), ("a", 9), ("a", 7)] {
                let carrier = Some(ActorId(first_id + id));
                living.push(NoiseStream::made(
                    &[print.as_bytes()],
                    carrier,
                    living.iter(),
                ));
            }
            living
        };
        let numbers = |fleet: &[NoiseStream]| fleet.iter().map(NoiseStream::number).collect();
        let (one, other): (Vec<u64>, Vec<u64>) = (numbers(&fleet(10)), numbers(&fleet(900)));
        assert_eq!(one, other);
        assert_eq!(one[1], one[4], "alike in everything, on one carrier");
        for (i, j) in [(0, 1), (0, 3), (1, 3), (1, 2)] {
            assert_ne!(one[i], one[j]);
        }
        // A twin that is gone leaves its number to the next.
        let mut left = fleet(10);
        left.remove(0);
        let next = NoiseStream::made(&[b"a"], Some(ActorId(77)), left.iter());
        assert_eq!(next.number(), one[0]);
    }
}
