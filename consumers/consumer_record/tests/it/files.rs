//! Recordings on disk: what goes in comes out, cut files are rescued, and no bytes whatever make a
//! reader panic.

use crate::sample;

use std::collections::BTreeMap;

use consumer_record::info::{file_info, info};
use consumer_record::recover::{recover, recover_file};
use sample::{PERIOD_NANOS, WALL_NANOS};
use schema_recording::walk::{End, RecordWalk};
use schema_recording::wire::bytes_field;
use schema_recording::write::{ChunkCompression, Recording, part_path};

#[test]
fn every_byte_of_every_frame_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    for compression in [
        ChunkCompression::None,
        ChunkCompression::Lz4,
        ChunkCompression::Zstd,
    ] {
        let _ = std::fs::remove_file(&path);
        sample::record(&path, 12, compression).unwrap();
        assert!(!part_path(&path).exists());
        let bytes = std::fs::read(&path).unwrap();
        let mut n_messages = 0;
        let mut data: BTreeMap<(String, u64), (Vec<u8>, u64)> = BTreeMap::new();
        for message in mcap::MessageStream::new(&bytes).unwrap() {
            let message = message.unwrap();
            n_messages += 1;
            data.insert(
                (message.channel.topic.clone(), message.log_time),
                (message.data.to_vec(), message.publish_time),
            );
        }
        for (tick, topic) in
            (1..=12).flat_map(|tick| sample::topics().into_iter().map(move |topic| (tick, topic)))
        {
            let (header, payload) = sample::frame(&topic, tick);
            let (lossless, publish_time) =
                &data[&(format!("/{topic}/gantry"), tick * PERIOD_NANOS)];
            assert_eq!(*publish_time, WALL_NANOS + tick * PERIOD_NANOS);
            assert_eq!(bytes_field(lossless, 4), Some(bytemuck::bytes_of(&header)));
            let found = match bytes_field(lossless, 6) {
                Some(elsewhere) => bytes_field(
                    &data[&(
                        String::from_utf8(elsewhere.to_vec()).unwrap(),
                        tick * PERIOD_NANOS,
                    )]
                        .0,
                    consumer_forms::foxglove::frames::DATA_FIELD,
                )
                .unwrap_or(&[]),
                None => bytes_field(lossless, 5).unwrap_or(&[]),
            };
            assert_eq!(found, payload, "{topic} at tick {tick}");
        }
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        assert_eq!(summary.attachment_indexes.len(), 1);
        assert_eq!(summary.stats.unwrap().message_count, n_messages);
    }
}

#[test]
fn info_tells_rates_and_names() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    sample::record(&path, 21, ChunkCompression::Lz4).unwrap();
    let found = file_info(&path).unwrap();
    assert!(found.complete, "{}", found.problem);
    assert_eq!(found.attachments, ["Sample.xodr"]);
    assert_eq!(found.metadata["gantry"]["domain"], "sample");
    assert_eq!(found.compressions, ["lz4"]);
    let rgb = found
        .channels
        .iter()
        .find(|channel| channel.topic == "/ego/front/rgb")
        .unwrap();
    assert_eq!(
        (rgb.schema.as_str(), rgb.n_messages),
        ("foxglove.RawImage", 21)
    );
    assert!((rgb.rate_hz - 20.0).abs() < 1e-9);
}

#[test]
fn a_cut_file_gives_back_its_complete_chunks() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    // 500 ticks of 80 kB are many chunks of 4 MiB.
    sample::record(&path, 500, ChunkCompression::None).unwrap();
    let whole = file_info(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let cut = folder.path().join("cut.mcap.part");
    std::fs::write(&cut, &bytes[..bytes.len() * 6 / 10]).unwrap();
    assert!(!file_info(&cut).unwrap().complete);
    let out = folder.path().join("rescued.mcap");
    let recovered = recover_file(&cut, &out).unwrap();
    assert_eq!(recovered.end, End::CutOff);
    assert_eq!(recovered.n_bad_chunks, 0);
    let rescued = file_info(&out).unwrap();
    assert!(rescued.complete);
    assert_eq!(rescued.attachments, ["Sample.xodr"]);
    let share = rescued.n_messages as f64 / whole.n_messages as f64;
    // Frames of events grow with the tick, so messages and bytes are not in proportion; two chunks
    // cover it.
    let tolerance = 2.0 / whole.n_chunks as f64;
    assert!(
        (share - 0.6).abs() < tolerance,
        "{share} of the messages, {} chunks",
        whole.n_chunks
    );
    assert!(
        recover_file(&cut, &out)
            .unwrap_err()
            .to_string()
            .contains("exists already")
    );
}

#[test]
fn a_part_file_is_rescued_under_the_name_that_it_would_have_had() {
    let folder = tempfile::tempdir().unwrap();
    let [path, part] = ["a.mcap", "a.mcap.part"].map(|name| folder.path().join(name));
    sample::record(&path, 21, ChunkCompression::Lz4).unwrap();
    let n_messages = file_info(&path).unwrap().n_messages;
    std::fs::rename(&path, &part).unwrap();
    let before = std::fs::read(&part).unwrap();
    assert_eq!(recover_file(&part, &path).unwrap().n_messages, n_messages);
    assert_eq!(file_info(&path).unwrap().n_messages, n_messages);
    assert!(
        std::fs::read(&part).unwrap() == before,
        "what is rescued stays as it was"
    );
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
}

#[test]
fn one_damaged_chunk_costs_only_itself() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    sample::record(&path, 500, ChunkCompression::Lz4).unwrap();
    let whole = file_info(&path).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    // Within a chunk: between two of them lie indices, which nobody misses.
    let summary = mcap::Summary::read(&bytes).unwrap().expect("a summary");
    let chunk = &summary.chunk_indexes[summary.chunk_indexes.len() / 2];
    let middle = (chunk.chunk_start_offset + chunk.chunk_length / 2) as usize;
    bytes[middle..middle + 16]
        .iter_mut()
        .for_each(|byte| *byte ^= 0x5a);
    let recovered = recover(
        RecordWalk::new(bytes.as_slice(), bytes.len() as u64).unwrap(),
        &folder.path().join("rescued.mcap"),
    )
    .unwrap();
    assert_eq!(
        (recovered.n_bad_chunks, recovered.n_chunks),
        (1, whole.n_chunks - 1)
    );
}

#[test]
fn an_existing_file_is_never_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    std::fs::write(&path, "mine").unwrap();
    let error = Recording::create(&path, ChunkCompression::Lz4)
        .err()
        .unwrap();
    assert!(error.to_string().contains("exists already"), "{error}");
    std::fs::remove_file(&path).unwrap();
    std::fs::write(part_path(&path), "half").unwrap();
    let error = Recording::create(&path, ChunkCompression::Lz4)
        .err()
        .unwrap();
    assert!(error.to_string().contains("recover"), "{error}");
}

/// Goal: no bytes make `info` or `recover` panic. Method: a small valid file, mutated with a fixed
/// seed: bytes, whole words, cuts, doublings.
#[test]
fn mutated_files_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut corpus = Vec::new();
    for compression in [
        ChunkCompression::None,
        ChunkCompression::Lz4,
        ChunkCompression::Zstd,
    ] {
        let _ = std::fs::remove_file(&path);
        sample::record(&path, 1, compression).unwrap();
        corpus.push(std::fs::read(&path).unwrap());
    }
    let mut rng = fastrand::Rng::with_seed(20260731);
    for round in 0..1500 {
        let mut bytes = corpus[round % corpus.len()].clone();
        for _ in 0..rng.usize(1..6) {
            mutate(&mut bytes, &mut rng);
        }
        if let Ok(walk) = RecordWalk::new(bytes.as_slice(), bytes.len() as u64) {
            let out = folder.path().join("rescued.mcap");
            recover(walk, &out).unwrap();
            std::fs::remove_file(&out).unwrap();
            info(bytes.as_slice(), bytes.len() as u64).unwrap();
        }
    }
}

fn mutate(bytes: &mut Vec<u8>, rng: &mut fastrand::Rng) {
    // Half of the hits go to the first 4 kB, where headers and lengths are dense.
    let reach = if rng.bool() {
        bytes.len().min(4096)
    } else {
        bytes.len()
    };
    if reach == 0 {
        return;
    }
    let at = rng.usize(0..reach);
    match rng.u8(0..5) {
        0 => bytes[at] = rng.u8(..),
        1 => bytes[at] ^= 1 << rng.u8(0..8),
        2 => bytes[at..].iter_mut().take(8).for_each(|byte| *byte = 0xff),
        3 => bytes.truncate(at),
        _ => {
            let end = (at + rng.usize(1..64)).min(bytes.len());
            let piece = bytes[at..end].to_vec();
            bytes.splice(at..at, piece);
        }
    }
}
