//! Listeners of several threads, and of processes that were killed.

use std::path::PathBuf;

use schema_bus::names;

use crate::place::Place;

/// The mask of this process for the modes of files that it makes.
fn file_mode_mask() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("Umask:"));
    line.expect("Linux says it since 4.7").to_owned()
}

/// Goal: threads that make listeners at the same time leave the process the file mode mask that it
/// had; else programs that it builds or starts from then on can make no folder that they may enter.
#[test]
fn listeners_made_at_once_leave_the_file_mode_mask() {
    let before = file_mode_mask();
    let place = Place::new("listeners");
    std::thread::scope(|threads| {
        for _ in 0..4 {
            threads.spawn(|| {
                let bus = place.bus("test");
                for _ in 0..100 {
                    drop(bus.listener(names::WORLD_SNAPSHOT).unwrap());
                }
            });
        }
    });
    assert_eq!(file_mode_mask(), before);
}

/// Files of the place's listeners: states in shared memory, and sockets.
fn files_of_listeners(place: &Place) -> Vec<PathBuf> {
    let mut found = Vec::from_iter(place.files());
    found.retain(|path| {
        let name = path.to_string_lossy();
        name.ends_with(".event") || name.ends_with(".event_mgmt")
    });
    found
}

/// A process makes the state and the socket of a listener, then tells the service of it. It can be
/// killed between the two: nobody but the files knows of the listener then.
#[test]
fn a_listener_whose_maker_was_killed_is_removed() {
    let place = Place::new("listeners");
    let bus = place.bus("one");
    let mut child = std::process::Command::new("true").spawn().unwrap();
    let gone = child.id();
    child.wait().unwrap();
    let listener = bus.listener(names::WORLD_SNAPSHOT).unwrap();
    let of_listener = files_of_listeners(&place);
    assert_eq!(
        of_listener.len(),
        2,
        "a state and a socket: {of_listener:?}"
    );
    for path in &of_listener {
        // The listener's id ends the name; of its four numbers the third is the process.
        let name = path.file_name().unwrap().to_str().unwrap();
        let (stem, end) = name.split_once(".event").unwrap();
        let (start, id) = stem.split_at(stem.rfind('_').map_or(0, |at| at + 1));
        let mut bytes = id.parse::<u128>().unwrap().to_ne_bytes();
        let of_process = &mut bytes[8..12];
        assert_eq!(of_process, std::process::id().to_ne_bytes());
        of_process.copy_from_slice(&gone.to_ne_bytes());
        let id = u128::from_ne_bytes(bytes);
        let left = path.with_file_name(format!("{start}{id}.event{end}"));
        std::fs::write(left, "").unwrap();
    }
    assert_eq!(files_of_listeners(&place).len(), 4);
    let other = place.bus("two");
    assert_eq!(files_of_listeners(&place), of_listener);
    drop((listener, bus, other));
    assert_eq!(files_of_listeners(&place), Vec::<PathBuf>::new());
}
