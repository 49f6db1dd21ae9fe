//! Connections between ports of which a process was killed.

use std::path::PathBuf;
use std::sync::mpsc::channel;
use std::time::Duration;

use schema_bus::{Bus, FrameTopic};

use crate::bus::{is_eventually, start_child};
use crate::place::Place;

const TOPIC: &str = "ego/front/rgb";
/// Longer than whatever may be waited for.
const PATIENCE: Duration = Duration::from_secs(60);

fn connections(place: &Place) -> Vec<PathBuf> {
    let mut found = Vec::from_iter(place.files());
    found.retain(|path| path.to_string_lossy().ends_with(".connection"));
    found
}

/// A process makes the memory of a connection in two steps, a name and a size, and may be killed
/// between the two. iceoryx2 waits for the size without a limit.
#[test]
fn a_connection_that_a_killed_process_left_without_a_size_stops_nobody() {
    let place = Place::new("sizeless");
    let mut child = start_child(&place, "both");
    is_eventually("the child's ports are connected", || {
        connections(&place).len() == 1
    });
    child.kill().unwrap();
    child.wait().unwrap();
    for path in connections(&place) {
        let file = std::fs::OpenOptions::new().write(true).open(path).unwrap();
        file.set_len(0).unwrap();
    }
    let (options, (done, ended)) = (place.options(), channel());
    std::thread::spawn(move || {
        let bus = Bus::open_with("d", "reader", &options).unwrap();
        bus.clean_dead_nodes();
        let _ = done.send(bus);
    });
    let bus = ended
        .recv_timeout(PATIENCE)
        .expect("a process cleans up after the killed one, and goes on");
    is_eventually("nothing of it is left", || {
        bus.clean_dead_nodes();
        connections(&place).is_empty()
    });
}

/// A connection that a killed process never noted itself in, with a process that lives.
#[test]
fn a_connection_with_a_process_that_is_gone_is_removed() {
    let place = Place::new("halves");
    let bus = place.bus("one");
    let mut child = std::process::Command::new("true").spawn().unwrap();
    let gone = child.id();
    child.wait().unwrap();
    let spec = FrameTopic {
        max_payload_bytes: 64,
        frames_in_flight: 2,
        max_readers: 4,
        buffer: 2,
        borrowed: 3,
    };
    let publisher = bus.frame_publisher(TOPIC, spec).unwrap();
    let mut reader = bus.frame_reader(TOPIC).unwrap();
    let send = || {
        publisher.loan(64).unwrap().send().unwrap();
    };
    send();
    let of_living = connections(&place);
    assert_eq!(of_living.len(), 1, "{of_living:?}");
    let name = of_living[0].file_name().unwrap().to_str().unwrap();
    let stem = name.strip_suffix(".connection").unwrap();
    let (start, id) = stem.split_at(stem.rfind('_').unwrap() + 1);
    let mut bytes = id.parse::<u128>().unwrap().to_ne_bytes();
    // Of the id's four numbers the third is the process.
    let of_process = &mut bytes[8..12];
    assert_eq!(of_process, std::process::id().to_ne_bytes());
    of_process.copy_from_slice(&gone.to_ne_bytes());
    let id = u128::from_ne_bytes(bytes);
    let left = of_living[0].with_file_name(format!("{start}{id}.connection"));
    std::fs::write(&left, [0; 4096]).unwrap();
    let other = place.bus("two");
    assert_eq!(connections(&place), of_living);
    assert!(
        reader.next().unwrap().is_some(),
        "the living one still connects"
    );
    drop((publisher, reader, bus, other));
    assert_eq!(connections(&place), Vec::<PathBuf>::new());
}
