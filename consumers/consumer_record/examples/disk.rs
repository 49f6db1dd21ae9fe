//! How fast a recording is written, beside plain sequential writing in the same run, both brought to
//! the disk: `cargo run --release --example disk -- FOLDER [MEGABYTES [TURNS]]`.

use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use consumer_record::files::Files;
use consumer_record::options::Split;
use consumer_record::queue::{Job, Refused, queue};
use consumer_record::writer::{Target, run};
use launch_cli::bench::{self, BenchResult, Samples, clap};
use schema_recording::messages::{Batch, Content, Entry};
use schema_recording::write::{ChunkCompression, Recording};

/// A message as large as an image of 800 × 600 pixels.
const MESSAGE_BYTES: usize = 1_920_000;

/// Times writing of recordings, beside plain writing
#[derive(Debug, clap::Args)]
struct Args {
    folder: PathBuf,
    #[arg(default_value_t = 1000)]
    megabytes: usize,
    #[arg(default_value_t = 5)]
    turns: usize,
}

fn main() -> ExitCode {
    bench::run("disk", measure)
}

fn measure(args: &Args, result: &mut BenchResult) -> anyhow::Result<()> {
    let folder = args.folder.as_path();
    let n = args.megabytes * 1_000_000 / MESSAGE_BYTES;
    let mut rng = fastrand::Rng::with_seed(1);
    let message: Vec<u8> = (0..MESSAGE_BYTES).map(|_| rng.u8(..)).collect();
    let mut rates = Vec::new();
    for turn in 1..=args.turns.max(1) {
        let raw = raw(folder, &message, n)?;
        let recorded = recorded(folder, message.clone(), n)?;
        println!(
            "turn {turn}: plain {raw:.0} MB/s, recording {recorded:.0} MB/s, ratio {:.2}",
            recorded / raw
        );
        rates.push((recorded, recorded / raw));
    }
    let rate = rates.iter().map(|it| it.0).collect::<Samples>().median();
    let ratio = rates.iter().map(|it| it.1).collect::<Samples>().median();
    result.row("median", &[("mb_per_sec", rate), ("ratio", ratio)]);
    println!("median: recording {rate:.0} MB/s, ratio {ratio:.2}");
    for share in [0.8, 0.9] {
        let (n, n_refused) = paced(folder, &message, share * rate)?;
        println!(
            "at {share} of that for {PACED_SECS} s: {n_refused} of {n} messages found the queue full"
        );
    }
    Ok(())
}

/// How long messages are offered at a rate.
const PACED_SECS: u64 = 10;
/// The program's default.
const QUEUE_BYTES: usize = 256 << 20;

/// Offers messages at a rate to the recorder's own queue and writer; how many, and how many did not
/// fit.
fn paced(folder: &Path, message: &[u8], megabytes_per_sec: f64) -> anyhow::Result<(u64, u64)> {
    let path = folder.join("paced.mcap");
    let files = Files::create(&path, ChunkCompression::None, Split::default())?;
    let (queue, _bench, outlet) = queue(QUEUE_BYTES);
    let writer = std::thread::spawn(move || run(Target::Files(Box::new(files)), outlet));
    let period = Duration::from_secs_f64(message.len() as f64 / 1e6 / megabytes_per_sec);
    let (began, mut n, mut n_refused) = (Instant::now(), 0u64, 0u64);
    while began.elapsed() < Duration::from_secs(PACED_SECS) {
        let due = began + period * n as u32;
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let mut bytes = queue.buffer(message.len());
        bytes.extend_from_slice(message);
        let batch = Batch {
            source: "bench".into(),
            sequence: n as u32,
            log_nanos: n * 1_000_000,
            publish_nanos: 0,
            entries: vec![Entry {
                topic: "/bench".into(),
                content: Content::Frame,
                bytes,
            }],
        };
        match queue.offer(Job::Batch(batch)) {
            Ok(()) => {}
            Err(Refused::Full(_)) => n_refused += 1,
            Err(Refused::Closed) => anyhow::bail!("the writer has ended"),
        }
        n += 1;
    }
    drop(queue);
    writer.join().expect("the writer does not panic")?;
    std::fs::remove_file(path)?;
    Ok((n, n_refused))
}

fn rate(n: usize, began: Instant) -> f64 {
    (n * MESSAGE_BYTES) as f64 / began.elapsed().as_secs_f64() / 1e6
}

fn raw(folder: &Path, message: &[u8], n: usize) -> anyhow::Result<f64> {
    let path = folder.join("plain.bin");
    let began = Instant::now();
    let mut file = File::create(&path)?;
    for _ in 0..n {
        file.write_all(message)?;
    }
    file.sync_all()?;
    let rate = rate(n, began);
    std::fs::remove_file(path)?;
    Ok(rate)
}

fn recorded(folder: &Path, message: Vec<u8>, n: usize) -> anyhow::Result<f64> {
    let path = folder.join("recording.mcap");
    let mut batch = Batch {
        source: "bench".into(),
        sequence: 0,
        log_nanos: 0,
        publish_nanos: 0,
        entries: vec![Entry {
            topic: "/bench".into(),
            content: Content::Frame,
            bytes: message,
        }],
    };
    let began = Instant::now();
    let mut recording = Recording::create(&path, ChunkCompression::None)?;
    for number in 0..n {
        batch.sequence = number as u32;
        batch.log_nanos = number as u64 * 50_000_000;
        recording.write(&batch)?;
    }
    recording.finish()?;
    let rate = rate(n, began);
    std::fs::remove_file(path)?;
    Ok(rate)
}
