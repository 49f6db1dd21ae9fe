//! `gantry-bench wakes`: what it costs a writer to wake its readers, by the rig's event or by each
//! topic's own. The writer is this process, the readers are processes of their own that sleep in
//! poll(2); all frames have 64 bytes, so that nothing but the wake-up is measured.

pub mod reader;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use consumer_report::numbers::micros;
use launch_cli::{Exit, Machine, bench};
use schema_bus::{Bus, FramePublisher, FrameTopic, Notifier, mono_now};
use schema_frames::Modality;
use serde::Serialize;

use crate::output;
use consumer_report::{Summary, Times};
use reader::WakeReader;

/// Bytes of every frame.
const FRAME_BYTES: usize = 64;
/// Ticks before counting begins.
const WARM_UP: u64 = 50;
/// Modalities of one camera, for the reader of several topics.
const VIEW: [Modality; 6] = [
    Modality::Rgb,
    Modality::Depth,
    Modality::Semantic,
    Modality::Instance,
    Modality::Flow,
    Modality::Normals,
];

#[derive(Debug, clap::Args)]
pub struct WakesArgs {
    /// Numbers of reader processes of one topic
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "0,1,2,4", value_parser = clap::value_parser!(u16).range(0..=16))]
    readers: Vec<u16>,

    /// Ticks per second
    #[arg(long, value_name = "HZ", default_value_t = 100.0)]
    rate: f64,

    /// Ticks counted per turn
    #[arg(long, value_name = "N", default_value_t = 300)]
    count: u64,

    /// Turns: every case is measured once in each
    #[arg(long, value_name = "N", default_value_t = 5)]
    turns: u32,

    /// Write the table as JSON too
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// What wakes the readers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Wake {
    /// `<rig>/tick`, after the last frame.
    Rig,
    /// Each topic's own event, right after its frame.
    OwnEach,
    /// Each topic's own event, after all frames are sent.
    OwnAll,
}

impl Wake {
    fn name(self) -> &'static str {
        match self {
            Wake::Rig => "the rig's tick",
            Wake::OwnEach => "own events, each after its frame",
            Wake::OwnAll => "own events, after all frames",
        }
    }
}

/// One line of the table.
#[derive(Debug, Serialize)]
struct Row {
    wake: &'static str,
    n_topics: usize,
    n_readers: usize,
    /// How long a tick's frames and notifications kept the writer busy.
    writing: Summary,
    /// Published → in hand, over all readers and topics.
    age: Summary,
    /// Wake-ups of a reader per tick.
    wakes_per_tick: f64,
    lost: u64,
}

#[derive(Debug, Serialize)]
struct Report {
    machine: Machine,
    /// Cost of one more sleeping subscriber of one topic for the writer, microseconds: the slope
    /// between the fewest and the most readers.
    extra_subscriber_us: Vec<Slope>,
    /// What such a subscriber costs more on its topic's own event than on the rig's.
    own_event_adds_us: f64,
    rows: Vec<Row>,
}

#[derive(Debug, Serialize)]
struct Slope {
    wake: &'static str,
    us: f64,
}

/// One case and what was measured of it so far.
struct Case {
    wake: Wake,
    n_topics: usize,
    n_readers: usize,
    writing: Times,
    age: Times,
    n_wakes: u64,
    n_ticks: u64,
    lost: u64,
}

/// Runs every case by turns and prints one table.
pub fn run(args: &WakesArgs) -> anyhow::Result<Exit> {
    let machine = Machine::read();
    println!("{}", machine.heading());
    let new = |wake, n_topics, n_readers| Case {
        wake,
        n_topics,
        n_readers,
        writing: Times::default(),
        age: Times::default(),
        n_wakes: 0,
        n_ticks: 0,
        lost: 0,
    };
    let mut cases = Vec::new();
    for n_readers in args.readers.iter().map(|n| usize::from(*n)) {
        for wake in [Wake::Rig, Wake::OwnEach] {
            cases.push(new(wake, 1, n_readers));
        }
    }
    for wake in [Wake::Rig, Wake::OwnEach, Wake::OwnAll] {
        cases.push(new(wake, VIEW.len(), 1));
    }
    for turn in 1..=args.turns {
        eprintln!("turn {turn} of {} …", args.turns);
        for (number, case) in cases.iter_mut().enumerate() {
            case.turn(args, number)?;
        }
    }
    let rows: Vec<Row> = cases.iter().map(Case::row).collect();
    let slope = |wake: Wake| Slope {
        wake: wake.name(),
        us: slope_us(&rows, wake.name()),
    };
    let slopes = [slope(Wake::Rig), slope(Wake::OwnEach)];
    let report = Report {
        machine,
        own_event_adds_us: slopes[1].us - slopes[0].us,
        extra_subscriber_us: slopes.into(),
        rows,
    };
    print!("{}", text(&report.rows));
    for slope in &report.extra_subscriber_us {
        println!("one more subscriber, {}: {:.1} µs", slope.wake, slope.us);
    }
    bench::write_json(args.json.as_deref(), &report)?;
    Ok(Exit::Done)
}

/// Writer's time per additional reader of one topic.
fn slope_us(rows: &[Row], wake: &str) -> f64 {
    let of_one = rows
        .iter()
        .filter(|row| row.wake == wake && row.n_topics == 1);
    let (Some(fewest), Some(most)) = (
        of_one.clone().min_by_key(|row| row.n_readers),
        of_one.max_by_key(|row| row.n_readers),
    ) else {
        return 0.0;
    };
    let n_more = most.n_readers.saturating_sub(fewest.n_readers).max(1);
    (most.writing.p50_us - fewest.writing.p50_us) / n_more as f64
}

impl Case {
    fn turn(&mut self, args: &WakesArgs, number: usize) -> anyhow::Result<()> {
        // A domain of its own, so that this neither meets nor disturbs a running simulator.
        let domain = format!("wakes-{}", std::process::id());
        let bus = Bus::open(&domain, "gantry-bench")?;
        let modalities = if self.n_topics == 1 {
            &[Modality::Semantic][..]
        } else {
            &VIEW[..self.n_topics]
        };
        let rig = format!("c{number}");
        let mut topics: Vec<(FramePublisher, Notifier)> = Vec::new();
        for modality in modalities {
            let topic = format!("{rig}/view/{}", modality.name());
            let spec = FrameTopic {
                frames_in_flight: 1,
                max_readers: self.n_readers.max(1),
                ..FrameTopic::new(*modality, FRAME_BYTES)
            };
            let publisher = bus.frame_publisher(&topic, spec)?;
            publisher.touch()?;
            let event = bus.notifier(&topic)?;
            topics.push((publisher, event));
        }
        let tick_event = format!("{rig}/tick");
        let rig = bus.notifier(&tick_event)?;
        let names: Vec<String> = topics.iter().map(|(p, _)| p.topic().to_owned()).collect();
        let events = match self.wake {
            Wake::Rig => vec![tick_event],
            Wake::OwnEach | Wake::OwnAll => names.clone(),
        };
        let readers = (0..self.n_readers)
            .map(|_| WakeReader::start(&domain, &names, &events))
            .collect::<anyhow::Result<Vec<_>>>()?;
        let period = Duration::from_secs_f64(1.0 / args.rate);
        let mut next = Instant::now();
        for tick in 1..=WARM_UP + args.count {
            std::thread::sleep(next.saturating_duration_since(Instant::now()));
            next = next.max(Instant::now() - period) + period;
            let started = mono_now();
            for (publisher, event) in &topics {
                let mut loan = publisher.loan(FRAME_BYTES)?;
                loan.payload_mut().fill(tick as u8);
                let bytes = publisher.modality().element_bytes();
                let header = loan.header_mut();
                header.set_image((FRAME_BYTES / bytes) as u32, 1);
                (header.seq, header.tick, header.epoch) = (tick, tick, 1);
                loan.send()?;
                if self.wake == Wake::OwnEach {
                    event.notify_listeners();
                }
            }
            if self.wake == Wake::OwnAll {
                topics.iter().for_each(|(_, event)| {
                    event.notify_listeners();
                });
            }
            rig.notify_listeners();
            if tick > WARM_UP {
                self.writing.record(mono_now().nanos_since(started));
            }
        }
        // The last frame is on its way to readers that sleep.
        std::thread::sleep(Duration::from_millis(100));
        self.n_ticks += WARM_UP + args.count;
        for reader in readers {
            let seen = reader.finish()?;
            for nanos in seen.ages_nanos.values().flat_map(|ages| {
                let n_warm_up = usize::try_from(WARM_UP).unwrap_or(0);
                ages.iter().skip(n_warm_up)
            }) {
                self.age.record(*nanos);
            }
            self.n_wakes += seen.n_wakes;
            self.lost += seen.lost;
        }
        Ok(())
    }

    fn row(&self) -> Row {
        let n_reader_ticks = self.n_ticks * self.n_readers.max(1) as u64;
        Row {
            wake: self.wake.name(),
            n_topics: self.n_topics,
            n_readers: self.n_readers,
            writing: self.writing.summary(),
            age: self.age.summary(),
            wakes_per_tick: self.n_wakes as f64 / n_reader_ticks.max(1) as f64,
            lost: self.lost,
        }
    }
}

fn text(rows: &[Row]) -> String {
    let row = |row: &Row| {
        vec![
            row.wake.to_owned(),
            row.n_topics.to_string(),
            row.n_readers.to_string(),
            micros(row.writing.p50_us),
            micros(row.writing.p99_us),
            micros(row.age.p50_us),
            micros(row.age.p99_us),
            format!("{:.2}", row.wakes_per_tick),
            row.lost.to_string(),
        ]
    };
    let heads = [
        "readers wake on (µs)",
        "topics",
        "readers",
        "writing p50",
        "p99",
        "age p50",
        "p99",
        "wakes/tick",
        "lost",
    ];
    output::table(&heads, &rows.iter().map(row).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cost_of_a_subscriber_is_the_slope() {
        let row = |wake: Wake, n_readers, p50_us| Row {
            wake: wake.name(),
            n_topics: 1,
            n_readers,
            writing: Summary {
                p50_us,
                ..Times::default().summary()
            },
            age: Times::default().summary(),
            wakes_per_tick: 1.0,
            lost: 0,
        };
        let rows = [
            row(Wake::Rig, 0, 3.0),
            row(Wake::OwnEach, 0, 5.0),
            row(Wake::Rig, 8, 83.0),
            row(Wake::OwnEach, 8, 93.0),
        ];
        assert_eq!(slope_us(&rows, Wake::Rig.name()), 10.0);
        assert_eq!(slope_us(&rows, Wake::OwnEach.name()), 11.0);
        assert!(text(&rows).contains("the rig's tick"));
    }
}
