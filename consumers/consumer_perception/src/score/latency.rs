//! How long results took, and what became of frames and results.
//!
//! Times are of the machine's monotonic clock, whatever the pace of the simulation:
//!
//! | Name | From | To |
//! |---|---|---|
//! | end to end | publication of the oldest frame behind the result | publication of the result |
//! | answer | publication of the answered frame | publication of the result |
//! | work | the program had the frame in hand | publication of the result |
//! | age at use | publication of the answered frame | the program had it in hand |
//!
//! Every result for a frame of the measured part counts, repeated ones too. What a writer leaves out
//! of its results' headers is left out here.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::Arc;

use crate::capture::{Capture, CapturedResult, SentFrame};
use crate::evidence::queries::published;
use crate::report::throughput::Throughput;
use crate::report::{Counts, Latency, ResultEvent};
use consumer_report::Spread;

/// A frame of an input: topic, epoch, tick.
type Key = (Arc<str>, u64, u64);

/// What the frames of one run were, and which results answer which.
pub struct Answered<'a> {
    capture: &'a Capture,
    from_nanos: u64,
    frames: HashMap<Key, At>,
    /// Results with the frame that they answer, in order of arrival; `None`: invented.
    pub results: Vec<(&'a CapturedResult, Option<Key>)>,
}

/// When a frame was.
#[derive(Clone, Copy, Debug)]
struct At {
    sim_nanos: u64,
    published: u64,
    seq: u64,
    order: usize,
}

impl<'a> Answered<'a> {
    /// Sorts the results of some topics, each with the input that they must answer.
    pub fn of(
        capture: &'a Capture,
        sent: &[SentFrame],
        inputs_by_topic: &BTreeMap<Arc<str>, String>,
        (from_nanos, to_nanos): (u64, u64),
    ) -> Answered<'a> {
        let wanted: HashSet<&str> = inputs_by_topic.values().map(String::as_str).collect();
        let mut frames: HashMap<Key, At> = HashMap::new();
        for (order, frame) in sent.iter().enumerate() {
            if wanted.contains(&*frame.topic) && frame.sim_nanos <= to_nanos {
                let key = (frame.topic.clone(), frame.epoch, frame.tick);
                frames.entry(key).or_insert(At {
                    sim_nanos: frame.sim_nanos,
                    published: frame.published_mono_nanos,
                    seq: frame.seq,
                    order,
                });
            }
        }
        let epochs: HashSet<u64> = sent.iter().map(|frame| frame.epoch).collect();
        let only = (epochs.len() == 1).then(|| epochs.iter().next().copied().unwrap_or(0));
        let of_task = capture.results.iter().filter_map(|result| {
            let input = inputs_by_topic.get(&result.topic)?;
            let own = result
                .inputs
                .iter()
                .filter(|record| record.topic() == **input)
                .max_by_key(|record| record.tick);
            let (epoch, tick) = match own {
                Some(record) => (record.epoch, record.tick),
                None => (result.header.epoch, result.header.tick),
            };
            let key = (Arc::from(input.as_str()), only.unwrap_or(epoch), tick);
            let sent = frames.get(&key);
            let sent = sent.filter(|at| at.published == 0 || published(result) >= at.published);
            Some((result, sent.is_some().then_some(key)))
        });
        let results = of_task.collect();
        Answered {
            capture,
            from_nanos,
            frames,
            results,
        }
    }

    fn counts(&self, at: &At) -> bool {
        at.sim_nanos >= self.from_nanos
    }

    /// Results for frames of the measured part with their frames.
    fn measured(&self) -> impl Iterator<Item = (&'a CapturedResult, &Key, At)> {
        self.results.iter().filter_map(|(result, key)| {
            let key = key.as_ref()?;
            let at = *self.frames.get(key)?;
            self.counts(&at).then_some((*result, key, at))
        })
    }

    /// The four latencies.
    pub fn latency(&self) -> Latency {
        let span = |from: u64, to: u64| (from > 0 && to > 0).then(|| to.saturating_sub(from));
        let spread = |of: &dyn Fn(&CapturedResult, At) -> Option<u64>| {
            Spread::of(self.measured().filter_map(|(result, _, at)| of(result, at)))
        };
        Latency {
            end_to_end: spread(&|result, at| {
                let origin = match result.header.origin_mono_nanos {
                    0 => at.published,
                    origin => origin,
                };
                span(origin, published(result))
            }),
            answer: spread(&|result, at| span(at.published, published(result))),
            work: spread(&|result, _| span(result.header.taken_mono_nanos, published(result))),
            age_at_use: spread(&|result, at| span(at.published, result.header.taken_mono_nanos)),
        }
    }

    /// What became of frames and results; the three counts of queries are not known here.
    pub fn tally(&self, n_unreadable: u64) -> Counts {
        let counted = self.frames.values().filter(|at| self.counts(at));
        let mut counts = Counts {
            n_frames: counted.count() as u64,
            n_unreadable,
            n_lost: self.capture.n_lost,
            ..Counts::default()
        };
        // By topic of results: a program may answer a frame once on each.
        let mut seen: HashSet<(&str, &Key)> = HashSet::new();
        let mut newest: HashMap<&str, usize> = HashMap::new();
        for (result, key) in &self.results {
            let topic = &*result.topic;
            let Some(key) = key else {
                counts.n_results += 1;
                counts.n_invented += 1;
                continue;
            };
            let at = self.frames[key];
            let before = newest.get(topic).copied();
            newest.insert(
                topic,
                before.map_or(at.order, |before| before.max(at.order)),
            );
            let is_new = seen.insert((topic, key));
            if !self.counts(&at) {
                continue;
            }
            counts.n_results += 1;
            counts.n_repeated += u64::from(!is_new);
            counts.n_out_of_order += u64::from(before.is_some_and(|before| at.order < before));
        }
        let answered: HashSet<&Key> = seen.iter().map(|(_, key)| *key).collect();
        let answered = answered
            .into_iter()
            .filter(|key| self.counts(&self.frames[*key]));
        counts.n_answered = answered.count() as u64;
        counts
    }

    /// Rates and jitter by the wall clock.
    pub fn throughput(&self) -> Throughput {
        let mut frames: Vec<(&Key, At)> = self
            .frames
            .iter()
            .filter(|(_, at)| self.counts(at))
            .map(|(key, at)| (key, *at))
            .collect();
        frames.sort_by_key(|(_, at)| at.order);
        let sent: Vec<(u64, u64)> = frames
            .iter()
            .map(|(_, at)| (at.order as u64, at.published))
            .collect();
        let published: Vec<(u64, u64)> = self
            .measured()
            .map(|(result, _, at)| (at.order as u64, published(result)))
            .collect();
        Throughput::of(&sent, &published)
    }

    /// Results on the time line, in simulated seconds since `zero_nanos`: every n-th if there are
    /// more than `most`.
    pub fn events(&self, zero_nanos: u64, most: usize) -> Vec<ResultEvent> {
        let all: Vec<_> = self.measured().collect();
        let step = all.len().div_ceil(most.max(1)).max(1);
        let secs = |nanos: f64| (nanos - zero_nanos as f64) / 1e9;
        let events = all.iter().step_by(step).filter_map(|(result, _, at)| {
            let clock = &self.capture.clock;
            let taken = match result.header.taken_mono_nanos {
                0 => at.published,
                taken => taken,
            };
            Some(ResultEvent {
                topic: result.topic.to_string(),
                frame_secs: secs(at.sim_nanos as f64),
                taken_secs: secs(clock.sim_at(taken)?),
                published_secs: secs(clock.sim_at(published(result))?),
                seq: at.seq,
            })
        });
        events.collect()
    }

    /// Simulated seconds since `zero_nanos` of every frame of the measured part, at most `most`.
    pub fn frame_secs(&self, zero_nanos: u64, most: usize) -> Vec<f64> {
        let counted = self.frames.values().filter(|at| self.counts(at));
        let mut secs: Vec<f64> = counted
            .map(|at| (at.sim_nanos as f64 - zero_nanos as f64) / 1e9)
            .collect();
        secs.sort_by(f64::total_cmp);
        let step = secs.len().div_ceil(most.max(1)).max(1);
        secs.into_iter().step_by(step).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::{Body, Clock, Mode, SentFrame};
    use schema_frames::{InputRecord, ResultHeader, ResultType};

    const MS: u64 = 1_000_000;
    const ZERO: u64 = 9_000 * MS;

    /// Frames every 100 ms from tick 1 on; results as `(tick, taken, published)` in ms.
    fn capture(n_frames: u64, results: &[(u64, u64, u64)]) -> Capture {
        let mut clock = Clock::default();
        clock.push(0, ZERO);
        // Half the pace of the wall clock.
        clock.push(1000 * MS, ZERO + 2000 * MS);
        Capture {
            program: "p".into(),
            scenario: "s".into(),
            mode: Mode::Streaming,
            speed: 0.5,
            added_delay_nanos: 0,
            clock,
            results: results
                .iter()
                .map(|(tick, taken, published)| {
                    let mut header = ResultHeader::new(ResultType::Text);
                    header.tick = *tick;
                    header.taken_mono_nanos = ZERO + taken * MS;
                    header.published_mono_nanos = ZERO + published * MS;
                    header.origin_mono_nanos = ZERO + (tick - 1) * 200 * MS - MS;
                    let mut input = InputRecord::new("a/rgb");
                    input.tick = *tick;
                    CapturedResult {
                        topic: "out".into(),
                        header,
                        body: Body::Dropped,
                        inputs: vec![input],
                        held_mono_nanos: ZERO + published * MS,
                    }
                })
                .collect(),
            abouts: Default::default(),
            frames: (0..n_frames)
                .map(|n| SentFrame {
                    topic: "a/rgb".into(),
                    tick: n + 1,
                    seq: n + 1,
                    epoch: 0,
                    sim_nanos: n * 100 * MS,
                    published_mono_nanos: ZERO + n * 200 * MS,
                })
                .collect(),
            n_lost: 3,
            n_refused: 0,
            usage: Vec::new(),
            faults: Vec::new(),
            has_crashed: false,
            drive_recording: None,
        }
    }

    fn inputs() -> BTreeMap<Arc<str>, String> {
        [(Arc::from("out"), "a/rgb".to_owned())].into()
    }

    #[test]
    fn latencies_are_spans_of_the_wall_clock() {
        let capture = capture(3, &[(2, 210, 250), (3, 430, 480)]);
        let answered = Answered::of(&capture, &capture.frames, &inputs(), (0, u64::MAX));
        let latency = answered.latency();
        for (spread, mean) in [
            (&latency.answer, (50.0 + 80.0) / 2.0),
            (&latency.end_to_end, (51.0 + 81.0) / 2.0),
            (&latency.work, (40.0 + 50.0) / 2.0),
            (&latency.age_at_use, (10.0 + 30.0) / 2.0),
        ] {
            assert_eq!(spread.n, 2);
            assert!(
                (spread.mean / mean - 1.0).abs() < 2e-3,
                "{} {mean}",
                spread.mean
            );
        }
        let events = answered.events(0, 100);
        assert_eq!(events.len(), 2);
        assert!((events[0].frame_secs - 0.1).abs() < 1e-9);
        assert!((events[0].taken_secs - 0.105).abs() < 1e-9);
        assert!((events[0].published_secs - 0.125).abs() < 1e-9);
        assert_eq!(answered.events(0, 1).len(), 1);
        assert_eq!(answered.frame_secs(0, 10), [0.0, 0.1, 0.2]);
    }

    #[test]
    fn what_misbehaves_is_counted_as_what_it_is() {
        // Frame 1 belongs to the warm-up. Frame 2 is answered, 4 before 3, 4 again, 9 was never sent,
        // and 6 is answered before it was sent.
        let all = [
            (1, 10, 20),
            (2, 210, 250),
            (4, 610, 620),
            (3, 630, 640),
            (4, 650, 660),
            (9, 700, 710),
            (6, 720, 730),
        ];
        let capture = capture(6, &all);
        let answered = Answered::of(&capture, &capture.frames, &inputs(), (50 * MS, u64::MAX));
        assert_eq!(
            answered.tally(4),
            Counts {
                n_frames: 5,
                n_answered: 3,
                n_results: 6,
                n_unreadable: 4,
                n_repeated: 1,
                n_out_of_order: 1,
                n_invented: 2,
                n_lost: 3,
                ..Counts::default()
            }
        );
        assert_eq!(answered.latency().answer.n, 4);
    }
}
