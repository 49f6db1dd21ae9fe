//! `gantry-bench ages`: how old frames of quick sensors are in a reader's hand while a running
//! simulator renders, by what wakes the reader. By turns: the rig's tick, the topic's own event, and
//! 64-byte frames of writers of this bench as the shortest way there is on this machine now.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::ensure;
use consumer_report::numbers::micros;
use launch_cli::values::some_span;
use launch_cli::{Exit, Machine, Shutdown, bench};
use schema_bus::{Bus, FrameTopic, names};
use schema_frames::{Modality, SensorKind};
use serde::Serialize;

use crate::output;
use crate::wakes::reader::WakeReader;
use consumer_report::{Summary, Times};

/// What a writer of 64-byte frames does after it has woken its reader, and its name in the table. One
/// that sleeps leaves its processor to the reader, which is the shortest way there is; one that
/// works on, as a simulator does, keeps it.
const WRITERS: [(&str, Duration); 2] = [
    ("64 bytes, their writer sleeps", Duration::ZERO),
    ("64 bytes, their writer works on", Duration::from_millis(3)),
];
/// Frames a second on the shortest way: about as often as sensors fire, because processes that sleep
/// longer wake more slowly.
const SHORTEST_HZ: f64 = 20.0;

#[derive(Debug, clap::Args)]
pub struct AgesArgs {
    /// Topics to measure; all but those of cameras if none is named
    #[arg(long, value_name = "TOPIC,…", value_delimiter = ',')]
    topics: Vec<String>,

    /// Turns
    #[arg(long, value_name = "N", default_value_t = 3)]
    turns: u32,

    /// How long each way is measured in a turn
    #[arg(long, value_name = "TIME", default_value = "10s", value_parser = some_span)]
    each: Duration,

    /// Write the table as JSON too
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// One topic and one way to be woken, over all turns.
#[derive(Debug, Serialize)]
struct Row {
    topic: String,
    wake: &'static str,
    age: Summary,
    /// p50 against that of 64 bytes whose writer sleeps.
    against_shortest: f64,
}

#[derive(Debug, Serialize)]
struct Report {
    machine: Machine,
    /// Cameras' topics that another process read all the while.
    rendered: Vec<String>,
    rows: Vec<Row>,
}

/// What wakes a reader of one topic.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Wake {
    Rig,
    Own,
}

impl Wake {
    fn name(self) -> &'static str {
        match self {
            Wake::Rig => "the rig's tick",
            Wake::Own => "own event",
        }
    }

    fn event(self, topic: &str) -> String {
        match self {
            Wake::Rig => names::rig_tick(names::rig_of(topic)),
            Wake::Own => topic.to_owned(),
        }
    }
}

/// Measures by turns and prints one table.
pub fn run(args: &AgesArgs, domain: &str) -> anyhow::Result<Exit> {
    let (machine, shutdown) = (Machine::read(), Shutdown::install()?);
    let bus = Bus::open(domain, "gantry-bench")?;
    let (views, others) = frame_topics(&bus)?;
    let topics = if args.topics.is_empty() {
        others
    } else {
        args.topics.clone()
    };
    ensure!(
        !topics.is_empty() && !views.is_empty(),
        "domain {domain:?} has {} topics of cameras and {} others, but both are needed; start the simulator with such sensors",
        views.len(),
        topics.len()
    );
    println!("{}", machine.heading());
    let rigs: Vec<String> = views
        .iter()
        .map(|topic| names::rig_tick(names::rig_of(topic)))
        .collect::<std::collections::BTreeSet<_>>()
        .into_iter()
        .collect();
    let viewer = WakeReader::start(domain, &views, &rigs)?;
    let ways: Vec<(usize, Wake)> = (0..topics.len())
        .flat_map(|topic| [(topic, Wake::Rig), (topic, Wake::Own)])
        .collect();
    let mut ages: Vec<Times> = ways.iter().map(|_| Times::default()).collect();
    let mut shortest = WRITERS.map(|_| Times::default());
    for turn in 1..=args.turns {
        eprintln!("turn {turn} of {} …", args.turns);
        for wake in [Wake::Rig, Wake::Own] {
            let mut readers = Vec::new();
            for (i, (topic, _)) in ways.iter().enumerate().filter(|(_, way)| way.1 == wake) {
                let topic = &topics[*topic];
                let reader =
                    WakeReader::start(domain, std::slice::from_ref(topic), &[wake.event(topic)])?;
                readers.push((i, reader));
            }
            if shutdown.wait(args.each) {
                return Ok(Exit::Done);
            }
            for (i, reader) in readers {
                let seen = reader.finish()?;
                let nanos = seen.ages_nanos.values().flatten();
                nanos.for_each(|nanos| ages[i].record(*nanos));
            }
        }
        for ((_, works), ages) in WRITERS.iter().zip(&mut shortest) {
            send_shortest(args.each, *works, ages)?;
        }
    }
    let rendered = viewer.finish()?.ages_nanos;
    ensure!(
        rendered.values().any(|frames| frames.len() > 1),
        "no camera delivered two frames in the time of the bench; give --each more"
    );
    let shortest = shortest.map(|ages| ages.summary());
    let against_shortest = |age: &Summary| age.p50_us / shortest[0].p50_us;
    let mut rows: Vec<Row> = ways
        .iter()
        .zip(&ages)
        .map(|((topic, wake), ages)| {
            let age = ages.summary();
            Row {
                topic: topics[*topic].clone(),
                wake: wake.name(),
                age,
                against_shortest: against_shortest(&age),
            }
        })
        .collect();
    rows.extend(WRITERS.iter().zip(&shortest).map(|((name, _), age)| Row {
        topic: (*name).into(),
        wake: Wake::Own.name(),
        age: *age,
        against_shortest: against_shortest(age),
    }));
    let report = Report {
        machine,
        rendered: views,
        rows,
    };
    print!("{}", text(&report.rows));
    bench::write_json(args.json.as_deref(), &report)?;
    Ok(Exit::Done)
}

/// Topics of cameras, and all other frame topics, that have a writer or would get one.
fn frame_topics(bus: &Bus) -> anyhow::Result<(Vec<String>, Vec<String>)> {
    let is_view = |modality: &Modality| modality.sensor_kind() == SensorKind::Camera;
    let mut found = (Vec::new(), Vec::new());
    for topic in bus.topics()? {
        match topic.modality {
            Some(modality) if is_view(&modality) => found.0.push(topic.name),
            Some(modality) if !modality.is_event() => found.1.push(topic.name),
            _ => {}
        }
    }
    Ok(found)
}

/// Sends 64-byte frames to a reader of their own for so long, and works for a while after each.
fn send_shortest(length: Duration, works: Duration, ages: &mut Times) -> anyhow::Result<()> {
    let domain = format!("ages-{}", std::process::id());
    let bus = Bus::open(&domain, "gantry-bench")?;
    let topic = "bench/view/semantic".to_owned();
    let publisher = bus.frame_publisher(&topic, FrameTopic::new(Modality::Semantic, 64))?;
    let event = bus.notifier(&topic)?;
    let reader = WakeReader::start(
        &domain,
        std::slice::from_ref(&topic),
        std::slice::from_ref(&topic),
    )?;
    let end = Instant::now() + length;
    for seq in 1.. {
        if Instant::now() >= end {
            break;
        }
        let mut loan = publisher.loan(64)?;
        loan.payload_mut().fill(seq as u8);
        let header = loan.header_mut();
        header.set_image(64, 1);
        (header.seq, header.tick, header.epoch) = (seq, seq, 1);
        loan.send()?;
        event.notify_listeners();
        let woken = Instant::now();
        while woken.elapsed() < works {
            std::hint::spin_loop();
        }
        std::thread::sleep(Duration::from_secs_f64(1.0 / SHORTEST_HZ));
    }
    let seen = reader.finish()?;
    seen.ages_nanos
        .values()
        .flatten()
        .for_each(|nanos| ages.record(*nanos));
    Ok(())
}

fn text(rows: &[Row]) -> String {
    let row = |row: &Row| {
        vec![
            row.topic.clone(),
            row.wake.to_owned(),
            micros(row.age.p50_us),
            micros(row.age.p99_us),
            micros(row.age.max_us),
            format!("{:.2}", row.against_shortest),
            row.age.n.to_string(),
        ]
    };
    let heads = [
        "published → in hand (µs)",
        "woken by",
        "p50",
        "p99",
        "max",
        "× 64 B",
        "n",
    ];
    output::table(&heads, &rows.iter().map(row).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reader_of_one_topic_sleeps_on_its_rig_or_on_itself() {
        assert_eq!(Wake::Rig.event("ego/imu/imu"), "ego/tick");
        assert_eq!(Wake::Own.event("ego/imu/imu"), "ego/imu/imu");
    }
}
