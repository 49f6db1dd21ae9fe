//! `gantry-bench chain`: what each process of a pipeline adds. This process is the camera; each
//! further process takes an image, copies it into a result of its own, and sends that on. All of
//! them sleep in poll(2) between two images, or poll.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use consumer_report::numbers::micros;
use launch_cli::{Exit, Machine, bench};
use schema_bus::{Answerable, Bus, Frame, FrameReader, FrameTopic, ResultReader, ResultSample};
use schema_bus::{ResultTopic, mono_now};
use schema_frames::{Modality, PixelFormat, ResultType};
use serde::{Deserialize, Serialize};

use crate::output;
use crate::part::{Parent, Part};
use consumer_report::{Summary, Times};

/// Images before counting begins.
const WARM_UP: u64 = 50;
/// Longest sleep, after which a process looks whether it is to end.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Topic of the camera.
const CAMERA: &str = "ego/front/rgb";

#[derive(Debug, clap::Args)]
pub struct ChainArgs {
    /// Image sizes
    #[arg(long, value_name = "WxH,…", value_delimiter = ',', default_value = "800x600,1920x1080", value_parser = size)]
    sizes: Vec<(u32, u32)>,

    /// Processes behind the camera
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=16))]
    links: u16,

    /// Images per second
    #[arg(long, value_name = "HZ", default_value_t = 50.0)]
    rate: f64,

    /// Images counted per turn
    #[arg(long, value_name = "N", default_value_t = 300)]
    count: u64,

    /// Turns: every case is measured once in each
    #[arg(long, value_name = "N", default_value_t = 3)]
    turns: u32,

    /// Write the table as JSON too
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

fn size(text: &str) -> Result<(u32, u32), String> {
    text.split_once('x')
        .and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)))
        .filter(|(w, h)| (1..=8192).contains(w) && (1..=8192).contains(h))
        .ok_or_else(|| format!("{text:?} is no size; write one from 1x1 to 8192x8192"))
}

/// Arguments of one process of the chain.
#[derive(Debug, clap::Args)]
pub struct LinkArgs {
    /// Topic to read
    #[arg(long)]
    input: String,
    /// Topic to write
    #[arg(long)]
    output: String,
    /// Poll instead of sleeping
    #[arg(long)]
    polled: bool,
}

/// What one process saw, nanoseconds.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Seen {
    /// From its input's stamp to the input in hand.
    hop: Vec<u64>,
    /// From the camera's stamp to the input in hand.
    since_camera: Vec<u64>,
    lost: u64,
}

#[derive(Debug, Serialize)]
struct Row {
    name: String,
    width_px: u32,
    height_px: u32,
    /// 1 is the process that reads the camera.
    link: usize,
    polled: bool,
    /// From the stamp of its input to the input in hand.
    hop: Summary,
    /// From the stamp of the camera's image to the input in hand.
    since_camera: Summary,
    lost: u64,
}

#[derive(Debug, Serialize)]
struct Report {
    bench: &'static str,
    machine: Machine,
    /// A copy of an image into memory that is warm, microseconds: the work of every link.
    memcpy_us: Vec<f64>,
    rows: Vec<Row>,
}

/// Measures every size, asleep and polled by turns, and prints one table.
pub fn run(args: &ChainArgs) -> anyhow::Result<Exit> {
    let machine = Machine::read();
    println!("{}", machine.heading());
    let mut rows: Vec<Row> = Vec::new();
    for (width, height) in args.sizes.iter().copied() {
        let mut kept: Vec<Vec<Seen>> = vec![Vec::new(), Vec::new()];
        for turn in 0..args.turns {
            for polled in [false, true] {
                let domain = format!("bench{}-{turn}-{}", std::process::id(), u8::from(polled));
                let seen = one_turn(args, &domain, (width, height), polled)?;
                join(&mut kept[usize::from(polled)], seen);
            }
        }
        for (polled, seen) in [false, true].into_iter().zip(kept) {
            rows.extend(seen.into_iter().enumerate().map(|(i, seen)| {
                Row {
                    name: format!("{width}x{height} {} {}", way(polled), i + 1),
                    width_px: width,
                    height_px: height,
                    link: i + 1,
                    polled,
                    hop: seen.hop.iter().copied().collect::<Times>().summary(),
                    since_camera: seen
                        .since_camera
                        .iter()
                        .copied()
                        .collect::<Times>()
                        .summary(),
                    lost: seen.lost,
                }
            }));
        }
    }
    let memcpy = |(w, h): &(u32, u32)| memcpy_us(*w as usize * *h as usize * 4);
    let report = Report {
        bench: "chain",
        machine,
        memcpy_us: args.sizes.iter().map(memcpy).collect(),
        rows,
    };
    print!("{}", text(&report.rows));
    bench::write_json(args.json.as_deref(), &report)?;
    Ok(Exit::Done)
}

/// Adds one turn to the turns before it.
fn join(kept: &mut Vec<Seen>, turn: Vec<Seen>) {
    kept.resize_with(turn.len(), Seen::default);
    for (all, mut one) in kept.iter_mut().zip(turn) {
        all.hop.append(&mut one.hop);
        all.since_camera.append(&mut one.since_camera);
        all.lost += one.lost;
    }
}

fn way(polled: bool) -> &'static str {
    if polled { "polled" } else { "asleep" }
}

fn one_turn(
    args: &ChainArgs,
    domain: &str,
    (width, height): (u32, u32),
    polled: bool,
) -> anyhow::Result<Vec<Seen>> {
    let bus = Bus::open(domain, "gantry-bench")?;
    let bytes = width as usize * height as usize * 4;
    let camera = bus.frame_publisher(CAMERA, FrameTopic::new(Modality::Rgb, bytes))?;
    camera.touch()?;
    let wake = bus.notifier(CAMERA)?;
    let mut links = Vec::new();
    for i in 0..args.links {
        let input = match i {
            0 => CAMERA.to_owned(),
            i => format!("chain/link{i}"),
        };
        let output = format!("chain/link{}", i + 1);
        let words = [
            "chain-link",
            "--domain",
            domain,
            "--input",
            &input,
            "--output",
            &output,
        ];
        let polled = polled.then_some("--polled");
        links.push(Part::start(
            &words.into_iter().chain(polled).collect::<Vec<_>>(),
        )?);
    }
    let period = Duration::from_secs_f64(1.0 / args.rate);
    let mut next = Instant::now();
    for seq in 1..=WARM_UP + args.count {
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
        next = next.max(Instant::now() - period) + period;
        let mut loan = camera.loan(bytes)?;
        loan.payload_mut().fill(seq as u8);
        let header = loan.header_mut();
        header.set_image(width, height);
        (header.seq, header.tick) = (seq, seq);
        loan.send()?;
        wake.notify();
    }
    // What is under way arrives.
    std::thread::sleep(2 * LOOK_EVERY);
    let seen: anyhow::Result<Vec<Seen>> = links.into_iter().map(Part::finish).collect();
    let mut seen = seen?;
    for link in &mut seen {
        for list in [&mut link.hop, &mut link.since_camera] {
            list.drain(..list.len().min(WARM_UP as usize));
        }
    }
    Ok(seen)
}

/// Best of many copies, microseconds.
fn memcpy_us(bytes: usize) -> f64 {
    let (from, mut to) = (vec![1u8; bytes], vec![0u8; bytes]);
    let mut best = f64::INFINITY;
    for _ in 0..50 {
        let began = Instant::now();
        to.copy_from_slice(std::hint::black_box(&from));
        std::hint::black_box(&mut to);
        best = best.min(began.elapsed().as_secs_f64() * 1e6);
    }
    best
}

/// Either end of the camera's topic or of another link's.
enum Input {
    Frames(FrameReader),
    Results(ResultReader),
}

/// An image of either.
enum Image {
    Frame(Frame),
    Result(ResultSample),
}

impl Input {
    fn open(bus: &Bus, topic: &str) -> anyhow::Result<Input> {
        Ok(match topic {
            CAMERA => Input::Frames(bus.frame_reader(topic)?),
            topic => Input::Results(bus.result_reader(topic)?),
        })
    }

    fn next(&mut self) -> anyhow::Result<Option<Image>> {
        Ok(match self {
            Input::Frames(reader) => reader.next()?.map(Image::Frame),
            Input::Results(reader) => reader.next()?.map(Image::Result),
        })
    }

    fn lost(&self) -> u64 {
        match self {
            Input::Frames(reader) => reader.counts().lost,
            Input::Results(reader) => reader.counts().lost,
        }
    }
}

impl Image {
    fn bytes(&self) -> &[u8] {
        match self {
            Image::Frame(frame) => frame,
            Image::Result(result) => result,
        }
    }

    fn size(&self) -> (u32, u32) {
        match self {
            Image::Frame(frame) => (frame.header().width, frame.header().height),
            Image::Result(result) => (result.header().width, result.header().height),
        }
    }

    /// Stamps of the image and of the camera's image behind it.
    fn stamps(&self) -> (u64, u64) {
        match self {
            Image::Frame(frame) => {
                let published = frame.header().published_mono_nanos;
                (published, published)
            }
            Image::Result(result) => {
                let header = result.header();
                (header.published_mono_nanos, header.origin_mono_nanos)
            }
        }
    }

    fn as_input(&self) -> &dyn Answerable {
        match self {
            Image::Frame(frame) => frame,
            Image::Result(result) => result,
        }
    }
}

/// One process of the chain.
pub fn link(args: &LinkArgs, domain: &str) -> anyhow::Result<Exit> {
    let bus = Bus::open(domain, "gantry-bench-link")?;
    let mut input = Input::open(&bus, &args.input)?;
    let listener = bus.listener(&args.input)?;
    let output = bus
        .result_publisher(&args.output, &ResultTopic::new(ResultType::Image))
        .context("cannot write the next link's topic")?;
    let parent = Parent::tell_ready()?;
    let mut seen = Seen::default();
    while !parent.is_over() {
        if !args.polled {
            listener.wait(LOOK_EVERY)?;
        }
        while let Some(image) = input.next()? {
            let held = mono_now().0;
            let (published, origin) = image.stamps();
            seen.hop.push(held.saturating_sub(published));
            seen.since_camera.push(held.saturating_sub(origin));
            let (width, height) = image.size();
            let mut loan = output.loan(image.bytes().len())?;
            loan.answers(image.as_input());
            loan.set_image(width, height, PixelFormat::Bgra8)?;
            loan.body_mut().copy_from_slice(image.bytes());
            loan.send()?;
        }
    }
    seen.lost = input.lost();
    parent.answer(&seen)?;
    Ok(Exit::Done)
}

fn text(rows: &[Row]) -> String {
    let heads = [
        "image",
        "way",
        "process",
        "hop p50 µs",
        "p99 µs",
        "since camera p50 µs",
        "p99 µs",
        "images",
        "lost",
    ];
    let cells = |row: &Row| {
        vec![
            format!("{}x{}", row.width_px, row.height_px),
            way(row.polled).to_owned(),
            row.link.to_string(),
            micros(row.hop.p50_us),
            micros(row.hop.p99_us),
            micros(row.since_camera.p50_us),
            micros(row.since_camera.p99_us),
            row.hop.n.to_string(),
            row.lost.to_string(),
        ]
    };
    output::table(&heads, &rows.iter().map(cells).collect::<Vec<_>>())
}
