//! Size and processor time of ways to store payloads losslessly, on frames of a recording that was
//! made with `--codec none`: `cargo run --release --example codecs -- drive.mcap [FRAMES]`.

use std::collections::BTreeMap;
use std::hint::black_box;
use std::path::PathBuf;
use std::process::ExitCode;

use consumer_forms::foxglove::frames::TopicName;
use consumer_record::coder::FrameCoder;
use consumer_record::options::Coding;
use launch_cli::bench::{self, BenchResult, Samples, clap, thread_cpu_secs};
use schema_frames::{FrameHeader, Modality};
use schema_recording::codec::{Encoder, decode};
use schema_recording::messages::Entry;
use schema_recording::read::{RecordingFile, Selection, What};

type Frame = (FrameHeader, Vec<u8>);
/// Codes a frame; the size.
type Work<'a> = &'a mut dyn FnMut(&Frame) -> usize;

/// Frames of a topic that are measured, unless told otherwise; spread over the recording.
const N_FRAMES: usize = 12;
/// Times that each is coded.
const N_TURNS: usize = 3;

/// Sizes and times of ways to store payloads
#[derive(Debug, clap::Args)]
struct Args {
    /// The recording
    recording: PathBuf,
    /// Frames of a topic
    #[arg(default_value_t = N_FRAMES)]
    frames: usize,
}

fn main() -> ExitCode {
    bench::run("codecs", |args: &Args, result| {
        for (topic, frames) in frames(&args.recording, args.frames)? {
            println!("\n{topic}, {} frames", frames.len());
            measure(&topic, &frames, result)?;
        }
        Ok(())
    })
}

/// Some frames of each topic.
fn frames(path: &std::path::Path, wanted: usize) -> anyhow::Result<BTreeMap<String, Vec<Frame>>> {
    let file = RecordingFile::open(path)?;
    let n_of = |name: &str| {
        let topic = file.topics().iter().find(|topic| &*topic.name == name);
        topic.and_then(|topic| topic.n_messages).unwrap_or(0) as usize
    };
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    let mut found: BTreeMap<String, Vec<Frame>> = BTreeMap::new();
    let mut samples = file.samples(&Selection::default());
    while let Some(sample) = samples.next()? {
        let What::Frame {
            topic,
            header,
            mut payload,
        } = sample.what
        else {
            continue;
        };
        let n = seen.entry(topic.to_string()).or_insert(0);
        *n += 1;
        let step = (n_of(topic) / wanted).max(1);
        if payload.len() > 4096 && n.is_multiple_of(step) {
            let bytes = payload.to_vec()?;
            let of = found.entry(topic.to_string()).or_default();
            of.push((header, bytes));
        }
    }
    Ok(found)
}

fn measure(topic: &str, frames: &[Frame], result: &mut BenchResult) -> anyhow::Result<()> {
    let mut row = |way: &str, work: Work<'_>| {
        let raw: usize = frames.iter().map(|frame| frame.1.len()).sum();
        let mut n_bytes = 0;
        let secs = Samples::of(N_TURNS, || {
            let began = thread_cpu_secs();
            n_bytes = frames.iter().map(|frame| black_box(work(frame))).sum();
            thread_cpu_secs() - began
        });
        let (n, secs) = (frames.len() as f64, secs.best());
        let figures = [("bytes", n_bytes as f64 / n), ("ms", secs / n * 1e3)];
        result.row(&format!("{topic}: {}", way.trim()), &figures);
        println!(
            "  {way:20} {:8.1} kB of {:7.1} {:6.1} % {:8.2} ms {:7.0} MB/s",
            n_bytes as f64 / n / 1e3,
            raw as f64 / n / 1e3,
            100.0 * n_bytes as f64 / raw as f64,
            secs / n * 1e3,
            raw as f64 / secs / 1e6
        );
    };
    row("copy", &mut |frame| black_box(frame.1.clone()).len());
    row("lz4", &mut |frame| {
        lz4::block::compress(&frame.1, None, false).map_or(0, |it| it.len())
    });
    for level in [1, 3] {
        let mut zstd = zstd::bulk::Compressor::new(level)?;
        row(&format!("zstd {level}"), &mut |frame| {
            zstd.compress(&frame.1).map_or(0, |it| it.len())
        });
    }
    if frames[0].0.modality() == Some(Modality::Rgb) {
        pictures(&mut row);
    }
    for level in [-3, 3] {
        let mut encoder = Encoder::with_level(level)?;
        row(&format!("codec, zstd {level}"), &mut |frame| {
            let coded = encoder.encode(&frame.0, &frame.1);
            coded.map_or(frame.1.len(), |(_, bytes)| bytes.len())
        });
    }
    let mut encoder = Encoder::new()?;
    let coded: Vec<(&str, Vec<u8>)> = frames
        .iter()
        .map(|frame| match encoder.encode(&frame.0, &frame.1) {
            Some((codec, bytes)) => (codec, bytes.to_vec()),
            None => ("", frame.1.clone()),
        })
        .collect();
    let name = coded[0].0;
    row(&format!("codec: {name}"), &mut |frame| {
        let coded = encoder.encode(&frame.0, &frame.1);
        coded.map_or(frame.1.len(), |(_, bytes)| bytes.len())
    });
    let mut out = Vec::new();
    let mut next = coded.iter().cycle();
    row("  decoded", &mut |frame| {
        let Some((codec, bytes)) = next.next() else {
            return 0;
        };
        out.resize(frame.1.len(), 0);
        decode(codec, &frame.0, bytes, &mut out).expect("what was coded is decoded");
        assert!(out == frame.1, "the payload comes back");
        bytes.len()
    });
    Ok(())
}

/// Ways of PNG.
fn pictures(row: &mut dyn FnMut(&str, Work<'_>)) {
    use png::{Compression, Filter};
    let ways = [
        ("png up", Compression::Fastest, Some(Filter::Up)),
        ("png sub", Compression::Fastest, Some(Filter::Sub)),
        ("png paeth", Compression::Fastest, Some(Filter::Paeth)),
        ("png fast", Compression::Fast, None),
        ("png balanced", Compression::Balanced, None),
    ];
    for (way, compression, filter) in ways {
        row(way, &mut |(header, payload)| {
            let pixels: Vec<u8> = payload
                .chunks_exact(4)
                .flat_map(|bgra| [bgra[2], bgra[1], bgra[0]])
                .collect();
            let mut file = Vec::new();
            let mut encoder = png::Encoder::new(&mut file, header.width, header.height);
            encoder.set_color(png::ColorType::Rgb);
            encoder.set_compression(compression);
            if let Some(filter) = filter {
                encoder.set_filter(filter);
            }
            let written = encoder
                .write_header()
                .and_then(|mut writer| writer.write_image_data(&pixels));
            written.map_or(0, |()| file.len())
        });
    }
    lossy(row);
}

/// What `--jpeg 90` and `--video h264` make of colour.
fn lossy(row: &mut dyn FnMut(&str, Work<'_>)) {
    let coder = |coding| FrameCoder::new(coding).expect("codecs");
    let name = TopicName::new("ego/front/rgb").expect("a topic of colour");
    let bytes_of = |entries: Vec<Entry>| entries.iter().map(|it| it.bytes.len()).sum();
    let mut jpeg = coder(Coding {
        jpeg_quality: Some(90),
        ..Coding::default()
    });
    row("jpeg 90", &mut |(header, payload)| {
        bytes_of(jpeg.entries(&name, header, payload, &mut Vec::with_capacity))
    });
    for qp in [18, 23, 28] {
        let mut video = coder(Coding {
            video_qp: Some(qp),
            ..Coding::default()
        });
        row(&format!("h264 {qp}"), &mut |(header, payload)| {
            bytes_of(video.entries(&name, header, payload, &mut Vec::with_capacity))
        });
    }
}
