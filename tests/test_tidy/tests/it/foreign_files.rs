//! Files that somebody else named or wrote are opened by `schema_types::files` alone.

use test_tidy::{files, relative};

/// Ways to open a file for reading that wait at a pipe and never end at a device.
const WAYS: [&str; 4] = [
    "File::open(",
    "fs::read(",
    "fs::read_to_string(",
    ".read(true)",
];
/// The kernel's own files, which are there under these names on every machine.
const OF_THE_KERNEL: [&str; 3] = ["\"/proc/", "\"/dev/urandom\"", "\"/sys/"];

/// Files of product code that open others in these ways, and why they may.
const ALLOWED: [(&str, &str); 19] = [
    ("schemas/schema_types/src/files.rs", "the one function"),
    (
        "schemas/schema_recording/src/write.rs",
        "a folder, whose names it brings to the disk",
    ),
    (
        "schemas/schema_stages/src/read.rs",
        "/proc of processes that it counts",
    ),
    (
        "schemas/schema_bus/src/looking/watch.rs",
        "iceoryx2's segments, which it maps",
    ),
    (
        "schemas/schema_bus/src/memory/leftovers.rs",
        "the bus's own folder, to lock it",
    ),
    (
        "schemas/schema_bus/src/memory/segment_files.rs",
        "iceoryx2's segments, which it maps",
    ),
    (
        "schemas/schema_bus/src/memory/shortage.rs",
        "iceoryx2's segments, which it reserves",
    ),
    (
        "schemas/schema_bus/src/place/gpu_socket.rs",
        "the bus's own folder, to lock it",
    ),
    (
        "schemas/schema_bus/src/ports/frames/writer.rs",
        "its own segment",
    ),
    (
        "consumers/consumer_sets/src/manifest.rs",
        "its own folder, to bring it to the disk",
    ),
    (
        "consumers/consumer_perception/src/run/usage.rs",
        "/proc of the processes that it measures",
    ),
    (
        "consumers/consumer_perception/src/truth_pass/cache.rs",
        "descriptions of its own cache, to lock them",
    ),
    (
        "launch/gantry/src/up/run_dir.rs",
        "its own folders, to lock them",
    ),
    (
        "consumers/consumer_rpc/src/owner.rs",
        "the kernel's lists of connections",
    ),
    (
        "launch/gantry/src/doctor/graphics.rs",
        "devices, to see whether they open",
    ),
    (
        "launch/gantry/src/doctor/limits.rs",
        "/proc and /sys, by path",
    ),
    ("launch/gantry/src/doctor/processor.rs", "/sys, by path"),
    (
        "launch/launch_cli/src/files.rs",
        "what it wrote itself, to bring it to the disk",
    ),
    (
        "launch/launch_cli/src/machine.rs",
        "/proc and /sys, by path",
    ),
];

/// Lines of a source before its unit tests, without comments.
fn product_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let product = text.split("#[cfg(test)]\nmod tests").next().unwrap_or(text);
    let lines = product.lines().enumerate();
    lines.filter(|(_, line)| !line.trim_start().starts_with("//"))
}

#[test]
fn foreign_files_are_opened_by_one_function() {
    let (mut wrong, mut used) = (Vec::new(), Vec::new());
    for path in files(&["rs"]) {
        let name = relative(&path);
        let is_product = !name.starts_with("tests/") && name.contains("/src/");
        if !is_product || name.ends_with("/tests.rs") {
            continue;
        }
        let text = std::fs::read_to_string(&path).expect("a source can be read");
        for (idx, line) in product_lines(&text) {
            let opens = WAYS.iter().any(|way| line.contains(way))
                && !OF_THE_KERNEL.iter().any(|file| line.contains(file));
            if !opens || line.contains("RecordingFile::open(") {
                continue;
            }
            match ALLOWED.iter().find(|(file, _)| *file == name) {
                Some((file, _)) => used.push(*file),
                None => wrong.push(format!("{name}:{}: {}", idx + 1, line.trim())),
            }
        }
    }
    assert!(
        wrong.is_empty(),
        "a pipe or a device in the place of these files waits for ever or has no end; open them with schema_types::files, or say in ALLOWED why nobody else can name them:\n{}",
        wrong.join("\n")
    );
    let idle: Vec<_> = ALLOWED
        .iter()
        .filter(|(file, _)| !used.contains(file))
        .collect();
    assert!(idle.is_empty(), "take these off the list: {idle:?}");
}
