//! What all tasks have in common: results against the frames that they answer, queries against the
//! newest result, at every added delay, by strata, scenario by scenario.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::Arc;

use schema_frames::{About, ResultType};

use super::{AnyTask, Context, Drawn, Measure, Plan, Reading, Scored, Spec, Tally, Worst};
use crate::capture::{Capture, Mode};
use crate::evidence::moment::Moment;
use crate::evidence::queries::Answers;
use crate::report::{CurvePoint, Stratum, TaskScore};

/// Strata of whole moments: light and the carrier's speed, m/s.
const MOMENT_STRATA: [(&str, &str); 6] = [
    ("light", "day"),
    ("light", "night"),
    ("speed_mps", "0-1"),
    ("speed_mps", "1-5"),
    ("speed_mps", "5-10"),
    ("speed_mps", "10-"),
];

/// Whether a moment lies in a stratum of [`MOMENT_STRATA`].
fn in_stratum(moment: &Moment<'_>, stratum: usize) -> bool {
    match stratum {
        0 => !moment.is_night,
        1 => moment.is_night,
        at => moment.ego().is_some_and(|ego| {
            let speed = ego.velocity_mps.norm();
            let limits = [0.0, 1.0, 5.0, 10.0, f64::INFINITY];
            (limits[at - 2]..limits[at - 1]).contains(&speed)
        }),
    }
}

/// Most queries of one scenario that go into the curve's other points and into strata; of more, every
/// n-th does.
pub const MAX_CURVE_QUERIES: u64 = 3000;

/// Decoded results that are held for later queries.
const MAX_HELD: usize = 64;

/// Totals of all that is said about a task.
struct Totals<M: Measure> {
    offline: M::Total,
    /// By added delay, the first is none.
    streaming: Vec<M::Total>,
    /// By stratum: offline, streaming.
    strata: Vec<[M::Total; 2]>,
}

impl<M: Measure> Totals<M> {
    fn new(measure: &M, n_delays: usize) -> Self {
        let n_strata = MOMENT_STRATA.len() + measure.strata().len();
        Totals {
            offline: measure.empty(),
            streaming: (0..n_delays).map(|_| measure.empty()).collect(),
            strata: (0..n_strata)
                .map(|_| [measure.empty(), measure.empty()])
                .collect(),
        }
    }

    fn take_in(&mut self, other: &Totals<M>) {
        self.offline.take_in(&other.offline);
        let streaming = self.streaming.iter_mut().zip(&other.streaming);
        let strata = self.strata.iter_mut().zip(&other.strata);
        let strata = strata.flat_map(|(own, other)| own.iter_mut().zip(other));
        streaming
            .chain(strata)
            .for_each(|(own, other)| own.take_in(other));
    }

    fn add_strata(&mut self, measure: &M, moment: &Moment<'_>, part: &M::Part, which: usize) {
        for stratum in 0..self.strata.len() {
            let total = &mut self.strata[stratum][which];
            match stratum.checked_sub(MOMENT_STRATA.len()) {
                None if in_stratum(moment, stratum) => measure.add(total, part),
                None => {}
                Some(own) => measure.add_stratum(total, part, own),
            }
        }
    }
}

/// [`AnyTask`] of a measure.
pub struct TaskRun<M: Measure> {
    spec: Spec,
    mode: Mode,
    plan: Plan,
    measure: M,
    all: Totals<M>,
    now: Totals<M>,
    answers: Answers,
    held: HashMap<usize, Option<Arc<M::Estimate>>>,
    scored: Scored,
    /// Every n-th query goes into curve and strata.
    stride: u64,
    n_asked: u64,
    /// Whether any moment of the scenario had a truth.
    has_truth: bool,
}

impl<M: Measure> TaskRun<M> {
    /// Nothing is scored yet.
    pub fn new(spec: Spec, mode: Mode, plan: Plan, measure: M) -> Self {
        let n_delays = plan.delays_nanos.len();
        TaskRun {
            all: Totals::new(&measure, n_delays),
            now: Totals::new(&measure, n_delays),
            spec,
            mode,
            plan,
            measure,
            answers: Answers::default(),
            held: HashMap::new(),
            scored: Scored::default(),
            stride: 1,
            n_asked: 0,
            has_truth: false,
        }
    }

    /// A result, decoded; `None` if it cannot be read.
    fn estimate(&mut self, capture: &Capture, index: usize) -> Option<Arc<M::Estimate>> {
        if let Some(held) = self.held.get(&index) {
            return held.clone();
        }
        let result = &capture.results[index];
        let usual = About::default();
        let bytes = result.body.bytes();
        let (bytes, failed) = match bytes {
            Ok(bytes) => (bytes, None),
            Err(error) => (Arc::default(), Some(format!("was not kept: {error}"))),
        };
        let reading = Reading {
            result,
            body: &bytes,
            about: capture.abouts.get(&result.topic).unwrap_or(&usual),
        };
        let kinds = self.spec.kind.result_types();
        let read = match result.header.kind() {
            _ if failed.is_some() => Err(failed.unwrap_or_default().into()),
            Some(kind) if kinds.contains(&kind) => self.measure.read(&reading),
            kind => Err(format!(
                "is of type {}, but {} needs {}",
                kind.map_or("unknown", ResultType::name),
                self.spec.kind.name(),
                kinds
                    .iter()
                    .map(|kind| kind.name())
                    .collect::<Vec<_>>()
                    .join(" or ")
            )
            .into()),
        };
        let estimate = match read {
            Ok(estimate) => Some(Arc::new(estimate)),
            Err(sentence) => {
                self.scored.n_unreadable += 1;
                let topic = &result.topic;
                let seq = result.header.seq;
                self.scored
                    .first_fault
                    .get_or_insert_with(|| format!("result {seq} of {topic} {sentence}"));
                None
            }
        };
        self.held.insert(index, estimate.clone());
        estimate
    }

    fn note_worst(&mut self, moment: &Moment<'_>, part: &M::Part, result: Option<usize>) {
        let Some(bad) = self.measure.bad(part).filter(|bad| bad.badness > 0.0) else {
            return;
        };
        let worst = &mut self.scored.worst;
        // Neighbours in time are the same failure: one of them stands for all within a second.
        let near = |other: &Worst| other.sim_nanos.abs_diff(moment.sim_nanos()) < 1_000_000_000;
        let own = Worst {
            bad,
            tick: moment.set.tick,
            sim_nanos: moment.sim_nanos(),
            result,
        };
        match worst.iter_mut().find(|other| near(other)) {
            Some(other) if other.bad.badness >= own.bad.badness => return,
            Some(other) => *other = own,
            None => worst.push(own),
        }
        worst.sort_by(|a, b| b.bad.badness.total_cmp(&a.bad.badness));
        worst.truncate(self.plan.n_worst);
    }

    fn offline(&mut self, moment: &Moment<'_>, capture: &Capture) {
        let Some(frame) = self.answers.frame_at(moment.set.tick) else {
            return;
        };
        let answer = self.answers.last_to.get(&frame);
        let result = answer.map(|at| self.answers.answers[*at].result);
        let lockstep = self.mode == Mode::Offline;
        if !self.answers.frames[frame].counts || (result.is_none() && !lockstep) {
            return;
        }
        let estimate = result.and_then(|index| self.estimate(capture, index));
        let Some(part) = self.measure.part(moment, estimate.as_deref()) else {
            return;
        };
        self.has_truth = true;
        self.measure.add(&mut self.now.offline, &part);
        self.now.add_strata(&self.measure, moment, &part, 0);
        if lockstep {
            self.note_worst(moment, &part, result);
            self.measure.keep(moment, &part);
        }
    }

    fn streaming(&mut self, moment: &Moment<'_>, capture: &Capture) {
        let at = moment.sim_nanos();
        let newest = |delay: &f64| self.answers.newest(at, *delay);
        let newest: Vec<Option<usize>> = self.plan.delays_nanos.iter().map(newest).collect();
        let in_curve = self.n_asked.is_multiple_of(self.stride);
        let mut at_delay = 0;
        while at_delay < newest.len() {
            // Delays rise, so those with the same newest result stand together.
            let same = newest[at_delay..]
                .iter()
                .take_while(|other| **other == newest[at_delay]);
            let behind = at_delay + same.count();
            let result = newest[at_delay].map(|at| self.answers.answers[at].result);
            let estimate = result.and_then(|index| self.estimate(capture, index));
            let Some(part) = self.measure.part(moment, estimate.as_deref()) else {
                return;
            };
            if at_delay == 0 {
                self.has_truth = true;
                self.n_asked += 1;
                self.scored.association.add(&self.answers, at, newest[0]);
                self.measure.add(&mut self.now.streaming[0], &part);
                if in_curve {
                    self.now.add_strata(&self.measure, moment, &part, 1);
                }
                if self.answers.frame_at(moment.set.tick).is_some() {
                    self.note_worst(moment, &part, result);
                    self.measure.keep(moment, &part);
                }
            }
            if !in_curve {
                return;
            }
            for total in &mut self.now.streaming[at_delay.max(1)..behind.max(1)] {
                self.measure.add(total, &part);
            }
            at_delay = behind;
        }
    }

    fn score(&self, totals: &Totals<M>) -> TaskScore {
        let measure = &self.measure;
        let headline = measure.headline();
        let value = |total: &M::Total| total.named().get(headline.metric).copied();
        let timed = self.mode == Mode::Streaming;
        let mut curve = Vec::new();
        if timed {
            for (delay, total) in self.plan.delays_nanos.iter().zip(&totals.streaming) {
                curve.extend(value(total).map(|value| CurvePoint {
                    delay_ms: delay / 1e6,
                    value,
                }));
            }
        }
        let names = MOMENT_STRATA.into_iter().chain(measure.strata());
        let strata = names
            .zip(&totals.strata)
            .map(|((by, part), [offline, streaming])| {
                let (n, _) = if timed { streaming } else { offline }.counts();
                let exists = |total: &M::Total| value(total).filter(|_| total.counts().0 > 0);
                Stratum {
                    by: by.into(),
                    part: part.into(),
                    n,
                    offline: exists(offline),
                    streaming: exists(streaming).filter(|_| timed),
                }
            });
        let strata = strata.filter(|stratum| stratum.n > 0).collect();
        let scored = if timed {
            &totals.streaming[0]
        } else {
            &totals.offline
        };
        let (n_scored, n_ignored) = scored.counts();
        TaskScore {
            task: self.spec.name.clone(),
            topic: self.spec.topic.clone(),
            headline: headline.metric.into(),
            unit: headline.unit.into(),
            higher_is_better: headline.higher_is_better,
            offline: totals.offline.named(),
            streaming: match timed {
                true => totals.streaming[0].named(),
                false => BTreeMap::new(),
            },
            curve,
            strata,
            n_scored,
            n_ignored,
        }
    }
}

impl<M: Measure> AnyTask for TaskRun<M> {
    fn begin(
        &mut self,
        context: &Context<'_>,
        answers: Answers,
        n_queries: u64,
    ) -> anyhow::Result<()> {
        self.answers = answers;
        self.now = Totals::new(&self.measure, self.plan.delays_nanos.len());
        self.held.clear();
        self.scored = Scored::default();
        self.stride = n_queries.div_ceil(MAX_CURVE_QUERIES).max(1);
        self.n_asked = 0;
        self.has_truth = false;
        self.measure.begin(context)
    }

    fn tick(&mut self, moment: &Moment<'_>, capture: &Capture, measured: bool) {
        self.measure.watch(moment);
        if !measured {
            return;
        }
        self.offline(moment, capture);
        if self.mode == Mode::Streaming {
            self.streaming(moment, capture);
        }
        if self.held.len() > MAX_HELD {
            let slowest = self.plan.delays_nanos.last().copied().unwrap_or(0.0);
            let oldest = self.answers.newest(moment.sim_nanos(), slowest);
            let still: HashSet<usize> = self.answers.answers[oldest.unwrap_or(0)..]
                .iter()
                .map(|answer| answer.result)
                .collect();
            self.held.retain(|index, _| still.contains(index));
            if self.held.len() > 4 * MAX_HELD {
                self.held.clear();
            }
        }
    }

    fn end(&mut self, _: &Capture) -> anyhow::Result<Scored> {
        self.held.clear();
        let mut scored = std::mem::take(&mut self.scored);
        if !self.has_truth && self.answers.n_frames() > 0 {
            let (name, sensor) = (&self.spec.name, &self.spec.truth);
            scored.first_fault.get_or_insert(format!(
                "the task {name} could not be scored: the recording holds no truth of it ({sensor})"
            ));
        }
        scored.score = self.score(&self.now);
        self.all.take_in(&self.now);
        Ok(scored)
    }

    fn total(&self) -> TaskScore {
        self.score(&self.all)
    }

    fn answers(&self) -> &Answers {
        &self.answers
    }

    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn draw(
        &mut self,
        truth: &mut crate::picture::Picture,
        result: &mut crate::picture::Picture,
        moment: &Moment<'_>,
        capture: &Capture,
        index: Option<usize>,
    ) {
        self.measure.draw(truth, moment, Drawn::Truth);
        if let Some(estimate) = index.and_then(|index| self.estimate(capture, index)) {
            self.measure.draw(result, moment, Drawn::Result(&estimate));
        }
    }

    fn coco(&mut self) -> Option<crate::evidence::coco_keep::Kept> {
        self.measure.coco()
    }
}
