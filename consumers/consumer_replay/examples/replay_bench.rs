//! How fast recordings are replayed, beside `cat FILE > /dev/null`, and how exactly at their own
//! speed: `replay_bench [FOLDER] [--ticks 300] [--json FILE]`.
//!
//! The recording is made here: two images and a lidar a tick, of which lz4 makes about a half. It is
//! read once before it is measured, so that the page cache holds it.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

use anyhow::{Context as _, ensure};
use consumer_replay::options::{Options, Rate};
use launch_cli::Shutdown;
use launch_cli::bench::{self, BenchResult, clap};
use schema_bus::Bus;
use schema_frames::snapshot::SNAPSHOT_MAGIC;
use schema_frames::{FrameHeader, Modality, SCHEMA_VERSION, SnapshotHeader};
use schema_recording::messages::{Batch, Content, Entry};
use schema_recording::wire::{DATA_FIELD, put_bytes};
use schema_recording::write::{ChunkCompression, Recording};

const SIZE_PX: (u32, u32) = (800, 600);
const N_POINTS: u32 = 60_000;
const TICK_NANOS: u64 = 50_000_000;

/// Times replays of a recording that is made for it
#[derive(Debug, clap::Args)]
struct Args {
    /// Folder for the recording [default: that of temporary files]
    folder: Option<PathBuf>,
    #[arg(long, default_value_t = 300)]
    ticks: u64,
}

fn main() -> ExitCode {
    bench::run("replay", measure_all)
}

fn measure_all(args: &Args, result: &mut BenchResult) -> anyhow::Result<()> {
    let folder = args.folder.clone().unwrap_or_else(std::env::temp_dir);
    let kinds = [
        ("uncompressed", ChunkCompression::None),
        ("lz4", ChunkCompression::Lz4),
        ("zstd", ChunkCompression::Zstd),
    ];
    for (name, compression) in kinds {
        let path = folder.join(format!("replay_bench_{}.mcap", std::process::id()));
        let outcome = measure(name, compression, &path, args.ticks, result);
        let _ = std::fs::remove_file(&path);
        outcome?;
    }
    Ok(())
}

fn measure(
    name: &str,
    compression: ChunkCompression,
    path: &Path,
    n_ticks: u64,
    result: &mut BenchResult,
) -> anyhow::Result<()> {
    write(path, compression, n_ticks)?;
    let file_bytes = std::fs::metadata(path)?.len();
    let cat = (0..3)
        .map(|_| cat(path))
        .collect::<anyhow::Result<Vec<Duration>>>()?;
    let cat_secs = cat.iter().min().copied().unwrap_or_default().as_secs_f64();
    let mut best = (f64::INFINITY, 0);
    for _ in 0..3 {
        let began = Instant::now();
        let (report, _) = replay(path, Rate::Max)?;
        let secs = began.elapsed().as_secs_f64();
        ensure!(report.n_dropped == 0 && report.damage.1 == 0, "{report:?}");
        if secs < best.0 {
            best = (secs, report.payload_bytes);
        }
    }
    let gbps = |bytes: u64, secs: f64| bytes as f64 * 1e-9 / secs;
    let (cat_gbps, file_gbps) = (gbps(file_bytes, cat_secs), gbps(file_bytes, best.0));
    let payload_gbps = gbps(best.1, best.0);
    println!(
        "{name}: file {:.2} GB, cat {cat_gbps:.2} GB/s, replay {file_gbps:.2} GB/s of the file, {payload_gbps:.2} GB/s of payloads",
        file_bytes as f64 * 1e-9
    );
    let figures = [
        ("file_gb", file_bytes as f64 * 1e-9),
        ("cat_gbps", cat_gbps),
        ("replay_gbps", file_gbps),
        ("payload_gbps", payload_gbps),
        ("of_cat_ratio", file_gbps / cat_gbps),
    ];
    let late = pace(path)?;
    println!(
        "{name}: at its own speed p50 {:.3} ms, p99 {:.3} ms, max {:.3} ms off the schedule",
        late[0], late[1], late[2]
    );
    let of_pace = [
        ("pace_p50_ms", late[0]),
        ("pace_p99_ms", late[1]),
        ("pace_max_ms", late[2]),
    ];
    result.row(name, &[&figures[..], &of_pace].concat());
    Ok(())
}

/// Reads the file as `cat FILE > /dev/null` does.
fn cat(path: &Path) -> anyhow::Result<Duration> {
    let out = std::fs::OpenOptions::new().write(true).open("/dev/null")?;
    let began = Instant::now();
    let status = std::process::Command::new("cat")
        .arg(path)
        .stdout(out)
        .status()
        .context("cannot start cat")?;
    ensure!(status.success(), "cat ended with {status}");
    Ok(began.elapsed())
}

/// Stamps of all snapshots: published, and simulated.
type Stamps = Vec<(u64, u64)>;

/// Replays with a reader of every topic.
fn replay(path: &Path, rate: Rate) -> anyhow::Result<(consumer_replay::Report, Stamps)> {
    let domain = format!("replay-bench-{}", std::process::id());
    let stop = Arc::new(AtomicBool::new(false));
    let reading = {
        let (domain, stop) = (domain.clone(), stop.clone());
        std::thread::spawn(move || read(&domain, &stop))
    };
    let options = Options {
        rate,
        // The first tick waits until the reader has all topics.
        n_awaited: 0,
        ..Options::new(&domain, path.to_path_buf())
    };
    let report = consumer_replay::replay(&options, &Shutdown::new())?;
    stop.store(true, Relaxed);
    let stamps = reading.join().expect("the reader does not panic")?;
    Ok((report, stamps))
}

fn read(domain: &str, stop: &AtomicBool) -> anyhow::Result<Stamps> {
    let bus = Bus::open(domain, "replay-bench")?;
    let mut readers = Vec::new();
    let mut stamps = Stamps::new();
    let mut snapshots = None;
    while !stop.load(Relaxed) {
        if readers.len() < TOPICS.len() {
            let name = TOPICS[readers.len()].0;
            if let Some(reader) = bus
                .exists(name)
                .then(|| bus.frame_reader(name).ok())
                .flatten()
            {
                readers.push(reader);
                continue;
            }
        }
        if snapshots.is_none() && bus.exists("world/snapshot") {
            snapshots = bus.snapshot_reader().ok();
        }
        for reader in &mut readers {
            while reader.next()?.is_some() {}
        }
        if let Some(snapshots) = &mut snapshots {
            while let Some(snapshot) = snapshots.next()? {
                let header = snapshot.header();
                stamps.push((header.published_mono_nanos, header.sim_nanos));
            }
        }
        std::thread::sleep(Duration::from_micros(500));
    }
    Ok(stamps)
}

/// How far snapshots are off the schedule of the median one, milliseconds: p50, p99, greatest.
fn pace(path: &Path) -> anyhow::Result<[f64; 3]> {
    let (_, stamps) = replay(path, Rate::Ratio(1.0))?;
    // The first two begin the schedule.
    let mut shifts: Vec<i64> = stamps
        .iter()
        .skip(2)
        .map(|(published, sim)| *published as i64 - *sim as i64)
        .collect();
    ensure!(shifts.len() > 20, "{} snapshots arrived", shifts.len());
    shifts.sort_unstable();
    let median = shifts[shifts.len() / 2];
    let mut off: Vec<u64> = shifts.iter().map(|shift| shift.abs_diff(median)).collect();
    off.sort_unstable();
    let at = |share: f64| off[((off.len() - 1) as f64 * share).round() as usize] as f64 * 1e-6;
    Ok([at(0.5), at(0.99), at(1.0)])
}

const TOPICS: [(&str, Modality); 3] = [
    ("ego/front/rgb", Modality::Rgb),
    ("ego/front/depth", Modality::Depth),
    ("ego/roof/lidar", Modality::Lidar),
];

fn write(path: &Path, compression: ChunkCompression, n_ticks: u64) -> anyhow::Result<()> {
    let mut file = Recording::create(path, compression)?;
    for tick in 1..=n_ticks {
        let sim_nanos = tick * TICK_NANOS;
        let mut entries = vec![snapshot(tick, sim_nanos)];
        for (topic, modality) in TOPICS {
            let mut header = FrameHeader::new(modality);
            match modality.is_image() {
                true => header.set_image(SIZE_PX.0, SIZE_PX.1),
                false => header.set_list(N_POINTS),
            }
            (header.tick, header.sim_nanos, header.seq) = (tick, sim_nanos, tick);
            let mut lossless = Vec::new();
            put_bytes(&mut lossless, 4, bytemuck::bytes_of(&header));
            put_bytes(&mut lossless, 6, format!("/{topic}").as_bytes());
            let mut shown = Vec::new();
            put_bytes(&mut shown, DATA_FIELD, &payload(header.payload_bytes, tick));
            entries.push(Entry {
                topic: format!("/{topic}/gantry"),
                content: Content::Frame,
                bytes: lossless,
            });
            entries.push(Entry {
                topic: format!("/{topic}"),
                content: match modality.is_image() {
                    true => Content::RawImage,
                    false => Content::PointCloud,
                },
                bytes: shown,
            });
        }
        file.write(&Batch {
            source: "bench".into(),
            sequence: tick as u32,
            log_nanos: sim_nanos,
            publish_nanos: sim_nanos,
            entries,
        })?;
    }
    file.finish().map(drop)
}

fn snapshot(tick: u64, sim_nanos: u64) -> Entry {
    let header = SnapshotHeader {
        magic: SNAPSHOT_MAGIC,
        schema_version: SCHEMA_VERSION,
        tick,
        sim_nanos,
        period_nanos: TICK_NANOS,
        episode: 1,
        ..bytemuck::Zeroable::zeroed()
    };
    let mut bytes = Vec::new();
    put_bytes(&mut bytes, 3, bytemuck::bytes_of(&header));
    Entry {
        topic: "/world/snapshot".into(),
        content: Content::Snapshot,
        bytes,
    }
}

/// Bytes half of which repeat.
fn payload(n_bytes: u64, seed: u64) -> Vec<u8> {
    let mut rng = fastrand::Rng::with_seed(seed);
    let mut bytes = vec![0; n_bytes as usize];
    for block in bytes.chunks_mut(64) {
        let half = block.len() / 2;
        rng.fill(&mut block[..half]);
        block[half..].fill(rng.u8(..));
    }
    bytes
}
