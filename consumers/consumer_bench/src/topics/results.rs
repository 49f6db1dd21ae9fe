//! Results of users' programs: how often they come, how old they are, and how long after what they
//! answer.

use consumer_report::numbers::micros;
use schema_bus::{Bus, BusError, ResultReader, ResultSample, TopicDetails, mono_now};
use schema_types::MonoTime;
use serde::Serialize;

use super::rate::{MAX_A_TURN, per_sec};
use crate::output;
use consumer_report::{Summary, Times};

/// One topic of results.
#[derive(Debug, Serialize)]
pub(super) struct ResultRow {
    topic: String,
    #[serde(rename = "type")]
    kind: &'static str,
    rate_hz: f64,
    mebibytes_per_sec: f64,
    n: u64,
    pub(super) lost: u64,
    pub(super) refused: u64,
    /// Published → held by this process.
    age: Summary,
    /// Its first input published → it published.
    answering: Summary,
    /// The oldest frame behind it published → it held by this process.
    since_frame: Summary,
}

/// A reader of one topic of results.
pub(super) struct ResultWatch {
    reader: ResultReader,
    age: Times,
    answering: Times,
    since_frame: Times,
    n_bytes: u64,
    /// Publishing times of the first and the newest result.
    span: Option<(MonoTime, MonoTime)>,
}

impl ResultWatch {
    pub(super) fn open(bus: &Bus, topic: &TopicDetails) -> Result<Self, BusError> {
        Ok(ResultWatch {
            reader: bus.result_reader(&topic.name)?,
            age: Times::default(),
            answering: Times::default(),
            since_frame: Times::default(),
            n_bytes: 0,
            span: None,
        })
    }

    /// Its topic without the domain.
    pub(super) fn topic(&self) -> &str {
        self.reader.topic()
    }

    pub(super) fn drain(&mut self) -> Result<(), BusError> {
        // A flood of one topic must not keep the others from their turn.
        for _ in 0..MAX_A_TURN {
            match self.reader.next() {
                Ok(Some(result)) => self.note(&result, mono_now()),
                Ok(None) => return Ok(()),
                // The reader counts it; the next result may be good.
                Err(BusError::BadResult { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    fn note(&mut self, result: &ResultSample, held: MonoTime) {
        let header = result.header();
        let published = MonoTime(header.published_mono_nanos);
        self.age.record(held.nanos_since(published));
        let input = result.inputs().first();
        if let Some(input) = input.filter(|input| input.published_mono_nanos != 0) {
            let asked = MonoTime(input.published_mono_nanos);
            self.answering.record(published.nanos_since(asked));
        }
        if header.origin_mono_nanos != 0 {
            let origin = MonoTime(header.origin_mono_nanos);
            self.since_frame.record(held.nanos_since(origin));
        }
        self.n_bytes += result.len() as u64;
        self.span = Some((self.span.map_or(published, |(first, _)| first), published));
    }

    pub(super) fn row(&self) -> ResultRow {
        let (counts, age) = (self.reader.counts(), self.age.summary());
        let secs = self
            .span
            .map_or(0.0, |(first, last)| last.nanos_since(first) as f64 * 1e-9);
        let rate_hz = per_sec(age.n, secs);
        let mean_bytes = self.n_bytes as f64 / age.n.max(1) as f64;
        ResultRow {
            topic: self.reader.topic().to_owned(),
            kind: self.reader.kind().name(),
            rate_hz,
            mebibytes_per_sec: rate_hz * mean_bytes / (1 << 20) as f64,
            n: age.n,
            lost: counts.lost,
            refused: counts.refused,
            age,
            answering: self.answering.summary(),
            since_frame: self.since_frame.summary(),
        }
    }
}

pub(super) fn results_text(rows: &[ResultRow]) -> String {
    let times = |of: &Summary| match of.n {
        0 => ["-".to_owned(), "-".to_owned()],
        _ => [micros(of.p50_us), micros(of.p99_us)],
    };
    let row = |row: &ResultRow| {
        let mut cells = vec![
            row.topic.clone(),
            row.kind.to_owned(),
            format!("{:.1}", row.rate_hz),
            format!("{:.2}", row.mebibytes_per_sec),
            row.n.to_string(),
            row.lost.to_string(),
            row.refused.to_string(),
        ];
        cells.extend(times(&row.age));
        cells.extend(times(&row.answering));
        cells.extend(times(&row.since_frame));
        cells
    };
    let heads = [
        "results (µs)",
        "type",
        "Hz",
        "MiB/s",
        "n",
        "lost",
        "refused",
        "age p50",
        "age p99",
        "answer p50",
        "answer p99",
        "frame p50",
        "frame p99",
    ];
    output::table(&heads, &rows.iter().map(row).collect::<Vec<_>>())
}
