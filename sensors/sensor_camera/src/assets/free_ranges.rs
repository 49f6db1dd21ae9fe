//! Which parts of a buffer are free.

/// Free ranges by rising start, none of them empty, no two touching.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct FreeRanges(Vec<(u32, u32)>);

impl FreeRanges {
    /// One range.
    pub fn of(from: u32, to: u32) -> FreeRanges {
        let mut free = FreeRanges::default();
        free.give(from, to.saturating_sub(from));
        free
    }

    /// Takes `n` places from the first range that has them; where it begins. Nothing is at 0.
    pub fn take(&mut self, n: u32) -> Option<u32> {
        if n == 0 {
            return Some(0);
        }
        let idx = self.0.iter().position(|(from, to)| to - from >= n)?;
        let (from, to) = self.0[idx];
        if to - from == n {
            self.0.remove(idx);
        } else {
            self.0[idx].0 += n;
        }
        Some(from)
    }

    /// Gives `n` places from `from` on back.
    pub fn give(&mut self, from: u32, n: u32) {
        if n == 0 {
            return;
        }
        let idx = self.0.partition_point(|range| range.0 < from);
        self.0.insert(idx, (from, from + n));
        if idx + 1 < self.0.len() && self.0[idx].1 == self.0[idx + 1].0 {
            self.0[idx].1 = self.0[idx + 1].1;
            self.0.remove(idx + 1);
        }
        if idx > 0 && self.0[idx - 1].1 == self.0[idx].0 {
            self.0[idx - 1].1 = self.0[idx].1;
            self.0.remove(idx);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Oracle: a list of places, each free or not.
    #[test]
    fn ranges_are_those_of_a_list_of_places() {
        const N: u32 = 400;
        let mut rng = fastrand::Rng::with_seed(4);
        let mut free = FreeRanges::of(0, N);
        let mut places = vec![true; N as usize];
        let mut taken: Vec<(u32, u32)> = Vec::new();
        for _ in 0..5000 {
            if rng.bool() {
                let n = rng.u32(1..40);
                let fits = places
                    .windows(n as usize)
                    .position(|window| window.iter().all(|is_free| *is_free));
                assert_eq!(free.take(n), fits.map(|at| at as u32));
                if let Some(at) = fits {
                    places[at..at + n as usize].fill(false);
                    taken.push((at as u32, n));
                }
            } else if !taken.is_empty() {
                let (from, n) = taken.swap_remove(rng.usize(..taken.len()));
                places[from as usize..(from + n) as usize].fill(true);
                free.give(from, n);
            }
        }
        for (from, n) in taken {
            free.give(from, n);
        }
        assert_eq!(free, FreeRanges::of(0, N));
    }
}
