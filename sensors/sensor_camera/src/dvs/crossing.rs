//! Crossings of a pixel's thresholds.

/// One pixel and its state.
pub(super) struct Crossing<'p> {
    /// Change of the level per event, upwards and downwards.
    pub thresholds: [f32; 2],
    /// Level at the last event.
    pub reference: &'p mut f32,
    /// Rest of the refractory period when the window began, nanoseconds; without one it is not
    /// touched.
    pub silent_nanos: &'p mut u32,
    pub refractory_nanos: u32,
}

impl Crossing<'_> {
    /// Levels at which the next event comes, below and above.
    #[inline(always)]
    pub fn limits(&self) -> [f32; 2] {
        let [up, down] = self.thresholds;
        [*self.reference - down, *self.reference + up]
    }

    /// Makes the events of a level that goes linearly from `before` to `after`.
    #[inline(always)]
    pub fn follow(
        &mut self,
        before: f32,
        after: f32,
        begin_nanos: u32,
        end_nanos: u32,
        event: &mut impl FnMut(u32, u8),
    ) {
        let [up, down] = self.thresholds;
        let (step, polarity) = if after > before { (up, 1) } else { (-down, 0) };
        // With this sign, levels rise in the direction of their change.
        let sign = if after > before { 1.0 } else { -1.0 };
        let mut target = *self.reference + step;
        if sign * after < sign * target {
            return;
        }
        let length_nanos = end_nanos - begin_nanos;
        // A level that is already beyond the threshold (a step where the images do not match)
        // crosses at once, or at the end if it does not change.
        let per_level = if after == before {
            f32::INFINITY
        } else {
            1.0 / (after - before)
        };
        while sign * after >= sign * target {
            let share = (target - before) * per_level;
            // The resolution is 2⁻²⁴ of the step: 3 ns of 50 ms. The conversion saturates, so times
            // outside the step become its ends.
            let nanos = begin_nanos + ((share * length_nanos as f32) as u32).min(length_nanos);
            *self.reference = target;
            target += step;
            if self.refractory_nanos == 0 {
                event(nanos, polarity);
            } else if nanos >= *self.silent_nanos {
                // In the refractory period the change is lost, as in the real pixel.
                event(nanos, polarity);
                *self.silent_nanos = nanos.saturating_add(self.refractory_nanos);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn follow(refractory_nanos: u32, after: f32, end_nanos: u32) -> (Vec<(u32, u8)>, f32) {
        let (mut reference, mut silent_nanos, mut events) = (0.0, 0, Vec::new());
        let mut crossing = Crossing {
            thresholds: [0.25; 2],
            reference: &mut reference,
            silent_nanos: &mut silent_nanos,
            refractory_nanos,
        };
        crossing.follow(0.0, after, 0, end_nanos, &mut |nanos, polarity| {
            events.push((nanos, polarity))
        });
        (events, reference)
    }

    #[test]
    fn ramp_crosses_at_equal_times_and_remembers_the_rest() {
        let (events, reference) = follow(0, 1.1, 1_100);
        assert_eq!(events.len(), 4);
        for ((nanos, polarity), expected) in events.into_iter().zip([250u32, 500, 750, 1000]) {
            assert!(nanos.abs_diff(expected) <= 1 && polarity == 1, "{nanos}");
        }
        assert_eq!(reference, 1.0);
    }

    #[test]
    fn refractory_period_swallows_events() {
        let (events, reference) = follow(400, -1.0, 1_000);
        assert_eq!(events.len(), 2, "{events:?}");
        for ((nanos, polarity), expected) in events.into_iter().zip([250u32, 750]) {
            assert!(nanos.abs_diff(expected) <= 1 && polarity == 0, "{nanos}");
        }
        assert_eq!(reference, -1.0);
    }

    #[test]
    fn what_is_beyond_already_crosses_at_once_and_a_level_that_stays_at_the_end() {
        let (mut reference, mut silent_nanos) = (0.0, 0);
        let mut times = Vec::new();
        let mut crossing = Crossing {
            thresholds: [0.25; 2],
            reference: &mut reference,
            silent_nanos: &mut silent_nanos,
            refractory_nanos: 0,
        };
        crossing.follow(0.3, 0.6, 100, 200, &mut |nanos, _| times.push(nanos));
        assert_eq!((times[0], times.len()), (100, 2));
        *crossing.reference = 0.0;
        times.clear();
        crossing.follow(-0.3, -0.3, 100, 200, &mut |nanos, _| times.push(nanos));
        assert!(
            times.iter().all(|nanos| (100..=200).contains(nanos)) && times.len() == 1,
            "{times:?}"
        );
    }
}
