//! Disks that fill up and too few descriptors: programs end with a sentence, what they wrote before
//! can be read, and nothing is left in shared memory.

use std::path::Path;

use test_e2e::recording::sequences;
use test_e2e::{SMALL_RIG, assert_nothing_left, mount_namespace, start_daemon, venv_program};
use test_kit::sandbox::binary_path;
use test_kit::{Process, Sandbox};

/// Runs a line of the shell with `simd` and others on its path, in the sandbox.
fn shell(sandbox: &Sandbox, line: &str) -> Process {
    let line = format!("PATH={}:$PATH; {line}", binary_folder().display());
    sandbox.spawn_program("sh", Path::new("/bin/sh"), &["-c", &line], &[])
}

fn binary_folder() -> std::path::PathBuf {
    let simd = binary_path("simd");
    simd.parent().expect("programs lie in a folder").to_owned()
}

/// Runs a line where `disk` is a disk of a few MiB, in a mount namespace of its own.
fn on_a_small_disk(sandbox: &Sandbox, n_mib: u32, line: &str) -> Process {
    std::fs::create_dir(sandbox.path("disk")).expect("a fresh sandbox");
    let own = mount_namespace().join(" ");
    let mount = format!("mount -t tmpfs -o size={n_mib}m tmpfs disk");
    shell(
        sandbox,
        &format!("unshare {own} sh -c '{mount} || exit 99; {line}'"),
    )
}

/// Rerun itself reads what was written.
fn opens_in_rerun(sandbox: &Sandbox, file: &str) {
    let args = ["rrd", "stats", file];
    let env = [("DO_NOT_TRACK", "1")];
    let read = sandbox.spawn_program("rerun", &venv_program("rerun"), &args, &env);
    let ended = read.wait().expect_code(0);
    assert!(!ended.says("truncated"), "{:#?}", ended.lines);
}

#[test]
fn a_file_that_may_not_grow_ends_a_viewing_with_a_sentence_and_opens() {
    let sandbox = Sandbox::new("view-short");
    let mut daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    // 800 blocks of 512 or 1024 bytes.
    let line = format!(
        "ulimit -f 800; exec gantry-view --save short.rrd --domain {}",
        sandbox.domain()
    );
    let ended = shell(&sandbox, &line).wait().expect_code(1);
    assert!(
        ended.says("cannot write short.rrd: File too large"),
        "{:#?}",
        ended.lines
    );
    opens_in_rerun(&sandbox, "short.rrd");
    assert!(daemon.is_running());
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn a_full_disk_ends_a_viewing_with_a_sentence_and_the_file_opens() {
    let sandbox = Sandbox::new("view-full");
    let daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    let line = format!(
        "gantry-view --save disk/full.rrd --domain {}; echo code $?; cp disk/full.rrd .",
        sandbox.domain()
    );
    let ended = on_a_small_disk(&sandbox, 1, &line).wait().expect_code(0);
    let sentence = "cannot write disk/full.rrd: No space left on device";
    assert!(
        ended.says(sentence) && ended.says("code 1"),
        "{:#?}",
        ended.lines
    );
    opens_in_rerun(&sandbox, "full.rrd");
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

#[test]
fn a_full_disk_ends_a_recording_and_what_was_written_is_recovered() {
    let sandbox = Sandbox::new("record-full-disk");
    let daemon = start_daemon(&sandbox, SMALL_RIG, &[]);
    let line = format!(
        "gantry-record --out disk/a.mcap --codec none --compression none --domain {}; echo code $?; gantry-record recover disk/a.mcap.part rescued.mcap",
        sandbox.domain()
    );
    let ended = on_a_small_disk(&sandbox, 12, &line).wait().expect_code(0);
    assert!(
        ended.says("could not be written to its end")
            && ended.says("No space left on device")
            && ended.says("code 1"),
        "{:#?}",
        ended.lines
    );
    let found = sequences(&sandbox.path("rescued.mcap"));
    assert!(!found["/world/snapshot"].is_empty());
    daemon.stop().expect_code(0);
    assert_nothing_left(&sandbox);
}

/// Wherever the descriptors end, a program ends with a sentence or lives: none panics, and none
/// leaves anything behind.
#[test]
fn too_few_descriptors_are_a_sentence() {
    let sandbox = Sandbox::new("few-descriptors");
    sandbox.write("launch.toml", SMALL_RIG);
    // How many a process inherits differs from machine to machine, so a stretch of limits is tried
    // one by one: it holds every step of opening a topic.
    let limits = [12, 18].into_iter().chain(24..=36).chain([48, 60, 78, 96]);
    for n in limits {
        let line = format!(
            "ulimit -n {n}; exec simd --launch launch.toml --ticks 3 --unpaced --domain {}",
            sandbox.domain()
        );
        let ended = shell(&sandbox, &line).wait();
        let panicked = ended.lines.iter().any(|line| line.contains("panicked"));
        let is_named = ended.says("ulimit -n") || ended.says("Too many open files");
        let is_told =
            ended.says("error: ") && is_named && [Some(1), Some(2)].contains(&ended.status.code());
        assert!(
            !panicked && (is_told || ended.status.success()),
            "{n} descriptors, {:?}: {:#?}",
            ended.status,
            ended.lines
        );
    }
    assert_nothing_left(&sandbox);
}
