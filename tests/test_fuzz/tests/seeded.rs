//! Every target on its seeds and on thousands of changed ones, the same every time. A round that
//! panics is printed with its number; `GANTRY_SOAK` makes them a hundred times as many.

use std::panic::catch_unwind;

use test_fuzz::mutate::mutant;
use test_fuzz::{TARGETS, Target};

const SEED: u64 = 20_261_123;

fn run(name: &str, n_rounds: u64) {
    let target: &Target = TARGETS
        .iter()
        .find(|target| target.name == name)
        .expect("a target of this name");
    let seeds = (target.seeds)();
    seeds.iter().for_each(|seed| (target.run)(seed));
    let factor = if std::env::var_os("GANTRY_SOAK").is_some() {
        100
    } else {
        1
    };
    for round in 0..n_rounds * factor {
        let mut random = fastrand::Rng::with_seed(SEED + round);
        let bytes = mutant(&seeds, target.is_text, &mut random);
        if catch_unwind(|| (target.run)(&bytes)).is_err() {
            let file = std::env::temp_dir().join(format!("fuzz-{name}-{round}"));
            let _ = std::fs::write(&file, &bytes);
            panic!(
                "{name}: round {round} panicked; its bytes are in {}",
                file.display()
            );
        }
    }
}

macro_rules! targets {
    ($($name:ident $n_rounds:literal;)*) => {$(
        #[test]
        fn $name() {
            run(stringify!($name), $n_rounds);
        }
    )*

        /// Every target is run here, and under cargo-fuzz.
        #[test]
        fn every_target_has_a_test_and_a_file() {
            let tests = [$(stringify!($name)),*];
            let mut names: Vec<&str> = TARGETS.iter().map(|target| target.name).collect();
            assert_eq!(names, tests);
            let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fuzz/fuzz_targets");
            let mut files: Vec<String> = std::fs::read_dir(folder)
                .expect("the folder of targets")
                .flatten()
                .map(|file| file.file_name().to_string_lossy().replace(".rs", ""))
                .collect();
            files.sort();
            names.sort();
            assert_eq!(files, names);
        }
    };
}
targets! {
    rpc 20_000;
    managers 3_000;
    browsers 20_000;
    streams 5_000;
    opendrive 600;
    launch_files 3_000;
    calibrations 2_000;
    recordings 1_500;
    carla_logs 10_000;
    checkpoints 2_000;
    results 20_000;
    journals 5_000;
    bridges 20_000;
    gpu_socket 3_000;
}

/// The crafted recordings can be read as far as they are meant to: the plain one whole.
#[test]
fn crafted_recordings_are_what_they_are_meant_to_be() {
    use schema_recording::read::{RecordingFile, Selection};
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in test_fuzz::crafted::recordings() {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let file = match RecordingFile::open(&path) {
            Ok(file) => file,
            Err(error) => {
                assert!(name.starts_with("metadata"), "{name}: {error:#}");
                continue;
            }
        };
        let (start, end) = file.span().unwrap_or_default();
        assert!(start <= end, "{name}: {start} to {end}");
        let mut samples = file.samples(&Selection::default());
        let mut n = 0;
        while samples.next().unwrap().is_some() {
            n += 1;
        }
        match name {
            "plain" | "chunk_ends_first" | "chunk_ends_first_walked" | "counts" => {
                assert_eq!((n, samples.damage().total()), (2, 0), "{name}");
            }
            "snapshots_near_the_end" | "frames_near_the_end" | "times_near_the_end" => {
                assert_eq!((n, samples.damage().total()), (3, 0), "{name}");
            }
            _ => {}
        }
        if name == "plain" {
            assert_eq!(file.walked_because(), None);
        }
    }
}

/// The seeds are such that the targets get far: each can be read whole.
#[test]
fn seeds_can_be_read() {
    for bytes in test_fuzz::seeds::checkpoints() {
        let world = test_fuzz::seeds::signalled_world();
        let read = simd_world::Checkpoint::from_bytes(&bytes, &world);
        read.map(drop).unwrap();
        let mut mended = bytes.clone();
        test_fuzz::targets::mend_checkpoint(&mut mended);
        assert_eq!(mended, bytes, "whole bytes are not changed by mending");
    }
    use consumer_carla::recorder::file::Reader;
    for text in test_fuzz::seeds::opendrive() {
        let text = String::from_utf8(text).unwrap();
        assert!(
            !schema_roads::RoadMap::parse(&text)
                .unwrap()
                .lanes()
                .is_empty()
        );
    }
    for text in test_fuzz::seeds::launch_files() {
        let text = String::from_utf8(text).unwrap();
        launch_spec::Launch::parse(&text, "launch.toml").unwrap();
    }
    for text in test_fuzz::seeds::calibrations() {
        let text = String::from_utf8(text).unwrap();
        schema_calibration::read(&text, None, Some([800, 600])).unwrap();
    }
    for log in test_fuzz::seeds::carla_logs() {
        let mut reader = Reader::new(&log[..]).unwrap();
        assert!(reader.next_frame().unwrap().is_some());
        assert!(reader.next_frame().unwrap().is_some());
    }
    for bytes in test_fuzz::seeds::results() {
        let (head, body) = bytes.split_at(size_of::<schema_frames::ResultHeader>());
        let header: schema_frames::ResultHeader = bytemuck::pod_read_unaligned(head);
        header.check(body.len()).unwrap();
    }
    for journal in test_fuzz::seeds::journals() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), journal).unwrap();
        let (mut reader, _) = simd::JournalReader::open(file.path()).unwrap();
        let stretch = reader.read_on();
        // Two of the six entries are the pieces of one file.
        assert_eq!(stretch.entries.len(), 5);
        assert!(matches!(stretch.end, Some(Ok(()))));
    }
    let said = test_fuzz::seeds::bridges();
    let (announced, refused) =
        consumer_bridge::announce::Announcement::parse(&said[0][1..]).unwrap();
    assert_eq!((announced.topics.len(), refused), (4, None));
    serde_json::from_slice::<schema_frames::CommandBatch>(&said[2][1..]).unwrap();
    serde_json::from_slice::<schema_frames::ReplyBatch>(&said[3][1..]).unwrap();
    let mut frames: Vec<Vec<u8>> = Vec::new();
    for sample in said.iter().filter(|bytes| bytes[0] == 4) {
        let len = usize::from(u16::from_le_bytes([sample[1], sample[2]]));
        let (envelope, payload) = sample[3..].split_at(len);
        let envelope = zenoh::bytes::ZBytes::from(envelope);
        let envelope = consumer_bridge::wire::Envelope::open(Some(&envelope)).unwrap();
        let (header, _) = envelope.header::<schema_frames::FrameHeader>().unwrap();
        let mut out = vec![0; envelope.raw_bytes];
        let payload = zenoh::bytes::ZBytes::from(payload);
        let frame = Some(&header);
        consumer_bridge::coding::decode(envelope.coding, frame, &payload, &mut out).unwrap();
        frames.push(out);
    }
    assert_eq!(frames.len(), 5);
    assert!(frames[1..4].iter().all(|frame| *frame == frames[0]));
}
