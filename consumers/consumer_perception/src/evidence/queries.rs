//! Which frame a result answers, and which result is the newest at a query.
//!
//! The rule is that of Li, Wang, Ramanan, "Towards Streaming Perception" (ECCV 2020), as the authors'
//! toolkit carries it out:
//!
//! - A **query** at time t compares the truth of t with the **newest** result: of those that are
//!   available at t, the one that became available last. Which frame it answers plays no part, so a
//!   late answer to an old frame replaces an earlier answer to a newer one.
//! - A result is **available** from the moment of its publication on, in simulated time. With a delay
//!   of d added, from d later on.
//! - **miss** counts queries at which nothing is available yet; they are scored as if the program had
//!   found nothing.
//! - **in_time** counts queries whose newest result answers the newest frame of that moment; with
//!   queries at the frames' times that is the toolkit's "frame ii is answered at ii".
//! - **mismatch** is the sum, over queries that are no misses, of how many frames the answered one
//!   lies behind the newest one.
//!
//! What the toolkit cannot meet, because its frames come from a list: a result that answers a frame
//! that was never sent, or was not sent yet, is *invented*; it is counted and never paired.
//! Results for frames of the warm-up are paired, so that a scenario does not begin with misses, but
//! counted nowhere else.

use std::collections::HashMap;

use crate::capture::{Capture, CapturedResult, SentFrame};

/// A frame of the input, as far as pairing goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Its tick.
    pub tick: u64,
    /// Its simulated time, nanoseconds.
    pub sim_nanos: u64,
    /// When it was published, nanoseconds of the monotonic clock; 0 if not known.
    pub published_mono_nanos: u64,
    /// Whether it belongs to the measured part.
    pub counts: bool,
}

/// A result of one task.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer {
    /// Index in [`Capture::results`].
    pub result: usize,
    /// Index in [`Answers::frames`].
    pub frame: usize,
    /// From when on it can be used, simulated nanoseconds.
    pub available_nanos: f64,
}

/// What a program answered at one task.
#[derive(Clone, Debug, Default)]
pub struct Answers {
    /// Frames of the input, by time.
    pub frames: Vec<Frame>,
    /// Results in the order in which they became available.
    pub answers: Vec<Answer>,
    /// By frame the last answer to it, as an index in `answers`.
    pub last_to: HashMap<usize, usize>,
    /// Results for frames of the measured part.
    pub n_results: u64,
    /// Frames of the measured part with an answer.
    pub n_answered: u64,
    /// Results for frames that had one already.
    pub n_repeated: u64,
    /// Results for a frame older than one that was answered before.
    pub n_out_of_order: u64,
    /// Results that answer frames that were never sent, or not yet.
    pub n_invented: u64,
}

/// When a result was published, nanoseconds of the monotonic clock: its writer's word, unless that
/// is missing or later than the benchmark held it.
pub fn published(result: &CapturedResult) -> u64 {
    match result.header.published_mono_nanos {
        0 => result.held_mono_nanos,
        said if result.held_mono_nanos > 0 => said.min(result.held_mono_nanos),
        said => said,
    }
}

/// The tick of the frame of topic `input` that a result answers: named among its inputs, or through
/// a chain the tick that it is about.
fn answered_tick(result: &CapturedResult, input: &str) -> u64 {
    let of_input = |record: &&schema_frames::InputRecord| record.topic() == input;
    let newest = result.inputs.iter().filter(of_input);
    newest
        .map(|record| record.tick)
        .max()
        .unwrap_or(result.header.tick)
}

impl Answers {
    /// Sorts the results of topic `topic` that answer those of `frames` that are of topic `input`;
    /// frames before `from_nanos` do not count. `extra_nanos` are added to each publication, on the
    /// wall clock.
    pub fn of(
        capture: &Capture,
        frames: &[SentFrame],
        topic: &str,
        input: &str,
        (from_nanos, to_nanos): (u64, u64),
        extra_nanos: u64,
    ) -> Answers {
        let counts = |sim_nanos: u64| (from_nanos..=to_nanos).contains(&sim_nanos);
        let frames = frames.iter().filter(|frame| *frame.topic == *input);
        let mut frames: Vec<Frame> = frames
            .map(|frame| Frame {
                tick: frame.tick,
                sim_nanos: frame.sim_nanos,
                published_mono_nanos: frame.published_mono_nanos,
                counts: counts(frame.sim_nanos),
            })
            .collect();
        frames.sort_by_key(|frame| (frame.sim_nanos, frame.tick));
        frames.dedup_by_key(|frame| frame.tick);
        let by_tick: HashMap<u64, usize> = frames
            .iter()
            .enumerate()
            .map(|(at, frame)| (frame.tick, at))
            .collect();
        let mut found = Answers {
            frames,
            ..Answers::default()
        };
        let own = capture.results.iter().enumerate();
        for (index, result) in own.filter(|(_, result)| *result.topic == *topic) {
            let published = published(result);
            let frame = by_tick.get(&answered_tick(result, input));
            let frame = frame.filter(|frame| {
                let sent = found.frames[**frame].published_mono_nanos;
                sent == 0 || published == 0 || published >= sent
            });
            let Some(&frame) = frame else {
                found.n_invented += 1;
                continue;
            };
            // In lockstep time stands still while a program works, so only the order counts.
            let available = capture.clock.sim_at(published + extra_nanos);
            found.answers.push(Answer {
                result: index,
                frame,
                available_nanos: available.unwrap_or(found.frames[frame].sim_nanos as f64),
            });
        }
        found
            .answers
            .sort_by(|a, b| a.available_nanos.total_cmp(&b.available_nanos));
        found.count();
        found
    }

    fn count(&mut self) {
        let mut newest: Option<usize> = None;
        for (at, answer) in self.answers.iter().enumerate() {
            let before = self.last_to.insert(answer.frame, at);
            if !self.frames[answer.frame].counts {
                newest = newest.max(Some(answer.frame));
                continue;
            }
            self.n_results += 1;
            self.n_answered += u64::from(before.is_none());
            self.n_repeated += u64::from(before.is_some());
            self.n_out_of_order += u64::from(newest.is_some_and(|newest| answer.frame < newest));
            newest = newest.max(Some(answer.frame));
        }
    }

    /// Frames of the measured part.
    pub fn n_frames(&self) -> u64 {
        self.frames.iter().filter(|frame| frame.counts).count() as u64
    }

    /// The frame of a tick, as an index.
    pub fn frame_at(&self, tick: u64) -> Option<usize> {
        let at = self.frames.partition_point(|frame| frame.tick < tick);
        self.frames
            .get(at)
            .filter(|frame| frame.tick == tick)
            .map(|_| at)
    }

    /// The newest result at a simulated time with `delay_nanos` added to every availability, as an
    /// index in `answers`.
    pub fn newest(&self, at_nanos: u64, delay_nanos: f64) -> Option<usize> {
        let until = at_nanos as f64;
        let n = self
            .answers
            .partition_point(|answer| answer.available_nanos + delay_nanos <= until);
        n.checked_sub(1)
    }

    /// The newest frame at a simulated time, as an index.
    pub fn newest_frame(&self, at_nanos: u64) -> Option<usize> {
        let n = self
            .frames
            .partition_point(|frame| frame.sim_nanos <= at_nanos);
        n.checked_sub(1)
    }
}

/// The toolkit's three counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Association {
    /// Queries in all.
    pub n_queries: u64,
    /// Queries at which there was no result yet.
    pub miss: u64,
    /// Queries whose newest result answers the newest frame.
    pub in_time: u64,
    /// Sum of the frames that the newest result lags behind.
    pub mismatch: u64,
}

impl Association {
    /// Counts a query.
    pub fn add(&mut self, answers: &Answers, at_nanos: u64, newest: Option<usize>) {
        self.n_queries += 1;
        let Some(newest) = newest else {
            self.miss += 1;
            return;
        };
        let frame = answers.answers[newest].frame;
        let now = answers.newest_frame(at_nanos).unwrap_or(frame);
        self.in_time += u64::from(now == frame);
        self.mismatch += now.saturating_sub(frame) as u64;
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use schema_frames::{InputRecord, ResultHeader, ResultType};

    use super::*;
    use crate::capture::{Body, Clock, Mode, SentFrame};

    const ZERO_MONO: u64 = 1_000_000;

    /// A capture at a simulated second per second of the wall clock.
    fn capture(frames: &[(u64, u64)], results: &[(u64, u64)]) -> Capture {
        let mut clock = Clock::default();
        clock.push(0, ZERO_MONO);
        clock.push(1000, ZERO_MONO + 1000);
        let topic: Arc<str> = "a/rgb".into();
        Capture {
            program: "p".into(),
            scenario: "s".into(),
            mode: Mode::Streaming,
            speed: 1.0,
            added_delay_nanos: 0,
            clock,
            results: results
                .iter()
                .map(|(tick, published)| {
                    let mut header = ResultHeader::new(ResultType::Text);
                    header.tick = *tick;
                    header.published_mono_nanos = ZERO_MONO + published;
                    let mut input = InputRecord::new("a/rgb");
                    input.tick = *tick;
                    CapturedResult {
                        topic: "out".into(),
                        header,
                        body: Body::Dropped,
                        inputs: vec![input],
                        held_mono_nanos: ZERO_MONO + published + 5,
                    }
                })
                .collect(),
            abouts: Default::default(),
            frames: frames
                .iter()
                .map(|(tick, at)| SentFrame {
                    topic: topic.clone(),
                    tick: *tick,
                    seq: *tick,
                    epoch: 0,
                    sim_nanos: *at,
                    published_mono_nanos: ZERO_MONO + at,
                })
                .collect(),
            n_lost: 0,
            n_refused: 0,
            usage: Vec::new(),
            faults: Vec::new(),
            has_crashed: false,
            drive_recording: None,
        }
    }

    /// What the paper's text says, by looking at everything at every query: of the results that are
    /// available the one that became available last; `None` without any.
    fn direct(
        frames: &[(u64, u64)],
        results: &[(u64, u64)],
        at: u64,
        delay: u64,
    ) -> Option<(u64, usize)> {
        let mut newest: Option<(u64, usize)> = None;
        for (index, (tick, published)) in results.iter().enumerate() {
            let frame = frames.iter().find(|(own, _)| own == tick);
            let is_sent = frame.is_some_and(|(_, sent)| published >= sent);
            if !is_sent || published + delay > at {
                continue;
            }
            if newest.is_none_or(|(before, _)| *published >= before) {
                newest = Some((*published, index));
            }
        }
        newest
    }

    #[test]
    fn pairing_is_what_looking_at_everything_finds() {
        let mut rng = fastrand::Rng::with_seed(15);
        for _ in 0..400 {
            let mut at = 0;
            let frames: Vec<(u64, u64)> = (1..=rng.u64(1..12))
                .map(|n| {
                    at += rng.u64(1..60);
                    (n * 3, at)
                })
                .collect();
            let n_results = rng.usize(0..25);
            let mut results: Vec<(u64, u64)> = (0..n_results)
                .map(|_| {
                    // Answers, late and early ones, twice, out of order, and to ticks without a
                    // frame.
                    let (tick, sent) = frames[rng.usize(..frames.len())];
                    let tick = if rng.u8(..10) == 0 { tick + 1 } else { tick };
                    (tick, (sent + rng.u64(0..300)).saturating_sub(30))
                })
                .collect();
            // The benchmark takes results in the order of their publication.
            results.sort_by_key(|(_, published)| *published);
            let from = rng.u64(0..at + 1);
            let capture = capture(&frames, &results);
            let answers = Answers::of(
                &capture,
                &capture.frames,
                "out",
                "a/rgb",
                (from, u64::MAX),
                0,
            );
            let delay = rng.u64(0..120);
            let mut counted = Association::default();
            let mut expected = Association::default();
            for at in (0..at + 300).step_by(7) {
                let found = answers.newest(at, delay as f64);
                let index = found.map(|found| answers.answers[found].result);
                let want = direct(&frames, &results, at, delay).map(|(_, index)| index);
                assert_eq!(index, want, "{frames:?} {results:?} at {at} + {delay}");
                counted.add(&answers, at, found);
                // The toolkit's counts, with the number of the newest frame as its "ii".
                expected.n_queries += 1;
                match want {
                    None => expected.miss += 1,
                    Some(index) => {
                        let of = frames
                            .iter()
                            .position(|(tick, _)| *tick == results[index].0);
                        let now = frames.iter().filter(|(_, sent)| *sent <= at).count() - 1;
                        let behind = now - of.expect("it was paired");
                        expected.in_time += u64::from(behind == 0);
                        expected.mismatch += behind as u64;
                    }
                }
            }
            assert_eq!(counted, expected);
            let is_there = |(tick, published): &&(u64, u64)| {
                let frame = frames.iter().find(|(own, _)| own == tick);
                frame.is_some_and(|(_, sent)| published >= sent)
            };
            let n_there = results.iter().filter(is_there).count();
            assert_eq!(answers.n_invented as usize, results.len() - n_there);
            let mut answered: Vec<u64> = results
                .iter()
                .filter(is_there)
                .filter(|(tick, _)| frames.iter().any(|(own, at)| own == tick && *at >= from))
                .map(|(tick, _)| *tick)
                .collect();
            assert_eq!(answers.n_results as usize, answered.len());
            answered.sort_unstable();
            answered.dedup();
            assert_eq!(answers.n_answered as usize, answered.len());
            assert_eq!(answers.n_repeated, answers.n_results - answers.n_answered);
        }
    }

    #[test]
    fn an_older_answer_that_comes_later_is_the_newest() {
        let frames = [(1, 100), (2, 200), (3, 300)];
        // The answer to frame 2 comes before the one to frame 1; frame 3 is answered twice.
        let results = [(2, 210), (1, 260), (3, 320), (3, 340)];
        let capture = capture(&frames, &results);
        let answers = Answers::of(&capture, &capture.frames, "out", "a/rgb", (0, 1000), 0);
        let at = |at: u64| answers.newest(at, 0.0).map(|n| answers.answers[n].result);
        assert_eq!(
            [205, 210, 259, 260, 319, 339, 340].map(at),
            [None, Some(0), Some(0), Some(1), Some(1), Some(2), Some(3)]
        );
        assert_eq!((answers.n_repeated, answers.n_out_of_order), (1, 1));
        assert_eq!(answers.last_to[&2], 3);
        // With a delay everything shifts by it.
        assert_eq!(answers.newest(259, 50.0), None);
        assert_eq!(answers.newest(260, 50.0), Some(0));
    }

    #[test]
    fn whoever_says_a_later_time_than_the_result_was_held_is_not_believed() {
        let mut capture = capture(&[(1, 100)], &[(1, 150)]);
        capture.results[0].header.published_mono_nanos = u64::MAX / 2;
        assert_eq!(published(&capture.results[0]), ZERO_MONO + 155);
        capture.results[0].header.published_mono_nanos = 0;
        assert_eq!(published(&capture.results[0]), ZERO_MONO + 155);
    }

    #[test]
    fn a_chain_answers_the_frame_of_its_tick() {
        let mut capture = capture(&[(1, 100), (2, 200)], &[(2, 250)]);
        capture.results[0].inputs = vec![InputRecord::new("boxes/out")];
        let answers = Answers::of(&capture, &capture.frames, "out", "a/rgb", (0, 1000), 0);
        assert_eq!(answers.answers[0].frame, 1);
    }
}
