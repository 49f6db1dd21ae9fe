//! `gantry-bench topics`: what a running simulator and users' programs deliver to a consumer, topic
//! by topic and view by view.
//!
//! It reads like any consumer: it sleeps until a topic announces a frame and then takes every frame
//! that waits. As a reader it also makes the simulator render what no other program asked for.

mod rate;
mod results;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use consumer_kit::{MAX_WAIT, WakeUps};
use consumer_report::numbers::micros;
use launch_cli::values::some_span;
use launch_cli::{Exit, Machine, Shutdown, bench};
use schema_bus::{Bus, BusError, Frame, FrameReader, TopicDetails, TopicKind, mono_now};
use schema_types::MonoTime;
use serde::Serialize;

use crate::output;
use consumer_report::{Summary, Times};
use rate::per_sec;
use results::{ResultRow, ResultWatch, results_text};

#[derive(Debug, clap::Args)]
pub struct TopicsArgs {
    /// How long
    #[arg(long = "for", value_name = "TIME", default_value = "10s", value_parser = some_span)]
    length: Duration,

    /// Only topics of frames and results whose name has this in it
    #[arg(long, value_name = "TEXT", default_value = "")]
    only: String,

    /// Write the tables as JSON too
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// One topic.
#[derive(Debug, Serialize)]
struct TopicRow {
    topic: String,
    rate_hz: f64,
    mebibytes_per_sec: f64,
    n: u64,
    lost: u64,
    refused: u64,
    /// Published → held by this process.
    age: Summary,
    /// Rendered → published.
    publishing: Summary,
    /// CPU copies of the last frame.
    cpu_copies: u32,
}

/// One sensor with all its modalities.
#[derive(Debug, Serialize)]
struct ViewRow {
    view: String,
    n_modalities: usize,
    sets_per_sec: f64,
    complete: u64,
    /// Ticks between the first and the last complete set that lack a modality.
    incomplete: u64,
}

#[derive(Debug, Serialize)]
struct Report {
    machine: Machine,
    topics: Vec<TopicRow>,
    views: Vec<ViewRow>,
    results: Vec<ResultRow>,
}

/// Reads all topics of frames and results for a while and prints their tables. Losses make the exit
/// code 3.
pub fn run(args: &TopicsArgs, domain: &str) -> anyhow::Result<Exit> {
    let (machine, shutdown) = (Machine::read(), Shutdown::install()?);
    let bus = Bus::open(domain, "gantry-bench")?;
    let topics = wanted(&bus, &args.only)?;
    let mut watches = open(&bus, &topics)?;
    let mut results = open_results(&bus, &topics)?;
    anyhow::ensure!(
        !watches.is_empty() || !results.is_empty(),
        "no topic of frames or results with a writer on domain {domain:?}; start the simulator with `gantry up`"
    );
    let mut events = WakeUps::new();
    for watch in &watches {
        let followed = watches.iter().map(|other| other.reader.topic());
        events.attach(&bus, watch.reader.topic(), followed)?;
    }
    for watch in &results {
        events.listen(&bus, watch.topic())?;
    }
    let mut views = Views::new(watches.iter().map(|watch| watch.reader.topic()));
    let end = Instant::now() + args.length;
    while Instant::now() < end && !shutdown.requested() {
        // Without an event this wakes up ten times a second, which is enough to notice the end.
        let rest = end.saturating_duration_since(Instant::now());
        events.wait(rest.min(MAX_WAIT))?;
        for watch in &mut watches {
            watch.drain(&mut views)?;
        }
        for watch in &mut results {
            watch.drain()?;
        }
    }
    let report = Report {
        machine,
        topics: watches.iter().map(Watch::row).collect(),
        views: views.rows(),
        results: results.iter().map(ResultWatch::row).collect(),
    };
    println!("{}", report.machine.heading());
    if !report.topics.is_empty() {
        println!("{}", topics_text(&report.topics));
        println!("{}", views_text(&report.views));
    }
    if !report.results.is_empty() {
        println!("{}", results_text(&report.results));
    }
    bench::write_json(args.json.as_deref(), &report)?;
    let frames = report.topics.iter().map(|topic| topic.lost + topic.refused);
    let results = report
        .results
        .iter()
        .map(|topic| topic.lost + topic.refused);
    let lost = frames.chain(results).any(|n| n > 0);
    Ok(if lost { Exit::DataLost } else { Exit::Done })
}

/// The topics that have a writer and `only` in their name.
fn wanted(bus: &Bus, only: &str) -> Result<Vec<TopicDetails>, BusError> {
    let is_wanted = |topic: &TopicDetails| topic.publishers > 0 && topic.name.contains(only);
    Ok(bus.topics()?.into_iter().filter(is_wanted).collect())
}

/// A reader on every topic of frames.
fn open(bus: &Bus, topics: &[TopicDetails]) -> Result<Vec<Watch>, BusError> {
    topics
        .iter()
        .filter(|topic| topic.kind == TopicKind::Frames)
        .map(|topic| Ok(Watch::new(bus.frame_reader(&topic.name)?)))
        .collect()
}

/// A reader on every topic of results.
fn open_results(bus: &Bus, topics: &[TopicDetails]) -> Result<Vec<ResultWatch>, BusError> {
    topics
        .iter()
        .filter(|topic| topic.result.is_some())
        .map(|topic| ResultWatch::open(bus, topic))
        .collect()
}

/// One topic being read.
struct Watch {
    reader: FrameReader,
    age: Times,
    publishing: Times,
    n_bytes: u64,
    cpu_copies: u32,
    /// Publishing times of the first and the newest frame.
    span: Option<(MonoTime, MonoTime)>,
}

impl Watch {
    fn new(reader: FrameReader) -> Self {
        Watch {
            reader,
            age: Times::default(),
            publishing: Times::default(),
            n_bytes: 0,
            cpu_copies: 0,
            span: None,
        }
    }

    fn drain(&mut self, views: &mut Views) -> Result<(), BusError> {
        loop {
            match self.reader.next() {
                Ok(Some(frame)) => self.note(&frame, mono_now(), views),
                Ok(None) => return Ok(()),
                // The reader counts it; the next frame may be good.
                Err(BusError::BadFrame { .. }) => {}
                Err(error) => return Err(error),
            }
        }
    }

    fn note(&mut self, frame: &Frame, held: MonoTime, views: &mut Views) {
        let header = frame.header();
        let published = MonoTime(header.published_mono_nanos);
        self.age.record(held.nanos_since(published));
        self.publishing
            .record(published.nanos_since(MonoTime(header.rendered_mono_nanos)));
        self.n_bytes += frame.len() as u64;
        self.cpu_copies = header.cpu_copies;
        self.span = Some((self.span.map_or(published, |(first, _)| first), published));
        views.note(self.reader.topic(), header.tick, published);
    }

    fn row(&self) -> TopicRow {
        let (counts, age) = (self.reader.counts(), self.age.summary());
        let secs = self
            .span
            .map_or(0.0, |(first, last)| last.nanos_since(first) as f64 * 1e-9);
        // n frames span n − 1 intervals.
        let rate_hz = per_sec(age.n, secs);
        TopicRow {
            topic: self.reader.topic().to_owned(),
            rate_hz,
            mebibytes_per_sec: rate_hz * self.n_bytes as f64
                / age.n.max(1) as f64
                / (1 << 20) as f64,
            n: age.n,
            lost: counts.lost,
            refused: counts.refused,
            age,
            publishing: self.publishing.summary(),
            cpu_copies: self.cpu_copies,
        }
    }
}

/// The sensor of a topic: all but the modality.
fn view_of(topic: &str) -> &str {
    topic.rsplit_once('/').map_or(topic, |(view, _)| view)
}

/// Which ticks of a view have how many modalities.
#[derive(Debug, Default)]
struct View {
    n_modalities: usize,
    /// By tick: modalities that came, and when the newest was published.
    ticks: BTreeMap<u64, (usize, MonoTime)>,
}

#[derive(Debug)]
struct Views(BTreeMap<String, View>);

impl Views {
    fn new<'a>(topics: impl Iterator<Item = &'a str>) -> Self {
        let mut views = BTreeMap::<String, View>::new();
        topics.for_each(|topic| {
            views
                .entry(view_of(topic).to_owned())
                .or_default()
                .n_modalities += 1
        });
        Views(views)
    }

    fn note(&mut self, topic: &str, tick: u64, published: MonoTime) {
        let Some(view) = self.0.get_mut(view_of(topic)) else {
            return;
        };
        let (n, newest) = view.ticks.entry(tick).or_insert((0, published));
        *n += 1;
        *newest = (*newest).max(published);
    }

    fn rows(&self) -> Vec<ViewRow> {
        let row = |(name, view): (&String, &View)| {
            let complete: Vec<_> = view
                .ticks
                .iter()
                .filter(|(_, (n, _))| *n == view.n_modalities)
                .collect();
            let (first, last) = (complete.first(), complete.last());
            let span = first
                .zip(last)
                .map(|(a, b)| (*a.0, *b.0, b.1.1.nanos_since(a.1.1) as f64 * 1e-9));
            let within = span.map_or(0, |(first, last, _)| view.ticks.range(first..=last).count());
            ViewRow {
                view: name.clone(),
                n_modalities: view.n_modalities,
                sets_per_sec: per_sec(complete.len() as u64, span.map_or(0.0, |(.., secs)| secs)),
                complete: complete.len() as u64,
                incomplete: (within - complete.len()) as u64,
            }
        };
        self.0.iter().map(row).collect()
    }
}

fn topics_text(rows: &[TopicRow]) -> String {
    let row = |row: &TopicRow| {
        vec![
            row.topic.clone(),
            format!("{:.1}", row.rate_hz),
            format!("{:.1}", row.mebibytes_per_sec),
            row.n.to_string(),
            row.lost.to_string(),
            micros(row.age.p50_us),
            micros(row.age.p99_us),
            micros(row.age.max_us),
            micros(row.publishing.p50_us),
            micros(row.publishing.p99_us),
            row.cpu_copies.to_string(),
        ]
    };
    let heads = [
        "topic (µs)",
        "Hz",
        "MiB/s",
        "n",
        "lost",
        "age p50",
        "age p99",
        "age max",
        "publish p50",
        "publish p99",
        "copies",
    ];
    output::table(&heads, &rows.iter().map(row).collect::<Vec<_>>())
}

fn views_text(rows: &[ViewRow]) -> String {
    let row = |row: &ViewRow| {
        let rate = format!("{:.1}", row.sets_per_sec);
        vec![
            row.view.clone(),
            row.n_modalities.to_string(),
            rate,
            row.complete.to_string(),
            row.incomplete.to_string(),
        ]
    };
    output::table(
        &[
            "view",
            "modalities",
            "complete sets/s",
            "complete",
            "incomplete",
        ],
        &rows.iter().map(row).collect::<Vec<_>>(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_counts_when_all_modalities_of_its_tick_are_there() {
        let topics = ["ego/front/rgb", "ego/front/depth", "ego/imu/imu"];
        let mut views = Views::new(topics.into_iter());
        for tick in 1..=5 {
            views.note("ego/front/rgb", tick, MonoTime(tick * 100_000_000));
            if tick != 1 && tick != 3 {
                views.note("ego/front/depth", tick, MonoTime(tick * 100_000_000 + 5));
            }
        }
        let rows = views.rows();
        let front = &rows[0];
        assert_eq!(
            (
                front.view.as_str(),
                front.n_modalities,
                front.complete,
                front.incomplete
            ),
            ("ego/front", 2, 3, 1)
        );
        assert!(
            (front.sets_per_sec - 2.0 / 0.3).abs() < 1e-9,
            "ticks 2 to 5 take 0.3 s"
        );
        assert_eq!((rows[1].complete, rows[1].sets_per_sec), (0, 0.0));
        assert!(views_text(&rows).contains("ego/front"));
    }
}
