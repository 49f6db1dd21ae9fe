//! Measures where the time of a submission goes, on the GPU and while it is prepared, for
//! benchmarks. It is off by default, and costs nothing then.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Instant;

use parking_lot::{Mutex, MutexGuard};

/// Upper limit of marks in one submission; further ones are left out.
const MAX_MARKS: u32 = 4096;

/// Sums of times by label, of the submissions of one device.
#[derive(Debug)]
pub(crate) struct Timing {
    device: wgpu::Device,
    /// Length of a step of the GPU's clock.
    period_nanos: f64,
    on: AtomicBool,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    open: Option<Marks>,
    /// Query sets of earlier submissions: making one costs the CPU more than all of its marks.
    spare: Vec<wgpu::QuerySet>,
    /// (place, label) to nanoseconds.
    spans: BTreeMap<(&'static str, &'static str), f64>,
}

/// Marks of a submission that is being recorded.
#[derive(Debug)]
struct Marks {
    queries: wgpu::QuerySet,
    labels: Vec<&'static str>,
}

/// Marks of a submission in flight.
#[derive(Debug)]
pub(crate) struct Pending {
    queries: wgpu::QuerySet,
    labels: Vec<&'static str>,
    values: wgpu::Buffer,
}

/// One sum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// `GPU`, or `CPU` for the work of preparing a submission.
    pub place: &'static str,
    /// Name of the work. `copies` may overlap with the other labels of the GPU; those add up.
    pub label: &'static str,
    /// Milliseconds since the sums were last taken.
    pub millis: f64,
}

impl Timing {
    /// Timing of a device and its queue, off.
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Timing {
        Timing {
            device: device.clone(),
            period_nanos: queue.get_timestamp_period() as f64,
            on: AtomicBool::new(false),
            state: Mutex::default(),
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock()
    }

    /// As [`crate::Gpu::set_timing`].
    pub fn set(&self, on: bool) -> bool {
        let wanted =
            wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS;
        let can = self.device.features().contains(wanted);
        self.on.store(on && can, Relaxed);
        can
    }

    pub fn is_on(&self) -> bool {
        self.on.load(Relaxed)
    }

    /// As [`crate::Gpu::take_spans`].
    pub fn take_spans(&self) -> Vec<Span> {
        let spans = std::mem::take(&mut self.state().spans);
        spans
            .into_iter()
            .map(|((place, label), nanos)| Span {
                place,
                label,
                millis: nanos * 1e-6,
            })
            .collect()
    }

    /// Adds clock steps that work on another queue took.
    pub fn add_span(&self, label: &'static str, steps: u64) {
        let nanos = steps as f64 * self.period_nanos;
        *self.state().spans.entry(("GPU", label)).or_default() += nanos;
    }

    /// As [`crate::Gpu::mark`].
    pub fn mark(&self, encoder: &mut wgpu::CommandEncoder, label: &'static str) {
        if !self.is_on() {
            return;
        }
        let mut state = self.state();
        let State { open, spare, .. } = &mut *state;
        let marks = open.get_or_insert_with(|| {
            let descriptor = wgpu::QuerySetDescriptor {
                label: Some("marks"),
                ty: wgpu::QueryType::Timestamp,
                count: MAX_MARKS,
            };
            let queries = spare
                .pop()
                .unwrap_or_else(|| self.device.create_query_set(&descriptor));
            Marks {
                queries,
                labels: Vec::new(),
            }
        });
        if (marks.labels.len() as u32) < MAX_MARKS {
            encoder.write_timestamp(&marks.queries, marks.labels.len() as u32);
            marks.labels.push(label);
        }
    }

    /// As [`crate::Gpu::time`].
    pub fn time<T>(&self, label: &'static str, work: impl FnOnce() -> T) -> T {
        if !self.is_on() {
            return work();
        }
        let begin = Instant::now();
        let out = work();
        *self.state().spans.entry(("CPU", label)).or_default() += begin.elapsed().as_nanos() as f64;
        out
    }

    /// Records the readback of the marks, in the last encoder of a submission.
    pub fn close_marks(&self, encoder: &mut wgpu::CommandEncoder) -> Option<Pending> {
        let marks = self.state().open.take()?;
        let n_bytes = 8 * marks.labels.len() as u64;
        let usage = wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC;
        let buffer = |usage| {
            self.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("marks"),
                size: n_bytes,
                usage,
                mapped_at_creation: false,
            })
        };
        let resolved = buffer(usage);
        let values = buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
        encoder.resolve_query_set(&marks.queries, 0..marks.labels.len() as u32, &resolved, 0);
        encoder.copy_buffer_to_buffer(&resolved, 0, &values, 0, n_bytes);
        Some(Pending {
            queries: marks.queries,
            labels: marks.labels,
            values,
        })
    }

    /// Adds up the marks of a submission that is done.
    pub fn read_marks(&self, pending: &Pending) {
        let Ok(view) = pending.values.get_mapped_range(..) else {
            return;
        };
        let at = |i: usize| u64::from_le_bytes(std::array::from_fn(|k| view[8 * i + k]));
        let mut state = self.state();
        state.spare.push(pending.queries.clone());
        for (i, label) in pending.labels.iter().enumerate().skip(1) {
            *state.spans.entry(("GPU", label)).or_default() +=
                at(i).saturating_sub(at(i - 1)) as f64 * self.period_nanos;
        }
    }
}

impl Pending {
    pub(crate) fn map(&self) {
        self.values.map_async(wgpu::MapMode::Read, .., |_| {});
    }
}
