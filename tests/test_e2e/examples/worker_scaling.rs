//! What render workers bring: many cameras, rendered by the simulator itself and by workers.
//!
//! `cargo run --release -p test_e2e --example worker_scaling -- [CAMERAS WIDTH HEIGHT] [--workers 0,1,2] [--adapters 0,1]
//! [--seconds 20] [--lockstep] [--batches N] [--json FILE]` (default: 64 cameras of 256 × 256, then 16 of 1920 × 1080). Worker n takes
//! adapter n of the list, counted round; without a list each takes the usual one. A `-` among the workers is the world alone:
//! no GPU, no worker, nobody reads. The world runs as fast as it can, or, with `--lockstep`, waits at every tick
//! until the frames of the last are read. Ticks are those of the world, milliseconds of the processor per tick
//! those of the process `simd`.

use std::process::ExitCode;
use std::time::{Duration, Instant};

use launch_cli::bench::{self, BenchResult, anyhow, clap};
use schema_bus::{Bus, CommandClient, FrameReader};
use schema_frames::Command;
use test_e2e::{ask, counter, join_bus, reader, spawn_consumer, start_daemon};
use test_kit::client::join_lockstep;
use test_kit::{Process, Sandbox, eventually};

/// Ticks before the first that counts.
const WARM_UP: u64 = 30;

/// Measures many cameras with and without render workers
#[derive(Debug, clap::Args)]
struct Options {
    /// Cameras, and width and height of their images
    #[arg(num_args = 3, value_names = ["CAMERAS", "WIDTH", "HEIGHT"])]
    cameras: Vec<u32>,
    /// Numbers of workers; - is the world alone
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "-,0,1,2", allow_hyphen_values = true, value_parser = workers)]
    workers: Vec<Workers>,
    /// Batches of as many cameras each, which are read in place of the cameras' own topics; 0 for none
    #[arg(long, value_name = "N", default_value_t = 0)]
    batches: usize,
    /// Adapters of the workers
    #[arg(long, value_name = "TEXT,…", value_delimiter = ',')]
    adapters: Vec<String>,
    /// Time of each measurement
    #[arg(long, default_value_t = 20.0)]
    seconds: f64,
    /// Wait at every tick until the frames of the last are read
    #[arg(long)]
    lockstep: bool,
}

/// How many workers render; none is the world alone.
#[derive(Clone, Copy, Debug)]
struct Workers(Option<usize>);

fn workers(text: &str) -> Result<Workers, String> {
    match text {
        "-" => Ok(Workers(None)),
        _ => match text.parse() {
            Ok(n) => Ok(Workers(Some(n))),
            Err(_) => Err("give a number, or - for the world alone".to_owned()),
        },
    }
}

fn launch(n_cameras: usize, [width_px, height_px]: [u32; 2], n_batches: usize) -> String {
    let mut text = String::from(
        "version = 1\n[scenario]\nmap = \"Town10HD\"\nseed = 7\ntick_hz = 20\nvehicles = 20\nwalkers = 20\n",
    );
    for n in 0..n_cameras {
        let yaw_deg = 360.0 * n as f64 / n_cameras as f64 - 180.0;
        text += &format!(
            "[sensor.c{n}]\nkind = \"camera\"\nrate_hz = 20\nwidth_px = {width_px}\nheight_px = {height_px}\nmount.position_m = [0.6, 0.0, 1.8]\nmount.rpy_deg = [0.0, 0.0, {yaw_deg:.3}]\n[topic.\"ego/c{n}/rgb\"]\nreaders = 2\n",
        );
    }
    if n_batches > 0 {
        // Nobody reads the spectator; as large as usual it would weigh as much as a small batch.
        text += "[spectator]\nwidth_px = 32\nheight_px = 32\n";
    }
    for n in 0..n_batches {
        let of_batch = (0..n_cameras).filter(|camera| camera * n_batches / n_cameras == n);
        let cameras: Vec<String> = of_batch
            .map(|camera| format!("\"ego/c{camera}\""))
            .collect();
        text += &format!("[batch.b{n}]\ncameras = [{}]\n", cameras.join(", "));
    }
    text
}

/// Processor time of a process so far, seconds.
fn processor_secs(pid: u32) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).expect("the process lives");
    let (_, rest) = stat.rsplit_once(") ").expect("a name in brackets");
    let ticks = |idx: usize| -> f64 {
        let field = rest.split(' ').nth(idx).expect("Linux has these fields");
        field.parse().expect("a number")
    };
    // Fields 14 and 15, counted in hundredths of a second.
    (ticks(11) + ticks(12)) / 100.0
}

fn drain(readers: &mut [FrameReader]) -> u64 {
    let mut n = 0;
    for reader in readers {
        while reader.next().expect("frames keep the contract").is_some() {
            n += 1;
        }
    }
    n
}

/// Reads frames for as long as it is asked to; as a participant of the lockstep all of every tick.
struct Reading<'a> {
    bus: &'a Bus,
    readers: Vec<FrameReader>,
    participant: Option<(u32, schema_bus::AckWriter)>,
    tick: u64,
}

impl<'a> Reading<'a> {
    fn begin(bus: &'a Bus, client: &mut CommandClient, topics: &[String], lockstep: bool) -> Self {
        // Before it joins: the first tick may begin with that, and its frames are waited for.
        let readers = topics.iter().map(|topic| reader(bus, topic)).collect();
        let participant = lockstep.then(|| {
            let acks = bus.ack_writer("reader").expect("there is room");
            (join_lockstep(client, "reader"), acks)
        });
        Reading {
            readers,
            bus,
            participant,
            tick: 0,
        }
    }

    /// Reads until it is over; returns how many frames it saw.
    fn until(&mut self, is_over: &mut dyn FnMut() -> bool) -> u64 {
        let mut n_frames = 0;
        let Some((participant, acks)) = &self.participant else {
            while !is_over() {
                n_frames += drain(&mut self.readers);
                std::thread::sleep(Duration::from_millis(1));
            }
            return n_frames;
        };
        let is_batch = self.readers[0].topic().starts_with("batch/");
        let event = if is_batch { "batch/tick" } else { "ego/tick" };
        let sent = self.bus.listener(event).expect("there is room");
        while !is_over() {
            let mut epoch = 0;
            for reader in &mut self.readers {
                loop {
                    if let Some(frame) = reader.next().expect("frames keep the contract") {
                        (self.tick, epoch) = (frame.header().tick, frame.header().epoch);
                        n_frames += 1;
                        break;
                    }
                    sent.wait(Duration::from_millis(5)).expect("the bus works");
                }
            }
            acks.send(*participant, epoch, self.tick)
                .expect("the bus works");
        }
        n_frames
    }
}

fn measure(
    result: &mut BenchResult,
    name: &str,
    text: &str,
    n_cameras: usize,
    n_workers: Option<usize>,
    options: &Options,
) {
    let sandbox = Sandbox::new("scaling");
    let n = n_workers.unwrap_or(0);
    let awaited = n.to_string();
    let mut args = vec!["--unpaced"];
    if n_workers != Some(0) {
        args.push("--no-gpu");
    } else if let Some(adapter) = options.adapters.first() {
        args.extend(["--adapter", adapter]);
    }
    let lockstep = options.lockstep && n_workers.is_some();
    if lockstep {
        args.extend(["--await-lockstep", "1"]);
    }
    args.extend(["--await-workers", &awaited]);
    let daemon = start_daemon(&sandbox, text, &args);
    let workers: Vec<Process> = (0..n)
        .map(|idx| {
            let name = format!("worker-{idx}");
            let mut args = vec!["--name", &name];
            if !options.adapters.is_empty() {
                let adapter = &options.adapters[idx % options.adapters.len()];
                args.extend(["--adapter", adapter]);
            }
            spawn_consumer(&sandbox, "gantry-render", &args)
        })
        .collect();
    let bus = join_bus(&sandbox, "scaling");
    let mut client = bus.command_client("scaling").expect("the daemon answers");
    let topics: Vec<String> = match n_workers {
        Some(_) if options.batches > 0 => {
            let batches = 0..options.batches;
            batches.map(|n| format!("batch/b{n}/rgb")).collect()
        }
        Some(_) => (0..n_cameras).map(|n| format!("ego/c{n}/rgb")).collect(),
        None => Vec::new(),
    };
    let mut reading = Reading::begin(&bus, &mut client, &topics, lockstep);
    let mut begun = || counter(&mut client, "ticks");
    let start_tick = begun();
    let mut looked = Instant::now();
    reading.until(&mut || {
        if looked.elapsed() < Duration::from_millis(50) {
            return false;
        }
        looked = Instant::now();
        begun() >= start_tick + WARM_UP
    });
    let of_workers = || -> f64 {
        workers
            .iter()
            .map(|worker| processor_secs(worker.pid()))
            .sum()
    };
    let (tick, cpu, cpu_of_workers, start) = (
        begun(),
        processor_secs(daemon.pid()),
        of_workers(),
        Instant::now(),
    );
    let n_frames = reading.until(&mut || start.elapsed().as_secs_f64() >= options.seconds);
    let secs = start.elapsed().as_secs_f64();
    let n_ticks = (begun() - tick) as f64;
    let figures = [
        ("n_ticks", n_ticks),
        ("ticks_per_s", n_ticks / secs),
        ("frames_per_s", n_frames as f64 / secs),
        (
            "simd_cpu_ms_per_tick",
            1e3 * (processor_secs(daemon.pid()) - cpu) / n_ticks,
        ),
        (
            "workers_cpu_ms_per_tick",
            1e3 * (of_workers() - cpu_of_workers) / n_ticks,
        ),
    ];
    let who = match n_workers {
        None => "world alone".to_owned(),
        Some(0) => "simd itself".to_owned(),
        Some(n) => format!("{n} workers"),
    };
    for reader in reading.readers.iter().filter(|_| options.batches > 0) {
        let pid = reader.writer().and_then(|origin| origin.pid);
        let of = workers.iter().position(|worker| Some(worker.pid()) == pid);
        let by = of.map_or("simd".to_owned(), |idx| format!("worker-{idx}"));
        println!("{} is made by {by}", reader.topic());
    }
    print!("{name}, {who}:");
    figures
        .iter()
        .for_each(|(key, figure)| print!(" {key} {figure:.2}"));
    println!();
    result.row(&format!("{name}, {who}"), &figures);
    if let Some((participant, _)) = reading.participant.take() {
        ask(&mut client, Command::LeaveLockstep { participant });
    }
    drop(reading);
    drop((client, bus));
    for worker in workers {
        worker.stop().expect_code(0);
    }
    daemon.stop().expect_code(0);
    eventually("nothing is left", || {
        sandbox.leftovers().is_empty().then_some(())
    });
}

fn main() -> ExitCode {
    bench::run("worker_scaling", |options: &Options, result| {
        let cases = match options.cameras[..] {
            [n, width_px, height_px] => vec![(n as usize, [width_px, height_px])],
            [] => vec![(64, [256, 256]), (16, [1920, 1080])],
            _ => anyhow::bail!("CAMERAS WIDTH HEIGHT come together"),
        };
        for (n_cameras, size_px) in cases {
            let name = format!("{n_cameras} x {}x{}", size_px[0], size_px[1]);
            let text = launch(n_cameras, size_px, options.batches);
            for Workers(n_workers) in &options.workers {
                measure(result, &name, &text, n_cameras, *n_workers, options);
            }
        }
        Ok(())
    })
}
