//! The time surface of an event camera: how long ago each pixel changed, brighter the newer.

use bytemuck::pod_read_unaligned;
use schema_frames::DvsEvent;

use consumer_forms::palette;

/// Age at which a change is no longer seen, nanoseconds.
const FADED_NANOS: u64 = 100_000_000;
/// Steps of brightness of each kind of change.
const STEPS: u64 = 31;

/// When each pixel changed last.
#[derive(Debug, Default)]
pub(crate) struct Surface {
    size_px: [u32; 2],
    /// Simulated time, nanoseconds, doubled, with the kind of change in the lowest bit.
    newest: Vec<u64>,
}

impl Surface {
    /// Takes the events of a window in that began at `begin_nanos`.
    pub(crate) fn take(&mut self, size_px: [u32; 2], begin_nanos: u64, payload: &[u8]) {
        let [width, height] = size_px.map(|px| px as usize);
        if self.size_px != size_px {
            self.size_px = size_px;
            self.newest = vec![0; width * height];
        }
        for bytes in payload.chunks_exact(size_of::<DvsEvent>()) {
            let event: DvsEvent = pod_read_unaligned(bytes);
            let (x, y) = (event.x_px as usize, event.y_px as usize);
            if x < width && y < height {
                let at = begin_nanos + event.nanos_in_window as u64;
                self.newest[y * width + x] = at << 1 | (event.polarity == 1) as u64;
            }
        }
    }

    /// The picture at `now_nanos` as numbers of [`colours`].
    pub(crate) fn numbers(&self, now_nanos: u64) -> Vec<u8> {
        let number = |newest: &u64| {
            let age = now_nanos.wrapping_sub(newest >> 1);
            // What lies ahead of now, after the world went back in time, is old too.
            if *newest == 0 || age >= FADED_NANOS {
                return 0;
            }
            let step = STEPS - age * STEPS / FADED_NANOS;
            (step + (newest & 1) * STEPS) as u8
        };
        self.newest.iter().map(number).collect()
    }
}

/// Colours of a time surface: nothing, then darker from old to new, then brighter from old to new.
pub(crate) fn colours() -> Vec<[u8; 3]> {
    let [nothing, darker, brighter] = palette::EVENTS;
    let faded = |full: [u8; 3], step: u64| {
        std::array::from_fn(|channel| {
            let (from, to) = (nothing[channel] as i64, full[channel] as i64);
            (from + (to - from) * step as i64 / STEPS as i64) as u8
        })
    };
    let mut all = vec![nothing];
    for full in [darker, brighter] {
        all.extend((1..=STEPS).map(|step| faded(full, step)));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_fades_and_the_newest_counts() {
        let event = |x_px, nanos_in_window, polarity| DvsEvent {
            nanos_in_window,
            x_px,
            y_px: 0,
            object_id: 0,
            polarity,
            class: 0,
            reserved: 0,
        };
        let events = [event(0, 0, 1), event(1, 50_000_000, 0), event(9, 0, 1)];
        let mut surface = Surface::default();
        surface.take([3, 1], 1_000_000_000, bytemuck::cast_slice(&events));
        let seen = |at| surface.numbers(at);
        // At its time a change has its full colour, the last of its kind.
        assert_eq!(seen(1_000_000_000)[0] as u64, 2 * STEPS);
        assert_eq!(seen(1_050_000_000), [STEPS as u8 + 16, STEPS as u8, 0]);
        assert_eq!(seen(1_100_000_000), [0, 16, 0]);
        assert_eq!(seen(500_000_000), [0, 0, 0], "the world went back");
        let colours = colours();
        assert_eq!(colours.len() as u64, 1 + 2 * STEPS);
        assert_eq!(
            [colours[31], colours[62]],
            [palette::EVENTS[1], palette::EVENTS[2]]
        );
    }
}
