//! What a program did in one run of one scenario: every result with its times, which frames there
//! were, and what the processes used.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt as _;
use std::path::PathBuf;
use std::sync::Arc;

use schema_frames::{About, InputRecord, ResultHeader};
use serde::{Deserialize, Serialize};

/// How a program is run.
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Serialize,
    Deserialize,
    schemars::JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// In lockstep: every frame is waited for, so time plays no part.
    Offline,
    /// In real time (or a multiple of it): the program gets what it can keep up with.
    Streaming,
    /// A constant stream, as many frames as asked for: latency only.
    Stress,
}

/// One run.
#[derive(Clone, Debug)]
pub struct Capture {
    /// Name of the program.
    pub program: String,
    /// Name of the scenario.
    pub scenario: String,
    /// How it ran.
    pub mode: Mode,
    /// Simulated seconds per second of the wall clock that were asked for; 0 in lockstep.
    pub speed: f64,
    /// What is added to the time at which every result counts as available, nanoseconds.
    pub added_delay_nanos: u64,
    /// Simulated time over time of the machine's monotonic clock, in order of both.
    pub clock: Clock,
    /// Every result that was published, in order of arrival, also late, repeated and wrong ones.
    pub results: Vec<CapturedResult>,
    /// What each topic of results says about itself: names of classes, fields of points.
    pub abouts: BTreeMap<Arc<str>, About>,
    /// Frames of the program's inputs that were there to be taken, by topic and tick.
    pub frames: Vec<SentFrame>,
    /// Results that the benchmark's own reader lost or did not keep, because a program sent faster
    /// than it reads, or more than [`MAX_RESULTS_PER_FRAME`].
    pub n_lost: u64,
    /// Results that break the contract and could not be read.
    pub n_refused: u64,
    /// What the processes used, sampled.
    pub usage: Vec<Usage>,
    /// What went wrong, a sentence each: a crash, a restart, a result that cannot be read.
    pub faults: Vec<String>,
    /// Whether one of its processes ended by itself with something else than exit code 0.
    pub has_crashed: bool,
    /// The recording of this very run, if the program drove.
    pub drive_recording: Option<PathBuf>,
}

/// Most results of one run that are kept for each frame that was sent; further ones count as lost.
pub const MAX_RESULTS_PER_FRAME: usize = 64;
/// Most bytes of bodies of one run that are kept.
pub const MAX_BODY_BYTES: u64 = 8 << 30;
/// Bodies up to this size stay in memory, bytes.
const SMALL_BODY_BYTES: usize = 8 << 10;
/// Most bytes of small bodies of one run in memory.
const MAX_SMALL_BYTES: u64 = 256 << 20;

/// The body of a result: in memory if it is small, else in a file without a name.
#[derive(Clone, Debug)]
pub enum Body {
    /// In memory.
    Held(Arc<[u8]>),
    /// In a file that many bodies share.
    Filed {
        /// The file.
        file: Arc<File>,
        /// Where it begins.
        at: u64,
        /// Its bytes.
        len: usize,
    },
    /// Not kept: only times count in this run.
    Dropped,
}

impl Body {
    /// The bytes; none of a body that was not kept.
    ///
    /// # Errors
    /// If the disk cannot be read.
    pub fn bytes(&self) -> io::Result<Arc<[u8]>> {
        match self {
            Body::Held(bytes) => Ok(bytes.clone()),
            Body::Filed { file, at, len } => {
                let mut bytes = vec![0; *len];
                file.read_exact_at(&mut bytes, *at)?;
                Ok(bytes.into())
            }
            Body::Dropped => Ok(Arc::default()),
        }
    }
}

/// Keeps the bodies of one run within bounds.
#[derive(Debug, Default)]
pub struct BodyStore {
    file: Option<Arc<File>>,
    filed_bytes: u64,
    held_bytes: u64,
}

impl BodyStore {
    /// Keeps a body; `None` if [`MAX_BODY_BYTES`] are kept already.
    ///
    /// # Errors
    /// If the folder for temporary files cannot be written.
    pub fn keep(&mut self, bytes: &[u8]) -> io::Result<Option<Body>> {
        let len = bytes.len() as u64;
        if bytes.len() <= SMALL_BODY_BYTES && self.held_bytes + len <= MAX_SMALL_BYTES {
            self.held_bytes += len;
            return Ok(Some(Body::Held(bytes.into())));
        }
        if self.filed_bytes + len > MAX_BODY_BYTES {
            return Ok(None);
        }
        let file = match &self.file {
            Some(file) => file.clone(),
            None => self.file.insert(Arc::new(tempfile::tempfile()?)).clone(),
        };
        let at = self.filed_bytes;
        file.write_all_at(bytes, at)?;
        self.filed_bytes += len;
        let len = bytes.len();
        Ok(Some(Body::Filed { file, at, len }))
    }
}

/// A result as it arrived.
#[derive(Clone, Debug)]
pub struct CapturedResult {
    /// Topic without the domain.
    pub topic: Arc<str>,
    /// Its header, checked.
    pub header: ResultHeader,
    /// Its body.
    pub body: Body,
    /// Which frames it answers.
    pub inputs: Vec<InputRecord>,
    /// When the benchmark held it, nanoseconds of the monotonic clock. When it was published stands
    /// in the header.
    pub held_mono_nanos: u64,
}

/// A frame of an input topic.
#[derive(Clone, Debug)]
pub struct SentFrame {
    /// Topic without the domain.
    pub topic: Arc<str>,
    /// Its tick.
    pub tick: u64,
    /// Number of its firing.
    pub seq: u64,
    /// Epoch of the simulator or replay that sent it; a recording that begins again has a new one.
    pub epoch: u64,
    /// Its simulated time, nanoseconds.
    pub sim_nanos: u64,
    /// When it was published, nanoseconds of the monotonic clock; 0 if that is not known.
    pub published_mono_nanos: u64,
}

/// What a process and its children used up to a moment.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Usage {
    /// Name of the process: the program, the simulator or the replay.
    pub process: String,
    /// Nanoseconds of the monotonic clock.
    pub mono_nanos: u64,
    /// Processor time so far, seconds.
    pub cpu_secs: f64,
    /// Memory of its own, bytes.
    pub own_bytes: u64,
}

/// Simulated time over the monotonic clock, from snapshots.
#[derive(Clone, Debug, Default)]
pub struct Clock {
    points: Vec<(u64, u64)>,
}

impl Clock {
    /// Of pairs of simulated time and the monotonic clock's, nanoseconds, which both rise.
    pub(crate) fn of(points: Vec<(u64, u64)>) -> Clock {
        Clock { points }
    }

    /// Those pairs.
    pub(crate) fn points(&self) -> &[(u64, u64)] {
        &self.points
    }

    /// A snapshot of simulated time `sim_nanos` was published at `mono_nanos`. Points that go back
    /// are left out.
    pub fn push(&mut self, sim_nanos: u64, mono_nanos: u64) {
        let goes_on = self
            .points
            .last()
            .is_none_or(|(sim, mono)| sim_nanos > *sim && mono_nanos > *mono);
        if goes_on {
            self.points.push((sim_nanos, mono_nanos));
        }
    }

    /// Simulated time at a moment of the monotonic clock, nanoseconds: between two snapshots in
    /// proportion, beyond the ends at the pace of the nearest two. `None` before there are two.
    pub fn sim_at(&self, mono_nanos: u64) -> Option<f64> {
        if self.points.len() < 2 {
            return None;
        }
        let at = self.points.partition_point(|(_, mono)| *mono <= mono_nanos);
        let at = at.clamp(1, self.points.len() - 1);
        let ((sim_a, mono_a), (sim_b, mono_b)) = (self.points[at - 1], self.points[at]);
        let share = (mono_nanos as f64 - mono_a as f64) / (mono_b - mono_a) as f64;
        Some(sim_a as f64 + share * (sim_b - sim_a) as f64)
    }

    /// When the first and the last snapshot were published, nanoseconds of the monotonic clock.
    pub fn mono_span(&self) -> Option<(u64, u64)> {
        Some((self.points.first()?.1, self.points.last()?.1))
    }

    /// Simulated seconds per second of the wall clock over the whole run; `None` before there are
    /// two snapshots.
    pub fn pace(&self) -> Option<f64> {
        let ((sim_a, mono_a), (sim_b, mono_b)) = (self.points.first()?, self.points.last()?);
        (mono_b > mono_a).then(|| (sim_b - sim_a) as f64 / (mono_b - mono_a) as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_bodies_stay_in_memory_and_large_ones_come_back_from_the_file() {
        let mut store = BodyStore::default();
        let (small, large) = (vec![1; 100], vec![2; SMALL_BODY_BYTES + 1]);
        let kept: Vec<Body> = [&small, &large, &large]
            .iter()
            .map(|bytes| store.keep(bytes).unwrap().unwrap())
            .collect();
        assert!(matches!(kept[0], Body::Held(_)) && matches!(kept[2], Body::Filed { .. }));
        assert_eq!(&*kept[0].bytes().unwrap(), &small[..]);
        assert_eq!(&*kept[2].bytes().unwrap(), &large[..]);
        store.filed_bytes = MAX_BODY_BYTES;
        assert!(store.keep(&large).unwrap().is_none());
    }

    #[test]
    fn simulated_time_follows_the_snapshots_and_goes_on_beyond_them() {
        let mut clock = Clock::default();
        assert_eq!(clock.sim_at(5), None);
        for (sim, mono) in [(0, 1000), (100, 1100), (100, 1150), (200, 1300)] {
            clock.push(sim, mono);
        }
        for (mono, sim) in [
            (900, -100.0),
            (1050, 50.0),
            (1100, 100.0),
            (1200, 150.0),
            (1400, 250.0),
        ] {
            assert_eq!(clock.sim_at(mono), Some(sim), "{mono}");
        }
        assert_eq!(clock.pace(), Some(200.0 / 300.0));
    }
}
