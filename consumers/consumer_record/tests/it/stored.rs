//! What the recorder stores: coded payloads, sets of files, rings, and what is cut and joined of them.

use crate::sample;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use consumer_record::cat::cat;
use consumer_record::dump::DumpRequest;
use consumer_record::edit::{Cut, merge, trim};
use consumer_record::files::{Files, file_of_set};
use consumer_record::info::file_info;
use consumer_record::options::{Coding, Ring, Split};
use consumer_record::queue::{Job, queue};
use consumer_record::recover::recover_file;
use consumer_record::select::Select;
use consumer_record::writer::Target;
use consumer_record::{options, ring, writer};
use sample::{PERIOD_NANOS, SIZE_PX};
use schema_recording::read::{RecordingFile, Selection, What};
use schema_recording::write::ChunkCompression;

fn files(path: &Path, split: Split) -> Target {
    Target::Files(Box::new(
        Files::create(path, ChunkCompression::Lz4, split).unwrap(),
    ))
}

fn coded(folder: &Path, n_ticks: u64, coding: Coding) -> PathBuf {
    let path = folder.join("coded.mcap");
    sample::record_to(files(&path, Split::default()), n_ticks, coding).unwrap();
    path
}

fn schemas(path: &Path) -> BTreeMap<String, String> {
    let info = file_info(path).unwrap();
    assert!(info.complete, "{}", info.problem);
    let n_channels = info.channels.len();
    let by_topic: BTreeMap<_, _> = info
        .channels
        .into_iter()
        .map(|channel| (channel.topic, channel.schema))
        .collect();
    assert_eq!(by_topic.len(), n_channels, "one type of message a topic");
    by_topic
}

#[test]
fn coded_payloads_come_back_and_others_still_see_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let path = coded(folder.path(), 30, Coding::default());
    sample::assert_frames(&path, 1..=30);
    let schemas = schemas(&path);
    for topic in ["rgb", "depth", "semantic", "instance", "dvs"] {
        let name = format!("/ego/front/{topic}");
        assert_eq!(schemas[&name], "foxglove.CompressedImage", "{name}");
    }
    assert_eq!(schemas["/ego/roof/lidar"], "foxglove.PointCloud");
    let codecs: BTreeMap<String, Vec<String>> = file_info(&path)
        .unwrap()
        .channels
        .into_iter()
        .map(|channel| (channel.topic, channel.codecs))
        .collect();
    assert_eq!(codecs["/ego/front/rgb/gantry"], ["png"]);
    assert_eq!(codecs["/ego/front/depth/gantry"], ["planes32"]);

    // The pictures are those of other programs: an independent reader opens them.
    let bytes = std::fs::read(&path).unwrap();
    let mut n_opened = 0;
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let schema = message.channel.schema.as_ref().unwrap().name.clone();
        if schema != "foxglove.CompressedImage" {
            continue;
        }
        let picture =
            <foxglove::messages::CompressedImage as foxglove::Decode>::decode(&*message.data)
                .unwrap();
        assert_eq!(picture.format, "png");
        let decoder = png::Decoder::new(std::io::Cursor::new(&picture.data[..]));
        let mut reader = decoder.read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        let full = ["rgb", "semantic"]
            .iter()
            .any(|it| message.channel.topic.ends_with(it));
        let expected = if full {
            SIZE_PX
        } else {
            SIZE_PX.map(|px| px / 2)
        };
        assert_eq!(
            [info.width, info.height],
            expected,
            "{}",
            message.channel.topic
        );
        n_opened += 1;
    }
    assert_eq!(n_opened, 30 * 5);
}

#[test]
fn without_previews_nothing_is_stored_twice() {
    let folder = tempfile::tempdir().unwrap();
    let coding = Coding {
        previews: false,
        ..Coding::default()
    };
    let path = coded(folder.path(), 5, coding);
    sample::assert_frames(&path, 1..=5);
    let schemas = schemas(&path);
    assert!(!schemas.contains_key("/ego/front/depth") && !schemas.contains_key("/ego/front/dvs"));
    assert_eq!(schemas["/ego/front/rgb"], "foxglove.CompressedImage");
}

#[test]
fn jpeg_replaces_the_payload_of_colour_and_of_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let coding = Coding {
        jpeg_quality: Some(80),
        ..Coding::default()
    };
    let path = coded(folder.path(), 3, coding);
    let file = RecordingFile::open(&path).unwrap();
    let mut samples = file.samples(&Selection::default());
    let mut n_refused = 0;
    while let Some(sample) = samples.next().unwrap() {
        if let What::Frame {
            topic,
            header,
            mut payload,
        } = sample.what
        {
            match payload.to_vec() {
                Ok(bytes) => assert_eq!(bytes, sample::frame(topic, header.tick).1, "{topic}"),
                Err(error) => {
                    assert_eq!(&**topic, "ego/front/rgb");
                    assert!(error.to_string().contains("jpeg"), "{error}");
                    n_refused += 1;
                }
            }
        }
    }
    assert_eq!(n_refused, 3);
}

/// Documents and metadata of every file of a set, and no frame twice or missing.
#[test]
fn every_file_of_a_set_is_complete_in_itself() {
    let folder = tempfile::tempdir().unwrap();
    let base = folder.path().join("drive.mcap");
    let split = Split {
        max_sim_nanos: Some(10 * PERIOD_NANOS),
        ..Split::default()
    };
    let written = sample::record_to(files(&base, split), 35, Coding::default()).unwrap();
    let names: Vec<_> = written.iter().map(|(path, _)| path.clone()).collect();
    let expected: Vec<_> = (1..=4).map(|part| file_of_set(&base, part)).collect();
    assert_eq!(names, expected);
    // The document of tick 0 is the first thing in the set, so the first file ends at tick 9.
    let spans = [1..=9, 10..=19, 20..=29, 30..=35];
    for (number, (path, ticks)) in names.iter().zip(spans).enumerate() {
        sample::assert_frames(path, ticks.clone());
        let n_frames = sample::frames_of(path).len();
        assert_eq!(n_frames, ticks.count() * sample::topics().len());
        let info = file_info(path).unwrap();
        assert!(info.complete);
        assert_eq!(info.attachments, ["Sample.xodr"]);
        assert_eq!(info.metadata["gantry"]["domain"], "sample");
        assert_eq!(info.metadata["set"]["part"], (number + 1).to_string());
        assert_eq!(info.metadata["set"]["set"], info.metadata["set_end"]["set"]);
        let next = names
            .get(number + 1)
            .map_or("", |it| it.file_name().unwrap().to_str().unwrap());
        assert_eq!(info.metadata["set_end"]["next"], next);
        assert!(
            info.text()
                .contains(&format!("file {} of the set", number + 1))
        );
        let file = RecordingFile::open(path).unwrap();
        let (start, _) = file.span().unwrap();
        let documents = file.documents_at(start).unwrap();
        assert_eq!(documents.len(), 1, "{}", path.display());
        assert_eq!(documents[0].text, r#"{"map":"Sample"}"#);
    }

    // Joined again, the set is what it would have been as one file.
    let whole = folder.path().join("whole.mcap");
    merge(&names, &whole).unwrap();
    sample::assert_frames(&whole, 1..=35);
    let info = file_info(&whole).unwrap();
    assert_eq!(info.attachments, ["Sample.xodr"]);
    assert!(!info.metadata.contains_key("set"));
    let documents = info.channels.iter().find(|it| it.topic == "/world/info");
    assert_eq!(documents.unwrap().n_messages, 1);
    let once = folder.path().join("once.mcap");
    let n_once = sample::record_to(files(&once, Split::default()), 35, Coding::default()).unwrap();
    assert_eq!(info.n_messages, n_once[0].1.messages.values().sum::<u64>());
}

#[test]
fn files_are_split_by_size() {
    let folder = tempfile::tempdir().unwrap();
    let base = folder.path().join("drive.mcap");
    let split = Split {
        max_bytes: Some(5_000_000),
        ..Split::default()
    };
    let files = Files::create(&base, ChunkCompression::None, split).unwrap();
    let target = Target::Files(Box::new(files));
    let written = sample::record_to(target, 300, Coding::none()).unwrap();
    assert!(written.len() > 2, "{} files", written.len());
    let (last, others) = written.split_last().unwrap();
    let n_frames: usize = written
        .iter()
        .map(|(path, _)| sample::frames_of(path).len())
        .sum();
    assert_eq!(n_frames, 300 * sample::topics().len());
    for (path, written) in others {
        // A chunk may be open when the size is looked at.
        let size = written.file_bytes;
        assert!(
            (5_000_000..15_000_000).contains(&size),
            "{}: {size}",
            path.display()
        );
    }
    assert!(last.1.file_bytes < 15_000_000);
}

fn ring_of(base: &Path, keep_ticks: u64, max_bytes: usize, dump_at_end: bool) -> Target {
    let (_sender, requests) = crossbeam_channel::unbounded();
    let settings = Ring {
        keep_nanos: keep_ticks * PERIOD_NANOS,
        max_bytes,
        dump_at_end,
        requests: requests.clone(),
    };
    let ring = ring::Ring::new(base, ChunkCompression::Lz4, settings);
    Target::Ring(Box::new(ring), requests)
}

#[test]
fn a_ring_holds_the_newest_and_what_they_need() {
    let folder = tempfile::tempdir().unwrap();
    let base = folder.path().join("crash.mcap");
    let target = ring_of(&base, 10, 1 << 30, true);
    let written = sample::record_to(target, 50, Coding::default()).unwrap();
    assert_eq!(written.len(), 1);
    assert_eq!(written[0].0, file_of_set(&base, 1));
    let path = &written[0].0;
    sample::assert_frames(path, 40..=50);
    assert_eq!(sample::frames_of(path).len(), 11 * sample::topics().len());
    let info = file_info(path).unwrap();
    assert_eq!(info.attachments, ["Sample.xodr"]);
    assert_eq!(info.metadata["dump"]["note"], "the recording ended");
    let file = RecordingFile::open(path).unwrap();
    assert_eq!(file.documents_at(u64::MAX - 1).unwrap().len(), 1);
    assert_eq!(file.span().unwrap(), (40 * PERIOD_NANOS, 50 * PERIOD_NANOS));
}

#[test]
fn a_ring_stays_within_its_memory() {
    let folder = tempfile::tempdir().unwrap();
    let base = folder.path().join("crash.mcap");
    let written =
        sample::record_to(ring_of(&base, 1000, 2_000_000, true), 200, Coding::none()).unwrap();
    let info = file_info(&written[0].0).unwrap();
    assert!(info.unpacked_bytes < 2_200_000, "{}", info.unpacked_bytes);
    assert_eq!(info.end_sim_nanos, 200 * PERIOD_NANOS);
    let quiet = folder.path().join("quiet.mcap");
    let nothing = sample::record_to(ring_of(&quiet, 10, 1 << 30, false), 20, Coding::none());
    assert!(nothing.unwrap().is_empty() && !file_of_set(&quiet, 1).exists());
}

#[test]
fn a_ring_is_dumped_on_request_while_it_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let base = folder.path().join("crash.mcap");
    let (sender, requests) = crossbeam_channel::unbounded();
    let settings = options::Ring {
        keep_nanos: 5 * PERIOD_NANOS,
        max_bytes: 1 << 30,
        dump_at_end: true,
        requests: requests.clone(),
    };
    // Asked before there is anything.
    let (request, answers) = DumpRequest::new("too early");
    sender.send(request).unwrap();
    let ring = ring::Ring::new(&base, ChunkCompression::Lz4, settings);
    let target = Target::Ring(Box::new(ring), requests);
    sample::record_to(target, 20, Coding::none()).unwrap();
    // The first job that the writer takes is the document, so that the dump holds nothing else.
    match answers.recv().unwrap() {
        Ok(done) => assert!(done.n_messages >= 1 && done.secs < 0.3, "{done:?}"),
        Err(error) => assert!(error.0.contains("nothing was recorded yet"), "{error}"),
    }
}

#[test]
fn a_cut_keeps_documents_map_and_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = coded(folder.path(), 40, Coding::default());
    let out = folder.path().join("short.mcap");
    let cut = Cut {
        from_nanos: 10 * PERIOD_NANOS,
        to_nanos: 20 * PERIOD_NANOS,
        select: Select {
            topics: vec!["ego/front/*".into()],
            exclude: vec!["*/flow".into()],
        },
    };
    trim(&path, &out, &cut).unwrap();
    let found = sample::frames_of(&out);
    assert_eq!(found.len(), 10 * 5, "ten ticks of five modalities");
    for ((topic, tick), (_, payload)) in &found {
        assert!((10..20).contains(tick) && topic.starts_with("ego/front/"));
        assert!(*payload == sample::frame(topic, *tick).1, "{topic} {tick}");
    }
    let info = file_info(&out).unwrap();
    assert!(info.complete && info.attachments == ["Sample.xodr"]);
    assert_eq!(info.start_sim_nanos, 10 * PERIOD_NANOS);
    let file = RecordingFile::open(&out).unwrap();
    let documents = file.documents_at(10 * PERIOD_NANOS).unwrap();
    assert_eq!(documents[0].text, r#"{"map":"Sample"}"#);

    let beyond = Cut {
        from_nanos: 100_000 * PERIOD_NANOS,
        to_nanos: u64::MAX,
        ..cut
    };
    let nothing = folder.path().join("nothing.mcap");
    let error = trim(&path, &nothing, &beyond).unwrap_err().to_string();
    assert!(error.contains("it covers 0.000 s to 2.000 s"), "{error}");
    assert!(!nothing.exists());
}

#[test]
fn recordings_of_different_versions_or_runs_are_not_joined() {
    let folder = tempfile::tempdir().unwrap();
    let make = |name: &str, version: &str, epoch: &str| {
        let path = folder.path().join(name);
        let mut file =
            schema_recording::write::Recording::create(&path, ChunkCompression::Lz4).unwrap();
        let pairs = |key: &str, value: &str| [(key.to_string(), value.to_string())].into();
        file.metadata("gantry", &pairs("schema_version", version))
            .unwrap();
        file.metadata("world/info", &pairs("epoch", epoch)).unwrap();
        file.finish().unwrap();
        path
    };
    let now = schema_frames::SCHEMA_VERSION.to_string();
    let first = make("a.mcap", &now, "7");
    let out = folder.path().join("out.mcap");
    let other_run = make("b.mcap", &now, "8");
    let error = merge(&[first.clone(), other_run], &out)
        .unwrap_err()
        .to_string();
    assert!(error.contains("different runs"), "{error}");
    let newer = make("c.mcap", "999", "7");
    let error = format!("{:#}", merge(&[first, newer], &out).unwrap_err());
    assert!(error.contains("999"), "{error}");
    assert!(!out.exists());
}

#[test]
fn cat_tells_every_field_but_the_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let path = coded(folder.path(), 12, Coding::default());
    let cut = Cut {
        from_nanos: 2 * PERIOD_NANOS,
        to_nanos: 4 * PERIOD_NANOS,
        select: Select {
            topics: vec!["ego/imu/imu".into(), "ego/front/rgb".into()],
            exclude: vec![],
        },
    };
    let mut out = Vec::new();
    cat(&path, &cut, true, &mut out).unwrap();
    let lines: Vec<serde_json::Value> = String::from_utf8(out)
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let of = |topic: &str| -> Vec<&serde_json::Value> {
        lines.iter().filter(|line| line["topic"] == topic).collect()
    };
    let imu = of("/ego/imu/imu");
    assert_eq!(imu.len(), 2);
    assert_eq!(imu[1]["message"]["angular_velocity_z_radps"], 3.0);
    assert_eq!(imu[1]["log_time"], 3 * PERIOD_NANOS);
    let frame = of("/ego/front/rgb/gantry")[0];
    assert_eq!(frame["message"]["codec"], "png");
    assert_eq!(frame["message"]["header"]["bytes"], 256);
    assert_eq!(of("/ego/front/rgb")[0]["message"]["format"], "png");
    assert!(of("/ego/front/depth").is_empty() && !of("/world/snapshot").is_empty());
    let mut text = Vec::new();
    cat(&path, &cut, false, &mut text).unwrap();
    let text = String::from_utf8(text).unwrap();
    assert!(
        text.contains("0.150000 /ego/imu/imu gantry.Imu seq 3 "),
        "{text}"
    );
}

/// Goal: nothing that trim, merge and cat are given makes them panic. Method: mutations of a file.
#[test]
fn damaged_files_are_refused_by_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let path = coded(folder.path(), 3, Coding::default());
    let whole = std::fs::read(&path).unwrap();
    let broken = folder.path().join("broken.mcap");
    let out = folder.path().join("out.mcap");
    let all = Cut {
        from_nanos: 0,
        to_nanos: u64::MAX,
        select: Select::default(),
    };
    // The record that ends the data.
    let mut data_end = mcap::MAGIC.len();
    while whole[data_end] != 0x0f {
        let len: [u8; 8] = whole[data_end + 1..data_end + 9].try_into().unwrap();
        data_end += 9 + u64::from_le_bytes(len) as usize;
    }
    let mut rng = fastrand::Rng::with_seed(8);
    for round in 0..200 {
        let mut bytes = whole.clone();
        match round % 3 {
            // The summary behind the data is not needed.
            0 => bytes.truncate(rng.usize(..data_end)),
            _ => {
                for _ in 0..rng.usize(1..4) {
                    let at = rng.usize(..bytes.len());
                    bytes[at] ^= 1 << rng.u8(..8);
                }
            }
        }
        std::fs::write(&broken, &bytes).unwrap();
        let said = [
            cat(&broken, &all, true, &mut std::io::sink()).err(),
            trim(&broken, &out, &all).err(),
            merge(&[broken.clone(), path.clone()], &out.with_extension("both")).err(),
        ];
        if round % 3 == 0 {
            assert!(
                said[0].is_some() && said[1].is_some(),
                "a file that was cut off at {}",
                bytes.len()
            );
        }
        for name in [&out, &out.with_extension("both")] {
            let _ = std::fs::remove_file(name);
        }
    }
    for (bytes, told) in [
        (&b""[..], "not an MCAP file"),
        (&b"bagfile"[..], "not an MCAP file"),
    ] {
        std::fs::write(&broken, bytes).unwrap();
        let error = format!("{:#}", trim(&broken, &out, &all).unwrap_err());
        assert!(error.contains(told), "{error}");
    }
}

/// Goal: after a loss of power a file ends anywhere, and everything in front of the last whole chunk
/// is there. Method: cuts at random places of a recording of many chunks.
#[test]
fn wherever_a_file_is_cut_the_chunks_before_are_rescued() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("whole.mcap");
    let target = Files::create(&path, ChunkCompression::None, Split::default()).unwrap();
    sample::record_to(Target::Files(Box::new(target)), 400, Coding::default()).unwrap();
    let whole = std::fs::read(&path).unwrap();
    let frames = sample::frames_of(&path);
    let (cut, out) = (
        folder.path().join("cut.part"),
        folder.path().join("out.mcap"),
    );
    let mut rng = fastrand::Rng::with_seed(9);
    let mut found: Vec<(usize, usize)> = Vec::new();
    for _ in 0..20 {
        let end = rng.usize(9..whole.len());
        std::fs::write(&cut, &whole[..end]).unwrap();
        recover_file(&cut, &out).unwrap();
        assert!(file_info(&out).unwrap().complete);
        let rescued = sample::frames_of(&out);
        for (key, (_, payload)) in &rescued {
            assert!(*payload == frames[key].1, "{key:?} of a file cut at {end}");
        }
        found.push((end, rescued.len()));
        std::fs::remove_file(&out).unwrap();
    }
    found.sort_unstable();
    assert!(
        found.windows(2).all(|pair| pair[0].1 <= pair[1].1),
        "{found:?}"
    );
    let per_chunk = frames.len() as f64 * (6 << 20) as f64 / whole.len() as f64;
    for (end, n) in found {
        let expected = frames.len() as f64 * end as f64 / whole.len() as f64;
        assert!(
            n as f64 + per_chunk >= expected,
            "{n} frames of a file cut at {end}"
        );
    }
}

/// Goal: what was recorded more than a second ago is in the file, although nobody has finished it.
#[test]
fn what_was_recorded_reaches_the_file_without_being_finished() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("going.mcap");
    let target = files(&path, Split::default());
    let (queue, bench, outlet) = queue(1 << 20);
    let writer = std::thread::spawn(move || writer::run(target, outlet));
    let pairs = [("key".to_string(), "value".to_string())].into();
    let name = "early".to_string();
    queue.push(Job::Metadata { name, pairs }).unwrap();
    let part = schema_recording::write::part_path(&path);
    let deadline = std::time::Instant::now() + std::time::Duration::from_secs(60);
    while !file_info(&part).is_ok_and(|info| info.metadata.contains_key("early")) {
        assert!(
            std::time::Instant::now() < deadline,
            "it never reached the file"
        );
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    drop((queue, bench));
    writer.join().unwrap().unwrap();
    assert!(path.exists() && !part.exists());
}

/// A file of 40 kB whose one chunk unpacks to a gigabyte.
#[test]
fn a_chunk_that_unpacks_to_a_gigabyte_costs_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (
        folder.path().join("bomb.mcap"),
        folder.path().join("out.mcap"),
    );
    let mut packed = zstd::stream::Encoder::new(Vec::new(), 1).unwrap();
    let zeros = vec![0u8; 1 << 20];
    for _ in 0..1 << 10 {
        std::io::Write::write_all(&mut packed, &zeros).unwrap();
    }
    let packed = packed.finish().unwrap();
    let mut body = [0u64, 0, 1 << 30].map(u64::to_le_bytes).concat();
    body.extend(0u32.to_le_bytes());
    body.extend(4u32.to_le_bytes());
    body.extend(b"zstd");
    body.extend((packed.len() as u64).to_le_bytes());
    body.extend(&packed);
    let mut bytes = mcap::MAGIC.to_vec();
    // A header record with an empty profile and library, then the chunk.
    bytes.extend([1, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    bytes.push(6);
    bytes.extend((body.len() as u64).to_le_bytes());
    bytes.extend(body);
    std::fs::write(&path, bytes).unwrap();
    let info = file_info(&path).unwrap();
    assert_eq!((info.n_chunks, info.n_bad_chunks), (1, 1));
    let rescued = recover_file(&path, &out).unwrap();
    assert_eq!((rescued.n_bad_chunks, rescued.n_messages), (1, 0));
    let all = Cut {
        from_nanos: 0,
        to_nanos: u64::MAX,
        select: Select::default(),
    };
    let error = cat(&path, &all, true, &mut std::io::sink()).unwrap_err();
    assert!(
        error.to_string().contains("damaged or not finished"),
        "{error}"
    );
}
