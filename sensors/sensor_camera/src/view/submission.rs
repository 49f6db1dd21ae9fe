//! A submission in flight, and its results.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::Duration;

use parking_lot::Mutex;
use schema_frames::Modality;
use sensor_gpu::{CopyOutcome, GpuError, InFlight, Place};

use crate::dvs::{EventCamera, EventImages, EventList, EventsMade, Rows};

/// Result of one [`crate::Output`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutputResult {
    /// What it shows.
    pub modality: Modality,
    /// Payload bytes in use.
    pub n_bytes: usize,
    /// Copies by the CPU: 0 or 1 (`dvs` is written in place: 0).
    pub cpu_copies: u32,
    /// First frame of a state (flow without a previous firing, an event camera that has just
    /// started).
    pub first: bool,
    /// Events that did not fit.
    pub n_dropped: u64,
    /// Time the frame covers (flow, dvs), nanoseconds; 0 for the others and for the first frame.
    pub window_nanos: u64,
}

/// Results of one [`crate::ViewJob`], outputs in the order of the job.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ViewResult {
    /// One per output.
    pub outputs: Vec<OutputResult>,
}

/// What to do for an output once the GPU is done.
#[derive(Debug)]
pub(crate) enum Plan<'a> {
    /// A copy that was recorded under this number.
    Copied {
        modality: Modality,
        copy: usize,
        first: bool,
        window_nanos: u64,
    },
    /// Events to be made from mapped images.
    Events {
        place: Place<'a>,
        maps: DvsMaps,
        state: Arc<Mutex<EventCamera>>,
        window_nanos: u64,
    },
    /// Events that the GPU made and that are to be sorted.
    EventList {
        place: Place<'a>,
        list: EventList,
        window_nanos: u64,
    },
}

/// Indices of the mapped copies that events are made from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DvsMaps {
    pub luminance: usize,
    pub flow: usize,
    pub depth: usize,
    pub instance: usize,
    pub class: usize,
}

/// Frames in the making. Nothing may be sent before [`Submission::wait`] has returned.
#[derive(Debug)]
#[must_use = "the bytes are there only after wait()"]
pub struct Submission<'a> {
    in_flight: Option<InFlight<'a>>,
    plans: Vec<Vec<Plan<'a>>>,
    /// Once [`Submission::begin_events`] has begun them.
    beside: Option<Result<Making, GpuError>>,
}

impl<'a> Submission<'a> {
    pub(crate) fn new(
        in_flight: Option<InFlight<'a>>,
        plans: Vec<Vec<Plan<'a>>>,
    ) -> Submission<'a> {
        Submission {
            in_flight,
            plans,
            beside: None,
        }
    }
}

/// Results that other threads work on. Dropping it waits for them, because they write to places that
/// the submission was given.
#[derive(Debug)]
struct Making(Receiver<std::thread::Result<Vec<ViewResult>>>);

impl Making {
    /// Carries plans out on rayon's threads.
    fn begin(plans: Vec<Vec<Plan<'static>>>, copies: Vec<CopyOutcome>) -> Making {
        let (sender, receiver) = sync_channel(1);
        rayon::spawn(move || {
            // A panic goes on where the results are waited for.
            let made = catch_unwind(AssertUnwindSafe(|| results(plans, copies)));
            let _ = sender.send(made);
        });
        Making(receiver)
    }

    fn wait(self) -> Vec<ViewResult> {
        match self.0.recv() {
            Ok(Ok(results)) => results,
            Ok(Err(panic)) => resume_unwind(panic),
            Err(_) => unreachable!("the other thread sends, even if it panics"),
        }
    }
}

impl Drop for Making {
    fn drop(&mut self) {
        let _ = self.0.recv();
    }
}

impl Submission<'_> {
    /// Whether nothing was submitted because there are no readers.
    pub fn is_empty(&self) -> bool {
        self.in_flight.is_none()
    }

    /// Whether the GPU has done its part, after waiting for `most` at most.
    pub fn is_drawn_within(&self, most: Duration) -> bool {
        let in_flight = self.in_flight.as_ref();
        in_flight.is_none_or(|in_flight| in_flight.is_done_within(most))
    }

    /// Whether there are events to be made once the GPU has done its part.
    pub fn has_events(&self) -> bool {
        let mut plans = self.plans.iter().flatten();
        plans.any(|plan| !matches!(plan, Plan::Copied { .. }))
    }

    /// Waits for the GPU, makes the events, and returns one result per job, in order.
    ///
    /// # Errors
    /// The device was lost.
    pub fn wait(self) -> Result<Vec<ViewResult>, GpuError> {
        match self.beside {
            Some(beside) => beside.map(Making::wait),
            None => Ok(results(self.plans, waited(self.in_flight)?)),
        }
    }
}

impl Submission<'static> {
    /// Waits for the GPU and lets other threads make the events, so that the next images can be
    /// recorded meanwhile. [`Submission::wait`] waits for them, and so does dropping this.
    pub fn begin_events(&mut self) {
        if self.beside.is_none() && self.has_events() {
            let copies = waited(self.in_flight.take());
            let plans = std::mem::take(&mut self.plans);
            self.beside = Some(copies.map(|copies| Making::begin(plans, copies)));
        }
    }
}

/// What the GPU brought.
fn waited(in_flight: Option<InFlight<'_>>) -> Result<Vec<CopyOutcome>, GpuError> {
    in_flight.map_or(Ok(Vec::new()), InFlight::wait)
}

/// Carries all plans out. The copies are those of the submission that the plans belong to, which is
/// done.
fn results(plans: Vec<Vec<Plan<'_>>>, mut copies: Vec<CopyOutcome>) -> Vec<ViewResult> {
    #[expect(
        unsafe_code,
        reason = "the GPU has written events; the block carries its proof"
    )]
    // SAFETY: whoever has the copies has waited for the submission, and without one there are no
    // plans.
    let mut finish = |plan| unsafe { finish_output(plan, &mut copies) };
    plans
        .into_iter()
        .map(|plans| ViewResult {
            outputs: plans.into_iter().map(&mut finish).collect(),
        })
        .collect()
}

/// Carries out a plan.
///
/// # Safety
/// The submission that the plan belongs to is done.
#[expect(
    unsafe_code,
    reason = "the GPU has written events; the block carries its proof"
)]
unsafe fn finish_output(plan: Plan<'_>, copies: &mut [CopyOutcome]) -> OutputResult {
    match plan {
        Plan::Copied {
            modality,
            copy,
            first,
            window_nanos,
        } => {
            let CopyOutcome {
                n_bytes,
                cpu_copies,
                ..
            } = copies[copy];
            OutputResult {
                modality,
                n_bytes,
                cpu_copies,
                first,
                n_dropped: 0,
                window_nanos,
            }
        }
        Plan::Events {
            mut place,
            maps,
            state,
            window_nanos,
        } => {
            let mut mapped = |copy: usize| {
                copies[copy]
                    .mapped
                    .take()
                    .expect("recorded as mapped, taken once")
            };
            let maps = [
                maps.luminance,
                maps.flow,
                maps.depth,
                maps.instance,
                maps.class,
            ]
            .map(&mut mapped);
            let [luminance, flow, depth, instance, class] = maps.each_ref().map(|map| {
                let rows = map.padded();
                Rows::new(rows.bytes, rows.row_bytes, rows.stride_bytes)
            });
            let images = EventImages {
                luminance,
                flow,
                depth,
                instance,
                class,
            };
            let mut state = state.lock();
            let made = state.advance(&images, window_nanos, place.bytes_mut());
            events_result(made, window_nanos)
        }
        Plan::EventList {
            mut place,
            list,
            window_nanos,
        } => {
            // SAFETY: the caller promises it.
            let made = unsafe { list.finish(place.bytes_mut()) };
            events_result(made, window_nanos)
        }
    }
}

fn events_result(made: EventsMade, window_nanos: u64) -> OutputResult {
    OutputResult {
        modality: Modality::Dvs,
        n_bytes: made.n_events * Modality::Dvs.element_bytes(),
        cpu_copies: 0,
        first: made.first,
        n_dropped: made.n_dropped,
        window_nanos: if made.first { 0 } else { window_nanos },
    }
}
