//! Colour as video: an independent decoder shows what was recorded, and every file begins with key
//! frames.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use consumer_forms::foxglove::frames::TopicName;
use consumer_record::files::Files;
use consumer_record::options::{self, Coding, Split};
use consumer_record::queue::{FrameJob, Job, Payload, queue};
use consumer_record::ring::Ring;
use consumer_record::writer::{Target, run, start_coders};
use foxglove::Decode as _;
use foxglove::messages::CompressedVideo;
use schema_frames::{FrameHeader, Modality};
use schema_recording::messages::Batch;
use schema_recording::read::{RecordingFile, Selection, What};
use schema_recording::write::ChunkCompression;

/// Topics, their sizes and times between frames: even and odd, one slower, one too small for video.
const TOPICS: [(&str, [u32; 2], u64); 3] = [
    ("ego/front/rgb", [162, 122], 50_000_000),
    ("ego/rear/rgb", [161, 121], 150_000_000),
    ("ego/tiny/rgb", [12, 10], 50_000_000),
];
/// As far as every recording goes, nanoseconds.
const END_NANOS: u64 = 3_500_000_000;

/// A shaded picture on which a square moves.
fn picture(topic: usize, nanos: u64) -> (FrameHeader, Vec<u8>) {
    let [width, height] = TOPICS[topic].1;
    let mut header = FrameHeader::new(Modality::Rgb);
    header.set_image(width, height);
    header.sim_nanos = nanos;
    header.tick = nanos / 50_000_000;
    header.seq = nanos / TOPICS[topic].2;
    header.epoch = 1;
    let shift = (nanos / 25_000_000) as u32;
    let pixels = (0..height).flat_map(|y| {
        (0..width).flat_map(move |x| {
            let is_square = (x + width - shift % width) % width < 30 && (20..50).contains(&y);
            match is_square {
                true => [40, 180, 220, 255],
                false => [x as u8, 60 + y as u8, 200 - (x + y) as u8 / 2, 255],
            }
        })
    });
    (header, pixels.collect())
}

/// Records all topics through the real threads; what each of them had, in order.
fn recorded(target: Target, coding: Coding) -> Vec<PathBuf> {
    let (queue, bench, outlet) = queue(64 << 20);
    start_coders(&bench, coding).unwrap();
    let writer = std::thread::spawn(move || run(target, outlet));
    for nanos in (0..END_NANOS).step_by(50_000_000) {
        for (number, (topic, _, every)) in TOPICS.iter().enumerate() {
            if nanos % every != 0 {
                continue;
            }
            let (header, payload) = picture(number, nanos);
            let batch = Batch {
                source: (*topic).into(),
                sequence: header.seq as u32,
                log_nanos: nanos,
                publish_nanos: nanos,
                entries: Vec::new(),
            };
            let name = TopicName::new(topic).unwrap().into();
            let job = FrameJob {
                batch,
                name,
                header,
                payload: Payload::Copied(payload),
            };
            queue.push(Job::Frame(Box::new(job))).unwrap();
        }
    }
    drop((queue, bench));
    let written = writer.join().unwrap().unwrap();
    written.into_iter().map(|(path, _)| path).collect()
}

fn files(path: &Path, split: Split, coding: Coding) -> Vec<PathBuf> {
    let files = Files::create(path, ChunkCompression::Lz4, split).unwrap();
    let files = files.on_seconds(coding.video_qp.is_some());
    recorded(Target::Files(Box::new(files)), coding)
}

fn video() -> Coding {
    Coding {
        video_qp: Some(23),
        n_threads: 3,
        ..Coding::default()
    }
}

/// Time and access unit of each frame of video by topic.
fn videos(path: &Path) -> BTreeMap<String, Vec<(u64, Vec<u8>)>> {
    let bytes = std::fs::read(path).unwrap();
    let mut found: BTreeMap<String, Vec<_>> = BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let schema = message.channel.schema.as_ref().unwrap();
        if schema.name == "foxglove.CompressedVideo" {
            let video = CompressedVideo::decode(&*message.data).unwrap();
            assert_eq!(video.format, "h264");
            let topic = message.channel.topic.trim_start_matches('/').to_string();
            let frames = found.entry(topic).or_default();
            frames.push((message.log_time, video.data.to_vec()));
        }
    }
    found
}

/// Whether an access unit is a key frame with its parameter sets, else one that is none.
fn is_key(unit: &[u8]) -> bool {
    assert_eq!(unit[..4], [0, 0, 0, 1], "Annex B");
    let starts = unit.windows(4).filter(|four| four[..3] == [0, 0, 1]);
    let types: Vec<u8> = starts.map(|four| four[3] & 31).collect();
    match types.as_slice() {
        [7, 8, 5] => true,
        [1] => false,
        other => panic!("units {other:?}"),
    }
}

/// Payloads of a topic that are kept, and the codecs of those that are not.
fn payloads(path: &Path, wanted: &str) -> (Vec<Vec<u8>>, usize) {
    let file = RecordingFile::open(path).unwrap();
    let mut samples = file.samples(&Selection::default());
    let (mut kept, mut n_refused) = (Vec::new(), 0);
    while let Some(sample) = samples.next().unwrap() {
        if let What::Frame {
            topic, mut payload, ..
        } = sample.what
            && &**topic == wanted
        {
            match payload.to_vec() {
                Ok(bytes) => kept.push(bytes),
                Err(error) => {
                    assert!(error.to_string().contains("h264"), "{error}");
                    n_refused += 1;
                }
            }
        }
    }
    (kept, n_refused)
}

#[test]
fn ffmpeg_shows_what_was_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let lossless = files(
        &folder.path().join("lossless.mcap"),
        Split::default(),
        Coding::default(),
    );
    let small = files(&folder.path().join("v.mcap"), Split::default(), video());
    let videos = videos(&small[0]);
    assert_eq!(videos.len(), 2);
    for (topic, [width, height], every) in &TOPICS[..2] {
        let (pictures, _) = payloads(&lossless[0], topic);
        let frames = &videos[*topic];
        assert_eq!(frames.len() as u64, END_NANOS.div_ceil(*every));
        assert_eq!(payloads(&small[0], topic), (Vec::new(), frames.len()));
        let mut second = None;
        for (nanos, unit) in frames {
            let here = Some(nanos / 1_000_000_000);
            assert_eq!(is_key(unit), here != second, "{topic} at {nanos}");
            second = here;
        }
        let stream = folder.path().join("stream.h264");
        let raw = folder.path().join("raw");
        let units: Vec<&[u8]> = frames.iter().map(|(_, unit)| unit.as_slice()).collect();
        std::fs::write(&stream, units.concat()).unwrap();
        std::fs::write(&raw, pictures.concat()).unwrap();
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let output = Command::new(root.join(".venv/bin/python"))
            .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/oracle/read_video.py"))
            .args([&stream, &raw])
            .args([width.to_string(), height.to_string()])
            .output()
            .expect("Python in .venv");
        let said = String::from_utf8_lossy(&output.stdout);
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        let (n_decoded, psnr) = said.trim().split_once(' ').expect("two numbers");
        assert_eq!(n_decoded, frames.len().to_string(), "{topic}");
        println!("{topic}: worst PSNR {psnr} dB");
        assert!(psnr.parse::<f64>().unwrap() > 30.0, "{topic}: {psnr} dB");
    }
}

#[test]
fn what_is_too_small_for_video_stays_lossless() {
    let folder = tempfile::tempdir().unwrap();
    let paths = files(&folder.path().join("v.mcap"), Split::default(), video());
    let (kept, n_refused) = payloads(&paths[0], TOPICS[2].0);
    assert_eq!((kept.len(), n_refused), (70, 0));
    for (number, payload) in kept.iter().enumerate() {
        assert_eq!(*payload, picture(2, number as u64 * 50_000_000).1);
    }
}

fn assert_begins_with_key_frames(path: &Path) -> BTreeMap<String, Vec<(u64, Vec<u8>)>> {
    let videos = videos(path);
    assert_eq!(videos.len(), 2, "{}", path.display());
    for (topic, frames) in &videos {
        assert!(is_key(&frames[0].1), "{}: {topic}", path.display());
    }
    videos
}

#[test]
fn every_file_of_a_set_begins_with_key_frames() {
    let folder = tempfile::tempdir().unwrap();
    let by_time = Split {
        max_sim_nanos: Some(1_000_000_000),
        ..Split::default()
    };
    let by_size = Split {
        max_bytes: Some(1),
        ..Split::default()
    };
    for (name, split) in [("time.mcap", by_time), ("size.mcap", by_size)] {
        let paths = files(&folder.path().join(name), split, video());
        assert_eq!(paths.len(), 4, "{name}: a file a second");
        let mut n_frames = 0;
        for (number, path) in paths.iter().enumerate() {
            let frames = assert_begins_with_key_frames(path);
            n_frames += frames[TOPICS[0].0].len();
            let seconds = frames
                .values()
                .flatten()
                .map(|(nanos, _)| nanos / 1_000_000_000);
            assert!(seconds.eq(std::iter::repeat_n(
                number as u64,
                frames.values().map(Vec::len).sum()
            )));
        }
        assert_eq!(n_frames, 70);
    }
}

#[test]
fn a_ring_begins_with_key_frames() {
    let folder = tempfile::tempdir().unwrap();
    for (name, keep_nanos, max_bytes) in [
        ("time.mcap", 1_200_000_000, 1 << 30),
        // Too little for all, enough for a second.
        ("size.mcap", 100_000_000_000, 90_000),
    ] {
        let (_sender, requests) = crossbeam_channel::unbounded();
        let settings = options::Ring {
            keep_nanos,
            max_bytes,
            dump_at_end: true,
            requests: requests.clone(),
        };
        let base = folder.path().join(name);
        let ring = Ring::new(&base, ChunkCompression::Lz4, settings).on_seconds(true);
        let paths = recorded(Target::Ring(Box::new(ring), requests), video());
        let frames = &assert_begins_with_key_frames(&paths[0])[TOPICS[0].0];
        let first = frames[0].0;
        assert!(
            first > 0 && first.is_multiple_of(1_000_000_000),
            "{name}: {first}"
        );
    }
}
