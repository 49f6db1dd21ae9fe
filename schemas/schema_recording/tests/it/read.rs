//! Files that this crate writes, read back whole, cut off at every record, with flipped bits, with
//! lies in them, and files of others.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use bytemuck::Zeroable;
use schema_frames::document::{DOCUMENT_MAGIC, DocumentHeader};
use schema_frames::snapshot::SNAPSHOT_MAGIC;
use schema_frames::{
    ActorRecord, FrameHeader, InputRecord, Modality, ResultHeader, ResultType, SCHEMA_VERSION,
    SnapshotHeader,
};
use schema_recording::messages::{Batch, Content, Entry};
use schema_recording::read::{RecordingFile, Samples, Selection, TopicKind, What};
use schema_recording::wire::{DATA_FIELD, put_bytes};
use schema_recording::write::{ChunkCompression, Recording};

const COMPRESSIONS: [ChunkCompression; 3] = [
    ChunkCompression::None,
    ChunkCompression::Lz4,
    ChunkCompression::Zstd,
];

fn batch(nanos: u64, sequence: u32, entries: Vec<Entry>) -> Batch {
    Batch {
        source: "test".into(),
        sequence,
        log_nanos: nanos,
        publish_nanos: nanos + 7,
        entries,
    }
}

fn entry(topic: &str, content: Content, fields: &[(u32, &[u8])]) -> Entry {
    let mut bytes = Vec::new();
    for (number, value) in fields {
        put_bytes(&mut bytes, *number, value);
    }
    Entry {
        topic: topic.into(),
        content,
        bytes,
    }
}

fn frame_header(modality: Modality, n: u32, tick: u64) -> FrameHeader {
    let mut header = FrameHeader::new(modality);
    header.set_list(n);
    (header.tick, header.sim_nanos, header.seq) = (tick, tick * 1000, tick);
    header
}

/// The pixels of a tick, which do not compress.
fn pixels(n: u32, tick: u64) -> Vec<u8> {
    let mut rng = fastrand::Rng::with_seed(tick);
    (0..n * 4).map(|_| rng.u8(..)).collect()
}

fn rgb(tick: u64, n: u32) -> Batch {
    let header = frame_header(Modality::Rgb, n, tick);
    let lossless: &[(u32, &[u8])] = &[(4, bytemuck::bytes_of(&header)), (6, b"/ego/front/rgb")];
    let pixels = pixels(n, tick);
    let shown: &[(u32, &[u8])] = &[(2, b"ego/front"), (DATA_FIELD, &pixels)];
    let entries = vec![
        entry("/ego/front/rgb/gantry", Content::Frame, lossless),
        entry("/ego/front/rgb", Content::RawImage, shown),
    ];
    batch(tick * 1000, tick as u32, entries)
}

fn imu(tick: u64) -> Batch {
    let header = frame_header(Modality::Imu, 1, tick);
    let lossless: &[(u32, &[u8])] = &[(4, bytemuck::bytes_of(&header)), (5, &[tick as u8; 72])];
    let entries = vec![
        entry("/ego/imu/imu/gantry", Content::Frame, lossless),
        entry("/ego/imu/imu", Content::Imu, &[(2, b"ego/imu")]),
    ];
    batch(tick * 1000, tick as u32, entries)
}

fn snapshot(tick: u64, n_actors: u32) -> Batch {
    let header = SnapshotHeader {
        magic: SNAPSHOT_MAGIC,
        schema_version: SCHEMA_VERSION,
        tick,
        n_actors,
        ..Zeroable::zeroed()
    };
    let record = ActorRecord {
        id: 7,
        ..Zeroable::zeroed()
    };
    let records = vec![record; n_actors as usize];
    let fields: &[(u32, &[u8])] = &[
        (3, bytemuck::bytes_of(&header)),
        (4, bytemuck::cast_slice(&records)),
    ];
    let entries = vec![
        entry("/world/snapshot", Content::Snapshot, fields),
        entry("/tf", Content::FrameTransforms, &[]),
    ];
    batch(tick * 1000, tick as u32, entries)
}

fn document(topic: &str, nanos: u64, revision: u64, text: &str) -> Batch {
    let header = DocumentHeader {
        magic: DOCUMENT_MAGIC,
        schema_version: SCHEMA_VERSION,
        revision,
        payload_bytes: text.len() as u64,
        ..Zeroable::zeroed()
    };
    let fields: &[(u32, &[u8])] = &[(3, bytemuck::bytes_of(&header)), (4, text.as_bytes())];
    let entries = vec![entry(topic, Content::Document, fields)];
    batch(nanos, revision as u32, entries)
}

fn text_result(tick: u64) -> Batch {
    let mut header = ResultHeader::new(ResultType::Text);
    header.set_list(5, 1, 0);
    header.n_inputs = 1;
    header.payload_bytes = ResultHeader::payload_for(5, 1);
    (header.tick, header.seq) = (tick, tick);
    let input = InputRecord::new("ego/front/rgb");
    let fields: &[(u32, &[u8])] = &[
        (4, bytemuck::bytes_of(&header)),
        (5, b"hello"),
        (7, bytemuck::bytes_of(&input)),
    ];
    let entries = vec![entry("/planner/say/gantry", Content::Result, fields)];
    batch(tick * 1000, tick as u32, entries)
}

/// Ten ticks of everything.
fn write(path: &Path, compression: ChunkCompression, n_pixels: u32) {
    let _ = std::fs::remove_file(path);
    let mut file = Recording::create(path, compression).unwrap();
    let version = SCHEMA_VERSION.to_string();
    let about = BTreeMap::from([("schema_version".to_string(), version)]);
    file.metadata("gantry", &about).unwrap();
    file.attach("Town01.xodr", "application/xml", b"<OpenDRIVE/>", 0)
        .unwrap();
    file.write(&document("/world/info", 1000, 1, "first"))
        .unwrap();
    file.write(&document("/world/map", 1000, 1, "map")).unwrap();
    for tick in 1..=10 {
        file.write(&snapshot(tick, 3)).unwrap();
        file.write(&imu(tick)).unwrap();
        file.write(&rgb(tick, n_pixels)).unwrap();
        file.write(&text_result(tick)).unwrap();
        if tick == 6 {
            file.write(&document("/world/info", 6000, 2, "second"))
                .unwrap();
        }
    }
    file.finish().unwrap();
}

/// One line per sample, payloads as checksums.
fn lines(samples: &mut Samples) -> Vec<String> {
    let mut lines = Vec::new();
    while let Some(sample) = samples.next().unwrap() {
        let what = match sample.what {
            What::Frame {
                topic,
                header,
                mut payload,
            } => {
                let bytes = payload.to_vec().unwrap();
                format!("{topic} {} {:08x}", header.tick, crc32fast::hash(&bytes))
            }
            What::Snapshot { header, records } => {
                assert!(records.iter().all(|record| record.id == 7));
                format!("snapshot {} {}", header.tick, records.len())
            }
            What::Document { topic, text, .. } => format!("{topic} {text}"),
            What::Result {
                topic,
                header,
                mut body,
                inputs,
            } => {
                let text = String::from_utf8(body.to_vec().unwrap()).unwrap();
                format!("{topic} {} {text} from {}", header.tick, inputs[0].topic())
            }
            What::Journal { text } => format!("journal {text}"),
            What::Foreign {
                topic,
                schema,
                encoding,
                bytes,
            } => format!("{topic} {schema} {encoding} {}", bytes.len()),
        };
        lines.push(format!("{} {what}", sample.log_nanos));
    }
    lines
}

fn expected(n_pixels: u32) -> Vec<String> {
    let mut lines = vec!["1000 world/info first".into(), "1000 world/map map".into()];
    for tick in 1..=10u64 {
        let nanos = tick * 1000;
        let crc = crc32fast::hash;
        let (imu, rgb) = (crc(&[tick as u8; 72]), crc(&pixels(n_pixels, tick)));
        lines.push(format!("{nanos} snapshot {tick} 3"));
        lines.push(format!("{nanos} ego/imu/imu {tick} {imu:08x}"));
        lines.push(format!("{nanos} ego/front/rgb {tick} {rgb:08x}"));
        lines.push(format!(
            "{nanos} planner/say {tick} hello from ego/front/rgb"
        ));
        if tick == 6 {
            lines.push("6000 world/info second".into());
        }
    }
    lines
}

#[test]
fn everything_that_was_written_is_read_back() {
    let folder = tempfile::tempdir().unwrap();
    for compression in COMPRESSIONS {
        let path = folder.path().join(format!("{compression:?}.mcap"));
        write(&path, compression, 300_000);
        let file = RecordingFile::open(&path).unwrap();
        assert!(file.is_complete() && file.is_gantry() && file.walked_because().is_none());
        assert_eq!(file.span(), Some((1000, 10_000)));
        let map = file.attachment("Town01.xodr").unwrap().unwrap();
        assert_eq!(map, b"<OpenDRIVE/>");
        assert_eq!(file.attachment("none").unwrap(), None);
        let names: Vec<_> = file
            .topics()
            .iter()
            .map(|topic| (topic.kind, &*topic.name, topic.n_messages))
            .collect();
        assert_eq!(
            names,
            [
                (TopicKind::Frame, "ego/front/rgb", Some(10)),
                (TopicKind::Frame, "ego/imu/imu", Some(10)),
                (TopicKind::Result, "planner/say", Some(10)),
                (TopicKind::Snapshot, "world/snapshot", Some(10)),
                (TopicKind::Document, "world/info", Some(2)),
                (TopicKind::Document, "world/map", Some(1)),
                (TopicKind::Derived, "ego/front/rgb", Some(10)),
                (TopicKind::Derived, "ego/imu/imu", Some(10)),
                (TopicKind::Derived, "tf", Some(10)),
            ]
        );
        let mut samples = file.samples(&Selection::default());
        assert_eq!(lines(&mut samples), expected(300_000));
        assert_eq!(samples.damage().total(), 0);
        let mut ahead = file.samples(&Selection::default()).read_ahead(3);
        assert_eq!(lines(&mut ahead), expected(300_000));
        ahead.skip_to(4000);
        assert_eq!(lines(&mut ahead)[0], "4000 snapshot 4 3");
    }
}

#[test]
fn a_selection_is_read_and_no_more() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    write(&path, ChunkCompression::Lz4, 300_000);
    let file = RecordingFile::open(&path).unwrap();
    let part = |from_nanos: u64, to_nanos: u64, topic: &str| {
        let selection = Selection {
            from_nanos,
            to_nanos,
            topics: vec![topic.to_string()],
        };
        lines(&mut file.samples(&selection))
    };
    let all = expected(300_000);
    let of = |name: &str, nanos: std::ops::Range<u64>| -> Vec<String> {
        let chosen = |line: &&String| {
            let at: u64 = line.split(' ').next().unwrap().parse().unwrap();
            let by_name = line.contains(name) || line.contains("snapshot");
            nanos.contains(&at) && (by_name || line.contains("world/"))
        };
        all.iter().filter(chosen).cloned().collect()
    };
    assert_eq!(part(3000, 5000, "ego/imu/*"), of("ego/imu/imu", 3000..5000));
    assert_eq!(part(0, u64::MAX, "*/rgb"), of("/rgb ", 0..u64::MAX));
    let mut only = file.samples_of((0, u64::MAX), |topic| topic.kind == TopicKind::Result);
    assert_eq!(lines(&mut only).len(), 10);
    // Back and forth.
    only.skip_to(9000);
    assert_eq!(lines(&mut only).len(), 2);
    only.skip_to(2000);
    assert_eq!(lines(&mut only).len(), 9);
    // To a place, also between a frame and its pixels.
    let mut samples = file.samples(&Selection::default());
    let mut marks = Vec::new();
    loop {
        marks.push(samples.mark());
        if samples.next().unwrap().is_none() {
            break;
        }
    }
    for (n, mark) in marks.iter().enumerate().rev() {
        samples.back_to(mark).unwrap();
        assert_eq!(lines(&mut samples), all[n..], "{n}");
    }
    assert_eq!(samples.damage().total(), 0);
    // Documents that hold at a time.
    let at = |nanos| -> Vec<String> {
        let found = file.documents_at(nanos).unwrap();
        found.into_iter().map(|found| found.text).collect()
    };
    assert_eq!(at(0), [""; 0]);
    assert_eq!(at(5999), ["first", "map"]);
    assert_eq!(at(6000), ["second", "map"]);
    // The first of a topic.
    let mut topics = file.topics().iter();
    let topic = topics.find(|topic| &*topic.name == "planner/say");
    let first = lines(&mut file.first_of(topic.unwrap()));
    assert_eq!(first.len(), 10);
}

#[test]
fn a_payload_in_the_next_chunk_is_found() {
    let folder = tempfile::tempdir().unwrap();
    for compression in COMPRESSIONS {
        let path = folder.path().join(format!("{compression:?}.mcap"));
        let mut file = Recording::create(&path, compression).unwrap();
        // The text leaves less room in the chunk than the frame's own message needs.
        let text = "x".repeat((4 << 20) - 400);
        file.write(&document("/world/map", 1000, 1, &text)).unwrap();
        file.write(&rgb(1, 100)).unwrap();
        file.finish().unwrap();
        let file = RecordingFile::open(&path).unwrap();
        let mut samples = file.samples(&Selection::default());
        let found = lines(&mut samples);
        assert_eq!(found.len(), 2, "{compression:?} {:?}", samples.damage());
        let crc = format!("{:08x}", crc32fast::hash(&pixels(100, 1)));
        assert!(found[1].ends_with(&crc));
    }
}

#[test]
fn a_missing_payload_is_counted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut file = Recording::create(&path, ChunkCompression::Lz4).unwrap();
    let mut lonely = rgb(1, 100);
    lonely.entries.pop();
    file.write(&lonely).unwrap();
    file.write(&rgb(2, 100)).unwrap();
    file.finish().unwrap();
    let file = RecordingFile::open(&path).unwrap();
    let mut samples = file.samples(&Selection::default());
    assert_eq!(lines(&mut samples).len(), 1);
    assert_eq!(samples.damage().counts(), &BTreeMap::from([("payload", 1)]));
    let said = &samples.damage().sentences()[0];
    assert!(
        said.contains("ego/front/rgb") && said.contains("0.000001 s"),
        "{said}"
    );
}

/// Starts of all records of a file, and its length.
fn borders(bytes: &[u8]) -> Vec<usize> {
    let mut at = 8;
    let mut borders = vec![8];
    while at + 9 <= bytes.len() {
        at += 9 + u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        borders.push(at.min(bytes.len()));
    }
    borders
}

/// Starts of the chunk records.
fn chunks(bytes: &[u8]) -> Vec<usize> {
    let is_chunk = |at: &usize| bytes.get(*at) == Some(&6);
    borders(bytes).into_iter().filter(is_chunk).collect()
}

#[test]
fn a_file_that_is_cut_off_anywhere_gives_what_is_whole() {
    let folder = tempfile::tempdir().unwrap();
    for compression in COMPRESSIONS {
        let path = folder.path().join(format!("{compression:?}.mcap"));
        write(&path, compression, 150_000);
        let whole = std::fs::read(&path).unwrap();
        let all = expected(150_000);
        let mut most = 0;
        for border in borders(&whole) {
            for cut in [border.saturating_sub(1), border, border + 5] {
                if cut > whole.len() || cut < 8 {
                    continue;
                }
                let part = folder.path().join("part.mcap");
                std::fs::write(&part, &whole[..cut]).unwrap();
                let file = RecordingFile::open(&part).unwrap();
                assert_eq!(file.is_complete(), cut == whole.len());
                assert_eq!(file.walked_because().is_none(), cut == whole.len());
                let mut samples = file.samples(&Selection::default());
                let found = lines(&mut samples);
                assert_eq!(found[..], all[..found.len()], "cut at {cut}");
                let whole_chunks = chunks(&whole)
                    .into_iter()
                    .filter(|at| {
                        borders(&whole)
                            .into_iter()
                            .any(|end| end > *at && end <= cut)
                    })
                    .count();
                assert_eq!(whole_chunks > 0, !found.is_empty(), "cut at {cut}");
                assert!(found.len() >= most, "a longer file holds no less");
                most = found.len();
            }
        }
        assert_eq!(most, all.len());
    }
}

#[test]
fn a_summary_that_lies_is_not_used() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    write(&path, ChunkCompression::Lz4, 60_000);
    let whole = std::fs::read(&path).unwrap();
    let footer = whole.len() - 8 - 20;
    let start = u64::from_le_bytes(whole[footer..footer + 8].try_into().unwrap());
    for (at, value) in [
        (footer, 7u64),
        (footer, u64::MAX),
        (footer, start + 1),
        (footer + 12, 3 << 32),
        (start as usize + 20, u64::MAX),
    ] {
        let mut bytes = whole.clone();
        bytes[at..at + 8].copy_from_slice(&value.to_le_bytes());
        std::fs::write(&path, &bytes).unwrap();
        let file = RecordingFile::open(&path).unwrap();
        assert!(file.walked_because().is_some(), "{at} {value}");
        let found = lines(&mut file.samples(&Selection::default()));
        assert_eq!(found, expected(60_000), "{at} {value}");
        assert_eq!(file.attachment_names(), ["Town01.xodr"]);
    }
}

#[test]
fn flipped_bits_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    let mut rng = fastrand::Rng::with_seed(14);
    for compression in COMPRESSIONS {
        let path = folder.path().join(format!("{compression:?}.mcap"));
        write(&path, compression, 500);
        let whole = std::fs::read(&path).unwrap();
        for _ in 0..600 {
            let mut bytes = whole.clone();
            for _ in 0..rng.usize(1..4) {
                let at = rng.usize(..bytes.len());
                bytes[at] ^= 1 << rng.u8(..8);
            }
            if rng.u8(..4) == 0 {
                bytes.truncate(rng.usize(..bytes.len()));
            }
            std::fs::write(&path, &bytes).unwrap();
            let Ok(file) = RecordingFile::open(&path) else {
                continue;
            };
            let _ = (file.attachment("Town01.xodr"), file.documents_at(5000));
            let mut samples = file.samples(&Selection::default());
            while let Some(sample) = samples.next().unwrap() {
                match sample.what {
                    What::Frame { mut payload, .. } => drop(payload.to_vec()),
                    What::Result { mut body, .. } => drop(body.to_vec()),
                    _ => {}
                }
            }
        }
    }
}

#[test]
fn a_damaged_chunk_costs_only_itself() {
    let folder = tempfile::tempdir().unwrap();
    for compression in [ChunkCompression::Lz4, ChunkCompression::Zstd] {
        let path = folder.path().join(format!("{compression:?}.mcap"));
        write(&path, compression, 300_000);
        let mut bytes = std::fs::read(&path).unwrap();
        let chunks = chunks(&bytes);
        assert!(chunks.len() >= 3, "{}", chunks.len());
        bytes[chunks[1] + 5000] ^= 1;
        std::fs::write(&path, &bytes).unwrap();
        let file = RecordingFile::open(&path).unwrap();
        let mut samples = file.samples(&Selection::default()).read_ahead(2);
        let n = lines(&mut samples).len();
        assert!(n > 20 && n < expected(1).len(), "{n}");
        assert_eq!(samples.damage().counts()["chunk"], 1);
    }
}

#[test]
fn the_checksum_of_an_uncompressed_chunk_is_compared_when_all_was_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    write(&path, ChunkCompression::None, 300_000);
    let mut bytes = std::fs::read(&path).unwrap();
    // Inside the first image.
    let inside = chunks(&bytes)[0] + 500_000;
    bytes[inside] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    let file = RecordingFile::open(&path).unwrap();
    let mut samples = file.samples(&Selection::default());
    assert_eq!(lines(&mut samples).len(), expected(1).len());
    let counted = BTreeMap::from([("checksum", 1)]);
    assert_eq!(samples.damage().counts(), &counted);
}

#[test]
fn a_chunk_that_claims_a_gigabyte_is_refused_and_the_rest_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    write(&path, ChunkCompression::Zstd, 300_000);
    let mut bytes = std::fs::read(&path).unwrap();
    let claim = chunks(&bytes)[0] + 25;
    bytes[claim..claim + 8].copy_from_slice(&(1u64 << 30).to_le_bytes());
    std::fs::write(&path, &bytes).unwrap();
    let file = RecordingFile::open(&path).unwrap();
    let mut samples = file.samples(&Selection::default());
    assert!(lines(&mut samples).len() > 10);
    let said = &samples.damage().sentences()[0];
    assert!(said.contains("claims 1073741824 bytes"), "{said}");
}

#[test]
fn headers_that_do_not_fit_what_is_there_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut file = Recording::create(&path, ChunkCompression::Lz4).unwrap();
    let frame = |header: &FrameHeader, payload: &[u8], codec: &[u8]| {
        let header = bytemuck::bytes_of(header);
        let fields: &[(u32, &[u8])] = &[(4, header), (5, payload), (7, codec)];
        batch(1, 1, vec![entry("/a/b/imu/gantry", Content::Frame, fields)])
    };
    let good = frame_header(Modality::Imu, 1, 1);
    let wrong = FrameHeader { magic: 1, ..good };
    let newer = FrameHeader {
        schema_version: 2,
        ..good
    };
    let longer = FrameHeader {
        payload_bytes: 1 << 40,
        ..good
    };
    file.write(&frame(&good, &[0; 72], b"")).unwrap();
    file.write(&frame(&wrong, &[0; 72], b"")).unwrap();
    file.write(&frame(&newer, &[0; 72], b"")).unwrap();
    file.write(&frame(&good, &[0; 71], b"")).unwrap();
    file.write(&frame(&longer, &[0; 72], b"rle")).unwrap();
    file.write(&frame(&good, &[0; 3], b"no such codec"))
        .unwrap();
    let mut short = snapshot(1, 3);
    short.entries[0].bytes.truncate(400);
    file.write(&short).unwrap();
    file.finish().unwrap();
    let file = RecordingFile::open(&path).unwrap();
    let mut samples = file.samples(&Selection::default());
    let mut n = 0;
    while let Some(sample) = samples.next().unwrap() {
        let What::Frame { mut payload, .. } = sample.what else {
            panic!("{sample:?}")
        };
        n += 1;
        assert_eq!(payload.to_vec().is_ok(), payload.codec().is_empty());
        assert!(payload.read_into(&mut [0; 3]).is_err());
    }
    assert_eq!(n, 2);
    assert_eq!(samples.damage().counts(), &BTreeMap::from([("header", 5)]));
}

#[test]
fn files_of_others_are_told_in_sentences_or_read_as_foreign() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let said = |path: &Path| format!("{:#}", RecordingFile::open(path).unwrap_err());
    assert!(said(&path).contains("cannot open"));
    assert!(said(folder.path()).contains("it is a folder, not a file"));
    std::fs::write(&path, b"").unwrap();
    assert!(said(&path).contains("is empty"));
    std::fs::write(&path, b"ID3 some music").unwrap();
    assert!(said(&path).contains("is not an MCAP file"));
    // Only the magic: nothing was written yet.
    std::fs::write(&path, mcap::MAGIC).unwrap();
    let file = RecordingFile::open(&path).unwrap();
    assert_eq!((file.topics().len(), file.span()), (0, None));
    // Messages outside of chunks.
    let out = std::io::BufWriter::new(std::fs::File::create(&path).unwrap());
    let options = mcap::WriteOptions::new().use_chunks(false);
    let mut writer = options.create(out).unwrap();
    let schema = writer.add_schema("sensor_msgs/msg/Imu", "ros2msg", b"...");
    let none = BTreeMap::new();
    let channel = writer.add_channel(schema.unwrap(), "/imu", "cdr", &none);
    let channel_id = channel.unwrap();
    for sequence in 0..5u32 {
        let header = mcap::records::MessageHeader {
            channel_id,
            sequence,
            log_time: 100 + u64::from(sequence),
            publish_time: 0,
        };
        writer
            .write_to_known_channel(&header, &[sequence as u8; 10])
            .unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    let file = RecordingFile::open(&path).unwrap();
    assert!(!file.is_gantry() && file.walked_because().is_some());
    assert_eq!(file.topics()[0].schema_encoding, "ros2msg");
    let found = lines(&mut file.samples(&Selection::default()));
    assert_eq!(found.len(), 5);
    assert_eq!(found[4], "104 imu sensor_msgs/msg/Imu cdr 10");
}

#[test]
fn a_recording_of_a_newer_schema_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut file = Recording::create(&path, ChunkCompression::Lz4).unwrap();
    let about = [("schema_version", "9"), ("recorder", "gantry-record 7.0")]
        .map(|(key, value)| (key.to_string(), value.to_string()));
    file.metadata("gantry", &about.into()).unwrap();
    file.finish().unwrap();
    let said = RecordingFile::open(&path).unwrap_err().to_string();
    assert!(
        said.contains("schema 9") && said.contains("gantry-record 7.0"),
        "{said}"
    );
}

#[test]
fn samples_can_be_read_on_another_thread() {
    fn is_send<T: Send>() {}
    is_send::<Samples>();
    is_send::<Arc<RecordingFile>>();
}
