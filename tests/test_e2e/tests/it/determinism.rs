//! Same seed, map, launch file and commands: the same bytes in every frame, on the same adapter.

use test_e2e::{SMALL_RIG, spawn_daemon};
use test_kit::Sandbox;

/// The lines "TICK TOPIC HASH" that one run of the daemon prints.
fn hashes(launch: &str, extra: &[&str]) -> Vec<String> {
    let sandbox = Sandbox::new("hash");
    let args = [&["--hash", "--unpaced", "--ticks", "12"], extra].concat();
    let ended = spawn_daemon(&sandbox, launch, &args).wait().expect_code(0);
    let is_hash = |line: &&String| {
        line.split(' ').nth(2).is_some_and(|hash| hash.len() == 16)
            && line.as_bytes()[0].is_ascii_digit()
    };
    let lines: Vec<String> = ended.lines.iter().filter(is_hash).cloned().collect();
    assert!(lines.len() > 12 * 9, "{} lines", lines.len());
    lines
}

#[test]
fn two_runs_with_one_seed_are_equal_in_every_frame() {
    assert_eq!(hashes(SMALL_RIG, &[]), hashes(SMALL_RIG, &[]));
}

#[test]
fn another_seed_gives_other_pictures() {
    assert_ne!(
        hashes(SMALL_RIG, &[]),
        hashes(&SMALL_RIG.replace("seed = 7", "seed = 8"), &[])
    );
}

/// With the one-copy fallback forced, only the header's count of copies may differ, and that is not
/// hashed.
#[test]
fn staged_and_imported_frames_are_the_same_bytes() {
    assert_eq!(hashes(SMALL_RIG, &[]), hashes(SMALL_RIG, &["--staged"]));
}

/// One more sensor changes no byte of the others: noise and ids follow from the sensor itself, not
/// from what else exists.
#[test]
fn another_rig_changes_nothing_for_the_first() {
    let more = format!(
        "{SMALL_RIG}[rig.roadside]\npose = {{ position_m = [0.0, 0.0, 8.0] }}\n[sensor.watch]\nrig = \"roadside\"\nkind = \"camera\"\nwidth_px = 64\nheight_px = 48\n"
    );
    let of_ego = |lines: Vec<String>| {
        lines
            .into_iter()
            .filter(|line| line.contains(" ego/"))
            .collect::<Vec<_>>()
    };
    assert_eq!(of_ego(hashes(SMALL_RIG, &[])), of_ego(hashes(&more, &[])));
}
