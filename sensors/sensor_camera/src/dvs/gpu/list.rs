//! The list of events that the GPU writes, and the copy to the reader.

use std::sync::Arc;

use bytemuck::Zeroable;
use parking_lot::Mutex;
use schema_frames::DvsEvent;
use sensor_gpu::HostMemory;

use crate::dvs::events_made::EventsMade;
use crate::dvs::sort::{Slices, Sorter};

/// Slices of time by which the shader groups events.
pub(super) const N_SLICES: usize = 1024;
/// Bytes of the list before its first event.
pub(super) const HEAD_BYTES: usize = 4 * N_SLICES;
/// Lists that are not in use.
pub(super) type Lists = Arc<Mutex<Vec<HostMemory>>>;

/// Where the events of a window will be once the GPU is done.
pub(crate) struct EventList {
    /// `None` after it was given back.
    pub(super) memory: Option<HostMemory>,
    pub(super) first: bool,
    pub(super) capacity: usize,
    pub(super) max_events: usize,
    pub(super) window_nanos: u64,
    pub(super) lists: Lists,
}

impl std::fmt::Debug for EventList {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("EventList")
            .field("window_nanos", &self.window_nanos)
            .finish_non_exhaustive()
    }
}

impl EventList {
    /// Writes the events to the front of `out`, sorted by time, y, x.
    ///
    /// # Safety
    /// The submission that writes the list is done.
    #[expect(
        unsafe_code,
        reason = "the GPU has written there; the block carries its proof"
    )]
    pub unsafe fn finish(mut self, out: &mut [u8]) -> EventsMade {
        let Some(memory) = self.memory.take() else {
            return EventsMade {
                n_events: 0,
                n_dropped: 0,
                first: self.first,
            };
        };
        let made = if self.first {
            EventsMade {
                n_events: 0,
                n_dropped: 0,
                first: true,
            }
        } else {
            // SAFETY: this value has exclusive use of the list until it is given back, nobody calls
            // `write` on it, and the submission that wrote it is done (the caller's promise).
            self.sort(unsafe { memory.bytes() }, out)
        };
        self.lists.lock().push(memory);
        made
    }

    fn sort(&self, bytes: &[u8], out: &mut [u8]) -> EventsMade {
        let (head, events) = bytes.split_at(HEAD_BYTES);
        let ends: &[u32] = bytemuck::cast_slice(head);
        let events: &[DvsEvent] =
            bytemuck::cast_slice(&events[..self.capacity * size_of::<DvsEvent>()]);
        let n_made = ends[N_SLICES - 1] as usize;
        // If a slice does not fit, which of its events are in the list depends on the order of the
        // GPU's work. Such a slice is dropped, so that frames are reproducible.
        let n_whole = ends
            .iter()
            .map(|end| *end as usize)
            .take_while(|end| *end <= self.capacity)
            .last()
            .unwrap_or(0);
        let n_events = n_made
            .min(self.max_events)
            .min(n_whole)
            .min(out.len() / size_of::<DvsEvent>());
        let slices = Slices {
            ends,
            window_nanos: self.window_nanos,
        };
        let out = &mut out[..n_events * size_of::<DvsEvent>()];
        match bytemuck::try_cast_slice_mut(out) {
            Ok(place) => Sorter::sort_slices(&slices, events, place),
            Err(_) => {
                let mut sorted = vec![DvsEvent::zeroed(); n_events];
                Sorter::sort_slices(&slices, events, &mut sorted);
                out.copy_from_slice(bytemuck::cast_slice(&sorted));
            }
        }
        EventsMade {
            n_events,
            n_dropped: (n_made - n_events) as u64,
            first: false,
        }
    }
}
