//! `gantry-bench latency`: a writer in this process, readers in processes of their own, three ways
//! between them, and a memcpy for comparison.
//!
//! With `--python` the readers in shared memory are also those of the Python package, which have the
//! frame as a numpy array in hand when their clock stops.
//!
//! On every way a frame is filled before its clock starts, as by a renderer. In shared memory the
//! clock starts just before the sample is sent and stops when the reader holds the frame; the
//! reader is either woken by an event, asleep in poll(2) until then, or polls. Over TCP the clock
//! starts before the first `write_all` and stops after `read_exact`. Each reader checks the first
//! and the last byte of each frame.

pub mod reader;

use std::hint::black_box;
use std::io::Write as _;
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, ensure};
use consumer_report::numbers::micros;
use launch_cli::values::number;
use launch_cli::{Exit, Machine, bench};
use schema_bus::{Bus, FrameTopic, mono_now, qos};
use serde::Serialize;

use crate::output;
use consumer_report::{Summary, Times};
use reader::{ReaderProcess, WARM_UP, Way};

/// Smallest frame, bytes: a time stamp and a number for TCP, and a first and a last byte to check.
const LEAST_BYTES: usize = 24;

#[derive(Debug, clap::Args)]
pub struct LatencyArgs {
    /// Payload sizes in bytes; 1920000 is 800×600 BGRA, 8294400 is 1920×1080
    #[arg(long, value_name = "BYTES,…", value_delimiter = ',', default_value = "64,1920000,8294400", value_parser = size)]
    sizes: Vec<usize>,

    /// Numbers of reader processes
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "1,8", value_parser = clap::value_parser!(u16).range(1..=64))]
    readers: Vec<u16>,

    /// Frames per second
    #[arg(long, value_name = "HZ", default_value_t = 100.0, value_parser = number("rate in Hz", 0.1..=100_000.0))]
    rate: f64,

    /// Frames counted per line of the table
    #[arg(long, value_name = "N", default_value_t = 500, value_parser = clap::value_parser!(u64).range(10..=10_000_000))]
    count: u64,

    /// Also measure readers in Python, run by this interpreter, which has the package gantry
    #[arg(long, value_name = "PROGRAM")]
    python: Option<PathBuf>,

    /// Write the table as JSON too
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

fn size(text: &str) -> Result<usize, String> {
    let bytes = text
        .parse()
        .map_err(|_| format!("{text:?} is no number of bytes"))?;
    if (LEAST_BYTES..=1 << 30).contains(&bytes) {
        Ok(bytes)
    } else {
        Err(format!("a frame has {LEAST_BYTES} to {} bytes", 1 << 30))
    }
}

/// One line of the table.
#[derive(Debug, Serialize)]
struct Row {
    way: &'static str,
    size_bytes: usize,
    n_readers: usize,
    /// Frames per second that the writer reached.
    rate_hz: f64,
    /// From the writer's stamp to the reader holding the frame, over all readers.
    latency: Summary,
    /// How long sending kept the writer busy.
    sending: Summary,
    /// Frames that readers missed, all readers together.
    lost: u64,
}

#[derive(Debug, Serialize)]
struct Report {
    machine: Machine,
    rows: Vec<Row>,
}

/// Runs every combination and prints one table.
pub fn run(args: &LatencyArgs) -> anyhow::Result<Exit> {
    let machine = Machine::read();
    println!("{}", machine.heading());
    let mut rows = Vec::new();
    for size_bytes in args.sizes.iter().copied() {
        rows.push(memcpy(size_bytes, args.count));
        for n_readers in args.readers.iter().map(|n| *n as usize) {
            let rust = [Way::Event, Way::Polled, Way::Tcp].map(|way| (way, None));
            let python = args.python.as_deref();
            let python = python.map(|it| [(Way::Event, Some(it)), (Way::Polled, Some(it))]);
            // Rust and Python by turns, so that they meet the same load.
            let mut ways: Vec<_> = rust
                .into_iter()
                .chain(python.into_iter().flatten())
                .collect();
            ways.sort_by_key(|(way, _)| *way as u8);
            for (way, python) in ways {
                let case = Case {
                    way,
                    python,
                    size_bytes,
                    n_readers,
                    number: rows.len(),
                    rate_hz: args.rate,
                    count: args.count,
                };
                eprintln!(
                    "{} frames of {size_bytes} bytes to {n_readers} readers by {} …",
                    args.count,
                    case.name()
                );
                let row = case.run().with_context(|| {
                    format!(
                        "{} with {n_readers} readers of {size_bytes} bytes",
                        case.name()
                    )
                })?;
                rows.push(row);
            }
        }
    }
    let report = Report { machine, rows };
    print!("{}", text(&report.rows));
    bench::write_json(args.json.as_deref(), &report)?;
    Ok(Exit::Done)
}

/// One way, size and number of readers.
struct Case<'a> {
    way: Way,
    /// Interpreter of readers in Python.
    python: Option<&'a Path>,
    size_bytes: usize,
    n_readers: usize,
    number: usize,
    rate_hz: f64,
    count: u64,
}

impl Case<'_> {
    fn name(&self) -> &'static str {
        match (self.way, self.python) {
            (Way::Event, Some(_)) => "python-event",
            (Way::Polled, Some(_)) => "python-polled",
            (way, _) => way.name(),
        }
    }

    fn run(&self) -> anyhow::Result<Row> {
        let mut sending = Times::default();
        let (received, rate_hz) = match self.way {
            Way::Tcp => self.over_tcp(&mut sending)?,
            Way::Event | Way::Polled => self.over_shared_memory(&mut sending)?,
        };
        let lost = received.iter().map(|r| r.lost).sum();
        let latency = received
            .into_iter()
            .flat_map(|r| r.nanos)
            .collect::<Times>()
            .summary();
        ensure!(
            latency.n + lost == self.count * self.n_readers as u64,
            "{} frames arrived and {lost} were lost",
            latency.n
        );
        Ok(Row {
            way: self.name(),
            size_bytes: self.size_bytes,
            n_readers: self.n_readers,
            rate_hz,
            latency,
            sending: sending.summary(),
            lost,
        })
    }

    fn over_shared_memory(
        &self,
        sending: &mut Times,
    ) -> anyhow::Result<(Vec<reader::Received>, f64)> {
        // A domain of its own, so that this neither meets nor disturbs a running simulator.
        let domain = format!("bench-{}", std::process::id());
        let bus = Bus::open(&domain, "gantry-bench")?;
        let topic = format!("bench/c{}/semantic", self.number);
        let spec = FrameTopic {
            frames_in_flight: 1,
            max_readers: self.n_readers,
            max_payload_bytes: self.size_bytes,
            buffer: qos::FRAME.buffer,
            borrowed: qos::FRAME.borrowed,
        };
        let publisher = bus.frame_publisher(&topic, spec)?;
        publisher.touch()?;
        let notifier = bus.notifier(&topic)?;
        let readers = self.start_readers(&["--domain", &domain, "--topic", &topic])?;
        let rate_hz = self.paced(|seq| {
            let mut loan = publisher.loan(self.size_bytes)?;
            loan.payload_mut().fill(seq as u8);
            let header = loan.header_mut();
            header.set_image(self.size_bytes as u32, 1);
            (header.seq, header.tick, header.epoch) = (seq, seq, 1);
            let started = mono_now();
            loan.send()?;
            if self.way == Way::Event {
                notifier.notify();
            }
            if seq > WARM_UP {
                sending.record(mono_now().nanos_since(started));
            }
            Ok(())
        })?;
        let received = readers
            .into_iter()
            .map(ReaderProcess::finish)
            .collect::<anyhow::Result<_>>()?;
        Ok((received, rate_hz))
    }

    fn over_tcp(&self, sending: &mut Times) -> anyhow::Result<(Vec<reader::Received>, f64)> {
        let listener =
            TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).context("cannot listen on 127.0.0.1")?;
        let address = listener.local_addr()?.to_string();
        let readers = self.start_readers(&["--address", &address])?;
        // Readers report that they are ready after they have connected, so this does not wait.
        let mut streams: Vec<TcpStream> = Vec::new();
        for _ in 0..self.n_readers {
            let (stream, _) = listener.accept()?;
            stream.set_nodelay(true)?;
            streams.push(stream);
        }
        let mut frame = vec![0u8; self.size_bytes];
        let rate_hz = self.paced(|seq| {
            frame.fill(seq as u8);
            frame[8..16].copy_from_slice(&seq.to_le_bytes());
            let started = mono_now();
            frame[..8].copy_from_slice(&started.0.to_le_bytes());
            for stream in &mut streams {
                stream.write_all(&frame).context("a reader hung up")?;
            }
            if seq > WARM_UP {
                sending.record(mono_now().nanos_since(started));
            }
            Ok(())
        })?;
        let received = readers
            .into_iter()
            .map(ReaderProcess::finish)
            .collect::<anyhow::Result<_>>()?;
        Ok((received, rate_hz))
    }

    fn start_readers(&self, place: &[&str]) -> anyhow::Result<Vec<ReaderProcess>> {
        let (size, last) = (
            self.size_bytes.to_string(),
            (WARM_UP + self.count).to_string(),
        );
        let mut words = vec!["--way", self.way.name(), "--size", &size, "--last", &last];
        words.extend(place);
        let mut readers = (0..self.n_readers)
            .map(|_| ReaderProcess::start(self.python, &words))
            .collect::<anyhow::Result<Vec<_>>>()?;
        readers
            .iter_mut()
            .try_for_each(ReaderProcess::wait_until_ready)?;
        Ok(readers)
    }

    /// Calls `send` for warm-up and counted frames at the rate, and returns the rate reached. A
    /// late frame delays those after it.
    fn paced(&self, mut send: impl FnMut(u64) -> anyhow::Result<()>) -> anyhow::Result<f64> {
        let period = Duration::from_secs_f64(1.0 / self.rate_hz);
        let (mut next, started) = (Instant::now(), Instant::now());
        for seq in 1..=WARM_UP + self.count {
            std::thread::sleep(next.saturating_duration_since(Instant::now()));
            next = next.max(Instant::now() - period) + period;
            send(seq)?;
        }
        Ok((WARM_UP + self.count) as f64 / started.elapsed().as_secs_f64())
    }
}

/// Times one copy of a freshly filled frame in this process.
fn memcpy(size_bytes: usize, count: u64) -> Row {
    let (mut source, mut target) = (vec![0u8; size_bytes], vec![0u8; size_bytes]);
    let mut spread = Times::default();
    for seq in 0..count {
        source.fill(seq as u8);
        let started = mono_now();
        black_box(&mut target).copy_from_slice(black_box(&source));
        spread.record(mono_now().nanos_since(started));
    }
    let latency = spread.summary();
    Row {
        way: "memcpy",
        size_bytes,
        n_readers: 0,
        rate_hz: 0.0,
        latency,
        sending: latency,
        lost: 0,
    }
}

fn text(rows: &[Row]) -> String {
    let row = |row: &Row| {
        vec![
            row.way.to_owned(),
            row.size_bytes.to_string(),
            row.n_readers.to_string(),
            format!("{:.0}", row.rate_hz),
            micros(row.latency.p50_us),
            micros(row.latency.p99_us),
            micros(row.latency.p999_us),
            micros(row.latency.max_us),
            micros(row.sending.p50_us),
            row.latency.n.to_string(),
            row.lost.to_string(),
        ]
    };
    let heads = [
        "way (µs)",
        "bytes",
        "readers",
        "Hz",
        "p50",
        "p99",
        "p99.9",
        "max",
        "send p50",
        "n",
        "lost",
    ];
    output::table(&heads, &rows.iter().map(row).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_outside_the_allowed_are_refused() {
        assert!(size("64").is_ok() && size("23").is_err() && size("x").is_err());
    }

    #[test]
    fn a_memcpy_is_timed_once_per_frame() {
        let row = memcpy(4096, 50);
        assert_eq!((row.latency.n, row.lost), (50, 0));
        assert!(text(&[row]).contains("memcpy"));
    }
}
