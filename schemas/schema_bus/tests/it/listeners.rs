//! Listeners of several threads.

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
