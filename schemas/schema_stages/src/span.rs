//! Stages and the spans that add to them.

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use nix::time::{ClockId, clock_gettime};
use parking_lot::Mutex;

/// Stages of this process that were entered at least once, in the order of their first time.
static ENTERED: Mutex<Vec<&'static Stage>> = Mutex::new(Vec::new());

thread_local! {
    /// Processor time and time on the wall, nanoseconds, that inner spans of the span that this
    /// thread is in have taken.
    static INNER: Cell<(u64, u64)> = const { Cell::new((0, 0)) };
}

/// One stage of a program's work. Make it a `static`.
#[derive(Debug)]
pub struct Stage {
    name: &'static str,
    cpu_nanos: AtomicU64,
    wall_nanos: AtomicU64,
    n_spans: AtomicU64,
    is_entered: AtomicBool,
}

/// What a stage took since the process began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sums {
    /// Processor time of the threads that were in it, nanoseconds.
    pub cpu_nanos: u64,
    /// Time on the wall, nanoseconds; of threads side by side the sum.
    pub wall_nanos: u64,
    /// How often it was entered.
    pub n_spans: u64,
}

impl Stage {
    /// A stage of this name, in lower case and at most 23 bytes.
    pub const fn new(name: &'static str) -> Stage {
        assert!(name.len() < 24, "the name of a stage has at most 23 bytes");
        Stage {
            name,
            cpu_nanos: AtomicU64::new(0),
            wall_nanos: AtomicU64::new(0),
            n_spans: AtomicU64::new(0),
            is_entered: AtomicBool::new(false),
        }
    }

    /// Its name.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Begins a span on this thread, which ends when it is dropped.
    pub fn span(&'static self) -> Span {
        Span {
            stage: self,
            outer: INNER.replace((0, 0)),
            began: Instant::now(),
            cpu_nanos: thread_cpu_nanos(),
        }
    }

    /// Adds what was measured elsewhere, such as by a GPU's own clock: it lies in no span.
    pub fn add(&'static self, cpu_nanos: u64, wall_nanos: u64) {
        if !self.is_entered.swap(true, Ordering::Relaxed) {
            entered(|stages| stages.push(self));
        }
        self.cpu_nanos.fetch_add(cpu_nanos, Ordering::Relaxed);
        self.wall_nanos.fetch_add(wall_nanos, Ordering::Relaxed);
        self.n_spans.fetch_add(1, Ordering::Relaxed);
    }

    /// What it took so far.
    pub fn sums(&self) -> Sums {
        Sums {
            cpu_nanos: self.cpu_nanos.load(Ordering::Relaxed),
            wall_nanos: self.wall_nanos.load(Ordering::Relaxed),
            n_spans: self.n_spans.load(Ordering::Relaxed),
        }
    }
}

/// The list of entered stages; it stays usable after a panic elsewhere.
pub(crate) fn entered<T>(use_it: impl FnOnce(&mut Vec<&'static Stage>) -> T) -> T {
    use_it(&mut ENTERED.lock())
}

/// A thread is in a stage until this is dropped, on the same thread.
#[derive(Debug)]
#[must_use = "a span ends when it is dropped"]
pub struct Span {
    stage: &'static Stage,
    /// What the inner spans of the span around this one had taken before it.
    outer: (u64, u64),
    began: Instant,
    cpu_nanos: u64,
}

impl Drop for Span {
    fn drop(&mut self) {
        let cpu_nanos = thread_cpu_nanos().saturating_sub(self.cpu_nanos);
        let wall_nanos = u64::try_from(self.began.elapsed().as_nanos()).unwrap_or(u64::MAX);
        let (inner_cpu, inner_wall) = INNER.get();
        self.stage.add(
            cpu_nanos.saturating_sub(inner_cpu),
            wall_nanos.saturating_sub(inner_wall),
        );
        let (outer_cpu, outer_wall) = self.outer;
        INNER.set((outer_cpu + cpu_nanos, outer_wall + wall_nanos));
    }
}

/// Processor time of this thread, nanoseconds; 0 where the kernel has no such clock.
fn thread_cpu_nanos() -> u64 {
    let time = clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID);
    time.map_or(0, |time| {
        u64::try_from(time.tv_sec()).unwrap_or(0) * 1_000_000_000
            + u64::try_from(time.tv_nsec()).unwrap_or(0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    static OUTER: Stage = Stage::new("outer");
    static INSIDE: Stage = Stage::new("inside");
    static ASLEEP: Stage = Stage::new("asleep");

    fn work(wanted_nanos: u64) {
        let from = thread_cpu_nanos();
        while thread_cpu_nanos() < from + wanted_nanos {
            std::hint::spin_loop();
        }
    }

    #[test]
    fn an_inner_span_does_not_count_for_the_outer_one() {
        {
            let _outer = OUTER.span();
            work(20_000_000);
            for _ in 0..2 {
                let _inner = INSIDE.span();
                work(40_000_000);
            }
        }
        let (outer, inner) = (OUTER.sums(), INSIDE.sums());
        assert_eq!((outer.n_spans, inner.n_spans), (1, 2));
        assert!(
            (20_000_000..40_000_000).contains(&outer.cpu_nanos),
            "{outer:?}"
        );
        assert!(inner.cpu_nanos >= 80_000_000, "{inner:?}");
    }

    #[test]
    fn sleep_takes_no_processor_time() {
        {
            let _span = ASLEEP.span();
            std::thread::sleep(Duration::from_millis(50));
        }
        let sums = ASLEEP.sums();
        assert!(
            sums.wall_nanos >= 50_000_000 && sums.cpu_nanos < 25_000_000,
            "{sums:?}"
        );
    }
}
