//! Which of several processes drives a vehicle.
//!
//! Every process finds out by itself who drives whom: from the vehicle's id, the number of shares,
//! and the processes that are at work. Each share draws a number per vehicle and the highest of
//! those at work wins (rendezvous hashing), so that a vehicle keeps its driver while others come,
//! and only the vehicles of a process that ends go to somebody else.

use std::str::FromStr;

use schema_types::noise::Noise;

/// Most shares: as many processes may read each other's controls beside the daemon and one that
/// only looks.
pub const MAX_SHARES: u32 = 6;
/// Stream of the draws.
const DRAWS: u64 = 0x73_68_61_72_65;

/// One of several shares of the vehicles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Share {
    /// Which one, from 1.
    pub number: u32,
    /// How many there are.
    pub of: u32,
}

impl FromStr for Share {
    type Err = String;

    fn from_str(text: &str) -> Result<Share, String> {
        let parsed = text
            .split_once('/')
            .and_then(|(number, of)| Some((number.parse().ok()?, of.parse().ok()?)));
        match parsed {
            Some((number, of)) if (1..=of).contains(&number) && of <= MAX_SHARES => {
                Ok(Share { number, of })
            }
            _ => Err(format!(
                "{text:?} is no share: write I/N, such as 2/3 for the second of three, with N from 1 to {MAX_SHARES} and I from 1 to N"
            )),
        }
    }
}

impl std::fmt::Display for Share {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}-of-{}", self.number, self.of)
    }
}

impl Share {
    /// Whether this share drives a vehicle while those shares are at work of which `works` says so;
    /// this one always is.
    pub fn drives(self, id: u32, works: impl Fn(u32) -> bool) -> bool {
        let draw = |number: u32| Noise::new(DRAWS, id.into(), number.into()).key();
        let mine = draw(self.number);
        let others = (1..=self.of).filter(|number| *number != self.number && works(*number));
        others.into_iter().all(|number| draw(number) < mine)
    }
}

/// What is known about the other shares.
#[derive(Clone, Debug)]
pub struct Colleagues {
    share: Share,
    /// Last tick that each answered, by number less one; `None` for one that was never heard.
    answered: Vec<Option<u64>>,
    /// Whether each has fallen silent.
    silent: Vec<bool>,
    revision: u64,
}

impl Colleagues {
    /// Nobody has been heard yet.
    pub fn new(share: Share) -> Colleagues {
        Colleagues {
            share,
            answered: vec![None; share.of as usize],
            silent: vec![false; share.of as usize],
            revision: 0,
        }
    }

    /// A share has answered a tick. Returns whether it was silent before.
    pub fn heard(&mut self, number: u32, tick: u64) -> bool {
        let idx = number as usize - 1;
        self.answered[idx] = self.answered[idx].max(Some(tick));
        let was_silent = std::mem::take(&mut self.silent[idx]);
        self.revision += u64::from(was_silent);
        was_silent
    }

    /// The shares, other than this one, that have answered once but nothing since `tick`, of which
    /// `is_late` says so too, and which were not known to be silent.
    pub fn fallen_silent(&mut self, tick: u64, is_late: impl Fn(u32) -> bool) -> Vec<u32> {
        let mut fallen = Vec::new();
        for number in (1..=self.share.of).filter(|number| *number != self.share.number) {
            let idx = number as usize - 1;
            let is_behind = self.answered[idx].is_some_and(|last| last < tick);
            if is_behind && !self.silent[idx] && is_late(number) {
                self.silent[idx] = true;
                self.revision += 1;
                fallen.push(number);
            }
        }
        fallen
    }

    /// Forgets which ticks were answered, because they are counted anew. Who was silent stays so
    /// until it is heard.
    pub fn restart(&mut self) {
        self.answered.fill(None);
    }

    /// The shares, other than this one, that have never answered.
    pub fn unheard(&self) -> impl Iterator<Item = u32> + '_ {
        (1..=self.share.of).filter(|number| {
            let idx = *number as usize - 1;
            *number != self.share.number && self.answered[idx].is_none() && !self.silent[idx]
        })
    }

    /// Whether this process drives a vehicle. A share that was never heard keeps its vehicles: its
    /// process may be about to start.
    pub fn drives(&self, id: u32) -> bool {
        self.share
            .drives(id, |number| !self.silent[number as usize - 1])
    }

    /// Grows whenever [`Colleagues::drives`] may answer otherwise.
    pub fn revision(&self) -> u64 {
        self.revision
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_vehicle_has_one_driver_and_shares_are_about_equal() {
        let of = 3;
        let mut counts = [0; 3];
        for id in 1..=900 {
            let drivers: Vec<u32> = (1..=of)
                .filter(|number| {
                    Share {
                        number: *number,
                        of,
                    }
                    .drives(id, |_| true)
                })
                .collect();
            assert_eq!(drivers.len(), 1, "vehicle {id}: {drivers:?}");
            counts[drivers[0] as usize - 1] += 1;
        }
        assert!(counts.iter().all(|n| (250..350).contains(n)), "{counts:?}");
    }

    #[test]
    fn the_vehicles_of_a_silent_share_go_to_the_others_and_come_back() {
        let shares = [1, 3].map(|number| Share { number, of: 3 });
        let mut seen = shares.map(Colleagues::new);
        for each in &mut seen {
            assert!(!each.heard(2, 10));
            assert_eq!(each.fallen_silent(10, |_| true), Vec::<u32>::new());
        }
        let drives = |seen: &[Colleagues; 2], id| [0, 1].map(|k: usize| seen[k].drives(id));
        let before: Vec<[bool; 2]> = (1..100).map(|id| drives(&seen, id)).collect();
        for each in &mut seen {
            assert_eq!(each.fallen_silent(11, |_| false), Vec::<u32>::new());
            assert_eq!(each.fallen_silent(11, |_| true), [2]);
            assert_eq!(each.fallen_silent(12, |_| true), Vec::<u32>::new());
        }
        for id in 1..100 {
            let (was, is) = (before[id as usize - 1], drives(&seen, id));
            assert_eq!(is.iter().filter(|it| **it).count(), 1, "vehicle {id}");
            // Who had a vehicle keeps it.
            assert!((0..2).all(|k| !was[k] || is[k]), "vehicle {id}");
        }
        for each in &mut seen {
            assert!(each.heard(2, 20));
        }
        let after: Vec<[bool; 2]> = (1..100).map(|id| drives(&seen, id)).collect();
        assert_eq!(before, after);
    }

    #[test]
    fn shares_are_read_strictly() {
        assert_eq!("2/3".parse(), Ok(Share { number: 2, of: 3 }));
        assert_eq!(Share { number: 2, of: 3 }.to_string(), "2-of-3");
        for wrong in ["0/3", "4/3", "1", "1/7", "a/b", "1/0", "-1/2", ""] {
            let error = wrong.parse::<Share>().unwrap_err();
            assert!(error.contains("I/N"), "{error}");
        }
    }
}
