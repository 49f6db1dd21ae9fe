//! Python decodes what the codecs made, with the functions that `docs/how-to/recording.md` shows.

use std::path::{Path, PathBuf};

use bytemuck::bytes_of;
use schema_frames::{DvsEvent, FrameHeader, LidarPoint, Modality};
use schema_recording::codec::{CODECS, Encoder};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// A payload of each kind, so that every codec is used.
fn samples() -> Vec<(FrameHeader, Vec<u8>)> {
    let (w, h) = (40u32, 25u32);
    let image = |modality| {
        let mut header = FrameHeader::new(modality);
        header.set_image(w, h);
        header
    };
    let list = |modality, n: usize| {
        let mut header = FrameHeader::new(modality);
        header.set_list(n as u32);
        header
    };
    let pixels = || (0..h).flat_map(move |y| (0..w).map(move |x| (x, y)));
    let colour = pixels().flat_map(|(x, y)| [x as u8 * 5, y as u8, (x * y) as u8, 255]);
    let classes = pixels().map(|(x, y)| (x / 11 + y / 9) as u8);
    let ids = pixels().flat_map(|(x, _)| (x / 7 * 99_999).to_le_bytes());
    let depth = pixels().flat_map(|(x, y)| (900.0 / (1.0 + y as f32) + x as f32).to_le_bytes());
    let normals =
        pixels().flat_map(|(x, y)| [x as u16, y as u16 * 900, 7, 65_000].map(u16::to_le_bytes));
    let flow = pixels().flat_map(|(x, y)| {
        let before = [x as f32 * 0.97 + 1.3, y as f32 * 1.02 + 0.4];
        [x as f32 + 0.5 - before[0], y as f32 + 0.5 - before[1]].map(f32::to_le_bytes)
    });
    let points = (0..400u16).flat_map(|i| {
        let angle = i as f32 * 0.02;
        let point = LidarPoint {
            hit_in_sensor_m: [angle.cos() * 30.0, angle.sin() * 30.0, -1.0],
            intensity: i,
            channel: i / 50,
        };
        bytes_of(&point).to_vec()
    });
    let mut events: Vec<DvsEvent> = (0..300u32)
        .flat_map(|pixel| {
            (0..1 + pixel % 5).map(move |k| DvsEvent {
                nanos_in_window: 1_000 + pixel * 77 % 911 + k * (5_000 + pixel * 3) + k / 3,
                x_px: (pixel * 7 % 640) as u16,
                y_px: (pixel / 60) as u16,
                object_id: pixel / 40,
                polarity: (pixel / 3 % 2) as u8 ^ (k > 2) as u8,
                class: (pixel / 100) as u8,
                reserved: 0,
            })
        })
        .collect();
    events.sort_by_key(|event| (event.nanos_in_window, event.y_px, event.x_px));
    let n_events = events.len();
    let events = events.iter().flat_map(|event| bytes_of(event).to_vec());
    vec![
        (image(Modality::Rgb), colour.collect()),
        (image(Modality::Semantic), classes.collect()),
        (image(Modality::Instance), ids.collect()),
        (image(Modality::Depth), depth.collect()),
        (image(Modality::Normals), normals.flatten().collect()),
        (image(Modality::Flow), flow.flatten().collect()),
        (list(Modality::Lidar, 400), points.collect()),
        (list(Modality::Dvs, n_events), events.collect()),
    ]
}

#[test]
fn python_decodes_every_codec() {
    let folder = tempfile::tempdir().unwrap();
    let mut encoder = Encoder::new().unwrap();
    let mut used = Vec::new();
    for (header, payload) in samples() {
        let (codec, coded) = encoder
            .encode(&header, &payload)
            .expect("it becomes smaller");
        let name = header.modality().unwrap().name();
        let write = |ending: &str, bytes: &[u8]| {
            std::fs::write(folder.path().join(format!("{name}.{ending}")), bytes).unwrap();
        };
        write("header", bytes_of(&header));
        write("codec", codec.as_bytes());
        write("coded", coded);
        write("payload", &payload);
        used.push(codec);
    }
    for codec in CODECS {
        assert!(used.contains(&codec), "{codec} is not among {used:?}");
    }
    let python = root().join(".venv/bin/python");
    assert!(
        python.exists(),
        "{} is missing: run ./gantry test, which makes the Python environment .venv",
        python.display()
    );
    let output = std::process::Command::new(python)
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/oracle/codecs.py"))
        .arg(folder.path())
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    assert_eq!(
        String::from_utf8_lossy(&output.stdout).lines().count(),
        used.len()
    );
}

#[test]
fn the_page_shows_the_functions_that_are_tested() {
    let script = include_str!("../oracle/codecs.py");
    let (_, rest) = script.split_once("# begin\n").unwrap();
    let (functions, _) = rest.split_once("# end\n").unwrap();
    let page = std::fs::read_to_string(root().join("docs/how-to/recording.md")).unwrap();
    assert!(
        page.contains(functions.trim()),
        "docs/how-to/recording.md must show what is between `# begin` and `# end` of tests/oracle/codecs.py"
    );
}
